//! Chooses what is loaded onto the device, and what is read.

use super::{Commands, Data, Load, Read, Stream, oldest};
use crate::{Now, Tile};

/// Data that arrived and found no place is dropped once it was not wanted for this many steps.
const PATIENCE: u64 = 60;

impl Stream {
    /// Puts what arrived on the device, wanted tiles first.
    pub(super) fn load(&mut self, now: &Now, commands: &mut Commands) {
        let mut arrived: Vec<Tile> = self.under_way.clone();
        arrived.retain(|tile| matches!(self.state(*tile).data, Data::Arrived { .. }));
        arrived.sort_by_key(|tile| {
            let state = self.state(*tile);
            (std::cmp::Reverse(state.wanted), !self.is_root(*tile), std::cmp::Reverse(state.pixels), *tile)
        });
        for tile in arrived {
            if commands.loads.len() >= self.budgets.loads {
                break;
            }
            let Data::Arrived { times } = self.state(tile).data else { continue };
            let wanted = self.state(tile).wanted;
            // Evicts no tile that is wanted now, and none that was wanted more recently than this one.
            let step = self.step;
            let may_go = |other: Tile| Some(self.state(other).wanted).filter(|last| *last < wanted.min(step));
            let Some(place) = oldest(&self.places, may_go) else {
                if wanted + PATIENCE < self.step {
                    self.under_way.retain(|other| *other != tile);
                    let state = self.state_mut(tile);
                    (state.data, state.visible) = Default::default();
                    commands.drops.push(tile);
                }
                continue;
            };
            if let Some(other) = self.places[place as usize] {
                self.free_place(other, commands);
                commands.unloads.retain(|of| *of != place);
            }
            self.places[place as usize] = Some(tile);
            self.under_way.retain(|other| *other != tile);
            let state = self.state_mut(tile);
            state.data = Data::Held { place, since: step };
            state.visible = super::Visible { held: times, ..Default::default() };
            // Its sun has to be decoded again.
            state.shown.iter_mut().for_each(|shown| shown.sun = None);
            commands.loads.push(Load { tile, place, features: true, times });
        }
        self.load_intervals(now, commands);
    }

    /// Puts intervals that are in memory on the device.
    fn load_intervals(&mut self, now: &Now, commands: &mut Commands) {
        let before = commands.loads.len();
        for tile in self.in_order() {
            if commands.loads.len() - before >= self.budgets.loads {
                break;
            }
            let Data::Held { place, .. } = self.state(tile).data else { continue };
            let times = self.times(tile, now);
            let super::State { visible, shown, .. } = self.state_mut(tile);
            // The clock may have left an interval before it was loaded.
            visible.ready = visible.ready.filter(|ready| Some(*ready) == times);
            if let Some(times) = visible.ready.take() {
                visible.held = Some(times);
                shown.iter_mut().for_each(|shown| shown.sun = None);
                commands.loads.push(Load { tile, place, features: false, times: Some(times) });
            }
        }
    }

    /// Starts reads for wanted tiles: first those that are not shown, then those that are shown but could not
    /// be decoded again.
    pub(super) fn read(&mut self, now: &Now, commands: &mut Commands) {
        let order = self.in_order();
        let [missing, stale]: [Vec<Tile>; 2] = [true, false].map(|is_missing| {
            let counts = |tile: &&Tile| self.state(**tile).shown.is_none() == is_missing;
            order.iter().filter(counts).copied().collect()
        });
        for tile in missing.into_iter().chain(stale) {
            if self.under_way.len() >= self.budgets.reads {
                break;
            }
            let tries = match self.state(tile).data {
                Data::Absent => 0,
                Data::Waiting { step, tries } if step <= self.step => tries,
                _ => continue,
            };
            let (ticket, times) = (self.ticket(), self.times(tile, now));
            let state = self.state_mut(tile);
            state.data = Data::Reading { ticket, tries };
            state.visible.ready = times;
            self.under_way.push(tile);
            commands.reads.push(Read { ticket, tile, features: true, times });
        }
        for tile in order {
            if self.intervals.len() >= self.budgets.reads {
                break;
            }
            let Some(times) = self.times(tile, now) else { continue };
            let super::State { data, visible, .. } = *self.state(tile);
            let is_known = [visible.held, visible.ready].contains(&Some(times));
            if !matches!(data, Data::Held { .. }) || is_known || visible.asked.is_some() {
                continue;
            }
            let ticket = self.ticket();
            self.state_mut(tile).visible.asked = Some((ticket, times));
            self.intervals.insert(ticket, tile);
            commands.reads.push(Read { ticket, tile, features: false, times: Some(times) });
        }
    }
}
