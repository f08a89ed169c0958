//! The promises of `build`, checked by rasterising its result afresh.

use super::footprint::BLOCK;
use super::raster::Bits;
use super::{Atlas, build};
use crate::Error;
use crate::geometry::{Geometry, Instance};
use crate::scene::{Lightmap, LightmapSize};
use glam::{DAffine3, DVec2, DVec3, Vec2, Vec3};

mod instances;
mod keep;
mod pages;

/// Deterministic noise in [0, 1).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Adds an instance of separate triangles, with flat normals.
fn add(geometry: &mut Geometry, triangles: &[[DVec3; 3]]) {
    let (first_triangle, first_vertex) = (geometry.triangles.len(), geometry.positions.len());
    for t in triangles {
        let base = geometry.positions.len() as u32;
        let normal = (t[1] - t[0]).cross(t[2] - t[0]).normalize_or(DVec3::Y).as_vec3();
        for corner in t {
            geometry.positions.push(corner.as_vec3());
            geometry.normals.push(normal);
            geometry.uvs.push(Vec2::ZERO);
            geometry.lightmap_uvs.push(Vec2::ZERO);
        }
        geometry.triangles.push([base, base + 1, base + 2]);
        geometry.material_of.push(0);
    }
    geometry.instances.push(Instance {
        name: format!("test {}", geometry.instances.len()),
        mesh: geometry.instances.len() as u32,
        world_from_mesh: DAffine3::IDENTITY,
        triangles: first_triangle..geometry.triangles.len(),
        vertices: first_vertex..geometry.positions.len(),
        lightmap: true,
        has_lightmap_uvs: false,
        lightmap_place: Default::default(),
        density: 1.0,
    });
}

fn quad(a: DVec3, u: DVec3, v: DVec3) -> [[DVec3; 3]; 2] {
    [[a, a + u, a + u + v], [a, a + u + v, a + v]]
}

fn cuboid(low: DVec3, size: DVec3) -> Vec<[DVec3; 3]> {
    let (x, y, z) = (DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z);
    let sides = [(low, y, x), (low + z, x, y), (low, z, y), (low + x, y, z), (low, x, z), (low + y, z, x)];
    sides.iter().flat_map(|&(a, u, v)| quad(a, u, v)).collect()
}

