//! Tests of the lamps: closed forms, round trips, uniformity, and the awkward places.

use super::*;
use std::f64::consts::TAU;

const ORIGIN: DVec3 = DVec3::new(1000.0, -20.0, 3.0);

fn random(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    ((*state >> 40) as f32 + 0.5) / (1u64 << 24) as f32
}

fn sphere(centre: DVec3, radius: f64) -> LampSampler {
    LampSampler::new(
        &Lamp::Sphere { centre: centre + ORIGIN, radius, radiance: DVec3::new(2.0, 1.0, 0.5) },
        ORIGIN,
    )
}

fn rectangle(corner: DVec3, edge_u: DVec3, edge_v: DVec3) -> LampSampler {
    let radiance = DVec3::new(2.0, 1.0, 0.5);
    LampSampler::new(&Lamp::Rectangle { corner: corner + ORIGIN, edge_u, edge_v, radiance }, ORIGIN)
}

fn disc(centre: DVec3, direction: DVec3, radius: f64) -> LampSampler {
    let radiance = DVec3::new(2.0, 1.0, 0.5);
    LampSampler::new(&Lamp::Disc { centre: centre + ORIGIN, direction, radius, radiance }, ORIGIN)
}

fn point(position: DVec3) -> LampSampler {
    let intensity = DVec3::new(2.0, 1.0, 0.5);
    LampSampler::new(&Lamp::Point { position: position + ORIGIN, intensity }, ORIGIN)
}

/// Mean over 16 independent seeds, and its standard error.
fn irradiance(lamp: &LampSampler, point: Vec3, normal: Vec3, n: u32) -> (f64, f64) {
    let means: Vec<f64> = (0..16)
        .map(|seed| {
            let mut state = seed * 7919 + 1;
            random(&mut state);
            let mut sum = 0.0;
            for _ in 0..n {
                let u = Vec2::new(random(&mut state), random(&mut state));
                sum += lamp.sample(point, normal, u).map_or(0.0, |s| f64::from(s.irradiance.y));
            }
            sum / f64::from(n)
        })
        .collect();
    let mean = means.iter().sum::<f64>() / 16.0;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / 15.0;
    (mean, (variance / 16.0).sqrt())
}

fn check(lamp: &LampSampler, point: Vec3, normal: Vec3, expected: f64) {
    let (mean, sigma) = irradiance(lamp, point, normal, 40_000);
    println!("{mean} ± {sigma}, expected {expected}");
    // f32 results carry 10⁻⁶ of rounding beside the noise.
    assert!((mean - expected).abs() <= 3.0 * sigma + 2e-6 * expected, "{mean} ± {sigma} against {expected}");
    assert!((mean / expected - 1.0).abs() < 0.01, "{mean} against {expected}");
}

