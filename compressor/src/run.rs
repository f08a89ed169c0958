//! The whole command: compress, read the written bundle back, judge it, and tell.

use crate::Result;
use crate::compress::{Options, Outcome, Rate, compress};
use crate::decode::Decoder;
use crate::evaluate::{Evaluation, evaluate};
use crate::report;
use dataset::console::Console;
use dataset::report::Section;
use dataset::store::Dataset;
use serde_json::{Value, json};
use std::path::Path;

/// A bundle that was written and judged.
#[derive(Debug)]
pub struct Judged {
    /// What compressing did.
    pub outcome: Outcome,
    /// How the written bundle compares with the dataset.
    pub evaluation: Evaluation,
    /// The report's sections, in order.
    pub sections: Vec<Section>,
}

/// Compresses the dataset in `root`, decodes the written bundle, evaluates it and prints the quality table.
///
/// # Errors
/// As [`compress`] and [`evaluate`].
pub fn compress_and_judge(root: &Path, options: &Options, console: &Console) -> Result<Judged> {
    let outcome = compress(root, options, console)?;
    if outcome.resumed > 0 {
        console.say(format!("{} of {} tiles taken over from an earlier run", outcome.resumed, outcome.tiles));
    }
    let dataset = Dataset::open(root)?;
    let decoder = Decoder::open(&outcome.bundle)?;
    let evaluation = evaluate(&dataset, None, &decoder, console)?;
    print(&evaluation, console);
    let missed = missed(options.rate, &evaluation);
    missed.iter().for_each(|what| console.warn(what));
    let sections = vec![
        report::training(&outcome),
        report::quality(&evaluation, missed.as_deref()),
        report::pictures(&dataset, &decoder)?,
        report::left_out(&outcome),
    ];
    Ok(Judged { outcome, evaluation, sections })
}

/// A pooled PSNR may be so far below its target: brief trials do not tell it closer.
const NEAR_DB: f64 = 0.5;

/// What to say where a target was not reached.
fn missed(rate: Rate, evaluation: &Evaluation) -> Option<String> {
    match rate {
        Rate::Psnr(target) => {
            let reached = evaluation.all.psnr_pooled_db.filter(|db| *db < target - NEAR_DB)?;
            Some(format!(
                "--target-psnr {target}: {reached:.2} dB were reached, less than brief trials foretold, or the most that the dearest of \
                 them give"
            ))
        }
        Rate::Bpp(target) if evaluation.bpp > target => Some(format!(
            "--target-bpp {target}: {:.3} bits are the least that the tiles with light take at this size",
            evaluation.bpp
        )),
        _ => None,
    }
}

/// Prints the quality table and its remarks.
pub fn print(evaluation: &Evaluation, console: &Console) {
    for line in evaluation.table().into_iter().chain(evaluation.remarks()) {
        console.print(line);
    }
}

impl Judged {
    /// The `--json` object of `compress`: that of `compress evaluate` and what only training knows.
    pub fn json(&self) -> Value {
        let mut object = self.evaluation.json();
        let outcome = &self.outcome;
        object["bundle"] = json!(outcome.bundle);
        object["psnr_unquantised_db"] = json!(outcome.psnr_unquantised_db);
        object["tiles"] = json!(outcome.tiles);
        object["tiles_empty"] = json!(outcome.empty);
        object["tiles_resumed"] = json!(outcome.resumed);
        object["seconds"] = json!(outcome.seconds);
        object["training_cpu_seconds"] = json!(outcome.training_seconds);
        object
    }
}
