//! Tests of the choice among many lights: its probabilities against each other, its sums against the lights
//! one by one, its variance against the exact choice.

use super::*;
use crate::Rgb;
use std::f64::consts::PI;

struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..4).for_each(|_| _ = random.next());
        random
    }

    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.next())
    }

    fn direction(&mut self) -> DVec3 {
        let y = self.between(-1.0, 1.0);
        let (sin, cos) = self.between(0.0, 2.0 * PI).sin_cos();
        let r = (1.0 - y * y).sqrt();
        DVec3::new(r * cos, y, r * sin)
    }
}

/// Lamps of every kind, of sizes and powers over many decades, some in one place.
fn mixed(n: usize) -> Vec<Lamp> {
    let mut random = Random::new(5);
    (0..n)
        .map(|i| {
            let at = DVec3::new(
                random.between(-10.0, 10.0),
                random.between(0.0, 6.0),
                random.between(-10.0, 10.0),
            );
            let at = if i % 50 == 7 { DVec3::new(1.0, 2.0, 3.0) } else { at };
            let direction = random.direction();
            let light = DVec3::splat(10f64.powf(random.between(-3.0, 2.0)));
            let radius = 10f64.powf(random.between(-4.0, -0.5));
            match i % 5 {
                0 => Lamp::Sphere { centre: at, radius, radiance: light },
                1 => Lamp::Disc { centre: at, direction, radius, radiance: light },
                2 => Lamp::Point { position: at, intensity: light },
                3 => Lamp::Spot { position: at, direction, inner: 0.3, outer: 0.9, intensity: light },
                _ => {
                    let (x, y) = direction.any_orthonormal_pair();
                    Lamp::Rectangle {
                        corner: at,
                        edge_u: x * radius,
                        edge_v: y * 2.0 * radius,
                        radiance: light,
                    }
                }
            }
        })
        .collect()
}

/// A bumpy sheet of `2 · side²` triangles over a square of 8 m at about 3 m, facing down.
fn sheet(side: u32) -> Vec<Emitter> {
    let mut random = Random::new(9);
    let heights: Vec<f32> = (0..(side + 1) * (side + 1)).map(|_| 3.0 + 0.02 * random.next()).collect();
    let at = |i: u32, j: u32| {
        let scale = 8.0 / side as f32;
        Vec3::new(i as f32 * scale - 4.0, heights[(j * (side + 1) + i) as usize], j as f32 * scale - 4.0)
    };
    let mut found = Vec::new();
    for j in 0..side {
        for i in 0..side {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            for corners in [[a, b, c], [d, c, b]] {
                let triangle = 100 + found.len() as u32;
                found.push(Emitter { triangle, corners, radiance: Rgb::ONE, two_sided: false });
            }
        }
    }
    found
}

fn receivers(n: usize) -> Vec<(Vec3, Vec3)> {
    let mut random = Random::new(77);
    (0..n)
        .map(|_| {
            let at = DVec3::new(
                random.between(-12.0, 12.0),
                random.between(-1.0, 7.0),
                random.between(-12.0, 12.0),
            );
            (at.as_vec3(), random.direction().as_vec3())
        })
        .chain([
            (Vec3::new(1.0, 2.0, 3.0), Vec3::Y),
            (Vec3::splat(1e5), Vec3::Y),
            (Vec3::splat(1e5), Vec3::NEG_Y),
        ])
        .collect()
}

fn groups() -> Vec<GroupSampler> {
    let few = mixed(5);
    vec![
        GroupSampler::new(&few, &[], DVec3::ZERO),
        GroupSampler::new(&few, &sheet(1), DVec3::ZERO),
        GroupSampler::new(&mixed(8), &[], DVec3::ZERO),
        GroupSampler::new(&mixed(500), &sheet(10), DVec3::ZERO),
        GroupSampler::new(&vec![few[2].clone(); 40], &[], DVec3::ZERO),
    ]
}

/// Over all lights the probabilities sum to 1, or all are 0.
#[test]
fn probabilities_sum_to_one() {
    for (k, group) in groups().iter().enumerate() {
        let mut summed = 0;
        for (p, n) in receivers(40) {
            let probabilities: Vec<f32> =
                (0..group.len()).map(|light| group.probability(p, n, light as u32)).collect();
            let sum: f64 = probabilities.iter().map(|x| f64::from(*x)).sum();
            assert!(probabilities.iter().all(|x| *x >= 0.0));
            assert!(sum == 0.0 || (sum - 1.0).abs() < 1e-4, "group {k}, {p}: {sum}");
            summed += usize::from(sum > 0.0);
            // What could give light can be chosen.
            for light in 0..group.len() as u32 {
                assert!(
                    group.importance(light, p, n) == 0.0 || probabilities[light as usize] > 0.0,
                    "group {k}: light {light} never chosen at {p}, {n}"
                );
            }
        }
        assert!(summed > 10, "group {k}");
    }
}

