//! The sun over the day, and what it gives a surface: the file that [`super::config`] names as the sun's
//! path.

use super::visibility::Between;
use crate::host::files::read_checked;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The sun by the minute. Between two times direction and irradiance are interpolated linearly, component by
/// component; outside of all times there is no sun.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SunPath {
    /// Ascending, in hours from 0 to 24; at least one.
    pub hours: Vec<f64>,
    /// Per time, the mean direction towards the visible part of the disc, as a vector whose length is 1 for a
    /// small disc and less for a wide one. x, y (up), z as in the geometry.
    pub direction: Vec<[f32; 3]>,
    /// Per time, the irradiance of a surface that faces the disc, red, green and blue, in the unit of the
    /// lightmaps.
    pub irradiance: Vec<[f32; 3]>,
}

impl SunPath {
    /// The bytes of a file.
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("numbers are JSON")
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Invalid`] with the key and the time whose value is wrong.
    pub fn read(path: &Path) -> Result<Self> {
        read_checked(path, SunPath::fault)
    }

    /// What is wrong with its values.
    fn fault(&self) -> Option<String> {
        let times = self.hours.len();
        if times == 0 || self.direction.len() != times || self.irradiance.len() != times {
            let found = format!(
                "{times} hours, {} directions, {} irradiances",
                self.direction.len(),
                self.irradiance.len()
            );
            return Some(format!("{found}; expected equal numbers ≥ 1"));
        }
        let ascend = self.hours.windows(2).all(|pair| pair[0] < pair[1]);
        if !ascend || self.hours.iter().any(|hour| !(0.0..=24.0).contains(hour)) {
            return Some("hours: expected ascending hours from 0 to 24".to_owned());
        }
        let is_direction = |d: &[f32; 3]| d.iter().map(|x| x * x).sum::<f32>().sqrt() <= 1.0 + 1e-6;
        if let Some(i) = self.direction.iter().position(|direction| !is_direction(direction)) {
            return Some(format!("direction {i}: {:?}; expected a vector of length ≤ 1", self.direction[i]));
        }
        let is_light = |e: &[f32; 3]| e.iter().all(|x| x.is_finite() && *x >= 0.0);
        let i = self.irradiance.iter().position(|irradiance| !is_light(irradiance))?;
        Some(format!("irradiance {i}: {:?}; expected finite numbers ≥ 0", self.irradiance[i]))
    }

    /// Mean direction and irradiance at an hour; `None` before the first time and after the last.
    pub fn at(&self, hour: f64) -> Option<([f32; 3], [f32; 3])> {
        let (first, last) = (self.hours.first()?, self.hours.last()?);
        if !(*first..=*last).contains(&hour) {
            return None;
        }
        let between = Between::new(&self.hours, hour);
        let lerp = |values: &[[f32; 3]]| {
            let [a, b] = [between.before, between.after].map(|i| values[i]);
            std::array::from_fn(|c| between.lerp(a[c], b[c]))
        };
        Some((lerp(&self.direction), lerp(&self.irradiance)))
    }

    /// The error of an hour before the first time or after the last.
    pub fn outside(&self, place: impl ToString, hour: f64) -> Error {
        let [from, to] =
            [self.hours.first(), self.hours.last()].map(|hour| hour.copied().unwrap_or_default());
        Error::invalid(place, format!("hour {hour}; expected {from} to {to}, the range that was baked"))
    }

    /// The direct irradiance of a texel at an hour, red, green and blue: `visibility` · (`normal` ·
    /// direction)⁺ · irradiance.
    pub fn light(&self, hour: f64, normal: [f32; 3], visibility: [f32; 3]) -> [f32; 3] {
        let Some((direction, irradiance)) = self.at(hour) else { return [0.0; 3] };
        let cosine: f32 = (0..3).map(|axis| normal[axis] * direction[axis]).sum();
        std::array::from_fn(|c| visibility[c] * cosine.max(0.0) * irradiance[c])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_is_interpolated_and_gone_outside() {
        let path = SunPath {
            hours: vec![6.0, 8.0],
            direction: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            irradiance: vec![[0.0; 3], [100.0, 80.0, 60.0]],
        };
        assert_eq!(path.at(7.0), Some(([0.5, 0.5, 0.0], [50.0, 40.0, 30.0])));
        assert_eq!(path.light(8.0, [0.0, 0.5, 0.0], [1.0, 0.5, 0.0]), [50.0, 20.0, 0.0]);
        assert_eq!(path.light(8.0, [0.0, -1.0, 0.0], [1.0; 3]), [0.0; 3]);
        assert_eq!((path.at(5.9), path.at(8.1)), (None, None));
    }

    #[test]
    fn wrong_values_are_named() {
        let good = SunPath { hours: vec![6.0], direction: vec![[1.0, 0.0, 0.0]], irradiance: vec![[1.0; 3]] };
        assert_eq!(good.fault(), None);
        for (path, expected) in [
            (SunPath::default(), "0 hours"),
            (SunPath { hours: vec![25.0], ..good.clone() }, "hours: expected"),
            (SunPath { direction: vec![[1.0, 1.0, 0.0]], ..good.clone() }, "direction 0"),
            (SunPath { direction: vec![[f32::NAN; 3]], ..good.clone() }, "direction 0"),
            (SunPath { irradiance: vec![[-1.0, 0.0, 0.0]], ..good.clone() }, "irradiance 0"),
            (SunPath { irradiance: Vec::new(), ..good.clone() }, "1 hours, 1 directions, 0 irradiances"),
        ] {
            assert!(path.fault().is_some_and(|what| what.contains(expected)), "{expected}");
        }
    }
}
