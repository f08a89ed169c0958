//! Windows with frames, inner sills, venetian blinds, curtains on rods, and the radiators below.

use super::THICK;
use super::walls::{SOUTH, WEST, Wall};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{Rect, full, sorted, steps};
use crate::shapes::{ALL, lathe, tube};
use crate::soft::slab;
use glam::DVec3;
use std::f64::consts::TAU;

/// Openings in the south wall, in its coordinates.
pub const SOUTH_WINDOWS: [Rect; 2] = [[-2.3, 0.85, -0.8, 2.3], [0.8, 0.85, 2.3, 2.3]];
/// The opening in the west wall.
pub const WEST_WINDOWS: [Rect; 1] = [[-0.7, 0.85, 0.7, 2.3]];

/// Depths of the window frame.
const FRAME: [f64; 2] = [0.13, 0.19];
/// Depth of the blinds.
const BLIND: f64 = 0.065;

pub fn build(model: &mut Model) {
    // Each window with the height its blind comes down to.
    for (wall, window, foot) in
        [(SOUTH, SOUTH_WINDOWS[0], 1.5), (SOUTH, SOUTH_WINDOWS[1], 0.9), (WEST, WEST_WINDOWS[0], 1.2)]
    {
        opening(model, &wall, window);
        blind(model, &wall, window, foot);
        curtains(model, &wall, window);
        radiator(model, &wall, (window[0] + window[2]) / 2.0);
    }
}

/// Reveals, sills, frame and glazing bars; the panes are left out, they would only absorb.
fn opening(model: &mut Model, wall: &Wall, window: Rect) {
    let [u0, v0, u1, v1] = window;
    let [left, right, top, _] = wall.reveal(window, [0.0, THICK]);
    model.add("reveals", "white_paint", left.with(right).with(top));
    // The bottom is covered by the inner sill up to the frame.
    let [_, _, _, bottom] = wall.reveal(window, [FRAME[0], THICK]);
    model.add("windows_detail", "stone", bottom);
    let sill = wall.bevelled([u0 - 0.06, v0 - 0.03, u1 + 0.06, v0 + 0.015], [-0.07, FRAME[0] + 0.02], 0.008);
    model.add_split("sills", "stone", sill, |n| n.y > 0.99);
    let [near, far] = FRAME;
    let mut bar = |rect: Rect, inset: f64| {
        let body = wall.bevelled(rect, [near + inset, far - inset], 0.006);
        model.add("windows_detail", "white_paint", body);
    };
    let (wide, middle) = (0.06, (u0 + u1) / 2.0);
    bar([u0 - 0.02, v0 - 0.02, u0 + wide, v1 + 0.02], 0.0);
    bar([u1 - wide, v0 - 0.02, u1 + 0.02, v1 + 0.02], 0.0);
    bar([u0 - 0.015, v0 - 0.02, u1 + 0.015, v0 + wide], 0.004);
    bar([u0 - 0.015, v1 - wide, u1 + 0.015, v1 + 0.02], 0.004);
    bar([middle - 0.04, v0 - 0.01, middle + 0.04, v1 + 0.01], 0.007);
    let high = v0 + (v1 - v0) * 0.68;
    bar([u0 - 0.01, high - 0.02, u1 + 0.01, high + 0.02], 0.012);
    let handle = [
        (wall.at(middle + 0.02, 1.45, near + 0.02), 0.012),
        (wall.at(middle + 0.02, 1.45, near - 0.035), 0.01),
        (wall.at(middle + 0.02, 1.44, near - 0.045), 0.01),
        (wall.at(middle + 0.02, 1.34, near - 0.045), 0.008),
    ];
    model.add("windows_detail", "steel", tube(&handle, 8));
}

