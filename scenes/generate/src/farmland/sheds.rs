//! The silo, and the cart shed that is open to the yard.

use super::timber::beam;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{plate, steps};
use crate::shapes::{lathe, tube};
use crate::soft::slab;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// The silo's axis, radius and height to its dome.
const SILO: [f64; 2] = [-4.2, -18.4];
const RADIUS: f64 = 2.5;
const HEIGHT: f64 = 10.4;
/// The cart shed: its open front, its back; its ends.
const X: [f64; 2] = [15.0, 20.6];
const Z: [f64; 2] = [2.6, 12.6];
/// Underside of the cart shed's roof at its front and its back.
const ROOF: [f64; 2] = [3.5, 2.5];

pub fn build(model: &mut Model) {
    silo(model);
    shed(model);
}

fn silo(model: &mut Model) {
    let at = |mesh: Mesh| mesh.translated(SILO[0], 0.0, SILO[1]);
    let sides = 48;
    model.add("silo", "concrete", at(lathe(&[&[(RADIUS, -0.4), (RADIUS, HEIGHT)]], sides)));
    let dome: Vec<(f64, f64)> = (0..=8)
        .map(|k| {
            let (sin, cos) = (PI / 2.0 * k as f64 / 8.0).sin_cos();
            (if k == 8 { 0.0 } else { (RADIUS + 0.12) * cos }, HEIGHT + 0.1 + 1.5 * sin)
        })
        .collect();
    model.add("silo_dome", "zinc_sheet", at(lathe(&[&dome], sides)));
    let rim = [(RADIUS - 0.05, HEIGHT - 0.05), (RADIUS + 0.12, HEIGHT - 0.05), (RADIUS + 0.12, HEIGHT + 0.1)];
    model.add("silo_detail", "zinc", at(lathe(&[&rim[..2], &rim[1..]], sides)));
    let foot = [(RADIUS + 0.35, -0.4), (RADIUS + 0.35, 0.22), (RADIUS - 0.02, 0.3)];
    model.add("silo_detail", "concrete", at(lathe(&[&foot[..2], &foot[1..]], sides)));
    for k in 0..12 {
        let (y, r) = (0.9 + 0.82 * k as f64, RADIUS);
        let hoop = [(r - 0.02, y - 0.04), (r + 0.03, y - 0.03), (r + 0.03, y + 0.03), (r - 0.02, y + 0.04)];
        model.add("silo_detail", "iron", at(lathe(&[&hoop[..2], &hoop[1..3], &hoop[2..]], sides)));
    }
    // A chute down the south side, and a ladder up the south-east.
    let chute = |y: f64| (DVec3::new(SILO[0], y, SILO[1] + RADIUS + 0.12), 0.36);
    model.add("silo_detail", "zinc", tube(&[chute(1.8), chute(HEIGHT - 0.3)], 14));
    let out = DVec3::new(0.6, 0.0, 0.8);
    let aside = DVec3::new(0.8, 0.0, -0.6) * 0.22;
    let foot = DVec3::new(SILO[0], 0.0, SILO[1]) + out * (RADIUS + 0.18);
    for side in [aside, -aside] {
        let rail = [(foot + side + DVec3::Y * 0.25, 0.025), (foot + side + DVec3::Y * (HEIGHT + 0.9), 0.025)];
        model.add("silo_detail", "iron", tube(&rail, 6));
    }
    for k in 0..34 {
        let y = DVec3::Y * (0.5 + 0.3 * k as f64);
        model.add("silo_detail", "iron", tube(&[(foot + aside + y, 0.014), (foot - aside + y, 0.014)], 5));
    }
    for y in [1.5, 4.5, 7.5, 10.0] {
        for side in [aside, -aside] {
            let stay = beam(foot + side + DVec3::Y * y, foot + side + DVec3::Y * y - out * 0.25, 0.03, 0.03);
            model.add("silo_detail", "iron", stay);
        }
    }
}

