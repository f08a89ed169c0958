//! What works on blocks of texels: the points of a texel that are its surface. (What light they get: `direct`, `indirect`.)

use super::state::{ALL_OUTSIDE, BlockState, PROBES};
use crate::atlas::Atlas;
use crate::surface::{BlockSurface, FaceBins, SurfacePoint};
use crate::trace::sampler::{Sample, Sequence};
use crate::trace::walk::{RayCounts, Receiver, Transport, point_pair};
use glam::Vec2;
use rayon::prelude::*;

/// What a sequence of random numbers is for. Each comes in two halves, scrambled independently.
#[derive(Clone, Copy, Debug)]
pub enum Stream {
    /// Indirect light.
    Indirect = 0,
    /// Direct light.
    Direct = 2,
    /// Points probed for lying inside solids.
    Probe = 4,
    /// The walks the cache is solved on.
    Pilot = 6,
    /// The reference texels are checked against.
    Check = 8,
    /// What bright surfaces are seen.
    View = 10,
}

/// What blocks are worked on with.
pub struct Worker<'a> {
    /// Light and geometry.
    pub transport: Transport<'a>,
    /// Where texels lie.
    pub atlas: &'a Atlas,
    /// The faces of each block.
    pub bins: &'a FaceBins,
    /// Seed of all randomness.
    pub seed: u64,
}

impl Worker<'_> {
    /// The blocks that hold surface.
    pub fn blocks(&self) -> Vec<usize> {
        (0..self.bins.columns * self.bins.rows).filter(|&b| !self.bins.faces(b).is_empty()).collect()
    }

    /// The surface of a block.
    pub fn surface(&self, block: usize) -> BlockSurface {
        BlockSurface::new(self.atlas, self.bins, block)
    }

    /// A texel's samples for one purpose and half. `texel` counts within the block, row by row.
    pub fn sequence(&self, surface: &BlockSurface, texel: usize, stream: Stream, half: usize) -> Sequence {
        let index = surface.page_index(self.atlas, texel);
        Sequence::new(self.seed, 0, index as u32, stream as u32 + half as u32)
    }

    /// The point of a sample. Where only some of the texel's probed points are its surface (`outside` says which), it lies
    /// around one of those: in the sixteenth of the texel that the probed point stands for, as far as it is seen from there.
    pub fn receiver(
        &self,
        surface: &BlockSurface,
        texel: usize,
        sample: Sample,
        outside: u16,
        counts: &mut RayCounts,
    ) -> Option<Receiver> {
        if outside == ALL_OUTSIDE {
            return self.any_point(surface, texel, sample);
        }
        // The k-th set bit; what is left of the number chooses the place around it.
        let u = point_pair(sample);
        let k = u.x * outside.count_ones() as f32;
        let probe = (0..PROBES).filter(|&i| outside >> i & 1 == 1).nth(k as usize)?;
        let probed = point_pair(self.sequence(surface, texel, Stream::Probe, 0).sample(probe));
        // (The 16 points of a (0, 2)-sequence lie one in each square of a 4 × 4 grid.)
        let square = (probed * 4.0).floor();
        let around = ((square + Vec2::new(k.fract(), u.y)) / 4.0).min(Vec2::splat(1.0 - f32::EPSILON));
        let known = self.transport.receiver(&surface.sample(self.atlas, texel, probed))?;
        let at = self.transport.receiver(&surface.sample(self.atlas, texel, around));
        Some(at.filter(|at| self.transport.sees(&known, at, counts)).unwrap_or(known))
    }

    /// The point of a sample, be it inside a solid.
    pub fn any_point(&self, surface: &BlockSurface, texel: usize, sample: Sample) -> Option<Receiver> {
        self.transport.receiver(&surface.sample(self.atlas, texel, point_pair(sample)))
    }

    /// Which probed points of a texel are its surface, one bit each: those outside solids, and where some are inside (a wall may
    /// stand on the texel), only the largest group of points that see each other. No texel mixes the light of two rooms.
    pub fn outside(&self, surface: &BlockSurface, texel: usize, counts: &mut RayCounts) -> u16 {
        let mut points = Vec::new();
        for probe in 0..PROBES {
            let at = self.transport.receiver(&self.probe_point(surface, texel, probe));
            points.extend(at.filter(|at| !self.transport.is_inside(at, counts)).map(|at| (probe, at)));
        }
        let mut largest = 0u16;
        let mut left: Vec<(u32, Receiver)> = points;
        if left.len() == PROBES as usize {
            return ALL_OUTSIDE;
        }
        while let Some((probe, first)) = left.pop() {
            // All that is seen from the first, or from what is seen.
            let (mut group, mut open) = (1u16 << probe, vec![first]);
            while let Some(from) = open.pop() {
                left.retain(|(probe, at)| {
                    let seen = self.transport.sees(&from, at, counts);
                    if seen {
                        group |= 1 << probe;
                        open.push(*at);
                    }
                    !seen
                });
            }
            if group.count_ones() > largest.count_ones() {
                largest = group;
            }
        }
        largest
    }

    /// Whether points of a texel that are not its surface lie outside solids all the same: on the other side of a wall.
    pub fn is_split(
        &self,
        surface: &BlockSurface,
        texel: usize,
        outside: u16,
        counts: &mut RayCounts,
    ) -> bool {
        (0..PROBES).filter(|&probe| outside >> probe & 1 == 0).any(|probe| {
            let at = self.transport.receiver(&self.probe_point(surface, texel, probe));
            at.is_some_and(|at| !self.transport.is_inside(&at, counts))
        })
    }

    /// A few of the probed points that are a texel's surface.
    pub fn witnesses(&self, surface: &BlockSurface, texel: usize, outside: u16) -> Vec<Receiver> {
        const MOST: usize = 4;
        let probes: Vec<u32> = (0..PROBES).filter(|&probe| outside >> probe & 1 == 1).collect();
        let some = probes.iter().step_by(probes.len().div_ceil(MOST).max(1));
        some.filter_map(|&probe| self.transport.receiver(&self.probe_point(surface, texel, probe))).collect()
    }

    fn probe_point(&self, surface: &BlockSurface, texel: usize, probe: u32) -> SurfacePoint {
        let sequence = self.sequence(surface, texel, Stream::Probe, 0);
        surface.sample(self.atlas, texel, point_pair(sequence.sample(probe)))
    }

    /// Finds out which points of the texels lie inside solids, if that is not known.
    pub fn probe(&self, surface: &BlockSurface, state: &mut BlockState) -> RayCounts {
        if !state.outside.is_empty() {
            return RayCounts::default();
        }
        let covered: Vec<usize> = surface.covered().collect();
        let probed: Vec<(u16, RayCounts)> = covered
            .par_iter()
            .with_min_len(64)
            .map(|&texel| {
                let mut counts = RayCounts::default();
                (self.outside(surface, texel, &mut counts), counts)
            })
            .collect();
        state.outside = probed.iter().map(|p| p.0).collect();
        sum(probed.into_iter().map(|p| p.1))
    }
}

/// The sum of counts.
pub fn sum(counts: impl IntoIterator<Item = RayCounts>) -> RayCounts {
    let mut all = RayCounts::default();
    counts.into_iter().for_each(|c| all += c);
    all
}
