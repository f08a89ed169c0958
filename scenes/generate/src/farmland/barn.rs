//! The barn: boarded walls with boards missing, open doors to the yard and behind, a hatch, a roof of
//! corrugated sheet that has lost one; inside a frame of posts and beams, a loft and a floor of trodden
//! straw.

use super::timber::{Wall, beam, stand};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{Plate, plate, steps};
use crate::shapes::{ALL, BOTTOM, EAST, NORTH, SOUTH, TOP, WEST, block, tube};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use std::f64::consts::TAU;

/// The ridge's x, and half the width to the walls' outer faces.
const MIDDLE: f64 = -14.0;
const HALF: f64 = 5.5;
/// The back and the front gable's outer faces.
const Z: [f64; 2] = [-21.0, -3.0];
/// Of the boarded walls.
const THICK: f64 = 0.1;
/// Top of the long walls, and where the gables' slopes meet.
const EAVES: f64 = 4.2;
const APEX: f64 = 7.6;
/// Walls begin below the ground.
const BELOW: f64 = -0.4;
/// Top of the floor and of the loft's boards.
const FLOOR: f64 = 0.1;
const LOFT: f64 = 2.75;
/// The loft reaches from the back gable to here.
const LOFT_EDGE: f64 = -14.2;
/// The big door: half its width, its height.
const DOOR: [f64; 2] = [2.1, 3.8];
/// How far the roof reaches beyond the walls.
const OVERHANG: f64 = 0.6;
/// Metres from crest to crest of the roof's sheets, and their relief.
const CORRUGATION: f64 = 0.32;
const CREST: f64 = 0.025;

/// No ground inside: [x0, z0, x1, z1].
pub const FOOTPRINT: [f64; 4] = [MIDDLE - HALF + 0.3, Z[0] + 0.3, MIDDLE + HALF - 0.3, Z[1] - 0.3];

pub fn build(model: &mut Model) {
    walls(model);
    for side in [-1.0, 1.0] {
        slope(model, side);
    }
    let ridge = |z: f64| (DVec3::new(MIDDLE, APEX + 0.07, z), 0.16);
    model.add(
        "barn_detail",
        "zinc",
        tube(&[ridge(Z[0] - OVERHANG - 0.04), ridge(Z[1] + OVERHANG + 0.04)], 12),
    );
    doors(model);
    frame(model);
    loft(model);
    let (x0, x1) = (MIDDLE - HALF + 0.05, MIDDLE + HALF - 0.05);
    let floor = |faces| block([x0, -0.3, Z[0] + 0.05], [x1, FLOOR, Z[1] - 0.04], faces);
    model.add("barn_floor", "straw_floor", floor(TOP));
    model.add("barn_detail", "straw_floor", floor(SOUTH | NORTH));
}

/// Adds a wall: outer and inner face with texels, cut edges without.
fn add_wall(model: &mut Model, wall: Plate) {
    model.add("barn_walls", "boards", wall.front);
    model.add("barn_inside", "old_boards", wall.back);
    model.add("barn_detail", "old_boards", wall.edges);
}

fn walls(model: &mut Model) {
    let gable = |openings: &[[f64; 4]]| {
        let (x, y) = ([-HALF, HALF], [BELOW, APEX - 0.02]);
        Wall { x, y, thickness: THICK, openings, gable: Some([EAVES, APEX]) }.build()
    };
    let hatch = [-1.0, 4.75, 1.0, 6.0];
    let front = gable(&[[-DOOR[0], BELOW, DOOR[0], DOOR[1]], hatch]);
    add_wall(model, stand(front, 0.0, DVec3::new(MIDDLE, 0.0, Z[1] - THICK / 2.0)));
    let back = gable(&[[1.2, BELOW, 2.5, 2.2]]);
    add_wall(model, stand(back, 180.0, DVec3::new(MIDDLE, 0.0, Z[0] + THICK / 2.0)));
    // The long walls stand 2 cm behind the gables' ends; x is measured from the barn's middle.
    let long = |openings: &[[f64; 4]]| {
        let half = (Z[1] - Z[0]) / 2.0 - 0.05;
        Wall { x: [-half, half], y: [BELOW, EAVES], thickness: THICK, openings, gable: None }.build()
    };
    let missing = |x: f64, y: f64| [x, y, x + 0.25, y + 2.4];
    let at = |side: f64| DVec3::new(MIDDLE + side * (HALF - 0.02 - THICK / 2.0), 0.0, (Z[0] + Z[1]) / 2.0);
    let west = long(&[missing(-1.0, 0.9), missing(0.5, 0.9), missing(4.25, 1.3), missing(6.5, 0.5)]);
    add_wall(model, stand(west, -90.0, at(-1.0)));
    let east = long(&[[-5.8, 1.3, -4.4, 2.3], missing(1.25, 1.2), missing(3.0, 0.8), [5.0, 1.3, 6.4, 2.3]]);
    add_wall(model, stand(east, 90.0, at(1.0)));
}

