//! The dining table, laid for four, and its chairs.

use super::lounge::{ball, bowl, cup};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use crate::relief::steps;
use crate::shapes::{bevelled, lathe, tube, tube_side};
use crate::soft::cushion;
use glam::{DAffine3, DVec3};
use std::f64::consts::TAU;

/// The table's middle on the floor.
pub const TABLE: DVec3 = DVec3::new(1.5, 0.0, 0.75);
/// Of the table top's upper side.
const TOP: f64 = 0.755;

pub fn build(model: &mut Model) {
    table(model);
    let chair = chair(model);
    for (x, z, turn) in [(-0.36, -0.62, 0.0), (0.4, -0.66, 4.0), (-0.38, 0.64, 178.0), (0.44, 0.86, 151.0)] {
        model.place_all(&chair, TABLE + DVec3::new(x, 0.0, z), turn, DVec3::ONE);
    }
    lay(model);
}

/// A turned leg of height `h`, thick above and slim at the foot, from y = −0.01.
fn turned_leg(h: f64, r: f64) -> Mesh {
    let profile: Vec<_> = [
        (0.0, 0.55),
        (0.04, 0.7),
        (0.1, 0.62),
        (0.3, 0.78),
        (0.5, 0.92),
        (0.62, 0.98),
        (0.68, 0.8),
        (0.7, 0.66),
        (0.72, 0.8),
        (0.74, 1.0),
        (0.77, 0.8),
        (0.8, 0.95),
        (0.84, 1.0),
        (1.0, 1.0),
    ]
    .into_iter()
    .map(|(t, width)| (r * width, -0.01 + (h + 0.01) * t))
    .collect();
    lathe(&[&[(0.0, -0.01), profile[0]], &profile, &[profile[13], (0.0, h)]], 20)
}

/// Oak: the top's upper side is lit, the rest is detail or too dark to matter.
fn table(model: &mut Model) {
    let at = |mesh: Mesh| mesh.translated(TABLE.x, TABLE.y, TABLE.z);
    let (hx, hz) = (0.8, 0.45);
    let top = bevelled([-hx, TOP - 0.032, -hz], [hx, TOP, hz], 0.008);
    model.add_split("table", "oak", at(top.grain_turned()), |n| n.y.abs() > 0.99);
    for z in [-hz + 0.08, hz - 0.08] {
        let apron = bevelled([-hx + 0.07, TOP - 0.12, z - 0.012], [hx - 0.07, TOP - 0.02, z + 0.012], 0.003);
        model.add_split("table", "oak", at(apron.grain_turned()), |n| n.z.abs() > 0.99);
    }
    for x in [-hx + 0.08, hx - 0.08] {
        let apron = bevelled([x - 0.012, TOP - 0.118, -hz + 0.07], [x + 0.012, TOP - 0.02, hz - 0.07], 0.003);
        model.add_split("table", "oak", at(apron.grain_turned()), |n| n.x.abs() > 0.99);
        for z in [-hz + 0.08, hz - 0.08] {
            model.add("table_detail", "oak", at(turned_leg(TOP - 0.02, 0.04).translated(x, 0.0, z)));
        }
    }
}

/// A chair that faces +Z: seat pad and back rest are lit, the frame is detail.
fn chair(model: &mut Model) -> Vec<usize> {
    let pad = cushion(DVec3::new(0.205, 0.028, 0.2), 0.024, 3, 7, DVec3::new(0.0, 0.014, 0.0));
    let (seat, under) = pad.translated(0.0, 0.468, 0.0).split(|n| n.y > -0.5);
    let lit = model.shape("chair", "seat", seat);
    let detail = model.shape("chair_detail", "seat", under);
    let board = bevelled([-0.215, 0.42, -0.21], [0.215, 0.45, 0.21], 0.01);
    model.shape("chair_detail", "oak", board);
    for x in [-0.18, 0.18] {
        model.shape("chair_detail", "oak", turned_leg(0.43, 0.02).translated(x, 0.0, 0.175));
        // The back leg goes on as the back's stile, leaning.
        let stile = [
            (DVec3::new(x, -0.01, -0.2), 0.015),
            (DVec3::new(x, 0.2, -0.185), 0.018),
            (DVec3::new(x, 0.44, -0.185), 0.02),
            (DVec3::new(x * 1.02, 0.68, -0.215), 0.018),
            (DVec3::new(x * 1.04, 0.92, -0.265), 0.014),
        ];
        model.shape("chair_detail", "oak", tube(&stile, 14));
        let rail = [(DVec3::new(x, 0.2, -0.185), 0.009), (DVec3::new(x, 0.22, 0.175), 0.009)];
        model.shape("chair_detail", "oak", tube_side(&rail, 10));
    }
    let rail = [(DVec3::new(-0.18, 0.21, 0.0), 0.009), (DVec3::new(0.18, 0.21, 0.0), 0.009)];
    model.shape("chair_detail", "oak", tube_side(&rail, 10));
    let rest = cushion(DVec3::new(0.175, 0.09, 0.016), 0.012, 2, 6, DVec3::new(0.0, 0.01, 0.0));
    let bent = |mut mesh: Mesh| {
        // Curved to the back that leans on it.
        mesh.positions.iter_mut().for_each(|p| p.z -= 0.03 * (1.0 - (p.x / 0.18).powi(2)));
        mesh
    };
    let rest = bent(rest).transformed(
        DAffine3::from_translation(DVec3::new(0.0, 0.82, -0.245)) * DAffine3::from_rotation_x(-0.2),
    );
    let (broad, thin) = rest.split(|n| n.z.abs() > 0.7);
    model.shape("chair", "oak", broad);
    model.shape("chair_detail", "oak", thin);
    for x in steps(-0.1, 0.1, 3) {
        let spindle = [
            (DVec3::new(x, 0.44, -0.19), 0.007),
            (DVec3::new(x, 0.6, -0.22), 0.009),
            (DVec3::new(x, 0.77, -0.262), 0.007),
        ];
        model.shape("chair_detail", "oak", tube_side(&spindle, 8));
    }
    vec![lit, detail]
}

