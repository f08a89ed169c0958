//! Rays against the scene's triangles: nearest hit and occlusion, with cut-outs really open.

use super::triangle::{Meeting, Shear};
use crate::geometry::Geometry;
use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};
use std::time::Duration;

/// The ray tracer: a bounding volume hierarchy over all triangles, and what decides whether a hit counts.
pub struct Rays<'a> {
    geometry: &'a Geometry,
    bvh: CwBvh,
    /// Corners in the order of the hierarchy's leaves.
    corners: Vec<[Vec3; 3]>,
    /// `Geometry` index of each of `corners`; the top bit marks a triangle with a cut-out.
    triangles: Vec<u32>,
}

/// Marks triangles whose hits the alpha texture decides.
const CUT_OUT: u32 = 1 << 31;

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

impl<'a> Rays<'a> {
    /// Builds the hierarchy. Triangles without area stay in: they neither hit nor harm.
    pub fn new(geometry: &'a Geometry) -> Self {
        let boxes: Vec<Aabb> = geometry
            .triangles
            .iter()
            .map(|&t| {
                let [a, b, c] = t.map(|i| Vec3A::from(geometry.positions[i as usize]));
                let (low, high) = (a.min(b).min(c), a.max(b).max(c));
                // Grown by what rounding may take in the box test (Ize 2013), relative to the coordinates' size.
                let slack = Vec3A::splat(low.abs().max(high.abs()).max_element() * 1e-6 + 1e-30);
                Aabb::new(low - slack, high + slack)
            })
            .collect();
        let bvh = if boxes.is_empty() {
            CwBvh::default()
        } else {
            build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default())
        };
        let triangles: Vec<u32> = bvh
            .primitive_indices
            .iter()
            .map(|&i| {
                let material = &geometry.materials[geometry.material_of[i as usize] as usize];
                if material.alpha_cutoff.is_some() { i | CUT_OUT } else { i }
            })
            .collect();
        let corners = bvh.primitive_indices.iter().map(|&i| geometry.corners(i as usize)).collect();
        Rays { geometry, bvh, corners, triangles }
    }

    /// The nearest hit along the unit `direction`; `from` is the triangle the ray starts on, which it cannot hit.
    #[inline]
    pub fn nearest(&self, origin: Vec3, direction: Vec3, from: u32) -> Option<Hit> {
        let shear = Shear::new(direction);
        let mut best: Option<Hit> = None;
        let mut state = self.bvh.new_ray_traversal(ray(origin, direction, f32::INFINITY));
        let mut hit = RayHit::none();
        while self.bvh.ray_traverse_dynamic(&mut state, &mut hit, |ray, leaf| {
            let Some((triangle, meeting)) = self.meet(&shear, origin, leaf, ray.tmax, from) else {
                return f32::INFINITY;
            };
            let barycentric = Vec3::new(1.0 - meeting.b1 - meeting.b2, meeting.b1, meeting.b2);
            best = Some(Hit { triangle, barycentric, t: meeting.t });
            meeting.t
        }) {}
        best
    }

    /// Whether anything stands between `origin` and the point at distance `t_max` along the unit `direction`.
    #[inline]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32, from: u32) -> bool {
        let shear = Shear::new(direction);
        let mut state = self.bvh.new_ray_traversal(ray(origin, direction, t_max));
        let mut hit = RayHit::none();
        // Returns at the first hit it finds.
        self.bvh.ray_traverse_dynamic(&mut state, &mut hit, |ray, leaf| {
            self.meet(&shear, origin, leaf, ray.tmax, from).map_or(f32::INFINITY, |(_, m)| m.t)
        })
    }

    #[inline]
    fn meet(
        &self,
        shear: &Shear,
        origin: Vec3,
        leaf: usize,
        t_max: f32,
        from: u32,
    ) -> Option<(u32, Meeting)> {
        let marked = self.triangles[leaf];
        let triangle = marked & !CUT_OUT;
        if triangle == from {
            return None;
        }
        let meeting = shear.meet(origin, &self.corners[leaf], t_max)?;
        if marked & CUT_OUT != 0 && self.is_open(triangle, &meeting) {
            return None;
        }
        Some((triangle, meeting))
    }

    #[cold]
    fn is_open(&self, triangle: u32, meeting: &Meeting) -> bool {
        let barycentric = Vec3::new(1.0 - meeting.b1 - meeting.b2, meeting.b1, meeting.b2);
        !self.geometry.is_solid_at(triangle as usize, barycentric)
    }
}

fn ray(origin: Vec3, direction: Vec3, t_max: f32) -> Ray {
    // A large finite inverse for zero components: no 0 · ∞ in the box test.
    let inverse = |d: f32| if d.abs() < 1e-30 { 1e30f32.copysign(d) } else { 1.0 / d };
    Ray {
        origin: origin.into(),
        direction: direction.into(),
        inv_direction: Vec3A::new(inverse(direction.x), inverse(direction.y), inverse(direction.z)),
        tmin: 0.0,
        tmax: t_max,
    }
}

