//! The house: façade with plinth, windows, shutters, door and porch; plain walls where the yard does not see
//! them.

use super::{BELOW, FRONT, HOUSE_X};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, sheet, sorted, steps, sunk};
use crate::shapes::{ALL, EAST, NORTH, SOUTH, TOP, WEST, bevelled, block, lathe, prism, tube};
use glam::DVec3;

/// Top of the façade, inside the roof.
const TOP_Y: f64 = 3.05;
/// Openings [x0, y0, x1, y1].
const WINDOWS: [[f64; 4]; 3] = [[-6.9, 1.0, -5.8, 2.4], [-4.2, 1.0, -3.1, 2.4], [1.4, 1.0, 2.6, 2.4]];
const DOOR: [f64; 4] = [-1.55, 0.1, -0.45, 2.3];
/// How far panes and the door stand back.
const RECESS: f64 = 0.2;
/// Back wall of the house.
const BACK: f64 = -11.0;

pub fn build(model: &mut Model) {
    facade(model);
    for window in WINDOWS {
        glaze(model, window);
    }
    door(model);
    porch(model);
    let walls = block([HOUSE_X[0], BELOW, BACK], [HOUSE_X[1], TOP_Y, FRONT], EAST | WEST | NORTH);
    model.add("house_occluder", "plaster", walls);
}

/// Plaster above a brick plinth, with reveals into the openings.
fn facade(model: &mut Model) {
    let mut xs = steps(HOUSE_X[0], HOUSE_X[1], 8);
    let mut ys = vec![0.42, TOP_Y];
    for [x0, y0, x1, y1] in WINDOWS.into_iter().chain([DOOR]) {
        xs.extend([x0, x1]);
        ys.extend([y0.max(0.42), y1]);
    }
    let (xs, ys) = (sorted(xs), sorted(ys));
    let solid = |i: usize, j: usize| {
        let (x, y) = ((xs[i] + xs[i + 1]) / 2.0, (ys[j] + ys[j + 1]) / 2.0);
        !WINDOWS.iter().chain([&DOOR]).any(|o| x > o[0] && x < o[2] && y > o[1] && y < o[3])
    };
    model.add("facade", "plaster", sheet(&xs, &ys, solid, |x, y| DVec3::new(x, y, FRONT)));
    for [x0, y0, x1, y1] in WINDOWS.into_iter().chain([DOOR]) {
        // The opening's four sides look inwards.
        let (front, back) = (FRONT, FRONT - RECESS);
        let p = DVec3::new;
        let mut reveal = Mesh::default();
        reveal.quad(p(x0, y0, front), p(x0, y0, back), p(x0, y1, back), p(x0, y1, front));
        reveal.quad(p(x1, y0, back), p(x1, y0, front), p(x1, y1, front), p(x1, y1, back));
        reveal.quad(p(x0, y1, back), p(x1, y1, back), p(x1, y1, front), p(x0, y1, front));
        reveal.quad(p(x0, y0, front), p(x1, y0, front), p(x1, y0, back), p(x0, y0, back));
        model.add("reveals", "plaster", reveal);
    }
    // The plinth stands 6 cm proud and slopes back into the plaster; its ends close it at the door.
    let proud = FRONT + 0.06;
    let section = [[FRONT, BELOW], [proud, BELOW], [proud, 0.42], [FRONT, 0.48]];
    for (x0, x1) in [(HOUSE_X[0], DOOR[0]), (DOOR[2], HOUSE_X[1])] {
        let (sides, ends) = prism(&section, x0, x1);
        let [_, front, slope, _] = <[Mesh; 4]>::try_from(sides).expect("four edges");
        model.add("plinth", "brick", front);
        model.add("house_detail", "brick", slope.with(ends));
    }
}

