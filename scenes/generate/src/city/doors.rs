//! House doors.

use super::openings::{RECESS, reveal};
use crate::model::Model;
use crate::relief::{full, sorted, sunk};
use crate::shapes::{ALL, NORTH, SOUTH, bevelled, block, tube};
use crate::soft::frame;
use glam::DVec3;

/// Width and height of a door's opening.
pub const DOOR: [f64; 2] = [1.4, 3.1];

/// A panelled double door under a fanlight, in a stone surround with a step; about the middle of its foot.
pub fn door(model: &mut Model) -> Vec<usize> {
    let [w, h] = DOOR;
    let (x, leaf_top) = (w / 2.0, 2.35);
    let panels: Vec<[f64; 4]> = [-1.0, 1.0]
        .into_iter()
        .flat_map(|s: f64| {
            [[0.35, 0.95], [1.08, 2.2]].map(|[y0, y1]| {
                let (a, b) = (s * 0.12, s * (x - 0.14));
                [a.min(b), y0, a.max(b), y1]
            })
        })
        .collect();
    let (mut xs, mut ys) = (vec![-x, x], vec![0.1, leaf_top]);
    for [a, b, c, d] in &panels {
        xs.extend([*a, a + 0.04, c - 0.04, *c]);
        ys.extend([*b, b + 0.04, d - 0.04, *d]);
    }
    let leaf = full(&sorted(xs), &sorted(ys), |x, y| {
        let depth: f64 = panels.iter().map(|&p| sunk(x, y, p, 0.04)).sum();
        DVec3::new(x, y, -RECESS - 0.03 * depth)
    });
    let door = model.shape("door", "green_wood", leaf);
    let detail = model.shape("door_detail", "stucco", reveal(w, h, RECESS + 0.05));
    let profile = [[0.2, -0.02], [0.2, 0.05], [0.08, 0.1], [0.0, 0.1], [0.0, -0.02]];
    let surround = frame(
        DVec3::Y * (h / 2.0 - 0.3),
        DVec3::X * (x + 0.2),
        DVec3::Y * (h / 2.0 + 0.5),
        DVec3::Z,
        &profile,
    );
    model.shape("door_detail", "stucco", surround);
    let fanlight = block([-x, leaf_top, -1.0], [x, h, -RECESS + 0.01], SOUTH);
    model.shape("door_detail", "glass", fanlight);
    let mut wood =
        block([-x, leaf_top - 0.03, -RECESS - 0.1], [x, leaf_top + 0.07, -RECESS + 0.06], ALL & !NORTH);
    wood.append(block([-0.04, 0.1, -RECESS - 0.1], [0.04, leaf_top, -RECESS + 0.03], ALL & !NORTH));
    for side in [-0.35, 0.35] {
        wood.append(block(
            [side - 0.02, leaf_top, -RECESS - 0.1],
            [side + 0.02, h, -RECESS + 0.035],
            ALL & !NORTH,
        ));
    }
    model.shape("door_detail", "green_wood", wood);
    let step = bevelled([-x - 0.1, 0.0, -RECESS - 0.1], [x + 0.1, 0.27, 0.3], 0.02);
    model.shape("door_detail", "granite", step);
    let handle =
        [(DVec3::new(0.1, 1.15, -RECESS - 0.01), 0.014), (DVec3::new(0.1, 1.15, -RECESS + 0.09), 0.03)];
    model.shape("door_detail", "steel", tube(&handle, 8));
    vec![door, detail]
}
