//! Compresses a dataset into a bundle: tiles in parallel, resumable.
//!
//! Every finished tile is stored in the folder `<bundle>.part/` until the bundle is written, so that a
//! stopped run continues where it was. The bytes written depend on the dataset, the options and the
//! processor's instruction set (which rounds sums in its own order), never on threads or time, unless there
//! is a time limit.

mod options;
mod note;
mod part;
mod shard;
mod stats;
mod allocate;
mod pace;
mod tiles;
mod planes;
mod outcome;
mod existing;
mod job;
mod repair;

pub(crate) use job::timeline;
pub use note::{Note, Shard, Stage};
pub use options::{DRAFT, FINAL, MEDIUM, Options, PRESETS, Preset, Rate};
pub use outcome::{CurvePoint, Outcome, TileOutcome};
pub use shard::{Status, status};
pub use stats::TileStats;
pub(crate) use tiles::{of_tile, seed};

use crate::bundle::{self, Header};
use crate::{Error, Result, of_bundle};
use dataset::host::files::{
    create_folders, expect_nameable, expect_writable, sync_folder_of, write_atomically,
};
use dataset::observe::{Observer, count};
use dataset::store::Dataset;
use existing::is_alike;
use job::{Job, header};
use part::Part;
use shard::Notes;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Instant;

/// Default path of a dataset's bundle: `<dataset>/<scene>.ndgi`.
pub fn default_bundle(dataset: &Dataset) -> PathBuf {
    dataset.root.join(format!("{}.ndgi", dataset.config.scene))
}

/// The digest of the light that a bundle was made from ([`dataset::format::Config::digest_of_light`]), if the
/// bundle has it.
pub fn light_of(header: &Header) -> Option<String> {
    info(header)["inputs"].as_str().map(str::to_owned)
}

/// What a header says of how its bundle was made.
pub(crate) fn info(header: &Header) -> serde_json::Value {
    serde_json::from_str(&header.info).unwrap_or_default()
}

/// True if a bundle omits the sun's direct light that its dataset stores separately.
pub(crate) fn sun_is_omitted(header: &Header) -> bool {
    info(header)["sun"] == "left out"
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
    expect_nameable(&beside(&job.out, outcome::SUFFIX))?;
    if !options.merge {
        job.check(console)?;
    }
    if options.merge && !job.out.exists() {
        // A merge may be tried often until all tiles exist: report missing ones before anything large is read
        // or shards are kept out.
        job.expect_shards()?;
    }
    let part = Part::open(&job.out, options.force && !options.merge)?;
    part.claim(&job.hours_key());
    let between = if options.merge { job.hours_of_shards(&part)? } else { job.hours()? };
    let header = job.header_with_sun(between, console)?;
    if let Some((outcome, damaged)) = job.existing(&header, console)? {
        // (A merge trains nothing.)
        let is_repaired = || -> Result<bool> {
            Ok(!options.merge && repair::repair(&job, &header, &part, &damaged, console)?)
        };
        if damaged.is_empty() || is_repaired()? {
            // (Also what a run left that was killed at its end.)
            job.tiles(&header, &part).claim();
            part.remove(&job.recipe);
            sync_folder_of(&job.out);
            return Ok(Outcome { up_to_date: damaged.is_empty(), ..outcome });
        }
        console.say(format!("replacing {}: it is damaged", job.out.display()));
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
    let outcome = Outcome::new(&header, job.out.clone(), bytes.len() as u64, &work, start, checked);
    outcome::write(&job.out, &outcome)?;
    part.finish()?;
    let folder = part.folder().to_owned();
    let left = part.remove(&job.recipe);
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
    // (Each reads only its rows of large files; the merge compares what it read.)
    let dataset = Dataset::open(root)?.with_unverified_rows();
    let job = Job::new(&dataset, options, console)?;
    // The full header is slow to compute: only if a bundle of the same inputs exists. (The work folder may be
    // gone, or be removed by a merge that waits for it.)
    if job.out.exists() && !options.force {
        let header = header(&job, Vec::new());
        let header = match is_alike(&job.out, &header) {
            true => job.header_with_sun(job.hours()?, console)?,
            false => header,
        };
        if let Some((existing, damaged)) = job.existing(&header, console)?
            && damaged.is_empty()
        {
            return Ok(Sharded::UpToDate(existing.bundle));
        }
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
    let stage = train().inspect_err(|error| notes.failed(error))?;
    let sharded = if stage == Stage::Trials { Sharded::TrialFits } else { Sharded::Trained };
    Ok(sharded(notes.last()))
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
        path().and_then(digest).unwrap_or_else(|_| format!("{:?}", dataset::host::Process::this()))
    });
    &PROGRAM
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

/// The folder with such a name, created if it is missing.
pub(crate) fn folder_beside(path: &Path, suffix: &str) -> Result<PathBuf> {
    let folder = beside(path, suffix);
    match create_folders(&folder) {
        Err(error) if !folder.is_dir() => Err(Error::io(&folder)(error)),
        _ => Ok(folder),
    }
}
