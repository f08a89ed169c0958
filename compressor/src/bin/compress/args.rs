//! The command line as typed.

use clap::{Args, Parser, Subcommand, ValueEnum};
use compressor::Result;
use compressor::compress::{PRESETS, Preset, Shard};
use compressor::lanes::Tier;
use compressor::model::{PROFILES, Profile};
use dataset::console::ConsoleArgs;
use dataset::typed;
use std::path::PathBuf;
use std::time::Duration;

const EXAMPLES: &str = "\
Examples:
  compress dataset/yard                                     writes yard.ndgi and yard.html there
  compress dataset/yard --draft --profile L                 fast, and small
  compress dataset/yard --time-limit 5m                     as well trained as that allows
  compress dataset/yard --target-psnr 40                    bits to the tiles that need them
  compress dataset/yard --levels                            yard.1.ndgi, yard.2.ndgi, ... too: coarser levels for virtual texturing
  compress dataset/yard --without-sun                       for a game that draws the sun itself
  compress decode dataset/yard/yard.ndgi --hour 18.05 --out evening.exr
  compress evaluate dataset/yard --csv quality.csv
  compress sweep dataset/yard --tiles 4 --presets draft     profiles side by side
  compress compare dataset/yard --draft                     other methods beside it
  compress info dataset/yard/yard.ndgi
  compress dataset/city --shard 3/16                        one of sixteen array jobs; then, once all are done,
  compress dataset/city --merge                             (compressor/CLUSTER.md has whole scripts)
  compress view dataset/yard                                a page that plays the day in a browser

A run that was stopped continues where it was when the same command is given again (a time limit begins anew).

Exit codes: 0 done; 1 bad input, 2 a command line that is none: no use to try again; 75 try again (another run works there, shards are missing, a full
disk); 143, 130, 129 ended by SIGTERM, Ctrl-C, a closing terminal.

Keys of the --json object (null where there is none):
  psnr_db                mean PSNR over (tile, set) pairs, peak = the tile's largest valid value
  psnr_range_db          the same with peak = largest - smallest
  psnr_pooled_db         from the mean squared error relative to the peak: bad tiles weigh as they are bad
  psnr_distinct_db       psnr_db over the sets that differ (sets_distinct of them)
  psnr_8bit_db           psnr_db after the 8-bit four-channel output
  psnr_log_db            psnr_db of ln(1 + E/e), e = 0.001 of the page's mean: sees errors in the dark
  psnr_worst_percent_db  mean of the worst 1 % of the pairs
  psnr_unquantised_db    before quantisation, mean over the training's tiles (compress only)
  psnr_8bit_features_db  the same with all features rounded to 8 bits (compress only)
  noise_ceiling_db       the bake's own sampling error as a PSNR, mean
  one_minus_ssim         1 - mean structural similarity (11x11 Gaussian, sigma 1.5); one_minus_ssim_uniform with 7x7 texels alike
  psnr_256_db, psnr_range_256_db, one_minus_ssim_256   on tiles of 256x256 texels instead of 128x128
  lpips, flip            mean LPIPS, with --lpips, and HDR-FLIP, with --flip
  relative_error         mean of RMSE / mean
  dark_relative_error    the same over the darkest quarter of each set's texels, mean over sets of 0.1 lux or more in the mean
  constant_relative_error  the same over pairs constant in space, which have no PSNR
  pairs, pairs_constant, pairs_black   pairs judged, judged apart, not judged
  bpp, bytes             bits per texel and set (all texels counted), bytes of the bundle; bytes_of_sun those of the sun's tiles,
                         bytes_of_shadows those of how its shadows move
  bits_per_valid_texel   the same per valid texel and set; bits_per_valid_texel_distinct where equal sets count once
  psnr_sunny_db, psnr_pooled_sunny_db   over the sets that the sun lights directly
  psnr_without_sun_db, psnr_pooled_without_sun_db   of what maps hold, where the sun's direct light is a stream of its own
  seam_ratio             error of the step between neighbouring texels, across tile borders / inside tiles
  between_median_db      psnr_pooled_db of moments between sets against the dataset's light there, or against a withheld bake: the
                         median; between_worst_db the least
  between_linear_median_db  of that linear light, against the withheld bake
  sun_between_pooled_db  of the sun's direct light at twelve moments of the day, against the dataset's visibility, where it is a stream of its own;
                         sun_between_mean_db, and sun_between_worst_db of the worst 5 %
  step_error             from set to set, RMS error of the change of light / RMS of the change, all together; switch_error across switches
                         (changes below 0.001 of the light are left out)
  hours                  a list of hour, psnr_db, psnr_range_db, psnr_pooled_db, psnr_worst_percent_db, noise_ceiling_db, psnr_log_db,
                         one_minus_ssim, relative_error, dark_relative_error
  steps                  a list of from, to (hours), switch, error
  tiles, seconds         tiles of the bundle, wall-clock seconds of the command
  bundle, report         paths written (compress only)
  levels                 with --levels, a list of level, bundle, pages, tiles, bytes, psnr_db, psnr_pooled_db, up_to_date (compress only)
  steps_least, steps_most   training steps of a tile with light (compress only)
  tiles_empty, tiles_resumed, training_cpu_seconds, up_to_date   (compress only; the seconds of the run that trained it)
  matches_dataset        whether the bundle was made from the light that the dataset holds now (evaluate only)
  decode_seconds         wall-clock seconds of decoding all sets (evaluate only)";

