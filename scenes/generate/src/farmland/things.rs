//! What stands about the yard: the well, the trough, churns, a woodpile, crates and pallets, a ladder,
//! stones.

use super::terrain::point;
use super::timber::{beam, laid};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::{Random, noise};
use crate::relief::steps;
use crate::shapes::{ALL, BOTTOM, EAST, NORTH, SOUTH, TOP, WEST, block, lathe, tube};
use crate::soft::{cushion, slab};
use glam::DVec3;
use std::f64::consts::TAU;

/// The well's axis.
const WELL: DVec3 = DVec3::new(5.2, 0.0, 11.2);

pub fn build(model: &mut Model) {
    well(model);
    trough(model);
    churns(model);
    woodpile(model);
    crates(model);
    stones(model);
}

/// A ring of stones with water below, a small roof on two posts, a winch.
fn well(model: &mut Model) {
    let at = |mesh: Mesh| mesh.translated(WELL.x, WELL.y, WELL.z);
    model.add("well", "rubble", at(lathe(&[&[(0.95, -0.3), (0.92, 0.85)]], 32)));
    model.add("well", "rubble", at(lathe(&[&[(0.64, 0.85), (0.64, -0.28)]], 32)));
    let coping: [(f64, f64); 4] = [(0.92, 0.82), (0.99, 0.84), (0.99, 0.94), (0.6, 0.96)];
    model.add("well_coping", "stone", at(lathe(&[&coping[2..], &[(0.6, 0.96), (0.6, 0.8)]], 32)));
    model.add("well_detail", "stone", at(lathe(&[&coping[..2], &coping[1..3]], 32)));
    model.add("well_detail", "glass", at(lathe(&[&[(0.7, -0.2), (0.0, -0.2)]], 32)));
    let p = |x: f64, y: f64, z: f64| WELL + DVec3::new(x, y, z);
    for x in [-0.84, 0.84] {
        model.add("well_detail", "old_wood", beam(p(x, 0.4, 0.0), p(x, 2.28, 0.0), 0.13, 0.13));
    }
    let axle = [(p(-0.98, 1.45, 0.0), 0.07), (p(0.98, 1.45, 0.0), 0.07)];
    model.add("well_detail", "old_wood", tube(&axle, 10));
    let crank = [(p(0.96, 1.45, 0.0), 0.02), (p(1.12, 1.45, 0.0), 0.02), (p(1.12, 1.2, 0.1), 0.02)];
    model.add("well_detail", "iron", tube(&crank, 6));
    model.add("well_detail", "straw", tube(&[(p(0.1, 1.42, 0.07), 0.015), (p(0.1, 1.1, 0.07), 0.015)], 6));
    let bucket: &[&[(f64, f64)]] = &[
        &[(0.0, 0.0), (0.12, 0.0)],
        &[(0.12, 0.0), (0.16, 0.3)],
        &[(0.16, 0.3), (0.145, 0.3)],
        &[(0.145, 0.3), (0.11, 0.03), (0.0, 0.03)],
    ];
    model.add("well_detail", "old_wood", lathe(bucket, 16).translated(WELL.x + 0.1, 0.82, WELL.z + 0.07));
    for side in [1.0, -1.0] {
        let us = steps(-1.15, 1.15, 4);
        let roof = slab(&us, &steps(-0.95, 0.0, 3), |u, v, s| {
            p(side * u, 2.75 + 0.75 * v + 0.06 * s * if v == 0.0 { 1.25 } else { 1.0 }, -side * v)
        });
        model.add("well_roof", "boards", roof.front.grain_turned());
        model.add("well_detail", "old_wood", roof.back.with(roof.edges));
    }
    model.add("well_detail", "old_wood", beam(p(-0.9, 2.22, 0.0), p(0.9, 2.22, 0.0), 0.1, 0.12));
    for x in [-0.84, 0.84] {
        for z in [-0.6, 0.6] {
            model.add("well_detail", "old_wood", beam(p(x, 1.75, 0.0), p(x, 2.3, z), 0.07, 0.08));
        }
        model.add("well_detail", "old_wood", beam(p(x, 2.2, 0.0), p(x, 2.76, 0.0), 0.1, 0.1));
    }
}

