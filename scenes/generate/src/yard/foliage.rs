//! The tree: a trunk with branches as tubes, and leaf cards in clouds around the branch ends. Shrubs use the
//! cards too.

use super::ground;
use crate::foliage::{self, card};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use crate::shapes::tube_side;
use glam::DVec3;

/// Where the trunk stands.
const TREE: [f64; 2] = [-4.3, 0.6];
/// Branches that carry texels; thinner ones are detail.
const LIMBS: usize = 7;

pub fn build(model: &mut Model) {
    let mut random = Random::new(2024);
    let foot = DVec3::new(TREE[0], ground::height(TREE[0], TREE[1]) - 0.12, TREE[1]);
    // A trunk that leans a little and flares at the foot.
    let trunk = [
        (foot, 0.34),
        (foot + DVec3::new(0.01, 0.22, 0.0), 0.25),
        (foot + DVec3::new(0.04, 0.7, 0.02), 0.21),
        (foot + DVec3::new(0.02, 1.4, 0.06), 0.19),
        (foot + DVec3::new(0.0, 2.1, 0.08), 0.17),
        (foot + DVec3::new(0.06, 2.8, 0.06), 0.13),
        (foot + DVec3::new(0.1, 3.6, 0.02), 0.08),
        (foot + DVec3::new(0.06, 4.5, -0.02), 0.03),
    ];
    model.add("trunk", "bark", tube_side(&trunk, 14));
    let mut tips = vec![trunk[7].0];
    for k in 0..LIMBS {
        let angle = (k as f64 * 137.5 + 20.0).to_radians();
        let height = 1.75 + 0.27 * k as f64;
        let root = along(&trunk, height);
        let reach = 1.9 - 0.13 * k as f64;
        let out = DVec3::new(angle.cos(), 0.0, angle.sin());
        let bend = random.direction() * 0.12;
        let limb = [
            (root, 0.09),
            (root + out * (reach * 0.35) + DVec3::Y * 0.28, 0.07),
            (root + out * (reach * 0.7) + DVec3::Y * 0.66 + bend, 0.05),
            (root + out * reach + DVec3::Y * 1.1 + bend, 0.02),
        ];
        model.add("limbs", "bark", tube_side(&limb, 9));
        tips.push(limb[3].0);
        // Twigs leave the limb's outer half to all sides.
        for j in 0..6 {
            let t = 1.0 + 2.0 * (j as f64 + random.range(0.0, 0.8)) / 6.0;
            let (a, b) = (limb[t as usize], limb[(t as usize + 1).min(3)]);
            let start = a.0.lerp(b.0, t.fract());
            let spread = (random.direction() + DVec3::Y * 0.4 + out * 0.5).normalize();
            let length = random.range(0.45, 0.85);
            let middle = start + spread * (length * 0.55) + DVec3::Y * 0.05;
            let twig = [(start, 0.028), (middle, 0.018), (start + spread * length + DVec3::Y * 0.12, 0.006)];
            model.add("twigs_detail", "bark", tube_side(&twig, 5));
            tips.push(twig[2].0);
            tips.push(middle);
        }
    }
    let mut leaves = Mesh::default();
    for &tip in &tips {
        for _ in 0..15 {
            let offset = random.direction() * random.range(0.05, 0.42);
            let size = random.range(0.26, 0.4);
            card(
                &mut leaves,
                tip + offset,
                (offset.normalize() + DVec3::Y * 0.3 + random.direction() * 0.6).normalize(),
                size,
                &mut random,
            );
        }
    }
    model.add("leaves", "leaves", leaves);
}

/// The point of a path at a height above its first point.
fn along(path: &[(DVec3, f64)], height: f64) -> DVec3 {
    let y = path[0].0.y + height;
    let k = (1..path.len() - 1).find(|&k| path[k].0.y > y).unwrap_or(path.len() - 1);
    let (a, b) = (path[k - 1].0, path[k].0);
    a.lerp(b, (y - a.y) / (b.y - a.y))
}

/// A shrub of the yard's leaves.
pub fn shrub(model: &mut Model, centre: DVec3, radii: DVec3, cards: usize, seed: u64) {
    model.add("leaves_shrubs", "leaves", foliage::shrub(centre, radii, cards, 0.16..0.24, seed));
}
