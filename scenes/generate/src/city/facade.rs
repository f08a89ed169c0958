//! A house's front: the pierced walls, what frames them, and everything that hangs on them. Its other sides
//! are plain.

use super::balconies::BAY_HALF;
use super::doors::DOOR;
use super::house::{Extra, Ground, House, Kit, filling};
use super::openings::Kind;
use super::shops;
use super::{DEPTH, FOOT, GROUND, PAVED, STOREY, Site};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{Rect, grid, sheet, steps};
use crate::shapes::{ALL, EAST, NORTH, WEST, bevelled, block, tube};
use glam::DVec3;

/// A wall in the façade's plane with holes, in a material.
pub fn pierced(model: &mut Model, site: &Site, name: &str, material: &str, rect: Rect, holes: &[Rect]) {
    let (us, vs, filled) = grid(rect, holes);
    let wall = sheet(&us, &vs, filled, |u, v| DVec3::new(u, v, 0.0));
    model.add(name, material, site.set(wall));
}

/// A window's hole about x above a floor.
pub fn hole(kind: Kind, x: f64, floor: f64) -> Rect {
    let ([w, h], y) = (kind.size(), floor + kind.sill());
    [x - w / 2.0, y, x + w / 2.0, y + h]
}

/// The front of house `number`, from x = 0 to `width`.
pub fn build(model: &mut Model, kit: &Kit, site: &Site, house: &House, width: f64, number: usize) {
    upper(model, kit, site, house, width, number);
    let name = format!("ground {number}");
    match house.ground {
        Ground::Windows => street_windows(model, kit, site, house, width, number),
        Ground::Shops(first, second) => {
            let [left, door, right] = slots(width);
            let wanted =
                if width > 10.0 { vec![(left, first), (right, second)] } else { vec![(left, first)] };
            let mut holes: Vec<Rect> = wanted.iter().map(|&(x, _)| shops::opening(x)).collect();
            holes.push(door_hole(door));
            pierced(model, site, &name, house.walls[1], [0.0, FOOT, width, GROUND], &holes);
            site.within(door, PAVED, 0.0, 0.0).place(model, &kit.door);
            for (x, shop) in wanted {
                kit.shops.place(model, &site.within(x, 0.0, 0.0, 0.0), shop);
            }
        }
        Ground::Arcade(..) => {}
    }
    trim(model, site, house, width);
    let top = house.top();
    // Towards the neighbours and the yard behind.
    let arcade = matches!(house.ground, Ground::Arcade(..));
    let foot = if arcade { GROUND } else { -0.1 };
    let sides = block([0.0, foot, -DEPTH], [width, top, 0.0], EAST | WEST);
    model.add("party_occluder", "stucco", site.set(sides));
    let back = block([0.0, -0.1, -DEPTH], [width, top, 0.0], NORTH);
    model.add("back_occluder", "distant", site.set(back));
}

/// Middles of the left shop, the door and the right shop.
pub fn slots(width: f64) -> [f64; 3] {
    if width > 10.0 { [width * 0.22, width * 0.5, width * 0.78] } else { [width * 0.36, width * 0.83, 0.0] }
}

pub fn door_hole(x: f64) -> Rect {
    [x - DOOR[0] / 2.0, PAVED, x + DOOR[0] / 2.0, PAVED + DOOR[1]]
}

/// The storeys above the ground floor.
fn upper(model: &mut Model, kit: &Kit, site: &Site, house: &House, width: f64, number: usize) {
    let axis = |a: usize| width * (a as f64 + 0.5) / house.axes as f64;
    let middle = house.axes / 2;
    let mut holes = Vec::new();
    let bay = (house.extra == Extra::Bay).then_some(house.storeys - 1);
    for s in 0..house.storeys {
        let floor = GROUND + STOREY * s as f64;
        for a in 0..house.axes {
            let x = axis(a);
            if bay.is_some_and(|storeys| a == middle && s < storeys) {
                continue;
            }
            let on_balcony = house.extra == Extra::Balconies && a % 2 == s % 2 && s + 1 < house.storeys;
            let kind = if on_balcony { Kind::French } else { house.kind };
            holes.push(hole(kind, x, floor));
            let pick = filling(number, s, a);
            site.within(x, floor + kind.sill(), 0.0, 0.0).place(model, kit.openings.window(kind, pick));
            if on_balcony {
                site.within(x, floor + kind.sill(), 0.0, 0.0).place(model, &kit.balcony);
            } else if kind == Kind::Shuttered && (a + s + number).is_multiple_of(3) {
                site.within(x, floor + kind.sill(), 0.1, 0.0).place(model, &kit.flowers);
            }
        }
    }
    if let Some(storeys) = bay {
        let x = axis(middle);
        let foot = GROUND + 0.35;
        holes.push([
            x - BAY_HALF + 0.02,
            foot + 0.02,
            x + BAY_HALF - 0.02,
            foot + STOREY * storeys as f64 - 0.02,
        ]);
        let (_, bay) = kit.bays.iter().find(|(m, _)| *m == house.walls[0]).expect("a bay of this material");
        let site = site.within(x, foot, 0.0, 0.0);
        bay.place(model, site, storeys, &kit.openings, |s| filling(number, s, middle));
    }
    let name = format!("front {number}");
    pierced(model, site, &name, house.walls[0], [0.0, GROUND, width, house.top()], &holes);
}

