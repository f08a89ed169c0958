//! Samples of every layer at a point: its direct light, and one path for all hours. A diffuse path does not
//! depend on the time of day, so each is traced once and every light's estimator adds to its own layer along
//! it.
//!
//! The estimators are disjoint and complete. Suns and lamps are sampled from a point and are invisible to the
//! path; the sky is met by the path. Emissive surfaces, and the sky where a sampler knows its bright parts,
//! are both sampled and met, weighted by the balance heuristic (Veach & Guibas 1995).

use super::sampler::Sample;
use crate::Rgb;
use crate::light::lamps::LampSample;
use crate::surface::SurfacePoint;
use crate::trace::counts::RayCounts;
use crate::trace::rays::pane::{GlassEvent, pass_or_reflect};
use crate::trace::rays::{Hit, PassedGlass};
use crate::trace::solids::{Receiver, Space};
use crate::trace::sources::{FEW_GROUPS, FlushEmitters, GroupLight, Lights, SunSample, SystematicSampler};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Russian roulette begins at this bounce.
const ROULETTE_FROM: u32 = 2;
/// The highest probability of going on under roulette, so that a path ends even where nothing absorbs.
const MAX_SURVIVAL: f32 = 0.999;
/// A path whose weight has grown to this under roulette has met hardly any absorption in over two thousand
/// bounces.
const ENDLESS_WEIGHT: f32 = 10.0;

/// Everything a path needs.
pub struct Transport<'a> {
    /// What light moves in.
    pub space: Space<'a>,
    /// The emitters.
    pub lights: &'a Lights,
    /// Most reflections, `None` for no limit.
    pub bounces: Option<u32>,
    flush: FlushEmitters,
}

/// A path arriving at a surface.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Where.
    pub hit: Hit,
    /// Whether from the triangle's back.
    pub is_back: bool,
    /// Irradiance at the path's start per unit of irradiance here.
    pub weight: Rgb,
    /// Direction of the last segment.
    pub direction: Vec3,
    /// Density over solid angle with which it was chosen.
    pub pdf: f32,
    /// Whether it is the first surface.
    pub is_first: bool,
}

/// What a path met first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirstHit {
    /// An absorbing back, as from inside a solid, and no sky was sampled.
    Back,
    /// Anything else, or nothing.
    Other,
}

/// Dimensions of a sample, by vertex of its path: pairs and single numbers are counted apart.
mod dimension {
    /// The point within the texel.
    pub(super) const POINT: u32 = 0;
    const PER_VERTEX: u32 = 4;
    pub(super) fn next_direction(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 1
    }
    pub(super) fn sun(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 2
    }
    pub(super) fn sky_sampler(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 3
    }
    pub(super) fn roulette(vertex: u32) -> u32 {
        PER_VERTEX * vertex + 4
    }
    /// Those of the panes along a segment, of which there may be many.
    pub(super) fn pane(vertex: u32, pane: u32) -> u32 {
        vertex.wrapping_mul(0x85eb_ca6b).wrapping_add(pane).wrapping_add(0x676c_6173)
    }
    /// Which groups are sampled.
    pub(super) fn selected(vertex: u32) -> u32 {
        0x6173_6b00 + vertex
    }
    /// Those of groups are spread by their key.
    pub(super) fn group(vertex: u32, key: u32) -> u32 {
        key.wrapping_add(vertex.wrapping_mul(0x9e37_79b9))
    }
}

/// The pair of numbers that choose a sample's point within the texel.
pub fn point_pair(sample: Sample) -> Vec2 {
    sample.pair(dimension::POINT)
}

/// What the suns share of a sample's direct light.
pub fn sun_sample(sample: Sample) -> SunSample {
    SunSample::new(sample.pair(dimension::sun(0)))
}

impl<'a> Transport<'a> {
    /// Light in a scene; `bounces`: most reflections, `None` for no limit.
    pub fn new(space: Space<'a>, lights: &'a Lights, bounces: Option<u32>) -> Self {
        let flush = FlushEmitters::new(&space, lights);
        Transport { space, lights, bounces, flush }
    }

    /// One sample of the light that comes straight from a sampled light (suns, then groups) as irradiance;
    /// its share, where the path may meet the light as well. `sun_sample` is [`sun_sample`] of the sample.
    pub fn direct(
        &self,
        at: &Receiver,
        light: usize,
        sample: Sample,
        sun_sample: &SunSample,
        counts: &mut RayCounts,
    ) -> Rgb {
        self.direct_at(at, light, sample, sun_sample, 0, counts)
    }

