//! What carpenters and masons use: beams between two points, walls with openings, things turned about any
//! axis.

use crate::mesh::Mesh;
use crate::relief::{Plate, plate, sorted};
use glam::{DAffine3, DQuat, DVec2, DVec3};

/// A closed beam from `a` to `b`, its section `width` across and `height` upwards; grain runs along it.
pub fn beam(a: DVec3, b: DVec3, width: f64, height: f64) -> Mesh {
    let along = (b - a).normalize();
    let side = if along.y.abs() > 0.99 { DVec3::X } else { along.cross(DVec3::Y).normalize() };
    let up = side.cross(along).normalize();
    let side = along.cross(up) * (width / 2.0);
    let up = up * (height / 2.0);
    let ring = [side - up, side + up, -side + up, -side - up];
    let mut mesh = Mesh::default();
    for k in 0..4 {
        let (p, q) = (ring[k], ring[(k + 1) % 4]);
        mesh.quad(a + q, a + p, b + p, b + q);
    }
    mesh.quad(a + ring[0], a + ring[1], a + ring[2], a + ring[3]);
    mesh.quad(b + ring[3], b + ring[2], b + ring[1], b + ring[0]);
    mesh
}

/// A wall in the (x, y) plane with openings.
pub struct Wall<'a> {
    /// Left and right end.
    pub x: [f64; 2],
    /// Foot and top.
    pub y: [f64; 2],
    /// Metres through.
    pub thickness: f64,
    /// [x0, y0, x1, y1] each.
    pub openings: &'a [[f64; 4]],
    /// A gable: above this height the wall narrows towards x = 0, to nothing at the second height.
    pub gable: Option<[f64; 2]>,
}

impl Wall<'_> {
    /// Front towards +Z, back towards −Z, and the cut edges.
    pub fn build(&self) -> Plate {
        let lines = |k: usize, ends: [f64; 2]| {
            let mut lines = vec![ends[0], ends[1]];
            lines.extend(self.openings.iter().flat_map(|o| [o[k], o[k + 2]]));
            if k == 1 {
                lines.extend(self.gable.map(|[eaves, _]| eaves));
            }
            sorted(lines)
        };
        let (xs, ys) = (lines(0, self.x), lines(1, self.y));
        let filled = |i: usize, j: usize| {
            let (x, y) = ((xs[i] + xs[i + 1]) / 2.0, (ys[j] + ys[j + 1]) / 2.0);
            !self.openings.iter().any(|o| x > o[0] && x < o[2] && y > o[1] && y < o[3])
        };
        let place = |x: f64, y: f64| match self.gable {
            Some([eaves, apex]) if y > eaves => DVec2::new(x * (apex - y) / (apex - eaves), y),
            _ => DVec2::new(x, y),
        };
        let mut wall = plate(&xs, &ys, self.thickness, filled, place);
        // Boards and courses stay upright in gables too.
        for side in [&mut wall.front, &mut wall.back] {
            side.uvs = side.positions.iter().map(|p| DVec2::new(p.x, -p.y)).collect();
        }
        wall
    }
}

/// A plate turned about +Y and moved.
pub fn stand(plate: Plate, turn: f64, at: DVec3) -> Plate {
    let put = |mesh: Mesh| mesh.turned(turn).translated(at.x, at.y, at.z);
    Plate { front: put(plate.front), back: put(plate.back), edges: put(plate.edges) }
}

/// A body built upright (about +Y), its axis laid along `axis` through `at`.
pub fn laid(mesh: Mesh, axis: DVec3, at: DVec3) -> Mesh {
    mesh.transformed(DAffine3::from_rotation_translation(
        DQuat::from_rotation_arc(DVec3::Y, axis.normalize()),
        at,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beam_is_a_closed_solid() {
        for b in [DVec3::new(3.0, 0.0, 4.0), DVec3::Y * 5.0, DVec3::new(0.0, -4.0, 3.0)] {
            let mesh = beam(DVec3::ZERO, b, 0.2, 0.1);
            assert!(mesh.is_closed());
            assert!((mesh.volume() - 5.0 * 0.2 * 0.1).abs() < 1e-12, "{b}");
        }
    }

    #[test]
    fn a_gable_with_a_door_is_a_closed_solid() {
        let wall = Wall {
            x: [-3.0, 3.0],
            y: [0.0, 5.0],
            thickness: 0.5,
            openings: &[[-1.0, 0.0, 1.0, 2.0]],
            gable: Some([3.0, 6.0]),
        };
        let Plate { front, back, edges } = wall.build();
        let solid = front.with(back).with(edges);
        assert!(solid.is_closed());
        // The rectangle without its door, and the trapezium from 6 m to 2 m.
        assert!((solid.volume() - 0.5 * (18.0 - 4.0 + 8.0)).abs() < 1e-12);
    }
}