/// A grid of quads over the unit square.
fn grid(nu: usize, nv: usize, surface: impl Fn(f64, f64) -> DVec3) -> Vec<[DVec3; 3]> {
    let at = |i: usize, j: usize| surface(i as f64 / nu as f64, j as f64 / nv as f64);
    let cells = (0..nu).flat_map(|i| (0..nv).map(move |j| (i, j)));
    cells
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

fn boxes(count: usize, scale: f64) -> Geometry {
    let mut geometry = Geometry::default();
    let mut noise = Noise(7);
    for _ in 0..count {
        let (low, size) = (noise.point() * 20.0 - 10.0, noise.point() * 2.0 + 0.05);
        let triangles = cuboid(low * scale, size * scale);
        add(&mut geometry, &triangles);
    }
    geometry
}

fn fixed(width: u32, height: u32) -> Lightmap {
    Lightmap { size: LightmapSize::Fixed { width, height }, pages: 1, padding: 2, ..Lightmap::default() }
}

/// Checks every promise by drawing the faces again at sub-texel accuracy, and returns the fraction of texels
/// touched.
fn check(geometry: &Geometry, atlas: &Atlas, padding: i64) -> f64 {
    let (width, height) = (atlas.width as usize, atlas.height as usize);
    // Each lightmapped triangle once, ascending.
    assert!(atlas.faces.is_sorted_by(|a, b| a.triangle < b.triangle));
    let wanted: usize = geometry.instances.iter().filter(|i| i.lightmap).map(|i| i.triangles.len()).sum();
    assert_eq!(atlas.faces.len() + atlas.degenerate, wanted);
    // Inside its page by half a texel.
    assert_eq!(atlas.height, (atlas.pages - 1) * atlas.stride + atlas.page_height);
    for face in &atlas.faces {
        let rows = atlas.page_rows(atlas.page_of(face));
        let low = DVec2::new(0.0, rows.start.into()) + 0.49;
        let high = DVec2::new(width as f64, rows.end.into()) - 0.49;
        assert!(face.corners.iter().all(|c| c.as_dvec2().cmpge(low).all()), "{face:?}");
        assert!(face.corners.iter().all(|c| c.as_dvec2().cmple(high).all()), "{face:?}");
        assert!(face.chart < atlas.charts);
    }
    // Shared layouts start on blocks.
    for placement in atlas.placements.iter().flatten() {
        assert!(placement.page < atlas.pages);
        let blocks =
            Vec2::from(placement.offset) * Vec2::new(width as f32, atlas.page_height as f32) / BLOCK as f32;
        assert!((blocks - blocks.round()).abs().max_element() < 1e-3, "a layout starts at {placement:?}");
    }
    // No overlap: at four samples per texel and axis, faces of one chart do not cover the same sample.
    let mut fine = Bits::new(4 * width, 4 * height);
    for face in &atlas.faces {
        assert!(!fine.cover(face.corners.map(|c| c.as_dvec2() * 4.0)), "{face:?} overlaps another");
    }
    // No texel is read for two charts by a filter of `padding` texels: by the exact test (separating axes) of
    // a triangle and the square in which the filter reads a texel, unlike the band clipping of the packer.
    let half = 0.5 * padding as f64;
    let mut owner = vec![u32::MAX; width * height];
    let mut touched = vec![false; width * height];
    for face in &atlas.faces {
        let t = face.corners.map(|c| c.as_dvec2());
        let (low, high) = super::raster::bounds(t);
        let range = |low: f64, high: f64, n: usize| {
            (low - half).max(0.0) as usize..((high + half).ceil() as usize + 1).min(n)
        };
        for y in range(low.y, high.y, height) {
            for x in range(low.x, high.x, width) {
                let at = DVec2::new(x as f64, y as f64);
                touched[y * width + x] |= touches(t, at, 1.0);
                if touches(t, at + 0.5 - half, 2.0 * half) {
                    let texel = &mut owner[y * width + x];
                    assert!(
                        *texel == u32::MAX || *texel == face.chart,
                        "texel ({x}, {y}) is read for two charts"
                    );
                    *texel = face.chart;
                }
            }
        }
    }
    // Nor does a block hold texels of two that bilinear filtering reads, except thin ones and those of
    // layouts, which may be scaled.
    let bilinear = padding == 2;
    let scaled = |chart: u32| {
        let face = atlas.faces.iter().find(|face| face.chart == chart).unwrap();
        let instance = geometry.instances.partition_point(|i| i.triangles.end <= face.triangle as usize);
        atlas.placements[instance][0].layout.is_some()
    };
    let thin = |chart: u32| {
        let faces = atlas
            .faces
            .iter()
            .filter(|face| face.chart == chart)
            .map(|face| face.corners.map(|c| c.as_dvec2()));
        let (low, high) =
            faces.map(super::raster::bounds).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap();
        (high - low).min_element() < 1.0
    };
    for (y, x) in (0..height).step_by(BLOCK).flat_map(|y| (0..width).step_by(BLOCK).map(move |x| (y, x))) {
        let texels = (0..BLOCK * BLOCK).map(|i| (x + i % BLOCK, y + i / BLOCK));
        let mut owners: Vec<u32> = texels
            .filter(|&(x, y)| x < width && y < height)
            .map(|(x, y)| owner[y * width + x])
            .filter(|&owner| owner != u32::MAX)
            .collect();
        owners.dedup();
        let alone = owners.iter().all(|&o| o == owners[0]);
        assert!(
            !bilinear || alone || owners.iter().all(|&o| thin(o) || scaled(o)),
            "block ({x}, {y}) of charts {owners:?}"
        );
    }
    // Every chart has a texel.
    let mut seen = vec![false; atlas.charts as usize];
    owner.iter().filter(|&&o| o != u32::MAX).for_each(|&o| seen[o as usize] = true);
    assert!(seen.iter().all(|&s| s));
    touched.iter().filter(|&&touched| touched).count() as f64
        / f64::from(width as u32 * atlas.page_height * atlas.pages)
}

/// Separating axes of a triangle and the square of this side at `low`.
fn touches(t: [DVec2; 3], low: DVec2, side: f64) -> bool {
    let square = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|corner| low + side * corner);
    let mut axes = vec![DVec2::X, DVec2::Y];
    axes.extend((0..3).map(|i| (t[(i + 1) % 3] - t[i]).perp()));
    axes.iter().all(|axis| {
        let interval = |points: &[DVec2]| {
            points
                .iter()
                .map(|p| axis.dot(*p))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| (a.min(d), b.max(d)))
        };
        let (a, b) = (interval(&t), interval(&square));
        a.0 < b.1 && b.0 < a.1
    })
}

