//! Shop fronts: an alcove behind each shop window, with goods in it and a lamp under its ceiling; sign and
//! awning.

use super::Site;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use crate::relief::{Rect, full, steps};
use crate::shapes::{ALL, TOP, bevelled, block, lathe, tube};
use crate::soft::cushion;
use glam::{DAffine3, DVec3};

/// Half the width, foot and top of a shop window.
const HALF: f64 = 1.75;
const SILL: f64 = 0.7;
const HEAD: f64 = 3.3;
/// Depth of the alcove behind it.
const ALCOVE: f64 = 1.15;

/// What is sold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shop {
    /// Bread; opens early.
    Bakery,
    /// Clothes.
    Fashion,
    /// Books and boxes.
    Books,
    /// Coffee; closes late.
    Cafe,
}

/// In the order of their numbers.
const SHOPS: [Shop; 4] = [Shop::Bakery, Shop::Fashion, Shop::Books, Shop::Cafe];

/// The hole of a shop window about x.
pub fn opening(x: f64) -> Rect {
    [x - HALF, SILL, x + HALF, HEAD]
}

/// Meshes of each shop.
pub struct Shops(Vec<Vec<usize>>);

impl Shops {
    /// Builds them, not yet placed.
    pub fn new(model: &mut Model) -> Self {
        let alcove = model.shape("alcove", "paper", alcove());
        model.shape("alcove", "oak", block([-HALF, 0.0, -ALCOVE], [HALF, SILL, 0.0], TOP));
        let shops = SHOPS.map(|shop| {
            let (name, wood, awning) = match shop {
                Shop::Bakery => ("bakery", "red_wood", Some("canvas")),
                Shop::Fashion => ("fashion", "green_wood", None),
                Shop::Books => ("books", "blue_wood", Some("green_awning")),
                Shop::Cafe => ("cafe", "green_wood", Some("red_awning")),
            };
            let (sign, detail) = (format!("sign_{name}"), format!("shop_{name}_detail"));
            let board = bevelled([-HALF - 0.2, HEAD + 0.12, -0.05], [HALF + 0.2, HEAD + 0.72, 0.1], 0.02);
            let (front, rest) = board.split(|n| n.z > 0.99);
            let mut meshes = vec![alcove, model.shape(&sign, wood, front), model.shape(&detail, wood, rest)];
            model.shape(&detail, wood, front_wood());
            model.shape(&detail, "stucco", lettering(shop as u64));
            goods(model, &detail, shop);
            if let Some(cloth) = awning {
                let (lit, iron) = self::awning();
                meshes.push(model.shape(&format!("awning_{name}"), cloth, lit));
                model.shape(&detail, "iron", iron);
            }
            meshes
        });
        Self(shops.into())
    }

    /// Places a shop at the middle of its window's foot line, in the façade's plane.
    pub fn place(&self, model: &mut Model, site: &Site, shop: Shop) {
        let row = SHOPS.iter().position(|&s| s == shop).expect("a known shop");
        site.place(model, &self.0[row]);
    }
}

/// Back, cheeks and ceiling.
fn alcove() -> Mesh {
    let p = DVec3::new;
    let (back, w) = (-ALCOVE, HALF);
    let mut mesh = Mesh::default();
    mesh.quad(p(-w, SILL, back), p(w, SILL, back), p(w, HEAD, back), p(-w, HEAD, back));
    mesh.quad(p(-w, SILL, 0.0), p(-w, SILL, back), p(-w, HEAD, back), p(-w, HEAD, 0.0));
    mesh.quad(p(w, SILL, back), p(w, SILL, 0.0), p(w, HEAD, 0.0), p(w, HEAD, back));
    mesh.quad(p(-w, HEAD, back), p(w, HEAD, back), p(w, HEAD, 0.0), p(-w, HEAD, 0.0));
    mesh
}

