//! A living room, 6.4 × 4.8 × 2.7 m: two windows to the south and one to the west, with blinds and curtains;
//! a sofa corner, a dining table under a pendant lamp, a bookcase, a sideboard and small things.
//!
//! Mesh names say what a lightmap should make of them: `*_detail` is too thin for texels, `*_occluder` stands
//! outside and only blocks and reflects light, `leaves` are too small; everything else is meant to be lit.
//! Parts that meet are sunk into each other, so that no two faces coincide, and large faces that nobody can
//! see are left out.

mod bookcase;
mod dining;
mod joinery;
mod lamps;
mod lounge;
mod outside;
mod plant;
mod shell;
mod sideboard;
#[cfg(test)]
mod tests;
mod textures;
mod walls;
mod windows;

use crate::model::{Material, Model};

/// Half the room's width, west to east.
const HALF_X: f64 = 3.2;
/// Half the room's depth, north to south.
const HALF_Z: f64 = 2.4;
/// Of the ceiling above the floor.
const HEIGHT: f64 = 2.7;
/// Of the walls and slabs.
const THICK: f64 = 0.25;

/// The whole scene.
pub fn model() -> Model {
    let mut model = Model::default();
    materials(&mut model);
    shell::build(&mut model);
    windows::build(&mut model);
    joinery::build(&mut model);
    lounge::build(&mut model);
    dining::build(&mut model);
    bookcase::build(&mut model);
    sideboard::build(&mut model);
    lamps::build(&mut model);
    plant::build(&mut model);
    outside::build(&mut model);
    model
}

/// Linear albedos; a textured material's factor tints its texture.
fn materials(model: &mut Model) {
    let mut texture = |t: crate::model::Texture| {
        model.textures.push(t);
        model.textures.len() - 1
    };
    let parquet = texture(textures::parquet());
    let wallpaper = texture(textures::wallpaper());
    let plaster = texture(crate::textures::plaster());
    let planks = texture(crate::textures::planks());
    let brick = texture(crate::textures::brick());
    let grass = texture(crate::textures::grass());
    let weave = texture(textures::weave());
    let rug = texture(textures::rug());
    let landscape = texture(textures::landscape());
    let blocks = texture(textures::blocks());
    let white = [1.0, 1.0, 1.0];
    let mut material = |name, albedo: [f64; 3], texture| {
        model.materials.push(Material { name, albedo, texture, cutoff: None, double_sided: false });
    };
    material("parquet", white, Some((parquet, textures::PARQUET)));
    material("wallpaper", white, Some((wallpaper, 0.8)));
    material("ceiling", [0.98, 1.0, 1.0], Some((plaster, 3.0)));
    material("oak", [0.62, 0.42, 0.24], Some((planks, 0.8)));
    material("walnut", [0.34, 0.21, 0.13], Some((planks, 0.8)));
    material("facade", white, Some((brick, 1.0)));
    material("lawn", white, Some((grass, 2.0)));
    // Cloth: one weave under different dyes.
    material("curtain", [0.86, 0.74, 0.52], Some((weave, 0.25)));
    material("sofa", [0.22, 0.36, 0.42], Some((weave, 0.2)));
    material("armchair", [0.72, 0.40, 0.12], Some((weave, 0.2)));
    material("pillow", [0.92, 0.86, 0.74], Some((weave, 0.15)));
    material("red_pillow", [0.66, 0.16, 0.12], Some((weave, 0.15)));
    material("seat", [0.52, 0.20, 0.14], Some((weave, 0.15)));
    material("shade", [0.92, 0.86, 0.74], Some((weave, 0.1)));
    material("rug", white, Some((rug, 1.2)));
    material("wicker", [0.70, 0.50, 0.28], Some((weave, 0.1)));
    material("landscape", white, Some((landscape, 1.0)));
    material("blocks", white, Some((blocks, 1.0)));
    material("white_paint", [0.80, 0.79, 0.76], None);
    material("enamel", [0.82, 0.82, 0.80], None);
    material("steel", [0.45, 0.45, 0.44], None);
    material("brass", [0.58, 0.42, 0.18], None);
    material("iron", [0.07, 0.07, 0.08], None);
    material("stone", [0.56, 0.54, 0.50], None);
    material("porcelain", [0.78, 0.79, 0.80], None);
    material("blue_glaze", [0.10, 0.20, 0.42], None);
    material("terracotta", [0.52, 0.22, 0.12], None);
    material("soil", [0.09, 0.06, 0.05], None);
    material("stem", [0.16, 0.22, 0.08], None);
    material("paper", [0.76, 0.73, 0.64], None);
    material("apple", [0.46, 0.12, 0.06], None);
    material("orange", [0.72, 0.34, 0.06], None);
    for (name, albedo) in bookcase::COVERS {
        material(name, albedo, None);
    }
    material("hedge", [0.06, 0.10, 0.05], None);
    // Thin things that are single sheets.
    for (name, albedo) in [("blind", [0.74, 0.72, 0.66]), ("leaf", [0.10, 0.24, 0.06])] {
        model.materials.push(Material { name, albedo, texture: None, cutoff: None, double_sided: true });
    }
}
