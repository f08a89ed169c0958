//! Paths that hardly anything absorbs.

use super::counts::RayCounts;
use super::sampler::Sequence;
use super::walk::{Transport, cosine_direction};
use crate::Rgb;
use crate::surface::SurfacePoint;
use glam::Vec3;

/// Bounces after which a path that kept half of its light is without end.
const BOUNCES: u32 = 1500;
/// So many of a path's first vertices are asked whether they are lit.
const ASKED: u32 = 64;
/// So many of a path's last vertices tell where it is caught.
const LAST: u32 = 64;

impl Transport<'_> {
    /// Follows a path from the middle of a triangle's front, or its back. If it keeps half of its light for 1500 bounces in a place that is
    /// lit, gives the triangles it met last.
    pub fn endless_path(&self, triangle: u32, is_back: bool, sequence: Sequence) -> Option<Vec<u32>> {
        if self.bounces.is_some() {
            return None;
        }
        let space = &self.space;
        let middle = SurfacePoint { triangle, barycentric: Vec3::splat(1.0 / 3.0) };
        let mut at = space.receiver_on(&middle, is_back)?;
        let mut last = Vec::new();
        let (mut weight, mut is_lit) = (Rgb::ONE, false);
        let (mut light, mut counts) = (vec![Rgb::ZERO; self.lights.layers()], RayCounts::default());
        for bounce in 0..BOUNCES {
            let sample = sequence.sample(bounce);
            if bounce < ASKED && !is_lit {
                self.add_direct(&at, Rgb::ONE, sample, 0, &mut light, &mut counts);
                is_lit = light.iter().any(|light| *light != Rgb::ZERO);
            }
            if bounce == ASKED && !is_lit {
                return None;
            }
            let direction = cosine_direction(at.normal, sample.pair(0));
            if direction.dot(at.face_normal) <= 0.0 {
                return None;
            }
            let hit = space.rays.nearest(at.origin, direction, at.triangle)?;
            let material = space.material(hit.triangle);
            let is_back = space.front(hit.triangle).dot(direction) > 0.0;
            if is_back && !material.two_sided {
                return None;
            }
            is_lit |= material.emission.is_some();
            weight *= space.geometry.albedo_at(hit.triangle as usize, hit.barycentric);
            if weight.max_element() < 0.5 {
                return None;
            }
            if bounce + LAST >= BOUNCES {
                last.push(hit.triangle);
            }
            let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
            at = space.receiver_on(&point, is_back)?;
        }
        Some(last)
    }
}
