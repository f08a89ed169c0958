//! Emissive triangles of a mesh as lights: directions uniform in the spherical triangle, points uniform in
//! area where its solid angle is too small to matter.
//!
//! The map is the half-vector form of Peters 2021, "BRDF Importance Sampling for Polygonal Lights", which
//! needs no angles of the spherical triangle (Arvo 1995) and keeps its digits for slivers.

use super::lamp::Outline;
use crate::Rgb;
use crate::geometry::Geometry;
use crate::light::{cos_bound, luminance};
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// A triangle of the scene that emits.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    /// Its index in the geometry.
    pub triangle: u32,
    /// Its corners, relative to the geometry's origin; front counter-clockwise.
    pub corners: [Vec3; 3],
    /// kcd/m², the mean over it; in a bake in units of the group's brightest number.
    pub radiance: Rgb,
    /// Whether the back emits too.
    pub two_sided: bool,
}

/// The emissive triangles of a light group that are worth sampling.
///
/// Left to the paths that meet them: cut-outs (a sampled point may lie in a hole) and triangles without area
/// or light.
pub fn emitters(geometry: &Geometry, group: u32) -> Vec<Emitter> {
    let mut found = Vec::new();
    for (triangle, &material) in geometry.material_of.iter().enumerate() {
        let material = &geometry.materials[material as usize];
        if let Some(emission) = material.emission
            && emission.group == group
            && material.alpha_cutoff.is_none()
        {
            let emitter = Emitter {
                triangle: triangle as u32,
                corners: geometry.corners(triangle),
                radiance: emission.radiance * geometry.emission_map_mean(triangle),
                two_sided: material.two_sided,
            };
            found.extend(emitter.is_usable().then_some(emitter));
        }
    }
    found
}

/// Twice the area over the longest edge squared, below which a triangle counts as having no area: rounding to
/// `f32` has left nothing of its plane.
const FLAT: f64 = 1e-9;

/// Heights over the plane, relative to the triangle's size, that count as in it.
const TOUCHING: f64 = 1e-10;

/// Below this solid angle points are chosen by area.
const SMALL_SOLID_ANGLE: f64 = 1e-9;

impl Emitter {
    /// Whether it has an area and light.
    pub fn is_usable(&self) -> bool {
        let [a, b, c] = self.corners.map(Vec3::as_dvec3);
        let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        let twice_area = (b - a).cross(c - a).length();
        twice_area > FLAT * longest && twice_area.is_finite() && luminance(self.radiance) > 0.0
    }

    /// What bounds it.
    pub fn outline(&self) -> Outline {
        let [a, b, c] = self.corners.map(Vec3::as_dvec3);
        let cross = (b - a).cross(c - a);
        let twice_area = cross.length();
        Outline {
            low: a.min(b).min(c),
            high: a.max(b).max(c),
            axis: cross / twice_area,
            spread: if self.two_sided { PI } else { 0.0 },
            reach: FRAC_PI_2,
            intensity: 0.5 * twice_area * f64::from(luminance(self.radiance)),
        }
    }

    /// What `p` sees of it; `None` from its plane, and from behind if that does not emit.
    pub fn seen_from(&self, p: DVec3) -> Option<Seen> {
        let [a, b, c] = self.corners.map(|corner| corner.as_dvec3() - p);
        let cross = (b - a).cross(c - a);
        let twice_area = cross.length();
        let height = -a.dot(cross) / twice_area;
        // (So close to its plane the map has no digits left: nothing is sampled, and paths that meet it count
        // in full.)
        if height * height <= TOUCHING * TOUCHING * twice_area {
            return None;
        }
        let (corners, normal) = if height > 0.0 {
            ([a, b, c], cross / twice_area)
        } else if height < 0.0 && self.two_sided {
            ([a, c, b], -cross / twice_area)
        } else {
            return None;
        };
        Some(Seen::new(corners, normal, height.abs(), 0.5 * twice_area))
    }

    /// The greatest height of a corner over the plane through `p` with normal `n`.
    fn height_bound(&self, p: DVec3, n: DVec3) -> f64 {
        self.corners.iter().map(|corner| (corner.as_dvec3() - p).dot(n)).fold(f64::MIN, f64::max)
    }

    /// As [`super::lamp::LampSampler::importance`], for radiance 1.
    pub fn importance(&self, p: DVec3, n: DVec3) -> f64 {
        let [a, b, c] = self.corners.map(|corner| corner.as_dvec3() - p);
        let cross = (b - a).cross(c - a);
        // Height times twice the area; > 0 in front.
        let front = -a.dot(cross);
        let front = if self.two_sided { front.abs() } else { front };
        if !(front > 0.0 && self.height_bound(p, n) > 0.0) {
            return 0.0;
        }
        let centre = (a + b + c) / 3.0;
        let radius2 = [a, b, c].iter().map(|corner| (corner - centre).length_squared()).fold(0.0, f64::max);
        let distance2 = centre.length_squared();
        if distance2 > 4.0 * radius2 {
            // Far: the centre's solid angle, the cosine over the ball around it.
            let distance = distance2.sqrt();
            let cosine = cos_bound(centre.dot(n) / distance, radius2 / distance2);
            return 0.5 * front / (distance2 * distance) * cosine.max(f64::MIN_POSITIVE);
        }
        self.seen_from(p).map_or(0.0, |seen| seen.solid_angle.clamp(f64::MIN_POSITIVE, PI))
    }
}

