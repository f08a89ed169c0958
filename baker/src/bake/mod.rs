//! From a scene to a dataset: what to trace, tracing it in rounds, and putting the layers together.
//!
//! Each folder uses only those above it. Its `mod.rs` says what comes in, what goes out and who calls, and
//! names the items and modules that others use. [`run`] is the bake from end to end.

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