/// Largest and smallest ratio of a face's length on the page to its length in space, over all edges, ÷
/// density.
fn stretch(geometry: &Geometry, atlas: &Atlas) -> (f64, f64) {
    let mut range = (f64::INFINITY, 0.0f64);
    for face in &atlas.faces {
        let world =
            geometry.triangles[face.triangle as usize].map(|v| geometry.positions[v as usize].as_dvec3());
        for i in 0..3 {
            let j = (i + 1) % 3;
            let flat = face.corners[i].as_dvec2().distance(face.corners[j].as_dvec2());
            let ratio = flat / world[i].distance(world[j]) / atlas.texels_per_metre;
            range = (range.0.min(ratio), range.1.max(ratio));
        }
    }
    range
}

#[test]
fn cube() {
    let mut geometry = Geometry::default();
    add(&mut geometry, &cuboid(DVec3::ZERO, DVec3::ONE));
    let atlas = build(&geometry, &fixed(64, 64)).unwrap();
    assert_eq!(atlas.faces.len(), 12);
    assert!(atlas.charts <= 6, "{} charts", atlas.charts);
    assert!(check(&geometry, &atlas, 2) > 0.45);
    let (low, high) = stretch(&geometry, &atlas);
    assert!(low > 0.999 && high < 1.001, "{low} … {high}");
    // Edges of the cube lie along the axes.
    let face = &atlas.faces[0];
    let along = |i: usize, j: usize| (face.corners[i] - face.corners[j]).abs().min_element() < 1e-3;
    assert_eq!([along(0, 1), along(1, 2), along(2, 0)].iter().filter(|&&a| a).count(), 2);
}

#[test]
fn random_boxes_fill_the_page_at_any_scale() {
    let mut densities = Vec::new();
    for scale in [1.0, 1e-4, 1e4] {
        let geometry = boxes(500, scale);
        let atlas = build(&geometry, &fixed(512, 512)).unwrap();
        let touched = check(&geometry, &atlas, 2);
        assert!((touched - atlas.utilisation).abs() < 0.02, "{touched} against {}", atlas.utilisation);
        assert!(touched > 0.38, "{touched}");
        densities.push(atlas.texels_per_metre * scale);
    }
    assert!(densities.iter().all(|d| (d / densities[0] - 1.0).abs() < 0.03), "{densities:?}");
}

#[test]
fn curved_surfaces_keep_their_shape() {
    let mut geometry = Geometry::default();
    add(
        &mut geometry,
        &grid(48, 48, |u, v| DVec3::new(u * 20.0, (u * 9.0).sin() * (v * 7.0).cos(), v * 20.0)),
    );
    let turn = |u: f64, v: f64| {
        let (s, c) = (u * std::f64::consts::TAU).sin_cos();
        DVec3::new(c, 8.0 * v, s)
    };
    add(&mut geometry, &grid(24, 10, turn));
    let atlas = build(&geometry, &fixed(256, 256)).unwrap();
    check(&geometry, &atlas, 2);
    assert!(atlas.charts < 40, "{} charts", atlas.charts);
    let (low, high) = stretch(&geometry, &atlas);
    assert!(low > 0.5 && high < 2.0, "{low} … {high}");
}

