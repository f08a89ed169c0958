//! Small tiles for the tests of methods.

use super::tiles::{Texels, Tile, TileSet};
use crate::grid::Place;
use crate::tile::{Coverage, TileSource};
use crate::time::{Coding, Timeline};
use crate::train::targets::Random;

/// A tile of these frames, all valid, at even hours.
pub(super) fn tile_of(width: usize, height: usize, frames: Vec<Texels>) -> Tile {
    let hours = (0..frames.len()).map(|k| 24.0 * k as f64 / frames.len() as f64).collect();
    let coverage = vec![Coverage::Valid; width * height];
    let source = TileSource { width, height, hours, frames, coverage, gates: vec![], neighbours: [false; 4] };
    Tile::new(Place { page: 0, column: 0, row: 0 }, 0, source)
}

/// A tile of random light, every seventh texel invalid.
pub(super) fn tile(width: usize, height: usize, frames: usize, seed: u64) -> Tile {
    let mut random = Random::new(seed);
    let mut set = || (0..width * height).map(|_| std::array::from_fn(|_| random.uniform(0.0, 1.0))).collect();
    let mut tile = tile_of(width, height, (0..frames).map(|_| set()).collect());
    let mut source = tile.source.clone();
    source.coverage.iter_mut().step_by(7).for_each(|coverage| *coverage = Coverage::Outside);
    tile = Tile::new(tile.place, 0, source);
    tile
}

/// The tiles of a run, without light groups.
pub(super) fn set_of(tiles: Vec<Tile>, hours: &[f64]) -> TileSet {
    let states = vec![vec![]; hours.len()];
    let timeline = Timeline {
        hours: hours.to_vec(),
        between: vec![],
        intervals: vec![],
        states,
        coding: Coding::Standard,
    };
    TileSet { of: tiles.len(), tiles, timeline }
}
