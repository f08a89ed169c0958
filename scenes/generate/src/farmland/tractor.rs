//! An old tractor, and a wagon with straw on it. Both face +Z as modelled.

use super::timber::{beam, laid};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::noise;
use crate::relief::{full, steps};
use crate::shapes::{ALL, BOTTOM, SOUTH, TOP, bevelled, block, lathe, tube};
use crate::soft::slab;
use glam::{DAffine3, DVec3};
use std::f64::consts::{PI, TAU};

/// Where they stand, and how they are turned.
const TRACTOR: (DVec3, f64) = (DVec3::new(3.4, 0.0, -3.2), 205.0);
const WAGON: (DVec3, f64) = (DVec3::new(-5.2, 0.0, 6.6), 62.0);
/// The wagon's bed: half its width, half its length, its height.
const BED: DVec3 = DVec3::new(0.95, 1.0, 2.1);

pub fn build(model: &mut Model) {
    tractor(model);
    wagon(model);
}

/// A wheel about the x axis at `centre`: a tyre with lugs, a rim.
fn wheel(model: &mut Model, name: &str, centre: DVec3, radius: f64, width: f64) {
    let half = width / 2.0;
    let (inner, bulge) = (radius * 0.56, radius * 0.06);
    let tyre = lathe(
        &[&[
            (inner, -half * 0.8),
            (radius - bulge, -half),
            (radius, -half * 0.6),
            (radius, half * 0.6),
            (radius - bulge, half),
            (inner, half * 0.8),
        ]],
        24,
    );
    let disc: [(f64, f64); 3] = [(inner + 0.01, half * 0.8), (inner * 0.8, half * 0.2), (0.0, half * 0.35)];
    let back: Vec<(f64, f64)> = disc.iter().rev().map(|&(r, y)| (r, -y)).collect();
    let name = format!("{name}_detail");
    let add = |model: &mut Model, material: &str, mesh: Mesh| {
        model.shape(&name, material, laid(mesh, DVec3::X, centre))
    };
    add(model, "rubber", tyre);
    add(model, "cream_paint", lathe(&[&disc], 24).with(lathe(&[&back], 24)));
    for k in 0..18 {
        let angle = k as f64 / 18.0 * TAU;
        let out = DVec3::new(0.0, angle.cos(), angle.sin());
        let lean = DVec3::new(0.0, -angle.sin(), angle.cos()) * (0.12 * radius);
        let side = if k % 2 == 0 { half * 0.9 } else { -half * 0.9 };
        let at = centre + out * (radius - 0.005);
        model.shape(&name, "rubber", beam(at, at + DVec3::X * side + lean, 0.05, 0.05));
    }
}

