//! The dataset on disk: the interface between baker and compressor.
//!
//! The baker writes it, the compressor reads it; neither rendering nor training happens here.
//! Modules are listed in the order of the data flow; a module imports only those above it.

pub mod error;
pub mod system;
pub mod signals;
pub mod observe;
pub mod console;
pub mod process;
pub mod typed;
pub mod digest;
pub mod image;
pub mod files;
pub mod lock;
pub mod layout;
pub mod config;
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
pub mod preview;
pub mod release;

pub use error::{Error, Result};
