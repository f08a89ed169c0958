//! Light is sampled at blocks of receivers.
//!
//! In: a block, the scene to trace, and how many samples are due. Out: sums in a
//! [`BlockState`](crate::bake::store::BlockState), and counts of rays. Callers: the cache, errors, rounds,
//! and what traces after them.
//!
//! [`Worker`] does it: `block` gives points on texels, `point` finds those that are surface, `direct` samples
//! suns and lamps, `indirect` follows paths, up to the [`Cache`]. `allocate` shares samples out.

pub(super) mod allocate;
mod block;
mod point;
pub(super) mod direct;
mod indirect;
#[cfg(test)]
mod air_tests;

pub(super) use allocate::{Class, Histogram, Pivot, classes, distinct, log2_shares};
pub use block::Worker;
pub(super) use block::{Stream, indices};
pub(super) use indirect::Cache;
