//! The ground below the horizon: a level plane without end, far below all that is modelled, lit by the open
//! sky and the sun.

use super::sky;
use super::sun::SunDisc;
use crate::Rgb;
use crate::scene::{Location, Sky};
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// Rings of the upper hemisphere that the sky's irradiance is summed over; there are twice as many directions
/// around.
const RINGS: usize = 128;
/// Points along a side of the square that a sun's disc is averaged over.
const SIDE: usize = 8;

/// Radiance of ground of this albedo under the sky of an hour.
pub fn under_sky(albedo: DVec3, sky: &Sky, location: Option<&Location>, hour: f64) -> Rgb {
    // E = ∫ L y dω, and dω = dy dφ.
    let around = 2 * RINGS;
    let directions: Vec<Vec3> = (0..RINGS * around)
        .map(|i| {
            let (y, phi) = (
                ((i / around) as f64 + 0.5) / RINGS as f64,
                TAU * ((i % around) as f64 + 0.5) / around as f64,
            );
            let r = (1.0 - y * y).sqrt();
            DVec3::new(r * phi.cos(), y, r * phi.sin()).as_vec3()
        })
        .collect();
    let radiances = sky::radiances(sky, location, hour, &directions);
    let sum = radiances.iter().zip(&directions).map(|(l, d)| l.as_dvec3() * f64::from(d.y)).sum::<DVec3>();
    let irradiance = sum * (TAU / (RINGS * around) as f64);
    (albedo * irradiance / PI).as_vec3()
}

/// Radiance of ground of this albedo under a sun.
pub fn under_sun(albedo: DVec3, sun: &SunDisc) -> Rgb {
    let height = |i: usize| {
        let u = Vec2::new((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5) / SIDE as f32;
        f64::from(sun.sample(u).y.max(0.0))
    };
    let height = (0..SIDE * SIDE).map(height).sum::<f64>() / (SIDE * SIDE) as f64;
    (albedo * sun.irradiance.as_dvec3() * height / PI).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_reflects_its_albedo_of_what_falls_on_it() {
        let albedo = DVec3::new(0.1, 0.2, 0.5);
        // An even sky of radiance 3: E = 3 π, and L = 3 times the albedo.
        let even = under_sky(albedo, &Sky::Constant { radiance: DVec3::splat(3.0) }, None, 12.0);
        assert!(even.abs_diff_eq(Vec3::new(0.3, 0.6, 1.5), 1e-4), "{even}");
        let direction = Vec3::new(0.6, 0.8, 0.0);
        for half_angle in [0.0, 0.1] {
            let sun = SunDisc { direction, irradiance: Vec3::splat(10.0), half_angle, horizon: true };
            let lit = under_sun(albedo, &sun).y;
            assert!((lit - 0.2 * 8.0 / PI as f32).abs() < 5e-3 * lit, "{lit}");
        }
        let below =
            SunDisc { direction: Vec3::NEG_Y, irradiance: Vec3::ONE, half_angle: 0.0, horizon: false };
        assert_eq!(under_sun(albedo, &below), Rgb::ZERO);
    }
}
