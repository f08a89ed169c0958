//! The charts of a mesh as things to place: each by itself, but four tiny ones to a block and two thin ones
//! side by side.

use super::charts::Chart;
use super::footprint::{BLOCK, ChartPlacement, Footprint, Pages, Turn, footprints, last_offset, owned};
use glam::DVec2;

/// What is placed as one.
pub(super) struct Outline {
    /// Its charts, and where each begins, in texels from where it begins itself.
    pub parts: Vec<(usize, DVec2)>,
    /// The turns in which it fits a page; none if it is too large.
    pub turns: Vec<Footprint>,
}

impl Outline {
    /// Where its parts lie.
    pub(super) fn chart_placements(
        &self,
        place: ChartPlacement,
    ) -> impl Iterator<Item = (usize, ChartPlacement)> + '_ {
        self.parts.iter().map(move |&(chart, offset)| {
            (chart, ChartPlacement { at: place.at + place.turn.size(offset), ..place })
        })
    }
}

/// Bilinear filtering reads two texels across for a chart below this width in texels, and so half a block.
const THIN_WIDTH: f64 = 1.0 - 1.0 / 32.0;

/// Texels from a thin chart to the next one beside it.
const THIN_CHART_STEP: f64 = BLOCK as f64 / 2.0;

/// All charts of a mesh at a density. Those that share a block are neighbours by rank.
pub(super) fn outlines(
    charts: &[Chart],
    ranks: &[u32],
    texels_per_metre: f64,
    pages: &Pages,
) -> Vec<Outline> {
    let mut alone = Vec::new();
    let (mut tiny, mut thin) = (Vec::new(), Vec::new());
    for (index, chart) in charts.iter().enumerate() {
        let size = chart.size * texels_per_metre;
        match () {
            // A wider filter reads more than half a block.
            _ if pages.padding > 2 => alone.push(index),
            _ if size.max_element() < THIN_WIDTH => tiny.push(index),
            // Charts lie along x.
            _ if size.y < THIN_WIDTH => thin.push(index),
            _ => alone.push(index),
        }
    }
    let length = |i: usize| {
        ((charts[i].size.x * texels_per_metre + pages.start() + pages.reach()) / BLOCK as f64) as usize
    };
    tiny.sort_by_key(|&i| ranks[i]);
    thin.sort_by_key(|&i| (length(i), ranks[i]));
    let four = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(|step| step * THIN_CHART_STEP);
    let groups = tiny
        .chunks(4)
        .chain(thin.chunk_by(|&a, &b| length(a) == length(b)).flat_map(|equal| equal.chunks(2)));
    let mut all = Vec::new();
    for group in groups {
        let is_tiny = charts[group[0]].size.x * texels_per_metre < THIN_WIDTH;
        let offsets =
            if is_tiny { four } else { [DVec2::ZERO, DVec2::Y * THIN_CHART_STEP, DVec2::ZERO, DVec2::ZERO] };
        match group {
            [one] => alone.push(*one),
            _ => {
                let parts: Vec<(usize, DVec2)> = group.iter().copied().zip(offsets).collect();
                let turns = together(charts, &parts, texels_per_metre, pages);
                // (A page may be smaller than a block.)
                match turns.is_empty() {
                    true => alone.extend(group),
                    false => all.push(Outline { parts, turns }),
                }
            }
        }
    }
    let one = |index| Outline {
        parts: vec![(index, DVec2::ZERO)],
        turns: footprints(&charts[index], texels_per_metre, pages),
    };
    all.extend(alone.into_iter().map(one));
    all.sort_by_key(|outline| outline.parts[0].0);
    all
}

/// The footprints of several charts: as they lie, and with the axes swapped. (Mirrored, their steps would not
/// be whole texels.)
fn together(
    charts: &[Chart],
    parts: &[(usize, DVec2)],
    texels_per_metre: f64,
    pages: &Pages,
) -> Vec<Footprint> {
    let end = parts
        .iter()
        .map(|&(chart, offset)| offset + charts[chart].size * texels_per_metre)
        .fold(DVec2::ZERO, DVec2::max);
    let mut all: Vec<Footprint> = Vec::new();
    for turn in [Turn::default(), Turn { swap: true, ..Turn::default() }] {
        let end = pages.start() + turn.size(end);
        let Some(last) = last_offset(end, pages) else { continue };
        let corners = parts.iter().flat_map(|&(chart, offset)| {
            let chart = &charts[chart];
            let start = ChartPlacement::in_block((0, 0), turn, pages.start());
            let place = ChartPlacement { at: start.at + turn.size(offset), ..start };
            chart.faces.iter().map(move |face| face.corners.map(|c| place.texel(chart, c, texels_per_metre)))
        });
        let bits = owned(corners, end, pages);
        if all.iter().all(|other| other.bits != bits) {
            all.push(Footprint::new(turn, bits, last));
        }
    }
    all
}
