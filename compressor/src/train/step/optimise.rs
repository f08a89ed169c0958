//! The training loop of one tile: epochs, steps of Adam, the loss weights, and the error so far.

use super::bases::Bases;
use super::gather::{FeatureGradient, Features, Samples, Uv};
use super::kernel::{
    Adam, BackpropagateBlocks, Batch, InterpolateBlocks, Noise, Scope, SquaredErrors, WEIGHT_CAP, run,
};
use super::network::{CHUNK, Network, NetworkGradient};
use crate::Result;
use crate::lanes::{Quad, Tier};
use crate::train::targets::{GUTTER_SHARE, Layout, Problem, Random, Texel};
use crate::train::{Aim, Coded};
use dataset::host::signals::stop_if_interrupted;
use dataset::pictures::metrics::psnr_db;
use std::ops::Range;

/// Samples per step, at most: the paper's 2¹².
const BATCH: usize = 4096;
/// β of Adam.
const BETA1: f32 = 0.9;

/// What a step moves, how far, and whether features carry noise.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    /// Parameters that move.
    pub scope: Scope,
    /// Learning rate of the features.
    pub rate: f32,
    /// Learning rate of the decoder network.
    pub network_rate: f32,
    /// Noise of 8-bit quantisation on sampled features.
    pub noise: bool,
    /// Adam's β₂.
    pub beta2: f32,
}

/// Learning rate at a step: a linear warm-up, then a cosine from 1 to `end`.
pub(crate) fn schedule(step: usize, steps: usize, warm_up: usize, end: f32) -> f32 {
    let progress = step as f32 / steps.max(1) as f32;
    let warm = ((step + 1) as f32 / warm_up.max(1) as f32).min(1.0);
    warm * (end + (1.0 - end) * 0.5 * (1.0 + (std::f32::consts::PI * progress).cos()))
}

/// Centred texels of the maps of blocks that the tile has.
#[derive(Clone, Debug)]
pub(crate) struct Maps {
    /// F_uv, block by block, x + 4 y within a block.
    pub uv: Vec<Quad>,
    /// F_uvt, slice by slice, row by row.
    pub uvt: Vec<Quad>,
}

/// The state of one tile's training.
#[derive(Debug)]
pub(crate) struct Trainer<const H: usize> {
    tier: Tier,
    /// The samples.
    pub problem: Problem,
    /// Order of the parameters.
    pub layout: Layout,
    pub params: Vec<f32>,
    /// F_uv and F_uvt as texels: made of the parameters, until they are frozen (of F_uv not by every step:
    /// [`Trainer::freeze`]).
    pub maps: Maps,
    /// Their decoder network.
    pub network: Network<H>,
    frozen: bool,
    /// With respect to the texels of F_uvt.
    of_uvt: Vec<Quad>,
    of_network: NetworkGradient<H>,
    flat: Vec<f32>,
    /// Adam's moments; of the network's matrices in their bases.
    mean: Vec<f32>,
    square: Vec<f32>,
    bases: Option<Bases>,
    steps: i32,
    epochs: Epochs,
    noise: Noise,
    random: Random,
}

impl<const H: usize> Trainer<H> {
    pub(crate) fn tier(&self) -> Tier {
        self.tier
    }

    /// Before the first step. `bases`: Adam sees the network's matrices in the eigenbases of their gradients,
    /// else as they are.
    pub(crate) fn new(problem: Problem, seed: u64, bases: bool, tier: Tier) -> Self {
        let mut random = Random::new(seed);
        let layout = Layout::new(&problem.shape, problem.coded == Coded::TexelByTexel);
        let params = layout.initial(&problem.shape, &mut random);
        let [uv, uvt, ..] = problem.shape.counts();
        let map = |blocks: usize| vec![[0.0; 4]; 16 * blocks];
        let mut trainer = Trainer {
            tier,
            network: Network::new(&params[layout.network.clone()], &problem),
            of_uvt: map(uvt),
            of_network: NetworkGradient::new(problem.points.len()),
            flat: vec![0.0; params.len()],
            mean: vec![0.0; params.len()],
            square: vec![0.0; params.len()],
            bases: bases.then(|| Bases::new(&problem.shape)),
            steps: 0,
            epochs: Epochs::default(),
            noise: Noise::new(&problem.shape, &mut random),
            frozen: false,
            problem,
            layout,
            params,
            maps: Maps { uv: map(uv), uvt: map(uvt) },
            random,
        };
        trainer.refresh();
        trainer
    }