/// One side of the roof; the western one has lost a sheet.
fn slope(model: &mut Model, side: f64) {
    let rise = (APEX - EAVES) / HALF;
    let up = DVec3::new(-side, rise, 0.0).normalize();
    let out = DVec3::new(side * rise, 1.0, 0.0).normalize();
    let along = up.cross(out);
    let z = if along.z > 0.0 { Z[0] - OVERHANG } else { Z[1] + OVERHANG };
    // The underside passes 5 cm below the walls' tops, which end inside the roof.
    let eaves = DVec3::new(MIDDLE + side * (HALF + OVERHANG), EAVES - 0.05 - OVERHANG * rise, z);
    let thick = 0.1;
    let length = (HALF + OVERHANG + 0.03) * (1.0 + rise * rise).sqrt();
    let columns = ((Z[1] - Z[0] + 2.0 * OVERHANG) / (CORRUGATION / 4.0)).round() as usize;
    let xs = steps(0.0, Z[1] - Z[0] + 2.0 * OVERHANG, columns);
    let ys = [0.0, 2.4, 4.7, length];
    let lost = |i: usize, j: usize| side < 0.0 && j == 1 && (126..146).contains(&i);
    let Plate { mut front, back, mut edges } = plate(&xs, &ys, thick, |i, j| !lost(i, j), DVec2::new);
    for mesh in [&mut front, &mut edges] {
        for p in &mut mesh.positions {
            if p.z > 0.0 {
                p.z += CREST * (TAU * p.x / CORRUGATION).cos();
            }
        }
    }
    let front = front.smoothed();
    let world =
        DAffine3::from_mat3_translation(DMat3::from_cols(along, up, out), eaves + out * (thick / 2.0));
    model.add("barn_roof", "zinc_sheet", front.transformed(world));
    model.add("barn_ceiling", "old_boards", back.transformed(world));
    model.add("barn_detail", "zinc", edges.transformed(world));
}

/// Two leaves on the big door, swung out, and one behind; each a plate with a brace on its inner side.
fn doors(model: &mut Model) {
    let mut leaf = |hinge: DVec3, turn: f64, width: f64, height: f64| {
        let put = |mesh: Mesh| mesh.turned(turn).translated(hinge.x, hinge.y, hinge.z);
        let body = |faces| block([0.03, 0.1, -0.03], [width, height, 0.03], faces);
        model.add("barn_doors", "red_boards", put(body(NORTH | SOUTH)));
        model.add("barn_detail", "red_boards", put(body(ALL & !NORTH & !SOUTH)));
        let (low, high) = (0.45, height - 0.35);
        for z in [-0.045, 0.045] {
            let p = |x: f64, y: f64| DVec3::new(x, y, z);
            for y in [low, (low + high) / 2.0, high] {
                model.add("barn_detail", "red_boards", put(beam(p(0.1, y), p(width - 0.07, y), 0.05, 0.14)));
            }
            for [a, b] in [[low, (low + high) / 2.0], [(low + high) / 2.0, high]] {
                let brace = beam(p(0.16, a + 0.05), p(width - 0.12, b - 0.05), 0.044, 0.12);
                model.add("barn_detail", "red_boards", put(brace));
            }
        }
    };
    let front = |x: f64| DVec3::new(MIDDLE + x, 0.0, Z[1] + 0.05);
    leaf(front(-DOOR[0]), -148.0, DOOR[0], DOOR[1]);
    leaf(front(DOOR[0]), 292.0, DOOR[0], DOOR[1]);
    leaf(DVec3::new(MIDDLE - 1.2, 0.0, Z[0] - 0.05), 80.0, 1.28, 2.2);
}

