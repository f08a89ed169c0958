//! Fences of posts and rails, field gates, and the dry stone wall behind the yard.

use super::terrain::{HALF, TRACK, YARD, point};
use super::timber::beam;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::{Random, noise};
use crate::relief::{full, steps};
use glam::{DVec2, DVec3};

/// From post to post.
const BAY: f64 = 2.5;
/// Length of a field gate.
const GATE: f64 = 3.6;
/// Height of the stone wall.
const WALL: f64 = 1.25;

pub fn build(model: &mut Model) {
    let runs = [
        ([-YARD + 0.4, YARD - 0.4], [-2.3, YARD - 0.4]),
        ([2.3, YARD - 0.4], [YARD, YARD - 0.4]),
        ([YARD, YARD - 0.4], [61.0, YARD - 0.4]),
        ([YARD - 0.5, YARD - 2.8], [YARD - 0.5, 14.3]),
        ([YARD - 0.5, 9.9], [YARD - 0.5, -YARD + 1.4]),
        ([-TRACK + 0.2, HALF - 2.5], [-2.3, HALF - 2.5]),
        ([2.3, HALF - 2.5], [TRACK - 0.2, HALF - 2.5]),
        ([-HALF + 2.0, HALF - 2.5], [-TRACK - 1.0, HALF - 2.5]),
    ];
    for (k, (from, to)) in runs.into_iter().enumerate() {
        run(model, from.into(), to.into(), 251 + k as u64);
    }
    let gate = gate(model);
    // Hinge, and the degrees it is turned from closing the gap: one to the track is wide open, one to the
    // pasture ajar.
    let gates = [
        (DVec2::new(-1.85, YARD - 0.4), 100.0),
        (DVec2::new(YARD - 0.5, 13.95), 52.0),
        (DVec2::new(-1.8, HALF - 2.5), 0.0),
    ];
    for (k, (at, turn)) in gates.into_iter().enumerate() {
        model.place_all(&[gate], point(at.x, at.y), turn, DVec3::ONE);
        // Along the pasture's fence the gap runs north to south.
        let along = if k == 1 { DVec2::NEG_Y } else { DVec2::X };
        for end in [-0.14, GATE + 0.14] {
            let foot = at + along * end;
            let foot = point(foot.x, foot.y);
            let post = beam(foot - DVec3::Y * 0.4, foot + DVec3::Y * 1.42, 0.2, 0.2);
            model.add("fences_detail", "old_wood", post);
        }
    }
    stone_wall(model);
}

/// Posts with three rails between them, from one point to another.
fn run(model: &mut Model, from: DVec2, to: DVec2, seed: u64) {
    let mut random = Random::new(seed);
    let bays = ((to - from).length() / BAY).round().max(1.0) as usize;
    let posts: Vec<DVec3> = (0..=bays)
        .map(|k| {
            let p = from.lerp(to, k as f64 / bays as f64);
            point(p.x, p.y)
        })
        .collect();
    let aside = (posts[bays] - posts[0]).cross(DVec3::Y).normalize() * 0.08;
    let mut wood = Mesh::default();
    for (k, &post) in posts.iter().enumerate() {
        let lean = DVec3::new(random.range(-0.03, 0.03), 0.0, random.range(-0.03, 0.03));
        let top = post + DVec3::Y * random.range(1.2, 1.3) + lean;
        wood.append(beam(post - DVec3::Y * 0.4, top, 0.12, 0.12));
        let Some(&next) = posts.get(k + 1) else { break };
        for height in [0.38, 0.72, 1.06] {
            // Rails overlap at the posts, one a little above the other.
            let dip = if k % 2 == 0 { 0.012 } else { -0.012 };
            let reach = (next - post).normalize() * 0.1;
            let a = post - reach + aside + DVec3::Y * (height + dip + random.range(-0.02, 0.02));
            let b = next + reach + aside + DVec3::Y * (height + dip + random.range(-0.02, 0.02));
            let skew = aside * if k % 2 == 0 { 0.0 } else { 0.3 };
            wood.append(beam(a + skew, b + skew, 0.045, 0.11));
        }
    }
    model.add("fences_detail", "old_wood", wood);
}

