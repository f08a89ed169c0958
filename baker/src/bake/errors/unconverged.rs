//! Which cells go on towards a target error: those that miss it, and those whose surroundings do.
//!
//! A cell's own samples must not end it alone. Where light comes by few paths, a cell that met none of them
//! sees no error, one that met some sees a great one: were the former ended and the latter brought on, the
//! mean over both would be too dark. The texels around know of paths that this cell's have not found.

use super::local_errors::{CellMap, Grid, LocalErrorSummary, error};
use super::sums::Sums;
use crate::bake::store::CELLS;

/// Cells so far to every side are asked: paths that one sample in some ten thousand finds are known to them
/// after the first round.
const CELLS_AROUND: usize = 2;
/// A target is met where no more than this share of the texels lies in cells that miss it, in every frame.
const MOST_UNCONVERGED: f64 = 0.05;
/// One texel in so many is hardly any.
const HARDLY_LIT: u64 = 100;

/// The cells of a page that miss the target, or near which light does.
#[derive(Clone, Debug, PartialEq)]
pub struct UnconvergedCells {
    grid: Grid,
    /// Row by row.
    unconverged: Vec<bool>,
    /// The largest share of a frame's texels that lies in unconverged cells.
    pub missed: f64,
    /// Whether hardly a texel has seen light yet.
    pub is_dark: bool,
}

/// What is asked of a block.
#[derive(Clone, Copy)]
pub struct BlockErrors<'a> {
    /// Column of its top left texel.
    pub x0: usize,
    /// Row of its top left texel.
    pub y0: usize,
    /// The texels of each cell that light could reach.
    pub usable: [u32; CELLS],
    /// Per frame, error and light of each cell, over the texels that have seen any.
    pub sums: &'a [[Sums; CELLS]],
}

/// What came of judging light.
pub struct TargetJudgement {
    /// The cells that miss the target in some frame.
    pub unconverged: UnconvergedCells,
    /// Local errors of all frames together; `None` without light.
    pub local: Option<LocalErrorSummary>,
}

impl UnconvergedCells {
    /// No cell of a page.
    pub fn none(grid: Grid) -> Self {
        UnconvergedCells { grid, unconverged: vec![false; grid.cells()], missed: 0.0, is_dark: false }
    }