/// A point of a triangle, moved off its surface to the side of `normal` by more than rounding can have sunk it
/// (Pharr, Jakob & Humphreys 2023, "Physically Based Rendering", section 6.8).
#[inline]
pub fn offset_point(corners: &[Vec3; 3], barycentric: Vec3, normal: Vec3) -> Vec3 {
    let parts = [corners[0] * barycentric.x, corners[1] * barycentric.y, corners[2] * barycentric.z];
    let point = parts[0] + parts[1] + parts[2];
    // γ₇ of the interpolation, and as much again for the translation in the triangle test.
    let gamma = 14.0 * f32::EPSILON * 0.5;
    let error = (parts[0].abs() + parts[1].abs() + parts[2].abs()) * gamma
        + corners.iter().fold(Vec3::ZERO, |m, c| m.max(c.abs())) * gamma;
    point + normal * (normal.abs().dot(error) + f32::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Material;

    /// A closed sphere of `rings × 2·rings` faces around the origin.
    fn sphere(rings: usize, centre: Vec3) -> Geometry {
        let mut g = Geometry::default();
        let columns = 2 * rings;
        for i in 0..=rings {
            let theta = std::f32::consts::PI * i as f32 / rings as f32;
            for j in 0..columns {
                let phi = std::f32::consts::TAU * j as f32 / columns as f32;
                let n = Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
                g.positions.push(centre + n);
                g.normals.push(n);
            }
        }
        let at = |i: usize, j: usize| (i * columns + j % columns) as u32;
        for i in 0..rings {
            for j in 0..columns {
                g.triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
                g.triangles.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
            }
        }
        g.material_of = vec![0; g.triangles.len()];
        g.materials.push(Material {
            albedo: Vec3::splat(0.5),
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: true,
            emission: None,
        });
        g
    }

    #[test]
    fn no_ray_leaves_a_closed_sphere_through_its_edges() {
        // Rays from inside, aimed at every vertex and at points on every edge: the worst places for a leak.
        for centre in [Vec3::ZERO, Vec3::new(37.0, -12.0, 91.0)] {
            let g = sphere(48, centre);
            let rays = Rays::new(&g);
            let (mut aimed, mut missed) = (0, 0);
            let sequence = super::super::sampler::Sequence::new(1, 0, 0, 0);
            for (i, t) in g.triangles.iter().enumerate() {
                let c = t.map(|v| g.positions[v as usize]);
                for k in 0..6u32 {
                    let u = sequence.sample(i as u32).pair(k);
                    let target = match k {
                        0 => c[0],
                        1 => (c[0] + c[1]) * 0.5,
                        2 => (c[1] + c[2]) * 0.5,
                        _ => c[0].lerp(c[2], u.x),
                    };
                    let origin = centre + (Vec3::new(u.y, u.x, 1.0 - u.y) - 0.5) * 0.6;
                    let direction = (target - origin).normalize_or(Vec3::X);
                    aimed += 1;
                    missed += usize::from(rays.nearest(origin, direction, u32::MAX).is_none());
                    missed += usize::from(!rays.occluded(origin, direction, f32::INFINITY, u32::MAX));
                }
            }
            assert!(aimed > 50_000 && missed == 0, "{missed} of {aimed} rays leaked");
        }
    }

    #[test]
    fn nearest_agrees_with_brute_force() {
        let g = sphere(12, Vec3::new(3.0, 0.0, 0.0));
        let rays = Rays::new(&g);
        let sequence = super::super::sampler::Sequence::new(5, 0, 0, 0);
        let mut hits = 0;
        for i in 0..2000 {
            let (u, v, w) =
                (sequence.sample(i).pair(0), sequence.sample(i).pair(1), sequence.sample(i).pair(2));
            let origin = Vec3::new(u.x * 8.0 - 1.0, u.y * 4.0 - 2.0, v.x * 4.0 - 2.0);
            let target = Vec3::new(v.y + 2.5, w.x - 0.5, w.y - 0.5) * 2.0 - Vec3::X * 3.0;
            let direction = (target - origin).normalize();
            let shear = Shear::new(direction);
            let brute = (0..g.triangles.len())
                .filter_map(|t| shear.meet(origin, &g.corners(t), f32::INFINITY).map(|m| m.t))
                .fold(f32::INFINITY, f32::min);
            let found = rays.nearest(origin, direction, u32::MAX).map_or(f32::INFINITY, |h| h.t);
            assert_eq!(brute, found);
            assert_eq!(brute.is_finite(), rays.occluded(origin, direction, f32::INFINITY, u32::MAX));
            hits += usize::from(brute.is_finite());
        }
        assert!(hits > 300);
    }

    #[test]
    fn a_wall_of_four_hundred_metres_stands_firm() {
        // The stiff case for quantised boxes: a wall 4 m high and 400 m long, seen from 2 m.
        let mut g = sphere(3, Vec3::ZERO);
        g.positions =
            [(-2e2, -1.0), (2e2, -1.0), (2e2, 3.0), (-2e2, 3.0)].map(|(x, y)| Vec3::new(x, y, -2.0)).to_vec();
        g.normals = vec![Vec3::Z; 4];
        g.triangles = vec![[0, 1, 2], [0, 2, 3]];
        g.material_of = vec![0; 2];
        let rays = Rays::new(&g);
        let sequence = super::super::sampler::Sequence::new(5, 0, 0, 0);
        let (mut brute, mut found, mut truth) = (0, 0, 0);
        let n = 20_000;
        for i in 0..n {
            // Directions towards the wall, most of them grazing along it.
            let u = sequence.sample(i).pair(0);
            let azimuth = (u.x - 0.5) * std::f32::consts::PI;
            let direction = Vec3::new(azimuth.sin(), u.y * 1.5, -azimuth.cos()).normalize();
            let t = -2.0 / f64::from(direction.z);
            let (x, y) = (t * f64::from(direction.x), t * f64::from(direction.y));
            truth += u32::from(y < 3.0 && x.abs() < 2e2);
            let shear = Shear::new(direction);
            brute +=
                u32::from((0..2).any(|t| shear.meet(Vec3::ZERO, &g.corners(t), f32::INFINITY).is_some()));
            found += u32::from(rays.nearest(Vec3::ZERO, direction, u32::MAX).is_some());
        }
        assert!(
            truth > n / 4 && truth.abs_diff(brute) < n / 2000 && truth.abs_diff(found) < n / 2000,
            "{truth} {brute} {found}"
        );
    }
}
