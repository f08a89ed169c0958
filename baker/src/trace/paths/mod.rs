//! Paths: light that arrives over any number of surfaces.
//!
//! In: a receiving point and random numbers (`sampler`). Out: the light of all layers, direct and indirect
//! ([`Transport`], `path`); `endless_path` follows those that nothing absorbs. Callers: the samples of a
//! bake, previews.

mod sampler;
pub mod path;
mod endless_path;

pub(crate) use endless_path::EndlessPath;
pub use path::Transport;
pub(crate) use sampler::Sample;
pub use sampler::{Sequence, SequenceKind};
