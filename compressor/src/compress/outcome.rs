//! Results of a run: per tile, in total, and as `<bundle>.run.json`.

use super::beside;
use super::stats::TileStats;
use super::tiles::Work;
use crate::Result;
use crate::bundle::{Header, MapCoding, Payload};
use crate::grid::Place;
use crate::lanes::Tier;
use crate::mean::{mean, weighted_mean};
use crate::model::Contents;
use crate::train::TrainedTile;
use dataset::host::files::{json, write_atomically};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What follows a bundle's name in that of its record.
pub(super) const SUFFIX: &str = ".run.json";

/// One point of the training curve over all tiles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Steps done.
    pub iteration: usize,
    /// CPU seconds per tile, mean over tiles.
    pub seconds: f64,
    /// PSNR in dB, mean over tiles weighted by the texels they are trained on.
    pub mean_db: f64,
    /// The worst tile's.
    pub worst_db: f64,
}

/// Results of a run, stored as `<bundle>.run.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outcome {
    /// The bundle's path.
    pub bundle: PathBuf,
    /// Its length in bytes.
    pub bytes: u64,
    /// True if its maps are planes: nothing was trained.
    pub is_basis: bool,
    /// Tiles of all pages.
    pub tiles: usize,
    /// Of these, tiles without light or valid texels, for which nothing is stored.
    pub empty: usize,
    /// Of these, tiles reused from a stopped run.
    pub resumed: usize,
    /// True if the bundle was up to date and nothing was trained.
    #[serde(skip)]
    pub up_to_date: bool,
    /// Threads and vector instructions it ran with.
    pub ran_with: (usize, String),
    /// Seconds of reading and checking the dataset.
    pub seconds_checking: f64,
    /// Wall-clock seconds of this run.
    pub seconds: f64,
    /// Sum over tiles of CPU seconds of training or encoding, trials included.
    pub training_seconds: f64,
    /// Of these, of trial fits.
    pub trial_seconds: f64,
    /// Fewest and most steps of a tile with light.
    pub steps: Option<[usize; 2]>,
    /// PSNR before quantisation, mean over tiles weighted by their valid texels, in dB (each tile: mean over
    /// its frames, peak = the frame's largest valid value).
    pub psnr_unquantised_db: Option<f64>,
    /// The same with features rounded to 8 bits (not BC7).
    pub psnr_8bit_features_db: Option<f64>,
    /// The same of the stored tiles.
    pub psnr_trained_db: Option<f64>,
    /// PSNR against seconds.
    pub curve: Vec<CurvePoint>,
    /// Remarks: what was omitted and why, and others, with the number of tiles, most frequent first.
    pub omitted: Vec<(String, usize)>,
    /// Every tile, in the order of the bundle's index.
    pub per_tile: Vec<TileOutcome>,
}

/// Configuration and quality of one tile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TileOutcome {
    /// Page, column and row.
    pub place: [usize; 3],
    /// Its [`Contents`] as text; `None` for a tile of which nothing is stored.
    pub has: Option<String>,
    /// Length of its payload.
    pub bytes: usize,
    /// Steps of the main phase; 0 for a tile without light.
    pub steps: usize,
    /// PSNR as stored, where it has one.
    pub psnr_db: Option<f64>,
    /// Remarks: what was omitted and why, and others.
    pub omitted: Vec<String>,
}

