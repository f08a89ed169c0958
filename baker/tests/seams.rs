//! Seams: which edges are some, and what stitching does to light of which the truth is known.

use baker::atlas::owners::Owners;
use baker::atlas::{self, Atlas, Face};
use baker::bake::finish::{Dilation, Seams};
use baker::geometry::{self, Geometry, Instance};
use baker::scene::{self, Lightmap, LightmapSize};
use baker::surface::{BLOCK, BlockSurface, FaceBins};
use dataset::image::{Image, Mask};
use glam::{DAffine3, DVec2, Vec2, Vec3, vec2, vec3};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// A mesh in world space: corners and their normals, counter-clockwise.
type Mesh = Vec<[(Vec3, Vec3); 3]>;

/// One instance per mesh; vertices are shared where position and normal are.
fn geometry(meshes: &[(Mesh, bool)]) -> Geometry {
    let mut g = Geometry::default();
    for (number, (mesh, lightmap)) in meshes.iter().enumerate() {
        let (first_triangle, first_vertex) = (g.triangles.len(), g.positions.len());
        let mut known: BTreeMap<[u32; 6], u32> = BTreeMap::new();
        for corners in mesh {
            g.triangles.push(corners.map(|(p, n)| {
                let key = [p.x, p.y, p.z, n.x, n.y, n.z].map(f32::to_bits);
                *known.entry(key).or_insert_with(|| {
                    g.positions.push(p);
                    g.normals.push(n.normalize());
                    g.positions.len() as u32 - 1
                })
            }));
        }
        g.uvs.resize(g.positions.len(), Vec2::ZERO);
        g.lightmap_uvs.resize(g.positions.len(), Vec2::ZERO);
        g.material_of.resize(g.triangles.len(), 0);
        g.instances.push(Instance {
            name: format!("mesh {number}"),
            mesh: number as u32,
            world_from_mesh: DAffine3::IDENTITY,
            triangles: first_triangle..g.triangles.len(),
            vertices: first_vertex..g.positions.len(),
            lightmap: *lightmap,
            has_lightmap_uvs: false,
            lightmap_place: Default::default(),
            density: 1.0,
        });
    }
    g
}

/// A flat quadrilateral, counter-clockwise.
fn quad([a, b, c, d]: [Vec3; 4]) -> Mesh {
    let n = (b - a).cross(c - a);
    vec![[(a, n), (b, n), (c, n)], [(a, n), (c, n), (d, n)]]
}

