//! What works on blocks of texels: the points of their samples. (Which points are surface: `point`. What
//! light they get: `direct`, `indirect`.)

use crate::bake::store::{ALL_POINTS, BlockState, POINTS};
use crate::receivers::{ReceiverBlock, Receivers};
use crate::trace::counts::{RayCounts, sum};
use crate::trace::paths::path::{Transport, point_pair};
use crate::trace::paths::{Sample, Sequence, SequenceKind};
use crate::trace::solids::Receiver;
use glam::Vec2;
use rayon::prelude::*;

/// What a sequence of random numbers is for. Each comes in two halves, scrambled independently.
#[derive(Clone, Copy, Debug)]
pub enum Stream {
    /// Indirect light.
    Indirect = 0,
    /// Direct light.
    Direct = 2,
    /// The points that tell which surface a texel stands for.
    Point = 4,
    /// The paths the cache is solved on.
    Solver = 6,
    /// The reference texels are checked against.
    Check = 8,
    /// What bright surfaces are seen.
    BrightSurfaces = 10,
    /// Direct light that only decides how many samples it gets.
    Pilot = 12,
    /// How much of the sun is seen.
    Visibility = 14,
    /// What is seen from a cell.
    VisibleCells = 16,
}

/// What blocks are worked on with.
pub struct Worker<'a> {
    /// Light and geometry.
    pub transport: Transport<'a>,
    /// Where light is gathered.
    pub receivers: &'a dyn Receivers,
    /// Seed of all randomness.
    pub seed: u64,
    /// Least samples of indirect light per texel: all, or towards a target or under a time limit those of the
    /// first round. The work before the rounds is scaled by it.
    pub guaranteed_samples: u32,
}

impl Worker<'_> {
    /// The blocks that have receivers.
    pub fn blocks(&self) -> Vec<usize> {
        self.receivers.blocks()
    }

    /// The receivers of a block.
    pub fn block(&self, block: usize) -> ReceiverBlock<'_> {
        self.receivers.block(block)
    }

    /// A texel's samples for one purpose and half. `texel` counts within the block, row by row.
    pub fn sequence(&self, receivers: &ReceiverBlock, texel: usize, stream: Stream, half: usize) -> Sequence {
        let index = receivers.page_index(texel);
        Sequence::new(self.seed, SequenceKind::Texel, index as u32, stream as u32 + half as u32)
    }

    /// The point of a sample. Where only some of the texel's 16 points are its surface (`points` says
    /// which), it lies around one of those: in the sixteenth of the texel that this point stands for,
    /// as far as it is seen from there.
    pub fn receiver(
        &self,
        receivers: &ReceiverBlock,
        texel: usize,
        sample: Sample,
        points: u16,
        counts: &mut RayCounts,
    ) -> Option<Receiver> {
        if points == ALL_POINTS {
            return self.any_point(receivers, texel, sample);
        }
        // The k-th set bit; what is left of the number chooses the place around it.
        let u = point_pair(sample);
        let k = u.x * points.count_ones() as f32;
        let point = indices(points).nth(k as usize)?;
        let place = Self::place(point);
        // (The 16 points of a (0, 2)-sequence lie one in each square of a 4 × 4 grid.)
        let square = (place * 4.0).floor();
        let around = ((square + Vec2::new(k.fract(), u.y)) / 4.0).min(Vec2::splat(1.0 - f32::EPSILON));
        let known = receivers.receiver(&self.transport.space, texel, place)?;
        let at = receivers.receiver(&self.transport.space, texel, around);
        Some(at.filter(|at| self.transport.space.sees(&known, at, counts)).unwrap_or(known))
    }

    /// The point of a sample, be it inside a solid.
    pub fn any_point(&self, receivers: &ReceiverBlock, texel: usize, sample: Sample) -> Option<Receiver> {
        receivers.receiver(&self.transport.space, texel, point_pair(sample))
    }

    /// Whether points of a texel that are not its surface lie outside solids all the same: on the other side
    /// of a wall.
    pub fn is_split(
        &self,
        receivers: &ReceiverBlock,
        texel: usize,
        points: u16,
        counts: &mut RayCounts,
    ) -> bool {
        indices(!points).any(|point| {
            let at = self.point(receivers, texel, point);
            at.is_some_and(|at| !self.transport.space.is_inside(&at, counts))
        })
    }

    /// A few of the points that are a texel's surface.
    pub fn some_points(&self, receivers: &ReceiverBlock, texel: usize, points: u16) -> Vec<Receiver> {
        const MOST: u32 = 4;
        let some = indices(points).step_by(points.count_ones().div_ceil(MOST).max(1) as usize);
        some.filter_map(|point| self.point(receivers, texel, point)).collect()
    }

    /// One of the points that are a texel's surface.
    pub fn one_point(&self, receivers: &ReceiverBlock, texel: usize, points: u16) -> Option<Receiver> {
        indices(points).find_map(|point| self.point(receivers, texel, point))
    }

    /// Per covered texel, whether its surface is closed in by two-sided bodies: all of a few points are. What
    /// is not usable is not.
    pub fn closed_in(
        &self,
        receivers: &ReceiverBlock,
        covered: &[usize],
        state: &BlockState,
        counts: &mut RayCounts,
    ) -> Vec<bool> {
        if !self.transport.space.geometry.materials.iter().any(|material| material.two_sided) {
            return vec![false; covered.len()];
        }
        let of = |(i, &texel): (usize, &usize)| {
            let mut counts = RayCounts::default();
            let points = self.some_points(receivers, texel, state.points[i]);
            let is_closed_in = state.is_usable(i)
                && !points.is_empty()
                && points.iter().all(|at| self.transport.space.is_closed_in(at, &mut counts));
            (is_closed_in, counts)
        };
        let found: Vec<(bool, RayCounts)> = covered.par_iter().enumerate().with_min_len(64).map(of).collect();
        *counts += sum(found.iter().map(|(_, counts)| *counts));
        found.into_iter().map(|(is_closed_in, _)| is_closed_in).collect()
    }

    /// The point of a texel with a number.
    pub fn point(&self, receivers: &ReceiverBlock, texel: usize, point: u32) -> Option<Receiver> {
        receivers.receiver(&self.transport.space, texel, Self::place(point))
    }

    /// Where the points of a texel lie: at the same places in all, whatever the seed. A wall that stands
    /// along a row of texels then leaves them all the same side, not one or the other by chance.
    fn place(point: u32) -> Vec2 {
        // A sequence that stands well apart and has a point near every corner.
        const SPREAD: u32 = 239;
        point_pair(Sequence::new(0, SequenceKind::Texel, SPREAD, Stream::Point as u32).sample(point))
    }
}

/// The numbers of the points whose bits are set.
pub(crate) fn indices(points: u16) -> impl Iterator<Item = u32> {
    (0..POINTS).filter(move |&point| points >> point & 1 == 1)
}
