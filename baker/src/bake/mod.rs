//! From a scene to a dataset: what to trace, tracing it in rounds, and putting the layers together.
//!
//! One folder is one room, in the order of the data: a room calls those above it alone. Its `mod.rs` is its
//! door: what comes in, what goes out, who calls, and every name that the house may use. [`run`] is the bake
//! from end to end.

pub mod store;
pub mod prepare;
pub mod samples;
pub mod cache;
pub mod errors;
pub mod rounds;
pub mod layers;
pub mod finish;
pub mod forecast;
pub mod output;
pub mod run;
