//! `bake`: from a scene file to a dataset of temporal lightmaps, and with `--compress` on to a bundle.

mod report;

use baker::bake::errors::LocalErrorSummary;
use baker::bake::forecast::{
    DiskSpace, ESCAPE_RAYS, Forecast, LayoutEstimate, forecast, in_words as bytes, mistakes, scale, views,
};
use baker::bake::output::{Point, Prediction, REPORT_FILE, predict, replacement_note, skipped, unwrapped};
use baker::bake::prepare::hour;
use baker::bake::run::{Denoise, Integrator, Options, Outcome, Preset, bake, prepare};
use baker::bake::store::Charts;
use baker::light::times::extra_times::{self, percent};
use baker::light::times::schedule::parse_hours;
use baker::preview::options::{HELP, Options as PreviewOptions};
use baker::preview::run::preview;
use baker::starter;
use baker::trace::rays::Backend;
use clap::{Parser, Subcommand};
use commands::console::{self, Console, ConsoleArgs};
use commands::typed;
use compressor::bundle::Bundle;
use compressor::compress::{DRAFT, MEDIUM, Options as CompressOptions, default_bundle, light_of};
use compressor::run::compress_and_judge;
use compressor::view::write_into_dataset;
use dataset::observe::count;
use dataset::store::Dataset;
use dataset::{Error, Result};
use reports::{self as page, Report, Section};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Bakes temporal lightmaps: HDR irradiance of a scene at every hour, and just before and after each light
/// switch.
#[derive(Parser)]
#[command(name = "bake", version, after_help = EXAMPLES, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    bake: Args,
    #[command(flatten)]
    console: ConsoleArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Draw the baked light from any viewpoint at any hour.
    #[command(after_help = HELP)]
    Preview {
        /// The scene file that was baked.
        scene: PathBuf,
        #[command(flatten)]
        options: PreviewOptions,
    },
    /// Write a scene file for models: their unit, windows and cameras as far as they can be guessed.
    #[command(after_help = starter::HELP)]
    New {
        /// The models: .glb, .gltf or .obj files.
        #[arg(required = true, value_name = "MODEL")]
        models: Vec<PathBuf>,
        #[command(flatten)]
        options: starter::Options,
    },
}

