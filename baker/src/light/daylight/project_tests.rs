//! Tests of the fit against light whose coefficients are known.

use super::*;
use crate::scene::{Location, Sun, SunKey};

fn scene(sky: Option<Sky>, sun: Option<Sun>) -> Scene {
    Scene {
        location: Some(Location {
            latitude: 48.0,
            longitude: 11.0,
            utc_offset: 1.0,
            date: (2024, 5, 3),
            north: 20.0,
            refraction: true,
        }),
        sun,
        sky,
        ..Scene::default()
    }
}

fn authored(direction: DVec3, disc_angle: f64) -> Sun {
    let irradiance = DVec3::new(3.0, 2.0, 1.0);
    Sun { disc_angle, track: SunTrack::Authored(vec![SunKey { hour: 0.0, direction, irradiance }]) }
}

const MODEL: Sky = Sky::HosekWilkie { turbidity: 3.0, ground_albedo: 0.3 };

#[test]
fn what_is_a_sum_of_the_functions_is_found_on_sphere_and_hemisphere() {
    let b = |i: usize| DVec3::new(0.5 + i as f64, -1.0, 0.25 * (i * i) as f64);
    for upper in [false, true] {
        let grid = Grid { rings: 90, upper };
        let light = |d: &Vec3| (0..FUNCTIONS).map(|i| b(i) * f64::from(harmonics(*d)[i])).sum::<DVec3>();
        let found =
            solve(&cholesky(grid.gram()), grid.products(|d| d.iter().map(|d| light(d).as_vec3()).collect()));
        for (i, found) in found.iter().enumerate() {
            assert!((*found - b(i)).length() < 1e-3 * b(i).length(), "{upper} {i}: {found}");
        }
    }
}

#[test]
fn a_constant_sky_is_its_first_function_alone() {
    let radiance = DVec3::new(3.0, 4.0, 5.0);
    let c = &coefficients(&scene(Some(Sky::Constant { radiance }), None), &[12.0])[0];
    let expected = radiance * (4.0 * PI).sqrt();
    assert!((DVec3::from_array(c[0]) - expected).length() < 1e-4, "{:?}", c[0]);
    assert!(c[1..].iter().flatten().all(|c| c.abs() < 1e-4), "{c:?}");
}

/// On the sphere the functions are orthonormal, so a sun's coefficients are irradiance × Y, faded by the size
/// of its disc by band: of a cap of half angle δ band 1 keeps (1 + cos δ) / 2.
#[test]
fn a_sun_is_an_impulse_of_its_irradiance() {
    let direction = DVec3::new(0.48, -0.6, 0.64);
    for disc_angle in [0.0, 60.0] {
        let scene =
            scene(Some(Sky::Constant { radiance: DVec3::ZERO }), Some(authored(direction, disc_angle)));
        let c = &coefficients(&scene, &[12.0])[0];
        let cos = f64::to_radians(disc_angle / 2.0).cos();
        // From perpendicular irradiance to ∫ L dω.
        let power = 2.0 / (1.0 + cos);
        let values = harmonics(direction.as_vec3());
        for (i, kept) in [(0, 1.0), (1, (1.0 + cos) / 2.0), (2, (1.0 + cos) / 2.0)] {
            let expected = DVec3::new(3.0, 2.0, 1.0) * power * kept * f64::from(values[i]);
            assert!((DVec3::from_array(c[i]) - expected).length() < 3e-3, "{disc_angle} {i}: {:?}", c[i]);
        }
    }
}

#[test]
fn functions_end_at_the_horizon_where_all_light_does() {
    let constant = || Some(Sky::Constant { radiance: DVec3::ONE });
    let location = || Some(Sun { disc_angle: 0.5, track: SunTrack::Computed { turbidity: 3.0 } });
    let cases = [
        (Some(MODEL), location(), true),
        (None, location(), true),
        (constant(), location(), false),
        (Some(MODEL), Some(authored(DVec3::new(0.6, 0.8, 0.0), 0.5)), true),
        (Some(MODEL), Some(authored(DVec3::new(0.6, -0.8, 0.0), 0.5)), false),
        (None, Some(authored(DVec3::new(0.6, -0.8, 0.0), 0.5)), false),
        // Half of its disc is below.
        (None, Some(authored(DVec3::new(1.0, 0.0, 0.0), 0.5)), false),
        (None, Some(authored(DVec3::new(1.0, 0.0, 0.0), 0.0)), true),
    ];
    for (sky, sun, expected) in cases {
        let scene = scene(sky, sun);
        assert_eq!(is_upper(&scene), expected, "{scene:?}");
    }
}

/// The light on level ground is ∫ L y dω, and y is one of the functions: the fit has it exactly, by the
/// definition of least squares.
#[test]
fn the_fit_keeps_the_light_on_level_ground() {
    let scene =
        scene(Some(MODEL), Some(Sun { disc_angle: 0.5, track: SunTrack::Computed { turbidity: 3.0 } }));
    let location = scene.location;
    for hour in [6.0, 12.0, 21.0] {
        let grid = Grid { rings: 180, upper: true };
        let ground = |light: &(dyn Fn(&[Vec3]) -> Vec<Vec3> + Sync)| {
            grid.products(|d| light(d).into_iter().zip(d).map(|(l, d)| l * d.y).collect())[0]
        };
        let sky = ground(&|d| sky::radiances(&MODEL, location.as_ref(), hour, d));
        let c = &coefficients(&scene, &[hour])[0];
        let sum = |d: &Vec3| {
            harmonics(*d).iter().zip(c).map(|(y, c)| DVec3::from_array(*c) * f64::from(*y)).sum::<DVec3>()
        };
        let fitted = ground(&|d| d.iter().map(|d| sum(d).as_vec3()).collect());
        let sun = sun::at(scene.sun.as_ref().unwrap(), location.as_ref(), hour);
        // (Products are with the first function, which is constant.)
        let y0 = f64::from(harmonics(Vec3::Y)[0]);
        let of_sun = sun.map_or(DVec3::ZERO, |s| s.irradiance.as_dvec3() * f64::from(s.direction.y) * y0);
        let expected = sky + of_sun;
        assert!((fitted - expected).length() < 2e-3 * expected.length(), "{hour}: {fitted} {expected}");
    }
}
