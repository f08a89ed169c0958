//! Tests of the sky sampler: its density against its samples, portals that overlap, pictures with a sun.

use super::*;
use crate::scene::{Sky, SkyImage};
use dataset::image::Image;
use std::sync::Arc;

const LOCATION: crate::scene::Location = crate::scene::Location {
    latitude: 48.0,
    longitude: 11.0,
    utc_offset: 1.0,
    date: (2024, 5, 3),
    north: 20.0,
    refraction: true,
};

fn random(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 40) as f32 / (1u64 << 24) as f32
}

fn scene(sky: Option<Sky>, portals: Vec<Portal>) -> Scene {
    Scene { name: "test".into(), location: Some(LOCATION), sky, portals, ..Scene::default() }
}

fn sky_sampler(sky: Option<Sky>, portals: Vec<Portal>) -> Option<SkySampler> {
    let scene = scene(sky, portals);
    let table = SkyTable::new(scene.sky.as_ref(), scene.location.as_ref(), &[12.0]);
    SkySampler::new(&scene, &table, DVec3::new(100.0, 0.0, 0.0))
}

/// A picture with a gradient and a sun of a few texels.
fn picture(width: usize, rotation: f64, sun: f32) -> Sky {
    let height = width / 2;
    let mut image = Image::black(width, height);
    for (i, texel) in image.texels.iter_mut().enumerate() {
        let (x, y) = (i % width, i / width);
        *texel = [1.0, 1.0 + y as f32 / height as f32, 2.0];
        if x.abs_diff(width / 4) < 2 && y.abs_diff(height / 3) < 2 {
            *texel = [sun; 3];
        }
    }
    Sky::Image(SkyImage {
        file: "sky.exr".into(),
        scale: 1.0,
        rotation,
        blake3: String::new(),
        radiance: Arc::new(image),
    })
}

/// A window of 1 × 1 m at x = `at`, in local space before the origin is taken off.
fn window(at: f64, height: f64, size: f64) -> Portal {
    Portal {
        corner: DVec3::new(100.0 + at, height, -0.5 * size),
        edge_u: DVec3::Y * size,
        edge_v: DVec3::Z * size,
        room: None,
    }
}

fn constant() -> Option<Sky> {
    Some(Sky::Constant { radiance: DVec3::ONE })
}

#[test]
fn only_points_of_its_room_look_through_a_portal() {
    let room = [DVec3::new(99.0, -1.0, -1.0), DVec3::new(101.0, 1.0, 1.0)];
    let portal = Portal { room: Some(room), ..window(0.5, -0.5, 1.0) };
    let (scene, origin) = (scene(constant(), vec![portal]), DVec3::X * 100.0);
    let sky = SkyTable::new(scene.sky.as_ref(), None, &[12.0]);
    let sky_sampler = SkySampler::new(&scene, &sky, origin).unwrap();
    for (x, expected) in [(0.0, true), (-0.9, true), (-1.1, false), (1.2, false)] {
        let normal = if x < 0.5 { Vec3::X } else { -Vec3::X };
        let point = Vec3::new(x, 0.0, 0.0);
        let found = sky_sampler.sample(point, normal, 0.5, Vec2::splat(0.5));
        assert_eq!(found.is_some(), expected, "{x}");
        assert_eq!(sky_sampler.pdf(point, normal, normal) > 0.0, expected, "{x}");
    }
}

