//! Geometry of the scenes in the folder above, and of two fixtures of the tests.

#[cfg(test)]
mod checks;
mod city;
mod extremes;
mod farmland;
mod foliage;
mod house;
mod relief;
mod room;
mod shapes;
mod soft;
mod textures;
mod yard;

#[cfg(test)]
use models::glb;
pub use models::{Generated, STRESS};
use models::{big, mesh, model, random};

/// Names of the scenes whose GLB files stand in the folder above.
pub const SCENES: [&str; 5] = ["city", "extremes", "farmland", "room", "yard"];
/// Names of the scenes whose GLB files stand in `tests/fixtures`: a house, and a field around it.
pub const FIXTURES: [&str; 2] = ["house", "field"];

/// Generates a scene of [`SCENES`], [`STRESS`] or [`FIXTURES`] by its name; `None` for another name.
pub fn generate(name: &str) -> Option<Generated> {
    let model = match name {
        "city" => city::model(),
        "extremes" => extremes::model(),
        "farmland" => farmland::model(),
        "room" => room::model(),
        "yard" => yard::model(),
        "house" => house::house(),
        "field" => house::field(),
        _ => return models::generate(name),
    };
    Some(model.into())
}

/// Many copies of a scene: what its geometry file and its scene file hold.
#[derive(Clone, Debug)]
pub struct Big {
    /// A binary glTF file, one copy of the scene.
    pub glb: Vec<u8>,
    /// The scene file that places the copies.
    pub toml: String,
}

/// Copies a scene of [`SCENES`] many times over, for tests of size; `None` for another name. The scene file
/// reads the geometry from `NAME.glb` beside it.
pub fn big(name: &str, copies: usize, size: u32) -> Option<Big> {
    let one = generate(name).filter(|_| SCENES.contains(&name))?;
    Some(Big { glb: one.glb, toml: big::scene(&format!("{name}.glb"), copies, size) })
}
