//! A farm on an autumn day, 128 × 128 m of rolling land: a yard with barn, silo, farmhouse and cart shed,
//! ploughed and stubble fields, crop rows, pasture and meadow; hedges, fences, trees. The sun and the sky
//! alone light it.
//!
//! Mesh names say what a lightmap should make of them: `*_detail` is too thin for texels, `*_occluder` only
//! blocks and reflects light, `leaves_*`, `crops_*` and `tufts_*` are cut-out cards; everything else is meant
//! to be lit. Parts that meet are sunk into each other, so that no two faces coincide, and large faces that
//! nobody can see are left out.

mod bales;
mod barn;
mod cutouts;
mod fences;
mod fields;
mod foliage;
mod house;
mod materials;
mod sheds;
mod terrain;
#[cfg(test)]
mod tests;
mod textures;
mod things;
mod timber;
mod tractor;
mod trees;

use crate::model::Model;

/// The whole scene.
pub fn model() -> Model {
    let mut model = Model::default();
    materials::add(&mut model);
    terrain::build(&mut model);
    fields::build(&mut model);
    barn::build(&mut model);
    house::build(&mut model);
    sheds::build(&mut model);
    fences::build(&mut model);
    foliage::build(&mut model);
    trees::build(&mut model);
    bales::build(&mut model);
    tractor::build(&mut model);
    things::build(&mut model);
    model
}