const SWEEP_EXAMPLES: &str = "\
Examples:
  compress sweep dataset/yard --tiles 4 --presets draft        some minutes
  compress sweep dataset/yard --profiles M --presets draft,medium,final --csv m.csv

Each tile is trained as `compress --profile … --preset …` would with that seed. The three PSNRs are of one training: of the float
model, of that with all features rounded to 8 bits, and of the stored tile in BC7; bpp counts the texels of the trained tiles alone. With --json: tiles, tiles_of, is_sun_apart, rows (profile,
preset, bpp, psnr_unquantised_db, psnr_8bit_features_db, psnr_bc7_db, one_minus_ssim, seconds), report, seconds.";

const COMPARE_EXAMPLES: &str = "\
Examples:
  compress compare dataset/yard --draft                     a first look, at the first page
  compress compare dataset/yard --tiles 16 --csv yard.csv   minutes to hours
  compress compare dataset/yard --transfer dataset/yard-transfer   precomputed radiance transfer beside them
  compress compare dataset/yard --draft --ablations
  compress compare dataset/yard --draft --render            the scene in the light of each method, as a page of its own
  compress compare dataset/yard --render --method \"NDGI M\" --method \"NTC L\" --method \"ASTC 12x12\" --method BC7

BC6H, BC7 and ASTC need a build with --features baselines. How each method is set up: compressor/BASELINES.md. With --json: tiles,
tiles_of, sets, draft, ablations, noise_ceiling_db, rows (family, method, bpp, psnr_db and other means, encode_seconds of a tile,
decode_milliseconds of 1024x1024 texels, note), left_out, rendered, report, seconds. With --render, rendered has cameras, moments (hour, what, set), views (camera, hour, method,
bpp, bytes, psnr_db, ssim, flip), crops (what, place, hour, method, psnr_db, bytes), lapse (method, error, relative_error, worst, steps),
lapse_camera, lapse_change, left_out and page; it is null otherwise.";

const STATUS_EXAMPLES: &str = "\
Examples:
  compress status dataset/city
  watch -n 10 compress status dataset/city

With --json: bundle, working (whether any shard has said a word), and then stage (trials or training), done, tiles, psnr_db, seconds_left, of, and
shards: a list of shard (number, of), stage, done, tiles, resumed, psnr_db, seconds, process, instructions, program, error,
at (seconds since 1970).";

const VIEW_EXAMPLES: &str = "\
Examples:
  compress view dataset/yard                       writes dataset/yard/yard.view.html; open it in a browser
  compress view dataset/yard/yard.ndgi --out day.html --no-reference
  compress view other.ndgi --scene dataset/yard/scene.glb
  compress view --serve dataset/city               at http://127.0.0.1:8017/, until it is interrupted; --serve=8080 at that port

