//! Processes the tiles of a dataset in parallel: trial fits of all, if there is a target, then training of
//! all.

use super::allocate::{self, Goal};
use super::note::{Shard, Stage};
use super::pace::{self, Pace};
use super::part::{Kept, Part};
use super::shard::{self, Notes};
use super::stats::TileStats;
use super::{Options, Rate};
use crate::bundle::{self, Header, MapCoding, Payload};
use crate::clock::Clock;
use crate::grid::Place;
use crate::lanes::Tier;
use crate::law::Law;
use crate::model::{Contents, Profile, TileParams};
use crate::tile::{self, Band};
use crate::train::{self, Recipe, TrainedTile, TrialFit};
use crate::{Error, Result, of_bundle};
use dataset::digest::Digest;
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Mask;
use dataset::observe::{Observer, count};
use dataset::store::Dataset;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Bands read together hold at least this many tiles per thread, so that threads seldom wait for the last
/// tile (5 MB each with 26 frames).
const TILES_PER_THREAD: usize = 8;

/// With a target PSNR, this many tiles are trained first to measure the gain of full training, at most this
/// many times.
const CALIBRATED: usize = 4;
const CALIBRATIONS: usize = 4;
/// An error up to this factor larger (0.3 dB) counts as reaching the target, because unmeasured tiles mostly
/// gain more.
const NEARLY: f64 = 1.07;

/// Results of all tiles, in the order of the bundle's index.
pub(super) struct Work {
    pub payloads: Vec<Payload>,
    pub stats: Vec<TileStats>,
    /// Number of tiles reused from a stopped run.
    pub resumed: usize,
    /// CPU seconds of trial fits.
    pub trial_seconds: f64,
}

/// A tile's trial fits and their CPU seconds.
type TileTrials = (Vec<TrialFit>, f64);

/// The configurations chosen by trial fits, in the order of the index.
#[derive(Debug, Serialize, Deserialize)]
struct Choice {
    /// Words of [`Contents`].
    words: Vec<Option<u32>>,
    /// CPU seconds of the trial fits.
    trial_seconds: f64,
    /// The trial fits' files, and those of tiles that were trained to choose by.
    files: Vec<String>,
}

impl Choice {
    fn contents(&self) -> Vec<Option<Contents>> {
        self.words.iter().map(|word| word.and_then(Contents::of_word)).collect()
    }
}

/// A finished tile.
pub(super) struct Tile {
    /// As [`bundle::encode_payload`] gives it; the default for a black tile.
    pub payload: Payload,
    pub stats: TileStats,
    /// True if it is reused from a stopped run.
    pub resumed: bool,
}

impl Tile {
    /// A tile without a valid texel.
    fn empty() -> Self {
        let omitted = vec![train::NO_TEXEL.to_owned()];
        let trained = TrainedTile { omitted, ..TrainedTile::default() };
        let stats = TileStats { trained, ..TileStats::default() };
        Tile { payload: Payload::default(), stats, resumed: false }
    }
}

/// The work on all tiles of a bundle: inputs, options and the work folder.
pub(super) struct Tiles<'a> {
    pub dataset: &'a Dataset,
    /// Which light the maps hold.
    pub law: &'a Law,
    /// Of every page.
    pub masks: &'a [Mask],
    pub options: &'a Options,
    pub header: &'a Header,
    pub part: &'a Part,
    /// Digest of the dataset's parts that decide a tile.
    pub trained_on: &'a str,
    /// See [`super::Job::recipe`].
    pub recipe: &'a str,
    /// True once the dataset's checksums are verified.
    pub is_verified: bool,
    /// With [`MapCoding::Basis`], the step of all tiles once it is known.
    pub step: OnceLock<u8>,
    pub bytes_of_sun: u64,
    /// When training is to end.
    pub deadline: Option<Instant>,
}