/// Panelled riser, sill, mullions, pilasters with capitals, and the cornice over the sign.
fn front_wood() -> Mesh {
    let bar = |x0: f64, y0: f64, x1: f64, y1: f64, back: f64, front: f64| {
        bevelled([x0, y0, back], [x1, y1, front], 0.012)
    };
    let mut mesh = bar(-HALF, 0.08, HALF, SILL - 0.02, -0.05, 0.05);
    for k in 0..3 {
        let x = -HALF + 2.0 * HALF * (k as f64 + 0.5) / 3.0;
        mesh.append(bar(x - 0.45, 0.22, x + 0.45, SILL - 0.12, 0.0, 0.075));
    }
    mesh.append(bar(-HALF - 0.02, SILL - 0.05, HALF + 0.02, SILL + 0.05, -0.1, 0.13));
    for x in [-HALF / 3.0, HALF / 3.0] {
        mesh.append(bar(x - 0.025, SILL, x + 0.025, HEAD, -0.08, -0.02));
    }
    mesh.append(bar(-HALF - 0.01, 2.65, HALF + 0.01, 2.71, -0.085, -0.015));
    mesh.append(bar(-HALF - 0.01, HEAD - 0.06, HALF + 0.01, HEAD + 0.02, -0.09, -0.01));
    for side in [-1.0, 1.0] {
        let x = side * (HALF + 0.1);
        mesh.append(bar(x - 0.13, 0.08, x + 0.13, HEAD + 0.13, -0.05, 0.07));
        mesh.append(bar(x - 0.16, 0.08, x + 0.16, 0.35, -0.05, 0.1));
        mesh.append(bar(x - 0.16, HEAD - 0.1, x + 0.16, HEAD + 0.14, -0.05, 0.11));
    }
    mesh.append(bar(-HALF - 0.3, HEAD + 0.7, HALF + 0.3, HEAD + 0.8, -0.05, 0.22));
    mesh
}

/// Raised bars that read as letters from across the street.
fn lettering(seed: u64) -> Mesh {
    let mut random = Random::new(400 + seed);
    let mut mesh = Mesh::default();
    let (y0, y1) = (HEAD + 0.28, HEAD + 0.56);
    let stroke = |x0: f64, y0: f64, x1: f64, y1: f64| bevelled([x0, y0, 0.06], [x1, y1, 0.125], 0.008);
    let count = 6 + seed as usize % 4;
    for k in 0..count {
        let x = (k as f64 - count as f64 / 2.0) * 0.3 + 0.05;
        mesh.append(stroke(x, y0, x + 0.05, y1));
        let high = [y0, (y0 + y1) / 2.0 - 0.02, y1 - 0.05];
        for y in high {
            if random.range(0.0, 1.0) > 0.35 {
                mesh.append(stroke(x + 0.03, y + 0.002, x + 0.19, y + 0.047));
            }
        }
        if random.range(0.0, 1.0) > 0.5 {
            mesh.append(stroke(x + 0.16, y0 - 0.003, x + 0.21, y1 + 0.003));
        }
    }
    mesh
}

