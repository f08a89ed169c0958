//! The error that is seen: of cells of 16×16 texels, relative to the light where they are.
//!
//! Relative to the page's mean, a dark room beside a sunny field has no error at all, however it looks. Here
//! every texel's error is taken relative to the mean light of its *piece*, the texels of its cell that belong
//! to its chart, and a cell's error is the root mean square of those. What is too dark to be seen need not be
//! better: light darker than [`VISIBLE_PART`] of what is seen from there, or than [`LEAST_IRRADIANCE`],
//! counts as that bright. In gaps without room for an eye, what is seen from their opening counts.

use super::sums::Sums;
use crate::Rgb;
use crate::atlas::owners::Owners;
use crate::bake::samples::{Stream, Worker};
use crate::bake::store::{BlockState, CELL, CELLS, Parts, Value, cell_of};
use crate::receivers::{PlaceFinder, ReceiverBlock, Receivers};
use crate::surface::BLOCK;
use crate::trace::counts::RayCounts;
use crate::trace::paths::path::point_pair;
use crate::trace::paths::{Sequence, SequenceKind};
use crate::trace::rays::Hit;
use crate::trace::sources::Lights;
use dataset::host::signals::stop_if_interrupted;
use dataset::image::encode_png;
use dataset::observe::Observer;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Of the light that an eye at a place is adapted to: what is darker is judged as if it were as bright as
/// this. There, 5 % are about one step of an 8-bit sRGB picture that shows the light around as white.
pub const VISIBLE_PART: f64 = 1.0 / 30.0;
/// Irradiance in klx that is judged as if nothing were darker: a tenth of a millilux, by which no eye sees
/// edges.
pub const LEAST_IRRADIANCE: f64 = 1e-7;
/// The errors above which cells are counted.
pub(crate) const COUNTED_ERRORS: [f64; 3] = [0.05, 0.1, 0.2];
/// A step of grey in a picture of errors.
pub const PICTURE_STEP: f64 = 0.002;
/// Rays from a cell that find which cells are seen from it.
const RAYS_PER_CELL: usize = 16;
/// Room that an eye needs, in metres: it does not see clearly what is nearer.
pub const EYE_ROOM: f32 = 0.25;
/// No cell.
const NO_CELL: u32 = u32::MAX;

/// Where the cells of a page are: their charts, and which other cells are seen from each.
pub struct CellMap {
    grid: Grid,
    owners: Owners,
    /// Per cell.
    seen: Vec<[u32; RAYS_PER_CELL]>,
}

/// What the rays from a cell meet.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    /// Per ray, the cell it meets; [`NO_CELL`] if none.
    cells: [u32; RAYS_PER_CELL],
    /// Rays that meet something nearer than [`EYE_ROOM`], cell or not.
    near: u32,
    /// Rays that do not.
    far: u32,
}

impl Default for Seen {
    fn default() -> Self {
        Seen { cells: [NO_CELL; RAYS_PER_CELL], near: 0, far: 0 }
    }
}

impl Seen {
    /// Adds what a ray meets: its distance in metres (∞: nothing), and its cell, if it has one.
    fn add(&mut self, ray: usize, (distance, cell): (f32, Option<u32>)) {
        self.cells[ray] = cell.unwrap_or(NO_CELL);
        match distance < EYE_ROOM {
            true => self.near += 1,
            false => self.far += 1,
        }
    }

    /// Whether an eye has no room before the cell: most rays are short. (Along a gap some are long.)
    fn is_cramped(&self) -> bool {
        self.near > self.far
    }
}

/// Per cell, the cells that its light is compared with: those that its rays meet. A cell without room for an
/// eye, as behind a bookcase, takes those of the nearest cell with room. The way there leads from cell to
/// cell: to those that its rays meet, then to those `beside` it on the page. Where no way leads out, as in a
/// scene of a few centimetres, a cell keeps what its own rays meet.
fn seen_by_eyes(seen: &[Seen], beside: impl Fn(usize) -> Vec<usize>) -> Vec<[u32; RAYS_PER_CELL]> {
    let mut found: Vec<Option<[u32; RAYS_PER_CELL]>> =
        seen.iter().map(|seen| (!seen.is_cramped()).then_some(seen.cells)).collect();
    let cramped = (0..seen.len()).filter(|&cell| found[cell].is_none());
    let next = |cell: usize| seen[cell].cells.into_iter().map(|met| met as usize).chain(beside(cell));
    let mut cramped: Vec<(usize, Vec<usize>)> = cramped.map(|cell| (cell, next(cell).collect())).collect();
    loop {
        let way_out = |(cell, next): &(usize, Vec<usize>)| {
            Some((*cell, next.iter().find_map(|&next| *found.get(next)?)?))
        };
        let out: Vec<_> = cramped.iter().filter_map(way_out).collect();
        if out.is_empty() {
            break;
        }
        out.into_iter().for_each(|(cell, far)| found[cell] = Some(far));
        cramped.retain(|(cell, _)| found[*cell].is_none());
    }
    found.iter().zip(seen).map(|(found, seen)| found.unwrap_or(seen.cells)).collect()
}

