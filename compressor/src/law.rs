//! Which part of a dataset's light goes into a bundle's maps, and how it is interpolated between frames.
//!
//! Where a dataset stores the sun's direct light and visibility separately, maps hold the rest, which is
//! smooth in time. A layer may have a curve between two frames (`dataset::format::curve`); the bundle then
//! stores tiles' means at more hours than those of the frames, so that dusk follows its curve and not a
//! straight line.

use crate::model::Knot;
use crate::time::{TimePoint, Timeline};
use crate::{Error, Result};
use dataset::format::curve::{Curve, kept};
use dataset::format::{Config, FileRef, Layer, Light};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Mask;
use dataset::store::Dataset;
use std::collections::BTreeMap;

/// Means at hours between frames are stored where a straight line is wrong by more than this share of the
/// light,
const WRONG: f64 = 0.03;
/// or by this share of the day's brightest, if that is more.
const TRIFLE: f64 = 1e-7;
/// Two frames farther apart than this, in hours, have no knots between them: that part of the day was not
/// baked.
pub const WIDEST: f64 = 12.0;
/// How much [`share`] holds to the share of light.
const HOLD: f64 = 0.02;

/// How far to blend from the first frame's picture to the second's. `frames`: the light of each by its parts;
/// `light`: what of the light between them stems from each. It is a least-squares fit of the parts' shares of
/// the light; the share of all light counts a little ([`HOLD`]), for when the parts do not decide. By all
/// light alone it would be wrong after sunset, when half of the sky's light may come from a frame at which
/// the sun still shone.
fn share(frames: [&[[f64; 3]]; 2], light: [&[[f64; 3]]; 2]) -> f64 {
    let part = |of: &[[f64; 3]], i: usize| of[i].iter().sum::<f64>();
    let [a, b] = frames.map(sum);
    let whole = sum(light[0]) + sum(light[1]);
    if a <= 0.0 || b <= 0.0 || whole <= 0.0 {
        return if whole > 0.0 { sum(light[1]) / whole } else { 0.0 };
    }
    let (mut top, mut bottom) = (HOLD * sum(light[1]) / whole, HOLD);
    for i in 0..frames[0].len() {
        let (from, to) = (part(frames[0], i) / a, part(frames[1], i) / b);
        let now = (part(light[0], i) + part(light[1], i)) / whole;
        top += (now - from) * (to - from);
        bottom += (to - from) * (to - from);
    }
    (top / bottom).clamp(0.0, 1.0)
}

fn sum(light: &[[f64; 3]]) -> f64 {
    light.iter().flatten().sum()
}

/// Texels of a page that are processed together.
const TEXELS: usize = 1 << 22;
/// Step in hours between the examined times: a minute.
const STEP: f64 = 1.0 / 60.0;

/// Light by layer: of some texels at a frame, the mean of each layer that has a curve, and of all light, red,
/// green and blue.
#[derive(Clone, Debug, PartialEq)]
pub struct Shares {
    /// By curve.
    pub of_curves: Vec<[f64; 3]>,
    /// Of all that the maps hold.
    pub all: [f64; 3],
}

impl Shares {
    /// By curve, then the rest. (Sums of floats may leave a trifle below 0.)
    fn parts(&self) -> Vec<[f64; 3]> {
        let rest =
            |c: usize| (self.all[c] - self.of_curves.iter().map(|light| light[c]).sum::<f64>()).max(0.0);
        self.of_curves.iter().copied().chain([[rest(0), rest(1), rest(2)]]).collect()
    }
}

/// Which light the maps of a bundle hold, and its curves between frames.
#[derive(Debug)]
pub struct Law {
    /// True if the sun's direct light is a separate stream.
    pub is_apart: bool,
    /// True if light groups are apart too.
    pub are_lamps_apart: bool,
    /// Indices of layers with a curve, and it.
    curves: Vec<(usize, Curve)>,
}

