//! Quality between frames: at hours that the bundle has no frame of.
//!
//! The reference is another bake, the *withheld* one: the same scene at other hours. Without it the decoder
//! is compared with light that goes from frame to frame by the curves of its layers, linearly where they have
//! none, a quarter and three quarters of the way, where training mostly has no samples: it has them at a
//! third and two thirds, and in wide gaps at more places.

use super::reference_law;
use super::strips::{cut, decode, read, strips};
use crate::decode::{Decoder, Lights};
use crate::law::{Law, LayerRows, Rows};
use crate::time::TimePoint;
use crate::{Error, Result};
use dataset::format::tiles::{Rect, TILE, tiles};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::{Image, Mask};
use dataset::observe::Observer;
use dataset::pictures::metrics;
use dataset::store::Dataset;
use std::ops::Range;

/// PSNR between frames, each time's pooled over its texels: from the mean squared error relative to the
/// tile's peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Between {
    /// Of the decoder: the median over the times. (A mean would depend on the quietest ones, or on the worst
    /// one.)
    pub median_db: f64,
    /// The worst time's, and its hour.
    pub worst: (f64, f64),
    /// The median of light linear between the dataset's uncompressed frames, against a withheld bake; without
    /// one it is the reference.
    pub linear_median_db: Option<f64>,
    /// Times evaluated.
    pub points: usize,
}

/// Evaluates a bundle, which is the dataset's, between its frames. `None` if there is no time to evaluate:
/// light is held at all of them, or does not change.
///
/// # Errors
/// [`Error::Invalid`] where a withheld bake is of another scene or has other pages; [`Error::Io`];
/// [`Error::Interrupted`].
pub(super) fn between(
    dataset: &Dataset,
    withheld: Option<&Dataset>,
    decoder: &Decoder,
    console: &dyn Observer,
) -> Result<Option<Between>> {
    let mut masks = dataset.masks()?;
    if let Some(withheld) = withheld {
        check_kind(dataset, withheld)?;
        // More hours light a few texels more.
        for (page, mask) in masks.iter_mut().enumerate() {
            let also = withheld.mask(page)?.valid;
            mask.valid.iter_mut().zip(also).for_each(|(valid, also)| *valid &= also);
        }
    }
    let points = points(dataset, withheld, decoder);
    // Without another bake, light between the frames is the dataset's own by the curves of its layers; the
    // sun of a separate stream is not evaluated then.
    let reference = reference_law(decoder);
    let has_sun = decoder.bundle().header.sun.is_some();
    let (law, lights) = match withheld {
        Some(_) => (Law::of(reference.is_apart), Lights::All),
        None => {
            let is_apart = has_sun || reference.is_apart;
            (Law::new(dataset, is_apart)?, if has_sun { Lights::Baked } else { Lights::All })
        }
    };
    let strips: Vec<_> = masks.iter().map(strips).collect();
    let total = points.len() * strips.iter().map(Vec::len).sum::<usize>();
    let progress = console.progress("between frames", total as u64);
    let mut pools: Vec<[Pool; 2]> = points.iter().map(|_| Default::default()).collect();
    for (page, mask) in masks.iter().enumerate() {
        for rows in &strips[page] {
            let mask = cut(mask, rows);
            let rects = tiles(mask.width, mask.height, TILE);
            let mut frames = Frames { dataset, law: &law, page, rows: rows.clone(), recent: Vec::new() };
            for (&(hour, point, index), [of_decoder, of_linear]) in points.iter().zip(&mut pools) {
                stop_if_interrupted()?;
                let linear = frames.linear(hour, &point)?;
                let decoded = decode(decoder, lights, page, hour, rows)?;
                let truth = match (withheld, index) {
                    (Some(withheld), Some(index)) => Some(read(withheld, &reference, index, page, rows)?),
                    _ => None,
                };
                for rect in &rects {
                    of_decoder.add(&decoded, truth.as_ref().unwrap_or(&linear), &mask, rect);
                    truth.iter().for_each(|truth| of_linear.add(&linear, truth, &mask, rect));
                }
                progress.advance(1);
            }
        }
    }
    let hours = points.iter().map(|(hour, ..)| *hour);
    let decoded: Vec<(f64, f64)> =
        pools.iter().zip(hours).filter_map(|(pools, hour)| Some((pools[0].db()?, hour))).collect();
    let worst = decoded.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(worst.map(|worst| Between {
        median_db: median(decoded.iter().map(|(db, _)| *db).collect()).unwrap_or(worst.0),
        worst,
        linear_median_db: median(pools.iter().filter_map(|pools| pools[1].db()).collect()),
        points: decoded.len(),
    }))
}

/// The lower median; nothing of nothing.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied()
}

