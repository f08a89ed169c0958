//! What ends the view: plain houses along the streets beyond the scene's edge, others across their ends, and
//! the land.

use super::{DEPTH, END, Site, blocks};
use crate::model::Model;
use crate::shapes::{self, EAST, NORTH, SOUTH, TOP, WEST, block, prism};

/// How far streets and houses go on.
const FAR: f64 = 92.0;
/// Height of the land and of the streets there.
const LAND: f64 = -0.03;

pub fn build(model: &mut Model) {
    let mut number = 0;
    for block in blocks() {
        let (x, z) = (block.west[0], block.south[0]);
        let south = block.site.within(END, 0.0, -z, 0.0);
        let west = block.site.within(x, 0.0, -FAR, -90.0);
        for site in [south, west] {
            let mut along = 0.0;
            for width in [15.0, 12.0, FAR - END - 27.0] {
                number += 1;
                let height = 13.5 + 1.1 * f64::from(number * 7 % 5);
                house(model, &site.within(along, 0.0, 0.0, 0.0), width, height);
                along += width;
            }
        }
        // The land between the block's houses, and beyond.
        let yard =
            shapes::block([x + DEPTH - 0.5, -1.0, -FAR - 40.0], [FAR + 40.0, LAND, -z - DEPTH + 0.5], TOP);
        model.add("land_occluder", "land", block.site.set(yard));
        let street = shapes::block([-x, -1.0, -FAR - 40.0], [x, LAND, -END], TOP);
        model.add("land_occluder", "asphalt", block.site.set(street));
        // Across the street's end.
        let end = block.site.within(-23.0, 0.0, -FAR - 14.0, 0.0);
        house(model, &end, 46.0, 16.5);
    }
}

/// A plain house with a ridge along the street.
fn house(model: &mut Model, site: &Site, width: f64, height: f64) {
    let walls = block([0.0, LAND - 0.1, -DEPTH], [width, height, 0.0], EAST | WEST | NORTH | SOUTH);
    model.add("distant_occluder", "distant", site.set(walls));
    let section = [[0.4, height], [-DEPTH / 2.0, height + 4.0], [-DEPTH - 0.4, height]];
    let (sides, ends) = prism(&section, -0.05, width + 0.05);
    for (k, side) in sides.into_iter().enumerate() {
        let material = if k == 2 { "stucco" } else { "roof_tiles" };
        model.add("distant_roofs_occluder", material, site.set(side));
    }
    model.add("distant_roofs_occluder", "stucco", site.set(ends));
}