/// What stands in the window.
fn goods(model: &mut Model, detail: &str, shop: Shop) {
    let mut random = Random::new(500 + shop as u64);
    let floor = SILL;
    match shop {
        Shop::Bakery | Shop::Cafe => {
            // Shelves, each with loaves or cups.
            for (y, z) in [(floor + 0.25, -0.42), (floor + 0.62, -0.72), (floor + 1.0, -0.95)] {
                let board = bevelled([-1.5, y - 0.03, z - 0.17], [1.5, y, z + 0.17], 0.008);
                model.shape(detail, "oak", board);
                for x in [-1.4, 0.0, 1.4] {
                    model.shape(
                        detail,
                        "iron",
                        block([x - 0.02, floor, z - 0.02], [x + 0.02, y - 0.01, z + 0.02], ALL),
                    );
                }
                for k in 0..9 {
                    let x = -1.35 + 0.335 * f64::from(k);
                    if shop == Shop::Bakery {
                        let long = random.range(0.11, 0.15);
                        let loaf = cushion(DVec3::new(long, 0.055, 0.075), 0.05, 2, 1, DVec3::ZERO)
                            .turned(random.range(-25.0, 25.0))
                            .translated(x, y + 0.05, z);
                        model.shape(detail, "bread", loaf);
                    } else {
                        let cup = lathe(
                            &[
                                &[(0.045, 0.0), (0.07, 0.11)],
                                &[(0.07, 0.11), (0.055, 0.11)],
                                &[(0.055, 0.11), (0.0, 0.03)],
                            ],
                            12,
                        );
                        model.shape(detail, "paper", cup.translated(x, y - 0.005, z));
                    }
                }
            }
        }
        Shop::Fashion => {
            for (x, cloth, turn) in
                [(-1.1, "red_cloth", 20.0), (0.05, "blue_cloth", -15.0), (1.15, "mustard", -30.0)]
            {
                let at = |mesh: Mesh| mesh.turned(turn).translated(x, floor, -0.55);
                let stand =
                    lathe(&[&[(0.16, 0.0), (0.16, 0.02)], &[(0.16, 0.02), (0.02, 0.03), (0.018, 0.6)]], 12);
                model.shape(detail, "steel", at(stand));
                let dress = lathe(
                    &[&[(0.31, 0.48), (0.24, 0.75), (0.145, 1.05), (0.19, 1.32), (0.17, 1.42), (0.05, 1.48)]],
                    18,
                );
                let flat = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.68));
                model.shape(detail, cloth, at(dress.transformed(flat)));
                let under = lathe(&[&[(0.0, 0.5), (0.3, 0.485)]], 18);
                model.shape(detail, cloth, at(under.transformed(flat)));
                let head = lathe(
                    &[&[(0.045, 1.46), (0.045, 1.53), (0.085, 1.6), (0.09, 1.68), (0.05, 1.76), (0.0, 1.77)]],
                    14,
                );
                model.shape(detail, "linen", at(head));
            }
        }
        Shop::Books => {
            for k in 0..7 {
                let (x, z) = (-1.45 + 0.48 * f64::from(k), random.range(-0.8, -0.4));
                let mut y = floor - 0.01;
                for _ in 0..(random.range(3.0, 9.0) as usize) {
                    let (w, d, h) =
                        (random.range(0.1, 0.17), random.range(0.08, 0.12), random.range(0.03, 0.09));
                    let cover =
                        ["red_cloth", "blue_cloth", "mustard", "paper"][random.range(0.0, 4.0) as usize];
                    let book = bevelled([-w, 0.0, -d], [w, h + 0.004, d], 0.004)
                        .turned(random.range(-20.0, 20.0))
                        .translated(x, y, z);
                    model.shape(detail, cover, book);
                    y += h;
                }
            }
        }
    }
}

/// A cloth that falls from above the sign, with a scalloped valance, on two arms.
fn awning() -> (Mesh, Mesh) {
    let (top, foot, out) = (HEAD + 0.1, HEAD - 0.5, 1.35);
    let half = HALF + 0.15;
    let slope = full(&steps(-half, half, 14), &steps(0.0, 1.0, 4), |x, t| {
        let sag = 0.05 * (std::f64::consts::PI * t).sin();
        DVec3::new(x, foot + (top - foot) * t - sag, 0.12 + (out - 0.12) * (1.0 - t))
    });
    let valance = full(&steps(-half, half, 56), &[0.0, 1.0], |x, t| {
        let scallop = 0.05 * (x * 14.0).sin().abs();
        DVec3::new(x, foot - (1.0 - t) * (0.16 + scallop), out + 0.004)
    });
    let mut iron = Mesh::default();
    for x in [-half + 0.1, half - 0.1] {
        let arm = [(DVec3::new(x, foot - 0.35, 0.05), 0.018), (DVec3::new(x, foot + 0.0, out - 0.02), 0.018)];
        iron.append(tube(&arm, 6));
    }
    let rod = [
        (DVec3::new(-half, foot - 0.02, out - 0.015), 0.02),
        (DVec3::new(half, foot - 0.02, out - 0.015), 0.02),
    ];
    iron.append(tube(&rod, 6));
    (slope.with(valance), iron)
}
