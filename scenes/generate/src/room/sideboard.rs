//! A sideboard beside the sofa, with a radio, a vase and a framed photograph.

use super::dining::vase;
use super::lounge::{ball, bowl};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, sorted, steps, sunk};
use crate::shapes::{bevelled, lathe, tube};
use crate::soft::{cushion, frame};
use glam::{DAffine3, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Ends.
const X: [f64; 2] = [-0.15, 1.4];
/// Back, just off the skirting, and front.
const Z: [f64; 2] = [-2.38, -1.98];
/// Underside and top.
const Y: [f64; 2] = [0.14, 0.72];

pub fn build(model: &mut Model) {
    let ([x0, x1], [y0, y1], [z0, z1]) = (X, Y, Z);
    let body = bevelled([x0, y0, z0], [x1, y1, z1], 0.006);
    // The front is covered by the doors but for narrow gaps.
    let lit = |n: DVec3| n.y > 0.99 || n.x.abs() > 0.99;
    model.add_split("sideboard", "oak", body.grain_turned(), lit);
    let doors = 3;
    for k in 0..doors {
        let edge = |k: usize| x0 + 0.02 + (x1 - x0 - 0.04) * k as f64 / doors as f64;
        door(model, [edge(k) + 0.004, y0 + 0.02, edge(k + 1) - 0.004, y1 - 0.02], z1);
    }
    for x in [x0 + 0.1, x1 - 0.1] {
        for z in [z0 + 0.07, z1 - 0.07] {
            let leg = [(DVec3::new(x, y0 + 0.01, z), 0.024), (DVec3::new(x, -0.01, z), 0.014)];
            model.add("sideboard_detail", "iron", tube(&leg, 12));
        }
    }
    radio(model, DVec3::new(1.05, y1, -2.18));
    model.add("vases_detail", "blue_glaze", vase(0.3).translated(0.05, y1 - 0.002, -2.2));
    model.add("bowls_detail", "terracotta", bowl(0.11, 0.06).translated(0.42, y1 - 0.002, -2.12));
    photograph(model, DVec3::new(0.68, y1, -2.22));
}

/// A door with a sunk panel and a knob.
fn door(model: &mut Model, [x0, y0, x1, y1]: [f64; 4], z: f64) {
    let panel = [x0 + 0.06, y0 + 0.06, x1 - 0.06, y1 - 0.06];
    let [a, b, c, d] = panel;
    let xs = sorted(vec![x0, a, a + 0.015, c - 0.015, c, x1]);
    let ys = sorted(vec![y0, b, b + 0.015, d - 0.015, d, y1]);
    let front = z + 0.012;
    let leaf = full(&xs, &ys, |x, y| DVec3::new(x, y, front - 0.008 * sunk(x, y, panel, 0.015)));
    model.add("sideboard", "oak", leaf);
    use crate::shapes::{ALL, NORTH, SOUTH, block};
    let edges = block([x0, y0, z - 0.01], [x1, y1, front], ALL & !SOUTH & !NORTH);
    model.add("sideboard_detail", "oak", edges);
    let knob = lathe(
        &[&[(0.005, -0.005), (0.005, 0.012), (0.014, 0.018), (0.015, 0.024), (0.009, 0.03), (0.0, 0.031)]],
        16,
    );
    let at = DAffine3::from_translation(DVec3::new(x1 - 0.03, (y0 + y1) / 2.0, front));
    model.add("sideboard_detail", "brass", knob.transformed(at * DAffine3::from_rotation_x(FRAC_PI_2)));
}

/// A rounded radio with a slotted front and two knobs.
fn radio(model: &mut Model, at: DVec3) {
    let case = cushion(DVec3::new(0.15, 0.09, 0.06), 0.025, 4, 4, DVec3::ZERO);
    model.add("radio_detail", "apple", case.translated(at.x, at.y + 0.088, at.z));
    for y in steps(0.05, 0.13, 9) {
        let slot = bevelled([-0.12, y - 0.003, 0.055], [0.02, y + 0.003, 0.063], 0.001);
        model.add("radio_detail", "iron", slot.translated(at.x, at.y, at.z));
    }
    for y in [0.06, 0.12] {
        let knob = lathe(&[&[(0.018, 0.0), (0.017, 0.014)], &[(0.017, 0.014), (0.0, 0.015)]], 20);
        let place = DAffine3::from_translation(at + DVec3::new(0.08, y, 0.057));
        model.add("radio_detail", "paper", knob.transformed(place * DAffine3::from_rotation_x(FRAC_PI_2)));
    }
    let aerial = [(at + DVec3::new(0.12, 0.16, -0.04), 0.003), (at + DVec3::new(0.24, 0.42, -0.05), 0.0015)];
    model.add("radio_detail", "steel", tube(&aerial, 6));
    model.add("radio_detail", "steel", ball(0.005).translated(aerial[1].0.x, aerial[1].0.y, aerial[1].0.z));
}

/// A small frame that leans back on its stand.
fn photograph(model: &mut Model, at: DVec3) {
    let profile = [[0.018, 0.004], [0.018, 0.01], [0.0, 0.012], [0.0, -0.004], [0.03, -0.004]];
    let rim = frame(DVec3::ZERO, DVec3::X * 0.07, DVec3::Y * 0.09, DVec3::Z, &profile);
    let mut pane = Mesh::default();
    let p = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    pane.quad(p(-0.06, -0.08, 0.005), p(0.06, -0.08, 0.005), p(0.06, 0.08, 0.005), p(-0.06, 0.08, 0.005));
    let mut back = Mesh::default();
    back.quad(p(0.06, -0.08, -0.003), p(-0.06, -0.08, -0.003), p(-0.06, 0.08, -0.003), p(0.06, 0.08, -0.003));
    let lean = |mesh: Mesh| {
        mesh.transformed(DAffine3::from_translation(at + DVec3::Y * 0.087) * DAffine3::from_rotation_x(-0.2))
    };
    model.add("photograph_detail", "brass", lean(rim.with(back)));
    model.add("photograph_detail", "paper", lean(pane));
    let stand = [(at + DVec3::new(0.0, 0.1, -0.01), 0.004), (at + DVec3::new(0.0, -0.002, -0.06), 0.004)];
    model.add("photograph_detail", "brass", tube(&stand, 6));
}