    /// [`Lights::chances`] at a point of a surface.
    pub fn chances(&self, at: &Receiver, selected: usize) -> Option<Vec<f32>> {
        self.lights.chances(at.origin, at.normal, selected)
    }

    /// Adds one sample, times `weight`, of the light that comes straight from each sampled light at a vertex
    /// of a path (0: its start); of more than a few groups some are sampled ([`Lights::chances`]).
    pub fn add_direct(
        &self,
        at: &Receiver,
        weight: Rgb,
        sample: Sample,
        vertex: u32,
        out: &mut [Rgb],
        counts: &mut RayCounts,
    ) {
        let sun_sample = SunSample::new(sample.pair(dimension::sun(vertex)));
        let suns = self.lights.suns.len();
        let chances = self.chances(at, FEW_GROUPS);
        let mut sampler = SystematicSampler::new(if chances.is_some() {
            sample.number(dimension::selected(vertex))
        } else {
            0.0
        });
        for light in 0..self.lights.sampled() {
            // (How likely a group is sampled does not change how its light is shared with the path, which may
            // meet it too.)
            let chance = chances.as_ref().map_or(1.0, |c| if light < suns { 1.0 } else { c[light - suns] });
            if sampler.selects(chance) {
                let found = self.direct_at(at, light, sample, &sun_sample, vertex, counts);
                out[self.lights.layer_of_sampled(light)] += weight * found / chance;
            }
        }
    }

