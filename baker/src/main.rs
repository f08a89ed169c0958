//! `bake`: from a scene file to a dataset of temporal lightmaps, and with `--compress` on to a bundle.

use baker::bake::run::{Options, Outcome, bake};
use baker::light::schedule::parse_hours;
use clap::Parser;
use compressor::compress::{DRAFT_ITERATIONS, ITERATIONS, Options as CompressOptions};
use compressor::run::compress_and_judge;
use dataset::console::{self, Console, ConsoleArgs};
use dataset::report::{Report, preview};
use dataset::store::Dataset;
use dataset::{Error, Result};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Bakes temporal lightmaps: HDR irradiance of a scene at every hour, and on both sides of every light switch.
#[derive(Parser)]
#[command(version, after_help = EXAMPLES)]
struct Args {
    /// The scene file (TOML; every key is described in scenes/README.md).
    scene: PathBuf,
    /// Hours to bake: a half-open range, a range with a step, or a list.
    #[arg(long, default_value = "0..24", value_name = "HOURS")]
    hours: String,
    /// Hand the dataset to the compressor (profile M), write the bundle and measure it.
    #[arg(long)]
    compress: bool,
    /// A quick look: half the lightmap's side, a quarter of the samples, short training.
    #[arg(long)]
    draft: bool,
    /// Samples per texel, a power of two [default: the scene's].
    #[arg(long, value_name = "N")]
    samples: Option<u32>,
    /// Folder of the dataset [default: dataset/<scene>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Start over, whatever an earlier run left.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    console: ConsoleArgs,
}

const EXAMPLES: &str = "\
Examples:
  bake scenes/yard.toml --hours 0..24              24 hourly sets and the switch extras into dataset/yard
  bake scenes/yard.toml --hours 0..24 --compress   the same, then dataset/yard/yard.ndgi and a report
  bake scenes/yard.toml --hours 12                 one set
  bake scenes/yard.toml --hours 6..18/0.5 --draft  half-hourly, quickly
  bake scenes/yard.toml --hours 5.5,12,18:30 --out /data/look

With --json, one object on stdout: scene, dataset, up_to_date, size, sets, texels, samples, relative_error (median
over tile and set), seconds, rays, rounds (error against seconds), facts, left_out, warnings, report, and with
--compress an object `compress` with the keys of `compress --json`.

A run that is interrupted or killed continues when started again with the same arguments.";

fn main() -> ExitCode {
    let args = Args::parse();
    console::catch_interrupts();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => console::fail(&error),
    }
}

fn run(args: &Args) -> Result<()> {
    let console = Console::new(args.console);
    let hours = parse_hours(&args.hours).map_err(|what| Error::invalid("--hours", what))?;
    let options =
        Options { hours, samples: args.samples, draft: args.draft, out: args.out.clone(), force: args.force };
    let outcome = bake(&args.scene, &options, &console)?;
    let set = Dataset::open(&outcome.dataset)?;
    let mut report = Report::new(&format!("{}: temporal lightmaps", outcome.scene));
    report.push(preview::section(&set)?);
    report.push(baker::report::section(&outcome));
    say(&outcome, &console);

    let mut result = serde_json::to_value(&outcome).map_err(|e| Error::invalid("result", e))?;
    if args.compress {
        let iterations = if args.draft { DRAFT_ITERATIONS } else { ITERATIONS };
        let options = CompressOptions { iterations, force: args.force, ..CompressOptions::default() };
        let judged = compress_and_judge(&outcome.dataset, &options, &console)?;
        console.say(format!("bundle: {}", judged.outcome.bundle.display()));
        result["compress"] = judged.json();
        judged.sections.into_iter().for_each(|section| report.push(section));
    }
    let path = outcome.dataset.join("report.html");
    // Nothing new: a report that stands there may tell more, of the compressor too.
    if args.compress || !outcome.up_to_date || !path.exists() {
        report.write(&path)?;
    }
    console.say(format!("report: {}", path.display()));
    result["report"] = json!(path);
    console.result(&result)?;
    Ok(())
}

fn say(outcome: &Outcome, console: &Console) {
    console.say(format!(
        "{}: {} sets of {} × {} texels in {:.1} s, estimated relative error {:.2} %",
        outcome.dataset.display(),
        outcome.sets,
        outcome.size[0],
        outcome.size[1],
        outcome.seconds,
        outcome.relative_error * 100.0
    ));
    for reason in &outcome.left_out {
        console.say(format!("  left out: {reason}"));
    }
}
