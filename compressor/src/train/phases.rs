//! The phases of one tile's training, by either recipe: the float model, its quantisation, fine-tuning in
//! between.

use super::step::kernel::Scope;
use super::step::optimise::{Step, Trainer, schedule};
use super::stored::quantise::Blocks;
use super::targets::problem::Problem;
use super::{Aim, Coded, Point, Recipe, TrainedTile};
use crate::clock::Clock;
use crate::lanes::Tier;
use crate::{Error, Result};

/// Largest learning rate of the main phase, and of the decoder network in it. These and the next three were
/// found by trying, on tiles of baked light, for the dB after some thousand steps; a rate that is large and
/// falls matters most.
const RATES: [f32; 2] = [0.02, 0.03];
/// Steps over which the rate rises.
const WARM_UP: usize = 100;
/// Share of the rate that is left at the end of the cosine.
const LAST_RATE: f32 = 0.02;
/// Adam's β₂: steps are few and their gradients sure, so a short memory wins.
const BETA2: f32 = 0.95;
/// After blocks are chosen: steps of planes and network, their largest rate, and steps over which it rises.
const REFIT: (usize, f32, usize) = (150, 0.003, 30);
/// After planes are rounded: the same of the network alone, which stands near its place by then.
const LAST_REFIT: (usize, f32, usize) = (100, 0.001, 30);
/// When in the main phase the loss weights are aligned with the error so far.
const ALIGNMENTS: [f64; 3] = [0.25, 0.5, 0.75];
/// The paper's learning rate, throughout.
const PAPER_RATE: f32 = 1e-3;
/// Adam's β₂ in the paper's recipe: the usual one.
const PAPER_BETA2: f32 = 0.999;
/// Steps of the network alone in the paper's recipe, which does not say how many.
const PAPER_FINE_TUNING: usize = 300;
/// A main phase that ends this far below its best point (in dB) has diverged, even if all its numbers are
/// finite. Points above [`GOOD_DB`] count as [`GOOD_DB`], because a tile with a bright peak may have any PSNR
/// up there: a phase that ends at 34 dB or more never has.
const LOST_DB: f64 = 6.0;
/// See [`LOST_DB`].
const GOOD_DB: f64 = 40.0;
/// Points of the curve in the main phase.
const POINTS: usize = 8;

/// A training at a multiple of the rates.
pub(super) struct Attempt<const H: usize> {
    trainer: Trainer<H>,
    rate_scale: f32,
    beta2: f32,
    aim: Aim,
    clock: Clock,
    curve: Vec<Point>,
    /// Steps done.
    iteration: usize,
    /// CPU seconds of the main phase's steps.
    stepping: f64,
    /// None follows: a poor result is taken.
    last: bool,
}

/// Why a training ended early.
enum Stop {
    /// It came to a number that is not finite, or lost what it had reached.
    Diverged,
    /// It must not go on.
    Failed(Error),
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        Stop::Failed(error)
    }
}

impl<const H: usize> Attempt<H> {
    /// Before the first step.
    pub(super) fn new(problem: &Problem, recipe: &Recipe, rate_scale: f32, tier: Tier) -> Self {
        Attempt {
            clock: Clock::start(),
            trainer: Trainer::new(problem.clone(), recipe.seed, !recipe.paper, tier),
            rate_scale,
            beta2: if recipe.paper { PAPER_BETA2 } else { BETA2 },
            aim: recipe.aim,
            curve: Vec::new(),
            iteration: 0,
            stepping: 0.0,
            last: false,
        }
    }

    /// All phases; `None` if the training diverged (only if it came to no number, where it is the `last`
    /// attempt). The result's `omitted` is empty.
    pub(super) fn finish(mut self, recipe: &Recipe, last: bool) -> Result<Option<TrainedTile>> {
        self.last = last;
        let trained = match self.trainer.problem.coded {
            _ if recipe.paper => self.paper(recipe.iterations),
            Coded::OnTheLoss => self.standard(recipe),
            Coded::Plainly | Coded::TexelByTexel => self.plain(recipe.iterations),
        };
        let (blocks, psnr) = match trained {
            Ok(trained) => trained,
            Err(Stop::Diverged) => return Ok(None),
            Err(Stop::Failed(error)) => return Err(error),
        };
        Ok(self.stored(&blocks, psnr, recipe.iterations))
    }

