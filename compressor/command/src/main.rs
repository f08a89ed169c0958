//! `compress`: the command line of the compressor.

pub(crate) mod args;
mod info;
mod shards;
mod view;

use args::{Command, Compare, Compress, LightName, SlowMetricsArgs, Sweep};
use commands::console::{Console, catch_interrupts, fail};
use compressor::bundle::Bundle;
use compressor::bundle::MapCoding;
use compressor::compare::{self, Effort};
use compressor::compress::{DRAFT, MEDIUM, Options, Rate, default_bundle, light_of};
use compressor::decode::{Decoder, Lights};
use compressor::evaluate::{Measures, SlowMetrics, evaluate, expect_match};
use compressor::law::WIDEST;
use compressor::run::compress_and_judge;
use compressor::{Error, Result, levels, of_bundle, sweep};
use dataset::host::files::{expect_output, write_atomically};
use dataset::host::inputs::expect_file;
use dataset::image::Image;
use dataset::pictures::Lpips;
use dataset::store::Dataset;
use reports::{Report, preview};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let cli = args::parse();
    catch_interrupts();
    let console = Console::new(cli.console);
    let done = match cli.command {
        None => compress(cli.compress, &console),
        Some(Command::Decode { bundle, hour, out, page, light }) => {
            let lights = match light {
                LightName::All => Lights::All,
                LightName::Baked => Lights::Baked,
                LightName::Sun => Lights::Sun,
            };
            decode(bundle, hour, out, page, lights, &console)
        }
        Some(Command::Evaluate { dataset, bundle, withheld, reference, slow_metrics, csv }) => {
            judge(dataset, bundle, [withheld, reference], slow_metrics, csv, &console)
        }
        Some(Command::Sweep(args)) => run_sweep(args, &console),
        Some(Command::Compare(args)) => run_compare(args, &console),
        Some(Command::Status { dataset, out }) => shards::status(&dataset, out, &console),
        Some(Command::Info { bundle }) => info::info(bundle, &console),
        Some(Command::View(args)) => view::view(args, &console),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => fail(&error),
    }
}

fn compress(args: Compress, console: &Console) -> Result<()> {
    let root = args.dataset.ok_or_else(|| Error::invalid("command line", "expected a dataset's folder"))?;
    let rate = match (args.target_psnr, args.target_bpp) {
        (None, None) => args.profile.map_or(Rate::Usual, Rate::Profile),
        (Some(db), _) => Rate::Psnr(db),
        (_, Some(bpp)) => Rate::Bpp(bpp),
    };
    let preset = args.preset.unwrap_or(if args.draft { DRAFT } else { MEDIUM });
    let iterations = match args.iterations {
        Some(iterations) => iterations as usize,
        None => preset.iterations,
    };
    args.instructions.iter().for_each(|tier| tier.limit());
    if args.coding == MapCoding::Basis && (args.iterations.is_some() || args.preset.is_some()) {
        let what = "the coding basis trains nothing; omit --iterations and --preset, or use --coding neural";
        return Err(Error::invalid("command line", what));
    }
    let Compress { coding, time_limit, seed, out, force, merge, without_sun, still_shadows, .. } = args;
    let options = Options {
        coding,
        rate,
        iterations,
        time_limit,
        seed,
        out,
        force,
        merge,
        without_sun,
        still_shadows,
        ..Options::of(preset)
    };
    for (path, extension, option) in [(&options.out, "ndgi", "--out"), (&args.report, "html", "--report")] {
        path.as_ref().map_or(Ok(()), |path| expect_output(path, extension, option))?;
    }
    if let Some(shard) = args.shard {
        return shards::train(&root, &options, shard, console);
    }
    let of_full = match args.levels {
        true => levels::options(&options, &Dataset::open_manifest(&root)?.config.pages, 0),
        false => options.clone(),
    };
    let judged = compress_and_judge(&root, &of_full, console)?;
    // The table is additional: --quiet omits it.
    if !console.quiet {
        judged.table.iter().for_each(|line| console.print(line));
    }
    let dataset = Dataset::open(&root)?;
    let bundle = &judged.outcome.bundle;
    let coarser = args.levels.then(|| levels::levels(&root, &options, bundle, console)).transpose()?;
    for stale in levels::stale(&dataset, bundle) {
        console.warn(format!(
            "{}: this coarser level was made from different light than the dataset's; run `compress --levels` or delete it",
            stale.display()
        ));
    }
    let mut report = Report::new(&format!("{}, compressed", dataset.config.scene));
    let mut object = judged.json();
    report.lead(judged.lead);
    for section in judged.sections {
        report.push(section);
    }
    if let Some(coarser) = &coarser {
        report.push(levels::section(coarser));
    }
    report.push(preview::section(&dataset)?.folded());
    let path = args.report.unwrap_or_else(|| judged.outcome.bundle.with_extension("html"));
    report.write(&path)?;
    console.say(format!("bundle: {}", judged.outcome.bundle.display()));
    console.say(format!("report: {}", path.display()));
    object["report"] = json!(path);
    object["levels"] = json!(coarser);
    console.result(&object)?;
    Ok(())
}

