//! The command line as typed.

use clap::{Args, Parser, Subcommand, ValueEnum};
use commands::console::{ConsoleArgs, refuse_arguments_not_utf8};
use commands::typed::{refuse_misspelt, time_limit};
use compressor::Result;
use compressor::bundle::MapCoding;
use compressor::compress::{PRESETS, Preset, Shard};
use compressor::lanes::Tier;
use compressor::model::{PROFILES, Profile};
use dataset::typed::hour;
use std::path::PathBuf;
use std::time::Duration;

const EXAMPLES: &str = "\
Examples:
  compress dataset/yard                                     writes yard.ndgi and yard.html into that folder
  compress dataset/yard --draft                             quick, at lower quality
  compress dataset/yard --time-limit 5m                     trains as long as that allows
  compress dataset/yard --target-psnr 40                    more bits for the tiles that need them
  compress dataset/yard --levels                            also yard.1.ndgi, yard.2.ndgi, ...: coarser levels for virtual texturing
  compress dataset/yard --without-sun                       for a game that draws the sun itself
  compress decode dataset/yard/yard.ndgi --hour 18.05 --out evening.exr
  compress evaluate dataset/yard --csv quality.csv
  compress dataset/yard --coding basis                      planes instead of neural maps
  compress sweep dataset/yard --tiles 4 --presets draft     compares profiles
  compress compare dataset/yard --draft                     compares other methods
  compress info dataset/yard/yard.ndgi
  compress dataset/city --shard 3/16                        one of sixteen array jobs; once all are done:
  compress dataset/city --merge                             (complete scripts: compressor/CLUSTER.md)
  compress view dataset/yard                                a page that plays the day in a browser

To continue a stopped run, give the same command again (a time limit starts anew).

Exit codes: 0 success; 1 invalid input, 2 an invalid command line: do not retry; 75 retry later (another run is active, shards are missing, the
disk is full, the port of `view --serve` is taken); 143, 130, 129 ended by SIGTERM, Ctrl-C, a closed terminal.

