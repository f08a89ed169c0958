//! Four shapes of trees, each modelled once: trunk, limbs and twigs as tubes, leaf cards around the twigs.

use super::foliage::card;
use super::terrain::point;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::Random;
use crate::shapes::tube_side;
use glam::DVec3;

/// How a tree grows.
struct Habit {
    name: &'static str,
    leaves: &'static str,
    height: f64,
    /// Radius of the trunk above its flare.
    girth: f64,
    /// Share of the height below the first limb.
    clear: f64,
    limbs: usize,
    /// Length of a limb by its place up the trunk, from 0 to 1.
    reach: fn(f64) -> f64,
    /// How much a limb rises, per metre outwards, by its place.
    rise: fn(f64) -> f64,
    twigs: usize,
    /// Cards at each twig's middle and tip.
    cards: usize,
    card: [f64; 2],
    seed: u64,
}

const HABITS: [Habit; 4] = [
    Habit {
        name: "oak",
        leaves: "oak_leaves",
        height: 9.5,
        girth: 0.36,
        clear: 0.24,
        limbs: 15,
        reach: |t| 4.4 - 2.9 * t * t,
        rise: |t| 0.25 + 0.8 * t,
        twigs: 8,
        cards: 5,
        card: [0.7, 1.1],
        seed: 241,
    },
    Habit {
        name: "apple",
        leaves: "apple_leaves",
        height: 4.6,
        girth: 0.15,
        clear: 0.3,
        limbs: 10,
        reach: |t| 2.0 - 1.1 * t,
        rise: |t| 0.35 + 0.5 * t,
        twigs: 6,
        cards: 4,
        card: [0.42, 0.62],
        seed: 242,
    },
    Habit {
        name: "poplar",
        leaves: "poplar_leaves",
        height: 13.0,
        girth: 0.24,
        clear: 0.1,
        limbs: 26,
        reach: |t| 1.1 - 0.5 * t,
        rise: |_| 1.9,
        twigs: 4,
        cards: 4,
        card: [0.55, 0.85],
        seed: 243,
    },
    Habit {
        name: "birch",
        leaves: "birch_leaves",
        height: 8.4,
        girth: 0.14,
        clear: 0.26,
        limbs: 16,
        reach: |t| 1.9 - 1.2 * t,
        rise: |t| 0.9 - 0.3 * t,
        twigs: 6,
        cards: 4,
        card: [0.45, 0.75],
        seed: 244,
    },
];

/// Which tree stands where, (u, v), how it is turned and how large it is.
const TREES: [(usize, f64, f64, f64, f64); 22] = [
    (0, 21.0, -8.5, 0.0, 1.0),
    (0, -30.0, 25.5, 130.0, 1.1),
    (0, 36.0, -24.0, 220.0, 0.95),
    (0, -44.0, -46.0, 75.0, 1.15),
    (0, 2.0, -50.0, 290.0, 1.0),
    (1, 6.5, -21.0, 20.0, 1.0),
    (1, 11.5, -22.0, 140.0, 0.9),
    (1, 20.5, -20.5, 260.0, 1.1),
    (1, 14.8, 21.3, 60.0, 1.05),
    (2, -5.6, 30.0, 0.0, 0.95),
    (2, -5.6, 37.5, 80.0, 1.05),
    (2, -5.6, 45.0, 170.0, 0.9),
    (2, -5.6, 52.5, 250.0, 1.0),
    (2, 58.0, 20.0, 30.0, 1.1),
    (3, -21.5, -1.0, 0.0, 1.0),
    (3, -52.0, 22.0, 100.0, 0.9),
    (3, 30.0, -47.0, 200.0, 1.1),
    (3, 33.5, -50.5, 310.0, 0.85),
    (3, 29.0, -53.0, 40.0, 1.0),
    (3, -20.0, -55.0, 150.0, 1.05),
    (0, 55.0, -54.0, 10.0, 1.05),
    (3, 60.0, 30.0, 120.0, 1.0),
];