impl Law {
    /// Of a dataset. `is_apart` leaves the sun's direct light out, which only works where [`can_omit_sun`].
    pub fn new(dataset: &Dataset, is_apart: bool) -> Result<Self> {
        let config = &dataset.config;
        let mut curves = Vec::new();
        for (i, layer) in config.layers.iter().enumerate() {
            if let Some(file) = layer.curve.as_ref().filter(|_| !(is_apart && layer.is_direct_sun())) {
                curves.push((i, Curve::read(&dataset.verified(file)?)?));
            }
        }
        Ok(Law { is_apart, are_lamps_apart: false, curves })
    }

    /// The same without the light of light groups, which [`can_part_lamps`] must allow.
    pub fn without_lamps(self) -> Self {
        Law { are_lamps_apart: true, ..self }
    }

    /// True if maps hold sums of layers, not frames.
    fn sums_layers(&self) -> bool {
        self.is_apart || self.are_lamps_apart
    }

    /// True if a layer is interpolated by a curve, so that tiles need means between frames.
    pub fn has_curves(&self) -> bool {
        !self.curves.is_empty()
    }

    /// The layers that decide maps, their means or their gates.
    pub fn layers<'a>(&'a self, config: &'a Config) -> impl Iterator<Item = &'a Layer> {
        let is_read = |i: usize, layer: &Layer| {
            self.sums_layers() || layer.light == Light::Group || self.curves.iter().any(|(of, _)| *of == i)
        };
        config.layers.iter().enumerate().filter(move |(i, layer)| is_read(*i, layer)).map(|(_, layer)| layer)
    }

