//! The garage: board-and-batten walls, a panelled door, a flat roof with a fascia, the work lamp's housing.

use super::{BELOW, GARAGE_X, GARAGE_Z};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, sheet, sorted, steps, sunk};
use crate::shapes::{ALL, BOTTOM, EAST, NORTH, TOP, WEST, bevelled, block, tube};
use glam::{DAffine3, DMat3, DVec3};

/// The garage door's opening [x0, y0, x1, y1].
const DOOR: [f64; 4] = [4.7, BELOW, 7.1, 2.05];
/// A small side door in the west wall [z0, y0, z1, y1].
const SIDE_DOOR: [f64; 4] = [-3.3, BELOW, -2.4, 2.02];
/// Underside of the roof above `x`: it rises to the east.
fn underside(x: f64) -> f64 {
    2.32 + (x - 3.7) * 0.05
}

pub fn build(model: &mut Model) {
    walls(model);
    doors(model);
    roof(model);
    // The work lamp above the door: an arm and a shade, open below.
    let arm = tube(&[(DVec3::new(5.9, 2.3, -1.65), 0.02), (DVec3::new(5.9, 2.33, -1.4), 0.02)], 8);
    let head = bevelled([5.8, 2.25, -1.46], [6.0, 2.36, -1.3], 0.02);
    model.add("garage_detail", "iron", arm.with(head));
}

/// Lines across boards `BOARD` wide, each covered at its seam by a batten.
const BOARD: f64 = 0.21;
fn battens(low: f64, high: f64) -> Vec<f64> {
    let count = ((high - low) / BOARD).round();
    let width = (high - low) / count;
    let mut out = vec![low, high];
    for k in 0..count as usize {
        let at = low + (k as f64 + 0.5) * width;
        out.extend([at - 0.045, at - 0.03, at + 0.03, at + 0.045]);
    }
    sorted(out)
}

/// How far the wall stands out at line `k` of `battens`, given with openings' lines added.
fn stands_out(v: f64, low: f64, high: f64) -> f64 {
    let count = ((high - low) / BOARD).round();
    let width = (high - low) / count;
    let from_seam = ((v - low).rem_euclid(width) - width / 2.0).abs();
    if from_seam < 0.031 { 0.022 } else { 0.0 }
}

fn walls(model: &mut Model) {
    let ([x0, x1], [z0, z1]) = (GARAGE_X, GARAGE_Z);
    // West, from inside the house to the front; z × y looks west.
    let low = -6.1;
    let mut us = battens(low, z1);
    us.extend([SIDE_DOOR[0], SIDE_DOOR[2]]);
    let us = sorted(us);
    let vs = [BELOW, 1.0, SIDE_DOOR[3], underside(x0) + 0.07];
    let open = |i: usize, j: usize| us[i] > SIDE_DOOR[0] - 1e-9 && us[i] < SIDE_DOOR[2] - 1e-9 && j < 2;
    let west = sheet(&us, &vs, |i, j| !open(i, j), |z, y| DVec3::new(x0 - stands_out(z, low, z1), y, z));
    model.add("garage_walls", "red_planks", west);
    // South, its top following the roof.
    let mut us = battens(x0, x1);
    us.extend([DOOR[0], DOOR[2]]);
    let us = sorted(us);
    let vs = [BELOW, 1.0, DOOR[3], 3.0];
    let open = |i: usize, j: usize| us[i] > DOOR[0] - 1e-9 && us[i] < DOOR[2] - 1e-9 && j < 2;
    let south = sheet(
        &us,
        &vs,
        |i, j| !open(i, j),
        |x, y| DVec3::new(x, if y == 3.0 { underside(x) + 0.07 } else { y }, z1 + stands_out(x, x0, x1)),
    );
    model.add("garage_walls", "red_planks", south);
    for (x, z) in [(x0, z1), (x1, z1)] {
        let post = block([x - 0.05, BELOW, z - 0.09], [x + 0.05, underside(x) + 0.05, z + 0.05], ALL & !TOP);
        model.add("garage_detail", "white_wood", post);
    }
    let outer = block([x0 + 0.3, BELOW - 3.0, z0], [x1, 0.07, z1], EAST | NORTH).transformed(roof_slope());
    let sliver = block([x0, BELOW, z0], [x0 + 0.3, underside(x0) + 0.07, -6.0], WEST | NORTH);
    model.add("garage_occluder", "red_planks", outer.with(sliver));
}

/// From a level roof at y = 0 to the real one, by a shear.
fn roof_slope() -> DAffine3 {
    DAffine3::from_mat3_translation(
        DMat3::from_cols(DVec3::new(1.0, 0.05, 0.0), DVec3::Y, DVec3::Z),
        DVec3::new(0.0, underside(0.0), 0.0),
    )
}

