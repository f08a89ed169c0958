//! The four walls as planes with coordinates of their own: u along, v up, d deep into the wall (negative in
//! the room).

use super::{HALF_X, HALF_Z};
use crate::mesh::Mesh;
use crate::relief::{Rect, grid, sheet};
use crate::shapes::{Faces, block};
use glam::DVec3;

/// A wall, seen from the room.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    /// Towards +u.
    pub along: DVec3,
    /// Into the room; `along` × up.
    pub normal: DVec3,
    /// From the room's middle to the wall.
    pub distance: f64,
    /// Half the wall's length.
    pub half: f64,
}

/// Looks south; u = x.
pub const NORTH: Wall = Wall { along: DVec3::X, normal: DVec3::Z, distance: HALF_Z, half: HALF_X };
/// Looks north; u = −x.
pub const SOUTH: Wall = Wall { along: DVec3::NEG_X, normal: DVec3::NEG_Z, distance: HALF_Z, half: HALF_X };
/// Looks west; u = z.
pub const EAST: Wall = Wall { along: DVec3::Z, normal: DVec3::NEG_X, distance: HALF_X, half: HALF_Z };
/// Looks east; u = −z.
pub const WEST: Wall = Wall { along: DVec3::NEG_Z, normal: DVec3::X, distance: HALF_X, half: HALF_Z };

impl Wall {
    /// A point in the world.
    pub fn at(&self, u: f64, v: f64, d: f64) -> DVec3 {
        self.along * u + DVec3::Y * v - self.normal * (self.distance + d)
    }

    /// Some faces of the block over a rectangle between two depths. Faces are the world's.
    pub fn block(&self, [u0, v0, u1, v1]: Rect, d: [f64; 2], faces: Faces) -> Mesh {
        let (a, b) = (self.at(u0, v0, d[0]), self.at(u1, v1, d[1]));
        block(a.min(b).to_array(), a.max(b).to_array(), faces)
    }

    /// The same with all edges bevelled.
    pub fn bevelled(&self, [u0, v0, u1, v1]: Rect, d: [f64; 2], bevel: f64) -> Mesh {
        let (a, b) = (self.at(u0, v0, d[0]), self.at(u1, v1, d[1]));
        crate::shapes::bevelled(a.min(b).to_array(), a.max(b).to_array(), bevel)
    }

    /// The wall's face in the room between two heights, without the `holes`.
    pub fn face(&self, [foot, top]: [f64; 2], holes: &[Rect]) -> Mesh {
        let (us, vs, filled) = grid([-self.half, foot, self.half, top], holes);
        sheet(&us, &vs, filled, |u, v| self.at(u, v, 0.0))
    }

    /// The face on the other side, at depth `d`, over a rectangle without the `holes`.
    pub fn far_face(&self, rect: Rect, d: f64, holes: &[Rect]) -> Mesh {
        let mirrored = |[u0, v0, u1, v1]: Rect| [-u1, v0, -u0, v1];
        let holes: Vec<Rect> = holes.iter().map(|&r| mirrored(r)).collect();
        let (us, vs, filled) = grid(mirrored(rect), &holes);
        sheet(&us, &vs, filled, |u, v| self.at(-u, v, d))
    }

    /// The sides of an opening between two depths, looking into it: left, right, top and bottom.
    pub fn reveal(&self, [u0, v0, u1, v1]: Rect, [near, far]: [f64; 2]) -> [Mesh; 4] {
        let quad = |corners: [(f64, f64, f64); 4]| {
            let [a, b, c, d] = corners.map(|(u, v, d)| self.at(u, v, d));
            let mut mesh = Mesh::default();
            mesh.quad(a, b, c, d);
            mesh
        };
        [
            quad([(u0, v0, near), (u0, v0, far), (u0, v1, far), (u0, v1, near)]),
            quad([(u1, v0, far), (u1, v0, near), (u1, v1, near), (u1, v1, far)]),
            quad([(u0, v1, far), (u1, v1, far), (u1, v1, near), (u0, v1, near)]),
            quad([(u0, v0, near), (u1, v0, near), (u1, v0, far), (u0, v0, far)]),
        ]
    }
}
