//! The watertight ray–triangle test (Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection"):
//! a ray through a shared edge hits one of the two triangles, whatever the rounding.

use glam::{Vec3, vec3};

/// What a ray's test needs of its direction, computed once per ray.
#[derive(Clone, Copy, Debug)]
pub struct Shear {
    axes: [usize; 3],
    shear: Vec3,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Distance in units of the direction's length.
    pub t: f32,
    /// Barycentric weight of the second corner.
    pub b1: f32,
    /// Barycentric weight of the third corner.
    pub b2: f32,
}

impl Shear {
    /// Prepares a non-zero direction.
    #[inline]
    pub fn new(direction: Vec3) -> Self {
        // kz: the dimension where the direction is largest; kx, ky follow, swapped to keep the winding.
        let size = direction.abs();
        let kz = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let sz = 1.0 / direction[kz];
        Shear { axes: [kx, ky, kz], shear: vec3(direction[kx] * sz, direction[ky] * sz, sz) }
    }

    /// The nearest meeting with 0 < t < `t_max`, from either side.
    #[inline]
    pub fn meet(&self, origin: Vec3, corners: &[Vec3; 3], t_max: f32) -> Option<Meeting> {
        let [kx, ky, kz] = self.axes;
        let s = self.shear;
        // Corners relative to the origin, sheared so that the ray runs along +z.
        let (a, b, c) = (corners[0] - origin, corners[1] - origin, corners[2] - origin);
        let (ax, ay) = (a[kx] - s.x * a[kz], a[ky] - s.y * a[kz]);
        let (bx, by) = (b[kx] - s.x * b[kz], b[ky] - s.y * b[kz]);
        let (cx, cy) = (c[kx] - s.x * c[kz], c[ky] - s.y * c[kz]);
        // Scaled barycentric coordinates: signed areas of the edges seen from the ray.
        let mut u = cx * by - cy * bx;
        let mut v = ax * cy - ay * cx;
        let mut w = bx * ay - by * ax;
        // On an edge in single precision: decide in double, where products of singles are exact.
        if u == 0.0 || v == 0.0 || w == 0.0 {
            let d = |p: f32, q: f32, r: f32, s: f32| {
                (f64::from(p) * f64::from(q) - f64::from(r) * f64::from(s)) as f32
            };
            u = d(cx, by, cy, bx);
            v = d(ax, cy, ay, cx);
            w = d(bx, ay, by, ax);
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        // Distance, scaled by the determinant.
        let inverse = 1.0 / det;
        let t = (u * (s.z * a[kz]) + v * (s.z * b[kz]) + w * (s.z * c[kz])) * inverse;
        (t > 0.0 && t < t_max).then_some(Meeting { t, b1: v * inverse, b2: w * inverse })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meets_where_a_plane_is_crossed() {
        let corners = [vec3(0.0, 0.0, 2.0), vec3(4.0, 0.0, 2.0), vec3(0.0, 4.0, 2.0)];
        let hit = Shear::new(Vec3::Z).meet(vec3(1.0, 1.0, 0.0), &corners, 10.0).unwrap();
        assert!((hit.t - 2.0).abs() < 1e-6 && (hit.b1 - 0.25).abs() < 1e-6 && (hit.b2 - 0.25).abs() < 1e-6);
        assert!(Shear::new(Vec3::Z).meet(vec3(1.0, 1.0, 0.0), &corners, 1.9).is_none());
        assert!(Shear::new(-Vec3::Z).meet(vec3(1.0, 1.0, 0.0), &corners, 10.0).is_none());
        assert!(Shear::new(Vec3::Z).meet(vec3(3.0, 3.0, 0.0), &corners, 10.0).is_none());
        // From the back, too.
        assert!(Shear::new(-Vec3::Z).meet(vec3(1.0, 1.0, 5.0), &corners, 10.0).is_some());
    }
}
