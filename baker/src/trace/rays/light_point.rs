//! Where a shadow ray ends: at a point of a light. A light is not shaded by a surface that it touches.
//!
//! Lamps are snapped to ceilings, and luminous panels lie flush in them. Whether such a surface stands before
//! the light's point, at it or behind it is then a matter of rounding. So a surface does not shade a point of
//! a light that lies in its plane, up to [`TOUCHING`]: an area light lights the side that it faces, and a
//! point lights both sides. (A ball does so by what of it lies on either side.)

use crate::geometry::Geometry;
use glam::{DVec3, Vec3};

/// How far off the plane of a surface a light still touches it, as a part of the largest coordinate of both
/// ends of the ray: 16 roundings to `f32`.
const TOUCHING: f64 = 1e-6;

/// The same of the surface's corners, which are rounded once: 4 roundings.
const OF_CORNERS: f64 = 0.25;

/// In files, too, positions are rounded to `f32`, from their zero. Coordinates above this many metres are no
/// reason for a larger tolerance, which would be wider than things are.
const FARTHEST: f64 = 1e3;

/// The part of a shadow ray within which it meets what touches the light.
const NEAR_END: f32 = 0.01;

/// The end of a shadow ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightPoint {
    point: DVec3,
    /// Distance along the ray.
    t: f32,
    /// Largest coordinate of both ends.
    size: f64,
}

impl LightPoint {
    /// The point at distance `t` along the unit `direction`.
    #[inline]
    pub(crate) fn new(origin: Vec3, direction: Vec3, t: f32) -> Self {
        let point = origin.as_dvec3() + direction.as_dvec3() * f64::from(t);
        let size = point.abs().max(origin.as_dvec3().abs()).max_element();
        LightPoint { point, t, size }
    }

    /// From what distance along the ray surfaces may touch the light.
    #[inline]
    pub(crate) fn ask_from(&self) -> f32 {
        self.t * (1.0 - NEAR_END)
    }

    /// Whether the point lies in the plane of a triangle that the ray meets near its end.
    #[cold]
    pub(crate) fn touches(&self, geometry: &Geometry, triangle: u32) -> bool {
        let corners = geometry.corners(triangle as usize);
        is_in_plane(self.point, &corners, tolerance(geometry, self.size, &corners))
    }
}

/// How far off a triangle's plane a point of a light still touches it, in metres; `size`: the largest
/// coordinate that went into the point.
pub(crate) fn tolerance(geometry: &Geometry, size: f64, corners: &[Vec3; 3]) -> f64 {
    let largest = corners.iter().fold(Vec3::ZERO, |m, corner| m.max(corner.abs())).max_element();
    let in_file = geometry.origin.abs().max_element().min(FARTHEST);
    TOUCHING * size.max(OF_CORNERS * f64::from(largest)).max(in_file)
}

/// Whether a point lies in a triangle's plane but for a tolerance.
pub(crate) fn is_in_plane(point: DVec3, corners: &[Vec3; 3], tolerance: f64) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    (point - a).dot(normal).abs() <= tolerance
}
