//! Chooses the tiles to decode: those that a switch affects, new ones, and those that have changed most.

use super::{Commands, Data, Decode, Shown, Stream, oldest};
use crate::{Now, Tile};
use std::cmp::Reverse;

/// A switch affects a tile whose network has no light group as input if the tile's mean changes by more than
/// this share.
const REACHED: f32 = 0.002;
/// A step of the clock of more hours than this is a jump, which is treated like a switch.
const JUMP: f64 = 1.0;
/// Changes are relative to the tile's light, or to this share of the mean light of the view where a tile is
/// darker.
const DARK: f32 = 0.01;
/// One tile in this many is decoded because it waited longest, not because it changed most.
const TURNS: usize = 4;

impl Stream {
    pub(super) fn decode(&mut self, now: &Now, commands: &mut Commands) {
        let order = self.in_order();
        let floor = DARK * self.adapted(now);
        let before = self.before.replace((now.hour, now.state.clone()));
        if before.is_some_and(|(hour, state)| state != now.state || apart(hour, now.hour) > JUMP) {
            self.switch(now, floor, commands);
        }
        let done: Vec<Tile> = commands.decodes.iter().map(|decode| decode.tile).collect();
        let is_ready = |tile: &Tile| self.is_held(*tile) && !done.contains(tile);
        let ready: Vec<Tile> = order.into_iter().filter(is_ready).collect();
        let (shown, new): (Vec<Tile>, Vec<Tile>) =
            ready.iter().copied().partition(|tile| self.state(*tile).shown.is_some());
        let mut changed: Vec<(Tile, f32)> =
            shown.iter().filter_map(|tile| self.stale(*tile, now, floor)).collect();
        // New tiles come first, but a quarter is kept for shown tiles, so that they are not left behind.
        let most = self.budgets.decodes;
        let kept = match (most, changed.len()) {
            (1, 1..) => usize::from(self.step.is_multiple_of(2)),
            (_, n) => n.min((most / TURNS).max(1)),
        };
        for tile in new.into_iter().take(most - kept) {
            self.first(tile, now, commands);
        }
        let left = most.saturating_sub(commands.decodes.len() - done.len());
        for tile in self.turns(&mut changed, left, |shown| shown.step) {
            self.again(tile, true, now, commands);
        }
        self.suns(&shown, now, commands);
    }

    /// The mean light of the wanted tiles, weighted by their pixels.
    fn adapted(&self, now: &Now) -> f32 {
        let (mut sum, mut pixels) = (0.0, 0.0);
        for (tile, of) in &self.wanted {
            sum += f64::from(*of) * f64::from(self.pyramid.mean(*tile, now).iter().sum::<f32>());
            pixels += f64::from(*of);
        }
        if pixels > 0.0 { (sum / pixels) as f32 } else { 0.0 }
    }

    /// Whether a tile's data is on the device for sure: a load of this step may still be refused.
    fn is_held(&self, tile: Tile) -> bool {
        matches!(self.state(tile).data, Data::Held { since, .. } if since < self.step)
    }

    /// Decodes all tiles that a switch affects at once, so that no room is half lit. Those that cannot be
    /// decoded lose their slots.
    fn switch(&mut self, now: &Now, floor: f32, commands: &mut Commands) {
        let shown: Vec<Tile> = self.slots.iter().flatten().copied().collect();
        for tile in shown {
            let Some(of) = self.state(tile).shown else { continue };
            let facts = self.pyramid.facts(tile);
            if !facts.has_gates && self.change(tile, of.travelled, now, floor) <= REACHED {
                continue;
            }
            if self.is_held(tile) && self.is_wanted(tile) {
                self.again(tile, true, now, commands);
            } else {
                self.free_slot(tile, commands);
            }
        }
    }

