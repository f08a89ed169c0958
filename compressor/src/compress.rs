//! Compresses a dataset into a bundle: tiles in parallel, resumable.
//!
//! Every finished tile is stored in the folder `<bundle>.part/` until the bundle is written, so that a
//! stopped run continues where it was. The bytes written depend on the dataset, the options and the
//! processor's instruction set (which rounds sums in its own order), never on threads or time, unless there
//! is a time limit.

mod part;
mod shard;
mod stats;
mod allocate;
mod pace;
mod tiles;
mod outcome;

pub(crate) use tiles::{of_tile, seed};

use crate::bundle::{self, Bundle, Header, Payload};
use crate::grid::{Grid, Place};
use crate::law::{Law, can_omit_sun, is_sun_apart};
use crate::model::{PROFILES, Profile};
use crate::sunlight::Sunlight;
use crate::tile::Band;
use crate::time::{Coding, Timeline};
use crate::train::{Aim, Recipe};
use crate::{Error, Result, of_bundle, printable};
use dataset::config::{Layer, Light, PageKind};
use dataset::console::{count, stop_if_interrupted};
use dataset::files::{expect_writable, sync_folder_of, write_atomically};
use dataset::image::Mask;
use dataset::observe::Observer;
use dataset::store::Dataset;
pub use outcome::{CurvePoint, Outcome, TileOutcome};
use part::Part;
use rayon::prelude::*;
use serde_json::json;
use shard::Notes;
pub use shard::{Note, Shard, Stage, Status, status};
pub use stats::TileStats;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Duration, Instant};
use tiles::Tiles;

/// How long and how carefully tiles are trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Steps of the main phase.
    pub iterations: usize,
    /// See [`Recipe::passes`].
    pub passes: usize,
}

/// Quick results.
pub const DRAFT: Preset = Preset { name: "draft", iterations: 1000, passes: 2 };
/// The default.
pub const MEDIUM: Preset = Preset { name: "medium", iterations: 10_000, passes: 2 };
/// The best quality.
pub const FINAL: Preset = Preset { name: "final", iterations: 32_000, passes: 4 };
/// All presets, the shortest first.
pub const PRESETS: [Preset; 3] = [DRAFT, MEDIUM, FINAL];

/// How tiles' configurations are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Profile M; S where the dataset stores the sun's direct light separately, because the rest is smooth in
    /// time.
    Usual,
    /// The same profile for all tiles, omitting what a tile does not need.
    Profile(Profile),
    /// By trial fits, so that all tiles together reach about this pooled PSNR in dB.
    Psnr(f64),
    /// By trial fits, within this many bits per texel and frame for the whole bundle.
    Bpp(f64),
}

/// Options of a compression.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// How tiles' configurations are chosen.
    pub rate: Rate,
    /// Steps of the main phase; with a time limit, at most this many.
    pub iterations: usize,
    /// See [`Recipe::passes`].
    pub passes: usize,
    /// Time from the run's start at which training is planned to end: all tiles get about the same number of
    /// steps. The bytes then depend on the machine and its load. Only with [`Rate::Profile`], because the
    /// time of trial fits cannot be planned.
    pub time_limit: Option<Duration>,
    /// Omit the sun's direct light, which the dataset stores separately: the bundle's reader draws the sun
    /// itself.
    pub without_sun: bool,
    /// Cross-fade the sun's shadows from frame to frame instead of moving them.
    pub still_shadows: bool,
    /// Seed of all randomness.
    pub seed: u64,
    /// The bundle's path; `None` for [`default_bundle`].
    pub out: Option<PathBuf>,
    /// Retrain every tile, even those a stopped run finished, and replace an existing bundle. Shards and
    /// merges only do the latter.
    pub force: bool,
    /// Write the bundle from the tiles that shards have trained or, with a target, first choose
    /// configurations from their trial fits. [`Rate::Psnr`] trains a few tiles to choose.
    pub merge: bool,
}

impl Options {
    /// The recipe of all tiles; each has its own seed.
    fn recipe(&self) -> Recipe {
        let aim = match self.rate {
            Rate::Usual | Rate::Profile(_) => Aim::MeanPsnr,
            _ => Aim::PooledError,
        };
        Recipe { iterations: self.iterations, passes: self.passes, paper: false, seed: self.seed, aim }
    }

