//! Bright facets: what is drawn is drawn as the density says.

use super::*;
use crate::atlas::{Atlas, build};
use crate::geometry::{Instance, Material, Texture, Wrap};
use crate::scene::{Lightmap, LightmapSize};
use crate::trace::irradiance::bright_facet_index::BrightFacetIndex;
use crate::trace::irradiance::bright_facets::{MOST_CLUSTERS, number_of, sides};
use crate::trace::paths::{Sequence, SequenceKind};
use crate::trace::rays::RayTracer;

/// A floor of 4 × 4 m that looks up, its texels, and light on it: 1 everywhere, in layer 0 a hundred on a
/// square of 0.5 m.
fn floor() -> (Geometry, Atlas) {
    let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    let positions = vec![corner(-2.0, 2.0), corner(2.0, 2.0), corner(2.0, -2.0), corner(-2.0, -2.0)];
    let instance = Instance {
        name: "floor".to_owned(),
        mesh: 0,
        world_from_mesh: glam::DAffine3::IDENTITY,
        triangles: 0..2,
        vertices: 0..4,
        lightmap: true,
        has_lightmap_uvs: false,
        lightmap_place: Default::default(),
        density: 1.0,
    };
    let material = Material {
        albedo: Rgb::ONE,
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: false,
        emission: None,
    };
    let geometry = Geometry {
        normals: vec![Vec3::Y; 4],
        uvs: vec![Vec2::ZERO; 4],
        lightmap_uvs: vec![Vec2::ZERO; 4],
        positions,
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material_of: vec![0; 2],
        instances: vec![instance],
        materials: vec![material],
        ..Geometry::default()
    };
    let size = LightmapSize::Fixed { width: 64, height: 64 };
    let atlas = build(&geometry, &Lightmap { size, pages: 1, padding: 1, ..Lightmap::default() }).unwrap();
    (geometry, atlas)
}

/// Where a triangle's point lies.
fn place(geometry: &Geometry, triangle: u32, barycentric: Vec3) -> Vec3 {
    let [a, b, c] = geometry.corners(triangle as usize);
    a * barycentric.x + b * barycentric.y + c * barycentric.z
}

fn hit(triangle: u32, barycentric: Vec3) -> Hit {
    Hit { triangle, barycentric, t: 1.0 }
}

/// Calls back with the bright surfaces of the floor.
fn with_bright_surfaces(bright: f32, test: impl FnOnce(&Geometry, Option<BrightSurfaces>)) {
    let (geometry, atlas) = floor();
    let all = 0..(atlas.width * atlas.height) as usize;
    let map = CacheMap::new(&atlas, &geometry, (0, usize::MAX), all);
    // The entries in the square, by points spread over the floor.
    let mut is_bright = vec![false; map.entries()];
    for i in 0..1 << 16 {
        let u = Sequence::new(1, SequenceKind::Texel, 0, 0).sample(i).pair(0);
        let b = if u.x + u.y > 1.0 { Vec2::ONE - u } else { u };
        let b = Vec3::new(1.0 - b.x - b.y, b.x, b.y);
        let p = place(&geometry, i % 2, b);
        if let Some(entry) = map.of_hit(&hit(i % 2, b), false)
            && (p.x - 1.0).abs() < 0.25
            && (p.z - 0.5).abs() < 0.25
        {
            is_bright[entry as usize] = true;
        }
    }
    let half = || {
        let mut half = CacheHalf::new(map.entries(), &[bright.max(1.0), 1.0]);
        half.set_all(|entry, out| {
            out[0] = Rgb::splat(if is_bright[entry as usize] { bright } else { 1.0 });
            out[1] = Rgb::ONE;
        });
        half
    };
    let (sides, part) = (
        sides(&geometry, &map),
        BrightSelection { layers: 0..2, key: 7, most_clusters: MOST_CLUSTERS, room: None },
    );
    test(&geometry, BrightSurfaces::new(&geometry, &map, &[half(), half()], &sides, part));
}

#[test]
fn even_light_has_no_bright_facets() {
    with_bright_surfaces(1.0, |_, bright_surfaces| assert!(bright_surfaces.is_none()));
}