Keys of the --json object (null where not available):
  psnr_db                mean PSNR over (tile, frame) pairs, peak = the tile's largest valid value
  psnr_range_db          the same with peak = largest - smallest
  psnr_pooled_db         PSNR of the mean squared error relative to the peak, so bad tiles count in full
  psnr_distinct_db       psnr_db over the frames that differ (frames_distinct of them)
  psnr_8bit_db           psnr_db after the 8-bit four-channel output
  psnr_log_db            psnr_db of ln(1 + E/e), e = 0.001 of the page's mean: sensitive to errors in the dark
  psnr_worst_percent_db  mean of the worst 1 % of the pairs
  psnr_unquantised_db    before quantisation, mean over the trained tiles (compress only)
  psnr_8bit_features_db  the same with all features rounded to 8 bits (compress only)
  noise_ceiling_db       the bake's own sampling error as a PSNR, mean
  one_minus_ssim         1 - mean structural similarity (11x11 Gaussian, sigma 1.5); one_minus_ssim_uniform: with a 7x7 box window
  psnr_256_db, psnr_range_256_db, one_minus_ssim_256   on tiles of 256x256 texels instead of 128x128
  local_error_median, local_error_p95, local_error_p99   local error of half, 95 %, 99 % of the texels: RMS over the channels / the mean light
                         of the texel's 16x16 cell, or / its tile's floor if that is more: 1/30 of the median light (black tiles do not count)
  chroma_error_...       the part of these errors that is not grey, likewise; colour_distance_...: distance in u'v' (CIE 1976), of texels above
                         the floor
  worst_hour             the hour of the largest local_error_p95, of hours with a mean of at least 0.1 lux
  worst_tile             of these hours, the tile of the largest local_error_p95: hour, page, x0, y0, x1, y1, local_error_p95
  scene_flip             mean LDR-FLIP of the report's picture of the scene, exposed for each hour (evaluate with --flip)
  reference              with --reference: bundle and dataset, each compared with it: psnr_db, psnr_pooled_db, psnr_worst_percent_db, local_error_...,
                         chroma_error_..., colour_distance_..., worst_hour, worst_tile, hours (evaluate only)
  lpips, flip            mean LPIPS (with --lpips) and HDR-FLIP (with --flip)
  relative_error         mean of RMSE / mean
  dark_relative_error    the same over the darkest quarter of each frame's texels, mean over frames whose mean is at least 0.1 lux
  constant_relative_error  the same over pairs constant in space, which have no PSNR
  pairs, pairs_constant, pairs_black   pairs evaluated, evaluated separately, not evaluated
  bpp, bytes             bits per texel and frame (all texels count), bytes of the bundle; bytes_of_sun: of these, the sun's tiles,
                         bytes_of_shadows: how its shadows move
  bits_per_valid_texel   the same per valid texel and frame; bits_per_valid_texel_distinct: where equal frames count once
  psnr_sunny_db, psnr_pooled_sunny_db   over the frames that the sun lights directly
  psnr_without_sun_db, psnr_pooled_without_sun_db   without the sun's direct light, where that is a separate stream
  seam_ratio             error of the difference between neighbouring texels, across tile borders / inside tiles
  between_median_db      median psnr_pooled_db at times between frames, against the dataset's own light or a withheld
                         bake; between_worst_db: the lowest
  between_linear_median_db  the same of linear interpolation, against the withheld bake
  sun_between_pooled_db  of the sun's direct light at twelve times of day, against the dataset's visibility, where it is a separate stream;
                         sun_between_mean_db: mean; sun_between_worst_db: of the worst 5 %
  step_error             between consecutive frames, RMS error of the change of light / RMS of the change; switch_error: across switches
                         (changes below 0.001 of the light are ignored)
  hours                  a list of hour, psnr_db, psnr_range_db, psnr_pooled_db, psnr_worst_percent_db, noise_ceiling_db, psnr_log_db,
                         one_minus_ssim, relative_error, dark_relative_error, local_error_..., chroma_error_..., colour_distance_..., mean_light (in
                         the dataset's unit), scene_flip, scene_flip_p95, scene_flip_p99
  steps                  a list of from, to (hours), switch, error
  tiles, seconds         tiles of the bundle, wall-clock seconds of the command
  bundle, report         paths written (compress only)
  levels                 with --levels, a list of level, bundle, pages, tiles, bytes, psnr_db, psnr_pooled_db, up_to_date (compress only)
  steps_min, steps_max     training steps of a tile with light (compress only)
  tiles_empty, tiles_resumed, training_cpu_seconds, up_to_date   (compress only; seconds of the run that trained it)
  matches_dataset        whether the bundle was made from the dataset's present light (evaluate only)
  decode_seconds         wall-clock seconds of decoding all frames (evaluate only)";

const SWEEP_EXAMPLES: &str = "\
Examples:
  compress sweep dataset/yard --tiles 4 --presets draft        a few minutes
  compress sweep dataset/yard --profiles M --presets draft,medium,final --csv m.csv

Each tile is trained as by `compress --profile … --preset …` with --seed. The three PSNRs are of one training: the float
model, the same with all features rounded to 8 bits, and the stored tile in BC7; bpp counts only the texels of the trained tiles. With --json: tiles, tiles_of, is_sun_apart, rows (profile,
preset, bpp, psnr_unquantised_db, psnr_8bit_features_db, psnr_bc7_db, one_minus_ssim, seconds), report, seconds.";

const COMPARE_EXAMPLES: &str = "\
Examples:
  compress compare dataset/yard --draft                     quick results, first page only
  compress compare dataset/yard --tiles 16 --csv yard.csv   minutes to hours
  compress compare dataset/yard --transfer dataset/yard-transfer   includes precomputed radiance transfer
  compress compare dataset/yard --draft --ablations
  compress compare dataset/yard --draft --render            also renders the scene with each method's light
  compress compare dataset/yard --render --method \"NDGI M\" --method \"NTC L\" --method \"ASTC 12x12\" --method BC7

BC6H, BC7 and ASTC need a build with --features baselines. How each method is set up: compressor/BASELINES.md. With --json: tiles,
tiles_of, frames, draft, ablations, noise_ceiling_db, rows (family, method, bpp, psnr_db and other means, encode_seconds of a tile,
decode_milliseconds of 1024x1024 texels, note), skipped, rendered, report, seconds. With --render, rendered has cameras, times (hour, what, frame), views (camera, hour, method,
bpp, bytes, psnr_db, ssim, flip), crops (what, tile, hour, method, psnr_db, bytes), lapse (method, error, relative_error, worst, steps),
lapse_camera, lapse_change, skipped and page; it is null otherwise.";

const STATUS_EXAMPLES: &str = "\
Examples:
  compress status dataset/city
  watch -n 10 compress status dataset/city

With --json: bundle, working (whether any shard has reported), fault (why the bundle cannot be read, or null), and, if working, stage
(reading, trials or training), done, tiles, psnr_db, seconds_left, of, and shards: a list of shard (number, of), recipe, stage, of_tiles, done,
tiles, resumed, psnr_db, texels, seconds, process, instructions, program, error, at (seconds since 1970).";

const VIEW_EXAMPLES: &str = "\
Examples:
  compress view dataset/yard                       writes dataset/yard/yard.view.html; open it in a browser
  compress view dataset/yard/yard.ndgi --out day.html --no-reference
  compress view other.ndgi --scene dataset/yard/scene.glb
  compress view --serve dataset/city               at http://127.0.0.1:8017/ until interrupted; --serve=8080 uses that port

The page needs WebGL 2 and no network. One file holds up to 128 MiB (bundle, geometry and reference, before base64); above that, use --serve.
A written page includes up to 4 MiB of reference lightmaps; --serve offers all of them. With --json: scene, bundle, geometry (null without one),
cameras, page and bytes, or with --serve url.";

const INFO_EXAMPLES: &str = "\
Examples:
  compress info dataset/yard/yard.ndgi
  compress info dataset/yard/yard.ndgi --json | jq .written.seed

With --json: scene, profile, pages, hours, hours_between, groups, tiles, tiles_empty, contents, sun_times, written, bpp and bytes, of which: bytes_of_header (with the
index), bytes_resident (means and peaks of all tiles), bytes_of_sun, bytes_of_shadows; the rest is features and decoders. bytes_held_of_sun: memory for the
sun's streams of all tiles at one time, in a compact layout (visibility in 3 bits, normals as stored); ndgi-gpu needs more.";

/// Compresses a dataset (the lightmaps of a day) into a random-access bundle and measures its quality.
#[derive(Debug, Parser)]
#[command(name = "compress", version, after_long_help = EXAMPLES, after_help = "Details and examples: compress --help")]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub compress: Compress,
    #[command(flatten)]
    pub console: ConsoleArgs,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Decode one atlas page at one time of day to an EXR image.
    #[command(after_help = "Example: compress decode dataset/yard/yard.ndgi --hour 18.05 --out evening.exr")]
    Decode {
        /// The bundle.
        bundle: PathBuf,
        /// Time of day: hours from 0 to below 24, such as 18.05 or 18:03.
        #[arg(long, allow_hyphen_values = true, value_parser = hour)]
        hour: f64,
        /// The image to write.
        #[arg(long)]
        out: PathBuf,
        /// The atlas page's number.
        #[arg(long, default_value_t = 0)]
        page: usize,
        /// Which light: all; or, where the sun is a separate stream, only its direct light (sun) or all other
        /// light (baked).
        #[arg(long, value_enum, default_value_t = LightName::All)]
        light: LightName,
    },
    /// Compare a bundle with its dataset: a table by hour, and optionally every tile as CSV.
    #[command(
        after_help = "Examples:\n  compress evaluate dataset/yard --csv quality.csv\n  compress evaluate dataset/yard --reference dataset/yard-final --flip\nKeys of --json: compress --help"
    )]
    Evaluate {
        /// The dataset's folder.
        dataset: PathBuf,
        /// The bundle [default: <dataset>/<scene>.ndgi].
        #[arg(long)]
        bundle: Option<PathBuf>,
        /// A bake of the same scene at other hours: evaluate the bundle there too, compared with linear
        /// interpolation of the frames.
        #[arg(long, value_name = "DATASET")]
        withheld: Option<PathBuf>,
        /// A converged bake of the same scene, layout and hours (or more hours): also compare the bundle and
        /// the dataset with it. How far the dataset is from it is the dataset's own noise.
        #[arg(long, value_name = "DATASET")]
        reference: Option<PathBuf>,
        #[command(flatten)]
        slow_metrics: SlowMetricsArgs,
        /// Write one line per (tile, frame) to this file.
        #[arg(long)]
        csv: Option<PathBuf>,
    },
    /// Compare profiles and presets on some tiles of a dataset: bits, PSNR before and after quantisation,
    /// seconds.
    #[command(after_help = SWEEP_EXAMPLES)]
    Sweep(Sweep),
    /// Compare NDGI with block compression, keyframes, SVD, NTC and PRT on some tiles of a dataset.
    #[command(after_help = COMPARE_EXAMPLES)]
    Compare(Compare),
    /// Write a page that plays a compressed day in a browser: one self-contained HTML file.
    #[command(after_help = VIEW_EXAMPLES)]
    View(View),
    /// Show the progress of a bundle's shards in one line.
    #[command(after_help = STATUS_EXAMPLES)]
    Status {
        /// The dataset's folder.
        dataset: PathBuf,
        /// The bundle that the shards train [default: <dataset>/<scene>.ndgi].
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Show a bundle's contents, sizes and settings.
    #[command(after_help = INFO_EXAMPLES)]
    Info {
        /// The bundle.
        bundle: PathBuf,
    },
}

