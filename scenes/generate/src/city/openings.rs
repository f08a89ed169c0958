//! Windows, each built once about the middle of its foot in the façade's plane, and placed many times.

use super::site::turned_over;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, steps};
use crate::shapes::{ALL, BOTTOM, NORTH, SOUTH, bevelled, block};
use crate::soft::frame;
use glam::DVec3;

/// How far panes stand back from the façade.
pub const RECESS: f64 = 0.24;

/// A kind of window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// With a moulded surround and a hood.
    Tall,
    /// Smaller, with louvred shutters.
    Shuttered,
    /// To the floor, for balconies.
    French,
    /// With a stone lintel, for brick.
    Sash,
}

/// In the order of their numbers.
pub const KINDS: [Kind; 4] = [Kind::Tall, Kind::Shuttered, Kind::French, Kind::Sash];

impl Kind {
    /// Width and height of the opening.
    pub fn size(self) -> [f64; 2] {
        match self {
            Kind::Tall => [1.2, 2.0],
            Kind::Shuttered => [1.05, 1.7],
            Kind::French => [1.3, 2.5],
            Kind::Sash => [1.15, 1.9],
        }
    }

    /// Height of the opening's foot above the floor.
    pub fn sill(self) -> f64 {
        match self {
            Kind::Tall => 0.75,
            Kind::Shuttered => 0.9,
            Kind::French => 0.12,
            Kind::Sash => 0.8,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Kind::Tall => "tall",
            Kind::Shuttered => "shuttered",
            Kind::French => "french",
            Kind::Sash => "sash",
        }
    }
}

/// What stands behind the panes: nothing, curtains, a blind, or a lamp in the evening.
pub const FILLINGS: usize = 4;
/// Meshes of every kind with every filling.
pub struct Openings {
    windows: Vec<Vec<usize>>,
}

impl Openings {
    /// Builds them, not yet placed.
    pub fn new(model: &mut Model) -> Self {
        let mut windows = Vec::new();
        for kind in KINDS {
            let [w, h] = kind.size();
            let name = kind.name();
            let detail = model.shape(&format!("window_{name}_detail"), "stucco", surround(kind));
            model.shape(&format!("window_{name}_detail"), "white_wood", casement(w, h));
            let pane = model.shape(&format!("pane_{name}"), "glass", pane(w, h));
            let home = model.shape(&format!("home_{name}"), "drapes", self::pane(w, h));
            let curtains = model.shape(&format!("curtains_{name}_detail"), "linen", curtains(w, h));
            let blind = block([-w / 2.0, h * 0.55, -RECESS], [w / 2.0, h, -RECESS + 0.01], SOUTH | BOTTOM);
            let blind = model.shape(&format!("blind_{name}_detail"), "linen", blind);
            windows.push(vec![detail, pane]);
            windows.push(vec![detail, pane, curtains]);
            windows.push(vec![detail, pane, blind]);
            windows.push(vec![detail, home]);
        }
        Self { windows }
    }

    /// The meshes of a window.
    pub fn window(&self, kind: Kind, filling: usize) -> &[usize] {
        let row = KINDS.iter().position(|&k| k == kind).expect("a known kind");
        &self.windows[row * FILLINGS + filling]
    }
}

/// The pane, as large as the opening.
fn pane(w: f64, h: f64) -> Mesh {
    block([-w / 2.0, 0.0, -1.0], [w / 2.0, h, -RECESS], SOUTH)
}

/// The opening's sides, from the façade to the pane.
pub fn reveal(w: f64, h: f64, depth: f64) -> Mesh {
    let (x, p) = (w / 2.0, DVec3::new);
    let mut mesh = Mesh::default();
    mesh.quad(p(-x, 0.0, 0.0), p(-x, 0.0, -depth), p(-x, h, -depth), p(-x, h, 0.0));
    mesh.quad(p(x, 0.0, -depth), p(x, 0.0, 0.0), p(x, h, 0.0), p(x, h, -depth));
    mesh.quad(p(-x, h, -depth), p(x, h, -depth), p(x, h, 0.0), p(-x, h, 0.0));
    mesh.quad(p(-x, 0.0, 0.0), p(x, 0.0, 0.0), p(x, 0.0, -depth), p(-x, 0.0, -depth));
    mesh
}

