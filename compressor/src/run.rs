//! What both commands do: compress, read the written bundle back, evaluate and report it.

use crate::compress::{Options, Outcome, Rate, compress};
use crate::decode::Decoder;
use crate::evaluate::{Evaluation, Measures, evaluate};
use crate::report;
use crate::{Result, of_bundle};
use dataset::observe::Observer;
use dataset::store::Dataset;
use reports::Section;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// A bundle that was written and evaluated.
#[derive(Debug)]
pub struct Judged {
    /// What compressing did.
    pub outcome: Outcome,
    /// How the written bundle compares with the dataset.
    pub evaluation: Evaluation,
    /// The quality table and its remarks, line by line.
    pub table: Vec<String>,
    /// What the report shows first: the scene and a summary.
    pub lead: Section,
    /// The report's sections, in order.
    pub sections: Vec<Section>,
    /// Wall-clock seconds of compressing and judging.
    pub seconds: f64,
}

/// Compresses the dataset in `root`, decodes the written bundle, and evaluates it.
///
/// # Errors
/// As [`compress`] and [`evaluate`].
pub fn compress_and_judge(root: &Path, options: &Options, observer: &dyn Observer) -> Result<Judged> {
    let start = Instant::now();
    let outcome = compress(root, options, observer)?;
    if outcome.up_to_date {
        let path = outcome.bundle.display();
        observer.say(format!("{path} is up to date (--force retrains it)"));
    }
    let dataset = Dataset::open(root)?;
    let decoder = Decoder::open(&outcome.bundle).map_err(of_bundle)?;
    let evaluation = evaluate(&dataset, &decoder, Measures::default(), observer)?;
    let mut remarks: Vec<String> =
        quantisation(&outcome).into_iter().chain(steps(options, &outcome)).collect();
    let missed = missed(options.rate, &evaluation);
    match &missed {
        Some((what, true)) => observer.warn(what),
        Some((what, false)) => remarks.push(what.clone()),
        None => {}
    }
    let table = evaluation.lines().into_iter().chain(remarks.iter().cloned()).collect();
    let missed = missed.filter(|(_, is_far)| *is_far).map(|(what, _)| what);
    let (lead, shows_scene) = report::lead(&dataset, &decoder, &outcome, &evaluation, missed.as_deref())?;
    remarks.extend(missed);
    let pictures = report::pictures(&dataset, &decoder)?;
    let sections = vec![
        // Without a picture of the scene, the pages' pictures are not folded.
        if shows_scene { pictures.folded() } else { pictures },
        report::seen(&dataset, &decoder, &evaluation)?.folded(),
        report::quality(&evaluation, &remarks).folded(),
        report::training(&outcome).folded(),
        report::omitted(&outcome, evaluation.sun_is_omitted).folded(),
    ];
    Ok(Judged { outcome, evaluation, table, lead, sections, seconds: start.elapsed().as_secs_f64() })
}

/// What quantisation cost.
fn quantisation(outcome: &Outcome) -> Option<String> {
    let (unquantised, stored) = outcome.psnr_unquantised_db.zip(outcome.psnr_trained_db)?;
    Some(format!(
        "PSNR of the maps, mean over tiles weighted by their texels: {unquantised:.2} dB with unquantised features, {:.2} dB with 8-bit features, {stored:.2} dB \
         as stored, in BC7",
        outcome.psnr_8bit_features_db?
    ))
}

/// The remark on training steps under a time limit.
fn steps(options: &Options, outcome: &Outcome) -> Option<String> {
    options.time_limit?;
    let [least, most] = outcome.steps?;
    (least < options.iterations).then(|| {
        format!(
            "steps per tile: {least} to {most}, of at most {}; under a time limit, another run can give different bytes",
            options.iterations
        )
    })
}

/// Largest shortfall in dB below a target PSNR without a warning: trial fits do not predict it more closely.
const NEAR_DB: f64 = 0.5;
/// Largest excess in dB above it without a remark.
const FAR_DB: f64 = 1.0;

/// The remark on a missed target, and true if it was missed by more than expected.
fn missed(rate: Rate, evaluation: &Evaluation) -> Option<(String, bool)> {
    match rate {
        Rate::Psnr(target) => {
            let reached = evaluation.all.psnr_pooled_db?;
            if reached > target + FAR_DB {
                let why = "even the smallest configurations exceed the target, or training gained more than the measured tiles predicted";
                return Some((format!("--target-psnr {target}: reached {reached:.2} dB: {why}"), false));
            }
            if reached >= target {
                return None;
            }
            let what = format!(
                "--target-psnr {target}: reached {reached:.2} dB, less than the trial fits predicted"
            );
            Some(match reached < target - NEAR_DB {
                true => (format!("{what}, or the most that the largest configurations give"), true),
                false => (what, false),
            })
        }
        Rate::Bpp(target) if evaluation.bpp > target => {
            let what = format!(
                "--target-bpp {target}: the smallest configurations take {:.3} bits per texel and frame; raise the target",
                evaluation.bpp
            );
            Some((what, true))
        }
        _ => None,
    }
}

impl Judged {
    /// The `--json` object of `compress`: that of `compress evaluate` and what only training knows.
    pub fn json(&self) -> Value {
        let mut object = self.evaluation.json();
        let outcome = &self.outcome;
        object["bundle"] = json!(outcome.bundle);
        object["psnr_unquantised_db"] = json!(outcome.psnr_unquantised_db);
        object["psnr_8bit_features_db"] = json!(outcome.psnr_8bit_features_db);
        object["tiles"] = json!(outcome.tiles);
        object["tiles_empty"] = json!(outcome.empty);
        object["up_to_date"] = json!(outcome.up_to_date);
        object["tiles_resumed"] = json!(outcome.resumed);
        object["steps_min"] = json!(outcome.steps.map(|steps| steps[0]));
        object["steps_max"] = json!(outcome.steps.map(|steps| steps[1]));
        object["seconds"] = json!(self.seconds);
        object["training_cpu_seconds"] = json!(outcome.training_seconds);
        object
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{Large, Quality, Steps};

    #[test]
    fn a_target_missed_by_little_is_a_remark() {
        let all = Quality { psnr_pooled_db: Some(39.7), ..Quality::default() };
        let evaluation = Evaluation {
            samples: vec![],
            sunny: None,
            without_sun: None,
            sun_is_omitted: false,
            all,
            by_hour: vec![],
            mean_light: vec![],
            worst_hour: None,
            worst_tile: None,
            converged: None,
            scene_flip: None,
            distinct: all,
            distinct_frames: 0,
            bpp: 0.5,
            bits_of_valid: [0.7; 2],
            bytes_of_sun: 0,
            bytes_of_shadows: 0,
            tiles: 1,
            bytes: 1,
            seam_ratio: None,
            large: Large::default(),
            steps: Steps::default(),
            shadows: None,
            between: None,
            decode_seconds: 0.0,
        };
        let missed = |rate| missed(rate, &evaluation);
        assert_eq!(missed(Rate::Psnr(39.6)), None);
        let above = missed(Rate::Psnr(38.6));
        assert!(above.is_some_and(|(what, is_far)| what.contains("gained more") && !is_far));
        let near = missed(Rate::Psnr(40.0));
        assert!(near.is_some_and(|(what, is_far)| what.contains("reached 39.70 dB") && !is_far));
        assert!(missed(Rate::Psnr(40.3)).is_some_and(|(_, is_far)| is_far));
        assert_eq!(missed(Rate::Bpp(0.5)), None);
        assert!(missed(Rate::Bpp(0.49)).is_some_and(|(_, is_far)| is_far));
    }
}