    /// The defaults with a preset's training.
    pub fn of(preset: Preset) -> Self {
        Options {
            rate: Rate::Usual,
            iterations: preset.iterations,
            passes: preset.passes,
            time_limit: None,
            without_sun: false,
            still_shadows: false,
            seed: 1,
            out: None,
            force: false,
            merge: false,
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Options::of(MEDIUM)
    }
}

/// Default path of a dataset's bundle: `<dataset>/<scene>.ndgi`.
pub fn default_bundle(dataset: &Dataset) -> PathBuf {
    dataset.root.join(format!("{}.ndgi", dataset.config.scene))
}

/// The digest of the light that a bundle was made from ([`dataset::config::Config::digest_of_light`]), if the
/// bundle has it.
pub fn light_of(header: &Header) -> Option<String> {
    let info: serde_json::Value = serde_json::from_str(&header.info).ok()?;
    Some(info["inputs"].as_str()?.to_owned())
}

/// True if a bundle omits the sun's direct light that its dataset stores separately.
pub(crate) fn sun_is_omitted(header: &Header) -> bool {
    let info: serde_json::Value = serde_json::from_str(&header.info).unwrap_or_default();
    info["sun"] == "left out"
}

/// Trains every tile of the dataset in `root` (with [`Options::merge`], takes those of shards), and writes
/// the bundle and `<bundle>.run.json` with timings.
///
/// # Errors
/// [`Error::Invalid`] for a dataset that is invalid (a truncated file, a NaN, …), before anything is written;
/// [`Error::Unready`] if another run is writing the bundle, or with [`Options::merge`] while tiles are
/// missing; [`Error::Interrupted`]; [`Error::Io`]. An existing bundle stays as it was unless the run
/// succeeds.
pub fn compress(root: &Path, options: &Options, console: &dyn Observer) -> Result<Outcome> {
    let start = Instant::now();
    let dataset = Dataset::open(root)?;
    let job = Job::new(&dataset, options, console)?;
    expect_writable(&job.out)?;
    if !options.merge {
        job.check(console)?;
    }
    let part = Part::open(&job.out, options.force && !options.merge)?;
    if options.merge && !job.out.exists() {
        // A merge may be tried often until all tiles exist: report missing ones before reading anything
        // large.
        let header = header(&job, job.hours_of_shards(&part)?);
        job.tiles(&header, &part).expect_shards()?;
    }
    part.claim(&job.hours_key());
    let between = if options.merge { job.hours_of_shards(&part)? } else { job.hours()? };
    let header = job.header_with_sun(between, console)?;
    if let Some(outcome) = job.existing(&header, console).transpose() {
        // (Also what a run left that was killed at its end.)
        if outcome.is_ok() {
            job.tiles(&header, &part).claim();
        }
        part.remove();
        sync_folder_of(&job.out);
        return outcome;
    }
    let suns = match job.sunlight.as_ref().zip(header.sun.as_ref()) {
        Some((sunlight, sun)) => sunlight.sections(sun, &job.masks, console)?,
        None => Vec::new(),
    };
    let mut tiles = job.tiles(&header, &part);
    tiles.bytes_of_sun = suns.iter().flatten().map(|section| section.bytes.len() as u64).sum();
    tiles.deadline = options.time_limit.map(|limit| start + limit);
    if options.merge {
        tiles.expect_shards()?;
        job.check(console)?;
        job.expect_hours(&part, &header)?;
    }
    tiles.is_verified = true;
    let checked = start.elapsed().as_secs_f64();
    let mut work = tiles.work(console)?;
    for ([sun, shadows], payload) in suns.into_iter().zip(&mut work.payloads) {
        (payload.sun, payload.shadows) = (sun, shadows);
    }
    // Without moving shadows the stream is omitted.
    let shadows = work.payloads.iter().any(|payload| !payload.shadows.bytes.is_empty());
    let header = Header { shadows, ..header };
    let bytes = bundle::encode(&header, &work.payloads).map_err(of_bundle)?;
    write_atomically(&job.out, &bytes)?;
    part.finish()?;

    let outcome = Outcome::new(&header, job.out.clone(), bytes.len() as u64, &work, start, checked);
    outcome::write(&job.out, &outcome)?;
    let folder = part.folder().to_owned();
    let left = part.remove();
    if left > 0 {
        console.say(format!(
            "{}: {} of stopped runs with other settings remain (--force removes them)",
            folder.display(),
            count(left, "finished part")
        ));
    }
    Ok(outcome)
}

/// Result of a shard.
#[derive(Clone, Debug)]
pub enum Sharded {
    /// All tiles of its share are trained.
    Trained(Note),
    /// The trial fits of its share are done. Those of other shards may be missing, or no merge has chosen by
    /// them yet.
    TrialFits(Note),
    /// The bundle already exists.
    UpToDate(PathBuf),
}

/// Trains one share of the tiles into the work folder `<bundle>.part/`, which other shards use at the same
/// time. It writes no bundle: [`compress`] with [`Options::merge`] does that when all shards are done. With a
/// target, the first call makes trial fits, and once a merge has chosen configurations by those of all
/// shards, the next call trains.
///
/// # Errors
/// As [`compress`], of the rows of pages that it reads; [`Error::Unsupported`] with a time limit.
pub fn train_shard(root: &Path, options: &Options, shard: Shard, console: &dyn Observer) -> Result<Sharded> {
    if options.time_limit.is_some() {
        return Err(Error::unsupported("time_limit", "a time limit is not supported with shards; omit it"));
    }
    let dataset = Dataset::open(root)?;
    let job = Job::new(&dataset, options, console)?;
    // The full header is slow to compute: only if a bundle exists. (The work folder may be gone, or be
    // removed by a merge that waits for it.)
    if job.out.exists()
        && let Some(existing) = job.existing(&job.header_with_sun(job.hours()?, console)?, console)?
    {
        return Ok(Sharded::UpToDate(existing.bundle));
    }
    let part = Part::share(&job.out)?;
    let notes = Notes::start(&part, shard, &job.recipe)?;
    let train = || {
        let header = header(&job, job.keep_hours(&part)?);
        let tiles = job.tiles(&header, &part);
        let own = tiles.share(shard);
        job.check_bands(&own, console)?;
        tiles.train_shard(&notes, &own, console)
    };
    match train().inspect_err(|error| notes.failed(error))? {
        Stage::Trials => Ok(Sharded::TrialFits(notes.last())),
        Stage::Training => Ok(Sharded::Trained(notes.last())),
    }
}

/// Inputs of the work on a bundle, known before the first tile.
struct Job<'a> {
    dataset: &'a Dataset,
    /// With the rate resolved.
    options: Options,
    out: PathBuf,
    masks: Vec<Mask>,
    law: Law,
    sunlight: Option<Sunlight<'a>>,
    trained_on: String,
    /// Digest of the light and the options that decide tiles, for notes of shards.
    recipe: String,
}

