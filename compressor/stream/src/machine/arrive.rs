//! Takes up what was read.

use super::{Answer, Commands, Completion, Data, Stream};
use crate::Tile;

/// Steps before the first retry of a read; the wait doubles after each failure.
const PAUSE: u64 = 8;
/// Doublings of it, at most.
const MOST: u32 = 6;

impl Stream {
    /// Takes up answers, and ignores those to reads that are no longer needed.
    pub(super) fn arrive(&mut self, completions: &[Completion], commands: &mut Commands) {
        for Completion { ticket, answer } in completions {
            let of = |state: &Data| matches!(state, Data::Reading { ticket: own, .. } if own == ticket);
            let reading = self.under_way.iter().copied().find(|tile| of(&self.state(*tile).data));
            match (reading, self.intervals.remove(ticket)) {
                (Some(tile), _) => self.of_features(tile, answer, commands),
                (None, Some(tile)) => self.of_interval(tile, answer, commands),
                (None, None) => {}
            }
        }
    }

    fn of_features(&mut self, tile: Tile, answer: &Answer, commands: &mut Commands) {
        let Data::Reading { tries, .. } = self.state(tile).data else { return };
        let times = self.state(tile).visible.ready;
        let Answer::Failed { is_lasting, what } = answer else {
            self.state_mut(tile).data = Data::Arrived { times };
            return;
        };
        // Only what is damaged is given up.
        if *is_lasting || tries >= self.budgets.retries {
            self.report(tile, what, commands);
        }
        self.under_way.retain(|other| *other != tile);
        self.state_mut(tile).visible = Default::default();
        match is_lasting {
            true => self.give_up(tile, commands),
            false => {
                let step = self.step + (PAUSE << tries.min(MOST));
                self.state_mut(tile).data = Data::Waiting { step, tries: tries + 1 };
            }
        }
    }

    fn of_interval(&mut self, tile: Tile, answer: &Answer, commands: &mut Commands) {
        let visible = &mut self.state_mut(tile).visible;
        let Some((_, times)) = visible.asked.take() else { return };
        match answer {
            Answer::Arrived => visible.ready = Some(times),
            // Asked for again in the next step.
            Answer::Failed { is_lasting: false, .. } => {}
            Answer::Failed { what, .. } => {
                // Its features passed their checks, so unpacking would fail again.
                self.report(tile, what, commands);
                self.give_up(tile, commands);
            }
        }
    }

    /// Never reads a tile again. Its slot could not be decoded again, so a coarser tile is the better choice.
    fn give_up(&mut self, tile: Tile, commands: &mut Commands) {
        self.wanted.remove(&tile);
        self.pinned.retain(|other| *other != tile);
        self.free_slot(tile, commands);
        self.free_place(tile, commands);
        self.state_mut(tile).data = Data::Failed;
    }

    /// Takes away a tile's slot.
    pub(super) fn free_slot(&mut self, tile: Tile, commands: &mut Commands) {
        if let Some(shown) = self.state_mut(tile).shown.take() {
            self.slots[shown.slot as usize] = None;
            self.altered.push(tile);
            commands.evictions.push(tile);
        }
    }

    /// Takes a tile's data off the device.
    pub(super) fn free_place(&mut self, tile: Tile, commands: &mut Commands) {
        let state = self.state_mut(tile);
        if let Data::Held { place, .. } = state.data {
            state.data = Data::Absent;
            let asked = state.visible.asked.take();
            state.visible = Default::default();
            if let Some((ticket, _)) = asked {
                self.intervals.remove(&ticket);
            }
            self.places[place as usize] = None;
            commands.unloads.push(place);
            commands.drops.push(tile);
        }
    }
}
