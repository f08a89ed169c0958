//! Tests of the ray tracer: against brute force, against closed forms, tier against tier.

use super::*;
use crate::geometry::Material;
use crate::trace::paths::{Sequence, SequenceKind};
use crate::trace::rays::bvh8::Tier;
use crate::trace::rays::triangle::Shear;
use glam::{Vec2, vec3};

fn finish(mut g: Geometry) -> Geometry {
    g.normals = vec![Vec3::Y; g.positions.len()];
    g.material_of = vec![0; g.triangles.len()];
    g.materials = vec![Material {
        albedo: Vec3::splat(0.5),
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: true,
        emission: None,
    }];
    g
}

/// A closed sphere of `4 · rings²` faces (those at the poles without area).
fn sphere(rings: usize, centre: Vec3) -> Geometry {
    let mut g = Geometry::default();
    let columns = 2 * rings;
    for i in 0..=rings {
        let theta = std::f32::consts::PI * i as f32 / rings as f32;
        // (The sine of the single-precision π is not zero: the poles are points.)
        let sin = if i == rings { 0.0 } else { theta.sin() };
        for j in 0..columns {
            let phi = std::f32::consts::TAU * j as f32 / columns as f32;
            g.positions.push(centre + vec3(sin * phi.cos(), theta.cos(), sin * phi.sin()));
        }
    }
    let at = |i: usize, j: usize| (i * columns + j % columns) as u32;
    for i in 0..rings {
        for j in 0..columns {
            g.triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            g.triangles.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    finish(g)
}

fn wall(half_width: f32) -> Geometry {
    let mut g = Geometry::default();
    let corners = [(-half_width, -1.0), (half_width, -1.0), (half_width, 3.0), (-half_width, 3.0)];
    g.positions = corners.map(|(x, y)| vec3(x, y, -2.0)).to_vec();
    g.triangles = vec![[0, 1, 2], [0, 2, 3]];
    finish(g)
}

/// Triangles of many sizes and shapes, duplicates among them, and if asked for slivers and points.
fn soup(n: u32, has_slivers: bool) -> Geometry {
    let mut g = Geometry::default();
    let sequence = Sequence::new(3, SequenceKind::Texel, 0, 0);
    for i in 0..n {
        let s = sequence.sample(i);
        let point = |k: u32| vec3(s.number(3 * k), s.number(3 * k + 1), s.number(3 * k + 2)) - 0.5;
        let size = 0.4 * (-8.0 * s.number(40)).exp2();
        let a = point(0) * 4.0;
        let b = a + point(1) * size * 4.0;
        let c = match i % 8 {
            0 if has_slivers => a.lerp(b, 0.3) + point(2) * size * 1e-6,
            1 if has_slivers => a.lerp(b, 0.5),
            _ => a + point(2) * size * 4.0,
        };
        let first = g.positions.len() as u32;
        g.positions.extend([a, b, c]);
        g.triangles.push([first, first + 1, first + 2]);
        if i % 16 == 5 {
            g.triangles.push([first + 1, first + 2, first]);
        }
    }
    finish(g)
}

/// Origin and unit direction of ray number `i` through about the middle of a scene of radius 2.
fn random_ray(i: u32) -> (Vec3, Vec3) {
    let s = Sequence::new(9, SequenceKind::Texel, 0, 0).sample(i);
    let point = |k: u32| vec3(s.number(3 * k), s.number(3 * k + 1), s.number(3 * k + 2)) - 0.5;
    let (origin, target) = (point(0) * 6.0, point(1) * 3.0);
    let mut direction = (target - origin).normalize();
    // Every eighth along an axis plane, every sixty-fourth along an axis.
    if i.is_multiple_of(8) {
        direction[i as usize / 8 % 3] = 0.0;
        if i.is_multiple_of(64) {
            direction[(i as usize / 8 + 1) % 3] = -0.0;
        }
        direction = direction.normalize();
    }
    (origin, direction)
}

/// Rays aimed at places of a closed mesh from inside, and those of them that either query let pass.
#[derive(Debug, Default, PartialEq)]
struct Leaks {
    at_edges: usize,
    at_vertices: usize,
    past_edges: usize,
    past_vertices: usize,
}

/// Aims at vertices and edges of a closed mesh around `centre`.
fn leaks(g: &Geometry, rays: &RayTracer, centre: Vec3, at_most: usize) -> Leaks {
    let mut found = Leaks::default();
    let sequence = Sequence::new(1, SequenceKind::Texel, 0, 0);
    let kinds = 6;
    let step = (g.triangles.len() * kinds).div_ceil(at_most).max(1);
    for (i, t) in g.triangles.iter().enumerate() {
        let c = t.map(|v| g.positions[v as usize]);
        for k in (0..kinds).filter(|k| (i * kinds + k) % step == 0) {
            let u = sequence.sample(i as u32).pair(k as u32);
            let target = match k {
                0 => c[0],
                1 => (c[0] + c[1]) * 0.5,
                2 => (c[1] + c[2]) * 0.5,
                _ => c[0].lerp(c[2], u.x),
            };
            let origin = centre + (vec3(u.y, u.x, 1.0 - u.y) - 0.5) * 0.6;
            let direction = (target - origin).normalize_or(Vec3::X);
            let missed = usize::from(
                rays.nearest(origin, direction, u32::MAX).is_none()
                    || !rays.occluded(origin, direction, f32::INFINITY, u32::MAX),
            );
            if c.contains(&target) {
                found.at_vertices += 1;
                found.past_vertices += missed;
            } else {
                found.at_edges += 1;
                found.past_edges += missed;
            }
        }
    }
    found
}

/// No ray may pass an edge, and none a vertex but with Embree: of those, one in fifty may.
///
/// Embree's robust mode takes the sign of single-precision edge functions
/// (kernels/geometry/triangle_intersector_pluecker.h) with a slack of 2⁻²³ of the triangle's area, less than
/// their rounding where triangles are small for their distance. Both triangles at an edge see the same
/// number, so edges are closed. Round a vertex the signs may be such that every triangle refuses the ray:
/// 2352 of 188,341 rays at the vertices of the fine sphere, and the formula redone in Rust refuses the same
/// ones. Neither filter nor near end matters: as many pass without the one and with the other below zero.
/// (Embree's issues 181, 188 and 381 say the same of vertices.)
#[track_caller]
fn expect_closed(backend: Backend, found: &Leaks) {
    let past_vertices = if backend == Backend::Embree { found.at_vertices / 50 } else { 0 };
    assert!(found.past_edges == 0 && found.past_vertices <= past_vertices, "{backend}: {found:?}");
}

#[test]
fn no_ray_leaves_a_closed_sphere_through_its_edges() {
    for centre in [Vec3::ZERO, vec3(37.0, -12.0, 91.0)] {
        let g = sphere(48, centre);
        for backend in Backend::built() {
            let rays = RayTracer::with_backend(&g, backend).expect("a built backend starts");
            let found = leaks(&g, &rays, centre, 60_000);
            assert!(found.at_edges + found.at_vertices > 50_000, "{found:?}");
            expect_closed(backend, &found);
        }
    }
}

#[test]
fn no_ray_leaves_a_finely_tessellated_sphere() {
    // 192k triangles, 577k rays; fewer where the code is not optimised.
    let centre = vec3(0.0, 3.0, 0.0);
    let g = sphere(219, centre);
    let at_most = if cfg!(debug_assertions) { 50_000 } else { 600_000 };
    assert!(g.triangles.len() > 190_000);
    for backend in Backend::built() {
        let rays = RayTracer::with_backend(&g, backend).expect("a built backend starts");
        let found = leaks(&g, &rays, centre, at_most);
        println!("{backend}: {found:?}");
        expect_closed(backend, &found);
    }
}

/// The nearest of all triangles; of equally near ones the first.
fn brute(g: &Geometry, origin: Vec3, direction: Vec3, from: u32) -> Option<(u32, f32)> {
    let shear = Shear::new(origin, direction);
    let mut best: Option<(u32, f64)> = None;
    for t in (0..g.triangles.len() as u32).filter(|&t| t != from) {
        let t_max = best.map_or(f64::INFINITY, |(_, t)| t);
        if let Some(m) = shear.intersect(&g.corners(t as usize), t_max) {
            best = Some((t, m.t));
        }
    }
    best.map(|(triangle, t)| (triangle, t as f32))
}

#[test]
fn every_tier_finds_exactly_what_brute_force_finds() {
    let scenes = [soup(1500, true), sphere(12, vec3(1.0, 0.0, 0.0)), finish(Geometry::default())];
    for (scene, g) in scenes.iter().enumerate() {
        let bvh = Bvh8::new(g);
        let mut hits = 0;
        for tier in Tier::ALL {
            let rays = RayTracer::with_hierarchy(g, bvh.clone().with_tier(tier));
            for i in 0..3000 {
                let (origin, direction) = random_ray(i);
                let first = brute(g, origin, direction, u32::MAX);
                // Half of the rays may not hit what they would hit first.
                let from = if i % 2 == 0 { u32::MAX } else { first.map_or(7, |(t, _)| t) };
                let expected = brute(g, origin, direction, from);
                let found = rays.nearest(origin, direction, from).map(|h| (h.triangle, h.t));
                assert_eq!(expected, found, "{tier:?} scene {scene} ray {i}");
                let t_max = if i % 3 == 0 { 1.5 } else { f32::INFINITY };
                let stops = expected.is_some_and(|(_, t)| t < t_max);
                assert_eq!(stops, rays.occluded(origin, direction, t_max, from), "{tier:?} {scene} {i}");
                hits += usize::from(found.is_some());
            }
        }
        assert!(hits > 1000 || g.triangles.is_empty());
    }
}

#[test]
fn long_walls_are_seen_where_they_stand() {
    // 4 m high, up to 40 km long, seen from 2 m. In doubles the plane's crossing is known to 10⁻¹² m, so the
    // bound is zero: every ray must agree. (The test in single precision is wrong for 1.4 % of them at 40
    // km.)
    for half_width in [2e2, 2e3, 2e4] {
        let g = wall(half_width);
        let rays = RayTracer::new(&g);
        let sequence = Sequence::new(5, SequenceKind::Texel, 0, 0);
        let (n, mut inside) = (20_000, 0);
        for i in 0..n {
            // Directions towards the wall, most of them grazing along it.
            let u = sequence.sample(i).pair(0);
            let x = half_width * (u.x * 2.2 - 1.1);
            let direction = vec3(x, u.y * 6.0 - 2.0, -2.0).normalize();
            let t = -2.0 / f64::from(direction.z);
            let (x, y) = (t * f64::from(direction.x), t * f64::from(direction.y));
            let truth = y > -1.0 && y < 3.0 && x.abs() < f64::from(half_width);
            let hit = rays.nearest(Vec3::ZERO, direction, u32::MAX);
            assert_eq!(truth, hit.is_some(), "{half_width} m: {direction} meets the plane at {x}, {y}");
            assert_eq!(truth, rays.occluded(Vec3::ZERO, direction, f32::INFINITY, u32::MAX));
            inside += u32::from(truth);
            if let Some(hit) = hit {
                assert!((f64::from(hit.t) - t).abs() <= t * f64::from(f32::EPSILON));
            }
        }
        assert!(inside > n / 2 && inside < n * 3 / 4);
    }
}

#[test]
fn edges_on_the_coordinate_planes_do_not_leak() {
    // A floor of square tiles with edges at whole numbers; rays straight down and in axis planes, onto edges
    // and corners.
    let mut g = Geometry::default();
    let n = 9u32;
    g.positions = (0..n * n).map(|i| vec3((i % n) as f32 - 4.0, 0.0, (i / n) as f32 - 4.0)).collect();
    for i in (0..n * (n - 1)).filter(|i| i % n != n - 1) {
        g.triangles.extend([[i, i + n, i + 1], [i + 1, i + n, i + n + 1]]);
    }
    let g = finish(g);
    for tier in Tier::ALL {
        let rays = RayTracer::with_hierarchy(&g, Bvh8::new(&g).with_tier(tier));
        for i in 0..49 {
            let point = vec3((i % 7) as f32 - 3.0, 0.0, (i / 7) as f32 - 3.0);
            for offset in [Vec3::Y, vec3(0.0, 1.0, 2.5), vec3(-0.25, 2.0, 0.0), vec3(1.0, 1e-3, 0.0)] {
                let hit = rays.nearest(point + offset, -offset.normalize(), u32::MAX);
                let distance = hit.map(|h| h.t).unwrap_or_default();
                assert!((distance - offset.length()).abs() < 1e-5, "{tier:?} {point} from {offset}");
            }
        }
    }
}

#[test]
fn copies_and_empty_triangles_are_harmless() {
    // Fifty thousand copies of one triangle, as many coplanar ones and points: built in time, the first copy
    // found.
    let mut g = Geometry {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0)],
        triangles: [[0, 0, 1], [0, 1, 3], [2, 2, 2]].repeat(10_000),
        ..Geometry::default()
    };
    g.triangles.extend([[0, 1, 2]; 50_000]);
    g.triangles.extend([[0, 3, 4]; 20_000]);
    let g = finish(g);
    let rays = RayTracer::new(&g);
    let hit = rays.nearest(vec3(0.2, 0.2, 1.0), Vec3::NEG_Z, u32::MAX).unwrap();
    assert_eq!((hit.triangle, hit.t), (30_000, 1.0));
    let hit = rays.nearest(vec3(0.9, 0.9, -1.0), Vec3::Z, 80_000).unwrap();
    assert_eq!((hit.triangle, hit.t), (80_001, 1.0));
    assert!(rays.nearest(vec3(3.0, 0.0, 1.0), Vec3::NEG_Z, u32::MAX).is_none());
}

