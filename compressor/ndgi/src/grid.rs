//! The grid of tiles on a page, and which page texel each stored texel repeats.

use crate::model::{BORDER, PAYLOAD};
use crate::{Error, Result};

/// Where a tile stands on its page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    /// Page index.
    pub page: usize,
    /// Column of the tile.
    pub column: usize,
    /// Row of the tile.
    pub row: usize,
}

impl Place {
    /// The page texel that the tile's stored texel (0, 0) repeats or owns; −BORDER at the page's edge.
    pub fn origin(&self) -> (isize, isize) {
        let at = |i: usize| (i * PAYLOAD) as isize - BORDER as isize;
        (at(self.column), at(self.row))
    }
}

/// The tiles of one page: payloads of [`PAYLOAD`]² from texel (0, 0), smaller at the right and bottom edge.
///
/// ```
/// use ndgi::grid::Grid;
///
/// let grid = Grid { width: 300, height: 140 };
/// assert_eq!((grid.columns(), grid.rows()), (3, 2));
/// assert_eq!(grid.payload(2, 0), (48, 126)); // its own texels
/// assert_eq!(grid.stored(2, 0), (52, 128)); // with a border, in whole blocks of 4×4
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Page width in texels, at least 1.
    pub width: usize,
    /// Page height in texels, at least 1.
    pub height: usize,
}

impl Grid {
    /// Tiles across.
    pub fn columns(&self) -> usize {
        self.width.div_ceil(PAYLOAD)
    }

    /// Tiles down.
    pub fn rows(&self) -> usize {
        self.height.div_ceil(PAYLOAD)
    }

    /// All tiles.
    pub fn tiles(&self) -> usize {
        self.columns() * self.rows()
    }

    /// The page's tiles row by row.
    pub fn places(self, page: usize) -> impl Iterator<Item = Place> {
        (0..self.rows())
            .flat_map(move |row| (0..self.columns()).map(move |column| Place { page, column, row }))
    }

    /// Where (u, v) of a page, in [0, 1]², is looked up: the tile; of the four stored texels around, whose
    /// centres are at halves, the one to the left and above; and the shares of those to the right and below.
    /// Beyond the page it is its edge.
    ///
    /// # Errors
    /// [`Error::Invalid`] for coordinates that are not numbers.
    pub(crate) fn around(&self, page: usize, [u, v]: [f64; 2]) -> Result<(Place, [usize; 2], [f32; 2])> {
        // From −1 on; the tile that owns that texel (or the page's first) stores the other three too.
        let axis = |name: &str, u: f64, n: usize| {
            if u.is_nan() {
                return Err(Error::invalid(name, format!("{u}; expected a number")));
            }
            let p = u.clamp(0.0, 1.0) * n as f64 - 0.5;
            let i = p.floor().min(n as f64 - 1.0);
            let tile = i.max(0.0) as usize / PAYLOAD;
            Ok((tile, (i as isize - (tile * PAYLOAD) as isize + BORDER as isize) as usize, (p - i) as f32))
        };
        let ((column, x, s), (row, y, t)) = (axis("u", u, self.width)?, axis("v", v, self.height)?);
        Ok((Place { page, column, row }, [x, y], [s, t]))
    }

    /// Texels that belong to the tile itself: width, height.
    pub fn payload(&self, column: usize, row: usize) -> (usize, usize) {
        let own = |extent: usize, i: usize| PAYLOAD.min(extent - i * PAYLOAD);
        (own(self.width, column), own(self.height, row))
    }

    /// Stored texels: payload and borders, rounded up to whole 4×4 blocks.
    pub fn stored(&self, column: usize, row: usize) -> (usize, usize) {
        let (width, height) = self.payload(column, row);
        let stored = |own: usize| (own + 2 * BORDER).next_multiple_of(4);
        (stored(width), stored(height))
    }
}

/// Index `i` of an axis of `n ≥ 1` texels, mirrored at both ends as often as needed: −1 is 0, n is n − 1.
pub fn mirrored(i: isize, n: usize) -> usize {
    let folded = i.rem_euclid(2 * n as isize) as usize;
    if folded < n { folded } else { 2 * n - 1 - folded }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::STORED;

    #[test]
    fn payloads_tile_the_page_and_stored_sides_fit() {
        for width in [1, 2, 3, 125, 126, 127, 128, 129, 252, 253, 512, 1000] {
            let grid = Grid { width, height: 1 };
            let owned: usize = (0..grid.columns()).map(|c| grid.payload(c, 0).0).sum();
            assert_eq!(owned, width);
            for column in 0..grid.columns() {
                let (stored, _) = grid.stored(column, 0);
                assert!(
                    stored <= STORED && stored % 4 == 0 && stored >= grid.payload(column, 0).0 + 2 * BORDER
                );
            }
            assert_eq!(grid.places(0).count(), grid.tiles());
        }
    }

    #[test]
    fn mirrors_like_a_reflection_about_the_edge() {
        assert_eq!((-3..6).map(|i| mirrored(i, 3)).collect::<Vec<_>>(), [2, 1, 0, 0, 1, 2, 2, 1, 0]);
        assert!((-9..9).all(|i| mirrored(i, 1) == 0));
    }
}