#[derive(Debug, Args)]
pub(crate) struct View {
    /// The dataset's folder, or a bundle.
    pub input: PathBuf,
    /// The bundle [default: INPUT if it is a bundle, else <dataset>/<scene>.ndgi].
    #[arg(long)]
    pub bundle: Option<PathBuf>,
    /// The page to write [default: the bundle's name with .view.html].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// The geometry with lightmap coordinates, a GLB file [default: the dataset's, or scene.glb beside the
    /// bundle; without one, the page shows only the atlas].
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Replace an HTML file that this command did not write; never a dataset's report.
    #[arg(long, conflicts_with = "serve")]
    pub force: bool,
    /// Omit the dataset's lightmaps, which the page shows for comparison.
    #[arg(long)]
    pub no_reference: bool,
    /// Serve the page on this machine instead of writing it [default port: 8017; 0: any free port].
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "8017", conflicts_with = "out")]
    pub serve: Option<u16>,
}

#[derive(Debug, Args)]
pub(crate) struct Sweep {
    /// The dataset's folder.
    pub dataset: PathBuf,
    /// Train at most this many tiles; the seed selects them.
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
    /// Also write the table to this CSV file.
    #[arg(long)]
    pub csv: Option<PathBuf>,
    /// The report to write, with PSNR against seconds [default: <dataset>/<scene>.sweep.html].
    #[arg(long)]
    pub report: Option<PathBuf>,
}

