//! What encloses the yard: the brick wall, the picket fence, a garden gate and the drive's double gate.

use super::{BELOW, EAST_X, GARAGE_Z, SOUTH_Z, WEST_X};
use crate::model::Model;
use crate::relief::plate;
use crate::shapes::{ALL, BOTTOM, EAST, TOP, WEST, bevelled, block, tube};
use glam::{DVec2, DVec3};

/// Length of a bay as modelled; placed bays are stretched to fit.
const BAY: f64 = 2.0;

pub fn build(model: &mut Model) {
    wall(model);
    let bay = pickets(model, "fence_bay", BAY, 11, false);
    let gate = pickets(model, "garden_gate", 1.08, 6, true);
    let wing = pickets(model, "drive_gate", 1.42, 8, true);
    let post = post(model);

    // Runs of bays along the south, each between two posts (x from the left, seen from the yard's outside).
    let south = |from: f64, to: f64, bays: usize| (DVec3::new(to, 0.0, SOUTH_Z), 180.0, to - from, bays);
    let east = (DVec3::new(EAST_X, 0.0, GARAGE_Z[1]), -90.0, SOUTH_Z - GARAGE_Z[1], 4);
    let runs = [south(-7.92, -1.66, 3), south(-0.34, 4.34, 2), east];
    for (start, turn, length, bays) in runs {
        let step = if turn == 180.0 { DVec3::NEG_X } else { DVec3::Z } * (length / bays as f64);
        for k in 0..bays {
            let stretch = length / bays as f64 / BAY;
            model.place_all(&bay, start + step * k as f64, turn, DVec3::new(stretch, 1.0, 1.0));
            let skip = turn == -90.0 && k == 0;
            if !skip {
                model.place_all(&[post], start + step * k as f64, 0.0, DVec3::ONE);
            }
        }
        // The last post; the wall and the corner have theirs already.
        if turn == 180.0 && start.x - length > -7.9 {
            model.place_all(&[post], start + step * bays as f64, 0.0, DVec3::ONE);
        }
    }
    // A short panel east of the drive, and the posts at its ends.
    let end = pickets(model, "fence_end", 0.54, 3, false);
    model.place_all(&end, DVec3::new(EAST_X, 0.0, SOUTH_Z), 180.0, DVec3::ONE);
    for x in [7.46, EAST_X] {
        model.place_all(&[post], DVec3::new(x, 0.0, SOUTH_Z), 0.0, DVec3::ONE);
    }
    // Gates hang between posts; hinges and latch.
    model.place_all(&gate, DVec3::new(-0.46, 0.0, SOUTH_Z), 180.0, DVec3::ONE);
    model.place_all(&wing, DVec3::new(5.88, 0.0, SOUTH_Z), 180.0, DVec3::ONE);
    model.place_all(&wing, DVec3::new(7.36, 0.0, SOUTH_Z), 180.0, DVec3::ONE);
    for (x, y) in [(-0.40, 0.32), (-0.40, 0.92), (4.40, 0.32), (4.40, 0.92), (7.40, 0.32), (7.40, 0.92)] {
        let hinge = tube(&[(DVec3::new(x, y - 0.06, 5.96), 0.03), (DVec3::new(x, y + 0.06, 5.96), 0.03)], 8);
        model.add("fence_detail", "iron", hinge);
    }
    model.add("fence_detail", "iron", block([-1.62, 0.9, 5.95], [-1.42, 0.94, 5.99], ALL));
    model.add("fence_detail", "iron", block([5.8, 0.9, 5.95], [6.04, 0.94, 5.99], ALL));
    // A letter box on the gate post.
    model.add("fence_detail", "blue_wood", bevelled([-1.84, 0.86, 5.72], [-1.52, 1.12, 5.97], 0.02));
}

/// A panel of `count` pointed pickets and two rails between x = 0 and `length`, cut from one sheet; gates
/// have a brace.
fn pickets(model: &mut Model, name: &str, length: f64, count: usize, gate: bool) -> Vec<usize> {
    const HALF: f64 = 0.05;
    let pitch = length / count as f64;
    let mut xs = vec![0.0];
    for k in 0..count {
        let middle = (k as f64 + 0.5) * pitch;
        xs.extend([middle - HALF, middle, middle + HALF]);
    }
    xs.push(length);
    let ys = [0.07, 0.27, 0.38, 0.86, 0.97, 1.2];
    let picket = |i: usize| !i.is_multiple_of(3);
    let filled =
        |i: usize, j: usize| if gate && (i == 0 || i == 3 * count) { false } else { picket(i) || j % 2 == 1 };
    let place = |x: f64, y: f64| {
        let line = (0..xs.len()).find(|&k| xs[k] == x).expect("a line of the sheet");
        // The middle line of a picket ends in a point; a gate's top swings up to its middle.
        let point = if line % 3 == 2 && y == 1.2 { 0.08 } else { 0.0 };
        let t = x / length;
        let arch = if gate && y == 1.2 { 0.5 * t * (1.0 - t) } else { 0.0 };
        DVec2::new(x, y + point + arch)
    };
    let panel = plate(&xs, &ys, 0.036, filled, place);
    let detail = format!("{name}_detail");
    let lit = model.shape(name, "fence_wood", panel.front);
    let thin = model.shape(&detail, "fence_wood", panel.edges);
    let outer = model.shape(&format!("{name}_occluder"), "fence_wood", panel.back);
    if gate {
        // A diagonal brace on the yard's side.
        let a = [DVec3::new(0.1, 0.34, 0.03), DVec3::new(length - 0.1, 0.9, 0.03)];
        model.shape(&detail, "fence_wood", tube(&[(a[0], 0.035), (a[1], 0.035)], 6));
    }
    vec![lit, thin, outer]
}

fn post(model: &mut Model) -> usize {
    let shaft = block([-0.06, BELOW, -0.06], [0.06, 1.3, 0.06], ALL & !BOTTOM & !TOP);
    let cap = bevelled([-0.085, 1.27, -0.085], [0.085, 1.34, 0.085], 0.02);
    let ball = tube(&[(DVec3::new(0.0, 1.32, 0.0), 0.05), (DVec3::new(0.0, 1.42, 0.0), 0.02)], 8);
    model.shape("post_detail", "fence_wood", shaft.with(cap).with(ball))
}

/// The brick wall to the west, with a stone coping and a pier at its end.
fn wall(model: &mut Model) {
    let [inner, outer] = WEST_X;
    let top = 1.8;
    model.add("garden_wall", "brick", block([outer, BELOW, -6.1], [inner, top, 6.05], EAST));
    model.add("garden_wall_occluder", "brick", block([outer, BELOW, -6.1], [inner, top, 6.05], WEST));
    let pier = block([outer - 0.08, BELOW, 5.8], [inner + 0.08, top + 0.15, 6.24], ALL & !TOP & !BOTTOM);
    model.add("garden_wall", "brick", pier);
    let coping = |z0: f64, z1: f64, y: f64, out: f64| {
        bevelled([outer - out, y - 0.03, z0], [inner + out, y + 0.07, z1], 0.025)
    };
    for stone in [coping(-6.05, 5.82, top, 0.05), coping(5.74, 6.3, top + 0.15, 0.13)] {
        model.add_split("coping", "stone", stone, |n| n.y > 0.99);
    }
}
