//! Geometry of the scenes in this folder, authored in code: in metres, +Y up, south towards +Z. The same
//! source writes the same bytes everywhere.

#[cfg(test)]
mod checks;
mod city;
mod extremes;
mod farmland;
mod foliage;
mod glb;
mod mesh;
mod model;
mod random;
mod relief;
mod room;
mod shapes;
mod soft;
mod stress;
mod textures;
mod yard;

/// Names of the scenes whose GLB files stand in this folder.
pub const SCENES: [&str; 5] = ["city", "extremes", "farmland", "room", "yard"];
/// Names of the stress scenes, which tests generate where they need them.
pub const STRESS: [&str; 5] = ["slivers", "charts", "packed", "glass", "glow"];
/// Names of the scenes whose GLB files stand in `tests/fixtures`: a house, and a field around it.
pub const FIXTURES: [&str; 2] = ["house", "field"];

/// What a scene's generator makes.
#[derive(Clone, Debug)]
pub struct Generated {
    /// A binary glTF file.
    pub glb: Vec<u8>,
    /// What it holds, as a table.
    pub table: String,
}

/// Generates a scene of [`SCENES`], [`STRESS`] or [`FIXTURES`] by its name; `None` for another name.
pub fn generate(name: &str) -> Option<Generated> {
    let model = match name {
        "city" => city::model(),
        "extremes" => extremes::model(),
        "farmland" => farmland::model(),
        "room" => room::model(),
        "yard" => yard::model(),
        "house" => stress::house::house(),
        "field" => stress::house::field(),
        "slivers" => stress::slivers(),
        "charts" => stress::charts(),
        "packed" => {
            let table = "a patch of ground, and a block at four places\n".to_owned();
            return Some(Generated { glb: stress::packed::glb(), table });
        }
        "glass" => {
            let table = "four bays of a room: an open one, and one behind glass of each kind\n".to_owned();
            return Some(Generated { glb: stress::glass::glb(), table });
        }
        "glow" => {
            let table = "a patch of ground, a screen, a sign, and lamps of three kinds\n".to_owned();
            return Some(Generated { glb: stress::glow::glb(), table });
        }
        _ => return None,
    };
    Some(Generated { glb: glb::write(&model), table: model.table() })
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
    Some(Big { glb: one.glb, toml: stress::big::scene(&format!("{name}.glb"), copies, size) })
}