/// A stone trough with water at the pasture's gate.
fn trough(model: &mut Model) {
    let at = point(21.6, 6.0);
    let put = |mesh: Mesh| mesh.translated(at.x, at.y, at.z);
    let (x, z, top) = (0.42, 1.2, 0.62);
    let sides = EAST | WEST | SOUTH | NORTH;
    model.add("trough", "stone", put(block([-x, -0.2, -z], [x, top, z], sides)));
    let wall = 0.12;
    for (a, b) in [
        ([-x, -z], [x, -z + wall]),
        ([-x, z - wall], [x, z]),
        ([-x, -z + wall], [-x + wall, z - wall]),
        ([x - wall, -z + wall], [x, z - wall]),
    ] {
        model.add("trough_detail", "stone", put(block([a[0], 0.0, a[1]], [b[0], top, b[1]], TOP)));
    }
    // The inside looks inwards.
    let inside = block([wall - x, 0.2, wall - z], [x - wall, top, z - wall], sides).flipped();
    model.add("trough_detail", "stone", put(inside));
    model.add(
        "trough_detail",
        "glass",
        put(block([wall - x, 0.2, wall - z], [x - wall, 0.5, z - wall], TOP)),
    );
}

/// Milk churns beside the house's door.
fn churns(model: &mut Model) {
    let churn = lathe(
        &[
            &[(0.19, -0.03), (0.2, 0.02), (0.2, 0.45), (0.17, 0.54), (0.11, 0.6), (0.11, 0.68)],
            &[(0.11, 0.68), (0.14, 0.69)],
            &[(0.14, 0.69), (0.14, 0.73)],
            &[(0.14, 0.73), (0.0, 0.75)],
        ],
        20,
    );
    let mesh = model.shape("churn_detail", "zinc", churn);
    for (k, (u, v)) in
        [(11.2, -11.9), (11.65, -12.05), (11.3, -11.4), (14.6, 1.9), (14.2, 2.15)].into_iter().enumerate()
    {
        model.place_all(&[mesh], point(u, v), 50.0 * k as f64, DVec3::ONE);
    }
}

/// Logs stacked against the house's western gable.
fn woodpile(model: &mut Model) {
    let mut random = Random::new(291);
    let x1 = 8.1;
    for row in 0..7 {
        for k in 0..20 - row % 2 {
            let z = -19.1 + 0.17 * (k as f64 + 0.5 * (row % 2) as f64);
            let y = 0.06 + 0.148 * row as f64;
            let r = 0.08 + random.range(0.0, 0.006);
            let reach = 7.45 + random.range(-0.05, 0.05);
            let log = tube(&[(DVec3::new(x1, y, z), r), (DVec3::new(reach, y, z), r)], 9);
            // The end inside the wall is left out.
            model.add("woodpile_detail", "bark", log.split(|n| n.x < 0.99).0);
        }
    }
    for z in [-19.28, -15.62] {
        let post = |y: f64| DVec3::new(7.6, y, z);
        model.add("woodpile_detail", "old_wood", beam(post(-0.3), post(1.35), 0.08, 0.08));
    }
}

