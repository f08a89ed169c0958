//! The farmhouse: rendered walls with deep windows, a slated roof between two chimneys.

use super::timber::{Wall, stand};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{Plate, steps};
use crate::shapes::{ALL, BOTTOM, SOUTH, bevelled, block, lathe, tube};
use crate::soft::{frame, slab};
use glam::DVec3;

/// Outer faces of the walls.
const X: [f64; 2] = [8.0, 18.0];
const Z: [f64; 2] = [-19.5, -12.5];
/// Of the walls.
const THICK: f64 = 0.34;
/// Walls begin below the ground.
const BELOW: f64 = -0.4;
/// Top of the long walls, and where the gables' slopes meet.
const EAVES: f64 = 4.7;
const APEX: f64 = 7.9;
/// How far the roof reaches beyond the walls: at the eaves, at the gables.
const OVERHANG: [f64; 2] = [0.4, 0.18];

/// No ground inside: [x0, z0, x1, z1].
pub const FOOTPRINT: [f64; 4] = [X[0] + 0.3, Z[0] + 0.3, X[1] - 0.3, Z[1] - 0.3];

pub fn build(model: &mut Model) {
    let (middle, half) = ((X[0] + X[1]) / 2.0, (X[1] - X[0]) / 2.0);
    let depth = (Z[1] - Z[0]) / 2.0 - 0.05;
    let window = |x: f64, y: f64| [x - 0.5, y, x + 0.5, y + 1.25];
    let door = [-0.5, 0.12, 0.5, 2.2];
    let front =
        [window(-3.0, 1.0), window(3.0, 1.0), door, window(-3.0, 3.1), window(0.0, 3.1), window(3.0, 3.1)];
    let back = [window(-2.5, 1.0), window(2.0, 1.0), window(2.0, 3.1)];
    let west = [window(0.3, 1.0), window(0.3, 3.1)];
    let east = [window(-1.0, 3.1)];
    // The gables stand 2 cm behind the long walls' ends.
    let inset = THICK / 2.0;
    face(model, &front, half, None, 0.0, DVec3::new(middle, 0.0, Z[1] - inset));
    face(model, &back, half, None, 180.0, DVec3::new(middle, 0.0, Z[0] + inset));
    let z = (Z[0] + Z[1]) / 2.0;
    face(model, &west, depth, Some(APEX), -90.0, DVec3::new(X[0] + 0.02 + inset, 0.0, z));
    face(model, &east, depth, Some(APEX), 90.0, DVec3::new(X[1] - 0.02 - inset, 0.0, z));
    roof(model);
    entrance(model);
}

/// A wall with its windows and doors.
fn face(model: &mut Model, openings: &[[f64; 4]], half: f64, apex: Option<f64>, turn: f64, at: DVec3) {
    let top = apex.map_or(EAVES, |apex| apex - 0.02);
    let gable = apex.map(|apex| [EAVES, apex]);
    let wall = Wall { x: [-half, half], y: [BELOW, top], thickness: THICK, openings, gable };
    // Nobody sees its back.
    let Plate { front, edges, .. } = stand(wall.build(), turn, at);
    model.add("house_walls", "render", front);
    model.add("house_detail", "render", edges);
    let mut add = |material: &str, mesh: Mesh| {
        model.add("house_detail", material, mesh.turned(turn).translated(at.x, at.y, at.z));
    };
    let face = THICK / 2.0;
    for &[x0, y0, x1, y1] in openings {
        let door = y0 < 0.5;
        let z = face - 0.2;
        let material = if door { "blue_wood" } else { "glass" };
        add(material, block([x0 - 0.03, y0 - 0.1, z - 0.05], [x1 + 0.03, y1 + 0.03, z], SOUTH));
        let centre = DVec3::new((x0 + x1) / 2.0, (y0 + y1) / 2.0, z);
        let (right, high) = (DVec3::X * ((x1 - x0) / 2.0 + 0.01), DVec3::Y * ((y1 - y0) / 2.0 + 0.01));
        let profile = [[0.08, -0.01], [0.08, 0.05], [0.0, 0.05]];
        add("white_wood", frame(centre, right, high, DVec3::Z, &profile));
        if door {
            // Panels.
            for (px, py) in [(-0.22, -0.55), (0.22, -0.55), (-0.22, 0.4), (0.22, 0.4)] {
                let (a, b) = (centre + DVec3::new(px, py, 0.0), DVec3::new(0.15, 0.34, 0.0));
                let bottom = DVec3::new(a.x - b.x, a.y - b.y, z - 0.03);
                let top = DVec3::new(a.x + b.x, a.y + b.y, z + 0.02);
                add("blue_wood", bevelled(bottom.to_array(), top.to_array(), 0.01));
            }
            continue;
        }
        let bar = |a: [f64; 2], b: [f64; 2]| {
            let [low, high] = [[a[0], a[1], z - 0.02], [b[0], b[1], z + 0.035]];
            block(low, high, ALL)
        };
        add("white_wood", bar([centre.x - 0.02, y0], [centre.x + 0.02, y1]));
        add("white_wood", bar([x0, centre.y + 0.04], [x1, centre.y + 0.08]));
        let sill = bevelled([x0 - 0.1, y0 - 0.12, face - 0.2], [x1 + 0.1, y0 - 0.005, face + 0.07], 0.015);
        add("stone", sill);
    }
}

