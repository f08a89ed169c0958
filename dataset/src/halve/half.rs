//! Which texels of a page count for a texel of half the resolution.

use crate::image::Mask;

/// A page of full resolution, as its half sees it.
#[derive(Debug)]
pub(super) struct Half {
    pub source: Mask,
    pub width: usize,
    pub height: usize,
}

/// The texels that count for one of the half: at least one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Counted {
    /// Row by row: (x, y) on the page of full resolution.
    places: [(usize, usize); 4],
    number: usize,
}

impl Counted {
    pub(super) fn places(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.places[..self.number].iter().copied()
    }

    /// The mean of three values of each of the texels, summed row by row in f64.
    pub(super) fn mean(&self, value: impl Fn((usize, usize)) -> [f32; 3]) -> [f32; 3] {
        let mut sum = [0.0f64; 3];
        for place in self.places() {
            let value = value(place);
            (0..3).for_each(|c| sum[c] += f64::from(value[c]));
        }
        // A mean is no greater than the greatest value, so it fits again.
        sum.map(|sum| (sum / self.number as f64) as f32)
    }
}

impl Half {
    /// Of a page with this mask.
    pub(super) fn new(source: Mask) -> Self {
        let (width, height) = (source.width.div_ceil(2), source.height.div_ceil(2));
        Half { source, width, height }
    }

    /// The valid texels under a texel of the half, or all that there are if none is valid.
    pub(super) fn counted(&self, x: usize, y: usize) -> Counted {
        let Mask { width, height, valid } = &self.source;
        let (columns, rows) = (2 * x..(2 * x + 2).min(*width), 2 * y..(2 * y + 2).min(*height));
        let inside = || rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y)));
        let is_valid = |&(x, y): &(usize, usize)| valid[y * width + x];
        let any = inside().any(|place| is_valid(&place));
        let mut counted = Counted { places: [(0, 0); 4], number: 0 };
        for place in inside().filter(|place| !any || is_valid(place)) {
            counted.places[counted.number] = place;
            counted.number += 1;
        }
        counted
    }

    /// The mask of the half: valid where a texel under it is.
    pub(super) fn mask(&self) -> Mask {
        let Mask { width, valid, .. } = &self.source;
        let is_valid = |x: usize, y: usize| self.counted(x, y).places().any(|(x, y)| valid[y * width + x]);
        let all = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        Mask { width: self.width, height: self.height, valid: all.map(|(x, y)| is_valid(x, y)).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mask drawn by `#` for valid texels.
    fn mask(rows: &[&str]) -> Mask {
        let valid = rows.iter().flat_map(|row| row.bytes().map(|texel| texel == b'#')).collect();
        Mask { width: rows[0].len(), height: rows.len(), valid }
    }

    fn places(half: &Half, x: usize, y: usize) -> Vec<(usize, usize)> {
        half.counted(x, y).places().collect()
    }

    #[test]
    fn valid_texels_count_and_all_where_none_is_valid() {
        let half = Half::new(mask(&["#...#", ".#..#", "....."]));
        assert_eq!((half.width, half.height), (3, 2));
        assert_eq!(half.mask(), mask(&["#.#", "..."]));
        assert_eq!(places(&half, 0, 0), [(0, 0), (1, 1)]);
        assert_eq!(places(&half, 1, 0), [(2, 0), (3, 0), (2, 1), (3, 1)]);
        // At odd edges there are fewer.
        assert_eq!(places(&half, 2, 0), [(4, 0), (4, 1)]);
        assert_eq!(places(&half, 0, 1), [(0, 2), (1, 2)]);
        assert_eq!(places(&half, 2, 1), [(4, 2)]);
    }

    #[test]
    fn a_page_of_one_texel_stays() {
        for rows in [["#"], ["."]] {
            let half = Half::new(mask(&rows));
            assert_eq!((half.mask(), places(&half, 0, 0)), (mask(&rows), vec![(0, 0)]));
        }
    }

    #[test]
    fn a_mean_of_the_largest_values_is_finite_and_no_negative_zero() {
        let half = Half::new(mask(&["##", "##"]));
        let counted = half.counted(0, 0);
        assert_eq!(counted.mean(|_| [f32::MAX, -0.0, f32::MIN_POSITIVE]), [f32::MAX, 0.0, f32::MIN_POSITIVE]);
        assert!(counted.mean(|_| [-0.0; 3])[0].is_sign_positive());
        assert_eq!(counted.mean(|(x, y)| [x as f32, y as f32, (x * y) as f32]), [0.5, 0.5, 0.25]);
    }
}