/// Pallets with crates on them, in the shed and before it, and a ladder on the barn's eastern wall.
fn crates(model: &mut Model) {
    let mut pallet = Mesh::default();
    for k in 0..5 {
        let z = -0.52 + 0.26 * k as f64;
        pallet.append(beam(DVec3::new(-0.6, 0.12, z), DVec3::new(0.6, 0.12, z), 0.2, 0.03));
    }
    for x in [-0.5, 0.0, 0.5] {
        pallet.append(beam(DVec3::new(x, 0.04, -0.6), DVec3::new(x, 0.04, 0.6), 0.1, 0.14));
    }
    let pallet = model.shape("pallet_detail", "old_wood", pallet);
    let (w, h) = (0.5, 0.62);
    let body = |faces| block([-w, 0.12, -w], [w, 0.12 + h, w], faces);
    let lit = model.shape("crate", "boards", body(ALL & !BOTTOM));
    let mut rims = Mesh::default();
    for y in [0.16, 0.1 + h] {
        for (a, b) in [
            ([-1.0, -1.0], [1.0, -1.0]),
            ([1.0, -1.0], [1.0, 1.0]),
            ([1.0, 1.0], [-1.0, 1.0]),
            ([-1.0, 1.0], [-1.0, -1.0]),
        ] {
            let corner = |c: [f64; 2]| DVec3::new(c[0] * w, y, c[1] * w);
            rims.append(beam(corner(a), corner(b), 0.05, 0.09));
        }
    }
    let rims = model.shape("crate_detail", "old_wood", rims);
    for (u, v, turn, stacked) in
        [(18.9, 4.4, 4.0, 2), (17.5, 4.5, -6.0, 1), (13.4, 10.8, 24.0, 1), (-9.9, -23.0, 0.0, 0)]
    {
        let at = point(u, v) - DVec3::Y * 0.02;
        model.place_all(&[pallet], at, turn, DVec3::ONE);
        for k in 0..stacked {
            let up = DVec3::Y * (k as f64 * (h + 0.005));
            model.place_all(&[lit, rims], at + up, turn + 3.0 * k as f64, DVec3::ONE);
        }
    }
    let side = |z: f64, t: f64| DVec3::new(-6.9 - 1.42 * t, 4.4 * t - 0.05, z);
    for z in [-12.6, -12.15] {
        model.add("ladder_detail", "old_wood", beam(side(z, 0.0), side(z, 1.0), 0.04, 0.08));
    }
    for k in 1..14 {
        let t = k as f64 / 14.0;
        model.add(
            "ladder_detail",
            "old_wood",
            tube(&[(side(-12.62, t), 0.016), (side(-12.13, t), 0.016)], 6),
        );
    }
    // A grindstone in its frame beside the shed.
    let at = point(13.6, 13.4);
    let stone = lathe(
        &[&[(0.0, -0.06), (0.34, -0.06)], &[(0.34, -0.06), (0.34, 0.06)], &[(0.34, 0.06), (0.0, 0.06)]],
        28,
    );
    model.add("grindstone_detail", "stone", laid(stone, DVec3::X, at + DVec3::Y * 0.72));
    let p = |x: f64, y: f64, z: f64| at + DVec3::new(x, y, z);
    for x in [-0.16, 0.16] {
        model.add("grindstone_detail", "old_wood", beam(p(x, -0.1, -0.4), p(x, 0.8, 0.0), 0.07, 0.08));
        model.add("grindstone_detail", "old_wood", beam(p(x, -0.1, 0.4), p(x, 0.74, 0.02), 0.06, 0.07));
    }
    model.add(
        "grindstone_detail",
        "iron",
        tube(&[(p(-0.3, 0.72, 0.0), 0.025), (p(0.36, 0.72, 0.0), 0.025)], 8),
    );
}

/// Field stones: three shapes, boulders in the pasture and lesser ones along walls, ways and the ploughed
/// field's rim.
fn stones(model: &mut Model) {
    let shapes: Vec<usize> = (0..3)
        .map(|k| {
            let half =
                [DVec3::new(0.5, 0.34, 0.42), DVec3::new(0.4, 0.4, 0.36), DVec3::new(0.55, 0.26, 0.38)][k];
            let mut stone = cushion(half, 0.22, 2, 2, DVec3::ZERO);
            for p in &mut stone.positions {
                let (a, b) = (p.x * 2.6 + 20.0 + 0.7 * p.y, p.z * 2.6 + 20.0 - 0.9 * p.y);
                *p *= 0.8 + 0.45 * noise(a, b, 64, 295 + k as u64);
            }
            model.shape(&format!("stone_{}_detail", k + 1), "stone", stone.smoothed())
        })
        .collect();
    let mut random = Random::new(298);
    let mut put = |u: f64, v: f64, size: f64, random: &mut Random| {
        let at = point(u, v) - DVec3::Y * (0.08 * size);
        let shape = shapes[random.range(0.0, 3.0) as usize];
        model.place_all(&[shape], at, random.range(0.0, 360.0), DVec3::splat(size));
    };
    for _ in 0..14 {
        let (u, v) = (random.range(28.0, 60.0), random.range(-56.0, 18.0));
        let size = random.range(0.8, 2.4);
        put(u, v, size, &mut random);
    }
    for _ in 0..50 {
        let (u, v) = (random.range(-22.0, 22.0), random.range(-23.2, -22.6));
        let clear = !(-10.6..-9.2).contains(&u);
        let size = random.range(0.25, 0.6);
        if clear {
            put(u, v, size, &mut random);
        }
    }
    for k in 0..26 {
        let (sin, cos) = (k as f64 / 26.0 * TAU).sin_cos();
        let size = random.range(0.18, 0.4);
        put(
            -2.0 + 13.5 * cos + random.range(-1.0, 1.0),
            0.5 + 9.0 * sin + random.range(-0.7, 0.7),
            size,
            &mut random,
        );
    }
    for _ in 0..24 {
        let (u, v) = (random.range(-62.0, -6.0), random.range(24.6, 26.0));
        let size = random.range(0.2, 0.5);
        put(u, v, size, &mut random);
    }
}
