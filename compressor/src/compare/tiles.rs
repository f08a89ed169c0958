//! The input of every method: the same whole tiles in all frames.

use super::Options;
use crate::bundle::checksum;
use crate::compress::{seed, timeline};
use crate::grid::Place;
use crate::tile::{Band, Coverage, TileSource};
use crate::time::Timeline;
use crate::{Error, Result};
use dataset::format::FileRef;
use dataset::format::tiles::{Rect, TILE, grid, tiles};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Mask;
use dataset::observe::count;
use dataset::pictures::metrics;
use dataset::store::Dataset;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Memory that the light of all tiles may take.
const MEMORY: u64 = 8 << 30;
/// Number of copies in memory at once: original, filled, and decoded.
const HELD: usize = 3;

/// An image of a tile at one frame: its texels row by row.
pub(super) type Texels = Vec<[f32; 3]>;

/// A tile of the paper's grid with its light.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    /// Its page, column and row.
    pub place: Place,
    /// Index in the page's grid.
    pub index: usize,
    /// What the NDGI trainer sees, without a border.
    pub source: TileSource,
    /// What a texture holds at every frame: where no texel is valid, what its neighbours have, so that no
    /// method spends bits there.
    pub filled: Vec<Texels>,
    /// The texels that are evaluated.
    pub mask: Mask,
    /// Per frame: the largest valid value.
    pub peaks: Vec<f32>,
}

/// The tiles of a run, and what they share.
#[derive(Clone, Debug)]
pub(super) struct TileSet {
    pub tiles: Vec<Tile>,
    /// Tiles with valid texels that they were drawn from.
    pub of: usize,
    pub timeline: Timeline,
}

impl Tile {
    /// Indices of the valid texels.
    pub(super) fn valid(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.mask.valid.len()).filter(|&i| self.mask.valid[i])
    }

    /// Texels that a method stores.
    pub(super) fn texels(&self) -> usize {
        self.source.width * self.source.height
    }

    /// The whole tile.
    pub(super) fn rect(&self) -> Rect {
        Rect { x0: 0, y0: 0, x1: self.source.width, y1: self.source.height }
    }

    /// Of a source whose light is finite and not negative.
    pub(super) fn new(place: Place, index: usize, source: TileSource) -> Self {
        let (width, height) = (source.width, source.height);
        let valid = source.coverage.iter().map(|coverage| *coverage == Coverage::Valid).collect();
        let mask = Mask { width, height, valid };
        let fill = Fill::new(&mask);
        let filled = source.frames.iter().map(|set| fill.apply(set)).collect();
        let peak = |set: &Texels| {
            let values =
                set.iter().zip(&mask.valid).filter(|(_, valid)| **valid).flat_map(|(texel, _)| *texel);
            values.fold(0.0, f32::max)
        };
        let peaks = source.frames.iter().map(peak).collect();
        Tile { place, index, source, filled, mask, peaks }
    }
}

impl TileSet {
    /// Values that bits are counted on: stored texels × frames.
    pub(super) fn values(&self) -> f64 {
        self.tiles.iter().map(|tile| (tile.texels() * tile.source.frames.len()) as f64).sum()
    }

    /// Reads the tiles of a run: this many, drawn by the seed from all pages, or the first page's.
    pub(super) fn load(dataset: &Dataset, options: &Options) -> Result<Self> {
        let masks = dataset.masks()?;
        // What a camera sees may lie on any page.
        let number = if options.render { Some(usize::MAX) } else { options.tiles };
        let (chosen, of) = choose(&masks, number, options.seed);
        let texels: usize = chosen.iter().map(|(_, rect)| rect.width() * rect.height()).sum();
        let bytes = (HELD * texels * dataset.config.frames.len() * size_of::<[f32; 3]>()) as u64;
        if bytes > MEMORY {
            let hint = if options.render { "omit --render" } else { "use fewer --tiles" };
            let what = format!(
                "{} with {} would need about {} GB of memory; expected at most {}: {hint}",
                count(chosen.len(), "tile"),
                count(dataset.config.frames.len(), "frame"),
                bytes >> 30,
                MEMORY >> 30
            );
            return Err(Error::unsupported(dataset.root.display(), what));
        }
        let used: BTreeSet<usize> = chosen.iter().map(|(place, _)| place.page).collect();
        let files: BTreeMap<&str, &FileRef> = (used.iter())
            .flat_map(|&page| dataset.config.frames.iter().map(move |set| &set.maps[page]))
            .map(|file| (file.path.as_str(), file))
            .collect();
        files.par_iter().try_for_each(|(_, file)| dataset.verified(file).map(drop))?;
        let load = |(place, rect): (Place, Rect)| {
            stop_if_interrupted()?;
            let mask = &masks[place.page];
            let across = grid(mask.width, mask.height, TILE).0;
            let source = Band::load_alone(dataset, mask, place.page, rect)?;
            Ok(Tile::new(place, place.row * across + place.column, source))
        };
        let tiles = chosen.into_iter().map(load).collect::<Result<_>>()?;
        Ok(TileSet { tiles, of, timeline: timeline(dataset) })
    }
}