#[test]
fn there_is_no_sampler_where_the_cosine_is_as_good() {
    let dome = Some(Sky::HosekWilkie { turbidity: 3.0, ground_albedo: 0.2 });
    assert!(sky_sampler(constant(), vec![]).is_none() && sky_sampler(dome.clone(), vec![]).is_none());
    assert!(sky_sampler(None, vec![window(2.0, 0.5, 1.0)]).is_none());
    assert!(
        sky_sampler(Some(Sky::Constant { radiance: DVec3::ZERO }), vec![window(2.0, 0.5, 1.0)]).is_none()
    );
    assert!(
        sky_sampler(dome, vec![window(2.0, 0.5, 1.0)]).is_some()
            && sky_sampler(constant(), vec![window(2.0, 0.5, 1.0)]).is_some()
    );
    // A picture that is even, or black.
    let even = |value| {
        let image = Image { width: 8, height: 4, texels: vec![[value; 3]; 32] };
        Sky::Image(SkyImage {
            file: "a.exr".into(),
            scale: 1.0,
            rotation: 0.0,
            blake3: String::new(),
            radiance: Arc::new(image),
        })
    };
    assert!(sky_sampler(Some(even(2.0)), vec![]).is_none() && sky_sampler(Some(even(0.0)), vec![]).is_none());
    assert!(sky_sampler(Some(picture(64, 0.0, 100.0)), vec![]).is_some());
}

fn sky_samplers() -> Vec<SkySampler> {
    let portals = || vec![window(2.0, 0.5, 1.0), window(-1.0, 0.2, 2.0), window(3.0, 0.6, 1.5)];
    vec![
        sky_sampler(constant(), vec![window(2.0, 0.5, 1.0)]).unwrap(),
        sky_sampler(constant(), portals()).unwrap(),
        sky_sampler(Some(picture(32, 30.0, 50.0)), vec![]).unwrap(),
        sky_sampler(Some(picture(32, -100.0, 50.0)), portals()).unwrap(),
    ]
}

/// ∫ pdf = 1 over the sphere, by 32 strata of 8000 points each: |z| < 4.5 (31 degrees of freedom: p =
/// 9·10⁻⁵).
#[test]
fn densities_integrate_to_one() {
    for (k, sky_sampler) in sky_samplers().iter().enumerate() {
        for (p, n) in [(Vec3::ZERO, Vec3::Y), (Vec3::new(0.3, 0.4, 0.2), Vec3::new(0.8, 0.6, 0.0))] {
            let mut state = 5 + k as u64;
            let means: Vec<f64> = (0..32)
                .map(|_| {
                    let mut sum = 0.0;
                    for _ in 0..8000 {
                        let y = 2.0 * random(&mut state) - 1.0;
                        let (sin, cos) = (2.0 * std::f32::consts::PI * random(&mut state)).sin_cos();
                        let r = (1.0 - y * y).sqrt();
                        sum += f64::from(sky_sampler.pdf(p, n, Vec3::new(r * cos, y, r * sin)));
                    }
                    sum / 8000.0 * 4.0 * PI
                })
                .collect();
            let mean = means.iter().sum::<f64>() / 32.0;
            let sigma = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (31.0 * 32.0)).sqrt();
            println!("{k}: {mean} ± {sigma}");
            assert!((mean - 1.0).abs() < 4.5 * sigma && sigma < 0.03, "{k}: {mean} ± {sigma}");
        }
    }
}

