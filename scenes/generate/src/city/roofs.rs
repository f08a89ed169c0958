//! The houses' roofs: closed bodies over the walls, with dormers, chimneys and parapets.

use super::house::{House, Kit, Roof};
use super::{DEPTH, Site};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::random::cell;
use crate::shapes::{ALL, BOTTOM, TOP, bevelled, block, prism, tube};
use glam::DVec3;

/// How far eaves stand out at the front and at the back.
const EAVES: [f64; 2] = [0.55, 0.35];
/// Rise of a ridge over the eaves.
const RIDGE: f64 = 4.2;
/// Height and depth of a mansard's steep slope.
const STEEP: [f64; 2] = [3.0, 1.35];

pub fn build(model: &mut Model, kit: &Kit, site: &Site, house: &House, width: f64, number: usize) {
    let top = house.top();
    let middle = -DEPTH / 2.0;
    let name = format!("roof {number}");
    match house.roof {
        Roof::Pitched(tiles) => {
            let section = [[EAVES[0], top], [middle, top + RIDGE], [-DEPTH - EAVES[1], top]];
            let (sides, ends) = prism(&section, 0.0, width);
            let [front, back, under] = <[Mesh; 3]>::try_from(sides).expect("three edges");
            model.add(&name, tiles, site.set(front.with(back)));
            model.add("gable_occluder", house.walls[0], site.set(ends));
            model.add("soffit_detail", "stucco", site.set(under));
            let ridge = |x: f64| (DVec3::new(x, top + RIDGE - 0.02, middle), 0.13);
            model.add("ridge_detail", tiles, site.set(tube(&[ridge(0.0), ridge(width)], 8)));
            // Skylights towards the street, and two small dormers where there is room.
            for k in 0..house.axes {
                let x = width * (k as f64 + 0.5) / house.axes as f64;
                if k % 2 == number % 2 {
                    site.within(x, top + 1.15, EAVES[0] - 1.5, 0.0).place(model, &kit.tops.small_dormer);
                } else {
                    let slope = (RIDGE).atan2(EAVES[0] - middle);
                    let window = skylight(slope).translated(x, top + RIDGE * 0.5, (EAVES[0] + middle) / 2.0);
                    let (glass, frame) = window.split(|n| n.y.acos() - slope < 0.01);
                    model.add("skylight_detail", "glass", site.set(glass));
                    model.add("skylight_detail", "zinc", site.set(frame));
                }
            }
        }
        Roof::Mansard => {
            let high = top + STEEP[0];
            let back = -DEPTH - EAVES[1];
            let section = [
                [EAVES[0] - 0.1, top],
                [EAVES[0] - STEEP[1], high],
                [middle, high + 1.3],
                [back + STEEP[1], high],
                [back, top],
            ];
            let (sides, ends) = prism(&section, 0.0, width);
            let [steep, front, rear, far, under] = <[Mesh; 5]>::try_from(sides).expect("five edges");
            model.add(&name, "slate", site.set(steep.with(far)));
            model.add(&name, "zinc", site.set(front.with(rear)));
            model.add("gable_occluder", house.walls[0], site.set(ends));
            model.add("soffit_detail", "stucco", site.set(under));
            let edge = block(
                [0.0, high - 0.07, EAVES[0] - STEEP[1] - 0.1],
                [width, high + 0.1, EAVES[0] - STEEP[1] + 0.12],
                ALL,
            );
            model.add("ridge_detail", "zinc", site.set(edge));
            for k in 0..house.axes {
                let x = width * (k as f64 + 0.5) / house.axes as f64;
                site.within(x, top + 0.35, EAVES[0] - 0.2, 0.0).place(model, &kit.tops.dormer);
            }
        }
        Roof::Flat => {
            let roof = block([0.25, 0.0, -DEPTH + 0.25], [width - 0.25, top + 0.08, -0.25], TOP);
            model.add(&name, "gravel", site.set(roof));
            model.add("parapet_detail", house.walls[0], site.set(parapet(width, top)));
            site.within(width * 0.3, top, -4.2, 0.0).place(model, &kit.tops.stair_house);
            for (x, z) in [(0.55, -3.0), (0.68, -6.5), (0.82, -4.4)] {
                site.within(width * x, top + 0.05, z, 20.0).place(model, &kit.tops.vent);
            }
        }
    }
    if !matches!(house.roof, Roof::Flat) {
        gutter(model, site, width, top);
        let high = top + RIDGE - 0.2;
        let shift = 0.5 * cell(number as i64, 1, 910);
        let places = [(0.75 + shift, middle - 0.9), (width - 0.75 - shift, middle + 1.1)];
        for (x, z) in places {
            let turn = if number.is_multiple_of(2) { 90.0 } else { 0.0 };
            site.within(x, high, z, turn).place(model, &kit.tops.chimney);
        }
    }
}

/// Low walls around a flat roof with a coping.
fn parapet(width: f64, top: f64) -> Mesh {
    let thick = 0.3;
    let mut mesh = Mesh::default();
    for (x0, x1, z0, z1) in [
        (0.0, width, -thick, 0.0),
        (0.0, width, -DEPTH, -DEPTH + thick),
        (0.0, thick, -DEPTH + thick, -thick),
        (width - thick, width, -DEPTH + thick, -thick),
    ] {
        mesh.append(block([x0, top - 0.02, z0], [x1, top + 0.9, z1], ALL & !BOTTOM));
    }
    for (x0, x1, z0, z1) in [
        (0.0, width, -thick - 0.06, 0.08),
        (0.0, width, -DEPTH - 0.06, -DEPTH + thick + 0.06),
        (0.0, thick + 0.06, -DEPTH + thick + 0.05, -thick - 0.05),
        (width - thick - 0.06, width, -DEPTH + thick + 0.05, -thick - 0.05),
    ] {
        mesh.append(bevelled([x0, top + 0.86, z0], [x1, top + 0.98, z1], 0.02));
    }
    mesh
}

/// A flat window in a roof of this slope, its middle in the slope's plane.
fn skylight(slope: f64) -> Mesh {
    bevelled([-0.4, -0.05, -0.6], [0.4, 0.09, 0.6], 0.03).transformed(glam::DAffine3::from_rotation_x(slope))
}

/// A half-round gutter along the eaves.
fn gutter(model: &mut Model, site: &Site, width: f64, top: f64) {
    let at = |x: f64| (DVec3::new(x, top + 0.02, EAVES[0] + 0.03), 0.075);
    model.add("gutters_detail", "zinc", site.set(tube(&[at(0.0), at(width)], 8)));
}
