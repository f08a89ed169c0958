//! The page table: which slot each tile shows.

use super::{Commands, Entry, Stream};
use crate::Tile;

impl Stream {
    /// Tells the entries that are different now: a tile's own slot, or the one of the nearest tile that covers it.
    pub(super) fn show(&mut self, commands: &mut Commands) {
        if !std::mem::take(&mut self.is_table_old) {
            return;
        }
        let mut table = vec![Entry::Mean; self.tiles.len()];
        // From the last level on: what covers a tile comes before it.
        for number in (0..self.tiles.len()).rev() {
            let tile = Tile(number as u32);
            let Some(spot) = self.pyramid.spot(tile).filter(|_| !self.pyramid.facts(tile).is_black()) else {
                continue;
            };
            table[number] = match (self.state(tile).shown, self.pyramid.parent(tile)) {
                (Some(shown), _) => Entry::Slot { slot: shown.slot, level: spot.level as u8 },
                (None, Some(parent)) => table[parent.0 as usize],
                (None, None) => Entry::Mean,
            };
        }
        let changed = (0..).zip(table.iter().zip(&self.table)).filter(|(_, (new, old))| new != old);
        commands.table.extend(changed.map(|(number, (new, _))| (Tile(number), *new)));
        self.table = table;
    }
}
