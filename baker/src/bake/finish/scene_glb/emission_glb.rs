//! Emission as glTF tells of it, for viewers of the geometry file.

use glam::{DVec3, Vec3};
use serde_json::{Map, Value, json};

/// The extension that holds what is brighter than 1.
const STRENGTH: &str = "KHR_materials_emissive_strength";

/// Takes from a material what it said that it emits.
pub(super) fn clear(material: &mut Value) {
    let Some(material) = material.as_object_mut() else { return };
    material.remove("emissiveFactor");
    material.remove("emissiveTexture");
    if let Some(extensions) = material.get_mut("extensions").and_then(Value::as_object_mut) {
        extensions.remove(STRENGTH);
        if extensions.is_empty() {
            material.remove("extensions");
        }
    }
}

/// Adds to a material what it emits: `radiance` in kcd/m², told in the unit that the scene gives to the
/// emission of files; `texture` is where the file has the map that multiplies it.
pub(super) fn add(material: &mut Value, radiance: Vec3, unit: f64, texture: Option<usize>) {
    let value = radiance.as_dvec3() / if unit > 0.0 { unit } else { 1.0 };
    let strength = value.max_element().max(1.0);
    if value == DVec3::ZERO || !strength.is_finite() {
        return;
    }
    material["emissiveFactor"] = json!((value / strength).to_array());
    if let Some(texture) = texture {
        material["emissiveTexture"] = json!({ "index": texture });
    }
    if strength > 1.0 {
        if !material["extensions"].is_object() {
            material["extensions"] = Value::Object(Map::new());
        }
        material["extensions"][STRENGTH] = json!({ "emissiveStrength": strength });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factor_times_strength_is_the_radiance_in_the_unit_of_files() {
        let emits = |radiance: [f32; 3], unit: f64| {
            let mut material = json!({});
            add(&mut material, Vec3::from(radiance), unit, None);
            let strength = material["extensions"][STRENGTH]["emissiveStrength"].as_f64();
            let factor = |c: usize| material["emissiveFactor"][c].as_f64().unwrap_or(0.0);
            assert!((0..3).all(|c| (0.0..=1.0).contains(&factor(c))) && strength.is_none_or(|s| s > 1.0));
            ([0, 1, 2].map(|c| factor(c) * strength.unwrap_or(1.0)), strength.is_some())
        };
        // (In powers of two, which divide exactly.)
        assert_eq!(emits([0.5, 0.25, 0.0], 1.0), ([0.5, 0.25, 0.0], false));
        assert_eq!(emits([8.0, 4.0, 2.0], 1.0), ([8.0, 4.0, 2.0], true));
        assert_eq!(emits([8.0, 4.0, 2.0], 16.0), ([0.5, 0.25, 0.125], false));
        assert_eq!(emits([8.0, 4.0, 2.0], 0.0), ([8.0, 4.0, 2.0], true));
        assert_eq!(emits([0.0; 3], 1.0), ([0.0; 3], false));
    }

    #[test]
    fn nothing_remains_of_what_is_cleared() {
        let mut material = json!({
            "name": "lamp", "emissiveFactor": [1, 1, 1], "emissiveTexture": { "index": 0 },
            "extensions": { STRENGTH: { "emissiveStrength": 5 } },
        });
        clear(&mut material);
        assert_eq!(material, json!({ "name": "lamp" }));
    }
}