    /// The main phase alone: the squared error of the float model relative to each frame's peak, mean over
    /// channels, summed over valid texels and frames; `None` if the training diverged.
    pub(super) fn trial(mut self, recipe: &Recipe) -> Result<Option<f64>> {
        let rates = |i| RATES.map(|rate| rate * schedule(i, recipe.iterations, WARM_UP, LAST_RATE));
        match self.main_phase(recipe.iterations, &ALIGNMENTS, rates) {
            Ok(_) => {}
            Err(Stop::Diverged) => return Ok(None),
            Err(Stop::Failed(error)) => return Err(error),
        }
        let stride = self.trainer.problem.coarse_stride();
        Ok(Some(self.error(stride)).filter(|error| error.is_finite()))
    }

    /// Squared error relative to each frame's peak, mean over channels, summed over frames and valid texels;
    /// of these, one in `stride` is asked.
    fn error(&mut self, stride: usize) -> f64 {
        let frames = self.trainer.problem.frames;
        let errors = self.trainer.mean_squared_errors(frames, stride);
        let problem = &self.trainer.problem;
        let peaks = problem.points.iter().map(|point| f64::from(point.peak).powi(2));
        errors.iter().zip(peaks).map(|(mse, peak)| mse / peak).sum::<f64>() * problem.valid as f64
    }

    /// Rounds the decoder network and measures what is stored; `None` if that, or the float model, is not
    /// finite. That model's PSNR is given, as it was and with features of 8 bits, and the main phase's steps.
    fn stored(
        mut self,
        blocks: &Blocks,
        [unquantised, of_8bit]: [f64; 2],
        steps: usize,
    ) -> Option<TrainedTile> {
        self.trainer.round_network();
        self.point();
        let psnr = self.trainer.psnr(1);
        if !psnr.is_finite() || !unquantised.is_finite() {
            return None;
        }
        let error = self.error(1);
        Some(TrainedTile {
            steps,
            stepping_seconds: self.stepping,
            error: Some(error),
            params: Some(self.trainer.store(blocks)),
            psnr_unquantised_db: Some(unquantised),
            psnr_8bit_features_db: Some(of_8bit),
            psnr_db: Some(psnr),
            curve: self.curve,
            omitted: Vec::new(),
        })
    }

    /// This project's recipe up to the network's rounding: the blocks, and the PSNR of the float model, as it
    /// is and with features of 8 bits.
    fn standard(&mut self, recipe: &Recipe) -> Result<(Blocks, [f64; 2]), Stop> {
        // 1. In float, with noise for the quantisation to come.
        let iterations = recipe.iterations;
        let rates = |i| RATES.map(|rate| rate * schedule(i, iterations, WARM_UP, LAST_RATE));
        let psnr = self.main_phase(iterations, &ALIGNMENTS, rates)?;
        let psnr = [psnr, self.trainer.psnr_8bit()];
        // 2. Blocks under the loss's own metric; what is still free follows; again around the new network.
        let mut blocks = self.trainer.freeze_blocks();
        self.point();
        for pass in 0..recipe.passes {
            if pass > 0 {
                self.trainer.refine_blocks(&mut blocks);
            }
            self.refit(Scope::Planes, REFIT)?;
            self.point();
        }
        // 3. Planes to 8 bits, then the network alone, then F_uv once more.
        self.trainer.round_planes();
        self.refit(Scope::Network, LAST_REFIT)?;
        self.trainer.refine_uv(&mut blocks);
        Ok((blocks, psnr))
    }

    /// The main phase as ever, then what the paper does: all maps to 8 bits, a plain BC7 encoder, the network
    /// around them (at a rate that falls, which is to its advantage).
    fn plain(&mut self, iterations: usize) -> Result<(Blocks, [f64; 2]), Stop> {
        let rates = |i| RATES.map(|rate| rate * schedule(i, iterations, WARM_UP, LAST_RATE));
        let psnr = self.main_phase(iterations, &ALIGNMENTS, rates)?;
        let psnr = [psnr, self.trainer.psnr_8bit()];
        self.trainer.round_planes();
        let blocks = self.trainer.encode_blocks();
        self.point();
        self.refit(Scope::Network, (PAPER_FINE_TUNING, REFIT.1, REFIT.2))?;
        Ok((blocks, psnr))
    }

    /// The paper's recipe (sections 3.2 and 4), likewise.
    fn paper(&mut self, iterations: usize) -> Result<(Blocks, [f64; 2]), Stop> {
        // 1. In float at a constant rate, with noise.
        let psnr = self.main_phase(iterations, &[], |_| [PAPER_RATE; 2])?;
        let psnr = [psnr, self.trainer.psnr_8bit()];
        // 2. All maps to 8 bits; BC7 of F_uv and F_uvt.
        self.trainer.round_planes();
        let blocks = self.trainer.encode_blocks();
        self.point();
        // 3. The network around the frozen maps.
        self.steps(Scope::Network, PAPER_FINE_TUNING, |_| PAPER_RATE)?;
        Ok((blocks, psnr))
    }