/// A venetian blind: curved slats, their outer edges raised, between a head rail and a bottom rail, on two
/// cords.
fn blind(model: &mut Model, wall: &Wall, [u0, _, u1, v1]: Rect, foot: f64) {
    const PITCH: f64 = 0.044;
    const HALF: f64 = 0.025;
    const TILT: f64 = 0.22;
    let (u0, u1) = (u0 + 0.015, u1 - 0.015);
    let head = wall.block([u0, v1 - 0.05, u1, v1 + 0.01], [BLIND - 0.028, BLIND + 0.028], ALL);
    model.add("blinds_detail", "blind", head);
    let rail = wall.bevelled([u0, foot, u1, foot + 0.02], [BLIND - 0.024, BLIND + 0.024], 0.004);
    model.add("blinds_detail", "blind", rail);
    let slats = ((v1 - 0.06 - foot - 0.03) / PITCH) as usize;
    for k in 0..=slats {
        let v = foot + 0.045 + PITCH * k as f64;
        let slat = full(&steps(u0, u1, 3), &steps(-HALF, HALF, 6), |u, s| {
            // An arc, 3 mm high, turned about its middle.
            let rise = 0.003 * (1.0 - (s / HALF).powi(2));
            let (sin, cos) = TILT.sin_cos();
            wall.at(u, v + s * sin + rise * cos, BLIND + s * cos - rise * sin)
        });
        model.add("blinds_detail", "blind", slat);
    }
    for part in [0.15, 0.85] {
        let u = u0 + (u1 - u0) * part;
        for d in [BLIND - HALF - 0.002, BLIND + HALF + 0.002] {
            let cord = [(wall.at(u, foot + 0.01, d), 0.001), (wall.at(u, v1 - 0.02, d), 0.001)];
            model.add("blinds_detail", "paper", tube(&cord, 4));
        }
    }
}

/// A pair of curtains drawn aside, on a rod with rings and knobs.
fn curtains(model: &mut Model, wall: &Wall, [u0, _, u1, v1]: Rect) {
    let (rod_v, rod_d) = (v1 + 0.14, -0.16);
    let (left, right) = (u0 - 0.36, u1 + 0.36);
    let rod = [(wall.at(left - 0.06, rod_v, rod_d), 0.013), (wall.at(right + 0.06, rod_v, rod_d), 0.013)];
    model.add("rods_detail", "brass", tube(&rod, 12));
    for u in [left - 0.07, right + 0.07] {
        let knob: Vec<_> = steps(0.0, 1.0, 8)
            .into_iter()
            .map(|t| {
                let (sin, cos) = (t * TAU / 2.0).sin_cos();
                (wall.at(u - 0.03 * cos, rod_v, rod_d), 0.002 + 0.028 * sin)
            })
            .collect();
        model.add("rods_detail", "brass", tube(&knob, 12));
    }
    for u in [left - 0.02, right + 0.02] {
        let bracket = [(wall.at(u, rod_v - 0.03, 0.01), 0.012), (wall.at(u, rod_v - 0.012, rod_d), 0.01)];
        model.add("rods_detail", "brass", tube(&bracket, 8));
    }
    for (k, (a, b)) in [(left, u0 + 0.12), (u1 - 0.12, right)].into_iter().enumerate() {
        let folds = 5.0;
        let phase = 1.3 * k as f64 + u0;
        let fall = |u: f64, v: f64, s: f64| {
            // Folds open towards the floor, and the cloth hangs a little crooked.
            let (t, drop) = ((u - a) / (b - a), (rod_v - v) / rod_v);
            let amplitude = 0.022 + 0.02 * drop;
            let wave = (TAU * folds * t + phase + 0.5 * drop * (3.0 * t + phase).sin()).sin();
            let narrow = (a + b) / 2.0 + (u - (a + b) / 2.0) * (0.94 + 0.06 * drop);
            wall.at(narrow, v, rod_d - 0.002 - amplitude * wave - 0.004 * s)
        };
        let cloth = slab(&steps(a, b, 50), &steps(0.02, rod_v - 0.035, 18), fall);
        model.add("curtains", "curtain", cloth.front);
        model.add("curtains_detail", "curtain", cloth.back.with(cloth.edges));
        for i in 0..2 * folds as usize {
            let u = a + (b - a) * (i as f64 + 0.5) / (2.0 * folds);
            ring(model, wall.at((a + b) / 2.0 + (u - (a + b) / 2.0) * 0.94, rod_v, rod_d), wall.along);
        }
    }
}

