//! The sun at an hour: where it stands, what it gives, and how its disc is sampled.

use crate::Rgb;
use crate::scene::{Location, Sun, SunKey, SunTrack};
use glam::{DVec3, Vec2, Vec3};
use solar_positioning::{SolarPositions, delta_t, time::JulianDate};
use std::f64::consts::{FRAC_PI_2, TAU};

/// The sun's disc at one time, as far as it stands above the horizon (authored suns have no horizon).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SunDisc {
    /// Unit vector towards its centre.
    pub direction: Vec3,
    /// Perpendicular irradiance of the visible part, kilolux: ∫ L dω over it, so that `irradiance · cos θ`
    /// averaged over [`SunDisc::sample`] is the irradiance of a surface. (The perpendicular irradiance of a
    /// scene file, π L sin²δ for a half angle δ, is that times (1 + cos δ) / 2, which the real sun's 0.27°
    /// put at 1 − 5·10⁻⁶.)
    pub irradiance: Rgb,
    /// Half angle in radians; 0: a direction.
    pub half_angle: f32,
    /// Whether directions with y < 0 are cut off.
    pub horizon: bool,
}

impl SunDisc {
    /// A direction uniformly distributed, by solid angle, on the visible part of the disc. `u` in [0, 1)².
    pub fn sample(&self, u: Vec2) -> Vec3 {
        DiscSampler::new(*self).sample(u)
    }

    /// Density of [`SunDisc::sample`] over solid angle: constant on the visible part, else 0. Infinite where
    /// the disc is a mere direction.
    #[cfg(test)]
    pub fn pdf(&self, direction: Vec3) -> f32 {
        match Cap::new(self) {
            Some(cap) if cap.contains(direction.as_dvec3()) => cap.solid_angle().recip() as f32,
            Some(_) => 0.0,
            None => f32::INFINITY,
        }
    }

    /// The `u` for which [`SunDisc::sample`] gives `direction`; `None` off the visible part, or where the
    /// disc is a mere direction.
    #[cfg(test)]
    pub fn invert(&self, direction: Vec3) -> Option<Vec2> {
        let cap = Cap::new(self)?;
        cap.contains(direction.as_dvec3()).then(|| cap.invert(direction.as_dvec3()).as_vec2())
    }
}

/// A disc, ready for sampling.
#[derive(Clone, Copy, Debug)]
pub struct DiscSampler {
    /// The disc.
    pub disc: SunDisc,
    cap: Option<Cap>,
}

impl DiscSampler {
    /// Of a disc.
    pub fn new(disc: SunDisc) -> Self {
        DiscSampler { disc, cap: Cap::new(&disc) }
    }

    /// [`SunDisc::sample`].
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let Some(cap) = &self.cap else { return self.disc.direction };
        let direction = cap.sample(f64::from(u.x), f64::from(u.y)).as_vec3();
        // Rounding to f32 must not put a direction below the horizon.
        if self.disc.horizon { direction.with_y(direction.y.max(0.0)) } else { direction }
    }
}

/// The part of a spherical cap above the horizon, in coordinates in which the horizon is a straight line.
///
/// ω = s·right + √(1 − s²)·(cos ψ·centre + sin ψ·up): area is ds dψ (Archimedes), the horizon is ψ = −e for a
/// centre at elevation e, and the cap with half angle δ is |s| ≤ sin δ·√(1 − x²), x = tan ψ / tan δ.
/// Integrated over s, the density over x = sin a is cos²a / (1 + k² sin²a) da with k = tan δ.
#[derive(Clone, Copy, Debug)]
struct Cap {
    centre: DVec3,
    up: DVec3,
    right: DVec3,
    sin_delta: f64,
    cos_delta: f64,
    /// k.
    tan_delta: f64,
    /// `a` of the horizon: −π/2 where the whole disc is visible.
    lowest: f64,
}

impl Cap {
    /// `None` for a disc without extent.
    fn new(disc: &SunDisc) -> Option<Self> {
        let delta = f64::from(disc.half_angle);
        if delta <= 0.0 {
            return None;
        }
        let centre = disc.direction.as_dvec3().normalize();
        // `right` is horizontal; straight up or down, any will do.
        let right = centre.cross(DVec3::Y).try_normalize().unwrap_or(DVec3::X);
        let up = right.cross(centre);
        let (sin_delta, cos_delta) = delta.sin_cos();
        let tan_delta = sin_delta / cos_delta;
        let elevation = centre.y.clamp(-1.0, 1.0).asin();
        let lowest = if disc.horizon { horizon_angle(elevation, delta) } else { -FRAC_PI_2 };
        Some(Self { centre, up, right, sin_delta, cos_delta, tan_delta, lowest })
    }

