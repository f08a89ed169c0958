//! The training loop of one tile: epochs, steps of Adam, the loss weights, and the error so far.

use super::features::{Layout, Maps};
use super::kernel::{
    Adam, Batch, Contract, FillMaps, Gradient, Noise, Samples, Scope, SquaredErrors, WEIGHT_CAP, run,
};
use super::network::{BLOCK, Network, NetworkGradient};
use super::problem::{GUTTER_SHARE, Problem};
use super::random::Random;
use super::{Aim, Coded};
use crate::Result;
use crate::lanes::Tier;
use dataset::console::stop_if_interrupted;
use dataset::metrics::psnr_db;

/// Samples per step: the paper's 2¹².
const BATCH: usize = 4096;
/// β of Adam.
const BETA1: f32 = 0.9;

/// What a step moves, how far, and whether features carry noise.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Parameters that move.
    pub scope: Scope,
    /// Learning rate of the features.
    pub rate: f32,
    /// Learning rate of the decoder.
    pub mlp_rate: f32,
    /// Noise of 8-bit quantisation on sampled features.
    pub noise: bool,
    /// Adam's β₂.
    pub beta2: f32,
}

/// Learning rate at a step: a linear warm-up, then a cosine from 1 to `end`.
pub fn schedule(step: usize, steps: usize, warm_up: usize, end: f32) -> f32 {
    let progress = step as f32 / steps.max(1) as f32;
    let warm = ((step + 1) as f32 / warm_up.max(1) as f32).min(1.0);
    warm * (end + (1.0 - end) * 0.5 * (1.0 + (std::f32::consts::PI * progress).cos()))
}

/// The state of one tile's training.
#[derive(Debug)]
pub struct Trainer<const H: usize> {
    tier: Tier,
    /// The samples.
    pub problem: Problem,
    /// Order of the parameters.
    pub layout: Layout,
    /// The parameters.
    pub params: Vec<f32>,
    /// Their maps; F_uv and F_uvt come from the blocks once these are frozen.
    pub maps: Maps,
    /// Their decoder.
    pub network: Network<H>,
    /// F_uv and F_uvt no longer follow the parameters.
    pub frozen: bool,
    gradient: Gradient<H>,
    flat: Vec<f32>,
    mean: Vec<f32>,
    square: Vec<f32>,
    steps: i32,
    epochs: Epochs,
    noise: Noise,
    random: Random,
}

impl<const H: usize> Trainer<H> {
    /// Instruction set in use.
    pub fn tier(&self) -> Tier {
        self.tier
    }

    /// Before the first step.
    pub fn new(problem: Problem, seed: u64, tier: Tier) -> Self {
        let mut random = Random::new(seed);
        let layout = Layout::new(&problem.shape, problem.coded == Coded::TexelByTexel);
        let params = layout.initial(&problem.shape, &mut random);
        let maps = Maps::new(&problem);
        let mut trainer = Trainer {
            tier,
            network: Network::new(&params[layout.mlp.clone()], &problem),
            gradient: Gradient { maps: maps.clone(), network: NetworkGradient::new(problem.moments.len()) },
            flat: vec![0.0; params.len()],
            mean: vec![0.0; params.len()],
            square: vec![0.0; params.len()],
            steps: 0,
            epochs: Epochs::default(),
            noise: Noise::new(&problem.shape, &mut random),
            frozen: false,
            problem,
            layout,
            params,
            maps,
            random,
        };
        trainer.refresh();
        trainer
    }

    /// Makes maps and decoder follow the parameters.
    pub fn refresh(&mut self) {
        let blocks = !self.frozen;
        let (problem, layout, params) = (&self.problem, &self.layout, &self.params);
        run(self.tier, FillMaps { problem, layout, params, maps: &mut self.maps, blocks });
        self.network = Network::new(&self.params[self.layout.mlp.clone()], &self.problem);
    }

