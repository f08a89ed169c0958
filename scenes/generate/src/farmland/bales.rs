//! Straw: round bales on the stubble, square ones in the barn, in its loft, in the shed and on the wagon.

use super::terrain::point;
use super::timber::laid;
use crate::model::Model;
use crate::random::Random;
use crate::shapes::{bevelled, lathe};
use glam::DVec3;

/// A round bale's radius and length.
const ROUND: [f64; 2] = [0.68, 1.25];
/// A square bale's length, height and width.
const SQUARE: [f64; 3] = [1.0, 0.42, 0.5];

pub fn build(model: &mut Model) {
    round(model);
    square(model);
}

/// A roll bound by twine, its ends a little hollow.
fn round(model: &mut Model) {
    let (r, half) = (ROUND[0], ROUND[1] / 2.0);
    let side: Vec<(f64, f64)> = [0.0, 0.03, 0.09, 0.42, 0.5, 0.58, 0.91, 0.97, 1.0]
        .into_iter()
        .zip([0.93, 0.985, 1.0, 1.0, 0.985, 1.0, 1.0, 0.985, 0.93])
        .map(|(t, grow)| (r * grow, half * (2.0 * t - 1.0)))
        .collect();
    let end = [(0.0, half - 0.05), (0.25, half - 0.03), (0.93 * r, half)];
    let other = [(0.93 * r, -half), (0.25, 0.03 - half), (0.0, 0.05 - half)];
    let top: Vec<(f64, f64)> = end.iter().rev().copied().collect();
    let bottom: Vec<(f64, f64)> = other.iter().rev().copied().collect();
    let roll = lathe(&[&bottom, &side, &top], 28);
    let bale = model.shape("bale_round", "straw", laid(roll, DVec3::X, DVec3::ZERO));
    let mut random = Random::new(271);
    let places = [
        (-31.0, -16.0),
        (-39.5, -19.5),
        (-49.0, -14.0),
        (-57.0, -20.0),
        (-34.5, -5.5),
        (-44.0, -3.0),
        (-54.5, -5.0),
        (-30.0, 4.5),
        (-40.0, 8.0),
        (-50.5, 6.5),
        (-59.0, 10.5),
        (-34.0, 16.5),
        (-46.0, 17.5),
        (-32.4, 16.9),
        (-28.5, 18.9),
        (-17.5, 14.8),
        (-15.9, 15.3),
    ];
    for (u, v) in places {
        let at = point(u, v) + DVec3::Y * (ROUND[0] - 0.05);
        model.place_all(&[bale], at, random.range(0.0, 180.0), DVec3::ONE);
    }
}

/// Square bales: their sides have texels, their worn edges none.
fn square(model: &mut Model) {
    let [length, height, width] = SQUARE;
    let body = bevelled([-length / 2.0, 0.0, -width / 2.0], [length / 2.0, height, width / 2.0], 0.03);
    let (broad, worn) = body.standing().split(|n| n.abs().max_element() > 0.99);
    let bale = [model.shape("bale_square", "straw", broad), model.shape("bale_square_detail", "straw", worn)];
    let mut random = Random::new(272);
    let mut stack = |at: DVec3, turn: f64, rows: &[(usize, f64)]| {
        let (sin, cos) = f64::to_radians(turn).sin_cos();
        let along = DVec3::new(cos, 0.0, -sin);
        for (row, &(count, shift)) in rows.iter().enumerate() {
            for k in 0..count {
                let x = shift + k as f64 * (length + 0.03);
                let slip = random.range(-0.04, 0.04);
                let aside = DVec3::new(sin, 0.0, cos) * slip;
                let foot = at + along * x + aside + DVec3::Y * (row as f64 * (height - 0.01));
                model.place_all(&bale, foot, turn + random.range(-2.5, 2.5), DVec3::ONE);
            }
        }
    };
    // In the barn: along the western wall, and in the loft.
    stack(DVec3::new(-18.75, 0.09, -7.5), 90.0, &[(4, 0.0), (4, 0.1), (2, 0.6)]);
    stack(DVec3::new(-18.1, 0.09, -7.6), 90.0, &[(4, 0.0), (2, 1.3)]);
    stack(DVec3::new(-17.5, 2.74, -19.6), 0.0, &[(5, 0.0), (4, 0.5), (3, 1.1)]);
    stack(DVec3::new(-17.0, 2.74, -18.2), 0.0, &[(3, 0.0)]);
    // In the cart shed, and beside the barn's door.
    stack(DVec3::new(19.6, -0.03, 11.9), 0.0, &[(1, 0.0), (1, 0.05)]);
    stack(DVec3::new(17.0, -0.03, 12.0), 0.0, &[(2, 0.0), (2, 0.3), (1, 0.8)]);
    stack(DVec3::new(-9.6, -0.04, -1.9), 12.0, &[(2, 0.0), (1, 0.4)]);
    stack(DVec3::new(-7.4, -0.04, -0.2), 75.0, &[(1, 0.0)]);
}
