//! From a dataset to a bundle: tiles in parallel, resumable.
//!
//! Every finished tile is kept in the folder `<bundle>.part/` until the bundle stands, so that a run that was stopped, by
//! whatever, continues where it was. What is written depends on the dataset, the options and the processor's instruction set
//! (which rounds sums in its own order), never on threads or time, unless there is a time limit.

mod part;
mod stats;
mod allocate;
mod pace;
mod tiles;
mod outcome;

pub(crate) use tiles::{of_tile, seed};

use crate::bundle::{self, Bundle, Header};
use crate::grid::Grid;
use crate::law::{Law, can_leave_sun_out, is_sun_apart};
use crate::model::{PROFILES, Profile};
use crate::sunlight::Sunlight;
use crate::time::{Coding, Timeline};
use crate::train::{Aim, Recipe};
use crate::{Error, Result, of_bundle, printable};
use dataset::config::{Layer, Light, PageKind};
use dataset::console::{Console, count, stop_if_interrupted};
use dataset::files::{expect_writable, sync_folder_of, write_atomically};
use dataset::image::Mask;
use dataset::store::Dataset;
pub use outcome::{CurvePoint, Outcome, TileOutcome};
use part::Part;
use rayon::prelude::*;
use serde_json::json;
pub use stats::TileStats;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
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

/// A first look.
pub const DRAFT: Preset = Preset { name: "draft", iterations: 1000, passes: 2 };
/// The default.
pub const MEDIUM: Preset = Preset { name: "medium", iterations: 10_000, passes: 2 };
/// What more time still buys.
pub const FINAL: Preset = Preset { name: "final", iterations: 32_000, passes: 4 };
/// All of them, the shortest first.
pub const PRESETS: [Preset; 3] = [DRAFT, MEDIUM, FINAL];

/// What tiles have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Profile M; S where the dataset keeps the sun's direct light apart: what is left is smooth in time.
    Usual,
    /// The maps of a profile, all tiles alike; only what a tile does not need is left out.
    Profile(Profile),
    /// What brief trials of each tile find: so much that all tiles together reach this pooled PSNR in dB, about.
    Psnr(f64),
    /// The same, within so many bits per texel and set for the whole bundle.
    Bpp(f64),
}

/// How to compress.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// What tiles have.
    pub rate: Rate,
    /// Steps of the main phase; with a time limit, at most so many.
    pub iterations: usize,
    /// See [`Recipe::passes`].
    pub passes: usize,
    /// Training is planned to end so long after the start of the run: all tiles get about as many steps, none of them is left out. The
    /// bytes then depend on the machine and its load. Goes with [`Rate::Profile`] alone: trials take what time they take.
    pub time_limit: Option<Duration>,
    /// Leave out the sun's direct light where the dataset keeps it apart: the bundle's reader draws the sun itself.
    pub without_sun: bool,
    /// Shadows of the sun fade from where they are at one set to where they are at the next, instead of moving there.
    pub still_shadows: bool,
    /// Seed of all randomness.
    pub seed: u64,
    /// The bundle's path; `None` for [`default_bundle`].
    pub out: Option<PathBuf>,
    /// Train every tile again, even where a stopped run left it finished.
    pub force: bool,
}

impl Options {
    /// The recipe of all tiles; each has a seed of its own.
    fn recipe(&self) -> Recipe {
        let aim = match self.rate {
            Rate::Usual | Rate::Profile(_) => Aim::MeanPsnr,
            _ => Aim::PooledError,
        };
        Recipe { iterations: self.iterations, passes: self.passes, paper: false, seed: self.seed, aim }
    }

    /// The defaults, trained as a preset says.
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
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Options::of(MEDIUM)
    }
}

/// Where the bundle of a dataset goes by default: `<dataset>/<scene>.ndgi`.
pub fn default_bundle(dataset: &Dataset) -> PathBuf {
    dataset.root.join(format!("{}.ndgi", dataset.config.scene))
}

