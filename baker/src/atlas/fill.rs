//! Fills one page with outlines: large ones first, bottom-left; then window by window what lies together in
//! space.

use super::footprint::{BLOCK, ChartPlacement, Footprint};
use super::page::Page;
use dataset::format::TILE;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;

/// How pages are filled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filling {
    /// How many outlines of one block share it: 1, unless there are more outlines than blocks.
    pub stack: usize,
    /// See [`super::footprint::Pages::start`].
    pub start: f64,
    /// How what lies together in space is kept together; `None` where only size counts.
    pub windows: Option<Windows>,
}

/// Squares of a page, each filled with what comes next in the order of space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Windows {
    /// Side in tiles.
    pub tiles: usize,
    /// What is longer than this many blocks is placed before all else, wherever it fits.
    pub large: usize,
}

impl Windows {
    /// From the one that keeps most together to the one that fills pages best.
    pub(super) const ALL: [Windows; 5] = [
        Windows { tiles: 1, large: 64 },
        Windows { tiles: 1, large: 32 },
        Windows { tiles: 2, large: 64 },
        Windows { tiles: 2, large: 32 },
        Windows { tiles: 2, large: 16 },
    ];
}

/// How many windows before its own an item may still go to, the earliest first: it fills what larger ones
/// left there.
const BLOCKS_BACK: usize = 4;

/// How many items a window hands on to the next one at most.
const MOST_CARRIED: usize = 64;

/// A page while it is being filled.
#[derive(Clone)]
pub(super) struct Filler<'a> {
    page: Page,
    /// Blocks across and down.
    size: (usize, usize),
    filling: Filling,
    /// The block that outlines of one block share now, and for how many more it has room.
    shared: Option<((usize, usize), usize)>,
    /// Per outline, the first row not searched: blocks are only ever taken, so a footprint never fits above
    /// the row where the same one was placed or refused before.
    first_row: BTreeMap<&'a [u64], BTreeMap<(usize, usize), usize>>,
}

impl<'a> Filler<'a> {
    /// An empty page of so many blocks across and down.
    pub(super) fn new(size: (usize, usize), filling: Filling) -> Self {
        Filler { page: Page::new(size.0, size.1), size, filling, shared: None, first_row: BTreeMap::new() }
    }

    /// Places one of an item's turns, and takes its blocks; `None`, and nothing taken, if no turn fits.
    pub(super) fn place(&mut self, turns: &'a [Footprint]) -> Option<ChartPlacement> {
        let columns = 0..self.size.0;
        self.place_in(turns, &columns, None)
    }

    /// The same, starting in these columns and in these rows. (Without rows the search goes on where it ended
    /// for the same outline.)
    fn place_in(
        &mut self,
        turns: &'a [Footprint],
        columns: &Range<usize>,
        rows: Option<&Range<usize>>,
    ) -> Option<ChartPlacement> {
        let stacks = self.filling.stack > 1 && turns.first()?.bits.count() == 1;
        if let Some(((x, y), room @ 1..)) = self.shared.filter(|_| stacks)
            && x <= turns[0].last.0
            && y <= turns[0].last.1
        {
            self.shared = Some(((x, y), room - 1));
            return Some(ChartPlacement::in_block((x, y), turns[0].turn, self.filling.start));
        }
        let mut best: Option<(usize, usize, usize, usize)> = None;
        for (t, footprint) in turns.iter().enumerate() {
            let bits = &footprint.bits;
            // The lowest end wins, then the lowest and leftmost start, then the first turn.
            let limit =
                best.map_or(footprint.last.1, |b| footprint.last.1.min(b.0.saturating_sub(bits.height)));
            let (row, column) = match rows {
                Some(rows) => self.page.find(footprint, columns, rows.start, limit.min(rows.end - 1)),
                None => {
                    let known = self.first_row.entry(&bits.words).or_default();
                    let from = known.entry((bits.width, bits.height)).or_insert(0);
                    let found = self.page.find(footprint, columns, *from, limit);
                    *from = found.0;
                    found
                }
            };
            if let Some(x) = column {
                let candidate = (row + bits.height, row, x, t);
                best = Some(best.map_or(candidate, |b| b.min(candidate)));
            }
        }
        let (_, y, x, t) = best?;
        self.page.take(&turns[t], x, y);
        let place = ChartPlacement::in_block((x, y), turns[t].turn, self.filling.start);
        if stacks {
            self.shared = Some(((x, y), self.filling.stack - 1));
        }
        Some(place)
    }

