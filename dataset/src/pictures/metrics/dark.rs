//! Metrics of errors in the dark, to which a PSNR (peak = the brightest texel) is insensitive.

use super::{RELATIVE_FLOOR, psnr_db, relative_error};
use crate::format::Rect;
use crate::image::{Image, Mask};

/// The PSNR of `ln(1 + E/ε)` of a tile, joint over RGB, capped like any; ε is [`RELATIVE_FLOOR`] ·
/// `page_mean`, the peak that of the tile's largest valid value. Equal ratios weigh the same at all
/// brightnesses far above ε. `page_mean` is that of the page's valid values in this frame. `None` for a tile
/// that is all zero or has no valid texel.
pub fn psnr_log_db(
    decoded: &Image,
    reference: &Image,
    mask: &Mask,
    tile: Rect,
    page_mean: f64,
) -> Option<f64> {
    let floor = RELATIVE_FLOOR * page_mean;
    let log = |value: f32| (f64::from(value) / floor).ln_1p();
    let (mut texels, mut squared_error, mut peak) = (0usize, 0.0f64, 0.0f64);
    for index in tile.valid(mask) {
        texels += 1;
        for (&a, &b) in decoded.texels[index].iter().zip(&reference.texels[index]) {
            let wanted = log(b);
            squared_error += (log(a) - wanted).powi(2);
            peak = peak.max(wanted);
        }
    }
    (peak > 0.0).then(|| psnr_db(peak, squared_error / (3 * texels) as f64))
}

/// The valid texels of one frame, gathered page by page.
#[derive(Debug, Default)]
pub struct Brightnesses {
    /// Reference value and squared error of a texel, both means over RGB.
    texels: Vec<(f32, f64)>,
}

impl Brightnesses {
    /// Adds a page. `decoded` and `reference` have the mask's size.
    pub fn add(&mut self, decoded: &Image, reference: &Image, mask: &Mask) {
        let texels = decoded.texels.iter().zip(&reference.texels).zip(&mask.valid);
        self.texels.extend(texels.filter(|(_, valid)| **valid).map(|((decoded, reference), _)| {
            let error = |c: usize| (f64::from(decoded[c]) - f64::from(reference[c])).powi(2);
            let mean = reference.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
            (mean as f32, (0..3).map(error).sum::<f64>() / 3.0)
        }));
    }

    /// The [`relative_error`] over the frame's darkest quarter: the texels no brighter than its lower
    /// quartile. `frame_mean` is that of all valid values; `None` if it is 0, or without texels.
    pub fn dark_relative_error(mut self, frame_mean: f64) -> Option<f64> {
        if self.texels.is_empty() || frame_mean == 0.0 {
            return None;
        }
        let quarter = (self.texels.len() - 1) / 4;
        let (_, &mut (quartile, _), _) =
            self.texels.select_nth_unstable_by(quarter, |a, b| a.0.total_cmp(&b.0));
        // In their own order, whatever the selection did to equal ones.
        self.texels.retain(|(brightness, _)| *brightness <= quartile);
        self.texels.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let n = self.texels.len() as f64;
        let (sum, squared) =
            self.texels.iter().fold((0.0, 0.0), |(s, e), (b, error)| (s + f64::from(*b), e + error));
        Some(relative_error(squared / n, sum / n, frame_mean))
    }
}
