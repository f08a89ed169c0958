//! The tiles of a scene at all levels, and their mean light, which is known without reading one.

use crate::{Error, Result};
use ndgi::bundle::{Bundle, MapCoding};
use ndgi::grid::{Grid, Place};
use ndgi::model::{Contents, Knot};
use ndgi::time::TimePoint;
use std::sync::Arc;

/// Most levels: an entry of the page table has four bits for one.
const LEVELS: usize = 16;

/// The number of a tile. Tiles are numbered level by level from the finest, then page by page, then row by
/// row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Tile(pub u32);

/// The level and place of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// The level: 0 is the finest; a texel of level m covers 2^m × 2^m texels of level 0.
    pub level: usize,
    /// Page, column and row in the level's bundle.
    pub place: Place,
}

/// The bundles of a scene, finest first; each has half the resolution of the one before.
#[derive(Clone, Debug)]
pub struct Pyramid {
    levels: Vec<Level>,
    tiles: Vec<Facts>,
}

#[derive(Clone, Debug)]
struct Level {
    bundle: Arc<Bundle>,
    /// The number of its first tile.
    first: u32,
    /// By page, the number of tiles before it on this level.
    pages: Vec<u32>,
    /// By tile of the level and knot, how far its light has gone up and down since the first knot: the sum of
    /// the absolute changes of its mean.
    travelled: Vec<f32>,
    knots: usize,
}

/// What the index says of a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facts {
    /// It has maps: its light changes over the day.
    pub has_maps: bool,
    /// The sun reaches it at some time.
    pub has_sun: bool,
    /// Its network takes the state of a light group as input.
    pub has_gates: bool,
}

impl Facts {
    /// It has no light at any time.
    pub(crate) fn is_black(&self) -> bool {
        !self.has_maps && !self.has_sun
    }
}

/// An hour of the day, with what depends on it alone, for all levels.
#[derive(Clone, Debug)]
pub struct Now {
    /// The hour in [0, 24).
    pub hour: f64,
    /// Which light groups are on.
    pub state: Vec<bool>,
    levels: Vec<OfLevel>,
}

#[derive(Clone, Debug)]
struct OfLevel {
    point: TimePoint,
    /// The times of visibility before and after the hour, and the sun's irradiance; `None` if it is down.
    sun: Option<([usize; 2], [f32; 3])>,
}

