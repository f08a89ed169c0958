//! NDGI compression of temporal lightmap frames (terms and equations follow the paper
//! "Neural Dynamic GI: Random-Access Neural Compression for Temporal Lightmaps in Dynamic Lighting Environments").
//!
//! Modules in the order the data passes them; a module imports only what stands above it. The decoding half is a crate of its own,
//! [`ndgi`], whose modules are re-exported here. Of what follows, `evaluate` needs `mean` alone.

pub use ndgi::{bc7, bundle, decode, grid, lanes, model, sun, time};

mod error;
mod printable;
mod clock;
mod mean;
pub mod law;
pub mod tile;
pub mod sunlight;
pub mod train;
pub mod compress;
pub mod evaluate;
pub mod report;
pub mod levels;
pub mod run;
pub mod sweep;
pub mod compare;
pub mod view;

pub use dataset::{Error, Result};
pub use error::of_bundle;
pub use printable::printable;
