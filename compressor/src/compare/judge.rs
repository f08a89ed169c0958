//! Evaluates a method: the paper's metrics over the same tiles and frames for all methods.

use super::method::CodedTiles;
use super::tiles::{Texels, Tile, TileSet, set_means};
use crate::Result;
use crate::evaluate::{Quality, Sample, SlowMetrics, Steps, Strip, quality};
use crate::mean::mean;
use dataset::format::Noise;
use dataset::image::Image;
use dataset::pictures::{Brightnesses, StepError, metrics};
use rayon::prelude::*;

/// The quality of a method over all tiles.
#[derive(Clone, Debug)]
pub(super) struct Judged {
    pub quality: Quality,
    pub steps: Steps,
    /// Per tile: the image of the frame that is shown of it, and its PSNR.
    pub shown: Vec<(Texels, Option<f64>)>,
}

/// Inputs of the evaluation that all methods share.
pub(super) struct Judge<'a> {
    set: &'a TileSet,
    set_means: Vec<f64>,
    noise: Option<&'a Noise>,
    slow_metrics: SlowMetrics<'a>,
    /// Per tile: the frame that is shown of it.
    pub shown: Vec<usize>,
}

impl<'a> Judge<'a> {
    pub(super) fn new(set: &'a TileSet, noise: Option<&'a Noise>, slow_metrics: SlowMetrics<'a>) -> Self {
        let shown = set.tiles.iter().map(most_contrast).collect();
        Judge { set, set_means: set_means(set), noise, slow_metrics, shown }
    }

    /// Compares what a method decodes with the light.
    pub(super) fn judge(&self, coded: &CodedTiles) -> Result<Judged> {
        let tiles = &self.set.tiles;
        let samples: Vec<Vec<Sample>> = tiles
            .par_iter()
            .zip(&coded.decoded)
            .map(|(tile, decoded)| {
                let samples =
                    (0..decoded.len()).filter_map(|k| self.sample(tile, k, &decoded[k]).transpose());
                samples.collect()
            })
            .collect::<Result<_>>()?;
        let n = self.set.timeline.hours.len();
        let (mut dark, mut steps) = (Vec::new(), vec![StepError::default(); n]);
        for k in 0..n {
            let mut brightnesses = Brightnesses::default();
            for (tile, decoded) in tiles.iter().zip(&coded.decoded) {
                let next = (k + 1) % n;
                let frames = &tile.source.frames;
                brightnesses.add(&image(tile, &decoded[k]), &image(tile, &frames[k]), &tile.mask);
                steps[k].add([&decoded[k], &decoded[next]], [&frames[k], &frames[next]], &tile.mask.valid);
            }
            dark.push(brightnesses.dark_relative_error(self.set_means[k]));
        }
        let all = quality(samples.iter().flatten());
        let steps = if n < 2 { Vec::new() } else { steps };
        let timeline = &self.set.timeline;
        Ok(Judged {
            quality: Quality { dark_relative_error: mean(dark.into_iter().flatten()), ..all },
            steps: Steps::new(&timeline.hours, &timeline.states, &steps),
            shown: (0..tiles.len())
                .map(|i| {
                    let k = self.shown[i];
                    let sample = samples[i].iter().find(|sample| sample.frame == k);
                    (coded.decoded[i][k].clone(), sample.and_then(|sample| sample.quality.psnr_db))
                })
                .collect(),
        })
    }

    /// A tile at a frame; nothing of one without a valid texel.
    fn sample(&self, tile: &Tile, k: usize, decoded: &Texels) -> Result<Option<Sample>> {
        let strip = Strip {
            frame: k,
            page: tile.place.page,
            row: 0,
            decoded: &image(tile, decoded),
            reference: &image(tile, &tile.source.frames[k]),
            mask: &tile.mask,
            page_mean: self.set_means[k],
            noise: None,
            slow_metrics: self.slow_metrics,
        };
        let noise = self.noise.map(|noise| noise.mse[k][tile.place.page][tile.index]);
        let sample = strip.sample(tile.rect(), noise)?;
        let q = &sample.quality;
        let relative_error = metrics::relative_error(q.mse(), q.mean, self.set_means[k]);
        Ok((q.texels > 0).then_some(Sample { relative_error, ..sample }))
    }
}

pub(super) fn image(tile: &Tile, texels: &Texels) -> Image {
    Image { width: tile.source.width, height: tile.source.height, texels: texels.clone() }
}

/// The frame whose light varies most in space beside its peak: there is most to see.
fn most_contrast(tile: &Tile) -> usize {
    let contrast = |k: usize| {
        let values: Vec<f64> = tile.valid().flat_map(|i| tile.source.frames[k][i]).map(f64::from).collect();
        let n = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n;
        if tile.peaks[k] > 0.0 { variance / f64::from(tile.peaks[k]).powi(2) } else { 0.0 }
    };
    (0..tile.peaks.len()).max_by(|&a, &b| contrast(a).total_cmp(&contrast(b))).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::super::method::Coded;
    use super::super::testing::{set_of, tile};
    use super::*;

    #[test]
    fn an_exact_method_has_no_error_and_another_has_its_own() {
        let hours = [1.0, 9.0, 17.0];
        let set = set_of(vec![tile(8, 8, 3, 1), tile(12, 4, 3, 2)], &hours);
        let judge = Judge::new(&set, None, SlowMetrics::default());
        let coded = |offset: f32| Coded {
            decoded: set
                .tiles
                .iter()
                .map(|tile| {
                    let set = |set: &Texels| set.iter().map(|texel| texel.map(|v| v + offset)).collect();
                    tile.source.frames.iter().map(set).collect()
                })
                .collect(),
            bits: 1.0,
            encode_seconds: 0.0,
            decode_seconds: 0.0,
            curves: vec![],
        };
        let exact = judge.judge(&coded(0.0)).unwrap();
        assert_eq!((exact.quality.psnr_db, exact.quality.samples), (Some(100.0), 6));
        assert_eq!((exact.steps.smooth, exact.steps.each.len()), (Some(0.0), 3));
        let brighter = judge.judge(&coded(0.01)).unwrap();
        // Peaks are just below 1.
        assert!((brighter.quality.psnr_db.unwrap() - 40.0).abs() < 0.5);
        // All frames are wrong alike: their steps are not.
        assert!(brighter.steps.smooth.unwrap() < 1e-6);
        assert_eq!(brighter.shown.len(), 2);
    }
}