/// Reveals, sill, and what frames the opening on the façade.
fn surround(kind: Kind) -> Mesh {
    let [w, h] = kind.size();
    let mut mesh = reveal(w, h, RECESS);
    let sill = |out: f64, proud: f64| bevelled([-out, -0.1, -RECESS + 0.01], [out, 0.025, proud], 0.015);
    let architrave = |width: f64| {
        let profile = [
            [width, -0.02],
            [width, 0.035],
            [width * 0.55, 0.05],
            [width * 0.4, 0.085],
            [0.0, 0.085],
            [0.0, -0.02],
        ];
        let (x, y) = (DVec3::X * (w / 2.0 + width), DVec3::Y * (h / 2.0 + width));
        frame(DVec3::Y * (h / 2.0), x, y, DVec3::Z, &profile)
    };
    match kind {
        Kind::Tall => {
            mesh.append(architrave(0.17));
            mesh.append(sill(w / 2.0 + 0.22, 0.17));
            let lintel =
                block([-w / 2.0 - 0.16, h + 0.15, -0.02], [w / 2.0 + 0.16, h + 0.3, 0.07], ALL & !NORTH);
            let hood = bevelled([-w / 2.0 - 0.26, h + 0.28, -0.05], [w / 2.0 + 0.26, h + 0.38, 0.26], 0.03);
            mesh.append(lintel.with(hood));
            for side in [-1.0, 1.0] {
                let x = side * (w / 2.0 + 0.12);
                mesh.append(bevelled([x - 0.05, h + 0.05, -0.02], [x + 0.05, h + 0.3, 0.17], 0.02));
                mesh.append(bevelled([x - 0.05, -0.3, -0.02], [x + 0.05, -0.08, 0.12], 0.02));
            }
        }
        Kind::Shuttered => {
            mesh.append(sill(w / 2.0 + 0.1, 0.13));
            for side in [-1.0, 1.0] {
                mesh.append(shutter(w / 2.0, h).translated(side * (w * 0.75 + 0.04), 0.0, 0.0));
            }
        }
        Kind::French => mesh.append(architrave(0.14)),
        Kind::Sash => {
            mesh.append(sill(w / 2.0 + 0.12, 0.12));
            let lintel =
                bevelled([-w / 2.0 - 0.16, h - 0.005, -0.05], [w / 2.0 + 0.16, h + 0.3, 0.045], 0.012);
            let key = bevelled([-0.11, h - 0.05, -0.05], [0.11, h + 0.38, 0.08], 0.015);
            mesh.append(lintel.with(key));
        }
    }
    mesh
}

/// A louvred shutter folded back against the wall, about x = 0.
fn shutter(w: f64, h: f64) -> Mesh {
    let (x, bar) = (w / 2.0, 0.06);
    let mut mesh = block([-x, -0.02, -0.02], [-x + bar, h + 0.02, 0.055], ALL & !NORTH);
    mesh.append(block([x - bar, -0.02, -0.02], [x, h + 0.02, 0.055], ALL & !NORTH));
    for y in [0.0, h / 2.0, h] {
        mesh.append(block([-x + 0.01, y - 0.04, -0.02], [x - 0.01, y + 0.04, 0.048], ALL & !NORTH));
    }
    let slats = (h / 0.095) as usize;
    for y in steps(0.07, h - 0.07, slats) {
        let slat = full(&[-x + 0.02, x - 0.02], &[0.0, 1.0], |u, t| {
            DVec3::new(u, y - 0.04 + 0.085 * t, 0.042 - 0.04 * t)
        });
        mesh.append(slat);
    }
    mesh
}

/// The wooden frame with its bars.
fn casement(w: f64, h: f64) -> Mesh {
    let (x, back, bar) = (w / 2.0, -RECESS - 0.01, 0.075);
    let wood = |x0: f64, y0: f64, x1: f64, y1: f64, front: f64| {
        block([x0, y0, back], [x1, y1, -RECESS + front], ALL & !NORTH)
    };
    let high = h * 0.7;
    let mut mesh = wood(-x - 0.01, 0.0, -x + bar, h, 0.07).with(wood(x - bar, 0.0, x + 0.01, h, 0.07));
    mesh.append(wood(-x, -0.01, x, bar, 0.064).with(wood(-x, h - bar, x, h + 0.01, 0.064)));
    mesh.append(wood(-0.05, 0.01, 0.05, h - 0.01, 0.075));
    mesh.append(wood(-x, high - 0.04, x, high + 0.04, 0.08));
    for side in [-1.0, 1.0] {
        let middle = side * (x - bar + 0.05) / 2.0;
        mesh.append(wood(middle - 0.015, high, middle + 0.015, h - 0.02, 0.03));
    }
    mesh.append(wood(-x, high / 2.0 - 0.018, x, high / 2.0 + 0.018, 0.034));
    mesh
}

/// Curtains behind the pane's edges, a little in front of it so that they are seen.
fn curtains(w: f64, h: f64) -> Mesh {
    let x = w / 2.0;
    let mut mesh = Mesh::default();
    for side in [-1.0, 1.0] {
        let fold = |u: f64, v: f64| {
            let at = side * (x - 0.02 - u * (0.14 + 0.1 * (v / h)) * 2.0 * x);
            DVec3::new(at, v, -RECESS + 0.012 + 0.008 * (u * 25.0).sin())
        };
        let us = steps(0.0, 1.0, 8);
        let vs = [0.03, h * 0.5, h - 0.03];
        let sheet = full(&us, &vs, fold);
        mesh.append(if side < 0.0 { sheet } else { turned_over(sheet) });
    }
    mesh
}
