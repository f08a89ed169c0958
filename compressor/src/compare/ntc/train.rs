//! Training of one segment: Adam, noise for the rounding to come, and a last part around the rounded grids.

use super::super::tiles::{Texels, TileSet};
use super::grids::{Layout, Quantiser};
use super::network::{INPUTS, OUTPUTS, Trace, Transposed, Weights, backward};
use super::{CURVE, Preset};
use crate::Result;
use crate::lanes::{Longest, Tier};
use crate::train::step::kernel::{Adam, Kernel, run};
use crate::train::step::optimise::schedule;
use crate::train::step::{CHUNK, Rows};
use crate::train::targets::Random;
use dataset::host::signals::stop_if_interrupted;
use half::f16;
use std::ops::Range;

/// Blocks of samples of a step: 4096 samples.
const BLOCKS: usize = 128;
const RATES: [f32; 2] = [0.01, 0.005];
/// Share of the steps after which the grids are rounded and held.
const FROZEN: f64 = 0.95;
/// Adam's.
const BETA: [f32; 2] = [0.9, 0.999];

pub(super) struct Trained {
    grids: Vec<f32>,
    weights: Box<Weights>,
}

/// A texel of a tile, and its code values at the frames of the segment.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    tile: u32,
    texel: u32,
    target: [f32; OUTPUTS],
}

/// The samples of a segment: every valid texel.
fn samples(set: &TileSet, frames: &Range<usize>) -> Vec<Sample> {
    let mut samples = Vec::new();
    for (t, tile) in set.tiles.iter().enumerate() {
        for texel in tile.valid() {
            let mut target = [0.0; OUTPUTS];
            for (i, k) in frames.clone().enumerate().filter(|&(_, k)| tile.peaks[k] > 0.0) {
                for c in 0..3 {
                    let relative = f64::from(tile.source.frames[k][texel][c] / tile.peaks[k]);
                    target[3 * i + c] = CURVE.encode(relative) as f32;
                }
            }
            samples.push(Sample { tile: t as u32, texel: texel as u32, target });
        }
    }
    samples
}

/// Loss and gradients of a batch.
struct Batch<'a> {
    layout: &'a Layout,
    grids: &'a [f32],
    weights: &'a Weights,
    samples: &'a [Sample],
    /// Outputs that count.
    outputs: usize,
    /// Gradient of the grids, where they are trained.
    of_grids: Option<&'a mut [f32]>,
    of_weights: &'a mut Weights,
}

impl Kernel for Batch<'_> {
    /// Mean over samples of the squared error, summed over outputs.
    type Output = f64;

    #[inline(always)]
    fn run<V: Longest>(mut self) -> f64 {
        let transposed = Transposed::new(self.weights);
        let (mut x, mut dx, mut trace) = (Rows::<INPUTS>::new(), Rows::<INPUTS>::new(), Trace::new());
        let mut loss = 0.0;
        let scale = 2.0 / self.samples.len() as f32;
        for block in self.samples.chunks(CHUNK) {
            for (row, sample) in x.iter_mut().zip(block) {
                self.layout.read(self.grids, sample.tile as usize, sample.texel as usize, row);
            }
            let y = self.weights.forward::<V>(&x, &mut trace);
            let mut dy = Rows::<OUTPUTS>::new();
            for ((dy, y), sample) in dy.iter_mut().zip(y.iter()).zip(block) {
                for c in 0..self.outputs {
                    let error = y[c] - sample.target[c];
                    loss += f64::from(error * error);
                    dy[c] = scale * error;
                }
            }
            let trained = self.of_grids.is_some();
            backward::<V>(&transposed, &x, &trace, &dy, self.of_weights, trained.then_some(&mut dx));
            if let Some(of_grids) = &mut self.of_grids {
                for (dx, sample) in dx.iter().zip(block) {
                    self.layout.add(of_grids, sample.tile as usize, sample.texel as usize, dx);
                }
            }
        }
        loss / self.samples.len() as f64
    }
}

/// Parameters with the moments of Adam.
struct Moved {
    mean: Vec<f32>,
    square: Vec<f32>,
    bounds: [f32; 2],
}

impl Moved {
    fn new(len: usize, bounds: [f32; 2]) -> Self {
        Moved { mean: vec![0.0; len], square: vec![0.0; len], bounds }
    }

