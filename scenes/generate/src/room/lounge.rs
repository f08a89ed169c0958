//! The sofa corner: sofa, armchair, coffee table, rug, a basket.

use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::steps;
use crate::shapes::{bevelled, lathe, tube, tube_side};
use crate::soft::cushion;
use glam::{DAffine3, DVec3};
use std::f64::consts::TAU;

/// The rug on the floor: x0, z0, x1, z1.
pub const RUG: [f64; 4] = [-2.5, -1.2, -0.4, 0.6];
/// Its upper side.
const PILE: f64 = 0.012;
/// The sofa's middle.
const SOFA: DVec3 = DVec3::new(-1.45, 0.0, -1.88);

pub fn build(model: &mut Model) {
    rug(model);
    sofa(model);
    let chair = armchair(model);
    model.place_all(&chair, DVec3::new(-0.7, 0.0, 1.4), 205.0, DVec3::ONE);
    coffee_table(model, DVec3::new(-1.4, PILE, -0.4));
    basket(model, DVec3::new(-2.72, 0.0, -0.95));
}

/// A cushion of the usual fineness: rounded by `radius`, tilted about x, then moved.
fn pad(half: [f64; 3], radius: f64, puff: [f64; 3], tilt: f64, at: [f64; 3]) -> Mesh {
    cushion(half.into(), radius, 4, 8, puff.into())
        .transformed(DAffine3::from_translation(at.into()) * DAffine3::from_rotation_x(tilt))
}

/// Wool, lit on top, with fringes at both ends.
fn rug(model: &mut Model) {
    let [x0, z0, x1, z1] = RUG;
    let body = bevelled([x0, -0.02, z0], [x1, PILE, z1], 0.006).standing();
    model.add_split("rug", "rug", body, |n| n.y > 0.99);
    for (x, out) in [(x0, -1.0), (x1, 1.0)] {
        for z in steps(z0 + 0.01, z1 - 0.01, 90) {
            let sway = 0.01 * ((z * 37.0).sin() + 0.5 * (z * 91.0).sin());
            let tassel = [
                (DVec3::new(x - out * 0.01, 0.005, z), 0.004),
                (DVec3::new(x + out * 0.03, 0.004, z + sway * 0.5), 0.003),
                (DVec3::new(x + out * 0.065, 0.003, z + sway), 0.002),
            ];
            model.add("rug_detail", "paper", tube(&tassel, 5));
        }
    }
}

/// Two seats wide, against the north wall.
fn sofa(model: &mut Model) {
    let sides = |n: DVec3| n.y.abs() < 0.9;
    let upper = |n: DVec3| n.y > -0.9;
    let none = [0.0; 3];
    let at = |mesh: Mesh| mesh.translated(SOFA.x, SOFA.y, SOFA.z);
    let mut add = |part: Mesh, lit: &dyn Fn(DVec3) -> bool| model.add_split("sofa", "sofa", at(part), lit);
    add(pad([0.97, 0.12, 0.42], 0.03, none, 0.0, [0.0, 0.24, 0.0]), &sides);
    add(pad([0.95, 0.33, 0.09], 0.06, none, -0.06, [0.0, 0.49, -0.36]), &upper);
    for x in [-1.0, 1.0] {
        add(pad([0.11, 0.26, 0.45], 0.07, [0.01, 0.01, 0.0], 0.0, [x, 0.36, 0.0]), &upper);
        add(pad([0.44, 0.085, 0.34], 0.05, [0.0, 0.02, 0.01], 0.0, [x * 0.445, 0.43, 0.1]), &upper);
        add(pad([0.43, 0.21, 0.085], 0.06, [0.0, 0.01, 0.03], -0.2, [x * 0.445, 0.70, -0.2]), &upper);
    }
    for (x, turn, material) in [(-0.66, 24.0, "pillow"), (0.6, -18.0, "red_pillow")] {
        let pillow = pad([0.2, 0.2, 0.045], 0.04, [0.0, 0.0, 0.05], -0.42, [0.0; 3]).turned(turn);
        model.add("pillows", material, at(pillow.translated(x, 0.685, 0.03)));
    }
    for (x, z) in [(-0.9, -0.36), (0.9, -0.36), (-0.9, 0.36), (0.9, 0.36)] {
        let leg = [(DVec3::new(x, 0.15, z), 0.026), (DVec3::new(x * 1.02, -0.01, z * 1.03), 0.016)];
        model.add("sofa_detail", "walnut", at(tube(&leg, 12)));
    }
}

