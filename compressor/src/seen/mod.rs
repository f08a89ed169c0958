//! What is seen of an error: how large it is relative to the light around it, and how far its colour is off.
//!
//! In: a tile's true and decoded light, and which texels are valid. Out: histograms of its texels' errors.
//! Callers: evaluation; whatever chooses bits by what is seen. Nothing here reads files.
//!
//! The **local light** of a texel is defined as in bakes, as far as the light alone tells it:
//!
//! - A *piece* is the connected valid texels (up, down, left, right) of one cell of 16×16 texels, counted
//!   from the tile's first texel. (A bake takes the cell's texels on one chart; where charts touch, a piece
//!   has texels of both.)
//! - The *floor* is 1/30 of the median light of the tile's valid texels, light being the mean of red, green
//!   and blue; where the median is 0, 1/300 of the brightest; and at least [`LEAST_LUX`], where the unit is
//!   known. (A bake takes the median of the cells that are seen from the texel's.)
//! - The local light is the mean light of the texel's piece, or the floor if that is more.
//!
//! It is that of the true light, never of the decoded: a decoder that makes all brighter gains nothing. A
//! tile without true light has none, and no errors.
//!
//! `histogram`: counts by size; `pieces`: which texels belong together; `errors`: a tile's errors.

mod histogram;
mod pieces;
mod errors;

pub use errors::{Errors, Figures};
pub use histogram::{Histogram, Quantiles};
pub use pieces::{CELL, LocalLight, Pieces};

/// The least floor of local light in lux, as in bakes: a tenth of a millilux, by which no eye sees edges.
pub const LEAST_LUX: f64 = 1e-4;

/// One lux in the unit of a dataset (`config.json`, `unit`); `None` where the unit says nothing of lux.
pub fn lux(unit: &str) -> Option<f64> {
    match () {
        () if unit.contains("kilolux") => Some(1e-3),
        () if unit.contains("lux") => Some(1.0),
        () => None,
    }
}

/// The least floor of local light in the unit of a dataset; 0 where that is unknown.
pub fn least_floor(unit: &str) -> f64 {
    lux(unit).map_or(0.0, |lux| LEAST_LUX * lux)
}