/// The digest of the light that a bundle was made from ([`dataset::config::Config::digest_of_light`]), if it says so.
pub fn light_of(header: &Header) -> Option<String> {
    let info: serde_json::Value = serde_json::from_str(&header.info).ok()?;
    Some(info["inputs"].as_str()?.to_owned())
}

/// Whether a bundle lacks the sun's direct light, which its dataset keeps apart.
pub(crate) fn sun_is_left_out(header: &Header) -> bool {
    let info: serde_json::Value = serde_json::from_str(&header.info).unwrap_or_default();
    info["sun"] == "left out"
}

/// Trains every tile of the dataset in `root` and writes the bundle and, beside it, `<bundle>.run.json` with timings.
///
/// # Errors
/// [`Error::Invalid`] for a dataset that breaks a rule (a torn file, a NaN, …), before anything is written;
/// [`Error::Interrupted`]; [`Error::Io`]. An existing bundle stays as it was unless the run succeeds.
pub fn compress(root: &Path, options: &Options, console: &Console) -> Result<Outcome> {
    let start = Instant::now();
    if options.time_limit.is_some() && !matches!(options.rate, Rate::Usual | Rate::Profile(_)) {
        return Err(Error::unsupported("time_limit", "a target of quality or size has no time limit"));
    }
    let dataset = Dataset::open(root)?;
    dataset.expect_moments()?;
    let out = options.out.clone().unwrap_or_else(|| default_bundle(&dataset));
    expect_writable(&out)?;
    let masks = (0..dataset.config.pages.len()).map(|page| dataset.mask(page)).collect::<Result<Vec<_>>>()?;
    check_texels(&dataset, console)?;
    if options.without_sun && !can_leave_sun_out(&dataset.config) {
        let layers = &dataset.config.layers;
        // Light of others, and of version 1, is one sum.
        if layers.is_empty()
            || layers
                .iter()
                .any(|layer| (layer.light, layer.part) == (Light::Sun, dataset::config::Part::All))
        {
            let what = "does not keep the sun's direct light as a layer, so that it cannot be left out; expected no --without-sun";
            return Err(Error::invalid(root.display(), what));
        }
        console
            .warn(format!("--without-sun: {} has no direct light of the sun to leave out", root.display()));
    }
    let is_apart = is_sun_apart(&dataset.config) || options.without_sun && can_leave_sun_out(&dataset.config);
    let law = Law::new(&dataset, is_apart)?;
    if law.is_apart {
        // Tiles are trained to layers then.
        let mut seen = BTreeSet::new();
        let mut files = dataset.config.layers.iter().flat_map(Layer::files);
        files.try_for_each(|file| match seen.insert(&file.path) {
            true => dataset.check_content(file),
            false => Ok(()),
        })?;
    }
    let usual = PROFILES.into_iter().find(|profile| profile.name == if law.is_apart { "S" } else { "M" });
    let options = &match (options.rate, usual) {
        (Rate::Usual, Some(profile)) => Options { rate: Rate::Profile(profile), ..options.clone() },
        _ => options.clone(),
    };
    let sunlight = if options.without_sun { None } else { Sunlight::new(&dataset, !options.still_shadows)? };
    let sun = sunlight.as_ref().map(|sunlight| sunlight.coded(&masks, console)).transpose()?;
    if options.still_shadows && sun.is_none() {
        console.warn(format!("--still-shadows: {} has no shadows of the sun to tell of", root.display()));
    }
    let shadows = sunlight.as_ref().is_some_and(Sunlight::moves);
    let header = Header { sun, shadows, ..header(&dataset, &masks, &law, options)? };
    if !options.force {
        match standing(&out, &header) {
            Standing::Same(outcome) => {
                // (Of a run that was killed at its end.)
                Part::tidy(&out);
                sync_folder_of(&out);
                return Ok(*outcome);
            }
            Standing::Kept(what) => {
                return Err(Error::invalid(
                    out.display(),
                    format!("{what}; expected --out FILE for one of its own, or --force to replace it"),
                ));
            }
            Standing::Other(what) => console.say(format!("{}, {what}, is replaced", out.display())),
            Standing::None => {}
        }
    }
    let part = Part::open(&out, options.force)?;
    let checked = start.elapsed().as_secs_f64();

    let suns = match sunlight.as_ref().zip(header.sun.as_ref()) {
        Some((sunlight, sun)) => sunlight.sections(sun, &masks, console)?,
        None => Vec::new(),
    };
    let tiles = Tiles {
        bytes_of_sun: suns.iter().flatten().map(|section| section.bytes.len() as u64).sum(),
        dataset: &dataset,
        law: &law,
        masks: &masks,
        options,
        header: &header,
        part: &part,
        trained_on: trained_on(&dataset, &law),
        deadline: options.time_limit.map(|limit| start + limit),
    };
    let mut work = tiles.work(console)?;
    for ([sun, shadows], payload) in suns.into_iter().zip(&mut work.payloads) {
        (payload.sun, payload.shadows) = (sun, shadows);
    }
    // Where no shadow moves, there is no stream of them.
    let shadows = work.payloads.iter().any(|payload| !payload.shadows.bytes.is_empty());
    let header = Header { shadows, ..header };
    let bytes = bundle::encode(&header, &work.payloads).map_err(of_bundle)?;
    write_atomically(&out, &bytes)?;
    part.finish()?;

    let outcome = Outcome::new(&header, out.clone(), bytes.len() as u64, &work, start, checked);
    outcome::write(&out, &outcome)?;
    let folder = part.folder().to_owned();
    let left = part.remove();
    if left > 0 {
        console.say(format!(
            "{}: left for the runs of other settings that were stopped: {} (--force removes them)",
            folder.display(),
            count(left, "finished part")
        ));
    }
    Ok(outcome)
}

