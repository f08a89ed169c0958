//! Balconies with iron railings, and bay windows that climb a façade.

use super::STOREY;
use super::openings::{Kind, Openings};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{grid, sheet};
use crate::shapes::{ALL, BOTTOM, bevelled, block, prism, tube, tube_side};
use glam::DVec3;

/// Half a balcony's width, and how far it stands out.
const HALF: f64 = 1.15;
const OUT: f64 = 0.95;
/// Its floor below the threshold.
const FLOOR: f64 = 0.03;
/// Height of railings above the slab.
const RAIL: f64 = 1.02;
/// Half a bay's width, and how far it stands out.
pub const BAY_HALF: f64 = 1.25;
const BAY_OUT: f64 = 0.85;

/// A balcony before a French window whose threshold is at y = 0; its slab lies a little lower.
pub fn balcony(model: &mut Model) -> Vec<usize> {
    let slab = bevelled([-HALF, -0.19, -0.1], [HALF, -FLOOR, OUT], 0.025);
    let (broad, thin) = slab.split(|n| n.y.abs() > 0.99);
    let lit = model.shape("balcony", "stucco", broad);
    let detail = model.shape("balcony_detail", "stucco", thin);
    // Consoles below.
    for x in [-0.8, 0.8] {
        let section = [[-0.05, -0.14], [0.7, -0.14], [0.6, -0.26], [0.12, -0.62], [-0.05, -0.66]];
        let (sides, ends) = prism(&section, x - 0.09, x + 0.09);
        model.shape("balcony_detail", "stucco", sides.into_iter().fold(ends, Mesh::with));
    }
    let corners = [
        DVec3::new(-HALF + 0.06, -FLOOR, -0.05),
        DVec3::new(-HALF + 0.06, -FLOOR, OUT - 0.06),
        DVec3::new(HALF - 0.06, -FLOOR, OUT - 0.06),
        DVec3::new(HALF - 0.06, -FLOOR, -0.05),
    ];
    model.shape("balcony_detail", "iron", railing(&corners));
    vec![lit, detail]
}

/// Rails and bars along a line on the ground, with a scroll of rings under the hand rail.
pub fn railing(line: &[DVec3]) -> Mesh {
    let mut mesh = Mesh::default();
    for pair in line.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        for (y, r) in [(RAIL, 0.024), (0.1, 0.014), (RAIL - 0.16, 0.01)] {
            mesh.append(tube(&[(a + DVec3::Y * y, r), (b + DVec3::Y * y, r)], 6));
        }
        let bars = ((b - a).length() / 0.115).round() as usize;
        for k in 0..bars {
            let foot = a.lerp(b, (k as f64 + 0.5) / bars as f64);
            let bar = [(foot + DVec3::Y * 0.1, 0.0085), (foot + DVec3::Y * RAIL, 0.0085)];
            mesh.append(tube_side(&bar, 5));
        }
    }
    for &post in line {
        mesh.append(tube(&[(post - DVec3::Y * 0.02, 0.02), (post + DVec3::Y * (RAIL + 0.05), 0.02)], 8));
    }
    mesh
}

/// A bay window: its storey with the floor at y = 0, what carries it and what covers it.
pub struct Bay {
    storey: Vec<usize>,
    foot: usize,
    head: usize,
}

