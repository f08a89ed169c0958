//! Street lamps: posts with a curved arm along the avenue, lantern posts along the street. The scene file has
//! a lamp at every place listed here.

use super::{AVENUE, PAVED, Site, blocks};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::steps;
use crate::shapes::{lathe, tube, tube_side};
use glam::DVec3;
use std::f64::consts::PI;

/// Distances of the posts from the façades' meeting point along each kerb.
pub const ALONG: [f64; 3] = [5.0, 16.5, 28.0];
/// Posts stand this far behind the kerb's edge.
const BEHIND: f64 = 0.75;
/// A lantern's middle above the pavement.
const LANTERN: f64 = 3.9;
/// An arm's lamp: height above the pavement and reach over the road.
const ARM: [f64; 2] = [6.3, 1.7];

/// Where posts stand: of the avenue, then of the street; local +Z faces the road.
pub fn posts() -> [Vec<Site>; 2] {
    let mut out = [Vec::new(), Vec::new()];
    for block in blocks() {
        let (x, z) = (block.west, block.south);
        for along in ALONG {
            let south = block.site.within(x[0] + along, PAVED, -z[1] - BEHIND, 0.0);
            let west = block.site.within(x[1] + BEHIND, PAVED, -z[0] - along, -90.0);
            let avenue_is_west = x == AVENUE;
            out[usize::from(!avenue_is_west)].push(west);
            out[usize::from(avenue_is_west)].push(south);
        }
    }
    out
}

/// Middles of the lamps: under the avenue's arms, in the street's lanterns.
#[cfg(test)]
pub fn places() -> [Vec<DVec3>; 2] {
    let [avenue, street] = posts();
    [
        avenue.iter().map(|s| s.at(0.0, ARM[0], ARM[1])).collect(),
        street.iter().map(|s| s.at(0.0, LANTERN, 0.0)).collect(),
    ]
}

pub fn build(model: &mut Model) {
    let arm = arm_post(model);
    let lantern = lantern_post(model);
    let [avenue, street] = posts();
    for site in avenue {
        site.place(model, &arm);
    }
    for site in street {
        site.place(model, &lantern);
    }
}

/// A cast foot with mouldings, tapering to a shaft that ends at `top`.
fn shaft(top: f64) -> Mesh {
    lathe(
        &[
            &[(0.2, -0.02), (0.2, 0.12)],
            &[(0.2, 0.12), (0.15, 0.17), (0.14, 0.55)],
            &[(0.14, 0.55), (0.17, 0.6), (0.15, 0.68)],
            &[(0.15, 0.68), (0.085, 0.95), (0.075, 1.15)],
            &[(0.075, 1.15), (0.1, 1.2), (0.075, 1.26)],
            &[(0.072, 1.26), (0.06, top * 0.7), (0.05, top)],
        ],
        14,
    )
}

/// A mast whose top bends over the road to a shallow bell, open below.
fn arm_post(model: &mut Model) -> Vec<usize> {
    let [height, reach] = ARM;
    let straight = height - 0.6;
    let mut path = vec![(DVec3::new(0.0, straight - 0.05, 0.0), 0.05)];
    path.extend(steps(0.0, PI, 14).into_iter().map(|a| {
        let p = DVec3::new(0.0, straight + 0.95 * a.sin(), reach / 2.0 * (1.0 - a.cos()));
        (p, 0.05 - 0.006 * a)
    }));
    // (The bend ends level with the bell's neck, above the lamp in the bell.)
    let neck = DVec3::new(0.0, height + 0.28, reach);
    let path: Vec<_> = path.into_iter().filter(|(p, _)| p.z < reach / 2.0 || p.y > neck.y).collect();
    let mut iron = shaft(straight).with(tube_side(&path, 10));
    // A scroll that braces the bend, and the bell.
    let scroll: Vec<_> = steps(0.0, 1.6 * PI, 16)
        .into_iter()
        .map(|a| {
            let r = 0.36 - 0.05 * a;
            (DVec3::new(0.0, straight - 0.2 + r * a.sin(), 0.42 - r * a.cos()), 0.016)
        })
        .collect();
    iron.append(tube(&scroll, 6));
    let end = path.last().expect("points").0;
    let hanger = [(end, 0.036), (neck, 0.03)];
    iron.append(tube(&hanger, 8));
    let bell = lathe(
        &[&[(0.3, 0.02), (0.3, 0.06)], &[(0.3, 0.06), (0.2, 0.16), (0.08, 0.22), (0.06, 0.34), (0.0, 0.36)]],
        20,
    );
    iron.append(bell.translated(0.0, height, reach));
    let inside = lathe(&[&[(0.0, 0.14), (0.12, 0.13), (0.26, 0.05), (0.3, 0.02)]], 20);
    let detail = model.shape("arm_post_detail", "iron", iron);
    model.shape("arm_post_detail", "white_paint", inside.translated(0.0, height, reach));
    vec![detail]
}

/// A post with a four-sided open lantern on it.
fn lantern_post(model: &mut Model) -> Vec<usize> {
    let top = LANTERN - 0.3;
    let mut iron = shaft(top + 0.03);
    // A crossbar for the ladder.
    let bar = [(DVec3::new(-0.3, top - 0.35, 0.0), 0.018), (DVec3::new(0.3, top - 0.35, 0.0), 0.018)];
    iron.append(tube(&bar, 8));
    let detail = model.shape("lantern_post_detail", "iron", iron);
    for (material, part) in lantern_head() {
        model.shape("lantern_post_detail", material, part.translated(0.0, LANTERN, 0.0));
    }
    vec![detail]
}

/// A lantern about its lamp: floor, four bars, hood with a white underside, finial.
pub fn lantern_head() -> Vec<(&'static str, Mesh)> {
    let mut iron = lathe(
        &[&[(0.0, -0.33), (0.06, -0.3)], &[(0.06, -0.3), (0.14, -0.26)], &[(0.14, -0.26), (0.0, -0.25)]],
        12,
    );
    for k in 0..6 {
        let a = PI / 3.0 * f64::from(k);
        let (sin, cos) = a.sin_cos();
        let bar = [
            (DVec3::new(0.13 * cos, -0.27, 0.13 * sin), 0.008),
            (DVec3::new(0.2 * cos, 0.21, 0.2 * sin), 0.008),
        ];
        iron.append(tube(&bar, 5));
    }
    iron.append(lathe(
        &[
            &[(0.25, 0.19), (0.25, 0.22)],
            &[(0.25, 0.22), (0.16, 0.32), (0.05, 0.37)],
            &[(0.05, 0.37), (0.06, 0.41), (0.03, 0.45), (0.0, 0.53)],
        ],
        12,
    ));
    let under = lathe(&[&[(0.0, 0.3), (0.14, 0.27), (0.25, 0.19)]], 12);
    vec![("iron", iron), ("white_paint", under)]
}
