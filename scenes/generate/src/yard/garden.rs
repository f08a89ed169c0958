//! Garden things: barrel, pots, woodpile, raised bed, sandbox, swing, lanterns, dustbin and stepping stones.

use super::foliage::shrub;
use super::ground::height;
use super::{FRONT, WEST_X};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use crate::shapes::{ALL, BOTTOM, EAST, NORTH, SOUTH, TOP, WEST, bevelled, block, lathe, tube};
use glam::DVec3;

/// Centres of the garden lamps: beside the path, by the terrace, by the drive, by the bench. The scene file
/// has the lamps there.
pub const LANTERNS: [[f64; 2]; 4] = [[-1.95, 4.9], [0.0, -1.9], [4.12, 0.4], [-7.3, 1.2]];

pub fn build(model: &mut Model) {
    barrels(model);
    pots(model);
    woodpile(model);
    raised_bed(model);
    sandbox(model);
    swing(model);
    lanterns(model);
    dustbin(model);
    stepping_stones(model);
}

/// A rain barrel under the downpipe, with water, and a second one by the drive.
fn barrels(model: &mut Model) {
    let staves: [(f64, f64); 5] = [(0.27, -0.1), (0.31, 0.2), (0.325, 0.45), (0.31, 0.7), (0.27, 0.95)];
    let body = lathe(&[&staves], 18);
    let rim = lathe(&[&[(0.27, 0.95), (0.24, 0.95)], &[(0.24, 0.95), (0.26, 0.8)]], 18);
    let hoop = |y: f64, r: f64| {
        lathe(
            &[
                &[(r - 0.02, y - 0.02), (r, y - 0.02)],
                &[(r, y - 0.02), (r, y + 0.02)],
                &[(r, y + 0.02), (r - 0.02, y + 0.02)],
            ],
            18,
        )
    };
    let barrel = model.shape("barrel", "oak", body);
    let detail = model.shape("barrel_detail", "oak", rim);
    for (y, r) in [(0.14, 0.32), (0.45, 0.34), (0.8, 0.312)] {
        model.shape("barrel_detail", "iron", hoop(y, r));
    }
    let water = model.shape("barrel_water_detail", "glass", lathe(&[&[(0.29, 0.85), (0.0, 0.85)]], 18));
    let lid = model.shape("barrel_lid_detail", "oak", lathe(&[&[(0.29, 0.9), (0.0, 0.9)]], 18));
    let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
    model.place_all(&[barrel, detail, water], at(-7.48, FRONT + 0.5), 0.0, DVec3::ONE);
    model.place_all(&[barrel, detail, lid], at(3.62, -1.3), 40.0, DVec3::new(0.9, 0.9, 0.9));
}

/// Terracotta pots with shrubs, one mesh at several sizes.
fn pots(model: &mut Model) {
    let side: [(f64, f64); 2] = [(0.15, -0.02), (0.21, 0.34)];
    let pot = model.shape("pot", "terracotta", lathe(&[&side], 12));
    let lip: &[&[(f64, f64)]] = &[
        &[(0.20, 0.31), (0.235, 0.31)],
        &[(0.235, 0.31), (0.235, 0.38)],
        &[(0.235, 0.38), (0.19, 0.38)],
        &[(0.19, 0.38), (0.18, 0.28)],
    ];
    let detail = model.shape("pot_detail", "terracotta", lathe(lip, 12));
    model.shape("pot_detail", "soil", lathe(&[&[(0.2, 0.33), (0.0, 0.34)]], 12));
    let places = [
        (-2.35, 0.0, -5.55, 1.1),
        (0.4, 0.03, -5.5, 1.25),
        (-2.4, 0.0, -5.0, 0.8),
        (3.4, 0.03, -5.45, 1.2),
        (3.5, 0.03, -4.75, 0.9),
        (0.5, 0.03, -2.5, 1.0),
        (-2.45, 0.0, 5.4, 1.0),
        (7.7, 0.0, -1.1, 1.0),
    ];
    for (k, (x, y, z, size)) in places.into_iter().enumerate() {
        model.place_all(&[pot, detail], DVec3::new(x, y, z), 25.0 * k as f64, DVec3::splat(size));
        let centre = DVec3::new(x, y + 0.42 * size, z);
        shrub(model, centre, DVec3::new(0.2, 0.32, 0.2) * size, 26, 300 + k as u64);
    }
}

