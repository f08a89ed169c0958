//! The café's tables on the pavement: round tables, bent-wood chairs, parasols.

use super::{AVENUE, PAVED, STREET, Site};
use crate::model::Model;
use crate::relief::steps;
use crate::shapes::{lathe, tube, tube_side};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// In front of the two cafés: the arcade's on the street, and one on the avenue.
#[rustfmt::skip]
const TABLES: [[f64; 2]; 6] = [
    [-37.6, -5.75], [-35.2, -5.75], [-32.8, -5.75],
    [AVENUE[0] - 1.1, -STREET[0] - 12.6], [AVENUE[0] - 1.1, -STREET[0] - 15.2], [AVENUE[0] - 1.1, -STREET[0] - 17.6],
];

pub fn build(model: &mut Model) {
    let (table, chair, parasol) = (table(model), chair(model), parasol(model));
    for (k, [x, z]) in TABLES.into_iter().enumerate() {
        let site = Site::new(DVec3::new(x, PAVED, z), 35.0 * k as f64);
        site.place(model, &table);
        let along = if k < 3 { 90.0 } else { 0.0 };
        for (n, turn) in [8.0, 175.0, 100.0].into_iter().enumerate() {
            if n == 2 && k % 2 == 0 {
                continue;
            }
            let at = Site { origin: site.origin, turn: along + turn + 6.0 * k as f64 };
            at.within(0.0, 0.0, 0.62, 180.0).place(model, &chair);
        }
        if k % 3 != 1 {
            let at = if k < 3 { [x, z - 0.75] } else { [x + 0.55, z - 0.6] };
            Site::new(DVec3::new(at[0], PAVED, at[1]), 20.0).place(model, &parasol);
        }
    }
}

fn table(model: &mut Model) -> Vec<usize> {
    let top = lathe(&[&[(0.33, 0.74), (0.0, 0.742)]], 24);
    let lit = model.shape("cafe_table", "granite", top);
    let rest = lathe(
        &[
            &[(0.0, 0.712), (0.31, 0.712)],
            &[(0.31, 0.712), (0.33, 0.72), (0.33, 0.74)],
            &[(0.2, -0.02), (0.2, 0.02)],
            &[(0.2, 0.02), (0.04, 0.06), (0.025, 0.3), (0.03, 0.72)],
        ],
        24,
    );
    let detail = model.shape("cafe_table_detail", "iron", rest);
    let cup = lathe(
        &[&[(0.03, 0.735), (0.042, 0.81)], &[(0.042, 0.81), (0.036, 0.81)], &[(0.036, 0.81), (0.0, 0.76)]],
        12,
    );
    let saucer = lathe(&[&[(0.03, 0.735), (0.075, 0.752)], &[(0.075, 0.752), (0.0, 0.748)]], 14);
    for (x, z) in [(0.16, 0.05), (-0.14, -0.1)] {
        model.shape("cafe_table_detail", "paper", cup.clone().with(saucer.clone()).translated(x, 0.004, z));
    }
    vec![lit, detail]
}

/// A chair that faces +Z, of bent tubes, with a round seat.
fn chair(model: &mut Model) -> Vec<usize> {
    let seat = lathe(
        &[
            &[(0.0, 0.42), (0.2, 0.425)],
            &[(0.2, 0.425), (0.21, 0.445), (0.2, 0.46)],
            &[(0.2, 0.46), (0.0, 0.452)],
        ],
        18,
    );
    let detail = model.shape("cafe_chair_detail", "bread", seat);
    let mut wood = crate::mesh::Mesh::default();
    let bend = |r: f64, points: Vec<[f64; 3]>| {
        let path: Vec<_> = points.into_iter().map(|p| (DVec3::from(p), r)).collect();
        tube(&path, 7)
    };
    for x in [-0.15, 0.15] {
        wood.append(bend(0.014, vec![[x, 0.43, 0.13], [x * 1.2, -0.01, 0.19]]));
    }
    // The back's hoop runs down into the rear legs.
    let mut hoop = vec![[-0.19, -0.01, -0.22], [-0.16, 0.42, -0.16]];
    hoop.extend(
        steps(0.0, TAU / 2.0, 10)
            .into_iter()
            .map(|a| [-0.17 * a.cos(), 0.7 + 0.17 * a.sin(), -0.22 - 0.05 * a.sin()]),
    );
    hoop.extend([[0.16, 0.42, -0.16], [0.19, -0.01, -0.22]]);
    wood.append(bend(0.014, hoop));
    let inner: Vec<[f64; 3]> = steps(0.0, TAU / 2.0, 8)
        .into_iter()
        .map(|a| [-0.09 * a.cos(), 0.62 + 0.13 * a.sin(), -0.215 - 0.035 * a.sin()])
        .collect();
    let mut path = vec![[-0.1, 0.44, -0.15]];
    path.extend(inner);
    path.push([0.1, 0.44, -0.15]);
    wood.append(bend(0.01, path));
    let ring: Vec<_> = steps(0.0, TAU, 16)
        .into_iter()
        .map(|a| (DVec3::new(0.16 * a.cos(), 0.2, 0.16 * a.sin()), 0.01))
        .collect();
    wood.append(tube_side(&ring, 6));
    model.shape("cafe_chair_detail", "bread", wood);
    vec![detail]
}

/// An open parasol of eight cloths over ribs.
fn parasol(model: &mut Model) -> Vec<usize> {
    const HIGH: f64 = 2.75;
    const LOW: f64 = 2.2;
    const R: f64 = 1.35;
    let mut cloth = crate::mesh::Mesh::default();
    let rim = |k: usize, t: f64| {
        let a = TAU * k as f64 / 8.0;
        let y = HIGH + (LOW - HIGH) * t;
        DVec3::new(R * t * a.sin(), y, R * t * a.cos())
    };
    for k in 0..8 {
        let (a, b, c, d) = (rim(k, 0.04), rim(k, 1.0), rim(k + 1, 1.0), rim(k + 1, 0.04));
        let uv = [DVec2::ZERO; 4];
        let corners = [a, b, c, d];
        cloth.polygon(&std::array::from_fn::<_, 4, _>(|i| (corners[i], uv[i])));
        let drop = DVec3::Y * -0.16;
        cloth.polygon(&[b, b + drop, c + drop, c].map(|p| (p, DVec2::ZERO)));
    }
    let lit = model.shape("parasol", "canvas", cloth);
    let pole = lathe(
        &[
            &[(0.28, -0.02), (0.28, 0.05)],
            &[(0.28, 0.05), (0.05, 0.1), (0.022, 0.2), (0.022, HIGH + 0.03)],
            &[(0.05, HIGH - 0.03), (0.03, HIGH + 0.05), (0.0, HIGH + 0.12)],
        ],
        14,
    );
    let detail = model.shape("parasol_detail", "oak", pole);
    for k in 0..8 {
        let (a, b) = (rim(k, 0.03) - DVec3::Y * 0.02, rim(k, 0.99) - DVec3::Y * 0.02);
        let strut = [(rim(k, 0.5) - DVec3::Y * 0.02, 0.007), (DVec3::Y * (LOW - 0.1), 0.007)];
        model.shape("parasol_detail", "oak", tube(&[(a, 0.008), (b, 0.008)], 5).with(tube(&strut, 5)));
    }
    vec![lit, detail]
}