impl Pyramid {
    /// A pyramid of the levels of one scene, finest first. A single bundle will do.
    ///
    /// # Errors
    /// [`Error::Invalid`] for bundles that are not levels of one scene: their light groups differ, or a
    /// level's pages are not those of the level before halved, rounded up. And for more than 16.
    pub fn new(bundles: Vec<Arc<Bundle>>) -> Result<Self> {
        let Some(finest) = bundles.first() else {
            return Err(Error::Invalid("no bundle; expected at least one".to_owned()));
        };
        if bundles.len() > LEVELS {
            return Err(Error::Invalid(format!("{} levels; expected at most {LEVELS}", bundles.len())));
        }
        let (mut levels, mut tiles) = (Vec::new(), Vec::new());
        for (level, bundle) in bundles.iter().enumerate() {
            let header = &bundle.header;
            if header.coding != MapCoding::Neural {
                return Err(Error::Invalid(format!(
                    "level {level} has planes (coding basis), which are not streamed yet; compress with --coding neural"
                )));
            }
            let halved = |side: usize| side.div_ceil(1 << level);
            let of_level = |grid: &Grid| Grid { width: halved(grid.width), height: halved(grid.height) };
            let expected: Vec<Grid> = finest.header.pages.iter().map(of_level).collect();
            if header.pages != expected {
                let found = header.pages.iter().zip(&expected).position(|(page, expected)| page != expected);
                let what = match found {
                    Some(page) => {
                        let [is, should] = [&header.pages[page], &expected[page]];
                        format!(
                            "page {page} of {} × {} texels; expected {} × {} (half the level before, rounded up)",
                            is.width, is.height, should.width, should.height
                        )
                    }
                    None => format!("{} pages; expected {}", header.pages.len(), expected.len()),
                };
                return Err(Error::Invalid(format!("level {level} has {what}")));
            }
            let lamps =
                |bundle: &Bundle| (bundle.header.groups.clone(), bundle.header.timeline.intervals.clone());
            if lamps(bundle) != lamps(finest) {
                return Err(Error::Invalid(format!(
                    "the light groups of level {level} differ from those of level 0"
                )));
            }
            levels.push(Level::new(bundle, tiles.len() as u32)?);
            for entry in &bundle.index {
                let contents = Contents::of_word(entry.maps.word).filter(|_| entry.maps.length > 0);
                tiles.push(Facts {
                    has_maps: contents.is_some(),
                    has_sun: entry.sun.length > 0,
                    has_gates: contents.is_some_and(|contents| contents.gates > 0),
                });
            }
        }
        Ok(Pyramid { levels, tiles })
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// A level's bundle.
    pub fn bundle(&self, level: usize) -> &Arc<Bundle> {
        &self.levels[level].bundle
    }

    /// Number of tiles of all levels.
    pub fn tiles(&self) -> usize {
        self.tiles.len()
    }

    /// Number of pages.
    pub fn pages(&self) -> usize {
        self.levels[0].pages.len()
    }

    /// The first tile of a page at a level.
    pub fn first(&self, level: usize, page: usize) -> Tile {
        let level = &self.levels[level];
        Tile(level.first + level.pages[page])
    }

    /// The tile at a level and place; `None` if there is none.
    pub fn tile(&self, Spot { level, place }: Spot) -> Option<Tile> {
        let grid = self.levels.get(level)?.bundle.header.pages.get(place.page)?;
        let inside = place.column < grid.columns() && place.row < grid.rows();
        let Tile(first) = if inside { self.first(level, place.page) } else { return None };
        Some(Tile(first + (place.row * grid.columns() + place.column) as u32))
    }

    /// The level and place of a tile; `None` for a number that no tile has.
    pub fn spot(&self, Tile(number): Tile) -> Option<Spot> {
        if number as usize >= self.tiles.len() {
            return None;
        }
        let level = self.levels.partition_point(|level| level.first <= number) - 1;
        let Level { first, pages, bundle, .. } = &self.levels[level];
        let within = number - first;
        let page = pages.partition_point(|page| *page <= within) - 1;
        let columns = bundle.header.pages[page].columns();
        let i = (within - pages[page]) as usize;
        Some(Spot { level, place: Place { page, column: i % columns, row: i / columns } })
    }

    /// The tile of the next coarser level that covers a tile; `None` on the last level.
    pub fn parent(&self, tile: Tile) -> Option<Tile> {
        let Spot { level, place } = self.spot(tile)?;
        let place = Place { column: place.column / 2, row: place.row / 2, ..place };
        self.tile(Spot { level: level + 1, place })
    }

    /// The tiles of the next finer level that a tile covers; none on the finest.
    pub fn children(&self, tile: Tile) -> impl Iterator<Item = Tile> + '_ {
        let spot = self.spot(tile).filter(|spot| spot.level > 0);
        spot.into_iter().flat_map(move |Spot { level, place }| {
            let child = move |i: usize| {
                let (column, row) = (2 * place.column + i % 2, 2 * place.row + i / 2);
                self.tile(Spot { level: level - 1, place: Place { column, row, ..place } })
            };
            (0..4).filter_map(child)
        })
    }

    /// The tiles of the last, coarsest level, page by page.
    pub fn roots(&self) -> impl Iterator<Item = Tile> + use<> {
        let first = self.levels.last().map_or(0, |level| level.first);
        (first..self.tiles.len() as u32).map(Tile)
    }

    /// Whether a tile has no light at any time.
    pub fn is_black(&self, tile: Tile) -> bool {
        self.facts(tile).is_black()
    }