    /// The tile with its priority, change × pixels, if its light changed by more than the tolerance.
    fn stale(&self, tile: Tile, now: &Now, floor: f32) -> Option<(Tile, f32)> {
        let state = self.state(tile);
        let change = self.change(tile, state.shown?.travelled, now, floor);
        (change > self.budgets.tolerance).then_some((tile, change * state.pixels as f32))
    }

    /// Chooses up to `most` of the tiles: one in four waited longest, the others have the highest priority.
    fn turns(&self, of: &mut Vec<(Tile, f32)>, most: usize, last: impl Fn(&Shown) -> u64) -> Vec<Tile> {
        let waits = |tile: Tile| self.state(tile).shown.as_ref().map_or(0, &last);
        let mut chosen = Vec::new();
        if of.len() > most {
            of.sort_by_key(|(tile, _)| (waits(*tile), *tile));
            chosen.extend(of.drain(..most.div_ceil(TURNS)).map(|(tile, _)| tile));
            of.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        }
        chosen.extend(of.iter().take(most - chosen.len()).map(|(tile, _)| *tile));
        chosen
    }

    /// Decodes a tile that has no slot, if one can be had.
    fn first(&mut self, tile: Tile, now: &Now, commands: &mut Commands) {
        let step = self.step;
        let may_go = |other: Tile| Some(self.state(other).wanted).filter(|last| *last < step);
        let Some(slot) = oldest(&self.slots, may_go) else { return };
        if let Some(other) = self.slots[slot as usize] {
            self.free_slot(other, commands);
        }
        self.slots[slot as usize] = Some(tile);
        self.altered.push(tile);
        self.state_mut(tile).shown = Some(Shown { slot, travelled: 0.0, step: 0, sun: None, sun_step: 0 });
        self.again(tile, true, now, commands);
    }

    /// Decodes a tile into its slot: its sun, and with `maps` its maps too.
    fn again(&mut self, tile: Tile, maps: bool, now: &Now, commands: &mut Commands) {
        let (Data::Held { place, .. }, Some(mut shown)) = (self.state(tile).data, self.state(tile).shown)
        else {
            return;
        };
        let has_sun = self.pyramid.facts(tile).has_sun;
        if maps {
            [shown.travelled, _] = self.pyramid.travelled(tile, now);
            shown.step = self.step;
        }
        if has_sun {
            shown.sun = self.is_sunlit(tile, now).then_some(now.hour);
            shown.sun_step = self.step;
        }
        self.state_mut(tile).shown = Some(shown);
        commands.decodes.push(Decode { tile, place, slot: shown.slot, maps, sun: has_sun });
    }

    fn is_sunlit(&self, tile: Tile, now: &Now) -> bool {
        self.pyramid.sun(tile, now).is_some() && self.state(tile).visible.held.is_some()
    }

    /// Decodes the sun alone of the shown tiles: it moves in every step in which the hour does.
    fn suns(&mut self, shown: &[Tile], now: &Now, commands: &mut Commands) {
        let done: Vec<Tile> = commands.decodes.iter().map(|decode| decode.tile).collect();
        let moved = |tile: &Tile| {
            let state = self.state(*tile);
            let was = state.shown?.sun;
            let is = self.is_sunlit(*tile, now).then_some(now.hour);
            (self.pyramid.facts(*tile).has_sun && was != is && !done.contains(tile)).then_some(*tile)
        };
        let mut moved: Vec<(Tile, f32)> =
            shown.iter().filter_map(moved).map(|tile| (tile, self.state(tile).pixels as f32)).collect();
        moved.sort_by_key(|(tile, pixels)| (Reverse(*pixels as u32), *tile));
        let most = self.budgets.suns;
        for tile in self.turns(&mut moved, most, |shown| shown.sun_step) {
            self.again(tile, false, now, commands);
        }
    }
}

/// Hours between two times of day, the shorter way.
fn apart(a: f64, b: f64) -> f64 {
    let way = (a - b).abs();
    way.min(24.0 - way)
}
