//! What is trained for.
//!
//! In: a tile's light. Out: a [`Problem`]: samples of it, and the values that a decoder is to give there.
//! Callers: the other folders of training.
//!
//! `light` surveys the tile, `problem` holds samples and targets, `features` lays out the learned parameters;
//! `random` is the generator of all draws.

pub(super) mod random;
pub(super) mod light;
pub(super) mod features;
pub(super) mod problem;

pub(super) use features::Layout;
pub(super) use problem::{GUTTER_SHARE, Pair, Problem, Texel, TimePoint};
pub(crate) use random::Random;
