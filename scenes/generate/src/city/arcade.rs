//! The arcade: piers and arches along the street, groined vaults behind them, shops under the vaults.

use super::facade::door_hole;
use super::house::{Ground, House, Kit};
use super::{GROUND, PAVED, Site, shops};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::relief::{full, grid, sheet, sorted, steps};
use crate::shapes::{bevelled, lathe};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Bays per house.
pub const BAYS: usize = 3;
/// Thickness of the wall with the arches.
const THICK: f64 = 0.7;
/// Depth of the vaults behind it.
const VAULT: f64 = 3.3;
/// Half the span of an arch, its springing and its rise.
const HALF: f64 = 1.42;
const SPRING: f64 = 2.75;
const RISE: f64 = 1.35;
/// The walls that close the arcade's ends stand this far before the neighbours'.
const INSET: f64 = 0.03;
/// Springing and rise of the vaults.
const IMPOST: f64 = 2.95;
const CROWN: f64 = 1.45;

/// Height of a vault at normalised coordinates −1 … 1 across a bay: two crossing barrels.
fn vault(s: f64, t: f64) -> f64 {
    IMPOST + CROWN * barrel(s).max(barrel(t))
}

/// A segmental arch of unit rise.
fn barrel(s: f64) -> f64 {
    // Part of a circle about (0, −C) that passes (±1, 0) and (0, 1) after scaling.
    const C: f64 = 0.35;
    let r2 = 1.0 + C * C;
    ((r2 - s * s).sqrt() - C) / (r2.sqrt() - C)
}

/// The arcade of one house; `ends` says whether it is closed on the left and on the right.
pub fn build(model: &mut Model, kit: &Kit, site: &Site, house: &House, width: f64, ends: [bool; 2]) {
    let Ground::Arcade(first, second) = house.ground else { return };
    let bay = width / BAYS as f64;
    let back = -THICK - VAULT;
    let stone = house.walls[1];
    let tag = format!("{:.0}", site.origin.x.abs());
    let name = |part: &str| format!("{part} {tag}");
    // Wall to the street, and its inner face, whose top follows the vaults.
    for k in 0..BAYS {
        let x0 = bay * k as f64;
        let front = arch_wall(x0, bay, |_| GROUND);
        model.add(&name("arcade front"), stone, site.set(front));
        let inner = arch_wall(-x0 - bay, bay, |x| lining((-x - x0) / bay)).turned(180.0);
        model.add(&name("arcade inside"), "cream", site.set(inner.translated(0.0, 0.0, -THICK)));
        model.add(&name("arcade reveals"), stone, site.set(intrados(x0 + bay / 2.0)));
        model.add(&name("vaults"), "cream", site.set(groin(x0, bay, back)));
        trim(model, site, x0, bay);
    }
    // Wall behind with shop windows and a door.
    let xs: Vec<f64> = (0..BAYS).map(|k| bay * (k as f64 + 0.5)).collect();
    let holes = [shops::opening(xs[0]), door_hole(xs[1]), shops::opening(xs[2])];
    let (us, vs, filled) = grid([0.0, PAVED - 0.03, width, IMPOST + 0.5], &holes);
    let lower = sheet(&us, &vs, filled, |u, v| DVec3::new(u, v, back));
    model.add(&name("arcade back"), "cream", site.set(lower));
    let mut us = us;
    us.extend(steps(0.0, width, 16 * BAYS));
    let lunette = full(&sorted(us), &[0.0, 1.0], |u, t| {
        let low = IMPOST + 0.5;
        let high = lining(u / bay - (u / bay).floor().min(BAYS as f64 - 1.0)).max(low + 0.01);
        DVec3::new(u, low + (high - low) * t, back)
    });
    model.add(&name("arcade back"), "cream", site.set(lunette));
    for (x, shop) in [(xs[0], first), (xs[2], second)] {
        kit.shops.place(model, &site.within(x, 0.0, back, 0.0), shop);
    }
    site.within(xs[1], PAVED, back, 0.0).place(model, &kit.door);
    // The floor, and the walls that close the ends.
    let mut floor =
        full(&[back - 0.05, -0.05], &steps(0.0, width, 3), |z, x| DVec3::new(x, PAVED + 0.004, z));
    floor.uvs = floor.positions.iter().map(|p| DVec2::new(p.x, p.z)).collect();
    model.add(&name("arcade floor"), "paving", site.set(floor));
    for (side, closed) in [-1.0, 1.0].into_iter().zip(ends) {
        if closed {
            let x = if side < 0.0 { INSET } else { width - INSET };
            let (a, b) = if side < 0.0 { (-THICK, back) } else { (back, -THICK) };
            let wall = full(&steps(a, b, 16), &[0.0, 1.0], |z, t| {
                let s = (z + THICK + VAULT / 2.0) / (VAULT / 2.0);
                let high = IMPOST + CROWN * barrel(s.clamp(-1.0, 1.0)) + 0.04;
                DVec3::new(x, PAVED - 0.03 + (high - PAVED + 0.03) * t, z)
            });
            model.add(&name("arcade end"), "cream", site.set(wall));
        }
    }
}

/// Height of a wall's top under a vault, a little above it, at a bay's coordinate 0 … 1.
fn lining(t: f64) -> f64 {
    IMPOST + CROWN * barrel((2.0 * t - 1.0).clamp(-1.0, 1.0)) + 0.04
}