/// The bundle where a new one is to go.
enum Standing {
    /// The bundle that would be written, but for bytes that go by the instruction set, and how it came to be.
    Same(Box<Outcome>),
    /// What a run without `--force` does not replace, in words: no bundle at all, one of another scene, or one of the same light that
    /// was trained for more steps.
    Kept(String),
    /// One of another bake or other settings, or a broken one, in words.
    Other(String),
    /// None.
    None,
}

/// What stands at `out`, beside what is asked for. Under a time limit no two runs are the same.
fn standing(out: &Path, header: &Header) -> Standing {
    if !out.exists() {
        return Standing::None;
    }
    let Ok(there) = Bundle::open(out) else {
        return match bundle::begins_like_one(out) {
            true => Standing::Other("which this program cannot read".to_owned()),
            false => Standing::Kept("is no bundle".to_owned()),
        };
    };
    if there.header.scene != header.scene {
        return Standing::Kept(format!(
            "is a bundle of the scene {}, not of {}",
            printable(&there.header.scene),
            header.scene
        ));
    }
    let told = |header: &Header| serde_json::from_str::<serde_json::Value>(&header.info).unwrap_or_default();
    let (old, new) = (told(&there.header), told(header));
    let is_limited = !new["time_limit_secs"].is_null();
    // (Whether there are shadows that move is known only when they have been looked for, at the times that the header names.)
    let header = &Header { shadows: header.shadows && there.header.shadows, ..header.clone() };
    let is_same = there.header == *header && !is_limited;
    let kept = outcome::read(out).filter(|outcome| is_same && outcome.bytes == there.bytes);
    if let Some(outcome) = kept {
        return Standing::Same(Box::new(outcome));
    }
    let differs = |key: &str| old[key] != new[key];
    // (Under a time limit they are the most that any tile gets.)
    let steps = old["iterations"].as_u64().filter(|_| old["time_limit_secs"].is_null());
    if let Some(steps) = steps.filter(|&steps| !differs("inputs") && new["iterations"].as_u64() < Some(steps))
    {
        let what = format!(
            "is a bundle of this light trained for {steps} steps, and {} would replace it",
            new["iterations"]
        );
        return Standing::Kept(what);
    }
    let what = match () {
        () if is_same => "whose record of training (.run.json) is not there, or of another bundle".to_owned(),
        () if differs("inputs") => "compressed from a different bake".to_owned(),
        () if differs("trained_on") => "made where other layers told which lamps light a tile".to_owned(),
        () if differs("iterations") => {
            format!("trained for {} steps", printable(&old["iterations"].to_string()))
        }
        () if there.header == *header => "of an earlier run under a time limit".to_owned(),
        () => "made with other settings".to_owned(),
    };
    Standing::Other(what)
}