/// Irradiance at `p` under unit radiance from a polygon, cut at the horizon (Lambert 1760): E = L/2 |Σ θᵢ
/// n·Γᵢ|.
fn lambert(polygon: &[DVec3], p: DVec3, n: DVec3) -> f64 {
    let corners: Vec<DVec3> = polygon.iter().map(|c| *c - p).collect();
    let mut cut = Vec::new();
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let (ha, hb) = (a.dot(n), b.dot(n));
        if ha >= 0.0 {
            cut.push(a);
        }
        if ha * hb < 0.0 {
            cut.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    let mut sum = 0.0;
    for (i, a) in cut.iter().enumerate() {
        let b = cut[(i + 1) % cut.len()];
        let cross = a.cross(b);
        if cross.length() > 0.0 {
            sum += cross.length().atan2(a.dot(b)) * n.dot(cross.normalize());
        }
    }
    0.5 * sum.abs()
}

#[test]
fn sphere_matches_its_closed_form() {
    let up = Vec3::Y;
    // E = π L (R/d)² cos θ.
    check(&sphere(DVec3::new(0.0, 3.0, 0.0), 1.0), Vec3::ZERO, up, PI / 9.0);
    check(&sphere(DVec3::new(3.0, 4.0, 0.0), 0.5), Vec3::ZERO, up, PI * 0.01 * 0.8);
    check(&sphere(DVec3::new(0.0, 1.01, 0.0), 1.0), Vec3::ZERO, up, PI / 1.01f64.powi(2));
    check(&sphere(DVec3::new(3e4, 4e4, 0.0), 1e-4), Vec3::ZERO, up, PI * (1e-4 / 5e4f64).powi(2) * 0.8);
    // Inside: E = π L.
    check(&sphere(DVec3::new(0.3, 0.4, 0.0), 1.0), Vec3::ZERO, up, PI);
}

/// On the axis E = π L R²/(R² + h²), from far to touch; off it and tilted, the disc as a polygon of 2000
/// corners.
#[test]
fn disc_matches_its_closed_form() {
    for height in [10.0, 2.0, 0.86, 0.84, 0.3, 1e-2, 1e-5, 1e-9] {
        let lamp = disc(DVec3::Y * height, DVec3::NEG_Y, 1.0);
        check(&lamp, Vec3::ZERO, Vec3::Y, PI / (1.0 + height * height));
    }
    // Emitters of 10⁻⁴ m, at 10 m and closer than their size.
    check(&disc(DVec3::Y * 10.0, DVec3::NEG_Y, 1e-4), Vec3::ZERO, Vec3::Y, PI * 1e-10);
    check(&disc(DVec3::Y * 5e-5, DVec3::NEG_Y, 1e-4), Vec3::ZERO, Vec3::Y, PI / 1.25);
    for (centre, direction, normal) in [
        (DVec3::new(0.5, 0.4, 0.0), DVec3::NEG_Y, DVec3::Y),
        (DVec3::new(1.2, 0.3, 0.1), DVec3::new(-0.6, -0.8, 0.0), DVec3::new(0.0, 0.6, 0.8)),
        (DVec3::new(3.0, 0.2, 1.0), DVec3::new(-1.0, 0.0, 0.0), DVec3::Y),
        (DVec3::new(0.9, 0.05, 0.0), DVec3::NEG_Y, DVec3::Y),
    ] {
        let (x, y) = direction.any_orthonormal_pair();
        let polygon: Vec<DVec3> = (0..2000)
            .map(|i| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 2000.0).sin_cos();
                centre + x * cos + y * sin
            })
            .collect();
        let expected = lambert(&polygon, DVec3::ZERO, normal);
        check(&disc(centre, direction, 1.0), Vec3::ZERO, normal.as_vec3(), expected);
    }
    // One-sided.
    assert!(disc(DVec3::Y, DVec3::Y, 1.0).sample(Vec3::ZERO, Vec3::Y, Vec2::splat(0.3)).is_none());
    assert_eq!(disc(DVec3::Y, DVec3::Y, 1.0).importance(Vec3::ZERO, Vec3::Y), 0.0);
}

/// Near a disc some samples miss it; the others agree with `pdf` and `invert`.
#[test]
fn near_discs_sample_their_square() {
    let mut hits = 0;
    for (centre, direction) in [
        (DVec3::new(0.1, 0.3, 0.2), DVec3::NEG_Y),
        (DVec3::new(0.9, 0.4, -0.3), DVec3::new(-0.48, -0.8, 0.36)),
        (DVec3::new(0.6, 1e-3, 0.0), DVec3::NEG_Y),
    ] {
        let lamp = disc(centre, direction, 1.0);
        for i in 0..400 {
            let u = Vec2::new((i % 20) as f32 + 0.5, (i / 20) as f32 + 0.5) / 20.0;
            let Some(s) = lamp.sample(Vec3::ZERO, Vec3::Y, u) else { continue };
            let pdf = lamp.pdf(Vec3::ZERO, Vec3::Y, s.direction);
            let expected = s.direction.y.max(0.0) / pdf;
            assert!(
                pdf > 0.0 && (s.irradiance.y - expected).abs() < 1e-5 * expected + 1e-6,
                "{s:?} {expected}"
            );
            let back = lamp.invert(Vec3::ZERO, Vec3::Y, s.direction).unwrap();
            // Towards the lamp's plane an f32 direction stands for a long way on it.
            assert!((back - u).abs().max_element() < 1e-3, "{u} → {back}");
            hits += 1;
        }
    }
    assert!(hits > 800, "{hits}");
}

