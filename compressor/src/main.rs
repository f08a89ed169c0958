//! `compress`: the command line of the compressor.

use clap::{Args, Parser, Subcommand, ValueEnum};
use compressor::bundle::Bundle;
use compressor::compress::{DRAFT_ITERATIONS, ITERATIONS, Options, PAPER_ITERATIONS, Rate, default_bundle};
use compressor::decode::Decoder;
use compressor::evaluate::evaluate;
use compressor::model::{Contents, PROFILES, Profile};
use compressor::run::{compress_and_judge, print};
use compressor::{Error, Result};
use dataset::console::{Console, ConsoleArgs, catch_interrupts, fail};
use dataset::files::write_atomically;
use dataset::report::{Report, preview};
use dataset::store::Dataset;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

const EXAMPLES: &str = "\
Examples:
  compress dataset/yard                                     writes yard.ndgi and yard.html there
  compress dataset/yard --draft --profile L                 fast and small
  compress dataset/yard --target-psnr 40                    bits to the tiles that need them
  compress decode dataset/yard/yard.ndgi --hour 18.05 --out evening.exr
  compress evaluate dataset/yard --csv quality.csv
  compress info dataset/yard/yard.ndgi

A run that was stopped continues where it was when the same command is given again.

Keys of the --json object (null where there is none):
  psnr_db                mean PSNR over (tile, set) pairs, peak = the tile's largest valid value
  psnr_range_db          the same with peak = largest - smallest
  psnr_pooled_db         from the mean squared error relative to the peak: bad tiles weigh as they are bad
  psnr_distinct_db       psnr_db over the sets that differ (sets_distinct of them)
  psnr_8bit_db           psnr_db after the 8-bit four-channel output
  psnr_log_db            psnr_db of ln(1 + E/e), e = 0.001 of the page's mean: sees errors in the dark
  psnr_worst_percent_db  mean of the worst 1 % of the pairs
  psnr_unquantised_db    before quantisation, mean over the training's tiles (compress only)
  noise_ceiling_db       the bake's own sampling error as a PSNR, mean
  one_minus_ssim         1 - mean structural similarity
  relative_error         mean of RMSE / mean
  dark_relative_error    the same over the darkest quarter of each set's texels, mean over sets
  constant_relative_error  the same over pairs constant in space, which have no PSNR
  pairs, pairs_constant, pairs_black   pairs judged, judged apart, not judged
  bpp, bytes             bits per texel and set (all texels counted), bytes of the bundle
  seam_ratio             error of the step between neighbouring texels, across tile borders / inside tiles
  between_median_db      psnr_pooled_db of moments between sets against light linear between them, or against a withheld bake: the
                         median; between_worst_db the least
  between_linear_median_db  of that linear light, against the withheld bake
  hours                  a list of hour, psnr_db, noise_ceiling_db, psnr_log_db, relative_error, dark_relative_error
  tiles, seconds         tiles of the bundle, wall-clock seconds
  bundle, report         paths written (compress only)
  tiles_empty, tiles_resumed, training_cpu_seconds   (compress only)
  decode_seconds         wall-clock seconds of decoding all sets (evaluate only)";

const INFO_EXAMPLES: &str = "\
Examples:
  compress info dataset/yard/yard.ndgi
  compress info dataset/yard/yard.ndgi --json | jq .written.seed";

/// Compresses a temporal lightmap set into a random-access bundle, and judges the result.
#[derive(Debug, Parser)]
#[command(name = "compress", version, after_long_help = EXAMPLES, after_help = "More, with examples: compress --help")]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    compress: Compress,
    #[command(flatten)]
    console: ConsoleArgs,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Decode one page at one moment to an EXR image.
    #[command(after_help = "Example: compress decode dataset/yard/yard.ndgi --hour 18.05 --out evening.exr")]
    Decode {
        /// The bundle.
        bundle: PathBuf,
        /// The moment: hours from 0 to below 24, such as 18.05, or 18:03.
        #[arg(long, allow_hyphen_values = true, value_parser = parse_hour)]
        hour: f64,
        /// The image to write.
        #[arg(long)]
        out: PathBuf,
        /// The page.
        #[arg(long, default_value_t = 0)]
        page: usize,
    },
    /// Compare a bundle with its dataset: a table by hour, and optionally every tile as CSV.
    #[command(
        after_help = "Example: compress evaluate dataset/yard --csv quality.csv\nKeys of --json: compress --help"
    )]
    Evaluate {
        /// The dataset's folder.
        dataset: PathBuf,
        /// The bundle [default: <dataset>/<scene>.ndgi].
        #[arg(long)]
        bundle: Option<PathBuf>,
        /// A bake of the same scene at other hours: judge the bundle there too, beside linear interpolation of the sets.
        #[arg(long, value_name = "DATASET")]
        withheld: Option<PathBuf>,
        /// Write one line per (tile, set) to this file.
        #[arg(long)]
        csv: Option<PathBuf>,
    },
    /// Show what a bundle says of itself.
    #[command(after_help = INFO_EXAMPLES)]
    Info {
        /// The bundle.
        bundle: PathBuf,
    },
}

