//! The grid of tiles metrics are computed on: non-overlapping squares from texel (0, 0), smaller at the right
//! and bottom edge.

use crate::image::Mask;

/// Side of the paper's evaluation tiles.
pub const TILE: usize = 128;

/// A rectangle of texels, `x0 ≤ x < x1`, `y0 ≤ y < y1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// Left column.
    pub x0: usize,
    /// Top row.
    pub y0: usize,
    /// One past the right column.
    pub x1: usize,
    /// One past the bottom row.
    pub y1: usize,
}

impl Rect {
    /// Columns.
    pub fn width(&self) -> usize {
        self.x1 - self.x0
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.y1 - self.y0
    }

    /// Indices of its texels on a page of this width, row by row.
    pub fn texels(&self, width: usize) -> impl Iterator<Item = usize> + Clone + use<> {
        let Rect { x0, x1, .. } = *self;
        (self.y0..self.y1).flat_map(move |y| y * width + x0..y * width + x1)
    }

    /// Those of them that are valid.
    pub fn valid<'a>(&self, mask: &'a Mask) -> impl Iterator<Item = usize> + use<'a> {
        self.texels(mask.width).filter(|&texel| mask.valid[texel])
    }
}

/// Number of tiles across and down a page.
pub fn grid(width: usize, height: usize, side: usize) -> (usize, usize) {
    (width.div_ceil(side), height.div_ceil(side))
}

/// The tiles of a page, row by row.
pub fn tiles(width: usize, height: usize, side: usize) -> Vec<Rect> {
    let (across, down) = grid(width, height, side);
    let tile = |column: usize, row: usize| Rect {
        x0: column * side,
        y0: row * side,
        x1: ((column + 1) * side).min(width),
        y1: ((row + 1) * side).min(height),
    };
    (0..down).flat_map(|row| (0..across).map(move |column| tile(column, row))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_every_texel_once() {
        for (width, height) in [(1, 1), (128, 128), (129, 127), (300, 512), (5, 1000)] {
            let mut covered = vec![0; width * height];
            for tile in tiles(width, height, TILE) {
                assert!(tile.width() > 0 && tile.height() > 0);
                for y in tile.y0..tile.y1 {
                    for x in tile.x0..tile.x1 {
                        covered[y * width + x] += 1;
                    }
                }
            }
            assert!(covered.iter().all(|&count| count == 1), "{width}×{height}");
        }
    }

    #[test]
    fn a_page_of_129_texels_has_a_tile_one_wide() {
        let tiles = tiles(129, 128, TILE);
        assert_eq!(
            tiles,
            [Rect { x0: 0, y0: 0, x1: 128, y1: 128 }, Rect { x0: 128, y0: 0, x1: 129, y1: 128 }]
        );
    }
}