/// An armchair that faces +Z.
fn armchair(model: &mut Model) -> Vec<usize> {
    let none = [0.0; 3];
    let mut lit = Mesh::default();
    let mut detail = Mesh::default();
    let mut add = |part: Mesh, wanted: fn(DVec3) -> bool| {
        let (broad, thin) = part.split(wanted);
        lit.append(broad);
        detail.append(thin);
    };
    add(pad([0.31, 0.09, 0.32], 0.03, none, 0.0, [0.0, 0.26, 0.0]), |n| n.y.abs() < 0.9);
    add(pad([0.3, 0.32, 0.08], 0.06, [0.0, 0.02, 0.02], -0.18, [0.0, 0.6, -0.3]), |n| n.y > -0.9);
    add(pad([0.265, 0.08, 0.29], 0.05, [0.0, 0.025, 0.01], 0.0, [0.0, 0.41, 0.05]), |n| n.y > -0.9);
    for x in [-0.34, 0.34] {
        add(pad([0.065, 0.2, 0.33], 0.05, none, 0.0, [x, 0.4, 0.0]), |n| n.y > -0.9);
    }
    let seat = model.shape("armchair", "armchair", lit);
    let under = model.shape("armchair_detail", "armchair", detail);
    for (x, z) in [(-0.28, -0.26), (0.28, -0.26), (-0.28, 0.26), (0.28, 0.26)] {
        let leg = [(DVec3::new(x, 0.2, z), 0.024), (DVec3::new(x * 1.1, -0.01, z * 1.12), 0.014)];
        model.shape("armchair_detail", "walnut", tube(&leg, 12));
    }
    vec![seat, under]
}

/// A round table on three legs, with books, a bowl of oranges and a cup.
fn coffee_table(model: &mut Model, foot: DVec3) {
    let at = |mesh: Mesh| mesh.translated(foot.x, foot.y, foot.z);
    let (r, y) = (0.44, 0.42);
    model.add("coffee_table", "walnut", at(lathe(&[&[(r - 0.012, y), (0.0, y)]], 64)));
    let rim: Vec<_> = steps(-0.5, 0.5, 8)
        .into_iter()
        .map(|t| (r - 0.012 + 0.014 * (t * TAU / 2.0).cos(), y - 0.014 + 0.014 * (t * TAU / 2.0).sin()))
        .collect();
    model.add(
        "coffee_table_detail",
        "walnut",
        at(lathe(&[&rim, &[(0.0, y - 0.028), (r - 0.012, y - 0.028)]], 64)),
    );
    for k in 0..3 {
        let (sin, cos) = ((k as f64 + 0.25) * TAU / 3.0).sin_cos();
        let leg = [
            (DVec3::new(0.26 * cos, y - 0.015, 0.26 * sin), 0.022),
            (DVec3::new(0.37 * cos, -0.006, 0.37 * sin), 0.013),
        ];
        model.add("coffee_table_detail", "walnut", at(tube(&leg, 14)));
    }
    // Books, each turned a little.
    let mut top = y;
    for (k, (size, turn, cover)) in [
        ([0.15, 0.03, 0.11], 12.0, "cover_green"),
        ([0.13, 0.022, 0.1], -8.0, "cover_red"),
        ([0.11, 0.028, 0.08], 25.0, "cover_sand"),
    ]
    .into_iter()
    .enumerate()
    {
        let [x, h, z]: [f64; 3] = size;
        let low = if k == 0 { 0.002 } else { 0.0005 };
        let body = |inset: f64, rise: f64, material: &str, model: &mut Model| {
            let block =
                bevelled([-x + inset, rise - low, -z + inset], [x - inset, h - rise, z - inset], 0.002);
            model.add("books_detail", material, at(block.turned(turn).translated(-0.13, top, -0.16)));
        };
        let boards = [(-low, 0.003), (h - 0.003, h)];
        for (a, b) in boards {
            let board = bevelled([-x, a, -z], [x, b, z], 0.001);
            model.add("books_detail", cover, at(board.turned(turn).translated(-0.13, top, -0.16)));
        }
        body(0.004, 0.001, "paper", model);
        top += h;
    }
    let bowl = bowl(0.13, 0.075);
    model.add("bowls_detail", "blue_glaze", at(bowl.translated(0.14, y - 0.002, 0.08)));
    for (x, h, z) in [(-0.035, 0.05, -0.02), (0.045, 0.05, -0.01), (0.0, 0.05, 0.055), (0.005, 0.105, 0.005)]
    {
        model.add("fruit_detail", "orange", at(ball(0.036).translated(0.14 + x, y + h, 0.08 + z)));
    }
    model.add("bowls_detail", "porcelain", at(cup().translated(-0.2, y - 0.001, 0.14)));
}

