//! Quality of a bundle against its dataset by the paper's protocol.
//!
//! Every set is decoded at its hour and compared on 128×128 tiles from texel (0, 0) of each page (not the bundle's, which own 126×126), valid texels only, linear RGB
//! ([`dataset::metrics`]). A *sample* is one (tile, set). Samples of a tile that is all zero or has no valid texel are skipped;
//! those whose reference is constant in space have no dynamic range and are judged by relative error, apart from the rest.

mod strips;
mod seams;
mod steps;
mod between;
mod table;

pub use between::Between;
pub use steps::{Step, Steps};
pub(crate) use strips::{read, strips, valid};
pub use table::COLUMNS;
pub(crate) use table::{aligned, cell};

use crate::decode::Decoder;
use crate::mean::mean;
use crate::{Error, Result};
use dataset::console::{Console, stop_if_interrupted};
use dataset::image::{Image, Mask};
use dataset::metrics::{self, Brightnesses, Lpips, TileQuality};
use dataset::store::Dataset;
use dataset::tiles::{Rect, TILE, tiles};
use rayon::prelude::*;
use seams::Seams;
use std::ops::Range;

/// Side of the large tiles that quality is told of too.
pub const LARGE: usize = 2 * TILE;

/// One tile of one set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Index of the set.
    pub set: usize,
    /// Page.
    pub page: usize,
    /// The tile's texels.
    pub rect: Rect,
    /// How the decoded tile compares.
    pub quality: TileQuality,
    /// PSNR (peak as in `quality.psnr_db`) after the 8-bit four-channel output.
    pub psnr_8bit_db: Option<f64>,
    /// The PSNR that the bake's own sampling error allows, where the dataset states it.
    pub noise_ceiling_db: Option<f64>,
    /// RMSE ÷ mean, as [`metrics::relative_error`].
    pub relative_error: f64,
    /// PSNR of the logarithm, as [`metrics::psnr_log_db`].
    pub psnr_log_db: Option<f64>,
    /// LPIPS, where there is a network for it.
    pub lpips: Option<f64>,
    /// Largest decoded value of a valid texel.
    pub largest: f32,
}

/// Means over samples, for all sets or for one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Mean PSNR; peak = the sample's largest valid value.
    pub psnr_db: Option<f64>,
    /// Mean PSNR with peak = largest − smallest.
    pub psnr_range_db: Option<f64>,
    /// `−10 log₁₀` of the mean over valid texels of the squared error ÷ peak²: bad samples weigh as much as they are bad.
    pub psnr_pooled_db: Option<f64>,
    /// Mean PSNR after the 8-bit four-channel output ([`to_rgbe`]).
    pub psnr_8bit_db: Option<f64>,
    /// Mean PSNR of the logarithm ([`metrics::psnr_log_db`]): sees errors in the dark.
    pub psnr_log_db: Option<f64>,
    /// Mean noise ceiling.
    pub noise_ceiling_db: Option<f64>,
    /// Mean PSNR of the worst 1 % of the samples (at least one).
    pub psnr_worst_percent_db: Option<f64>,
    /// 1 − mean structural similarity.
    pub one_minus_ssim: Option<f64>,
    /// The same with windows of 7×7 texels that count alike.
    pub one_minus_ssim_uniform: Option<f64>,
    /// Mean LPIPS; `None` without a network.
    pub lpips: Option<f64>,
    /// Mean relative error.
    pub relative_error: Option<f64>,
    /// Relative error over the darkest quarter of the valid texels of a set; the mean over sets.
    pub dark_relative_error: Option<f64>,
    /// Samples behind the means above.
    pub samples: usize,
    /// Samples constant in space, not among them.
    pub constant: usize,
    /// Mean relative error of those.
    pub constant_relative_error: Option<f64>,
    /// Samples that are all zero, not among them.
    pub black: usize,
    /// Largest value that decoded black samples hold (they should hold none).
    pub black_largest_error: f64,
}

/// Means over (large tile, set), of those that are neither black nor constant in space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Large {
    /// Mean PSNR; peak = the tile's largest valid value.
    pub psnr_db: Option<f64>,
    /// Mean PSNR with peak = largest − smallest.
    pub psnr_range_db: Option<f64>,
    /// 1 − mean structural similarity.
    pub one_minus_ssim: Option<f64>,
}

