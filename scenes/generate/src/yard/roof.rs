//! The house's tiled roof with eaves, gutter, downpipes and chimney.

use super::{FRONT, HOUSE_X};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, sorted, steps};
use crate::shapes::{ALL, BOTTOM, bevelled, block, prism, tube};
use glam::{DVec2, DVec3};

/// Width of a roof tile.
pub const TILE_WIDTH: f64 = 0.33;
/// Eaves line and ridge of the bare roof, (z, y); a 3-4-5 slope.
const EAVES: [f64; 2] = [FRONT + 0.5, 2.975];
const RIDGE: [f64; 2] = [FRONT - 2.5, 5.225];
/// Underside of the eaves.
const SOFFIT: f64 = 2.86;
/// Gable overhang.
const OVERHANG: f64 = 0.3;

pub fn build(model: &mut Model) {
    let (x0, x1) = (HOUSE_X[0] - OVERHANG, HOUSE_X[1] + OVERHANG);
    let back = 2.0 * RIDGE[0] - EAVES[0];
    let section = [RIDGE, [back, EAVES[1]], [back, SOFFIT], [FRONT - 0.1, SOFFIT], [EAVES[0], SOFFIT], EAVES];
    let (sides, ends) = prism(&section, x0, x1);
    let [far_slope, far_fascia, under, soffit, fascia, slope] =
        <[Mesh; 6]>::try_from(sides).expect("six edges");
    model.add("soffit", "white_wood", soffit);
    model.add("roof_detail", "white_wood", fascia);
    for hidden in [under, slope, far_fascia] {
        model.add("roof_occluder", "white_wood", hidden);
    }
    model.add("roof_occluder", "roof_tiles", far_slope);
    model.add("roof_occluder", "plaster", ends);
    model.add("roof", "roof_tiles", tiles(x0, x1));
    let ridge = |x: f64| (DVec3::new(x, RIDGE[1], RIDGE[0]), 0.13);
    model.add("roof_detail", "roof_tiles", tube(&[ridge(x0 - 0.03), ridge(x1 + 0.03)], 12));
    chimney(model);
    gutter(model, x0, x1);
}

/// Rows of tiles: each row ramps down to the row above, each tile swells across. The sheet's rim dives below
/// the bare slope, so that nobody sees under it.
fn tiles(x0: f64, x1: f64) -> Mesh {
    // How far in from the gables the first tiles begin.
    const MARGIN: f64 = 0.09;
    let (run, rise) = (RIDGE[0] - EAVES[0], RIDGE[1] - EAVES[1]);
    let length = (run * run + rise * rise).sqrt();
    let along = DVec3::new(0.0, rise / length, run / length);
    let up = DVec3::new(0.0, -run / length, rise / length);
    let rows = 10;
    let pitch = (length - 0.02) / rows as f64;
    let mut vs = vec![0.005];
    for row in 0..rows {
        let foot = 0.005 + row as f64 * pitch;
        // The lowest row climbs out of the eaves more gently.
        vs.extend([foot + if row == 0 { 0.08 } else { 0.03 }, foot + pitch]);
    }
    let columns = ((x1 - x0 - 2.0 * MARGIN) / TILE_WIDTH).round();
    let width = (x1 - x0 - 2.0 * MARGIN) / columns;
    let mut us = vec![x0 + 0.005, x1 - 0.005];
    us.extend(steps(x0 + MARGIN, x1 - MARGIN, columns as usize * 2));
    let (us, vs) = (sorted(us), sorted(vs));
    let (first, last) = (us[0], us[us.len() - 1]);
    let mut mesh = full(&us, &vs, |x, v| {
        let row = ((v - 0.005) / pitch).fract();
        let at_foot = row > 1e-6 && row < 1.0 - 1e-6;
        // Seams between tiles lie low, their middles swell.
        let halves = ((x - x0 - MARGIN) / width * 2.0).round().rem_euclid(2.0);
        let swell = 0.03 * halves;
        let border = x == first || x == last || v == vs[0];
        let lift = if border { -0.02 } else { (if at_foot { 0.058 } else { 0.022 }) + swell };
        DVec3::new(x, EAVES[1], EAVES[0]) + along * v + up * lift
    });
    // One texture cell per tile.
    mesh.uvs.iter_mut().for_each(|uv| {
        *uv = DVec2::new((uv.x - x0 - MARGIN) / width, (uv.y + 0.005) / pitch) * TILE_WIDTH;
    });
    mesh
}

fn chimney(model: &mut Model) {
    let (x, z) = ([1.1, 1.75], [-8.1, -7.5]);
    let stack = block([x[0], 4.2, z[0]], [x[1], 5.95, z[1]], ALL & !BOTTOM);
    model.add("chimney", "brick", stack);
    model.add(
        "roof_detail",
        "stone",
        bevelled([x[0] - 0.06, 5.9, z[0] - 0.06], [x[1] + 0.06, 6.02, z[1] + 0.06], 0.02),
    );
    let pot = tube(&[(DVec3::new(1.42, 5.95, -7.8), 0.12), (DVec3::new(1.42, 6.35, -7.8), 0.1)], 12);
    model.add("roof_detail", "terracotta", pot);
}

/// A half-round trough along the eaves, closed by end plates, and a downpipe at each end.
fn gutter(model: &mut Model, x0: f64, x1: f64) {
    let (y, z) = (2.95, EAVES[0] + 0.05);
    let (outer, inner) = (0.07, 0.06);
    // From the back rim around the outside to the front rim, and back along the inside.
    let mut profile = Vec::new();
    let point = |r: f64, k: usize| {
        let (sin, cos) = (std::f64::consts::PI * k as f64 / 8.0).sin_cos();
        DVec3::new(0.0, y - r * sin, z - r * cos)
    };
    profile.extend((0..=8).map(|k| point(outer, k)));
    profile.extend((0..=8).rev().map(|k| point(inner, k)));
    profile.push(point(outer, 0));
    let mut trough = Mesh::default();
    for pair in profile.windows(2) {
        trough.quad(
            pair[0] + DVec3::X * x0,
            pair[0] + DVec3::X * x1,
            pair[1] + DVec3::X * x1,
            pair[1] + DVec3::X * x0,
        );
    }
    model.add("roof_detail", "metal", trough);
    for x in [x0, x1] {
        let plate = [(DVec3::new(x - 0.02, y - 0.01, z), 0.085), (DVec3::new(x + 0.02, y - 0.01, z), 0.085)];
        model.add("roof_detail", "metal", tube(&plate, 16));
    }
    let wall = FRONT + 0.07;
    let pipe = |points: &[[f64; 3]]| {
        let path: Vec<_> = points.iter().map(|&p| (DVec3::from(p), 0.045)).collect();
        tube(&path, 10)
    };
    // One ends above the rain barrel, one in the ground beside the garage.
    let west = [
        [-7.62, 2.91, z],
        [-7.62, 2.72, z],
        [-7.62, 2.5, wall],
        [-7.62, 1.35, wall],
        [-7.6, 1.2, wall + 0.1],
        [-7.5, 1.08, wall + 0.45],
    ];
    let east = [[3.8, 2.91, z], [3.8, 2.72, z], [3.8, 2.5, wall], [3.8, -0.2, wall]];
    model.add("roof_detail", "metal", pipe(&west).with(pipe(&east)));
}
