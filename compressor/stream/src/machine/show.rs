//! The page table: which slot each tile shows.

use super::{Commands, Entry, Stream};
use crate::Tile;
use std::sync::Arc;

impl Stream {
    /// Lists the entries that have changed. An entry is the tile's own slot, or that of the nearest tile that
    /// covers it.
    pub(super) fn show(&mut self, commands: &mut Commands) {
        let mut altered = std::mem::take(&mut self.altered);
        // From the last level on: what covers a tile comes before it.
        altered.sort_unstable_by(|a, b| b.cmp(a));
        altered.dedup();
        let pyramid = Arc::clone(&self.pyramid);
        let mut to_do: Vec<Tile> = Vec::new();
        for tile in altered {
            to_do.push(tile);
            while let Some(tile) = to_do.pop() {
                let entry = self.entry_of(tile);
                let known = &mut self.table[tile.0 as usize];
                if *known != entry {
                    *known = entry;
                    commands.table.push((tile, entry));
                    // Those that it covers and that have no slot show what it does.
                    to_do.extend(pyramid.children(tile).filter(|child| self.state(*child).shown.is_none()));
                }
            }
        }
    }

    /// What a tile shows, where what its parent shows is known.
    fn entry_of(&self, tile: Tile) -> Entry {
        let Some(spot) = self.pyramid.spot(tile).filter(|_| !self.pyramid.is_black(tile)) else {
            return Entry::Mean;
        };
        match (self.state(tile).shown, self.pyramid.parent(tile)) {
            (Some(shown), _) => Entry::Slot { slot: shown.slot, level: spot.level as u8 },
            (None, Some(parent)) => self.entry(parent),
            (None, None) => Entry::Mean,
        }
    }
}
