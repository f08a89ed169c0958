//! Parked cars: two bodies in a few paints, lofted over stations along their length, placed along the kerbs.

use super::car_body::{ESTATE, HALF, HATCHBACK, Shape, WHEEL};
use super::{AVENUE, STREET, Site, streets};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::shapes::{ALL, bevelled, block, lathe};
use glam::{DAffine3, DVec3};
use std::f64::consts::FRAC_PI_2;

/// A wheel about its middle, its outside towards +Z.
fn wheel() -> [Mesh; 2] {
    let r = WHEEL;
    let rim =
        lathe(&[&[(r * 0.68, 0.1), (r * 0.6, 0.06)], &[(r * 0.6, 0.06), (r * 0.25, 0.085), (0.0, 0.09)]], 22);
    let tyre =
        lathe(&[&[(0.0, -0.1), (r, -0.1)], &[(r, -0.1), (r, 0.05), (r * 0.94, 0.085), (r * 0.68, 0.1)]], 22);
    [tyre, rim].map(|m| m.transformed(DAffine3::from_rotation_x(FRAC_PI_2)))
}

/// A car's meshes in a paint: nose towards −X, standing on y = 0.
fn car(model: &mut Model, shape: &Shape, paint: &'static str) -> Vec<usize> {
    let name = format!("{}_{paint}", shape.name);
    let lit = model.shape(&name, paint, shape.body());
    model.shape(&name, paint, shape.cabin(false));
    let detail_name = format!("{name}_detail");
    let detail = model.shape(&detail_name, "glass", shape.cabin(true));
    // The dark underneath, inside the skin.
    let [nose, tail] = shape.ends;
    let under = block([nose + 0.3, 0.19, -HALF + 0.3], [tail - 0.3, 0.62, HALF - 0.3], ALL);
    let floor = block([nose + 0.12, 0.3, -HALF + 0.12], [tail - 0.12, 0.36, HALF - 0.12], ALL);
    model.shape(&detail_name, "tyre", under.with(floor));
    for x in shape.axles {
        for side in [-1.0, 1.0] {
            for (material, part) in ["tyre", "steel"].into_iter().zip(wheel()) {
                let part = if side < 0.0 { part.turned(180.0) } else { part };
                model.shape(&detail_name, material, part.translated(x, WHEEL, side * (HALF - 0.13)));
            }
            // A liner hides the inside above the wheel.
            let liner = block([x - 0.36, 0.3, side * 0.68 - 0.01], [x + 0.36, 0.67, side * 0.68 + 0.01], ALL);
            model.shape(&detail_name, "tyre", liner);
        }
    }
    let part =
        |x0: f64, y0: f64, z0: f64, x1: f64, y1: f64, z1: f64| bevelled([x0, y0, z0], [x1, y1, z1], 0.015);
    for side in [-1.0, 1.0] {
        let span = |a: f64, b: f64| if side > 0.0 { (a, b) } else { (-b, -a) };
        let (z0, z1) = span(0.4, 0.7);
        model.shape(&detail_name, "paper", part(nose - 0.015, 0.5, z0, nose + 0.3, 0.62, z1));
        let (z0, z1) = span(0.45, 0.68);
        model.shape(&detail_name, "tail_light", part(tail - 0.3, 0.56, z0, tail + 0.015, 0.74, z1));
        let (z0, z1) = span(HALF - 0.08, HALF + 0.12);
        let x = shape.cabin[0][0] + 0.32;
        model.shape(&detail_name, paint, part(x, 0.93, z0, x + 0.1, 1.06, z1));
        for x in [shape.pillars[0] - 0.22, shape.pillars[1] - 0.16] {
            let (z0, z1) = span(HALF - 0.06, HALF + 0.012);
            model.shape(&detail_name, "steel", part(x, 0.76, z0, x + 0.16, 0.795, z1));
        }
    }
    model.shape(&detail_name, "tyre", part(nose - 0.02, 0.36, -0.6, nose + 0.3, 0.46, 0.6));
    model.shape(&detail_name, "tyre", part(tail - 0.3, 0.36, -0.6, tail + 0.02, 0.44, 0.6));
    model.shape(&detail_name, "white_paint", part(nose - 0.03, 0.375, -0.26, nose + 0.2, 0.455, 0.26));
    model.shape(&detail_name, "white_paint", part(tail - 0.2, 0.6, -0.26, tail + 0.03, 0.7, 0.26));
    vec![lit, detail]
}

/// Where cars stand: along the avenue (x < 0: the west kerb) or the street, and which one it is.
#[rustfmt::skip]
const AVENUE_CARS: [(f64, f64, usize); 9] = [
    (1.0, -16.4, 0), (1.0, -28.0, 2), (1.0, -33.2, 4), (1.0, 20.5, 1), (1.0, 31.0, 3),
    (-1.0, -21.5, 3), (-1.0, -38.0, 1), (-1.0, 17.0, 2), (-1.0, 27.6, 0),
];
const STREET_CARS: [(f64, f64, usize); 6] =
    [(1.0, 18.5, 4), (1.0, 24.6, 1), (1.0, 36.5, 0), (1.0, -19.5, 3), (1.0, -31.0, 2), (1.0, -37.0, 0)];

pub fn build(model: &mut Model) {
    let kinds = [
        car(model, &HATCHBACK, "red_paint"),
        car(model, &ESTATE, "silver_paint"),
        car(model, &HATCHBACK, "white_paint"),
        car(model, &ESTATE, "blue_paint"),
        car(model, &HATCHBACK, "mustard"),
    ];
    // From the kerb to a car's middle.
    let aside = HALF + 0.22;
    for (side, z, kind) in AVENUE_CARS {
        let across = side * (AVENUE[1] - aside);
        let y = streets::height(AVENUE[1], across, 99.0) - 0.006;
        // Traffic keeps to the right.
        Site::new(DVec3::new(across, y, z), -90.0 * side).place(model, &kinds[kind]);
    }
    for (side, x, kind) in STREET_CARS {
        let across = side * (STREET[1] - aside);
        let y = streets::height(STREET[1], across, 99.0) - 0.006;
        Site::new(DVec3::new(x, y, across), 180.0).place(model, &kinds[kind]);
    }
}
