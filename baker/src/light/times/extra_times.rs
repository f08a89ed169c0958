//! Extra times: where lightmaps of the hours asked for, interpolated, would miss how smooth light goes.
//!
//! Smooth light is what comes from the sky and what surfaces reflect of the sun; lightmaps are interpolated
//! linearly between times. At dawn and dusk it falls by powers of ten in an hour. How the mean of a page goes
//! is known well enough from the sun and the sky alone, so that the times are found before any ray is traced.

use super::schedule::{self, Hours, TimePoint, is_on};
use crate::light::daylight::{Illuminance, sun};
use crate::light::luminance;
use crate::scene::{Baked, Scene};
use serde::Serialize;

/// Extra times of a day at most, where nothing else is asked for.
pub const MOST_EXTRA_TIMES: u32 = 6;

/// Times are added until interpolated light errs by no more than this share of itself, at any minute.
pub const MOST_ERROR: f64 = 0.05;

/// Times no farther apart than this many micro-hours get none between them: ten minutes, so that 240 hours a
/// day are what was asked for.
const LEAST_GAP: i64 = 10 * 1_000_000 / 60;

/// Light below this share of the day's greatest counts as this much: by night an error is none that anyone
/// sees.
const DARK_SHARE: f64 = 1e-3;

/// What surfaces reflect of the sun, next to the light of a sky of the same irradiance on level ground: of
/// the sun's on level ground, and of that on walls that face it. Between those of a yard (0.11, 0.007) and of
/// a room with windows to the sun (0.6, 0.3).
const REFLECTED_BY_GROUND: f64 = 0.25;
const REFLECTED_BY_WALLS: f64 = 0.05;

/// Micro-hours in a day.
const DAY: i64 = 24_000_000;

/// The times added to those asked for, and how far interpolated light errs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ExtraTimes {
    /// Ascending.
    pub added: Vec<ExtraTime>,
    /// The greatest error at any minute without them, as a share of the light; `None` where it is not looked
    /// for: nothing changes, or there is nothing to interpolate for more than ten minutes.
    pub error_before: Option<f64>,
    /// The greatest error with them.
    pub error_after: Option<f64>,
}

/// A time that was added.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ExtraTime {
    /// A whole minute, in [0, 24).
    pub hour: f64,
    /// The greatest error between its neighbours among the hours asked for and the switches, as a share of
    /// the light.
    pub error_before: f64,
    /// The greatest error between it and the times next to it.
    pub error_after: f64,
}

impl ExtraTimes {
    /// Why there are none, or not enough, in words.
    pub fn skipped(&self) -> Option<String> {
        let (before, after) = (self.error_before?, self.error_after?);
        if self.added.is_empty() && before <= MOST_ERROR {
            return Some(format!(
                "no extra times: light of sky and sun interpolated linearly between the frames errs by {} at most",
                percent(before)
            ));
        }
        (after > MOST_ERROR).then(|| {
            format!(
                "no more than {} (--extra-times): light of sky and sun interpolated linearly between the frames errs by up to {}",
                dataset::observe::count(self.added.len(), "extra time"),
                percent(after)
            )
        })
    }
}

/// Such as `4.2 %`.
pub fn percent(share: f64) -> String {
    if share < 0.0995 { format!("{:.1} %", share * 100.0) } else { format!("{:.0} %", share * 100.0) }
}