    /// Places all of these items, indices into `items` in the order of space, so that what lies together
    /// there does so on the page; tells each that is placed. Gives those that did not fit.
    pub(super) fn place_all(
        &mut self,
        items: &[&'a [Footprint]],
        list: &[usize],
        mut placed: impl FnMut(usize, ChartPlacement),
    ) -> Vec<usize> {
        let by_size = |list: &mut Vec<usize>| {
            let key = |i: usize| {
                let bits = &items[i][0].bits;
                (bits.width.max(bits.height), bits.width * bits.height)
            };
            list.sort_by_key(|&i| (std::cmp::Reverse(key(i)), i));
        };
        let side = |i: usize| items[i][0].bits.width.max(items[i][0].bits.height);
        let longest = self.filling.windows.map_or(0, |windows| windows.large);
        let (mut large, small): (Vec<usize>, Vec<usize>) = list.iter().partition(|&&i| side(i) > longest);
        by_size(&mut large);
        let mut refused = Vec::new();
        for i in large {
            match self.place(items[i]) {
                Some(place) => placed(i, place),
                None => refused.push(i),
            }
        }
        // Each window takes from the queue what would fill it, the largest first; what it has no place for
        // goes to the next one.
        let mut queue = VecDeque::from(small);
        let (mut batch, mut rest): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
        let all = self.filling.windows.map_or(Vec::new(), |w| windows(self.size, w.tiles * TILE / BLOCK));
        for (w, (columns, rows)) in all.iter().enumerate() {
            let mut room = self.page.free(columns, rows.clone());
            let take = |batch: &[usize]| batch.iter().map(|&i| items[i][0].bits.count()).sum::<usize>();
            room = room.saturating_sub(take(&batch));
            while let Some(&i) = queue.front().filter(|_| room > 0) {
                queue.pop_front();
                room = room.saturating_sub(items[i][0].bits.count());
                batch.push(i);
            }
            by_size(&mut batch);
            let near = &all[w.saturating_sub(BLOCKS_BACK)..=w];
            batch.retain(|&i| {
                match near.iter().find_map(|(columns, rows)| self.place_in(items[i], columns, Some(rows))) {
                    Some(place) => {
                        placed(i, place);
                        false
                    }
                    None => true,
                }
            });
            rest.extend(batch.drain(MOST_CARRIED.min(batch.len())..));
        }
        // The rest goes wherever there is room.
        batch.extend(rest);
        batch.extend(queue);
        by_size(&mut batch);
        for i in batch {
            match self.place(items[i]) {
                Some(place) => placed(i, place),
                None => refused.push(i),
            }
        }
        refused
    }

    /// Rows of blocks down to the lowest item.
    pub(super) fn used(&self) -> usize {
        self.page.used()
    }
}

/// The windows of this side on a page along a curve that keeps near what is near (Hilbert's).
fn windows((width, height): (usize, usize), window: usize) -> Vec<(Range<usize>, Range<usize>)> {
    let (across, down) = (width.div_ceil(window), height.div_ceil(window));
    let side = across.max(down).next_power_of_two();
    let mut all: Vec<(usize, usize, usize)> =
        (0..down).flat_map(|y| (0..across).map(move |x| (hilbert(side, x, y), x, y))).collect();
    all.sort_unstable();
    let range = |i: usize, n: usize| i * window..((i + 1) * window).min(n);
    all.into_iter().map(|(_, x, y)| (range(x, width), range(y, height))).collect()
}

/// The place of a cell along Hilbert's curve in a square whose side is a power of two.
fn hilbert(side: usize, mut x: usize, mut y: usize) -> usize {
    let (mut d, mut s) = (0, side / 2);
    while s > 0 {
        let (rx, ry) = (usize::from(x & s > 0), usize::from(y & s > 0));
        d += s * s * ((3 * rx) ^ ry);
        if ry == 0 {
            if rx == 1 {
                (x, y) = ((side - 1).wrapping_sub(x), (side - 1).wrapping_sub(y));
            }
            (x, y) = (y, x);
        }
        s /= 2;
    }
    d
}