/// Numbers on a fine grid choose each light as often as its probability says, to within the grid.
#[test]
fn the_choice_follows_its_probabilities() {
    for (k, group) in groups().iter().enumerate() {
        for (p, n) in receivers(3) {
            let grid = 1 << 15;
            let mut counts = vec![0u32; group.len()];
            for i in 0..grid {
                let choice = (f64::from(i) + 0.5) / f64::from(grid);
                if let Some((light, probability, _)) = group.choose(p, n, choice as f32, choice as f32) {
                    counts[light as usize] += 1;
                    let again = group.probability(p, n, light);
                    assert!((again / probability - 1.0).abs() < 1e-5, "group {k}: {again} {probability}");
                }
            }
            if counts.iter().all(|&count| count == 0) {
                continue;
            }
            for (light, &count) in counts.iter().enumerate() {
                let expected = f64::from(group.probability(p, n, light as u32)) * f64::from(grid);
                // Each light has an interval of the tree's part and one of the even part.
                assert!(
                    (f64::from(count) - expected).abs() <= 4.5,
                    "group {k}, light {light}: {count} {expected}"
                );
            }
        }
    }
}

/// Irradiance by `n` samples in each of 16 independent seeds: |z| < 4.5 for the mean of seeds (Student's t
/// with 15 degrees of freedom: p = 4·10⁻⁴).
fn check(group: &GroupSampler, p: Vec3, normal: Vec3, n: u32, expected: f64) {
    let means: Vec<f64> = (0..16)
        .map(|seed| {
            let mut random = Random::new(1000 + seed);
            let mut sum = 0.0;
            for i in 0..n {
                // (Stratified, as the bake's numbers are.)
                let choice = (i as f32 + random.next()) / n as f32;
                let u = Vec2::new(random.next(), random.next());
                let choice = choice.min(1.0 - f32::EPSILON / 2.0);
                sum += group.sample(p, normal, choice, u).map_or(0.0, |s| f64::from(s.irradiance.y));
            }
            sum / f64::from(n)
        })
        .collect();
    let mean = means.iter().sum::<f64>() / 16.0;
    let sigma = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (15.0 * 16.0)).sqrt();
    println!("{mean} ± {sigma}, expected {expected}");
    assert!((mean - expected).abs() <= 4.5 * sigma + 1e-4 * expected, "{mean} ± {sigma} against {expected}");
    assert!(sigma < 0.1 * expected, "{sigma} against {expected}");
}

/// 500 points and balls above the receivers' horizon, whose irradiances have closed forms.
#[test]
fn five_hundred_lamps_give_what_each_gives() {
    let mut random = Random::new(3);
    let lamps: Vec<Lamp> = (0..500)
        .map(|i| {
            let at =
                DVec3::new(random.between(-9.0, 9.0), random.between(1.0, 5.0), random.between(-9.0, 9.0));
            let light = DVec3::splat(10f64.powf(random.between(-2.0, 1.0)));
            if i % 2 == 0 {
                Lamp::Point { position: at, intensity: light }
            } else {
                Lamp::Sphere { centre: at, radius: 0.3, radiance: light }
            }
        })
        .collect();
    let group = GroupSampler::new(&lamps, &[], DVec3::ZERO);
    for p in [DVec3::ZERO, DVec3::new(7.0, 0.5, -3.0), DVec3::new(-30.0, 0.2, 4.0)] {
        let expected: f64 = lamps
            .iter()
            .map(|lamp| {
                let (at, light) = match *lamp {
                    Lamp::Point { position, intensity } => (position, intensity.x),
                    Lamp::Sphere { centre, radius, radiance } => (centre, radiance.x * PI * radius * radius),
                    _ => unreachable!(),
                };
                let offset = at - p;
                light * offset.y / offset.length().powi(3)
            })
            .sum();
        check(&group, p.as_vec3(), Vec3::Y, 2000, expected);
    }
}

