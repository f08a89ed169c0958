//! Points that are one point within a tolerance.

use glam::{DVec3, Vec3};
use std::collections::BTreeSet;

/// Cells of the grid are this many tolerances wide, so that a look-up rarely needs more than one.
const CELL: f64 = 64.0;

/// Points on a grid, each farther than the tolerance from those before it.
pub(super) struct Welder {
    /// Metres.
    pub tolerance: f64,
    points: Vec<DVec3>,
    /// Cell and number of every point.
    cells: BTreeSet<([i64; 3], u32)>,
}

impl Welder {
    /// No points yet. The tolerance is a length in metres above zero.
    pub(super) fn new(tolerance: f64) -> Self {
        Welder { tolerance, points: Vec::new(), cells: BTreeSet::new() }
    }

    /// The first point within the tolerance.
    pub(super) fn find(&self, position: Vec3) -> Option<u32> {
        let position = position.as_dvec3();
        let (low, high) = (self.cell(position - self.tolerance), self.cell(position + self.tolerance));
        let mut first = None;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let cell = [x, y, z];
                    for &(_, point) in self.cells.range((cell, 0)..=(cell, u32::MAX)) {
                        let near = self.points[point as usize].distance(position) <= self.tolerance;
                        if near && first.is_none_or(|first| point < first) {
                            first = Some(point);
                        }
                    }
                }
            }
        }
        first
    }

    /// The number of the point at a position: of an old one within the tolerance, else a new one.
    pub(super) fn weld(&mut self, position: Vec3) -> u32 {
        self.find(position).unwrap_or_else(|| {
            let (number, position) = (self.points.len() as u32, position.as_dvec3());
            self.points.push(position);
            self.cells.insert((self.cell(position), number));
            number
        })
    }

    /// Where a point is.
    pub(super) fn position(&self, point: u32) -> Vec3 {
        self.points[point as usize].as_vec3()
    }

    fn cell(&self, position: DVec3) -> [i64; 3] {
        // Off centre, so that round coordinates do not lie on borders.
        (position / (CELL * self.tolerance) + 0.353_553).floor().to_array().map(|c| c as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    #[test]
    fn points_within_the_tolerance_are_one_wherever_cells_end() {
        for i in -200..200 {
            let mut welder = Welder::new(0.01);
            let p = vec3(i as f32 * 0.017, 5.0 - i as f32 * 0.003, 0.25);
            assert_eq!(welder.weld(p), 0);
            assert_eq!(welder.weld(p + vec3(0.005, -0.005, 0.005)), 0);
            assert_eq!(welder.weld(p - vec3(0.009, 0.0, 0.0)), 0);
            assert_eq!(welder.find(p + vec3(0.0, 0.011, 0.0)), None);
            assert_eq!(welder.weld(p + vec3(0.0, 0.011, 0.0)), 1);
        }
    }
}