/// Samples tell the density that `pdf` tells, and fall where it says: the mean of 1/pdf over the samples
/// within a cap is the solid angle of the part of the cap that has a density, counted on a grid.
#[test]
fn samples_follow_the_density() {
    for (k, sky_sampler) in sky_samplers().iter().enumerate() {
        let (p, n) = (Vec3::new(0.1, 0.3, 0.1), Vec3::new(0.6, 0.8, 0.0));
        // Around the edges of the windows, or of the picture's sun.
        let axis = match &sky_sampler.picture {
            Some(picture) => picture.frame.direction_of(DVec2::new(8.5 / 32.0, 5.5 / 16.0)).as_vec3(),
            None => Vec3::new(0.9, 0.35, 0.1).normalize(),
        };
        let inside = |d: Vec3| d.dot(axis) > 0.97;
        // The measure: pdf > 0 in the cap.
        let side = 600;
        let (x, y) = axis.any_orthonormal_pair();
        let mut covered = 0.0;
        for i in 0..side * side {
            let c = 1.0 - 0.03 * ((i / side) as f32 + 0.5) / side as f32;
            let (sin, cos) = (2.0 * std::f32::consts::PI * ((i % side) as f32 + 0.5) / side as f32).sin_cos();
            let s = (1.0 - c * c).sqrt();
            let d = axis * c + (x * cos + y * sin) * s;
            covered += if sky_sampler.pdf(p, n, d) > 0.0 { 1.0 } else { 0.0 };
        }
        let covered = covered / f64::from(side * side) * 2.0 * PI * 0.03;
        let means: Vec<f64> = (0..16)
            .map(|seed| {
                let mut state = 99 + 31 * seed;
                (0..4).for_each(|_| _ = random(&mut state));
                let mut sum = 0.0;
                for _ in 0..20_000 {
                    let choice = random(&mut state);
                    let u = Vec2::new(random(&mut state), random(&mut state));
                    let Some((d, pdf)) = sky_sampler.sample(p, n, choice, u) else { continue };
                    assert!((d.length() - 1.0).abs() < 1e-5);
                    assert_eq!(pdf, sky_sampler.pdf(p, n, d));
                    sum += if inside(d) { 1.0 / f64::from(pdf) } else { 0.0 };
                }
                sum / 20_000.0
            })
            .collect();
        let mean = means.iter().sum::<f64>() / 16.0;
        let sigma = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (15.0 * 16.0)).sqrt();
        println!("{k}: {mean} ± {sigma}, covered {covered}");
        assert!(
            (mean - covered).abs() < 4.5 * sigma + 3e-3 * covered,
            "{k}: {mean} ± {sigma} against {covered}"
        );
    }
}

/// One window behind another: a direction through both has the sum of their densities, through one alone its
/// own.
#[test]
fn overlapping_portals_add_up() {
    let (near, far) = (window(2.0, -0.5, 1.0), window(4.0, -1.0, 2.0));
    let both = sky_sampler(constant(), vec![near, far]).unwrap();
    let (p, n) = (Vec3::ZERO, Vec3::X);
    let [a, b] = [0, 1].map(|i| both.portals[i].seen_from(DVec3::ZERO).unwrap().solid_angle());
    // The same cone.
    assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
    assert!((both.pdf(p, n, Vec3::X) * a as f32 - 1.0).abs() < 1e-5);
    assert_eq!(both.pdf(p, n, Vec3::new(0.8, 0.6, 0.0)), 0.0);
    // A narrow one in front of a wide one, and seen from the other side.
    let both = sky_sampler(constant(), vec![window(2.0, -0.5, 1.0), window(4.0, -3.0, 6.0)]).unwrap();
    for (p, n, along) in [(Vec3::ZERO, Vec3::X, 1.0), (Vec3::new(9.0, 0.0, 0.0), Vec3::NEG_X, -1.0)] {
        let shares = [0, 1].map(|i| both.portals[i].importance(p.as_dvec3(), n.as_dvec3()));
        let angles = [0, 1].map(|i| both.portals[i].seen_from(p.as_dvec3()).unwrap().solid_angle());
        let part = |i: usize| shares[i] / (shares[0] + shares[1]) / angles[i];
        let through_both = f64::from(both.pdf(p, n, Vec3::X * along as f32));
        assert!((through_both / (part(0) + part(1)) - 1.0).abs() < 1e-5);
        let aside = Vec3::new(along as f32, 0.35, 0.0).normalize();
        assert!((f64::from(both.pdf(p, n, aside)) / part(1) - 1.0).abs() < 1e-5);
    }
}

