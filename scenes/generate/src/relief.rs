//! Sheets, thin plates cut out of them, and grids with holes.

use crate::mesh::Mesh;
use glam::DVec2;

pub use models::relief::*;

/// The three parts of a plate in the (x, y) plane.
pub struct Plate {
    /// Towards +Z.
    pub front: Mesh,
    /// Towards −Z.
    pub back: Mesh,
    /// The cut edges.
    pub edges: Mesh,
}

/// A plate `thickness` metres thick about z = 0, cut to the filled cells; `place` bends the outline in (x,
/// y).
pub fn plate(
    xs: &[f64],
    ys: &[f64],
    thickness: f64,
    filled: impl Fn(usize, usize) -> bool,
    place: impl Fn(f64, f64) -> DVec2,
) -> Plate {
    let half = thickness / 2.0;
    let front = sheet(xs, ys, &filled, |x, y| place(x, y).extend(half));
    let mut back = sheet(xs, ys, &filled, |x, y| place(x, y).extend(-half));
    back.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let back = back.smoothed();
    let mut edges = Mesh::default();
    let (nx, ny) = (xs.len() - 1, ys.len() - 1);
    for j in 0..ny {
        for i in 0..nx {
            if !filled(i, j) {
                continue;
            }
            let corner = |i: usize, j: usize| place(xs[i], ys[j]);
            // The cell's sides counter-clockwise, each with what lies beyond it.
            let sides = [
                (corner(i, j), corner(i + 1, j), j > 0 && filled(i, j - 1)),
                (corner(i + 1, j), corner(i + 1, j + 1), i + 1 < nx && filled(i + 1, j)),
                (corner(i + 1, j + 1), corner(i, j + 1), j + 1 < ny && filled(i, j + 1)),
                (corner(i, j + 1), corner(i, j), i > 0 && filled(i - 1, j)),
            ];
            for (a, b, inner) in sides {
                if !inner {
                    edges.quad(a.extend(half), a.extend(-half), b.extend(-half), b.extend(half));
                }
            }
        }
    }
    Plate { front, back, edges }
}

/// Ascending, without repeats closer than 1 mm.
pub fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values.dedup_by(|a, b| (*a - *b).abs() < 1e-3);
    values
}

/// A rectangle on a wall or floor: [u0, v0, u1, v1].
pub type Rect = [f64; 4];

/// Grid lines of a rectangle with holes, and which of its cells are filled.
pub fn grid(
    [u0, v0, u1, v1]: Rect,
    holes: &[Rect],
) -> (Vec<f64>, Vec<f64>, impl Fn(usize, usize) -> bool + use<>) {
    let lines = |low: f64, high: f64, at: [usize; 2]| {
        let mut lines = vec![low, high];
        lines.extend(holes.iter().flat_map(|h| at.map(|k| h[k])).filter(|&x| x > low && x < high));
        sorted(lines)
    };
    let (us, vs) = (lines(u0, u1, [0, 2]), lines(v0, v1, [1, 3]));
    let (mid_u, mid_v) = (us.clone(), vs.clone());
    let holes = holes.to_vec();
    let filled = move |i: usize, j: usize| {
        let (u, v) = ((mid_u[i] + mid_u[i + 1]) / 2.0, (mid_v[j] + mid_v[j + 1]) / 2.0);
        !holes.iter().any(|h| u > h[0] && u < h[2] && v > h[1] && v < h[3])
    };
    (us, vs, filled)
}

/// Depth of a sunk, bevelled rectangle [x0, y0, x1, y1] at a point: 0 outside, 1 past the bevel.
pub fn sunk(x: f64, y: f64, [x0, y0, x1, y1]: [f64; 4], bevel: f64) -> f64 {
    ((x - x0).min(x1 - x).min(y - y0).min(y1 - y) / bevel).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plate_with_a_hole_is_a_closed_solid() {
        let cut = |i: usize, j: usize| !(i == 1 && j == 1);
        let plate = plate(&steps(0.0, 3.0, 3), &steps(0.0, 3.0, 3), 0.5, cut, DVec2::new);
        let solid = plate.front.with(plate.back).with(plate.edges);
        assert!(solid.is_closed());
        assert!((solid.volume() - 4.0).abs() < 1e-12);
    }
}
