//! A small room of four bays that are alike but for what closes them: nothing, and glass of three kinds.

use crate::model::{Material, Model};
use crate::shapes::{ALL, block};
use serde_json::json;

/// Width, height and depth of a bay, in metres.
const BAY: [f64; 3] = [1.0, 1.0, 1.0];
/// Thickness of walls in metres.
const WALL: f64 = 0.1;
/// Metres by which a pane reaches into the walls around it.
const REBATE: f64 = 0.02;
/// Metres from a bay's middle to the front of its pane.
const FRONT: f64 = 0.45;
/// Thickness of the pane that is a closed body.
const BODY: f64 = 0.01;

/// Bays side by side along +X, the first around zero, open towards +Z; in each a plaster box. The second is
/// closed by a sheet of tinted glass (`KHR_materials_transmission`), the third by a sheet that blends (alpha
/// is coverage), the fourth by a closed body of glass, whose two faces dim one after the other. No glass
/// reflects, so each bay has what the open one has, times what its glass lets through.
pub(crate) fn glb() -> Vec<u8> {
    let mut model = Model::default();
    for (name, albedo) in
        [("plaster", [0.6; 3]), ("tinted", [0.8, 0.5, 0.2]), ("blended", [0.0; 3]), ("body", [0.8; 3])]
    {
        model.materials.push(Material { name, albedo, texture: None, cutoff: None, double_sided: false });
    }
    let [width, height, depth] = BAY;
    let (pitch, z) = (width + WALL, depth / 2.0);
    let (west, east) = (-width / 2.0, 3.0 * pitch + width / 2.0);
    for (name, from, to) in [
        ("floor", [west - WALL, -WALL, -z], [east + WALL, 0.0, z]),
        ("roof", [west - WALL, height, -z], [east + WALL, height + WALL, z]),
        ("back", [west - WALL, -WALL, -z - WALL], [east + WALL, height + WALL, -z]),
    ] {
        model.add(name, "plaster", block(from, to, ALL));
    }
    for wall in 0..5 {
        let x = west - WALL + f64::from(wall) * pitch;
        model.add(&format!("wall {wall}"), "plaster", block([x, 0.0, -z], [x + WALL, height, z], ALL));
    }
    for bay in 0..4 {
        let x = f64::from(bay) * pitch;
        let name = ["open", "tinted", "blended", "body"][bay as usize];
        let thing = block([x - 0.1, 0.0, -0.4], [x + 0.1, 0.3, -0.2], ALL).standing();
        model.add(&format!("thing {name}"), "plaster", thing);
        let [low, high] = [[x + west - REBATE, -REBATE], [x - west + REBATE, height + REBATE]];
        let back = if name == "body" { FRONT - BODY } else { FRONT };
        let faces = if name == "body" { ALL } else { crate::shapes::SOUTH };
        if name != "open" {
            let pane = block([low[0], low[1], back], [high[0], high[1], FRONT], faces);
            model.add(&format!("pane {name}"), name, pane);
        }
    }
    crate::glb::write_with(&model, |root| {
        for material in root["materials"].as_array_mut().into_iter().flatten() {
            if material["name"] == "blended" {
                material["alphaMode"] = json!("BLEND");
                material["pbrMetallicRoughness"]["baseColorFactor"][3] = json!(0.7);
            } else if material["name"] != "plaster" {
                material["extensions"] =
                    json!({ "KHR_materials_transmission": { "transmissionFactor": 1.0 } });
            }
        }
        root["extensionsUsed"] = json!(["KHR_materials_transmission"]);
    })
}