/// A bundle's quality.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// Every (tile, set) that has a valid texel, set by set, page by page, row by row.
    pub samples: Vec<Sample>,
    /// Over all sets.
    pub all: Quality,
    /// Per set: hour and quality.
    pub by_hour: Vec<(f64, Quality)>,
    /// Over the sets that differ: nights under the same lamps are one image, which `all` counts once per set.
    pub distinct: Quality,
    /// How many sets differ.
    pub distinct_sets: usize,
    /// Over all sets, on tiles of [`LARGE`]² texels.
    pub large: Large,
    /// How well the change from set to set is met.
    pub steps: Steps,
    /// Length of the bundle file × 8 ÷ (texels of all pages × sets), texels without a surface included.
    pub bpp: f64,
    /// Bytes of the bundle file.
    pub bytes: u64,
    /// Mean error of the step from a texel to its neighbour across borders of the bundle's tiles, over that inside tiles, each
    /// page and set weighted by 1 ÷ its mean. 1 where tiles do not show; `None` where there are no borders, or no errors inside.
    pub seam_ratio: Option<f64>,
    /// Quality between the sets, where light is interpolated anywhere.
    pub between: Option<Between>,
    /// Wall-clock seconds of decoding alone.
    pub decode_seconds: f64,
}

/// What is judged by besides the dataset.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measures<'a> {
    /// A bake of the same scene at other hours: between the sets it is the truth.
    pub withheld: Option<&'a Dataset>,
    /// The network that LPIPS is measured by.
    pub lpips: Option<&'a Lpips>,
}

/// Decodes every set of `decoder`'s bundle and compares it with `dataset`.
///
/// # Errors
/// [`Error::Invalid`] where the bundle's pages or hours are not the dataset's, or either is damaged; [`Error::Io`];
/// [`Error::Interrupted`].
pub fn evaluate(
    dataset: &Dataset,
    decoder: &Decoder,
    measures: Measures,
    console: &Console,
) -> Result<Evaluation> {
    let bundle = decoder.bundle();
    check_match(dataset, decoder)?;
    let noise = dataset.noise()?;
    let masks = (0..dataset.config.pages.len()).map(|page| dataset.mask(page)).collect::<Result<Vec<_>>>()?;
    let sets = &dataset.config.sets;
    let progress = console.progress("evaluating", (sets.len() * masks.len()) as u64);
    let mut samples = Vec::new();
    let mut large: Vec<TileQuality> = Vec::new();
    let mut decode_seconds = 0.0;
    let mut seams = Seams::default();
    let mut dark: Vec<Option<f64>> = Vec::with_capacity(sets.len());
    let strips: Vec<_> = masks.iter().map(strips).collect();
    for (k, set) in sets.iter().enumerate() {
        let first = samples.len();
        let (mut sum, mut texels) = (0.0, 0);
        let mut brightnesses = Brightnesses::default();
        for (page, mask) in masks.iter().enumerate() {
            let mut references = References { dataset, set: k, page, height: mask.height, last: None };
            // The mean first: it is the unit of what follows.
            let (mut page_sum, mut page_texels) = (0.0, 0);
            for rows in &strips[page] {
                stop_if_interrupted()?;
                let (sum, texels) = metrics::valid_sum(&references.read(rows)?.texels, valid(mask, rows));
                page_sum += sum;
                page_texels += texels;
            }
            dataset.check_content(&set.maps[page].file)?;
            let page_mean = if page_texels == 0 { 0.0 } else { page_sum / (3 * page_texels) as f64 };
            let noise = noise.as_ref().map(|noise| &noise.mse[k][page]);
            for rows in &strips[page] {
                stop_if_interrupted()?;
                // With the row below, for the step across.
                let more = rows.start..(rows.end + 1).min(mask.height);
                let mut reference = references.take(rows)?;
                let start = std::time::Instant::now();
                let mut decoded = decoder.decode_rows(page, set.hour, more.clone())?;
                decode_seconds += start.elapsed().as_secs_f64();
                let mut mask = strips::cut(mask, &more);
                seams.add(&decoded, &reference, &mask, rows, page_mean);
                for image in [&mut reference, &mut decoded] {
                    image.height = rows.len();
                    image.texels.truncate(rows.len() * image.width);
                }
                mask.height = rows.len();
                mask.valid.truncate(rows.len() * mask.width);
                let judge = |&rect: &Rect| metrics::compare(&decoded, &reference, &mask, rect);
                let rects = tiles(mask.width, mask.height, LARGE);
                large.par_extend(rects.par_iter().map(judge).filter(|quality| quality.ssim.is_some()));
                let rects = tiles(mask.width, mask.height, TILE);
                let before = rows.start / TILE * mask.width.div_ceil(TILE);
                let sample = |(i, &rect): (usize, &Rect)| {
                    let quality = judge(&rect);
                    let ceiling = |mse: f64| metrics::psnr_db(quality.peak, mse);
                    let lpips = |lpips: &Lpips| {
                        lpips.distance(&decoded, &reference, &mask, rect, &quality).transpose()
                    };
                    Ok(Sample {
                        set: k,
                        page,
                        rect: Rect { y0: rect.y0 + rows.start, y1: rect.y1 + rows.start, ..rect },
                        quality,
                        psnr_8bit_db: quality
                            .psnr_db
                            .map(|_| psnr_8bit_db(&decoded, &reference, &mask, rect, &quality)),
                        noise_ceiling_db: quality.psnr_db.and(noise.map(|tiles| ceiling(tiles[before + i]))),
                        relative_error: 0.0,
                        psnr_log_db: metrics::psnr_log_db(&decoded, &reference, &mask, rect, page_mean),
                        lpips: measures.lpips.and_then(lpips).transpose()?,
                        largest: largest(&decoded, &mask, rect),
                    })
                };
                let judged = rects.par_iter().enumerate().map(sample).collect::<Result<Vec<_>>>()?;
                samples.extend(judged.into_iter().filter(|sample| sample.quality.texels > 0));
                brightnesses.add(&decoded, &reference, &mask);
            }
            sum += page_sum;
            texels += page_texels;
            progress.advance(1);
        }
        let set_mean = if texels == 0 { 0.0 } else { sum / (3 * texels) as f64 };
        for sample in &mut samples[first..] {
            sample.relative_error =
                metrics::relative_error(sample.quality.mse(), sample.quality.mean, set_mean);
        }
        dark.push(brightnesses.dark_relative_error(set_mean));
    }
    // The quality over some of the sets.
    let over = |wanted: &dyn Fn(usize) -> bool| Quality {
        dark_relative_error: mean((0..sets.len()).filter(|&k| wanted(k)).filter_map(|k| dark[k])),
        ..quality(samples.iter().filter(|sample| wanted(sample.set)))
    };
    let texels: u64 =
        dataset.config.pages.iter().map(|page| u64::from(page.width) * u64::from(page.height)).sum();
    let files = |k: usize| sets[k].maps.iter().map(|map| &map.file.blake3).collect::<Vec<_>>();
    let mut seen = std::collections::BTreeSet::new();
    let firsts: Vec<usize> = (0..sets.len()).filter(|&k| seen.insert(files(k))).collect();
    Ok(Evaluation {
        all: over(&|_| true),
        by_hour: sets.iter().enumerate().map(|(k, set)| (set.hour, over(&|of| of == k))).collect(),
        distinct: over(&|k| firsts.binary_search(&k).is_ok()),
        distinct_sets: firsts.len(),
        large: Large {
            psnr_db: mean(large.iter().filter_map(|quality| quality.psnr_db)),
            psnr_range_db: mean(large.iter().filter_map(|quality| quality.psnr_range_db)),
            one_minus_ssim: mean(large.iter().filter_map(|quality| quality.ssim)).map(|ssim| 1.0 - ssim),
        },
        steps: steps::steps(dataset, decoder, console)?,
        bpp: bundle.bytes as f64 * 8.0 / (texels as f64 * sets.len() as f64),
        bytes: bundle.bytes,
        seam_ratio: seams.ratio(),
        between: between::between(dataset, measures.withheld, decoder, console)?,
        decode_seconds,
        samples,
    })
}