The page needs WebGL 2 and no network. One file holds 128 MiB at most (bundle, geometry and reference, before base64); past that use --serve.
A written page includes reference lightmaps up to 4 MiB; --serve offers all of them. With --json: scene, bundle, geometry (null without one),
cameras, page and bytes, or with --serve url.";

const INFO_EXAMPLES: &str = "\
Examples:
  compress info dataset/yard/yard.ndgi
  compress info dataset/yard/yard.ndgi --json | jq .written.seed

With --json: scene, profile, pages, hours, hours_between, groups, tiles, tiles_empty, contents, sun_times, written, bpp and bytes: bytes_of_header with the
index, bytes_resident (means and peaks of all tiles), bytes_of_sun, bytes_of_shadows; the rest is features and decoders. bytes_held_of_sun: bytes of the
sun's streams of all tiles at one moment, in a compact layout (levels in 3 bits, normals as stored); ndgi-gpu needs more.";

/// Compresses a temporal lightmap set into a random-access bundle, and judges the result.
#[derive(Debug, Parser)]
#[command(name = "compress", version, after_long_help = EXAMPLES, after_help = "More, with examples: compress --help")]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub compress: Compress,
    #[command(flatten)]
    pub console: ConsoleArgs,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Decode one page at one moment to an EXR image.
    #[command(after_help = "Example: compress decode dataset/yard/yard.ndgi --hour 18.05 --out evening.exr")]
    Decode {
        /// The bundle.
        bundle: PathBuf,
        /// The moment: hours from 0 to below 24, such as 18.05, or 18:03.
        #[arg(long, allow_hyphen_values = true, value_parser = typed::hour)]
        hour: f64,
        /// The image to write.
        #[arg(long)]
        out: PathBuf,
        /// The page.
        #[arg(long, default_value_t = 0)]
        page: usize,
        /// Which light: all, or where the sun is a stream of its own, its direct light (sun) or what else there is (baked).
        #[arg(long, value_enum, default_value_t = LightName::All)]
        light: LightName,
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
        #[command(flatten)]
        looks: LooksArgs,
        /// Write one line per (tile, set) to this file.
        #[arg(long)]
        csv: Option<PathBuf>,
    },
    /// Compare profiles and presets on some tiles of a dataset: bits, PSNR before and after quantisation, seconds.
    #[command(after_help = SWEEP_EXAMPLES)]
    Sweep(Sweep),
    /// Compare NDGI with block compression, keyframes, SVD, NTC and PRT on some tiles of a dataset.
    #[command(after_help = COMPARE_EXAMPLES)]
    Compare(Compare),
    /// Write a page that plays a compressed day in a browser: one self-contained HTML file.
    #[command(after_help = VIEW_EXAMPLES)]
    View(View),
    /// Show how far the shards of a bundle are, in one line.
    #[command(after_help = STATUS_EXAMPLES)]
    Status {
        /// The dataset's folder.
        dataset: PathBuf,
        /// The bundle that the shards work for [default: <dataset>/<scene>.ndgi].
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Show what a bundle says of itself.
    #[command(after_help = INFO_EXAMPLES)]
    Info {
        /// The bundle.
        bundle: PathBuf,
    },
}

#[derive(Debug, Args)]
pub struct View {
    /// The dataset's folder, or a bundle.
    pub input: PathBuf,
    /// The bundle [default: INPUT if it is a bundle, else <dataset>/<scene>.ndgi].
    #[arg(long)]
    pub bundle: Option<PathBuf>,
    /// The page to write [default: the bundle's name with .view.html].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// The geometry with lightmap coordinates, a GLB file [default: the dataset's, or scene.glb beside the bundle; without one the page
    /// shows the atlas alone].
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Replace an HTML file that is no page of this command; never a dataset's report.
    #[arg(long, conflicts_with = "serve")]
    pub force: bool,
    /// Omit the dataset's lightmaps, to which the page can compare.
    #[arg(long)]
    pub no_reference: bool,
    /// Serve the page on this machine instead of writing it, at this port [port if none is given: 8017; 0: any free one].
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "8017", conflicts_with = "out")]
    pub serve: Option<u16>,
}