/// E = I cos θ / d².
#[test]
fn point_matches_its_closed_form() {
    let lamp = point(DVec3::new(3.0, 4.0, 0.0));
    let s = lamp.sample(Vec3::ZERO, Vec3::Y, Vec2::splat(0.7)).unwrap();
    assert!(
        (s.irradiance.y - 0.8 / 25.0).abs() < 1e-8 && (s.distance - 5.0).abs() < 1e-6 && s.emitter.is_none()
    );
    assert!((lamp.importance(Vec3::ZERO, Vec3::Y) / luminance(s.irradiance) - 1.0).abs() < 1e-6);
    assert_eq!(lamp.importance(Vec3::ZERO, Vec3::NEG_Y), 0.0);
    assert_eq!(
        (lamp.pdf(Vec3::ZERO, Vec3::Y, s.direction), lamp.invert(Vec3::ZERO, Vec3::Y, s.direction)),
        (0.0, None)
    );
    // On it: nothing.
    assert!(point(DVec3::ZERO).sample(Vec3::ZERO, Vec3::Y, Vec2::ZERO).is_none());
}

/// In the plane of a flat lamp nothing arrives; a hair in front of it the light of a half space, or of its
/// closed form.
#[test]
fn the_plane_of_a_flat_lamp_is_its_edge() {
    let flat =
        [rectangle(DVec3::new(-0.5, 0.0, -0.5), DVec3::X, DVec3::Z), disc(DVec3::ZERO, DVec3::NEG_Y, 0.5)];
    for lamp in &flat {
        for p in [Vec3::ZERO, Vec3::new(0.49, 0.0, 0.0), Vec3::new(0.5, 0.0, 0.0), Vec3::new(3.0, 0.0, 1.0)] {
            for n in [Vec3::Y, Vec3::X, Vec3::NEG_Y] {
                assert!(lamp.sample(p, n, Vec2::splat(0.4)).is_none(), "{lamp:?} {p}");
                assert_eq!((lamp.importance(p, n), lamp.pdf(p, n, Vec3::Y)), (0.0, 0.0));
            }
        }
        // Touching, facing it.
        for away in [1e-4f32, 1e-7, 1e-12, 1e-20] {
            let p = Vec3::new(0.1, -away, 0.1);
            let (mean, sigma) = irradiance(lamp, p, Vec3::Y, 2000);
            assert!((mean - PI).abs() < 4.0 * sigma + 2e-3, "{lamp:?} {away}: {mean} ± {sigma}");
        }
    }
    // Emitters of 10⁻⁴ m at 10 m: as a point of the same intensity.
    let tiny = [
        (rectangle(DVec3::new(0.0, 10.0, 0.0), DVec3::X * 1e-4, DVec3::Z * 1e-4), 1e-8),
        (disc(DVec3::Y * 10.0, DVec3::NEG_Y, 1e-4), PI * 1e-8),
        (sphere(DVec3::Y * 10.0, 1e-4), PI * 1e-8),
    ];
    for (lamp, area) in tiny {
        check(&lamp, Vec3::ZERO, Vec3::Y, area / 100.0);
    }
}

/// A sphere cut by the horizon, its cone integrated on a grid.
#[test]
fn sphere_across_the_horizon() {
    let centre = DVec3::new(2.0, 0.3, 0.0);
    let (cos_max, axis) = ((1.0 - 1.0 / centre.length_squared()).sqrt(), centre.normalize());
    let n = 2000;
    let mut sum = 0.0;
    for i in 0..n {
        let cosine = 1.0 - (1.0 - cos_max) * (i as f64 + 0.5) / n as f64;
        for j in 0..n {
            let phi = TAU * (j as f64 + 0.5) / n as f64;
            sum += (cosine * axis.y + (1.0 - cosine * cosine).sqrt() * phi.cos() * axis.x).max(0.0);
        }
    }
    let expected = sum / (n * n) as f64 * TAU * (1.0 - cos_max);
    check(&sphere(centre, 1.0), Vec3::ZERO, Vec3::Y, expected);
    assert!(sphere(DVec3::new(2.0, -1.1, 0.0), 1.0).sample(Vec3::ZERO, Vec3::Y, Vec2::splat(0.5)).is_none());
}

/// Parallel to the receiver over a corner: F = 1/2π [A/√(1+A²)·atan(B/√(1+A²)) + B/√(1+B²)·atan(A/√(1+B²))],
/// E = π L F.
#[test]
fn rectangle_over_a_corner() {
    for (a, b, h) in [(1.0f64, 2.0f64, 1.5f64), (4.0, 4.0, 0.05), (0.01, 0.02, 3.0), (1e-4, 1e-4, 1.0)] {
        let lamp = rectangle(DVec3::new(0.0, h, 0.0), DVec3::X * a, DVec3::Z * b);
        let (a, b) = (a / h, b / h);
        let (ra, rb) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        let factor = (a / ra * (b / ra).atan() + b / rb * (a / rb).atan()) / TAU;
        check(&lamp, Vec3::ZERO, Vec3::Y, PI * factor);
    }
}