    /// The files whose sum the maps hold of a page at a frame: frames of the same files are the same.
    pub fn files<'a>(&self, dataset: &'a Dataset, frame: usize, page: usize) -> Vec<&'a str> {
        let config = &dataset.config;
        if !self.sums_layers() {
            return vec![&config.frames[frame].maps[page].path];
        }
        let daylight = self.daylight(config).filter_map(|(_, layer)| layer.file(frame, page));
        let local = self.local(config, frame, page).into_iter();
        daylight.chain(local).map(|file| file.path.as_str()).collect()
    }

    /// The light that maps hold of some rows of a page at a frame; and per curve that of its layer, where it
    /// is not black.
    pub fn rows<'a>(
        &self,
        dataset: &'a Dataset,
        [frame, page]: [usize; 2],
        [y0, y1]: [usize; 2],
        kept: &mut LayerRows<'a>,
    ) -> Result<Rows> {
        let config = &dataset.config;
        let read = |file: &FileRef| dataset.image_rows(file, page, y0, y1);
        let of_curve =
            |(layer, _): &(usize, Curve)| config.layers[*layer].file(frame, page).map(&read).transpose();
        let layers = self.curves.iter().map(of_curve).collect::<Result<Vec<_>>>()?;
        if !self.sums_layers() {
            return Ok((dataset.map_rows(frame, page, y0, y1)?, layers));
        }
        if config.layers.is_empty() || self.is_apart && config.layers.iter().any(Layer::is_whole_sun) {
            let what = "has no separate layers of the sun's direct light, so the light without it is unknown";
            return Err(Error::unsupported(dataset.root.display(), what));
        }
        // ((sun indirect + sky) + local), as in frames but for the sun's direct light.
        let mut sum = vec![[0.0f32; 3]; config.pages[page].width as usize * (y1 - y0)];
        let mut add = |texels: &[[f32; 3]]| {
            sum.iter_mut().flatten().zip(texels.as_flattened()).for_each(|(sum, texel)| *sum += texel);
        };
        for (i, layer) in self.daylight(config) {
            match self.curves.iter().position(|(of, _)| *of == i) {
                Some(at) => layers[at].iter().for_each(|texels| add(texels)),
                None => layer.file(frame, page).map(&read).transpose()?.iter().for_each(|texels| add(texels)),
            }
        }
        // The light of lamps is the same in many frames.
        for file in self.local(config, frame, page) {
            if !kept.contains_key(file.path.as_str()) {
                kept.insert(&file.path, read(file)?);
            }
            add(&kept[file.path.as_str()]);
        }
        Ok((sum, layers))
    }

    /// All light of a dataset but the sun's direct light, if `is_apart`; without curves.
    pub fn of(is_apart: bool) -> Self {
        Law { is_apart, are_lamps_apart: false, curves: Vec::new() }
    }

    /// The layers of the sun's and the sky's light that maps hold, with their indices.
    fn daylight<'a>(&self, config: &'a Config) -> impl Iterator<Item = (usize, &'a Layer)> {
        let is_apart = self.is_apart;
        let is_daylight = move |layer: &Layer| {
            matches!(layer.light, Light::Sun | Light::Sky) && !(is_apart && layer.is_direct_sun())
        };
        config.layers.iter().enumerate().filter(move |(_, layer)| is_daylight(layer))
    }

    /// The files of the light groups that maps hold at a frame.
    fn local<'a>(&self, config: &'a Config, frame: usize, page: usize) -> Vec<&'a FileRef> {
        match self.are_lamps_apart {
            true => Vec::new(),
            false => config.files_of_local(frame, page).into_iter().flatten().collect(),
        }
    }

    /// How far an hour is from one frame to another; and by curve and channel, by what the light of each is
    /// multiplied.
    fn weights(&self, hours: [f64; 2], hour: f64) -> (f64, Vec<[[f64; 2]; 3]>) {
        let part = (hour - hours[0]).rem_euclid(24.0) / (hours[1] - hours[0]).rem_euclid(24.0);
        (part, self.curves.iter().map(|(_, curve)| curve.weights(hours, hour.rem_euclid(24.0))).collect())
    }

    /// The light at an hour between two frames, from that of each.
    pub fn mixed(&self, hours: [f64; 2], hour: f64, rows: [&Rows; 2]) -> Vec<[f32; 3]> {
        let (part, weights) = self.weights(hours, hour);
        let texel = |i: usize, c: usize| {
            let mut light = 0.0;
            for (end, straight) in [1.0 - part, part].into_iter().enumerate() {
                let (all, layers) = rows[end];
                let mut rest = f64::from(all[i][c]);
                for (layer, weights) in layers.iter().zip(&weights) {
                    let of_layer = layer.as_ref().map_or(0.0, |layer| f64::from(layer[i][c]));
                    light += weights[c][end] * of_layer;
                    rest -= of_layer;
                }
                light += straight * rest.max(0.0);
            }
            light.min(f64::from(f32::MAX)) as f32
        };
        (0..rows[0].0.len()).map(|i| [0, 1, 2].map(|c| texel(i, c))).collect()
    }

    /// Hours between frames at which tiles' means are stored, by the light of all pages.
    pub fn hours(&self, dataset: &Dataset, masks: &[Mask], timeline: &Timeline) -> Result<Vec<f64>> {
        if self.curves.is_empty() {
            return Ok(Vec::new());
        }
        let shares = (0..timeline.hours.len())
            .map(|frame| self.shares_of_pages(dataset, masks, frame))
            .collect::<Result<Vec<_>>>()?;
        let brightest = shares.iter().flat_map(|shares| shares.all).fold(0.0, f64::max);
        let mut found = Vec::new();
        for a in 0..timeline.hours.len() {
            let b = (a + 1) % timeline.hours.len();
            let span = (timeline.hours[b] - timeline.hours[a]).rem_euclid(24.0);
            let hour = |i: usize| (timeline.hours[a] + i as f64 * STEP).rem_euclid(24.0);
            let steps = (span / STEP).ceil() as usize;
            // The frame, minutes between frames that are both shown, and the other frame.
            let is_between = |i: &usize| {
                let point = timeline.at(hour(*i));
                (point.a, point.b) == (a, b)
            };
            let mut minutes: Vec<f64> = (1..steps).filter(is_between).map(|i| i as f64 * STEP).collect();
            if a == b || minutes.is_empty() || span > WIDEST {
                continue;
            }
            minutes.insert(0, 0.0);
            minutes.push(span);
            let light: Vec<[f64; 3]> = minutes
                .iter()
                .map(|minute| {
                    let weighed =
                        self.weighed(timeline, [a, b], timeline.hours[a] + minute, [&shares[a], &shares[b]]);
                    std::array::from_fn(|c| weighed.iter().flatten().map(|part| part[c]).sum())
                })
                .collect();
            let is_on_line = |from: usize, i: usize, to: usize| {
                let part = (minutes[i] - minutes[from]) / (minutes[to] - minutes[from]);
                (0..3).all(|c| {
                    let line = light[from][c] + (light[to][c] - light[from][c]) * part;
                    (line - light[i][c]).abs() <= (WRONG * light[i][c]).max(TRIFLE * brightest)
                })
            };
            // Without the frames themselves.
            let last = minutes.len() - 1;
            let between = kept(last, is_on_line).into_iter().filter(|i| (1..last).contains(i));
            found.extend(between.map(|i| (timeline.hours[a] + minutes[i]).rem_euclid(24.0)));
        }
        found.sort_by(f64::total_cmp);
        found.dedup();
        Ok(found)
    }

    /// Means over the valid texels of all pages at a frame.
    fn shares_of_pages(&self, dataset: &Dataset, masks: &[Mask], frame: usize) -> Result<Shares> {
        let mut sums = Sums::new(self);
        for (page, mask) in masks.iter().enumerate() {
            let height = (TEXELS / mask.width).max(1);
            for y0 in (0..mask.height).step_by(height) {
                stop_if_interrupted()?;
                let rows = [y0, (y0 + height).min(mask.height)];
                let light = self.rows(dataset, [frame, page], rows, &mut LayerRows::new())?;
                let valid = &mask.valid[rows[0] * mask.width..rows[1] * mask.width];
                sums.add(&light, (0..valid.len()).filter(|i| valid[*i]));
            }
        }
        Ok(sums.mean())
    }

    /// Of the light at an hour between two frames, what stems from each: by curve, then the rest.
    fn weighed(
        &self,
        timeline: &Timeline,
        frames: [usize; 2],
        hour: f64,
        shares: [&Shares; 2],
    ) -> [Vec<[f64; 3]>; 2] {
        let hours = frames.map(|frame| timeline.hours[frame]);
        let (part, weights) = self.weights(hours, hour);
        [0, 1].map(|end| {
            let straight = [1.0 - part, part][end];
            let weight = |i: usize, c: usize| weights.get(i).map_or(straight, |weights| weights[c][end]);
            let parts = shares[end].parts();
            parts.iter().enumerate().map(|(i, light)| [0, 1, 2].map(|c| weight(i, c) * light[c])).collect()
        })
    }

    /// The knots of a tile from those of its frames, by the shares of its light at each.
    pub fn knots(&self, timeline: &Timeline, of_frames: &[Knot], shares: &[Shares]) -> Vec<Knot> {
        let mut knots: BTreeMap<usize, Knot> = BTreeMap::new();
        knots.extend(of_frames.iter().enumerate().map(|(frame, knot)| (timeline.knot_of(frame), *knot)));
        for &hour in &timeline.between {
            let TimePoint { a, b, knots: [at, _], .. } = timeline.at(hour);
            let weighed = self.weighed(timeline, [a, b], hour, [&shares[a], &shares[b]]);
            // A tile's scale is its mean, or more where that is too little.
            let scaled = |frame: usize, light: &[f64; 3]| -> [f64; 3] {
                std::array::from_fn(|c| match shares[frame].all[c] {
                    mean if mean > 0.0 => light[c] / mean * f64::from(of_frames[frame].mean[c]),
                    _ => 0.0,
                })
            };
            let parts = |frame: usize, parts: &[[f64; 3]]| {
                parts.iter().map(|part| scaled(frame, part)).collect::<Vec<_>>()
            };
            let (of_a, of_b) = (parts(a, &weighed[0]), parts(b, &weighed[1]));
            let (whole_a, whole_b) = (parts(a, &shares[a].parts()), parts(b, &shares[b].parts()));
            let peak =
                |frame: usize, light: &[[f64; 3]]| match crate::time::brightness(&of_frames[frame].mean) {
                    whole if whole > 0.0 => f64::from(of_frames[frame].peak) * sum(light) / whole,
                    _ => 0.0,
                };
            let knot = Knot {
                mean: std::array::from_fn(|c| {
                    of_a.iter().chain(&of_b).map(|part| part[c]).sum::<f64>() as f32
                }),
                peak: (peak(a, &of_a) + peak(b, &of_b)) as f32,
                share: share([&whole_a, &whole_b], [&of_a, &of_b]) as f32,
            };
            knots.insert(at, knot);
        }
        knots.into_values().collect()
    }
}

