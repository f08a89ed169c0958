//! A texel in space, and the box that it lies in: what `neighbours` asks for and `stored_blocks` holds.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Directions along the surface in which it is found out how far one can see.
pub(super) const SECTORS: usize = 16;

/// A texel in space.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TexelInSpace {
    pub position: Vec3,
    pub normal: Vec3,
    /// The length of a texel; 0 for invalid ones.
    pub size: f32,
    /// How far one sees along the surface, by sector.
    pub free_distances: [u8; SECTORS],
}

/// A box of space: the octave of the texel's size, and the box among those of that octave, along z last.
/// (Very far boxes share a key: distances tell what is in them apart.)
pub(super) type Key = u64;