/// The cells of a page, row by row; blocks at its edges are whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Cells across.
    pub columns: usize,
    /// Cells down.
    pub rows: usize,
}

impl Grid {
    /// Those of a page of so many texels.
    pub fn new(width: usize, height: usize) -> Self {
        const ALONG: usize = BLOCK / CELL;
        Grid { columns: width.div_ceil(BLOCK) * ALONG, rows: height.div_ceil(BLOCK) * ALONG }
    }

    /// How many.
    pub fn cells(&self) -> usize {
        self.columns * self.rows
    }

    /// The cell of a texel.
    pub fn at(&self, x: usize, y: usize) -> usize {
        y / CELL * self.columns + x / CELL
    }

    /// Per cell, the squared relative bias of the filter. The estimate of one cell is as uncertain as it is
    /// large. So the ratio of squared bias to variance before filtering is taken over the cells around, and
    /// multiplied by the cell's own variance; 0 where that is negative.
    pub fn squared_biases(&self, cells: &[Sums]) -> Vec<f64> {
        /// Cells to each side.
        const AROUND: usize = 2;
        if cells.iter().all(|sums| sums.local_squared_bias == 0.0) {
            return vec![0.0; cells.len()];
        }
        let around =
            |centre: usize, count: usize| centre.saturating_sub(AROUND)..(centre + AROUND + 1).min(count);
        let bias = |cell: usize| {
            let (mut bias, mut noise) = (0.0, 0.0);
            for row in around(cell / self.columns, self.rows) {
                for sums in &cells[row * self.columns..][around(cell % self.columns, self.columns)] {
                    bias += sums.local_squared_bias;
                    noise += sums.local_variance_before;
                }
            }
            let own = &cells[cell];
            if own.values == 0 || bias <= 0.0 || noise <= 0.0 {
                0.0
            } else {
                bias / noise * own.local_variance_before / own.values as f64
            }
        };
        (0..cells.len()).map(bias).collect()
    }

    /// A grey PNG file with a pixel per cell, its error in steps of [`PICTURE_STEP`], 255 also where it is
    /// more; black where there is no light.
    pub fn picture(&self, errors: Option<&[f64]>) -> Vec<u8> {
        let code =
            |error: f64| if error > 0.0 { (error / PICTURE_STEP).round().clamp(1.0, 255.0) as u8 } else { 0 };
        let codes = match errors {
            Some(errors) => errors.iter().map(|error| code(*error)).collect(),
            None => vec![0; self.cells()],
        };
        encode_png(&codes, self.columns, self.rows, image::ExtendedColorType::L8)
    }

    /// The cell of this number within the block whose top left texel is (x0, y0).
    pub fn of_block(&self, x0: usize, y0: usize, cell: usize) -> usize {
        const ALONG: usize = BLOCK / CELL;
        self.at(x0 + cell % ALONG * CELL, y0 + cell / ALONG * CELL)
    }
}

/// Texels by the piece they belong to: those of one cell and one chart.
pub struct Pieces {
    of: Vec<u32>,
    cells: Vec<u32>,
}

impl Pieces {
    /// Of texels, each with its cell and its chart if it is of one alone.
    pub fn new(texels: impl Iterator<Item = (usize, Option<u32>)>) -> Self {
        let mut known = BTreeMap::new();
        let mut pieces = Pieces { of: Vec::new(), cells: Vec::new() };
        for (cell, chart) in texels {
            let piece = *known.entry((cell, chart)).or_insert(pieces.cells.len() as u32);
            if piece as usize == pieces.cells.len() {
                pieces.cells.push(cell as u32);
            }
            pieces.of.push(piece);
        }
        pieces
    }

    /// Of texels of a page of this width, by their indices.
    pub fn of_texels(cell_map: &CellMap, width: usize, texels: impl Iterator<Item = usize>) -> Self {
        let xy = |index: usize| (index % width, index / width);
        Pieces::new(texels.map(xy).map(|(x, y)| (cell_map.grid.at(x, y), cell_map.chart_of(x, y))))
    }

