//! Quality of a bundle against its dataset by the paper's protocol.
//!
//! Every frame is decoded at its hour and compared on 128×128 tiles from texel (0, 0) of each page (not the
//! bundle's, which own 126×126), valid texels only, linear RGB ([`dataset::pictures::metrics`]). A *sample*
//! is one (tile, frame). A tile without a valid texel is not a sample; samples that are all zero are counted
//! separately; samples with a constant reference have no dynamic range and are evaluated separately, by
//! relative error.

mod strips;
mod rgbe;
mod sample;
mod quality;
mod seams;
mod shadows;
mod steps;
mod between;
mod table;

pub use between::Between;
pub use quality::Quality;
pub(crate) use quality::quality;
pub use rgbe::{from_rgbe, to_rgbe};
pub(crate) use sample::Strip;
pub use sample::{Sample, SlowMetrics};
pub use shadows::Shadows;
pub use steps::{Step, Steps};
pub(crate) use strips::{decode, read, strips, valid};
pub use table::COLUMNS;
pub(crate) use table::{aligned, cell};

use crate::decode::{Decoder, Lights};
use crate::law::Law;
use crate::mean::mean;
use crate::{Error, Result, printable};
use dataset::format::{Noise, TILE};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::{Image, Mask};
use dataset::observe::{Meter, Observer};
use dataset::pictures::{Brightnesses, TileQuality, metrics};
use dataset::store::Dataset;
use seams::Seams;
use std::ops::Range;

/// Side in texels of the large tiles, on which quality is also reported.
pub const LARGE: usize = 2 * TILE;

/// Means over (large tile, frame), of those that are neither black nor constant in space.
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
    /// Every (tile, frame) that has a valid texel, frame by frame, page by page, row by row.
    pub samples: Vec<Sample>,
    /// Over all frames.
    pub all: Quality,
    /// Over the frames that the sun lights directly, if the dataset says which.
    pub sunny: Option<Quality>,
    /// Of the maps only (without the sun's direct light, if that is a separate stream): over all frames,
    /// without slow metrics and noise.
    pub without_sun: Option<Quality>,
    /// True if the bundle omits the sun's direct light; the reference then omits it, too.
    pub sun_is_omitted: bool,
    /// Per frame: hour and quality.
    pub by_hour: Vec<(f64, Quality)>,
    /// Over the frames that differ: nights with the same light groups on are one image, which `all` counts
    /// once per frame.
    pub distinct: Quality,
    /// Number of distinct frames.
    pub distinct_frames: usize,
    /// Over all frames, on tiles of [`LARGE`]² texels.
    pub large: Large,
    /// Error of the change from frame to frame.
    pub steps: Steps,
    /// Length of the bundle file × 8 ÷ (texels of all pages × frames), texels without a surface included.
    pub bpp: f64,
    /// The same ÷ (valid texels × frames), and ÷ (valid texels × frames that differ).
    pub bits_of_valid: [f64; 2],
    /// Bytes of the bundle's tiles of the sun.
    pub bytes_of_sun: u64,
    /// Bytes of moving shadows.
    pub bytes_of_shadows: u64,
    /// Tiles that are not empty.
    pub tiles: usize,
    /// Bytes of the bundle file.
    pub bytes: u64,
    /// Mean error of differences between neighbouring texels across tile borders, divided by that inside
    /// tiles, each page and frame weighted by 1 ÷ its mean. 1 if tile borders are invisible; `None` if there
    /// are no borders, or no errors inside.
    pub seam_ratio: Option<f64>,
    /// The sun's direct light between the frames, where it is a separate stream.
    pub shadows: Option<Shadows>,
    /// Quality between the frames, where light is interpolated anywhere.
    pub between: Option<Between>,
    /// Wall-clock seconds of decoding alone.
    pub decode_seconds: f64,
}

/// Optional references and metrics of an evaluation.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measures<'a> {
    /// A bake of the same scene at other hours: the reference between the frames.
    pub withheld: Option<&'a Dataset>,
    /// Slow quality metrics.
    pub slow_metrics: SlowMetrics<'a>,
}

/// Decodes every frame of `decoder`'s bundle and compares it with `dataset`.
///
/// # Errors
/// [`Error::Invalid`] where the bundle's pages or hours are not the dataset's, or either is damaged;
/// [`Error::Io`]; [`Error::Interrupted`].
pub fn evaluate(
    dataset: &Dataset,
    decoder: &Decoder,
    measures: Measures,
    console: &dyn Observer,
) -> Result<Evaluation> {
    expect_match(dataset, decoder)?;
    let noise = dataset.noise()?;
    let masks = dataset.masks()?;
    let strips = masks.iter().map(strips).collect();
    let (law, lights) = (reference_law(decoder), Lights::All);
    let mut lightmaps = Lightmaps {
        dataset,
        law,
        lights,
        decoder,
        visible: visible(dataset),
        noise,
        masks,
        strips,
        slow_metrics: measures.slow_metrics,
    };
    let found = found(&lightmaps, "evaluating", console)?;
    let mut indirect = None;
    if decoder.bundle().header.sun.is_some() {
        (lightmaps.law, lightmaps.lights) = (Law::of(true), Lights::Baked);
        (lightmaps.noise, lightmaps.slow_metrics) = (None, SlowMetrics::default());
        let found = self::found(&lightmaps, "evaluating without the sun", console)?;
        indirect = Some(Quality {
            dark_relative_error: mean(found.dark.into_iter().flatten()),
            ..quality(found.samples.iter())
        });
    }
    let evaluation =
        found.into_evaluation(dataset, &reference_law(decoder), decoder, measures.withheld, console)?;
    Ok(Evaluation { without_sun: indirect, ..evaluation })
}

