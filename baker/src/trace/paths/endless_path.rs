//! Paths that hardly anything absorbs.

use super::path::{Transport, cosine_direction};
use super::sampler::{Sequence, SequenceKind};
use crate::Rgb;
use crate::surface::SurfacePoint;
use crate::trace::counts::RayCounts;
use crate::trace::rays::{Hit, PassedGlass};
use crate::trace::solids::Receiver;
use glam::{Vec2, Vec3};

/// Bounces after which a path that kept half of its light is without end.
const ENDLESS_BOUNCES: u32 = 1500;
/// So many of a path's first vertices are asked whether they are lit.
const VERTICES_TESTED_FOR_LIGHT: u32 = 64;
/// So many of a path's last vertices tell where it is caught.
const LAST_VERTICES: u32 = 64;

/// A path that kept half of its light for 1500 bounces.
#[derive(Clone, Debug)]
pub struct EndlessPath {
    /// The triangles that it met last.
    pub triangles: Vec<u32>,
    /// Whether any light reached its first vertices.
    pub is_lit: bool,
}

impl Transport<'_> {
    /// Follows a path from the middle of a triangle's front, or its back, to its end; `None` if it has one.
    /// Where it is dark, it is followed only if `in_the_dark`.
    pub fn endless_path(
        &self,
        triangle: u32,
        is_back: bool,
        sequence: Sequence,
        in_the_dark: bool,
    ) -> Option<EndlessPath> {
        if self.bounces.is_some() {
            return None;
        }
        let middle = SurfacePoint { triangle, barycentric: Vec3::splat(1.0 / 3.0) };
        let mut at = self.space.receiver_on(&middle, is_back)?;
        let (mut weight, mut is_lit, mut triangles) = (Rgb::ONE, false, Vec::new());
        for bounce in 0..ENDLESS_BOUNCES {
            is_lit |= bounce < VERTICES_TESTED_FOR_LIGHT && !is_lit && self.is_lit(&at, sequence, bounce);
            if bounce == VERTICES_TESTED_FOR_LIGHT && !is_lit && !in_the_dark {
                return None;
            }
            let (next, hit) = self.step(&at, sequence.sample(bounce).pair(0), &mut weight)?;
            is_lit |= self.space.material(hit.triangle).emission.is_some();
            weight *= self.space.geometry.albedo_at(hit.triangle as usize, hit.barycentric);
            if weight.max_element() < 0.5 {
                return None;
            }
            if bounce + LAST_VERTICES >= ENDLESS_BOUNCES {
                triangles.push(hit.triangle);
            }
            at = next;
        }
        Some(EndlessPath { triangles, is_lit })
    }

    /// Whether light is found about a point of a path that did not end: at its next vertices, or where it
    /// leaves the scene.
    pub fn is_lit_about(&self, start: &Receiver) -> bool {
        let sequence = Sequence::new(0, SequenceKind::PlanRay, start.triangle, 0);
        let mut at = *start;
        for bounce in 0..VERTICES_TESTED_FOR_LIGHT {
            if self.is_lit(&at, sequence, bounce) {
                return true;
            }
            let mut weight = Rgb::ONE;
            let step = self.step(&at, sequence.sample(bounce).pair(0), &mut weight);
            let Some((next, hit)) = step else { return true };
            if self.space.material(hit.triangle).emission.is_some() {
                return true;
            }
            at = next;
        }
        false
    }

    /// Whether a sample of the sampled lights reaches a point.
    fn is_lit(&self, at: &Receiver, sequence: Sequence, number: u32) -> bool {
        let (mut light, mut counts) = (vec![Rgb::ZERO; self.lights.layers()], RayCounts::default());
        self.add_direct(at, Rgb::ONE, sequence.sample(number), 0, &mut light, &mut counts);
        light.iter().any(|light| *light != Rgb::ZERO)
    }

    /// The next vertex of a path, and what it meets there; `None` where it ends. Glass on the way takes its
    /// part of `weight`.
    fn step(&self, at: &Receiver, u: Vec2, weight: &mut Rgb) -> Option<(Receiver, Hit)> {
        let space = &self.space;
        let direction = cosine_direction(at.normal, u);
        if direction.dot(at.face_normal) <= 0.0 {
            return None;
        }
        // What glass reflects counts as if it went on.
        let mut passed = PassedGlass::default();
        let hit = loop {
            let hit = space.ray_tracer.nearest_behind(at.origin, direction, at.triangle, &passed)?;
            let triangle = hit.triangle as usize;
            if !space.geometry.is_glass(triangle) {
                break hit;
            }
            *weight *= space.geometry.transmittance_at(triangle, hit.barycentric)
                + space.geometry.albedo_at(triangle, hit.barycentric);
            passed.add(&hit);
        };
        let is_back = space.front(hit.triangle).dot(direction) > 0.0;
        if is_back && !space.material(hit.triangle).two_sided {
            return None;
        }
        let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
        Some((space.receiver_on(&point, is_back)?, hit))
    }
}