#[derive(Debug, Args)]
pub struct Sweep {
    /// The dataset's folder.
    pub dataset: PathBuf,
    /// Tiles to train, at most; which, the seed decides.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..))]
    pub tiles: u32,
    /// Profiles to compare.
    #[arg(long, value_delimiter = ',', default_value = "S,L,M,H", value_parser = parse_profile)]
    pub profiles: Vec<Profile>,
    /// Presets to train each with.
    #[arg(long, value_delimiter = ',', default_value = "draft,medium", value_parser = parse_preset)]
    pub presets: Vec<Preset>,
    /// Seed of all randomness.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the table to this file as well.
    #[arg(long)]
    pub csv: Option<PathBuf>,
    /// The report to write, with PSNR against seconds [default: <dataset>/<scene>.sweep.html].
    #[arg(long)]
    pub report: Option<PathBuf>,
}

/// Measures that take long.
#[derive(Debug, Args)]
pub struct LooksArgs {
    /// Measure LPIPS too, by this network: an ONNX file as dataset/python/export_lpips.py writes it (builds with --features lpips).
    #[arg(long, value_name = "FILE")]
    pub lpips: Option<PathBuf>,
    /// Measure HDR-ꟻLIP too, the error seen by flipping between two images at any exposure (some hundredths of a second a tile and set).
    #[arg(long)]
    pub flip: bool,
}

