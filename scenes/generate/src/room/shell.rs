//! Floor, ceiling and walls: inner faces with holes where something hides them, and the outer faces that keep
//! the light out.

use super::walls::{EAST, NORTH, SOUTH, WEST};
use super::{HALF_X, HALF_Z, HEIGHT, THICK, joinery, lounge, windows};
use crate::model::Model;
use crate::relief::{Rect, grid, sheet};
use crate::shapes::{BOTTOM, TOP, block};
use glam::DVec3;

pub fn build(model: &mut Model) {
    // Walls begin behind the skirting and end behind the coving, as the ceiling does.
    let (foot, rim) = (joinery::SKIRTING - 0.01, joinery::COVING - 0.01);
    let (south, west) = (windows::SOUTH_WINDOWS.to_vec(), windows::WEST_WINDOWS.to_vec());
    let [u0, _, u1, v1] = joinery::DOOR;
    for (name, wall, openings) in [
        ("wall_north", NORTH, vec![[u0, -1.0, u1, v1]]),
        ("wall_south", SOUTH, south.clone()),
        ("wall_east", EAST, vec![]),
        ("wall_west", WEST, west.clone()),
    ] {
        let holes: Vec<Rect> = openings.into_iter().chain(joinery::hidden(&wall)).collect();
        model.add(name, "wallpaper", wall.face([foot, HEIGHT - rim], &holes));
    }
    // The floor under the rug is left out.
    let [x0, z0, x1, z1] = lounge::RUG;
    let inset = 0.03;
    let (us, vs, filled) =
        grid([-HALF_Z, -HALF_X, HALF_Z, HALF_X], &[[z0 + inset, x0 + inset, z1 - inset, x1 - inset]]);
    model.add("floor", "parquet", sheet(&us, &vs, filled, |z, x| DVec3::new(x, 0.0, z)));
    let (us, vs, filled) = grid([-HALF_X + rim, -HALF_Z + rim, HALF_X - rim, HALF_Z - rim], &[]);
    model.add("ceiling", "ceiling", sheet(&us, &vs, filled, |x, z| DVec3::new(x, HEIGHT, z)));
    // Outer faces.
    let (low, high) = (-THICK, HEIGHT + THICK);
    for (wall, holes) in [(NORTH, &vec![]), (EAST, &vec![]), (SOUTH, &south), (WEST, &west)] {
        let half = wall.half + THICK;
        let outer = wall.far_face([-half, low, half, high], THICK, holes);
        model.add("shell_occluder", "facade", outer);
    }
    let (x, z) = (HALF_X + THICK, HALF_Z + THICK);
    model.add("shell_occluder", "facade", block([-x, low, -z], [x, high, z], TOP | BOTTOM));
}
