//! The houses on the cut corners: three fronts, a flat roof behind a parapet, a dome on some.

use super::facade::{door_hole, hole, pierced};
use super::house::{Kit, filling};
use super::openings::Kind;
use super::{Block, CHAMFER, DEPTH, END, FOOT, GROUND, PAVED, STOREY, Site};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::shapes::{self, ALL, BOTTOM, EAST, NORTH, bevelled, block, lathe};
use glam::{DVec2, DVec3};

/// Upper storeys.
const STOREYS: usize = 4;
/// Height of the parapet.
const PARAPET: f64 = 1.0;

/// A front of the corner house: its left end, its width, and its windows per storey.
struct Front {
    site: Site,
    width: f64,
    axes: usize,
}

pub fn build(model: &mut Model, kit: &Kit, block: &Block, walls: &'static str, dome: bool, number: usize) {
    let (x, z) = (block.west[0], block.south[0]);
    let side = DEPTH - CHAMFER;
    let cut = CHAMFER * std::f64::consts::SQRT_2;
    let south = block.site.within(x + CHAMFER, 0.0, -z, 0.0);
    let west = block.site.within(x, 0.0, -END, -90.0).within(END - z - DEPTH, 0.0, 0.0, 0.0);
    let middle = block.site.within(x, 0.0, -z - CHAMFER, -45.0);
    let fronts = [
        Front { site: west, width: side, axes: 3 },
        Front { site: middle, width: cut, axes: 1 },
        Front { site: south, width: side, axes: 3 },
    ];
    let top = GROUND + STOREY * STOREYS as f64;
    let label = (b'A' + (block.site.turn / 90.0) as u8) as char;
    for (k, front) in fronts.iter().enumerate() {
        storeys(model, kit, front, walls, &format!("corner {label}{k}"), number + 40 * k);
        street_level(model, kit, front, &format!("corner ground {label}{k}"), number + 40 * k);
        trim(model, front, top, walls);
    }
    // The roof's outline, in the block's frame: counter-clockwise from above.
    let plan =
        [[x + CHAMFER, -z], [x + DEPTH, -z], [x + DEPTH, -z - DEPTH], [x, -z - DEPTH], [x, -z - CHAMFER]];
    let mut roof = Mesh::default();
    roof.polygon(&plan.map(|[x, z]| (DVec3::new(x, top + 0.06, z), DVec2::new(x, z))));
    model.add("roof corners", "gravel", block.site.set(roof));
    // Towards the neighbours, who are lower or as high.
    let own = block.site.within(x, 0.0, -z, 0.0);
    let party = shapes::block([0.0, -0.1, -DEPTH], [DEPTH, top + PARAPET, 0.0], EAST | NORTH);
    model.add("party_occluder", "stucco", own.set(party));
    let thick = 0.3;
    let rims = shapes::block(
        [DEPTH - thick, top, -DEPTH + thick],
        [DEPTH, top + PARAPET, -0.01],
        ALL & !BOTTOM & !EAST,
    )
    .with(shapes::block(
        [0.01, top, -DEPTH],
        [DEPTH, top + PARAPET, -DEPTH + thick],
        ALL & !BOTTOM & !NORTH & !EAST,
    ));
    model.add("parapet_detail", walls, own.set(rims));
    own.within(7.6, top, -7.4, 30.0).place(model, &kit.tops.stair_house);
    own.within(8.2, top + 0.05, -2.6, 0.0).place(model, &kit.tops.vent);
    if dome {
        cupola(model, &middle.within(cut / 2.0, top, -2.1, 0.0));
    }
}

/// Walls and windows above street level; a balcony at every floor of the cut corner.
fn storeys(model: &mut Model, kit: &Kit, front: &Front, walls: &str, name: &str, number: usize) {
    let mut holes = Vec::new();
    for s in 0..STOREYS {
        let floor = GROUND + STOREY * s as f64;
        for a in 0..front.axes {
            let x = front.width * (a as f64 + 0.5) / front.axes as f64;
            let balcony = front.axes == 1 && s + 1 < STOREYS;
            let kind = if balcony { Kind::French } else { Kind::Tall };
            holes.push(hole(kind, x, floor));
            let at = front.site.within(x, floor + kind.sill(), 0.0, 0.0);
            at.place(model, kit.openings.window(kind, filling(number, s, a)));
            if balcony {
                at.place(model, &kit.balcony);
            }
        }
    }
    let top = GROUND + STOREY * STOREYS as f64 + PARAPET;
    pierced(model, &front.site, name, walls, [0.0, GROUND, front.width, top], &holes);
}