/// Darkest mean light that counts as visible, in lux: half a full moon's. With an unknown unit, any light
/// counts.
pub const VISIBLE_LUX: f64 = 0.1;

/// The same in the unit of a dataset.
fn visible(dataset: &Dataset) -> f64 {
    let unit = &dataset.config.unit;
    match () {
        () if unit.contains("kilolux") => VISIBLE_LUX / 1000.0,
        () if unit.contains("lux") => VISIBLE_LUX,
        () => 0.0,
    }
}

/// The dataset's light that a bundle is compared with: all, or without the sun's direct light if the bundle
/// omits it.
pub(crate) fn reference_law(decoder: &Decoder) -> Law {
    Law::of(crate::compress::sun_is_omitted(&decoder.bundle().header))
}

/// Compares all frames.
fn found(lightmaps: &Lightmaps, what: &str, console: &dyn Observer) -> Result<Found> {
    let frames = lightmaps.dataset.config.frames.len();
    let progress = console.progress(what, (frames * lightmaps.masks.len()) as u64);
    let mut found = Found::default();
    for frame in 0..frames {
        found.add_frame(lightmaps, frame, &progress)?;
    }
    Ok(found)
}

/// The inputs of a comparison, page by page in strips.
struct Lightmaps<'a> {
    dataset: &'a Dataset,
    /// Which light of the dataset and of the bundle is compared.
    law: Law,
    lights: Lights,
    decoder: &'a Decoder,
    noise: Option<Noise>,
    /// Frames of a lower mean are too dark to evaluate in their darkest texels.
    visible: f64,
    masks: Vec<Mask>,
    /// Of each page, the rows of its strips.
    strips: Vec<Vec<Range<usize>>>,
    slow_metrics: SlowMetrics<'a>,
}

/// Results so far.
#[derive(Default)]
struct Found {
    samples: Vec<Sample>,
    large: Vec<TileQuality>,
    seams: Seams,
    /// Per frame, the relative error of its darkest texels.
    dark: Vec<Option<f64>>,
    decode_seconds: f64,
}

impl Found {
    /// Adds all pages of a frame.
    fn add_frame(&mut self, of: &Lightmaps, frame: usize, progress: &dyn Meter) -> Result<()> {
        let first = self.samples.len();
        let (mut sum, mut texels) = (0.0, 0);
        let mut brightnesses = Brightnesses::default();
        for page in 0..of.masks.len() {
            let (page_sum, page_texels) = self.add_page(of, frame, page, &mut brightnesses)?;
            sum += page_sum;
            texels += page_texels;
            progress.advance(1);
        }
        let set_mean = mean_of(sum, texels);
        for sample in &mut self.samples[first..] {
            sample.relative_error =
                metrics::relative_error(sample.quality.mse(), sample.quality.mean, set_mean);
        }
        let is_seen = set_mean >= of.visible;
        self.dark.push(if is_seen { brightnesses.dark_relative_error(set_mean) } else { None });
        Ok(())
    }

    /// Adds a page of a frame; returns the sum of its valid texels' channels and their number.
    fn add_page(
        &mut self,
        of: &Lightmaps,
        frame: usize,
        page: usize,
        brightnesses: &mut Brightnesses,
    ) -> Result<(f64, usize)> {
        let (dataset, mask) = (of.dataset, &of.masks[page]);
        let frames = &dataset.config.frames;
        let mut references =
            References { dataset, law: &of.law, frame, page, height: mask.height, last: None };
        // The mean first: it is the unit of what follows.
        let (mut sum, mut texels) = (0.0, 0);
        for rows in &of.strips[page] {
            stop_if_interrupted()?;
            let of_strip = metrics::valid_sum(&references.read(rows)?.texels, valid(mask, rows));
            sum += of_strip.0;
            texels += of_strip.1;
        }
        let page_mean = mean_of(sum, texels);
        for rows in &of.strips[page] {
            stop_if_interrupted()?;
            // With the row below, for the step across.
            let more = rows.start..(rows.end + 1).min(mask.height);
            let mut reference = references.take(rows)?;
            let start = std::time::Instant::now();
            let mut decoded = strips::decode(of.decoder, of.lights, page, frames[frame].hour, &more)?;
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
            self.samples.extend(strip.samples()?);
            brightnesses.add(&decoded, &reference, &mask);
        }
        Ok((sum, texels))
    }

