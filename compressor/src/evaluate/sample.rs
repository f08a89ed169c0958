//! One tile of one frame: decoded and reference.

use super::rgbe::{from_rgbe, to_rgbe};
use crate::Result;
use crate::seen::{Errors, Figures, Pieces};
use dataset::format::tiles::{Rect, TILE, tiles};
use dataset::image::{Image, Mask};
use dataset::pictures::{Lpips, TileQuality, metrics};
use rayon::prelude::*;

/// One tile of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Index of the frame.
    pub frame: usize,
    /// Page.
    pub page: usize,
    /// The tile's texels.
    pub rect: Rect,
    /// Quality of the decoded tile.
    pub quality: TileQuality,
    /// PSNR (peak as in `quality.psnr_db`) after the 8-bit four-channel output.
    pub psnr_8bit_db: Option<f64>,
    /// The noise ceiling: the PSNR of the bake's own sampling error, if the dataset has it.
    pub noise_ceiling_db: Option<f64>,
    /// RMSE ÷ mean, as [`metrics::relative_error`].
    pub relative_error: f64,
    /// PSNR of the logarithm, as [`metrics::psnr_log_db`].
    pub psnr_log_db: Option<f64>,
    /// LPIPS, where there is a network for it.
    pub lpips: Option<f64>,
    /// HDR-ꟻLIP, where it is requested.
    pub flip: Option<f64>,
    /// Largest decoded value of a valid texel.
    pub largest: f32,
    /// What is seen of its errors; nothing of a black tile.
    pub seen: Figures,
}

/// Slow perceptual metrics, measured on request.
#[derive(Clone, Copy, Debug, Default)]
pub struct SlowMetrics<'a> {
    /// The network that LPIPS is measured by.
    pub lpips: Option<&'a Lpips>,
    /// Whether HDR-ꟻLIP is measured.
    pub flip: bool,
}

/// A strip of whole tiles of a page of a frame.
pub(crate) struct Strip<'a> {
    pub frame: usize,
    pub page: usize,
    /// The strip's first row on the page, a multiple of [`TILE`].
    pub row: usize,
    /// The strip's texels as they were decoded.
    pub decoded: &'a Image,
    /// As they should be.
    pub reference: &'a Image,
    /// Which of them count.
    pub mask: &'a Mask,
    /// Mean light of the page.
    pub page_mean: f64,
    /// The page's sampling error as a mean square per tile, where the dataset states it.
    pub noise: Option<&'a [f64]>,
    pub slow_metrics: SlowMetrics<'a>,
}

impl Strip<'_> {
    /// Its tiles that have a valid texel, row by row, whose errors are added to `errors`; their
    /// [`Sample::relative_error`], which takes the frame's mean, is 0. `least_floor` is the least floor of
    /// local light.
    pub(super) fn samples(&self, least_floor: f64, errors: &mut Errors) -> Result<Vec<Sample>> {
        let rects = tiles(self.mask.width, self.mask.height, TILE);
        let before = self.row / TILE * self.mask.width.div_ceil(TILE);
        let noise = |i: usize| self.noise.map(|tiles| tiles[before + i]);
        let judge = |(i, &rect): (usize, &Rect)| {
            let sample = self.sample(rect, noise(i))?;
            Ok((sample.quality.texels > 0).then(|| (sample, self.errors(rect, least_floor))))
        };
        let judged = rects.par_iter().enumerate().map(judge).collect::<Result<Vec<_>>>()?;
        let add = |(sample, of_tile): (Sample, Errors)| {
            errors.merge(&of_tile);
            Sample { seen: of_tile.figures(), ..sample }
        };
        Ok(judged.into_iter().flatten().map(add).collect())
    }

    /// What is seen of the errors of one of its tiles.
    fn errors(&self, rect: Rect, least_floor: f64) -> Errors {
        let texels = || rect.texels(self.mask.width);
        let valid: Vec<bool> = texels().map(|i| self.mask.valid[i]).collect();
        let [light, decoded] =
            [self.reference, self.decoded].map(|image| texels().map(|i| image.texels[i]).collect::<Vec<_>>());
        let mut errors = Errors::default();
        errors.add(&Pieces::new(rect.width(), &valid), &light, &decoded, least_floor);
        errors
    }

    /// One of its tiles, likewise, without what is seen of its errors; `noise` is its sampling error.
    pub(crate) fn sample(&self, rect: Rect, noise: Option<f64>) -> Result<Sample> {
        let Strip { decoded, reference, mask, .. } = self;
        let quality = metrics::compare(decoded, reference, mask, rect);
        let lpips = |lpips: &Lpips| lpips.distance(decoded, reference, mask, rect, &quality).transpose();
        Ok(Sample {
            frame: self.frame,
            page: self.page,
            rect: Rect { y0: rect.y0 + self.row, y1: rect.y1 + self.row, ..rect },
            quality,
            psnr_8bit_db: quality.psnr_db.map(|_| psnr_8bit_db(decoded, reference, mask, rect, &quality)),
            noise_ceiling_db: quality.psnr_db.and(noise.map(|mse| metrics::psnr_db(quality.peak, mse))),
            relative_error: 0.0,
            psnr_log_db: metrics::psnr_log_db(decoded, reference, mask, rect, self.page_mean),
            lpips: self.slow_metrics.lpips.and_then(lpips).transpose()?,
            flip: self
                .slow_metrics
                .flip
                .then(|| metrics::flip(decoded, reference, mask, rect, &quality))
                .flatten(),
            largest: rect.valid(mask).flat_map(|i| decoded.texels[i]).fold(0.0, f32::max),
            seen: Figures::default(),
        })
    }

    /// Its tiles of `side`² texels, a divisor of its height or more than that, that have a structure to
    /// compare.
    pub(crate) fn qualities(&self, side: usize) -> Vec<TileQuality> {
        let rects = tiles(self.mask.width, self.mask.height, side);
        let judge = |&rect: &Rect| metrics::compare(self.decoded, self.reference, self.mask, rect);
        rects.par_iter().map(judge).filter(|quality| quality.ssim.is_some()).collect()
    }
}

/// PSNR of a tile whose decoded texels went through [`to_rgbe`].
fn psnr_8bit_db(decoded: &Image, reference: &Image, mask: &Mask, rect: Rect, quality: &TileQuality) -> f64 {
    let mut squared_error = 0.0;
    for i in rect.valid(mask) {
        let texel = from_rgbe(to_rgbe(decoded.texels[i]));
        let error = |c: usize| f64::from(texel[c]) - f64::from(reference.texels[i][c]);
        squared_error += (0..3).map(|c| error(c) * error(c)).sum::<f64>();
    }
    metrics::psnr_db(quality.peak, squared_error / (3 * quality.texels) as f64)
}