/// Irradiance at the origin of a polygon's edges by Lambert's formula, the whole of it above the horizon.
fn lambert(corners: &[Vec3; 3], p: DVec3) -> f64 {
    let v = corners.map(|corner| (corner.as_dvec3() - p).normalize());
    let edge = |a: DVec3, b: DVec3| {
        let cross = a.cross(b);
        0.5 * cross.length().atan2(a.dot(b)) * cross.normalize_or_zero().y
    };
    (edge(v[0], v[1]) + edge(v[1], v[2]) + edge(v[2], v[0])).abs()
}

/// A sheet of 50 000 triangles, from far and from a few centimetres below it.
#[test]
fn fifty_thousand_triangles_give_what_each_gives() {
    let sheet = sheet(160);
    let group = GroupSampler::new(&[], &sheet, DVec3::ZERO);
    assert!(group.len() > 50_000);
    for p in [Vec3::ZERO, Vec3::new(3.0, 2.95, -1.0), Vec3::new(30.0, -5.0, 4.0)] {
        // The bumps make some triangles turn away from a grazing receiver.
        let seen = |e: &Emitter| e.seen_from(p.as_dvec3()).is_some();
        let expected: f64 = sheet.iter().filter(|e| seen(e)).map(|e| lambert(&e.corners, p.as_dvec3())).sum();
        check(&group, p, Vec3::Y, 4000, expected);
    }
    for p in [Vec3::ZERO, Vec3::new(3.0, 2.95, -1.0)] {
        let sum: f64 = (0..group.len()).map(|i| f64::from(group.probability(p, Vec3::Y, i as u32))).sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    }
}

/// The density told for a met triangle is that of the sample that gives it.
#[test]
fn densities_of_met_triangles_are_the_samples() {
    let mut found = 0;
    for group in [
        GroupSampler::new(&mixed(3), &sheet(1), DVec3::ZERO),
        GroupSampler::new(&mixed(30), &sheet(20), DVec3::ZERO),
    ] {
        let mut random = Random::new(8);
        for (p, n) in receivers(20) {
            for _ in 0..300 {
                let (choice, u) = (random.next(), Vec2::new(random.next(), random.next()));
                let Some(s) = group.sample(p, n, choice, u) else { continue };
                let Some((triangle, pdf)) = s.emitter else { continue };
                let again = group.emitter_pdf(p, n, triangle, s.direction, s.distance);
                assert!((again / pdf - 1.0).abs() < 1e-4, "{again} {pdf}");
                // Radiance 1: irradiance · pdf is the cosine.
                let cosine = s.direction.dot(n).max(0.0);
                assert!((s.irradiance.y * pdf - cosine).abs() < 1e-5, "{s:?} {cosine}");
                found += 1;
            }
        }
        assert_eq!(group.emitter_pdf(Vec3::ZERO, Vec3::Y, 3, Vec3::Y, 1.0), 0.0);
    }
    assert!(found > 1000, "{found}");
}

/// A ceiling of 500 lamps of which every other one, at random, is hidden: the variance of the tree's choice
/// against that of the exact one, over receivers below, between and beside the lamps.
#[test]
fn variance_is_near_that_of_the_exact_choice() {
    let mut random = Random::new(4);
    let lamps: Vec<Lamp> = (0..500)
        .map(|i| {
            let at = DVec3::new(f64::from(i % 25) - 12.0, 3.0, f64::from(i / 25) - 10.0);
            Lamp::Disc { centre: at, direction: DVec3::NEG_Y, radius: 0.1, radiance: DVec3::ONE }
        })
        .collect();
    let group = GroupSampler::new(&lamps, &[], DVec3::ZERO);
    // [On the floor and half way up, within half a metre of the lamps' plane].
    let (mut tree, mut exact, mut worst) = ([0.0; 2], [0.0; 2], [0.0f64; 2]);
    for k in 0..200 {
        let height = [0.0, 1.5, 2.5, 2.9][k % 4];
        let p = DVec3::new(random.between(-14.0, 14.0), height, random.between(-12.0, 12.0)).as_vec3();
        let light: Vec<f64> = (0..500).map(|i| f64::from(group.importance(i, p, Vec3::Y))).collect();
        let seen: Vec<bool> = (0..500).map(|_| random.next() < 0.5).collect();
        let total: f64 = light.iter().sum();
        let visible: f64 = light.iter().zip(&seen).filter(|(_, seen)| **seen).map(|(light, _)| light).sum();
        if visible < 0.05 * total {
            // All but hidden: the even part of the choice wins, which is not what is measured here.
            continue;
        }
        let variance = |probability: &dyn Fn(usize) -> f64| {
            let second: f64 = (0..500)
                .filter(|&i| seen[i] && light[i] > 0.0)
                .map(|i| light[i].powi(2) / probability(i))
                .sum();
            second / (visible * visible) - 1.0
        };
        let by_tree = variance(&|i| f64::from(group.probability(p, Vec3::Y, i as u32)));
        let by_share = variance(&|i| light[i] / total);
        let close = usize::from(k % 4 > 1);
        // (The second moment: a variance of nearly 0 has no ratio.)
        let ratio = (1.0 + by_tree) / (1.0 + by_share);
        tree[close] += by_tree;
        exact[close] += by_share;
        worst[close] = worst[close].max(ratio);
    }
    let ratios = [0, 1].map(|i| tree[i] / exact[i]);
    println!("variance {ratios:?} of the exact choice's, worst second moments {worst:?}");
    assert!(ratios.iter().all(|ratio| *ratio < 1.5) && worst[0] < 2.0);
    // There the lamps' light falls with the fourth power of distance, which a bound of many follows less
    // well.
    assert!(worst[1] < 8.0);
}