/// Pane, frame, glazing bars, sill and shutters of a window.
fn glaze(model: &mut Model, [x0, y0, x1, y1]: [f64; 4]) {
    let pane = FRONT - RECESS + 0.02;
    model.add(
        "glass",
        "glass",
        block([x0 - 0.05, y0 - 0.05, pane - 0.1], [x1 + 0.05, y1 + 0.05, pane], SOUTH),
    );
    let (back, front, bar) = (pane - 0.03, pane + 0.05, 0.07);
    let mut wood = |min: [f64; 2], max: [f64; 2], front: f64, material: &str| {
        let solid = block([min[0], min[1], back], [max[0], max[1], front], ALL & !NORTH);
        model.add("house_detail", material, solid);
    };
    let white = "white_wood";
    wood([x0 - 0.03, y0 - 0.03], [x0 + bar, y1 + 0.03], front, white);
    wood([x1 - bar, y0 - 0.03], [x1 + 0.03, y1 + 0.03], front, white);
    wood([x0, y0 - 0.03], [x1, y0 + bar], front - 0.025, white);
    wood([x0, y1 - bar], [x1, y1 + 0.03], front - 0.025, white);
    let middle = (x0 + x1) / 2.0;
    wood([middle - 0.045, y0], [middle + 0.045, y1], front - 0.005, white);
    for part in [1.0 / 3.0, 2.0 / 3.0] {
        let y = y0 + (y1 - y0) * part;
        wood([x0, y - 0.02], [x1, y + 0.02], front - 0.045, white);
    }
    let sill = bevelled([x0 - 0.1, y0 - 0.08, FRONT - RECESS], [x1 + 0.1, y0 + 0.02, FRONT + 0.12], 0.015);
    model.add("house_detail", "stone", sill);
    let width = (x1 - x0) / 2.0;
    shutter(model, [x0 - 0.03 - width, y0 - 0.02, x0 - 0.03, y1 + 0.02]);
    shutter(model, [x1 + 0.03, y0 - 0.02, x1 + 0.03 + width, y1 + 0.02]);
}

/// A louvred shutter folded back against the wall.
fn shutter(model: &mut Model, [x0, y0, x1, y1]: [f64; 4]) {
    const FRAME: f64 = 0.08;
    const PITCH: f64 = 0.12;
    let front = FRONT + 0.06;
    let inner = [x0 + FRAME, y0 + FRAME, x1 - FRAME, y1 - FRAME];
    let louvres = ((inner[3] - inner[1]) / PITCH).round() as usize;
    let mut ys = vec![y0, y1];
    for (k, y) in steps(inner[1], inner[3], louvres).into_iter().enumerate() {
        ys.push(y);
        if k < louvres {
            ys.push(y + 0.025);
        }
    }
    let ys = sorted(ys);
    let xs = [x0, inner[0], inner[0] + 0.02, inner[2] - 0.02, inner[2], x1];
    let place = |x: f64, y: f64| {
        // Each louvre leans out at its foot.
        let phase = ((y - inner[1]) * louvres as f64 / (inner[3] - inner[1])).rem_euclid(1.0);
        let foot = phase > 0.2 && phase < 0.3;
        let edge = y < inner[1] + 1e-6 || y > inner[3] - 1e-6;
        let depth = if edge || foot { 0.004 } else { 0.022 };
        DVec3::new(
            x,
            y,
            front - depth * sunk(x, y, [inner[0], y0 - 1.0, inner[2], y1 + 1.0], 0.02) * f64::from(!edge),
        )
    };
    model.add("shutters", "blue_paint", full(&xs, &ys, place));
    let body = block([x0, y0, FRONT - 0.02], [x1, y1, front], ALL & !SOUTH & !NORTH);
    model.add("house_detail", "blue_paint", body);
}