/// The times of a bake: those of [`schedule::time_points`], and at most `most` more where interpolated light
/// would err.
pub fn all_times(scene: &Scene, hours: &Hours, most: u32) -> (Vec<TimePoint>, ExtraTimes) {
    let mut points = schedule::time_points(hours, &scene.groups);
    if hours.ranges.is_empty() {
        return (points, ExtraTimes::default());
    }
    let asked = gaps(&points, hours, &Smooth::new(scene));
    if is_steady(&asked) {
        return (points, ExtraTimes::default());
    }
    let worst = |gaps: &[Gap]| gaps.iter().map(Gap::error).fold(0.0, f64::max);
    let error_before = worst(&asked);
    let cuts = cuts(&asked, most as usize);
    let gaps: Vec<Gap> = asked.iter().zip(&cuts).flat_map(|(gap, cuts)| gap.cut(cuts)).collect();
    let times = asked.iter().zip(&cuts).flat_map(|(gap, cuts)| cuts.iter().map(|&at| gap.light[at].0));
    let mut times: Vec<i64> = times.collect();
    times.sort_by_key(|time| time.rem_euclid(DAY));
    let added = times.iter().map(|&time| ExtraTime {
        hour: hour_of(time),
        error_before: asked.iter().filter(|gap| gap.holds(time)).map(Gap::error).fold(0.0, f64::max),
        error_after: gaps.iter().filter(|gap| gap.touches(time)).map(Gap::error).fold(0.0, f64::max),
    });
    let extra = ExtraTimes {
        added: added.collect(),
        error_before: Some(error_before),
        error_after: Some(worst(&gaps)),
    };
    points.extend(extra.added.iter().map(|time| TimePoint {
        hour: time.hour,
        groups_on: scene.groups.iter().map(|group| is_on(&group.on, time.hour)).collect(),
        extra: false,
        refines: true,
    }));
    points.sort_by(|a, b| a.hour.total_cmp(&b.hour));
    (points, extra)
}

/// A time in micro-hours as an hour of the day.
fn hour_of(time: i64) -> f64 {
    time.rem_euclid(DAY) as f64 / 1e6
}

/// The smooth light of a page, up to a factor, as the sun and the sky alone tell it.
struct Smooth<'a> {
    scene: &'a Scene,
    sky: Illuminance<'a>,
}

impl<'a> Smooth<'a> {
    fn new(scene: &'a Scene) -> Self {
        let sky = scene.sky.as_ref().filter(|_| scene.sky_baked != Baked::None);
        Smooth { scene, sky: Illuminance::new(sky, scene.location.as_ref()) }
    }

    fn at(&self, hour: f64) -> f64 {
        let sun = self.scene.sun.as_ref().filter(|_| self.scene.sun_baked != Baked::None);
        let of_sun =
            sun.and_then(|sun| sun::at(sun, self.scene.location.as_ref(), hour)).map_or(0.0, |disc| {
                let height = f64::from(disc.direction.y.clamp(0.0, 1.0));
                let along = (1.0 - height * height).sqrt();
                f64::from(luminance(disc.irradiance))
                    * (REFLECTED_BY_GROUND * height + REFLECTED_BY_WALLS * along)
            });
        self.sky.at(hour) + of_sun
    }
}

/// A gap between two neighbouring times between which light is interpolated.
#[derive(Clone, Debug)]
struct Gap {
    /// Times in micro-hours, the first and the last those of time points, the others whole minutes; and the
    /// light at each. The last may be past midnight.
    light: Vec<(i64, f64)>,
    /// Light below this counts as this much.
    floor: f64,
}

impl Gap {
    /// The light of every whole minute between two times.
    fn new([from, to]: [i64; 2], smooth: &Smooth) -> Self {
        let minutes =
            (from * 60 / 1_000_000..=to * 60 / 1_000_000 + 1).map(|minute| (minute * 1_000_000 + 30) / 60);
        let between = minutes.filter(|&time| from < time && time < to);
        let times = std::iter::once(from).chain(between).chain([to]);
        Gap { light: times.map(|time| (time, smooth.at(hour_of(time)))).collect(), floor: 0.0 }
    }

    fn greatest(&self) -> f64 {
        self.light.iter().map(|(_, light)| *light).fold(0.0, f64::max)
    }

    /// The greatest error at any minute of light that goes linearly from end to end.
    fn error(&self) -> f64 {
        let last = self.light.len() - 1;
        (0..=last).map(|at| self.error_at(at, 0, last)).fold(0.0, f64::max)
    }

    /// The error at one minute of light that goes linearly from another to a third.
    fn error_at(&self, at: usize, a: usize, b: usize) -> f64 {
        let ((from, first), (to, last), (time, light)) = (self.light[a], self.light[b], self.light[at]);
        let t = (time - from) as f64 / (to - from) as f64;
        (first + (last - first) * t - light).abs() / light.max(self.floor).max(f64::MIN_POSITIVE)
    }