    /// Makes maps, where samples read them, and the network follow the parameters.
    pub(crate) fn refresh(&mut self) {
        if !self.frozen {
            if self.problem.coded == Coded::TexelByTexel {
                self.interpolate_uv();
            }
            let [endpoints, weights] = [&self.layout.uvt_endpoints, &self.layout.uvt_weights]
                .map(|range| &self.params[range.clone()]);
            let across = self.problem.shape.uvt[0];
            run(self.tier, InterpolateBlocks { endpoints, weights, across, map: &mut self.maps.uvt });
        }
        self.network = Network::new(&self.params[self.layout.network.clone()], &self.problem);
    }

    fn interpolate_uv(&mut self) {
        let [endpoints, weights] =
            [&self.layout.uv_endpoints, &self.layout.uv_weights].map(|range| &self.params[range.clone()]);
        run(self.tier, InterpolateBlocks { endpoints, weights, across: 4, map: &mut self.maps.uv });
    }

    /// From now on F_uv and F_uvt are what the maps hold, whatever the parameters: at first the same.
    pub(crate) fn freeze(&mut self) {
        self.interpolate_uv();
        self.frozen = true;
    }

    /// The maps follow the parameters again.
    pub(crate) fn thaw(&mut self) {
        self.frozen = false;
        self.refresh();
    }