#[derive(Debug, Args)]
pub struct Compare {
    /// The dataset's folder.
    pub dataset: PathBuf,
    /// Tiles of 128×128 texels to compare on, at most; which, the seed decides [default: all of the first page].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub tiles: Option<u32>,
    /// The transfer of the dataset's scene, baked alike (`bake SCENE --transfer`): PRT is compared, too.
    #[arg(long, value_name = "DIR", conflicts_with = "ablations")]
    pub transfer: Option<PathBuf>,
    /// A first look: brief trainings and faster presets of all encoders.
    #[arg(long)]
    pub draft: bool,
    /// The paper's ablations instead of other methods: 2D and 3D maps, training that knows of blocks, quantisation.
    #[arg(long)]
    pub ablations: bool,
    /// Run this method alone, by its name in the table; may be given several times [default: all].
    #[arg(long, value_name = "NAME", conflicts_with = "ablations")]
    pub method: Vec<String>,
    /// Render the scene, too, in the light of NDGI M, NTC L, PRT, ASTC 12×12 and the dataset's own bundle: at five moments by up to three
    /// cameras, and over a day; tiles from near. Tiles are those of all pages. The page is the report's name with .render.html.
    #[arg(long, conflicts_with_all = ["ablations", "tiles"])]
    pub render: bool,
    #[command(flatten)]
    pub looks: LooksArgs,
    /// Seed of all randomness.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the table to this file as well.
    #[arg(long)]
    pub csv: Option<PathBuf>,
    /// The report to write, with plots and pictures [default: <dataset>/<scene>.compare.html].
    #[arg(long)]
    pub report: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct Compress {
    /// The dataset's folder.
    #[arg(required = true)]
    pub dataset: Option<PathBuf>,
    /// Size of the representation, the same for all tiles: S, L, M or H; L.32, M.32 and S.32 with wider hidden layers, M.64 with yet wider ones.
    /// [default: M; S where the dataset keeps the sun's direct light apart]
    #[arg(long, value_parser = parse_profile)]
    pub profile: Option<Profile>,
    /// Choose what each tile has by brief trials, so that all tiles together reach about this pooled PSNR in dB (more if even
    /// the smallest configuration exceeds it).
    #[arg(long, value_name = "DB", allow_hyphen_values = true, value_parser = parse_positive, conflicts_with = "profile")]
    pub target_psnr: Option<f64>,
    /// The same, within so many bits per texel and set.
    #[arg(long, value_name = "B", allow_hyphen_values = true, value_parser = parse_positive, conflicts_with_all = ["profile", "target_psnr"])]
    pub target_bpp: Option<f64>,
    /// The bundle to write [default: <dataset>/<scene>.ndgi].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// The report to write [default: the bundle's name with .html].
    #[arg(long)]
    pub report: Option<PathBuf>,
    /// How long to train: draft (1000 steps per tile), medium (10000) or final (32000, and more passes of quantisation)
    /// [default: medium].
    #[arg(long, value_parser = parse_preset)]
    pub preset: Option<Preset>,
    /// The same as --preset draft.
    #[arg(long, conflicts_with = "preset")]
    pub draft: bool,
    /// Training steps per tile, instead of the preset's.
    #[arg(long, conflicts_with_all = ["preset", "draft"], value_parser = clap::value_parser!(u32).range(1..))]
    pub iterations: Option<u32>,
    /// Plan the training to end after this time, e.g. 90s, 5m, 2h: every tile gets about as many steps as the time allows for all, and at
    /// least 200. (Quantising takes some seconds a tile whatever the limit, and judging the bundle comes after it. What is written then depends on the machine and its load.)
    #[arg(long, value_name = "TIME", value_parser = typed::time_limit, conflicts_with_all = ["target_psnr", "target_bpp"])]
    pub time_limit: Option<Duration>,
    /// Write coarser levels for virtual texturing beside the bundle: NAME.1.ndgi of half the resolution, NAME.2.ndgi of a quarter, until
    /// every page fits in one tile (126 texels a side). What is at texel position p of a page is at p / 2^m of level m. All options apply
    /// to every level; a time limit is shared among them. Each level is judged by its own light, as `dataset halve` makes it.
    #[arg(long)]
    pub levels: bool,
    /// Leave the sun's direct light out, for readers that draw the sun themselves. The dataset must have it as a layer of its own.
    #[arg(long)]
    pub without_sun: bool,
    /// Let the sun's shadows fade from where they are at one set to where they are at the next, instead of moving there: saves bytes where
    /// nobody looks between the sets.
    #[arg(long, conflicts_with = "without_sun")]
    pub still_shadows: bool,
    /// Train one of N equal shares of the tiles, and write no bundle: for array jobs on many machines that share the dataset's folder. Shards
    /// are numbered from 1, run in any order, and may be run twice. Give all the same options; then --merge.
    #[arg(long, value_name = "I/N", conflicts_with_all = ["merge", "time_limit", "levels", "report"])]
    pub shard: Option<Shard>,
    /// Train nothing: write the bundle from what the shards have trained. Ends with exit code 75 and names the tiles where some are missing.
    /// Towards a target, shards make trial fits first: the first merge chooses by them what each tile gets, and the shards are to be run again.
    #[arg(long, conflicts_with_all = ["time_limit", "levels"])]
    pub merge: bool,
    /// Vector instructions to use: portable, avx2 or avx512 [default: the best this processor has]. They decide the last bits of what is
    /// trained: give the same to all machines that work on a bundle.
    #[arg(long, value_name = "NAME", value_parser = parse_instructions)]
    pub instructions: Option<Tier>,
    /// Seed of all randomness.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Train every tile again, even those a stopped run finished; replace a bundle that was trained for more steps, or another
    /// scene's bundle, or a file that is not a bundle. With --shard and --merge it only allows to replace the bundle.
    #[arg(long)]
    pub force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LightName {
    All,
    Baked,
    Sun,
}

fn parse_profile(name: &str) -> Result<Profile, String> {
    let known = || PROFILES.map(|profile| profile.name).join(", ");
    let found = PROFILES.into_iter().find(|profile| profile.name.eq_ignore_ascii_case(name));
    found.ok_or_else(|| format!("expected one of {}", known()))
}

fn parse_preset(name: &str) -> Result<Preset, String> {
    let found = PRESETS.into_iter().find(|preset| preset.name == name);
    found.ok_or_else(|| format!("expected one of {}", PRESETS.map(|preset| preset.name).join(", ")))
}

fn parse_instructions(name: &str) -> Result<Tier, String> {
    let available = Tier::available();
    let named = |tier: &&Tier| format!("{tier:?}").eq_ignore_ascii_case(name);
    available.iter().find(named).copied().ok_or_else(|| {
        let names: Vec<String> = available.iter().map(|tier| format!("{tier:?}").to_lowercase()).collect();
        format!("this processor has {}", names.join(", "))
    })
}

fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "expected a number above 0".to_owned())
}

/// The command line; ends the process where it is none, or asks for help.
pub fn parse() -> Cli {
    typed::refuse_misspelt::<Cli>("a dataset's folder");
    Cli::parse()
}
