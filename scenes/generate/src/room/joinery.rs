//! What the joiner fixed to the walls: skirting, coving, the door, pictures; a clock, a switch and sockets.

use super::HEIGHT;
use super::walls::{EAST, NORTH, SOUTH, WEST, Wall};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{Rect, full, sorted, steps, sunk};
use crate::shapes::{lathe, tube};
use crate::soft::{frame, moulding};
use glam::{DAffine3, DVec2, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Height of the skirting.
pub const SKIRTING: f64 = 0.08;
/// How far the coving reaches down the wall and into the ceiling.
pub const COVING: f64 = 0.1;
/// The door's opening in the north wall.
pub const DOOR: Rect = [1.7, 0.0, 2.6, 2.05];
/// Width of the architrave around it.
const ARCHITRAVE: f64 = 0.08;
/// Pictures: wall, middle, half size with the frame, material.
const PICTURES: [(Wall, [f64; 2], [f64; 2], &str); 4] = [
    (NORTH, [-1.45, 1.68], [0.55, 0.38], "landscape"),
    (NORTH, [0.35, 1.6], [0.24, 0.3], "blocks"),
    (EAST, [1.35, 1.6], [0.35, 0.45], "blocks"),
    (WEST, [1.6, 1.55], [0.3, 0.38], "landscape"),
];

pub fn build(model: &mut Model) {
    edges(model);
    door(model);
    for (wall, middle, half, material) in PICTURES {
        picture(model, &wall, middle, half, material);
    }
    small_things(model);
}

/// The part of a wall's pictures that hides the wall.
pub fn hidden(wall: &Wall) -> Vec<Rect> {
    let on_wall = PICTURES.iter().filter(|(w, ..)| w.along == wall.along);
    on_wall.map(|(_, [u, v], [w, h], _)| [u - w + 0.02, v - h + 0.02, u + w - 0.02, v + h - 0.02]).collect()
}

/// Skirting along the floor, around the door, and coving under the ceiling.
fn edges(model: &mut Model) {
    let board = [[0.014, -0.01], [0.014, SKIRTING - 0.015], [0.004, SKIRTING], [-0.01, SKIRTING]];
    let cove: Vec<[f64; 2]> = steps(0.0, FRAC_PI_2, 8)
        .into_iter()
        .map(|angle| [COVING * (1.0 - angle.cos()), HEIGHT - COVING * (1.0 - angle.sin())])
        .collect();
    for wall in [NORTH, EAST, SOUTH, WEST] {
        let corner = |u: f64| wall.at(u, 0.0, 0.0);
        let runs = if wall.along == NORTH.along {
            vec![
                (-wall.half, DOOR[0] - ARCHITRAVE + 0.02, [1.0, 0.0]),
                (DOOR[2] + ARCHITRAVE - 0.02, wall.half, [0.0, 1.0]),
            ]
        } else {
            vec![(-wall.half, wall.half, [1.0, 1.0])]
        };
        for (a, b, mitre) in runs {
            let run = moulding(corner(a), corner(b), mitre, DVec3::Y, &board, false);
            model.add_split("skirting", "white_paint", run, |n| n.y.abs() < 0.01);
        }
        let run = moulding(corner(-wall.half), corner(wall.half), [1.0, 1.0], DVec3::Y, &cove, true);
        model.add("coving", "white_paint", run);
    }
}

/// A panelled door with architrave, threshold, hinges and handles.
fn door(model: &mut Model) {
    let [u0, v0, u1, v1] = DOOR;
    let (deep, wide) = (0.1, ARCHITRAVE);
    let [left, right, top, _] = NORTH.reveal([u0, v0 - 0.01, u1, v1], [0.0, deep + 0.05]);
    model.add("door_frame", "white_paint", left.with(right).with(top));
    // From the opening's edge outwards.
    let profile = [
        [wide - 0.005, -0.01],
        [wide - 0.005, 0.014],
        [wide - 0.02, 0.02],
        [0.008, 0.02],
        [0.0, 0.012],
        [0.0, -0.01],
    ];
    let at = |u: f64, v: f64| NORTH.at(u, v, 0.0);
    let (left, high, right) = (u0 - wide, v1 + wide, u1 + wide);
    for (a, b, mitre) in [
        (at(left, v0 - 0.01), at(left, high), [0.0, 1.0]),
        (at(left, high), at(right, high), [1.0, 1.0]),
        (at(right, high), at(right, v0 - 0.01), [1.0, 0.0]),
    ] {
        let run = moulding(a, b, mitre, NORTH.normal, &profile, false);
        model.add_split("door_frame", "white_paint", run, |n| n.z > 0.99);
    }
    let threshold = NORTH.bevelled([u0 - 0.01, -0.03, u1 + 0.01, 0.012], [-0.012, deep + 0.02], 0.006);
    model.add("door_detail", "walnut", threshold);
    let panels = [
        [u0 + 0.12, 0.2, (u0 + u1) / 2.0 - 0.05, 0.85],
        [(u0 + u1) / 2.0 + 0.05, 0.2, u1 - 0.12, 0.85],
        [u0 + 0.12, 1.05, (u0 + u1) / 2.0 - 0.05, 1.9],
        [(u0 + u1) / 2.0 + 0.05, 1.05, u1 - 0.12, 1.9],
    ];
    let (mut us, mut vs) = (vec![u0 - 0.02, u1 + 0.02], vec![0.0, v1 + 0.02]);
    for [a, b, c, d] in panels {
        us.extend([a, a + 0.03, c - 0.03, c]);
        vs.extend([b, b + 0.03, d - 0.03, d]);
    }
    let leaf = full(&sorted(us), &sorted(vs), |u, v| {
        let depth: f64 = panels.iter().map(|&p| sunk(u, v, p, 0.03)).sum();
        NORTH.at(u, v, deep + 0.015 * depth)
    });
    model.add("door", "white_paint", leaf);
    let u = u0 + 0.07;
    let plate = NORTH.bevelled([u - 0.02, 0.93, u + 0.02, 1.15], [deep - 0.006, deep + 0.004], 0.003);
    model.add("door_detail", "brass", plate);
    let lever: Vec<_> = [(0.0, 0.0), (0.0, 0.045), (0.01, 0.055), (0.025, 0.06), (0.12, 0.058), (0.13, 0.05)]
        .into_iter()
        .map(|(along, out)| (NORTH.at(u + along, 1.08, deep - out), 0.009))
        .collect();
    model.add("door_detail", "brass", tube(&lever, 12));
    for v in [0.3, 1.75] {
        let hinge = [
            (NORTH.at(u1 - 0.008, v, deep - 0.006), 0.008),
            (NORTH.at(u1 - 0.008, v + 0.09, deep - 0.006), 0.008),
        ];
        model.add("door_detail", "brass", tube(&hinge, 10));
    }
}

/// A framed picture; `half` is the frame's outer half size.
fn picture(model: &mut Model, wall: &Wall, [u, v]: [f64; 2], half: [f64; 2], material: &str) {
    let profile = [[0.045, 0.004], [0.045, 0.016], [0.03, 0.024], [0.012, 0.03], [0.0, 0.024], [0.0, -0.005]];
    let (right, high) = (wall.along * half[0], DVec3::Y * half[1]);
    let centre = wall.at(u, v, 0.0);
    model.add("pictures_detail", "walnut", frame(centre, right, high, wall.normal, &profile));
    let (r, h) = (wall.along * (half[0] - 0.04), DVec3::Y * (half[1] - 0.04));
    let pane = centre + wall.normal * 0.01;
    let mut mesh = Mesh::default();
    mesh.polygon(&[
        (pane - r - h, DVec2::new(0.0, 1.0)),
        (pane + r - h, DVec2::new(1.0, 1.0)),
        (pane + r + h, DVec2::new(1.0, 0.0)),
        (pane - r + h, DVec2::new(0.0, 0.0)),
    ]);
    model.add("pictures", material, mesh);
}

/// A clock over the door's side, a light switch and two sockets.
fn small_things(model: &mut Model) {
    // Bodies of revolution about +Y, turned to look out of the north wall.
    let hang = |mesh: Mesh, u: f64, v: f64| {
        let at = NORTH.at(u, v, 0.0);
        mesh.transformed(DAffine3::from_translation(at) * DAffine3::from_rotation_x(FRAC_PI_2))
    };
    let case = lathe(
        &[
            &[(0.15, -0.01), (0.155, 0.02), (0.15, 0.035), (0.14, 0.04)],
            &[(0.14, 0.04), (0.132, 0.036), (0.13, 0.026)],
        ],
        48,
    );
    let (u, v) = (1.2, 1.9);
    model.add("clock_detail", "walnut", hang(case, u, v));
    model.add("clock_detail", "porcelain", hang(lathe(&[&[(0.132, 0.028), (0.0, 0.028)]], 48), u, v));
    for (angle, length) in [(0.9f64, 0.11), (-1.0, 0.075)] {
        let (sin, cos) = angle.sin_cos();
        let hand = [
            (NORTH.at(u - sin * 0.02, v - cos * 0.02, -0.033), 0.004),
            (NORTH.at(u + sin * length, v + cos * length, -0.033), 0.0025),
        ];
        model.add("clock_detail", "iron", tube(&hand, 6));
    }
    let mut plate = |wall: &Wall, u: f64, v: f64| {
        let body = wall.bevelled([u - 0.04, v - 0.04, u + 0.04, v + 0.04], [-0.01, 0.01], 0.004);
        let rocker = wall.bevelled([u - 0.027, v - 0.027, u + 0.027, v + 0.027], [-0.014, 0.0], 0.003);
        model.add("sockets_detail", "porcelain", body.with(rocker));
    };
    plate(&NORTH, 1.52, 1.1);
    plate(&EAST, 0.75, 0.3);
    plate(&WEST, 2.1, 0.3);
}