fn judge(
    root: PathBuf,
    bundle: Option<PathBuf>,
    others: [Option<PathBuf>; 2],
    slow_metrics: SlowMetricsArgs,
    csv: Option<PathBuf>,
    console: &Console,
) -> Result<()> {
    let start = Instant::now();
    csv.as_ref().map_or(Ok(()), |path| expect_output(path, "csv", "--csv"))?;
    let dataset = Dataset::open(&root)?;
    let decoder = Decoder::new(open(&bundle.unwrap_or_else(|| default_bundle(&dataset)))?);
    expect_match(&dataset, &decoder)?;
    let matches = light_of(&decoder.bundle().header) == Some(dataset.config.digest_of_light());
    let (of, scene) = (&decoder.bundle().header.scene, &dataset.config.scene);
    if of != scene {
        console.warn(format!("the bundle is of scene {of:?}, the dataset of scene {scene:?}: the numbers below compare two different scenes"));
    } else if !matches {
        console.warn("the bundle was compressed from a different bake; run `compress` again");
    }
    let open_dataset = |root: Option<PathBuf>| root.map(|root| Dataset::open(&root)).transpose();
    let [withheld, reference] = others;
    let (withheld, reference) = (open_dataset(withheld)?, open_dataset(reference)?);
    let lpips = slow_metrics.lpips.map(|path| Lpips::load(&path)).transpose()?;
    let slow_metrics = SlowMetrics { lpips: lpips.as_ref(), flip: slow_metrics.flip };
    let measures = Measures { withheld: withheld.as_ref(), reference: reference.as_ref(), slow_metrics };
    let evaluation = evaluate(&dataset, &decoder, measures, console)?;
    if withheld.is_some() && evaluation.between.is_none() {
        console.warn("--withheld: none of its hours lies between frames that the bundle interpolates, so nothing was evaluated there; give a bake at other hours");
    }
    evaluation.lines().iter().for_each(|line| console.print(line));
    if let Some(path) = csv {
        write_atomically(&path, evaluation.csv().as_bytes())?;
    }
    let mut object = evaluation.json();
    object["tiles"] = json!(decoder.bundle().index.len());
    object["matches_dataset"] = json!(matches);
    object["decode_seconds"] = json!(evaluation.decode_seconds);
    object["seconds"] = json!(start.elapsed().as_secs_f64());
    console.result(&object)?;
    Ok(())
}

fn run_sweep(args: Sweep, console: &Console) -> Result<()> {
    let start = Instant::now();
    let dataset = Dataset::open(&args.dataset)?;
    let scene = &dataset.config.scene;
    let path = args.report.unwrap_or_else(|| dataset.root.join(format!("{scene}.sweep.html")));
    expect_output(&path, "html", "--report")?;
    args.csv.as_ref().map_or(Ok(()), |path| expect_output(path, "csv", "--csv"))?;
    let (profiles, presets) = (distinct(args.profiles), distinct(args.presets));
    let Sweep { tiles, seed, .. } = args;
    let options = sweep::Options { tiles: tiles as usize, profiles, presets, seed };
    let sweep = sweep::sweep(&dataset, &options, console)?;
    sweep.table().iter().for_each(|line| console.print(line));
    if let Some(path) = args.csv {
        write_atomically(&path, sweep.csv().as_bytes())?;
    }
    let mut report = Report::new(&format!("{scene}, profiles and presets"));
    report.push(sweep.section());
    report.write(&path)?;
    console.say(format!("report: {}", path.display()));
    let mut object = json!(sweep);
    object["report"] = json!(path);
    object["seconds"] = json!(start.elapsed().as_secs_f64());
    console.result(&object)
}

fn run_compare(args: Compare, console: &Console) -> Result<()> {
    let start = Instant::now();
    let dataset = Dataset::open(&args.dataset)?;
    let scene = &dataset.config.scene;
    let path = args.report.unwrap_or_else(|| dataset.root.join(format!("{scene}.compare.html")));
    expect_output(&path, "html", "--report")?;
    args.csv.as_ref().map_or(Ok(()), |path| expect_output(path, "csv", "--csv"))?;
    let options = compare::Options {
        tiles: args.tiles.map(|tiles| tiles as usize),
        effort: if args.draft { Effort::Draft } else { Effort::Full },
        ablations: args.ablations,
        methods: args.method,
        render: args.render,
        seed: args.seed,
    };
    let transfer = args.transfer.as_deref().map(Dataset::open).transpose()?;
    let lpips = args.slow_metrics.lpips.map(|path| Lpips::load(&path)).transpose()?;
    let slow_metrics = SlowMetrics { lpips: lpips.as_ref(), flip: args.slow_metrics.flip };
    let comparison = compare::compare(&dataset, transfer.as_ref(), slow_metrics, &options, console)?;
    comparison.table().iter().for_each(|line| console.print(line));
    if let Some(path) = args.csv {
        write_atomically(&path, comparison.csv().as_bytes())?;
    }
    let mut report = Report::new(&format!("{scene}, methods compared"));
    report.push(comparison.section());
    report.write(&path)?;
    console.say(format!("report: {}", path.display()));
    let mut object = json!(comparison);
    if let Some(rendered) = &comparison.rendered {
        let page = path.with_extension("render.html");
        rendered.table().iter().for_each(|line| console.print(line));
        rendered.report(&comparison).write(&page)?;
        console.say(format!("rendered: {}", page.display()));
        object["rendered"]["page"] = json!(page);
    }
    object["report"] = json!(path);
    object["seconds"] = json!(start.elapsed().as_secs_f64());
    console.result(&object)
}

