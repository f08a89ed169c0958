//! Error against run time of a bake to come, by the rounds of an earlier one.

use super::existing::RUN;
use super::options::Outcome;
use super::prepare::Prepared;
use super::rounds::Round;
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
}

/// A bake with so many samples.
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

/// By the bake that lies in `out`; `None` if there is none of this scene with these times and this
/// integrator, or if its cells got different numbers of samples (towards a target, or out of time).
/// `texels`: those that surface touches.
pub fn predict(prepared: &Prepared, out: &Path, texels: usize) -> Option<Prediction> {
    let run: Outcome = serde_json::from_slice(&std::fs::read(out.join(RUN)).ok()?).ok()?;
    let hours = prepared.plan.times.iter().map(|time| time.hour);
    let is_like = run.scene == prepared.scene.name
        && run.integrator == prepared.integrator
        && run.denoised.is_some() == prepared.denoise.is_some()
        && hours.eq(run.hours.iter().copied());
    let ((_, worst), all) = (run.worst_hour().filter(|_| is_like)?, run.local.all?);
    let power = if run.denoised.is_some() { POWER_DENOISED } else { 0.5 };
    let errors = [all.median, worst.p95];
    let more_texels = texels as f64 / run.texels.max(1) as f64;
    let points = points(&run.rounds, errors, power, prepared.limits.samples, more_texels)?;
    Some(Prediction { from_samples: run.samples, points })
}

fn points(
    rounds: &[Round],
    [median, p95]: [f64; 2],
    power: f64,
    samples: u32,
    more_texels: f64,
) -> Option<Vec<Point>> {
    let (first, last) = (rounds.first()?, rounds.last()?);
    // (A cell that stopped early has fewer samples than the round.)
    if rounds.iter().any(|round| round.is_late || round.is_missed || round.unconverged_cells > 0) {
        return None;
    }
    // The first round holds what does not depend on samples: the cache, and pilot samples.
    let slope = match last.samples - first.samples {
        0 => last.seconds / f64::from(last.samples),
        samples => (last.seconds - first.seconds) / f64::from(samples),
    };
    let at = |step: &f64| {
        let samples = (f64::from(samples) * step).round().max(1.0);
        let before = f64::from(last.samples);
        let less = (samples / before).powf(-power);
        let seconds = (last.seconds + slope * (samples - before)).max(0.0) * more_texels;
        Point { samples: samples as u32, seconds, median: median * less, p95: p95 * less }
    };
    Some(STEPS.iter().map(at).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round(samples: u32, seconds: f64) -> Round {
        Round { samples, seconds, ..Round::default() }
    }

    fn predicted(rounds: &[Round], more_texels: f64) -> Option<Vec<Point>> {
        points(rounds, [0.02, 0.1], 0.5, 64, more_texels)
    }

    #[test]
    fn seconds_are_linear_in_samples_and_errors_fall_with_their_root() {
        let rounds = [round(8, 4.0), round(64, 11.0)];
        let points = predicted(&rounds, 1.0).unwrap();
        let samples: Vec<u32> = points.iter().map(|point| point.samples).collect();
        assert_eq!(samples, [16, 32, 64, 128, 256]);
        assert_eq!(points[2], Point { samples: 64, seconds: 11.0, median: 0.02, p95: 0.1 });
        assert_eq!(points[4], Point { samples: 256, seconds: 35.0, median: 0.01, p95: 0.05 });
        assert_eq!(predicted(&rounds, 4.0).unwrap()[2].seconds, 44.0);
        // By a single round, all of it goes with the samples.
        assert_eq!(predicted(&[round(32, 8.0)], 1.0).unwrap()[2].seconds, 16.0);
    }

    #[test]
    fn nothing_is_predicted_from_cells_that_stopped_early() {
        let early = Round { unconverged_cells: 3, ..round(16, 4.0) };
        assert_eq!(predicted(&[early, round(64, 11.0)], 1.0), None);
        assert_eq!(predicted(&[], 1.0), None);
    }
}
