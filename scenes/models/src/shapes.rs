//! Axis-aligned blocks.

use crate::mesh::Mesh;
use glam::{DVec2, DVec3};

/// Faces of a block, to be combined with `|`.
pub type Faces = u8;
/// The face towards +X.
pub const EAST: Faces = 1;
/// The face towards −X.
pub const WEST: Faces = 2;
/// The face towards +Y.
pub const TOP: Faces = 4;
/// The face towards −Y.
pub const BOTTOM: Faces = 8;
/// The face towards +Z.
pub const SOUTH: Faces = 16;
/// The face towards −Z.
pub const NORTH: Faces = 32;
/// A closed block.
pub const ALL: Faces = 63;

/// Some faces of an axis-aligned block; texture coordinates follow the world's axes.
pub fn block(min: [f64; 3], max: [f64; 3], faces: Faces) -> Mesh {
    let (a, b) = (DVec3::from(min), DVec3::from(max));
    let mut mesh = Mesh::default();
    let p = |x: bool, y: bool, z: bool| {
        DVec3::new(if x { b.x } else { a.x }, if y { b.y } else { a.y }, if z { b.z } else { a.z })
    };
    let mut face = |flag: Faces, corners: [DVec3; 4], uv: fn(DVec3) -> DVec2| {
        if faces & flag != 0 {
            mesh.polygon(&corners.map(|c| (c, uv(c))));
        }
    };
    let (o, i) = (false, true);
    face(EAST, [p(i, o, i), p(i, o, o), p(i, i, o), p(i, i, i)], |c| DVec2::new(-c.z, -c.y));
    face(WEST, [p(o, o, o), p(o, o, i), p(o, i, i), p(o, i, o)], |c| DVec2::new(c.z, -c.y));
    face(TOP, [p(o, i, i), p(i, i, i), p(i, i, o), p(o, i, o)], |c| DVec2::new(c.x, c.z));
    face(BOTTOM, [p(o, o, o), p(i, o, o), p(i, o, i), p(o, o, i)], |c| DVec2::new(c.x, -c.z));
    face(SOUTH, [p(o, o, i), p(i, o, i), p(i, i, i), p(o, i, i)], |c| DVec2::new(c.x, -c.y));
    face(NORTH, [p(i, o, o), p(o, o, o), p(o, i, o), p(i, i, o)], |c| DVec2::new(-c.x, -c.y));
    mesh
}
