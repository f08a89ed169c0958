//! Whether a point lies in a pocket of two-sided bodies: in one of them, or under one that stands on its
//! surface.
//!
//! Such backs may also be the walls of a lit room, so this alone does not make a point invalid; it does where
//! no light is found.

use super::space::{Receiver, Space, SurroundingHits};
use crate::trace::counts::RayCounts;
use crate::trace::rays::Hit;
use glam::Vec3;

/// Directions besides the normal and those close to the surface.
const MORE: usize = 16;
/// At least one direction in this many meets a back.
const ONE_IN: usize = 4;
/// Cosine and sine of the golden angle.
const GOLDEN: [f32; 2] = [-0.737_368_9, 0.675_490_3];

impl Space<'_> {
    /// Whether an opaque surface is met in every one of 21 directions, and in a quarter of them the back of a
    /// two-sided one. The answer does not depend on the seed. (For one-sided bodies see
    /// [`Space::is_in_solid`] and [`Space::is_enclosed`].)
    pub fn is_closed_in(&self, at: &Receiver, counts: &mut RayCounts) -> bool {
        let mut known_hits = SurroundingHits::default();
        let around = Self::directions_around(at);
        let mut backs = 0;
        for (k, direction) in around.into_iter().enumerate() {
            let Some(hit) = self.hit_in(at, k, &mut known_hits, counts) else { return false };
            match self.is_two_sided_back(at, direction, &hit, counts) {
                Some(is_back) => backs += usize::from(is_back),
                None => return false,
            }
        }
        // (Most points indoors see fronts alone: the first directions tell.)
        if backs == 0 {
            return false;
        }
        for direction in cosine_spiral(at) {
            counts.inside += 1;
            let Some(hit) = self.ray_tracer.nearest_wall(at.origin(), direction, at.triangle) else {
                return false;
            };
            match self.is_two_sided_back(at, direction, &hit, counts) {
                Some(is_back) => backs += usize::from(is_back),
                None => return false,
            }
        }
        ONE_IN * backs >= around.len() + MORE
    }

    /// Whether what is met is the back of a two-sided surface, or such a back lies where a front is met (a
    /// face that is there twice, turned both ways). `None`: it is a cut-out, beside which light may pass.
    fn is_two_sided_back(
        &self,
        at: &Receiver,
        direction: Vec3,
        hit: &Hit,
        counts: &mut RayCounts,
    ) -> Option<bool> {
        let is_back = |hit: &Hit| {
            self.material(hit.triangle).two_sided && self.front(hit.triangle).dot(direction) > 0.0
        };
        let is_cut_out = self.material(hit.triangle).alpha_cutoff.is_some();
        (!is_cut_out).then(|| {
            is_back(hit)
                || self.coincident_hit(at, direction, hit, counts).is_some_and(|other| is_back(&other))
        })
    }
}

/// Directions over the hemisphere about a point's normal, as dense as light from there counts.
fn cosine_spiral(at: &Receiver) -> impl Iterator<Item = Vec3> {
    let (tangent, bitangent) = at.face_normal.any_orthonormal_pair();
    let normal = at.face_normal;
    let mut aside = [1.0f32, 0.0];
    (0..MORE).map(move |k| {
        let squared = (k as f32 + 0.5) / MORE as f32;
        let (cosine, sine) = (squared.sqrt(), (1.0 - squared).sqrt());
        let [c, s] = aside;
        aside = [c * GOLDEN[0] - s * GOLDEN[1], c * GOLDEN[1] + s * GOLDEN[0]];
        (normal * cosine + (tangent * c + bitangent * s) * sine).normalize()
    })
}
