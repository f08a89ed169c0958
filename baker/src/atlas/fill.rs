//! Fills one page: bottom-left first fit over bit maps of touched texels.

use super::footprint::{Footprint, Place};
use super::page::Page;
use std::collections::BTreeMap;

/// A page while it is being filled.
#[derive(Clone)]
pub struct Filler<'a> {
    page: Page,
    padding: usize,
    /// Per outline, the first row not searched: texels are only ever taken, so a footprint never fits above the row where the
    /// same one was placed or refused before.
    first_row: BTreeMap<&'a [u64], BTreeMap<(usize, usize), usize>>,
}

impl<'a> Filler<'a> {
    /// An empty page.
    pub fn new(width: usize, height: usize, padding: usize) -> Self {
        Filler { page: Page::new(width, height), padding, first_row: BTreeMap::new() }
    }

    /// Places one of an item's turns, and takes its texels; `None`, and nothing taken, if no turn fits.
    pub fn place(&mut self, turns: &'a [Footprint]) -> Option<Place> {
        let mut best: Option<(usize, usize, usize, usize)> = None;
        for (t, footprint) in turns.iter().enumerate() {
            let bits = &footprint.bits;
            let rows = self.first_row.entry(&bits.words).or_default();
            let from = rows.entry((bits.width, bits.height)).or_insert(0);
            // The lowest end wins, then the lowest and leftmost start, then the first turn.
            let limit =
                best.map_or(footprint.last.1, |b| footprint.last.1.min(b.0.saturating_sub(bits.height)));
            let (row, column) = self.page.find(footprint, *from, limit);
            *from = row;
            if let Some(x) = column {
                let candidate = (row + bits.height, row, x, t);
                best = Some(best.map_or(candidate, |b| b.min(candidate)));
            }
        }
        let (_, y, x, t) = best?;
        self.page.take(&turns[t], x, y, self.padding);
        Some(Place { page: 0, x, y, turn: turns[t].turn })
    }

    /// Rows down to half a texel past the lowest item.
    pub fn used(&self) -> usize {
        self.page.used()
    }
}

/// Indices of items in the order in which to place them: large ones first, equal ones as they stand.
pub fn order(items: &[&[Footprint]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..items.len()).collect();
    let key = |i: usize| {
        let bits = &items[i][0].bits;
        (bits.width.max(bits.height), bits.width * bits.height)
    };
    order.sort_by_key(|&i| (std::cmp::Reverse(key(i)), i));
    order
}

/// Places one of the turns of every item on one page; gives the places and the rows used, or `None` if they do not fit.
pub fn first_fit(
    items: &[&[Footprint]],
    width: usize,
    height: usize,
    padding: usize,
) -> Option<(Vec<Place>, usize)> {
    let mut filler = Filler::new(width, height, padding);
    let mut places = vec![Place::default(); items.len()];
    for i in order(items) {
        places[i] = filler.place(items[i])?;
    }
    Some((places, filler.used()))
}