impl<'a> Job<'a> {
    fn new(dataset: &'a Dataset, options: &Options, console: &dyn Observer) -> Result<Self> {
        if options.time_limit.is_some() && !matches!(options.rate, Rate::Usual | Rate::Profile(_)) {
            return Err(Error::unsupported(
                "time_limit",
                "a time limit is not supported with a target quality or size; omit one of them",
            ));
        }
        dataset.expect_day()?;
        let root = dataset.root.display();
        let config = &dataset.config;
        if options.without_sun && !can_omit_sun(config) {
            let layers = &config.layers;
            // In imported datasets, and in version 1, the layer is one sum.
            let is_whole =
                |layer: &Layer| (layer.light, layer.part) == (Light::Sun, dataset::config::Part::All);
            if layers.is_empty() || layers.iter().any(is_whole) {
                let what = "does not store the sun's direct light as a separate layer, so it cannot be omitted; drop --without-sun, or bake the dataset again";
                return Err(Error::invalid(root, what));
            }
            console.warn(format!("--without-sun has no effect: {root} has no direct light of the sun"));
        }
        let law = Law::new(dataset, is_sun_apart(config) || options.without_sun && can_omit_sun(config))?;
        let usual = PROFILES.into_iter().find(|profile| profile.name == if law.is_apart { "S" } else { "M" });
        let rate = match (options.rate, usual) {
            (Rate::Usual, Some(profile)) => Rate::Profile(profile),
            (rate, _) => rate,
        };
        let sunlight = match options.without_sun {
            true => None,
            false => Sunlight::new(dataset, !options.still_shadows)?,
        };
        let trained_on = trained_on(dataset, &law);
        let Options { iterations, passes, seed, without_sun, still_shadows, .. } = *options;
        let recipe =
            json!([trained_on, format!("{rate:?}"), iterations, passes, seed, without_sun, still_shadows]);
        Ok(Job {
            recipe: digest(&recipe),
            out: options.out.clone().unwrap_or_else(|| default_bundle(dataset)),
            masks: (0..config.pages.len()).map(|page| dataset.mask(page)).collect::<Result<Vec<_>>>()?,
            trained_on,
            options: Options { rate, ..options.clone() },
            dataset,
            law,
            sunlight,
        })
    }

