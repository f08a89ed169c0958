//! A bookcase against the east wall, two columns of five shelves, full of books.

use super::HALF_X;
use super::dining::vase;
use crate::model::Model;
use crate::random::Random;
use crate::relief::steps;
use crate::shapes::{ALL, bevelled, block};
use crate::soft::slab;
use glam::DVec3;
use std::f64::consts::TAU;

/// Book covers and their albedos.
pub const COVERS: [(&str, [f64; 3]); 6] = [
    ("cover_red", [0.36, 0.08, 0.06]),
    ("cover_blue", [0.08, 0.14, 0.30]),
    ("cover_green", [0.10, 0.22, 0.12]),
    ("cover_sand", [0.62, 0.52, 0.34]),
    ("cover_black", [0.07, 0.07, 0.07]),
    ("cover_white", [0.72, 0.70, 0.66]),
];

/// Front, and back just off the skirting.
const X: [f64; 2] = [HALF_X - 0.34, HALF_X - 0.02];
/// Ends.
const Z: [f64; 2] = [-1.5, 0.3];
/// Of the whole.
const HIGH: f64 = 1.95;
/// Of a board.
const BOARD: f64 = 0.025;

pub fn build(model: &mut Model) {
    let ([x0, x1], [z0, z1]) = (X, Z);
    // Boards are sunk into each other by 5 mm and set back by a few, so that no faces coincide.
    for z in [z0, z1 - BOARD] {
        let side = bevelled([x0, -0.01, z], [x1, HIGH, z + BOARD], 0.002);
        model.add_split("bookcase", "walnut", side, |n| n.z.abs() > 0.99);
    }
    let back = block([x1 - 0.012, 0.05, z0 + 0.01], [x1 - 0.003, HIGH - 0.01, z1 - 0.01], ALL);
    model.add_split("bookcase", "walnut", back, |n| n.x < -0.99);
    let middle = (z0 + z1) / 2.0;
    let divider = bevelled(
        [x0 + 0.006, 0.06, middle - BOARD / 2.0],
        [x1 - 0.005, HIGH - 0.012, middle + BOARD / 2.0],
        0.002,
    );
    model.add_split("bookcase", "walnut", divider, |n| n.z.abs() > 0.99);
    let levels = steps(0.08, HIGH - BOARD - 0.003, 5);
    for &y in &levels {
        let shelf =
            bevelled([x0 + 0.003, y, z0 + BOARD - 0.005], [x1 - 0.004, y + BOARD, z1 - BOARD + 0.005], 0.002);
        model.add_split("bookcase", "walnut", shelf.grain_turned(), |n| n.y.abs() > 0.99);
    }
    let plinth = block([x0 + 0.03, -0.01, z0 + 0.01], [x0 + 0.05, 0.09, z1 - 0.01], ALL);
    model.add("bookcase_detail", "walnut", plinth);
    let shapes: Vec<usize> = COVERS.iter().map(|(cover, _)| book(model, cover)).collect();
    let mut random = Random::new(5);
    for (row, pair) in levels.windows(2).enumerate() {
        let (floor, room) = (pair[0] + BOARD, pair[1] - pair[0] - BOARD);
        for (column, (a, b)) in
            [(z0 + BOARD, middle - BOARD / 2.0), (middle + BOARD / 2.0, z1 - BOARD)].into_iter().enumerate()
        {
            let mut z = a + 0.004;
            // Most shelves are full; some leave room for a vase or a gap.
            let end = match (row + 2 * column) % 5 {
                1 => b - 0.3,
                3 => b - 0.16,
                _ => b - 0.01,
            };
            if (row + 2 * column) % 5 == 1 {
                let vase = vase(room * 0.7).translated((x0 + x1) / 2.0 - 0.02, floor - 0.002, b - 0.14);
                let glaze = if column == 0 { "porcelain" } else { "blue_glaze" };
                model.add("vases_detail", glaze, vase);
            }
            // Books come in runs of one size, as editions do.
            let (mut left, mut size, mut cover) = (0, DVec3::ZERO, 0);
            loop {
                if left == 0 {
                    left = random.range(1.0, 6.0) as usize;
                    let high = room * random.range(0.62, 0.92);
                    size = DVec3::new(random.range(0.14, 0.22), high, random.range(0.018, 0.045));
                    cover = random.range(0.0, 6.0) as usize % 6;
                }
                let thick = size.z * random.range(0.8, 1.2);
                if z + thick > end {
                    break;
                }
                let front = x0 + 0.02 + random.range(0.0, 0.02);
                let at = DVec3::new(front, floor - 0.001, z);
                model.place_all(&[shapes[cover]], at, 0.0, DVec3::new(size.x, size.y, thick));
                z += thick + random.range(0.0008, 0.002);
                left -= 1;
            }
        }
    }
}

/// A closed book in the unit cube, spine at x = 0, upright.
fn book(model: &mut Model, cover: &str) -> usize {
    // Around the book: from the fore-edge along one board, over the round spine, back along the other.
    let (round, steps_round) = (0.06, 8);
    let path = |k: f64, inner: f64| {
        let turn = (k - 1.0) / steps_round as f64;
        let (x, z) = match turn {
            t if t < 0.0 => (1.0, 0.0),
            t if t > 1.0 => (1.0, 1.0),
            t => {
                let (sin, cos) = (t * TAU / 2.0).sin_cos();
                (round * (1.0 - sin), 0.5 - 0.5 * cos)
            }
        };
        (x + inner * 0.03 * f64::from((0.0..=1.0).contains(&turn)), 0.5 + (z - 0.5) * (1.0 - 0.2 * inner))
    };
    let count = steps_round + 2;
    let shell = slab(&steps(0.0, count as f64, count), &[0.0, 1.0], |k, y, s| {
        let (x, z) = path(k, 1.0 - s);
        DVec3::new(x, y, z)
    });
    let name = format!("{cover}_detail");
    model.shape(&name, cover, shell.front.with(shell.back).with(shell.edges));
    model.shape(&name, "paper", block([0.05, 0.02, 0.08], [0.97, 0.98, 0.92], ALL))
}
