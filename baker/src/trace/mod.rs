//! Light transport: rays, solids, the lights of a bake, paths, and the irradiance at which paths end.
//!
//! In: geometry, lights and points of surface. Out: whether rays are blocked and what they meet, and the
//! light of every layer that a path carries. Callers: bakes, previews, `bake new`. Each folder uses only
//! those above it.

mod memory_pages;
pub mod counts;
pub mod rays;
pub mod solids;
pub mod sources;
pub mod paths;
pub mod irradiance;