    /// Trains everything in float, with noise; `rates` gives those of features and network at a step. The
    /// result's PSNR.
    fn main_phase(
        &mut self,
        iterations: usize,
        alignments: &[f64],
        rates: impl Fn(usize) -> [f32; 2],
    ) -> Result<f64, Stop> {
        let mut best = self.trainer.psnr(self.trainer.problem.coarse_stride());
        let mut begun = self.clock.seconds();
        for i in 0..iterations {
            if alignments.iter().any(|share| i == (share * iterations as f64) as usize) {
                let before = self.clock.seconds();
                self.trainer.align_weights(self.aim);
                begun += self.clock.seconds() - before;
            }
            self.step(Scope::All, rates(i), true)?;
            if (i + 1) % (iterations / POINTS).max(1) == 0 {
                let before = self.clock.seconds();
                best = best.max(self.point());
                begun += self.clock.seconds() - before;
            }
        }
        self.stepping = self.clock.seconds() - begun;
        let psnr = self.trainer.psnr(1);
        if psnr < best.min(GOOD_DB) - LOST_DB && !self.last { Err(Stop::Diverged) } else { Ok(psnr) }
    }

    /// Continues training around what is already quantised: this many steps, at a rate that rises and falls
    /// to 0.
    fn refit(&mut self, scope: Scope, (steps, rate, warm_up): (usize, f32, usize)) -> Result<(), Stop> {
        self.steps(scope, steps, |i| rate * schedule(i, steps, warm_up, 0.0))
    }

    /// Steps without noise.
    fn steps(&mut self, scope: Scope, steps: usize, rate: impl Fn(usize) -> f32) -> Result<(), Stop> {
        (0..steps).try_for_each(|i| self.step(scope, [rate(i); 2], false))
    }

    fn step(&mut self, scope: Scope, rates: [f32; 2], noise: bool) -> Result<(), Stop> {
        let [rate, network_rate] = rates.map(|rate| rate * self.rate_scale);
        let loss = self.trainer.step(&Step { scope, rate, network_rate, noise, beta2: self.beta2 })?;
        self.iteration += 1;
        if loss.is_finite() { Ok(()) } else { Err(Stop::Diverged) }
    }

    /// Adds to the curve; the PSNR there.
    fn point(&mut self) -> f64 {
        let few = self.trainer.problem.coarse_stride();
        let (iteration, seconds, psnr_db) = (self.iteration, self.clock.seconds(), self.trainer.psnr(few));
        self.curve.push(Point { iteration, seconds, psnr_db });
        psnr_db
    }
}

#[cfg(test)]
mod tests {
    use super::super::step::gather::Samples;
    use super::super::targets::light::Light;
    use super::*;
    use crate::model::{Profile, Shape};
    use crate::tile::{Coverage, TileSource};

    #[test]
    fn what_is_not_a_number_never_counts_as_trained() {
        let source = TileSource {
            width: 8,
            height: 8,
            hours: vec![0.0, 12.0],
            // Blue is black: an output that is not a number would pass for it if it were shown as 0.
            frames: vec![vec![[1.0, 0.5, 0.0]; 64]; 2],
            coverage: vec![Coverage::Valid; 64],
            gates: vec![],
            neighbours: [false; 4],
        };
        let recipe = Recipe { iterations: 20, passes: 2, paper: false, seed: 3, aim: Aim::MeanPsnr };
        let light = Light::new(&source, recipe.coding());
        let shape = Shape::new(&Profile::M.contents(2, 0), 8, 8, 2, recipe.coding());
        let problem = Problem::new(&source, &light, shape, recipe.coding());
        let stored = |poison: Option<usize>| {
            let mut attempt = Attempt::<16>::new(&problem, &recipe, 1.0, Tier::detect());
            let Ok((blocks, psnr)) = attempt.standard(&recipe) else { panic!("training stopped") };
            let network = attempt.trainer.layout.network.clone();
            if let Some(channel) = poison {
                // b₃ stands last.
                attempt.trainer.params[network.end - 3 + channel] = f32::NAN;
                attempt.trainer.refresh();
                assert!(!attempt.trainer.psnr(1).is_finite());
                let texels = attempt.trainer.problem.texels[..3].to_vec();
                let samples = [Samples { point: 0, texels: &texels }];
                assert!(!attempt.trainer.differentiate(&samples, false, Scope::Network).is_finite());
            }
            attempt.stored(&blocks, psnr, recipe.iterations)
        };
        assert!(stored(None).is_some_and(|tile| tile.psnr_db.is_some_and(f64::is_finite)));
        for channel in 0..3 {
            assert!(stored(Some(channel)).is_none(), "channel {channel}");
        }
    }
}
