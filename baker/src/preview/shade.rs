//! What a camera ray sees.

use super::baked::Baked;
use super::light::Light;
use crate::Rgb;
use crate::geometry::BLOCKED_BELOW;
use crate::surface::SurfacePoint;
use crate::trace::counts::RayCounts;
use crate::trace::lens::NO_TRIANGLE;
use crate::trace::path::Transport;
use crate::trace::ray_tracer::{PassedGlass, offset_point};
use crate::trace::sampler::Sequence;
use crate::trace::triangle::Hit;
use glam::Vec3;
use std::f32::consts::PI;

/// Radiance along camera rays.
pub struct Shader<'a> {
    /// The scene, and paths in it.
    pub transport: Transport<'a>,
    /// The emitters.
    pub light: &'a Light,
    /// Its light on surfaces with texels.
    pub baked: &'a Baked,
    /// Paths that estimate the light of a surface without texels, per camera ray.
    pub paths: u32,
}

impl Shader<'_> {
    /// Radiance that arrives along a camera ray, and whether it is a surface's; `number` is the ray's place
    /// in its pixel's `paths`.
    pub fn radiance(&self, origin: Vec3, direction: Vec3, paths: Sequence, number: u32) -> (Rgb, bool) {
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
            let reflected = match self.of_texel(&hit, is_back) {
                Some(irradiance) => albedo * irradiance / PI,
                None if albedo == Rgb::ZERO => Rgb::ZERO,
                None => albedo * self.estimate(&hit, is_back, paths, number) / PI,
            };
            seen += left * (reflected + self.light.emission(geometry, triangle, hit.barycentric));
            if !is_glass {
                return (seen, true);
            }
            left *= geometry.transmittance_at(triangle, hit.barycentric);
            if left.max_element() < BLOCKED_BELOW {
                return (seen, true);
            }
            passed.add(&hit);
        }
        (seen + left * self.light.sky(direction), false)
    }

    /// Baked irradiance, where there is any.
    fn of_texel(&self, hit: &Hit, is_back: bool) -> Option<Rgb> {
        if is_back { None } else { self.baked.irradiance(hit.triangle, hit.barycentric) }
    }

    /// Irradiance where nothing was baked: light straight from sun and lamps, and paths that end at the first
    /// baked surface.
    fn estimate(&self, hit: &Hit, is_back: bool, paths: Sequence, number: u32) -> Rgb {
        let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
        let space = &self.transport.space;
        let Some(at) = space.receiver_on(&point, is_back) else { return Rgb::ZERO };
        let lights = &self.light.lights;
        let (mut layers, mut read) = (vec![Rgb::ZERO; lights.layers()], Rgb::ZERO);
        let (mut direct, mut hit_light) = (layers.clone(), vec![Rgb::ZERO; lights.hit_lights()]);
        let mut counts = RayCounts::default();
        for path in number * self.paths..(number + 1) * self.paths {
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
        (self.light.sum(&layers) + read) / self.paths as f32
    }
}
