//! Which chart texels belong to, so that what is filled around charts does not come from another one.

use super::Atlas;
use super::footprint::BLOCK;
use super::raster::touched;

/// Texels along a cell: what a chart less than a texel wide has of a block it shares.
const CELL: usize = BLOCK / 2;
/// No chart's.
const NO_CHART: u32 = u32::MAX;
/// Of several.
const SEVERAL_CHARTS: u32 = u32::MAX - 1;

/// The chart of every cell of 2×2 texels of the virtual page.
#[derive(Clone, Debug)]
pub struct Owners {
    columns: usize,
    chart_of: Vec<u32>,
}

impl Owners {
    /// A cell belongs to the chart for which bilinear filtering reads texels of it; else to the chart of its
    /// block of 4×4, where that is one alone.
    pub fn new(atlas: &Atlas) -> Self {
        let (width, height) = (atlas.width as usize, atlas.height as usize);
        // Whole blocks.
        let (columns, rows) = (2 * width.div_ceil(BLOCK), 2 * height.div_ceil(BLOCK));
        // Those with centres nearer than a texel: not those at exactly that distance.
        let reach = 0.5 - 1.0 / 65536.0;
        let mut chart_of = vec![NO_CHART; columns * rows];
        for face in &atlas.faces {
            let corners = face.corners.map(|corner| corner.as_dvec2() / CELL as f64);
            for (row, span) in touched(corners, reach / CELL as f64, columns, rows) {
                for owner in &mut chart_of[row * columns..][span] {
                    *owner =
                        if *owner == NO_CHART || *owner == face.chart { face.chart } else { SEVERAL_CHARTS };
                }
            }
        }
        for (row, column) in (0..rows).step_by(2).flat_map(|r| (0..columns).step_by(2).map(move |c| (r, c))) {
            let cells = [0, 1, columns, columns + 1].map(|step| row * columns + column + step);
            let mut owners = cells.iter().map(|&cell| chart_of[cell]).filter(|&owner| owner != NO_CHART);
            let Some(first) = owners.next() else { continue };
            if owners.all(|owner| owner == first) {
                cells.iter().for_each(|&cell| chart_of[cell] = first);
            }
        }
        Owners { columns, chart_of }
    }

    /// No place is of any chart.
    pub fn none([width, height]: [usize; 2]) -> Self {
        let (columns, rows) = (2 * width.div_ceil(BLOCK), 2 * height.div_ceil(BLOCK));
        Owners { columns, chart_of: vec![NO_CHART; columns * rows] }
    }

    /// The chart that the texel of this column and row belongs to, if it is one alone.
    pub fn of(&self, x: usize, y: usize) -> Option<u32> {
        let owner = self.chart_of[y / CELL * self.columns + x / CELL];
        (owner < SEVERAL_CHARTS).then_some(owner)
    }
}