/// Reads every lightmap once, band by band, so that a bad texel or a torn file stops the run before it has trained anything.
fn check_texels(dataset: &Dataset, console: &Console) -> Result<()> {
    let sets = &dataset.config.frames;
    let mut seen = BTreeSet::new();
    let maps: Vec<(usize, usize)> = (0..sets.len())
        .flat_map(|set| (0..dataset.config.pages.len()).map(move |page| (set, page)))
        .filter(|&(set, page)| seen.insert(&sets[set].maps[page].path))
        .collect();
    let progress = console.progress("checking", maps.len() as u64);
    let faults: Vec<Result<()>> = maps
        .par_iter()
        .map(|&(set, page)| {
            stop_if_interrupted()?;
            let height = dataset.config.pages[page].height as usize;
            for y in (0..height).step_by(crate::model::STORED) {
                dataset.map_rows(set, page, y, (y + crate::model::STORED).min(height))?;
            }
            // After the texels' check: that says more than "the checksum differs".
            dataset.check_content(&sets[set].maps[page])?;
            progress.advance(1);
            Ok(())
        })
        .collect();
    // The first fault in the dataset's order, whichever thread met one first.
    faults.into_iter().collect()
}

/// What the bundle says of itself.
fn header(dataset: &Dataset, masks: &[Mask], law: &Law, options: &Options) -> Result<Header> {
    let config = &dataset.config;
    let mut info = json!({
        "generator": concat!("compress ", env!("CARGO_PKG_VERSION")),
        "inputs": dataset.config.digest_of_light(),
        "trained_on": trained_on(dataset, law),
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
    // A coarser level says which, and of what light.
    if let Some(halved) = config.halved() {
        (info["level"], info["level_of"]) = (json!(halved.times), json!(halved.light));
    }
    let grid =
        |page: &dataset::config::Page| Grid { width: page.width as usize, height: page.height as usize };
    let mut timeline = timeline(dataset);
    timeline.between = law.hours(dataset, masks, &timeline)?;
    Ok(Header {
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
        timeline,
    })
}

/// The dataset's hours, schedules and states.
pub(crate) fn timeline(dataset: &Dataset) -> Timeline {
    let config = &dataset.config;
    Timeline {
        hours: config.frames.iter().map(|set| set.hour).collect(),
        intervals: config.groups.iter().map(|group| group.on.clone()).collect(),
        states: config.frames.iter().map(|set| set.groups_on.clone()).collect(),
        between: vec![],
        coding: Coding::Standard,
    }
}

/// Digest of the light and of what else decides a tile's training: the layers tell which groups light it.
fn trained_on(dataset: &Dataset, law: &Law) -> String {
    let config = &dataset.config;
    let files = |group: u32| {
        let layers = config.layers_of(Light::Group, Some(group));
        layers.flat_map(Layer::files).map(|file| file.blake3.clone()).collect::<Vec<_>>()
    };
    let mut layers: Vec<_> = (0..config.groups.len() as u32).map(files).collect();
    // Where the sun is apart, maps hold the sum of layers.
    if law.is_apart {
        layers.push(config.layers.iter().flat_map(Layer::files).map(|file| file.blake3.clone()).collect());
    }
    blake3::hash(json!([dataset.config.digest_of_light(), layers]).to_string().as_bytes())
        .to_hex()
        .to_string()
}

/// `path` with `suffix` appended to its name.
pub(crate) fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}