pub fn build(model: &mut Model) {
    let shapes = HABITS.map(|habit| tree(model, &habit));
    for (shape, u, v, turn, size) in TREES {
        model.place_all(&shapes[shape], point(u, v) - DVec3::Y * 0.15, turn, DVec3::splat(size));
    }
}

fn tree(model: &mut Model, habit: &Habit) -> [usize; 2] {
    let mut random = Random::new(habit.seed);
    let h = habit.height;
    let sway = |random: &mut Random| random.direction() * DVec3::new(0.016, 0.0, 0.016) * h;
    let mut trunk = vec![
        (DVec3::NEG_Y * 0.25, habit.girth * 1.9),
        (DVec3::Y * (0.02 * h), habit.girth * 1.3),
        (DVec3::Y * (0.07 * h), habit.girth),
    ];
    for k in 1..=6 {
        let t = k as f64 / 6.0;
        let girth = habit.girth * (1.0 - 0.93 * t);
        trunk.push((DVec3::Y * (h * (0.07 + 0.9 * t)) + sway(&mut random), girth));
    }
    let mut wood = tube_side(&trunk, 12);
    let mut leaves = Mesh::default();
    let mut tuft = |at: DVec3, random: &mut Random| {
        for _ in 0..habit.cards {
            let axis = (random.direction() + DVec3::Y * 0.25).normalize();
            let size = random.range(habit.card[0], habit.card[1]);
            card(&mut leaves, at + axis * random.range(0.0, 0.3 * size), axis, size, random);
        }
    };
    for k in 0..habit.limbs {
        let t = (k as f64 + random.range(0.1, 0.9)) / habit.limbs as f64;
        let root = along(&trunk, h * (habit.clear + (0.94 - habit.clear) * t));
        let angle = (k as f64 * 137.5 + random.range(-20.0, 20.0)).to_radians();
        let out = DVec3::new(angle.cos(), 0.0, angle.sin());
        let (reach, rise) = ((habit.reach)(t) * random.range(0.85, 1.15), (habit.rise)(t));
        let thick = (habit.girth * (0.5 - 0.34 * t)).max(0.03);
        let limb: Vec<(DVec3, f64)> = [(0.0, 1.0), (0.35, 0.75), (0.7, 0.5), (1.0, 0.2)]
            .map(|(s, girth): (f64, f64)| {
                let wander = random.direction() * (0.06 * reach * s);
                (root + (out * s + DVec3::Y * (rise * s.powf(1.3))) * reach + wander, thick * girth)
            })
            .to_vec();
        wood.append(tube_side(&limb, 7));
        tuft(limb[3].0, &mut random);
        for j in 0..habit.twigs {
            let s = 0.8 + 2.1 * (j as f64 + random.range(0.0, 0.9)) / habit.twigs as f64;
            let start = limb[s as usize].0.lerp(limb[s as usize + 1].0, s.fract());
            let spread = (random.direction() + DVec3::Y * 0.3 + out * 0.5).normalize();
            let length = reach * random.range(0.28, 0.5);
            let middle = start + spread * (length * 0.55) + DVec3::Y * (0.06 * length);
            let tip = start + spread * length + DVec3::Y * (0.16 * length);
            wood.append(tube_side(&[(start, thick * 0.3), (middle, thick * 0.2), (tip, thick * 0.06)], 5));
            tuft(middle, &mut random);
            tuft(tip, &mut random);
        }
    }
    [
        model.shape(&format!("{}_detail", habit.name), "bark", wood),
        model.shape(&format!("leaves_{}", habit.name), habit.leaves, leaves),
    ]
}

/// The point of an upright path at a height.
fn along(path: &[(DVec3, f64)], height: f64) -> DVec3 {
    let k = (1..path.len() - 1).find(|&k| path[k].0.y > height).unwrap_or(path.len() - 1);
    let (a, b) = (path[k - 1].0, path[k].0);
    a.lerp(b, (height - a.y) / (b.y - a.y))
}