/// One page of one set by strips, each with the row below it where there is one. The last one read is kept: a page of one strip is
/// read once.
struct References<'a> {
    dataset: &'a Dataset,
    set: usize,
    page: usize,
    height: usize,
    last: Option<(usize, Image)>,
}

impl References<'_> {
    fn read(&mut self, rows: &Range<usize>) -> Result<&Image> {
        let last = self.take(rows)?;
        Ok(&self.last.insert((rows.start, last)).1)
    }

    fn take(&mut self, rows: &Range<usize>) -> Result<Image> {
        match self.last.take() {
            Some((first, image)) if first == rows.start => Ok(image),
            _ => {
                let more = rows.start..(rows.end + 1).min(self.height);
                strips::read(self.dataset, self.set, self.page, &more)
            }
        }
    }
}

/// An error unless the bundle has the dataset's pages and hours.
fn check_match(dataset: &Dataset, decoder: &Decoder) -> Result<()> {
    let header = &decoder.bundle().header;
    let pages = |size: (usize, usize)| format!("{} × {}", size.0, size.1);
    let bundle_pages: Vec<_> = header.pages.iter().map(|page| pages((page.width, page.height))).collect();
    let config = &dataset.config;
    let dataset_pages: Vec<_> =
        config.pages.iter().map(|page| pages((page.width as usize, page.height as usize))).collect();
    let hours: Vec<f64> = config.sets.iter().map(|set| set.hour).collect();
    let differs = |what, bundle: &dyn std::fmt::Debug, dataset_has: &dyn std::fmt::Debug| {
        let text =
            format!("has {what} {bundle:?}; the dataset {} has {dataset_has:?}", dataset.root.display());
        Err(Error::invalid(format!("bundle of scene {}", header.scene), text))
    };
    if bundle_pages != dataset_pages {
        return differs("pages", &bundle_pages, &dataset_pages);
    }
    if header.timeline.hours != hours {
        return differs("hours", &header.timeline.hours, &hours);
    }
    Ok(())
}