#[derive(clap::Args)]
struct Args {
    /// The scene file (TOML; every key is described in scenes/README.md).
    #[arg(required = true)]
    scene: Option<PathBuf>,
    /// Hours to bake: 0..24 (24 excluded), 6..18/0.5 or 5.5,12,18:30.
    #[arg(long, default_value = "0..24", value_name = "HOURS", allow_hyphen_values = true)]
    hours: String,
    /// Bake up to N additional times where interpolating sunlight and skylight between the hours of a range
    /// would err by more than 5 %, as at dusk. They are chosen before any ray is traced; --plan lists them.
    /// 0: none.
    #[arg(long, value_name = "N", default_value_t = extra_times::MOST_EXTRA_TIMES)]
    extra_times: u32,
    /// Bake the scene under each spherical harmonic of bands 0 to 3 instead of its own sun, sky and lamps,
    /// into dataset/<scene>-transfer: what `compress compare DATASET --transfer` needs for its comparison
    /// with precomputed radiance transfer.
    #[arg(long, conflicts_with_all = ["hours", "compress"])]
    transfer: bool,
    /// Of sunlight, bake only what surfaces reflect, for games that draw the sun themselves: as
    /// `baked = "indirect"` under [sun].
    #[arg(long, conflicts_with = "transfer")]
    indirect: bool,
    /// Also compress the dataset with default settings (with --draft: preset draft): writes the bundle, its
    /// quality into the report, and the page <scene>.view.html.
    #[arg(long)]
    compress: bool,
    /// A quick look: half the lightmap's side, a quarter of the samples.
    #[arg(long)]
    draft: bool,
    /// For shipping: twice the lightmap's side, twice the samples (no effect on --compress; see
    /// `compress --preset`).
    #[arg(long, conflicts_with = "draft")]
    r#final: bool,
    /// Average samples of indirect light per texel, a power of two. With a target error or a time limit: the
    /// maximum [default: the scene's; 65536 with a target or a limit].
    #[arg(long, value_name = "N")]
    samples: Option<u32>,
    /// Stop when, at every time, 95 % of the texels lie in converged cells: cells of 16×16 texels whose local
    /// error is below ERROR, e.g. 5%, as is that of the 5×5 cells around together. Local error is the
    /// standard error divided by the cell's own light, or by 1/30 of the median light visible from it if that
    /// is larger. In a gap with less than 25 cm of room, the light visible from its opening counts. The
    /// decision is made after denoising. Light that very few paths find (a pinhole) can be missed.
    #[arg(long, value_name = "ERROR", value_parser = parse_error)]
    target_error: Option<f64>,
    /// Stop tracing after this time, e.g. 90s, 5m, 2h, but not before the first round is complete. The
    /// remaining error is reported.
    #[arg(long, value_name = "TIME", value_parser = typed::time_limit)]
    time_limit: Option<Duration>,
    /// How light is traced beyond the first surface.
    #[arg(long, value_enum, default_value = "cached")]
    integrator: Integrator,
    /// Ray-tracing backend: obvhs (built in), or embree in builds with that feature.
    #[arg(long, default_value = "obvhs", value_name = "BACKEND")]
    backend: Backend,
    /// Denoise indirect light: auto, or off (own is the same as auto). Transfers are never
    /// denoised. The traced light is kept, so changing this traces nothing again unless a --target-error is
    /// then missed.
    #[arg(
        long,
        value_enum,
        default_value = "auto",
        value_name = "auto|off|own",
        hide_possible_values = true
    )]
    denoise: Denoise,
    /// Retrace 512 texels with N unbiased paths each (4096 if N is omitted) and report the measured error.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "4096", value_parser = clap::value_parser!(u32).range(2..))]
    check: Option<u32>,
    /// Print what would be traced, what is skipped and why, and estimates of disk and memory; bake nothing.
    #[arg(long)]
    plan: bool,
    /// Folder of the dataset [default: dataset/<scene>, with --transfer dataset/<scene>-transfer].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Discard all earlier work in the output folder, and replace its dataset even if that has more hours,
    /// samples or texels, or is of another scene.
    #[arg(long)]
    force: bool,
}

const EXAMPLES: &str = "\
Examples:
  bake scenes/yard.toml --hours 0..24              24 hourly frames, 6 extra ones, and those at switches, in dataset/yard
  bake scenes/yard.toml --hours 0..24 --compress   the same, then dataset/yard/yard.ndgi and a report
  bake scenes/yard.toml --hours 12 --draft --out /data/look   one frame, quickly, elsewhere
  bake scenes/yard.toml --final --out /data/yard   for shipping: twice the side, twice the samples
  bake scenes/yard.toml --hours 6..18/0.5 --out /data/day     half-hourly
  bake scenes/yard.toml --hours 5.5,12,18:30 --out /data/three
  bake scenes/yard.toml --extra-times 12           up to 12 extra times, mostly at dawn and dusk; 0: none
  bake scenes/yard.toml --target-error 5% --time-limit 5m   whichever is reached first
  bake scenes/yard.toml --indirect                 without the sun's direct light, for games that draw it themselves
  bake scenes/yard.toml --transfer                 its surfaces lit by spherical harmonics, into dataset/yard-transfer
  bake scenes/yard.toml --plan                     what would be traced, what is skipped and why
  bake preview scenes/yard.toml --hour 18.5        what was baked, as a picture (bake preview --help)
  bake new models/house.glb                        a scene file for a model (bake new --help)