/// A triangle as seen from a point in front of it.
pub struct Seen {
    /// Corners relative to the point, counter-clockwise as seen from the point's side, and unit vectors to
    /// them.
    corners: [DVec3; 3],
    v: [DVec3; 3],
    /// Unit normal on the point's side.
    normal: DVec3,
    /// Distance of the point from the plane, > 0.
    height: f64,
    area: f64,
    /// |v₀ · (v₁ × v₂)|, v₀·v₂ + v₁·v₂ and 1 + v₀·v₁: tan(Ω/2) = g₀/(g₁ + g₂) (Van Oosterom & Strackee 1983).
    g: [f64; 3],
    solid_angle: f64,
}

impl Seen {
    fn new(corners: [DVec3; 3], normal: DVec3, height: f64, area: f64) -> Self {
        let lengths = corners.map(DVec3::length);
        let v: [DVec3; 3] = std::array::from_fn(|i| corners[i] / lengths[i]);
        // The determinant from the plane's height: no difference of products.
        let g0 = 2.0 * area * height / (lengths[0] * lengths[1] * lengths[2]);
        let g = [g0, v[0].dot(v[2]) + v[1].dot(v[2]), 1.0 + v[0].dot(v[1])];
        let solid_angle = 2.0 * g[0].atan2(g[1] + g[2]);
        Self { corners, v, normal, height, area, g, solid_angle }
    }

    fn by_area(&self) -> bool {
        self.solid_angle.is_nan() || self.solid_angle < SMALL_SOLID_ANGLE
    }

    /// Direction and distance to the sampled point.
    pub fn sample(&self, u: DVec2) -> Option<(DVec3, f64)> {
        let [a, b, c] = self.corners;
        if self.by_area() {
            let root = u.x.sqrt();
            let offset = a + (b - a) * (root * (1.0 - u.y)) + (c - a) * (root * u.y);
            let distance = offset.length();
            return (distance > 0.0).then(|| (offset / distance, distance));
        }
        // w on the arc v₀v₂ such that (v₀, v₁, w) has the u-th part of the solid angle: the half vector of v₀
        // and w.
        let [v0, v1, v2] = self.v;
        let (sin, cos) = (0.5 * self.solid_angle * u.x).sin_cos();
        let half = v0 * (self.g[0] * cos - self.g[1] * sin) + v2 * (self.g[2] * sin);
        let w = (half * (2.0 * v0.dot(half) / half.length_squared()) - v0).normalize();
        // On the arc from v₁ to w, 1 − cos uniform.
        let versine = u.y * 0.5 * (w - v1).length_squared();
        let across = (w - v1 * v1.dot(w)).normalize_or_zero();
        let direction = v1 * (1.0 - versine) + across * (versine * (2.0 - versine)).max(0.0).sqrt();
        let distance = self.height / -direction.dot(self.normal);
        let farthest = a.length().max(b.length()).max(c.length());
        (direction.is_finite() && distance > 0.0).then(|| (direction.normalize(), distance.min(farthest)))
    }

    /// Density over solid angle at a point at `distance`.
    pub fn pdf(&self, distance: f64) -> f64 {
        if self.by_area() {
            return distance.powi(3) / (self.height * self.area);
        }
        1.0 / self.solid_angle
    }

    /// The `u` for which [`Seen::sample`] gives a unit direction towards the triangle.
    #[cfg(test)]
    pub fn invert(&self, direction: DVec3) -> DVec2 {
        let [v0, v1, v2] = self.v;
        if self.by_area() {
            let [a, b, c] = self.corners;
            let offset = direction * (self.height / -direction.dot(self.normal)) - a;
            let normal = (b - a).cross(c - a);
            let t = offset.cross(c - a).dot(normal) / normal.length_squared();
            let s = (b - a).cross(offset).dot(normal) / normal.length_squared();
            let root = s + t;
            return DVec2::new(root * root, if root > 0.0 { s / root } else { 0.0 });
        }
        // w: where the great circle through v₁ and the direction meets the arc v₀v₂.
        let w = v1.cross(direction).cross(v0.cross(v2)).normalize();
        let w = if w.dot(v0 + v2) < 0.0 { -w } else { w };
        let g = [v0.dot(v1.cross(w)).abs(), v0.dot(w) + v1.dot(w), 1.0 + v0.dot(v1)];
        let part = 2.0 * g[0].atan2(g[1] + g[2]);
        DVec2::new(part / self.solid_angle, (direction - v1).length_squared() / (w - v1).length_squared())
    }
}

#[cfg(test)]
#[path = "emitter_tests.rs"]
mod tests;
