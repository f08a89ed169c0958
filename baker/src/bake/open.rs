//! Which cells go on towards a target error: those that miss it, and those whose surroundings do.
//!
//! A cell's own samples must not end it alone. Where light comes by few paths, a cell that met none of them sees no error, one that met
//! some sees a great one: were the former ended and the latter brought on, the mean over both would be too dark. The texels around know
//! of paths that this cell's have not found.

use super::errors::Sums;
use super::state::{CELL, CELLS};
use crate::surface::BLOCK;

/// Cells so far to every side are asked: paths that one sample in some ten thousand finds are known to them after the first round.
const REACH: usize = 2;
/// What is darker than this part of its set's mean is judged as if it were as bright: by what is seen of its noise.
const DARK: f64 = 0.1;
/// One texel in so many is hardly any.
const HARDLY: u64 = 100;

/// The cells of a page that miss the target, or near which light does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenCells {
    columns: usize,
    /// Row by row.
    open: Vec<bool>,
}

/// What is asked of a block.
#[derive(Clone, Copy)]
pub struct Block<'a> {
    /// Column of its top left texel.
    pub x0: usize,
    /// Row of its top left texel.
    pub y0: usize,
    /// The texels of each cell that light could reach.
    pub exposed: [u32; CELLS],
    /// Per set, error and light of each cell, over the texels that have seen any.
    pub sums: &'a [[Sums; CELLS]],
}

impl OpenCells {
    /// No cell of a page of so many texels.
    pub fn none(width: usize, height: usize) -> Self {
        let (columns, rows) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        OpenCells { columns: columns * (BLOCK / CELL), open: vec![false; columns * rows * CELLS] }
    }

