//! Temporal error: the error of the change of light over a day in half hours, from one camera.

use super::pages::Pages;
use super::times::is_baked;
use super::{lit, with_texels};
use crate::{Error, Result};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Image;
use dataset::observe::Meter;
use dataset::pictures::View;
use dataset::store::Dataset;
use serde::Serialize;

/// Times of a day.
const TIMES: usize = 48;
/// Width and height of a picture, in pixels.
const SIZE: [usize; 2] = [320, 180];

/// Radiance of the pixels that show texels.
type Frame = Vec<[f32; 3]>;

/// Temporal error of a method.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    pub method: String,
    /// Mean over steps and pixels of |Δ method − Δ reference|, in shares of white as exposed.
    pub error: f64,
    /// The same over the mean |Δ reference|; `None` if nothing changes.
    pub relative_error: Option<f64>,
    /// The step that is worst: the hour in its middle, and its error.
    pub worst: (f64, f64),
    /// Each step: the hour in its middle, and its error.
    pub steps: Vec<(f64, f64)>,
}

/// The dataset's day and the methods' errors.
pub(super) struct Lapse {
    pub view: View,
    /// Which pixels are evaluated.
    judged: Vec<bool>,
    hours: Vec<f64>,
    frames: Vec<Frame>,
    exposures: Vec<f64>,
    /// Mean |Δ reference| over steps and pixels, in shares of white.
    pub change: f64,
    pub lines: Vec<Line>,
}

/// The half hours of the day that were baked.
pub(super) fn hours(dataset: &Dataset) -> Result<Vec<f64>> {
    let mut hours = Vec::new();
    for hour in (0..TIMES).map(|i| 24.0 * i as f64 / TIMES as f64) {
        if is_baked(dataset, hour)? {
            hours.push(hour);
        }
    }
    Ok(hours)
}

impl Lapse {
    pub(super) fn new(
        dataset: &Dataset,
        pages: &Pages,
        hours: Vec<f64>,
        progress: &dyn Meter,
    ) -> Result<Self> {
        let view = View::each(dataset, SIZE, 1)?.into_iter().next();
        let view = view.ok_or_else(|| {
            Error::invalid(dataset.root.display(), "no pixel of a small picture shows texels; omit --render")
        })?;
        let judged = with_texels(&view).valid;
        let mut lapse = Lapse {
            view,
            judged,
            hours,
            frames: Vec::new(),
            exposures: Vec::new(),
            change: 0.0,
            lines: Vec::new(),
        };
        for &hour in &lapse.hours {
            stop_if_interrupted()?;
            let light = lit(&lapse.view, dataset, &pages.of_dataset(hour, None)?)?;
            lapse.exposures.push(lapse.view.exposure(&light));
            let frame = lapse.kept(lapse.view.to_radiance(&light));
            lapse.frames.push(frame);
            progress.advance(1);
        }
        let steps = lapse.steps();
        let still: Vec<f64> = steps.iter().map(|&step| lapse.step(step, None)).collect();
        lapse.change = mean(&still);
        Ok(lapse)
    }

    /// A method by the light it has on all pages at an hour. `None` if there are no two times side by side.
    pub(super) fn line(
        &self,
        dataset: &Dataset,
        method: &str,
        at_hour: impl Fn(f64) -> Result<Vec<Image>>,
    ) -> Result<Option<Line>> {
        let seen = |i: usize| {
            stop_if_interrupted()?;
            let light = lit(&self.view, dataset, &at_hour(self.hours[i])?)?;
            Ok(self.kept(self.view.to_radiance(&light)))
        };
        let mut steps = Vec::new();
        // The last time seen; and the first, with which the day closes.
        let (mut last, mut first): (Option<(usize, Frame)>, Option<Frame>) = (None, None);
        for [a, b] in self.steps() {
            let before = match last.take() {
                Some((i, frame)) if i == a => frame,
                _ => seen(a)?,
            };
            if a == 0 {
                first = Some(before.clone());
            }
            let after = match &first {
                Some(first) if b == 0 => first.clone(),
                _ => seen(b)?,
            };
            let middle = (self.hours[a] + 0.5 * 24.0 / TIMES as f64).rem_euclid(24.0);
            steps.push((middle, self.step([a, b], Some([&before, &after]))));
            last = Some((b, after));
        }
        let errors: Vec<f64> = steps.iter().map(|(_, error)| *error).collect();
        let worst = steps.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
        Ok(worst.map(|worst| Line {
            method: method.to_owned(),
            error: mean(&errors),
            relative_error: (self.change > 0.0).then(|| mean(&errors) / self.change),
            worst,
            steps,
        }))
    }

    /// Times side by side, by their indices.
    fn steps(&self) -> Vec<[usize; 2]> {
        let n = self.hours.len();
        let pairs = (0..n).map(|i| [i, (i + 1) % n]);
        let gap = |[a, b]: &[usize; 2]| (self.hours[*b] - self.hours[*a]).rem_euclid(24.0);
        pairs.filter(|pair| pair[0] != pair[1] && (gap(pair) - 24.0 / TIMES as f64).abs() < 1e-9).collect()
    }

    /// The mean over pixels and channels of what a step's change differs by from the dataset's; without a
    /// method, of that itself. Both times are exposed as the brighter one is, and white at most.
    fn step(&self, [a, b]: [usize; 2], found: Option<[&Frame; 2]>) -> f64 {
        let scale = self.exposures[a].min(self.exposures[b]).exp2() as f32;
        let shown = |light: f32| f64::from((light * scale).min(1.0));
        let change = |from: &[f32; 3], to: &[f32; 3], c: usize| shown(to[c]) - shown(from[c]);
        let (before, after) = (&self.frames[a], &self.frames[b]);
        let pixel = |i: usize| {
            let wanted = |c: usize| change(&before[i], &after[i], c);
            let found = |c: usize| found.map_or(0.0, |[from, to]| change(&from[i], &to[i], c));
            (0..3).map(|c| (found(c) - wanted(c)).abs()).sum::<f64>()
        };
        (0..before.len()).map(pixel).sum::<f64>() / (3 * before.len()).max(1) as f64
    }

    fn kept(&self, pixels: Vec<[f32; 3]>) -> Frame {
        pixels.into_iter().zip(&self.judged).filter(|(_, judged)| **judged).map(|(pixel, _)| pixel).collect()
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
