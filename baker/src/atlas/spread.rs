//! Spreads charts and shared layouts over several pages, so that a mesh stays on one page wherever that costs
//! little.

use super::fill::{Filler, Filling};
use super::footprint::{BLOCK, ChartPlacement, Footprint, Pages};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A mesh goes on a page as a whole unless that fills the page to more than this many times its fair share:
/// at most a twentieth of the density is lost.
const OVERFULL: f64 = 1.1;

/// Pages with their items, as indices, in the order of placing.
type Lists = Vec<Vec<usize>>;

/// Places one of the turns of every item. `unit_of` says, per item, which others it should share a page with
/// (the charts of a mesh; equal ones stand side by side); `rank` is the order in which items lie in space.
/// Gives the places, the most rows used of a page and the number of pages used, numbered from 0, or `None` if
/// the items do not fit.
pub(super) fn spread(
    items: &[&[Footprint]],
    unit_of: &[usize],
    rank: &[u32],
    pages: &Pages,
    filling: Filling,
) -> Option<(Vec<ChartPlacement>, usize, usize)> {
    let loads: Vec<f64> = items.iter().map(|turns| turns[0].bits.count() as f64).collect();
    let (page_of, parts) = assign(&loads, unit_of, rank, pages.count);

    // Every page by itself.
    let mut order: Vec<usize> = (0..items.len()).collect();
    order.sort_by_key(|&i| (rank[i], i));
    let mut lists: Lists = vec![Vec::new(); pages.count];
    order.into_iter().for_each(|i| lists[page_of[i]].push(i));
    let allowance = if pages.count > 1 { (OVERFULL - 1.0) * loads.iter().sum::<f64>() } else { 0.0 };
    let filled = lists.par_iter().map(|list| fill(items, &loads, list, &parts, (pages, filling), allowance));
    let filled: Vec<Filled> = filled.collect::<Option<_>>()?;

    // What found no place there goes to any page that takes the whole part of the mesh.
    let mut chart_placements: Vec<Option<ChartPlacement>> = vec![None; items.len()];
    let mut evicted: Vec<Vec<usize>> = Vec::new();
    let mut fillers = Vec::new();
    for (page, Filled { filler, placed, refused }) in filled.into_iter().enumerate() {
        placed
            .into_iter()
            .for_each(|(i, place)| chart_placements[i] = Some(ChartPlacement { page, ..place }));
        evicted.extend(refused.into_values());
        fillers.push(filler);
    }
    let homeless: f64 = evicted.iter().flatten().map(|&i| loads[i]).sum();
    if homeless > allowance {
        return None;
    }
    let part_load = |part: &[usize]| part.iter().map(|&i| loads[i]).sum::<f64>();
    evicted.sort_by(|a, b| part_load(b).total_cmp(&part_load(a)).then(a.cmp(b)));
    for part in evicted {
        let home = fillers.iter_mut().enumerate().find_map(|(page, filler)| {
            if let [one] = part[..] {
                return Some((page, vec![filler.place(items[one])?]));
            }
            // Where only some of it fits, the page stays as it was.
            let mut trial = filler.clone();
            let placed: Vec<ChartPlacement> =
                part.iter().map(|&i| trial.place(items[i])).collect::<Option<_>>()?;
            *filler = trial;
            Some((page, placed))
        });
        let (page, placed) = home?;
        part.iter()
            .zip(placed)
            .for_each(|(&i, place)| chart_placements[i] = Some(ChartPlacement { page, ..place }));
    }

    // Pages that hold nothing are left out.
    let rows = fillers.iter().map(Filler::used).max().unwrap_or(0) * BLOCK;
    let mut number = vec![0; pages.count];
    let mut used = 0;
    for (page, _) in fillers.iter().enumerate().filter(|(_, filler)| filler.used() > 0) {
        (number[page], used) = (used, used + 1);
    }
    let chart_placements: Option<Vec<ChartPlacement>> = chart_placements.into_iter().collect();
    let chart_placements = chart_placements?
        .into_iter()
        .map(|place| ChartPlacement { page: number[place.page], ..place })
        .collect();
    Some((chart_placements, rows, used))
}