    /// The features as samples read them.
    pub(crate) fn features(&self) -> Features<'_> {
        features(&self.layout, &self.params, &self.maps, self.frozen)
    }

    /// Loss (Σ w r², per sample) and gradient of a batch at the present parameters; the gradient is added to
    /// `flat`, which a step leaves zero.
    pub(crate) fn differentiate(&mut self, samples: &[Samples], noise: bool, scope: Scope) -> f64 {
        let salt = self.random.bits();
        self.of_network = NetworkGradient::new(self.problem.points.len());
        let loss = run(
            self.tier,
            Batch {
                problem: &self.problem,
                features: features(&self.layout, &self.params, &self.maps, self.frozen),
                network: &self.network,
                samples,
                noise: noise.then_some((&self.noise, salt)),
                of_features: FeatureGradient::new(&mut self.flat, &self.layout, &mut self.of_uvt),
                of_network: &mut self.of_network,
                scope,
                // Far from Adam's ε on one side and from overflow on the other.
                scale: 64.0 / (samples.len() * CHUNK) as f32,
            },
        );
        if scope == Scope::All {
            let [endpoints, weights] = [&self.layout.uvt_endpoints, &self.layout.uvt_weights];
            let backpropagate = BackpropagateBlocks {
                endpoints: &self.params[endpoints.clone()],
                weights: &self.params[weights.clone()],
                across: self.problem.shape.uvt[0],
                map: &mut self.of_uvt,
                gradient: &mut self.flat[endpoints.start..weights.end],
            };
            run(self.tier, backpropagate);
        }
        self.of_network.flatten(&self.problem, &mut self.flat[self.layout.network.clone()]);
        loss / (samples.len() * CHUNK) as f64
    }

    /// The gradient that [`Self::differentiate`] left, times 32 / samples.
    #[cfg(test)]
    pub(crate) fn gradient(&self) -> &[f32] {
        &self.flat
    }

    /// One step on the next batch; gives its loss, which is not finite once the training diverged.
    pub(crate) fn step(&mut self, step: &Step) -> Result<f64> {
        stop_if_interrupted()?;
        let mut epochs = std::mem::take(&mut self.epochs);
        let batch = epochs.next(&self.problem, &mut self.random);
        let loss = self.differentiate(&batch, step.noise, step.scope);
        self.epochs = epochs;
        self.steps += 1;
        let (network, ut) = (self.layout.network.clone(), self.layout.ut.start);
        let features = match step.scope {
            Scope::All => 0..network.start,
            Scope::Planes => ut..network.start,
            Scope::Network => network.start..network.start,
        };
        let beta = [BETA1, step.beta2];
        let corrections = beta.map(|b| 1.0 - f64::from(b).powi(self.steps));
        if let Some(bases) = &mut self.bases {
            bases.rotate(self.tier, &mut self.flat[network.clone()], &mut self.mean[network.clone()]);
        }
        let mut adam = |range: Range<usize>, rate: f32, bounds: [f32; 2], params: &mut [f32]| {
            let adam = Adam {
                params,
                gradient: &mut self.flat[range.clone()],
                mean: &mut self.mean[range.clone()],
                square: &mut self.square[range],
                beta,
                corrected: [(f64::from(rate) / corrections[0]) as f32, (1.0 / corrections[1]) as f32],
                bounds,
            };
            run(self.tier, adam);
        };
        adam(features.clone(), step.rate, [0.0, 1.0], &mut self.params[features]);
        let mut moved = vec![0.0; network.len()];
        adam(network.clone(), step.network_rate, [f32::NEG_INFINITY, f32::INFINITY], &mut moved);
        if let Some(bases) = &self.bases {
            bases.rotate_back(self.tier, &mut moved);
        }
        self.params[network].iter_mut().zip(&moved).for_each(|(p, m)| *p += m);
        match step.scope {
            Scope::Network => {
                self.network = Network::new(&self.params[self.layout.network.clone()], &self.problem);
            }
            _ => self.refresh(),
        }
        Ok(loss)
    }

    /// Mean squared error in linear light of the first this many time points, over every `stride`-th valid
    /// texel.
    pub(crate) fn mean_squared_errors(&self, points: usize, stride: usize) -> Vec<f64> {
        let valid = &self.problem.texels[..self.problem.valid];
        let texels: Vec<Texel> = valid.iter().step_by(stride).copied().collect();
        let (problem, features, network) = (&self.problem, self.features(), &self.network);
        let mut sums = run(self.tier, SquaredErrors { problem, features, network, points, texels: &texels });
        sums.iter_mut().for_each(|s| *s /= (3 * texels.len()) as f64);
        sums
    }

    /// Mean over the frames of the PSNR (at most 100 dB) against the frame's largest valid value; not finite
    /// where any output is not.
    pub(crate) fn psnr(&self, stride: usize) -> f64 {
        let errors = self.mean_squared_errors(self.problem.frames, stride);
        let peaks = self.problem.points.iter().map(|m| f64::from(m.peak));
        peaks.zip(&errors).map(|(peak, mse)| psnr_db(peak, *mse)).sum::<f64>() / errors.len() as f64
    }

    /// Weighs the loss so that it follows the PSNR in linear light: to first order E's error is 2 mean·y·δy,
    /// its share of the frame's log-MSE is (mean·y)²/MSE; the weight of a frame's texel is the root of that,
    /// mostly averaged over the frame ([`EVEN`]), scaled to mean 1, with a floor for the dark. For the pooled
    /// error, peak² would stand for MSE; √(peak² MSE) gives two thirds of the gain and leaves the dark nearly
    /// as good.
    pub(crate) fn align_weights(&mut self, aim: Aim) {
        let stride = self.problem.coarse_stride();
        let errors = self.mean_squared_errors(self.problem.points.len(), stride);
        let problem = &mut self.problem;
        let (mut total, mut count) = (0.0, 0.0);
        // Mean and median of each channel's targets.
        let mut targets_of = Vec::with_capacity(problem.points.len());
        for (a, (point, mse)) in problem.points.iter_mut().zip(errors).enumerate() {
            // 100 dB is as good as it is measured.
            let root = mse.max(f64::from(point.peak).powi(2) * 1e-10).sqrt();
            let root = match aim {
                Aim::MeanPsnr => root,
                Aim::PooledError => (root * f64::from(point.peak)).sqrt(),
            };
            let targets = &problem.targets[a * problem.texels.len()..][..problem.valid];
            let of = [0, 1, 2].map(|c| {
                let targets = || targets.iter().step_by(stride).map(|t| t[c]);
                (targets().sum::<f32>() / targets().count() as f32, median(targets()))
            });
            for (c, (mean, _)) in of.iter().enumerate() {
                point.slope[c] = (f64::from(point.means[c]) / root) as f32;
                total += f64::from(point.slope[c] * mean);
                count += 1.0;
            }
            targets_of.push(of);
        }
        let factor = (count / total) as f32;
        if !factor.is_finite() {
            return;
        }
        for (point, targets) in problem.points.iter_mut().zip(targets_of) {
            for (c, (mean, median)) in targets.into_iter().enumerate() {
                let slope = factor * point.slope[c];
                // Of a frame that one peak outshines, the rest counts by its relative error.
                let dark = (TYPICAL / median.max(f32::MIN_POSITIVE)).max(1.0).powi(2);
                let floor = EVEN * slope * mean + DARK_WEIGHT * dark;
                point.base[c] = if point.means[c] > 0.0 { floor.min(WEIGHT_CAP) } else { 0.0 };
                point.slope[c] = (1.0 - EVEN) * slope;
            }
        }
    }
}