fn tractor(model: &mut Model) {
    const NAME: &str = "tractor";
    let detail = "tractor_detail";
    wheel(model, NAME, DVec3::new(-0.78, 0.72, -0.75), 0.75, 0.38);
    wheel(model, NAME, DVec3::new(0.78, 0.72, -0.75), 0.75, 0.38);
    wheel(model, NAME, DVec3::new(-0.66, 0.40, 1.25), 0.42, 0.2);
    wheel(model, NAME, DVec3::new(0.66, 0.40, 1.25), 0.42, 0.2);
    // The bonnet's broad sides have texels, as have fenders and canopy.
    let bonnet = bevelled([-0.31, 0.78, 0.02], [0.31, 1.36, 1.62], 0.05);
    let (broad, rest) = bonnet.split(|n| n.x.abs() > 0.99 || n.y > 0.99);
    model.shape(NAME, "red_paint", broad);
    model.shape(detail, "red_paint", rest);
    for (material, min, max) in [
        ("iron", [-0.22, 0.5, -0.9], [0.22, 0.86, 1.5]),
        ("iron", [-0.26, 0.84, 1.58], [0.26, 1.28, 1.64]),
        ("iron", [-0.58, 0.34, 1.19], [0.58, 0.46, 1.31]),
        ("iron", [-0.7, 0.62, -0.85], [0.7, 0.82, -0.65]),
        ("red_paint", [-0.30, 0.82, -0.35], [0.30, 0.92, 0.06]),
        ("rubber", [-0.24, 0.98, -0.86], [0.24, 1.08, -0.46]),
        ("rubber", [-0.22, 1.06, -0.92], [0.22, 1.4, -0.83]),
        ("iron", [-0.1, 0.8, -0.75], [0.1, 1.0, -0.55]),
    ] {
        model.shape(detail, material, bevelled(min, max, 0.02));
    }
    for side in [-1.0, 1.0] {
        let x = side * 0.78;
        let arc = |angle: f64, r: f64| DVec3::new(0.0, 0.72 + r * angle.sin(), -0.75 + r * angle.cos());
        let fender = slab(&[-0.24, 0.24], &steps(0.25, PI * 0.94, 10), |dx, angle, s| {
            arc(angle, 0.83 + 0.03 * s) + DVec3::X * (x + dx)
        });
        model.shape(NAME, "red_paint", fender.front);
        model.shape(detail, "red_paint", fender.back.with(fender.edges));
        let rod = |a: DVec3, b: DVec3, r: f64| tube(&[(a, r), (b, r)], 8);
        for z in [-1.05, 0.05] {
            let foot = if z < 0.0 { 1.05 } else { 0.85 };
            let post = rod(DVec3::new(side * 0.5, foot, z), DVec3::new(side * 0.5, 2.3, z), 0.025);
            model.shape(detail, "iron", post);
        }
        let lamp = lathe(&[&[(0.0, 0.0), (0.09, 0.03), (0.09, 0.1)], &[(0.09, 0.1), (0.0, 0.1)]], 14);
        model.shape(detail, "cream_paint", laid(lamp, DVec3::Z, DVec3::new(side * 0.4, 1.05, 1.5)));
    }
    let canopy = bevelled([-0.72, 2.28, -1.25], [0.72, 2.35, 0.3], 0.02);
    let (broad, rest) = canopy.split(|n| n.y.abs() > 0.99);
    model.shape(NAME, "cream_paint", broad);
    model.shape(detail, "cream_paint", rest);
    let pipe = [(DVec3::new(0.18, 1.3, 1.1), 0.035), (DVec3::new(0.18, 2.1, 1.1), 0.035)];
    model.shape(detail, "iron", tube(&pipe, 10));
    let column = [(DVec3::new(0.0, 1.2, -0.05), 0.025), (DVec3::new(0.0, 1.42, -0.28), 0.025)];
    model.shape(detail, "iron", tube(&column, 8));
    let ring: Vec<(DVec3, f64)> = steps(0.0, TAU, 20)
        .into_iter()
        .map(|a| (DVec3::new(0.19 * a.cos(), 1.42 + 0.13 * a.sin(), -0.28 + 0.13 * a.sin()), 0.016))
        .collect();
    model.shape(detail, "rubber", crate::shapes::tube_side(&ring, 6));
    put(model, NAME, TRACTOR);
}

/// Places the meshes of a thing, all of which are called by its name.
fn put(model: &mut Model, name: &str, (at, turn): (DVec3, f64)) {
    let meshes: Vec<usize> =
        (0..model.meshes.len()).filter(|&k| model.meshes[k].name.starts_with(name)).collect();
    model.place_all(&meshes, at, turn, DVec3::ONE);
}