    pub(crate) fn facts(&self, tile: Tile) -> &Facts {
        &self.tiles[tile.0 as usize]
    }

    /// What depends on the hour alone (periodic in 24), for all levels.
    ///
    /// # Errors
    /// [`Error::Bundle`] for an hour that is not a finite number.
    pub fn at(&self, hour: f64) -> Result<Now> {
        let of_level = |level: &Level| {
            let at = level.bundle.at(hour)?;
            let sun = at.sun().map(|sun| (sun.times, sun.irradiance));
            Ok(OfLevel { point: *at.point(), sun })
        };
        let levels = self.levels.iter().map(of_level).collect::<Result<_>>()?;
        let hour = ndgi::time::fold_hour(hour);
        Ok(Now { hour, state: self.levels[0].bundle.header.timeline.state(hour), levels })
    }

    /// The mean light of a tile's maps as red, green and blue, without the sun's stream.
    pub fn mean(&self, tile: Tile, now: &Now) -> [f32; 3] {
        let (_, point, knots) = self.knots(tile, now);
        let [a, b] = point.knots.map(|knot| knots.get(knot).map_or([0.0; 3], |knot| knot.mean));
        std::array::from_fn(|c| {
            (f64::from(a[c]) * (1.0 - point.fraction) + f64::from(b[c]) * point.fraction) as f32
        })
    }

    fn knots<'a>(&'a self, tile: Tile, now: &'a Now) -> (usize, &'a TimePoint, &'a [Knot]) {
        let level = self.level_of(tile);
        let of = &self.levels[level];
        (level, &now.levels[level].point, of.bundle.knots_at((tile.0 - of.first) as usize))
    }

    fn level_of(&self, tile: Tile) -> usize {
        self.levels.partition_point(|level| level.first <= tile.0) - 1
    }

    /// The times of visibility before and after an hour at a tile's level, and the sun's irradiance; `None`
    /// if the sun is down.
    pub(crate) fn sun(&self, tile: Tile, now: &Now) -> Option<([usize; 2], [f32; 3])> {
        now.levels[self.level_of(tile)].sun
    }

    /// How far a tile's mean has travelled from the first knot to an hour, and in a whole day.
    pub(crate) fn travelled(&self, tile: Tile, now: &Now) -> [f32; 2] {
        let (level, point, _) = self.knots(tile, now);
        let level = &self.levels[level];
        if level.knots == 0 {
            return [0.0; 2];
        }
        let of_tile = &level.travelled[(tile.0 - level.first) as usize * (level.knots + 1)..][..=level.knots];
        let whole = of_tile[level.knots];
        let [from, to] = point.knots.map(|knot| of_tile[knot]);
        let to = if to < from { to + whole } else { to };
        [from + (to - from) * point.fraction as f32, whole]
    }
}

impl Level {
    fn new(bundle: &Arc<Bundle>, first: u32) -> Result<Self> {
        let (mut pages, mut before) = (Vec::new(), 0);
        for grid in &bundle.header.pages {
            pages.push(before);
            before += grid.tiles() as u32;
        }
        let knots = bundle.header.knots();
        let mut travelled = Vec::with_capacity(bundle.index.len() * (knots + 1));
        for place in bundle.header.places() {
            let of_tile = bundle.knots(place)?;
            let (mut sum, mut last) = (0.0, of_tile.first().map(|knot| knot.mean));
            // All knots, and the first one of the next day.
            for knot in 0..=knots {
                let mean = of_tile.get(knot % knots.max(1)).map(|knot| knot.mean);
                if let Some((mean, last)) = mean.zip(last) {
                    sum += (0..3).map(|c| (mean[c] - last[c]).abs()).sum::<f32>();
                }
                last = mean;
                travelled.push(sum);
            }
        }
        Ok(Level { bundle: Arc::clone(bundle), first, pages, travelled, knots })
    }
}
