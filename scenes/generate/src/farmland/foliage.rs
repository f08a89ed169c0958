//! Leaf cards, and what is made of them alone: hedges, bushes and tufts of grass. None of it gets texels.

use super::terrain::{TRACK, YARD, point};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::{Random, noise};
use crate::soft::cushion;
use glam::{DVec2, DVec3};

/// Length of the piece of hedge that is placed many times.
const HEDGE: f64 = 3.0;

/// A card that grows from `root` along `axis`, turned about it at random.
pub fn card(mesh: &mut Mesh, root: DVec3, axis: DVec3, size: f64, random: &mut Random) {
    let side = axis.cross(random.direction()).normalize_or(axis.any_orthonormal_vector()) * (size / 2.0);
    let high = root + axis * size;
    mesh.polygon(&[
        (root - side, DVec2::new(0.0, 1.0)),
        (root + side, DVec2::new(1.0, 1.0)),
        (high + side, DVec2::new(1.0, 0.0)),
        (high - side, DVec2::new(0.0, 0.0)),
    ]);
}

pub fn build(model: &mut Model) {
    hedges(model);
    bushes(model);
    tufts(model);
}

/// A lumpy dark core that no light passes, around the origin.
fn core(half: DVec3, seed: u64) -> Mesh {
    let mut core = cushion(half, half.min_element() * 0.8, 2, 3, DVec3::ZERO);
    for p in &mut core.positions {
        let lump = noise(p.x * 2.3 + 20.0, p.y * 2.3 + p.z * 2.9 + 20.0, 64, seed) - 0.5;
        *p *= 1.0 + 0.3 * lump;
    }
    core
}

/// Cards that leave the box `half` about `centre` to all sides, from near its surface.
fn coat(centre: DVec3, half: DVec3, cards: usize, size: [f64; 2], seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut leaves = Mesh::default();
    for _ in 0..cards {
        let out = random.direction();
        // Onto a rounded box: between the sphere and the cube.
        let onto = out / out.abs().max_element().powf(0.7);
        let root = centre + onto * half * random.range(0.72, 0.95);
        let axis = (out + DVec3::Y * 0.35 + random.direction() * 0.7).normalize();
        card(&mut leaves, root, axis, random.range(size[0], size[1]), &mut random);
    }
    leaves
}

/// Hedgerows between the fields and along the track.
fn hedges(model: &mut Model) {
    let half = DVec3::new(HEDGE / 2.0, 0.75, 0.55);
    let mut pieces = Vec::new();
    for k in 0..2 {
        let number = k + 1;
        let core = core(DVec3::new(HEDGE / 2.0 + 0.1, 0.66, 0.36), 221 + k).translated(0.0, 0.5, 0.0);
        let coat = coat(DVec3::Y * 0.75, half, 420, [0.34, 0.55], 223 + k);
        pieces.push([
            model.shape(&format!("hedge_{number}_occluder"), "thicket", core),
            model.shape(&format!("leaves_hedge_{number}"), "hedge_leaves", coat),
        ]);
    }
    let mut random = Random::new(225);
    // Runs in (u, v) from one point to another.
    let runs = [
        ([-62.0, YARD + 0.6], [-YARD, YARD + 0.6]),
        ([-YARD, -22.0], [-YARD, 10.0]),
        ([TRACK + 0.4, 29.0], [TRACK + 0.4, 61.0]),
        ([24.0, -58.0], [24.0, -25.0]),
    ];
    for (from, to) in runs {
        let (a, b) = (DVec2::from(from), DVec2::from(to));
        let count = ((b - a).length() / HEDGE).round() as usize;
        for k in 0..count {
            let at = |t: f64| {
                let p = a.lerp(b, t / count as f64);
                point(p.x, p.y)
            };
            let (start, end) = (at(k as f64), at(k as f64 + 1.0));
            let run = end - start;
            let flip = if random.range(0.0, 1.0) < 0.5 { 0.0 } else { 180.0 };
            let turn = (-run.z).atan2(run.x).to_degrees() + flip;
            let size =
                DVec3::new(1.04 * run.length() / HEDGE, random.range(0.85, 1.25), random.range(0.9, 1.2));
            let foot = (start + end) / 2.0 - DVec3::Y * 0.12;
            model.place_all(&pieces[k % 2], foot, turn, size);
        }
    }
}