    fn step(&mut self, tier: Tier, params: &mut [f32], gradient: &mut [f32], rate: f32, step: usize) {
        let corrections = BETA.map(|b| 1.0 - f64::from(b).powi(step as i32 + 1));
        let corrected = [(f64::from(rate) / corrections[0]) as f32, (1.0 / corrections[1]) as f32];
        let (mean, square) = (&mut self.mean, &mut self.square);
        run(tier, Adam { params, gradient, mean, square, beta: BETA, corrected, bounds: self.bounds });
    }
}

/// Trains the grids of all tiles and their network to some frames.
pub(super) fn train(
    set: &TileSet,
    layout: &Layout,
    preset: &Preset,
    frames: Range<usize>,
    steps: usize,
    seed: u64,
) -> Result<Trained> {
    let tier = Tier::detect();
    let mut random = Random::new(seed);
    let mut samples = samples(set, &frames);
    let quantisers = preset.bits.map(Quantiser::new);
    let ranges = [0..layout.high, layout.high..layout.len];
    let mut grids = vec![0.0; layout.len];
    for (range, quantiser) in ranges.iter().zip(quantisers) {
        let [low, high] = quantiser.bounds();
        grids[range.clone()].iter_mut().for_each(|v| *v = random.uniform(low, high));
    }
    let mut weights = Weights::initial(preset.inputs(), &mut random);
    let mut moved = [0, 1].map(|i| Moved::new(ranges[i].len(), quantisers[i].bounds()));
    let mut moved_weights = Moved::new(weights.flat().len(), [f32::NEG_INFINITY, f32::INFINITY]);
    // A step leaves it zero.
    let mut gradient = vec![0.0; layout.len];
    let mut noisy = grids.clone();
    let frozen = (FROZEN * steps as f64) as usize;
    let batch = (BLOCKS * CHUNK).min(samples.len()).max(1);
    let mut next = samples.len();
    for step in 0..steps {
        stop_if_interrupted()?;
        if samples.is_empty() {
            break;
        }
        if next + batch > samples.len() {
            random.shuffle(&mut samples);
            next = 0;
        }
        for (range, quantiser) in ranges.iter().zip(quantisers) {
            if step < frozen {
                let values = noisy[range.clone()].iter_mut().zip(&grids[range.clone()]);
                values.for_each(|(noisy, value)| *noisy = quantiser.noisy(*value, &mut random));
            } else if step == frozen {
                grids[range.clone()].iter_mut().for_each(|v| *v = quantiser.round(*v));
                noisy[range.clone()].copy_from_slice(&grids[range.clone()]);
            }
        }
        let mut of_weights = Weights::zeros();
        run(
            tier,
            Batch {
                layout,
                grids: &noisy,
                weights: &weights,
                samples: &samples[next..next + batch],
                outputs: 3 * frames.len(),
                of_grids: (step < frozen).then_some(&mut gradient),
                of_weights: &mut of_weights,
            },
        );
        next += batch;
        let rate = schedule(step, steps, 1, 0.0);
        if step < frozen {
            for (range, moved) in ranges.iter().zip(&mut moved) {
                moved.step(
                    tier,
                    &mut grids[range.clone()],
                    &mut gradient[range.clone()],
                    RATES[0] * rate,
                    step,
                );
            }
        }
        moved_weights.step(tier, weights.flat_mut(), of_weights.flat_mut(), RATES[1] * rate, step);
    }
    // As they are stored; a training of a step or none has not come to this.
    for (range, quantiser) in ranges.into_iter().zip(quantisers) {
        grids[range].iter_mut().for_each(|v| *v = quantiser.round(*v));
    }
    weights.flat_mut().iter_mut().for_each(|w| *w = f16::from_f32(*w).to_f32());
    Ok(Trained { grids, weights })
}

/// The outputs of texels of a tile.
struct Decode<'a> {
    layout: &'a Layout,
    trained: &'a Trained,
    tile: usize,
    texels: usize,
}

impl Kernel for Decode<'_> {
    type Output = Vec<[f32; OUTPUTS]>;

    #[inline(always)]
    fn run<V: Longest>(self) -> Vec<[f32; OUTPUTS]> {
        let mut out = Vec::with_capacity(self.texels + CHUNK);
        let (mut x, mut trace) = (Rows::<INPUTS>::new(), Trace::new());
        for first in (0..self.texels).step_by(CHUNK) {
            for (s, row) in x.iter_mut().enumerate() {
                let texel = (first + s).min(self.texels - 1);
                self.layout.read(&self.trained.grids, self.tile, texel, row);
            }
            out.extend(self.trained.weights.forward::<V>(&x, &mut trace).iter());
        }
        out.truncate(self.texels);
        out
    }
}

