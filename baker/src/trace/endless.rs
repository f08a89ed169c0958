//! Paths that hardly anything absorbs.

use super::counts::RayCounts;
use super::rays::Passed;
use super::sampler::Sequence;
use super::walk::{Transport, cosine_direction};
use crate::Rgb;
use crate::surface::SurfacePoint;
use glam::Vec3;

/// Bounces after which a path that kept half of its light is without end.
const BOUNCES: u32 = 1500;
/// So many of a path's first vertices are asked whether they are lit.
const ASKED: u32 = 64;

impl Transport<'_> {
    /// Whether a path from a triangle's middle keeps half of its light for 1500 bounces in a place that is lit.
    pub fn is_endless(&self, triangle: u32, sequence: Sequence) -> bool {
        if self.bounces.is_some() {
            return false;
        }
        let space = &self.space;
        let middle = SurfacePoint { triangle, barycentric: Vec3::splat(1.0 / 3.0) };
        let Some(mut at) = space.receiver(&middle) else { return false };
        let (mut weight, mut is_lit) = (Rgb::ONE, false);
        let (mut light, mut counts) = (vec![Rgb::ZERO; self.lights.layers()], RayCounts::default());
        for bounce in 0..BOUNCES {
            let sample = sequence.sample(bounce);
            if bounce < ASKED && !is_lit {
                self.add_direct(&at, Rgb::ONE, sample, 0, &mut light, &mut counts);
                is_lit = light.iter().any(|light| *light != Rgb::ZERO);
            }
            if bounce == ASKED && !is_lit {
                return false;
            }
            let direction = cosine_direction(at.normal, sample.pair(0));
            if direction.dot(at.face_normal) <= 0.0 {
                return false;
            }
            // What glass reflects counts as if it went on.
            let mut passed = Passed::default();
            let hit = loop {
                let next = space.rays.beyond(at.origin, direction, at.triangle, &passed);
                let Some(hit) = next else { return false };
                let triangle = hit.triangle as usize;
                if !space.geometry.is_glass(triangle) {
                    break hit;
                }
                weight *= space.geometry.transmittance_at(triangle, hit.barycentric)
                    + space.geometry.albedo_at(triangle, hit.barycentric);
                if weight.max_element() < 0.5 {
                    return false;
                }
                passed.add(&hit);
            };
            let material = space.material(hit.triangle);
            let is_back = space.front(hit.triangle).dot(direction) > 0.0;
            if is_back && !material.two_sided {
                return false;
            }
            is_lit |= material.emission.is_some();
            weight *= space.geometry.albedo_at(hit.triangle as usize, hit.barycentric);
            if weight.max_element() < 0.5 {
                return false;
            }
            let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
            let Some(next) = space.receiver_on(&point, is_back) else { return false };
            at = next;
        }
        true
    }
}