impl Bay {
    /// Builds it in a wall material, not yet placed.
    pub fn new(model: &mut Model, material: &str) -> Self {
        let [w, h] = Kind::Tall.size();
        let sill = Kind::Tall.sill();
        let hole = [-w / 2.0, sill, w / 2.0, sill + h];
        let name = format!("bay_{material}");
        let (us, vs, filled) = grid([-BAY_HALF, 0.0, BAY_HALF, STOREY], &[hole]);
        let front = sheet(&us, &vs, filled, |u, v| DVec3::new(u, v, BAY_OUT));
        let lit = model.shape(&name, material, front);
        // A narrow pane in each side.
        let narrow = [0.2, sill, BAY_OUT - 0.2, sill + h];
        let detail = format!("{name}_detail");
        let mut panes = Mesh::default();
        for side in [-1.0, 1.0] {
            // Seen from outside, u runs towards the street on the left side and away from it on the right
            // one; both begin inside the wall.
            let cheek = if side < 0.0 {
                let (us, vs, filled) = grid([-0.05, 0.0, BAY_OUT, STOREY], &[narrow]);
                sheet(&us, &vs, filled, |u, v| DVec3::new(-BAY_HALF, v, u))
            } else {
                let (us, vs, filled) = grid([0.0, 0.0, BAY_OUT + 0.05, STOREY], &[narrow]);
                sheet(&us, &vs, filled, |u, v| DVec3::new(BAY_HALF, v, BAY_OUT - u))
            };
            model.shape(&name, material, cheek);
            let depth = 0.12;
            let x = side * (BAY_HALF - depth);
            let (a, b) = if side < 0.0 { (narrow[0], narrow[2]) } else { (narrow[2], narrow[0]) };
            panes.quad(
                DVec3::new(x, sill, a),
                DVec3::new(x, sill, b),
                DVec3::new(x, sill + h, b),
                DVec3::new(x, sill + h, a),
            );
            let reveal = super::openings::reveal(narrow[2] - narrow[0], h, depth)
                .turned(90.0 * side)
                .translated(side * BAY_HALF, sill, BAY_OUT / 2.0);
            model.shape(&detail, "white_wood", reveal);
        }
        let detail = model.shape(&detail, "glass", panes);
        let slab = |y0: f64, y1: f64, out: f64| {
            bevelled([-BAY_HALF - out, y0, -0.1], [BAY_HALF + out, y1, BAY_OUT + out], 0.02)
        };
        model.shape(&format!("{name}_detail"), "stucco", slab(0.0, 0.18, 0.06));
        // Three consoles carry it; a copper roof covers it.
        let mut foot =
            bevelled([-BAY_HALF - 0.03, -0.3, -0.1], [BAY_HALF + 0.03, 0.06, BAY_OUT + 0.03], 0.03);
        let section =
            [[-0.05, -0.28], [BAY_OUT - 0.1, -0.28], [BAY_OUT - 0.2, -0.5], [0.1, -1.1], [-0.05, -1.15]];
        for x in [-0.9, 0.0, 0.9] {
            let (sides, ends) = prism(&section, x - 0.12, x + 0.12);
            foot.append(sides.into_iter().fold(ends, Mesh::with));
        }
        let foot = model.shape(&format!("{name}_foot_detail"), "stucco", foot);
        let head_name = format!("{name}_head_detail");
        let head = model.shape(&head_name, "stucco", slab(-0.12, 0.12, 0.14));
        let section = [[-0.05, 0.1], [BAY_OUT + 0.06, 0.1], [BAY_OUT + 0.06, 0.16], [-0.05, 0.62]];
        let (sides, ends) = prism(&section, -BAY_HALF - 0.05, BAY_HALF + 0.05);
        model.shape(&head_name, "copper", sides.into_iter().fold(ends, Mesh::with));
        Self { storey: vec![lit, detail], foot, head }
    }

    /// Places a bay of some storeys at a site in the façade's plane.
    pub fn place(
        &self,
        model: &mut Model,
        site: super::Site,
        storeys: usize,
        openings: &Openings,
        filling: impl Fn(usize) -> usize,
    ) {
        site.place(model, &[self.foot]);
        for s in 0..storeys {
            let y = s as f64 * STOREY;
            site.within(0.0, y, 0.0, 0.0).place(model, &self.storey);
            let window = openings.window(Kind::Tall, filling(s));
            site.within(0.0, y + Kind::Tall.sill(), BAY_OUT, 0.0).place(model, window);
        }
        site.within(0.0, storeys as f64 * STOREY, 0.0, 0.0).place(model, &[self.head]);
    }
}

/// A window box with its soil, about the middle of its back's foot.
pub fn flower_box(model: &mut Model) -> Vec<usize> {
    let body = bevelled([-0.5, -0.02, 0.02], [0.5, 0.17, 0.22], 0.015);
    let detail = model.shape("flower_box_detail", "clay", body);
    model.shape("flower_box_detail", "soil", block([-0.47, 0.1, 0.05], [0.47, 0.178, 0.19], ALL & !BOTTOM));
    let leaves =
        crate::foliage::shrub(DVec3::new(0.0, 0.22, 0.12), DVec3::new(0.48, 0.16, 0.1), 34, 0.12..0.2, 71);
    let leaves = model.shape("leaves_flower_box", "leaves", leaves);
    vec![detail, leaves]
}
