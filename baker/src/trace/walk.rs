//! One walk for all hours: a diffuse path does not depend on the time of day, so each is traced once and every light's
//! estimator adds to its own layer along it.
//!
//! The estimators are disjoint and complete: the sun and the lamps are sampled at every vertex and are invisible to the
//! walk; the sky and emissive surfaces are met by the walk itself.

use super::rays::{Rays, offset_point};
use super::sampler::Sample;
use crate::Rgb;
use crate::geometry::Geometry;
use crate::light::lamp::LampSampler;
use crate::light::sky::SkyTable;
use crate::light::sun::SunDisc;
use crate::surface::SurfacePoint;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Russian roulette begins at this bounce.
const ROULETTE_FROM: u32 = 2;
/// The highest probability of going on under roulette, so that a walk ends even where nothing absorbs.
const GO_ON_AT_MOST: f32 = 0.999;

/// Everything a walk needs: the scene and its light, one layer per sun, per lit sky hour, per group.
pub struct Transport<'a> {
    /// The triangles and materials.
    pub geometry: &'a Geometry,
    /// The ray tracer over them.
    pub rays: &'a Rays<'a>,
    /// The distinct suns: layers 0 ….
    pub suns: &'a [SunDisc],
    /// The sky: the next `sky.lit.len()` layers.
    pub sky: &'a SkyTable,
    /// The lamps of each traced group: the last layers, as if always on.
    pub groups: &'a [Vec<LampSampler>],
    /// Per group of the scene, its place among `groups`; `None`: not traced.
    pub layer_of_group: &'a [Option<usize>],
    /// Most reflections, `None` for no limit.
    pub bounces: Option<u32>,
}

/// Rays traced, by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RayCounts {
    /// Segments of walks.
    pub walk: u64,
    /// Shadow rays to the sun.
    pub sun: u64,
    /// Shadow rays to lamps.
    pub lamp: u64,
    /// Rays that find out whether a point lies inside a solid.
    pub inside: u64,
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.walk += other.walk;
        self.sun += other.sun;
        self.lamp += other.lamp;
        self.inside += other.inside;
    }
}

/// A point light arrives at, moved off its surface.
struct Receiver {
    origin: Vec3,
    triangle: u32,
    /// Geometric normal on the side considered.
    face_normal: Vec3,
    /// The normal cosines are measured against.
    normal: Vec3,
}

