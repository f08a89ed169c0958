//! Street furniture: benches, bins, bollards, planters, bicycle stands, traffic lights, a bus shelter.

use super::{AVENUE, PAVED, STREET, Site, blocks};
use crate::foliage::shrub;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, steps};
use crate::shapes::{ALL, BOTTOM, NORTH, SOUTH, TOP, bevelled, block, lathe, tube, tube_side};
use glam::DVec3;
use std::f64::consts::PI;

pub fn build(model: &mut Model) {
    let (bench, bin, bollard) = (bench(model), bin(model), bollard(model));
    let (planter, stand, lights) = (planter(model), stand(model), traffic_light(model));
    for (k, block) in blocks().iter().enumerate() {
        let (x, z) = (block.west, block.south);
        // In a block's frame: beside the kerb of its south side, x to the east.
        let south =
            |along: f64, behind: f64, turn: f64| block.site.within(x[0] + along, PAVED, -z[1] - behind, turn);
        let west = |along: f64, behind: f64, turn: f64| {
            block.site.within(x[1] + behind, PAVED, -z[0] - along, turn - 90.0)
        };
        let avenue_is_west = x == AVENUE;
        let along_avenue = |along: f64, behind: f64, turn: f64| {
            if avenue_is_west { west(along, behind, turn) } else { south(along, behind, turn) }
        };
        // Benches between the avenue's trees and lamps, with their backs to the road; bins beside them.
        for along in [13.4, 25.2] {
            along_avenue(along, 0.95, 180.0).place(model, &bench);
            along_avenue(along - 1.4, 0.85, 0.0).place(model, &bin);
        }
        // Bollards around the corner, but for the zebra crossings.
        for angle in [0.28, 0.5, 0.72].map(|t| t * PI / 2.0) {
            let r = [x[0] - x[1] - 0.55, z[0] - z[1] - 0.55];
            let at =
                block.site.within(x[0] - r[0] * f64::cos(angle), PAVED, -z[0] + r[1] * f64::sin(angle), 0.0);
            at.place(model, &bollard);
        }
        for along in [6.5, 8.0, 9.5, 11.0, 12.5] {
            let at = if avenue_is_west { south(along, 0.5, 0.0) } else { west(along, 0.5, 0.0) };
            at.place(model, &bollard);
        }
        for along in [5.5, 7.2] {
            along_avenue(along + 1.4, 0.95, 90.0 * k as f64).place(model, &planter);
        }
        // Stands where bicycles are chained, across from the shops.
        for n in 0..4 {
            let along = 18.6 + 0.9 * f64::from(n);
            let at = if avenue_is_west { south(along, 1.0, 0.0) } else { west(along, 1.0, 0.0) };
            at.place(model, &stand);
        }
        // One light for each road that arrives here.
        south(4.5, 0.55, 90.0).place(model, &lights);
        west(4.6, 0.55, -90.0).place(model, &lights);
    }
    shelter(model);
}

/// A bench that faces +Z: slats on cast sides.
fn bench(model: &mut Model) -> Vec<usize> {
    let half = 0.9;
    let mut slats = Mesh::default();
    for k in 0..4 {
        let z = -0.2 + 0.12 * f64::from(k);
        slats.append(bevelled([-half, 0.42, z], [half, 0.455, z + 0.105], 0.008));
    }
    let lean =
        |mesh: Mesh| mesh.transformed(glam::DAffine3::from_rotation_x(-0.2)).translated(0.0, 0.45, -0.22);
    let mut back = Mesh::default();
    for k in 0..3 {
        let y = 0.1 + 0.14 * f64::from(k);
        back.append(bevelled([-half, y, -0.018], [half, y + 0.12, 0.018], 0.008));
    }
    let (top, rest) = slats.with(lean(back)).split(|n| n.y > 0.99 || n.z > 0.95);
    let lit = model.shape("bench", "oak", top);
    let detail = model.shape("bench_detail", "oak", rest);
    for x in [-0.72, 0.72] {
        let leg = |points: &[[f64; 2]]| {
            let path: Vec<_> = points.iter().map(|&[z, y]| (DVec3::new(x, y, z), 0.024)).collect();
            tube(&path, 8)
        };
        let side =
            leg(&[[0.26, -0.01], [0.2, 0.2], [0.27, 0.41], [-0.2, 0.41], [-0.27, 0.2], [-0.22, -0.01]]);
        let stile = leg(&[[-0.22, 0.4], [-0.33, 0.96]]);
        let arm = leg(&[[-0.28, 0.7], [0.0, 0.68], [0.22, 0.66], [0.27, 0.6], [0.23, 0.41]]);
        model.shape("bench_detail", "iron", side.with(stile).with(arm));
    }
    vec![lit, detail]
}

