//! The room of what is trained for: samples of a tile's light, and what the maps are to give there.
//!
//! `light` surveys the tile, `problem` holds samples and targets, `features` the maps; `random` is the
//! generator of all draws.

pub(super) mod random;
pub(super) mod light;
pub(super) mod features;
pub(super) mod problem;

pub(super) use features::Layout;
pub(super) use problem::{GUTTER_SHARE, Pair, Problem, Texel, TimePoint};
pub(crate) use random::Random;
