//! Visibility of tile borders: the error of differences between neighbouring texels, across tile borders and
//! inside tiles.

use crate::model::PAYLOAD;
use dataset::image::{Image, Mask};
use std::ops::Range;

/// Sum and number of errors.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f64,
    count: f64,
}

/// Errors of steps between valid neighbours to the right and below.
#[derive(Debug, Default)]
pub(super) struct Seams {
    across: Mean,
    inside: Mean,
}

impl Seams {
    /// Adds the rows `rows` of a page, given with the one below them where there is one. Errors count in
    /// units of the page's `mean`, so that nights count as days; a black page does not count.
    pub(super) fn add(
        &mut self,
        decoded: &Image,
        reference: &Image,
        mask: &Mask,
        rows: &Range<usize>,
        mean: f64,
    ) {
        if mean == 0.0 {
            return;
        }
        let (width, height) = (mask.width, mask.height);
        let error = |i: usize, c: usize| f64::from(decoded.texels[i][c]) - f64::from(reference.texels[i][c]);
        let mut pair = |i: usize, j: usize, border: bool| {
            if mask.valid[i] && mask.valid[j] {
                let of = if border { &mut self.across } else { &mut self.inside };
                of.sum += (0..3).map(|c| (error(j, c) - error(i, c)).abs()).sum::<f64>() / mean;
                of.count += 1.0;
            }
        };
        for y in 0..rows.len() {
            for x in 0..width {
                let i = y * width + x;
                if x + 1 < width {
                    pair(i, i + 1, (x + 1).is_multiple_of(PAYLOAD));
                }
                if y + 1 < height {
                    pair(i, i + width, (rows.start + y + 1).is_multiple_of(PAYLOAD));
                }
            }
        }
    }

    /// Mean error across borders over that inside; `None` without borders, or where nothing is wrong inside.
    pub(super) fn ratio(&self) -> Option<f64> {
        let defined = self.across.count > 0.0 && self.inside.sum > 0.0;
        defined.then(|| self.across.sum / self.across.count / (self.inside.sum / self.inside.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of ±`inside` in turn on a page of three tiles in a row, the second of them `seam` too bright;
    /// texel 5 is invalid.
    fn ratio(inside: f32, seam: f32) -> Option<f64> {
        let (width, height) = (3 * PAYLOAD, 8);
        let reference = Image { width, height, texels: vec![[2.0; 3]; width * height] };
        let texels = (0..width * height).map(|i| {
            let (x, y) = (i % width, i / width);
            let sign = if (x + y) % 2 == 0 { 1.0 } else { -1.0 };
            let tile = if x / PAYLOAD == 1 { seam } else { 0.0 };
            if i == 5 { [1e9; 3] } else { [2.0 + sign * inside + tile; 3] }
        });
        let decoded = Image { texels: texels.collect(), ..reference };
        let mask = Mask { width, height, valid: (0..width * height).map(|i| i != 5).collect() };
        let mut seams = Seams::default();
        seams.add(&decoded, &reference, &mask, &(0..height), 2.0);
        seams.add(&decoded, &reference, &mask, &(0..height), 0.0);
        seams.ratio()
    }

    #[test]
    fn a_page_in_strips_counts_every_step_once() {
        let (width, height) = (4, 2 * PAYLOAD);
        let value = |i: usize| [(i * i % 101) as f32; 3];
        let image = |texels| Image { width, height, texels };
        let reference = image(vec![[1.0; 3]; width * height]);
        let decoded = image((0..width * height).map(value).collect());
        let mask = Mask { width, height, valid: (0..width * height).map(|i| i % 7 != 0).collect() };
        let ratio = |strips: &[Range<usize>]| {
            let mut seams = Seams::default();
            for rows in strips {
                let texels = rows.start * width..(rows.end + 1).min(height) * width;
                let cut = |image: &Image| Image {
                    width,
                    height: texels.len() / width,
                    texels: image.texels[texels.clone()].to_vec(),
                };
                let valid = mask.valid[texels.clone()].to_vec();
                let mask = Mask { width, height: texels.len() / width, valid };
                seams.add(&cut(&decoded), &cut(&reference), &mask, rows, 1.0);
            }
            seams.ratio()
        };
        // One strip is the page as it is.
        let whole = ratio(std::slice::from_ref(&(0..height)));
        assert!(whole.is_some());
        assert_eq!(ratio(&[0..128, 128..height]), whole);
        assert_eq!(ratio(&[0..PAYLOAD, PAYLOAD..height]), whole);
    }

    #[test]
    fn a_tile_that_is_too_bright_shows_at_its_borders() {
        // Inside, neighbours differ by 2 · 0.125. At borders by that ± 1; the signs alternate from row to
        // row.
        assert_eq!(ratio(0.125, 0.0), Some(1.0));
        assert_eq!(ratio(0.125, 1.0), Some(4.0));
        assert_eq!(ratio(0.0, 1.0), None);
        assert_eq!(Seams::default().ratio(), None);
    }
}
