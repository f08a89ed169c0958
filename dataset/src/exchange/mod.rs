//! Sets in the layouts that others read and write: import and export.
//!
//! Two layouts of raw float32 files ([`layout1`], [`layout2`]) both ways, and EXR files per hour in. What is foreign becomes
//! a dataset like a baked one, with [`crate::config::Source`] to tell where it comes from.

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
