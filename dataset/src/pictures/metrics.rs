//! Quality metrics of the paper's protocol: per tile, valid texels only, linear RGB.
//!
//! The protocol (NDGI, "Dataset Evaluation"): every lightmap is cut into 128×128 tiles
//! ([`crate::format::TILE`]), each metric is computed inside the mask with the tile's own dynamic range, and
//! averaged over all tiles of all frames.

use crate::format::Rect;
use crate::image::{Image, Mask};

mod dark;
mod flip;
mod lpips;
mod ssim;
mod picture;
mod steps;

pub use dark::{Brightnesses, psnr_log_db};
pub use flip::flip;
pub use lpips::Lpips;
pub use picture::{PictureQuality, compare_pictures};
pub use steps::StepError;

/// Cap of PSNR in dB: an exact tile has no finite one.
pub const PSNR_CAP_DB: f64 = 100.0;

/// Means below this share of their frame's mean are floored there by [`relative_error`].
pub const RELATIVE_FLOOR: f64 = 1e-3;

/// Quality of one tile of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TileQuality {
    /// Valid texels.
    pub texels: usize,
    /// Sum over valid texels and channels of the squared error.
    pub squared_error: f64,
    /// Largest valid value of the reference: the peak of `psnr_db`.
    pub peak: f64,
    /// Largest − smallest valid value of the reference.
    pub range: f64,
    /// Mean valid value of the reference, over texels and channels.
    pub mean: f64,
    /// True where every channel of the reference has one value at all valid texels (also with one or no valid
    /// texel).
    pub constant: bool,
    /// 10 log₁₀(peak² ÷ MSE), joint over RGB, capped; `None` for a tile that is all zero or has no valid
    /// texel.
    pub psnr_db: Option<f64>,
    /// The same with `range` for peak; `None` besides where the reference is constant.
    pub psnr_range_db: Option<f64>,
    /// Structural similarity (11×11 Gaussian, σ 1.5, range = max − min, mean over channels and valid texels);
    /// `None` as `psnr_range_db`. Windows are cut at the tile's edge; invalid texels weigh nothing, and the
    /// weights of the rest are scaled to a sum of one; windows stand at valid texels. C₁ = (0.01 · range)²,
    /// C₂ = (0.03 · range)².
    pub ssim: Option<f64>,
    /// The same with a 7×7 box window.
    pub ssim_uniform: Option<f64>,
}

impl TileQuality {
    /// Mean squared error over valid texels and channels; 0 without valid texels.
    pub fn mse(&self) -> f64 {
        if self.texels == 0 { 0.0 } else { self.squared_error / (3 * self.texels) as f64 }
    }
}

/// 10 log₁₀(peak² ÷ mse), at most [`PSNR_CAP_DB`]. A squared error that is not a number stays one.
pub fn psnr_db(peak: f64, mse: f64) -> f64 {
    if mse.is_nan() {
        return f64::NAN;
    }
    if mse <= 0.0 {
        return PSNR_CAP_DB;
    }
    (10.0 * (peak * peak / mse).log10()).min(PSNR_CAP_DB)
}

/// The relative error, defined here for all crates: RMSE ÷ mean over valid texels, a mean below
/// [`RELATIVE_FLOOR`] of its frame's mean being floored there. 0 for an exact black frame; infinite for an
/// error where the whole frame is black.
pub fn relative_error(mse: f64, mean: f64, set_mean: f64) -> f64 {
    let floored = mean.max(RELATIVE_FLOOR * set_mean);
    if mse == 0.0 { 0.0 } else { mse.sqrt() / floored }
}

/// Sum over valid texels and channels, and the number of valid texels. The mean of a frame is the sum over
/// its pages ÷ (3 · texels).
pub fn valid_sum(texels: &[[f32; 3]], valid: &[bool]) -> (f64, usize) {
    let texels = texels.iter().zip(valid).filter(|(_, valid)| **valid);
    texels.fold((0.0, 0), |(sum, count), (texel, _)| {
        (sum + texel.iter().map(|&v| f64::from(v)).sum::<f64>(), count + 1)
    })
}

/// Compares one tile. `decoded` and `reference` have the page's size.
pub fn compare(decoded: &Image, reference: &Image, mask: &Mask, tile: Rect) -> TileQuality {
    let (mut texels, mut squared_error, mut sum) = (0usize, 0.0f64, 0.0f64);
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for index in tile.valid(mask) {
        texels += 1;
        for channel in 0..3 {
            let value = reference.texels[index][channel];
            let error = f64::from(decoded.texels[index][channel]) - f64::from(value);
            squared_error += error * error;
            sum += f64::from(value);
            low[channel] = low[channel].min(value);
            high[channel] = high[channel].max(value);
        }
    }
    if texels == 0 {
        return TileQuality { constant: true, ..TileQuality::default() };
    }
    let samples = (3 * texels) as f64;
    let mse = squared_error / samples;
    let peak = f64::from(high[0].max(high[1]).max(high[2]));
    let range = peak - f64::from(low[0].min(low[1]).min(low[2]));
    let constant = low == high;
    let psnr = (peak > 0.0).then(|| psnr_db(peak, mse));
    let varies = peak > 0.0 && !constant;
    TileQuality {
        texels,
        squared_error,
        peak,
        range,
        mean: sum / samples,
        constant,
        psnr_db: psnr,
        psnr_range_db: varies.then(|| psnr_db(range, mse)),
        ssim: varies.then(|| ssim::masked(ssim::gaussian(), decoded, reference, mask, tile, range)),
        ssim_uniform: varies.then(|| ssim::masked(ssim::uniform(), decoded, reference, mask, tile, range)),
    }
}