#[test]
fn any_page_shape_and_padding() {
    let geometry = boxes(20, 1.0);
    for (width, height, padding) in [(129, 200, 2), (200, 129, 3), (512, 64, 5), (61, 300, 2)] {
        let size = LightmapSize::Fixed { width, height };
        let atlas = build(&geometry, &Lightmap { size, pages: 1, padding, ..Lightmap::default() }).unwrap();
        assert_eq!((atlas.width, atlas.height), (width, height));
        check(&geometry, &atlas, padding.into());
    }
    // Less than 2 texels of padding would let bilinear taps mix charts.
    let size = LightmapSize::Fixed { width: 128, height: 128 };
    check(
        &geometry,
        &build(&geometry, &Lightmap { size, pages: 1, padding: 0, ..Lightmap::default() }).unwrap(),
        2,
    );
}

#[test]
fn slivers_and_degenerate_triangles() {
    let mut geometry = Geometry::default();
    let o = DVec3::new(1.0, 2.0, 3.0);
    add(
        &mut geometry,
        &[
            [o, o + DVec3::X, o + DVec3::Y],
            [o, o, o + DVec3::X],
            [o, o + DVec3::X, o + DVec3::X * 2.0],
            [o, o, o],
            [o, o + DVec3::X * 10.0, o + DVec3::new(5.0, 1e-4, 0.0)],
            [o, o + DVec3::Z * 1e-3, o + DVec3::Y * 1e-3],
        ],
    );
    let atlas = build(&geometry, &fixed(64, 64)).unwrap();
    assert_eq!(atlas.degenerate, 3);
    assert_eq!(atlas.faces.iter().map(|f| f.triangle).collect::<Vec<_>>(), [0, 4, 5]);
    check(&geometry, &atlas, 2);
}

#[test]
fn occluders_are_left_out_and_density_scales() {
    let mut geometry = Geometry::default();
    for i in 0..3 {
        add(&mut geometry, &quad(DVec3::Y * f64::from(i), DVec3::X, DVec3::Z));
    }
    geometry.instances[0].lightmap = false;
    geometry.instances[2].density = 3.0;
    let atlas = build(&geometry, &fixed(128, 128)).unwrap();
    assert_eq!(atlas.faces.iter().map(|f| f.triangle).collect::<Vec<_>>(), [2, 3, 4, 5]);
    check(&geometry, &atlas, 2);
    let length = |i: usize| f64::from(atlas.faces[i].corners[0].distance(atlas.faces[i].corners[2]));
    assert!((length(2) / length(0) - 3.0).abs() < 1e-3);
    assert!((length(0) / (2.0f64.sqrt() * atlas.texels_per_metre) - 1.0).abs() < 1e-3);
}

#[test]
fn a_density_gets_the_page_it_needs() {
    for (metres, texels_per_metre) in [(10.0, 8.0), (1e-3, 1e5), (1e5, 1e-3)] {
        let mut geometry = Geometry::default();
        add(&mut geometry, &cuboid(DVec3::splat(-0.5 * metres), DVec3::new(metres, metres, 4.0 * metres)));
        let size = LightmapSize::TexelsPerMetre(texels_per_metre);
        let atlas =
            build(&geometry, &Lightmap { size, pages: 1, padding: 4, ..Lightmap::default() }).unwrap();
        assert_eq!((atlas.width % 4, atlas.height % 4), (0, 0));
        assert_eq!(atlas.texels_per_metre, texels_per_metre);
        check(&geometry, &atlas, 4);
        let (low, high) = stretch(&geometry, &atlas);
        assert!(low > 0.99 && high < 1.01, "{low} … {high}");
        assert!(atlas.utilisation > 0.5, "{}", atlas.utilisation);
    }
}

