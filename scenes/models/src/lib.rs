//! Models authored in code: in metres, +Y up, south towards +Z. The same source writes the same bytes
//! everywhere. The stress models are for tests, which generate them where they need them; the rest is also
//! what the generator of the scenes in this folder builds on.

#![warn(unreachable_pub)]

pub mod mesh;
pub mod model;
pub mod random;
pub mod relief;
pub mod shapes;
pub mod textures;
pub mod glb;
pub mod big;
mod stress;
mod packed;
mod glass;
mod glow;
#[cfg(test)]
mod tests;

/// Names of the stress models.
pub const STRESS: [&str; 5] = ["slivers", "charts", "packed", "glass", "glow"];

/// What a generator makes.
#[derive(Clone, Debug)]
pub struct Generated {
    /// A binary glTF file.
    pub glb: Vec<u8>,
    /// What it holds, as a table.
    pub table: String,
}

impl From<model::Model> for Generated {
    fn from(model: model::Model) -> Self {
        Self { glb: glb::write(&model), table: model.table() }
    }
}

/// Generates a model of [`STRESS`] by its name; `None` for another name.
pub fn generate(name: &str) -> Option<Generated> {
    let (glb, table) = match name {
        "slivers" => return Some(stress::slivers().into()),
        "charts" => return Some(stress::charts().into()),
        "packed" => (packed::glb(), "a patch of ground, and a block at four places\n"),
        "glass" => (glass::glb(), "four bays of a room: an open one, and one behind glass of each kind\n"),
        "glow" => (glow::glb(), "a patch of ground, a screen, a sign, and lamps of three kinds\n"),
        _ => return None,
    };
    Some(Generated { glb, table: table.to_owned() })
}
