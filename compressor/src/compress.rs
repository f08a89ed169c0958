//! From a dataset to a bundle: tiles in parallel, resumable.
//!
//! Every finished tile is kept in the folder `<bundle>.part/` until the bundle stands, so that a run that was stopped, by
//! whatever, continues where it was. What is written depends on the dataset, the options and the processor's instruction set
//! (which rounds sums in its own order), never on threads or time.

mod part;

use crate::bundle::{self, Header};
use crate::clock::Clock;
use crate::grid::{Grid, Place};
use crate::lanes::Tier;
use crate::mean::mean;
use crate::model::{PROFILES, Profile};
use crate::tile::Band;
use crate::time::Timeline;
use crate::train::{self, Recipe};
use crate::{Error, Result};
use dataset::console::{Console, stop_if_interrupted};
use dataset::files::write_atomically;
use dataset::image::Mask;
use dataset::store::Dataset;
use part::Part;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Steps of the main phase of a tile's training.
pub const ITERATIONS: usize = 12_000;
/// The same for drafts.
pub const DRAFT_ITERATIONS: usize = 1000;
/// The same for the paper's recipe, whose constant rate needs about 15 times more for equal quality.
pub const PAPER_ITERATIONS: usize = 100_000;
/// Bands read together hold at least this many tiles per thread, so that threads seldom wait for the last tile (5 MB each with 26 sets).
const TILES_PER_THREAD: usize = 8;

/// How to compress.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Size of the representation.
    pub profile: Profile,
    /// Steps of the main phase; see [`ITERATIONS`].
    pub iterations: usize,
    /// The paper's literal recipe; see [`Recipe::paper`].
    pub paper: bool,
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
        Recipe { iterations: self.iterations, paper: self.paper, seed: self.seed }
    }
}

impl Default for Options {
    fn default() -> Self {
        Options {
            profile: PROFILES[1],
            iterations: ITERATIONS,
            paper: false,
            seed: 1,
            out: None,
            force: false,
        }
    }
}

/// Where the bundle of a dataset goes by default: `<dataset>/<scene>.ndgi`.
pub fn default_bundle(dataset: &Dataset) -> PathBuf {
    dataset.root.join(format!("{}.ndgi", dataset.config.scene))
}

/// What training told about one tile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TileStats {
    /// PSNR before and after quantisation, in dB, where the tile has one.
    pub psnr_unquantised_db: Option<f64>,
    /// See [`TileStats::psnr_unquantised_db`].
    pub psnr_db: Option<f64>,
    /// (step, CPU seconds, dB) along the training.
    pub curve: Vec<(usize, f64, f64)>,
    /// What was left out and why.
    pub left_out: Vec<String>,
    /// CPU seconds.
    pub seconds: f64,
}

/// One point of the training curve over all tiles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Steps done.
    pub iteration: usize,
    /// CPU seconds per tile, mean over tiles.
    pub seconds: f64,
    /// PSNR in dB, mean over tiles.
    pub mean_db: f64,
    /// The worst tile's.
    pub worst_db: f64,
}

/// What a run did.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The bundle's path.
    pub bundle: PathBuf,
    /// Its length in bytes.
    pub bytes: u64,
    /// Tiles of all pages.
    pub tiles: usize,
    /// Of these, without light or valid texel, so nothing is stored.
    pub empty: usize,
    /// Of these, taken over from a run that was stopped.
    pub resumed: usize,
    /// Wall-clock seconds of this run.
    pub seconds: f64,
    /// Sum over tiles of CPU seconds of training.
    pub training_seconds: f64,
    /// PSNR before quantisation, mean over tiles, in dB (each tile: mean over its sets, peak = the set's largest valid value).
    pub psnr_unquantised_db: Option<f64>,
    /// The same of the stored tiles.
    pub psnr_trained_db: Option<f64>,
    /// PSNR against seconds.
    pub curve: Vec<CurvePoint>,
    /// What was left out and why, with the number of tiles, most frequent first.
    pub left_out: Vec<(String, usize)>,
}

