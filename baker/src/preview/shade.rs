//! What a camera ray sees.

use super::baked::Baked;
use super::light::Light;
use crate::Rgb;
use crate::geometry::BLOCKED_BELOW;
use crate::surface::SurfacePoint;
use crate::trace::counts::RayCounts;
use crate::trace::paths::{Sequence, Transport};
use crate::trace::rays::ray_tracer::{PassedGlass, offset_point};
use crate::trace::rays::{Hit, NO_TRIANGLE};
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;

/// Radiance along camera rays.
pub(super) struct Shader<'a> {
    /// The scene, and paths in it.
    pub transport: Transport<'a>,
    /// The emitters.
    pub light: &'a Light,
    /// Its light on surfaces with texels.
    pub baked: &'a Baked,
    /// Paths that estimate the light of a surface without texels, per camera ray; `None`: as an engine that
    /// has nothing but the texels, which leaves it black, and lights backs like their fronts.
    pub paths: Option<u32>,
}

/// What a camera ray ends at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// The sky, or the ground below it.
    Outside,
    /// A surface with light.
    Lit,
    /// A surface that nothing lights.
    Unlit,
}

impl Shader<'_> {
    /// Radiance that arrives along a camera ray, and what from; `number` is the ray's place in its pixel's
    /// `paths`.
    pub(super) fn radiance(
        &self,
        origin: Vec3,
        direction: Vec3,
        paths: Sequence,
        number: u32,
    ) -> (Rgb, Seen) {
        /// Backs that one ray passes; more are the walls of an endless stack.
        const MOST_BACKS: usize = 256;
        let (space, geometry) = (&self.transport.space, self.transport.space.geometry);
        let (mut from, mut start) = (NO_TRIANGLE, origin);
        let (mut passed, mut seen, mut left) = (PassedGlass::default(), Rgb::ZERO, Rgb::ONE);
        for _ in 0..MOST_BACKS {
            let Some(hit) = space.ray_tracer.nearest_behind(start, direction, from, &passed) else { break };
            let (triangle, front) = (hit.triangle as usize, space.front(hit.triangle));
            let is_back = front.dot(direction) > 0.0;
            let material = geometry.material_of[triangle];
            let is_glass = geometry.is_glass(triangle);
            if is_back && !is_glass && !geometry.materials[material as usize].two_sided {
                // Not drawn, as in a game: on from its other side.
                (from, start) =
                    (hit.triangle, offset_point(&geometry.corners(triangle), hit.barycentric, front));
                passed = PassedGlass::default();
                continue;
            }
            if is_glass && is_back && !geometry.materials[material as usize].two_sided {
                // Dims, and shows nothing of its own.
                left *= geometry.transmittance_at(triangle, hit.barycentric);
                passed.add(&hit);
                continue;
            }
            let albedo = geometry.albedo_at(triangle, hit.barycentric);
            let (irradiance, what) = match (self.of_texel(&hit, is_back), self.paths) {
                (Some(irradiance), _) => (irradiance, Seen::Lit),
                (None, Some(_)) if albedo == Rgb::ZERO => (Rgb::ZERO, Seen::Lit),
                (None, Some(count)) => {
                    let numbers = number * count..(number + 1) * count;
                    (self.estimate(&hit, is_back, paths, numbers), Seen::Lit)
                }
                (None, None) => (Rgb::ZERO, Seen::Unlit),
            };
            let emitted = self.light.emission(geometry, triangle, hit.barycentric);
            seen += left * (albedo * irradiance / PI + emitted);
            if !is_glass {
                return (seen, what);
            }
            left *= geometry.transmittance_at(triangle, hit.barycentric);
            if left.max_element() < BLOCKED_BELOW {
                return (seen, what);
            }
            passed.add(&hit);
        }
        (seen + left * self.light.sky(direction), Seen::Outside)
    }

    /// Baked irradiance, where there is any.
    fn of_texel(&self, hit: &Hit, is_back: bool) -> Option<Rgb> {
        let is_lightless = is_back && self.paths.is_some();
        if is_lightless { None } else { self.baked.irradiance(hit.triangle, hit.barycentric) }
    }

    /// Irradiance where nothing was baked: light straight from sun and lamps, and paths that end at the first
    /// baked surface.
    fn estimate(&self, hit: &Hit, is_back: bool, paths: Sequence, numbers: Range<u32>) -> Rgb {
        let count = numbers.len();
        let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
        let space = &self.transport.space;
        let Some(at) = space.receiver_on(&point, is_back) else { return Rgb::ZERO };
        let lights = &self.light.lights;
        let (mut layers, mut read) = (vec![Rgb::ZERO; lights.layers()], Rgb::ZERO);
        let (mut direct, mut hit_light) = (layers.clone(), vec![Rgb::ZERO; lights.hit_lights()]);
        let mut counts = RayCounts::default();
        for path in numbers {
            let sample = paths.sample(path);
            self.transport.add_direct(&at, Rgb::ONE, sample, 0, &mut direct, &mut counts);
            self.transport.indirect(
                &at,
                sample,
                |arrival, _, _| match self.of_texel(&arrival.hit, arrival.is_back) {
                    Some(irradiance) => {
                        read += arrival.weight * irradiance;
                        true
                    }
                    None => false,
                },
                &mut layers,
                Some(&mut hit_light),
                &mut counts,
            );
        }
        lights.add_held(&direct, &hit_light, &mut layers);
        (self.light.sum(&layers) + read) / count as f32
    }
}