    /// The piece of a texel.
    pub fn of(&self, texel: usize) -> usize {
        self.of[texel] as usize
    }

    /// Adds the light of all texels to the sums of their cells.
    pub fn add(&self, light: &[Value], cells: &mut [Sums]) {
        let mut pieces = self.sums();
        light.iter().enumerate().for_each(|(texel, value)| self.add_texel(texel, value, &mut pieces));
        self.add_to_cells(&pieces, cells);
    }

    /// The sums of each piece, without texels.
    pub fn sums(&self) -> Vec<Sums> {
        vec![Sums::default(); self.cells.len()]
    }

    /// Adds one texel to the sums of its piece.
    pub fn add_texel(&self, texel: usize, value: &Value, pieces: &mut [Sums]) {
        pieces[self.of[texel] as usize].add_texel(value);
    }

    /// Adds the sums of all pieces to those of their cells.
    pub fn add_to_cells(&self, pieces: &[Sums], cells: &mut [Sums]) {
        for (sums, &cell) in pieces.iter().zip(&self.cells) {
            let mean = sums.mean();
            let relative = |squared: f64| if mean > 0.0 { squared / (mean * mean) } else { 0.0 };
            let (local, local_squared_bias) = (relative(sums.squared_error), relative(sums.squared_bias));
            let local_variance_before = relative(sums.variance_before);
            cells[cell as usize].add(&Sums { local, local_squared_bias, local_variance_before, ..*sums });
        }
    }
}

/// What the local errors of many cells sum up to: each cell counts by its texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LocalErrorSummary {
    /// Half of the texels lie in cells with less.
    pub median: f64,
    /// 95 % of the texels lie in cells with no more.
    pub p95: f64,
    /// The greatest.
    pub worst: f64,
    /// Shares of the texels in cells with more than [`COUNTED_ERRORS`].
    pub over: [f64; 3],
}

impl LocalErrorSummary {
    /// Of errors with their weights; `None` of none.
    pub fn of(errors: impl Iterator<Item = (f64, u64)>) -> Option<Self> {
        let mut errors: Vec<(f64, u64)> = errors.filter(|(_, weight)| *weight > 0).collect();
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: u64 = errors.iter().map(|(_, weight)| weight).sum();
        let at = |share: f64| {
            let mut below = 0;
            let reached = |&&(_, weight): &&(f64, u64)| {
                below += weight;
                below as f64 >= share * all as f64
            };
            errors.iter().find(reached).map_or(0.0, |(error, _)| *error)
        };
        let over = COUNTED_ERRORS.map(|least| {
            let above = errors.iter().filter(|(error, _)| *error > least);
            above.map(|(_, weight)| weight).sum::<u64>() as f64 / all as f64
        });
        Some(LocalErrorSummary { median: at(0.5), p95: at(0.95), worst: errors.last()?.0, over })
    }
}

impl CellMap {
    /// Traces 16 rays from texels spread over every cell.
    pub fn find(worker: &Worker, console: &dyn Observer) -> crate::Result<(Self, RayCounts)> {
        let mut cell_map = CellMap::seeing_nothing(worker.receivers);
        let place_of = worker.receivers.place_finder(worker.transport.space.geometry);
        let blocks = worker.blocks();
        let progress = console.progress("finding visible cells", blocks.len() as u64);
        let of_block = |&block: &usize| -> crate::Result<_> {
            stop_if_interrupted()?;
            let receivers = worker.block(block);
            let mut texels = vec![Vec::new(); CELLS];
            receivers.covered().for_each(|t| texels[cell_of(&receivers, t)].push(t));
            let (mut seen, mut rays) = ([Seen::default(); CELLS], RayCounts::default());
            for (cell, texels) in texels.iter().enumerate().filter(|(_, texels)| !texels.is_empty()) {
                for ray in 0..RAYS_PER_CELL {
                    let texel = texels[ray * texels.len() / RAYS_PER_CELL];
                    let met = cell_map.trace_seen(worker, &place_of, &receivers, texel, &mut rays);
                    met.into_iter().for_each(|met| seen[cell].add(ray, met));
                }
            }
            progress.advance(1);
            Ok((receivers.x0, receivers.y0, seen, rays))
        };
        let found = blocks.par_iter().map(of_block).collect::<crate::Result<Vec<_>>>()?;
        let mut rays = RayCounts::default();
        let mut seen = vec![Seen::default(); cell_map.grid.cells()];
        for (x0, y0, of_block, counts) in found {
            for (cell, of_cell) in of_block.into_iter().enumerate() {
                seen[cell_map.grid.of_block(x0, y0, cell)] = of_cell;
            }
            rays += counts;
        }
        cell_map.seen = seen_by_eyes(&seen, |cell| cell_map.beside(worker.receivers.size(), cell));
        Ok((cell_map, rays))
    }

