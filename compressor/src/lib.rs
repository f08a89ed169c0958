//! NDGI compression of temporal lightmap sets (terms and equations follow the paper
//! "Neural Dynamic GI: Random-Access Neural Compression for Temporal Lightmaps in Dynamic Lighting Environments").
//!
//! Modules in the order the data passes them; a module imports only what stands above it. The decoding half
//! (`lanes`, `time`, `model`, `bc7`, `grid`, `bundle`, `decode`) never imports the training half
//! (`clock`, `mean`, `tile`, `train`, `compress`, `evaluate`, `report`, `run`, `sweep`, `compare`). Of the latter, `evaluate` needs `mean` alone.

pub mod lanes;
pub mod time;
pub mod model;
pub mod bc7;
pub mod grid;
pub mod bundle;
pub mod decode;
mod clock;
mod mean;
pub mod tile;
pub mod train;
pub mod compress;
pub mod evaluate;
pub mod report;
pub mod run;
pub mod sweep;
pub mod compare;

#[cfg(test)]
mod testing;

pub use dataset::{Error, Result};
