//! Where a chart may lie, and what it owns there: the blocks of 4×4 texels that filtering reads for it.

use super::charts::Chart;
use super::raster::{Bits, TOLERANCE};
use dataset::format::TILE;
use glam::{DVec2, Vec2Swizzles};

/// Side in texels of the blocks that pages are packed by: the block of the GPU formats, and a texel of the
/// second mip.
pub(super) const BLOCK: usize = 4;

/// The pages to pack, all alike.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pages {
    /// Texels.
    pub width: usize,
    /// Texels, at most.
    pub height: usize,
    /// How many there are.
    pub count: usize,
    /// Width in texels of the filter that never mixes two charts: 2 for bilinear filtering, 4 for bicubic.
    pub padding: usize,
}

impl Pages {
    /// Rows of the virtual page from one page's first row to the next one's, for pages of this height: see
    /// [`super::Atlas::stride`].
    pub(super) fn stride(&self, height: usize) -> usize {
        // (Dilation may reach twice its distance, of a block at least.)
        let apart = 2 * self.padding.max(BLOCK);
        if self.count > 1 { (height + apart).next_multiple_of(TILE) } else { height }
    }

    /// Blocks across and down; the last ones may reach past the page.
    pub(super) fn blocks(&self) -> (usize, usize) {
        (self.width.div_ceil(BLOCK), self.height.div_ceil(BLOCK))
    }

    /// Texels: what is nearer to a triangle than this counts as touched. Twice the rounding of a corner to
    /// `f32` on the virtual page of all pages.
    pub(super) fn tolerance(&self) -> f64 {
        let rows = self.stride(self.height) * (self.count - 1) + self.height;
        TOLERANCE.max(rows.max(self.width).next_power_of_two() as f64 / f64::from(1 << 24))
    }

    /// Texels from a block's corner to the lower corner of a chart that starts there: as far as the filter
    /// reads.
    pub(super) fn start(&self) -> f64 {
        self.padding as f64 / 2.0 - 0.5
    }

    /// Texels around a chart's surface whose squares the filter reads: those whose centres lie within half of
    /// its width.
    pub(super) fn reach(&self) -> f64 {
        self.padding as f64 / 2.0 - 0.5 + self.tolerance()
    }
}

/// Where a chart lies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ChartPlacement {
    /// The page.
    pub page: usize,
    /// The lower corner of the chart's bounding box, in texels of the page.
    pub at: DVec2,
    /// How it is turned.
    pub turn: Turn,
}

/// A symmetry of the square: swap the axes, then mirror them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Turn {
    /// Whether x and y change places.
    pub swap: bool,
    /// Whether x runs the other way.
    pub mirror_x: bool,
    /// Whether y runs the other way.
    pub mirror_y: bool,
}

impl Turn {
    const ALL: [Turn; 8] = {
        let mut all = [Turn { swap: false, mirror_x: false, mirror_y: false }; 8];
        let mut i = 0;
        while i < 8 {
            all[i] = Turn { swap: i & 1 != 0, mirror_x: i & 2 != 0, mirror_y: i & 4 != 0 };
            i += 1;
        }
        all
    };

    /// A size after the turn.
    pub(super) fn size(self, size: DVec2) -> DVec2 {
        if self.swap { size.yx() } else { size }
    }
}

impl ChartPlacement {
    /// The place of what starts in this block.
    pub(super) fn in_block((column, row): (usize, usize), turn: Turn, start: f64) -> Self {
        let at = DVec2::new(column as f64, row as f64) * BLOCK as f64 + start;
        ChartPlacement { page: 0, at, turn }
    }

    /// From a chart's metres to texels of its page.
    pub(super) fn texel(&self, chart: &Chart, corner: DVec2, texels_per_metre: f64) -> DVec2 {
        let (mut p, size) = (self.turn.size(corner), self.turn.size(chart.size));
        if self.turn.mirror_x {
            p.x = size.x - p.x;
        }
        if self.turn.mirror_y {
            p.y = size.y - p.y;
        }
        p * texels_per_metre + self.at
    }
}

/// The blocks that something owns when it is turned in one way.
#[derive(Clone, Debug)]
pub(super) struct Footprint {
    /// How it is turned.
    pub turn: Turn,
    /// The blocks.
    pub bits: Bits,
    /// Maximal runs of ones, the longest first.
    pub runs: Vec<Run>,
    /// Largest offset, column and row of blocks, at which it stays inside the page.
    pub last: (usize, usize),
}

/// Owned blocks side by side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// From the footprint's offset.
    pub row: usize,
    /// First column, from the footprint's offset.
    pub start: usize,
    /// Blocks.
    pub length: usize,
}

/// The largest offsets in blocks of what ends here in texels, so that all that filtering reads for it lies
/// inside the page.
pub(super) fn last_offset(end: DVec2, pages: &Pages) -> Option<(usize, usize)> {
    let room = DVec2::new(pages.width as f64, pages.height as f64) - pages.tolerance() - pages.reach() - end;
    (room.min_element() >= 0.0).then_some((room.x as usize / BLOCK, room.y as usize / BLOCK))
}

/// The distinct footprints of a chart's turns that fit a page.
pub(super) fn footprints(chart: &Chart, texels_per_metre: f64, pages: &Pages) -> Vec<Footprint> {
    let mut all: Vec<Footprint> = Vec::new();
    for turn in Turn::ALL {
        let size = turn.size(chart.size) * texels_per_metre;
        let Some(last) = last_offset(pages.start() + size, pages) else { continue };
        let place = ChartPlacement::in_block((0, 0), turn, pages.start());
        let corners = chart.faces.iter().map(|f| f.corners.map(|c| place.texel(chart, c, texels_per_metre)));
        let bits = owned(corners, pages.start() + size, pages);
        if all.iter().all(|other| other.bits != bits) {
            all.push(Footprint::new(turn, bits, last));
        }
    }
    all
}

/// The blocks in which filtering reads texels for one of these triangles, which end at `end`.
pub(super) fn owned(triangles: impl Iterator<Item = [DVec2; 3]>, end: DVec2, pages: &Pages) -> Bits {
    let (block, reach) = (BLOCK as f64, pages.reach());
    let cells = |end: f64| ((end + reach) / block) as usize + 1;
    let mut bits = Bits::new(cells(end.x), cells(end.y));
    triangles.for_each(|corners| bits.touch(corners.map(|c| c / block), reach / block));
    bits
}

impl Footprint {
    /// Of these blocks.
    pub(super) fn new(turn: Turn, bits: Bits, last: (usize, usize)) -> Self {
        let runs = runs(&bits);
        Footprint { turn, bits, runs, last }
    }
}

/// The maximal runs of owned blocks, the longest first.
fn runs(bits: &Bits) -> Vec<Run> {
    let mut runs = Vec::new();
    for row in 0..bits.height {
        let mut end = 0;
        while let Some(start) = bits.next(row, end, true) {
            end = bits.next(row, start, false).unwrap_or(bits.width);
            runs.push(Run { row, start, length: end - start });
        }
    }
    // A long run rules out most columns at once.
    runs.sort_by_key(|run| (std::cmp::Reverse(run.length), run.row));
    runs
}
