//! The plants of the crop rows.

use super::foliage::card;
use super::terrain::{HALF, RIDGE, ROW, TRACK, YARD, point};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use glam::DVec3;

/// Length of the piece of crop row that is placed many times.
const PIECE: f64 = 4.0;

/// Rows of low leafy plants on their ridges.
pub fn build(model: &mut Model) {
    let pieces: Vec<usize> = (0..3).map(|k| piece(model, k)).collect();
    let mut random = Random::new(215);
    let rows = ((HALF - YARD) / ROW) as usize;
    for row in 2..rows - 1 {
        let v = YARD + row as f64 * ROW;
        let count = ((HALF - TRACK - 4.0) / PIECE) as usize;
        for k in 0..count {
            let u = TRACK + 2.0 + (k as f64 + 0.5) * PIECE;
            // A few pieces failed to grow.
            if random.range(0.0, 1.0) < 0.03 {
                continue;
            }
            let at = point(u, v) + DVec3::Y * RIDGE;
            let pick = random.range(0.0, pieces.len() as f64) as usize;
            let turn = if random.range(0.0, 1.0) < 0.5 { 0.0 } else { 180.0 };
            let size = random.range(0.85, 1.2);
            model.place_all(&[pieces[pick]], at, turn, DVec3::new(1.0, size, size));
        }
    }
}

/// A piece of row: plants of bent leaves around their hearts; the roots reach into the ground.
fn piece(model: &mut Model, number: u64) -> usize {
    let mut random = Random::new(216 + number);
    let mut leaves = Mesh::default();
    let plants = 9;
    for plant in 0..plants {
        let x = PIECE * ((plant as f64 + 0.5) / plants as f64 - 0.5) + random.range(-0.06, 0.06);
        let heart = DVec3::new(x, -0.12, random.range(-0.04, 0.04));
        for leaf in 0..7 {
            let angle = leaf as f64 * 2.4 + random.range(0.0, 0.8);
            let lean = random.range(0.25, 0.95);
            let axis = DVec3::new(angle.cos() * lean, 1.0, angle.sin() * lean).normalize();
            card(&mut leaves, heart, axis, random.range(0.42, 0.6), &mut random);
        }
    }
    model.shape(&format!("crops_{}", number + 1), "crop_leaves", leaves)
}