#[test]
fn a_ray_that_is_no_ray_hits_nothing() {
    let g = sphere(6, Vec3::ZERO);
    for backend in Backend::built() {
        let rays = RayTracer::with_backend(&g, backend).expect("a built backend starts");
        for (origin, direction) in [
            (Vec3::ZERO, Vec3::ZERO),
            (Vec3::NAN, Vec3::X),
            (Vec3::ZERO, Vec3::NAN),
            (Vec3::INFINITY, Vec3::X),
        ] {
            assert!(rays.nearest(origin, direction, u32::MAX).is_none(), "{backend} {origin} {direction}");
            assert!(
                !rays.occluded(origin, direction, f32::INFINITY, u32::MAX),
                "{backend} {origin} {direction}"
            );
        }
    }
}

#[test]
fn offset_points_do_not_meet_their_own_plane() {
    // From a point on one tile of a wall, along the wall's normal and grazing, nothing of the wall stands in
    // the way.
    let g = wall(50.0);
    for backend in Backend::built() {
        let rays = RayTracer::with_backend(&g, backend).expect("a built backend starts");
        for i in 0..2000 {
            let u: Vec2 = Sequence::new(2, SequenceKind::Texel, 0, 0).sample(i).pair(0);
            let b = vec3(1.0 - u.x.max(u.y), (u.x - u.y).abs(), u.x.min(u.y));
            let origin = offset_point(&g.corners(0), b, Vec3::Z);
            let direction = vec3(u.y - 0.5, u.x - 0.5, 1e-3).normalize();
            assert!(!rays.occluded(origin, direction, f32::INFINITY, 0), "{backend} {origin} {direction}");
        }
    }
}

