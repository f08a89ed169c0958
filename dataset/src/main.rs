//! `dataset`: looks at temporal lightmap sets.

use clap::{Parser, Subcommand};
use dataset::config::Config;
use dataset::console::{Console, ConsoleArgs, catch_interrupts, count, fail};
use dataset::store::Dataset;
use dataset::{Error, Result};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Looks at temporal lightmap sets: what is in one, and whether it is whole.
#[derive(Parser)]
#[command(
    version,
    after_help = "\
Examples:
  dataset info dataset/yard            scene, pages, hours, light groups, sizes
  dataset check dataset/yard           every checksum, every texel; names each fault
  dataset check dataset/yard --json    the same for a program; exit code 1 with faults"
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    console: ConsoleArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Prints what a set holds.
    ///
    /// With --json, one object: scene, generator, unit, seed, samples, files, bytes, pages [{width, height,
    /// valid_texels}], groups [{name, on, layers}], sets [{hour, on, relative_error}].
    #[command(after_help = "Example:\n  dataset info dataset/yard --json")]
    Info {
        /// The folder that holds config.json.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Verifies everything a consumer relies on, and names each fault.
    ///
    /// Checks the manifest, each file's length and checksum, masks, the noise file, that all texels are finite and not
    /// negative, and, where layers are kept, that each lightmap is (sun + sky) + local bit for bit.
    /// With --json, one object: ok, faults [text], files, bytes, sets, dead_texels [per page; null where unknown], seconds.
    #[command(after_help = "Example:\n  dataset check dataset/yard")]
    Check {
        /// The folder that holds config.json.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    catch_interrupts();
    let console = Console::new(arguments.console);
    let result = match &arguments.command {
        Command::Info { folder } => info(&console, folder).map(|()| ExitCode::SUCCESS),
        Command::Check { folder } => check(&console, folder),
    };
    result.unwrap_or_else(|error| fail(&error))
}

fn info(console: &Console, folder: &Path) -> Result<()> {
    let dataset = Dataset::open(folder)?;
    let config = &dataset.config;
    let valid: Vec<usize> = (0..config.pages.len())
        .map(|page| dataset.mask(page).map(|mask| mask.count()))
        .collect::<Result<_>>()?;
    let (files, bytes) = extent(&dataset);

    console.print(format!("{}: written by {}, seed {}", config.scene, config.generator, config.seed));
    for (page, valid) in config.pages.iter().zip(&valid) {
        let share = 100.0 * *valid as f64 / (f64::from(page.width) * f64::from(page.height));
        console.print(format!("  page   {}×{} texels, {share:.1} % on surfaces", page.width, page.height));
    }
    for group in &config.groups {
        let on: Vec<String> = group.on.iter().map(|[from, to]| format!("{from} to {to} h")).collect();
        let on = if on.is_empty() { "never on".to_owned() } else { format!("on {}", on.join(", ")) };
        console.print(format!("  lights {}: {on}", group.name));
    }
    for set in &config.sets {
        let on = names_on(config, &set.groups_on);
        let on = if on.is_empty() { "no lamp".to_owned() } else { on.join(", ") };
        let error =
            set.relative_error.map_or(String::new(), |error| format!("  error {:.2} %", 100.0 * error));
        console.print(format!("  set    {:>7} h  {on}{error}", set.hour));
    }
    console.print(format!("  {}, {:.1} MB; unit: {}", count(files, "file"), bytes as f64 / 1e6, config.unit));

    let sets = config.sets.iter().map(|set| {
        json!({ "hour": set.hour, "on": names_on(config, &set.groups_on), "relative_error": set.relative_error })
    });
    let pages =
        config.pages.iter().zip(&valid).map(
            |(page, valid)| json!({ "width": page.width, "height": page.height, "valid_texels": valid }),
        );
    let groups = config
        .groups
        .iter()
        .map(|group| json!({ "name": group.name, "on": group.on, "layers": !group.layers.is_empty() }));
    console.result(&json!({
        "scene": config.scene,
        "generator": config.generator,
        "unit": config.unit,
        "seed": config.seed,
        "samples": config.samples,
        "files": files,
        "bytes": bytes,
        "pages": pages.collect::<Vec<_>>(),
        "groups": groups.collect::<Vec<_>>(),
        "sets": sets.collect::<Vec<_>>(),
    }))?;
    Ok(())
}

fn check(console: &Console, folder: &Path) -> Result<ExitCode> {
    let start = std::time::Instant::now();
    // Lengths are part of the check, so that one missing file does not hide the others.
    let (opened, verification) = match Dataset::open_manifest(folder) {
        Ok(dataset) => {
            let progress = console.progress("checking", dataset.verify_steps() as u64);
            let verification = dataset.verify(|| progress.advance(1));
            (Some(dataset), verification)
        }
        Err(fault @ (Error::Invalid { .. } | Error::Unsupported { .. })) => {
            let faults = vec![fault];
            (None, dataset::store::Verification { faults, dead_texels: Vec::new() })
        }
        Err(error) => return Err(error),
    };
    if dataset::console::interrupted() {
        return Err(Error::Interrupted);
    }
    for fault in &verification.faults {
        console.error(fault);
    }
    for (page, dead) in verification.dead_texels.iter().enumerate() {
        if let Some(dead @ 1..) = dead {
            console.say(format!(
                "page {page}: black in every set though on a surface: {}",
                count(*dead, "texel")
            ));
        }
    }
    let (files, bytes) = opened.as_ref().map_or((0, 0), extent);
    let sets = opened.as_ref().map_or(0, |dataset| dataset.config.sets.len());
    let faults: Vec<String> = verification.faults.iter().map(ToString::to_string).collect();
    let ok = faults.is_empty();
    let found = match ok {
        true => format!("{}, {}: no fault", count(sets, "set"), count(files, "file")),
        false => count(faults.len(), "fault"),
    };
    console.say(format!("{}: {found}", folder.display()));
    console.result(&json!({
        "ok": ok,
        "faults": faults,
        "files": files,
        "bytes": bytes,
        "sets": sets,
        "dead_texels": verification.dead_texels,
        "seconds": start.elapsed().as_secs_f64(),
    }))?;
    Ok(if ok { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Names of the groups that are on.
fn names_on<'a>(config: &'a Config, on: &[bool]) -> Vec<&'a str> {
    config.groups.iter().zip(on).filter(|(_, on)| **on).map(|(group, _)| &*group.name).collect()
}

/// Number and total length of the files the manifest names, each counted once.
fn extent(dataset: &Dataset) -> (usize, u64) {
    let distinct: BTreeMap<&str, u64> = dataset.files().map(|file| (&*file.path, file.bytes)).collect();
    (distinct.len(), distinct.values().sum())
}