/// Split logs stacked against the brick wall, under a small board roof.
fn woodpile(model: &mut Model) {
    let mut random = Random::new(77);
    let (x0, x1) = (WEST_X[0] - 0.02, WEST_X[0] + 0.42);
    let pitch = 0.155;
    for row in 0..7 {
        let count = 13 - row % 2;
        for k in 0..count {
            let z = -4.2 + pitch * (k as f64 + 0.5 * (row % 2) as f64);
            let y = 0.13 + 0.134 * row as f64;
            let r = 0.07 + random.range(0.0, 0.008);
            let reach = x1 + random.range(-0.04, 0.04);
            // The end inside the wall is left out.
            let log = tube(&[(DVec3::new(x0, y, z), r), (DVec3::new(reach, y, z), r)], 7);
            model.add("woodpile_detail", "bark", log.split(|n| n.x > -0.99).0);
        }
    }
    for z in [-4.36, -2.18] {
        let post = block([x0 + 0.1, -0.15, z - 0.04], [x0 + 0.18, 1.3, z + 0.04], ALL);
        let front = block([x1 - 0.12, -0.15, z - 0.04], [x1 - 0.04, 1.2, z + 0.04], ALL);
        model.add("woodpile_detail", "oak", post.with(front));
    }
    for z in [-3.9, -2.6] {
        model.add("woodpile_detail", "oak", block([x0, -0.1, z - 0.05], [x1, 0.08, z + 0.05], ALL));
    }
    let roof = |faces| {
        block([-0.3, 0.0, -1.25], [0.3, 0.04, 1.25], faces)
            .transformed(glam::DAffine3::from_rotation_z(-0.22))
            .translated(x0 + 0.32, 1.22, -3.27)
    };
    model.add("woodpile_roof", "oak", roof(TOP | BOTTOM));
    model.add("woodpile_detail", "oak", roof(EAST | WEST | SOUTH | NORTH));
}

/// A timber bed with plants along the south fence.
fn raised_bed(model: &mut Model) {
    let (x, z, top) = ([-6.9, -3.3], [4.85, 5.6], 0.4);
    for (a, b) in [
        ([x[0], -0.15, z[0]], [x[1], top, z[0] + 0.06]),
        ([x[0], -0.15, z[1] - 0.06], [x[1], top, z[1]]),
        ([x[0] - 0.04, -0.15, z[0] - 0.04], [x[0] + 0.04, top + 0.03, z[1] + 0.04]),
        ([x[1] - 0.04, -0.15, z[0] - 0.04], [x[1] + 0.04, top + 0.03, z[1] + 0.04]),
    ] {
        let long = b[0] - a[0] > 1.0;
        let (broad, thin) = if long { (SOUTH | NORTH, TOP) } else { (EAST | WEST, TOP | SOUTH | NORTH) };
        model.add("raised_bed", "oak", block(a, b, broad).grain_turned());
        model.add("raised_bed_detail", "oak", block(a, b, thin));
    }
    model.add("bed_soil", "soil", block([x[0], 0.0, z[0] + 0.02], [x[1], 0.33, z[1] - 0.02], TOP));
    for k in 0..7 {
        let centre = DVec3::new(x[0] + 0.3 + 0.5 * k as f64, 0.38, (z[0] + z[1]) / 2.0);
        shrub(model, centre, DVec3::new(0.22, 0.3, 0.2), 22, 400 + k);
    }
}

/// Sand in a frame of four planks, a bucket and a ball.
fn sandbox(model: &mut Model) {
    let (x, z) = ([1.1, 2.9], [2.4, 4.2]);
    let top = 0.2;
    let plank =
        |a: [f64; 2], b: [f64; 2], y: f64| bevelled([a[0], -0.1, a[1]], [b[0], y, b[1]], 0.012).standing();
    for (a, b, y) in [
        ([x[0], z[0]], [x[1], z[0] + 0.2], top),
        ([x[0], z[1] - 0.2], [x[1], z[1]], top),
        ([x[0] + 0.03, z[0] + 0.05], [x[0] + 0.2, z[1] - 0.05], top - 0.03),
        ([x[1] - 0.2, z[0] + 0.05], [x[1] - 0.03, z[1] - 0.05], top - 0.03),
    ] {
        let mut body = plank(a, b, y);
        if b[0] - a[0] > 1.0 {
            body = body.grain_turned();
        }
        model.add_split("sandbox_frame", "oak", body, |n| n.abs().max_element() > 0.99);
    }
    let grid = |low: f64, high: f64| crate::relief::steps(low + 0.1, high - 0.1, 10);
    let sand = crate::relief::full(&grid(z[0], z[1]), &grid(x[0], x[1]), |z, x| {
        DVec3::new(x, 0.07 + 0.09 * crate::random::noise(x * 2.2, z * 2.2, 64, 9), z)
    });
    model.add("sand", "sand", sand);
    let bucket: &[&[(f64, f64)]] = &[
        &[(0.09, -0.05), (0.13, 0.2)],
        &[(0.13, 0.2), (0.12, 0.2)],
        &[(0.12, 0.2), (0.09, 0.04), (0.0, 0.04)],
    ];
    model.add("toys_detail", "yellow_paint", lathe(bucket, 14).translated(1.75, 0.13, 3.1));
    let ball: Vec<(f64, f64)> = (0..=10)
        .map(|k| {
            let (sin, cos) = (std::f64::consts::PI * k as f64 / 10.0).sin_cos();
            (if k == 0 || k == 10 { 0.0 } else { 0.15 * sin }, -0.15 * cos)
        })
        .collect();
    let ball = lathe(&[&ball], 18).translated(0.3, height(0.3, 1.6) + 0.145, 1.6);
    model.add("toys_detail", "terracotta", ball);
}

