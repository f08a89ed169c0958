//! The sky's radiance by direction: Hosek–Wilkie by day, twilight, night.
//!
//! Hosek and Wilkie's model covers solar elevations from 0 up. Below, a twilight follows that keeps the
//! model's last picture, fades it into a smooth one (darker and bluer overhead, a warm glow over the sun) and
//! scales both to published illuminances; from −18° on an even night sky stays.

use super::harmonics::{Harmonic, harmonics, part_at};
use super::hosek_wilkie::HosekWilkie;
use super::sky_image::ImageMap;
use super::sun;
use crate::Rgb;
use crate::light::luminance;
use crate::scene::{Location, Sky};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_PI_2, PI};

/// Radiance of the sky model itself in some directions, without the table.
pub fn radiances(sky: &Sky, location: Option<&Location>, hour: f64, directions: &[Vec3]) -> Vec<Rgb> {
    let at = SkyAt::new(sky, location, hour);
    directions.iter().map(|&direction| at.radiance(direction)).collect()
}

/// From the model's unit to kcd/m². The RGB data are colour-matched spectral radiances in W m⁻² sr⁻¹ nm⁻¹
/// summed over wavelength, so luminance is their Rec. 709 luminance × 683 lm/W; checked, not fitted: see the
/// tests for its distance from published clear-sky illuminances.
const KCD_PER_MODEL_UNIT: f32 = 0.683;

/// Horizontal illuminance in lux at solar depressions of 0°, 1°, … 18°: the polynomials of Janiczek & DeYoung
/// 1987 (US Naval Observatory Circular 171; also Seidelmann 1992, Urban & Seidelmann 2013), without moon. The
/// last one is the night sky's floor, of the order of starlight and airglow (10⁻³ lx), which then stays.
const TWILIGHT_LUX: [f64; 19] = [
    758.6, 404.6, 189.4, 79.07, 29.93, 10.44, 3.412, 1.086, 0.3481, 0.1164, 0.04211, 0.01708, 8.056e-3,
    4.557e-3, 2.916e-3, 2.023e-3, 1.443e-3, 1.003e-3, 6.447e-4,
];

/// The sky at one time.
pub(crate) enum SkyAt {
    /// The same in all directions, below the horizon too.
    Constant(Rgb),
    /// Black below the horizon.
    Dome(Dome),
    /// A picture of the whole sphere.
    Image(ImageMap),
    /// A part of a spherical harmonic.
    Harmonic(Harmonic),
}

/// The sky above the horizon as a weighted sum of pictures.
pub(crate) struct Dome {
    /// Unit vector towards the sun.
    sun: Vec3,
    /// Its horizontal part, unit (or zero at the nadir).
    azimuth: Vec3,
    /// Hosek–Wilkie at this elevation or at 0, and its weight.
    day: Option<(HosekWilkie, f32)>,
    /// Weight of the twilight picture.
    twilight: f32,
    /// Radiance of the even, white night sky.
    night: Rgb,
}

impl SkyAt {
    /// A sky that follows the sun is black without a place.
    pub(crate) fn new(sky: &Sky, location: Option<&Location>, hour: f64) -> Self {
        match (sky, location) {
            (Sky::Constant { radiance }, _) => Self::Constant(radiance.as_vec3()),
            (Sky::HosekWilkie { turbidity, ground_albedo }, Some(location)) => {
                let (sun, elevation) = sun::direction(location, hour);
                Self::Dome(Dome::new(sun, elevation, *turbidity, *ground_albedo))
            }
            (Sky::Image(image), _) => Self::Image(ImageMap::new(image)),
            (Sky::HosekWilkie { .. }, None) => Self::Constant(Rgb::ZERO),
            (Sky::Harmonics { upper }, _) => match part_at(*upper, hour) {
                Some(part) => Self::Harmonic(Harmonic { part, upper: *upper }),
                None => Self::Constant(Rgb::ZERO),
            },
        }
    }

    /// Domes never are: the night sky has a floor.
    pub(crate) fn is_black(&self) -> bool {
        match self {
            Self::Constant(radiance) => *radiance == Rgb::ZERO,
            Self::Dome(_) | Self::Harmonic(_) => false,
            Self::Image(image) => image.is_black(),
        }
    }