#[derive(Debug, Args)]
struct Compress {
    /// The dataset's folder.
    #[arg(required = true)]
    dataset: Option<PathBuf>,
    /// Size of the representation, the same for all tiles: L, M, M.64 or H.
    #[arg(long, default_value = "M", value_parser = parse_profile)]
    profile: Profile,
    /// Choose what each tile has by brief trials, so that all tiles together reach about this pooled PSNR in dB.
    #[arg(long, value_name = "DB", value_parser = parse_positive, conflicts_with = "profile")]
    target_psnr: Option<f64>,
    /// The same, within so many bits per texel and set.
    #[arg(long, value_name = "B", value_parser = parse_positive, conflicts_with_all = ["profile", "target_psnr"])]
    target_bpp: Option<f64>,
    /// The bundle to write [default: <dataset>/<scene>.ndgi].
    #[arg(long)]
    out: Option<PathBuf>,
    /// The report to write [default: the bundle's name with .html].
    #[arg(long)]
    report: Option<PathBuf>,
    /// Train briefly: a first look.
    #[arg(long, conflicts_with = "iterations")]
    draft: bool,
    /// Training steps per tile [default: 12000; 100000 with --recipe paper; 1000 with --draft].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    iterations: Option<u32>,
    /// How to train.
    #[arg(long, value_enum, default_value_t = RecipeName::Standard)]
    recipe: RecipeName,
    /// Seed of all randomness.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Train every tile again, even those a stopped run finished.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum RecipeName {
    /// This project's.
    Standard,
    /// The paper's, literally: time axis by the hour, γ on πτ and 2πτ, power 2.2, constant learning rate, plain BC7.
    Paper,
}

fn parse_profile(name: &str) -> Result<Profile, String> {
    let known = || PROFILES.map(|profile| profile.name).join(", ");
    let found = PROFILES.into_iter().find(|profile| profile.name.eq_ignore_ascii_case(name));
    found.ok_or_else(|| format!("expected one of {}", known()))
}

fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "expected a number above 0".to_owned())
}

/// `18.05` or `18:03`, in [0, 24).
fn parse_hour(text: &str) -> Result<f64, String> {
    let hour = match text.split_once(':') {
        None => text.parse::<f64>().ok(),
        Some((hours, minutes)) => {
            let number =
                |text: &str| text.bytes().all(|b| b.is_ascii_digit()).then(|| text.parse::<u8>().ok())?;
            let minutes = number(minutes).filter(|m| *m < 60 && text.len() - hours.len() == 3);
            number(hours).zip(minutes).map(|(h, m)| f64::from(h) + f64::from(m) / 60.0)
        }
    };
    hour.filter(|hour| (0.0..24.0).contains(hour))
        .ok_or_else(|| "expected an hour from 0 to below 24, such as 18.05 or 18:03".to_owned())
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    catch_interrupts();
    let console = Console::new(cli.console);
    let done = match cli.command {
        None => compress(cli.compress, &console),
        Some(Command::Decode { bundle, hour, out, page }) => decode(bundle, hour, out, page, &console),
        Some(Command::Evaluate { dataset, bundle, withheld, csv }) => {
            judge(dataset, bundle, withheld, csv, &console)
        }
        Some(Command::Info { bundle }) => info(bundle, &console),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => fail(&error),
    }
}