    /// The cells that miss the `target` (a relative error) in one of the sets, of these mean values; one without exposed texels never. Where no set has light yet, or hardly a texel
    /// has seen any, nearly all of it may be missing: all cells are open.
    pub fn find<'a>(
        (width, height): (usize, usize),
        target: f64,
        set_means: &[f64],
        blocks: impl Iterator<Item = Block<'a>> + Clone,
    ) -> Self {
        let mut found = OpenCells::none(width, height);
        let mut exposed = found.open.clone();
        let (mut texels, mut lit) = (0, 0);
        for block in blocks.clone() {
            for (cell, &n) in block.exposed.iter().enumerate() {
                exposed[found.place(block.x0, block.y0, cell)] = n > 0;
                texels += u64::from(n);
                lit += block.sums.iter().map(|cells| cells[cell].values / 3).max().unwrap_or(0);
            }
        }
        let is_dark = lit * HARDLY < texels || set_means.iter().all(|mean| *mean <= 0.0);
        for (set, &mean) in set_means.iter().enumerate() {
            let mut cells = vec![Sums::default(); found.open.len()];
            for Block { x0, y0, sums, .. } in blocks.clone() {
                (0..CELLS).for_each(|cell| cells[found.place(x0, y0, cell)] = sums[set][cell]);
            }
            let misses =
                |sums: &Sums| mean > 0.0 && sums.mse().sqrt() > target * sums.mean().max(DARK * mean);
            for place in (0..cells.len()).filter(|&place| exposed[place]) {
                found.open[place] |= is_dark || misses(&cells[place]) || misses(&found.around(&cells, place));
            }
        }
        found
    }

    /// All texels of the cells around one, and its own.
    fn around(&self, cells: &[Sums], place: usize) -> Sums {
        let (x, y) = (place % self.columns, place / self.columns);
        let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(self.columns);
        let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(cells.len() / self.columns);
        let mut all = Sums::default();
        rows.flat_map(|y| columns.clone().map(move |x| y * self.columns + x))
            .for_each(|p| all.add(&cells[p]));
        all
    }

    /// Where a cell of the block whose top left texel is (x0, y0) stands.
    fn place(&self, x0: usize, y0: usize, cell: usize) -> usize {
        const ALONG: usize = BLOCK / CELL;
        (y0 / CELL + cell / ALONG) * self.columns + x0 / CELL + cell % ALONG
    }

    /// The cells of a block.
    pub fn of_block(&self, x0: usize, y0: usize) -> [bool; CELLS] {
        std::array::from_fn(|cell| self.open[self.place(x0, y0, cell)])
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.open.iter().filter(|open| **open).count()
    }

    /// One byte a cell, for storing them.
    pub fn bytes(&self) -> Vec<u8> {
        self.open.iter().map(|open| u8::from(*open)).collect()
    }

    /// What [`OpenCells::bytes`] gave for a page of so many texels; `None` where it does not fit.
    pub fn from_bytes(width: usize, height: usize, bytes: &[u8]) -> Option<Self> {
        let mut read = OpenCells::none(width, height);
        (bytes.len() == read.open.len()).then(|| {
            read.open.iter_mut().zip(bytes).for_each(|(open, byte)| *open = *byte != 0);
            read
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rgb;

    /// One set on a page of 4 × 2 blocks; `texel(x, y)` is the mean and the error of all texels of the cell (x, y).
    fn find(target: f64, mean: f64, texel: impl Fn(usize, usize) -> Option<(f32, f32)>) -> OpenCells {
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
                        (0..256).for_each(|_| sums.add_texel(Rgb::splat(mean), Rgb::splat(error)));
                    }
                    sums
                };
                [std::array::from_fn(cell)]
            })
            .collect();
        let blocks = sums.iter().enumerate().map(|(block, sums)| {
            let (x0, y0) = corner(block);
            Block { x0, y0, exposed: std::array::from_fn(|c| of_cell(block, c).map_or(0, |_| 256)), sums }
        });
        OpenCells::find((4 * BLOCK, 2 * BLOCK), target, &[mean], blocks)
    }

    fn open(cells: &OpenCells) -> Vec<(usize, usize)> {
        let at = |i: usize| (i % cells.columns, i / cells.columns);
        (0..cells.open.len()).filter(|&i| cells.open[i]).map(at).collect()
    }

    #[test]
    fn a_cell_goes_on_while_itself_or_what_is_around_it_misses_the_target() {
        assert_eq!(find(0.05, 1.0, |_, _| Some((1.0, 0.049))).count(), 0);
        assert_eq!(find(0.05, 1.0, |_, _| Some((1.0, 0.051))).count(), 16 * 8);
        // A little too much in one cell is its own affair.
        let cells = find(0.05, 1.0, |x, y| Some((1.0, if (x, y) == (5, 3) { 0.1 } else { 0.01 })));
        assert_eq!(open(&cells), [(5, 3)]);
        // Far too much is that of all cells from which it is two away, in other blocks too.
        let cells = find(0.05, 1.0, |x, y| Some((1.0, if (x, y) == (4, 3) { 1.0 } else { 0.0 })));
        let near = (1..6).flat_map(|y| (2..7).map(move |x| (x, y)));
        assert_eq!(open(&cells), near.collect::<Vec<_>>());
    }

    #[test]
    fn cells_that_found_nothing_go_on_beside_those_that_did() {
        // Every third cell met a path: all light of it there, and an error as great.
        let cells = find(0.2, 0.1, |x, y| Some(if (x + y) % 3 == 0 { (0.3, 0.3) } else { (0.0, 0.0) }));
        assert_eq!(cells.count(), 16 * 8);
        // Amid dark that nobody lit they end.
        let cells = find(0.2, 0.1, |x, _| Some(if x == 0 { (1.6, 0.8) } else { (0.0, 0.0) }));
        assert_eq!(open(&cells), (0..8).flat_map(|y| (0..3).map(move |x| (x, y))).collect::<Vec<_>>());
    }

    #[test]
    fn without_light_all_that_has_texels_goes_on() {
        let cells = find(0.2, 0.0, |x, y| (x == y).then_some((0.0, 0.0)));
        assert_eq!(open(&cells), (0..8).map(|i| (i, i)).collect::<Vec<_>>());
    }

    #[test]
    fn while_hardly_a_texel_has_seen_light_all_goes_on() {
        // One lit cell of 128, and two.
        let lit =
            |most: usize| find(0.2, 0.1, |x, y| Some((if x < most && y == 0 { 9.0 } else { 0.0 }, 0.0)));
        assert_eq!([1, 2].map(|most| lit(most).count()), [16 * 8, 0]);
    }

    #[test]
    fn cells_are_read_back_as_they_were_stored() {
        let cells = find(0.05, 1.0, |x, y| Some((1.0, if (x + 3 * y) % 5 == 0 { 0.06 } else { 0.04 })));
        assert!(cells.count() > 0 && cells.count() < 16 * 8);
        let again = OpenCells::from_bytes(4 * BLOCK, 2 * BLOCK, &cells.bytes());
        assert_eq!(again, Some(cells.clone()));
        assert_eq!(OpenCells::from_bytes(4 * BLOCK, 2 * BLOCK + 1, &cells.bytes()), None);
        for (x0, y0) in [(0, 0), (3 * BLOCK, BLOCK)] {
            let of_block = cells.of_block(x0, y0);
            let bit = |cell: usize| cells.open[(y0 / CELL + cell / 4) * 16 + x0 / CELL + cell % 4];
            assert!((0..CELLS).all(|cell| of_block[cell] == bit(cell)));
        }
    }
}
