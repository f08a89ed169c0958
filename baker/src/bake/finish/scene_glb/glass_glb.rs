//! Glass as glTF tells of it, for viewers of the geometry file.

use crate::geometry::Glass;
use serde_json::{Value, json};

/// The extension that holds what passes.
const EXTENSION: &str = "KHR_materials_transmission";

/// Takes from a material what it said that it lets through.
pub(super) fn clear(material: &mut Value) {
    if material["alphaMode"] == "BLEND" {
        material.as_object_mut().map(|material| material.remove("alphaMode"));
    }
    if let Some(extensions) = material.get_mut("extensions").and_then(Value::as_object_mut) {
        extensions.remove(EXTENSION);
        // It says how thick glass is that is no longer told of.
        extensions.remove("KHR_materials_volume");
        if extensions.is_empty() {
            material.as_object_mut().map(|material| material.remove("extensions"));
        }
    }
}

/// Adds to a material of `scene.glb` what it lets through; `texture` is where the file has that of the glass.
///
/// What passes is exact. Of glass that is not tinted by its base colour, what is reflected is not: glTF has
/// one colour for both.
pub(super) fn add(material: &mut Value, glass: &Glass, texture: Option<usize>) {
    if glass.is_blended {
        material["alphaMode"] = json!("BLEND");
    }
    let factor = glass.transmission.max_element();
    if factor <= 0.0 {
        return;
    }
    let colour = glass.tint.unwrap_or(glass.transmission / factor);
    let pbr = &mut material["pbrMetallicRoughness"];
    for (channel, value) in colour.to_array().into_iter().enumerate() {
        pbr["baseColorFactor"][channel] = json!(value);
    }
    if let Some(pbr) = pbr.as_object_mut().filter(|_| glass.tint.is_none() && !glass.is_blended) {
        pbr.remove("baseColorTexture");
    }
    let mut transmission = json!({ "transmissionFactor": factor });
    if let Some(texture) = texture {
        transmission["transmissionTexture"] = json!({ "index": texture });
    }
    if !material["extensions"].is_object() {
        material["extensions"] = json!({});
    }
    material["extensions"][EXTENSION] = transmission;
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn what_passes_is_factor_times_base_colour() {
        let plain = || json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1.0] } });
        let passes = |glass: &Glass| {
            let mut material = plain();
            add(&mut material, glass, None);
            let factor = material["extensions"][EXTENSION]["transmissionFactor"].as_f64().unwrap();
            let colour = &material["pbrMetallicRoughness"]["baseColorFactor"];
            [0, 1, 2].map(|c| (colour[c].as_f64().unwrap() * factor) as f32)
        };
        let near = |found: [f32; 3], expected: Vec3| {
            assert!(Vec3::from(found).abs_diff_eq(expected, 1e-6), "{found:?}")
        };
        near(passes(&Glass::clear(Vec3::new(0.8, 0.4, 0.2))), Vec3::new(0.8, 0.4, 0.2));
        let tint = Some(Vec3::new(1.0, 0.5, 0.25));
        near(passes(&Glass { tint, ..Glass::clear(Vec3::splat(0.8)) }), Vec3::new(0.8, 0.4, 0.2));
        let mut blended = plain();
        add(&mut blended, &Glass { is_blended: true, ..Glass::clear(Vec3::ZERO) }, None);
        assert!(blended["alphaMode"] == "BLEND" && blended["extensions"].is_null());
        clear(&mut blended);
        assert_eq!(blended, plain());
    }
}
