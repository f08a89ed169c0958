//! Direct light of suns and groups at the texels of a block: samples where they are worth their rays.

use super::block::{Stream, Worker, sum};
use super::errors::cell_of;
use super::state::{BlockState, CELLS};
use crate::surface::BlockSurface;
use crate::trace::walk::{RayCounts, sun_draw};
use dataset::console::interrupted;
use rayon::prelude::*;

/// The direct samples *in each half* that go with `samples` of indirect light *in both*: of a texel and light whose first ones did
/// not differ (`want` 0) one for 32, for they may all have missed a thin shadow; of others samples × 2^(want − [`SAME`]).
fn wanted(want: u8, first: u16, samples: u32) -> u16 {
    /// What a counter holds.
    const MOST: u64 = 1 << 15;
    let samples = match want {
        0 => u64::from(samples / 32),
        _ => u64::from(samples) << want >> SAME,
    };
    (samples.min(MOST) as u16).max(first)
}

/// The `want` of as many direct samples in each half as there are of indirect light in both.
const SAME: u8 = 4;

impl Worker<'_> {
    /// Draws the `first` samples of the direct light of each texel, light and half.
    pub fn first_direct(&self, surface: &BlockSurface, state: &mut BlockState, first: u16) -> RayCounts {
        let goals = vec![first; state.direct.len()];
        self.draw_direct(surface, state, &goals)
    }

    /// Draws the direct samples that go with `samples` of indirect light: few where the `first` of the *other* half hardly
    /// differ, from each other and from those of the texels beside. This is decided once. (A half that decided on
    /// its own samples would stop at the lucky ones and be biased. So it would if it decided again: the other half's later
    /// samples exist because of its own first ones.) `means` holds the mean of each half's
    /// samples of each light over all pages; the other half's counts, again.
    pub fn more_direct(
        &self,
        surface: &BlockSurface,
        state: &mut BlockState,
        active: &[bool; CELLS],
        first: u16,
        samples: u32,
        means: &[f32],
    ) -> RayCounts {
        if state.more_direct.is_empty() {
            let covered: Vec<usize> = surface.covered().collect();
            state.more_direct = wants_more(surface, &covered, state, means, self.transport.lights.suns.len());
        }
        let per_texel = means.len().max(1);
        let goals = surface.covered().zip(state.more_direct.chunks(per_texel)).flat_map(|(texel, wants)| {
            let samples = if active[cell_of(surface, texel)] { samples } else { 0 };
            wants.iter().map(move |&want| wanted(want, first, samples))
        });
        let goals: Vec<u16> = goals.collect();
        self.draw_direct(surface, state, &goals)
    }

    /// Brings the direct light of each texel, half and light to as many samples as `goals` says.
    fn draw_direct(&self, surface: &BlockSurface, state: &mut BlockState, goals: &[u16]) -> RayCounts {
        let lights = self.transport.lights.sampled();
        if lights == 0 {
            return RayCounts::default();
        }
        let covered: Vec<usize> = surface.covered().collect();
        let texels = state
            .direct
            .par_chunks_mut(2 * lights)
            .zip(goals.par_chunks(2 * lights))
            .zip(&state.outside)
            .zip(&covered)
            .with_min_len(64);
        let counts = texels.map(|(((direct, goals), &outside), &texel)| {
            let mut counts = RayCounts::default();
            if outside == 0 || interrupted() {
                return counts;
            }
            for (half, (direct, goals)) in direct.chunks_mut(lights).zip(goals.chunks(lights)).enumerate() {
                let sequence = self.sequence(surface, texel, Stream::Direct, half);
                let open = direct.iter().zip(goals).filter(|(d, goal)| d.drawn < **goal);
                let first = open.map(|(d, _)| d.drawn).min();
                let last = goals.iter().copied().max().unwrap_or(0);
                for i in first.unwrap_or(last)..last {
                    let sample = sequence.sample(u32::from(i));
                    let at = self.receiver(surface, texel, sample, outside, &mut counts);
                    let draw = sun_draw(sample);
                    for (light, (d, goal)) in direct.iter_mut().zip(goals).enumerate() {
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

/// Per texel, half and light, how many samples the other half asks for: see [`Worker::more_direct`] and [`wanted`].
fn wants_more(
    surface: &BlockSurface,
    covered: &[usize],
    state: &BlockState,
    means: &[f32],
    suns: usize,
) -> Vec<u8> {
    /// The most. (Four times more again would take a third off what is left in `room` at noon, for twice the time.)
    const MOST: f32 = SAME as f32 + 2.0;
    let lights = means.len() / 2;
    // (Neighbours in other blocks are not asked: along their borders some edges of shadows are found less surely.)
    // The place of each texel of the block among the covered ones.
    let mut place = vec![None; surface.width * surface.height];
    covered.iter().enumerate().for_each(|(i, &texel)| place[texel] = Some(i));
    let record = |i: usize, half: usize, light: usize| &state.direct[(i * 2 + half) * lights + light];
    let mut wants = vec![0; state.direct.len()];
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
                let beside = beside.iter().flatten().map(|&n| record(n, 1 - half, light));
                let edges = beside.filter(|n| other.differs_from(n));
                let step = edges.map(|n| (n.mean() - other.mean()).element_sum().abs()).reduce(f32::max);
                // Where samples vary, as many as of indirect light; of groups a quarter, whose rays cost more.
                let usual = if light < suns { SAME } else { SAME - 2 };
                let usual = if other.varies() || step.is_some() { usual } else { 0 };
                // In proportion to the deviation where it is large beside the light's mean over all pages.
                let deviation = other.deviation().max(0.5 * step.unwrap_or(0.0));
                let large =
                    (deviation / means[(1 - half) * lights + light].max(f32::MIN_POSITIVE)).log2().round()
                        + f32::from(SAME)
                        - 1.0;
                wants[(i * 2 + half) * lights + light] = usual.max(large.clamp(0.0, MOST) as u8);
            }
        }
    }
    wants
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_the_want() {
        assert_eq!(wanted(0, 4, 128), 4);
        assert_eq!(wanted(0, 4, 1024), 32);
        assert_eq!([1, 3, 4, 6].map(|want| wanted(want, 4, 128)), [16, 64, 128, 512]);
        assert_eq!(wanted(6, 4, 2), 8);
        assert_eq!(wanted(6, 4, u32::MAX), 1 << 15);
        assert_eq!(wanted(0, 4, 0), 4);
    }
}