/// The values without repetitions, in order of first appearance.
fn distinct<T: PartialEq>(named: Vec<T>) -> Vec<T> {
    let mut distinct = Vec::with_capacity(named.len());
    for value in named {
        if !distinct.contains(&value) {
            distinct.push(value);
        }
    }
    distinct
}

/// Opens a bundle; if it does not exist, the error says how to make one.
fn open(path: &Path) -> Result<Bundle> {
    expect_file(path, "a bundle, a .ndgi file, as `compress <dataset>` writes it")?;
    Bundle::open(path).map_err(of_bundle)
}

fn decode(
    bundle: PathBuf,
    hour: f64,
    out: PathBuf,
    page: usize,
    lights: Lights,
    console: &Console,
) -> Result<()> {
    expect_output(&out, "exr", "--out")?;
    let start = Instant::now();
    let decoder = Decoder::new(open(&bundle)?);
    let header = &decoder.bundle().header;
    if matches!(lights, Lights::Sun) && header.sun.is_none() {
        let what = "has no separate stream of the sun's direct light (it was omitted, is part of the other light, or the scene has none); use --light all";
        return Err(Error::invalid(bundle.display(), what));
    }
    let timeline = &header.timeline;
    let point = timeline.at(hour);
    let (from, to) = (timeline.hours[point.a], timeline.hours[point.b]);
    if let Some(range) = baked_range_without(&timeline.hours, hour) {
        let baked = match range {
            [first, last] if first == last => format!("{first} h alone is baked"),
            [first, last] => format!("{first} h to {last} h are baked"),
        };
        let shown = match from == to {
            true => format!("the light of {from} h"),
            false => format!("an interpolation across midnight, from {from} h to {to} h"),
        };
        let sunless = if header.sun.is_some() { ", without the sun's direct light" } else { "" };
        console.warn(format!("{hour} h is outside the baked range ({baked}): the image shows {shown}{sunless}; bake that hour too (`bake --hours`), or decode one in the range"));
    } else if from != to && (to - from).rem_euclid(24.0) > WIDEST {
        console.warn(format!("{hour} h lies in a wide gap between the frames of {from} h and {to} h: the image is interpolated from these, without the sun's direct light at {hour} h; bake more hours for a better one"));
    }
    if !timeline.shows(hour) {
        let frame = timeline.hours[point.a];
        console.warn(format!("no frame has the light groups that are on at {hour} h: the image shows the light of {frame} h; bake an hour with these groups on"));
    }
    let compressor::decode::Image { width, height, texels } =
        decoder.decode_page_of(lights, page, hour).map_err(of_bundle)?;
    let image = Image { width, height, texels };
    write_atomically(&out, &image.to_exr())?;
    console.say(format!("{} × {} texels at {hour} h: {}", image.width, image.height, out.display()));
    let seconds = start.elapsed().as_secs_f64();
    console.result(&json!({ "out": out, "page": page, "hour": hour, "width": image.width, "height": image.height, "seconds": seconds }))?;
    Ok(())
}

/// First and last of the frames' hours, if `hour` lies in the gap around midnight between them, and that is
/// wider than every other: a bake of a whole day has none.
fn baked_range_without(hours: &[f64], hour: f64) -> Option<[f64; 2]> {
    let (first, last) = (*hours.first()?, *hours.last()?);
    let widest = hours.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    // (Hours such as 0.1 are not exact.)
    let is_day = first + 24.0 - last <= widest + 1e-6;
    (!(first..=last).contains(&hour) && !is_day).then_some([first, last])
}

#[cfg(test)]
mod tests {
    use super::baked_range_without;

    #[test]
    fn an_hour_before_the_first_or_after_the_last_is_outside_unless_the_day_is_whole() {
        let outside = |hours: &[f64], hour| baked_range_without(hours, hour).is_some();
        let whole: Vec<f64> = (0..24).map(f64::from).collect();
        let forenoon = [8.0, 9.0, 9.5, 12.0];
        assert!(!outside(&whole, 23.5) && !outside(&whole, 0.0));
        assert!(!outside(&[0.0, 6.0, 12.0, 18.0], 21.0));
        assert!([8.0, 8.5, 11.0, 12.0].iter().all(|&hour| !outside(&forenoon, hour)));
        assert!([0.0, 7.99, 12.01, 23.0].iter().all(|&hour| outside(&forenoon, hour)));
        assert!(outside(&[12.0], 12.5) && outside(&[12.0], 11.5) && !outside(&[12.0], 12.0));
        assert_eq!(baked_range_without(&forenoon, 20.0), Some([8.0, 12.0]));
    }
}