/// Six quadrilaterals with hard edges.
fn cube() -> Mesh {
    let v = |i: usize| vec3((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        .iter()
        .flat_map(|q| quad(q.map(v)))
        .collect()
}

/// A unit sphere of meridians and parallels with smooth normals.
fn sphere(around: usize) -> Mesh {
    let v = |i: usize, j: usize| {
        let (phi, theta) = (
            std::f32::consts::TAU * (i % around) as f32 / around as f32,
            std::f32::consts::PI * j as f32 / (around / 2) as f32,
        );
        let p = if j == 0 {
            Vec3::Y
        } else if j == around / 2 {
            Vec3::NEG_Y
        } else {
            vec3(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos())
        };
        (p, p)
    };
    let mut mesh = Mesh::new();
    for i in 0..around {
        for j in 0..around / 2 {
            if j > 0 {
                mesh.push([v(i, j), v(i + 1, j + 1), v(i + 1, j)]);
            }
            if j + 1 < around / 2 {
                mesh.push([v(i, j), v(i, j + 1), v(i + 1, j + 1)]);
            }
        }
    }
    mesh
}

fn unwrap(g: &Geometry, side: u32) -> Atlas {
    let size = LightmapSize::Fixed { width: side, height: side };
    atlas::build(g, &Lightmap { size, pages: 1, padding: 2, ..Lightmap::default() }).unwrap()
}

/// An atlas of given corners.
fn page(width: u32, height: u32, corners: &[[Vec2; 3]]) -> Atlas {
    let face = |(i, &corners): (usize, &[Vec2; 3])| Face { triangle: i as u32, corners, chart: i as u32 };
    Atlas {
        width,
        height,
        pages: 1,
        page_height: height,
        stride: height,
        texels_per_metre: 1.0,
        faces: corners.iter().enumerate().map(face).collect(),
        charts: corners.len() as u32,
        degenerate: 0,
        skipped: Default::default(),
        utilisation: 1.0,
        notes: Vec::new(),
        warnings: Vec::new(),
        placements: Vec::new(),
        layouts: Vec::new(),
    }
}

/// A repeatable number in [0, 1).
fn random(seed: u32, i: u32) -> f32 {
    let mut x = i.wrapping_mul(0x9e37_79b9) ^ seed.wrapping_mul(0x85eb_ca6b);
    for _ in 0..3 {
        x = (x ^ x >> 16).wrapping_mul(0x45d9_f3b5);
    }
    ((x ^ x >> 16) >> 8) as f32 / (1 << 24) as f32
}

/// A number with mean 0 and deviation 1.
fn normal(seed: u32, i: u32) -> f32 {
    (0..12).map(|k| random(seed + 1000 * k, i)).sum::<f32>() - 6.0
}

/// Every covered texel gets the mean of `light` over 16 points of its surface, its chart at the first of
/// them.
fn bake(g: &Geometry, atlas: &Atlas, light: impl Fn(Vec3, u32, u32) -> [f32; 3]) -> (Image, Mask) {
    let (width, height) = (atlas.width as usize, atlas.height as usize);
    let mut image = Image::black(width, height);
    let mut mask = Mask { width, height, valid: vec![false; width * height] };
    let bins = FaceBins::new(atlas);
    for block in 0..bins.columns * bins.rows {
        let surface = BlockSurface::new(atlas, &bins, block);
        for texel in (0..surface.width * surface.height).filter(|&t| surface.is_covered(t)) {
            let (x, y) = (surface.x0 + texel % surface.width, surface.y0 + texel / surface.width);
            let index = y * width + x;
            mask.valid[index] = true;
            for i in 0..16 {
                let u = vec2((i as f32 + 0.5) / 16.0, (i as f32 * 0.618_034 + 0.3).fract());
                let point = surface.sample(atlas, texel, u);
                let [a, b, c] = g.corners(point.triangle as usize);
                let p = a * point.barycentric.x + b * point.barycentric.y + c * point.barycentric.z;
                let at = atlas.faces.binary_search_by_key(&point.triangle, |f| f.triangle).unwrap();
                let value = light(p, atlas.faces[at].chart, index as u32);
                (0..3).for_each(|c| image.texels[index][c] += value[c] / 16.0);
            }
        }
    }
    assert_eq!(BLOCK, 64);
    (image, mask)
}

/// Mean magnitude and root mean square of the jumps of the red channel over edges that are the same two
/// vertices, read by a bilinear sampler of its own at seven points each, beside the root mean square error
/// against the truth.
fn read(g: &Geometry, atlas: &Atlas, image: &Image, truth: impl Fn(Vec3) -> f32) -> (f64, f64, f64) {
    let sample = |p: DVec2| {
        let (mut sum, q) = (0.0, p - 0.5);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let t = q.floor() + DVec2::new(f64::from(dx), f64::from(dy));
            let weight = (1.0 - (q.x - t.x).abs()) * (1.0 - (q.y - t.y).abs());
            let x = t.x.clamp(0.0, image.width as f64 - 1.0) as usize;
            let y = t.y.clamp(0.0, image.height as f64 - 1.0) as usize;
            sum += weight * f64::from(image.texels[y * image.width + x][0]);
        }
        sum
    };
    let mut first: BTreeMap<(u32, u32), (usize, usize)> = BTreeMap::new();
    let (mut mean, mut square, mut error, mut n) = (0.0, 0.0, 0.0, 0.0);
    for (f, face) in atlas.faces.iter().enumerate() {
        let vertices = g.triangles[face.triangle as usize];
        for c in 0..3 {
            let (a, b) = (vertices[c], vertices[(c + 1) % 3]);
            let Some(&(of, oc)) = first.get(&(b, a)) else {
                first.insert((a, b), (f, c));
                continue;
            };
            let other = &atlas.faces[of].corners;
            let ends = [face.corners[c], face.corners[(c + 1) % 3]].map(DVec2::from);
            let others = [other[(oc + 1) % 3], other[oc]].map(DVec2::from);
            if ends[0].distance(others[0]) + ends[1].distance(others[1]) < 0.1 {
                continue;
            }
            for i in 0..7 {
                let t = (f64::from(i) + 0.4) / 7.0;
                let (v, w) = (sample(ends[0].lerp(ends[1], t)), sample(others[0].lerp(others[1], t)));
                let p = g.positions[a as usize].lerp(g.positions[b as usize], t as f32);
                let length = ends[0].distance(ends[1]);
                mean += length * (v - w).abs();
                square += length * (v - w).powi(2);
                error +=
                    0.5 * length * ((v - f64::from(truth(p))).powi(2) + (w - f64::from(truth(p))).powi(2));
                n += length;
            }
        }
    }
    (mean / n, (square / n).sqrt(), (error / n).sqrt())
}

/// Smooth light from 1 to 3.
fn smooth(p: Vec3) -> f32 {
    2.0 + (2.0 * p.x).sin() * (1.5 * p.y + 1.0).cos() * (p.z + 0.5).cos()
}

fn same_texels(a: &Image, b: &Image) -> usize {
    a.texels.iter().zip(&b.texels).filter(|(a, b)| a == b).count()
}

#[test]
fn a_sphere_with_noise_and_charts_of_different_brightness_loses_its_jumps() {
    const NOISE: f32 = 0.05;
    let g = geometry(&[(sphere(32), true)]);
    let atlas = unwrap(&g, 128);
    assert!(atlas.charts > 3, "{}", atlas.charts);
    let light = |p: Vec3, chart: u32, texel: u32| {
        [smooth(p) + NOISE * normal(1, texel) + 0.02 * normal(7, chart), 1.0, 0.0]
    };
    let (mut image, mask) = bake(&g, &atlas, light);
    Dilation::new(&mask, &Owners::new(&atlas), 2).apply(&mut image);
    let seams = Seams::new(&g, &atlas, &mask);
    let before = image.clone();
    seams.stitch(&mut image);
    let ((mean, rms, error), (mean_after, rms_after, error_after)) =
        (read(&g, &atlas, &before, smooth), read(&g, &atlas, &image, smooth));
    println!(
        "{} edges: mean {mean} -> {mean_after}, rms {rms} -> {rms_after}, error {error} -> {error_after}",
        seams.edges()
    );
    // An eighth at least, by a sampler that reads elsewhere than at the points stitched.
    assert!(mean_after < mean / 8.0 && rms_after < rms / 8.0, "{mean} -> {mean_after}, {rms} -> {rms_after}");
    // What is read at seams is nearer to the truth, not only the same on both sides.
    assert!(error_after < error, "{error} -> {error_after}");
    // Its own measure says the same.
    let (own, own_after) = (seams.jump(&before).unwrap(), seams.jump(&image).unwrap());
    assert!(own_after.mean < own.mean / 8.0 && own_after.rms < own.rms / 8.0, "{own:?} -> {own_after:?}");
    // Baked texels move by less than their noise; light that agrees already stays, but for rounding.
    let moved = |valid: bool| {
        let moves = (0..mask.valid.len()).filter(|&i| mask.valid[i] == valid);
        let moves: Vec<f32> =
            moves.map(|i| image.texels[i][0] - before.texels[i][0]).filter(|d| *d != 0.0).collect();
        let rms = (moves.iter().map(|d| f64::from(d * d)).sum::<f64>() / moves.len() as f64).sqrt();
        (moves.len(), rms)
    };
    println!("baked texels moved {:?}, gutter {:?}", moved(true), moved(false));
    assert!(moved(true).1 < f64::from(NOISE), "{:?}", moved(true));
    assert!(image.texels.iter().zip(&before.texels).all(|(a, b)| a[2] == b[2] && (a[1] - b[1]).abs() < 1e-5));
    assert!(image.texels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
}

#[test]
fn hard_edges_keep_their_jump_and_diagonals_lose_it() {
    let g = geometry(&[(cube(), true)]);
    let whole = unwrap(&g, 64);
    let (mut image, mask) = bake(&g, &whole, |_, chart, _| [1.0 + chart as f32; 3]);
    Dilation::new(&mask, &Owners::new(&whole), 2).apply(&mut image);
    let seams = Seams::new(&g, &whole, &mask);
    assert_eq!((seams.edges(), seams.jump(&image)), (0, None));
    let before = image.clone();
    seams.stitch(&mut image);
    assert_eq!(image, before);

    // Every triangle a chart of its own: six diagonals are seams.
    let corners: Vec<[Vec2; 3]> = (0..12)
        .map(|i| {
            let o = vec2((i % 4) as f32 * 16.0 + 1.3, (i / 4) as f32 * 16.0 + 1.6);
            let square = [vec2(0.0, 0.0), vec2(12.0, 0.0), vec2(12.0, 12.0), vec2(0.0, 12.0)].map(|p| o + p);
            if i % 2 == 0 { [square[0], square[1], square[2]] } else { [square[0], square[2], square[3]] }
        })
        .collect();
    let atlas = page(64, 48, &corners);
    let (mut image, mask) =
        bake(&g, &atlas, |_, chart, _| [1.0 + (chart / 2) as f32 + 0.1 * (chart % 2) as f32; 3]);
    Dilation::new(&mask, &Owners::new(&atlas), 3).apply(&mut image);
    let seams = Seams::new(&g, &atlas, &mask);
    assert_eq!(seams.edges(), 6);
    let before = image.clone();
    seams.stitch(&mut image);
    let (own, own_after) = (seams.jump(&before).unwrap(), seams.jump(&image).unwrap());
    println!("diagonals: {own:?} -> {own_after:?}");
    assert!(own_after.mean < own.mean / 5.0, "{own:?} -> {own_after:?}");
    // Texels three rows from the diagonal are away from every seam.
    let face_of = |x: usize, y: usize| (y / 16 * 4 + x / 16, x % 16, y % 16);
    for (i, (a, b)) in image.texels.iter().zip(&before.texels).enumerate() {
        let (_, x, y) = face_of(i % 64, i / 64);
        if x.abs_diff(y) > 3 && mask.valid[i] {
            assert_eq!(a, b, "texel ({}, {})", i % 64, i / 64);
        }
    }
}

#[test]
fn what_is_a_seam() {
    let v = vec3;
    // Two halves of a floor meet along x = 0.
    let left = || quad([v(-1.0, 0.0, 1.0), v(0.0, 0.0, 1.0), v(0.0, 0.0, 0.0), v(-1.0, 0.0, 0.0)]);
    let right = || quad([v(0.0, 0.0, 1.0), v(1.0, 0.0, 1.0), v(1.0, 0.0, 0.0), v(0.0, 0.0, 0.0)]);
    let wall = |up: f32| quad([v(0.0, 0.0, 1.0), v(0.0, 0.0, 0.0), v(0.0, up, 0.0), v(0.0, up, 1.0)]);
    let shifted = |by: Vec3| right().into_iter().map(|t| t.map(|(p, n)| (p + by, n))).collect::<Mesh>();
    let flipped = || right().into_iter().map(|[a, b, c]| [a, c, b].map(|(p, n)| (p, -n))).collect::<Mesh>();
    let ramp = |degrees: f32| {
        let turn = glam::Quat::from_rotation_z(degrees.to_radians());
        right().into_iter().map(|t| t.map(|(p, n)| (turn * p, turn * n))).collect::<Mesh>()
    };
    let count = |parts: &[(Mesh, bool)]| {
        let g = geometry(parts);
        let atlas = unwrap(&g, 64);
        let (_, mask) = bake(&g, &atlas, |_, _, _| [1.0; 3]);
        Seams::new(&g, &atlas, &mask).edges()
    };
    let lit = |mesh: Mesh| (mesh, true);
    assert_eq!(count(&[lit(left()), lit(right())]), 1, "two modules of a floor");
    assert_eq!(count(&[lit([left(), right()].concat())]), 0, "one chart");
    assert_eq!(count(&[lit(left()), lit(ramp(14.0))]), 1, "a faint edge");
    assert_eq!(count(&[lit(left()), lit(ramp(16.0))]), 0, "a hard edge");
    assert_eq!(count(&[lit(left()), lit(ramp(-14.0))]), 1, "a faint edge downwards");
    assert_eq!(count(&[lit(left()), lit(flipped())]), 0, "one half seen from below");
    assert_eq!(count(&[lit(left()), lit(shifted(v(0.0, 0.0, 0.0001)))]), 1, "within rounding");
    assert_eq!(count(&[lit(left()), lit(shifted(v(0.01, 0.0, 0.0)))]), 0, "a gap");
    assert_eq!(count(&[lit(left()), (right(), false)]), 0, "no texels on one side");
    // A wall on the edge keeps light from one half; one below it does not.
    for texels in [false, true] {
        assert_eq!(count(&[lit(left()), lit(right()), (wall(1.0), texels)]), 0, "a wall");
        assert_eq!(count(&[lit(left()), lit(right()), (wall(-1.0), texels)]), 1, "a wall below");
    }
}

#[test]
fn layers_stitched_one_by_one_sum_to_the_stitched_sum() {
    let g = geometry(&[(sphere(24), true)]);
    let atlas = unwrap(&g, 96);
    let layer = |seed: u32| {
        let (mut image, mask) = bake(&g, &atlas, |p, chart, texel| {
            let v = smooth(p) + 0.1 * random(seed, texel) + 0.2 * random(seed + 1, chart);
            [v, 3.0 - v * 0.5, 1.0 + 0.3 * random(seed + 2, texel)]
        });
        Dilation::new(&mask, &Owners::new(&atlas), 2).apply(&mut image);
        (image, mask)
    };
    let ((mut a, mask), (mut b, _)) = (layer(3), layer(40));
    let seams = Seams::new(&g, &atlas, &mask);
    let add = |a: &Image, b: &Image| {
        let mut sum = a.clone();
        sum.texels.iter_mut().flatten().zip(b.texels.iter().flatten()).for_each(|(a, b)| *a += b);
        sum
    };
    let mut sum = add(&a, &b);
    [&mut a, &mut b, &mut sum].into_iter().for_each(|image| seams.stitch(image));
    let apart = add(&a, &b);
    for (texel, (s, t)) in sum.texels.iter().flatten().zip(apart.texels.iter().flatten()).enumerate() {
        assert!((s - t).abs() < 1e-5, "value {texel}: {s}, in parts {t}");
    }
    // Scaled light gives scaled results.
    let (mut dim, _) = layer(3);
    dim.texels.iter_mut().flatten().for_each(|v| *v *= 1e-6);
    seams.stitch(&mut dim);
    for (a, b) in a.texels.iter().flatten().zip(dim.texels.iter().flatten()) {
        assert!((a - b * 1e6).abs() < 1e-5, "{a} {b}");
    }
    // And the same bytes whatever the number of threads.
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (mut again, mask) = layer(3);
        pool.install(|| Seams::new(&g, &atlas, &mask).stitch(&mut again));
        assert_eq!(same_texels(&again, &a), a.texels.len());
    }
}

#[test]
fn buried_texels_take_no_part() {
    let g = geometry(&[(sphere(24), true)]);
    let atlas = unwrap(&g, 96);
    let (image, mut mask) =
        bake(&g, &atlas, |p, chart, texel| [smooth(p) + random(5, texel) + random(6, chart); 3]);
    let covered = mask.clone();
    // What lies low is inside a solid.
    let (low, _) = bake(&g, &atlas, |p, _, _| [f32::from(p.y < -0.3); 3]);
    mask.valid.iter_mut().zip(&low.texels).for_each(|(valid, low)| *valid &= low[0] == 0.0);
    let mut before = image;
    (0..mask.valid.len()).filter(|&i| !mask.valid[i]).for_each(|i| before.texels[i] = [0.0; 3]);
    Dilation::new(&mask, &Owners::new(&atlas), 2).apply(&mut before);
    let seams = Seams::new(&g, &atlas, &mask);
    let mut after = before.clone();
    seams.stitch(&mut after);
    let changed = |i: &usize| before.texels[*i] != after.texels[*i];
    let all = 0..mask.valid.len();
    assert_eq!(all.clone().filter(|&i| covered.valid[i] && !mask.valid[i]).filter(changed).count(), 0);
    assert!(all.filter(|&i| mask.valid[i]).filter(changed).count() > 100);
    assert!(seams.jump(&after).unwrap().mean < seams.jump(&before).unwrap().mean / 4.0);
    // With nothing valid there is nothing to do, nor is there without light.
    let none = Mask { valid: vec![false; mask.valid.len()], ..mask.clone() };
    assert_eq!(Seams::new(&g, &atlas, &none).jump(&before), None);
    let mut black = Image::black(96, 96);
    seams.stitch(&mut black);
    assert_eq!(black, Image::black(96, 96));
    assert_eq!(seams.jump(&black).map(|jump| jump.mean), Some(0.0));
}

#[test]
fn one_texel_and_edges_without_length() {
    let floor = quad([vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 1.0), vec3(1.0, 0.0, 0.0)]);
    let g = geometry(&[(floor, true)]);
    let mask = Mask { width: 1, height: 1, valid: vec![true] };
    for corners in [
        // Both triangles in the one texel, at different places.
        [[vec2(0.1, 0.1), vec2(0.1, 0.9), vec2(0.9, 0.9)], [vec2(0.2, 0.1), vec2(0.9, 0.8), vec2(0.9, 0.1)]],
        // The edge is a point on one side, or on both.
        [[vec2(0.5, 0.5), vec2(0.1, 0.9), vec2(0.5, 0.5)], [vec2(0.1, 0.1), vec2(0.9, 0.9), vec2(0.9, 0.1)]],
        [[vec2(0.5, 0.5), vec2(0.1, 0.9), vec2(0.5, 0.5)], [vec2(0.1, 0.1), vec2(0.1, 0.1), vec2(0.9, 0.1)]],
    ] {
        let seams = Seams::new(&g, &page(1, 1, &corners), &mask);
        let mut image = Image { width: 1, height: 1, texels: vec![[3.0, 0.0, 1e-30]] };
        seams.stitch(&mut image);
        assert_eq!(image.texels, [[3.0, 0.0, 1e-30]]);
        assert!(seams.jump(&image).is_none_or(|jump| jump.mean == 0.0 && jump.rms == 0.0));
    }
}