fn compress(args: Compress, console: &Console) -> Result<()> {
    let root = args.dataset.ok_or_else(|| Error::invalid("command line", "expected a dataset's folder"))?;
    let paper = args.recipe == RecipeName::Paper;
    let rate = match (args.target_psnr, args.target_bpp) {
        (None, None) => Rate::Profile(args.profile),
        _ if paper => {
            return Err(Error::invalid(
                "--recipe paper",
                "has one profile for all tiles: expected no target",
            ));
        }
        (Some(db), _) => Rate::Psnr(db),
        (_, Some(bpp)) => Rate::Bpp(bpp),
    };
    let iterations = match args.iterations {
        Some(iterations) => iterations as usize,
        None if args.draft => DRAFT_ITERATIONS,
        None if paper => PAPER_ITERATIONS,
        None => ITERATIONS,
    };
    let options = Options { rate, iterations, paper, seed: args.seed, out: args.out, force: args.force };
    for (path, extension, option) in [(&options.out, "ndgi", "--out"), (&args.report, "html", "--report")] {
        path.as_ref().map_or(Ok(()), |path| expect_extension(path, extension, option))?;
    }
    let judged = compress_and_judge(&root, &options, console)?;
    let dataset = Dataset::open(&root)?;
    let mut report = Report::new(&format!("{}, compressed", dataset.config.scene));
    let mut object = judged.json();
    report.push(preview::section(&dataset)?);
    for section in judged.sections {
        report.push(section);
    }
    let path = args.report.unwrap_or_else(|| judged.outcome.bundle.with_extension("html"));
    report.write(&path)?;
    console.say(format!("bundle: {}", judged.outcome.bundle.display()));
    console.say(format!("report: {}", path.display()));
    object["report"] = json!(path);
    console.result(&object)?;
    Ok(())
}

fn judge(
    root: PathBuf,
    bundle: Option<PathBuf>,
    withheld: Option<PathBuf>,
    csv: Option<PathBuf>,
    console: &Console,
) -> Result<()> {
    let start = Instant::now();
    csv.as_ref().map_or(Ok(()), |path| expect_extension(path, "csv", "--csv"))?;
    let dataset = Dataset::open(&root)?;
    let decoder = Decoder::new(open(&bundle.unwrap_or_else(|| default_bundle(&dataset)))?);
    let info: serde_json::Value = serde_json::from_str(&decoder.bundle().header.info).unwrap_or_default();
    if info["inputs"] != json!(compressor::compress::inputs(&dataset)) {
        console.warn("the bundle was made from another bake than this dataset holds: compress it again");
    }
    let withheld = withheld.map(|root| Dataset::open(&root)).transpose()?;
    let evaluation = evaluate(&dataset, withheld.as_ref(), &decoder, console)?;
    if withheld.is_some() && evaluation.between.is_none() {
        console.warn("--withheld: none of its hours lies between sets that the bundle interpolates; nothing to judge there");
    }
    print(&evaluation, console);
    if let Some(path) = csv {
        evaluation.write_csv(&path)?;
    }
    let mut object = evaluation.json();
    object["tiles"] = json!(decoder.bundle().index.len());
    object["decode_seconds"] = json!(evaluation.decode_seconds);
    object["seconds"] = json!(start.elapsed().as_secs_f64());
    console.result(&object)?;
    Ok(())
}

/// An error unless the path ends as it should: no output may replace a bundle or a manifest by mistake.
fn expect_extension(path: &Path, extension: &str, option: &str) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)) {
        return Ok(());
    }
    Err(Error::invalid(option, format!("{}: expected a name that ends in .{extension}", path.display())))
}

/// Opens a bundle; says how to come by one where there is none.
fn open(path: &Path) -> Result<Bundle> {
    if path.is_dir() {
        return Err(Error::invalid(path.display(), "a folder; expected a bundle, a file that ends in .ndgi"));
    }
    if !path.exists() {
        return Err(Error::invalid(path.display(), "no such bundle; `compress <dataset>` writes one"));
    }
    Bundle::open(path)
}

fn decode(bundle: PathBuf, hour: f64, out: PathBuf, page: usize, console: &Console) -> Result<()> {
    expect_extension(&out, "exr", "--out")?;
    let start = Instant::now();
    let image = Decoder::new(open(&bundle)?).decode_page(page, hour)?;
    write_atomically(&out, &image.to_exr())?;
    console.say(format!("{} × {} texels at {hour} h: {}", image.width, image.height, out.display()));
    let seconds = start.elapsed().as_secs_f64();
    console.result(&json!({ "out": out, "page": page, "hour": hour, "width": image.width, "height": image.height, "seconds": seconds }))?;
    Ok(())
}

