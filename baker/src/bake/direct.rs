//! Direct light of suns and groups at the texels of a block: samples where they are worth their rays.
//!
//! How many they are is decided once, by a few *trial* samples that count for nothing else. Were it decided by the samples that
//! count, the lucky ones would be kept; were each half to decide for the other, both would miss the same thin shadow together
//! and agree on a light without it.

use super::block::{Stream, Worker, sum};
use super::errors::cell_of;
use super::state::{BlockState, CELLS, Direct};
use crate::surface::BlockSurface;
use crate::trace::counts::RayCounts;
use crate::trace::walk::sun_draw;
use dataset::console::interrupted;
use rayon::prelude::*;

/// Trial samples of each texel and light.
const TRIALS: u16 = 4;
/// Samples in each half that every texel and light gets.
const FIRST: u16 = 4;
/// The `want` of twice as many direct samples as there are of indirect light on average; one less is half as many.
const TWICE: u8 = 4;

/// The direct samples *in each half* that go with `samples` of indirect light *in both*: where trial samples did not differ
/// (`want` 0) one for 32, for they may all have missed a thin shadow; elsewhere samples × 2^(want − [`TWICE`]).
fn wanted(want: u8, samples: u32) -> u16 {
    /// What a counter holds.
    const MOST: u64 = 1 << 15;
    let samples = match want {
        0 => u64::from(samples / 32),
        _ => u64::from(samples) << want >> TWICE,
    };
    (samples.min(MOST) as u16).max(FIRST)
}

