//! The roadways: four cambered arms, zebra crossings, and the level middle with its rounded corners.

use super::{AVENUE, Block, END, STREET, blocks};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, steps};
use crate::shapes::lathe;
use glam::{DVec2, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Metres that the road's texture covers: the avenue's roadway.
pub const ROAD: f64 = 2.0 * AVENUE[1];
/// Length of a zebra crossing along the road.
const ZEBRA: f64 = 4.0;
/// Height of the roadway's middle over its gutters, and the length over which it rises from the crossing.
const CAMBER: [f64; 2] = [0.09, 8.0];
/// The roadways dive under the kerbs by this much.
const LAP: f64 = 0.06;

pub fn build(model: &mut Model) {
    for block in blocks() {
        arm(model, &block);
        corner(model, &block);
    }
    // The middle: a level rectangle as wide as one roadway and as long as the other street.
    let (x, z) = (AVENUE[1], STREET[0]);
    let level = |xs: &[f64], zs: &[f64]| full(zs, xs, |z, x| DVec3::new(x, 0.0, z));
    let rest = level(&[-AVENUE[0], -x], &[-STREET[1], STREET[1]]);
    let east = level(&[x, AVENUE[0]], &[-STREET[1], STREET[1]]);
    let middle = level(&[-x, x], &[-z, -STREET[1], STREET[1], z]);
    model.add("crossing", "asphalt", planar(middle.with(rest).with(east)));
    manholes(model);
}

/// Height of an arm's surface `across` from its middle and `along` it from the crossing.
pub fn height(half: f64, across: f64, along: f64) -> f64 {
    CAMBER[0] * (along / CAMBER[1]).clamp(0.0, 1.0) * (1.0 - (across / half).powi(2))
}

/// The road along the block's west side, from the crossing northwards, with its zebra crossing.
fn arm(model: &mut Model, block: &Block) {
    let half = block.west[1];
    let start = block.south[0];
    let width = half + LAP;
    let across = [-width, -half, -half * 0.6, 0.0, half * 0.6, half, width];
    let surface = |alongs: &[f64]| {
        let mut mesh = full(alongs, &across, |along, x| {
            let y = if x.abs() > half { -0.02 } else { height(half, x, along - start - ZEBRA) };
            DVec3::new(x, y, -along)
        });
        // The texture lies across the road once, whatever its width.
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let uvs = mesh.positions.iter().map(|p| DVec2::new((p.x / half + 1.0) * AVENUE[1], p.z - start));
        mesh.uvs = uvs.collect();
        block.site.set(mesh.smoothed())
    };
    let mut alongs = vec![start + ZEBRA];
    alongs.extend(steps(start + ZEBRA + 4.0, END, 8));
    model.add(&format!("road {}", block.site.turn / 90.0 + 1.0), "road", surface(&alongs));
    model.add("zebras", "zebra", surface(&[start, start + ZEBRA]));
}

/// Between the rounded kerb and the middle.
fn corner(model: &mut Model, block: &Block) {
    let (x, z) = (block.west, block.south);
    let tip = DVec3::new(x[1], 0.0, -z[1]);
    let arc: Vec<DVec3> = steps(0.0, FRAC_PI_2, 12)
        .into_iter()
        .map(|angle| {
            let (sin, cos) = angle.sin_cos();
            // Through the ends of the kerbs, from the west side to the south side.
            DVec3::new(x[0] - (x[0] - x[1]) * cos, 0.0, -z[0] + (z[0] - z[1]) * sin)
        })
        .collect();
    let mut mesh = Mesh::default();
    for pair in arc.windows(2) {
        mesh.polygon(&[tip, pair[1], pair[0]].map(|p| (p, DVec2::ZERO)));
    }
    model.add("crossing", "asphalt", planar(block.site.set(mesh)));
}

/// Texture coordinates from the ground plane.
fn planar(mut mesh: Mesh) -> Mesh {
    mesh.uvs = mesh.positions.iter().map(|p| DVec2::new(p.x, p.z)).collect();
    mesh
}

/// Cast-iron covers, a little proud of the asphalt, and gully grates along the kerbs.
fn manholes(model: &mut Model) {
    let cover = lathe(
        &[&[(0.36, -0.05), (0.36, 0.006)], &[(0.36, 0.006), (0.31, 0.012)], &[(0.31, 0.012), (0.0, 0.012)]],
        28,
    );
    let stud = |x: f64, z: f64| {
        crate::shapes::bevelled([x - 0.03, -0.02, z - 0.03], [x + 0.03, 0.02, z + 0.03], 0.008).standing()
    };
    let mut studs = Mesh::default();
    for i in -3i32..=3 {
        for j in -3i32..=3 {
            if (i * i + j * j) < 11 {
                studs.append(stud(0.08 * f64::from(i), 0.08 * f64::from(j)));
            }
        }
    }
    let cover = model.shape("manhole_detail", "iron", cover.with(studs));
    for (x, z) in [(1.6, -2.4), (-2.0, 5.2), (2.2, -19.0), (-1.8, 27.0), (-1.9, -33.5), (1.7, 17.5)] {
        let along = f64::abs(z) - STREET[0] - ZEBRA;
        model.place_all(&[cover], DVec3::new(x, height(AVENUE[1], x, along), z), x * 40.0, DVec3::ONE);
    }
    for (x, z) in [(19.0, 0.9), (-24.0, -1.0), (35.0, -0.8), (-37.0, 0.7)] {
        let along = f64::abs(x) - AVENUE[0] - ZEBRA;
        model.place_all(&[cover], DVec3::new(x, height(STREET[1], z, along), z), x * 40.0, DVec3::ONE);
    }
}
