//! The room of what stands around a point: inside which bodies, behind which walls.
//!
//! In: rays. Out: [`Space`], which the points of texels and of paths are asked about (`space`; `clear` for
//! many at once, `closed_in` for pockets of two-sided bodies).

mod space;
mod closed_in;
mod clear;

pub(crate) use clear::SurfaceAxes;
pub use space::Space;
pub(crate) use space::{Receiver, SurroundingHits};