With --json, one object on stdout: scene, dataset, up_to_date, inputs, hours, integrator, size, pages, frames, texels, samples (of the last round),
mean_samples, layers (traced, reused), denoised (method, layers, new_layers: those filtered by this run, seconds; null if nothing was denoised), relative_error (median over tile and frame), local (error of cells of 16×16 texels relative to the light there:
all, frames, worst_frame, advice; each median, p95, worst, and over: shares above 5, 10 and 20 %), out_of_time, seconds, rays, rounds (error
against seconds), check (with --check; as in run.json), facts, skipped, warnings, report, and with --compress an object `compress` with the keys of
`compress --json`. With --plan: scene, integrator, times, extra_times (added: hour,
error_before and error_after of interpolated light, as a share of it; error_before and error_after of the whole day, null where no light
changes), layers, visibility (of the sun: times, minutes of the finest step; null where it is not found), skipped, existing (what it replaces, or why it is refused), forecast (size, pages, finer: how many times as
wide the texels are in the coarser layout that pages above 2048² are estimated from, else 1; texels covered, skipped_triangles, skipped_area and skipped_rays of faces that nobody can see,
texels_per_metre, extent in metres, dataset_bytes, layers_bytes, work_bytes, peak_bytes: the most of these at once, memory_bytes, escaping_rays: of 4096
rays from surfaces, those that leave the scene), expected (error against run time, by the bake in the dataset's folder: from_samples, points: samples, seconds of tracing, median
and p95 of the local error, that at the worst hour; target: the point that --target-error takes, or null; null if there is no bake with these
times and a fixed number of samples that traced all layers), free_bytes (on the file system of the dataset; null if unknown), warnings.

A run that is interrupted or killed continues when started again with the same arguments. Ctrl-C, SIGTERM and SIGHUP end it within
0.2 s, with exit code 130, 143 or 129. Other exit codes: 0 done; 1 or 2 do not retry (bad input, a bad command
line); 75 retry (another bake writes there, the disk is full). A finished bake keeps its layers: after
a change of a schedule, colour or intensity, or with more hours, only missing layers are traced (and, with --target-error, those
that no longer meet it). --force is needed to replace a dataset by one with fewer hours, samples or texels or of another scene,
and to discard unfinished work with other settings that has completed a round.";

/// `2%` or `0.02`.
fn parse_error(text: &str) -> std::result::Result<f64, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |number| (number, 0.01));
    let value = number.trim().parse::<f64>().ok().map(|v| v * unit);
    value
        .filter(|v| (1e-4..1.0).contains(v))
        .ok_or_else(|| "expected an error from 0.01% to less than 100%, such as 2%".to_owned())
}

fn main() -> ExitCode {
    console::refuse_arguments_not_utf8::<Cli>();
    typed::refuse_misspelt::<Cli>("a scene file");
    let cli = Cli::parse();
    console::catch_interrupts();
    // All layer files of a time are open at once.
    dataset::host::system::allow_more_open_files();
    let console = Console::new(cli.console);
    let done = match cli.command {
        None => run(&cli.bake, &console),
        Some(Command::Preview { scene, options }) => {
            preview(&scene, &options, &console).and_then(|result| console.result(&result))
        }
        Some(Command::New { models, options }) => {
            starter::new(&models, &options, &console).and_then(|result| console.result(&result))
        }
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => console::fail(&error),
    }
}

