//! A street crossing, 88 × 88 m: an avenue from north to south, a street from west to east, and four blocks
//! of town houses with shops, an arcade, balconies, bays and roofs; street trees, cars, lamps and what else
//! stands about.
//!
//! Mesh names say what a lightmap should make of them: `*_detail` is too thin for texels, `*_occluder` only
//! blocks and reflects light, `leaves*` are cut-out cards, `roof*` is seen from above only; everything else
//! is meant to be lit. Parts that meet are sunk into each other by 2 cm or more, so that no two faces
//! coincide, and faces that nobody can see are left out.

mod arcade;
mod backdrop;
mod balconies;
mod cafe;
mod car_body;
mod cars;
mod corner;
mod doors;
mod facade;
mod furniture;
mod house;
mod houses;
mod kiosk;
mod lamps;
mod materials;
mod openings;
mod pavement;
mod roofs;
mod rooftop;
mod shops;
mod site;
mod streets;
#[cfg(test)]
mod tests;
mod textures;
mod trees;

use crate::model::Model;
use site::Site;

/// Half the side of what has texels.
const END: f64 = 44.0;
/// Half the width of the avenue, from façade to façade, and of its roadway.
const AVENUE: [f64; 2] = [9.0, 5.5];
/// The same of the street.
const STREET: [f64; 2] = [7.5, 4.0];
/// Height of the pavements.
const PAVED: f64 = 0.15;
/// How far walls go below the pavement, out of sight.
const FOOT: f64 = PAVED - 0.05;
/// From a house's front to its back.
const DEPTH: f64 = 11.0;
/// What a corner is cut by along each street.
const CHAMFER: f64 = 4.0;
/// Height of the ground floors.
const GROUND: f64 = 4.6;
/// Height of the other floors.
const STOREY: f64 = 3.35;

/// A block, seen in a frame of its own in which it lies to the north-east of the crossing.
#[derive(Clone, Copy, Debug)]
struct Block {
    /// Turns the block to its place: north-east, north-west, south-west, south-east.
    site: Site,
    /// Façade and kerb of the street along its west side, as distances from the crossing's middle.
    west: [f64; 2],
    /// Façade and kerb of the street along its south side.
    south: [f64; 2],
}

/// The four blocks.
fn blocks() -> [Block; 4] {
    [0, 1, 2, 3].map(|k| {
        let (west, south) = if k % 2 == 0 { (AVENUE, STREET) } else { (STREET, AVENUE) };
        Block { site: Site::new(glam::DVec3::ZERO, 90.0 * k as f64), west, south }
    })
}

/// The whole scene.
pub fn model() -> Model {
    let mut model = Model::default();
    materials::build(&mut model);
    streets::build(&mut model);
    pavement::build(&mut model);
    houses::build(&mut model);
    lamps::build(&mut model);
    trees::build(&mut model);
    cars::build(&mut model);
    furniture::build(&mut model);
    kiosk::build(&mut model);
    cafe::build(&mut model);
    backdrop::build(&mut model);
    model
}