    /// Cells that see nothing: each is judged by its own light.
    pub fn seeing_nothing(receivers: &dyn Receivers) -> Self {
        let [width, height] = receivers.size();
        let grid = Grid::new(width, height);
        CellMap { grid, owners: receivers.owners(), seen: vec![[NO_CELL; RAYS_PER_CELL]; grid.cells()] }
    }

    /// Cells of a page without charts, each of which sees those that `seen` says.
    #[cfg(test)]
    pub fn for_tests(width: usize, height: usize, seen: impl Fn(usize) -> Option<u32>) -> Self {
        let atlas = crate::atlas::Atlas::for_tests(width as u32, height as u32, Vec::new());
        let mut cell_map = CellMap::seeing_nothing(&crate::receivers::SurfaceTexels::new(&atlas));
        for (cell, all) in cell_map.seen.iter_mut().enumerate() {
            *all = [seen(cell).unwrap_or(NO_CELL); RAYS_PER_CELL];
        }
        cell_map
    }

    /// What a ray from a texel meets: its distance in metres (∞: nothing), and the cell, if the front of a
    /// surface with texels is met. `None` where the texel has no surface at that point.
    fn trace_seen(
        &self,
        worker: &Worker,
        place_of: &PlaceFinder,
        receivers: &ReceiverBlock,
        texel: usize,
        rays: &mut RayCounts,
    ) -> Option<(f32, Option<u32>)> {
        // (Whatever the seed of the bake: what is judged does not hang on it.)
        let index = receivers.page_index(texel) as u32;
        let sample = Sequence::new(0, SequenceKind::Texel, index, Stream::VisibleCells as u32).sample(0);
        let space = &worker.transport.space;
        let at = receivers.receiver(space, texel, point_pair(sample))?;
        rays.inside += 1;
        let (distance, hit) = worker.transport.seen(&at, sample)?;
        let cell = |hit: Hit| {
            let [x, y] = place_of(&hit)?;
            Some(self.grid.at(x, y) as u32)
        };
        Some((distance, hit.and_then(cell)))
    }

    /// The up to four cells next to a cell on the page whose adjoining texels lie on the same chart as its
    /// own.
    fn beside(&self, [width, height]: [usize; 2], cell: usize) -> Vec<usize> {
        let (x, y) = (cell % self.grid.columns * CELL, cell / self.grid.columns * CELL);
        let is_on_page = |x: usize, y: usize| x < width && y < height;
        let chart = |x: usize, y: usize| if is_on_page(x, y) { self.owners.of(x, y) } else { None };
        let next = |(dx, dy): (isize, isize)| {
            let along = |step: isize, i: usize| match step {
                -1 => 0,
                1 => CELL - 1,
                _ => i,
            };
            (0..CELL).find_map(|i| {
                let (x, y) = (x + along(dx, i), y + along(dy, i));
                let other = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
                (chart(x, y)? == chart(other.0, other.1)?).then(|| self.grid.at(other.0, other.1))
            })
        };
        [(-1, 0), (1, 0), (0, -1), (0, 1)].into_iter().filter_map(next).collect()
    }

    /// The grid of the cells.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// The chart of a texel, if it is of one alone.
    pub fn chart_of(&self, x: usize, y: usize) -> Option<u32> {
        self.owners.of(x, y)
    }

    /// What tells the piece of a texel of a block: its cell of the block, and its chart if it is of one
    /// alone.
    pub fn piece_of(&self, receivers: &ReceiverBlock, in_block: usize) -> (usize, Option<u32>) {
        let (x, y) = (receivers.x0 + in_block % receivers.width, receivers.y0 + in_block / receivers.width);
        (cell_of(receivers, in_block), self.chart_of(x, y))
    }