/// Intensities of 1 : 10⁸ in one group: the faint lamp is chosen, and its weight is finite and bounded.
#[test]
fn faint_lamps_are_not_starved() {
    let point = |x: f64, intensity: f64| Lamp::Point {
        position: DVec3::new(x, 1.0, 0.0),
        intensity: DVec3::splat(intensity),
    };
    let mut many = vec![point(0.5, 1e8)];
    many.extend((0..499).map(|i| point(f64::from(i) * 0.1, 1.0)));
    for lamps in [vec![point(0.0, 1e8), point(1.0, 1.0)], many, vec![point(0.0, 1e12), point(1.0, 1e-12)]] {
        let group = GroupSampler::new(&lamps, &[], DVec3::ZERO);
        assert_eq!(group.len(), lamps.len());
        let least = EVEN_SHARE / lamps.len() as f32 * 0.99;
        for light in 0..lamps.len() as u32 {
            assert!(group.probability(Vec3::ZERO, Vec3::Y, light) >= least, "{light}");
        }
        let mut faint = 0;
        for i in 0..10_000 {
            let u = i as f32 / 10_000.0;
            let s = group.sample(Vec3::ZERO, Vec3::Y, u, Vec2::new(u, 0.5)).unwrap();
            assert!(s.irradiance.is_finite());
            faint += usize::from(s.direction.x.abs() > 0.45 + 0.05 * lamps.len().min(3) as f32 - 0.1);
        }
        assert!(faint > 20, "{faint}");
    }
}

#[test]
fn lights_without_power_are_dropped() {
    let dark = Lamp::Point { position: DVec3::Y, intensity: DVec3::ZERO };
    let flat = Emitter { triangle: 0, corners: [Vec3::X; 3], radiance: Rgb::ONE, two_sided: true };
    let none = GroupSampler::new(&[dark], &[flat], DVec3::ZERO);
    assert!(none.is_empty() && none.sample(Vec3::ZERO, Vec3::Y, 0.0, Vec2::ZERO).is_none());
    assert_eq!(none.emitter_pdf(Vec3::ZERO, Vec3::Y, 0, Vec3::Y, 1.0), 0.0);
}

#[test]
fn a_group_is_worth_nothing_only_where_it_gives_nothing() {
    let (mut none, mut some) = (0, 0);
    for n in [1, 2, 5, 200] {
        // One lamp of each kind, or many of all.
        for first in 0..if n == 1 { 5 } else { 1 } {
            let group = GroupSampler::new(&mixed(first + n)[first..], &[], DVec3::ZERO);
            let mut random = Random::new(11);
            for _ in 0..1000 {
                let mut at = || random.between(-12.0, 12.0) as f32;
                let point = Vec3::new(at(), at(), at());
                let normal = random.direction().as_vec3();
                let worth = group.worth(point, normal);
                assert!(worth >= 0.0 && worth.is_finite());
                let mut sample =
                    || group.sample(point, normal, random.next(), Vec2::new(random.next(), random.next()));
                let gives = (0..16).any(|_| sample().is_some_and(|s| s.irradiance != Rgb::ZERO));
                assert!(worth > 0.0 || !gives, "{n} {point} {normal}");
                if worth > 0.0 { some += 1 } else { none += 1 }
            }
        }
    }
    assert!(none > 100 && some > 1000, "{none} {some}");
}
