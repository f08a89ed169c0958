//! Samples of every layer at a point: its direct light, and one walk for all hours. A diffuse path does not depend on the
//! time of day, so each is traced once and every light's estimator adds to its own layer along it.
//!
//! The estimators are disjoint and complete. Suns and lamps are sampled from a point and are invisible to the walk; the sky is
//! met by the walk. Emissive surfaces, and the sky where a guide knows its bright parts, are both sampled and met, weighted by
//! the balance heuristic (Veach & Guibas 1995).

use super::lights::{GroupLight, Lights, SunDraw};
use super::rays::{Hit, Rays, offset_point};
use super::sampler::Sample;
use crate::Rgb;
use crate::geometry::Geometry;
use crate::surface::SurfacePoint;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// Russian roulette begins at this bounce.
const ROULETTE_FROM: u32 = 2;
/// The highest probability of going on under roulette, so that a walk ends even where nothing absorbs.
const GO_ON_AT_MOST: f32 = 0.999;
/// A walk whose weight has grown to this under roulette has met hardly any absorption in over two thousand bounces.
const ENDLESS: f32 = 10.0;

/// Everything a walk needs.
pub struct Transport<'a> {
    /// The triangles and materials.
    pub geometry: &'a Geometry,
    /// The ray tracer over them.
    pub rays: &'a Rays<'a>,
    /// What shines.
    pub lights: &'a Lights,
    /// Most reflections, `None` for no limit.
    bounces: Option<u32>,
    /// Per triangle, the unit normal of its front.
    fronts: Vec<Vec3>,
}

/// Rays traced, by purpose, and what the walks met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RayCounts {
    /// Segments of walks.
    pub walk: u64,
    /// Shadow rays to the sun.
    pub sun: u64,
    /// Shadow rays to lamps.
    pub lamp: u64,
    /// Shadow rays to the sky, through portals or at its bright parts.
    pub sky: u64,
    /// Shadow rays to bright surfaces.
    pub reflector: u64,
    /// Rays that find out which points of a texel lie inside a solid, or behind a wall.
    pub inside: u64,
    /// Walks that ended by reading the cache.
    pub cached: u64,
    /// Walks that would never end: nothing absorbs them.
    pub endless: u64,
}

impl RayCounts {
    /// Rays of all purposes.
    pub fn rays(&self) -> u64 {
        self.walk + self.sun + self.lamp + self.sky + self.reflector + self.inside
    }
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.walk += other.walk;
        self.sun += other.sun;
        self.lamp += other.lamp;
        self.sky += other.sky;
        self.reflector += other.reflector;
        self.inside += other.inside;
        self.cached += other.cached;
        self.endless += other.endless;
    }
}

impl std::ops::Add for RayCounts {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

/// A point light arrives at, moved off its surface.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    pub(super) origin: Vec3,
    pub(super) triangle: u32,
    /// Geometric normal on the side considered.
    pub(super) face_normal: Vec3,
    /// The normal cosines are measured against.
    pub(super) normal: Vec3,
}

/// A walk arriving at a surface.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Where.
    pub hit: Hit,
    /// Whether from the triangle's back.
    pub is_back: bool,
    /// Irradiance at the walk's start per unit of irradiance here.
    pub weight: Rgb,
    /// Direction of the last segment.
    pub direction: Vec3,
    /// Density over solid angle with which it was chosen.
    pub pdf: f32,
    /// Whether it is the first surface.
    pub is_first: bool,
}

/// Dimensions of a sample, by vertex of its walk: pairs and single numbers are counted apart.
mod dimension {
    /// The point within the texel.
    pub const POINT: u32 = 0;
    const PER_VERTEX: u32 = 4;
    pub fn onwards(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 1
    }
    pub fn sun(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 2
    }
    pub fn guide(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 3
    }
    pub fn roulette(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 4
    }
    /// Those of groups are spread by their key.
    pub fn group(vertex: u32, key: u32) -> u32 {
        key.wrapping_add(vertex.wrapping_mul(0x9e37_79b9))
    }
}

