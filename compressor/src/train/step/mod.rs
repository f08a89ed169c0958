//! The room of one step of training.
//!
//! In: targets, maps and a network. Out: the same after a step. `gather` samples maps, `network` is the
//! decoder, `kernel` runs both over a batch and back; `bases` and `optimise` take the step.

pub(crate) mod network;
pub(super) mod gather;
pub(crate) mod kernel;
pub(super) mod bases;
pub(crate) mod optimise;

pub(super) use gather::Samples;
pub(super) use kernel::Kernel;
pub(crate) use network::{CHUNK, Rows};
pub(super) use optimise::Trainer;