/// Slow quality metrics.
#[derive(Debug, Args)]
pub(crate) struct SlowMetricsArgs {
    /// Also measure LPIPS with this network: an ONNX file written by dataset/python/export_lpips.py (builds
    /// with --features lpips).
    #[arg(long, value_name = "FILE")]
    pub lpips: Option<PathBuf>,
    /// Also measure HDR-ꟻLIP, the error seen when flipping between two images at any exposure (about 0.05 s
    /// per tile and frame). `compress evaluate` also measures ꟻLIP of a picture of the scene at each hour,
    /// exposed as an eye adapts: the log-average luminance becomes middle grey, or less where the 95th
    /// percentile would be above white.
    #[arg(long)]
    pub flip: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Compare {
    /// The dataset's folder.
    pub dataset: PathBuf,
    /// Largest number of tiles (128×128 texels) to compare; the seed selects them [default: all of the first
    /// page].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub tiles: Option<u32>,
    /// The transfer of the dataset's scene, baked with the same settings (`bake SCENE --transfer`): also
    /// compare PRT.
    #[arg(long, value_name = "DIR", conflicts_with = "ablations")]
    pub transfer: Option<PathBuf>,
    /// Quick results: short training and fast presets of all encoders.
    #[arg(long)]
    pub draft: bool,
    /// Run the paper's ablations instead of other methods: 2D and 3D maps, block-aware training,
    /// quantisation.
    #[arg(long)]
    pub ablations: bool,
    /// Run only this method, by its name in the table; repeatable [default: all].
    #[arg(long, value_name = "NAME", conflicts_with = "ablations")]
    pub method: Vec<String>,
    /// Also render the scene with the light of NDGI M, NTC L, PRT, ASTC 12×12 and the dataset's own bundle:
    /// at five times from up to three cameras, over a day, and close-ups of tiles. Uses the tiles of all
    /// atlas pages. The HTML file has the report's name with .render.html.
    #[arg(long, conflicts_with_all = ["ablations", "tiles"])]
    pub render: bool,
    #[command(flatten)]
    pub slow_metrics: SlowMetricsArgs,
    /// Seed of all randomness.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Also write the table to this CSV file.
    #[arg(long)]
    pub csv: Option<PathBuf>,
    /// The report to write, with plots and pictures [default: <dataset>/<scene>.compare.html].
    #[arg(long)]
    pub report: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct Compress {
    /// The dataset's folder.
    #[arg(required = true)]
    pub dataset: Option<PathBuf>,
    /// Size of the feature maps, the same for all tiles: S, L, M or H; S.32, L.32 and M.32 have hidden
    /// layers of 32 units instead of 16, M.64 of 64. [default: M; S where the dataset stores the sun's direct
    /// light separately]
    #[arg(long, value_parser = parse_profile)]
    pub profile: Option<Profile>,
    /// How maps are coded. neural: feature maps and a tiny network per tile, trained: 8 to 12 bits a texel in
    /// memory for the whole day, decoded by shaders. basis: planes that all hours share, lamps apart: cleaner
    /// nights, encoded in seconds; the compute shader and the stream do not decode it yet.
    #[arg(long, value_name = "CODING", default_value = "neural", value_parser = parse_coding)]
    pub coding: MapCoding,
    /// Choose what each tile stores by brief trial fits, so that all tiles together reach about this pooled
    /// PSNR in dB (more if even the smallest choices exceed it).
    #[arg(long, value_name = "DB", allow_hyphen_values = true, value_parser = parse_positive, conflicts_with = "profile")]
    pub target_psnr: Option<f64>,
    /// Choose what each tile stores by trial fits, for the best quality within this many bits per texel and
    /// frame.
    #[arg(long, value_name = "B", allow_hyphen_values = true, value_parser = parse_positive, conflicts_with_all = ["profile", "target_psnr"])]
    pub target_bpp: Option<f64>,
    /// The bundle to write [default: <dataset>/<scene>.ndgi].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// The report to write [default: the bundle's name with .html].
    #[arg(long)]
    pub report: Option<PathBuf>,
    /// How long to train: draft (1000 steps per tile), medium (10000) or final (32000, and more passes of
    /// quantisation) [default: medium].
    #[arg(long, value_parser = parse_preset)]
    pub preset: Option<Preset>,
    /// The same as --preset draft.
    #[arg(long, conflicts_with = "preset")]
    pub draft: bool,
    /// Training steps per tile, instead of the preset's.
    #[arg(long, conflicts_with_all = ["preset", "draft"], value_parser = clap::value_parser!(u32).range(1..))]
    pub iterations: Option<u32>,
    /// Plan the training to end after this time, e.g. 90s, 5m, 2h: every tile gets as many steps as the time
    /// allows for all, but at least 200. (Quantisation takes a few seconds per tile regardless of the limit,
    /// and evaluation follows after it. The bytes written depend on the machine and its load.)
    #[arg(long, value_name = "TIME", value_parser = time_limit, conflicts_with_all = ["target_psnr", "target_bpp"])]
    pub time_limit: Option<Duration>,
    /// Also write coarser levels for virtual texturing: NAME.1.ndgi at half the resolution, NAME.2.ndgi at a
    /// quarter, until every page fits in one tile (126 texels a side). Texel position p of a page is at p /
    /// 2^m in level m. All options apply to every level; a time limit is shared among them. Each level is
    /// evaluated against the halved dataset, as `dataset halve` makes it.
    #[arg(long)]
    pub levels: bool,
    /// Omit the sun's direct light, for engines that draw the sun themselves. The dataset must store it as a
    /// separate layer.
    #[arg(long)]
    pub without_sun: bool,
    /// Cross-fade the sun's shadows from one frame to the next instead of moving them: saves bytes when
    /// times between frames do not matter.
    #[arg(long, conflicts_with = "without_sun")]
    pub still_shadows: bool,
    /// Train one of N equal shares of the tiles without writing a bundle: for array jobs on machines that
    /// share the dataset's folder. Shards are numbered from 1, run in any order, and may be repeated. Give
    /// all of them the same options; then run --merge.
    #[arg(long, value_name = "I/N", conflicts_with_all = ["merge", "time_limit", "levels", "report"])]
    pub shard: Option<Shard>,
    /// Write the bundle from the tiles that shards have trained. If tiles are missing, name them and exit
    /// with code 75. With a target, the first run of the shards makes trial fits, from which the first merge
    /// chooses what each tile stores (with --target-psnr it trains up to 16 tiles to do so); then run the
    /// shards and --merge again.
    #[arg(long, conflicts_with_all = ["time_limit", "levels"])]
    pub merge: bool,
    /// Vector instructions to use: portable, avx2 or avx512 [default: the best this processor has]. They
    /// affect the last bits of what is trained: use the same on all machines that train a bundle.
    #[arg(long, value_name = "NAME", value_parser = parse_instructions)]
    pub instructions: Option<Tier>,
    /// Seed of all randomness.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Retrain every tile, even those a stopped run finished; replace a bundle that was trained for more
    /// steps, another scene's bundle, or a file that is not a bundle. With --shard and --merge, only allow
    /// replacing the bundle.
    #[arg(long)]
    pub force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LightName {
    All,
    Baked,
    Sun,
}

fn parse_profile(name: &str) -> Result<Profile, String> {
    let known = || PROFILES.map(|profile| profile.name).join(", ");
    let found = PROFILES.into_iter().find(|profile| profile.name.eq_ignore_ascii_case(name));
    found.ok_or_else(|| format!("expected one of {}", known()))
}

fn parse_coding(name: &str) -> Result<MapCoding, String> {
    match name {
        "neural" => Ok(MapCoding::Neural),
        "basis" => Ok(MapCoding::Basis),
        _ => Err("expected neural or basis".to_owned()),
    }
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

/// Parses the command line; exits if it is invalid or asks for help.
pub(crate) fn parse() -> Cli {
    refuse_arguments_not_utf8::<Cli>();
    refuse_misspelt::<Cli>("a dataset's folder");
    Cli::parse()
}
