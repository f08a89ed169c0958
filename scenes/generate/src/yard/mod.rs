//! An enclosed yard, 16 × 12 m: a house front to the north, a garage to the north-east, a brick wall to the
//! west, a picket fence with two gates to the south and east; a tree, a terrace with table and chairs, paths
//! and garden things.
//!
//! Mesh names say what a lightmap should make of them: `*_detail` is too thin for texels, `*_occluder` only
//! blocks and reflects light, `leaves` are cut-out cards; everything else is meant to be lit. Parts that meet
//! are sunk into each other by 2 cm or more, so that no two faces coincide, and faces nobody can see are left
//! out.

mod fence;
mod foliage;
mod furniture;
mod garage;
mod garden;
mod ground;
mod house;
mod roof;
#[cfg(test)]
mod tests;

use crate::model::{Material, Model};
use crate::textures;

/// The house front's plane.
const FRONT: f64 = -6.0;
/// The house's sides.
const HOUSE_X: [f64; 2] = [-8.4, 4.3];
/// The garage's west and east walls.
const GARAGE_X: [f64; 2] = [4.0, 8.0];
/// The garage's back and front walls.
const GARAGE_Z: [f64; 2] = [-6.6, -1.6];
/// The fence line to the south.
const SOUTH_Z: f64 = 6.0;
/// The fence line to the east.
const EAST_X: f64 = 8.0;
/// The brick wall's inner and outer faces to the west.
const WEST_X: [f64; 2] = [-7.88, -8.12];
/// Walls start below the lawn.
const BELOW: f64 = -0.3;

/// The whole scene.
pub fn model() -> Model {
    let mut model = Model::default();
    materials(&mut model);
    ground::build(&mut model);
    house::build(&mut model);
    roof::build(&mut model);
    garage::build(&mut model);
    fence::build(&mut model);
    foliage::build(&mut model);
    furniture::build(&mut model);
    garden::build(&mut model);
    model
}

/// Linear albedos; a textured material's factor tints its texture.
fn materials(model: &mut Model) {
    let mut texture = |t: crate::model::Texture| {
        model.textures.push(t);
        model.textures.len() - 1
    };
    let brick = texture(textures::brick());
    let plaster = texture(textures::plaster());
    let planks = texture(textures::planks());
    let grass = texture(textures::grass());
    let paving = texture(textures::paving());
    let tiles = texture(textures::roof_tiles());
    let bark = texture(textures::bark());
    let spray = texture(textures::leaf_spray());
    let mut material = |name, albedo: [f64; 3], texture| {
        model.materials.push(Material { name, albedo, texture, cutoff: None, double_sided: false });
    };
    material("brick", [1.0, 1.0, 1.0], Some((brick, 1.0)));
    material("plaster", [1.0, 1.0, 1.0], Some((plaster, 2.0)));
    material("grass", [1.0, 1.0, 1.0], Some((grass, 2.0)));
    material("paving", [1.0, 1.0, 1.0], Some((paving, ground::SLAB * 4.0)));
    material("roof_tiles", [1.0, 1.0, 1.0], Some((tiles, 8.0 * roof::TILE_WIDTH)));
    material("bark", [1.0, 1.0, 1.0], Some((bark, 0.8)));
    // Painted and bare wood: the same boards under different tints.
    material("red_planks", [0.62, 0.20, 0.13], Some((planks, 1.6)));
    material("fence_wood", [0.78, 0.66, 0.50], Some((planks, 1.2)));
    material("oak", [0.60, 0.40, 0.22], Some((planks, 0.8)));
    material("blue_wood", [0.16, 0.30, 0.42], Some((planks, 0.8)));
    material("green_wood", [0.17, 0.33, 0.20], Some((planks, 0.8)));
    material("blue_paint", [0.08, 0.18, 0.27], None);
    material("white_wood", [0.80, 0.79, 0.75], None);
    material("glass", [0.06, 0.07, 0.08], None);
    material("metal", [0.30, 0.31, 0.32], None);
    material("iron", [0.07, 0.07, 0.08], None);
    material("bitumen", [0.10, 0.10, 0.11], None);
    material("terracotta", [0.52, 0.22, 0.12], None);
    material("soil", [0.09, 0.06, 0.04], None);
    material("sand", [0.60, 0.48, 0.31], None);
    material("yellow_paint", [0.74, 0.52, 0.08], None);
    material("fields", [0.16, 0.20, 0.09], None);
    material("street", [0.20, 0.20, 0.20], None);
    material("stone", [0.42, 0.40, 0.37], None);
    model.materials.push(Material {
        name: "leaves",
        albedo: [1.0, 1.0, 1.0],
        texture: Some((spray, 1.0)),
        cutoff: Some(0.5),
        double_sided: true,
    });
}