#[test]
fn rectangle_anywhere_matches_lambert() {
    let mut state = 3;
    let mut cut = 0;
    for trial in 0..40 {
        let mut vector = || DVec3::from_array([0; 3].map(|_| f64::from(random(&mut state)) * 2.0 - 1.0));
        let (corner, u, n) = (vector(), vector(), vector().normalize().as_vec3().as_dvec3());
        let v = u.cross(vector()).normalize() * 1.3;
        let edges = [corner, corner + u, corner + u + v, corner + v];
        let lamp = rectangle(corner, u, v);
        let expected = if (-corner).dot(u.cross(v)) > 0.0 { lambert(&edges, DVec3::ZERO, n) } else { 0.0 };
        let heights = edges.map(|e| e.dot(n) > 0.0);
        cut += i32::from(expected > 0.0 && heights.contains(&true) && heights.contains(&false));
        let (mean, sigma) = irradiance(&lamp, Vec3::ZERO, n.as_vec3(), 10_000);
        // 4σ over 40 trials: a false alarm once in 400 runs, and the seeds are fixed.
        assert!(
            (mean - expected).abs() <= 4.0 * sigma + 1e-6 * expected,
            "{trial}: {mean} ± {sigma}, {expected}"
        );
        assert!(expected > 0.0 || lamp.sample(Vec3::ZERO, n.as_vec3(), Vec2::splat(0.3)).is_none());
        assert_eq!(lamp.importance(Vec3::ZERO, n.as_vec3()) > 0.0, expected > 0.0);
    }
    assert!(cut >= 4, "{cut} rectangles stood across the horizon");
}

/// Both sides of the change from solid angle to area give the same light.
#[test]
fn small_rectangles_change_over_smoothly() {
    for size in [3.0e-4, 3.3e-4, 1e-6] {
        let lamp = rectangle(DVec3::new(0.0, 1.0, 0.0), DVec3::X * size, DVec3::Z * size);
        let (mean, _) = irradiance(&lamp, Vec3::ZERO, Vec3::Y, 100);
        assert!((mean / (size * size) - 1.0).abs() < 1e-5, "{size}: {mean}");
    }
    // Thin and near: few steradians, but far from a point.
    let corner = DVec3::new(-1.0, 0.01, 0.0);
    let (u, v) = (DVec3::X * 2.0, DVec3::new(0.0, -1e-10, 1e-10));
    let lamp = rectangle(corner, u, -v);
    let edges = [corner, corner + u, corner + u - v, corner - v];
    let front = (-corner).dot(u.cross(-v)) > 0.0;
    let lamp = if front { lamp } else { rectangle(corner + u, -u, -v) };
    let seen = matches!(&lamp.shape, Shape::Rectangle(r) if r.seen_from(DVec3::ZERO).unwrap().by_area());
    assert!(seen);
    let (mean, sigma) = irradiance(&lamp, Vec3::ZERO, Vec3::Y, 40_000);
    let expected = lambert(&edges, DVec3::ZERO, DVec3::Y);
    assert!((mean - expected).abs() < 4.0 * sigma + 1e-3 * expected, "{mean} ± {sigma} against {expected}");
}

fn spot(inner: f64, outer: f64) -> LampSampler {
    let position = ORIGIN + DVec3::new(0.0, 2.0, 0.0);
    LampSampler::new(
        &Lamp::Spot { position, direction: DVec3::NEG_Y, inner, outer, intensity: DVec3::splat(8.0) },
        ORIGIN,
    )
}

