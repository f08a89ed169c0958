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
mod frames;
mod worst;
mod reference;
mod pictures;
mod table;
mod figures;

pub use between::Between;
pub(crate) use figures::{clock, percent};
pub(crate) use pictures::with_texels;
pub use pictures::{PictureFlip, SceneFlip};
pub use quality::Quality;
pub(crate) use quality::quality;
pub use reference::{Against, Converged, expect_reference};
pub use rgbe::{from_rgbe, to_rgbe};
pub(crate) use sample::Strip;
pub use sample::{Sample, SlowMetrics};
pub use shadows::Shadows;
pub use steps::{Step, Steps};
pub(crate) use strips::{decode, read, strips, valid};
pub use table::COLUMNS;
pub(crate) use table::{aligned, cell};
pub use worst::{VISIBLE_LUX, WorstTile};

use crate::decode::{Decoder, Lights};
use crate::law::Law;
use crate::mean::mean;
use crate::{Error, Result, printable, seen};
use dataset::format::TILE;
use dataset::image::Mask;
use dataset::observe::Observer;
use dataset::pictures::TileQuality;
use dataset::store::Dataset;
use frames::{Compared, Found, Lightmaps, found};

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
    /// Per frame, its mean light, in the dataset's unit.
    pub mean_light: Vec<f64>,
    /// Index of the frame with the largest local error at 95 % of its texels; frames below [`VISIBLE_LUX`] on
    /// average are not named. `None` if no frame has visible light.
    pub worst_hour: Option<usize>,
    /// The tile whose errors are seen most, of the same frames.
    pub worst_tile: Option<WorstTile>,
    /// Against a reference, if there is one.
    pub converged: Option<Converged>,
    /// ꟻLIP of pictures of the scene; `None` if it is not requested, or nothing can be shown.
    pub scene_flip: Option<SceneFlip>,
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
    /// A converged bake of the same scene at the same hours, or more of them.
    pub reference: Option<&'a Dataset>,
    /// Slow quality metrics.
    pub slow_metrics: SlowMetrics<'a>,
}

/// Decodes every frame of `decoder`'s bundle and compares it with `dataset`.
///
/// # Errors
/// [`Error::Invalid`] where the bundle's pages or hours are not the dataset's, where a withheld bake or a
/// reference is of another scene, or any is damaged; [`Error::Io`]; [`Error::Interrupted`].
pub fn evaluate(
    dataset: &Dataset,
    decoder: &Decoder,
    measures: Measures,
    console: &dyn Observer,
) -> Result<Evaluation> {
    expect_match(dataset, decoder)?;
    if let Some(reference) = measures.reference {
        expect_reference(dataset, reference)?;
    }
    let hours = || dataset.config.frames.iter().map(|frame| frame.hour);
    let mut lightmaps = Lightmaps {
        truth: dataset,
        law: reference_law(decoder),
        frames: hours().enumerate().map(|(frame, hour)| (hour, frame)).collect(),
        compared: Compared::Bundle(decoder, Lights::All),
        visible: visible(dataset),
        noise: dataset.noise()?,
        masks: dataset.masks()?,
        slow_metrics: measures.slow_metrics,
    };
    let found = found(&lightmaps, "evaluating", console)?;
    let mut without_sun = None;
    if decoder.bundle().header.sun.is_some() {
        (lightmaps.law, lightmaps.compared) = (Law::of(true), Compared::Bundle(decoder, Lights::Baked));
        (lightmaps.noise, lightmaps.slow_metrics) = (None, SlowMetrics::default());
        without_sun = Some(self::found(&lightmaps, "evaluating without the sun", console)?.over(&|_| true));
    }
    let evaluation =
        found.into_evaluation(dataset, &reference_law(decoder), decoder, measures.withheld, console)?;
    let converged =
        measures.reference.map(|reference| reference::converged(dataset, reference, decoder, console));
    let scene_flip = measures.slow_metrics.flip.then(|| pictures::scene_flip(dataset, decoder, console));
    Ok(Evaluation {
        without_sun,
        converged: converged.transpose()?,
        scene_flip: scene_flip.transpose()?.flatten(),
        ..evaluation
    })
}

/// [`VISIBLE_LUX`] in the unit of a dataset.
fn visible(dataset: &Dataset) -> f64 {
    seen::lux(&dataset.config.unit).map_or(0.0, |lux| VISIBLE_LUX * lux)
}

/// The dataset's light that a bundle is compared with: all, or without the sun's direct light if the bundle
/// omits it.
pub(crate) fn reference_law(decoder: &Decoder) -> Law {
    Law::of(crate::compress::sun_is_omitted(&decoder.bundle().header))
}

impl Found {
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
        let over = |wanted: &dyn Fn(usize) -> bool| self.over(wanted);
        let against = Against::new(&self, frames.iter().map(|frame| frame.hour), visible(dataset));
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
            all: against.all,
            by_hour: against.by_hour,
            worst_hour: against.worst_hour,
            worst_tile: against.worst_tile,
            converged: None,
            scene_flip: None,
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
            mean_light: self.means,
            samples: self.samples,
        })
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