/// The means over samples; without the error in the dark, which is a set's.
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
        relative_error: over(&|s| Some(s.relative_error)),
        dark_relative_error: None,
        samples: judged.len(),
        constant: constant.len(),
        constant_relative_error: mean(constant.iter().map(|sample| sample.relative_error)),
        black: black.len(),
        black_largest_error: largest,
    }
}

/// Largest value of a tile's valid texels.
fn largest(image: &Image, mask: &Mask, rect: Rect) -> f32 {
    let texels = (rect.y0..rect.y1).flat_map(|y| y * mask.width + rect.x0..y * mask.width + rect.x1);
    texels.filter(|&i| mask.valid[i]).flat_map(|i| image.texels[i]).fold(0.0, f32::max)
}

/// PSNR of a tile whose decoded texels went through [`to_rgbe`].
fn psnr_8bit_db(decoded: &Image, reference: &Image, mask: &Mask, rect: Rect, quality: &TileQuality) -> f64 {
    let mut squared_error = 0.0;
    for y in rect.y0..rect.y1 {
        for i in y * mask.width + rect.x0..y * mask.width + rect.x1 {
            if mask.valid[i] {
                let texel = from_rgbe(to_rgbe(decoded.texels[i]));
                let error = |c: usize| f64::from(texel[c]) - f64::from(reference.texels[i][c]);
                squared_error += (0..3).map(|c| error(c) * error(c)).sum::<f64>();
            }
        }
    }
    metrics::psnr_db(quality.peak, squared_error / (3 * quality.texels) as f64)
}

/// The 8-bit four-channel output that a decoder writes to a texture: three mantissas and a shared exponent (Ward, "Real
/// Pixels", Graphics Gems II): with e the least exponent for which `round(256 · max / 2^e) ≤ 255`, the bytes are
/// `round(256 · c / 2^e)` and `e + 128`. Smaller than 2⁻¹²⁸ is black.
pub fn to_rgbe(texel: [f32; 3]) -> [u8; 4] {
    let texel = texel.map(f64::from);
    let max = texel.into_iter().fold(0.0, f64::max);
    if max < 2f64.powi(-128) {
        return [0; 4];
    }
    // floor(log₂ max) + 1, one more where the largest mantissa would round to 256.
    let mut exponent = max.log2().floor() as i32 + 1;
    if (256.0 * max / 2f64.powi(exponent)).round() > 255.0 {
        exponent += 1;
    }
    let exponent = exponent.clamp(-127, 127);
    let [r, g, b] = texel.map(|c| (256.0 * c / 2f64.powi(exponent)).round().clamp(0.0, 255.0) as u8);
    [r, g, b, (exponent + 128) as u8]
}

/// The value that four bytes of [`to_rgbe`] stand for: `c / 256 · 2^(e − 128)`; black for e = 0.
pub fn from_rgbe([r, g, b, e]: [u8; 4]) -> [f32; 3] {
    if e == 0 {
        return [0.0; 3];
    }
    let scale = 2f64.powi(i32::from(e) - 128 - 8);
    [r, g, b].map(|c| (f64::from(c) * scale) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_exponents_keep_eight_bits_of_the_largest_channel() {
        let mut x = 1e-30f32;
        while x < 1e30 {
            let texel = [x, 0.3 * x, 0.0];
            let [r, g, b] = from_rgbe(to_rgbe(texel));
            assert!(
                (r - x).abs() <= x / 256.0 * 1.01 && (g - 0.3 * x).abs() <= x / 256.0 * 1.01 && b == 0.0,
                "{x}"
            );
            x *= 1.37;
        }
        for exact in [[0.0; 3], [1.0, 0.5, 0.25], [255.0, 1.0, 3.0], [0.99609375, 0.0, 0.00390625]] {
            assert_eq!(from_rgbe(to_rgbe(exact)), exact);
        }
        assert!(from_rgbe(to_rgbe([f32::MAX; 3])).iter().all(|v| v.is_finite()));
        // 255.9/256 would round to 256: the exponent gives way.
        assert_eq!(from_rgbe(to_rgbe([0.9999, 0.0, 0.0]))[0], 1.0);
    }

    fn sample(texels: usize, mse: f64, peak: f64, constant: bool) -> Sample {
        let psnr = (peak > 0.0).then(|| metrics::psnr_db(peak, mse));
        Sample {
            set: 0,
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
            largest: 2.0 * mse.sqrt() as f32,
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
        assert!((q.lpips.unwrap() - 0.3).abs() < 1e-9);
        assert_eq!(q.noise_ceiling_db, None);
        assert_eq!(quality([].iter()), Quality::default());
    }
}