fn run(args: &Args, console: &Console) -> Result<()> {
    let scene =
        args.scene.as_deref().ok_or_else(|| Error::invalid("command line", "expected a scene file"))?;
    let hours = parse_hours(&args.hours).map_err(|what| Error::invalid("--hours", what))?;
    let preset = match (args.draft, args.r#final) {
        (true, _) => Preset::Draft,
        (_, true) => Preset::Final,
        _ => Preset::Default,
    };
    let options = Options {
        extra_times: args.extra_times,
        transfer: args.transfer,
        indirect: args.indirect,
        samples: args.samples,
        target_error: args.target_error,
        time_limit: args.time_limit,
        integrator: args.integrator,
        backend: args.backend,
        denoise: args.denoise,
        check: args.check,
        preset,
        out: args.out.clone(),
        force: args.force,
        ..Options::new(hours)
    };
    if args.plan {
        return plan(scene, &options, console);
    }
    let outcome = bake(scene, &options, console)?;
    let dataset = Dataset::open(&outcome.dataset)?;
    let mut report = Report::new(&format!("{}: temporal lightmaps", outcome.scene));
    say(&outcome, args.check.is_some(), args.target_error, console);
    if let Some(bundle) = stale_bundle(&dataset).filter(|_| !args.compress) {
        console.warn(format!(
            "{} was compressed from a different bake; run `compress {}` to update it",
            bundle.display(),
            outcome.dataset.display()
        ));
    }

    let mut result = serde_json::to_value(&outcome).map_err(|e| Error::invalid("result", e))?;
    if args.compress {
        let preset = if args.draft { DRAFT } else { MEDIUM };
        let options = CompressOptions { force: args.force, ..CompressOptions::of(preset) };
        let judged = compress_and_judge(&outcome.dataset, &options, console)?;
        // The table is additional: --quiet omits it.
        if !console.quiet {
            judged.table.iter().for_each(|line| console.print(line));
        }
        console.say(format!("bundle: {}", judged.outcome.bundle.display()));
        result["compress"] = judged.json();
        report.lead(judged.lead);
        match write_into_dataset(&outcome.dataset, args.force) {
            Ok(None) => {}
            Ok(Some(page)) => {
                console.say(format!("page: {}", page.display()));
                result["compress"]["page"] = json!(page);
            }
            // (Not worth the loss of what took hours.)
            Err(error @ Error::Invalid { .. }) => console.warn(format!("no page is written: {error}")),
            Err(error) => return Err(error),
        }
        judged.sections.into_iter().for_each(|section| report.push(section));
    } else if !outcome.up_to_date || !outcome.dataset.join(REPORT_FILE).exists() {
        page::scene::section(&dataset)?.into_iter().for_each(|section| report.lead(section));
    }
    // With the compression's summary on top, the other sections start collapsed.
    let fold = |section: Section| if args.compress { section.folded() } else { section };
    report.push(fold(page::preview::section(&dataset)?));
    report.push(fold(report::section(&outcome, &dataset)?));
    let path = outcome.dataset.join(REPORT_FILE);
    // Nothing new: a report that stands there may tell more, of the compressor too.
    if args.compress || !outcome.up_to_date || !path.exists() {
        report.write(&path)?;
    }
    console.say(format!("report: {}", path.display()));
    result["report"] = json!(path);
    console.result(&result)?;
    Ok(())
}

/// The bundle beside a dataset, if it was not made from it.
fn stale_bundle(dataset: &Dataset) -> Option<PathBuf> {
    let path = default_bundle(dataset);
    let bundle = Bundle::open(&path).ok()?;
    (light_of(&bundle.header) != Some(dataset.config.digest_of_light())).then_some(path)
}

/// Prints what a bake would do.
fn plan(scene: &Path, options: &Options, console: &Console) -> Result<()> {
    let prepared = prepare(scene, options, console)?;
    let out = prepared.out(options);
    // First what decides whether the rest matters, which can be long.
    let mut existing = replacement_note(&prepared, options)?;
    existing.iter().for_each(|what| console.print(what));
    let plan = &prepared.plan;
    let layers: Vec<String> = (0..plan.layers()).map(|layer| plan.name_of(layer)).collect();
    console.print(format!(
        "{}: {}, {}, {}, {}{} samples per texel on average, integrator {}",
        prepared.scene.name,
        count(prepared.geometry.triangles.len(), "triangle"),
        count(plan.times.len(), "time"),
        count(layers.len(), "layer"),
        if prepared.limits.have_target() { "up to " } else { "" },
        prepared.limits.samples,
        match prepared.integrator {
            Integrator::Cached => "cached",
            Integrator::Path => "path",
        }
    ));
    let charts = Charts::beside(&out);
    let layout = LayoutEstimate::of(&prepared, &charts)?;
    let unwrapped = unwrapped(charts.counts());
    charts.keep(&out);
    // (What a coarser layout would warn of need not be so in a bake.)
    let (mut of_layout, notes) = match layout.texel_scale == 1 {
        true => (layout.atlas.warnings.clone(), layout.atlas.notes.clone()),
        false => (Vec::new(), layout.in_words().into_iter().collect()),
    };
    of_layout.extend(mistakes::warnings(&prepared, layout.texels_per_metre())?);
    of_layout.iter().for_each(|w| console.warn(w));
    let forecast = forecast(&prepared, &layout)?;
    let (left, free) =
        (DiskSpace::still_needed(&prepared, &layout, &out, options), (options.free_bytes)(&out));
    if existing.is_none()
        && let Err(refused) = left.check_free_space(&out, free)
    {
        let refused = format!("this bake would be refused: {refused}");
        console.print(format!("  {refused}"));
        existing = Some(refused);
    }
    say_forecast(&forecast, free, console);
    let layout = unwrapped.into_iter().chain(skipped(&layout.atlas)).chain(notes);
    layout.for_each(|what| console.print(format!("  {what}")));
    in_short(&layers).iter().for_each(|what| console.print(format!("  trace {what}")));
    plan.extra_times.added.iter().for_each(|time| {
        console.print(format!(
            "  extra time {}: reduces the interpolation error nearby from {} to {}",
            hour(time.hour),
            percent(time.error_before),
            percent(time.error_after)
        ));
    });
    if let Some(visibility_times) = &prepared.visibility_times {
        console.print(format!(
            "  find the sun's visibility at {}, every {} min where it changes",
            count(visibility_times.hours.len(), "time"),
            visibility_times.minutes
        ));
    }
    plan.skipped.iter().for_each(|reason| console.print(format!("  {reason}")));
    let expected = predict(&prepared, &out, forecast.texels);
    say_prediction(expected.as_ref(), &out, console);
    let times: Vec<f64> = plan.times.iter().map(|m| m.hour).collect();
    let warnings = [&prepared.warnings[..], &of_layout].concat();
    console.result(&json!({
        "scene": prepared.scene.name,
        "integrator": prepared.integrator,
        "times": times,
        "extra_times": plan.extra_times,
        "layers": layers,
        "visibility": prepared.visibility_times.as_ref().map(|visibility_times| json!({
            "times": visibility_times.hours.len(),
            "minutes": visibility_times.minutes,
        })),
        "skipped": plan.skipped,
        "existing": existing,
        "forecast": forecast,
        "expected": expected,
        "free_bytes": free,
        "warnings": warnings,
    }))
}