/// A ground floor of windows with a door in the middle.
fn street_windows(model: &mut Model, kit: &Kit, site: &Site, house: &House, width: f64, number: usize) {
    let middle = house.axes / 2;
    let floor = 0.75;
    let mut holes = Vec::new();
    for a in 0..house.axes {
        let x = width * (a as f64 + 0.5) / house.axes as f64;
        if a == middle {
            holes.push(door_hole(x));
            site.within(x, PAVED, 0.0, 0.0).place(model, &kit.door);
        } else {
            let kind = Kind::Sash;
            holes.push(hole(kind, x, floor));
            let window = kit.openings.window(kind, filling(number, 9, a));
            site.within(x, floor + kind.sill(), 0.0, 0.0).place(model, window);
        }
    }
    pierced(model, site, &format!("ground {number}"), house.walls[1], [0.0, FOOT, width, GROUND], &holes);
    // A plinth between the doors' surrounds.
    let door = width * (middle as f64 + 0.5) / house.axes as f64;
    for (x0, x1) in [(0.0, door - 0.95), (door + 0.95, width)] {
        let plinth = bevelled([x0, FOOT, -0.05], [x1, 0.95, 0.07], 0.03).standing();
        let (front, rest) = plinth.split(|n| n.z > 0.99);
        model.add(&format!("ground {number}"), "granite", site.set(front));
        model.add("trim_detail", "granite", site.set(rest));
    }
}

/// String courses, cornice with brackets, quoins and a downpipe.
fn trim(model: &mut Model, site: &Site, house: &House, width: f64) {
    let band = |y0: f64, y1: f64, out: f64| block([0.0, y0, -0.05], [width, y1, out], ALL & !NORTH);
    let top = house.top();
    let mut mesh = band(GROUND - 0.26, GROUND - 0.08, 0.08).with(band(GROUND - 0.1, GROUND + 0.06, 0.17));
    for s in 1..house.storeys {
        let floor = GROUND + STOREY * s as f64;
        if house.extra != Extra::Bay && house.kind != Kind::Shuttered {
            mesh.append(band(floor - 0.02, floor + 0.08, 0.045));
        }
    }
    mesh.append(band(top - 0.8, top - 0.68, 0.06));
    mesh.append(band(top - 0.3, top - 0.14, 0.42).with(band(top - 0.16, top + 0.02, 0.5)));
    let brackets = (width / 0.62).round() as usize;
    for k in 0..brackets {
        let x = width * (k as f64 + 0.5) / brackets as f64;
        mesh.append(bevelled([x - 0.08, top - 0.585, -0.05], [x + 0.08, top - 0.28, 0.14], 0.02));
        mesh.append(bevelled([x - 0.07, top - 0.42, -0.05], [x + 0.07, top - 0.28, 0.36], 0.02));
    }
    if house.kind == Kind::Sash {
        mesh.append(quoins(width, top));
    }
    model.add("trim_detail", "stucco", site.set(mesh));
    let foot = if matches!(house.ground, Ground::Arcade(..)) { GROUND - 0.1 } else { FOOT };
    let x = width - 0.14;
    let path: Vec<(DVec3, f64)> = [
        (top - 0.1, 0.45),
        (top - 0.35, 0.42),
        (top - 0.95, 0.12),
        (GROUND + 0.4, 0.12),
        (GROUND + 0.15, 0.25),
        (GROUND - 0.35, 0.24),
        (GROUND - 0.6, 0.11),
        (foot, 0.11),
    ]
    .map(|(y, z)| (DVec3::new(x, y, z), 0.05))
    .into();
    let clips = steps(GROUND + 1.0, top - 1.5, 3).into_iter().map(|y| {
        let ring = [(DVec3::new(x, y, 0.12), 0.065), (DVec3::new(x, y + 0.06, 0.12), 0.065)];
        tube(&ring, 8)
    });
    let end = if foot < GROUND - 1.0 { path.len() } else { 4 };
    let pipe = clips.fold(tube(&path[..end], 8), Mesh::with);
    model.add("pipes_detail", "zinc", site.set(pipe));
}

/// Long and short stones up both edges.
fn quoins(width: f64, top: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let courses = ((top - 0.85 - GROUND - 0.1) / 0.42) as usize;
    for k in 0..courses {
        let (y, length) = (GROUND + 0.1 + 0.42 * k as f64, if k % 2 == 0 { 0.6 } else { 0.38 });
        mesh.append(block([0.0, y, -0.05], [length, y + 0.39, 0.04], ALL & !NORTH));
        mesh.append(block([width - length, y, -0.05], [width, y + 0.39, 0.04], ALL & !NORTH));
    }
    mesh
}