/// The times to evaluate where light is interpolated: hours that only the withheld bake has, with its frame;
/// or a quarter and three quarters of the way between frames that are not the same images.
fn points(
    dataset: &Dataset,
    withheld: Option<&Dataset>,
    decoder: &Decoder,
) -> Vec<(f64, TimePoint, Option<usize>)> {
    let timeline = &decoder.bundle().header.timeline;
    let hours: Vec<(f64, Option<usize>)> = match withheld {
        Some(withheld) => {
            withheld.config.frames.iter().enumerate().map(|(k, frame)| (frame.hour, Some(k))).collect()
        }
        None => {
            let n = timeline.hours.len();
            let next = |k: usize| timeline.hours[(k + 1) % n] + if k + 1 == n { 24.0 } else { 0.0 };
            let way = |k: usize| {
                [0.25, 0.75].map(|share| timeline.hours[k] + share * (next(k) - timeline.hours[k]))
            };
            let is_near = |k: &usize| next(*k) - timeline.hours[*k] <= crate::law::WIDEST;
            (0..n).filter(is_near).flat_map(way).map(|hour| (crate::time::fold_hour(hour), None)).collect()
        }
    };
    let files = |k: usize| dataset.config.frames[k].maps.iter().map(|map| &map.blake3);
    let judged = |&(hour, index): &(f64, Option<usize>)| {
        let point = timeline.at(hour);
        (point.a != point.b && files(point.a).ne(files(point.b))).then_some((hour, point, index))
    };
    hours.iter().filter_map(judged).collect()
}

/// An error unless both are of one scene, in one unit, with pages of the same sizes.
pub(super) fn check_kind(dataset: &Dataset, withheld: &Dataset) -> Result<()> {
    let kind = |dataset: &Dataset| {
        let pages = dataset.config.pages.iter().map(|page| format!("{} × {}", page.width, page.height));
        let (scene, unit) = (&dataset.config.scene, &dataset.config.unit);
        format!("scene {scene}, in {unit}, pages {}", pages.collect::<Vec<_>>().join(", "))
    };
    let (found, expected) = (kind(withheld), kind(dataset));
    if found == expected {
        return Ok(());
    }
    let what = format!("{found}; expected the same as {}: {expected}", dataset.root.display());
    Err(Error::invalid(withheld.root.display(), what))
}

/// Rows of a page of the dataset's frames; the last two read are cached.
struct Frames<'a> {
    dataset: &'a Dataset,
    page: usize,
    rows: Range<usize>,
    recent: Vec<(usize, Rows)>,
    law: &'a Law,
}

impl Frames<'_> {
    fn read(&mut self, frame: usize) -> Result<()> {
        if self.recent.iter().all(|(k, _)| *k != frame) {
            self.recent.truncate(1);
            let range = [self.rows.start, self.rows.end];
            let light = self.law.rows(self.dataset, [frame, self.page], range, &mut LayerRows::new())?;
            self.recent.insert(0, (frame, light));
        }
        // The newest first.
        self.recent.sort_by_key(|(k, _)| *k != frame);
        Ok(())
    }

    /// Linear interpolation of the frames around a time.
    fn linear(&mut self, hour: f64, point: &TimePoint) -> Result<Image> {
        self.read(point.a)?;
        self.read(point.b)?;
        let [(_, b), (_, a)] = &self.recent[..] else { unreachable!("two frames that differ were read") };
        let hours = [point.a, point.b].map(|frame| self.dataset.config.frames[frame].hour);
        let width = self.dataset.config.pages[self.page].width as usize;
        Ok(Image { width, height: self.rows.len(), texels: self.law.mixed(hours, hour, [a, b]) })
    }
}

/// Squared errors relative to the peak of their tile and time: sum and number.
#[derive(Default)]
struct Pool {
    sum: f64,
    count: usize,
}

impl Pool {
    /// A tile's valid texels; a black one does not count.
    fn add(&mut self, image: &Image, reference: &Image, mask: &Mask, rect: &Rect) {
        let (mut sum, mut count, mut peak) = (0.0, 0, 0.0f64);
        for i in rect.valid(mask) {
            count += 3;
            for (found, wanted) in image.texels[i].into_iter().zip(reference.texels[i]) {
                let (found, wanted) = (f64::from(found), f64::from(wanted));
                peak = peak.max(wanted);
                sum += (found - wanted) * (found - wanted);
            }
        }
        if peak > 0.0 {
            self.sum += sum / (peak * peak);
            self.count += count;
        }
    }

    fn db(&self) -> Option<f64> {
        (self.count > 0).then(|| metrics::psnr_db(1.0, self.sum / self.count as f64))
    }
}
