//! Who stands where: the houses of the four blocks, from left to right as seen from their streets.

use super::balconies::{self, Bay};
use super::house::{Extra, Ground, House, Kit, Roof};
use super::openings::{Kind, Openings};
use super::shops::{Shop, Shops};
use super::{Block, DEPTH, END, Site, blocks};
use super::{arcade, corner, doors, facade, roofs, rooftop};
use crate::model::Model;

const fn house(
    storeys: usize,
    axes: usize,
    walls: [&'static str; 2],
    kind: Kind,
    extra: Extra,
    ground: Ground,
    roof: Roof,
) -> House {
    House { storeys, axes, walls, kind, extra, ground, roof }
}

/// Per block the houses along its south side (from the corner outwards) and along its west side (towards the
/// corner).
#[rustfmt::skip]
fn rows() -> [[Vec<House>; 2]; 4] {
    use {Extra as E, Ground::*, Kind::*, Roof::*, Shop::*};
    let red = Pitched("roof_tiles");
    let slate = Pitched("slate");
    [
        // North-east: the street, then the avenue.
        [
            vec![
                house(3, 4, ["cream", "sandstone"], Tall, E::Balconies, Shops(Bakery, Fashion), Mansard),
                house(3, 4, ["brick", "limestone"], Sash, E::None, Shops(Books, Books), slate),
            ],
            vec![
                house(3, 3, ["ochre", "ochre"], Shuttered, E::None, Windows, red),
                house(4, 3, ["pale_blue", "limestone"], Tall, E::Bay, Shops(Books, Fashion), Mansard),
                house(3, 3, ["rose", "sandstone"], Tall, E::Balconies, Shops(Cafe, Cafe), red),
            ],
        ],
        // North-west: the avenue, then the street with the arcade.
        [
            vec![
                house(4, 4, ["sage", "limestone"], Tall, E::Bay, Shops(Fashion, Books), slate),
                house(3, 4, ["cream", "cream"], Shuttered, E::None, Windows, red),
            ],
            vec![
                house(3, 4, ["sandstone", "sandstone"], Tall, E::Balconies, Arcade(Books, Fashion), red),
                house(3, 4, ["cream", "sandstone"], Tall, E::None, Arcade(Cafe, Bakery), red),
            ],
        ],
        // South-west: the street, then the avenue.
        [
            vec![
                house(3, 3, ["terracotta", "terracotta"], Shuttered, E::None, Windows, red),
                house(4, 3, ["grey", "limestone"], Tall, E::Bay, Shops(Books, Books), Mansard),
                house(3, 3, ["ochre", "sandstone"], Sash, E::None, Shops(Fashion, Books), slate),
            ],
            vec![
                house(3, 4, ["brick", "limestone"], Sash, E::Balconies, Shops(Fashion, Books), Flat),
                house(4, 4, ["cream", "sandstone"], Tall, E::Balconies, Shops(Bakery, Fashion), Mansard),
            ],
        ],
        // South-east: the avenue, then the street.
        [
            vec![
                house(3, 3, ["rose", "limestone"], Tall, E::Balconies, Shops(Fashion, Books), red),
                house(3, 3, ["dark_brick", "dark_brick"], Sash, E::None, Windows, slate),
                house(4, 3, ["sage", "sandstone"], Tall, E::Bay, Shops(Books, Books), Mansard),
            ],
            vec![
                house(3, 4, ["pale_blue", "pale_blue"], Shuttered, E::None, Windows, red),
                house(3, 4, ["cream", "limestone"], Tall, E::Balconies, Shops(Cafe, Bakery), slate),
            ],
        ],
    ]
}

/// The corner houses' walls, and whether a dome stands over the cut corner.
const CORNERS: [(&str, bool); 4] =
    [("sandstone", true), ("rose", false), ("brick", false), ("limestone", true)];

/// The block's sides as façades: left end, turn, length, and where its houses begin and end along it.
fn sides(block: &Block) -> [(Site, [f64; 2]); 2] {
    let (x, z) = (block.west[0], block.south[0]);
    let south = block.site.within(x, 0.0, -z, 0.0);
    let west = block.site.within(x, 0.0, -END, -90.0);
    [(south, [DEPTH, END - x]), (west, [0.0, END - z - DEPTH])]
}

pub fn build(model: &mut Model) {
    let kit = Kit {
        openings: Openings::new(model),
        door: doors::door(model),
        balcony: balconies::balcony(model),
        flowers: balconies::flower_box(model),
        bays: ["pale_blue", "sage", "grey"].map(|m| (m, Bay::new(model, m))).into(),
        shops: Shops::new(model),
        tops: rooftop::Tops::new(model),
    };
    let mut number = 0;
    for (block, (row, (walls, dome))) in blocks().iter().zip(rows().into_iter().zip(CORNERS)) {
        for ((site, [from, to]), houses) in sides(block).into_iter().zip(row) {
            let width = (to - from) / houses.len() as f64;
            for (k, house) in houses.iter().enumerate() {
                number += 1;
                let site = site.within(from + width * k as f64, 0.0, 0.0, 0.0);
                facade::build(model, &kit, &site, house, width, number);
                roofs::build(model, &kit, &site, house, width, number);
                if let Ground::Arcade(..) = house.ground {
                    arcade::build(model, &kit, &site, house, width, [k == 0, k + 1 == houses.len()]);
                }
            }
        }
        corner::build(model, &kit, block, walls, dome, number);
    }
}