    /// Loss (Σ w r², per sample) and gradient of a batch at the present parameters; the gradient is left in `flat`.
    pub fn differentiate(&mut self, samples: &[Samples], noise: bool, scope: Scope) -> f64 {
        let salt = self.random.bits();
        self.gradient.network = NetworkGradient::new(self.problem.moments.len());
        let loss = run(
            self.tier,
            Batch {
                problem: &self.problem,
                maps: &self.maps,
                network: &self.network,
                samples,
                noise: noise.then_some((&self.noise, salt)),
                gradient: &mut self.gradient,
                scope,
                // Far from Adam's ε on one side and from overflow on the other.
                scale: 64.0 / (samples.len() * BLOCK) as f32,
            },
        );
        if scope != Scope::Decoder {
            let contract = Contract {
                problem: &self.problem,
                layout: &self.layout,
                params: &self.params,
                maps: &mut self.gradient.maps,
                gradient: &mut self.flat,
                blocks: scope == Scope::All,
            };
            run(self.tier, contract);
        }
        self.gradient.network.flatten(&self.problem, &mut self.flat[self.layout.mlp.clone()]);
        loss / (samples.len() * BLOCK) as f64
    }

    /// The gradient that [`Self::differentiate`] left, times 32 / samples.
    #[cfg(test)]
    pub fn gradient(&self) -> &[f32] {
        &self.flat
    }

    /// One step on the next batch; gives its loss, which is not finite once the training diverged.
    pub fn step(&mut self, step: &Step) -> Result<f64> {
        stop_if_interrupted()?;
        let mut epochs = std::mem::take(&mut self.epochs);
        let batch = epochs.next(&self.problem, &mut self.random);
        let loss = self.differentiate(batch, step.noise, step.scope);
        self.epochs = epochs;
        self.steps += 1;
        let (mlp, ut) = (self.layout.mlp.clone(), self.layout.ut.start);
        let features = match step.scope {
            Scope::All => 0..mlp.start,
            Scope::Planes => ut..mlp.start,
            Scope::Decoder => mlp.start..mlp.start,
        };
        let beta = [BETA1, step.beta2];
        let corrections = beta.map(|b| 1.0 - f64::from(b).powi(self.steps));
        for (range, rate, bounds) in
            [(features, step.rate, [0.0, 1.0]), (mlp, step.mlp_rate, [f32::NEG_INFINITY, f32::INFINITY])]
        {
            let adam = Adam {
                params: &mut self.params[range.clone()],
                gradient: &self.flat[range.clone()],
                mean: &mut self.mean[range.clone()],
                square: &mut self.square[range],
                beta,
                corrected: [(f64::from(rate) / corrections[0]) as f32, (1.0 / corrections[1]) as f32],
                bounds,
            };
            run(self.tier, adam);
        }
        match step.scope {
            Scope::Decoder => {
                self.network = Network::new(&self.params[self.layout.mlp.clone()], &self.problem);
            }
            _ => self.refresh(),
        }
        Ok(loss)
    }

    /// Mean squared error in linear light of the first so many moments, over every `stride`-th valid texel.
    pub fn mean_squared_errors(&self, moments: usize, stride: usize) -> Vec<f64> {
        let texels: Vec<u32> = (0..self.problem.valid as u32).step_by(stride).collect();
        let (problem, maps, network) = (&self.problem, &self.maps, &self.network);
        let mut sums = run(self.tier, SquaredErrors { problem, maps, network, moments, texels: &texels });
        sums.iter_mut().for_each(|s| *s /= (3 * texels.len()) as f64);
        sums
    }

    /// Mean over the sets of the PSNR (at most 100 dB) against the set's largest valid value; not finite where any
    /// output is not.
    pub fn psnr(&self, stride: usize) -> f64 {
        let errors = self.mean_squared_errors(self.problem.sets, stride);
        let peaks = self.problem.moments.iter().map(|m| f64::from(m.peak));
        peaks.zip(&errors).map(|(peak, mse)| psnr_db(peak, *mse)).sum::<f64>() / errors.len() as f64
    }

