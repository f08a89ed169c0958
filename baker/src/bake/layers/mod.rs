//! The room of finished layers, kept beside the dataset for later bakes.
//!
//! In: the means of blocks. Out: [`Layers`], a folder with a file per layer, its texels ([`ValidTexels`] says
//! which count) and denoised copies. Callers: `finish`, forecasts, `output`, `run`.
//!
//! `layer_file` reads and writes a file, `folder` all of them; `denoise` filters, `target` judges filtered
//! light, `kept` says which layers of earlier bakes serve this one.

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