/// A curtain ring around the rod.
fn ring(model: &mut Model, centre: DVec3, axis: DVec3) {
    let (r, side) = (0.021, axis.cross(DVec3::Y));
    let path: Vec<_> = steps(0.0, TAU, 12)
        .into_iter()
        .map(|angle| (centre - DVec3::Y * 0.008 + (DVec3::Y * angle.cos() + side * angle.sin()) * r, 0.003))
        .collect();
    model.add("rods_detail", "brass", crate::shapes::tube_side(&path, 6));
}

/// A panel radiator with a pressed front, a grille, a valve and its pipes.
fn radiator(model: &mut Model, wall: &Wall, u: f64) {
    let (u0, u1, v0, v1) = (u - 0.55, u + 0.55, 0.14, 0.7);
    let (near, far) = (-0.115, -0.035);
    // Vertical channels pressed into the front.
    let channels = 18;
    let mut us = vec![u0, u1];
    for k in 0..channels {
        let c = u0 + (u1 - u0) * (k as f64 + 0.5) / channels as f64;
        us.extend([c - 0.02, c - 0.012, c + 0.012, c + 0.02]);
    }
    let front = full(&sorted(us.clone()), &[v0, v0 + 0.03, v0 + 0.045, v1 - 0.045, v1 - 0.03, v1], |u, v| {
        let c = ((u - u0) / (u1 - u0) * channels as f64).fract();
        let across = (1.0 - ((c - 0.5).abs() * (u1 - u0) / channels as f64 - 0.012) / 0.008).clamp(0.0, 1.0);
        let along = ((v - v0 - 0.03).min(v1 - 0.03 - v) / 0.015).clamp(0.0, 1.0);
        wall.at(u, v, near + 0.008 * across * along)
    });
    model.add("radiators", "enamel", front);
    // The body behind it, set back by less than the channels are deep.
    let body = wall.block([u0 + 0.002, v0 + 0.002, u1 - 0.002, v1 - 0.002], [near + 0.012, far], ALL);
    model.add("radiators_detail", "enamel", body);
    let rim = wall.reveal([u0, v0, u1, v1], [near, near + 0.013]);
    for side in rim {
        model.add("radiators_detail", "enamel", inside_out(side));
    }
    // Grille bars on top.
    for k in 0..28 {
        let c = u0 + 0.03 + (u1 - u0 - 0.06) * k as f64 / 27.0;
        let bar =
            wall.bevelled([c - 0.006, v1 - 0.01, c + 0.006, v1 + 0.012], [near + 0.012, far - 0.012], 0.003);
        model.add("radiators_detail", "enamel", bar);
    }
    for side in [-0.4, 0.4] {
        let hook =
            wall.block([u + side - 0.02, v0 + 0.1, u + side + 0.02, v1 - 0.1], [far - 0.01, 0.01], ALL);
        model.add("radiators_detail", "steel", hook);
    }
    let d = (near + far) / 2.0;
    for (u, knob) in [(u1 + 0.05, true), (u0 - 0.05, false)] {
        let inwards = if knob { -0.07 } else { 0.07 };
        let pipe = [
            (wall.at(u, -0.02, d), 0.009),
            (wall.at(u, v0 + 0.04, d), 0.009),
            (wall.at(u + inwards * 0.1, v0 + 0.055, d), 0.009),
            (wall.at(u + inwards, v0 + 0.055, d), 0.009),
        ];
        model.add("radiators_detail", "enamel", tube(&pipe, 10));
        if knob {
            let body: Mesh = lathe(
                &[
                    &[(0.0, 0.0), (0.018, 0.0)],
                    &[(0.018, 0.0), (0.021, 0.02), (0.019, 0.07)],
                    &[(0.019, 0.07), (0.0, 0.075)],
                ],
                16,
            );
            let at = wall.at(u, v0 + 0.05, d);
            model.add("radiators_detail", "porcelain", body.translated(at.x, at.y, at.z));
        }
    }
}

/// Faces and normals turned round.
fn inside_out(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.normals.iter_mut().for_each(|n| *n = -*n);
    mesh
}
