//! Tests of emissive triangles: solid angles, round trips, and the awkward places.

use super::*;
use crate::geometry::Emission;
use glam::Vec2;

fn emitter(corners: [Vec3; 3]) -> Emitter {
    Emitter { triangle: 5, corners, radiance: Rgb::new(2.0, 1.0, 0.5), two_sided: false }
}

/// Facing down on the origin: large and near, touching a corner of the view, small, far, slivers.
fn shapes() -> Vec<[Vec3; 3]> {
    let v = Vec3::new;
    vec![
        [v(-1.0, 1.0, -1.0), v(2.0, 1.0, -1.0), v(-1.0, 1.0, 2.0)],
        [v(-50.0, 0.01, -40.0), v(70.0, 0.01, -60.0), v(-10.0, 0.01, 80.0)],
        [v(0.3, 0.5, 0.2), v(0.4, 0.5, 0.2), v(0.3, 0.5, 0.3)],
        [v(3.0, 40.0, 0.2), v(3.1, 40.0, 0.2), v(3.0, 40.5, 0.3)],
        // Slivers of 10⁻⁴ and 10⁻⁶.
        [v(-1.0, 1.0, 0.0), v(1.0, 1.0, 0.0), v(0.3, 1.0, 2e-4)],
        [v(-1.0, 0.5, 0.0), v(1.0, 0.5, 0.0), v(0.3, 0.5, 2e-6)],
        // Nearly edge-on.
        [v(1.0, 0.5, -1.0), v(2.0, 0.500_01, -1.0), v(1.0, 0.5, 1.0)],
    ]
}

#[test]
fn an_octant_has_an_eighth_of_the_sphere() {
    let mut octant = emitter([Vec3::X, Vec3::Z, Vec3::Y]);
    let seen = octant.seen_from(DVec3::ZERO).unwrap();
    assert!((seen.solid_angle - 0.5 * PI).abs() < 1e-12);
    assert!((octant.importance(DVec3::ZERO, DVec3::ONE.normalize()) - 0.5 * PI).abs() < 1e-6);
    // From behind: nothing, unless the back emits too.
    let behind = DVec3::splat(5.0);
    assert!(octant.seen_from(behind).is_none() && octant.importance(behind, -DVec3::ONE.normalize()) == 0.0);
    octant.two_sided = true;
    assert!(octant.seen_from(behind).unwrap().solid_angle > 0.0);
    assert!(octant.importance(behind, -DVec3::ONE.normalize()) > 0.0);
    assert_eq!(octant.importance(behind, DVec3::ONE.normalize()), 0.0);
}

#[test]
fn sample_and_invert_agree() {
    for (k, corners) in shapes().into_iter().enumerate() {
        let emitter = emitter(corners);
        assert!(emitter.is_usable(), "{k}");
        let seen = emitter.seen_from(DVec3::ZERO).unwrap_or_else(|| panic!("{k}"));
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        for i in 0..24 {
            for j in 0..24 {
                let u = DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5) / 24.0;
                let (direction, distance) = seen.sample(u).unwrap();
                assert!((direction.length() - 1.0).abs() < 1e-9);
                // The point lies on the triangle.
                let normal = (b - a).cross(c - a);
                let offset = direction * distance - a;
                let s = offset.cross(c - a).dot(normal) / normal.length_squared();
                let t = (b - a).cross(offset).dot(normal) / normal.length_squared();
                assert!(s > -1e-6 && t > -1e-6 && s + t < 1.0 + 1e-6, "{k}: {s} {t}");
                let back = seen.invert(direction);
                assert!((back - u).abs().max_element() < 1e-5, "{k}: {u} → {back}");
            }
        }
    }
}

/// Lambert's polygon formula against the sampled mean of cosine ÷ pdf, on a grid of 512² cells: each error is
/// far below 10⁻³ of the value (but for the nearly edge-on one).
#[test]
fn irradiance_matches_lambert() {
    for (k, corners) in shapes().into_iter().enumerate() {
        let emitter = emitter(corners);
        let seen = emitter.seen_from(DVec3::ZERO).unwrap();
        let n = DVec3::Y;
        let v: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3().normalize()).collect();
        let mut expected = 0.0;
        for i in 0..3 {
            let (a, b) = (v[i], v[(i + 1) % 3]);
            let cross = a.cross(b);
            expected += 0.5 * cross.length().atan2(a.dot(b)) * n.dot(cross.normalize_or_zero());
        }
        let expected = expected.abs();
        let side = 512;
        let mut sum = 0.0;
        for i in 0..side * side {
            let u = DVec2::new(f64::from(i % side) + 0.5, f64::from(i / side) + 0.5) / f64::from(side);
            let (direction, distance) = seen.sample(u).unwrap();
            sum += direction.dot(n) / seen.pdf(distance);
        }
        let mean = sum / f64::from(side * side);
        println!("{k}: {mean} against {expected}");
        assert!((mean / expected - 1.0).abs() < 1e-3, "{k}: {mean} against {expected}");
    }
}