fn features<'a>(layout: &Layout, params: &'a [f32], maps: &'a Maps, frozen: bool) -> Features<'a> {
    let part = |range: &Range<usize>| &params[range.clone()];
    let lines = !frozen && !layout.uv_weights.is_empty();
    Features {
        uv: match lines {
            true => Uv::Blocks { endpoints: part(&layout.uv_endpoints), weights: part(&layout.uv_weights) },
            false => Uv::Texels(&maps.uv),
        },
        uvt: &maps.uvt,
        ut: part(&layout.ut),
        vt: part(&layout.vt),
    }
}

/// Share of a frame's weight that all its texels have alike; the rest goes as they are bright. With 0 the
/// scene `yard` has 0.6 dB more, and errors in its dark that are 1.9 times those of a loss without weights;
/// with this share 1.02 times.
const EVEN: f32 = 0.75;
/// Floor of the aligned loss weight: without one, darkness would count for nothing. Tuned on the yard.
const DARK_WEIGHT: f32 = 0.1;
/// Below this median of its targets, a frame's channel is mostly dark beside its peak, and the floor rises
/// (the tiles of 10⁶ in NUMERICS).
const TYPICAL: f32 = 0.1;

/// The lower median; 1 of nothing.
fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    if values.is_empty() {
        return 1.0;
    }
    let middle = (values.len() - 1) / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// An epoch visits one of this many samples of a time point between frames.
const BETWEEN_SHARE: usize = 8;

/// Draws batches: every valid texel of a frame once an epoch, and of the gutter one in [`GUTTER_SHARE`]. A
/// time point goes through them in one of a few random orders, from a random place on. Batches go round the
/// time points; the chunks of one go by the slices they read.
#[derive(Debug, Default)]
struct Epochs {
    /// Each has all valid texels and its share of the gutter; then its first ones again, so that a chunk can
    /// start at each.
    orders: [Vec<Texel>; GUTTER_SHARE],
    chunks: Vec<Chunk>,
    used: usize,
    batch: usize,
}

/// A time point, and which order its chunk is of and where it starts there.
#[derive(Clone, Copy, Debug)]
struct Chunk {
    point: usize,
    order: usize,
    start: usize,
}

impl Epochs {
    fn next(&mut self, problem: &Problem, random: &mut Random) -> Vec<Samples<'_>> {
        if self.used == self.chunks.len() {
            self.refill(problem, random);
        }
        let end = (self.used + self.batch).min(self.chunks.len());
        let batch = &mut self.chunks[self.used..end];
        self.used = end;
        // Chunks that read the same slices of F_uvt one after another: they stay in the near cache.
        batch.sort_by_key(|chunk| (problem.points[chunk.point].slices.at, chunk.point, chunk.start));
        let samples = |&Chunk { point, order, start }: &Chunk| Samples {
            point,
            texels: &self.orders[order][start..][..CHUNK],
        };
        batch.iter().map(samples).collect()
    }

    fn refill(&mut self, problem: &Problem, random: &mut Random) {
        let (valid, gutter) = problem.texels.split_at(problem.valid);
        for (share, order) in self.orders.iter_mut().enumerate() {
            order.clear();
            order.extend(valid);
            order.extend(gutter.iter().skip(share).step_by(GUTTER_SHARE));
            random.shuffle(order);
            (0..CHUNK).for_each(|i| order.push(order[i]));
        }
        let lengths = self.orders.each_ref().map(|order| order.len() - CHUNK);
        let first = |point| {
            let order = random.below(GUTTER_SHARE);
            Chunk { point, order, start: random.below(lengths[order]) }
        };
        let mut turn: Vec<Chunk> = (0..problem.points.len()).map(first).collect();
        self.chunks.clear();
        // The first order has the most gutter.
        for round in 0..lengths[0].div_ceil(CHUNK) {
            random.shuffle(&mut turn);
            let of_round = |first: &&Chunk| {
                first.point < problem.frames || (round + first.point).is_multiple_of(BETWEEN_SHARE)
            };
            let chunk = |first: &Chunk| Chunk {
                start: (first.start + round * CHUNK) % lengths[first.order],
                ..*first
            };
            self.chunks.extend(turn.iter().filter(of_round).map(chunk));
        }
        let batches = self.chunks.len().div_ceil(BATCH / CHUNK);
        self.batch = self.chunks.len().div_ceil(batches);
        self.used = 0;
    }
}