    fn direct_at(
        &self,
        at: &Receiver,
        light: usize,
        sample: Sample,
        sun_sample: &SunSample,
        vertex: u32,
        counts: &mut RayCounts,
    ) -> Rgb {
        match self.lights.suns.get(light) {
            Some(sun) => {
                let direction = sun.sample(sun_sample);
                let cosine = direction.dot(at.normal);
                if cosine <= 0.0 || direction.dot(at.face_normal) <= 0.0 {
                    return Rgb::ZERO;
                }
                counts.sun += 1;
                let through =
                    self.space.ray_tracer.transmittance(at.origin, direction, f32::INFINITY, at.triangle);
                sun.irradiance() * cosine * through
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
        let irradiance = match s.emitter {
            Some(emitter) if group.has_maps => self.mapped(at, group, &s, emitter)?,
            _ => s.irradiance,
        };
        let rays = self.space.ray_tracer;
        let distance = match s.emitter {
            Some((triangle, _)) => {
                let distance = rays.distance_to(at.origin, s.direction, s.distance, triangle);
                if self.flush.is_covered(triangle) {
                    let hit = Hit { triangle, barycentric: Vec3::ZERO, t: distance };
                    let owner = self.flush.owner(&self.space, at.origin, s.direction, &hit);
                    owner.filter(|owner| owner.triangle == triangle)?;
                }
                distance
            }
            None => s.distance,
        };
        counts.lamp += 1;
        let through = match s.is_flat {
            true => rays.transmittance_of_light(at.origin, s.direction, distance, at.triangle),
            false => rays.transmittance(at.origin, s.direction, distance, at.triangle),
        };
        if through == Rgb::ZERO {
            return None;
        }
        // The path meets emissive triangles with density cos θ ÷ π.
        let share = s
            .emitter
            .map_or(1.0, |(_, pdf)| balance_heuristic(pdf, s.direction.dot(at.normal).max(0.0) / PI));
        Some(irradiance * share * through)
    }

    /// The irradiance of a sample of an emissive triangle by what its map shows there; `None` where that is
    /// black.
    fn mapped(
        &self,
        at: &Receiver,
        group: &GroupLight,
        s: &LampSample,
        (triangle, pdf): (u32, f32),
    ) -> Option<Rgb> {
        let (geometry, triangle) = (self.space.geometry, triangle as usize);
        let material = geometry.material_of[triangle] as usize;
        if geometry.materials[material].emission.is_none_or(|emission| emission.map.is_none()) {
            return Some(s.irradiance);
        }
        let barycentrics = geometry.barycentric_of(triangle, at.origin + s.direction * s.distance);
        let radiance = group.emission[material] * geometry.emission_map_at(triangle, barycentrics);
        let irradiance = radiance * (s.direction.dot(at.normal).max(0.0) / pdf);
        (irradiance != Rgb::ZERO && irradiance.is_finite()).then_some(irradiance)
    }

    /// What is seen in a cosine-distributed direction, glass omitted: its distance in metres (∞: nothing),
    /// and the hit if a front is met. `None` where the direction lies below the triangle.
    pub fn seen(&self, at: &Receiver, sample: Sample) -> Option<(f32, Option<Hit>)> {
        let direction = cosine_direction(at.normal, sample.pair(dimension::next_direction(0)));
        if direction.dot(at.face_normal) <= 0.0 {
            return None;
        }
        let hit = self.space.ray_tracer.nearest_wall(at.origin, direction, at.triangle);
        let is_front = |hit: &Hit| self.space.front(hit.triangle).dot(direction) < 0.0;
        Some((hit.map_or(f32::INFINITY, |hit| hit.t), hit.filter(is_front)))
    }

    /// Adds one sample of all light at `start` that does not come straight from a sampled light. `on_arrival`
    /// is called where the path arrives at a surface; it returns true where it knows the light there, has
    /// added it, and the path may end.
    ///
    /// With `hit_light`, what comes straight from emissive surfaces to the start is added there, and from the
    /// sky if it is summed apart ([`Lights::layers_of_hit_lights`]).
    ///
    /// Returns what the path met first, glass that it passed omitted.
    pub fn indirect(
        &self,
        start: &Receiver,
        sample: Sample,
        mut on_arrival: impl FnMut(&Arrival, &mut [Rgb], &mut RayCounts) -> bool,
        out: &mut [Rgb],
        mut hit_light: Option<&mut [Rgb]>,
        counts: &mut RayCounts,
    ) -> FirstHit {
        let lights = self.lights;
        let mut at = *start;
        // Irradiance at the start, per unit of it at the vertex.
        let mut weight = Rgb::ONE;
        for vertex in 0.. {
            if vertex > 0 {
                hit_light = None;
            }
            let sky = self.sampled_sky(&at, sample, vertex, counts);
            if let Some(light) = sky {
                lights.add_from_outside(light.0, weight * light.1, out, hit_light.as_deref_mut());
            }
            // Onwards, distributed as the cosine: E = ∫ L cos θ dω is estimated by π L.
            let direction = cosine_direction(at.normal, sample.pair(dimension::next_direction(vertex)));
            if direction.dot(at.face_normal) <= 0.0 {
                return FirstHit::Other;
            }
            counts.path += 1;
            let pdf = direction.dot(at.normal).max(0.0) / PI;
            // To the first surface that does not let the path through.
            let (mut passed, mut panes) = (PassedGlass::default(), 0);
            let (hit, is_back) = loop {
                let beta = weight * PI;
                let Some(hit) =
                    self.space.ray_tracer.nearest_behind(at.origin, direction, at.triangle, &passed)
                else {
                    let sky_density = lights
                        .sky_sampler
                        .as_ref()
                        .map(|sampler| sampler.pdf(at.origin, at.normal, direction));
                    let share = sky_density.map_or(1.0, |density| balance_heuristic(pdf, density));
                    lights.add_from_outside(direction, beta * share, out, hit_light.as_deref_mut());
                    return FirstHit::Other;
                };
                let triangle = hit.triangle as usize;
                let material = self.space.material(hit.triangle);
                let front = self.space.front(hit.triangle);
                let is_back = front.dot(direction) > 0.0;
                let is_glass = self.space.geometry.is_glass(triangle);
                let absorbs = is_back && !material.two_sided;
                let mut add_emission = |hit: &Hit| {
                    self.add_emission(&at, direction, pdf, hit, beta, out, hit_light.as_deref_mut());
                };
                match !is_glass && self.flush.is_covered(hit.triangle) {
                    true => {
                        let owner = self.flush.owner(&self.space, at.origin, direction, &hit);
                        owner.iter().for_each(add_emission);
                    }
                    false => add_emission(&hit),
                }
                if !is_glass {
                    if absorbs {
                        return if vertex == 0 && sky.is_none() { FirstHit::Back } else { FirstHit::Other };
                    }
                    break (hit, is_back);
                }
                let choice = || sample.number(dimension::pane(vertex, panes));
                match pass_or_reflect(self.space.geometry, &hit, absorbs, choice, &mut weight) {
                    GlassEvent::Passes => passed.add(&hit),
                    GlassEvent::Reflects => break (hit, is_back),
                    GlassEvent::Ends => return FirstHit::Other,
                }
                panes += 1;
                counts.path += 1;
            };
            let triangle = hit.triangle as usize;
            if self.bounces.is_some_and(|most| vertex + 1 > most) {
                return FirstHit::Other;
            }
            // Reflected radiance is albedo ÷ π times the irradiance there.
            weight *= self.space.geometry.albedo_at(triangle, hit.barycentric);
            let arrival = Arrival { hit, is_back, weight, pdf, direction, is_first: vertex == 0 };
            if on_arrival(&arrival, out, counts) {
                counts.cached += 1;
                return FirstHit::Other;
            }
            if vertex + 1 >= ROULETTE_FROM {
                let survival = weight.max_element().min(MAX_SURVIVAL);
                if sample.number(dimension::roulette(vertex)) >= survival {
                    return FirstHit::Other;
                }
                weight /= survival;
                if weight.max_element() > ENDLESS_WEIGHT {
                    // (Where it is dark no light grows.)
                    counts.endless += u64::from(self.is_lit_about(&at));
                    return FirstHit::Other;
                }
            }
            if weight.max_element() <= 0.0 {
                return FirstHit::Other;
            }
            let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
            let Some(next) = self.space.receiver_on(&point, is_back) else { return FirstHit::Other };
            at = next;
            self.add_direct(&at, weight, sample, vertex + 1, out, counts);
        }
        FirstHit::Other
    }

    /// Adds what a surface that a path meets emits towards it. `pdf` is the density with which the path goes
    /// in the direction, `beta` what it brings per unit of radiance.
    #[expect(clippy::too_many_arguments, reason = "the state of a path")]
    fn add_emission(
        &self,
        at: &Receiver,
        direction: Vec3,
        pdf: f32,
        hit: &Hit,
        beta: Rgb,
        out: &mut [Rgb],
        hit_light: Option<&mut [Rgb]>,
    ) {
        let (lights, geometry) = (self.lights, self.space.geometry);
        let material = self.space.material(hit.triangle);
        let Some(emission) = material.emission else { return };
        let Some(&Some(g)) = lights.index_of_group.get(emission.group as usize) else { return };
        if self.space.front(hit.triangle).dot(direction) > 0.0 && !material.two_sided {
            return;
        }
        let group = &lights.groups[g];
        let triangle = hit.triangle as usize;
        let mut radiance = group.emission[geometry.material_of[triangle] as usize];
        if emission.map.is_some() {
            radiance *= geometry.emission_map_at(triangle, hit.barycentric);
        }
        let sampled = group.sampler.emitter_pdf(at.origin, at.normal, hit.triangle, direction, hit.t);
        let light = beta * radiance * balance_heuristic(pdf, sampled);
        match (hit_light, lights.hit_index_of_group.get(g)) {
            (Some(hit_light), Some(&Some(index))) => hit_light[index] += light,
            _ => out[lights.group_layer(g)] += light,
        }
    }

    /// A direction in which the sky sampler found open sky, and the irradiance per unit of radiance from
    /// there, weighted against the path's own density.
    fn sampled_sky(
        &self,
        at: &Receiver,
        sample: Sample,
        vertex: u32,
        counts: &mut RayCounts,
    ) -> Option<(Vec3, Rgb)> {
        let sky_sampler = self.lights.sky_sampler.as_ref()?;
        let dimension = dimension::sky_sampler(vertex);
        let u = sample.pair(dimension);
        let (direction, pdf) = sky_sampler.sample(at.origin, at.normal, sample.number(dimension), u)?;
        let cosine = direction.dot(at.normal);
        if cosine <= 0.0 || direction.dot(at.face_normal) <= 0.0 {
            return None;
        }
        counts.sky += 1;
        let through = self.space.ray_tracer.transmittance(at.origin, direction, f32::INFINITY, at.triangle);
        if through == Rgb::ZERO {
            return None;
        }
        Some((direction, through * (cosine / pdf * balance_heuristic(pdf, cosine / PI))))
    }
}

/// The balance heuristic: the share of a sample drawn with density `own` where `other` could have drawn it
/// too.
pub fn balance_heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() { 1.0 } else { own / (own + other).max(f32::MIN_POSITIVE) }
}

/// A unit direction about `normal` with density cos θ ÷ π.
pub fn cosine_direction(normal: Vec3, u: Vec2) -> Vec3 {
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
    use super::super::sampler::{Sequence, SequenceKind};
    use super::*;

    #[test]
    fn cosine_directions_have_the_cosines_moments() {
        let sequence = Sequence::new(1, SequenceKind::Texel, 3, 0);
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
