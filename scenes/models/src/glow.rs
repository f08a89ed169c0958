//! What shines in files: an emissive texture, emission of some strength, and lamps of three kinds.

use crate::model::Material;
use crate::shapes::{ALL, SOUTH, block};
use crate::stress::ground;
use crate::textures::texture;
use serde_json::{Value, json};

/// A patch of ground of 8 m; a screen of 2 × 1 m that stands on it and is white towards −X and dark towards
/// +X; a sign whose emission has a strength; a point lamp and a spot; and a directional light, which shines
/// straight down.
pub(crate) fn glb() -> Vec<u8> {
    let mut model = ground();
    let half = |x: f64, _| (if x < 0.5 { [255.0; 3] } else { [20.0; 3] }, true);
    model.textures.push(texture("half", 64, half));
    for (name, texture) in [("screen", Some((0, SCREEN))), ("sign", None)] {
        model.materials.push(Material { name, albedo: [0.1; 3], texture, cutoff: None, double_sided: false });
    }
    // Texture coordinates are metres from zero along +X, over the screen's width.
    model.add("screen", "screen", block([0.0, 0.0, -1.0], [SCREEN, 1.0, -1.0], SOUTH));
    model.add("sign", "sign", block([-3.5, 0.5, -3.0], [-2.5, 1.0, -2.9], ALL));
    crate::glb::write_with(&model, |root| {
        for material in root["materials"].as_array_mut().into_iter().flatten() {
            match material["name"].as_str() {
                Some("screen") => {
                    material["emissiveFactor"] = json!([1, 1, 1]);
                    material["emissiveTexture"] = json!({ "index": 0 });
                }
                Some("sign") => {
                    material["emissiveFactor"] = json!([1, 0.5, 0.25]);
                    material["extensions"] =
                        json!({ "KHR_materials_emissive_strength": { "emissiveStrength": 5 } });
                }
                _ => {}
            }
        }
        root["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_emissive_strength"]);
        root["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
            { "type": "point", "intensity": 400 },
            { "type": "spot", "intensity": 900, "spot": { "innerConeAngle": 0.3, "outerConeAngle": 0.4 } },
            { "type": "directional", "intensity": 5000 },
        ] } });
        // Lamps shine along −Z: a quarter turn about X makes that down.
        let down = [-std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];
        for (light, (name, at)) in
            [("bulb", [-2.0, 2.0, 2.0]), ("spot", [2.5, 2.0, 2.5]), ("sun", [0.0, 5.0, 0.0])]
                .iter()
                .enumerate()
        {
            let extension = json!({ "KHR_lights_punctual": { "light": light } });
            let node = json!({ "name": name, "translation": at, "rotation": down, "extensions": extension });
            push(&mut root["nodes"], node);
        }
        let all = root["nodes"].as_array().map_or(0, Vec::len);
        root["scenes"][0]["nodes"] = json!((0..all).collect::<Vec<_>>());
    })
}

/// Width of the screen in metres.
const SCREEN: f64 = 2.0;

fn push(list: &mut Value, value: Value) {
    list.as_array_mut().expect("a list").push(value);
}