    /// ∫ of the density over `a` from 0.
    fn area(&self, a: f64) -> f64 {
        cap_area(self.tan_delta, a)
    }

    #[cfg(test)]
    fn solid_angle(&self) -> f64 {
        2.0 * self.sin_delta * self.tan_delta * (self.area(FRAC_PI_2) - self.area(self.lowest))
    }

    fn sample(&self, u: f64, v: f64) -> DVec3 {
        if self.lowest <= -FRAC_PI_2 {
            // Whole disc: uniform in 1 − cos θ and in azimuth.
            let versine = u * self.sin_delta.powi(2) / (1.0 + self.cos_delta);
            let sine = (versine * (2.0 - versine)).sqrt();
            let (sin_phi, cos_phi) = (TAU * v).sin_cos();
            return self.centre * (1.0 - versine) + (self.right * cos_phi + self.up * sin_phi) * sine;
        }
        // Solve area(a) = target by Newton steps kept inside a shrinking bracket.
        let (mut low, mut high) = (self.lowest, FRAC_PI_2);
        let target = self.area(low) + u * (self.area(high) - self.area(low));
        let mut a = 0.5 * (low + high);
        for _ in 0..60 {
            let miss = self.area(a) - target;
            if miss > 0.0 {
                high = a
            } else {
                low = a
            }
            let (sine, cosine) = a.sin_cos();
            let slope = cosine * cosine / (1.0 + (self.tan_delta * sine).powi(2));
            let newton = a - miss / slope;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let done = (next - a).abs() < 1e-13;
            a = next;
            if done {
                break;
            }
        }
        // x = sin a; s uniform in ±sin δ·cos a; cos ψ = 1/√(1 + (x k)²).
        let (sin_a, cos_a) = a.sin_cos();
        let s = (2.0 * v - 1.0) * self.sin_delta * cos_a;
        let tan_psi = sin_a * self.tan_delta;
        let in_plane = ((1.0 - s * s) / (1.0 + tan_psi * tan_psi)).sqrt();
        self.right * s + (self.centre + self.up * tan_psi) * in_plane
    }

    #[cfg(test)]
    fn contains(&self, direction: DVec3) -> bool {
        let sine = direction.cross(self.centre).length();
        let inside = direction.dot(self.centre) > 0.0 && sine <= self.sin_delta * (1.0 + 1e-6) + 1e-7;
        inside && (self.lowest <= -FRAC_PI_2 || direction.y >= -1e-7)
    }

    #[cfg(test)]
    fn invert(&self, direction: DVec3) -> glam::DVec2 {
        let (s, along, above) =
            (direction.dot(self.right), direction.dot(self.centre), direction.dot(self.up));
        if self.lowest <= -FRAC_PI_2 {
            let u = (s * s + above * above) / (1.0 + along) * (1.0 + self.cos_delta) / self.sin_delta.powi(2);
            return glam::DVec2::new(u.clamp(0.0, 1.0), (above.atan2(s) / TAU).rem_euclid(1.0));
        }
        let a = (above / along / self.tan_delta).clamp(-1.0, 1.0).asin();
        let (start, end) = (self.area(self.lowest), self.area(FRAC_PI_2));
        let v = 0.5 + 0.5 * s / (self.sin_delta * a.cos()).max(1e-300);
        glam::DVec2::new((self.area(a) - start) / (end - start), v).clamp(glam::DVec2::ZERO, glam::DVec2::ONE)
    }
}

/// ∫₀ᵃ cos²t / (1 + k² sin²t) dt.
fn cap_area(k: f64, a: f64) -> f64 {
    let (sine, cosine) = a.sin_cos();
    if k < 1e-4 {
        // Flat disc: the closed form below loses its digits, and the difference is of order k² = 10⁻⁸.
        return 0.5 * (a + sine * cosine);
    }
    let root = (1.0 + k * k).sqrt();
    (root * (root * sine).atan2(cosine) - a) / (k * k)
}

/// `a` at which the horizon cuts a disc of half angle `delta` centred at `elevation`; ±π/2 where it does not.
fn horizon_angle(elevation: f64, delta: f64) -> f64 {
    if elevation >= delta {
        -FRAC_PI_2
    } else if elevation <= -delta {
        FRAC_PI_2
    } else {
        (-elevation.tan() / delta.tan()).clamp(-1.0, 1.0).asin()
    }
}

