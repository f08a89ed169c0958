//! What the city is made of: linear albedos; a textured material's factor tints its texture.

use super::{streets, textures};
use crate::model::{Material, Model, Texture};
use crate::textures as shared;

pub fn build(model: &mut Model) {
    let mut texture = |t: Texture| {
        model.textures.push(t);
        model.textures.len() - 1
    };
    let road = texture(textures::road());
    let asphalt = texture(textures::asphalt());
    let zebra = texture(textures::zebra());
    let paving = texture(textures::pavement());
    let ashlar = texture(textures::ashlar());
    let slate = texture(textures::slate());
    let windows = texture(textures::distant_windows());
    let brick = texture(shared::brick());
    let plaster = texture(shared::plaster());
    let planks = texture(shared::planks());
    let tiles = texture(shared::roof_tiles());
    let bark = texture(shared::bark());
    let spray = texture(shared::leaf_spray());
    let white = [1.0, 1.0, 1.0];
    let mut material = |name, albedo: [f64; 3], texture| {
        model.materials.push(Material { name, albedo, texture, cutoff: None, double_sided: false });
    };
    material("road", white, Some((road, streets::ROAD)));
    material("asphalt", white, Some((asphalt, 4.0)));
    material("zebra", white, Some((zebra, 1.0)));
    material("paving", white, Some((paving, 2.4)));
    material("roof_tiles", white, Some((tiles, 2.4)));
    material("slate", white, Some((slate, 2.0)));
    material("brick", [1.0, 0.96, 0.92], Some((brick, 1.0)));
    material("dark_brick", [0.62, 0.56, 0.56], Some((brick, 1.0)));
    material("sandstone", white, Some((ashlar, 3.2)));
    material("limestone", [1.04, 1.1, 1.18].map(|c: f64| c.min(1.0)), Some((ashlar, 3.2)));
    material("distant", white, Some((windows, 14.0)));
    // Painted plaster.
    for (name, albedo) in [
        ("cream", [1.0, 0.97, 0.92]),
        ("ochre", [0.92, 0.68, 0.40]),
        ("rose", [0.92, 0.66, 0.60]),
        ("sage", [0.66, 0.78, 0.68]),
        ("pale_blue", [0.66, 0.76, 0.92]),
        ("terracotta", [0.80, 0.44, 0.32]),
        ("grey", [0.62, 0.64, 0.68]),
    ] {
        material(name, albedo, Some((plaster, 3.0)));
    }
    material("bark", white, Some((bark, 0.8)));
    material("oak", [0.60, 0.40, 0.22], Some((planks, 0.8)));
    material("green_wood", [0.14, 0.30, 0.19], Some((planks, 0.8)));
    material("red_wood", [0.46, 0.12, 0.10], Some((planks, 0.8)));
    material("blue_wood", [0.12, 0.22, 0.38], Some((planks, 0.8)));
    material("stucco", [0.74, 0.71, 0.64], None);
    material("granite", [0.38, 0.37, 0.36], None);
    material("white_wood", [0.78, 0.77, 0.74], None);
    material("glass", [0.06, 0.07, 0.08], None);
    material("linen", [0.66, 0.63, 0.56], None);
    material("drapes", [0.34, 0.29, 0.22], None);
    material("iron", [0.06, 0.065, 0.07], None);
    material("zinc", [0.42, 0.44, 0.46], None);
    material("copper", [0.26, 0.46, 0.38], None);
    material("steel", [0.50, 0.51, 0.52], None);
    material("tyre", [0.055, 0.055, 0.055], None);
    material("gravel", [0.34, 0.32, 0.29], None);
    material("soil", [0.09, 0.065, 0.052], None);
    material("clay", [0.52, 0.22, 0.12], None);
    material("bread", [0.62, 0.38, 0.17], None);
    material("red_cloth", [0.60, 0.10, 0.08], None);
    material("blue_cloth", [0.10, 0.16, 0.42], None);
    material("mustard", [0.68, 0.46, 0.08], None);
    material("paper", [0.78, 0.76, 0.70], None);
    // Car paints.
    material("silver_paint", [0.52, 0.53, 0.54], None);
    material("red_paint", [0.48, 0.06, 0.055], None);
    material("blue_paint", [0.07, 0.14, 0.34], None);
    material("white_paint", [0.76, 0.76, 0.75], None);
    material("tail_light", [0.50, 0.055, 0.055], None);
    material("land", [0.20, 0.19, 0.17], None);
    // Single sheets.
    for (name, albedo) in [
        ("red_awning", [0.56, 0.12, 0.10]),
        ("green_awning", [0.14, 0.34, 0.22]),
        ("canvas", [0.80, 0.74, 0.60]),
    ] {
        model.materials.push(Material { name, albedo, texture: None, cutoff: None, double_sided: true });
    }
    for (name, albedo) in [("leaves", [0.96, 1.0, 0.9]), ("box_leaves", [0.62, 0.74, 1.0])] {
        model.materials.push(Material {
            name,
            albedo,
            texture: Some((spray, 1.0)),
            cutoff: Some(0.5),
            double_sided: true,
        });
    }
}