/// A panelled leaf in the (x, y) plane at z = 0, its panels in `columns` × `rows`.
fn leaf(width: f64, height: f64, columns: usize, rows: usize) -> Mesh {
    let mut panels = Vec::new();
    for i in 0..columns {
        for j in 0..rows {
            let (w, h) = (width / columns as f64, height / rows as f64);
            let (x, y) = (i as f64 * w, j as f64 * h);
            panels.push([x + 0.07, y + 0.07, x + w - 0.07, y + h - 0.07]);
        }
    }
    let (mut xs, mut ys) = (vec![-0.04, width + 0.04], vec![-0.04, height + 0.04]);
    for [a, b, c, d] in &panels {
        xs.extend([*a, a + 0.03, c - 0.03, *c]);
        ys.extend([*b, b + 0.03, d - 0.03, *d]);
    }
    full(&sorted(xs), &sorted(ys), |x, y| {
        DVec3::new(x, y, -0.02 * panels.iter().map(|&p| sunk(x, y, p, 0.03)).sum::<f64>())
    })
}

fn doors(model: &mut Model) {
    let (z, [x0, _, x1, top]) = (GARAGE_Z[1], DOOR);
    model.add("garage_door", "white_wood", leaf(x1 - x0, top, 4, 4).translated(x0, 0.0, z - 0.12));
    let mut frame = |min: [f64; 3], max: [f64; 3]| {
        model.add("garage_detail", "white_wood", block(min, max, ALL));
    };
    frame([x0 - 0.08, BELOW, z - 0.16], [x0 + 0.05, top + 0.08, z + 0.05]);
    frame([x1 - 0.05, BELOW, z - 0.16], [x1 + 0.08, top + 0.08, z + 0.05]);
    frame([x0 - 0.02, top - 0.05, z - 0.16], [x1 + 0.02, top + 0.06, z + 0.035]);
    let bar = |x: f64, z: f64| (DVec3::new(x, 0.78, z), 0.014);
    let grip = tube(&[bar(5.75, z - 0.14), bar(5.76, z - 0.05), bar(6.04, z - 0.05), bar(6.05, z - 0.14)], 8);
    model.add("garage_detail", "metal", grip);

    // The side door looks west: turned a quarter, its left edge to the north.
    let (x, [z0, _, z1, top]) = (GARAGE_X[0], SIDE_DOOR);
    let side = leaf(z1 - z0, top, 2, 3).turned(-90.0).translated(x + 0.08, 0.0, z0);
    model.add("side_door", "green_wood", side);
    let mut frame = |min: [f64; 3], max: [f64; 3]| {
        model.add("garage_detail", "white_wood", block(min, max, ALL));
    };
    frame([x - 0.05, BELOW, z0 - 0.07], [x + 0.12, top + 0.07, z0 + 0.05]);
    frame([x - 0.05, BELOW, z1 - 0.05], [x + 0.12, top + 0.07, z1 + 0.07]);
    frame([x - 0.035, top - 0.05, z0 - 0.02], [x + 0.12, top + 0.05, z1 + 0.02]);
    frame([x - 0.06, BELOW, z0 + 0.03], [x + 0.12, 0.06, z1 - 0.03]);
    let knob = tube(
        &[(DVec3::new(x + 0.1, 1.0, z1 - 0.13), 0.03), (DVec3::new(x + 0.0, 1.0, z1 - 0.13), 0.035)],
        10,
    );
    model.add("garage_detail", "metal", knob);
}

/// A sheared slab: roofing felt on top, a white fascia, boards below.
fn roof(model: &mut Model) {
    let (x0, x1, z0, z1) = (3.7, 8.3, GARAGE_Z[0] - 0.3, GARAGE_Z[1] + 0.38);
    let shear = roof_slope();
    let part = |faces| block([x0, 0.0, z0], [x1, 0.14, z1], faces).transformed(shear);
    model.add("garage_detail", "white_wood", part(ALL & !TOP & !BOTTOM));
    // Only the overhang's underside can be seen.
    for (a, b, c, d) in [(x0, x1, GARAGE_Z[1] - 0.1, z1), (x0, GARAGE_X[0] + 0.1, z0, GARAGE_Z[1] - 0.1)] {
        let boards = block([a, 0.0, c], [b, 0.14, d], BOTTOM).transformed(shear);
        model.add("garage_soffit", "white_wood", boards);
    }
    let rest = block([GARAGE_X[0] + 0.1, 0.0, z0], [x1, 0.14, GARAGE_Z[1] - 0.1], BOTTOM);
    model.add("garage_occluder", "white_wood", rest.transformed(shear));
    // Seams of the felt run across the slope.
    let xs = sorted(
        steps(x0, x1, 5)
            .into_iter()
            .skip(1)
            .take(4)
            .flat_map(|x| [x - 0.03, x, x + 0.03])
            .chain([x0, x1])
            .collect(),
    );
    let mut zs = steps(z0, z1, 4);
    zs.extend([z0 + 0.04, z1 - 0.04]);
    let zs = sorted(zs);
    let felt = full(&zs, &xs, |z, x| {
        let seam = steps(x0, x1, 5)[1..5].iter().any(|s| (s - x).abs() < 1e-9) && z > z0 && z < z1;
        DVec3::new(x, 0.14 + if seam { 0.02 } else { 0.0 }, z)
    });
    model.add("garage_roof", "bitumen", felt.transformed(shear));
}