/// Light of texels: all that the maps hold, and per curve its layer's, where it is not black.
pub type Rows = (Vec<[f32; 3]>, Vec<Option<Vec<[f32; 3]>>>);

/// Sums of light over texels.
#[derive(Debug)]
pub struct Sums {
    /// By curve, and of all light.
    sums: Vec<[f64; 3]>,
    texels: usize,
}

impl Sums {
    /// Of nothing yet.
    pub fn new(law: &Law) -> Self {
        Sums { sums: vec![[0.0; 3]; law.curves.len() + 1], texels: 0 }
    }

    /// Adds the texels of these indices.
    pub fn add(&mut self, (all, layers): &Rows, texels: impl Iterator<Item = usize>) {
        let light: Vec<_> = layers.iter().map(Option::as_ref).chain([Some(all)]).collect();
        for i in texels {
            self.texels += 1;
            for (sum, light) in self.sums.iter_mut().zip(&light) {
                (0..3).for_each(|c| sum[c] += light.map_or(0.0, |light| f64::from(light[i][c])));
            }
        }
    }

    /// Their means.
    pub fn mean(&self) -> Shares {
        let mean = |sum: &[f64; 3]| sum.map(|sum| sum / self.texels.max(1) as f64);
        let (all, of_curves) = self.sums.split_last().expect("all light is there");
        Shares { of_curves: of_curves.iter().map(mean).collect(), all: mean(all) }
    }
}