fn wagon(model: &mut Model) {
    const NAME: &str = "wagon";
    let detail = "wagon_detail";
    for x in [-1.08, 1.08] {
        for z in [-1.35, 1.35] {
            spoked(model, detail, DVec3::new(x, 0.52, z));
        }
    }
    let p = DVec3::new;
    for z in [-1.35, 1.35] {
        model.shape(detail, "old_wood", beam(p(-1.12, 0.52, z), p(1.12, 0.52, z), 0.12, 0.12));
        model.shape(detail, "old_wood", block([-0.6, 0.57, z - 0.1], [0.6, 0.95, z + 0.1], ALL & !BOTTOM));
    }
    let bed = |faces| block([-BED.x, BED.y - 0.08, -BED.z], [BED.x, BED.y, BED.z], faces);
    model.shape(NAME, "boards", bed(BOTTOM));
    model.shape(detail, "boards", bed(ALL & !BOTTOM));
    // Side boards that lean out, lit outside; the load hides their insides.
    for side in [-1.0, 1.0] {
        for k in 0..3 {
            let y = BED.y + 0.1 + 0.2 * k as f64;
            let x = side * (BED.x + 0.02 + 0.05 * k as f64);
            let board = beam(p(x, y, -BED.z), p(x, y, BED.z), 0.03, 0.17);
            let (out, rest) = board.split(|n| n.x * side > 0.99);
            model.shape(NAME, "boards", out);
            model.shape(detail, "boards", rest);
        }
        for z in steps(-BED.z + 0.15, BED.z - 0.15, 3) {
            let stake = beam(p(side * (BED.x + 0.0), 0.88, z), p(side * (BED.x + 0.21), 1.75, z), 0.07, 0.06);
            model.shape(detail, "old_wood", stake);
        }
        let tongue = beam(p(side * 0.35, 0.5, 1.35), p(side * 0.05, 0.42, 4.0), 0.08, 0.1);
        model.shape(detail, "old_wood", tongue);
    }
    for z in [-BED.z, BED.z] {
        let board = beam(p(-BED.x - 0.03, BED.y + 0.16, z), p(BED.x + 0.03, BED.y + 0.16, z), 0.04, 0.4);
        let (out, rest) = board.split(|n| n.z * z > 0.0 && n.z.abs() > 0.99);
        model.shape(NAME, "boards", out);
        model.shape(detail, "boards", rest);
    }
    // Loose straw, heaped.
    let (us, vs) = (steps(-1.0, 1.0, 24), steps(-1.0, 1.0, 14));
    let heap = full(&us, &vs, |u, v| {
        let edge = (1.0 - u.powi(4)).max(0.0) * (1.0 - v.powi(4)).max(0.0);
        let lump = noise(u * 5.0 + 20.0, v * 3.0 + 20.0, 64, 281) - 0.5;
        let swell = 1.0 + 0.06 * edge;
        p(
            v * (BED.x - 0.02) * swell,
            BED.y + 0.05 + (0.95 + 0.5 * lump) * edge.sqrt(),
            u * (BED.z - 0.04) * swell,
        )
    });
    model.shape(NAME, "straw", heap);
    put(model, NAME, WAGON);
}

/// A wooden wheel about the x axis: felloe, hub and twelve spokes.
fn spoked(model: &mut Model, name: &str, centre: DVec3) {
    let (r, half) = (0.54, 0.04);
    let rim = lathe(
        &[
            &[(r, -half), (r, half)],
            &[(r, half), (r - 0.08, half)],
            &[(r - 0.08, half), (r - 0.08, -half)],
            &[(r - 0.08, -half), (r, -half)],
        ],
        28,
    );
    model.shape(name, "old_wood", laid(rim, DVec3::X, centre));
    let hub = tube(&[(centre - DVec3::X * 0.12, 0.1), (centre + DVec3::X * 0.12, 0.08)], 12);
    model.shape(name, "old_wood", hub);
    for k in 0..12 {
        let turn = DAffine3::from_rotation_x(k as f64 / 12.0 * TAU);
        let spoke = beam(DVec3::Y * 0.06, DVec3::Y * (r - 0.04), 0.045, 0.045);
        model.shape(name, "old_wood", spoke.transformed(turn).translated(centre.x, centre.y, centre.z));
    }
    model.shape(
        name,
        "iron",
        block(
            [centre.x - 0.14, centre.y - 0.03, centre.z - 0.03],
            [centre.x + 0.14, centre.y + 0.03, centre.z + 0.03],
            TOP | SOUTH,
        ),
    );
}