    /// The harmonic, if it is one.
    pub(crate) fn harmonic(&self) -> Option<Harmonic> {
        match self {
            Self::Harmonic(harmonic) => Some(*harmonic),
            _ => None,
        }
    }

    pub(crate) fn radiance(&self, direction: Vec3) -> Rgb {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Dome(dome) if direction.y >= 0.0 => dome.radiance(direction),
            Self::Dome(_) => Rgb::ZERO,
            Self::Image(image) => image.radiance(direction),
            Self::Harmonic(harmonic) => Rgb::splat(harmonic.radiance(&harmonics(direction), direction)),
        }
    }
}

impl Dome {
    /// `elevation` of the sun in degrees.
    fn new(sun: Vec3, elevation: f64, turbidity: f64, ground_albedo: f64) -> Self {
        let azimuth = sun.with_y(0.0).normalize_or_zero();
        let model = hosek_wilkie(elevation.max(0.0), turbidity, ground_albedo);
        let mut dome = Self { sun, azimuth, day: Some((model, 1.0)), twilight: 0.0, night: Rgb::ZERO };
        let depression = -elevation;
        if depression <= 0.0 {
            return dome;
        }
        // The pictures, each scaled to a horizontal illuminance of 1: the model with the sun on the horizon,
        // …
        dome.sun = azimuth;
        let sunset = horizontal_illuminance(|d| dome.radiance(d));
        let twilight = horizontal_illuminance(|d| dome.glow(d));
        // … their shares of the light: the model's until −6°, the even night's from −12° to −18°, …
        let late = smoothstep(depression / 6.0);
        let dark = smoothstep((depression - 12.0) / 6.0);
        let total = twilight_illuminance(depression, f64::from(sunset)) as f32;
        // … and the sum.
        dome.day = (late < 1.0).then(|| (model, total * (1.0 - late) / sunset));
        dome.twilight = total * late * (1.0 - dark) / twilight;
        dome.night = Rgb::splat(total * dark / PI);
        dome
    }

    /// Radiance in a direction with y ≥ 0.
    fn radiance(&self, direction: Vec3) -> Rgb {
        let mut radiance = self.night;
        if let Some((model, weight)) = &self.day {
            let theta = direction.y.clamp(0.0, 1.0).acos();
            let gamma = direction.dot(self.sun).clamp(-1.0, 1.0).acos();
            radiance += model.radiance(theta, gamma).max(Rgb::ZERO) * (KCD_PER_MODEL_UNIT * weight);
        }
        if self.twilight > 0.0 {
            radiance += self.glow(direction) * self.twilight;
        }
        radiance
    }

    /// The twilight picture, in no unit: blue, twice as bright at the horizon as overhead, and a warm glow
    /// low over the sun.
    fn glow(&self, direction: Vec3) -> Rgb {
        let low = (-4.0 * direction.y).exp();
        let towards = 0.5 + 0.5 * direction.dot(self.azimuth);
        TWILIGHT_BLUE * (1.0 + low) + TWILIGHT_WARM * (3.0 * low * towards * towards * towards)
    }
}

/// Colours of luminance 1: the blue of twilight (a black body of 15,000 K) and the glow over the sun (3500
/// K).
const TWILIGHT_BLUE: Rgb = Rgb::new(0.785, 0.993, 1.706);
const TWILIGHT_WARM: Rgb = Rgb::new(1.564, 0.893, 0.405);

/// The model, its arguments clamped to where it is defined.
fn hosek_wilkie(elevation: f64, turbidity: f64, ground_albedo: f64) -> HosekWilkie {
    let elevation = (elevation.to_radians() as f32).clamp(0.0, FRAC_PI_2);
    HosekWilkie::new(elevation, turbidity.clamp(1.0, 10.0) as f32, ground_albedo.clamp(0.0, 1.0) as f32)
}