    /// Computes the means, and adds the measurements between frames.
    fn into_evaluation(
        self,
        dataset: &Dataset,
        law: &Law,
        decoder: &Decoder,
        withheld: Option<&Dataset>,
        console: &dyn Observer,
    ) -> Result<Evaluation> {
        let (bundle, frames, pages) = (decoder.bundle(), &dataset.config.frames, &dataset.config.pages);
        // The quality over some of the frames.
        let over = |wanted: &dyn Fn(usize) -> bool| Quality {
            dark_relative_error: mean((0..frames.len()).filter(|&k| wanted(k)).filter_map(|k| self.dark[k])),
            ..quality(self.samples.iter().filter(|sample| wanted(sample.frame)))
        };
        let over_large = |of: fn(&TileQuality) -> Option<f64>| mean(self.large.iter().filter_map(of));
        let texels: u64 = pages.iter().map(|page| u64::from(page.width) * u64::from(page.height)).sum();
        let files = |k: usize| frames[k].maps.iter().map(|map| &map.blake3).collect::<Vec<_>>();
        let mut seen = std::collections::BTreeSet::new();
        let firsts: Vec<usize> = (0..frames.len()).filter(|&k| seen.insert(files(k))).collect();
        let valid: usize = dataset.masks()?.iter().map(Mask::count).sum();
        let is_sunny = |k: usize| {
            let mut direct = dataset.config.layers.iter().filter(|layer| layer.is_direct_sun());
            direct.any(|layer| (0..pages.len()).any(|page| layer.file(k, page).is_some()))
        };
        let sunny = (0..frames.len()).any(is_sunny);
        Ok(Evaluation {
            without_sun: None,
            sun_is_omitted: crate::compress::sun_is_omitted(&decoder.bundle().header),
            sunny: sunny.then(|| over(&is_sunny)),
            all: over(&|_| true),
            by_hour: frames.iter().enumerate().map(|(k, frame)| (frame.hour, over(&|of| of == k))).collect(),
            distinct: over(&|k| firsts.binary_search(&k).is_ok()),
            distinct_frames: firsts.len(),
            large: Large {
                psnr_db: over_large(|quality| quality.psnr_db),
                psnr_range_db: over_large(|quality| quality.psnr_range_db),
                one_minus_ssim: over_large(|quality| quality.ssim).map(|ssim| 1.0 - ssim),
            },
            steps: steps::steps(dataset, law, decoder, console)?,
            bpp: bundle.bytes as f64 * 8.0 / (texels as f64 * frames.len() as f64),
            bits_of_valid: [frames.len(), firsts.len()]
                .map(|frames| bundle.bytes as f64 * 8.0 / (valid as f64 * frames as f64)),
            bytes_of_sun: bundle.index.iter().map(|entry| u64::from(entry.sun.length)).sum(),
            bytes_of_shadows: bundle.index.iter().map(|entry| u64::from(entry.shadows.length)).sum(),
            tiles: bundle.index.iter().filter(|entry| entry.bytes() > 0).count(),
            bytes: bundle.bytes,
            seam_ratio: self.seams.ratio(),
            shadows: shadows::shadows(dataset, decoder, console)?,
            between: between::between(dataset, withheld, decoder, console)?,
            decode_seconds: self.decode_seconds,
            samples: self.samples,
        })
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

/// Sizes of pages as text.
pub(crate) fn sizes<T: std::fmt::Display>(pages: impl Iterator<Item = [T; 2]>) -> String {
    pages.map(|[width, height]| format!("{width} × {height}")).collect::<Vec<_>>().join(", ")
}

/// An error unless the bundle has the dataset's pages and hours.
///
/// # Errors
/// [`Error::Invalid`] with both.
pub fn expect_match(dataset: &Dataset, decoder: &Decoder) -> Result<()> {
    let header = &decoder.bundle().header;
    let config = &dataset.config;
    let hours = |hours: Vec<f64>| hours.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let kinds = [
        (
            "pages of",
            sizes(header.pages.iter().map(|page| [page.width, page.height])),
            sizes(config.pages.iter().map(|page| [page.width, page.height])),
        ),
        (
            "frames at the hours",
            hours(header.timeline.hours.clone()),
            hours(config.frames.iter().map(|frame| frame.hour).collect()),
        ),
    ];
    for (what, bundle, of_dataset) in kinds {
        if bundle != of_dataset {
            let (scene, root) = (printable(&header.scene), dataset.root.display());
            let what = format!("has {what} {bundle}; the dataset {root} has {of_dataset}; expected the same");
            return Err(Error::invalid(format!("bundle of scene {scene}"), what));
        }
    }
    Ok(())
}