/// Per tile, the light of a segment's frames.
pub(super) fn decode(
    set: &TileSet,
    layout: &Layout,
    trained: &Trained,
    frames: Range<usize>,
) -> Vec<Vec<Texels>> {
    let tile = |t: usize| -> Vec<Texels> {
        let tile = &set.tiles[t];
        let outputs = run(Tier::detect(), Decode { layout, trained, tile: t, texels: tile.texels() });
        let light = |i: usize, k: usize| {
            let value =
                |c: usize, y: &[f32; OUTPUTS]| tile.peaks[k] * CURVE.decode(f64::from(y[3 * i + c])) as f32;
            outputs.iter().map(|y| [0, 1, 2].map(|c| value(c, y))).collect()
        };
        frames.clone().enumerate().map(|(i, k)| light(i, k)).collect()
    };
    (0..set.tiles.len()).map(tile).collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::testing::{set_of, tile};
    use super::super::PRESETS;
    use super::*;

    #[test]
    fn gradients_are_those_of_finite_differences() {
        for preset in &PRESETS {
            let set = set_of(vec![tile(12, 8, 3, 1), tile(8, 8, 3, 2)], &[0.0, 8.0, 16.0]);
            let layout = Layout::new(&set, preset);
            let samples = samples(&set, &(0..3));
            let mut random = Random::new(7);
            let grids: Vec<f32> = (0..layout.len).map(|_| random.uniform(-0.4, 0.5)).collect();
            let weights = Weights::initial(preset.inputs(), &mut random);
            for tier in Tier::available() {
                let differentiate = |grids: &[f32], weights: &Weights| {
                    let (mut of_grids, mut of_weights) = (vec![0.0; grids.len()], Weights::zeros());
                    let loss = run(
                        tier,
                        Batch {
                            layout: &layout,
                            grids,
                            weights,
                            samples: &samples,
                            outputs: 9,
                            of_grids: Some(&mut of_grids),
                            of_weights: &mut of_weights,
                        },
                    );
                    (loss, of_grids, of_weights)
                };
                let (_, of_grids, of_weights) = differentiate(&grids, &weights);
                let agrees = |found: f32, above: f64, below: f64, h: f64, what: &str| {
                    let expected = (above - below) / (2.0 * h);
                    let size = expected.abs().max(0.02);
                    assert!((f64::from(found) - expected).abs() < 0.03 * size, "{what}: {found} {expected}");
                };
                let h = 0.02f32;
                // Along random directions everything counts; the grids on their own too.
                let direction: Vec<f32> = grids.iter().map(|_| random.uniform(-1.0, 1.0)).collect();
                let along = |sign: f32| {
                    let moved: Vec<f32> =
                        grids.iter().zip(&direction).map(|(g, d)| g + sign * h * d).collect();
                    differentiate(&moved, &weights).0
                };
                let slope = of_grids.iter().zip(&direction).map(|(g, d)| g * d).sum();
                agrees(slope, along(1.0), along(-1.0), f64::from(h), "grids");
                let count = weights.flat().len();
                for part in 0..12 {
                    let range = part * count / 12..(part + 1) * count / 12;
                    let direction: Vec<f32> = range.clone().map(|_| random.uniform(-1.0, 1.0)).collect();
                    let h = 1e-3f32;
                    let along = |sign: f32| {
                        let mut moved = weights.clone();
                        let flat = &mut moved.flat_mut()[range.clone()];
                        flat.iter_mut().zip(&direction).for_each(|(w, d)| *w += sign * h * d);
                        differentiate(&grids, &moved).0
                    };
                    let slope =
                        of_weights.flat()[range.clone()].iter().zip(&direction).map(|(g, d)| g * d).sum();
                    agrees(slope, along(1.0), along(-1.0), f64::from(h), &format!("weights, part {part}"));
                }
                // One cell that two texels share.
                for i in [0, layout.high - 1, layout.high, layout.len - 1] {
                    let along = |sign: f32| {
                        let mut moved = grids.clone();
                        moved[i] += sign * h;
                        differentiate(&moved, &weights).0
                    };
                    agrees(of_grids[i], along(1.0), along(-1.0), f64::from(h), &format!("cell {i}"));
                }
            }
        }
    }
}
