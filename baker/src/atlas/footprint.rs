//! Where a chart may lie: the pages, its places and turns on them, and the texels it touches there.

use super::charts::Chart;
use super::raster::{Bits, TOLERANCE};
use dataset::tiles::TILE;
use glam::{DVec2, Vec2Swizzles};

/// Charts start on multiples of this many texels, the block of the GPU formats, so that few blocks see two charts.
pub const BLOCK: usize = 4;

/// The pages to pack, all alike.
#[derive(Clone, Copy, Debug)]
pub struct Pages {
    /// Texels.
    pub width: usize,
    /// Texels, at most.
    pub height: usize,
    /// How many there are.
    pub count: usize,
    /// Empty texels between charts.
    pub padding: usize,
}

impl Pages {
    /// Rows of the virtual page from one page's first row to the next one's, for pages of this height: see
    /// [`super::Atlas::stride`].
    pub fn stride(&self, height: usize) -> usize {
        if self.count > 1 { (height + self.padding).next_multiple_of(TILE) } else { height }
    }

    /// Texels: what is nearer to a triangle than this counts as touched. Twice the rounding of a corner to `f32` on the virtual
    /// page of all pages.
    pub fn tolerance(&self) -> f64 {
        let rows = self.stride(self.height) * (self.count - 1) + self.height;
        TOLERANCE.max(rows.max(self.width).next_power_of_two() as f64 / f64::from(1 << 24))
    }
}

/// Where a chart lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The page.
    pub page: usize,
    /// The texel that holds the lower corner of the chart's bounding box, at its centre.
    pub x: usize,
    /// See `x`.
    pub y: usize,
    /// How it is turned.
    pub turn: Turn,
}

/// A symmetry of the square: swap the axes, then mirror them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Turn {
    swap: bool,
    mirror_x: bool,
    mirror_y: bool,
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
}

impl Place {
    /// From a chart's metres to texels of its page. The chart's lower corner lies on a texel centre.
    pub fn texel(&self, chart: &Chart, corner: DVec2, texels_per_metre: f64) -> DVec2 {
        let (mut p, mut size) = (corner, chart.size);
        if self.turn.swap {
            (p, size) = (p.yx(), size.yx());
        }
        if self.turn.mirror_x {
            p.x = size.x - p.x;
        }
        if self.turn.mirror_y {
            p.y = size.y - p.y;
        }
        p * texels_per_metre + DVec2::new(self.x as f64, self.y as f64) + 0.5
    }
}

/// The texels a turned chart touches.
pub struct Footprint {
    /// How the chart is turned.
    pub turn: Turn,
    /// The texels.
    pub bits: Bits,
    /// Maximal runs of ones, the longest first.
    pub runs: Vec<Run>,
    /// Rows from its offset to half a texel past the chart.
    pub rows: usize,
    /// Largest offset, column and row, at which it stays half a texel inside the page.
    pub last: (usize, usize),
}

/// Touched texels side by side.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// From the footprint's offset.
    pub row: usize,
    /// First column, from the footprint's offset.
    pub start: usize,
    /// Texels.
    pub length: usize,
}

/// The largest offsets for a chart of this size in texels, so that it ends half a texel inside the page.
pub fn last_offset(size: DVec2, width: usize, height: usize) -> Option<(usize, usize)> {
    let room = DVec2::new(width as f64, height as f64) - 1.0 - size;
    (room.min_element() >= 0.0).then(|| (room.x as usize / BLOCK * BLOCK, room.y as usize / BLOCK * BLOCK))
}

/// The distinct footprints of a chart's turns that fit a page.
pub fn footprints(chart: &Chart, texels_per_metre: f64, pages: &Pages) -> Vec<Footprint> {
    let tolerance = pages.tolerance();
    let mut all: Vec<Footprint> = Vec::new();
    for turn in Turn::ALL {
        let size = if turn.swap { chart.size.yx() } else { chart.size } * texels_per_metre;
        let Some(last) = last_offset(size, pages.width, pages.height) else { continue };
        let cells = |length: f64| (length + 0.5 + tolerance) as usize + 1;
        let mut bits = Bits::new(cells(size.x), cells(size.y));
        let place = Place { turn, ..Place::default() };
        for face in &chart.faces {
            bits.touch(face.corners.map(|c| place.texel(chart, c, texels_per_metre)), tolerance);
        }
        if all.iter().all(|other| other.bits != bits) {
            let runs = runs(&bits);
            all.push(Footprint { turn, bits, runs, rows: (size.y + 1.0).ceil() as usize, last });
        }
    }
    all
}

/// The maximal runs of touched texels, the longest first.
pub fn runs(bits: &Bits) -> Vec<Run> {
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
