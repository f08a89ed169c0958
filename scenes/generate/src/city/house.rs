//! What a house consists of, and what houses are made of.

use super::balconies::Bay;
use super::openings::{Kind, Openings};
use super::shops::{Shop, Shops};
use super::{GROUND, STOREY, rooftop};

/// What stands at street level.
#[derive(Clone, Copy, Debug)]
pub enum Ground {
    /// A house door among windows.
    Windows,
    /// Shops to both sides of a house door; a narrow house has the first alone.
    Shops(Shop, Shop),
    /// Open arches before the shops.
    Arcade(Shop, Shop),
}

/// What stands out of the upper storeys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extra {
    /// Nothing.
    None,
    /// Balconies before every second axis, but the top storey's.
    Balconies,
    /// A bay window over the door.
    Bay,
}

/// What lies above.
#[derive(Clone, Copy, Debug)]
pub enum Roof {
    /// A ridge along the street, in this material.
    Pitched(&'static str),
    /// A steep slate slope with dormers.
    Mansard,
    /// Gravel behind a parapet.
    Flat,
}

/// A town house.
#[derive(Clone, Copy, Debug)]
pub struct House {
    /// Upper storeys.
    pub storeys: usize,
    /// Windows per storey.
    pub axes: usize,
    /// Materials of the upper storeys and of the ground floor.
    pub walls: [&'static str; 2],
    /// Its windows.
    pub kind: Kind,
    /// Balconies or a bay.
    pub extra: Extra,
    /// Street level.
    pub ground: Ground,
    /// Its roof.
    pub roof: Roof,
}

impl House {
    /// Height of the eaves.
    pub fn top(&self) -> f64 {
        GROUND + STOREY * self.storeys as f64
    }
}

/// What houses are made of, built once.
pub struct Kit {
    /// Windows.
    pub openings: Openings,
    /// A house door.
    pub door: Vec<usize>,
    /// A balcony.
    pub balcony: Vec<usize>,
    /// A window box.
    pub flowers: Vec<usize>,
    /// Bays in the materials they are wanted in.
    pub bays: Vec<(&'static str, Bay)>,
    /// Shop fronts.
    pub shops: Shops,
    /// Dormers, chimneys and the like.
    pub tops: rooftop::Tops,
}

/// What stands behind a window: the same every time, and different next door.
pub fn filling(number: usize, storey: usize, axis: usize) -> usize {
    let pick = crate::random::cell((number * 8 + storey) as i64, axis as i64, 900);
    [0.34, 0.60, 0.84].iter().filter(|&&limit| pick > limit).count()
}