/// Bushes beside the buildings and along the stone wall.
fn bushes(model: &mut Model) {
    let core = core(DVec3::new(0.5, 0.4, 0.5), 226).translated(0.0, 0.28, 0.0);
    let coat = coat(DVec3::Y * 0.5, DVec3::new(0.62, 0.5, 0.62), 340, [0.3, 0.46], 227);
    let bush =
        [model.shape("bush_occluder", "thicket", core), model.shape("leaves_bush", "bush_leaves", coat)];
    let places = [
        (8.8, -11.4, 0.9),
        (10.2, -11.7, 0.7),
        (17.2, -11.3, 1.1),
        (19.2, -14.5, 1.2),
        (19.4, -17.2, 1.0),
        (7.1, -17.0, 0.9),
        (-21.2, -14.0, 1.2),
        (-21.4, -8.4, 0.9),
        (22.0, 16.5, 1.3),
        (20.6, 18.2, 1.0),
        (-8.0, 21.5, 1.1),
        (-10.2, 22.3, 1.4),
        (-17.5, 20.8, 1.2),
        (33.0, -8.0, 1.5),
        (41.0, 9.0, 1.2),
        (52.0, -15.0, 1.7),
        (-36.0, -33.0, 1.6),
        (-14.0, -38.0, 1.4),
        (9.0, -44.0, 1.8),
        (47.0, -41.0, 1.5),
    ];
    for (k, (u, v, size)) in places.into_iter().enumerate() {
        let at = point(u, v) - DVec3::Y * 0.1;
        model.place_all(&bush, at, 77.0 * k as f64, DVec3::new(size, size * 0.95, size));
    }
}

/// Tufts of long grass where no wheel and no plough gets: along fences, walls and hedges, and strewn over the
/// pasture.
fn tufts(model: &mut Model) {
    let mut random = Random::new(231);
    let mut pieces = Vec::new();
    for k in 0..2 {
        let mut blades = Mesh::default();
        for _ in 0..8 {
            let root = DVec3::new(random.range(-0.28, 0.28), -0.08, random.range(-0.28, 0.28));
            let lean = random.direction() * DVec3::new(0.35, 0.0, 0.35);
            card(&mut blades, root, (DVec3::Y + lean).normalize(), random.range(0.38, 0.62), &mut random);
        }
        pieces.push(model.shape(&format!("tufts_{}", k + 1), "grass_blades", blades));
    }
    let mut put = |u: f64, v: f64, random: &mut Random| {
        let size = random.range(0.7, 1.3);
        let piece = pieces[(random.range(0.0, 2.0)) as usize];
        model.place_all(&[piece], point(u, v), random.range(0.0, 360.0), DVec3::splat(size));
    };
    // Along lines, strewn about them.
    let lines = [
        ([-62.0, YARD], [-TRACK - 1.0, YARD], 1.3, 70),
        ([TRACK + 1.0, YARD], [62.0, YARD], 0.9, 60),
        ([YARD, -22.0], [YARD, 22.0], 0.7, 50),
        ([-23.0, -23.2], [23.0, -23.2], 0.5, 40),
        ([-YARD, -22.0], [-YARD, 22.0], 1.2, 50),
        ([-TRACK, YARD], [-TRACK, 62.0], 0.7, 50),
        ([TRACK, YARD], [TRACK, 62.0], 0.7, 50),
        ([-20.4, -20.0], [-20.4, -3.0], 0.4, 24),
        ([7.0, -20.4], [19.0, -20.4], 0.5, 14),
    ];
    for (a, b, width, count) in lines {
        for _ in 0..count {
            let p = DVec2::from(a).lerp(DVec2::from(b), random.range(0.0, 1.0));
            let aside = random.range(-width, width);
            let (du, dv) = if a[0] == b[0] { (aside, 0.0) } else { (0.0, aside) };
            put(p.x + du, p.y + dv, &mut random);
        }
    }
    for _ in 0..160 {
        let (u, v) = (random.range(26.0, 62.0), random.range(-60.0, 22.0));
        put(u, v, &mut random);
    }
    for _ in 0..120 {
        let (u, v) = (random.range(-60.0, 22.0), random.range(-60.0, -26.0));
        put(u, v, &mut random);
    }
}