#[test]
fn points_are_drawn_from_the_bright_square_with_the_density_told() {
    with_bright_surfaces(100.0, |geometry, bright_surfaces| {
        let bright_surfaces = bright_surfaces.expect("a bright square");
        // Listed second, after a list of every other facet: both are found, in this order.
        let others: Vec<BrightFacet> = bright_surfaces.facets().iter().copied().step_by(2).collect();
        let index = BrightFacetIndex::new(geometry.triangles.len(), &[&others, bright_surfaces.facets()]);
        let density_at = |view: &BrightSurfaceView, hit: &Hit, is_back: bool| match index.at(hit, is_back) {
            [] => 0.0,
            [held] => {
                assert!(held.list == 1 && held.facet % 2 == 1);
                bright_surfaces.density(view, held.facet as usize)
            }
            [other, held] => {
                assert!((other.list, held.list, 2 * other.facet) == (0, 1, held.facet));
                bright_surfaces.density(view, held.facet as usize)
            }
            more => panic!("{more:?}"),
        };
        let receivers = [(Vec3::new(0.0, 2.0, 0.0), -Vec3::Y)];
        let number = |r: usize, k: usize| {
            Sequence::new(3, SequenceKind::Texel, r as u32, 0).sample(k as u32).number(0)
        };
        let view = bright_surfaces.view_from(&receivers, number, |_, _, _| true).expect("it is seen");
        let sequence = Sequence::new(2, SequenceKind::Texel, 0, 0);
        // The sum of 1 ÷ density over what is drawn is the area it is drawn from.
        let (mut area, n) = (0.0, 1 << 14);
        let mut quarter = [0f64; 4];
        // Points on the edge between two facets may be told to be of the other.
        let mut strayed = 0;
        for i in 0..n {
            let sample = sequence.sample(i);
            let point = bright_surfaces.sample(&view, sample.number(0), sample.pair(0)).expect("always one");
            let told = density_at(&view, &hit(point.triangle, point.barycentric), point.is_back);
            strayed += u32::from((told / point.density - 1.0).abs() > 1e-5);
            let p = place(geometry, point.triangle, point.barycentric);
            assert!(p.distance(point.point) < 1e-5 && point.normal == Vec3::Y && !point.is_back);
            // (Facets are two texels long: they reach out of the square by as much.)
            assert!((p.x - 1.0).abs() < 0.5 && (p.z - 0.5).abs() < 0.5, "{p}");
            area += 1.0 / f64::from(point.density) / f64::from(n);
            quarter[usize::from(p.x > 1.0) + 2 * usize::from(p.z > 0.5)] += 1.0 / f64::from(n);
        }
        assert!((0.2..0.7).contains(&area), "{area}");
        assert!(strayed < n / 1000, "{strayed} of {n}");
        // The same area, found by points spread over the whole floor; and the density sums to 1 over it.
        let (mut bright, mut sum, mut by_quarter) = (0.0, 0.0, [0f64; 4]);
        let of_point = 16.0 / f64::from(4 * n);
        for i in 0..4 * n {
            let u = sequence.sample(i).pair(1);
            let b = if u.x + u.y > 1.0 { Vec2::ONE - u } else { u };
            let b = Vec3::new(1.0 - b.x - b.y, b.x, b.y);
            let density = f64::from(density_at(&view, &hit(i % 2, b), false));
            assert_eq!(density_at(&view, &hit(i % 2, b), true), 0.0);
            let p = place(geometry, i % 2, b);
            bright += if density > 0.0 { of_point } else { 0.0 };
            sum += density * of_point;
            by_quarter[usize::from(p.x > 1.0) + 2 * usize::from(p.z > 0.5)] += density * of_point;
        }
        assert!((sum - 1.0).abs() < 0.02, "{sum}");
        assert!((area / bright - 1.0).abs() < 0.05, "{area} {bright}");
        for (drawn, told) in quarter.iter().zip(by_quarter) {
            assert!((drawn - told).abs() < 0.02, "{quarter:?} {by_quarter:?}");
        }
    });
}