/// Plates and cups for four, a fruit bowl, and a vase with twigs.
fn lay(model: &mut Model) {
    let plate = lathe(
        &[
            &[(0.0, 0.0), (0.07, 0.0)],
            &[(0.07, 0.0), (0.09, 0.006), (0.125, 0.016)],
            &[(0.125, 0.016), (0.125, 0.019)],
            &[(0.125, 0.019), (0.095, 0.011), (0.08, 0.006), (0.07, 0.005)],
            &[(0.07, 0.005), (0.0, 0.005)],
        ],
        48,
    );
    let plate = model.shape("plate_detail", "porcelain", plate);
    let cup = model.shape("cup_detail", "blue_glaze", cup());
    for (x, z) in [(-0.36, -0.28), (0.4, -0.28), (-0.38, 0.28), (0.42, 0.28)] {
        let on = |x: f64, z: f64| TABLE + DVec3::new(x, TOP - 0.001, z);
        model.place_all(&[plate], on(x, z), 0.0, DVec3::ONE);
        model.place_all(&[cup], on(x + 0.19, z - 0.08 * z.signum()), 40.0 * x, DVec3::ONE);
    }
    let at = |mesh: Mesh, x: f64, y: f64, z: f64| mesh.translated(TABLE.x + x, TOP + y, TABLE.z + z);
    model.add("bowls_detail", "porcelain", at(bowl(0.14, 0.08), 0.22, -0.002, 0.0));
    for (x, y, z) in [(-0.05, 0.05, -0.03), (0.05, 0.05, -0.03), (0.0, 0.05, 0.055), (0.0, 0.108, 0.0)] {
        model.add("fruit_detail", "apple", at(ball(0.038), 0.22 + x, y, z));
    }
    model.add("vases_detail", "terracotta", at(vase(0.22), -0.14, -0.002, 0.0));
    let mut random = Random::new(77);
    for k in 0..9 {
        let (sin, cos) = (k as f64 / 9.0 * TAU + random.range(-0.2, 0.2)).sin_cos();
        let (reach, high) = (random.range(0.06, 0.14), random.range(0.32, 0.46));
        let root = TABLE + DVec3::new(-0.14, TOP, 0.0);
        let twig = [
            (root + DVec3::new(0.01 * cos, 0.1, 0.01 * sin), 0.003),
            (root + DVec3::new(0.018 * cos, 0.22, 0.018 * sin), 0.003),
            (root + DVec3::new(reach * cos, high, reach * sin), 0.002),
        ];
        model.add("vases_detail", "stem", tube(&twig, 6));
        model.add("vases_detail", "orange", ball(0.014).translated(twig[2].0.x, twig[2].0.y, twig[2].0.z));
    }
}

/// A vase of height `h` standing on y = 0, open above.
pub fn vase(h: f64) -> Mesh {
    let outer: Vec<_> =
        steps(0.0, 1.0, 18).into_iter().map(|t| (h * (0.2 + 0.14 * (t * TAU * 0.72).sin()), h * t)).collect();
    let inner: Vec<_> =
        outer.iter().rev().map(|&(r, y)| (r - 0.006, y)).filter(|&(_, y)| y > 0.3 * h).collect();
    let (rim, last) = ([outer[18], inner[0]], inner[inner.len() - 1]);
    lathe(&[&[(0.0, 0.0), outer[0]], &outer, &rim, &inner, &[last, (0.0, last.1)]], 36)
}