/// Posts, tie beams with braces and king posts, rafters; and boards that finish the outside.
fn frame(model: &mut Model) {
    let mut wood = Mesh::default();
    let p = |x: f64, y: f64, z: f64| DVec3::new(MIDDLE + x, y, z);
    for z in steps(Z[0] + 3.4, Z[1] - 3.4, 3) {
        wood.append(beam(p(-HALF + 0.2, 3.9, z), p(HALF - 0.2, 3.9, z), 0.2, 0.26));
        wood.append(beam(p(0.0, 3.9, z), p(0.0, APEX - 0.1, z), 0.16, 0.16));
        for side in [-1.0, 1.0] {
            wood.append(beam(p(side * 5.22, -0.2, z), p(side * 5.22, 4.12, z), 0.22, 0.22));
            wood.append(beam(p(side * 5.2, 2.9, z), p(side * 4.1, 3.85, z), 0.12, 0.14));
            wood.append(beam(p(side * 0.05, 4.6, z), p(side * 2.3, 5.95, z), 0.1, 0.12));
        }
    }
    for z in steps(Z[0] + 0.5, Z[1] - 0.5, 17) {
        for side in [-1.0, 1.0] {
            wood.append(beam(p(side * 5.36, 4.15, z), p(0.0, 7.46, z), 0.09, 0.14));
        }
    }
    for side in [-1.0, 1.0] {
        wood.append(beam(p(side * 2.7, 5.72, Z[0] + 0.08), p(side * 2.7, 5.72, Z[1] - 0.08), 0.14, 0.18));
        // Corner boards, and boards along the gables' slopes.
        for (z, out) in [(Z[1], 0.02), (Z[0], -0.02)] {
            wood.append(beam(
                p(side * (HALF - 0.1), BELOW, z + out),
                p(side * (HALF - 0.1), 4.3, z + out),
                0.28,
                0.08,
            ));
            let edge = |x: f64| p(side * x, EAVES - 0.1 + (HALF - x) * (APEX - EAVES) / HALF, z + 29.0 * out);
            wood.append(beam(edge(HALF + OVERHANG - 0.02), edge(0.0), 0.05, 0.2));
        }
        wood.append(beam(p(side * DOOR[0], BELOW, Z[1]), p(side * DOOR[0], DOOR[1], Z[1]), 0.14, 0.14));
    }
    wood.append(beam(p(-DOOR[0] - 0.1, DOOR[1], Z[1]), p(DOOR[0] + 0.1, DOOR[1], Z[1]), 0.15, 0.16));
    // A beam over the hatch, to haul up bales.
    wood.append(beam(p(0.0, 6.35, Z[1] - 0.6), p(0.0, 6.35, Z[1] + 1.1), 0.16, 0.2));
    model.add("barn_detail", "old_boards", wood);
    let rope = [(p(0.0, 6.3, Z[1] + 0.95), 0.015), (p(0.0, 5.1, Z[1] + 0.95), 0.015)];
    model.add("barn_detail", "straw", tube(&rope, 6));
}

/// A boarded loft over the barn's back, and a ladder to it.
fn loft(model: &mut Model) {
    let (x0, x1) = (MIDDLE - HALF + 0.08, MIDDLE + HALF - 0.08);
    let boards = |faces| block([x0, LOFT - 0.06, Z[0] + 0.07], [x1, LOFT, LOFT_EDGE], faces);
    model.add("barn_loft", "old_boards", boards(TOP | BOTTOM));
    model.add("barn_detail", "old_boards", boards(SOUTH | EAST | WEST));
    for z in steps(Z[0] + 0.6, LOFT_EDGE - 0.12, 6) {
        let joist = beam(DVec3::new(x0, LOFT - 0.15, z), DVec3::new(x1, LOFT - 0.15, z), 0.12, 0.2);
        model.add("barn_detail", "old_boards", joist);
    }
    for x in [-3.0, 0.0, 3.0] {
        let post = |y: f64| DVec3::new(MIDDLE + x, y, LOFT_EDGE - 0.14);
        model.add("barn_detail", "old_boards", beam(post(-0.1), post(LOFT - 0.1), 0.16, 0.16));
    }
    let side = |x: f64, t: f64| DVec3::new(MIDDLE + x, 3.5 * t, LOFT_EDGE + 1.1 - 1.05 * t);
    for x in [-1.75, -1.25] {
        model.add("barn_detail", "boards", beam(side(x, 0.0), side(x, 1.0), 0.04, 0.08));
    }
    for k in 1..12 {
        let t = k as f64 / 12.0;
        model.add("barn_detail", "boards", tube(&[(side(-1.75, t), 0.016), (side(-1.25, t), 0.016)], 6));
    }
}