impl Outcome {
    /// The outcome of a run that began at `start` and wrote `bytes` bytes.
    pub(super) fn new(
        header: &Header,
        bundle: PathBuf,
        bytes: u64,
        work: &Work,
        start: Instant,
        seconds_checking: f64,
    ) -> Self {
        let Work { payloads, stats, resumed, trial_seconds } = work;
        let tile =
            |(Place { page, column, row }, (payload, stats)): (Place, (&Payload, &TileStats))| TileOutcome {
                place: [page, column, row],
                has: contents(header, payload),
                bytes: payload.bytes(),
                steps: stats.trained.steps,
                psnr_db: stats.trained.psnr_db,
                omitted: stats.trained.omitted.clone(),
            };
        let mean_of = |value: fn(&TrainedTile) -> Option<f64>| {
            weighted_mean(stats.iter().filter_map(|tile| Some((value(&tile.trained)?, tile.texels))))
        };
        let steps = || stats.iter().map(|tile| tile.trained.steps).filter(|steps| *steps > 0);
        Outcome {
            bundle,
            bytes,
            is_basis: header.coding == MapCoding::Basis,
            steps: steps().min().zip(steps().max()).map(|(least, most)| [least, most]),
            tiles: payloads.len(),
            empty: payloads.iter().filter(|payload| payload.bytes() == 0).count(),
            resumed: *resumed,
            up_to_date: false,
            ran_with: (rayon::current_num_threads(), format!("{:?}", Tier::detect())),
            seconds_checking,
            seconds: start.elapsed().as_secs_f64(),
            training_seconds: trial_seconds + stats.iter().map(|tile| tile.seconds).sum::<f64>(),
            trial_seconds: *trial_seconds,
            psnr_unquantised_db: mean_of(|tile| tile.psnr_unquantised_db),
            psnr_8bit_features_db: mean_of(|tile| tile.psnr_8bit_features_db),
            psnr_trained_db: mean_of(|tile| tile.psnr_db),
            curve: aggregate(stats),
            omitted: count(stats),
            per_tile: header.places().zip(payloads.iter().zip(stats)).map(tile).collect(),
        }
    }
}

/// What a tile has, as text.
fn contents(header: &Header, payload: &Payload) -> Option<String> {
    let word = (!payload.maps.bytes.is_empty()).then_some(payload.maps.word)?;
    match header.coding {
        MapCoding::Neural => Contents::of_word(word).map(|contents| contents.to_string()),
        MapCoding::Basis => Some(dataset::observe::count(word as usize, "plane")),
    }
}

/// The training curve over all tiles: the mean of the tiles' i-th points, PSNR weighted by texels.
fn aggregate(stats: &[TileStats]) -> Vec<CurvePoint> {
    let points = stats.iter().map(|tile| tile.trained.curve.len()).max().unwrap_or(0);
    let at = |i: usize| {
        let point = move |tile: &TileStats| Some((*tile.trained.curve.get(i)?, tile.texels));
        stats.iter().filter_map(point).filter(|(point, _)| point.psnr_db.is_finite())
    };
    (0..points)
        .filter_map(|i| {
            Some(CurvePoint {
                iteration: at(i).map(|(point, _)| point.iteration).max()?,
                seconds: mean(at(i).map(|(point, _)| point.seconds))?,
                mean_db: weighted_mean(at(i).map(|(point, texels)| (point.psnr_db, texels)))?,
                worst_db: at(i).map(|(point, _)| point.psnr_db).min_by(f64::total_cmp)?,
            })
        })
        .collect()
}

/// Distinct remarks with their number of tiles.
fn count(stats: &[TileStats]) -> Vec<(String, usize)> {
    let mut counts = BTreeMap::new();
    for remark in stats.iter().flat_map(|tile| &tile.trained.omitted) {
        *counts.entry(remark.clone()).or_insert(0) += 1;
    }
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    counts
}

/// Writes `<bundle>.run.json`, which has everything that changes from run to run.
pub(super) fn write(out: &Path, outcome: &Outcome) -> Result<()> {
    let json = json(Path::new("run.json"), outcome)?;
    write_atomically(&beside(out, SUFFIX), &json)
}

/// Reads the `.run.json` of the bundle at `out`, if there is one.
pub(super) fn read(out: &Path) -> Option<Outcome> {
    let outcome: Outcome = serde_json::from_slice(&std::fs::read(beside(out, SUFFIX)).ok()?).ok()?;
    // (It may have been moved since.)
    Some(Outcome { bundle: out.to_owned(), up_to_date: true, resumed: 0, ..outcome })
}
