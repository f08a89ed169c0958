//! One block of texels at work: its samples of direct and of indirect light.

use super::errors::cell_of;
use super::state::{ALL_OUTSIDE, BlockState, CELLS, Direct, PROBES};
use crate::Rgb;
use crate::atlas::Atlas;
use crate::surface::{BlockSurface, FaceBins, SurfacePoint};
use crate::trace::cache::{CacheHalf, CacheMap};
use crate::trace::sampler::{Sample, Sequence};
use crate::trace::walk::{RayCounts, Receiver, Transport, point_pair, sun_draw};
use dataset::console::interrupted;
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
}

/// A filled cache: where its entries are, and its two halves.
pub struct Cache<'a> {
    /// Where entries are.
    pub map: CacheMap<'a>,
    /// One per half of the samples.
    pub halves: [CacheHalf; 2],
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

    /// Brings the direct light of each texel and light to `target` samples a half, or leaves it at its `first` samples where
    /// those of the *other* half hardly differ: from each other, and from those of the texels beside. This is decided once.
    /// (A half that decided on its own samples would stop at the lucky ones and be biased. So it would if it decided again:
    /// the other half's later samples exist because of its own first ones.)
    pub fn direct(
        &self,
        surface: &BlockSurface,
        state: &mut BlockState,
        first: u16,
        target: u16,
    ) -> RayCounts {
        let lights = self.transport.lights.sampled();
        if lights == 0 {
            return RayCounts::default();
        }
        let covered: Vec<usize> = surface.covered().collect();
        if target > first && state.more_direct.is_empty() {
            state.more_direct = wants_more(surface, &covered, state, lights);
        }
        let active = if target > first { state.more_direct.clone() } else { vec![1; state.direct.len()] };
        // The edge of a sun's shadow falls to a small error quickly, and its rays cost little: groups get half as many.
        let suns = self.transport.lights.suns.len();
        let goal = |light: usize| if light < suns { target } else { (target / 2).max(first).min(target) };
        let texels = state
            .direct
            .par_chunks_mut(2 * lights)
            .zip(active.par_chunks(2 * lights))
            .zip(&state.outside)
            .zip(&covered)
            .with_min_len(64);
        let counts = texels.map(|(((direct, active), &outside), &texel)| {
            let mut counts = RayCounts::default();
            if outside == 0 || interrupted() {
                return counts;
            }
            for (half, (direct, active)) in direct.chunks_mut(lights).zip(active.chunks(lights)).enumerate() {
                let sequence = self.sequence(surface, texel, Stream::Direct, half);
                let wants =
                    |light: usize, d: &Direct, i: u16| active[light] == 1 && d.drawn <= i && i < goal(light);
                let open = direct.iter().enumerate().filter(|(light, d)| wants(*light, d, d.drawn));
                let first = open.map(|(_, d)| d.drawn).min();
                for i in first.unwrap_or(target)..target {
                    let sample = sequence.sample(u32::from(i));
                    let at = self.receiver(surface, texel, sample, outside, &mut counts);
                    let draw = sun_draw(sample);
                    for (light, d) in direct.iter_mut().enumerate().filter(|(light, d)| wants(*light, d, i)) {
                        match &at {
                            Some(at) => d.add(self.transport.direct(at, light, sample, &draw, &mut counts)),
                            None => d.drawn += 1,
                        }
                    }
                }
            }
            counts
        });
        sum(counts.collect::<Vec<_>>())
    }

    /// Brings the indirect light of the texels of the `active` cells to `target` samples a half.
    pub fn indirect(
        &self,
        surface: &BlockSurface,
        state: &mut BlockState,
        active: &[bool; CELLS],
        target: u32,
        cache: Option<&Cache>,
    ) -> RayCounts {
        let layers = self.transport.lights.layers();
        let covered: Vec<usize> = surface.covered().collect();
        let drawn = state.drawn;
        let texels = state
            .sums
            .par_chunks_mut((2 * layers).max(1))
            .zip(&mut state.taken)
            .zip(&state.outside)
            .zip(&covered)
            .with_min_len(64);
        let counts = texels.map(|(((sums, taken), &outside), &texel)| {
            let mut counts = RayCounts::default();
            let cell = cell_of(surface, texel);
            if outside == 0 || !active[cell] || interrupted() {
                return counts;
            }
            for half in 0..2 {
                let sequence = self.sequence(surface, texel, Stream::Indirect, half);
                let out = &mut sums[half * layers..(half + 1) * layers];
                for i in drawn[cell]..target {
                    let sample = sequence.sample(i);
                    let at = self.receiver(surface, texel, sample, outside, &mut counts);
                    let Some(at) = at else { continue };
                    taken[half] += 1;
                    self.walk(&at, sample, cache.map(|c| (&c.map, &c.halves[half])), out, &mut counts);
                }
            }
            counts
        });
        let counts = sum(counts.collect::<Vec<_>>());
        for (drawn, active) in state.drawn.iter_mut().zip(active) {
            if *active {
                *drawn = (*drawn).max(target);
            }
        }
        counts
    }

    /// One walk, ended where the cache knows the light.
    pub fn walk(
        &self,
        at: &Receiver,
        sample: Sample,
        cache: Option<(&CacheMap, &CacheHalf)>,
        out: &mut [Rgb],
        counts: &mut RayCounts,
    ) {
        match cache {
            None => self.transport.indirect(at, sample, |_, _, _, _| false, out, counts),
            Some((map, half)) => {
                let land = |hit: &_, is_back, weight, out: &mut [Rgb]| match map.of_hit(hit, is_back) {
                    Some(entry) => {
                        half.add(entry, weight, out);
                        true
                    }
                    None => false,
                };
                self.transport.indirect(at, sample, land, out, counts);
            }
        }
    }
}

/// Per texel, half and light, 1 where the other half asks for more samples: see [`Worker::direct`].
fn wants_more(surface: &BlockSurface, covered: &[usize], state: &BlockState, lights: usize) -> Vec<u8> {
    // The place of each texel of the block among the covered ones.
    let mut place = vec![None; surface.width * surface.height];
    covered.iter().enumerate().for_each(|(i, &texel)| place[texel] = Some(i));
    let record = |i: usize, half: usize, light: usize| &state.direct[(i * 2 + half) * lights + light];
    let mut active = vec![0; state.direct.len()];
    for (i, &texel) in covered.iter().enumerate() {
        let (x, y) = (texel % surface.width, texel / surface.width);
        let beside = [
            (x > 0).then(|| texel - 1),
            (x + 1 < surface.width).then(|| texel + 1),
            (y > 0).then(|| texel - surface.width),
            (y + 1 < surface.height).then(|| texel + surface.width),
        ];
        let beside = beside.map(|t| t.and_then(|t| place[t]));
        for half in 0..2 {
            for light in 0..lights {
                let other = record(i, 1 - half, light);
                let edge =
                    || beside.iter().flatten().any(|&n| other.differs_from(record(n, 1 - half, light)));
                active[(i * 2 + half) * lights + light] = u8::from(other.varies() || edge());
            }
        }
    }
    active
}

/// The sum of counts.
pub fn sum(counts: impl IntoIterator<Item = RayCounts>) -> RayCounts {
    let mut all = RayCounts::default();
    counts.into_iter().for_each(|c| all += c);
    all
}