impl Transport<'_> {
    /// Number of layers.
    pub fn layers(&self) -> usize {
        self.suns.len() + self.sky.lit.len() + self.groups.len()
    }

    /// Adds one sample of the irradiance at `point` to every layer of `out`; false, and nothing is added, where the point
    /// lies inside a solid.
    pub fn gather(
        &self,
        point: &SurfacePoint,
        sample: Sample,
        out: &mut [Rgb],
        counts: &mut RayCounts,
    ) -> bool {
        let Some(mut at) = self.receiver(point) else { return true };
        if self.is_inside(&at, counts) {
            return false;
        }
        let pairs_per_vertex = 2 + self.groups.len() as u32;
        // Pair 0 chose the point; each vertex then has its own pairs.
        let mut pair = 1;
        // Irradiance at the texel, per unit of it at the vertex.
        let mut weight = Rgb::ONE;
        let mut bounce = 0;
        loop {
            // Onwards, distributed as the cosine: E = ∫ L cos θ dω is estimated by π L.
            let direction = cosine_direction(at.normal, sample.pair(pair + 1));
            let leaves = direction.dot(at.face_normal) > 0.0;
            let hit = if leaves { self.rays.nearest(at.origin, direction, at.triangle) } else { None };
            counts.walk += u64::from(leaves);
            let absorbed = hit.as_ref().is_some_and(|hit| self.is_absorbing_back(hit.triangle, direction));
            self.add_suns(&at, weight, sample, pair, out, counts);
            self.add_lamps(&at, weight, sample, pair + 2, out, counts);
            if !leaves || absorbed {
                return true;
            }
            let beta = weight * PI;
            let Some(hit) = hit else {
                let first = self.suns.len();
                self.sky.add(direction, beta, &mut out[first..first + self.sky.lit.len()]);
                return true;
            };

            let triangle = hit.triangle as usize;
            let material = &self.geometry.materials[self.geometry.material_of[triangle] as usize];
            let front = self.geometry.normal(triangle);
            let is_back = front.dot(direction) > 0.0;
            if let Some((radiance, group)) = material.emission
                && let Some(layer) = self.layer_of_group[group as usize]
            {
                out[self.suns.len() + self.sky.lit.len() + layer] += beta * radiance;
            }
            bounce += 1;
            if self.bounces.is_some_and(|most| bounce > most) {
                return true;
            }
            // Reflected radiance is albedo ÷ π times the irradiance there.
            weight *= self.geometry.albedo_at(triangle, hit.barycentric);
            if bounce >= ROULETTE_FROM {
                let go_on = weight.max_element().min(GO_ON_AT_MOST);
                // (Even purposes are roulette's, odd ones the choice of a lamp.)
                if sample.number(bounce << 1) >= go_on {
                    return true;
                }
                weight /= go_on;
            }
            if weight.max_element() <= 0.0 {
                return true;
            }
            let normal = if is_back { -front } else { front };
            if normal == Vec3::ZERO {
                return true;
            }
            let origin = offset_point(&self.geometry.corners(triangle), hit.barycentric, normal);
            at = Receiver { origin, triangle: hit.triangle, face_normal: normal, normal };
            pair += pairs_per_vertex;
        }
    }

    /// Whether a point lies inside a solid: every one of a few fixed directions, straight up and close to the surface all
    /// around, meets the absorbing back of a one-sided triangle. The directions carry no light, so that leaving such points
    /// out does not favour the light that reaches the others.
    fn is_inside(&self, at: &Receiver, counts: &mut RayCounts) -> bool {
        let (tangent, bitangent) = at.face_normal.any_orthonormal_pair();
        // 75° off the normal: what stands under a single sheet sees past it, what lies in a closed body does not.
        let (sin, cos) = (0.965_925_8, 0.258_819_04);
        let meets_a_back = |direction: Vec3| {
            let hit = self.rays.nearest(at.origin, direction, at.triangle);
            hit.is_some_and(|hit| self.is_absorbing_back(hit.triangle, direction))
        };
        counts.inside += 1;
        if !meets_a_back(at.face_normal) {
            return false;
        }
        let around = [tangent, bitangent, -tangent, -bitangent];
        counts.inside += around.len() as u64;
        around.into_iter().all(|side| meets_a_back((side * sin + at.face_normal * cos).normalize()))
    }

    /// Whether a ray along `direction` meets the absorbing side of a one-sided triangle.
    fn is_absorbing_back(&self, triangle: u32, direction: Vec3) -> bool {
        let material = &self.geometry.materials[self.geometry.material_of[triangle as usize] as usize];
        !material.two_sided && self.geometry.normal(triangle as usize).dot(direction) > 0.0
    }

    /// The texel's point, on the front, with the interpolated normal the game shades with. `None` without a normal.
    fn receiver(&self, point: &SurfacePoint) -> Option<Receiver> {
        let triangle = point.triangle as usize;
        let face_normal = self.geometry.normal(triangle);
        if face_normal == Vec3::ZERO {
            return None;
        }
        let smooth = self.geometry.shading_normal_at(triangle, point.barycentric);
        let normal = if smooth.dot(face_normal) > 0.0 { smooth } else { face_normal };
        let origin = offset_point(&self.geometry.corners(triangle), point.barycentric, face_normal);
        Some(Receiver { origin, triangle: point.triangle, face_normal, normal })
    }

    fn add_suns(
        &self,
        at: &Receiver,
        weight: Rgb,
        sample: Sample,
        pair: u32,
        out: &mut [Rgb],
        counts: &mut RayCounts,
    ) {
        if self.suns.is_empty() {
            return;
        }
        let u = sample.pair(pair);
        for (sun, out) in self.suns.iter().zip(out) {
            let direction = sun.sample(u);
            let cosine = direction.dot(at.normal);
            if cosine <= 0.0 || direction.dot(at.face_normal) <= 0.0 {
                continue;
            }
            counts.sun += 1;
            if !self.rays.occluded(at.origin, direction, f32::INFINITY, at.triangle) {
                *out += weight * sun.irradiance * cosine;
            }
        }
    }

    fn add_lamps(
        &self,
        at: &Receiver,
        weight: Rgb,
        sample: Sample,
        pair: u32,
        out: &mut [Rgb],
        counts: &mut RayCounts,
    ) {
        let first = self.suns.len() + self.sky.lit.len();
        for (g, lamps) in self.groups.iter().enumerate() {
            let purpose = (pair + g as u32) << 1 | 1;
            let Some((lamp, probability)) = choose(lamps, at, || sample.number(purpose)) else {
                continue;
            };
            let Some(s) = lamp.sample(at.origin, at.normal, sample.pair(pair + g as u32)) else {
                continue;
            };
            if s.irradiance == Rgb::ZERO || s.direction.dot(at.face_normal) <= 0.0 {
                continue;
            }
            counts.lamp += 1;
            if !self.rays.occluded(at.origin, s.direction, s.distance, at.triangle) {
                out[first + g] += weight * s.irradiance / probability;
            }
        }
    }
}