/// A slatted bin with a hood on a foot.
fn bin(model: &mut Model) -> Vec<usize> {
    let inner = lathe(
        &[
            &[(0.0, 0.1), (0.2, 0.1)],
            &[(0.2, 0.1), (0.22, 0.78)],
            &[(0.22, 0.78), (0.19, 0.78)],
            &[(0.19, 0.78), (0.17, 0.4), (0.0, 0.4)],
        ],
        18,
    );
    let detail = model.shape("bin_detail", "iron", inner);
    let mut rest = lathe(&[&[(0.09, -0.02), (0.07, 0.12)]], 10);
    for k in 0..18 {
        let turn = 20.0 * f64::from(k);
        rest.append(bevelled([-0.026, 0.14, 0.2], [0.026, 0.76, 0.235], 0.006).turned(turn));
    }
    rest.append(lathe(
        &[
            &[(0.25, 0.95), (0.25, 0.98)],
            &[(0.25, 0.98), (0.16, 1.06), (0.0, 1.09)],
            &[(0.0, 0.94), (0.25, 0.95)],
        ],
        18,
    ));
    for x in [-0.2, 0.2] {
        rest.append(tube(&[(DVec3::new(x, 0.7, 0.0), 0.012), (DVec3::new(x, 0.97, 0.0), 0.012)], 6));
    }
    model.shape("bin_detail", "green_wood", rest);
    vec![detail]
}

fn bollard(model: &mut Model) -> Vec<usize> {
    let post = lathe(
        &[
            &[(0.11, -0.02), (0.11, 0.1)],
            &[(0.11, 0.1), (0.075, 0.15), (0.065, 0.75)],
            &[(0.065, 0.75), (0.085, 0.78), (0.065, 0.81)],
            &[(0.06, 0.81), (0.085, 0.87), (0.08, 0.93), (0.045, 0.98), (0.0, 0.99)],
        ],
        14,
    );
    vec![model.shape("bollard_detail", "iron", post)]
}

/// A square stone tub with a box shrub and flowers.
fn planter(model: &mut Model) -> Vec<usize> {
    let body = bevelled([-0.55, -0.02, -0.55], [0.55, 0.55, 0.55], 0.03).standing();
    let (broad, thin) = body.split(|n| n.x.abs() > 0.99 || n.z.abs() > 0.99);
    let lit = model.shape("planter", "granite", broad);
    let detail = model.shape("planter_detail", "granite", thin);
    model.shape("planter_detail", "granite", bevelled([-0.6, 0.48, -0.6], [0.6, 0.56, 0.6], 0.02));
    model.shape("planter_detail", "soil", block([-0.5, 0.0, -0.5], [0.5, 0.565, 0.5], TOP));
    let tall = shrub(DVec3::Y * 1.0, DVec3::new(0.42, 0.55, 0.42), 170, 0.16..0.26, 41);
    let low = shrub(DVec3::Y * 0.62, DVec3::new(0.5, 0.18, 0.5), 60, 0.14..0.22, 42);
    let leaves = model.shape("leaves_planter", "box_leaves", tall);
    model.shape("leaves_planter", "leaves", low);
    vec![lit, detail, leaves]
}

/// A bent tube to which bicycles are chained.
fn stand(model: &mut Model) -> Vec<usize> {
    let mut path = vec![(DVec3::new(0.0, -0.02, -0.35), 0.024)];
    path.extend(
        steps(0.0, PI, 12)
            .into_iter()
            .map(|a| (DVec3::new(0.0, 0.6 + 0.25 * a.sin(), -0.35 * a.cos()), 0.024)),
    );
    path.push((DVec3::new(0.0, -0.02, 0.35), 0.024));
    vec![model.shape("stand_detail", "steel", tube_side(&path, 8))]
}