/// The pair of numbers that choose a sample's point within the texel.
pub fn point_pair(sample: Sample) -> Vec2 {
    sample.pair(dimension::POINT)
}

/// What the suns share of a sample's direct light.
pub fn sun_draw(sample: Sample) -> SunDraw {
    SunDraw::new(sample.pair(dimension::sun(0)))
}

impl<'a> Transport<'a> {
    /// Light in a scene; `bounces`: most reflections, `None` for no limit.
    pub fn new(geometry: &'a Geometry, rays: &'a Rays<'a>, lights: &'a Lights, bounces: Option<u32>) -> Self {
        let fronts = (0..geometry.triangles.len()).map(|t| geometry.normal(t)).collect();
        Transport { geometry, rays, lights, bounces, fronts }
    }

    /// Unit normal of a triangle's front; zero for one without area.
    #[inline]
    pub fn front(&self, triangle: u32) -> Vec3 {
        self.fronts[triangle as usize]
    }

    /// A point on one side of a triangle, with the normal of its plane. `None` without a normal.
    pub fn flat_receiver(&self, point: &SurfacePoint, is_back: bool) -> Option<Receiver> {
        let triangle = point.triangle as usize;
        let front = self.front(point.triangle);
        let normal = if is_back { -front } else { front };
        let origin = offset_point(&self.geometry.corners(triangle), point.barycentric, normal);
        (normal != Vec3::ZERO).then_some(Receiver {
            origin,
            triangle: point.triangle,
            face_normal: normal,
            normal,
        })
    }

    /// The texel's point, on the front, with the interpolated normal the game shades with. `None` without a normal.
    pub fn receiver(&self, point: &SurfacePoint) -> Option<Receiver> {
        let triangle = point.triangle as usize;
        let face_normal = self.front(point.triangle);
        if face_normal == Vec3::ZERO {
            return None;
        }
        let smooth = self.geometry.shading_normal_at(triangle, point.barycentric);
        let normal = if smooth.dot(face_normal) > 0.0 { smooth } else { face_normal };
        let origin = offset_point(&self.geometry.corners(triangle), point.barycentric, face_normal);
        Some(Receiver { origin, triangle: point.triangle, face_normal, normal })
    }

    /// Whether a point lies inside a solid: every one of a few fixed directions, straight up and close to the surface all
    /// around, meets the absorbing back of a one-sided triangle. The directions carry no light, so that leaving such points
    /// out does not favour the light that reaches the others.
    pub fn is_inside(&self, at: &Receiver, counts: &mut RayCounts) -> bool {
        let (tangent, bitangent) = at.face_normal.any_orthonormal_pair();
        // 75° off the normal: what stands under a single sheet sees past it, what lies in a closed body does not.
        let (sin, cos) = (0.965_925_8, 0.258_819_04);
        let is_back = |hit: &Hit, direction: Vec3| {
            let front = self.front(hit.triangle);
            front.dot(direction) > 0.0 && !self.material(hit.triangle).two_sided
        };
        // Where a body stands against another (a wall under a ceiling), its back and the other's front are met at once.
        const AT_ONCE: f32 = 1e-5;
        let mut against = 0;
        let mut meets_a_back = |direction: Vec3| {
            let Some(hit) = self.rays.nearest(at.origin, direction, at.triangle) else { return false };
            is_back(&hit, direction) || {
                against += 1;
                let next = self.rays.nearest(at.origin, direction, hit.triangle);
                next.is_some_and(|next| next.t - hit.t <= AT_ONCE * hit.t && is_back(&next, direction))
            }
        };
        let around = [tangent, bitangent, -tangent, -bitangent];
        let directions = around.map(|side| (side * sin + at.face_normal * cos).normalize());
        let mut traced = 0;
        let is_inside = [at.face_normal].into_iter().chain(directions).all(|direction| {
            traced += 1;
            meets_a_back(direction)
        });
        counts.inside += traced + against;
        is_inside
    }