#[cfg(feature = "embree")]
mod embree {
    use super::*;

    #[test]
    fn both_backends_see_the_same() {
        let g = soup(20_000, false);
        let own = RayTracer::new(&g);
        let embree = RayTracer::with_backend(&g, Backend::Embree).unwrap();
        let (n, mut hits, mut apart, mut shadows_apart) = (200_000, 0, 0, 0);
        for i in 0..n {
            let (origin, direction) = random_ray(i);
            let from = own.nearest(origin, direction, u32::MAX).map_or(u32::MAX, |h| h.triangle);
            let from = if i % 2 == 0 { from } else { u32::MAX };
            let distance = |rays: &RayTracer| rays.nearest(origin, direction, from).map_or(1e9, |h| h.t);
            let (a, b) = (distance(&own), distance(&embree));
            hits += u32::from(a < 1e9);
            // (Embree's distances carry rounding of the corners' distance, some 10⁻⁶ m here.)
            apart += u32::from((a - b).abs() > 1e-5 * (a + 1.0));
            let stops = |rays: &RayTracer| rays.occluded(origin, direction, 1.5, from);
            shadows_apart += u32::from(stops(&own) != stops(&embree));
        }
        // They may differ where a ray passes an edge within single precision's rounding (10⁻⁷ of the
        // distance; the scene has some 10 m of edges in view of a ray): at most one ray in ten thousand.
        println!("{hits} hits of {n}, {apart} and {shadows_apart} apart");
        assert!(
            hits > n / 2 && apart <= n / 10_000 && shadows_apart <= n / 10_000,
            "{apart} {shadows_apart}"
        );
    }
}

#[cfg(not(feature = "embree"))]
#[test]
fn embree_without_the_feature_says_how_to_get_it() {
    let g = sphere(3, Vec3::ZERO);
    let error = RayTracer::with_backend(&g, Backend::Embree).err().expect("not built").to_string();
    assert!(error.contains("--features embree") && error.contains("fetch-embree"), "{error}");
}