    /// Reads all training data once, so that a bad texel or a truncated file stops the run before any
    /// training.
    fn check(&self, console: &dyn Observer) -> Result<()> {
        check_texels(self.dataset, console)?;
        // (Curves, masks and what the sun's stream is made of are verified where they are read.)
        let mut seen = BTreeSet::new();
        let mut files = self.law.layers(&self.dataset.config).flat_map(Layer::files);
        files.try_for_each(|file| match seen.insert(&file.path) {
            true => self.dataset.check_content(file),
            false => Ok(()),
        })
    }

    /// Reads the training data of some tiles once, so that a bad texel or a truncated file stops the run
    /// before any training: only their rows, not whole files.
    fn check_bands(&self, places: &[Place], console: &dyn Observer) -> Result<()> {
        let bands: BTreeSet<(usize, usize)> = places.iter().map(|place| (place.page, place.row)).collect();
        let progress = console.progress("checking", bands.len() as u64);
        for (page, row) in bands {
            stop_if_interrupted()?;
            drop(Band::load(self.dataset, &self.law, &self.masks[page], page, row)?);
            progress.advance(1);
        }
        Ok(())
    }

    /// The times between frames at which means are stored: [`Law::hours`].
    fn hours(&self) -> Result<Vec<f64>> {
        self.law.hours(self.dataset, &self.masks, &timeline(self.dataset))
    }

    /// The times between frames ([`Job::hours`]) as kept in the work folder, or computed if they are not
    /// there. They depend on the light of all pages; so only the first of many shards reads all pages.
    fn hours_of_shards(&self, part: &Part) -> Result<Vec<f64>> {
        match part.read::<Vec<f64>>(&self.hours_key()) {
            Some(kept) if self.law.has_curves() => Ok(kept.result),
            _ => self.hours(),
        }
    }

    /// The times between frames ([`Job::hours_of_shards`]); keeps them in the work folder.
    fn keep_hours(&self, part: &Part) -> Result<Vec<f64>> {
        let between = self.hours_of_shards(part)?;
        if self.law.has_curves() && part.read::<Vec<f64>>(&self.hours_key()).is_none() {
            part.write(&self.hours_key(), &Payload::default(), &between, None)?;
        }
        Ok(between)
    }

    /// Once checksums are verified: corrects the kept times between frames, with an error, if they were
    /// computed from other light.
    fn expect_hours(&self, part: &Part, header: &Header) -> Result<()> {
        let between = self.hours()?;
        if between == header.timeline.between {
            return Ok(());
        }
        part.write(&self.hours_key(), &Payload::default(), &between, None)?;
        let what = "the times between frames were computed from a file that was damaged or has been replaced since; they are corrected: run the shards \
                    again, then this command";
        Err(Error::unready(part.folder().display(), what))
    }

    fn hours_key(&self) -> String {
        digest(&json!(["hours", program(), self.trained_on, self.law.is_apart]))
    }

    /// The bundle's header with the sun's stream; `between`: [`Law::hours`].
    fn header_with_sun(&self, between: Vec<f64>, console: &dyn Observer) -> Result<Header> {
        let sun = self.sunlight.as_ref().map(|sunlight| sunlight.coded(&self.masks, console)).transpose()?;
        if self.options.still_shadows && sun.is_none() {
            console.warn(format!(
                "--still-shadows has no effect: {} has no shadows of the sun",
                self.dataset.root.display()
            ));
        }
        let shadows = self.sunlight.as_ref().is_some_and(Sunlight::moves);
        Ok(Header { sun, shadows, ..header(self, between) })
    }

    /// The existing bundle if it is up to date; an error if it must not be replaced.
    fn existing(&self, header: &Header, console: &dyn Observer) -> Result<Option<Outcome>> {
        if self.options.force {
            return Ok(None);
        }
        match existing_bundle(&self.out, header) {
            Existing::Same(outcome) => return Ok(Some(*outcome)),
            Existing::Protected(what) => {
                return Err(Error::invalid(
                    self.out.display(),
                    format!("{what}; choose another file with --out, or replace it with --force"),
                ));
            }
            Existing::Other(what) => console.say(format!("replacing {}: {what}", self.out.display())),
            Existing::None => {}
        }
        Ok(None)
    }

