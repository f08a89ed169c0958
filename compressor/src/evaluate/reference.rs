//! A bundle, and the dataset it was made from, against a converged bake of the same scene.
//!
//! What the dataset differs by from such a *reference* is its own noise. A bundle that is closer to the
//! dataset than that may only be good at copying noise; against the reference it shows.

use super::between::check_kind;
use super::frames::{Compared, Found, Lightmaps, found};
use super::quality::Quality;
use super::worst::{WorstTile, worst_hour, worst_tile};
use super::{SlowMetrics, reference_law, visible};
use crate::decode::{Decoder, Lights};
use crate::{Error, Result};
use dataset::image::Mask;
use dataset::observe::Observer;
use dataset::store::Dataset;

/// Hours that differ by less are one.
const SAME_HOUR: f64 = 1e-6;

/// How light compares with a reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Against {
    /// Over all frames.
    pub all: Quality,
    /// Per frame: hour and quality.
    pub by_hour: Vec<(f64, Quality)>,
    /// Index of the frame with the largest local error at 95 % of its texels, if any has visible light.
    pub worst_hour: Option<usize>,
    /// The worst tile, if any is visible.
    pub worst_tile: Option<WorstTile>,
}

/// Both against a reference, on texels that are valid in dataset and reference, without slow metrics.
#[derive(Clone, Debug, PartialEq)]
pub struct Converged {
    /// The bundle.
    pub bundle: Against,
    /// The dataset: what its own noise amounts to.
    pub dataset: Against,
}

impl Against {
    /// Of all frames, at these hours; those of a lower mean than `visible` are not named the worst.
    pub(super) fn new(found: &Found, hours: impl Iterator<Item = f64>, visible: f64) -> Self {
        let by_hour: Vec<_> = hours.enumerate().map(|(k, hour)| (hour, found.over(&|of| of == k))).collect();
        let is_visible = |frame: usize| found.means[frame] >= visible;
        Against {
            all: found.over(&|_| true),
            worst_hour: worst_hour(&by_hour, is_visible),
            worst_tile: worst_tile(&found.samples, is_visible),
            by_hour,
        }
    }
}

/// Compares a bundle and its dataset with a reference.
///
/// # Errors
/// [`Error::Invalid`] as [`expect_reference`]; [`Error::Io`]; [`Error::Interrupted`].
pub(super) fn converged(
    dataset: &Dataset,
    reference: &Dataset,
    decoder: &Decoder,
    console: &dyn Observer,
) -> Result<Converged> {
    let frames = expect_reference(dataset, reference)?;
    let mut masks = dataset.masks()?;
    for (page, mask) in masks.iter_mut().enumerate() {
        let Mask { valid, .. } = reference.mask(page)?;
        mask.valid.iter_mut().zip(valid).for_each(|(valid, also)| *valid &= also);
    }
    let (law, visible) = (reference_law(decoder), visible(reference));
    let mut lightmaps = Lightmaps {
        truth: reference,
        law: reference_law(decoder),
        frames,
        compared: Compared::Bundle(decoder, Lights::All),
        noise: None,
        visible,
        masks,
        slow_metrics: SlowMetrics::default(),
    };
    let hours = || dataset.config.frames.iter().map(|frame| frame.hour);
    let bundle = found(&lightmaps, "against the reference", console)?;
    lightmaps.compared = Compared::Dataset(dataset, &law);
    let of_dataset = found(&lightmaps, "the dataset against the reference", console)?;
    Ok(Converged {
        bundle: Against::new(&bundle, hours(), visible),
        dataset: Against::new(&of_dataset, hours(), visible),
    })
}

/// Per frame of a dataset its hour, and the frame of a reference at that hour.
///
/// # Errors
/// [`Error::Invalid`] unless the reference is of the same scene, unit and layout of charts, and has a frame
/// at each hour of the dataset, with the same light groups on.
pub fn expect_reference(dataset: &Dataset, reference: &Dataset) -> Result<Vec<(f64, usize)>> {
    check_kind(dataset, reference)?;
    let (of, root) = (reference.root.display(), dataset.root.display());
    let digest = |dataset: &Dataset| dataset.config.geometry.as_ref().map(|file| file.blake3);
    if let Some((found, expected)) = digest(reference).zip(digest(dataset))
        && found != expected
    {
        let what = format!(
            "its geometry file differs from that of {root}, so its charts may lie elsewhere; expected a bake of the same scene file and \
             models with the same size and density of texels"
        );
        return Err(Error::invalid(of, what));
    }
    let mut frames = Vec::new();
    let mut missing = Vec::new();
    for frame in &dataset.config.frames {
        let mut same = reference.config.frames.iter();
        match same.position(|other| (other.hour - frame.hour).abs() < SAME_HOUR) {
            Some(k) if reference.config.frames[k].groups_on == frame.groups_on => {
                frames.push((frame.hour, k));
            }
            _ => missing.push(frame.hour.to_string()),
        }
    }
    if missing.is_empty() {
        return Ok(frames);
    }
    let what = format!(
        "has no frame with the same light groups on at {} h; expected all hours of {root}: bake the reference at these hours too",
        missing.join(", ")
    );
    Err(Error::invalid(of, what))
}
