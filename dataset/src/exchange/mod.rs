//! Import and export of datasets in the layouts of other tools.
//!
//! The layouts of raw float32 files ([`crate::layout`]) both ways, and EXR files per hour in. An imported
//! dataset becomes a dataset like a baked one, with [`crate::format::Source`] as its origin.

mod raw;
mod kept;
mod incoming;
mod images;
mod convert;
mod import;
mod export;

pub use export::{Exported, export};
pub use import::{Origin, import};
pub use kept::lightmaps_of;
