//! One step of training.
//!
//! In: targets, feature maps and a network. Out: maps and network after a step. Callers: `stored`, `phases`.
//!
//! `gather` samples maps, `network` is the decoder, `kernel` runs both over a batch and back, and has Adam.
//! `bases` rotates the network's gradients, `optimise` takes the step.

pub(crate) mod network;
pub(super) mod gather;
pub(crate) mod kernel;
pub(super) mod bases;
pub(crate) mod optimise;

pub(super) use gather::Samples;
pub(super) use kernel::Kernel;
pub(crate) use network::{CHUNK, Rows};
pub(super) use optimise::Trainer;