/// Names of layers, those that differ in the hour alone on one line: `sun at 6:00, 7:00 … 21:00 (16 layers)`.
fn in_short(layers: &[String]) -> Vec<String> {
    let split = |name: &str| name.split_once(" at ").map(|(kind, hour)| (kind.to_owned(), hour.to_owned()));
    let mut lines: Vec<(Option<String>, Vec<String>)> = Vec::new();
    for name in layers {
        match (split(name), lines.last_mut()) {
            (Some((kind, hour)), Some((Some(last), hours))) if *last == kind => hours.push(hour),
            (Some((kind, hour)), _) => lines.push((Some(kind), vec![hour])),
            (None, _) => lines.push((None, vec![name.clone()])),
        }
    }
    let line = |(kind, hours): (Option<String>, Vec<String>)| match (kind, &hours[..]) {
        (Some(kind), [first, second, .., last]) if hours.len() > 3 => {
            format!("{kind} at {first}, {second} … {last} ({} layers)", hours.len())
        }
        (Some(kind), _) => format!("{kind} at {}", hours.join(", ")),
        (None, _) => hours.concat(),
    };
    lines.into_iter().map(line).collect()
}

/// Error against run time, in words.
fn say_prediction(expected: Option<&Prediction>, out: &Path, console: &Console) {
    let Some(Prediction { from_samples, points, target }) = expected else {
        return console.print(
            "  error and time: known after a bake with these times and a fixed number of samples (--draft is quick)",
        );
    };
    console.print(format!("  by the bake in {} ({from_samples} samples), on its machine:", out.display()));
    let say = |point: &Point, what: &str| {
        console.print(format!(
            "    {:>6} samples{what}: {} of tracing; local error {} in the median cell, up to {} in 95 % of cells at the worst hour",
            point.samples,
            run_time(point.seconds),
            percent(point.median),
            percent(point.p95)
        ));
    };
    points.iter().for_each(|point| say(point, ""));
    target.iter().for_each(|point| say(point, " for the target, fewer where cells converge earlier"));
}