fn roof(model: &mut Model) {
    let z = (Z[0] + Z[1]) / 2.0;
    let run = (Z[1] - Z[0]) / 2.0 - 0.05;
    let rise = (APEX - EAVES) / run;
    let thick = 0.16;
    let x = [X[0] - OVERHANG[1], X[1] + OVERHANG[1]];
    for side in [1.0, -1.0] {
        let out = DVec3::new(0.0, 1.0, side * rise).normalize() * thick;
        // The underside passes 6 cm below the walls' tops; v is the distance from the ridge, upwards.
        let place = |u: f64, v: f64, s: f64| {
            let foot = DVec3::new(side * u, APEX - 0.06 + v * rise, z - side * v);
            let lift = if v == 0.0 { DVec3::Y * (thick * (1.0 + rise * rise).sqrt()) } else { out };
            foot + lift * s
        };
        let us = if side > 0.0 { steps(x[0], x[1], 10) } else { steps(-x[1], -x[0], 10) };
        let tiles = slab(&us, &steps(-run - 0.05 - OVERHANG[0], 0.0, 6), place);
        model.add("house_roof", "slate", tiles.front);
        model.add("house_detail", "slate", tiles.edges.with(tiles.back));
        let y = APEX - 0.06 - (run + 0.05 + OVERHANG[0]) * rise;
        let gutter = |x: f64| (DVec3::new(x, y + 0.02, z + side * (run + 0.05 + OVERHANG[0] + 0.1)), 0.07);
        model.add("house_detail", "iron", tube(&[gutter(x[0]), gutter(x[1])], 8));
        for x in [X[0] + 0.25, X[1] - 0.25] {
            let wall = z + side * (run + 0.05 + 0.08);
            let path = [
                (DVec3::new(x, y, z + side * (run + 0.05 + OVERHANG[0] + 0.1)), 0.045),
                (DVec3::new(x, y - 0.35, wall), 0.045),
                (DVec3::new(x, BELOW, wall), 0.045),
            ];
            model.add("house_detail", "iron", tube(&path, 8));
        }
    }
    let ridge = |x: f64| (DVec3::new(x, APEX + 0.13, z), 0.11);
    model.add("house_detail", "slate", tube(&[ridge(x[0] - 0.02), ridge(x[1] + 0.02)], 8));
    for (x0, x1) in [(X[0] + 0.1, X[0] + 0.9), (X[1] - 0.9, X[1] - 0.1)] {
        let stack = |y0: f64, y1: f64, grow: f64, faces| {
            block([x0 - grow, y0, z - 0.6 - grow], [x1 + grow, y1, z + 0.6 + grow], faces)
        };
        model.add("chimneys", "render", stack(APEX - 1.0, APEX + 1.3, 0.0, ALL & !BOTTOM));
        model.add("house_detail", "stone", stack(APEX + 1.22, APEX + 1.36, 0.06, ALL));
        for dz in [-0.28, 0.28] {
            let pot = lathe(
                &[
                    &[(0.14, 0.0), (0.11, 0.5)],
                    &[(0.11, 0.5), (0.08, 0.5)],
                    &[(0.08, 0.5), (0.08, 0.2), (0.0, 0.2)],
                ],
                12,
            );
            let pot = pot.translated((x0 + x1) / 2.0, APEX + 1.33, z + dz);
            model.add("house_detail", "terracotta", pot);
        }
    }
}

/// A step, and a slated canopy over the door.
fn entrance(model: &mut Model) {
    let x = (X[0] + X[1]) / 2.0;
    let step = bevelled([x - 0.85, -0.3, Z[1] - 0.05], [x + 0.85, 0.13, Z[1] + 0.75], 0.02).standing();
    model.add_split("house_step", "stone", step, |n| n.y > 0.99);
    let canopy = slab(&steps(x - 0.85, x + 0.85, 2), &steps(-0.85, 0.1, 2), |u, v, s| {
        DVec3::new(u, 2.75 + 0.45 * v + 0.09 * s, Z[1] - v)
    });
    model.add("house_canopy", "slate", canopy.front);
    model.add("house_detail", "white_wood", canopy.edges.with(canopy.back));
    for side in [-0.72, 0.72] {
        let p = |y: f64, z: f64| DVec3::new(x + side, y, Z[1] + z);
        let bracket = super::timber::beam(p(1.8, 0.0), p(2.44, 0.66), 0.07, 0.08);
        model.add("house_detail", "white_wood", bracket);
    }
}