    /// The work on tiles, without the sun's stream and without a deadline.
    fn tiles<'b>(&'b self, header: &'b Header, part: &'b Part) -> Tiles<'b> {
        Tiles {
            bytes_of_sun: 0,
            dataset: self.dataset,
            law: &self.law,
            masks: &self.masks,
            options: &self.options,
            header,
            part,
            trained_on: &self.trained_on,
            recipe: &self.recipe,
            is_verified: false,
            deadline: None,
        }
    }
}

/// Digest of the running program: another build may train different bytes, so its tiles are retrained.
pub(crate) fn program() -> &'static str {
    static PROGRAM: LazyLock<String> = LazyLock::new(|| {
        // (The path may meanwhile hold another build; this is the file that runs.)
        let running = Path::new("/proc/self/exe");
        let path = || if running.exists() { Ok(running.to_owned()) } else { std::env::current_exe() };
        let digest = |path: PathBuf| -> std::io::Result<String> {
            let mut hasher = blake3::Hasher::new();
            std::io::copy(&mut std::fs::File::open(path)?, &mut hasher)?;
            Ok(hasher.finalize().to_hex()[..16].to_owned())
        };
        // A program that cannot be read trusts no tiles but its own.
        path().and_then(digest).unwrap_or_else(|_| format!("{:?}", dataset::process::Process::this()))
    });
    &PROGRAM
}

/// The state of the output path.
enum Existing {
    /// An up-to-date bundle (except for bytes that depend on the instruction set) with its training record.
    Same(Box<Outcome>),
    /// A file that only `--force` replaces, with the reason: not a bundle, one of another scene, or one of
    /// the same light that was trained for more steps.
    Protected(String),
    /// A bundle that is replaced, with the reason: another bake, other settings, or damage.
    Other(String),
    /// No file.
    None,
}

/// Compares the file at `out` with the requested bundle. With a time limit no bundle is up to date.
fn existing_bundle(out: &Path, header: &Header) -> Existing {
    if !out.exists() {
        return Existing::None;
    }
    let Ok(there) = Bundle::open(out) else {
        return match bundle::begins_like_one(out) {
            true => Existing::Other("this program cannot read it".to_owned()),
            false => Existing::Protected("is not a bundle".to_owned()),
        };
    };
    if there.header.scene != header.scene {
        return Existing::Protected(format!(
            "is a bundle of scene {}, not of {}",
            printable(&there.header.scene),
            header.scene
        ));
    }
    let reported =
        |header: &Header| serde_json::from_str::<serde_json::Value>(&header.info).unwrap_or_default();
    let (old, new) = (reported(&there.header), reported(header));
    let is_limited = !new["time_limit_secs"].is_null();
    // (Whether there are moving shadows is known only after searching for them, at the times in the header.)
    let header = &Header { shadows: header.shadows && there.header.shadows, ..header.clone() };
    let is_same = there.header == *header && !is_limited;
    let kept = outcome::read(out).filter(|outcome| is_same && outcome.bytes == there.bytes);
    if let Some(outcome) = kept {
        return Existing::Same(Box::new(outcome));
    }
    let differs = |key: &str| old[key] != new[key];
    // (With a time limit they are an upper bound.)
    let steps = old["iterations"].as_u64().filter(|_| old["time_limit_secs"].is_null());
    if let Some(steps) = steps.filter(|&steps| !differs("inputs") && new["iterations"].as_u64() < Some(steps))
    {
        let what = format!(
            "is a bundle of the same light trained for {steps} steps, more than the {} requested",
            new["iterations"]
        );
        return Existing::Protected(what);
    }
    let what = match () {
        () if is_same => "its training record (.run.json) is missing or belongs to another bundle".to_owned(),
        () if differs("inputs") => "it was compressed from a different bake".to_owned(),
        () if differs("trained_on") => "it was trained on different layers".to_owned(),
        () if differs("iterations") => {
            format!("it was trained for {} steps", printable(&old["iterations"].to_string()))
        }
        () if there.header == *header => "it is of an earlier run with a time limit".to_owned(),
        () => "it was made with other settings".to_owned(),
    };
    Existing::Other(what)
}

