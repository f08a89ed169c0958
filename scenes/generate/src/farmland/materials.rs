//! What things are made of: linear albedos; a textured material's factor tints its texture.

use super::{cutouts, terrain, textures};
use crate::model::{Material, Model, Texture};

pub fn add(model: &mut Model) {
    let mut texture = |t: Texture| {
        model.textures.push(t);
        model.textures.len() - 1
    };
    let yard_ground = texture(textures::yard_ground());
    let track = texture(textures::track());
    let meadow = texture(textures::meadow());
    let soil = texture(textures::soil());
    let stubble = texture(textures::stubble());
    let far_fields = texture(textures::far_fields());
    let boards = texture(textures::boards());
    let metal_sheet = texture(textures::metal_sheet());
    let straw = texture(textures::straw());
    let rubble = texture(textures::rubble());
    let slate = texture(textures::slate());
    let plaster = texture(crate::textures::plaster());
    let bark = texture(crate::textures::bark());
    let spray = texture(cutouts::spray());
    let blades = texture(cutouts::blades());
    let crop_leaf = texture(cutouts::crop_leaf());
    let white = [1.0, 1.0, 1.0];
    let mut material = |name, albedo: [f64; 3], texture| {
        model.materials.push(Material { name, albedo, texture, cutoff: None, double_sided: false });
    };
    material("yard_ground", white, Some((yard_ground, 2.0 * terrain::YARD)));
    material("track", white, Some((track, textures::TRACK)));
    material("grass", white, Some((meadow, textures::MEADOW)));
    material("soil", white, Some((soil, textures::SOIL)));
    material("crop_soil", [0.92, 0.92, 0.95], Some((soil, textures::SOIL)));
    material("stubble", white, Some((stubble, textures::STUBBLE)));
    material("far_fields", white, Some((far_fields, terrain::FAR)));
    // The same boards weathered, painted and old; the same sheet on roofs and small things.
    material("boards", [0.86, 0.80, 0.74], Some((boards, 2.0)));
    material("old_boards", [0.62, 0.54, 0.46], Some((boards, 2.0)));
    material("red_boards", [0.68, 0.27, 0.29], Some((boards, 1.4)));
    material("old_wood", [0.70, 0.66, 0.60], Some((boards, 1.6)));
    material("zinc_sheet", white, Some((metal_sheet, 6.0)));
    material("zinc", [0.40, 0.41, 0.42], None);
    material("straw", white, Some((straw, 1.2)));
    material("straw_floor", [0.62, 0.58, 0.54], Some((straw, 1.6)));
    material("rubble", white, Some((rubble, 2.0)));
    material("stone", [0.92, 0.92, 0.92], Some((rubble, 5.0)));
    material("slate", white, Some((slate, 3.6)));
    material("render", [0.96, 0.97, 1.0], Some((plaster, 2.0)));
    material("bark", white, Some((bark, 0.8)));
    material("concrete", [0.60, 0.62, 0.66], Some((plaster, 3.0)));
    material("thicket", [0.10, 0.11, 0.06], None);
    material("white_wood", [0.78, 0.77, 0.73], None);
    material("blue_wood", [0.12, 0.24, 0.32], None);
    material("red_paint", [0.48, 0.08, 0.06], None);
    material("cream_paint", [0.70, 0.64, 0.48], None);
    material("rubber", [0.055, 0.055, 0.058], None);
    material("iron", [0.10, 0.09, 0.09], None);
    material("glass", [0.06, 0.07, 0.08], None);
    material("terracotta", [0.50, 0.24, 0.15], None);
    for (name, albedo, texture) in [
        ("oak_leaves", [0.26, 0.30, 0.14], spray),
        ("apple_leaves", [0.34, 0.38, 0.13], spray),
        ("poplar_leaves", [0.66, 0.54, 0.13], spray),
        ("birch_leaves", [0.62, 0.44, 0.14], spray),
        ("hedge_leaves", [0.22, 0.28, 0.14], spray),
        ("bush_leaves", [0.34, 0.25, 0.14], spray),
        ("grass_blades", [0.95, 0.95, 0.9], blades),
        ("crop_leaves", [0.9, 1.0, 0.95], crop_leaf),
    ] {
        let (texture, cutoff) = (Some((texture, 1.0)), Some(0.5));
        model.materials.push(Material { name, albedo, texture, cutoff, double_sided: true });
    }
}
