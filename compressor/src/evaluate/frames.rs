//! Compares the light of all frames, page by page in strips.

use super::LARGE;
use super::quality::{Quality, quality};
use super::sample::{Sample, SlowMetrics, Strip};
use super::seams::Seams;
use super::strips::{self, valid};
use crate::Result;
use crate::decode::{Decoder, Lights};
use crate::law::Law;
use crate::mean::mean;
use crate::seen::{Errors, least_floor};
use dataset::format::Noise;
use dataset::host::signals::stop_if_interrupted;
use dataset::image::{Image, Mask};
use dataset::observe::{Meter, Observer};
use dataset::pictures::{Brightnesses, TileQuality, metrics};
use dataset::store::Dataset;
use std::ops::Range;

/// Light that is compared with a dataset's.
#[derive(Clone, Copy)]
pub(super) enum Compared<'a> {
    /// What a bundle decodes to.
    Bundle(&'a Decoder, Lights),
    /// Another dataset's: that of its frames in their order.
    Dataset(&'a Dataset, &'a Law),
}

impl Compared<'_> {
    /// Rows of a page of a frame, which is at this hour.
    fn rows(&self, frame: usize, hour: f64, page: usize, rows: &Range<usize>) -> Result<Image> {
        match self {
            Compared::Bundle(decoder, lights) => strips::decode(decoder, *lights, page, hour, rows),
            Compared::Dataset(dataset, law) => strips::read(dataset, law, frame, page, rows),
        }
    }
}

/// The inputs of a comparison.
pub(super) struct Lightmaps<'a> {
    /// What is right.
    pub truth: &'a Dataset,
    /// Which light of it is compared.
    pub law: Law,
    /// Per frame that is compared: its hour, and which of `truth` it is.
    pub frames: Vec<(f64, usize)>,
    /// What is compared with it.
    pub compared: Compared<'a>,
    pub noise: Option<Noise>,
    /// Frames of a lower mean are too dark to evaluate in their darkest texels.
    pub visible: f64,
    pub masks: Vec<Mask>,
    pub slow_metrics: SlowMetrics<'a>,
}

/// Results so far.
#[derive(Default)]
pub(super) struct Found {
    pub samples: Vec<Sample>,
    pub large: Vec<TileQuality>,
    pub seams: Seams,
    /// Per frame, its mean light.
    pub means: Vec<f64>,
    /// Per frame, the errors that are seen.
    errors: Vec<Errors>,
    /// Per frame, the relative error of its darkest texels.
    dark: Vec<Option<f64>>,
    pub decode_seconds: f64,
}

/// Compares all frames.
pub(super) fn found(lightmaps: &Lightmaps, what: &str, console: &dyn Observer) -> Result<Found> {
    let frames = lightmaps.frames.len();
    let strips: Vec<_> = lightmaps.masks.iter().map(strips::strips).collect();
    let progress = console.progress(what, (frames * lightmaps.masks.len()) as u64);
    let mut found = Found::default();
    for frame in 0..frames {
        found.add_frame(lightmaps, &strips, frame, &progress)?;
    }
    Ok(found)
}

impl Found {
    /// The quality over some of the frames.
    pub(super) fn over(&self, is_wanted: &dyn Fn(usize) -> bool) -> Quality {
        let wanted = || (0..self.dark.len()).filter(|&k| is_wanted(k));
        let mut errors = Errors::default();
        wanted().for_each(|k| errors.merge(&self.errors[k]));
        Quality {
            dark_relative_error: mean(wanted().filter_map(|k| self.dark[k])),
            seen: errors.figures(),
            ..quality(self.samples.iter().filter(|sample| is_wanted(sample.frame)))
        }
    }

    /// Adds all pages of a frame; `strips` has the rows of each page's strips.
    fn add_frame(
        &mut self,
        of: &Lightmaps,
        strips: &[Vec<Range<usize>>],
        frame: usize,
        progress: &dyn Meter,
    ) -> Result<()> {
        let first = self.samples.len();
        let (mut sum, mut texels) = (0.0, 0);
        let mut brightnesses = Brightnesses::default();
        self.errors.push(Errors::default());
        for (page, strips) in strips.iter().enumerate() {
            let (page_sum, page_texels) = self.add_page(of, frame, page, strips, &mut brightnesses)?;
            sum += page_sum;
            texels += page_texels;
            progress.advance(1);
        }
        let set_mean = mean_of(sum, texels);
        for sample in &mut self.samples[first..] {
            sample.relative_error =
                metrics::relative_error(sample.quality.mse(), sample.quality.mean, set_mean);
        }
        let is_visible = set_mean >= of.visible;
        self.dark.push(if is_visible { brightnesses.dark_relative_error(set_mean) } else { None });
        self.means.push(set_mean);
        Ok(())
    }

    /// Adds a page of a frame; returns the sum of its valid texels' channels and their number.
    fn add_page(
        &mut self,
        of: &Lightmaps,
        frame: usize,
        page: usize,
        strips: &[Range<usize>],
        brightnesses: &mut Brightnesses,
    ) -> Result<(f64, usize)> {
        let (mask, (hour, of_truth)) = (&of.masks[page], of.frames[frame]);
        let mut references = References {
            dataset: of.truth,
            law: &of.law,
            frame: of_truth,
            page,
            height: mask.height,
            last: None,
        };
        // The mean first: it is the unit of what follows.
        let (mut sum, mut texels) = (0.0, 0);
        for rows in strips {
            stop_if_interrupted()?;
            let of_strip = metrics::valid_sum(&references.read(rows)?.texels, valid(mask, rows));
            sum += of_strip.0;
            texels += of_strip.1;
        }
        let page_mean = mean_of(sum, texels);
        for rows in strips {
            stop_if_interrupted()?;
            // With the row below, for the step across.
            let more = rows.start..(rows.end + 1).min(mask.height);
            let mut reference = references.take(rows)?;
            let start = std::time::Instant::now();
            let mut decoded = of.compared.rows(frame, hour, page, &more)?;
            self.decode_seconds += start.elapsed().as_secs_f64();
            let mut mask = strips::cut(mask, &more);
            self.seams.add(&decoded, &reference, &mask, rows, page_mean);
            for image in [&mut reference, &mut decoded] {
                image.height = rows.len();
                image.texels.truncate(rows.len() * image.width);
            }
            mask.height = rows.len();
            mask.valid.truncate(rows.len() * mask.width);
            let strip = Strip {
                frame,
                page,
                row: rows.start,
                decoded: &decoded,
                reference: &reference,
                mask: &mask,
                page_mean,
                noise: of.noise.as_ref().map(|noise| &noise.mse[frame][page][..]),
                slow_metrics: of.slow_metrics,
            };
            self.large.extend(strip.qualities(LARGE));
            let least_floor = least_floor(&of.truth.config.unit);
            self.samples.extend(strip.samples(least_floor, &mut self.errors[frame])?);
            brightnesses.add(&decoded, &reference, &mask);
        }
        Ok((sum, texels))
    }
}

/// The mean over the channels of this many texels; 0 of none.
fn mean_of(sum: f64, texels: usize) -> f64 {
    if texels == 0 { 0.0 } else { sum / (3 * texels) as f64 }
}

/// One page of one frame by strips, each with the row below it where there is one. The last one read is
/// cached: a page of one strip is read once.
struct References<'a> {
    dataset: &'a Dataset,
    law: &'a Law,
    frame: usize,
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
                strips::read(self.dataset, self.law, self.frame, self.page, &more)
            }
        }
    }
}