/// A panelled door with frame, threshold and handle.
fn door(model: &mut Model) {
    let [x0, y0, x1, y1] = DOOR;
    let plane = FRONT - RECESS + 0.03;
    let panels = [
        [x0 + 0.16, 0.32, -1.05, 0.95],
        [-0.95, 0.32, x1 - 0.16, 0.95],
        [x0 + 0.16, 1.1, -1.05, 2.1],
        [-0.95, 1.1, x1 - 0.16, 2.1],
    ];
    let (mut xs, mut ys) = (vec![x0 - 0.04, x1 + 0.04], vec![y0 - 0.04, y1 + 0.04]);
    for [a, b, c, d] in panels {
        xs.extend([a, a + 0.035, c - 0.035, c]);
        ys.extend([b, b + 0.035, d - 0.035, d]);
    }
    let leaf = full(&sorted(xs), &sorted(ys), |x, y| {
        let depth: f64 = panels.iter().map(|&p| sunk(x, y, p, 0.035)).sum();
        DVec3::new(x, y, plane - 0.025 * depth)
    });
    model.add("door", "green_wood", leaf);
    let mut frame = |min: [f64; 3], max: [f64; 3]| {
        model.add("house_detail", "white_wood", block(min, max, ALL & !NORTH));
    };
    frame([x0 - 0.03, 0.05, plane - 0.05], [x0 + 0.07, y1 + 0.03, plane + 0.06]);
    frame([x1 - 0.07, 0.05, plane - 0.05], [x1 + 0.03, y1 + 0.03, plane + 0.06]);
    frame([x0, y1 - 0.07, plane - 0.05], [x1, y1 + 0.04, plane + 0.04]);
    let threshold = bevelled([x0 + 0.04, 0.05, plane - 0.1], [x1 - 0.04, 0.21, FRONT + 0.04], 0.01);
    model.add("house_detail", "stone", threshold);
    let knob = |y: f64, z: f64| DVec3::new(-0.66, y, plane + z);
    let stem = tube(&[(knob(1.05, -0.02), 0.014), (knob(1.05, 0.06), 0.014)], 8);
    let grip = tube(&[(knob(1.05, 0.055), 0.016), (knob(1.05, 0.055) - DVec3::X * 0.13, 0.012)], 8);
    let plate = block([-0.69, 0.95, plane - 0.02], [-0.63, 1.15, plane + 0.008], ALL & !NORTH);
    model.add("house_detail", "metal", stem.with(grip).with(plate));
}

/// Steps, two posts and a small roof with the lamp's housing under it.
fn porch(model: &mut Model) {
    let upper = bevelled([-2.1, -0.2, FRONT - 0.05], [0.1, 0.17, -4.75], 0.02);
    let lower = bevelled([-1.85, -0.25, -5.0], [-0.15, 0.1, -4.42], 0.02);
    // The treads and risers; the step goes into the wall.
    let lit = |n: DVec3| n.max_element() > 0.99 || n.x < -0.99;
    model.add_split("porch_steps", "stone", upper.with(lower).standing(), lit);
    for x in [-1.95, -0.05] {
        let post = bevelled([x - 0.06, 0.1, -4.98], [x + 0.06, 2.4, -4.86], 0.015);
        let foot = bevelled([x - 0.09, 0.12, -5.01], [x + 0.09, 0.3, -4.83], 0.015);
        model.add("house_detail", "white_wood", post.with(foot));
    }
    model.add("house_detail", "white_wood", bevelled([-2.18, 2.26, -4.99], [0.18, 2.42, -4.85], 0.015));
    let section = [[FRONT - 0.05, 2.63], [-4.55, 2.36], [-4.55, 2.46], [FRONT - 0.05, 2.76]];
    let (sides, ends) = prism(&section, -2.3, 0.3);
    let [under, edge, top, _] = <[Mesh; 4]>::try_from(sides).expect("four edges");
    model.add("porch_roof", "roof_tiles", top);
    model.add("porch_ceiling", "white_wood", under);
    model.add("house_detail", "white_wood", edge.with(ends));
    let housing = block([-1.32, 2.44, -5.6], [-0.68, 2.58, -5.2], ALL & !TOP);
    model.add("house_detail", "metal", housing);
    // A door mat, and a bell beside the door.
    model.add("house_detail", "iron", bevelled([-1.4, 0.1, -5.75], [-0.6, 0.19, -5.25], 0.005));
    let bell = lathe(&[&[(0.0, 0.0), (0.05, 0.0)], &[(0.05, 0.0), (0.03, 0.06), (0.0, 0.07)]], 12);
    model.add("house_detail", "metal", bell.translated(-0.2, 1.5, FRONT + 0.02));
}