    /// Whether nothing stands between two points.
    pub fn sees(&self, a: &Receiver, b: &Receiver, counts: &mut RayCounts) -> bool {
        counts.inside += 1;
        let (direction, distance) = (b.origin - a.origin).normalize_and_length();
        !self.rays.occluded(a.origin, direction, distance, a.triangle)
    }

    /// One sample of the light that comes straight from a sampled light (suns, then groups) as irradiance; its share, where the
    /// walk may meet the light as well. `draw` is [`sun_draw`] of the sample.
    pub fn direct(
        &self,
        at: &Receiver,
        light: usize,
        sample: Sample,
        draw: &SunDraw,
        counts: &mut RayCounts,
    ) -> Rgb {
        self.direct_at(at, light, sample, draw, 0, counts)
    }

    fn direct_at(
        &self,
        at: &Receiver,
        light: usize,
        sample: Sample,
        draw: &SunDraw,
        vertex: u32,
        counts: &mut RayCounts,
    ) -> Rgb {
        match self.lights.suns.get(light) {
            Some(sun) => {
                let direction = sun.sample(draw);
                let cosine = direction.dot(at.normal);
                if cosine <= 0.0 || direction.dot(at.face_normal) <= 0.0 {
                    return Rgb::ZERO;
                }
                counts.sun += 1;
                let blocked = self.rays.occluded(at.origin, direction, f32::INFINITY, at.triangle);
                if blocked { Rgb::ZERO } else { sun.irradiance() * cosine }
            }
            None => {
                let group = &self.lights.groups[light - self.lights.suns.len()];
                self.lamp(at, group, sample, vertex, counts).unwrap_or(Rgb::ZERO)
            }
        }
    }

    /// One sample of a group's lamps and emissive triangles.
    fn lamp(
        &self,
        at: &Receiver,
        group: &GroupLight,
        sample: Sample,
        vertex: u32,
        counts: &mut RayCounts,
    ) -> Option<Rgb> {
        let dimension = dimension::group(vertex, group.key);
        let u = sample.pair(dimension);
        let s = group.sampler.sample(at.origin, at.normal, sample.number(dimension), u)?;
        if s.irradiance == Rgb::ZERO || s.direction.dot(at.face_normal) <= 0.0 {
            return None;
        }
        counts.lamp += 1;
        // A ray to an emissive triangle must not be stopped by that very triangle.
        let distance = if s.emitter.is_some() { s.distance * (1.0 - 1e-4) } else { s.distance };
        if self.rays.occluded(at.origin, s.direction, distance, at.triangle) {
            return None;
        }
        // The walk meets emissive triangles with density cos θ ÷ π.
        let share = s.emitter.map_or(1.0, |(_, pdf)| balance(pdf, s.direction.dot(at.normal).max(0.0) / PI));
        Some(s.irradiance * share)
    }

