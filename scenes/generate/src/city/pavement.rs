//! Pavements with kerb stones: along each block's two streets and around its corner.

use super::{Block, CHAMFER, END, PAVED, blocks};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, steps};
use glam::{DVec2, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Width of the kerb stones.
const KERB: f64 = 0.3;
/// Pavements reach under the façades by this much.
const LAP: f64 = 0.05;

pub fn build(model: &mut Model) {
    for block in blocks() {
        let (x, z) = (block.west, block.south);
        let corner = [x[0] + CHAMFER, z[0] + CHAMFER];
        let mut lay = |name: &str, mut mesh: Mesh| {
            // Slabs follow the streets.
            mesh.uvs = mesh.positions.iter().map(|p| DVec2::new(p.x, p.z)).collect();
            let name = format!("{name} {}", block.site.turn / 90.0 + 1.0);
            model.add(&name, "paving", block.site.set(mesh));
        };
        let inner = [x[1] + KERB - 0.02, z[1] + KERB - 0.02];
        // South and west arms, split so that no triangle is too long.
        let south =
            full(&[-z[0] - LAP, -inner[1]], &steps(corner[0], END, 4), |z, x| DVec3::new(x, PAVED, z));
        let west = full(&steps(-END, -corner[1], 4), &[inner[0], x[0] + LAP], |z, x| DVec3::new(x, PAVED, z));
        lay("pavement south", south);
        lay("pavement west", west);
        lay("pavement corner", around_the_corner(&block, inner));
        kerb(model, &block);
    }
}

/// The kerb's line at `offset` metres from its edge towards the houses: down the west side, round, along the
/// south side. The corner is an ellipse about the meeting point of the façades.
fn line(block: &Block, offset: f64, ends: [f64; 2]) -> Vec<DVec3> {
    let (x, z) = (block.west, block.south);
    let (rx, rz) = (x[0] - x[1] - offset, z[0] - z[1] - offset);
    let mut points = vec![DVec3::new(x[1] + offset, 0.0, -ends[1])];
    points.extend(steps(0.0, FRAC_PI_2, 14).into_iter().map(|angle| {
        let (sin, cos) = angle.sin_cos();
        DVec3::new(x[0] - rx * cos, 0.0, -z[0] + rz * sin)
    }));
    points.push(DVec3::new(ends[0], 0.0, -z[1] - offset));
    points
}

/// From the cut corner of the houses to the kerb.
fn around_the_corner(block: &Block, inner: [f64; 2]) -> Mesh {
    let (x, z) = (block.west, block.south);
    let ends = [x[0] + CHAMFER, z[0] + CHAMFER];
    let outer = line(block, inner[0] - x[1], ends);
    let count = outer.len() - 1;
    let (a, b) = (DVec3::new(x[0], 0.0, -ends[1]), DVec3::new(ends[0], 0.0, -z[0]));
    let back = (DVec3::X - DVec3::Z) * LAP;
    full(&steps(0.0, count as f64, count), &[0.0, 1.0], |k, t| {
        let near = outer[k as usize];
        let far =
            a.lerp(b, k / count as f64) + if k == 0.0 || k == count as f64 { DVec3::ZERO } else { back };
        near.lerp(far, t) + DVec3::Y * PAVED
    })
}

/// Rounded granite stones along the road's edge.
fn kerb(model: &mut Model, block: &Block) {
    // From the foot in the gutter over the rounded nose to the back: [towards the houses, up].
    let profile = [
        [0.0, -0.06],
        [0.0, 0.105],
        [0.012, 0.14],
        [0.035, 0.158],
        [0.06, 0.163],
        [KERB, PAVED + 0.004],
        [KERB + 0.02, PAVED - 0.03],
    ];
    let lines: Vec<Vec<DVec3>> = profile.iter().map(|p| line(block, p[0], [END, END])).collect();
    let points = lines[0].len();
    let ks: Vec<f64> = (0..profile.len()).map(|k| k as f64).collect();
    let mesh = full(&steps(0.0, (points - 1) as f64, points - 1), &ks, |i, k| {
        lines[k as usize][i as usize] + DVec3::Y * profile[k as usize][1]
    });
    let mut mesh = block.site.set(mesh);
    mesh.uvs.iter_mut().for_each(|uv| *uv = DVec2::ZERO);
    model.add("kerb_detail", "granite", mesh);
}
