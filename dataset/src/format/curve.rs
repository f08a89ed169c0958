//! Curves: how a layer's light is interpolated between two frames; a layer of [`super::config`] names its
//! curve's file.
//!
//! A light that changes by powers of ten in an hour is far from linear between two frames, but its share of a
//! known quantity is not: of the sky's light, the share of its irradiance on level ground; of what surfaces
//! reflect of the sun, that of the sun's on the surfaces around. A curve s(t) is such a quantity over the
//! day, up to a factor. Between frames at a and b, u of the way from a to b, light is
//!
//! v(t) = s(t) · ((1 − u) · v(a) ÷ s(a) + u · v(b) ÷ s(b))
//!
//! per red, green and blue.

use super::visibility::Between;
use crate::Result;
use crate::host::files::read_checked;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A quantity over the day to which a light is nearly proportional between frames. Between two times it is
/// linear.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Curve {
    /// Ascending, from 0 to 24.
    pub hours: Vec<f64>,
    /// Per time, red, green and blue, 0 or more. Its unit does not matter.
    pub values: Vec<[f32; 3]>,
}

impl Curve {
    /// The bytes of a file.
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("numbers are JSON")
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::Invalid`] with the time whose value is wrong.
    pub fn read(path: &Path) -> Result<Self> {
        read_checked(path, Curve::fault)
    }

    /// A message if it is invalid.
    fn fault(&self) -> Option<String> {
        let (hours, values) = (self.hours.len(), self.values.len());
        if hours != values {
            return Some(format!("{hours} hours and {values} values; expected one value per hour"));
        }
        let ascend = self.hours.windows(2).all(|pair| pair[0] < pair[1]);
        if !ascend || self.hours.first() != Some(&0.0) || self.hours.last() != Some(&24.0) {
            return Some("hours: expected ascending hours from 0 to 24".to_owned());
        }
        let is_light = |value: &[f32; 3]| value.iter().all(|x| x.is_finite() && *x >= 0.0);
        let i = self.values.iter().position(|value| !is_light(value))?;
        Some(format!("value {i}: {:?}; expected finite numbers ≥ 0", self.values[i]))
    }

    /// Its value at an hour.
    pub fn at(&self, hour: f64) -> [f64; 3] {
        let Between { before, after, part } = Between::new(&self.hours, hour);
        std::array::from_fn(|c| {
            let [a, b] = [before, after].map(|i| f64::from(self.values[i][c]));
            a + (b - a) * part
        })
    }

    /// Weights of the frames before and after an hour, per red, green and blue; the light at the hour is the
    /// weighted sum. `frames`: the hours of the frames, at most a day apart; where the first is not below the
    /// second, midnight lies between them.
    ///
    /// Where the curve is 0 at one frame, the share of the other frame is used. Where it is 0 at both, light
    /// is linear.
    pub fn weights(&self, frames: [f64; 2], hour: f64) -> [[f64; 2]; 3] {
        let part = way(frames, hour);
        let [s, a, b] = [hour, frames[0], frames[1]].map(|hour| self.at(hour));
        std::array::from_fn(|c| match (a[c] > 0.0, b[c] > 0.0) {
            (true, true) => [s[c] / a[c] * (1.0 - part), s[c] / b[c] * part],
            (true, false) => [s[c] / a[c], 0.0],
            (false, true) => [0.0, s[c] / b[c]],
            (false, false) => [1.0 - part, part],
        })
    }

    /// As few of its times as hold all of its values to a share of themselves.
    pub fn thinned(&self, share: f64) -> Self {
        let is_on_line = |a: usize, i: usize, b: usize| {
            let part = part_of([self.hours[a], self.hours[b]], self.hours[i]);
            (0..3).all(|c| {
                let [from, value, to] = [a, i, b].map(|i| f64::from(self.values[i][c]));
                (from + (to - from) * part - value).abs() <= share * value
            })
        };
        let Some(last) = self.hours.len().checked_sub(1) else { return self.clone() };
        let kept = kept(last, is_on_line);
        Curve {
            hours: kept.iter().map(|&i| self.hours[i]).collect(),
            values: kept.iter().map(|&i| self.values[i]).collect(),
        }
    }
}

/// As few of the points from 0 to `last` as hold the others: `is_on_line(from, i, to)` of every point `i`
/// between two that follow each other.
pub fn kept(last: usize, is_on_line: impl Fn(usize, usize, usize) -> bool) -> Vec<usize> {
    let (mut kept, mut at) = (vec![0], 0);
    while at < last {
        // One by one: a point that can be reached stays one that can be tried from.
        let next = (at + 2..=last).take_while(|&next| (at + 1..next).all(|i| is_on_line(at, i, next))).last();
        at = next.unwrap_or(at + 1);
        kept.push(at);
    }
    kept
}

/// How far an hour is from one to another, from 0 to 1.
fn part_of([from, to]: [f64; 2], hour: f64) -> f64 {
    if to > from { ((hour - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 }
}

/// How far an hour is from one frame to the next, from 0 to 1, on the circle of the day.
pub fn way([from, to]: [f64; 2], hour: f64) -> f64 {
    let later = |hour: f64| if hour < from { hour + 24.0 } else { hour };
    let to = if to <= from { to + 24.0 } else { to };
    part_of([from, to], later(hour))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(values: &[(f64, f32)]) -> Curve {
        Curve {
            hours: values.iter().map(|(hour, _)| *hour).collect(),
            values: values.iter().map(|(_, value)| [*value, 2.0 * value, 0.0]).collect(),
        }
    }

    #[test]
    fn a_constant_share_of_the_curve_is_met_at_every_hour() {
        let dusk = curve(&[(0.0, 1e-6), (18.0, 10.0), (19.0, 1.0), (20.0, 1e-5), (24.0, 1e-6)]);
        for (frames, hour) in
            [([18.0, 20.0], 18.3), ([18.0, 20.0], 19.5), ([20.0, 18.0], 23.0), ([20.0, 18.0], 5.0)]
        {
            let weights = dusk.weights(frames, hour);
            for (c, [before, after]) in weights.into_iter().enumerate().take(2) {
                let light = frames.map(|hour| 0.3 * dusk.at(hour)[c]);
                let found = before * light[0] + after * light[1];
                let expected = 0.3 * dusk.at(hour)[c];
                assert!((found / expected - 1.0).abs() < 1e-12, "{hour}: {found} {expected}");
            }
            // Of a curve that is 0 nothing is known: linear.
            let part = way(frames, hour);
            assert_eq!(weights[2], [1.0 - part, part]);
        }
    }

    #[test]
    fn a_share_that_changes_goes_linearly() {
        let even = curve(&[(0.0, 4.0), (24.0, 4.0)]);
        assert_eq!(even.weights([6.0, 10.0], 7.0)[0], [0.75, 0.25]);
        // Across midnight: 22 h, 2 h and half of the way.
        assert_eq!(even.weights([22.0, 2.0], 0.0)[0], [0.5, 0.5]);
        assert_eq!(even.weights([22.0, 2.0], 24.0)[0], [0.5, 0.5]);
        // One frame alone.
        assert_eq!(even.weights([12.0, 12.0], 12.0)[0], [1.0, 0.0]);
    }

    #[test]
    fn a_frame_without_light_leaves_the_share_to_the_other() {
        let sunrise = curve(&[(0.0, 0.0), (6.0, 0.0), (8.0, 2.0), (20.0, 0.0), (24.0, 0.0)]);
        assert_eq!(sunrise.weights([6.0, 8.0], 7.0)[0], [0.0, 0.5]);
        assert_eq!(sunrise.weights([8.0, 20.0], 14.0)[0], [0.5, 0.0]);
        assert_eq!(sunrise.weights([20.0, 4.0], 23.0)[0], [0.625, 0.375]);
    }

    #[test]
    fn thinned_curves_keep_what_they_are() {
        let hours: Vec<f64> = (0..=1440).map(|minute| f64::from(minute) / 60.0).collect();
        let light =
            |hour: f64| if hour < 6.0 { 0.0 } else { (1e-4 + (-(hour - 13.0).powi(2) / 3.0).exp()) as f32 };
        let full = Curve { values: hours.iter().map(|&h| [light(h), 1.0, 0.0]).collect(), hours };
        let thin = full.thinned(1e-3);
        assert!(thin.hours.len() < 400, "{}", thin.hours.len());
        assert_eq!(thin.fault(), None);
        for &hour in &full.hours {
            let (expected, found) = (full.at(hour)[0], thin.at(hour)[0]);
            assert!((found - expected).abs() <= 1e-3 * expected + 1e-12, "{hour}: {found} {expected}");
        }
        let two = curve(&[(0.0, 1.0), (24.0, 2.0)]);
        assert_eq!(two.thinned(1e-3), two);
        assert_eq!(curve(&[(0.0, 3.0), (5.0, 3.0), (24.0, 3.0)]).thinned(1e-3).hours, [0.0, 24.0]);
    }

    #[test]
    fn wrong_values_are_named() {
        let good = curve(&[(0.0, 1.0), (24.0, 1.0)]);
        assert_eq!(good.fault(), None);
        for (curve, expected) in [
            (Curve::default(), "hours: expected"),
            (Curve { hours: vec![0.0, 23.0], ..good.clone() }, "hours: expected"),
            (Curve { hours: vec![24.0, 0.0], ..good.clone() }, "hours: expected"),
            (Curve { hours: vec![f64::NAN, 24.0], ..good.clone() }, "hours: expected"),
            (Curve { values: vec![[1.0; 3], [-1.0; 3]], ..good.clone() }, "value 1"),
            (Curve { values: vec![[f32::INFINITY; 3], [1.0; 3]], ..good.clone() }, "value 0"),
            (Curve { values: Vec::new(), ..good.clone() }, "2 hours and 0 values"),
        ] {
            assert!(curve.fault().is_some_and(|what| what.contains(expected)), "{expected}");
        }
    }
}
