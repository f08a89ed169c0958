//! The box around points.

use glam::{DVec3, Vec3};

/// A box along the axes; without points, its corners are infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The least coordinates.
    pub low: Vec3,
    /// The greatest.
    pub high: Vec3,
}

impl Bounds {
    /// The smallest box that holds all points.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        let empty = Bounds { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
        points
            .into_iter()
            .fold(empty, |all, point| Bounds { low: all.low.min(point), high: all.high.max(point) })
    }

    /// Lengths of its sides; 0 without points.
    pub fn size(&self) -> DVec3 {
        (self.high - self.low).max(Vec3::ZERO).as_dvec3()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_touches_the_outermost_points_and_is_empty_without_any() {
        let bounds = Bounds::of([Vec3::new(1.0, -2.0, 0.0), Vec3::new(-3.0, 4.0, 0.5)]);
        assert_eq!((bounds.low, bounds.high), (Vec3::new(-3.0, -2.0, 0.0), Vec3::new(1.0, 4.0, 0.5)));
        assert_eq!(bounds.size(), DVec3::new(4.0, 6.0, 0.5));
        assert_eq!(Bounds::of([]).size(), DVec3::ZERO);
    }
}