    /// Adds one sample of all light at `start` that does not come straight from a sampled light. `land` is called where the
    /// walk arrives at a surface; it returns true where it knows the light there, has added it, and the walk may end.
    pub fn indirect(
        &self,
        start: &Receiver,
        sample: Sample,
        mut land: impl FnMut(&Arrival, &mut [Rgb], &mut RayCounts) -> bool,
        out: &mut [Rgb],
        counts: &mut RayCounts,
    ) {
        let lights = self.lights;
        let mut at = *start;
        // Irradiance at the start, per unit of it at the vertex.
        let mut weight = Rgb::ONE;
        for vertex in 0.. {
            if let Some(light) = self.guided_sky(&at, sample, vertex, counts) {
                lights.sky.add(light.0, weight * light.1, &mut out[lights.sky_layers()]);
            }
            // Onwards, distributed as the cosine: E = ∫ L cos θ dω is estimated by π L.
            let direction = cosine_direction(at.normal, sample.pair(dimension::onwards(vertex)));
            if direction.dot(at.face_normal) <= 0.0 {
                return;
            }
            counts.walk += 1;
            let pdf = direction.dot(at.normal).max(0.0) / PI;
            let beta = weight * PI;
            let Some(hit) = self.rays.nearest(at.origin, direction, at.triangle) else {
                let guided = lights.guide.as_ref().map(|g| g.pdf(at.origin, at.normal, direction));
                let share = guided.map_or(1.0, |guided| balance(pdf, guided));
                lights.sky.add(direction, beta * share, &mut out[lights.sky_layers()]);
                return;
            };
            let triangle = hit.triangle as usize;
            let material = self.material(hit.triangle);
            let front = self.front(hit.triangle);
            let is_back = front.dot(direction) > 0.0;
            if is_back && !material.two_sided {
                return;
            }
            if let Some((_, group)) = material.emission
                && let Some(g) = lights.place_of_group[group as usize]
            {
                let group = &lights.groups[g];
                let radiance = group.emission[self.geometry.material_of[triangle] as usize];
                let sampler = &group.sampler;
                let sampled = sampler.emitter_pdf(at.origin, at.normal, hit.triangle, direction, hit.t);
                out[lights.group_layer(g)] += beta * radiance * balance(pdf, sampled);
            }
            if self.bounces.is_some_and(|most| vertex + 1 > most) {
                return;
            }
            // Reflected radiance is albedo ÷ π times the irradiance there.
            weight *= self.geometry.albedo_at(triangle, hit.barycentric);
            let arrival = Arrival { hit, is_back, weight, pdf, direction, is_first: vertex == 0 };
            if land(&arrival, out, counts) {
                counts.cached += 1;
                return;
            }
            if vertex + 1 >= ROULETTE_FROM {
                let go_on = weight.max_element().min(GO_ON_AT_MOST);
                if sample.number(dimension::roulette(vertex)) >= go_on {
                    return;
                }
                weight /= go_on;
                if weight.max_element() > ENDLESS {
                    counts.endless += 1;
                    return;
                }
            }
            if weight.max_element() <= 0.0 {
                return;
            }
            let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
            let Some(next) = self.flat_receiver(&point, is_back) else { return };
            at = next;
            let draw = SunDraw::new(sample.pair(dimension::sun(vertex + 1)));
            for light in 0..lights.sampled() {
                out[lights.layer_of_sampled(light)] +=
                    weight * self.direct_at(&at, light, sample, &draw, vertex + 1, counts);
            }
        }
    }

    /// A direction in which the guide found open sky, and the irradiance per unit of radiance from there, weighted against the
    /// walk's own density.
    fn guided_sky(
        &self,
        at: &Receiver,
        sample: Sample,
        vertex: u32,
        counts: &mut RayCounts,
    ) -> Option<(Vec3, f32)> {
        let guide = self.lights.guide.as_ref()?;
        let dimension = dimension::guide(vertex);
        let u = sample.pair(dimension);
        let (direction, pdf) = guide.sample(at.origin, at.normal, sample.number(dimension), u)?;
        let cosine = direction.dot(at.normal);
        if cosine <= 0.0 || direction.dot(at.face_normal) <= 0.0 {
            return None;
        }
        counts.sky += 1;
        if self.rays.occluded(at.origin, direction, f32::INFINITY, at.triangle) {
            return None;
        }
        Some((direction, cosine / pdf * balance(pdf, cosine / PI)))
    }

    fn material(&self, triangle: u32) -> &crate::geometry::Material {
        &self.geometry.materials[self.geometry.material_of[triangle as usize] as usize]
    }
}

/// The balance heuristic: the share of a sample drawn with density `own` where `other` could have drawn it too.
pub fn balance(own: f32, other: f32) -> f32 {
    if own.is_infinite() { 1.0 } else { own / (own + other).max(f32::MIN_POSITIVE) }
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