/// Trains every tile of the dataset in `root` and writes the bundle and, beside it, `<bundle>.run.json` with timings.
///
/// # Errors
/// [`Error::Invalid`] for a dataset that breaks a rule (a torn file, a NaN, …), before anything is written;
/// [`Error::Interrupted`]; [`Error::Io`]. An existing bundle stays as it was unless the run succeeds.
pub fn compress(root: &Path, options: &Options, console: &Console) -> Result<Outcome> {
    let start = Instant::now();
    let dataset = Dataset::open(root)?;
    let out = options.out.clone().unwrap_or_else(|| default_bundle(&dataset));
    let masks = (0..dataset.config.pages.len()).map(|page| dataset.mask(page)).collect::<Result<Vec<_>>>()?;
    check_texels(&dataset, console)?;
    let header = header(&dataset, options);
    let part = Part::open(&out, options.force)?;
    let checked = start.elapsed().as_secs_f64();

    let run = Run {
        dataset: &dataset,
        masks: &masks,
        options,
        header: &header,
        part: &part,
        inputs: inputs(&dataset),
    };
    let tiles = run.tiles(console)?;
    let (payloads, stats): (Vec<Vec<u8>>, Vec<(TileStats, bool)>) =
        tiles.into_iter().map(|tile| (tile.payload, (tile.stats, tile.resumed))).unzip();
    let bytes = bundle::encode(&header, &payloads)?;
    write_atomically(&out, &bytes)?;

    let resumed = stats.iter().filter(|(_, resumed)| *resumed).count();
    let stats: Vec<TileStats> = stats.into_iter().map(|(stats, _)| stats).collect();
    let outcome = Outcome {
        bytes: bytes.len() as u64,
        tiles: payloads.len(),
        empty: payloads.iter().filter(|payload| payload.is_empty()).count(),
        resumed,
        seconds: start.elapsed().as_secs_f64(),
        training_seconds: stats.iter().map(|tile| tile.seconds).sum(),
        psnr_unquantised_db: mean(stats.iter().filter_map(|tile| tile.psnr_unquantised_db)),
        psnr_trained_db: mean(stats.iter().filter_map(|tile| tile.psnr_db)),
        curve: aggregate(&stats),
        left_out: count(&stats),
        bundle: out.clone(),
    };
    write_run(&out, &outcome, checked)?;
    part.remove();
    Ok(outcome)
}

/// Reads every lightmap once, band by band, so that a bad texel or a torn file stops the run before it has trained anything.
fn check_texels(dataset: &Dataset, console: &Console) -> Result<()> {
    let sets = &dataset.config.sets;
    let mut seen = BTreeSet::new();
    let maps: Vec<(usize, usize)> = (0..sets.len())
        .flat_map(|set| (0..dataset.config.pages.len()).map(move |page| (set, page)))
        .filter(|&(set, page)| seen.insert(&sets[set].maps[page].file.path))
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
            dataset.check_content(&sets[set].maps[page].file)?;
            progress.advance(1);
            Ok(())
        })
        .collect();
    // The first fault in the dataset's order, whichever thread met one first.
    faults.into_iter().collect()
}

/// What the bundle says of itself.
fn header(dataset: &Dataset, options: &Options) -> Header {
    let config = &dataset.config;
    let info = json!({
        "generator": concat!("compress ", env!("CARGO_PKG_VERSION")),
        "inputs": inputs(dataset),
        "unit": config.unit,
        "profile": options.profile.name,
        "recipe": if options.paper { "paper" } else { "standard" },
        "iterations": options.iterations,
        "seed": options.seed,
    });
    let grid =
        |page: &dataset::config::Page| Grid { width: page.width as usize, height: page.height as usize };
    Header {
        scene: config.scene.clone(),
        info: info.to_string(),
        profile: options.profile,
        pages: config.pages.iter().map(grid).collect(),
        groups: config.groups.iter().map(|group| group.name.clone()).collect(),
        timeline: Timeline {
            hours: config.sets.iter().map(|set| set.hour).collect(),
            intervals: config.groups.iter().map(|group| group.on.clone()).collect(),
            states: config.sets.iter().map(|set| set.groups_on.clone()).collect(),
            coding: options.recipe().coding(),
        },
    }
}