/// On, in and beside: finite or nothing.
#[test]
fn awkward_places_give_no_nan() {
    let mut shapes = shapes();
    shapes.push([Vec3::ZERO, Vec3::X, Vec3::Z]);
    shapes.push([Vec3::ZERO, Vec3::X * 1e-4, Vec3::Y * 1e-4]);
    shapes.push([Vec3::ZERO, Vec3::X * 1e5, Vec3::Y * 1e-1]);
    let mut lit = 0;
    for corners in shapes {
        for two_sided in [false, true] {
            let emitter = Emitter { two_sided, ..emitter(corners) };
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let edge = 0.5 * (corners[0] + corners[1]);
            for base in [Vec3::ZERO, corners[0], corners[2], middle, edge] {
                for away in [0.0, 1e-30, 1e-12, 1e-6, 1e-3, 1.0, 1e5] {
                    for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_Y, Vec3::new(0.6, 0.0, -0.8)] {
                        let p = (base + axis * away).as_dvec3();
                        for n in [DVec3::Y, DVec3::NEG_Y, DVec3::X, DVec3::new(0.0, 0.6, 0.8)] {
                            let importance = emitter.importance(p, n);
                            assert!(importance.is_finite() && importance >= 0.0);
                            let Some(seen) = emitter.seen_from(p) else { continue };
                            for u in [Vec2::ZERO, Vec2::new(0.3, 0.9), Vec2::splat(1.0 - f32::EPSILON / 2.0)]
                            {
                                let Some((direction, distance)) = seen.sample(u.as_dvec2()) else { continue };
                                let pdf = seen.pdf(distance);
                                assert!((direction.length() - 1.0).abs() < 1e-6, "{corners:?} {p} {u}");
                                assert!(distance > 0.0 && distance.is_finite() && pdf > 0.0);
                                let weight = direction.dot(n).max(0.0) / pdf;
                                assert!(weight.is_finite() && (weight < 1e-6 || importance > 0.0));
                                lit += usize::from(weight > 0.0);
                            }
                        }
                    }
                }
            }
        }
    }
    assert!(lit > 500, "{lit}");
}

#[test]
fn triangles_without_area_or_light_are_no_emitters() {
    let line = emitter([Vec3::ZERO, Vec3::X, Vec3::X * 2.0]);
    let point = emitter([Vec3::ONE; 3]);
    let dark = Emitter { radiance: Rgb::ZERO, ..emitter([Vec3::ZERO, Vec3::X, Vec3::Z]) };
    assert!(!line.is_usable() && !point.is_usable() && !dark.is_usable());
    assert!(emitter([Vec3::ZERO, Vec3::X, Vec3::new(0.5, 0.0, 1e-6)]).is_usable());
}

#[test]
fn a_groups_emitters_are_found() {
    let material = |emission: Option<(Vec3, u32)>, alpha_cutoff| crate::geometry::Material {
        albedo: Vec3::splat(0.5),
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff,
        two_sided: false,
        emission: emission.map(|(radiance, group)| Emission { radiance, group, map: None }),
    };
    let geometry = Geometry {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Z],
        triangles: vec![[0, 1, 2], [0, 2, 1], [0, 1, 1], [0, 1, 2], [0, 1, 2], [2, 1, 0]],
        material_of: vec![0, 1, 1, 2, 3, 1],
        materials: vec![
            material(None, None),
            material(Some((Vec3::ONE, 1)), None),
            material(Some((Vec3::ONE, 0)), None),
            material(Some((Vec3::ONE, 1)), Some(0.5)),
        ],
        ..Geometry::default()
    };
    let triangles = |group| emitters(&geometry, group).iter().map(|e| e.triangle).collect::<Vec<_>>();
    assert_eq!(triangles(0), [3]);
    assert_eq!(triangles(1), [1, 5]);
    assert!(triangles(2).is_empty());
    assert_eq!(emitters(&geometry, 1)[0].corners, [Vec3::ZERO, Vec3::Z, Vec3::X]);
}