    /// Whether light that goes linearly from one minute to another errs nowhere by more than a bound.
    fn is_within(&self, bound: f64, a: usize, b: usize) -> bool {
        (a + 1..b).all(|at| self.error_at(at, a, b) <= bound)
    }

    /// The fewest minutes to cut at so that no part errs by more than a bound, none if that takes more than
    /// `most`.
    fn cuts(&self, bound: f64, most: usize) -> Option<Vec<usize>> {
        let last = self.light.len() - 1;
        let (mut cuts, mut at) = (Vec::new(), 0);
        loop {
            // As far as light may be interpolated; neighbouring minutes have nothing between them.
            let next = (at + 2..=last).rev().find(|&next| self.is_within(bound, at, next));
            at = next.unwrap_or(at + 1);
            if at >= last {
                return Some(cuts);
            }
            if cuts.len() == most {
                return None;
            }
            cuts.push(at);
        }
    }

    /// The parts between cuts.
    fn cut(&self, cuts: &[usize]) -> Vec<Gap> {
        let ends: Vec<usize> =
            std::iter::once(0).chain(cuts.iter().copied()).chain([self.light.len() - 1]).collect();
        let part = |pair: &[usize]| Gap { light: self.light[pair[0]..=pair[1]].to_vec(), floor: self.floor };
        ends.windows(2).map(part).collect()
    }

    /// Whether a time lies between the ends.
    fn holds(&self, time: i64) -> bool {
        self.light[0].0 < time && time < self.light[self.light.len() - 1].0
    }

    /// Whether a time is one of the ends.
    fn touches(&self, time: i64) -> bool {
        self.light[0].0 == time || self.light[self.light.len() - 1].0 == time
    }
}

/// The stretches of time over which light is interpolated: within the ranges that were asked for, between
/// times that show the same lamps and are not close to each other.
fn gaps(points: &[TimePoint], hours: &Hours, smooth: &Smooth) -> Vec<Gap> {
    let micro = |hour: f64| (hour * 1e6).round() as i64;
    let next = |k: usize| match points.get(k + 1) {
        Some(next) => (micro(next.hour), next),
        // Around midnight.
        None => (micro(points[0].hour) + DAY, &points[0]),
    };
    let pairs = points.iter().enumerate().filter_map(|(k, point)| {
        let (from, (to, next)) = (micro(point.hour), next(k));
        let is_asked = hours.spans([point.hour, to as f64 / 1e6]);
        (is_asked && to - from > LEAST_GAP && point.groups_on == next.groups_on).then_some([from, to])
    });
    let mut gaps: Vec<Gap> = pairs.map(|pair| Gap::new(pair, smooth)).collect();
    let floor = DARK_SHARE * gaps.iter().map(Gap::greatest).fold(0.0, f64::max);
    gaps.iter_mut().for_each(|gap| gap.floor = floor);
    gaps
}

/// Per gap where to cut it: the cuts, no more than `most` in all, that leave the least error, or as few as
/// leave [`MOST_ERROR`].
fn cuts(gaps: &[Gap], most: usize) -> Vec<Vec<usize>> {
    let within = |bound: f64| {
        let mut left = most;
        let of_gap = |gap: &Gap| {
            let cuts = gap.cuts(bound, left)?;
            left -= cuts.len();
            Some(cuts)
        };
        gaps.iter().map(of_gap).collect::<Option<Vec<_>>>()
    };
    if let Some(cuts) = within(MOST_ERROR) {
        return cuts;
    }
    // The bound is not reached: the least that is, in between, to a thousandth of itself.
    let mut high = gaps.iter().map(Gap::error).fold(MOST_ERROR, f64::max);
    let (mut low, mut best) = (MOST_ERROR, vec![Vec::new(); gaps.len()]);
    while high > low * 1.001 {
        let middle = (low * high).sqrt();
        match within(middle) {
            Some(cuts) => (high, best) = (middle, cuts),
            None => low = middle,
        }
    }
    best
}

/// Whether light never changes.
fn is_steady(gaps: &[Gap]) -> bool {
    let mut light = gaps.iter().flat_map(|gap| &gap.light).map(|(_, light)| *light);
    light.next().is_none_or(|first| light.all(|other| other == first))
}

#[cfg(test)]
#[path = "extra_times_tests.rs"]
mod tests;