    /// Per cell of a frame, the least light in klx that errors are relative to: by the median of its own and
    /// that of the cells seen from it.
    pub fn floors(&self, cells: &[Sums]) -> Vec<f64> {
        let floor = |own: usize| {
            let seen_cells =
                self.seen[own].iter().filter(|seen| **seen != NO_CELL).map(|seen| *seen as usize);
            let lit = std::iter::once(own)
                .chain(seen_cells)
                .map(|cell| &cells[cell])
                .filter(|sums| sums.values > 0);
            let mut lights: Vec<f64> = lit.map(Sums::mean).collect();
            lights.sort_by(f64::total_cmp);
            // Of two in the middle the lesser: it asks for more.
            let adapted = lights.get(lights.len().saturating_sub(1) / 2).copied().unwrap_or(0.0);
            (VISIBLE_PART * adapted).max(LEAST_IRRADIANCE)
        };
        (0..cells.len()).map(floor).collect()
    }

    /// Per cell of a frame, its local error; 0 of one without light.
    pub fn errors(&self, cells: &[Sums]) -> Vec<f64> {
        let floors = self.floors(cells).into_iter().zip(self.grid.squared_biases(cells));
        cells.iter().zip(floors).map(|(sums, (floor, bias))| error(sums, floor, bias)).collect()
    }

    /// The errors of a frame, and what they sum up to.
    pub fn judge(&self, cells: &[Sums]) -> (Vec<f64>, Option<LocalErrorSummary>) {
        let errors = self.errors(cells);
        let local =
            LocalErrorSummary::of(errors.iter().zip(cells).map(|(error, sums)| (*error, sums.values / 3)));
        (errors, local)
    }
}

/// The local error of a cell: every texel's ÷ the light of its piece or ÷ the floor, whichever is more. (Per
/// texel: of the sums the lesser error is taken, which is no less.) `bias` is the filter's squared relative
/// bias, as [`Grid::squared_biases`] gives it.
pub(crate) fn error(sums: &Sums, floor: f64, bias: f64) -> f64 {
    if sums.values == 0 {
        return 0.0;
    }
    let (by_light, by_floor) = (sums.local / sums.values as f64, sums.squared_error / sums.values as f64);
    (by_light + bias).sqrt().min((by_floor + bias * sums.mean() * sums.mean()).sqrt() / floor)
}

