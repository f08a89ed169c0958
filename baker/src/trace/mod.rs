//! Light transport: rays, random numbers, and the walk that gathers every layer of a texel at once.

pub mod sampler;
pub mod triangle;
pub mod rays;
pub mod walk;
