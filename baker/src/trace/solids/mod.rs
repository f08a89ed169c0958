//! What stands around a point.
//!
//! In: geometry and rays. Out: [`Space`], which says of a point in which bodies and behind which walls it
//! lies (`space`; `clear` for many at once, `closed_in` for pockets of two-sided bodies). Callers: all
//! folders below, and the points of texels.

mod space;
mod closed_in;
mod clear;

pub(crate) use clear::SurfaceAxes;
pub use space::Space;
pub(crate) use space::{Receiver, SurroundingHits};
