//! The seam of the pipeline: what a temporal lightmap set is on disk.
//!
//! The baker writes it, the compressor reads it; neither rendering nor training happens here.
//! Modules in the order the data passes them; a module imports only what stands above it.

pub mod error;
pub mod system;
pub mod signals;
pub mod console;
pub mod process;
pub mod typed;
pub mod config;
pub mod image;
pub mod files;
pub mod lock;
pub mod tiles;
pub mod visibility;
pub mod sun;
pub mod curve;
pub mod normals;
pub mod store;
pub mod halve;
pub mod exchange;
pub mod metrics;
pub mod tone;
pub mod view;
pub mod report;
pub mod release;

pub use error::{Error, Result};