/// The page of every item by its load, and its part: the items of a unit that are to share a page.
fn assign(loads: &[f64], unit_of: &[usize], rank: &[u32], pages: usize) -> (Vec<usize>, Vec<usize>) {
    // Units as ranges of items, in the order of space: by the rank of the middle one of their items.
    let mut units: Vec<(u32, f64, std::ops::Range<usize>)> = Vec::new();
    let mut start = 0;
    for chunk in unit_of.chunk_by(|a, b| a == b) {
        let range = start..start + chunk.len();
        start = range.end;
        let mut ranks = rank[range.clone()].to_vec();
        let middle = ranks.len() / 2;
        let middle = *ranks.select_nth_unstable(middle).1;
        units.push((middle, loads[range.clone()].iter().sum(), range));
    }
    units.sort_by_key(|unit| (unit.0, unit.2.start));

    // Each to the page where it lies when pages take equal shares in that order, or else to the emptiest one.
    // One that would overfill that too is poured over the pages, each up to its fair share.
    let fair_share = loads.iter().sum::<f64>() / pages as f64;
    let mut fill = vec![0.0; pages];
    let emptiest = |fill: &[f64]| (0..pages).min_by(|&a, &b| fill[a].total_cmp(&fill[b])).unwrap_or_default();
    let mut page_of = vec![0; loads.len()];
    let mut part_of = vec![0; loads.len()];
    let (mut parts, mut before) = (0, 0.0);
    for (_, load, range) in units {
        let mut page = (((before + 0.5 * load) / fair_share) as usize).min(pages - 1);
        before += load;
        let fits = |page: usize| fill[page] + load <= OVERFULL * fair_share;
        if !fits(page) {
            page = emptiest(&fill);
        }
        let whole = fits(page);
        let mut items: Vec<usize> = range.collect();
        items.sort_by_key(|&i| rank[i]);
        for i in items {
            if !whole && fill[page] + 0.5 * loads[i] > fair_share {
                (page, parts) = (emptiest(&fill), parts + 1);
            }
            fill[page] += loads[i];
            (page_of[i], part_of[i]) = (page, parts);
        }
        parts += 1;
    }
    (page_of, part_of)
}

/// A page filled with what fits.
struct Filled<'a> {
    filler: Filler<'a>,
    placed: Vec<(usize, ChartPlacement)>,
    /// The parts that do not fit as a whole.
    refused: BTreeMap<usize, Vec<usize>>,
}

/// Fills a page with the parts of its list that fit as a whole; `None` once the others load more than
/// `allowance`.
fn fill<'a>(
    items: &[&'a [Footprint]],
    loads: &[f64],
    list: &[usize],
    parts: &[usize],
    (pages, filling): (&Pages, Filling),
    allowance: f64,
) -> Option<Filled<'a>> {
    let mut refused: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    loop {
        let mut filler = Filler::new(pages.blocks(), filling);
        let mut placed: Vec<(usize, ChartPlacement)> = Vec::new();
        let wanted: Vec<usize> = list.iter().copied().filter(|&i| !refused.contains_key(&parts[i])).collect();
        let homeless = filler.place_all(items, &wanted, |i, place| placed.push((i, place)));
        let homeless: f64 = homeless.iter().chain(refused.values().flatten()).map(|&i| loads[i]).sum();
        if homeless > allowance {
            return None;
        }
        // A part of which anything is refused is refused as a whole; all over again if the rest of it was
        // placed.
        let mut is_placed = vec![false; items.len()];
        placed.iter().for_each(|&(i, _)| is_placed[i] = true);
        let mut fresh: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for &i in list.iter().filter(|&&i| !is_placed[i] && !refused.contains_key(&parts[i])) {
            fresh.entry(parts[i]).or_default();
        }
        for &i in list {
            if let Some(part) = fresh.get_mut(&parts[i]) {
                part.push(i);
            }
        }
        let complete = fresh.values().flatten().all(|&i| !is_placed[i]);
        refused.append(&mut fresh);
        if complete {
            return Some(Filled { filler, placed, refused });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_stay_whole_unless_they_overfill_a_page() {
        // Three equal units on two pages: the last is cut in halves; on three pages none is.
        let rank: Vec<u32> = (0..12).collect();
        let (loads, unit_of) = ([1.0; 12], [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2]);
        let (page_of, parts) = assign(&loads, &unit_of, &rank, 2);
        assert_eq!(page_of, [0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 1, 1]);
        assert_eq!(parts, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 3]);
        let (page_of, parts) = assign(&loads, &unit_of, &rank, 3);
        assert_eq!((page_of, parts), (unit_of.to_vec(), unit_of.to_vec()));
        // A giant is poured over all pages, in order; what is small evens them out.
        let (page_of, _) = assign(&[6.0, 6.0, 6.0, 1.0, 1.0], &[0, 0, 0, 1, 2], &rank[..5], 3);
        assert_eq!(page_of[..3], [0, 1, 2]);
        // More pages than items.
        assert_eq!(assign(&[1.0], &[0], &[0], 4).0, [0]);
    }
}