#[test]
fn what_cannot_fit_is_an_error() {
    let mut geometry = Geometry::default();
    assert!(matches!(build(&geometry, &fixed(64, 64)), Err(Error::Invalid { .. })));
    add(&mut geometry, &[[DVec3::ZERO, DVec3::X, DVec3::Y]]);
    for (width, height) in [(1, 1), (1, 64), (0, 8), (20000, 8)] {
        assert!(build(&geometry, &fixed(width, height)).is_err(), "{width} x {height}");
    }
    check(&geometry, &build(&geometry, &fixed(3, 3)).unwrap(), 2);
    // A page with fewer blocks than charts still takes them all, with a warning that says which parts cost
    // most.
    let crowded = build(&boxes(500, 1.0), &fixed(32, 32)).unwrap();
    assert_eq!((crowded.faces.len(), crowded.width, crowded.height), (6000, 32, 32));
    assert!(
        crowded.warnings.iter().any(|w| w.contains("lie on each other") && w.contains("test 76 (")),
        "{:?}",
        crowded.warnings
    );
    // The density the message names fits.
    let size =
        |d| Lightmap { size: LightmapSize::TexelsPerMetre(d), pages: 1, padding: 2, ..Lightmap::default() };
    let what = build(&geometry, &size(1e6)).unwrap_err().to_string();
    let named = what.split("about ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(build(&geometry, &size(named)).is_ok(), "{what}");
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(build(&geometry, &size(bad)), Err(Error::Invalid { .. })));
    }
    geometry.positions[1].y = f32::NAN;
    assert!(matches!(build(&geometry, &fixed(64, 64)), Err(Error::Invalid { .. })));
}

/// Two unit quads side by side in space, far apart in the authored layout, the second half as large there.
fn authored() -> Geometry {
    let mut geometry = Geometry::default();
    let mut triangles = quad(DVec3::ZERO, DVec3::X, DVec3::Z).to_vec();
    triangles.extend(quad(DVec3::X, DVec3::X, DVec3::Z));
    add(&mut geometry, &triangles);
    geometry.instances[0].has_lightmap_uvs = true;
    for (i, uv) in geometry.lightmap_uvs.iter_mut().enumerate() {
        let p = Vec2::new(geometry.positions[i].x, geometry.positions[i].z);
        *uv = if i < 6 { p * 0.5 } else { Vec2::splat(0.7) + (p - Vec2::X) * 0.25 };
    }
    geometry
}

#[test]
fn authored_layout_is_used() {
    let geometry = authored();
    let atlas = build(&geometry, &fixed(128, 128)).unwrap();
    check(&geometry, &atlas, 2);
    assert_eq!(atlas.charts, 2);
    assert_eq!(atlas.notes, ["lightmap layouts of the files are used for 1 of 1 instance"]);
    // The layout's proportions hold, and so does the area over the whole instance: 2 m².
    let length = |i: usize| f64::from(atlas.faces[i].corners[0].distance(atlas.faces[i].corners[1]));
    assert!((length(0) / length(2) - 2.0).abs() < 1e-3);
    let metres = (length(0).powi(2) + length(2).powi(2)) / atlas.texels_per_metre.powi(2);
    assert!((metres - 2.0).abs() < 1e-3);
}

#[test]
fn texels_so_wide_that_the_model_may_not_be_in_metres_are_told() {
    let mut geometry = authored();
    assert!(build(&geometry, &fixed(128, 128)).unwrap().warnings.is_empty());
    geometry.positions.iter_mut().for_each(|p| *p *= 1000.0);
    let atlas = build(&geometry, &fixed(128, 128)).unwrap();
    assert!(atlas.warnings.len() == 1 && atlas.warnings[0].contains("m wide"), "{:?}", atlas.warnings);
    // A density that was asked for is meant.
    let density = Lightmap { size: LightmapSize::TexelsPerMetre(0.1), ..fixed(1, 1) };
    assert!(build(&geometry, &density).unwrap().warnings.is_empty());
}

