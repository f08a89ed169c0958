//! A house as people make it, of boxes, and a field around it: dark inside, bright outside, on one page.

use crate::model::{Material, Model};
use crate::shapes::{ALL, EAST, NORTH, SOUTH, WEST, block};

/// Half the room's width, its height and half its depth, in metres.
const ROOM: [f64; 3] = [2.5, 2.6, 2.0];
/// Thickness of walls, floor and roof in metres.
const WALL: f64 = 0.3;
/// The window in the south wall: from west to east and from sill to lintel, in metres.
const WINDOW: [[f64; 2]; 2] = [[-0.2, 1.0], [0.9, 1.9]];
/// Side of the field in metres.
const FIELD: f64 = 60.0;

fn model() -> Model {
    let mut model = Model::default();
    for (name, albedo, double_sided) in [
        ("plaster", [0.72, 0.70, 0.66], false),
        ("wood", [0.35, 0.22, 0.12], false),
        ("shade", [0.8, 0.75, 0.6], true),
        ("grass", [0.16, 0.2, 0.07], false),
    ] {
        model.materials.push(Material { name, albedo, texture: None, cutoff: None, double_sided });
    }
    model
}

/// The house: one mesh of walls, floor and roof around a room with a window to the south; three boxes as
/// furniture; and the shade of a lamp, open above and below, around (−1.4, 1.4, −1.2).
pub fn house() -> Model {
    let mut model = model();
    let [x, y, z] = ROOM;
    let [[west, east], [sill, lintel]] = WINDOW;
    let (ox, oz) = (x + WALL, z + WALL);
    let mut walls = block([-ox, -WALL, -oz], [ox, 0.0, oz], ALL);
    for (from, to) in [
        ([-ox, y, -oz], [ox, y + WALL, oz]),
        ([-ox, 0.0, -oz], [ox, y, -z]),
        ([-ox, 0.0, -z], [-x, y, z]),
        ([x, 0.0, -z], [ox, y, z]),
        // Around the window.
        ([-ox, 0.0, z], [west, y, oz]),
        ([east, 0.0, z], [ox, y, oz]),
        ([west, 0.0, z], [east, sill, oz]),
        ([west, lintel, z], [east, y, oz]),
    ] {
        walls.append(block(from, to, ALL));
    }
    model.add("walls", "plaster", walls);
    for (name, from, to) in [
        ("table", [0.6, 0.0, -0.6], [1.8, 0.75, 0.2]),
        ("cupboard", [-2.5, 0.0, 0.4], [-2.0, 1.8, 1.6]),
        ("bed", [-0.6, 0.0, -2.0], [1.4, 0.45, -1.0]),
    ] {
        model.add(name, "wood", block(from, to, ALL).standing());
    }
    model.add(
        "shade",
        "shade",
        block([-1.55, 1.25, -1.35], [-1.25, 1.55, -1.05], EAST | WEST | SOUTH | NORTH),
    );
    model
}

/// The field: a square of ground whose top is a hand below the house's floor.
pub fn field() -> Model {
    let mut model = model();
    let half = FIELD / 2.0;
    model.add("field", "grass", block([-half, -1.0, -half], [half, -0.1, half], crate::shapes::TOP));
    model
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks;

    #[test]
    fn both_are_valid_gltf_and_the_same_each_time() {
        for build in [house, field] {
            let model = build();
            checks::valid_gltf(&model);
            assert!(crate::glb::write(&model) == crate::glb::write(&build()));
        }
    }

    #[test]
    fn the_fixtures_files_are_what_is_generated() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures");
        for name in crate::FIXTURES {
            let kept = std::fs::read(folder.join(format!("{name}.glb"))).unwrap();
            assert!(
                crate::generate(name).unwrap().glb == kept,
                "{name}: cargo run --release --manifest-path scenes/generate/Cargo.toml -- {name} \
                 tests/fixtures/{name}.glb"
            );
        }
    }
}
