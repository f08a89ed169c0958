//! Light as a linear basis: planes that all frames share, and how much of each a frame has.
//!
//! In: a tile's section of planes. Out: its light at any time ([`PlanesAt`]). Callers: the bundle, `at`, the
//! encoder. `range` codes bits, `coefficients` what they mean; `set` is one light source as whole numbers,
//! `section` all of a tile; `light` and `tile` are what is decoded.

mod range;
mod coefficients;
mod transform;
mod set;
mod section;
mod light;
mod tile;
#[cfg(test)]
mod tests;

pub use light::{Source, Unpacked, components};
pub(crate) use section::decode_section;
pub use section::encode_section;
pub use set::{MOST_PLANES, MOST_PLANES_OF_TILE, PlaneSet};
pub(crate) use tile::lit_frames;
pub use tile::{PlanesAt, TilePlanes};
pub use transform::UNITS;

/// A set's bytes on a tile of stored width.
pub fn encode(set: &PlaneSet, width: usize) -> Vec<u8> {
    set.encode(width.div_ceil(8))
}

/// Chooses a set's coefficients on a tile of stored width: `exact`, per plane and block, what they should be
/// in steps; `lambda`, the error in squared steps that a bit is worth. Gives the set's bytes.
pub fn encode_towards(set: &mut PlaneSet, exact: &[[f32; 64]], lambda: f32, width: usize) -> Vec<u8> {
    set.encode_towards(exact, lambda, width.div_ceil(8))
}