/// The tiles of a run with their texels, by page and row, and how many there are with a valid texel.
fn choose(masks: &[Mask], number: Option<usize>, of_seed: u64) -> (Vec<(Place, Rect)>, usize) {
    let mut all: Vec<(Place, Rect)> = Vec::new();
    for (page, mask) in masks.iter().enumerate() {
        let across = grid(mask.width, mask.height, TILE).0;
        let of_page = tiles(mask.width, mask.height, TILE).into_iter().enumerate();
        all.extend(
            of_page
                .filter(|(_, rect)| rect.valid(mask).next().is_some())
                .map(|(i, rect)| (Place { page, column: i % across, row: i / across }, rect)),
        );
    }
    let of = all.len();
    match number {
        None => {
            let first = all.first().map(|(place, _)| place.page);
            all.retain(|(place, _)| Some(place.page) == first);
        }
        Some(number) => {
            // The order of their digests is as good as random.
            all.sort_by_key(|(place, _)| checksum(&[b"compare", &seed(of_seed, *place).to_le_bytes()]));
            all.truncate(number);
            all.sort_by_key(|(place, _)| (place.page, place.row, place.column));
        }
    }
    (all, of)
}

/// How texels without a surface are filled: ring by ring around the valid ones, each with the mean of its
/// neighbours that have a value.
pub(super) struct Fill {
    /// A texel, and the neighbours whose mean it gets; in an order in which these come first.
    steps: Vec<(usize, Vec<usize>)>,
}

impl Fill {
    fn new(mask: &Mask) -> Self {
        Fill::near(mask, usize::MAX)
    }

    /// This many rings around valid texels.
    pub(super) fn near(mask: &Mask, most: usize) -> Self {
        let (width, height) = (mask.width, mask.height);
        let mut known = mask.valid.clone();
        let mut steps = Vec::new();
        for _ in 0..most {
            let mut ring = Vec::new();
            for i in (0..known.len()).filter(|&i| !known[i]) {
                let (x, y) = (i % width, i / width);
                let rows = y.saturating_sub(1)..(y + 2).min(height);
                let around =
                    rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
                let from: Vec<usize> = around.filter(|&j| known[j]).collect();
                if !from.is_empty() {
                    ring.push((i, from));
                }
            }
            if ring.is_empty() {
                break;
            }
            ring.iter().for_each(|(i, _)| known[*i] = true);
            steps.extend(ring);
        }
        Fill { steps }
    }

    pub(super) fn apply(&self, set: &Texels) -> Texels {
        let mut filled = set.clone();
        for (i, from) in &self.steps {
            let sum = |c: usize| from.iter().map(|&j| filled[j][c]).sum::<f32>();
            filled[*i] = [0, 1, 2].map(|c| sum(c) / from.len() as f32);
        }
        filled
    }
}

/// The mean of a frame over the tiles of a run.
pub(super) fn set_means(set: &TileSet) -> Vec<f64> {
    let mean = |k: usize| {
        let sums = set.tiles.iter().map(|tile| metrics::valid_sum(&tile.source.frames[k], &tile.mask.valid));
        let (sum, texels) = sums.fold((0.0, 0), |(a, n), (b, m)| (a + b, n + m));
        if texels == 0 { 0.0 } else { sum / (3 * texels) as f64 }
    };
    (0..set.timeline.hours.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_those_of_the_first_page_or_drawn_from_all() {
        let mask = |width: usize, height: usize, from: usize| Mask {
            width,
            height,
            valid: (0..width * height).map(|i| i % width >= from).collect(),
        };
        // Nothing valid on the first page; nothing in the second one's first column of tiles.
        let masks = [mask(200, 100, 200), mask(400, 130, 128), mask(100, 100, 0)];
        let (page, of) = choose(&masks, None, 1);
        let places: Vec<_> = page.iter().map(|(place, _)| (place.page, place.column, place.row)).collect();
        assert_eq!(places, [(1, 1, 0), (1, 2, 0), (1, 3, 0), (1, 1, 1), (1, 2, 1), (1, 3, 1)]);
        assert_eq!((of, page[2].1), (7, Rect { x0: 384, y0: 0, x1: 400, y1: 128 }));
        let (some, _) = choose(&masks, Some(3), 1);
        assert_eq!(some, choose(&masks, Some(3), 1).0);
        assert!((2..9).any(|seed| choose(&masks, Some(3), seed).0 != some));
        assert_eq!(choose(&masks, Some(99), 1).0.len(), 7);
    }

    #[test]
    fn what_is_not_valid_gets_the_mean_of_its_neighbours() {
        let mut mask = Mask { width: 5, height: 1, valid: vec![false; 5] };
        mask.valid[1] = true;
        mask.valid[3] = true;
        let set = vec![[9.0; 3], [1.0; 3], [9.0; 3], [3.0; 3], [9.0; 3]];
        let filled = Fill::new(&mask).apply(&set);
        assert_eq!(filled.iter().map(|texel| texel[0]).collect::<Vec<_>>(), [1.0, 1.0, 2.0, 3.0, 3.0]);
    }
}
