//! Tests of the table against the model it tabulates.

use super::*;
use crate::light::luminance;
use glam::{DVec3, Vec2};

const LOCATION: Location = Location {
    latitude: 48.0,
    longitude: 11.0,
    utc_offset: 1.0,
    date: (2024, 5, 3),
    north: 20.0,
    refraction: true,
};
const SKY: Sky = Sky::HosekWilkie { turbidity: 3.0, ground_albedo: 0.3 };

fn radiance(sky: &Sky, location: Option<&Location>, hour: f64, direction: Vec3) -> Rgb {
    radiances(sky, location, hour, &[direction])[0]
}

/// Points spread evenly over [0, 1)² (the R2 sequence).
fn points(n: u32) -> impl Iterator<Item = Vec2> {
    (0..n).map(|i| {
        let at = |a: f64| (0.5 + a * f64::from(i)).fract() as f32;
        Vec2::new(at(0.754_877_666_246_693), at(0.569_840_290_998_053))
    })
}

#[test]
fn the_map_is_its_own_inverse() {
    for u in points(20_000) {
        let square = [2.0 * u.x - 1.0, 2.0 * u.y - 1.0];
        let direction = direction_from_square(square);
        let back = square_from_direction(direction);
        assert!((direction.length() - 1.0).abs() < 1e-6 && direction.y >= 0.0);
        assert!(
            (back[0] - square[0]).abs() < 1e-5 && (back[1] - square[1]).abs() < 1e-5,
            "{square:?} {back:?}"
        );
    }
    assert_eq!(square_from_direction(Vec3::Y), [0.0, 0.0]);
    assert!(square_from_direction(Vec3::X)[0] >= 1.0 - 1e-6);
}

/// Irradiance of planes turned every way is within 0.5 % of the model's at every hour, from noon to night.
#[test]
fn tilted_planes_get_the_same_light() {
    let hours: Vec<f64> = (0..24).map(f64::from).collect();
    let table = SkyTable::new(Some(&SKY), Some(&LOCATION), &hours);
    assert_eq!(table.lit, (0..24).collect::<Vec<_>>());
    let skies: Vec<SkyAt> = hours.iter().map(|&h| SkyAt::new(&SKY, Some(&LOCATION), h)).collect();
    // No direction is off by more than 3 % of its own or the mean radiance (worst: within 0.03° of the
    // horizon at sunrise).
    let mean = |sky: &SkyAt| {
        points(1000).map(|u| luminance(sky.radiance(direction_from_square([u.x, u.y])))).sum::<f32>() / 1e3
    };
    let means: Vec<f32> = skies.iter().map(mean).collect();
    let normals = [
        Vec3::Y,
        Vec3::X,
        Vec3::Z,
        Vec3::NEG_X,
        Vec3::new(0.6, 0.8, 0.0),
        Vec3::new(-0.48, -0.6, 0.64),
        Vec3::new(0.0, -0.96, 0.28),
    ];
    let mut exact = vec![[Rgb::ZERO; 24]; normals.len()];
    let mut ours = exact.clone();
    let mut worst = 0.0f32;
    for u in points(30_000) {
        // Uniform over the hemisphere above the horizon.
        let (sin, cos) = (std::f32::consts::TAU * u.y).sin_cos();
        let r = (1.0 - u.x * u.x).sqrt();
        let d = Vec3::new(r * cos, u.x, r * sin);
        let mut tabulated = [Rgb::ZERO; 24];
        table.add(d, Rgb::ONE, &mut tabulated);
        for (k, sky) in skies.iter().enumerate() {
            let model = sky.radiance(d);
            worst = worst.max(luminance((tabulated[k] - model).abs()) / luminance(model).max(means[k]));
            for (n, normal) in normals.iter().enumerate() {
                let cosine = normal.dot(d).max(0.0);
                exact[n][k] += model * cosine;
                ours[n][k] += tabulated[k] * cosine;
            }
        }
    }
    let mut largest = 0.0f32;
    for (exact, ours) in exact.iter().flatten().zip(ours.iter().flatten()) {
        largest = largest.max(((*ours - *exact).abs() / *exact).max_element());
    }
    println!("irradiance {largest:.5}, worst direction {worst:.4}");
    assert!(largest < 0.005, "{largest}");
    assert!(worst < 0.03, "{worst}");
}

/// Every count of hours (whole vectors and rests): the table's sum is beta times its own single-hour look-up.
#[test]
fn hours_do_not_depend_on_each_other() {
    let beta = Rgb::new(0.5, 1.0, 2.0);
    for count in [1, 3, 4, 7, 9] {
        let hours: Vec<f64> = (0..count).map(|k| f64::from(k) * 24.0 / f64::from(count)).collect();
        let table = SkyTable::new(Some(&SKY), Some(&LOCATION), &hours);
        let singles: Vec<SkyTable> =
            hours.iter().map(|&h| SkyTable::new(Some(&SKY), Some(&LOCATION), &[h])).collect();
        for direction in [Vec3::Y, Vec3::X, Vec3::new(0.36, 0.48, -0.8), Vec3::new(-0.6, 1e-7, -0.8)] {
            let mut out = vec![Rgb::ONE; hours.len()];
            table.add(direction, beta, &mut out);
            for (k, &hour) in hours.iter().enumerate() {
                let mut single = [Rgb::ONE];
                singles[k].add(direction, beta, &mut single);
                assert_eq!(out[k], single[0], "{count} hours, {hour} towards {direction}");
                let model = Rgb::ONE + beta * radiance(&SKY, Some(&LOCATION), hour, direction);
                assert!((out[k] - model).abs().max_element() < 0.02 * model.max_element());
            }
        }
    }
}

/// The horizon is as bright as the model's, and black just below.
#[test]
fn the_horizon_does_not_fade() {
    let table = SkyTable::new(Some(&SKY), Some(&LOCATION), &[12.0]);
    for i in 0..100 {
        let (sin, cos) = (i as f32 * 0.0628).sin_cos();
        let mut out = [Rgb::ZERO];
        table.add(Vec3::new(cos, 0.0, sin), Rgb::ONE, &mut out);
        let model = radiance(&SKY, Some(&LOCATION), 12.0, Vec3::new(cos, 0.0, sin));
        assert!((out[0] / model - 1.0).abs().max_element() < 0.01, "{i}: {} {model}", out[0]);
        let below = out;
        table.add(Vec3::new(cos, -1e-6, sin), Rgb::ONE, &mut out);
        assert_eq!(out, below);
    }
}

#[test]
fn constant_and_missing_skies() {
    let radiance = DVec3::new(1.0, 0.0, 3.0);
    let table = SkyTable::new(Some(&Sky::Constant { radiance }), None, &[3.0, 4.0]);
    assert_eq!(table.lit, [0, 1]);
    let mut out = [Rgb::ONE; 2];
    table.add(Vec3::NEG_Y, Rgb::splat(2.0), &mut out);
    assert_eq!(out, [Rgb::new(3.0, 1.0, 7.0); 2]);
    for dark in [None, Some(&Sky::Constant { radiance: DVec3::ZERO }), Some(&SKY)] {
        let table = SkyTable::new(dark, None, &[3.0, 12.0]);
        assert!(table.lit.is_empty());
        table.add(Vec3::Y, Rgb::ONE, &mut []);
    }
    SkyTable::new(Some(&SKY), Some(&LOCATION), &[]).add(Vec3::Y, Rgb::ONE, &mut []);
}
