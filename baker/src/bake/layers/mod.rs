//! Finished layers, kept beside the dataset for later bakes.
//!
//! In: a [`Tracer`](super::rounds::Tracer) whose rounds are done. Out: [`Layers`]: a file per layer, a second
//! one for its direct light, and what filters made of it; [`ValidTexels`]. Callers: `finish`, `forecast`,
//! `output`, `run`.
//!
//! `layer_file` reads and writes a file, `folder` all of them. `denoise` filters, `target` judges light as it
//! would be stored, `kept` says which layers of earlier bakes serve this one.

mod layer_file;
mod folder;
mod valid;
pub(super) mod denoise;
pub(super) mod target;
pub(super) mod kept;

pub use denoise::Denoised;
pub use denoise::Denoiser;
pub(super) use folder::{FilteredLayer, LayerReader, each_sum};
pub use folder::{Layers, Texel};
pub(super) use layer_file::CHECKSUM;
pub(super) use valid::ValidTexels;