#[test]
fn spot_falls_off_between_its_angles() {
    let e = |lamp: &LampSampler, x: f32| {
        lamp.sample(Vec3::X * x, Vec3::Y, Vec2::ZERO).map_or(0.0, |s| s.irradiance.x)
    };
    let lamp = spot(0.3, 0.6);
    // I cosθ / d² inside.
    assert!((e(&lamp, 0.0) - 2.0).abs() < 1e-6);
    let angle = 0.2f64;
    assert!((f64::from(e(&lamp, 2.0 * angle.tan() as f32)) - 2.0 * angle.cos().powi(3)).abs() < 1e-6);
    // Half the falloff at the middle cosine.
    let middle = (0.5 * (0.3f64.cos() + 0.6f64.cos())).acos();
    assert!((f64::from(e(&lamp, 2.0 * middle.tan() as f32)) - middle.cos().powi(3)).abs() < 1e-5);
    assert_eq!(e(&lamp, 2.0 * 0.61f32.tan()), 0.0);
    assert!(lamp.sample(Vec3::ZERO, Vec3::NEG_Y, Vec2::ZERO).is_none_or(|s| s.irradiance == Rgb::ZERO));
    // Hard edge.
    let hard = spot(0.4, 0.4);
    assert!(e(&hard, 2.0 * 0.399f32.tan()) > 1.0 && e(&hard, 2.0 * 0.401f32.tan()) == 0.0);
    // A delta: no density, and the guess is exact.
    assert_eq!(lamp.pdf(Vec3::ZERO, Vec3::Y, Vec3::Y), 0.0);
    assert!(lamp.invert(Vec3::ZERO, Vec3::Y, Vec3::Y).is_none());
    assert!((lamp.importance(Vec3::ZERO, Vec3::Y) - 2.0).abs() < 1e-6);
    assert_eq!(lamp.importance(Vec3::ZERO, Vec3::NEG_Y), 0.0);
}

/// Lamps with extent, seen from the origin with normal +Y.
fn extended() -> Vec<LampSampler> {
    vec![
        sphere(DVec3::new(1.0, 2.0, 0.5), 0.7),
        sphere(DVec3::new(1.0, 0.2, 0.5), 0.9),
        sphere(DVec3::new(0.1, 0.2, -0.1), 0.9),
        sphere(DVec3::new(0.0, 50.0, 1.0), 0.5),
        rectangle(DVec3::new(-0.5, 1.0, -0.3), DVec3::X * 2.0, DVec3::Z),
        rectangle(DVec3::new(-0.5, 0.02, -0.3), DVec3::X * 1.5, DVec3::Z),
        rectangle(DVec3::new(1.0, -0.5, -0.3), DVec3::Z, DVec3::Y * 2.0),
        rectangle(DVec3::new(-0.5, 30.0, -0.3), DVec3::X * 2.0, DVec3::Z),
        disc(DVec3::new(0.5, 40.0, -0.3), DVec3::NEG_Y, 0.7),
        disc(DVec3::new(0.9, 1.2, -0.3), DVec3::new(-0.48, -0.8, 0.36), 0.7),
    ]
}

#[test]
fn sample_pdf_and_invert_agree() {
    for (k, lamp) in extended().iter().enumerate() {
        for i in 0..20 {
            for j in 0..20 {
                let u = Vec2::new(i as f32 + 0.5, j as f32 + 0.5) / 20.0;
                let s = lamp.sample(Vec3::ZERO, Vec3::Y, u).unwrap_or_else(|| panic!("lamp {k}"));
                let pdf = lamp.pdf(Vec3::ZERO, Vec3::Y, s.direction);
                let expected = f64::from(s.direction.y.max(0.0)) / f64::from(pdf);
                assert!(
                    pdf > 0.0 && (f64::from(s.irradiance.y) - expected).abs() < 1e-5 * expected + 1e-6,
                    "lamp {k}"
                );
                let back = lamp.invert(Vec3::ZERO, Vec3::Y, s.direction).unwrap();
                let mut error = (back - u).abs();
                error.y = error.y.min(1.0 - error.y);
                // Small in the sky: an f32 direction resolves 10⁻⁷ / its angular size.
                assert!(error.max_element() < 2e-4, "lamp {k}: {u} → {back}");
            }
        }
        assert_eq!(lamp.pdf(Vec3::ZERO, Vec3::Y, Vec3::NEG_Y), 0.0, "lamp {k}");
        assert!(lamp.invert(Vec3::ZERO, Vec3::Y, Vec3::NEG_Y).is_none());
    }
}

