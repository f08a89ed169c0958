//! Import and export of datasets in the layouts of other tools.
//!
//! Two layouts of raw float32 files ([`layout1`], [`layout2`]) both ways, and EXR files per hour in. An
//! imported dataset becomes a dataset like a baked one, with [`crate::config::Source`] as its origin.

mod raw;
mod plan;
pub mod layout1;
pub mod layout2;
mod layouts;
mod incoming;
mod images;
mod convert;
mod import;
mod export;

pub use export::{Exported, export};
pub use import::{Origin, import};
pub use layouts::lightmaps_of;
pub use plan::Lightmap;
