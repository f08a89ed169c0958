//! Error against run time of a bake to come, by the rounds of an earlier one.

use super::existing::RUN_FILE;
use super::outcome::Outcome;
use crate::bake::prepare::Prepared;
use crate::bake::rounds::Round;
use serde::Serialize;
use std::path::Path;

/// Errors of denoised light fall more slowly than with the square root of the samples (NUMERICS,
/// "Denoising").
const POWER_DENOISED: f64 = 1.0 / 2.4;
/// What is predicted: from a quarter of the samples asked for to four times as many.
const STEPS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

/// What an earlier bake lets expect.
#[derive(Clone, Debug, Serialize)]
pub struct Prediction {
    /// The samples of the earlier bake.
    pub from_samples: u32,
    /// By the number of samples.
    pub points: Vec<Point>,
    /// With as many samples everywhere as the target error takes; `None` without one. (Cells that converge
    /// earlier take fewer.)
    pub target: Option<Point>,
}

/// A bake with this number of samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Samples per texel.
    pub samples: u32,
    /// Seconds of tracing on the machine of the earlier bake.
    pub seconds: f64,
    /// Local error that half of the texels' cells stay below, over all frames.
    pub median: f64,
    /// That of 95 %, at the worst hour.
    pub p95: f64,
}

/// By the bake that lies in `out`; `None` if there is none of this scene with these times and this integrator
/// that traced all of its layers, each cell with the same samples (not towards a target, nor out of time).
/// `texels`: those that surface touches.
pub fn predict(prepared: &Prepared, out: &Path, texels: usize) -> Option<Prediction> {
    let run: Outcome = serde_json::from_slice(&std::fs::read(out.join(RUN_FILE)).ok()?).ok()?;
    let hours = prepared.plan.times.iter().map(|time| time.hour);
    let is_like = run.scene == prepared.scene.name
        && run.integrator == prepared.integrator
        && run.denoised.is_some() == prepared.denoise.is_some()
        && run.layers.reused == 0
        && hours.eq(run.hours.iter().copied());
    let ((_, worst), all) = (run.worst_hour().filter(|_| is_like)?, run.local.all?);
    let earlier = Earlier {
        rounds: &run.rounds,
        median: all.median,
        p95: worst.p95,
        power: if run.denoised.is_some() { POWER_DENOISED } else { 0.5 },
        more_texels: texels as f64 / run.texels.max(1) as f64,
    };
    let from_samples = earlier.samples()?;
    let target = prepared.limits.target_error.map(|error| earlier.at(earlier.samples_for(error)));
    let samples = if prepared.limits.have_target() { from_samples } else { prepared.limits.samples };
    let points = STEPS.iter().map(|step| earlier.at(f64::from(samples) * step)).collect();
    Some(Prediction { from_samples, points, target })
}

/// What counts of the earlier bake.
struct Earlier<'a> {
    rounds: &'a [Round],
    median: f64,
    p95: f64,
    /// By which its errors fall with samples.
    power: f64,
    /// Texels of the bake to come, to one of the earlier.
    more_texels: f64,
}

impl Earlier<'_> {
    /// Those of every cell; `None` if some stopped early.
    fn samples(&self) -> Option<u32> {
        let is_even = |round: &Round| !round.is_late && !round.is_missed && round.unconverged_cells == 0;
        let last = self.rounds.last().filter(|last| last.samples > 0)?;
        self.rounds.iter().all(is_even).then_some(last.samples)
    }

    fn samples_for(&self, error: f64) -> f64 {
        let last = self.rounds.last().map_or(0, |last| last.samples);
        f64::from(last) * (self.p95 / error).powf(1.0 / self.power)
    }

    fn at(&self, samples: f64) -> Point {
        let (first, last) = (&self.rounds[0], &self.rounds[self.rounds.len() - 1]);
        let samples = samples.round().clamp(1.0, f64::from(u32::MAX));
        // The first round holds what does not depend on samples: the cache, and pilot samples.
        let slope = match last.samples.saturating_sub(first.samples) {
            0 => last.seconds / f64::from(last.samples),
            samples => (last.seconds - first.seconds) / f64::from(samples),
        };
        let seconds = last.seconds + slope * (samples - f64::from(last.samples));
        let less = (samples / f64::from(last.samples)).powf(-self.power);
        Point {
            samples: samples as u32,
            seconds: seconds.max(0.0) * self.more_texels,
            median: self.median * less,
            p95: self.p95 * less,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round(samples: u32, seconds: f64) -> Round {
        Round { samples, seconds, ..Round::default() }
    }

    fn earlier(rounds: &[Round], more_texels: f64) -> Earlier<'_> {
        Earlier { rounds, median: 0.02, p95: 0.1, power: 0.5, more_texels }
    }

    #[test]
    fn seconds_are_linear_in_samples_and_errors_fall_with_their_root() {
        let rounds = [round(8, 4.0), round(64, 11.0)];
        let bake = earlier(&rounds, 1.0);
        assert_eq!(bake.samples(), Some(64));
        assert_eq!(bake.at(64.0), Point { samples: 64, seconds: 11.0, median: 0.02, p95: 0.1 });
        assert_eq!(bake.at(256.0), Point { samples: 256, seconds: 35.0, median: 0.01, p95: 0.05 });
        assert_eq!(earlier(&rounds, 4.0).at(64.0).seconds, 44.0);
        // By a single round, all of it goes with the samples.
        assert_eq!(earlier(&[round(32, 8.0)], 1.0).at(64.0).seconds, 16.0);
    }

    #[test]
    fn a_target_takes_the_samples_that_reach_it() {
        let rounds = [round(8, 4.0), round(64, 11.0)];
        let bake = earlier(&rounds, 1.0);
        assert!((bake.samples_for(0.05) - 256.0).abs() < 1e-9);
        assert_eq!(bake.at(bake.samples_for(0.05)), bake.at(256.0));
        // However small, it stays a number.
        assert_eq!(bake.at(bake.samples_for(1e-300)).samples, u32::MAX);
        assert_eq!(Earlier { p95: 0.0, ..bake }.samples_for(0.05), 0.0);
    }

    #[test]
    fn nothing_is_predicted_from_cells_that_stopped_early_or_from_nonsense() {
        let early = Round { unconverged_cells: 3, ..round(16, 4.0) };
        assert_eq!(earlier(&[early, round(64, 11.0)], 1.0).samples(), None);
        assert_eq!(earlier(&[], 1.0).samples(), None);
        assert_eq!(earlier(&[round(64, 1.0), round(0, 2.0)], 1.0).samples(), None);
        // Rounds that fall were written by nobody; they give no panic.
        assert_eq!(earlier(&[round(64, 1.0), round(16, 2.0)], 1.0).at(32.0).seconds, 4.0);
    }
}