    /// Weighs the loss so that it follows the PSNR in linear light: to first order E's error is 2 mean·y·δy, its share
    /// of the set's log-MSE is (mean·y)²/MSE; the weight of a set's texel is the root of that, mostly averaged over the set
    /// ([`EVEN`]), scaled to mean 1, with a floor for the dark. For the pooled error, peak² would stand for MSE; √(peak² MSE) gives
    /// two thirds of the gain and leaves the dark nearly as good.
    pub fn align_weights(&mut self, aim: Aim) {
        let stride = self.problem.valid.div_ceil(2048);
        let errors = self.mean_squared_errors(self.problem.moments.len(), stride);
        let problem = &mut self.problem;
        let (mut total, mut count) = (0.0, 0.0);
        // Mean and median of each channel's targets.
        let mut targets_of = Vec::with_capacity(problem.moments.len());
        for (a, (moment, mse)) in problem.moments.iter_mut().zip(errors).enumerate() {
            // 100 dB is as good as it is measured.
            let root = mse.max(f64::from(moment.peak).powi(2) * 1e-10).sqrt();
            let root = match aim {
                Aim::MeanPsnr => root,
                Aim::PooledError => (root * f64::from(moment.peak)).sqrt(),
            };
            let targets = &problem.targets[a * problem.texels.len()..][..problem.valid];
            let of = [0, 1, 2].map(|c| {
                let targets = || targets.iter().step_by(stride).map(|t| t[c]);
                (targets().sum::<f32>() / targets().count() as f32, median(targets()))
            });
            for (c, (mean, _)) in of.iter().enumerate() {
                moment.slope[c] = (f64::from(moment.means[c]) / root) as f32;
                total += f64::from(moment.slope[c] * mean);
                count += 1.0;
            }
            targets_of.push(of);
        }
        let factor = (count / total) as f32;
        if !factor.is_finite() {
            return;
        }
        for (moment, targets) in problem.moments.iter_mut().zip(targets_of) {
            for (c, (mean, median)) in targets.into_iter().enumerate() {
                let slope = factor * moment.slope[c];
                // Of a set that one peak outshines, the rest counts by its relative error.
                let dark = (TYPICAL / median.max(f32::MIN_POSITIVE)).max(1.0).powi(2);
                let floor = EVEN * slope * mean + DARK_WEIGHT * dark;
                moment.base[c] = if moment.means[c] > 0.0 { floor.min(WEIGHT_CAP) } else { 0.0 };
                moment.slope[c] = (1.0 - EVEN) * slope;
            }
        }
    }
}

/// Share of a set's weight that all its texels have alike; the rest goes as they are bright. With 0 the scene `yard` has 0.6 dB more,
/// and errors in its dark that are 1.9 times those of a loss without weights; with this share 1.02 times.
const EVEN: f32 = 0.75;
/// Floor of the aligned loss weight.
const DARK_WEIGHT: f32 = 0.1;
/// Below this target, the median of a set's channel raises the floor.
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

/// An epoch visits one of so many samples of a moment between sets.
const BETWEEN_SHARE: usize = 8;

/// Draws batches: every sample of a set once an epoch, in random order; consecutive blocks go round the moments.
#[derive(Debug, Default)]
struct Epochs {
    blocks: Vec<Samples>,
    used: usize,
    batch: usize,
}

impl Epochs {
    fn next(&mut self, problem: &Problem, random: &mut Random) -> &[Samples] {
        if self.used == self.blocks.len() {
            self.refill(problem, random);
        }
        let end = (self.used + self.batch).min(self.blocks.len());
        let batch = &self.blocks[self.used..end];
        self.used = end;
        batch
    }

    fn refill(&mut self, problem: &Problem, random: &mut Random) {
        let gutter = problem.texels.len() - problem.valid;
        let per_moment = problem.valid + gutter.div_ceil(GUTTER_SHARE);
        let rounds = per_moment.div_ceil(BLOCK);
        let mut orders: Vec<u32> = Vec::with_capacity(problem.moments.len() * per_moment);
        for _ in &problem.moments {
            let first = orders.len();
            orders.extend(0..problem.valid as u32);
            // A random arithmetic progression of the gutter: each of its texels is as likely.
            let start = if gutter > 0 { random.below(gutter) } else { 0 };
            let picks = gutter.div_ceil(GUTTER_SHARE);
            orders.extend((0..picks).map(|i| (problem.valid + (start + i * GUTTER_SHARE) % gutter) as u32));
            random.shuffle(&mut orders[first..]);
        }
        let mut turn: Vec<usize> = (0..problem.moments.len()).collect();
        self.blocks.clear();
        for round in 0..rounds {
            random.shuffle(&mut turn);
            let visited =
                |moment: &&usize| **moment < problem.sets || (round + **moment).is_multiple_of(BETWEEN_SHARE);
            self.blocks.extend(turn.iter().filter(visited).map(|&moment| {
                let order = &orders[moment * per_moment..][..per_moment];
                // The last round is filled up from the start.
                let texel = |s| order[(round * BLOCK + s) % per_moment];
                Samples { moment, texels: std::array::from_fn(texel), count: BLOCK }
            }));
        }
        let batches = self.blocks.len().div_ceil(BATCH / BLOCK);
        self.batch = self.blocks.len().div_ceil(batches);
        self.used = 0;
    }
}