/// In a portal's plane, on it, behind the surface, touching: nothing or finite.
#[test]
fn awkward_places_give_no_nan() {
    let sky_sampler = sky_sampler(constant(), vec![window(2.0, 0.0, 1.0), window(2.0, 0.0, 1e-4)]).unwrap();
    let mut found = 0;
    for p in [
        Vec3::new(2.0, 0.5, 0.0),
        Vec3::new(2.0, 3.0, 0.0),
        Vec3::new(2.0 + 1e-6, 0.5, 0.0),
        Vec3::new(2.1, 0.0, 0.0),
        Vec3::ZERO,
    ] {
        for n in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z] {
            for choice in [0.0, 0.5, 1.0 - f32::EPSILON / 2.0] {
                for u in [Vec2::ZERO, Vec2::splat(0.5), Vec2::splat(1.0 - f32::EPSILON / 2.0)] {
                    if let Some((d, pdf)) = sky_sampler.sample(p, n, choice, u) {
                        assert!(d.is_finite() && pdf.is_finite() && pdf > 0.0);
                        found += 1;
                    }
                }
            }
            assert!(sky_sampler.pdf(p, n, Vec3::X).is_finite());
        }
    }
    assert!(found > 50, "{found}");
    assert_eq!(sky_sampler.pdf(Vec3::new(2.0, 0.5, 0.0), Vec3::X, Vec3::X), 0.0);
}

/// With the balance heuristic against the cosine, a picture's irradiance comes out, and with a hundredth of
/// the cosine's variance when a small sun gives most of it.
#[test]
fn a_bright_sun_in_the_picture_is_found() {
    let sky = picture(256, 30.0, 2e4);
    let table = SkyTable::new(Some(&sky), None, &[12.0]);
    let sky_sampler = sky_sampler(Some(sky), vec![]).unwrap();
    let radiance = |d: Vec3| {
        let mut out = [Vec3::ZERO];
        table.add(d, Vec3::ONE, &mut out);
        f64::from(out[0].y)
    };
    // The reference: a fine grid over the upper hemisphere (the sun stands above it).
    let side = 4000;
    let mut expected = 0.0;
    for i in 0..side * side / 4 {
        let (column, row) = (i % side, i / side);
        let cos = 1.0 - (f64::from(row) + 0.5) / f64::from(side / 4);
        let (s, c) = (2.0 * PI * (f64::from(column) + 0.5) / f64::from(side)).sin_cos();
        let r = (1.0 - cos * cos).sqrt();
        expected += radiance(DVec3::new(r * c, cos, r * s).as_vec3()) * cos;
    }
    expected *= 2.0 * PI / f64::from(side * side / 4);
    let (p, n) = (Vec3::ZERO, Vec3::Y);
    let n_samples = 4000;
    let (mut means, mut by_cosine) = (Vec::new(), Vec::new());
    for seed in 0..16 {
        let mut state = 7 + 131 * seed;
        (0..4).for_each(|_| _ = random(&mut state));
        let (mut sum, mut plain) = (0.0, 0.0);
        for _ in 0..n_samples {
            let u = DVec2::new(f64::from(random(&mut state)), f64::from(random(&mut state)));
            let d = crate::light::cosine_hemisphere(DVec3::Y, u).as_vec3();
            let p_cos = f64::from(d.y) / PI;
            plain += PI * radiance(d);
            sum += radiance(d) * f64::from(d.y) / (p_cos + f64::from(sky_sampler.pdf(p, n, d)));
            let u = Vec2::new(random(&mut state), random(&mut state));
            let Some((d, pdf)) = sky_sampler.sample(p, n, random(&mut state), u) else { continue };
            let cosine = f64::from(d.y.max(0.0));
            sum += radiance(d) * cosine / (cosine / PI + f64::from(pdf));
        }
        means.push(sum / f64::from(n_samples));
        by_cosine.push(plain / f64::from(n_samples));
    }
    let moments = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / 16.0;
        (mean, values.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / 15.0)
    };
    let ((mean, variance), (_, plain)) = (moments(&means), moments(&by_cosine));
    let sigma = (variance / 16.0).sqrt();
    println!("{mean} ± {sigma}, expected {expected}; variance {} of the cosine's", variance / plain);
    assert!((mean - expected).abs() < 4.5 * sigma + 1e-3 * expected, "{mean} ± {sigma} against {expected}");
    assert!(variance < 0.01 * plain, "{variance} {plain}");
}