/// What tiles have, with their number and bytes: the largest share of the bundle first.
fn contents(bundle: &Bundle) -> Vec<serde_json::Value> {
    let mut kinds: BTreeMap<String, (usize, u64)> = BTreeMap::new();
    for entry in bundle.index.iter().filter(|entry| entry.length > 0) {
        let kind = Contents::of_word(entry.word).map_or(String::new(), |contents| contents.to_string());
        let (tiles, bytes) = kinds.entry(kind).or_default();
        (*tiles, *bytes) = (*tiles + 1, *bytes + u64::from(entry.length));
    }
    let mut kinds: Vec<_> = kinds.into_iter().collect();
    kinds.sort_by_key(|(_, (_, bytes))| std::cmp::Reverse(*bytes));
    let object = |(has, (tiles, bytes))| json!({ "has": has, "tiles": tiles, "bytes": bytes });
    kinds.into_iter().map(object).collect()
}

fn info(path: PathBuf, console: &Console) -> Result<()> {
    let bundle = open(&path)?;
    let header = &bundle.header;
    let pages: Vec<_> = header.pages.iter().map(|page| json!([page.width, page.height])).collect();
    let empty = bundle.index.iter().filter(|entry| entry.length == 0).count();
    let groups: Vec<_> = header
        .groups
        .iter()
        .zip(&header.timeline.intervals)
        .map(|(name, on)| json!({ "name": name, "on": on }))
        .collect();
    let texels: f64 = header.pages.iter().map(|page| page.width as f64 * page.height as f64).sum();
    let bpp = bundle.bytes as f64 * 8.0 / (texels * header.timeline.hours.len() as f64);
    // What the writer noted about itself is shown as it stands where it is no JSON.
    let written = serde_json::from_str(&header.info).unwrap_or_else(|_| json!(header.info));
    let object = json!({
        "scene": header.scene, "profile": written["profile"], "pages": pages, "hours": header.timeline.hours, "groups": groups,
        "tiles": bundle.index.len(), "tiles_empty": empty, "contents": contents(&bundle),
        "bytes": bundle.bytes, "bpp": bpp, "written": written,
    });
    for (name, text) in in_words(&bundle, &written, bpp) {
        console.print(format!("{name:>8}  {text}"));
    }
    console.result(&object)?;
    Ok(())
}

/// What a bundle says of itself, for people.
fn in_words(bundle: &Bundle, written: &serde_json::Value, bpp: f64) -> Vec<(&'static str, String)> {
    let header = &bundle.header;
    let hours = &header.timeline.hours;
    let mut lines = vec![("scene", header.scene.clone())];
    let pages: Vec<String> =
        header.pages.iter().map(|page| format!("{} × {}", page.width, page.height)).collect();
    lines.push(("pages", format!("{} texels", pages.join(", "))));
    let (first, last) = (hours.first().copied().unwrap_or(0.0), hours.last().copied().unwrap_or(0.0));
    lines.push(("sets", format!("{}, from {first} h to {last} h", hours.len())));
    for (name, on) in header.groups.iter().zip(&header.timeline.intervals) {
        let spans: Vec<String> = on.iter().map(|[from, to]| format!("{from}–{to} h")).collect();
        lines.push((
            "group",
            format!("{name}, {}", if spans.is_empty() { "off".to_owned() } else { spans.join(", ") }),
        ));
    }
    lines.push(("size", format!("{} bytes, {bpp:.3} bits per texel and set", bundle.bytes)));
    let empty = bundle.index.iter().filter(|entry| entry.length == 0).count();
    lines.push(("tiles", format!("{}, {empty} of them empty", bundle.index.len())));
    let text = |value: &serde_json::Value| value.as_str().unwrap_or_default().to_owned();
    for kind in contents(bundle) {
        lines.push(("", format!("{} × {}: {} bytes", kind["tiles"], text(&kind["has"]), kind["bytes"])));
    }
    if written.is_object() {
        let choice = match (&written["profile"], &written["target_psnr_db"], &written["target_bpp"]) {
            (serde_json::Value::String(profile), ..) => format!("profile {profile}"),
            (_, serde_json::Value::Number(db), _) => format!("--target-psnr {db}"),
            (.., bpp) => format!("--target-bpp {bpp}"),
        };
        let by = format!("{}, {choice}, recipe {}", text(&written["generator"]), text(&written["recipe"]));
        lines
            .push(("written", format!("by {by}, {} steps, seed {}", written["iterations"], written["seed"])));
    }
    lines
}
