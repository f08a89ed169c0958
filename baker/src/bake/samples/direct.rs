//! Direct light of suns and groups at the texels of a block: samples where they are worth their rays.
//!
//! How many they are is decided once, by a few *pilot* samples that count for nothing else. Were it decided
//! by the samples that count, the lucky ones would be kept; were each half to decide for the other, both
//! would miss the same thin shadow together and agree on a light without it.
//!
//! Where light groups are many, each texel's samples go to those that give it most, beside what each gives
//! all in all: the others have their numbers halved, once or more. By how much is a matter of places alone,
//! not of samples.

use super::block::{Stream, Worker};
use crate::bake::store::{BlockState, CELLS, Direct, cell_of};
use crate::receivers::ReceiverBlock;
use crate::trace::counts::{RayCounts, sum};
use crate::trace::paths::path::sun_sample;
use crate::trace::sources::FEW_GROUPS;
use dataset::host::signals::interrupted;
use rayon::prelude::*;

/// Pilot samples of each texel and light.
const PILOT_SAMPLES: u16 = 4;
/// Samples in each half that every texel and light gets where those of indirect light are eight or more; see
/// [`first_samples`].
const FIRST_DIRECT_SAMPLES: u16 = 4;
/// The `log2` of twice as many direct samples as there are of indirect light on average; one less is half as
/// many.
const LOG2_TWICE: u8 = 4;

/// How many direct samples a texel and light gets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct DirectBudget {
    /// log₂ of their number relative to the samples of indirect light, see [`DirectBudget::samples`].
    log2: u8,
    /// How often the numbers that go to every texel are halved for it.
    halvings: u8,
}

impl DirectBudget {
    /// As kept in a block's state.
    fn to_byte(self) -> u8 {
        self.halvings << 4 | self.log2
    }

    fn from_byte(byte: u8) -> Self {
        DirectBudget { log2: byte & 15, halvings: byte >> 4 }
    }

    /// The direct samples *in each half* that go with `samples` of indirect light *in both*: where pilot
    /// samples did not differ (`log2` 0) one for 32, for they may all have missed a thin shadow; elsewhere
    /// samples × 2^(log2 − [`LOG2_TWICE`]).
    fn samples(self, samples: u32, first: u16) -> u16 {
        /// What a counter holds.
        const MOST: u64 = 1 << 15;
        let samples = match self.log2 {
            0 => u64::from(samples / 32) >> self.halvings,
            _ => u64::from(samples) << self.log2 >> LOG2_TWICE,
        };
        (samples.min(MOST) as u16).max(halved(first, self.halvings))
    }
}

/// Samples in each half that every texel and light gets where `samples` of indirect light are sure to be
/// drawn: no more than of those, but two at least.
fn first_samples(samples: u32) -> u16 {
    (samples / 2).clamp(2, u32::from(FIRST_DIRECT_SAMPLES)) as u16
}

/// So many samples, halved, and one at least.
fn halved(samples: u16, halvings: u8) -> u16 {
    (samples >> halvings).max(1)
}

