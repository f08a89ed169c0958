//! Structural similarity (Wang et al. 2004) of the valid texels of one tile.

use crate::format::Rect;
use crate::image::{Image, Mask};

/// Standard deviation of the Gaussian window, in texels.
const SIGMA: f64 = 1.5;

/// Mean over channels and valid texels of the tile, windows cut at the tile's edge and weighted by the mask.
/// `window` holds the weights along one axis, which are symmetric and of sum one. The tile holds a valid
/// texel and `range > 0`.
pub(super) fn masked<const TAPS: usize>(
    window: [f64; TAPS],
    decoded: &Image,
    reference: &Image,
    mask: &Mask,
    tile: Rect,
    range: f64,
) -> f64 {
    let (width, height) = (tile.width(), tile.height());
    // Index in the page of each texel of the tile, row by row.
    let in_page = || tile.texels(mask.width);
    let valid: Vec<bool> = in_page().map(|texel| mask.valid[texel]).collect();
    let mut blur = Blur::new(window, width, height);

    // W = G ∗ m, the weight of each window.
    let mut weight: Vec<f64> = valid.iter().map(|&valid| f64::from(u8::from(valid))).collect();
    blur.apply(&mut weight);

    // With s = x + y and d = x − y:  σx² + σy² = (σs² + σd²) ÷ 2,  2 σxy = (σs² − σd²) ÷ 2,
    // which spares one product, and keeps σd² exact where x and y nearly agree.
    let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
    let (mut sum, mut texels) = (0.0, 0usize);
    let field = || vec![0.0f64; width * height];
    let (mut s1, mut d1, mut s2, mut d2) = (field(), field(), field(), field());
    for channel in 0..3 {
        // Values in units of the range, so that C₁ and C₂ have no unit; s about the tile's first valid value,
        // as variances do not depend on it and lose fewer digits near it.
        let mut first = None;
        for (index, texel) in in_page().enumerate() {
            if !valid[index] {
                (s1[index], d1[index], s2[index], d2[index]) = (0.0, 0.0, 0.0, 0.0);
                continue;
            }
            let x = f64::from(decoded.texels[texel][channel]) / range;
            let y = f64::from(reference.texels[texel][channel]) / range;
            let s = x + y - *first.get_or_insert(2.0 * y);
            let d = x - y;
            (s1[index], d1[index], s2[index], d2[index]) = (s, d, s * s, d * d);
        }
        let offset = first.unwrap_or(0.0);
        for field in [&mut s1, &mut d1, &mut s2, &mut d2] {
            blur.apply(field);
        }
        for index in (0..width * height).filter(|&index| valid[index]) {
            let w = 1.0 / weight[index];
            let (s, d) = (s1[index] * w, d1[index] * w);
            let variance_s = (s2[index] * w - s * s).max(0.0);
            let variance_d = (d2[index] * w - d * d).max(0.0);
            // Means of x and y, with the offset of s put back.
            let (x, y) = ((s + offset + d) / 2.0, (s + offset - d) / 2.0);
            let luminance = (2.0 * x * y + c1) / (x * x + y * y + c1);
            let structure = ((variance_s - variance_d) / 2.0 + c2) / ((variance_s + variance_d) / 2.0 + c2);
            sum += luminance * structure;
            texels += 1;
        }
    }
    sum / texels as f64
}

/// Wang et al.'s window of 11×11 texels.
pub(super) fn gaussian() -> [f64; 11] {
    let weights: [f64; 11] =
        std::array::from_fn(|tap| (-(tap as f64 - 5.0).powi(2) / (2.0 * SIGMA * SIGMA)).exp());
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// A 7×7 box window.
pub(super) fn uniform() -> [f64; 7] {
    [1.0 / 7.0; 7]
}

/// A separable filter over fields of one size; what lies outside counts as zero.
struct Blur<const TAPS: usize> {
    window: [f64; TAPS],
    width: usize,
    height: usize,
    /// One row with half a window of zeros before and after it.
    padded_row: Vec<f64>,
    /// The field filtered along its rows, with as many rows of zeros above and below it.
    padded_rows: Vec<f64>,
}

impl<const TAPS: usize> Blur<TAPS> {
    /// Half the window, its middle omitted.
    const RADIUS: usize = TAPS / 2;

    fn new(window: [f64; TAPS], width: usize, height: usize) -> Self {
        let padded_row = vec![0.0; width + 2 * Self::RADIUS];
        let padded_rows = vec![0.0; width * (height + 2 * Self::RADIUS)];
        Blur { window, width, height, padded_row, padded_rows }
    }

    fn apply(&mut self, field: &mut [f64]) {
        let width = self.width;
        // Along each row.
        for y in 0..self.height {
            self.padded_row[Self::RADIUS..Self::RADIUS + width]
                .copy_from_slice(&field[y * width..(y + 1) * width]);
            let shifted: [&[f64]; TAPS] = std::array::from_fn(|tap| &self.padded_row[tap..tap + width]);
            let start = (y + Self::RADIUS) * width;
            weighted_sum(&mut self.padded_rows[start..start + width], shifted, &self.window);
        }
        // Across rows.
        for (y, out) in field.chunks_exact_mut(width).enumerate() {
            let rows = |tap: usize| &self.padded_rows[(y + tap) * width..(y + tap + 1) * width];
            weighted_sum(out, std::array::from_fn(rows), &self.window);
        }
    }
}

/// `out[i] = Σ window[k] · inputs[k][i]`, the window being symmetric.
fn weighted_sum<const TAPS: usize>(out: &mut [f64], inputs: [&[f64]; TAPS], window: &[f64; TAPS]) {
    let middle = TAPS / 2;
    let inputs = inputs.map(|input| &input[..out.len()]);
    for (i, out) in out.iter_mut().enumerate() {
        let mut sum = window[middle] * inputs[middle][i];
        for tap in 0..middle {
            sum += window[tap] * (inputs[tap][i] + inputs[TAPS - 1 - tap][i]);
        }
        *out = sum;
    }
}