/// An open bowl standing on y = 0.
pub fn bowl(r: f64, h: f64) -> Mesh {
    let outer: Vec<_> =
        steps(0.0, 1.0, 10).into_iter().map(|t| (r * (0.4 + 0.6 * (t * TAU / 4.0).sin()), h * t)).collect();
    let inner: Vec<_> =
        outer.iter().rev().map(|&(x, y)| (x - 0.005, y.max(0.008))).filter(|&(_, y)| y > 0.0081).collect();
    let rim = [outer[10], inner[0]];
    let last = inner[inner.len() - 1];
    lathe(&[&[(0.0, 0.0), outer[0]], &outer, &rim, &inner, &[last, (0.0, last.1)]], 40)
}

/// A ball about the origin.
pub fn ball(r: f64) -> Mesh {
    let profile: Vec<_> = steps(-0.25, 0.25, 12)
        .into_iter()
        .map(|t| ((r * (t * TAU).cos()).max(0.0), r * (t * TAU).sin()))
        .enumerate()
        .map(|(k, (x, y))| (if k == 0 || k == 12 { 0.0 } else { x }, y))
        .collect();
    lathe(&[&profile], 20)
}

/// A cup with a handle, standing on y = 0.
pub fn cup() -> Mesh {
    let body = lathe(
        &[
            &[(0.0, 0.0), (0.024, 0.0)],
            &[(0.024, 0.0), (0.034, 0.02), (0.039, 0.05), (0.041, 0.085)],
            &[(0.041, 0.085), (0.038, 0.085)],
            &[(0.038, 0.085), (0.036, 0.05), (0.031, 0.02), (0.024, 0.008)],
            &[(0.024, 0.008), (0.0, 0.008)],
        ],
        28,
    );
    let handle: Vec<_> = steps(-0.25, 0.25, 10)
        .into_iter()
        .map(|t| {
            // Both ends stop inside the wall, which leans out.
            let (sin, cos) = (t * TAU).sin_cos();
            (DVec3::new(0.0362 + 0.0023 * sin + 0.026 * cos, 0.048 + 0.02 * sin, 0.0), 0.0035)
        })
        .collect();
    body.with(tube_side(&handle, 8))
}

/// A wicker basket with a rolled blanket.
fn basket(model: &mut Model, at: DVec3) {
    let side: Vec<_> = steps(0.0, 1.0, 36)
        .into_iter()
        .map(|t| {
            (0.17 + 0.05 * (t * TAU / 2.0).sin() + 0.004 * (t * 36.0 * TAU / 4.0).sin(), 0.34 * t - 0.005)
        })
        .collect();
    let inner: Vec<_> =
        side.iter().rev().map(|&(r, y)| (r - 0.012, y.max(0.02))).filter(|&(_, y)| y > 0.021).collect();
    let (rim, last) = ([side[36], inner[0]], inner[inner.len() - 1]);
    let body = lathe(&[&side, &rim, &inner, &[last, (0.0, last.1)]], 40);
    model.add("basket_detail", "wicker", body.translated(at.x, at.y, at.z));
    let roll = pad([0.08, 0.16, 0.08], 0.07, [0.01, 0.0, 0.01], 0.25, [at.x, at.y + 0.28, at.z]);
    model.add("basket_detail", "pillow", roll);
}