/// Rows of files that several frames name.
pub type LayerRows<'a> = BTreeMap<&'a str, Vec<[f32; 3]>>;

/// True if a dataset has the sun's direct light at any time: as a separate layer, with visibility.
pub fn is_sun_apart(config: &Config) -> bool {
    config.visibility.is_some() && config.sun_path.is_some() && config.layers.iter().any(Layer::is_direct_sun)
}

/// True if a dataset has the sun's direct light as a separate layer, so it can be omitted.
pub fn can_omit_sun(config: &Config) -> bool {
    config.layers.iter().any(Layer::is_direct_sun) && !config.layers.iter().any(Layer::is_whole_sun)
}

/// True if a dataset keeps the light of each light group as a layer, so that its maps can leave lamps out.
pub fn can_part_lamps(config: &Config, is_sun_apart: bool) -> bool {
    let is_lit = |group: usize| config.frames.iter().any(|frame| frame.groups_on[group]);
    let has_layer = |group: usize| config.layers_of(Light::Group, Some(group as u32)).next().is_some();
    // (An imported dataset may have all its lamps as one layer that changes.)
    config.layers.iter().any(|layer| layer.light == Light::Group)
        && config.layers_of(Light::Lamps, None).next().is_none()
        && !(is_sun_apart && config.layers.iter().any(Layer::is_whole_sun))
        && (0..config.groups.len()).all(|group| !is_lit(group) || has_layer(group))
}