/// Digest of what of the dataset decides the bundle: hours, schedules, and the content of masks and lightmaps.
pub fn inputs(dataset: &Dataset) -> String {
    let config = &dataset.config;
    let pages: Vec<_> =
        config.pages.iter().map(|page| json!([page.width, page.height, page.mask.blake3])).collect();
    let groups: Vec<_> = config.groups.iter().map(|group| json!([group.name, group.on])).collect();
    let sets: Vec<_> = config
        .sets
        .iter()
        .map(|set| {
            let maps: Vec<_> = set.maps.iter().map(|map| &map.file.blake3).collect();
            json!([set.hour, set.groups_on, maps])
        })
        .collect();
    let all = json!([config.scene, pages, groups, sets]).to_string();
    blake3::hash(all.as_bytes()).to_hex().to_string()
}

/// A finished tile.
pub(crate) struct Tile {
    /// As [`bundle::encode_payload`] gives it; empty for a black tile.
    payload: Vec<u8>,
    stats: TileStats,
    /// Whether a stopped run had left it.
    resumed: bool,
}

struct Run<'a> {
    dataset: &'a Dataset,
    masks: &'a [Mask],
    options: &'a Options,
    header: &'a Header,
    part: &'a Part,
    inputs: String,
}

impl Run<'_> {
    /// All tiles in the order of the bundle's index. A few bands are in memory at a time.
    fn tiles(&self, console: &Console) -> Result<Vec<Tile>> {
        let progress = console.progress("training", self.header.tiles() as u64);
        let so_far = std::sync::Mutex::new((0.0, 0));
        let mut done = Vec::with_capacity(self.header.tiles());
        for (page, grid) in self.header.pages.iter().enumerate() {
            let wanted = TILES_PER_THREAD * rayon::current_num_threads();
            let rows: Vec<usize> = (0..grid.rows()).collect();
            for rows in rows.chunks(wanted.div_ceil(grid.columns())) {
                // Bands of which every tile is finished already are not read.
                let places: Vec<Place> = rows
                    .iter()
                    .flat_map(|&row| (0..grid.columns()).map(move |column| Place { page, column, row }))
                    .collect();
                let found: Vec<Option<Tile>> = places.par_iter().map(|&place| self.finished(place)).collect();
                let missing =
                    |row: usize| places.iter().zip(&found).any(|(p, tile)| p.row == row && tile.is_none());
                let bands = rows
                    .par_iter()
                    .map(|&row| {
                        missing(row)
                            .then(|| Band::load(self.dataset, &self.masks[page], page, row))
                            .transpose()
                    })
                    .collect::<Result<Vec<Option<Band>>>>()?;
                let tiles: Vec<Result<Tile>> = places
                    .par_iter()
                    .zip(found)
                    .with_max_len(1)
                    .map(|(&place, found)| {
                        stop_if_interrupted()?;
                        let tile = match (found, &bands[place.row - rows[0]]) {
                            (Some(tile), _) => tile,
                            (None, Some(band)) => self.train(place, band)?,
                            (None, None) => unreachable!("a band with a missing tile is read"),
                        };
                        if let (Some(db), Ok(mut so_far)) = (tile.stats.psnr_db, so_far.lock()) {
                            so_far.0 += db;
                            so_far.1 += 1;
                            progress.note(&format!("{:.1} dB", so_far.0 / f64::from(so_far.1)));
                        }
                        progress.advance(1);
                        Ok(tile)
                    })
                    .collect();
                for tile in tiles {
                    done.push(tile?);
                }
            }
        }
        Ok(done)
    }

    /// The tile's own recipe: its randomness depends on its place, never on the order of work.
    fn recipe(&self, place: Place) -> Recipe {
        let recipe = self.options.recipe();
        let numbers = [recipe.seed, place.page as u64, place.column as u64, place.row as u64];
        let seed = bundle::checksum(&numbers.map(u64::to_le_bytes).each_ref().map(|n| &n[..]));
        Recipe { seed, ..recipe }
    }

    /// What decides a tile, and so names its file in the work folder.
    fn key(&self, place: Place) -> String {
        let Recipe { iterations, paper, seed } = self.recipe(place);
        let Place { page, column, row } = place;
        let tier = format!("{:?}", Tier::detect());
        let all = json!([
            env!("CARGO_PKG_VERSION"),
            bundle::VERSION,
            self.inputs,
            self.options.profile.name,
            iterations,
            paper,
            seed,
            tier,
            page,
            column,
            row,
        ]);
        blake3::hash(all.to_string().as_bytes()).to_hex()[..32].to_owned()
    }

    /// The tile as a stopped run left it, if it did.
    fn finished(&self, place: Place) -> Option<Tile> {
        let (payload, stats) = self.part.read(&self.key(place))?;
        let expected = bundle::payload_len(&self.header.shape(place));
        (payload.is_empty() || payload.len() == expected).then_some(Tile { payload, stats, resumed: true })
    }

    fn train(&self, place: Place, band: &Band) -> Result<Tile> {
        let clock = Clock::start();
        let source = band.tile(place.column);
        let trained = train::train(&source, &self.options.profile, &self.recipe(place))
            .map_err(|error| of_tile(place, error))?;
        let faulty = |what| of_tile(place, Error::invalid("payload", format!("training failed: {what}")));
        let payload = match &trained.params {
            Some(params) => bundle::encode_payload(params).map_err(faulty)?,
            None => Vec::new(),
        };
        let stats = TileStats {
            psnr_unquantised_db: trained.psnr_unquantised_db,
            psnr_db: trained.psnr_db,
            curve: trained
                .curve
                .iter()
                .map(|point| (point.iteration, point.seconds, point.psnr_db))
                .collect(),
            left_out: trained.left_out,
            seconds: clock.seconds(),
        };
        self.part.write(&self.key(place), &payload, &stats)?;
        Ok(Tile { payload, stats, resumed: false })
    }
}

