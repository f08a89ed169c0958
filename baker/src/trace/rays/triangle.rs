//! Where a line crosses a triangle, decided in double precision: the watertight test of Woop, Benthin & Wald
//! 2013 ("Watertight Ray/Triangle Intersection") with its sheared coordinates and edge functions in `f64`.
//!
//! The paper's single-precision form shifts every corner by some 10⁻⁷ of its distance: closed edges stay
//! closed, but a ray a few millimetres inside a wall of 40 km may see it elsewhere. In double precision the
//! shift is 10⁻¹⁶ of the distance, and the sign of an edge function is the same number, negated, in both
//! triangles that share the edge. [`super::bvh8`]'s kernels reject in single precision only what this test is
//! sure to reject.

use glam::Vec3;

/// What a ray's test needs of its origin and direction, computed once per ray.
#[derive(Clone, Copy, Debug)]
pub struct Shear {
    /// Dimensions x, y and z of the sheared space; the direction is largest along z.
    pub axes: [usize; 3],
    origin: [f64; 3],
    shear: [f64; 3],
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Distance in units of the direction's length.
    pub t: f64,
    /// Barycentric weight of the second corner.
    pub b1: f64,
    /// Barycentric weight of the third corner.
    pub b2: f64,
}

/// A hit.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Index into `Geometry::triangles`.
    pub triangle: u32,
    /// Barycentric weights of the three corners.
    pub barycentric: Vec3,
    /// Distance along the unit direction.
    pub t: f32,
}

impl TriangleHit {
    /// The weights of the three corners.
    pub fn barycentric(&self) -> Vec3 {
        Vec3::new((1.0 - self.b1 - self.b2) as f32, self.b1 as f32, self.b2 as f32)
    }
}

impl Shear {
    /// Prepares a ray along a non-zero direction.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        // kz: the dimension where the direction is largest. (The paper swaps the others to keep the winding;
        // both sides are hit here.)
        let size = direction.abs();
        let kz = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let axes = [[1, 2, 0], [2, 0, 1], [0, 1, 2]][kz];
        let [x, y, z] = axes.map(|k| f64::from(direction[k]));
        let sz = 1.0 / z;
        Shear { axes, origin: axes.map(|k| f64::from(origin[k])), shear: [x * sz, y * sz, sz] }
    }

    /// The intersection with 0 < t < `t_max`, from either side.
    #[inline]
    pub fn intersect(&self, corners: &[Vec3; 3], t_max: f64) -> Option<TriangleHit> {
        let [ox, oy, oz] = self.origin;
        let [sx, sy, sz] = self.shear;
        let [kx, ky, kz] = self.axes;
        // Corners relative to the origin, sheared so that the ray runs along +z.
        let sheared = |p: Vec3| {
            let z = f64::from(p[kz]) - oz;
            [f64::from(p[kx]) - ox - sx * z, f64::from(p[ky]) - oy - sy * z, z]
        };
        let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) =
            (sheared(corners[0]), sheared(corners[1]), sheared(corners[2]));
        // Scaled barycentric coordinates: signed areas of the edges seen from the ray.
        let u = cx * by - cy * bx;
        let v = ax * cy - ay * cx;
        let w = bx * ay - by * ax;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        // Distance, scaled by the determinant.
        let inverse = 1.0 / det;
        let t = (u * az + v * bz + w * cz) * sz * inverse;
        (t > 0.0 && t < t_max).then_some(TriangleHit { t, b1: v * inverse, b2: w * inverse })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    #[test]
    fn meets_where_a_plane_is_crossed() {
        let corners = [vec3(0.0, 0.0, 2.0), vec3(4.0, 0.0, 2.0), vec3(0.0, 4.0, 2.0)];
        let meet = |origin, direction, t_max| Shear::new(origin, direction).intersect(&corners, t_max);
        let hit = meet(vec3(1.0, 1.0, 0.0), Vec3::Z, 10.0).unwrap();
        assert_eq!((hit.t, hit.b1, hit.b2), (2.0, 0.25, 0.25));
        assert!(meet(vec3(1.0, 1.0, 0.0), Vec3::Z, 1.9).is_none());
        assert!(meet(vec3(1.0, 1.0, 0.0), -Vec3::Z, 10.0).is_none());
        assert!(meet(vec3(3.0, 3.0, 0.0), Vec3::Z, 10.0).is_none());
        // From the back, too.
        assert!(meet(vec3(1.0, 1.0, 5.0), -Vec3::Z, 10.0).is_some());
    }

    #[test]
    fn slivers_are_met_as_their_shape_says() {
        // 1 m long, 1 µm wide: hit inside, missed beside, from any of three directions.
        let corners = [vec3(0.0, 0.0, 2.0), vec3(1.0, 0.0, 2.0), vec3(0.0, 1e-6, 2.0)];
        for from in [vec3(0.25, 2.5e-7, 0.0), vec3(0.5, 1.0, 0.5), vec3(-1.0, -0.5, 1.0)] {
            let towards = |x: f32, y: f32| {
                let direction = vec3(x, y, 2.0) - from;
                Shear::new(from, direction).intersect(&corners, f64::INFINITY)
            };
            let hit = towards(0.25, 2.5e-7).expect("the middle of the sliver");
            assert!((hit.t - 1.0).abs() < 1e-6);
            assert!(towards(0.25, 1.5e-6).is_none() && towards(0.25, -1.5e-6).is_none());
        }
    }

    #[test]
    fn a_triangle_without_area_is_not_met() {
        let (a, b) = (vec3(0.0, 0.0, 2.0), vec3(1.0, 1.0, 2.0));
        for corners in [[a, a, a], [a, b, a], [a, a.lerp(b, 0.5), b]] {
            assert!(Shear::new(vec3(0.5, 0.5, 0.0), Vec3::Z).intersect(&corners, 10.0).is_none());
        }
    }
}