/// One lamp of a group, chosen in proportion to what it may give, and the probability of that choice.
fn choose<'l>(
    lamps: &'l [LampSampler],
    at: &Receiver,
    u: impl Fn() -> f32,
) -> Option<(&'l LampSampler, f32)> {
    if let [only] = lamps {
        return Some((only, 1.0));
    }
    let importance = |lamp: &LampSampler| lamp.importance(at.origin, at.normal);
    let total: f32 = lamps.iter().map(importance).sum();
    if total <= 0.0 {
        return None;
    }
    let mut left = u() * total;
    let mut chosen = None;
    for lamp in lamps {
        let share = importance(lamp);
        if share > 0.0 {
            chosen = Some((lamp, share / total));
            if left < share {
                break;
            }
            left -= share;
        }
    }
    chosen
}

/// A unit direction about `normal` with density cos θ ÷ π.
fn cosine_direction(normal: Vec3, u: Vec2) -> Vec3 {
    // Points uniform on the disc, kept close to where they stood on the square (Shirley & Chiu 1997).
    let p = u * 2.0 - Vec2::ONE;
    let (r, phi) = if p == Vec2::ZERO {
        (0.0, 0.0)
    } else if p.x.abs() > p.y.abs() {
        (p.x, PI / 4.0 * (p.y / p.x))
    } else {
        (p.y, PI / 2.0 - PI / 4.0 * (p.x / p.y))
    };
    let (sin, cos) = phi.sin_cos();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let up = (1.0 - r * r).max(0.0).sqrt();
    (tangent * (r * cos) + bitangent * (r * sin) + normal * up).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosine_directions_have_the_cosines_moments() {
        let sequence = super::super::sampler::Sequence::new(1, 0, 3, 0);
        let normal = Vec3::new(0.3, -0.5, 0.8).normalize();
        let n = 1 << 14;
        let (mut first, mut second) = (0.0, 0.0);
        for i in 0..n {
            let c = f64::from(cosine_direction(normal, sequence.sample(i).pair(0)).dot(normal));
            first += c;
            second += c * c;
        }
        // E[cos] = 2/3, E[cos²] = 1/2.
        assert!(
            (first / f64::from(n) - 2.0 / 3.0).abs() < 1e-3 && (second / f64::from(n) - 0.5).abs() < 1e-3
        );
    }
}