#[test]
fn a_hidden_cluster_is_drawn_rarely_but_drawn() {
    with_bright_surfaces(100.0, |_, bright_surfaces| {
        let bright_surfaces = bright_surfaces.expect("a bright square");
        let receivers = [(Vec3::new(0.0, 2.0, 0.0), -Vec3::Y)];
        let number = |r: usize, k: usize| {
            Sequence::new(3, SequenceKind::Texel, r as u32, 0).sample(k as u32).number(0)
        };
        // A wall at x = 1: only directions that end at less are free.
        let free = |_: usize, direction: Vec3, distance: f32| direction.x * distance < 1.0;
        let view = bright_surfaces.view_from(&receivers, number, free).expect("half of it is seen");
        let n = 1 << 12;
        let behind = (0..n).filter(|&i| {
            let sample = Sequence::new(2, SequenceKind::Texel, 0, 0).sample(i);
            let point = bright_surfaces.sample(&view, sample.number(0), sample.pair(0)).expect("always one");
            point.point.x > 1.05
        });
        let part = behind.count() as f64 / f64::from(n);
        assert!((0.01..0.1).contains(&part), "{part}");
    });
}

#[test]
fn a_receiver_that_faces_away_sees_nothing() {
    with_bright_surfaces(100.0, |_, bright_surfaces| {
        let bright_surfaces = bright_surfaces.expect("a bright square");
        let number = |_: usize, _: usize| 0.5;
        assert!(bright_surfaces.view_from(&[(Vec3::Y, Vec3::Y)], number, |_, _, _| true).is_none());
        assert!(bright_surfaces.view_from(&[(-Vec3::Y, Vec3::Y)], number, |_, _, _| true).is_none());
    });
}

#[test]
fn a_point_of_a_facet_is_found_there() {
    for n in [1u32, 2, 3, 7, 64, 1000] {
        for number in (0..n * n).step_by((n * n / 997).max(1) as usize) {
            for u in [Vec2::new(0.3, 0.3), Vec2::new(0.05, 0.9), Vec2::new(0.9, 0.05)] {
                let barycentric = point_of(n, number, u);
                assert!(barycentric.min_element() >= 0.0 && barycentric.max_element() <= 1.0);
                assert_eq!(number_of(n, barycentric), number, "{n} {u}");
            }
        }
    }
}

#[test]
fn holes_of_a_cut_out_reflect_nothing() {
    with_bright_surfaces(100.0, |geometry, bright_surfaces| {
        let bright_surfaces = bright_surfaces.expect("a bright square");
        // Solid for x < 1, through the middle of the bright square.
        let rgba = (0..64).map(|i| [255, 255, 255, if i < 48 { 255 } else { 0 }]).collect();
        let texture = Texture { width: 64, height: 1, rgba, wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp };
        let mut sheet = geometry.clone();
        sheet.uvs = sheet.positions.iter().map(|p| Vec2::new((p.x + 2.0) / 4.0, 0.5)).collect();
        sheet.textures = vec![texture];
        sheet.materials[0].texture = Some(0);
        sheet.materials[0].alpha_cutoff = Some(0.5);
        let found = |geometry: &Geometry| {
            let rays = RayTracer::new(geometry);
            let space = Space::new(geometry, &rays);
            // Above the floor, looking down.
            let receiver = Receiver {
                origin: Vec3::new(0.0, 2.0, 0.0),
                triangle: u32::MAX,
                face_normal: -Vec3::Y,
                normal: -Vec3::Y,
            };
            let sequence = Sequence::new(2, SequenceKind::Texel, 0, 0);
            let mut counts = RayCounts::default();
            let view =
                bright_surfaces.view(&space, &[(receiver, sequence.sample(0))], &mut counts).expect("seen");
            let mut sides = [0; 2];
            for i in 0..1 << 10 {
                let sample = sequence.sample(i);
                if let Some((hit, is_back, weight)) =
                    bright_surfaces.reflected(&space, &receiver, &view, 1.0, sample, &mut counts)
                {
                    assert!(!is_back && weight.min_element() > 0.0);
                    let x = place(geometry, hit.triangle, hit.barycentric).x;
                    sides[usize::from(x > 1.0)] += 1;
                }
            }
            sides
        };
        let [left, right] = found(geometry);
        assert!(left > 300 && right > 300, "{left} {right}");
        let [left, right] = found(&sheet);
        assert!(left > 300 && right == 0, "{left} {right}");
    });
}