#[test]
fn unusable_authored_layout_is_told_and_replaced() {
    type Spoil = fn(&mut Geometry);
    let breaks: [(Spoil, &str); 10] = [
        (|g| g.lightmap_uvs[0].x = f32::NAN, "not finite"),
        (|g| g.lightmap_uvs[5].y = f32::NEG_INFINITY, "not finite"),
        (|g| g.lightmap_uvs[0] = Vec2::new(1.5, 0.0), "leaves [0, 1]"),
        (|g| g.lightmap_uvs[7].x = -3e38, "leaves [0, 1]"),
        (|g| g.lightmap_uvs.iter_mut().for_each(|uv| *uv += 10.0), "leaves [0, 1]"),
        (|g| g.lightmap_uvs.iter_mut().for_each(|uv| *uv = Vec2::splat(0.5)), "no area"),
        (|g| g.lightmap_uvs.iter_mut().for_each(|uv| uv.y = 0.25), "no area"),
        (|g| g.lightmap_uvs.iter_mut().for_each(|uv| *uv = Vec2::ZERO), "no area"),
        (|g| g.lightmap_uvs[2] = g.lightmap_uvs[0], "no area"),
        (|g| g.lightmap_uvs.iter_mut().skip(6).for_each(|uv| *uv -= 0.5), "overlap"),
    ];
    for (spoil, why) in breaks {
        let mut geometry = authored();
        spoil(&mut geometry);
        let atlas = build(&geometry, &fixed(128, 128)).unwrap();
        let [warning] = &atlas.warnings[..] else { panic!("{:?}", atlas.warnings) };
        assert!(warning.contains(why) && warning.contains("not used, test 0: "), "{warning} / {why}");
        check(&geometry, &atlas, 2);
        let (low, high) = stretch(&geometry, &atlas);
        assert!(low > 0.99 && high < 1.01, "{low} … {high}");
    }
}

#[test]
fn a_tiny_authored_layout_is_as_good_as_a_large_one() {
    let (large, mut geometry) = (authored(), authored());
    for scale in [1e-6f32, 1e-18, 1e-36] {
        for (uv, other) in geometry.lightmap_uvs.iter_mut().zip(&large.lightmap_uvs) {
            *uv = *other * scale;
        }
        let atlas = build(&geometry, &fixed(128, 128)).unwrap();
        check(&geometry, &atlas, 2);
        assert_eq!(atlas.charts, 2, "{:?}", atlas.notes);
        assert!(atlas.notes[0].starts_with("lightmap layouts of the files are used"), "{:?}", atlas.notes);
    }
}

#[test]
fn thread_count_does_not_matter() {
    let geometry = boxes(60, 1.0);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| build(&geometry, &fixed(200, 129)).unwrap())
    };
    let (one, four) = (run(1), run(4));
    assert_eq!(one.texels_per_metre.to_bits(), four.texels_per_metre.to_bits());
    let bits = |a: &Atlas| -> Vec<_> {
        a.faces
            .iter()
            .map(|f| (f.triangle, f.chart, f.corners.map(|c| c.to_array().map(f32::to_bits))))
            .collect()
    };
    assert_eq!(bits(&one), bits(&four));
}

#[test]
fn hostile_meshes_do_not_break_the_build() {
    // Every edge of a fan shared by many triangles, doubled faces, random soup, and a vertex used by all.
    let mut geometry = Geometry::default();
    let mut noise = Noise(3);
    let fan: Vec<_> = (0..30).map(|_| [DVec3::ZERO, DVec3::Y, noise.point() - 0.5]).collect();
    add(&mut geometry, &fan);
    add(&mut geometry, &[fan[0], fan[0], fan[0]]);
    let soup: Vec<_> = (0..200).map(|_| [noise.point(), noise.point(), noise.point()]).collect();
    add(&mut geometry, &soup);
    let tiny: Vec<_> =
        (0..50).map(|_| [noise.point() * 1e3, noise.point() * 1e-3, noise.point() * 1e-3]).collect();
    add(&mut geometry, &tiny);
    geometry.normals.iter_mut().step_by(7).for_each(|n| *n = Vec3::ZERO);
    let atlas = build(&geometry, &fixed(512, 512)).unwrap();
    check(&geometry, &atlas, 2);
}