/// A door in the cut corner, windows beside it.
fn street_level(model: &mut Model, kit: &Kit, front: &Front, name: &str, number: usize) {
    let mut holes = Vec::new();
    for a in 0..front.axes {
        let x = front.width * (a as f64 + 0.5) / front.axes as f64;
        if front.axes == 1 {
            holes.push(door_hole(x));
            front.site.within(x, PAVED, 0.0, 0.0).place(model, &kit.door);
        } else {
            let (kind, floor) = (Kind::French, 0.75);
            holes.push(hole(kind, x, floor));
            let at = front.site.within(x, floor + kind.sill(), 0.0, 0.0);
            at.place(model, kit.openings.window(kind, filling(number, 7, a)));
        }
    }
    pierced(model, &front.site, name, "limestone", [0.0, FOOT, front.width, GROUND], &holes);
}

/// String courses, cornice, parapet and its balustrade; courses meet at the cut corner's edges by
/// overlapping.
fn trim(model: &mut Model, front: &Front, top: f64, walls: &str) {
    let w = front.width;
    // Ends are pulled in or out so that the bands of neighbouring fronts close without a gap.
    let band = |y0: f64, y1: f64, out: f64| {
        let reach = if front.axes == 1 { out * 0.41 } else { 0.0 };
        block([-reach, y0, -0.05], [w + reach, y1, out], ALL & !NORTH)
    };
    let mut mesh = band(GROUND - 0.28, GROUND - 0.08, 0.1).with(band(GROUND - 0.1, GROUND + 0.08, 0.2));
    for s in 1..STOREYS {
        let floor = GROUND + STOREY * s as f64;
        mesh.append(band(floor - 0.02, floor + 0.1, 0.06));
    }
    mesh.append(band(top - 0.75, top - 0.62, 0.08));
    mesh.append(band(top - 0.3, top - 0.12, 0.5).with(band(top - 0.14, top + 0.06, 0.6)));
    mesh.append(band(top + PARAPET - 0.14, top + PARAPET + 0.02, 0.1));
    let brackets = (w / 0.7).round() as usize;
    for k in 0..brackets {
        let x = w * (k as f64 + 0.5) / brackets as f64;
        mesh.append(bevelled([x - 0.1, top - 0.58, -0.05], [x + 0.1, top - 0.28, 0.2], 0.02));
        mesh.append(bevelled([x - 0.08, top - 0.44, -0.05], [x + 0.08, top - 0.28, 0.45], 0.02));
    }
    // Rustication: grooved bands at street level.
    for k in 0..front.axes + 1 {
        let x = w * k as f64 / front.axes as f64;
        let (a, b) = ((x - 0.24).max(0.0), (x + 0.24).min(w));
        for row in 0..8 {
            let y = 0.12 + 0.53 * f64::from(row);
            mesh.append(bevelled([a, y, -0.05], [b, y + 0.5, 0.09], 0.03));
        }
    }
    model.add("trim_detail", "stucco", front.site.set(mesh));
    let back = block([0.0, top, -0.35], [w, top + PARAPET, -0.3], NORTH);
    let cap = block([0.0, top + PARAPET - 0.05, -0.4], [w, top + PARAPET + 0.04, 0.02], ALL);
    model.add("parapet_detail", walls, front.site.set(back));
    model.add("parapet_detail", "stucco", front.site.set(cap));
}

/// A drum with a railing, a copper dome and a lantern.
fn cupola(model: &mut Model, site: &Site) {
    let drum = lathe(&[&[(1.9, 0.0), (1.9, 1.9)]], 28);
    model.add("roof cupolas", "limestone", site.set(drum));
    let dome: Vec<(f64, f64)> = (0..=14)
        .map(|k| {
            let a = std::f64::consts::FRAC_PI_2 * f64::from(k) / 14.0 * 0.93;
            (2.0 * a.cos(), 2.1 + 2.7 * a.sin())
        })
        .collect();
    model.add("roof cupolas", "copper", site.set(lathe(&[&dome], 28)));
    let rim = lathe(
        &[
            &[(1.85, 1.72), (2.16, 1.86)],
            &[(2.16, 1.86), (2.2, 2.0), (2.16, 2.12)],
            &[(2.16, 2.12), (1.9, 2.16)],
        ],
        28,
    );
    model.add("cupola_detail", "stucco", site.set(rim));
    let spire = lathe(
        &[
            &[(0.5, 4.6), (0.34, 4.8), (0.3, 5.4)],
            &[(0.3, 5.4), (0.42, 5.42)],
            &[(0.42, 5.42), (0.3, 5.7), (0.06, 6.3), (0.03, 7.6), (0.0, 7.62)],
        ],
        16,
    );
    model.add("cupola_detail", "copper", site.set(spire));
    for k in 0..8 {
        let turn = site.within(0.0, 0.0, 0.0, 45.0 * f64::from(k));
        let window = bevelled([-0.28, 0.5, 1.75], [0.28, 1.55, 1.93], 0.03);
        model.add("cupola_detail", "stucco", turn.set(window));
        let pane = bevelled([-0.2, 0.58, 1.8], [0.2, 1.47, 1.96], 0.02);
        model.add("cupola_detail", "glass", turn.set(pane));
    }
}
