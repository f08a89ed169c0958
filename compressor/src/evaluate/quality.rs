//! Means over samples.

use super::sample::Sample;
use crate::mean::mean;
use crate::seen::Figures;
use dataset::pictures::metrics;

/// Means over samples, for all frames or for one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Mean PSNR; peak = the sample's largest valid value.
    pub psnr_db: Option<f64>,
    /// Mean PSNR with peak = largest − smallest.
    pub psnr_range_db: Option<f64>,
    /// `−10 log₁₀` of the mean over valid texels of the squared error ÷ peak²: bad samples count in full.
    pub psnr_pooled_db: Option<f64>,
    /// Mean PSNR after the 8-bit four-channel output ([`super::to_rgbe`]).
    pub psnr_8bit_db: Option<f64>,
    /// Mean PSNR of the logarithm ([`metrics::psnr_log_db`]): sensitive to errors in the dark.
    pub psnr_log_db: Option<f64>,
    /// Mean noise ceiling.
    pub noise_ceiling_db: Option<f64>,
    /// Mean PSNR of the worst 1 % of the samples (at least one).
    pub psnr_worst_percent_db: Option<f64>,
    /// 1 − mean structural similarity.
    pub one_minus_ssim: Option<f64>,
    /// The same with a 7×7 box window.
    pub one_minus_ssim_uniform: Option<f64>,
    /// Mean LPIPS; `None` without a network.
    pub lpips: Option<f64>,
    /// Mean HDR-ꟻLIP; `None` if it is not requested.
    pub flip: Option<f64>,
    /// Mean relative error.
    pub relative_error: Option<f64>,
    /// Relative error over the darkest quarter of the valid texels of a frame; the mean over frames.
    pub dark_relative_error: Option<f64>,
    /// What is seen of the errors of all texels but those of black samples.
    pub seen: Figures,
    /// Samples behind the means above.
    pub samples: usize,
    /// Samples constant in space, not among them.
    pub constant: usize,
    /// Mean relative error of those.
    pub constant_relative_error: Option<f64>,
    /// Samples that are all zero, not among them.
    pub black: usize,
    /// Largest decoded value of black samples (ideally 0).
    pub black_largest_error: f64,
}

/// The means over samples; without the error in the dark, which is a frame's, and without what is seen, which
/// is the texels'.
pub(crate) fn quality<'a>(samples: impl Iterator<Item = &'a Sample>) -> Quality {
    let (black, lit): (Vec<&Sample>, Vec<&Sample>) =
        samples.partition(|sample| sample.quality.psnr_db.is_none());
    let (constant, judged): (Vec<&Sample>, Vec<&Sample>) =
        lit.into_iter().partition(|sample| sample.quality.constant);
    let over =
        |value: &dyn Fn(&Sample) -> Option<f64>| mean(judged.iter().filter_map(|sample| value(sample)));
    // Pooled: the mean over texels of the error relative to the sample's peak.
    let texels: usize = judged.iter().map(|sample| sample.quality.texels).sum();
    let error = |s: &&Sample| s.quality.squared_error / 3.0 / (s.quality.peak * s.quality.peak);
    let pooled = judged.iter().map(error).sum::<f64>() / texels as f64;
    let mut worst: Vec<f64> = judged.iter().filter_map(|sample| sample.quality.psnr_db).collect();
    worst.sort_by(f64::total_cmp);
    worst.truncate(worst.len().div_ceil(100));
    let largest = black.iter().map(|sample| f64::from(sample.largest)).fold(0.0, f64::max);
    Quality {
        psnr_db: over(&|s| s.quality.psnr_db),
        psnr_range_db: over(&|s| s.quality.psnr_range_db),
        psnr_pooled_db: (texels > 0).then(|| metrics::psnr_db(1.0, pooled)),
        psnr_8bit_db: over(&|s| s.psnr_8bit_db),
        psnr_log_db: over(&|s| s.psnr_log_db),
        noise_ceiling_db: over(&|s| s.noise_ceiling_db),
        psnr_worst_percent_db: mean(worst.into_iter()),
        one_minus_ssim: over(&|s| s.quality.ssim.map(|ssim| 1.0 - ssim)),
        one_minus_ssim_uniform: over(&|s| s.quality.ssim_uniform.map(|ssim| 1.0 - ssim)),
        lpips: over(&|s| s.lpips),
        flip: over(&|s| s.flip),
        relative_error: over(&|s| Some(s.relative_error)),
        dark_relative_error: None,
        seen: Figures::default(),
        samples: judged.len(),
        constant: constant.len(),
        constant_relative_error: mean(constant.iter().map(|sample| sample.relative_error)),
        black: black.len(),
        black_largest_error: largest,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::format::Rect;
    use dataset::pictures::TileQuality;

    fn sample(texels: usize, mse: f64, peak: f64, constant: bool) -> Sample {
        let psnr = (peak > 0.0).then(|| metrics::psnr_db(peak, mse));
        Sample {
            frame: 0,
            page: 0,
            rect: Rect { x0: 0, y0: 0, x1: 1, y1: 1 },
            quality: TileQuality {
                texels,
                squared_error: 3.0 * texels as f64 * mse,
                peak,
                range: if constant { 0.0 } else { peak },
                mean: peak / 2.0,
                constant,
                psnr_db: psnr,
                psnr_range_db: psnr.filter(|_| !constant),
                ssim: psnr.filter(|_| !constant).map(|_| 0.9),
                ssim_uniform: psnr.filter(|_| !constant).map(|_| 0.8),
            },
            psnr_8bit_db: psnr,
            noise_ceiling_db: None,
            relative_error: mse.sqrt(),
            psnr_log_db: psnr.map(|db| db - 3.0),
            lpips: psnr.map(|db| db / 100.0),
            flip: psnr.map(|db| db / 200.0),
            largest: 2.0 * mse.sqrt() as f32,
            seen: Figures::default(),
        }
    }

    #[test]
    fn constant_and_black_tiles_stand_apart_and_pooling_weighs_errors() {
        let samples = [
            sample(100, 1e-4, 1.0, false),
            sample(300, 1e-2, 1.0, false),
            sample(50, 1e-6, 1.0, true),
            sample(9, 0.0, 0.0, true),
        ];
        let q = quality(samples.iter());
        assert_eq!((q.samples, q.constant, q.black), (2, 1, 1));
        assert!((q.psnr_db.unwrap() - 30.0).abs() < 1e-9, "mean of 40 and 20 dB");
        let pooled: f64 = (100.0 * 1e-4 + 300.0 * 1e-2) / 400.0;
        assert!((q.psnr_pooled_db.unwrap() + 10.0 * pooled.log10()).abs() < 1e-9);
        assert!((q.psnr_worst_percent_db.unwrap() - 20.0).abs() < 1e-9);
        assert!((q.constant_relative_error.unwrap() - 1e-3).abs() < 1e-12);
        assert!((q.one_minus_ssim.unwrap() - 0.1).abs() < 1e-12);
        assert!((q.one_minus_ssim_uniform.unwrap() - 0.2).abs() < 1e-12);
        assert!((q.psnr_log_db.unwrap() - 27.0).abs() < 1e-9);
        assert!((q.lpips.unwrap() - 0.3).abs() < 1e-9 && (q.flip.unwrap() - 0.15).abs() < 1e-9);
        assert_eq!(q.noise_ceiling_db, None);
        assert_eq!(quality([].iter()), Quality::default());
    }
}