/// An A-frame swing on the lawn.
fn swing(model: &mut Model) {
    let (x, z, top) = ([1.2, 3.4], 0.4, 2.1);
    let mut rod = |a: DVec3, b: DVec3, r: f64, material: &str| {
        model.add("swing_detail", material, tube(&[(a, r), (b, r)], 8));
    };
    rod(DVec3::new(x[0] - 0.12, top, z), DVec3::new(x[1] + 0.12, top, z), 0.05, "oak");
    for x in x {
        for s in [-1.0, 1.0] {
            rod(DVec3::new(x, top + 0.08, z - s * 0.03), DVec3::new(x, -0.15, z + s * 0.85), 0.045, "oak");
        }
        rod(DVec3::new(x, 0.9, z - 0.48), DVec3::new(x, 0.9, z + 0.48), 0.03, "oak");
    }
    for x in [2.06, 2.54] {
        rod(DVec3::new(x, top, z), DVec3::new(x, 0.5, z + 0.18), 0.012, "iron");
    }
    let seat = bevelled([2.0, 0.48, z + 0.07], [2.6, 0.52, z + 0.31], 0.01);
    model.add_split("swing_seat", "oak", seat.grain_turned(), |n| n.y.abs() > 0.99);
}

/// Lamp posts with open lanterns: a plate, four thin rods and a hat; the lamp hangs free between them.
fn lanterns(model: &mut Model) {
    let post = [(DVec3::new(0.0, -0.2, 0.0), 0.04), (DVec3::new(0.0, 1.62, 0.0), 0.03)];
    let foot = lathe(&[&[(0.12, -0.1), (0.11, 0.06), (0.05, 0.12), (0.02, 0.13)]], 12);
    let mut lantern = tube(&post, 8).with(foot);
    lantern.append(bevelled([-0.12, 1.6, -0.12], [0.12, 1.63, 0.12], 0.01));
    for (x, z) in [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)] {
        let rod = [(DVec3::new(x, 1.61, z), 0.006), (DVec3::new(x, 1.9, z), 0.006)];
        lantern.append(tube(&rod, 5));
    }
    lantern.append(lathe(&[&[(0.0, 1.885), (0.17, 1.885)], &[(0.17, 1.885), (0.05, 1.98), (0.0, 2.02)]], 12));
    let mesh = model.shape("lantern_detail", "iron", lantern);
    for [x, z] in LANTERNS {
        model.place_all(&[mesh], DVec3::new(x, 0.0, z), 0.0, DVec3::ONE);
    }
}

/// A dustbin beside the garage door.
fn dustbin(model: &mut Model) {
    let (x, z) = ([3.32, 3.82], [-0.75, -0.2]);
    let body = block([x[0], -0.08, z[0]], [x[1], 0.98, z[1]], ALL & !TOP & !BOTTOM);
    model.add("dustbin", "green_wood", body);
    let lid = bevelled([x[0] - 0.03, 0.94, z[0] - 0.03], [x[1] + 0.03, 1.02, z[1] + 0.03], 0.02);
    model.add_split("dustbin", "green_wood", lid, |n| n.y > 0.99);
}

/// Flat stones through the lawn from the path to the bench.
fn stepping_stones(model: &mut Model) {
    let mut random = Random::new(31);
    for k in 0..6 {
        let t = k as f64 / 5.0;
        let (x, z) = (-2.25 - 4.3 * t, 2.3 + 0.9 * t + random.range(-0.12, 0.12));
        let mut ring = Vec::new();
        for s in 0..9 {
            let (sin, cos) = (s as f64 * std::f64::consts::TAU / 9.0).sin_cos();
            let r = random.range(0.27, 0.36);
            ring.push([r * cos, r * sin]);
        }
        // A top and a worn rim that slopes into the lawn: one smooth cap, open below.
        let y = height(x, z) + 0.035;
        let mut stone = Mesh::default();
        let centre = stone.vertex(DVec3::new(x, y, z), Default::default());
        for (grow, drop) in [(1.0, 0.0), (1.2, 0.14)] {
            for p in &ring {
                stone.vertex(DVec3::new(x + p[0] * grow, y - drop, z + p[1] * grow), Default::default());
            }
        }
        for s in 0..9 {
            let (a, b) = (1 + s, 1 + (s + 1) % 9);
            stone.triangles.extend([[centre, b, a], [a, b, b + 9], [a, b + 9, a + 9]]);
        }
        model.add("stepping_stones", "stone", stone.smoothed());
    }
}