/// The pdf integrates to 1, and directions drawn with it independently (over the sphere, kept with
/// probability pdf/peak) fall evenly into 8×8 cells of `u`: χ² with 63 degrees of freedom below 119 (p =
/// 2·10⁻⁵).
#[test]
fn samples_follow_the_pdf() {
    for (k, lamp) in extended().iter().enumerate().filter(|(k, _)| ![3, 7, 8].contains(k)) {
        let mut state = 11 + k as u64;
        let (mut counts, mut total, mut integral) = ([0u32; 64], 0u32, 0.0);
        let n = 400_000;
        let peak = (0..64).map(|i| Vec2::new((i % 8) as f32 + 0.5, (i / 8) as f32 + 0.5) / 8.0);
        let peak = peak
            .filter_map(|u| lamp.sample(Vec3::ZERO, Vec3::Y, u))
            .map(|s| lamp.pdf(Vec3::ZERO, Vec3::Y, s.direction))
            .fold(0.0, |a, b| f32::max(a, 1.3 * b))
            .max(if k == 2 { 1.0 / std::f32::consts::PI } else { 0.0 });
        for _ in 0..n {
            let y = 2.0 * random(&mut state) - 1.0;
            let (sin, cos) = (std::f32::consts::TAU * random(&mut state)).sin_cos();
            let r = (1.0 - y * y).sqrt();
            let direction = Vec3::new(r * cos, y, r * sin);
            let pdf = lamp.pdf(Vec3::ZERO, Vec3::Y, direction);
            integral += f64::from(pdf) * 4.0 * PI / f64::from(n);
            if pdf > peak * random(&mut state) {
                let cell = (lamp.invert(Vec3::ZERO, Vec3::Y, direction).unwrap() * 7.9999).as_uvec2();
                counts[(cell.x * 8 + cell.y) as usize] += 1;
                total += 1;
            }
        }
        let mean = f64::from(total) / 64.0;
        let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - mean).powi(2) / mean).sum();
        assert!(chi2 < 119.0 && total > 640, "lamp {k}: χ² = {chi2} of {total}");
        assert!((integral - 1.0).abs() < 5.0 / f64::from(total).sqrt(), "lamp {k}: ∫ pdf = {integral}");
    }
}

/// Points on, in, near and far from lamps, tiny and huge: everything finite, directions unit, the guess not
/// zero where there is light.
#[test]
fn awkward_places_give_no_nan() {
    let mut lamps = extended();
    lamps.push(spot(0.3, 0.3));
    lamps.push(spot(0.0, 1.5));
    lamps.push(point(DVec3::ZERO));
    lamps.push(point(DVec3::new(0.0, 2.0, 0.0)));
    for scale in [1e-4, 1.0, 1e3] {
        lamps.push(sphere(DVec3::ZERO, scale));
        lamps.push(disc(DVec3::ZERO, DVec3::X, scale));
        lamps.push(disc(DVec3::Y * scale, DVec3::new(0.0, -0.8, 0.6), scale));
        lamps.push(rectangle(DVec3::ZERO, DVec3::X * scale, DVec3::NEG_Z * scale * 0.01));
        lamps.push(rectangle(DVec3::ZERO, DVec3::Y * scale, DVec3::X * scale));
    }
    lamps.push(rectangle(DVec3::ZERO, DVec3::ZERO, DVec3::X));
    let mut points =
        vec![Vec3::ZERO, Vec3::new(0.0, 2.0, 0.0), Vec3::new(0.5, 1.0, 0.2), Vec3::new(-0.5, 1.0, -0.3)];
    for distance in [1e-20, 1e-7, 1e-4, 0.3, 1.0, 1e5] {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_Y, Vec3::new(0.6, 0.0, 0.8), Vec3::splat(0.577)] {
            points.push(axis * distance);
        }
    }
    let mut lit = 0;
    for lamp in &lamps {
        for &p in &points {
            for n in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::new(0.0, -0.6, 0.8)] {
                let guess = lamp.importance(p, n);
                assert!(guess.is_finite() && guess >= 0.0);
                for u in [0.0, 0.25, 0.5, 1.0 - f32::EPSILON / 2.0] {
                    for v in [0.0, 0.6, 1.0 - f32::EPSILON / 2.0] {
                        if let Some(s) = lamp.sample(p, n, Vec2::new(u, v)) {
                            assert!(
                                s.direction.is_finite() && (s.direction.length() - 1.0).abs() < 1e-5,
                                "{lamp:?} {p} {s:?}"
                            );
                            assert!(s.distance > 0.0 && s.distance.is_finite() && s.irradiance.is_finite());
                            assert!(s.irradiance.min_element() >= 0.0);
                            assert!(s.irradiance == Rgb::ZERO || guess > 0.0, "{lamp:?} {p} {n} {s:?}");
                            lit += usize::from(s.irradiance.x > 0.0);
                            assert!(!lamp.pdf(p, n, s.direction).is_nan());
                            assert!(lamp.invert(p, n, s.direction).is_none_or(|u| u.is_finite()));
                        }
                    }
                }
            }
        }
    }
    assert!(lit > 1000, "{lit}");
}