#[test]
fn the_yard_is_stitched_in_seconds() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/yard.toml");
    let (scene, _) = scene::load(&file).unwrap();
    let (g, _) = geometry::load(&scene).unwrap();
    for side in [512, 1024] {
        let atlas = unwrap(&g, side);
        let light = |p: Vec3, chart: u32, texel: u32| {
            let v = smooth(0.3 * p) + 0.05 * normal(1, texel) + 0.02 * normal(2, chart);
            [v, 0.5 * v, 1.0]
        };
        let (mut image, mask) = bake(&g, &atlas, light);
        Dilation::new(&mask, &Owners::new(&atlas), 2).apply(&mut image);
        let start = Instant::now();
        let seams = Seams::new(&g, &atlas, &mask);
        let built = start.elapsed().as_secs_f64();
        let before = image.clone();
        seams.stitch(&mut image);
        let stitched = start.elapsed().as_secs_f64() - built;
        let (jump, after) = (seams.jump(&before).unwrap(), seams.jump(&image).unwrap());
        println!(
            "yard {side}: {} charts, {} seam edges, {} texels; found in {built:.3} s, a layer in {stitched:.4} s; {jump:?} -> {after:?}",
            atlas.charts,
            seams.edges(),
            seams.texels().len(),
        );
        assert!(seams.edges() > 100);
        assert!(after.mean < jump.mean / 5.0, "{jump:?} -> {after:?}");
        assert!(image.texels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    }
}