/// The fraction of the disc's solid angle above the horizon.
fn visible_fraction(elevation: f64, delta: f64) -> f64 {
    if delta <= 0.0 {
        return if elevation > 0.0 { 1.0 } else { 0.0 };
    }
    let (k, whole) = (delta.tan(), cap_area(delta.tan(), FRAC_PI_2));
    0.5 - 0.5 * cap_area(k, horizon_angle(elevation, delta)) / whole
}

/// Why no sun position can be computed for this place and date, in a sentence; `Ok` when one can, for any
/// hour.
pub fn check(location: &Location) -> Result<(), String> {
    for hour in [0.0, 24.0] {
        position(location, hour).map_err(|error| error.to_string())?;
    }
    Ok(())
}

/// Unit vector towards the sun's centre as it is seen, and its elevation in degrees, at a local hour. Where
/// [`check`] fails the sun is at the nadir.
pub fn direction(location: &Location, hour: f64) -> (Vec3, f64) {
    lifted(location, hour, refraction)
}

/// As [`direction`], of a disc of which the horizon may hide the centre: what is left of it is seen at the
/// horizon, so all of it is lifted as much as that is.
fn disc_direction(location: &Location, hour: f64) -> (Vec3, f64) {
    lifted(location, hour, |elevation| refraction(elevation.max(SEEN_AT_HORIZON)))
}

/// The sun's direction and elevation, raised by `lift` of its elevation unless the air does not refract.
fn lifted(location: &Location, hour: f64, lift: impl Fn(f64) -> f64) -> (Vec3, f64) {
    let Ok((azimuth, geometric)) = position(location, hour) else { return (Vec3::NEG_Y, -90.0) };
    let elevation = if location.refraction { geometric + lift(geometric) } else { geometric };
    // Azimuth runs clockwise from north, and north clockwise from −Z.
    let (sin_azimuth, cos_azimuth) = (azimuth + location.north).to_radians().sin_cos();
    let (sin_elevation, cos_elevation) = elevation.to_radians().sin_cos();
    let direction = DVec3::new(sin_azimuth * cos_elevation, sin_elevation, -cos_azimuth * cos_elevation);
    (direction.as_vec3(), elevation)
}

/// Geometric elevation in degrees of what is seen at the horizon.
const SEEN_AT_HORIZON: f64 = -0.564_1;

/// Degrees by which the standard atmosphere (1013.25 hPa, 15 °C) lifts what stands at a geometric elevation
/// in degrees: equation 42 of the SPA (Reda & Andreas 2004), after Saemundsson 1986.
///
/// That formula has a pole at −5.1°, and the SPA's own end of it, at −0.83°, is a jump. Below the horizon,
/// where nothing is seen, the lift fades as 1/tan instead, as that of NOAA's solar calculator does: from a
/// few degrees on, twilight goes by the geometric depression. The sum of elevation and lift grows everywhere.
fn refraction(elevation: f64) -> f64 {
    if elevation < SEEN_AT_HORIZON {
        let fade = SEEN_AT_HORIZON.to_radians().tan() / elevation.to_radians().tan();
        return refraction(SEEN_AT_HORIZON) * fade;
    }
    let air = (1013.25 / 1010.0) * (283.0 / (273.0 + 15.0));
    air * 1.02 / 60.0 / (elevation + 10.3 / (elevation + 5.11)).to_radians().tan()
}

/// Azimuth and elevation in degrees by the SPA of Reda & Andreas 2004, without refraction, at sea level.
fn position(location: &Location, hour: f64) -> solar_positioning::Result<(f64, f64)> {
    let (year, month, day) = location.date;
    let delta_t = delta_t::estimate_from_date(year, month)?;
    let midnight = JulianDate::from_utc(year, month, day, 0, 0, 0.0, delta_t)?;
    let time = JulianDate::new(midnight.julian_date() + (hour - location.utc_offset) / 24.0, delta_t)?;
    let coordinates =
        solar_positioning::Location { latitude: location.latitude, longitude: location.longitude };
    let sun = SolarPositions::new().at_from_julian(time, coordinates, 0.0, None)?;
    Ok((sun.azimuth(), sun.elevation_angle()))
}

