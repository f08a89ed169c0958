//! Table, chairs and bench.

use super::WEST_X;
use crate::model::Model;
use crate::relief::steps;
use crate::shapes::{ALL, BOTTOM, TOP, bevelled, block, lathe, tube};
use glam::DVec3;

/// Height of the paving.
const PAVED: f64 = 0.03;
/// The table's middle on the terrace.
const TABLE: DVec3 = DVec3::new(2.0, PAVED, -3.85);

pub fn build(model: &mut Model) {
    table(model);
    let chair = chair(model);
    for (k, turn) in [28.0, 118.0, 215.0, 300.0f64].into_iter().enumerate() {
        // Chairs face the table; one is pushed back.
        let (sin, cos) = turn.to_radians().sin_cos();
        let away = if k == 2 { 1.18 } else { 0.92 };
        model.place_all(&chair, TABLE + DVec3::new(sin, 0.0, cos) * away, turn + 180.0, DVec3::ONE);
    }
    bench(model);
}

/// A round table on a foot: the top is lit, its rim and the foot are detail.
fn table(model: &mut Model) {
    let (r, y) = (0.62, 0.74);
    let at = |mesh: crate::mesh::Mesh| mesh.translated(TABLE.x, TABLE.y, TABLE.z);
    model.add("table", "oak", at(lathe(&[&[(r, y), (0.0, y)]], 32)));
    let rim = lathe(
        &[&[(0.0, y - 0.04), (r - 0.02, y - 0.04)], &[(r - 0.02, y - 0.04), (r, y - 0.02), (r, y)]],
        32,
    );
    model.add("table_detail", "oak", at(rim));
    let foot =
        lathe(&[&[(0.26, -0.03), (0.24, 0.03), (0.06, 0.08), (0.04, 0.3), (0.05, 0.6), (0.14, 0.72)]], 16);
    model.add("table_detail", "iron", at(foot));
    // A jug and two cups.
    let jug = lathe(
        &[
            &[(0.05, -0.02), (0.075, 0.06), (0.05, 0.16), (0.055, 0.2)],
            &[(0.055, 0.2), (0.045, 0.2)],
            &[(0.045, 0.2), (0.04, 0.1), (0.0, 0.1)],
        ],
        14,
    );
    model.add("table_detail", "yellow_paint", at(jug.translated(0.05, y, -0.08)));
    for (x, z) in [(0.3, 0.15), (-0.22, 0.28)] {
        let cup = lathe(
            &[
                &[(0.03, -0.02), (0.04, 0.08)],
                &[(0.04, 0.08), (0.034, 0.08)],
                &[(0.034, 0.08), (0.028, 0.02), (0.0, 0.02)],
            ],
            12,
        );
        model.add("table_detail", "white_wood", at(cup.translated(x, y, z)));
    }
}

/// A chair that faces +Z: seat and back are lit, legs and rails are detail.
fn chair(model: &mut Model) -> Vec<usize> {
    let seat = ([-0.22, 0.42, -0.22], [0.22, 0.46, 0.22]);
    let lit = model.shape("chair", "blue_wood", block(seat.0, seat.1, TOP | BOTTOM));
    let detail = model.shape("chair_detail", "blue_wood", block(seat.0, seat.1, ALL & !TOP & !BOTTOM));
    // The back leans; both faces are lit, its thin edges are not.
    let lean = |mesh: crate::mesh::Mesh| {
        mesh.transformed(glam::DAffine3::from_rotation_x(-0.16)).translated(0.0, 0.46, -0.19)
    };
    let back = ([-0.2, 0.22, -0.012], [0.2, 0.5, 0.012]);
    use crate::shapes::{NORTH, SOUTH};
    model.shape("chair", "blue_wood", lean(block(back.0, back.1, NORTH | SOUTH)));
    model.shape("chair_detail", "blue_wood", lean(block(back.0, back.1, ALL & !NORTH & !SOUTH)));
    for x in [-0.185, 0.185] {
        let stile = block([x - 0.02, -0.1, -0.036], [x + 0.02, 0.53, 0.004], ALL);
        model.shape("chair_detail", "blue_wood", lean(stile));
        for z in [-0.185, 0.185] {
            let splay = DVec3::new(x * 0.15, 0.0, z * 0.15);
            let leg = [(DVec3::new(x, 0.44, z), 0.02), (DVec3::new(x, -0.01, z) + splay, 0.016)];
            model.shape("chair_detail", "blue_wood", tube(&leg, 7));
        }
        let rail = [(DVec3::new(x * 1.07, 0.2, -0.2), 0.012), (DVec3::new(x * 1.07, 0.2, 0.2), 0.012)];
        model.shape("chair_detail", "blue_wood", tube(&rail, 6));
    }
    vec![lit, detail]
}

/// A bench along the brick wall, facing east.
fn bench(model: &mut Model) {
    let (x0, z0, z1) = (WEST_X[0] + 0.22, 2.2, 3.9);
    // Seat and back of two slats each.
    for k in 0..2 {
        let x = x0 + 0.02 + 0.22 * k as f64;
        let slat = bevelled([x, 0.44, z0], [x + 0.2, 0.48, z1], 0.008);
        model.add_split("bench", "oak", slat, |n| n.y > 0.99);
    }
    for k in 0..2 {
        let y = 0.56 + 0.21 * k as f64;
        let slat = bevelled([x0 - 0.05, y, z0], [x0 - 0.015, y + 0.19, z1], 0.008);
        model.add_split("bench", "oak", slat.grain_turned(), |n| n.x > 0.99);
    }
    for z in steps(z0 + 0.12, z1 - 0.12, 2) {
        let leg = |x: f64, y: f64| bevelled([x - 0.03, -0.15, z - 0.035], [x + 0.03, y, z + 0.035], 0.008);
        model.add("bench_detail", "iron", leg(x0 - 0.065, 0.92).with(leg(x0 + 0.38, 0.46)));
        model.add(
            "bench_detail",
            "iron",
            block([x0 - 0.07, 0.38, z - 0.03], [x0 + 0.4, 0.455, z + 0.03], ALL),
        );
    }
}