/// Horizontal illuminance in klx for a solar depression in degrees: the table, log-linear between its
/// entries, led from the model's own value `at_horizon` into the table over the first 6°.
fn twilight_illuminance(depression: f64, at_horizon: f64) -> f64 {
    let at = depression.clamp(0.0, 18.0);
    let i = (at as usize).min(17);
    let log = |k: usize| (TWILIGHT_LUX[k] / 1000.0).ln();
    let table = log(i) + (log(i + 1) - log(i)) * (at - i as f64);
    let lead = (1.0 - at / 6.0).max(0.0);
    (table + (at_horizon.ln() - log(0)) * lead).exp()
}

fn smoothstep(t: f64) -> f32 {
    let t = t.clamp(0.0, 1.0);
    (t * t * (3.0 - 2.0 * t)) as f32
}

/// Irradiance of a horizontal surface under a sky at an hour, in kilolux.
pub(crate) fn irradiance(sky: &Sky, location: Option<&Location>, hour: f64) -> Rgb {
    let at = SkyAt::new(sky, location, hour);
    irradiance_by(32, |direction| at.radiance(direction))
}

/// Illuminance of a horizontal surface under a sky.
fn horizontal_illuminance(sky: impl Fn(Vec3) -> Rgb) -> f32 {
    luminance(irradiance_by(64, sky))
}

/// Irradiance of a horizontal surface under a sky from `n`² directions, by a midpoint rule uniform in
/// cosine-weighted solid angle.
fn irradiance_by(n: u32, sky: impl Fn(Vec3) -> Rgb) -> Rgb {
    let mut sum = Rgb::ZERO;
    for i in 0..n * n {
        let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
        let (sin_phi, cos_phi) = (2.0 * PI * u.y).sin_cos();
        let r = u.x.sqrt();
        sum += sky(Vec3::new(r * cos_phi, (1.0 - u.x).sqrt(), r * sin_phi));
    }
    sum * (PI / (n * n) as f32)
}

/// Horizontal illuminance of a sky over time, without its directions: a hundred times cheaper than the sky
/// itself.
pub struct Illuminance<'a> {
    location: Option<&'a Location>,
    /// Of a sky that is the same all day, kilolux.
    steady: f64,
    /// Of a clear sky, kilolux by whole degrees of the sun's elevation from 0 to 90: by day it depends on
    /// nothing else.
    by_degree: Vec<f64>,
}

impl<'a> Illuminance<'a> {
    /// Tabulates a sky, if there is one.
    pub fn new(sky: Option<&Sky>, location: Option<&'a Location>) -> Self {
        let mut illuminance = Self { location, steady: 0.0, by_degree: Vec::new() };
        match (sky, location) {
            (Some(Sky::HosekWilkie { turbidity, ground_albedo }), Some(_)) => {
                let of_degree = |degree: u32| {
                    let elevation = f64::from(degree);
                    let (sin, cos) = elevation.to_radians().sin_cos();
                    let sun = Vec3::new(cos as f32, sin as f32, 0.0);
                    let dome = Dome::new(sun, elevation, *turbidity, *ground_albedo);
                    f64::from(luminance(irradiance_by(32, |direction| dome.radiance(direction))))
                };
                illuminance.by_degree = (0..=90).into_par_iter().map(of_degree).collect();
            }
            (Some(sky @ (Sky::Constant { .. } | Sky::Image(_))), _) => {
                let at = SkyAt::new(sky, location, 0.0);
                illuminance.steady = f64::from(horizontal_illuminance(|direction| at.radiance(direction)));
            }
            _ => {}
        }
        illuminance
    }

    /// In kilolux.
    pub fn at(&self, hour: f64) -> f64 {
        let (Some(location), Some(&at_horizon)) = (self.location, self.by_degree.first()) else {
            return self.steady;
        };
        let (_, elevation) = sun::direction(location, hour);
        if elevation < 0.0 {
            return twilight_illuminance(-elevation, at_horizon);
        }
        let degree = (elevation as usize).min(89);
        let (low, high) = (self.by_degree[degree], self.by_degree[degree + 1]);
        low + (high - low) * (elevation - degree as f64)
    }
}

#[cfg(test)]
#[path = "sky_model_tests.rs"]
mod tests;
