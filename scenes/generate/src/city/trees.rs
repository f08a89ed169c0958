//! Street trees along the avenue: two trees, each placed several times, in iron grates.

use super::{AVENUE, PAVED, Site, blocks};
use crate::foliage::card;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use crate::relief::steps;
use crate::shapes::{TOP, bevelled, block, tube, tube_side};
use glam::DVec3;

/// Distances of the trees from the façades' meeting point along the avenue.
const ALONG: [f64; 2] = [10.75, 22.25];
/// Trunks stand this far behind the kerb's edge.
const BEHIND: f64 = 1.05;
/// Half the side of a grate.
const GRATE: f64 = 0.75;

pub fn build(model: &mut Model) {
    let trees = [tree(model, 1), tree(model, 2)];
    let grate = grate(model);
    let mut number = 0;
    for block in blocks() {
        let (x, z) = (block.west, block.south);
        for along in ALONG {
            // Along the avenue, whichever side of the block that is.
            let site = if x == AVENUE {
                block.site.within(x[1] + BEHIND, PAVED, -z[0] - along, -90.0)
            } else {
                block.site.within(x[0] + along, PAVED, -z[1] - BEHIND, 0.0)
            };
            site.place(model, &grate);
            let turned = Site { turn: site.turn + 67.0 * f64::from(number), ..site };
            let size = 0.92 + 0.05 * f64::from(number % 4);
            let turn = turned.turn.rem_euclid(360.0);
            model.place_all(&trees[number as usize % 2], site.origin, turn, DVec3::splat(size));
            number += 1;
        }
    }
}

/// A trunk, boughs in three tiers, twigs, and cards about their ends; some 8 m high.
fn tree(model: &mut Model, seed: u64) -> Vec<usize> {
    let mut random = Random::new(7000 + seed);
    let sway = |random: &mut Random, r: f64| DVec3::new(random.range(-r, r), 0.0, random.range(-r, r));
    let mut trunk = vec![(DVec3::Y * -0.1, 0.2), (DVec3::Y * 0.25, 0.145)];
    for (y, r) in [(1.2, 0.125), (2.4, 0.115), (3.4, 0.1), (4.6, 0.08), (5.8, 0.055), (7.0, 0.025)] {
        trunk.push((DVec3::Y * y + sway(&mut random, 0.02 + 0.015 * y), r));
    }
    let bark = model.shape(&format!("trunk {seed}"), "bark", tube_side(&trunk, 12));
    let mut wood = Mesh::default();
    let mut tips = vec![trunk[trunk.len() - 1].0, trunk[trunk.len() - 2].0];
    let boughs = 13;
    for k in 0..boughs {
        let t = k as f64 / (boughs - 1) as f64;
        let height = 2.7 + 3.6 * t;
        let j = trunk.iter().position(|p| p.0.y > height).expect("below the top");
        let (a, b) = (trunk[j - 1].0, trunk[j].0);
        let root = a.lerp(b, (height - a.y) / (b.y - a.y));
        let angle = (k as f64 * 137.5 + 40.0 * seed as f64).to_radians();
        let out = DVec3::new(angle.cos(), 0.0, angle.sin());
        // The crown is widest at a third of its height.
        let reach = 2.1 - 1.5 * (t - 0.3).abs() + random.range(-0.15, 0.15);
        let bend = random.direction() * 0.14;
        let bough = [
            (root, 0.07 - 0.03 * t),
            (root + out * (reach * 0.4) + DVec3::Y * 0.32, 0.05 - 0.02 * t),
            (root + out * (reach * 0.75) + DVec3::Y * 0.7 + bend, 0.032 - 0.01 * t),
            (root + out * reach + DVec3::Y * 1.05 + bend, 0.014),
        ];
        wood.append(tube_side(&bough, 7));
        tips.push(bough[3].0);
        for j in 0..7 {
            let s = 0.8 + 2.2 * (j as f64 + random.range(0.0, 0.8)) / 7.0;
            let (a, b) = (bough[s as usize], bough[(s as usize + 1).min(3)]);
            let start = a.0.lerp(b.0, s.fract());
            let spread = (random.direction() + DVec3::Y * 0.35 + out * 0.5).normalize();
            let length = random.range(0.4, 0.85);
            let middle = start + spread * (length * 0.55) + DVec3::Y * 0.04;
            let end = start + spread * length + DVec3::Y * 0.1;
            wood.append(tube(&[(start, 0.02), (middle, 0.013), (end, 0.005)], 4));
            tips.extend([middle, end]);
        }
    }
    let twigs = model.shape(&format!("twigs_{seed}_detail"), "bark", wood);
    let mut leaves = Mesh::default();
    for &tip in &tips {
        for _ in 0..7 {
            let offset = random.direction() * random.range(0.05, 0.45);
            let axis = (offset.normalize() + DVec3::Y * 0.2 + random.direction() * 0.6).normalize();
            let size = random.range(0.3, 0.5);
            card(&mut leaves, tip + offset, axis, size, &mut random);
        }
    }
    vec![bark, twigs, model.shape(&format!("leaves_{seed}"), "leaves", leaves)]
}

/// An iron grate flush with the pavement, soil below its slots, and a guard around the trunk.
fn grate(model: &mut Model) -> Vec<usize> {
    let mut iron = Mesh::default();
    let high = 0.015;
    for side in [-1.0, 1.0] {
        let (a, b) = (side * GRATE, side * (GRATE - 0.08));
        iron.append(bevelled([a.min(b), -0.05, -GRATE], [a.max(b), high, GRATE], 0.006).standing());
        iron.append(
            bevelled([-GRATE + 0.08, -0.05, a.min(b)], [GRATE - 0.08, high, a.max(b)], 0.006).standing(),
        );
    }
    for x in steps(-GRATE + 0.14, GRATE - 0.14, 14) {
        for side in [-1.0, 1.0] {
            let (a, b): (f64, f64) = (side * 0.26, side * (GRATE - 0.07));
            iron.append(block([x - 0.022, -0.02, a.min(b)], [x + 0.022, high - 0.003, a.max(b)], TOP));
        }
        if x.abs() > 0.3 {
            iron.append(block([x - 0.022, -0.02, -0.26], [x + 0.022, high - 0.003, 0.26], TOP));
        }
    }
    for k in 0..10 {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 10.0).sin_cos();
        let (foot, head) = (DVec3::new(0.3 * cos, 0.0, 0.3 * sin), DVec3::new(0.34 * cos, 1.5, 0.34 * sin));
        iron.append(tube(&[(foot, 0.011), (head, 0.011)], 5));
    }
    for (y, r) in [(0.12, 0.303), (1.4, 0.337)] {
        let ring: Vec<_> = steps(0.0, std::f64::consts::TAU, 20)
            .into_iter()
            .map(|a| (DVec3::new(r * a.cos(), y, r * a.sin()), 0.014))
            .collect();
        iron.append(tube_side(&ring, 6));
    }
    let detail = model.shape("grate_detail", "iron", iron);
    model.shape(
        "grate_detail",
        "soil",
        block([-GRATE + 0.05, 0.0, -GRATE + 0.05], [GRATE - 0.05, 0.006, GRATE - 0.05], TOP),
    );
    vec![detail]
}