fn run_time(seconds: f64) -> String {
    match seconds {
        ..10.0 => format!("{seconds:.1} s"),
        ..60.0 => format!("{seconds:.0} s"),
        ..3600.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

/// What a bake would take, in words.
fn say_forecast(forecast: &Forecast, free: Option<u64>, console: &Console) {
    let [width, height] = forecast.size;
    console.print(format!("  {}", scale(forecast.extent, forecast.texels_per_metre)));
    console.print(format!(
        "  {} of {width} × {height} texels, {}{} covered",
        count(forecast.pages as usize, "page"),
        if forecast.texel_scale > 1 { "about " } else { "" },
        forecast.texels
    ));
    console.print(format!(
        "  disk: dataset at most {}, kept layers {}, and {} while all of them are traced: up to {} at once{}; memory about {}",
        bytes(forecast.dataset_bytes),
        bytes(forecast.layers_bytes),
        bytes(forecast.work_bytes),
        bytes(forecast.peak_bytes),
        free.map_or(String::new(), |free| format!(" ({} free)", bytes(free))),
        bytes(forecast.memory_bytes)
    ));
    views::in_words(&forecast.views, forecast.lit_tiles)
        .into_iter()
        .for_each(|what| console.print(format!("  {what}")));
    if forecast.escaping_rays == Some(0) {
        console.print(format!(
            "  the scene may be closed: none of {ESCAPE_RAYS} rays from lightmapped surfaces leaves it. Sun and sky are traced anyway, \
             because a small opening may have been missed; if the room is closed, remove [sun] and [sky]"
        ));
    }
}

/// Such as
/// `median cell 1.6 %, 95th percentile 5.2 %; above 5 / 10 / 20 %: 5.3 / 0.4 / 0.0 % of the texels`.
fn in_words(local: &LocalErrorSummary) -> String {
    let percent = |share: f64| format!("{:.1}", share * 100.0);
    format!(
        "median cell {} %, 95th percentile {} %; above 5 / 10 / 20 %: {} % of the texels",
        percent(local.median),
        percent(local.p95),
        local.over.map(percent).join(" / ")
    )
}

/// The run in a few lines. `is_checked`: a check was asked for; `target`: a target error was.
fn say(outcome: &Outcome, is_checked: bool, target: Option<f64>, console: &Console) {
    console.say(format!(
        "{}{}: {} of {}{} × {} texels{}{}",
        outcome.dataset.display(),
        if outcome.up_to_date { " already holds this bake (--force bakes it again)" } else { "" },
        count(outcome.frames, "frame"),
        if outcome.pages > 1 { format!("{} pages of ", outcome.pages) } else { String::new() },
        outcome.size[0],
        outcome.size[1],
        if outcome.up_to_date { String::new() } else { format!(" in {:.1} s", outcome.seconds) },
        outcome.local.all.map_or(String::new(), |local| format!(", local error {}", in_words(&local)))
    ));
    // What was said when it was baked need not be said again; a check that was asked for is an answer.
    if outcome.up_to_date && !is_checked {
        return;
    }
    if outcome.out_of_time {
        console.say("  the time limit ended the tracing");
    }
    if let Some((hour, local)) = outcome.worst_hour() {
        let missed = target.filter(|target| local.p95 > *target);
        let missed = missed
            .map_or(String::new(), |target| format!("; the target error of {} % is missed", target * 100.0));
        console.say(format!("  worst at {hour:.2} h: {}{missed}", in_words(&local)));
    }
    outcome.denoised_in_words().into_iter().for_each(|what| console.say(format!("  {what}")));
    outcome.local.advice.iter().for_each(|what| console.say(format!("  {what}")));
    if let Some(check) = &outcome.check {
        let known = check.frames.iter().filter_map(|frame| Some((frame.measured_error?, frame)));
        if let Some((measured_error, worst)) = known.max_by(|a, b| a.0.total_cmp(&b.0)) {
            let hour = outcome.hours.get(worst.frame).copied().unwrap_or_default();
            console.say(format!(
                "  measured error of {}: up to {:.2} % of the mean light (at {hour:.2} h; estimated {:.2} %, noise of the \
                 measurement {:.2} %); the report lists all times",
                count(check.texels, "texel"),
                measured_error * 100.0,
                worst.estimated_error * 100.0,
                worst.reference_noise * 100.0
            ));
            console.say(format!("  {}", report::worst_eighth(outcome, check)));
        } else {
            console.say("  measured error: no difference beyond the measurement's own noise; the report lists all times");
        }
    }
    for reason in outcome.skipped.iter().filter(|_| !outcome.up_to_date) {
        console.say(format!("  {reason}"));
    }
}
