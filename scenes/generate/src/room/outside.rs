//! What the windows look at: a lawn, a house across the garden to the south, a hedge to the west.

use crate::model::Model;
use crate::shapes::{ALL, BOTTOM, TOP, block};

/// Of the lawn below the floor.
const LAWN: f64 = -0.6;

pub fn build(model: &mut Model) {
    let r = 40.0;
    model.add("lawn_occluder", "lawn", block([-r, LAWN - 1.0, -r], [r, LAWN, r], TOP));
    // Too low and too far to hide the midday sun.
    let house = block([-9.0, LAWN - 0.1, 15.0], [7.0, 3.6, 23.0], ALL & !BOTTOM);
    model.add("house_occluder", "facade", house);
    let hedge = block([-13.0, LAWN - 0.1, -8.0], [-12.0, 0.9, 12.0], ALL & !BOTTOM);
    model.add("hedge_occluder", "hedge", hedge);
}
