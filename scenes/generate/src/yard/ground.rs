//! The lawn, the paved surfaces let into it, and the land around the yard.

use super::{GARAGE_X, GARAGE_Z};
use crate::model::Model;
use crate::random::noise;
use crate::relief::{sheet, sorted};
use crate::shapes::{ALL, BOTTOM, TOP, block};
use glam::DVec3;

/// Edge of a paving slab; the lattice of slabs passes through `ORIGIN`.
pub const SLAB: f64 = 0.6;
const ORIGIN: [f64; 2] = [-1.6, -5.8];
/// Lawn cells are half a slab wide.
const CELL: f64 = SLAB / 2.0;

/// Paved rectangles in slabs of the lattice: [x0, z0, x1, z1].
const PATH: [[i64; 4]; 3] = [[0, 2, 2, 20], [3, 0, 9, 6], [2, 3, 3, 5]];
const DRIVE: [[i64; 4]; 1] = [[10, 7, 15, 20]];

pub fn build(model: &mut Model) {
    model.add("lawn", "grass", lawn());
    model.add("path", "paving", paved(&PATH));
    model.add("drive", "paving", paved(&DRIVE));
    surroundings(model);
}

/// Distance in metres from a point to the nearest of some paved rectangles, 0 inside.
fn distance(rectangles: &[[i64; 4]], x: f64, z: f64) -> f64 {
    rectangles.iter().fold(f64::MAX, |least, r| {
        let line = |k: usize| ORIGIN[k % 2] + r[k] as f64 * SLAB;
        let dx = (line(0) - x).max(x - line(2)).max(0.0);
        let dz = (line(1) - z).max(z - line(3)).max(0.0);
        least.min((dx * dx + dz * dz).sqrt())
    })
}

/// Distance to anything paved.
fn to_paving(x: f64, z: f64) -> f64 {
    distance(&PATH, x, z).min(distance(&DRIVE, x, z))
}

/// Height of the lawn: flat beside paving, uneven by a few centimetres elsewhere.
pub fn height(x: f64, z: f64) -> f64 {
    let swell = noise(x * 0.45 + 20.0, z * 0.45 + 20.0, 64, 5) - 0.5;
    let bump = noise(x * 1.3 + 20.0, z * 1.3 + 20.0, 64, 6) - 0.5;
    (0.10 * swell + 0.03 * bump) * (to_paving(x, z) / 0.8).min(1.0)
}

fn lawn() -> crate::mesh::Mesh {
    let line = |k: usize, n: i64| ORIGIN[k] + n as f64 * CELL;
    let xs: Vec<f64> = (-22..=33).map(|n| line(0, n)).collect();
    let zs: Vec<f64> = (-1..=40).map(|n| line(1, n)).collect();
    let grown = |j: usize, i: usize| {
        let (x, z) = (xs[i] + CELL / 2.0, zs[j] + CELL / 2.0);
        let in_garage = x > GARAGE_X[0] + CELL && z < GARAGE_Z[1] - CELL;
        let under_step = x > -2.0 && x < 0.0 && z < -5.0;
        to_paving(x, z) > 0.0 && !in_garage && !under_step
    };
    // z × x looks up.
    let mut mesh = sheet(&zs, &xs, grown, |z, x| {
        // Beyond the fences it dives under the land around.
        let rim = x == xs[0] || x == xs[xs.len() - 1] || z == zs[zs.len() - 1];
        DVec3::new(x, if rim { -0.15 } else { height(x, z) }, z)
    });
    mesh.uvs.iter_mut().for_each(|uv| *uv = -uv.perp());
    mesh
}

/// Slabs with sunk joints, 3 cm above the lawn, whose rim slopes into the ground.
fn paved(rectangles: &[[i64; 4]]) -> crate::mesh::Mesh {
    const JOINT: f64 = 0.022;
    const RIM: f64 = 0.10;
    let inside =
        |i: i64, j: i64| rectangles.iter().any(|r| (r[0]..r[2]).contains(&i) && (r[1]..r[3]).contains(&j));
    // Lines across one axis: beside each joint, on it, and the rim beyond a rectangle's end.
    let lines = |axis: usize| {
        let (low, high) =
            rectangles.iter().fold((i64::MAX, i64::MIN), |(a, b), r| (a.min(r[axis]), b.max(r[axis + 2])));
        let at = |n: i64| ORIGIN[axis] + n as f64 * SLAB;
        let mut out: Vec<f64> = (low..=high).flat_map(|n| [at(n) - JOINT, at(n), at(n) + JOINT]).collect();
        // The rim needs a line beyond each rectangle's end.
        out.extend(rectangles.iter().flat_map(|r| [at(r[axis]) - RIM, at(r[axis + 2]) + RIM]));
        sorted(out)
    };
    let (xs, zs) = (lines(0), lines(1));
    let slab = |x: f64, z: f64| {
        inside(((x - ORIGIN[0]) / SLAB).floor() as i64, ((z - ORIGIN[1]) / SLAB).floor() as i64)
    };
    // A cell is kept if it is paved or lies within the rim of a paved one.
    let kept = |j: usize, i: usize| {
        let (x, z) = ((xs[i] + xs[i + 1]) / 2.0, (zs[j] + zs[j + 1]) / 2.0);
        let near = |d: f64| slab(x + d, z) || slab(x - d, z) || slab(x, z + d) || slab(x, z - d);
        slab(x, z) || near(RIM) || [RIM, -RIM].iter().any(|&d| slab(x + d, z + RIM) || slab(x + d, z - RIM))
    };
    let mut mesh = sheet(&zs, &xs, kept, |z, x| {
        let e = 1e-6;
        let inner = slab(x - e, z - e) && slab(x + e, z - e) && slab(x - e, z + e) && slab(x + e, z + e);
        let on_joint = |v: f64, axis: usize| {
            let slabs = (v - ORIGIN[axis]) / SLAB;
            (slabs - slabs.round()).abs() * SLAB < e
        };
        let y = if !inner {
            0.03 - 0.85 * distance(rectangles, x, z)
        } else if on_joint(x, 0) || on_joint(z, 1) {
            0.016
        } else {
            0.032
        };
        DVec3::new(x, y, z)
    });
    mesh.uvs = mesh.positions.iter().map(|p| glam::DVec2::new(p.x - ORIGIN[0], p.z - ORIGIN[1])).collect();
    mesh
}

/// Land and a street beyond the fence: they bounce light back and end the view.
fn surroundings(model: &mut Model) {
    const Y: f64 = -0.06;
    const FAR: f64 = 60.0;
    // A ring that starts under the yard's rim and inside the house.
    let (x, z) = ([-8.0, 8.05], [-6.05, 6.0]);
    for (x0, x1, z0, z1) in
        [(-FAR, FAR, -FAR, z[0]), (-FAR, x[0], z[0], z[1]), (x[1], FAR, z[0], z[1]), (-FAR, FAR, z[1], FAR)]
    {
        model.add("land_occluder", "fields", block([x0, -1.0, z0], [x1, Y, z1], TOP));
    }
    model.add("street_occluder", "street", block([-FAR, -1.0, 8.0], [FAR, Y + 0.03, 13.0], ALL & !BOTTOM));
    for x in [[-1.6, -0.4], [4.4, 7.4]] {
        model.add(
            "street_occluder",
            "street",
            block([x[0], -1.0, 6.0], [x[1], Y + 0.06, 8.1], ALL & !BOTTOM),
        );
    }
}
