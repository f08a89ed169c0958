//! A rubber plant in a pot, in the corner between the windows.

use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use crate::relief::{full, steps};
use crate::shapes::{lathe, tube};
use glam::DVec3;
use std::f64::consts::TAU;

/// Where it stands.
const AT: DVec3 = DVec3::new(-2.68, 0.0, 1.72);

pub fn build(model: &mut Model) {
    let pot = lathe(
        &[
            &[(0.13, -0.01), (0.15, 0.05), (0.185, 0.3)],
            &[(0.185, 0.3), (0.2, 0.305), (0.2, 0.345)],
            &[(0.2, 0.345), (0.18, 0.345)],
            &[(0.18, 0.345), (0.175, 0.28)],
        ],
        48,
    );
    model.add("pot", "terracotta", pot.translated(AT.x, AT.y, AT.z));
    let soil = lathe(&[&[(0.178, 0.3), (0.1, 0.315), (0.0, 0.32)]], 32);
    model.add("pot_detail", "soil", soil.translated(AT.x, AT.y, AT.z));
    let mut random = Random::new(31);
    for stem in 0..4 {
        let angle = (stem as f64 + 0.3) / 4.0 * TAU;
        let out = DVec3::new(angle.cos(), 0.0, angle.sin());
        let high = 1.35 - 0.16 * stem as f64;
        let point = |t: f64| {
            AT + DVec3::Y * (0.3 + (high - 0.3) * t)
                + out * (0.04 + 0.16 * t * t)
                + DVec3::X * (0.02 * (9.0 * t).sin())
        };
        let path: Vec<_> = steps(0.0, 1.0, 12).into_iter().map(|t| (point(t), 0.013 - 0.008 * t)).collect();
        model.add("plant_detail", "stem", tube(&path, 9));
        let leaves = 13;
        for k in 0..leaves {
            let t = 0.25 + 0.75 * k as f64 / (leaves - 1) as f64;
            let turn = k as f64 * 2.4 + angle;
            let size = random.range(0.17, 0.25) * (1.15 - 0.4 * t);
            let lift = 0.35 + 0.9 * t + random.range(-0.2, 0.2);
            let away = DVec3::new(turn.cos(), 0.0, turn.sin());
            model.add("leaves", "leaf", leaf(point(t), away, lift, size));
        }
    }
}

/// A leaf on a short stalk that leaves `root` towards `away`, `lift` radians up, bending down towards its
/// tip.
fn leaf(root: DVec3, away: DVec3, lift: f64, size: f64) -> Mesh {
    let side = away.cross(DVec3::Y);
    full(&steps(0.0, 1.0, 10), &steps(-1.0, 1.0, 6), |t, s| {
        // Along the midrib the slope falls by 1.2 rad; the height is its integral.
        let slope = |t: f64| (lift * t - 0.6 * t * t) * size * 1.3;
        let flat = size * 1.3 * t * (1.0 - 0.15 * lift);
        let width = 0.3 * size * (4.0 * (t - 0.12).max(0.02) * (1.015 - t)).max(0.0).sqrt() * (1.2 - 0.4 * t);
        let vee = 0.25 * width * s.abs();
        root + away * flat + DVec3::Y * (slope(t) + vee) + side * (width * s)
    })
}