impl Worker<'_> {
    /// Draws the pilot samples and the first ones that count.
    pub fn first_direct(&self, receivers: &ReceiverBlock, state: &mut BlockState) -> RayCounts {
        let lights = self.transport.lights.sampled();
        state.pilot_samples = vec![Direct::default(); state.taken.len() * lights];
        let halvings = self.halvings_of(receivers, &state.points);
        let goals = |samples| halvings.iter().map(|&h| halved(samples, h)).collect::<Vec<u16>>();
        let goals_of_pilot = goals(PILOT_SAMPLES);
        let rays = self.draw_direct(
            receivers,
            &state.points,
            &mut state.pilot_samples,
            &goals_of_pilot,
            &[(Stream::Pilot, 0)],
        );
        let goals = goals(first_samples(self.guaranteed_samples));
        rays + self.draw_direct(receivers, &state.points, &mut state.direct, &goals, &COUNTED_STREAMS)
    }

    /// Draws the direct samples that go with `samples` of indirect light, in cells that are `active`. `means`
    /// holds the mean of each light over all pages.
    pub fn more_direct(
        &self,
        receivers: &ReceiverBlock,
        state: &mut BlockState,
        active: &[bool; CELLS],
        samples: u32,
        means: &[f32],
    ) -> RayCounts {
        if state.direct_budgets.is_empty() {
            let covered: Vec<usize> = receivers.covered().collect();
            let halvings = self.halvings_of(receivers, &state.points);
            let suns = self.transport.lights.suns.len();
            state.direct_budgets =
                direct_budgets(receivers, &covered, &state.pilot_samples, &halvings, means, suns);
            state.pilot_samples = Vec::new();
        }
        let first = first_samples(self.guaranteed_samples);
        let goals = receivers.covered().zip(state.direct_budgets.chunks(means.len().max(1))).flat_map(
            |(texel, direct_budgets)| {
                let samples = if active[cell_of(receivers, texel)] { samples } else { 0 };
                direct_budgets
                    .iter()
                    .map(move |&budget| DirectBudget::from_byte(budget).samples(samples, first))
            },
        );
        let goals: Vec<u16> = goals.collect();
        self.draw_direct(receivers, &state.points, &mut state.direct, &goals, &COUNTED_STREAMS)
    }

    /// How often the samples of each covered texel and light are halved (`[texel][light]`): as often as the
    /// chance with which the group would be sampled among all of them. Suns are never.
    fn halvings_of(&self, receivers: &ReceiverBlock, points: &[u16]) -> Vec<u8> {
        /// A group's light is looked at with one sample at least: more halvings change nothing but what goes
        /// with a thousand samples.
        const MOST: f32 = 4.0;
        /// Light groups, of many, that get all of their samples.
        const FULLY_SAMPLED: usize = 4;
        let lights = self.transport.lights;
        let (suns, groups) = (lights.suns.len(), lights.groups.len());
        if groups <= FEW_GROUPS {
            return vec![0; points.len() * lights.sampled()];
        }
        let covered: Vec<usize> = receivers.covered().collect();
        let of_texel = |(&texel, &points): (&usize, &u16)| {
            let at = self.one_point(receivers, texel, points);
            let chances = at.and_then(|at| self.transport.chances(&at, FULLY_SAMPLED));
            let of_groups = chances.unwrap_or_else(|| vec![1.0; groups]).into_iter();
            let halvings = of_groups.map(|chance| (-chance.log2()).floor().min(MOST) as u8);
            std::iter::repeat_n(0, suns).chain(halvings).collect::<Vec<u8>>()
        };
        covered.par_iter().zip(points).with_min_len(64).flat_map_iter(of_texel).collect()
    }

    /// Brings the direct light of each texel, stream and light (as `records` are ordered) to as many samples
    /// as `goals` says of its texel and light.
    fn draw_direct(
        &self,
        receivers: &ReceiverBlock,
        points: &[u16],
        records: &mut [Direct],
        goals: &[u16],
        streams: &[(Stream, usize)],
    ) -> RayCounts {
        let lights = self.transport.lights.sampled();
        if lights == 0 {
            return RayCounts::default();
        }
        let covered: Vec<usize> = receivers.covered().collect();
        let texels = records
            .par_chunks_mut(streams.len() * lights)
            .zip(goals.par_chunks(lights))
            .zip(points)
            .zip(&covered)
            .with_min_len(64);
        let counts = texels.map(|(((records, goals), &points), &texel)| {
            let mut counts = RayCounts::default();
            if points == 0 || interrupted() {
                return counts;
            }
            for (records, &(stream, half)) in records.chunks_mut(lights).zip(streams) {
                let sequence = self.sequence(receivers, texel, stream, half);
                let open = records.iter().zip(goals).filter(|(d, goal)| d.drawn < **goal);
                let first = open.map(|(d, _)| d.drawn).min();
                let last = goals.iter().copied().max().unwrap_or(0);
                for i in first.unwrap_or(last)..last {
                    let sample = sequence.sample(u32::from(i));
                    let at = self.receiver(receivers, texel, sample, points, &mut counts);
                    let sun_sample = sun_sample(sample);
                    for (light, (d, goal)) in records.iter_mut().zip(goals).enumerate() {
                        if d.drawn > i || i >= *goal {
                            continue;
                        }
                        match &at {
                            Some(at) => {
                                d.add(self.transport.direct(at, light, sample, &sun_sample, &mut counts))
                            }
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
const COUNTED_STREAMS: [(Stream, usize); 2] = [(Stream::Direct, 0), (Stream::Direct, 1)];

/// The [`DirectBudget`] of each covered texel and light (`[texel][light]`), as bytes: how many are worth
/// their rays, by its pilot samples and those of the texels beside.
fn direct_budgets(
    receivers: &ReceiverBlock,
    covered: &[usize],
    pilot_samples: &[Direct],
    halvings: &[u8],
    means: &[f32],
    suns: usize,
) -> Vec<u8> {
    /// The most for groups: four times as many again take twice the time in the scene `room`, for a third off
    /// the error at noon.
    const MOST: f32 = LOG2_TWICE as f32 + 2.0;
    /// Of suns there are many, and their noise is little beside that of indirect light: they get half of what
    /// groups would. (In the yard that costs 3 % of error and saves a fifth of the time; a quarter costs 12 %
    /// and saves a tenth more.)
    const LESS: u8 = 1;
    let lights = means.len();
    // Of many groups each has its own bright texels, and those of all together are many.
    let fewer = if lights - suns > FEW_GROUPS { LESS } else { 0 };
    // The index of each texel of the block among the covered ones. (Neighbours in other blocks are not asked:
    // along their borders some edges of shadows are found less surely.)
    let mut index = vec![None; receivers.width * receivers.height];
    covered.iter().enumerate().for_each(|(i, &texel)| index[texel] = Some(i));
    let mut direct_budgets = vec![0; pilot_samples.len()];
    for (i, &texel) in covered.iter().enumerate() {
        let (x, y) = (texel % receivers.width, texel / receivers.width);
        let beside = [
            (x > 0).then(|| texel - 1),
            (x + 1 < receivers.width).then(|| texel + 1),
            (y > 0).then(|| texel - receivers.width),
            (y + 1 < receivers.height).then(|| texel + receivers.width),
        ];
        let beside = beside.map(|t| t.and_then(|t| index[t]));
        for light in 0..lights {
            let own = &pilot_samples[i * lights + light];
            let beside = || beside.iter().flatten().map(|&n| &pilot_samples[n * lights + light]);
            let edges = beside().filter(|n| own.differs_from(n));
            let step = edges.map(|n| (n.mean() - own.mean()).element_sum().abs()).reduce(f32::max);
            let less = if light < suns { LESS } else { 0 };
            // Where nothing is known but that samples differ: as many as of indirect light for suns, half as
            // many for groups, whose rays cost more. Beside texels whose samples vary a quarter as many: a
            // thin shadow that crosses them may have been missed here.
            let most = if light < suns { LOG2_TWICE - LESS } else { LOG2_TWICE - 2 };
            let usual = match own.varies() || step.is_some() {
                true => most,
                false if beside().any(Direct::varies) => (most - 2).max(1),
                false => 0,
            };
            // In proportion to the deviation where it is large beside the light's mean over all pages.
            let deviation = own.deviation().max(0.5 * step.unwrap_or(0.0));
            let large = (deviation / means[light].max(f32::MIN_POSITIVE)).log2().round()
                + f32::from(LOG2_TWICE)
                - 1.0;
            let halvings = halvings[i * lights + light];
            let usual: u8 = usual.saturating_sub(halvings);
            let large = (large.clamp(0.0, MOST) as u8).saturating_sub(less + fewer);
            let log2 = usual.max(large);
            direct_budgets[i * lights + light] = DirectBudget { log2, halvings }.to_byte();
        }
    }
    direct_budgets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_the_budget() {
        let samples_of =
            |log2, samples| DirectBudget { log2, halvings: 0 }.samples(samples, FIRST_DIRECT_SAMPLES);
        assert_eq!(samples_of(0, 128), 4);
        assert_eq!(samples_of(0, 1024), 32);
        assert_eq!([1, 3, 4, 6].map(|budget| samples_of(budget, 128)), [16, 64, 128, 512]);
        assert_eq!(samples_of(6, 2), 8);
        assert_eq!(samples_of(6, u32::MAX), 1 << 15);
        assert_eq!(samples_of(0, 0), FIRST_DIRECT_SAMPLES);
    }

    #[test]
    fn few_samples_begin_with_few() {
        assert_eq!([2, 4, 8, 16, 1024].map(first_samples), [2, 2, 4, 4, 4]);
        assert_eq!(DirectBudget::default().samples(2, first_samples(2)), 2);
    }

    #[test]
    fn halvings_leave_one_sample_and_the_budget() {
        let of =
            |log2, halvings, samples| DirectBudget { log2, halvings }.samples(samples, FIRST_DIRECT_SAMPLES);
        assert_eq!([0, 1, 2, 4].map(|h| of(0, h, 64)), [4, 2, 1, 1]);
        assert_eq!([0, 1, 2, 4].map(|h| of(0, h, 1024)), [32, 16, 8, 2]);
        assert_eq!([0, 4].map(|h| of(3, h, 64)), [32, 32]);
        for budget in (0..=6).flat_map(|log2| (0..=4).map(move |halvings| DirectBudget { log2, halvings })) {
            assert_eq!(DirectBudget::from_byte(budget.to_byte()), budget);
        }
    }
}