    /// The cells that miss the `target` (a local error) in one of the frames, by themselves or together with
    /// those around them; one without usable texels never. Together, errors count beside what is tolerated
    /// of the cell they are of, or of the one that is judged, whichever is more: what is bright does not hide
    /// what its dim neighbours miss, nor go on for their sake. Where no frame has light yet, or hardly a
    /// texel has seen any, nearly all of it may be missing: all cells are unconverged.
    pub fn find<'a>(
        cell_map: &CellMap,
        target: f64,
        frames: usize,
        blocks: impl Iterator<Item = BlockErrors<'a>> + Clone,
    ) -> Self {
        let grid = cell_map.grid();
        let mut found = UnconvergedCells::none(grid);
        let mut usable = vec![0; grid.cells()];
        let (mut texels, mut lit) = (0, 0);
        for block in blocks.clone() {
            for (cell, &n) in block.usable.iter().enumerate() {
                usable[grid.of_block(block.x0, block.y0, cell)] = n;
                texels += u64::from(n);
                lit += block.sums.iter().map(|cells| cells[cell].values / 3).max().unwrap_or(0);
            }
        }
        let mut is_dark = true;
        for frame in 0..frames {
            let mut cells = vec![Sums::default(); grid.cells()];
            for BlockErrors { x0, y0, sums, .. } in blocks.clone() {
                (0..CELLS).for_each(|cell| cells[grid.of_block(x0, y0, cell)] = sums[frame][cell]);
            }
            is_dark &= cells.iter().all(|sums| sums.light <= 0.0);
            found.judge(cell_map, target, &cells, &usable);
        }
        if is_dark || lit * HARDLY_LIT < texels {
            found
                .unconverged
                .iter_mut()
                .zip(usable)
                .for_each(|(unconverged, usable)| *unconverged |= usable > 0);
            (found.missed, found.is_dark) = (1.0, true);
        }
        found
    }

    /// Adds the cells with usable texels that miss the target in a frame.
    pub fn judge(&mut self, cell_map: &CellMap, target: f64, cells: &[Sums], usable: &[u32]) {
        let floors = cell_map.floors(cells);
        let biases = cell_map.grid().squared_biases(cells);
        // Of all usable texels: where few have seen light, as of a keyhole, the others are owed some.
        let values: Vec<u64> = usable.iter().map(|n| 3 * u64::from(*n)).collect();
        let of_cell =
            |cell: usize| target * (cells[cell].light / values[cell].max(1) as f64).max(floors[cell]);
        let (mut all_texels, mut missed) = (0, 0);
        for cell in (0..cells.len()).filter(|&cell| usable[cell] > 0) {
            let (mut errors, mut all) = (0.0, 0);
            for near in self.around(cell) {
                let (sums, tolerated) = (&cells[near], of_cell(near).max(of_cell(cell)));
                let bias = biases[near] * sums.mean().powi(2) * sums.values as f64;
                errors += (sums.squared_error + bias) / tolerated.powi(2);
                all += values[near];
            }
            let is_unconverged =
                error(&cells[cell], floors[cell], biases[cell]) > target || errors > all as f64;
            self.unconverged[cell] |= is_unconverged;
            // What no light has found in this frame, and what is told of no error, hides none that is missed.
            if is_unconverged || cells[cell].values > 0 {
                all_texels += usable[cell];
            }
            missed += if is_unconverged { usable[cell] } else { 0 };
        }
        self.missed = self.missed.max(f64::from(missed) / f64::from(all_texels.max(1)));
    }

    /// Whether the target is met: at every hour, at all but one texel in twenty.
    pub fn is_met(&self) -> bool {
        self.missed <= MOST_UNCONVERGED
    }

    /// A cell and those around it.
    fn around(&self, cell: usize) -> impl Iterator<Item = usize> + use<> {
        let across = self.grid.columns;
        let (x, y) = (cell % across, cell / across);
        let columns = x.saturating_sub(CELLS_AROUND)..(x + CELLS_AROUND + 1).min(across);
        let rows =
            y.saturating_sub(CELLS_AROUND)..(y + CELLS_AROUND + 1).min(self.unconverged.len() / across);
        rows.flat_map(move |y| columns.clone().map(move |x| y * across + x))
    }

    /// The cells of a block.
    pub fn of_block(&self, x0: usize, y0: usize) -> [bool; CELLS] {
        std::array::from_fn(|cell| self.unconverged[self.grid.of_block(x0, y0, cell)])
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.unconverged.iter().filter(|unconverged| **unconverged).count()
    }

    /// One byte a cell, for storing them.
    pub fn bytes(&self) -> Vec<u8> {
        self.unconverged.iter().map(|unconverged| u8::from(*unconverged)).collect()
    }

    /// What [`UnconvergedCells::bytes`] gave for a page; `None` where it does not fit.
    pub fn from_bytes(grid: Grid, bytes: &[u8]) -> Option<Self> {
        let mut read = UnconvergedCells::none(grid);
        (bytes.len() == read.unconverged.len()).then(|| {
            read.unconverged.iter_mut().zip(bytes).for_each(|(unconverged, byte)| *unconverged = *byte != 0);
            read
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rgb;
    use crate::bake::store::CELL;
    use crate::bake::store::Value;
    use crate::surface::BLOCK;

    /// Cells of a page of 4 × 2 blocks, none of which sees another.
    fn cell_map() -> CellMap {
        CellMap::for_tests(4 * BLOCK, 2 * BLOCK, |_| None)
    }

    /// One frame on that page; `texel(x, y)` is the mean and the error of all texels of the cell (x, y).
    fn find(target: f64, texel: impl Fn(usize, usize) -> Option<(f32, f32)>) -> UnconvergedCells {
        let corner = |block: usize| (block % 4 * BLOCK, block / 4 * BLOCK);
        let of_cell = |block: usize, cell: usize| {
            let (x0, y0) = corner(block);
            texel(x0 / CELL + cell % 4, y0 / CELL + cell / 4)
        };
        let sums: Vec<[[Sums; CELLS]; 1]> = (0..8)
            .map(|block| {
                let cell = |cell: usize| {
                    let mut sums = Sums::default();
                    // (Texels that have seen no light do not count.)
                    if let Some((mean, error)) = of_cell(block, cell).filter(|(mean, _)| *mean > 0.0) {
                        (0..256).for_each(|_| {
                            sums.add_texel(&Value::traced(Rgb::splat(mean), Rgb::splat(error)))
                        });
                        sums.local = sums.squared_error / f64::from(mean).powi(2);
                    }
                    sums
                };
                [std::array::from_fn(cell)]
            })
            .collect();
        let blocks = sums.iter().enumerate().map(|(block, sums)| {
            let (x0, y0) = corner(block);
            BlockErrors {
                x0,
                y0,
                usable: std::array::from_fn(|c| of_cell(block, c).map_or(0, |_| 256)),
                sums,
            }
        });
        UnconvergedCells::find(&cell_map(), target, 1, blocks)
    }

    fn unconverged(cells: &UnconvergedCells) -> Vec<(usize, usize)> {
        let at = |i: usize| (i % cells.grid.columns, i / cells.grid.columns);
        (0..cells.unconverged.len()).filter(|&i| cells.unconverged[i]).map(at).collect()
    }

    #[test]
    fn a_cell_goes_on_while_itself_or_what_is_around_it_misses_the_target() {
        assert_eq!(find(0.05, |_, _| Some((1.0, 0.049))).count(), 0);
        assert_eq!(find(0.05, |_, _| Some((1.0, 0.051))).count(), 16 * 8);
        // A little too much in one cell is its own affair.
        let cells = find(0.05, |x, y| Some((1.0, if (x, y) == (5, 3) { 0.1 } else { 0.01 })));
        assert_eq!(unconverged(&cells), [(5, 3)]);
        // Far too much is that of all cells from which it is two away, in other blocks too.
        let cells = find(0.05, |x, y| Some((1.0, if (x, y) == (4, 3) { 1.0 } else { 0.0 })));
        let near = (1..6).flat_map(|y| (2..7).map(move |x| (x, y)));
        assert_eq!(unconverged(&cells), near.collect::<Vec<_>>());
    }

    #[test]
    fn texels_that_no_light_reaches_do_not_make_up_for_those_that_miss_the_target() {
        // One column in four is lit, and one cell in eight of it misses: 12.5 % of what is lit, 3 % of all.
        let cells = find(0.05, |x, y| match (x.is_multiple_of(4), y) {
            (false, _) => Some((0.0, 0.0)),
            (true, 0) => Some((1.0, 0.06)),
            (true, _) => Some((1.0, 0.001)),
        });
        assert!((cells.missed - 0.125).abs() < 1e-9 && !cells.is_met(), "{}", cells.missed);
    }

    #[test]
    fn bright_cells_neither_hide_what_dim_ones_miss_nor_go_on_for_it() {
        // Every fifth column is well-known light; of the others, which have a tenth of it, few met a path.
        let bright = |x: usize| x.is_multiple_of(5);
        let cells = find(0.2, |x, y| match (x + 3 * y) % 7 {
            _ if bright(x) => Some((5.0, 0.5)),
            0 => Some((0.5, 0.5)),
            _ => Some((0.0, 0.0)),
        });
        let dim = (0..8).flat_map(|y| (0..16).filter(|&x| !bright(x)).map(move |x| (x, y)));
        assert_eq!(unconverged(&cells), dim.collect::<Vec<_>>());
    }

    #[test]
    fn cells_that_found_nothing_go_on_beside_those_that_did() {
        // Every third cell met a path: all light of it there, and an error as great.
        let cells = find(0.2, |x, y| Some(if (x + y) % 3 == 0 { (0.3, 0.3) } else { (0.0, 0.0) }));
        assert_eq!(cells.count(), 16 * 8);
        // Amid dark that nobody lit they end.
        let cells = find(0.2, |x, _| Some(if x == 0 { (1.6, 0.8) } else { (0.0, 0.0) }));
        assert_eq!(unconverged(&cells), (0..8).flat_map(|y| (0..3).map(move |x| (x, y))).collect::<Vec<_>>());
    }

    #[test]
    fn without_light_all_that_has_texels_goes_on() {
        let cells = find(0.2, |x, y| (x == y).then_some((0.0, 0.0)));
        assert_eq!(unconverged(&cells), (0..8).map(|i| (i, i)).collect::<Vec<_>>());
    }

    #[test]
    fn while_hardly_a_texel_has_seen_light_all_goes_on() {
        // One lit cell of 128, and two.
        let lit = |most: usize| find(0.2, |x, y| Some((if x < most && y == 0 { 9.0 } else { 0.0 }, 0.0)));
        assert_eq!([1, 2].map(|most| lit(most).count()), [16 * 8, 0]);
    }

    #[test]
    fn a_target_is_met_where_one_texel_in_twenty_misses_it() {
        let met = |wrong: usize| {
            let cells = find(0.05, |x, y| Some((1.0, if 16 * y + x < wrong { 0.06 } else { 0.01 })));
            assert_eq!(cells.count(), wrong);
            cells.is_met()
        };
        assert_eq!([6, 7].map(met), [true, false]);
        // Where nothing is known it is not.
        assert!(!find(0.05, |_, _| Some((0.0, 0.0))).is_met());
    }

    #[test]
    fn what_is_too_dark_to_be_seen_from_where_it_is_is_not_asked_for_more() {
        // Every cell sees the first, which is bright: errors of all their light are seen down to a thirtieth
        // of its.
        let cell_map = CellMap::for_tests(2 * BLOCK, BLOCK, |_| Some(0));
        let judged = |light: f32| {
            let mut cells = vec![Sums::default(); cell_map.grid().cells()];
            for (cell, sums) in cells.iter_mut().enumerate() {
                let light = if cell == 0 { 1.0 } else { light };
                sums.add_texel(&Value::traced(
                    Rgb::splat(light),
                    Rgb::splat(if cell == 0 { 0.0 } else { 0.1 * light }),
                ));
                sums.local = if cell == 0 { 0.0 } else { 3.0 * 0.01 };
            }
            let mut unconverged = UnconvergedCells::none(cell_map.grid());
            unconverged.judge(&cell_map, 0.05, &cells, &vec![1; cells.len()]);
            (
                cell_map.errors(&cells)[9],
                unconverged.unconverged[1..].iter().filter(|unconverged| **unconverged).count(),
            )
        };
        let near = |(error, unconverged): (f64, usize), expected: (f64, usize)| {
            assert!((error - expected.0).abs() < 1e-6 && unconverged == expected.1, "{error} {unconverged}");
        };
        near(judged(1.0), (0.1, 31));
        near(judged(0.1), (0.1, 31));
        // A fortieth: three quarters as wrong as by its own light.
        near(judged(1.0 / 40.0), (0.075, 31));
        near(judged(1.0 / 120.0), (0.025, 0));
    }

    #[test]
    fn cells_are_read_back_as_they_were_stored() {
        let cells = find(0.05, |x, y| Some((1.0, if (x + 3 * y) % 5 == 0 { 0.06 } else { 0.04 })));
        assert!(cells.count() > 0 && cells.count() < 16 * 8);
        let again = UnconvergedCells::from_bytes(cells.grid, &cells.bytes());
        assert_eq!(again.map(|again| again.unconverged), Some(cells.unconverged.clone()));
        assert_eq!(UnconvergedCells::from_bytes(Grid::new(4 * BLOCK, 2 * BLOCK + 1), &cells.bytes()), None);
        for (x0, y0) in [(0, 0), (3 * BLOCK, BLOCK)] {
            let of_block = cells.of_block(x0, y0);
            let bit = |cell: usize| cells.unconverged[(y0 / CELL + cell / 4) * 16 + x0 / CELL + cell % 4];
            assert!((0..CELLS).all(|cell| of_block[cell] == bit(cell)));
        }
    }
}