/// The sun at `hour`; `None` when none of it is above the horizon or it gives no light (or it follows a place
/// and there is none).
pub fn at(sun: &Sun, location: Option<&Location>, hour: f64) -> Option<SunDisc> {
    let delta = (0.5 * sun.disc_angle).to_radians();
    // From perpendicular irradiance of the whole disc, π L sin²δ, to ∫ L dω = 2π L (1 − cos δ).
    let to_integral = 2.0 / (1.0 + delta.cos());
    let (direction, irradiance, horizon) = match &sun.track {
        SunTrack::Computed { turbidity } => {
            let (direction, elevation) = disc_direction(location?, hour);
            let visible = visible_fraction(elevation.to_radians(), delta);
            (direction, clear_air_irradiance(elevation, *turbidity) * visible, true)
        }
        SunTrack::Authored(keys) => {
            let (direction, irradiance) = along_track(keys, hour)?;
            (direction.as_vec3(), irradiance, false)
        }
    };
    let irradiance = (irradiance * to_integral).as_vec3();
    (irradiance.max_element() > 0.0).then_some(SunDisc {
        direction,
        irradiance,
        half_angle: delta as f32,
        horizon,
    })
}

/// Direction and perpendicular irradiance between the keys around `hour`, linear and periodic.
fn along_track(keys: &[SunKey], hour: f64) -> Option<(DVec3, DVec3)> {
    let hour = hour.rem_euclid(24.0);
    let after = keys.partition_point(|key| key.hour <= hour);
    let next = keys.get(after).or(keys.first())?;
    let previous = if after > 0 { keys[after - 1] } else { *keys.last()? };
    let span = (next.hour - previous.hour).rem_euclid(24.0);
    let t = if span > 0.0 { (hour - previous.hour).rem_euclid(24.0) / span } else { 0.0 };
    let between = previous.direction.lerp(next.direction, t);
    // Opposite directions have no middle: the nearer key's stands in.
    let nearer = if t < 0.5 { previous.direction } else { next.direction };
    let direction = if between.length() > 1e-6 { between.normalize() } else { nearer };
    Some((direction, previous.irradiance.lerp(next.irradiance, t)))
}

/// Luminous solar constant, kilolux: 133.1 klx (Darula, Kittler & Gueymard 2005, "Reference luminous solar
/// constant and solar luminance for illuminance calculations").
const SOLAR_CONSTANT: f64 = 133.1;

/// Linear Rec. 709 of sunlight outside the atmosphere, luminance 1: chromaticity x = 0.3233, y = 0.3326 (ASTM
/// E490).
const SUN_COLOUR: DVec3 = DVec3::new(1.0968, 0.9770, 0.9437);

/// Effective wavelengths of the Rec. 709 primaries, micrometres.
const WAVELENGTH: DVec3 = DVec3::new(0.612, 0.549, 0.465);

/// Optical depth of 0.35 cm (350 Dobson units) of ozone at these wavelengths (Chappuis band, Vigroux
/// coefficients as in Iqbal 1983).
const OZONE: DVec3 = DVec3::new(0.042, 0.030, 0.004);

/// Perpendicular irradiance of the unobscured sun in kilolux, linear Rec. 709, through clear air.
///
/// Three bands (the RGB primaries' effective wavelengths λ) attenuated by exp(−m (τ_R + τ_a + τ_o)): Rayleigh
/// τ_R = 0.008735 λ^−4.08, aerosol τ_a = β λ^−1.3 with β = 0.04608 T − 0.04586 for turbidity T (Preetham et
/// al. 1999 after Iqbal 1983), ozone; m by Kasten & Young 1989. No fitted factor.
fn clear_air_irradiance(elevation: f64, turbidity: f64) -> DVec3 {
    let m = air_mass(elevation);
    let beta = (0.04608 * turbidity - 0.04586).max(0.0);
    let depth = 0.008735 * WAVELENGTH.powf(-4.08) + beta * WAVELENGTH.powf(-1.3) + OZONE;
    SOLAR_CONSTANT * SUN_COLOUR * (-m * depth).exp()
}

/// Relative optical air mass of Kasten & Young 1989 for an elevation in degrees, held at its horizon value
/// below 0.
fn air_mass(elevation: f64) -> f64 {
    let elevation = elevation.max(0.0);
    (elevation.to_radians().sin() + 0.50572 * (elevation + 6.07995).powf(-1.6364)).recip()
}

/// Luminance of an f64 colour.
#[cfg(test)]
fn luminance_of(rgb: DVec3) -> f64 {
    f64::from(crate::light::luminance(rgb.as_vec3()))
}

#[cfg(test)]
#[path = "sun_tests.rs"]
mod tests;