/// A field gate along +X, hung at the origin: five bars, two stiles, a brace.
fn gate(model: &mut Model) -> usize {
    let p = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let mut wood = Mesh::default();
    wood.append(beam(p(0.04, 0.12, 0.0), p(0.04, 1.3, 0.0), 0.09, 0.09));
    wood.append(beam(p(GATE - 0.04, 0.16, 0.0), p(GATE - 0.04, 1.16, 0.0), 0.08, 0.08));
    for y in [0.24, 0.44, 0.64, 0.86, 1.1] {
        wood.append(beam(p(0.02, y, 0.0), p(GATE - 0.02, y, 0.0), 0.03, 0.09));
    }
    wood.append(beam(p(0.1, 0.26, 0.03), p(1.75, 1.1, 0.03), 0.03, 0.09));
    wood.append(beam(p(1.78, 0.22, 0.031), p(1.78, 1.12, 0.031), 0.03, 0.09));
    model.shape("gate_detail", "old_wood", wood)
}

/// A wall of field stones between yard and meadow: its two faces and its coping are one lumpy sheet.
fn stone_wall(model: &mut Model) {
    let (u0, u1) = (-YARD + 0.6, YARD - 1.0);
    // Across the wall: out of the ground in the north, over the top, down in the south; the distance along
    // that way.
    let profile = [
        (-0.36, -0.35),
        (-0.27, WALL - 0.05),
        (-0.1, WALL + 0.08),
        (0.1, WALL + 0.08),
        (0.27, WALL - 0.05),
        (0.36, -0.35),
    ];
    let mut lengths = vec![0.0];
    for pair in profile.windows(2) {
        let step = DVec2::new(pair[1].0 - pair[0].0, pair[1].1 - pair[0].1).length();
        lengths.push(lengths[lengths.len() - 1] + step);
    }
    let vs: Vec<f64> = lengths
        .windows(2)
        .flat_map(|pair| {
            let count = ((pair[1] - pair[0]) / 0.2).ceil() as usize;
            steps(pair[0], pair[1], count).into_iter().take(count)
        })
        .chain([lengths[lengths.len() - 1]])
        .collect();
    let place = |u: f64, s: f64| {
        let k = (1..lengths.len() - 1).find(|&k| lengths[k] > s).unwrap_or(lengths.len() - 1);
        let t = (s - lengths[k - 1]) / (lengths[k] - lengths[k - 1]);
        let (a, b) = (profile[k - 1], profile[k]);
        let (across, up) = (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t);
        let lump = noise(u / 0.42 + 400.0, s / 0.34 + 40.0, 1024, 261) - 0.5;
        let sag = 0.16 * (noise(u / 4.0 + 40.0, 0.0, 256, 262) - 0.5);
        let ground = point(u, -YARD + 0.1);
        let bulge = DVec3::new(0.0, if up > WALL { 0.10 } else { 0.02 }, across.signum() * 0.09) * lump;
        ground + DVec3::new(0.0, up + if up > 0.2 { sag } else { 0.0 }, -across) + bulge
    };
    let count = ((u1 - u0) / 0.24) as usize;
    // From the south face over the top to the north face, east × that way looks out.
    let mut mesh = full(&steps(u0, u1, count), &vs, place);
    mesh.uvs.iter_mut().for_each(|uv| uv.y = -uv.y);
    model.add("stone_wall", "rubble", mesh);
    // Piers at its ends.
    for u in [u0, u1] {
        let p = point(u, -YARD + 0.1);
        let pier = crate::shapes::bevelled(
            [p.x - 0.42, p.y - 0.4, p.z - 0.46],
            [p.x + 0.42, p.y + WALL + 0.3, p.z + 0.46],
            0.04,
        );
        model.add("piers_detail", "rubble", pier);
    }
}