impl Worker<'_> {
    /// Draws the trial samples and the first ones that count.
    pub fn first_direct(&self, surface: &BlockSurface, state: &mut BlockState) -> RayCounts {
        let lights = self.transport.lights.sampled();
        state.trials = vec![Direct::default(); state.taken.len() * lights];
        let goals = vec![TRIALS; state.trials.len()];
        let trial =
            self.draw_direct(surface, &state.probes, &mut state.trials, &goals, &[(Stream::Trial, 0)]);
        let goals = vec![FIRST; state.trials.len()];
        trial + self.draw_direct(surface, &state.probes, &mut state.direct, &goals, &HALVES)
    }

    /// Draws the direct samples that go with `samples` of indirect light, in cells that are `active`. `means` holds the mean of
    /// each light over all pages.
    pub fn more_direct(
        &self,
        surface: &BlockSurface,
        state: &mut BlockState,
        active: &[bool; CELLS],
        samples: u32,
        means: &[f32],
    ) -> RayCounts {
        if state.wants.is_empty() {
            let covered: Vec<usize> = surface.covered().collect();
            state.wants = wants(surface, &covered, &state.trials, means, self.transport.lights.suns.len());
            state.trials = Vec::new();
        }
        let goals =
            surface.covered().zip(state.wants.chunks(means.len().max(1))).flat_map(|(texel, wants)| {
                let samples = if active[cell_of(surface, texel)] { samples } else { 0 };
                wants.iter().map(move |&want| wanted(want, samples))
            });
        let goals: Vec<u16> = goals.collect();
        self.draw_direct(surface, &state.probes, &mut state.direct, &goals, &HALVES)
    }

    /// Brings the direct light of each texel, stream and light (as `records` are ordered) to as many samples as `goals` says of
    /// its texel and light.
    fn draw_direct(
        &self,
        surface: &BlockSurface,
        probes: &[u16],
        records: &mut [Direct],
        goals: &[u16],
        streams: &[(Stream, usize)],
    ) -> RayCounts {
        let lights = self.transport.lights.sampled();
        if lights == 0 {
            return RayCounts::default();
        }
        let covered: Vec<usize> = surface.covered().collect();
        let texels = records
            .par_chunks_mut(streams.len() * lights)
            .zip(goals.par_chunks(lights))
            .zip(probes)
            .zip(&covered)
            .with_min_len(64);
        let counts = texels.map(|(((records, goals), &probes), &texel)| {
            let mut counts = RayCounts::default();
            if probes == 0 || interrupted() {
                return counts;
            }
            for (records, &(stream, half)) in records.chunks_mut(lights).zip(streams) {
                let sequence = self.sequence(surface, texel, stream, half);
                let open = records.iter().zip(goals).filter(|(d, goal)| d.drawn < **goal);
                let first = open.map(|(d, _)| d.drawn).min();
                let last = goals.iter().copied().max().unwrap_or(0);
                for i in first.unwrap_or(last)..last {
                    let sample = sequence.sample(u32::from(i));
                    let at = self.receiver(surface, texel, sample, probes, &mut counts);
                    let draw = sun_draw(sample);
                    for (light, (d, goal)) in records.iter_mut().zip(goals).enumerate() {
                        if d.drawn > i || i >= *goal {
                            continue;
                        }
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
}

/// The streams of the samples that count.
const HALVES: [(Stream, usize); 2] = [(Stream::Direct, 0), (Stream::Direct, 1)];

/// The `want` of each covered texel and light (`[texel][light]`; [`wanted`] makes it a number of samples): how many are worth their
/// rays, by its trial samples and those of the texels beside.
fn wants(
    surface: &BlockSurface,
    covered: &[usize],
    trials: &[Direct],
    means: &[f32],
    suns: usize,
) -> Vec<u8> {
    /// The most for groups: four times as many again take twice the time in the scene `room`, for a third off the error at noon.
    const MOST: f32 = TWICE as f32 + 2.0;
    /// Of suns there are many, and their noise is little beside that of indirect light: they get half of what groups would. (In the
    /// yard that costs 3 % of error and saves a fifth of the time; a quarter costs 12 % and saves a tenth more.)
    const LESS: u8 = 1;
    let lights = means.len();
    // The place of each texel of the block among the covered ones. (Neighbours in other blocks are not asked: along their borders
    // some edges of shadows are found less surely.)
    let mut place = vec![None; surface.width * surface.height];
    covered.iter().enumerate().for_each(|(i, &texel)| place[texel] = Some(i));
    let mut wants = vec![0; trials.len()];
    for (i, &texel) in covered.iter().enumerate() {
        let (x, y) = (texel % surface.width, texel / surface.width);
        let beside = [
            (x > 0).then(|| texel - 1),
            (x + 1 < surface.width).then(|| texel + 1),
            (y > 0).then(|| texel - surface.width),
            (y + 1 < surface.height).then(|| texel + surface.width),
        ];
        let beside = beside.map(|t| t.and_then(|t| place[t]));
        for light in 0..lights {
            let own = &trials[i * lights + light];
            let beside = || beside.iter().flatten().map(|&n| &trials[n * lights + light]);
            let edges = beside().filter(|n| own.differs_from(n));
            let step = edges.map(|n| (n.mean() - own.mean()).element_sum().abs()).reduce(f32::max);
            let less = if light < suns { LESS } else { 0 };
            // Where nothing is known but that samples differ: as many as of indirect light for suns, half as many for groups, whose rays
            // cost more. Beside texels whose samples vary a quarter as many: a thin shadow that crosses them may have been missed here.
            let most = if light < suns { TWICE - LESS } else { TWICE - 2 };
            let usual = match own.varies() || step.is_some() {
                true => most,
                false if beside().any(Direct::varies) => (most - 2).max(1),
                false => 0,
            };
            // In proportion to the deviation where it is large beside the light's mean over all pages.
            let deviation = own.deviation().max(0.5 * step.unwrap_or(0.0));
            let large =
                (deviation / means[light].max(f32::MIN_POSITIVE)).log2().round() + f32::from(TWICE) - 1.0;
            wants[i * lights + light] = usual.max((large.clamp(0.0, MOST) as u8).saturating_sub(less));
        }
    }
    wants
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_the_want() {
        assert_eq!(wanted(0, 128), 4);
        assert_eq!(wanted(0, 1024), 32);
        assert_eq!([1, 3, 4, 6].map(|want| wanted(want, 128)), [16, 64, 128, 512]);
        assert_eq!(wanted(6, 2), 8);
        assert_eq!(wanted(6, u32::MAX), 1 << 15);
        assert_eq!(wanted(0, 0), FIRST);
    }
}