/// The error, with the tile's place for its own where it is of the tile's content.
fn of_tile(place: Place, error: Error) -> Error {
    match error {
        Error::Invalid { what, .. } => {
            let Place { page, column, row } = place;
            Error::invalid(format!("page {page}, tile ({column}, {row})"), what)
        }
        other => other,
    }
}

/// The training curve over all tiles: the i-th points of all tiles that have one, averaged.
fn aggregate(stats: &[TileStats]) -> Vec<CurvePoint> {
    let points = stats.iter().map(|tile| tile.curve.len()).max().unwrap_or(0);
    let at =
        |i: usize| stats.iter().filter_map(move |tile| tile.curve.get(i)).filter(|point| point.2.is_finite());
    (0..points)
        .filter_map(|i| {
            Some(CurvePoint {
                iteration: at(i).map(|point| point.0).max()?,
                seconds: mean(at(i).map(|point| point.1))?,
                mean_db: mean(at(i).map(|point| point.2))?,
                worst_db: at(i).map(|point| point.2).min_by(f64::total_cmp)?,
            })
        })
        .collect()
}

/// Distinct remarks with the number of tiles they were made of.
fn count(stats: &[TileStats]) -> Vec<(String, usize)> {
    let mut counts = BTreeMap::new();
    for remark in stats.iter().flat_map(|tile| &tile.left_out) {
        *counts.entry(remark.clone()).or_insert(0) += 1;
    }
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    counts
}

/// `<bundle>.run.json`: what changes from run to run.
fn write_run(out: &Path, outcome: &Outcome, checked: f64) -> Result<()> {
    let run = json!({
        "seconds": outcome.seconds,
        "seconds_checking": checked,
        "cpu_seconds_training": outcome.training_seconds,
        "threads": rayon::current_num_threads(),
        "instructions": format!("{:?}", Tier::detect()),
        "tiles": outcome.tiles,
        "tiles_empty": outcome.empty,
        "tiles_resumed": outcome.resumed,
        "psnr_unquantised_db": outcome.psnr_unquantised_db,
        "psnr_trained_db": outcome.psnr_trained_db,
        "curve": outcome.curve,
        "left_out": outcome.left_out,
    });
    let text = serde_json::to_string_pretty(&run).map_err(|error| Error::invalid("run.json", error))?;
    write_atomically(&beside(out, ".run.json"), format!("{text}\n").as_bytes())
}

/// `path` with `suffix` appended to its name.
fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_of_training_names_its_tile() {
        let place = Place { page: 2, column: 3, row: 4 };
        let message = of_tile(place, Error::invalid("tile", "training diverges")).to_string();
        assert_eq!(message, "page 2, tile (3, 4): training diverges");
        assert!(matches!(of_tile(place, Error::Interrupted), Error::Interrupted));
    }
}
