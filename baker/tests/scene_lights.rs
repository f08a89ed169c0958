//! What shines in geometry files: lamps, glowing materials, and the groups they become.

use baker::geometry::{self, FileLampKind, Geometry};
use baker::scene::{self, Lamp, Scene};
use base64::Engine;
use glam::{DMat4, DVec3};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// A triangle, and whatever else nodes and materials are given.
fn asset(nodes: Value, lights: Value, materials: Value) -> Value {
    let bytes: Vec<u8> = [0f32, 0., 0., 1., 0., 0., 0., 0., -1.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let uri = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let mut all = vec![json!({ "mesh": 0, "name": "floor" })];
    all.extend(nodes.as_array().unwrap().iter().cloned());
    let is_child = |i: usize| {
        all.iter().any(|n| n["children"].as_array().is_some_and(|c| c.iter().any(|c| c.as_u64() == Some(i as u64))))
    };
    let roots: Vec<usize> = (0..all.len()).filter(|&i| !is_child(i)).collect();
    json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": lights } },
        "scenes": [{ "nodes": roots }],
        "nodes": all,
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1 } }],
        "materials": materials,
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, -1], "max": [1, 0, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": format!("data:application/octet-stream;base64,{uri}") }],
    })
}

fn light(index: usize) -> Value {
    json!({ "KHR_lights_punctual": { "light": index } })
}

#[test]
fn lamps_and_cameras_of_a_file_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    let nodes = json!([
        { "name": "post", "translation": [1, 2, 3], "scale": [2, 2, 2], "children": [2, 3] },
        // A quarter turn about X: −Z becomes −Y.
        { "name": " lantern\n", "translation": [0, 1, 0], "rotation": [-(0.5f64.sqrt()), 0, 0, 0.5f64.sqrt()], "extensions": light(1) },
        { "extensions": light(0) },
        { "name": "sun", "extensions": light(2) },
        { "name": "eye", "camera": 0, "translation": [0, 0, 5] },
    ]);
    let lights = json!([
        { "name": "bulb", "type": "point", "intensity": 40, "color": [1, 0.5, 0.25], "range": 3 },
        { "type": "spot", "intensity": 100, "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.4 } },
        { "type": "directional", "intensity": 90000 },
    ]);
    fs::write(&path, asset(nodes, lights, json!([{}])).to_string()).unwrap();
    let contents = geometry::contents(&path).unwrap();
    let [spot, bulb, sun] = &contents.lamps[..] else { panic!("{:?}", contents.lamps) };
    assert_eq!((spot.name.as_str(), &spot.parents[..]), ("lantern", &["post".to_owned()][..]));
    assert_eq!(spot.kind, FileLampKind::Spot { inner: f64::from(0.2f32), outer: f64::from(0.4f32) });
    assert!((spot.position(&DMat4::IDENTITY) - DVec3::new(1.0, 4.0, 3.0)).length() < 1e-6);
    assert!((spot.direction(&DMat4::IDENTITY).unwrap() - DVec3::NEG_Y).length() < 1e-6);
    // A node without a name has its light's.
    assert_eq!((bulb.name.as_str(), bulb.kind, bulb.intensity), ("bulb", FileLampKind::Point, 40.0));
    assert_eq!(bulb.colour, DVec3::new(1.0, 0.5, 0.25));
    assert_eq!((sun.name.as_str(), sun.kind, sun.intensity), ("sun", FileLampKind::Directional, 90000.0));
    let [eye] = &contents.cameras[..] else { panic!("{:?}", contents.cameras) };
    assert_eq!((eye.name.as_str(), eye.position, eye.direction), ("eye", DVec3::new(0.0, 0.0, 5.0), DVec3::NEG_Z));
    // Twice as wide as high: tan(fov / 2) = 2 tan(½).
    assert!((eye.fov - (2.0 * 0.5f64.tan()).atan().to_degrees() * 2.0).abs() < 1e-4);
}