impl Tiles<'_> {
    /// Trial fits and training of every tile that a stopped run has not finished.
    pub(super) fn work(&self, console: &dyn Observer) -> Result<Work> {
        let (chosen, trial_seconds) = self.chosen(console)?;
        self.distrust(&self.lit(), |place| self.key(place, self.contents(&chosen, place)), console)?;
        if self.options.merge {
            self.expect_trained(&chosen)?;
        }
        let tiles = self.trained(&chosen, console)?;
        let resumed = tiles.iter().filter(|tile| tile.resumed).count();
        let (payloads, stats) = tiles.into_iter().map(|tile| (tile.payload, tile.stats)).unzip();
        Ok(Work { payloads, stats, resumed, trial_seconds })
    }

    /// An error unless shards have trained every tile or, with a target before any choice, finished all trial
    /// fits.
    pub(super) fn expect_shards(&self) -> Result<()> {
        match self.known_choice() {
            Some(chosen) => self.expect_trained(&chosen),
            None => self
                .expect(shard::TRIED, |place| self.part.read::<TileTrials>(&self.trial_key(place)).is_some()),
        }
    }

    /// An error unless every tile is trained with its chosen configuration.
    fn expect_trained(&self, chosen: &[Option<Contents>]) -> Result<()> {
        let is_there = |place| self.finished(&self.key(place, self.contents(chosen, place))).is_some();
        self.expect(shard::TRAINED, is_there)
    }

    fn expect(&self, what: &str, is_there: impl Fn(Place) -> bool) -> Result<()> {
        let places = self.lit();
        let missing: Vec<Place> = places.iter().filter(|place| !is_there(**place)).copied().collect();
        match missing.is_empty() {
            true => Ok(()),
            false => Err(shard::missing(self.part.folder(), self.recipe, what, &missing, places.len())),
        }
    }

    /// The tiles' configurations, if they are all the same or have been chosen.
    fn known_choice(&self) -> Option<Vec<Option<Contents>>> {
        match self.options.rate {
            Rate::Usual | Rate::Profile(_) => Some(Vec::new()),
            _ => self.part.read::<Choice>(&self.choice_key()).map(|kept| self.taken(&kept.result)),
        }
    }

    /// The configurations of a choice; with planes, its step is taken for all tiles.
    fn taken(&self, choice: &Choice) -> Vec<Option<Contents>> {
        if self.options.coding == MapCoding::Neural {
            return choice.contents();
        }
        if let Some(step) = choice.words.iter().flatten().next() {
            self.step.get_or_init(|| *step as u8);
        }
        Vec::new()
    }

    /// The tiles that have a valid texel, in the order of the index.
    fn lit(&self) -> Vec<Place> {
        lit(self.header, self.masks)
    }

    /// Counts the files of these tiles as this run's, to be removed with its own.
    pub(super) fn claim(&self) {
        let chosen = self.known_choice().unwrap_or_default();
        for place in self.lit() {
            self.part.claim(&self.key(place, self.contents(&chosen, place)));
            self.part.claim(&self.trial_key(place));
        }
    }

    /// Shards verify no checksums, only the texels they read. So once they are verified, this compares the
    /// light of the tiles or trial fits that shards left with the dataset's, and removes what was made from
    /// other light: of a file that was damaged at the time, or has been replaced since.
    fn distrust(
        &self,
        places: &[Place],
        key: impl Fn(Place) -> String + Sync,
        console: &dyn Observer,
    ) -> Result<()> {
        let made_from = |place| self.part.made_from(&key(place));
        let of_shards: Vec<Place> =
            places.par_iter().copied().filter(|place| made_from(*place).is_some()).collect();
        let progress = console.progress("comparing", of_shards.len() as u64);
        let wrong = AtomicUsize::new(0);
        self.some_tiles(&of_shards, |place, band| {
            if made_from(place).is_some_and(|digest| digest != band.digest()) {
                self.part.discard(&key(place));
                wrong.fetch_add(1, Ordering::Relaxed);
            }
            progress.advance(1);
            Ok(())
        })?;
        let wrong = wrong.into_inner();
        if wrong > 0 {
            console.warn(format!(
                "removed the shards' work on {}: it was made from a file that was damaged, or has been replaced since",
                count(wrong, "tile")
            ));
        }
        Ok(())
    }

    /// See [`Kept::made_from`].
    fn made_from<'b>(&self, band: &'b Band) -> Option<&'b str> {
        (!self.is_verified).then(|| band.digest())
    }

    fn write_tile(&self, key: &str, tile: &Tile, band: &Band) -> Result<()> {
        self.part.write(key, &tile.payload, &tile.stats, self.made_from(band))
    }

    /// The tiles of a shard.
    pub(super) fn share(&self, shard: Shard) -> Vec<Place> {
        let lit = self.lit();
        lit[shard.share(lit.len())].to_vec()
    }

    /// Trains the tiles of a shard, or makes their trial fits if no configurations have been chosen.
    pub(super) fn train_shard(&self, notes: &Notes, own: &[Place], console: &dyn Observer) -> Result<Stage> {
        let Some(chosen) = self.known_choice() else {
            let is_open = |place: &&Place| self.part.read::<TileTrials>(&self.trial_key(**place)).is_none();
            let work = |place: Place, band: &Band| self.try_tile(place, band).map(|_| (0, None));
            return self.shard_of(notes, Stage::Trials, own, is_open, work, console);
        };
        let is_open =
            |place: &&Place| self.finished(&self.key(**place, self.contents(&chosen, **place))).is_none();
        let work = |place: Place, band: &Band| {
            let contents = self.contents(&chosen, place);
            let tile = self.train(place, contents, band, self.options.iterations)?;
            self.write_tile(&self.key(place, contents), &tile, band)?;
            Ok((tile.stats.texels, tile.stats.trained.psnr_db))
        };
        self.shard_of(notes, Stage::Training, own, is_open, work, console)
    }

    /// Runs `work` on the unfinished tiles of a shard; its result (texels and PSNR) goes into the shard's
    /// notes.
    fn shard_of(
        &self,
        notes: &Notes,
        stage: Stage,
        own: &[Place],
        is_open: impl Fn(&&Place) -> bool,
        work: impl Fn(Place, &Band) -> Result<(usize, Option<f64>)> + Sync,
        console: &dyn Observer,
    ) -> Result<Stage> {
        let open: Vec<Place> = own.iter().filter(is_open).copied().collect();
        notes.begin(stage, [own.len(), self.lit().len()], own.len() - open.len())?;
        let what = if stage == Stage::Trials { "trying" } else { self.doing() };
        let progress = console.progress(what, open.len() as u64);
        self.some_tiles(&open, |place, band| {
            let (texels, psnr_db) = work(place, band)?;
            progress.advance(1);
            notes.finished(texels, psnr_db)
        })?;
        Ok(stage)
    }

    /// A tile's configuration.
    fn contents(&self, chosen: &[Option<Contents>], place: Place) -> Option<Contents> {
        self.header.position(place).and_then(|at| chosen.get(at).copied().flatten())
    }

    /// All tiles in the order of the bundle's index, as [`Tiles::chosen`] chose.
    fn trained(&self, chosen: &[Option<Contents>], console: &dyn Observer) -> Result<Vec<Tile>> {
        let so_far = std::sync::Mutex::new((0.0, 0));
        let contents = |place| self.contents(chosen, place);
        let note = |tile: &Tile| {
            let (Some(db), Ok(mut so_far)) = (tile.stats.trained.psnr_db, so_far.lock()) else { return None };
            so_far.0 += tile.stats.texels as f64 * db;
            so_far.1 += tile.stats.texels;
            Some(format!("{:.1} dB", so_far.0 / so_far.1 as f64))
        };
        let finished = |place: Place| match tile::valid_texels(&self.masks[place.page], place) {
            // Its light need not be read.
            0 => Some(Tile::empty()),
            _ => self.finished(&self.key(place, contents(place))),
        };
        let left = self.header.places().filter(|&place| self.part.has(&self.key(place, contents(place))));
        let left = left.filter(|&place| tile::valid_texels(&self.masks[place.page], place) > 0).count();
        if left > 0 {
            console.say(format!(
                "continuing: {left} of {} tiles are reused from an earlier run",
                self.header.tiles()
            ));
        }
        let pace = self.pace(&contents, &finished)?;
        let work = |place: Place, band: &Band| {
            let start = Instant::now();
            let tile = self.train(place, contents(place), band, pace.begin(place))?;
            pace.measure(place, &tile.stats, start.elapsed());
            self.write_tile(&self.key(place, contents(place)), &tile, band)?;
            Ok(tile)
        };
        self.each_tile(console, self.doing(), finished, work, note)
    }

    /// Trains some tiles again, of known contents, without keeping them.
    pub(super) fn again(
        &self,
        places: &[Place],
        contents: impl Fn(&Place) -> Option<Contents> + Sync,
        console: &dyn Observer,
    ) -> Result<Vec<Payload>> {
        let progress = console.progress(self.doing(), places.len() as u64);
        self.some_tiles(places, |place, band| {
            let tile = self.train(place, contents(&place), band, self.options.iterations)?;
            progress.advance(1);
            Ok(tile.payload)
        })
    }

    /// Plans the tiles' steps. With a time limit the largest tiles, one per thread, are trained briefly first
    /// to measure the time of a step.
    fn pace(
        &self,
        contents: &(impl Fn(Place) -> Option<Contents> + Sync),
        finished: &impl Fn(Place) -> Option<Tile>,
    ) -> Result<Pace> {
        let most = self.options.iterations;
        let Some(deadline) = self.deadline else {
            return Ok(Pace::unlimited(most));
        };
        let texels = |place: Place| tile::valid_texels(&self.masks[place.page], place);
        let open = self.header.places().map(|place| (place, texels(place)));
        let open: Vec<_> = open.filter(|(place, texels)| *texels > 0 && finished(*place).is_none()).collect();
        let mut largest = open.clone();
        largest.sort_by_key(|(_, texels)| std::cmp::Reverse(*texels));
        largest.truncate(rayon::current_num_threads());
        let pace = Pace::until(deadline, most, open);
        if pace.late() {
            return Ok(pace);
        }
        let largest: Vec<Place> = largest.into_iter().map(|(place, _)| place).collect();
        self.some_tiles(&largest, |place, band| {
            let start = Instant::now();
            let trial = self.train(place, contents(place), band, pace::FLOOR)?;
            pace.measure(place, &trial.stats, start.elapsed());
            Ok(())
        })?;
        Ok(pace)
    }

    /// The configuration chosen for each tile by trial fits, in the order of the index (`None` for a tile
    /// without light), and their CPU seconds. An empty list if all tiles have the same profile.
    pub(super) fn chosen(&self, console: &dyn Observer) -> Result<(Vec<Option<Contents>>, f64)> {
        if let Rate::Usual | Rate::Profile(_) = self.options.rate {
            return Ok((Vec::new(), 0.0));
        }
        if let Some(Kept { result: choice, .. }) = self.part.read::<Choice>(&self.choice_key()) {
            self.part.adopt(&choice.files);
            return Ok((self.taken(&choice), choice.trial_seconds));
        }
        let finished = |place: Place| match tile::valid_texels(&self.masks[place.page], place) {
            0 => Some(TileTrials::default()),
            _ => self.part.read::<TileTrials>(&self.trial_key(place)).map(|kept| kept.result),
        };
        self.distrust(&self.lit(), |place| self.trial_key(place), console)?;
        if self.options.merge {
            self.expect_shards()?;
        }
        let work = |place: Place, band: &Band| self.try_tile(place, band);
        let trial_fits = self.each_tile(console, "trying", finished, work, |_| None)?;
        let (trials, seconds): (Vec<Vec<TrialFit>>, Vec<f64>) = trial_fits.into_iter().unzip();
        if self.options.coding == MapCoding::Basis {
            let words = vec![Some(u32::from(self.step_for(&trials)?)); self.header.tiles()];
            let choice = Choice { words, trial_seconds: seconds.iter().sum(), files: self.part.own() };
            self.part.write(&self.choice_key(), &Payload::default(), &choice, None)?;
            return Ok((self.taken(&choice), choice.trial_seconds));
        }
        let contents = |tile: usize, at: Option<usize>| {
            at.and_then(|at| trials[tile].get(at)).and_then(|trial| Contents::of_word(trial.word))
        };
        let contents = |chosen: &[Option<usize>]| -> Vec<Option<Contents>> {
            chosen.iter().enumerate().map(|(tile, at)| contents(tile, *at)).collect()
        };
        let chosen = match self.options.rate {
            Rate::Psnr(db) => self.calibrated(db, &trials, contents, console)?,
            Rate::Bpp(bpp) => allocate::choose(&trials, self.bytes(bpp)?),
            Rate::Usual | Rate::Profile(_) => Vec::new(),
        };
        let chosen = contents(&chosen);
        let words = chosen.iter().map(|contents| contents.and_then(|contents| contents.word())).collect();
        let choice = Choice { words, trial_seconds: seconds.iter().sum(), files: self.part.own() };
        self.part.write(&self.choice_key(), &Payload::default(), &choice, None)?;
        Ok((chosen, choice.trial_seconds))
    }

    /// Makes a tile's trial fits and stores them.
    fn try_tile(&self, place: Place, band: &Band) -> Result<TileTrials> {
        let clock = Clock::start();
        let trials = match self.options.coding {
            MapCoding::Neural => train::trials(&band.tile(place.column), self.recipe(place).seed),
            MapCoding::Basis => self.trials_of_steps(place, band),
        };
        let trials = trials.map_err(|error| of_tile(place, error))?;
        let trial_fits = (trials, clock.seconds());
        self.part.write(&self.trial_key(place), &Payload::default(), &trial_fits, self.made_from(band))?;
        Ok(trial_fits)
    }

    /// The smallest choice found whose tiles reach a pooled PSNR, by the measured gain of training on some of
    /// them: bisects between choices that assume too small a gain and choices that assume too large a one. If
    /// none reaches it, the largest.
    fn calibrated(
        &self,
        db: f64,
        trials: &[Vec<TrialFit>],
        contents: impl Fn(&[Option<usize>]) -> Vec<Option<Contents>>,
        console: &dyn Observer,
    ) -> Result<Vec<Option<usize>>> {
        let terms: u64 = trials.iter().filter_map(|trials| trials.first()).map(|trial| trial.terms).sum();
        // What the tiles together may keep of error.
        let wanted = terms as f64 * 10f64.powf(-db / 10.0);
        let choose = |gain: f64| allocate::choose(trials, Goal::Error(wanted * gain));
        let tried_error = |chosen: &[Option<usize>]| -> f64 {
            chosen.iter().zip(trials).filter_map(|(at, trials)| Some(trials[(*at)?].error)).sum()
        };
        let mut gain = train::gain(self.options.iterations);
        let mut chosen: Vec<Option<usize>> = choose(gain);
        // The largest gain foreseen that was met, with its choice, and the least that was not.
        let mut met: Option<(f64, Vec<Option<usize>>)> = None;
        let mut missed: Option<f64> = None;
        for _ in 0..CALIBRATIONS {
            let Some(found) = self.measured_gain(trials, &chosen, &contents(&chosen), console)? else {
                break;
            };
            if tried_error(&chosen) <= wanted * found * NEARLY {
                if met.as_ref().is_none_or(|(largest, _)| gain > *largest) {
                    met = Some((gain, chosen.clone()));
                }
            } else {
                missed = Some(missed.map_or(gain, |least| least.min(gain)));
            }
            gain = match (&met, missed) {
                (Some((met, _)), Some(missed)) => f64::sqrt(met * missed),
                _ => found,
            };
            let next = choose(gain);
            if next == chosen {
                break;
            }
            chosen = next;
        }
        Ok(met.map_or(chosen, |(_, chosen)| chosen))
    }

    /// The factor by which training reduces the error, compared with trial fits, of the tiles with the
    /// largest errors. Their results are stored, because most tiles will keep these configurations. `None` if
    /// no tile has light.
    fn measured_gain(
        &self,
        trials: &[Vec<TrialFit>],
        chosen: &[Option<usize>],
        contents: &[Option<Contents>],
        console: &dyn Observer,
    ) -> Result<Option<f64>> {
        let error = |tile: usize| chosen[tile].map(|at| trials[tile][at].error);
        let mut worst: Vec<(f64, usize)> = (0..trials.len()).filter_map(|t| Some((error(t)?, t))).collect();
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        worst.truncate(CALIBRATED);
        let places: Vec<Place> = self.header.places().collect();
        let chosen_for = |place: Place| self.header.position(place).and_then(|tile| contents[tile]);
        let key = |place: Place| self.key(place, chosen_for(place));
        // (Shards of another target may have trained them.)
        let examined: Vec<Place> = worst.iter().map(|&(_, tile)| places[tile]).collect();
        self.distrust(&examined, key, console)?;
        let finished = |place: Place| self.finished(&key(place));
        let open = worst.iter().map(|&(_, tile)| places[tile]).filter(|&place| finished(place).is_none());
        let open: Vec<Place> = open.collect();
        let progress = console.progress("measuring the gain of full training", open.len() as u64);
        self.some_tiles(&open, |place, band| {
            let tile = self.train(place, chosen_for(place), band, self.options.iterations)?;
            progress.advance(1);
            self.write_tile(&key(place), &tile, band)
        })?;
        let stored = |tile: usize| finished(places[tile]).and_then(|tile| tile.stats.trained.error);
        let pairs = worst.iter().filter_map(|&(trial_fits, tile)| Some((trial_fits, stored(tile)?)));
        let (trial_fits, stored) =
            pairs.fold((0.0, 0.0), |(a, b), (trial_fits, stored)| (a + trial_fits, b + stored));
        Ok((stored > 0.0).then(|| trial_fits / stored))
    }

    /// The bytes that a rate in bits per texel and frame leaves for the features of all tiles.
    fn bytes(&self, bpp: f64) -> Result<Goal> {
        Ok(Goal::Bytes(self.bytes_of_maps(bpp)?))
    }

    /// The same as a number.
    pub(super) fn bytes_of_maps(&self, bpp: f64) -> Result<u64> {
        let none = vec![Payload::default(); self.header.tiles()];
        let header = bundle::encode(self.header, &none).map_err(of_bundle)?.len() as f64;
        let texels: f64 = self.header.pages.iter().map(|page| page.width as f64 * page.height as f64).sum();
        let bytes = bpp * texels * self.header.timeline.hours.len() as f64 / 8.0;
        Ok((bytes - header - self.bytes_of_sun as f64).max(0.0) as u64)
    }

    /// Runs `work` on every tile that is not `finished`, in parallel; the results are in the order of the
    /// bundle's index.
    fn each_tile<T: Send>(
        &self,
        console: &dyn Observer,
        what: &str,
        finished: impl Fn(Place) -> Option<T> + Sync,
        work: impl Fn(Place, &Band) -> Result<T> + Sync,
        note: impl Fn(&T) -> Option<String> + Sync,
    ) -> Result<Vec<T>> {
        let progress = console.progress(what, self.header.tiles() as u64);
        let show = |tile: &T| {
            if let Some(note) = note(tile) {
                progress.note(&note);
            }
            progress.advance(1);
        };
        let places: Vec<Place> = self.header.places().collect();
        let found = places.par_iter().map(|&place| {
            stop_if_interrupted()?;
            Ok(finished(place).inspect(show))
        });
        let found = found.collect::<Result<Vec<Option<T>>>>()?;
        let open = places.iter().zip(&found).filter(|(_, tile)| tile.is_none());
        let open: Vec<Place> = open.map(|(place, _)| *place).collect();
        let worked = self.some_tiles(&open, |place, band| work(place, band).inspect(show))?;
        let mut worked = worked.into_iter();
        Ok(found.into_iter().filter_map(|tile| tile.or_else(|| worked.next())).collect())
    }

    /// Runs `work` on some tiles, in parallel, with a few bands in memory at a time. The results are in the
    /// order of the index if the tiles are.
    fn some_tiles<T: Send>(
        &self,
        places: &[Place],
        work: impl Fn(Place, &Band) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let mut done = Vec::with_capacity(places.len());
        let mut rows: Vec<(usize, usize)> = places.iter().map(|place| (place.page, place.row)).collect();
        rows.sort_unstable();
        rows.dedup();
        for of_page in rows.chunk_by(|a, b| a.0 == b.0) {
            let page = of_page[0].0;
            for rows in of_page.chunks(self.bands_at_once(page)) {
                let load = |&(_, row): &(usize, usize)| {
                    Ok((row, Band::load(self.dataset, self.law, &self.masks[page], page, row)?))
                };
                let bands = rows.par_iter().map(load).collect::<Result<BTreeMap<usize, Band>>>()?;
                let of_bands = places.par_iter().with_max_len(1).filter(|place| place.page == page);
                let tiles = of_bands.filter_map(|&place| Some((place, bands.get(&place.row)?)));
                let tiles: Vec<Result<T>> = tiles
                    .map(|(place, band)| {
                        stop_if_interrupted()?;
                        work(place, band)
                    })
                    .collect();
                for tile in tiles {
                    done.push(tile?);
                }
            }
        }
        Ok(done)
    }

    /// How many rows of a page's tiles are in memory together.
    fn bands_at_once(&self, page: usize) -> usize {
        let wanted = TILES_PER_THREAD * rayon::current_num_threads();
        wanted.div_ceil(self.header.pages[page].columns())
    }

    /// The tile's own recipe: its randomness depends on its place, never on the order of work.
    fn recipe(&self, place: Place) -> Recipe {
        let recipe = self.options.recipe();
        let seed = seed(recipe.seed, place);
        Recipe { seed, ..recipe }
    }

    /// A file name in the work folder: a digest of a list of values, the input, the tile's coordinate and the
    /// program.
    fn name(&self, place: Place, values: &serde_json::Value) -> String {
        let Place { page, column, row } = place;
        let tier = format!("{:?}", Tier::detect());
        let program = json!([super::program(), bundle::VERSION, tier]);
        let all = json!([
            program,
            self.trained_on,
            self.header.timeline.between,
            page,
            column,
            row,
            self.recipe(place).seed,
            values
        ]);
        super::digest(&all)
    }

    /// The name of a tile's file in the work folder: a digest of everything that decides its bytes.
    fn key(&self, place: Place, contents: Option<Contents>) -> String {
        let Recipe { iterations, passes, aim, .. } = self.recipe(place);
        let limit = self.options.time_limit;
        let has = match (self.options.rate, contents) {
            _ if self.options.coding == MapCoding::Basis => json!(["basis", self.step()]),
            (Rate::Profile(profile), _) => json!(profile.name),
            (_, contents) => json!(contents.and_then(|contents| contents.word())),
        };
        self.name(place, &json!(["tile", has, iterations, passes, limit, format!("{aim:?}")]))
    }

    /// The same for its trial fits.
    fn trial_key(&self, place: Place) -> String {
        self.name(place, &json!(["trials", format!("{:?}", self.options.coding)]))
    }

    /// The name of the file with the chosen configurations. (Bits per texel also count the sun's stream, so
    /// all of the dataset decides.)
    fn choice_key(&self) -> String {
        let Options { coding, rate, iterations, passes, seed, without_sun, still_shadows, .. } =
            *self.options;
        let options =
            json!([format!("{coding:?} {rate:?}"), iterations, passes, seed, without_sun, still_shadows]);
        let files: Vec<Digest> = self.dataset.files().map(|file| file.blake3).collect();
        self.name(Place { page: 0, column: 0, row: 0 }, &json!(["choice", options, files]))
    }

    /// The tile, if a stopped run finished it.
    fn finished(&self, key: &str) -> Option<Tile> {
        let Kept { payload, result: stats, .. } = self.part.read(key)?;
        Some(Tile { payload, stats, resumed: !self.part.wrote(key) })
    }

    fn train(
        &self,
        place: Place,
        contents: Option<Contents>,
        band: &Band,
        iterations: usize,
    ) -> Result<Tile> {
        if self.options.coding == MapCoding::Basis {
            return self.encode(place, band);
        }
        let clock = Clock::start();
        let (source, recipe) = (band.tile(place.column), Recipe { iterations, ..self.recipe(place) });
        let trained = match (self.options.rate, contents) {
            (Rate::Profile(profile), _) => train::train(&source, &profile, &recipe),
            (_, Some(contents)) => train::train(&source, &contents, &recipe),
            // There are no trial fits: the tile has nothing to store, or all of them diverged.
            (_, None) => train::train(&source, &Profile::L, &recipe),
        };
        let trained = trained.map_err(|error| of_tile(place, error))?;
        let faulty = |what| of_tile(place, Error::invalid("payload", format!("training failed: {what}")));
        let payload = match &trained.params {
            Some(params) => {
                let timeline = &self.header.timeline;
                let knots = self.law.knots(timeline, &params.knots, band.shares(place.column));
                bundle::encode_payload(&TileParams { knots, ..params.clone() }).map_err(faulty)?
            }
            None => Payload::default(),
        };
        let stats = TileStats {
            texels: tile::valid_texels(&self.masks[place.page], place),
            trained: TrainedTile { params: None, ..trained },
            seconds: clock.seconds(),
        };
        Ok(Tile { payload, stats, resumed: false })
    }
}

/// The tiles that have a valid texel, in the order of the index.
pub(super) fn lit(header: &Header, masks: &[Mask]) -> Vec<Place> {
    header.places().filter(|place| tile::valid_texels(&masks[place.page], *place) > 0).collect()
}

/// The seed of a tile.
pub(crate) fn seed(seed: u64, place: Place) -> u64 {
    let numbers = [seed, place.page as u64, place.column as u64, place.row as u64];
    bundle::checksum(&numbers.map(u64::to_le_bytes).each_ref().map(|n| &n[..]))
}

/// The error, placed at the tile if it concerns the tile's content.
pub(crate) fn of_tile(place: Place, error: Error) -> Error {
    match error {
        Error::Invalid { what, .. } => {
            let Place { page, column, row } = place;
            Error::invalid(format!("page {page}, tile ({column}, {row})"), what)
        }
        other => other,
    }
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