/// Half a circle's sweep from the left springing to the right one: point, and height.
fn arch() -> Vec<[f64; 2]> {
    steps(0.0, PI, 20).into_iter().map(|a| [-HALF * a.cos(), SPRING + RISE * a.sin()]).collect()
}

/// The wall of a bay about an arch, in the plane z = 0, up to `top`.
fn arch_wall(x0: f64, bay: f64, top: impl Fn(f64) -> f64) -> Mesh {
    let (middle, foot) = (x0 + bay / 2.0, PAVED - 0.05);
    let curve = arch();
    // Piers.
    let pier = |xs: &[f64]| {
        full(xs, &[0.0, 0.5, 1.0], |x, t| {
            let y = if t < 0.6 { foot + (SPRING - foot) * t * 2.0 } else { top(x) };
            DVec3::new(x, y, 0.0)
        })
    };
    let (left, right) = (middle - HALF, middle + HALF);
    let mut mesh = pier(&steps(x0, left, 3)).with(pier(&steps(right, x0 + bay, 3)));
    // Spandrels.
    let ks = steps(0.0, (curve.len() - 1) as f64, curve.len() - 1);
    mesh.append(full(&ks, &[0.0, 1.0], |k, t| {
        let [x, y] = curve[k as usize];
        let x = middle + x;
        DVec3::new(x, y + (top(x) - y) * t, 0.0)
    }));
    mesh
}

/// The arch's thickness: up one pier, over, down the other.
fn intrados(middle: f64) -> Mesh {
    let foot = PAVED - 0.05;
    let mut line = vec![[-HALF, foot], [-HALF, (foot + SPRING) / 2.0]];
    line.extend(arch());
    line.extend([[HALF, (foot + SPRING) / 2.0], [HALF, foot]]);
    let ks = steps(0.0, (line.len() - 1) as f64, line.len() - 1);
    full(&ks, &[-THICK, 0.0], |k, z| {
        let [x, y] = line[k as usize];
        DVec3::new(middle + x, y, z)
    })
}

/// A groined vault, its creases on the grid's diagonals.
fn groin(x0: f64, bay: f64, back: f64) -> Mesh {
    const N: usize = 16;
    let lines = |k: usize| (k as f64 / N as f64 * PI - FRAC_PI_2).sin();
    let at = |i: usize, j: usize| {
        let (s, t) = (lines(i), lines(j));
        let x = x0 + bay * (s + 1.0) / 2.0;
        let z = back + VAULT * (t + 1.0) / 2.0;
        DVec3::new(x, vault(s, t), z)
    };
    let mut mesh = Mesh::default();
    for j in 0..=N {
        for i in 0..=N {
            let p = at(i, j);
            mesh.vertex(p, DVec2::new(p.x, p.z));
        }
    }
    let index = |i: usize, j: usize| (j * (N + 1) + i) as u32;
    for j in 0..N {
        for i in 0..N {
            let (a, b, c, d) = (index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1));
            // Looking down, each cell is cut along the crease's direction.
            if (2 * i + 1 > N) == (2 * j + 1 > N) {
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                mesh.triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    mesh.smoothed()
}

/// Imposts and plinths of the piers, keystones, and a hanging lantern.
fn trim(model: &mut Model, site: &Site, x0: f64, bay: f64) {
    let middle = x0 + bay / 2.0;
    let mut mesh = Mesh::default();
    for (a, b) in [(x0, middle - HALF), (middle + HALF, x0 + bay)] {
        for (y0, y1, out) in [(PAVED - 0.05, 0.55, 0.06), (SPRING - 0.16, SPRING, 0.05)] {
            mesh.append(bevelled([a, y0, -THICK - out], [b, y1, out], 0.015));
            // Around the pier's side towards the arch.
            let x = if a > middle { a - out } else { b - 0.1 };
            mesh.append(bevelled(
                [x, y0, -THICK - out + 0.002],
                [x + 0.1 + out, y1 - 0.002, out - 0.002],
                0.015,
            ));
        }
    }
    let top = SPRING + RISE;
    mesh.append(bevelled([middle - 0.16, top - 0.05, -0.2], [middle + 0.16, GROUND - 0.2, 0.1], 0.02));
    model.add("arcade_detail", "stucco", site.set(mesh));
    let [x, y, z] = lantern(bay, x0);
    let glass = super::lamps::lantern_head();
    for (material, part) in glass {
        model.add("arcade_lamps_detail", material, site.set(part.translated(x, y, z)));
    }
    let ceiling = IMPOST + CROWN;
    let rod = lathe(&[&[(0.012, y + 0.3), (0.012, ceiling + 0.02)]], 6);
    model.add("arcade_lamps_detail", "iron", site.set(rod.translated(x, 0.0, z)));
    let rose = lathe(&[&[(0.02, ceiling - 0.06), (0.12, ceiling + 0.02)]], 12);
    model.add("arcade_lamps_detail", "iron", site.set(rose.translated(x, 0.0, z)));
}

/// The lamp in the vault of the bay that begins at `x0`, in the house's frame.
pub fn lantern(bay: f64, x0: f64) -> [f64; 3] {
    [x0 + bay / 2.0, 3.25, -THICK - VAULT / 2.0]
}