/// Reads every lightmap once, band by band, so that a bad texel or a truncated file stops the run before any
/// training.
fn check_texels(dataset: &Dataset, console: &dyn Observer) -> Result<()> {
    let frames = &dataset.config.frames;
    let mut seen = BTreeSet::new();
    let maps: Vec<(usize, usize)> = (0..frames.len())
        .flat_map(|frame| (0..dataset.config.pages.len()).map(move |page| (frame, page)))
        .filter(|&(frame, page)| seen.insert(&frames[frame].maps[page].path))
        .collect();
    let progress = console.progress("checking", maps.len() as u64);
    let faults: Vec<Result<()>> = maps
        .par_iter()
        .map(|&(frame, page)| {
            stop_if_interrupted()?;
            let height = dataset.config.pages[page].height as usize;
            for y in (0..height).step_by(crate::model::STORED) {
                dataset.map_rows(frame, page, y, (y + crate::model::STORED).min(height))?;
            }
            // After the texels' check, whose message says more than "the checksum differs".
            dataset.check_content(&frames[frame].maps[page])?;
            progress.advance(1);
            Ok(())
        })
        .collect();
    // The first fault in the dataset's order, whichever thread met one first.
    faults.into_iter().collect()
}

/// The bundle's header without the sun's stream; `between`: [`Law::hours`].
fn header(job: &Job, between: Vec<f64>) -> Header {
    let Job { dataset, law, options, .. } = job;
    let config = &dataset.config;
    let mut info = json!({
        "generator": concat!("compress ", env!("CARGO_PKG_VERSION")),
        "inputs": dataset.config.digest_of_light(),
        "trained_on": job.trained_on,
        "unit": config.unit,
        "profile": match options.rate {
            Rate::Profile(profile) => json!(profile.name),
            _ => json!(null),
        },
        "target_psnr_db": match options.rate {
            Rate::Psnr(target) => json!(target),
            _ => json!(null),
        },
        "target_bpp": match options.rate {
            Rate::Bpp(target) => json!(target),
            _ => json!(null),
        },
        "iterations": options.iterations,
        "passes": options.passes,
        "time_limit_secs": options.time_limit.map(|limit| limit.as_secs_f64()),
        "seed": options.seed,
        "sun": law.is_apart.then_some(if options.without_sun { "left out" } else { "apart" }),
    });
    // A coarser level names its level and the light it was made from.
    if let Some(halved) = config.halved() {
        (info["level"], info["level_of"]) = (json!(halved.times), json!(halved.light));
    }
    let grid =
        |page: &dataset::config::Page| Grid { width: page.width as usize, height: page.height as usize };
    Header {
        scene: config.scene.clone(),
        info: info.to_string(),
        pages: config.pages.iter().map(grid).collect(),
        kinds: config
            .pages
            .iter()
            .map(|page| match page.kind {
                PageKind::Atlas => bundle::PageKind::Atlas,
            })
            .collect(),
        sun: None,
        shadows: false,
        groups: config.groups.iter().map(|group| group.name.clone()).collect(),
        timeline: Timeline { between, ..timeline(dataset) },
    }
}

/// The dataset's hours, schedules and states.
pub(crate) fn timeline(dataset: &Dataset) -> Timeline {
    let config = &dataset.config;
    Timeline {
        hours: config.frames.iter().map(|frame| frame.hour).collect(),
        intervals: config.groups.iter().map(|group| group.on.clone()).collect(),
        states: config.frames.iter().map(|frame| frame.groups_on.clone()).collect(),
        between: vec![],
        coding: Coding::Standard,
    }
}

/// Digest of everything that decides a tile's training: the light, and the layers, which show which groups
/// light a tile.
fn trained_on(dataset: &Dataset, law: &Law) -> String {
    let config = &dataset.config;
    let files = |group: u32| {
        let layers = config.layers_of(Light::Group, Some(group));
        layers.flat_map(Layer::files).map(|file| file.blake3.clone()).collect::<Vec<_>>()
    };
    let mut layers: Vec<_> = (0..config.groups.len() as u32).map(files).collect();
    // With a separate sun, maps hold the sum of layers.
    if law.is_apart {
        layers.push(config.layers.iter().flat_map(Layer::files).map(|file| file.blake3.clone()).collect());
    }
    // With curves, their layers' shares of the light decide means.
    if law.has_curves() {
        let files = |layer: &'_ Layer| -> Vec<String> {
            layer.files().chain(&layer.curve).map(|file| file.blake3.clone()).collect()
        };
        layers.push(law.layers(config).flat_map(files).collect());
    }
    blake3::hash(json!([dataset.config.digest_of_light(), layers]).to_string().as_bytes())
        .to_hex()
        .to_string()
}

/// A digest as a file name.
fn digest(of: &serde_json::Value) -> String {
    blake3::hash(of.to_string().as_bytes()).to_hex()[..32].to_owned()
}

/// `path` with `suffix` appended to its name.
pub(crate) fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}
