//! Chooses the wanted tiles: those that the view needs, as far as there are slots.

use super::{Data, Seen, Stream};
use crate::Tile;
use std::collections::BTreeMap;

/// The view is to ask for finer levels if its tiles need less than the first share of the slots, for coarser
/// ones if more than the second.
const FULL: [f32; 2] = [0.75, 0.95];
/// A tile stays wanted for this many feedbacks, the one that saw it included.
const LINGERS: u32 = 8;
/// Levels by which the bias changes per feedback, for each share of the slots beyond those limits.
const PACE: f32 = 0.2;
/// The most levels by which it changes per feedback.
const MOST: f32 = 0.1;

impl Stream {
    /// Takes up a feedback.
    pub(super) fn want(&mut self, seen: &[Seen]) {
        let mut wanted = BTreeMap::<Tile, u32>::new();
        for Seen { tile, pixels } in seen {
            let Some(tile) = self.readable(*tile) else { continue };
            let sum = wanted.entry(tile).or_default();
            *sum = sum.saturating_add(*pixels);
        }
        // What covers them is shown until they are there: the coarsest tiles, and those that are shown now.
        let covers: Vec<Tile> = wanted.keys().flat_map(|tile| self.covers(*tile)).collect();
        for tile in covers.into_iter().filter_map(|tile| self.readable(tile)) {
            wanted.entry(tile).or_insert(1);
        }
        let room = self.slots.len() - self.pinned.iter().filter(|tile| !wanted.contains_key(tile)).count();
        self.bias(wanted.len() as f32 / room as f32);
        let mut order: Vec<(Tile, u32)> = wanted.into_iter().collect();
        order.sort_by_key(|(tile, pixels)| (!self.is_root(*tile), std::cmp::Reverse(*pixels), *tile));
        order.truncate(room);
        // Tiles of a few pixels are not in every feedback, so those of the last few feedbacks stay wanted if
        // there is room.
        self.seen.retain(|_, (_, age)| {
            *age += 1;
            *age < LINGERS
        });
        self.seen.extend(order.iter().map(|(tile, pixels)| (*tile, (*pixels, 0))));
        let mut lingering: Vec<(u32, Tile, u32)> = self
            .seen
            .iter()
            .filter(|(_, (_, age))| *age > 0)
            .map(|(tile, (pixels, age))| (*age, *tile, *pixels))
            .collect();
        lingering.retain(|(_, tile, _)| self.state(*tile).data != Data::Failed);
        lingering.sort_unstable();
        order.extend(lingering.into_iter().take(room - order.len()).map(|(_, tile, pixels)| (tile, pixels)));
        self.wanted = order.into_iter().collect();
    }

    /// The tile, or else the nearest one that covers it and can be read; `None` if there is none, or if the
    /// tile has no light.
    fn readable(&self, tile: Tile) -> Option<Tile> {
        let mut tile = self.pyramid.spot(tile).map(|_| tile)?;
        if self.pyramid.facts(tile).is_black() {
            return None;
        }
        while self.state(tile).data == Data::Failed {
            tile = self.pyramid.parent(tile)?;
        }
        Some(tile)
    }

    /// The tile of the last level that covers a tile.
    fn root(&self, mut tile: Tile) -> Tile {
        while let Some(parent) = self.pyramid.parent(tile) {
            tile = parent;
        }
        tile
    }

    /// The coarsest tile that covers a tile; the nearest one that is shown in its place; and the next one of
    /// a tile that could not be read so far.
    fn covers(&self, tile: Tile) -> impl Iterator<Item = Tile> + use<> {
        let above = |tile: &Tile| self.pyramid.parent(*tile);
        let is_shown = |tile: &Tile| self.state(*tile).shown.is_some();
        let shown = std::iter::successors(Some(tile), above).find(is_shown);
        let next = above(&tile).filter(|_| self.state(tile).reported);
        [Some(self.root(tile)), shown, next].into_iter().flatten()
    }

    pub(super) fn is_root(&self, tile: Tile) -> bool {
        self.pyramid.spot(tile).is_some_and(|spot| spot.level + 1 == self.pyramid.levels())
    }

    fn bias(&mut self, full: f32) {
        let [low, high] = FULL;
        let beyond = (full - high).max(0.0) + (full - low).min(0.0);
        let most = (self.pyramid.levels() - 1) as f32;
        self.mip_bias = (self.mip_bias + (PACE * beyond).clamp(-MOST, MOST)).clamp(0.0, most);
    }

    /// Marks the tiles that are wanted in this step; pinned tiles always are.
    pub(super) fn mark(&mut self) {
        let pinned = self.pinned.iter().map(|tile| (*tile, 1));
        let wanted: Vec<(Tile, u32)> =
            pinned.chain(self.wanted.iter().map(|(tile, pixels)| (*tile, *pixels))).collect();
        for (tile, pixels) in wanted {
            let step = self.step;
            let state = self.state_mut(tile);
            (state.wanted, state.pixels) = (step, pixels);
        }
    }

    /// The tiles wanted in this step: roots first, then by pixels; pinned tiles that no view sees come last.
    pub(super) fn in_order(&self) -> Vec<Tile> {
        let mut order: Vec<Tile> = self.wanted.keys().chain(&self.pinned).copied().collect();
        order.sort_unstable();
        order.dedup();
        order.sort_by_key(|tile| {
            let is_unseen = !self.wanted.contains_key(tile);
            (is_unseen, !self.is_root(*tile), std::cmp::Reverse(self.state(*tile).pixels))
        });
        order
    }
}