/// Three boarded walls and a roof that falls to the back, on posts along the front.
fn shed(model: &mut Model) {
    let below = -0.4;
    let slope = (ROOF[1] - ROOF[0]) / (X[1] - X[0]);
    let under = |x: f64| ROOF[0] + (x - X[0]) * slope;
    let mut wall = |xs: &[f64], turn: f64, at: DVec3, top: &dyn Fn(f64) -> f64| {
        let place = |x: f64, y: f64| DVec2::new(x, if y == 0.0 { below } else { top(x) });
        let built = super::timber::stand(plate(xs, &[0.0, 1.0], 0.1, |_, _| true, place), turn, at);
        let upright = |mut mesh: Mesh| {
            mesh.uvs = mesh.positions.iter().map(|p| DVec2::new(p.x + p.z, -p.y)).collect();
            mesh
        };
        model.add("shed_walls", "boards", upright(built.front));
        model.add("shed_inside", "old_boards", upright(built.back));
        model.add("shed_detail", "old_boards", built.edges);
    };
    let depth = X[1] - X[0];
    let into_roof = 0.04;
    wall(&[0.2, depth - 0.05], 0.0, DVec3::new(X[0], 0.0, Z[1] - 0.05), &|x| under(X[0] + x) + into_roof);
    wall(&[0.05 - depth, -0.2], 180.0, DVec3::new(X[0], 0.0, Z[0] + 0.05), &|x| under(X[0] - x) + into_roof);
    let half = (Z[1] - Z[0]) / 2.0 + 0.02;
    let middle = (Z[0] + Z[1]) / 2.0;
    wall(&[-half, half], 90.0, DVec3::new(X[1] - 0.03, 0.0, middle), &|_| under(X[1]) + into_roof);

    let length = (1.0 + slope * slope).sqrt();
    let out = DVec3::new(-slope, 1.0, 0.0) / length;
    // Rows fall from the front's overhang to the back's.
    let (from, to) = (X[0] - 0.7, X[1] + 0.4);
    let corrugation = 0.32;
    let count = ((Z[1] - Z[0] + 0.8) / (corrugation / 4.0)).round() as usize;
    let roof = slab(&steps(Z[0] - 0.4, Z[1] + 0.4, count), &[from, to], |z, x, s| {
        let crest = 0.025 * (TAU * z / corrugation).cos();
        DVec3::new(x, under(x), z) + out * (s * (0.1 + crest))
    });
    model.add("shed_roof", "zinc_sheet", roof.front);
    model.add("shed_ceiling", "old_boards", roof.back);
    model.add("shed_detail", "zinc", roof.edges);

    let mut wood = Mesh::default();
    for z in steps(Z[0] + 0.12, Z[1] - 0.12, 3) {
        let p = |x: f64, y: f64| DVec3::new(x, y, z);
        wood.append(beam(p(X[0] + 0.15, below), p(X[0] + 0.15, under(X[0]) + 0.02), 0.2, 0.2));
        wood.append(beam(
            p(X[0] - 0.6, under(X[0] - 0.6) - 0.07),
            p(X[1] - 0.1, under(X[1]) - 0.05),
            0.1,
            0.18,
        ));
    }
    for (x, drop) in [(X[0] + 0.15, 0.2), (17.8, 0.19)] {
        let y = under(x) - drop;
        wood.append(beam(DVec3::new(x, y, Z[0] + 0.03), DVec3::new(x, y, Z[1] - 0.03), 0.14, 0.16));
    }
    for z in steps(Z[0] + 0.12, Z[1] - 0.12, 3) {
        for side in [-0.8, 0.8] {
            let inside = z + side > Z[0] && z + side < Z[1];
            if inside {
                let (x, y) = (X[0] + 0.15, under(X[0]) - 0.25);
                wood.append(beam(DVec3::new(x, y - 0.75, z), DVec3::new(x, y, z + side), 0.09, 0.1));
            }
        }
    }
    model.add("shed_detail", "old_boards", wood);
}
