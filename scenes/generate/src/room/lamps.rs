//! The pendant over the table and the floor lamp beside the sofa. The scene file puts a ball of light in
//! each.

use super::HEIGHT;
use super::dining::TABLE;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::shapes::{lathe, tube};
use glam::DVec3;
use std::f64::consts::TAU;

/// Middles of the lamps of the scene file.
pub const LAMPS: [DVec3; 2] = [DVec3::new(TABLE.x, 1.64, TABLE.z), DVec3::new(-2.84, 1.56, -2.02)];

pub fn build(model: &mut Model) {
    let [pendant, standing] = LAMPS;
    let at = |mesh: Mesh, foot: DVec3| mesh.translated(foot.x, foot.y, foot.z);
    // The pendant: shade, socket, cord and the rose on the ceiling.
    model.add("shades", "shade", at(shade(0.12, 0.25, 0.22), pendant - DVec3::Y * 0.09));
    let socket = lathe(
        &[
            &[(0.0, 0.0), (0.02, 0.0)],
            &[(0.02, 0.0), (0.022, 0.05), (0.012, 0.07)],
            &[(0.012, 0.07), (0.0, 0.075)],
        ],
        20,
    );
    model.add("lamps_detail", "brass", at(socket, pendant + DVec3::Y * 0.075));
    spokes(model, pendant + DVec3::Y * 0.118, 0.126);
    let cord = [(pendant + DVec3::Y * 0.14, 0.003), (DVec3::new(pendant.x, HEIGHT - 0.01, pendant.z), 0.003)];
    model.add("lamps_detail", "iron", tube(&cord, 8));
    let rose = lathe(&[&[(0.0, -0.035), (0.02, -0.034), (0.045, -0.02), (0.055, 0.005)]], 28);
    model.add("lamps_detail", "white_paint", at(rose, DVec3::new(pendant.x, HEIGHT, pendant.z)));
    // The floor lamp: foot, pole, socket, shade.
    let floor = DVec3::new(standing.x, 0.0, standing.z);
    let foot = lathe(
        &[&[(0.15, -0.01), (0.15, 0.012)], &[(0.15, 0.012), (0.13, 0.024), (0.04, 0.032), (0.02, 0.05)]],
        40,
    );
    model.add("lamps_detail", "brass", at(foot, floor));
    let pole = [(floor + DVec3::Y * 0.03, 0.011), (floor + DVec3::Y * 1.42, 0.011)];
    model.add("lamps_detail", "brass", tube(&pole, 14));
    let socket = lathe(&[&[(0.011, 0.0), (0.02, 0.012), (0.02, 0.06)], &[(0.02, 0.06), (0.0, 0.06)]], 20);
    model.add("lamps_detail", "brass", at(socket, floor + DVec3::Y * 1.41));
    model.add("shades", "shade", at(shade(0.14, 0.2, 0.28), standing - DVec3::Y * 0.13));
    spokes(model, standing - DVec3::Y * 0.1, 0.195);
}

/// An open shade from y = 0, `low` wide there and `high` above; closed cloth, 3 mm thick.
fn shade(high: f64, low: f64, tall: f64) -> Mesh {
    let t = 0.003;
    lathe(
        &[
            &[(low, 0.0), (high, tall)],
            &[(high, tall), (high - t, tall)],
            &[(high - t, tall), (low - t, 0.0)],
            &[(low - t, 0.0), (low, 0.0)],
        ],
        56,
    )
}

/// Three wires that carry a shade of radius `r`.
fn spokes(model: &mut Model, centre: DVec3, r: f64) {
    for k in 0..3 {
        let (sin, cos) = (k as f64 / 3.0 * TAU).sin_cos();
        let wire = [(centre, 0.0025), (centre + DVec3::new(cos, 0.0, sin) * r, 0.0025)];
        model.add("lamps_detail", "brass", tube(&wire, 6));
    }
}