/// A post with three lights towards +Z and a sign.
fn traffic_light(model: &mut Model) -> Vec<usize> {
    let post = lathe(
        &[
            &[(0.09, -0.02), (0.09, 0.25)],
            &[(0.09, 0.25), (0.055, 0.3), (0.05, 3.3)],
            &[(0.05, 3.3), (0.0, 3.33)],
        ],
        12,
    );
    let detail = model.shape("traffic_light_detail", "zinc", post);
    let mut dark = bevelled([-0.16, 2.3, 0.06], [0.16, 3.25, 0.28], 0.03);
    dark.append(bevelled([-0.04, 2.5, -0.02], [0.04, 3.05, 0.1], 0.01));
    for (k, lens) in ["green_wood", "mustard", "tail_light"].into_iter().enumerate() {
        let y = 2.46 + 0.3 * k as f64;
        let disc =
            lathe(&[&[(0.1, 0.0), (0.0, 0.03)]], 16).transformed(glam::DAffine3::from_rotation_x(PI / 2.0));
        model.shape("traffic_light_detail", lens, disc.translated(0.0, y, 0.278));
        // A hood over the lens: a half pipe with a thickness.
        let arc = steps(0.0, PI, 10);
        let pipe = |r: f64, flip: bool| {
            let mesh =
                full(&arc, &[0.0, 1.0], |a, t| DVec3::new(r * a.cos(), y + r * a.sin(), 0.27 + 0.17 * t));
            if flip { super::site::turned_over(mesh) } else { mesh }
        };
        dark.append(pipe(0.115, true).with(pipe(0.125, false)));
    }
    model.shape("traffic_light_detail", "iron", dark);
    vec![detail]
}

/// A bus shelter on the avenue's west side: glass is left out, its back is a timetable and a poster.
fn shelter(model: &mut Model) {
    let site = Site::new(DVec3::new(-AVENUE[1] - 1.9, PAVED, -STREET[0] - 16.6 - 14.0), 90.0);
    let (half, deep, high) = (2.2, 0.75, 2.45);
    let roof = bevelled([-half - 0.15, high, -deep - 0.1], [half + 0.15, high + 0.12, deep + 0.35], 0.03);
    let (broad, thin) = roof.split(|n| n.y.abs() > 0.99);
    model.add("shelter", "zinc", site.set(broad));
    let mut steel = thin;
    for x in [-half, 0.0, half] {
        steel.append(tube(
            &[(DVec3::new(x, -0.02, -deep), 0.04), (DVec3::new(x, high + 0.05, -deep), 0.04)],
            10,
        ));
        steel.append(tube(
            &[(DVec3::new(x, high - 0.1, -deep), 0.03), (DVec3::new(x, high + 0.04, deep), 0.025)],
            8,
        ));
    }
    for y in [0.25, 1.1] {
        steel.append(tube(&[(DVec3::new(-half, y, -deep), 0.02), (DVec3::new(half, y, -deep), 0.02)], 8));
    }
    for k in 0..3 {
        let z = -0.45 + 0.14 * f64::from(k);
        steel.append(bevelled([-half + 0.3, 0.44, z], [half - 0.3, 0.475, z + 0.12], 0.01));
    }
    for x in [-1.4, 1.4] {
        steel.append(tube(&[(DVec3::new(x, 0.45, -0.25), 0.03), (DVec3::new(x, 0.45, -deep), 0.03)], 8));
    }
    model.add("shelter_detail", "steel", site.set(steel));
    // The back's left half is a panel with a poster on either face; the side wall stands across.
    let panel = block([-half + 0.05, 0.3, -deep - 0.03], [-0.06, 2.2, -deep + 0.03], NORTH | SOUTH);
    model.add("shelter", "paper", site.set(panel));
    let rim = block([-half + 0.05, 0.3, -deep - 0.03], [-0.06, 2.2, -deep + 0.03], ALL & !NORTH & !SOUTH);
    model.add("shelter_detail", "steel", site.set(rim));
    for (x, y, w, h, cloth) in [(-1.6, 1.2, 0.4, 0.75, "blue_cloth"), (-0.62, 1.35, 0.35, 0.55, "mustard")] {
        let picture = block([x - w, y - h, -deep], [x + w, y + h, -deep + 0.04], ALL & !NORTH & !BOTTOM);
        model.add("shelter_detail", cloth, site.set(picture));
    }
    let box_body = bevelled([half - 0.09, 0.1, -deep + 0.15], [half + 0.09, 2.1, deep - 0.1], 0.02);
    let (faces, rest) = box_body.split(|n| n.x.abs() > 0.99);
    model.add("shelter_poster", "paper", site.set(faces));
    model.add("shelter_detail", "steel", site.set(rest));
}
