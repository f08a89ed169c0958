//! LPIPS (Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric") of one
//! tile, by a network that the user supplies as an ONNX file: two inputs of 1 × 3 × 128 × 128 values in [−1,
//! 1], one number out. `dataset/python/export_lpips.py` writes it from the authors' package.
//!
//! Builds with the feature `lpips` can run one; others say so when asked.

#[cfg(not(feature = "lpips"))]
mod absent;
#[cfg(feature = "lpips")]
mod network;

#[cfg(not(feature = "lpips"))]
use absent::Network;
#[cfg(feature = "lpips")]
use network::Network;

use super::TileQuality;
use crate::format::{Rect, TILE};
use crate::image::{Image, Mask};
use crate::{Error, Result};
use std::path::Path;

/// Values of an input: channel by channel, row by row.
const VALUES: usize = 3 * TILE * TILE;
/// What a network may give for equal images, which are at distance 0.
const ZERO: f64 = 1e-6;

/// A network that measures the perceptual distance of two tiles.
#[derive(Debug)]
pub struct Lpips {
    network: Network,
}

impl Lpips {
    /// Reads the network and checks its output on test images.
    ///
    /// # Errors
    /// [`Error::Unsupported`] in builds without the feature; [`Error::Io`]; [`Error::Invalid`] if the file is
    /// not such a network.
    pub fn load(path: &Path) -> Result<Self> {
        let lpips = Lpips { network: Network::load(path)? };
        let plain = |value: f32| vec![value; VALUES];
        let same = lpips.network.run(plain(0.0), plain(0.0))?;
        if same.is_nan() || same.abs() > ZERO {
            let what = format!("gives {same} for two equal images; expected 0, as LPIPS does");
            return Err(Error::invalid(path.display(), what));
        }
        let apart = lpips.network.run(plain(-0.5), plain(0.5))?;
        if apart.is_nan() || apart <= ZERO {
            let what = format!("gives {apart} for dark and bright; expected more than 0, as LPIPS does");
            return Err(Error::invalid(path.display(), what));
        }
        Ok(lpips)
    }

    /// The distance of a decoded tile from its reference, whose `quality` is known; `None` if that has no
    /// SSIM. Light is told in the tile's own range, linear; what is not valid is black in both, and so is
    /// what a small tile lacks of 128×128.
    ///
    /// # Errors
    /// [`Error::Invalid`] where the network gives no finite number.
    pub fn distance(
        &self,
        decoded: &Image,
        reference: &Image,
        mask: &Mask,
        tile: Rect,
        quality: &TileQuality,
    ) -> Result<Option<f64>> {
        if quality.ssim.is_none() {
            return Ok(None);
        }
        let [decoded, reference] = [decoded, reference].map(|image| input(image, mask, tile, quality));
        self.network.run(reference, decoded).map(Some)
    }
}

/// A tile as the network's input.
fn input(image: &Image, mask: &Mask, tile: Rect, quality: &TileQuality) -> Vec<f32> {
    let least = quality.peak - quality.range;
    let mut values = vec![-1.0; VALUES];
    for (y, row) in (tile.y0..tile.y1).enumerate() {
        for (x, column) in (tile.x0..tile.x1).enumerate() {
            let i = row * image.width + column;
            if mask.valid[i] {
                for (channel, &light) in image.texels[i].iter().enumerate() {
                    let share = (f64::from(light) - least) / quality.range;
                    values[channel * TILE * TILE + y * TILE + x] =
                        (2.0 * share - 1.0).clamp(-1.0, 1.0) as f32;
                }
            }
        }
    }
    values
}

#[cfg(test)]
#[path = "lpips_tests.rs"]
mod tests;
