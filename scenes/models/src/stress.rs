//! Slivers and tiny charts over a patch of ground.

use crate::mesh::Mesh;
use crate::model::{Material, Model};
use crate::random::Random;
use crate::relief::{full, steps};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Half the side of the ground under both scenes, in metres.
const GROUND: f64 = 4.0;
/// Slivers of each kind.
pub(crate) const SLIVERS: usize = 400;
/// Widths of slivers in metres: from what a texel may show down to less than `f32` resolves.
const WIDTHS: [f64; 2] = [1e-2, 1e-12];
/// The bits stand in a square grid with this many on a side.
pub(crate) const BITS: usize = 100;
/// Side lengths of bits in metres.
const SIDES: [f64; 2] = [0.005, 0.04];

/// Slivers of every kind that real files hold, over a patch of ground: free ones, fans whose points lie on
/// one line but for rounding, triangles of exactly collinear corners, and coincident ones that face both
/// ways.
pub(crate) fn slivers() -> Model {
    let mut model = ground();
    let mut random = Random::new(1);
    let mut free = Mesh::default();
    for _ in 0..SLIVERS {
        let (start, along) = segment(&mut random);
        let width = width(&mut random);
        let across = random.direction() * width;
        triangle(&mut free, [start, start + along, start + along * random.range(0.0, 1.0) + across]);
    }
    model.add("free", "grey", free);
    // What is left of a wall whose edge got more points: the points lie on the edge but for rounding to
    // `f32`.
    let mut fans = Mesh::default();
    for _ in 0..SLIVERS / 8 {
        let (start, along) = segment(&mut random);
        let apex =
            start + along * 0.5 + along.cross(random.direction()).normalize() * random.range(0.01, 0.5);
        let points: Vec<DVec3> = (0..=8).map(|k| rounded(start + along * (k as f64 / 8.0))).collect();
        for pair in points.windows(2) {
            triangle(&mut fans, [pair[0], pair[1], apex]);
        }
        for k in 1..8 {
            triangle(&mut fans, [points[0], points[k], points[k + 1]]);
        }
    }
    model.add("fans", "grey", fans);
    // Steps of whole 1/64 m, which `f32` holds exactly.
    let mut collinear = Mesh::default();
    for _ in 0..SLIVERS {
        let whole = |random: &mut Random, low: f64, high: f64| random.range(low, high).floor() / 64.0;
        let start = DVec3::from_array([-128.0, 8.0, -128.0].map(|low| whole(&mut random, low, low + 256.0)));
        let step = DVec3::from_array([(); 3].map(|()| whole(&mut random, -16.0, 16.0)));
        triangle(&mut collinear, [start, start + step * 3.0, start + step]);
    }
    model.add("collinear", "grey", collinear);
    let mut both = Mesh::default();
    for _ in 0..SLIVERS / 2 {
        let (start, along) = segment(&mut random);
        let corners = [start, start + along, start + random.direction() * width(&mut random)];
        triangle(&mut both, corners);
        triangle(&mut both, [corners[1], corners[0], corners[2]]);
    }
    model.add("both_sides", "pale", both);
    model
}

/// Ten thousand loose triangles and squares of millimetres to centimetres, each a chart of its own, over a
/// patch of ground.
pub(crate) fn charts() -> Model {
    let mut model = ground();
    let mut random = Random::new(2);
    let mut bits = Mesh::default();
    for k in 0..BITS * BITS {
        let place = |i: usize| (i as f64 + 0.5) / BITS as f64 * 2.0 * GROUND - GROUND;
        let centre = DVec3::new(place(k % BITS), random.range(0.1, 1.0), place(k / BITS));
        let side = SIDES[0] * (SIDES[1] / SIDES[0]).powf(random.range(0.0, 1.0));
        let normal = random.direction();
        let u = normal.any_orthonormal_vector() * side;
        let v = normal.cross(u) * random.range(0.3, 1.0);
        let corners = [centre, centre + u, centre + u + v, centre + v].map(|c| (c, DVec2::ZERO));
        bits.polygon(&corners[..3 + k % 2]);
    }
    model.add("bits", "pale", bits);
    model
}

/// A patch of ground and two materials.
pub(crate) fn ground() -> Model {
    let mut model = Model::default();
    for (name, albedo) in [("grey", 0.5), ("pale", 0.7)] {
        let (albedo, texture) = ([albedo; 3], None);
        model.materials.push(Material { name, albedo, texture, cutoff: None, double_sided: false });
    }
    let steps = steps(-GROUND, GROUND, 4);
    model.add("ground", "grey", full(&steps, &steps, |z, x| DVec3::new(x, 0.0, z)));
    model
}

/// A place over the ground, and a vector of centimetres to a metre.
fn segment(random: &mut Random) -> (DVec3, DVec3) {
    let (radius, turn) = (random.range(0.0, GROUND), random.range(0.0, TAU));
    let start = DVec3::new(radius * turn.cos(), random.range(0.1, 2.0), radius * turn.sin());
    (start, random.direction() * random.range(0.05, 1.0))
}

/// One of [`WIDTHS`], every power of ten as often.
fn width(random: &mut Random) -> f64 {
    WIDTHS[0] * (WIDTHS[1] / WIDTHS[0]).powf(random.range(0.0, 1.0))
}

/// As the file will hold it.
pub(crate) fn rounded(point: DVec3) -> DVec3 {
    point.as_vec3().as_dvec3()
}

/// Adds a triangle with vertices of its own, which may be without area: then its normal is up.
fn triangle(mesh: &mut Mesh, corners: [DVec3; 3]) {
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize().unwrap_or(DVec3::Y);
    let vertices = corners.map(|corner| mesh.vertex(corner, DVec2::ZERO));
    vertices.iter().for_each(|&vertex| mesh.normals[vertex as usize] = normal);
    mesh.triangles.push(vertices);
}
