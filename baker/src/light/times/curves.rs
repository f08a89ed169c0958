//! What smooth light goes with between frames: the sky's with its irradiance on level ground, what surfaces
//! reflect of the sun with the sun's irradiance on what is around.

use super::visibility_times;
use crate::light::daylight::sky_model::irradiance;
use crate::scene::{Location, Sky, Sun, SunTrack};
use dataset::format::Curve;
use rayon::prelude::*;

/// Curves are true to this share of themselves, and have as few times as that takes.
const MOST_ERROR: f64 = 1e-3;

/// Of the sun's irradiance on a surface that faces it, what counts as falling on the scene beside what falls
/// on level ground: walls catch it when it stands low. (Of 0, 0.02, 0.05 and 0.1, that of least error in
/// `yard`, `room` and `farmland`.)
const REFLECTED_BY_WALLS: f32 = 0.05;

/// Of a sky that follows the sun; `None` of others, which are the same all day.
pub(crate) fn of_sky(sky: &Sky, location: Option<&Location>) -> Option<Curve> {
    let (Sky::HosekWilkie { .. }, Some(_)) = (sky, location) else { return None };
    let hours: Vec<f64> = (0..=24 * 60).map(|minute| f64::from(minute) / 60.0).collect();
    let values = hours.par_iter().map(|&hour| irradiance(sky, location, hour).to_array()).collect();
    Some(Curve { hours, values }.thinned(MOST_ERROR))
}

/// Of what surfaces reflect of a computed sun; `None` of an authored one: where it jumps or shines from below
/// the horizon, light is far from in proportion to any such quantity.
pub(crate) fn of_reflected_sun(sun: &Sun, location: Option<&Location>) -> Option<Curve> {
    if matches!(sun.track, SunTrack::Authored(_)) {
        return None;
    }
    let path = visibility_times::sun_path(sun, location, [0.0, 24.0]);
    let value = |(direction, irradiance): (&[f32; 3], &[f32; 3])| {
        irradiance.map(|e| e * (direction[1].max(0.0) + REFLECTED_BY_WALLS))
    };
    let values = path.direction.iter().zip(&path.irradiance).map(value).collect();
    Some(Curve { hours: path.hours, values }.thinned(MOST_ERROR))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SunKey;
    use glam::DVec3;

    const CLEAR: Sky = Sky::HosekWilkie { turbidity: 3.0, ground_albedo: 0.2 };

    fn vienna() -> Location {
        Location {
            latitude: 48.2,
            longitude: 16.4,
            utc_offset: 2.0,
            date: (2026, 4, 12),
            north: 0.0,
            refraction: true,
        }
    }

    fn authored(keys: &[(f64, DVec3)]) -> Sun {
        let key =
            |&(hour, direction): &(f64, DVec3)| SunKey { hour, direction, irradiance: DVec3::splat(10.0) };
        Sun { disc_angle: 0.0, track: SunTrack::Authored(keys.iter().map(key).collect()) }
    }

    #[test]
    fn the_skys_curve_is_its_irradiance_on_level_ground() {
        let location = vienna();
        let curve = of_sky(&CLEAR, Some(&location)).unwrap();
        let illuminance = crate::light::daylight::Illuminance::new(Some(&CLEAR), Some(&location));
        // At half minutes too, from noon to the night's floor, ten thousand times darker.
        for step in 0..2 * 24 * 60 {
            let hour = f64::from(step) / 120.0;
            let [r, g, b] = curve.at(hour);
            let (found, expected) = (0.2126 * r + 0.7152 * g + 0.0722 * b, illuminance.at(hour));
            // (Of the glow around a low sun its few directions find a part that changes with the azimuth.)
            assert!((found / expected - 1.0).abs() < 0.05, "{hour} h: {found} {expected}");
        }
        assert!(curve.hours.len() < 400, "{} times", curve.hours.len());
        let noon = curve.at(13.0);
        assert!(noon[2] > 1.5 * noon[0], "a clear sky is blue: {noon:?}");
    }

    #[test]
    fn skies_that_never_change_and_authored_suns_have_none() {
        assert_eq!(of_sky(&Sky::Constant { radiance: DVec3::ONE }, Some(&vienna())), None);
        assert_eq!(of_sky(&CLEAR, None), None);
        assert_eq!(of_reflected_sun(&authored(&[(0.0, DVec3::Y)]), None), None);
        assert_eq!(of_reflected_sun(&authored(&[(6.0, DVec3::X), (12.0, DVec3::Y)]), Some(&vienna())), None);
    }

    #[test]
    fn the_suns_curve_is_0_by_night_and_follows_its_height_by_day() {
        let curve = of_reflected_sun(
            &Sun { disc_angle: 0.53, track: SunTrack::Computed { turbidity: 3.0 } },
            Some(&vienna()),
        )
        .unwrap();
        assert_eq!([0.0, 3.0, 23.9].map(|hour| curve.at(hour)), [[0.0; 3]; 3]);
        assert!(curve.at(13.0)[1] > 5.0 * curve.at(7.0)[1]);
    }
}