/// Per frame, the sums of each cell of a block. A texel counts where it is usable and some layer reaches it.
pub(crate) fn of_block(
    frames: &[Parts],
    lights: &Lights,
    receivers: &ReceiverBlock,
    state: &BlockState,
    cell_map: &CellMap,
) -> Vec<[Sums; CELLS]> {
    let layers = lights.layers();
    let (mut a, mut b) = (vec![Rgb::ZERO; layers], vec![Rgb::ZERO; layers]);
    // Of the texels that count: where they are, and per frame their light and its standard error.
    let mut counted = Vec::new();
    let mut light: Vec<Vec<Value>> = vec![Vec::new(); frames.len()];
    for (texel, in_block) in receivers.covered().enumerate() {
        if !state.is_usable(texel) {
            continue;
        }
        state.means(texel, 0, lights, &mut a);
        state.means(texel, 1, lights, &mut b);
        if a.iter().chain(&b).all(|v| *v == Rgb::ZERO) {
            continue;
        }
        counted.push(cell_map.piece_of(receivers, in_block));
        for (parts, light) in frames.iter().zip(&mut light) {
            let sum = |half: &[Rgb]| parts.iter().map(|&(l, scale)| half[l] * scale).sum::<Rgb>();
            let (a, b) = (sum(&a), sum(&b));
            light.push(Value::traced((a + b) * 0.5, (a - b) * 0.5));
        }
    }
    let pieces = Pieces::new(counted.into_iter());
    let cells = |light: Vec<Value>| {
        let mut cells = [Sums::default(); CELLS];
        pieces.add(&light, &mut cells);
        cells
    };
    light.into_iter().map(cells).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_judged_by_the_light_of_their_chart() {
        // In one cell, a chart of light 100 known to 1 % and one of light 1 known to 50 %.
        let texels = |n: usize| (0..n).map(|i| (0, Some((i % 2) as u32)));
        let pieces = Pieces::new(texels(256));
        let light: Vec<Value> = (0..256)
            .map(|i| [(100.0, 1.0), (1.0, 0.5)][i % 2])
            .map(|(m, e)| Value::traced(Rgb::splat(m), Rgb::splat(e)))
            .collect();
        let mut cells = vec![Sums::default()];
        pieces.add(&light, &mut cells);
        let expected = ((0.01f64.powi(2) + 0.5f64.powi(2)) / 2.0).sqrt();
        assert!((error(&cells[0], 1e-9, 0.0) - expected).abs() < 1e-6);
        // By the cell's own mean it would be 1.6 %.
        assert!((cells[0].mse().sqrt() / cells[0].mean() - 0.0157).abs() < 1e-3);
        // Texels that do not count leave no trace.
        let mut some = vec![Sums::default()];
        let mut sums = pieces.sums();
        (0..256).step_by(2).for_each(|texel| pieces.add_texel(texel, &light[texel], &mut sums));
        pieces.add_to_cells(&sums, &mut some);
        assert_eq!((some[0].values, some[0].mean()), (384, 100.0));
    }

    #[test]
    fn squared_bias_is_shared_out_by_noise() {
        // Four cells in a row as traced wrong by 20, 20, 1 and 20 %; filters left a tenth of each variance,
        // and a bias that two of them tell.
        let grid = Grid { columns: 4, rows: 1 };
        let cell = |noise: f64, bias: f64| Sums {
            values: 3,
            local: 3.0 * 0.1 * noise * noise,
            local_squared_bias: 3.0 * bias,
            local_variance_before: 3.0 * noise * noise,
            ..Sums::default()
        };
        let cells = [cell(0.2, 0.02), cell(0.2, -0.01), cell(0.01, 0.0), cell(0.2, 0.0)];
        let biases = grid.squared_biases(&cells);
        let of_noise = 0.01 / (2.0 * 0.04 + 0.0001);
        assert!((biases[0] - of_noise * 0.04).abs() < 1e-9, "{biases:?}");
        // A cell that hardly had any noise has hardly any of it; and what is less than nothing is nothing.
        assert!(biases[2] < 1e-5, "{biases:?}");
        assert_eq!(biases[3], 0.0, "{biases:?}");
        assert_eq!(grid.squared_biases(&[Sums::default(); 4]), [0.0; 4]);
    }

    #[test]
    fn cells_count_by_their_texels() {
        let local = LocalErrorSummary::of([(0.5, 4), (0.01, 90), (0.07, 6), (9.0, 0)].into_iter());
        assert_eq!(
            local,
            Some(LocalErrorSummary { median: 0.01, p95: 0.07, worst: 0.5, over: [0.1, 0.04, 0.04] })
        );
        assert_eq!(LocalErrorSummary::of([(1.0, 0)].into_iter()), None);
    }

    #[test]
    fn cells_in_a_gap_are_judged_from_its_opening() {
        let far = |cell| (2.0, Some(cell));
        let near = |cell| (0.1, Some(cell));
        let seen = |met: &[(f32, Option<u32>)]| {
            let mut seen = Seen::default();
            met.iter().enumerate().for_each(|(ray, met)| seen.add(ray, *met));
            seen
        };
        let cells = [
            // In a room; at the mouth of a gap; two inside it.
            seen(&[far(9)]),
            seen(&[far(8), near(2), far(9)]),
            seen(&[near(3), near(1), far(3)]),
            seen(&[near(2)]),
            // One that sees nothing; two that see only each other.
            seen(&[]),
            seen(&[near(6)]),
            seen(&[near(5)]),
            // Before something near without texels, beside the mouth on the page; and before the open sky.
            seen(&[(0.1, None)]),
            seen(&[(0.1, None), (f32::INFINITY, None)]),
        ];
        let beside = |cell| if cell == 7 { vec![1] } else { Vec::new() };
        let first = |seen: [u32; RAYS_PER_CELL]| seen.into_iter().find(|&cell| cell != NO_CELL);
        let found: Vec<Option<u32>> = seen_by_eyes(&cells, beside).into_iter().map(first).collect();
        let expected = [Some(9), Some(8), Some(8), Some(8), None, Some(6), Some(5), Some(8), None];
        assert_eq!(found, expected);
    }

    #[test]
    fn the_dark_of_nights_without_light_is_no_error() {
        let cell_map = CellMap::for_tests(BLOCK, BLOCK, |_| None);
        let cells = vec![Sums::default(); cell_map.grid().cells()];
        assert_eq!(cell_map.judge(&cells).1, None);
        let mut cells = cells;
        cells[3].add_texel(&Value::traced(Rgb::splat(1e-12), Rgb::splat(1e-12)));
        cells[3].local = 3.0;
        let (errors, local) = cell_map.judge(&cells);
        assert!((errors[3] - 1e-5).abs() < 1e-9 && local.is_some_and(|local| local.worst == errors[3]));
        let picture = cell_map.grid().picture(Some(&errors));
        assert!(picture.starts_with(b"\x89PNG"));
    }
}
