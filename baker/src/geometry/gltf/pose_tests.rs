//! Meshes in their pose, and nodes that are hidden: against what the format says.

use crate::geometry::{self, Geometry};
use crate::scene;
use base64::Engine;
use glam::{DMat4, DVec3, Vec3, vec3};
use serde_json::{Value, json};

/// An asset under construction.
pub(super) struct Asset {
    pub root: Value,
    binary: Vec<u8>,
}

pub(super) fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

impl Asset {
    /// A triangle (0, 0, 0), (1, 0, 0), (0, 1, 0) with its normals as mesh 0, and these nodes, the first
    /// `roots` of which are roots.
    pub(super) fn new(nodes: Value, roots: usize) -> Self {
        let root = json!({
            "asset": { "version": "2.0" }, "scenes": [{ "nodes": (0..roots).collect::<Vec<_>>() }], "nodes": nodes,
            "meshes": [{ "primitives": [{ "attributes": {} }] }], "accessors": [], "bufferViews": [],
        });
        let mut asset = Asset { root, binary: Vec::new() };
        let corners = asset.add(5126, "VEC3", &floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]));
        asset.root["accessors"][corners]["min"] = json!([0, 0, 0]);
        asset.root["accessors"][corners]["max"] = json!([1, 1, 0]);
        asset.attribute("POSITION", corners);
        let normals = asset.add(5126, "VEC3", &floats(&[0., 0., 1., 0., 0., 1., 0., 0., 1.]));
        asset.attribute("NORMAL", normals);
        asset
    }

    pub(super) fn view(&mut self, bytes: &[u8]) -> usize {
        let at = self.binary.len();
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let views = self.root["bufferViews"].as_array_mut().unwrap();
        views.push(json!({ "buffer": 0, "byteOffset": at, "byteLength": bytes.len() }));
        views.len() - 1
    }

    /// An accessor of tightly packed elements.
    pub(super) fn add(&mut self, component: u32, kind: &str, bytes: &[u8]) -> usize {
        let size = match component {
            5126 => 4,
            5122 | 5123 => 2,
            _ => 1,
        };
        let count = bytes.len()
            / size
            / [("VEC3", 3), ("VEC4", 4), ("MAT4", 16)].iter().find(|k| k.0 == kind).unwrap().1;
        let view = self.view(bytes);
        let accessors = self.root["accessors"].as_array_mut().unwrap();
        accessors
            .push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
        accessors.len() - 1
    }

    pub(super) fn attribute(&mut self, name: &str, accessor: usize) {
        self.root["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    }

    /// A skin of these joints, with these inverse bind matrices if there are any.
    pub(super) fn skin(&mut self, joints: &[usize], mesh_in_joints: &[DMat4]) {
        let mut skin = json!({ "joints": joints });
        if !mesh_in_joints.is_empty() {
            let columns: Vec<f32> =
                mesh_in_joints.iter().flat_map(|m| m.to_cols_array().map(|x| x as f32)).collect();
            skin["inverseBindMatrices"] = json!(self.add(5126, "MAT4", &floats(&columns)));
        }
        match self.root["skins"].as_array_mut() {
            Some(skins) => skins.push(skin),
            None => self.root["skins"] = json!([skin]),
        }
    }

    pub(super) fn text(&self) -> String {
        let mut root = self.root.clone();
        let encoded = base64::engine::general_purpose::STANDARD.encode(&self.binary);
        let uri = format!("data:application/octet-stream;base64,{encoded}");
        root["buffers"] = json!([{ "byteLength": self.binary.len(), "uri": uri }]);
        root.to_string()
    }

    pub(super) fn load(&self) -> dataset::Result<(Geometry, Vec<String>)> {
        load(self.text().as_bytes(), "")
    }

    /// The corners in the world of all triangles.
    fn corners(&self) -> Vec<[Vec3; 3]> {
        let (g, _) = self.load().unwrap_or_else(|e| panic!("{e}"));
        (0..g.triangles.len()).map(|t| g.corners(t).map(|p| (p.as_dvec3() + g.origin).as_vec3())).collect()
    }

    fn error(&self) -> String {
        self.load().expect_err("an error").to_string()
    }
}

/// Loads a file under a scene file with these lines after its object.
fn load(file: &[u8], lines: &str) -> dataset::Result<(Geometry, Vec<String>)> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.gltf"), file).unwrap();
    std::fs::write(folder.path().join("scene.toml"), format!("[[object]]\nfile = \"a.gltf\"\n{lines}"))
        .unwrap();
    let (scene, _) = scene::load(&folder.path().join("scene.toml"))?;
    geometry::load(&scene)
}

/// Whether points agree to single precision.
fn expect(found: [Vec3; 3], expected: [Vec3; 3]) {
    let near = found.iter().zip(&expected).all(|(a, b)| a.distance(*b) < 1e-6 * (1.0 + b.length()));
    assert!(near, "{found:?}, expected {expected:?}");
}

const PLAIN: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

#[test]
fn what_is_hidden_is_not_there() {
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    let shown = json!({ "KHR_node_visibility": { "visible": true }, "KHR_lights_punctual": { "light": 0 } });
    let mut asset = Asset::new(
        json!([
            { "mesh": 0, "name": "floor", "extensions": { "KHR_node_visibility": {} } },
            { "mesh": 0, "name": "roof", "extensions": hidden, "children": [2, 3] },
            // Whatever it says itself.
            { "mesh": 0, "name": "chimney", "extensions": shown },
            { "camera": 0 },
        ]),
        2,
    );
    asset.root["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 1, "znear": 1 } }]);
    asset.root["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    for key in ["extensionsUsed", "extensionsRequired"] {
        asset.root[key] = json!(["KHR_lights_punctual", "KHR_node_visibility"]);
        let (g, warnings) = asset.load().unwrap();
        assert_eq!((g.instances.len(), g.instances[0].name.as_str()), (1, "a.gltf: floor"));
        assert_eq!(g.originals.cameras().count(), 1, "cameras are not hidden");
        assert!(
            !warnings.iter().any(|w| w.contains("lit all day") || w.contains("extension")),
            "{warnings:?}"
        );
    }
    // A part may name what is hidden now.
    let part = "[[object.part]]\nname = \"chimney\"\nalbedo = 0.3\n";
    assert!(load(asset.text().as_bytes(), part).is_ok());
    asset.root["nodes"][1]["extensions"]["KHR_node_visibility"]["visible"] = json!("no");
    assert!(asset.error().contains("roof: KHR_node_visibility: `visible` = \"no\": expected true or false"));
    asset.root["nodes"][1]["extensions"]["KHR_node_visibility"]["visible"] = json!(true);
    let (g, warnings) = asset.load().unwrap();
    assert!(
        g.instances.len() == 3 && warnings.iter().any(|w| w.contains("lit all day: 1 lamp")),
        "{warnings:?}"
    );
    for node in [0, 1] {
        asset.root["nodes"][node]["extensions"] = json!({ "KHR_node_visibility": { "visible": false } });
    }
    assert!(
        asset.error().contains("all of its meshes are hidden (KHR_node_visibility)"),
        "{}",
        asset.error()
    );
}

#[test]
fn animated_visibility_means_its_default() {
    let mut asset = Asset::new(
        json!([{ "mesh": 0 }, { "mesh": 0, "extensions": { "KHR_node_visibility": { "visible": false } } }]),
        2,
    );
    // Such a channel names no node.
    let target = json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": {
        "pointer": "/nodes/1/extensions/KHR_node_visibility/visible" } } });
    asset.root["animations"] = json!([{ "channels": [{ "sampler": 0, "target": target }], "samplers": [{ "input": 0, "output": 0 }] }]);
    asset.root["extensionsUsed"] = json!(["KHR_node_visibility", "KHR_animation_pointer"]);
    asset.root["extensionsRequired"] = asset.root["extensionsUsed"].clone();
    let (g, warnings) = asset.load().unwrap();
    assert_eq!(g.instances.len(), 1);
    assert!(warnings.iter().any(|w| w.contains("1 animation not played")), "{warnings:?}");
}

/// Weights and joints of the triangle's three corners.
fn bind(asset: &mut Asset, joints: [[u8; 4]; 3], weights: [[f32; 4]; 3], set: usize) {
    let accessor = asset.add(5121, "VEC4", joints.as_flattened());
    asset.attribute(&format!("JOINTS_{set}"), accessor);
    let accessor = asset.add(5126, "VEC4", &floats(weights.as_flattened()));
    asset.attribute(&format!("WEIGHTS_{set}"), accessor);
}

#[test]
fn joints_place_a_skinned_mesh_and_its_node_does_not() {
    // As a figure below a moved, turned and stretched node, whose bone stays at zero.
    let moved =
        json!({ "name": "body", "mesh": 0, "skin": 0, "translation": [0, 7, 0], "scale": [1, 5, -1] });
    let mut asset = Asset::new(json!([{ "name": "bone" }, moved]), 2);
    bind(&mut asset, [[0; 4]; 3], [[1., 0., 0., 0.]; 3], 0);
    asset.skin(&[0], &[DMat4::IDENTITY]);
    expect(asset.corners()[0], PLAIN);
    let (g, warnings) = asset.load().unwrap();
    assert!(!warnings.iter().any(|w| w.contains("skin")), "{warnings:?}");
    assert_eq!((g.normals[0], g.instances[0].name.as_str()), (Vec3::Z, "a.gltf: body"));
    // The joint's place in the file, its parents included, times the inverse bind matrix.
    asset.root["nodes"] = json!([
        { "name": "root", "translation": [10, 0, 0], "children": [1] },
        { "name": "bone", "translation": [0, 2, 0], "rotation": [0, 0, 0.5f64.sqrt(), 0.5f64.sqrt()] },
        { "name": "body", "mesh": 0, "skin": 0, "translation": [0, 7, 0] },
    ]);
    asset.root["scenes"][0]["nodes"] = json!([0, 2]);
    asset.root.as_object_mut().unwrap().remove("skins");
    asset.skin(&[1], &[DMat4::from_translation(DVec3::new(1.0, 0.0, 0.0))]);
    // (x, y) + (1, 0), turned by a quarter to (−y, x + 1), moved by (10, 2).
    expect(asset.corners()[0], [vec3(10., 3., 0.), vec3(10., 4., 0.), vec3(9., 3., 0.)]);
}

#[test]
fn joints_far_away_cost_no_precision() {
    let mut asset = Asset::new(json!([{ "mesh": 0, "skin": 0 }, { "translation": [1e6, 0, 0] }]), 2);
    bind(&mut asset, [[0; 4]; 3], [[1., 0., 0., 0.]; 3], 0);
    asset.skin(&[1], &[]);
    let (g, _) = asset.load().unwrap();
    let [a, b, c] = g.corners(0);
    expect([a - a, b - a, c - a], PLAIN);
    assert!(((a.as_dvec3() + g.origin).x - 1e6).abs() < 1e-6, "{}", g.origin);
}

#[test]
fn weights_mix_joints_whatever_their_type_and_sum() {
    // Three joints at heights 0, 4 and 100; the third by a second set.
    let nodes =
        json!([{ "mesh": 0, "skin": 0 }, {}, { "translation": [0, 0, 4] }, { "translation": [0, 0, 100] }]);
    let mut asset = Asset::new(nodes, 4);
    asset.skin(&[1, 2, 3], &[]);
    let joints: Vec<u8> = [[0u16, 1, 0, 0]; 3].as_flattened().iter().flat_map(|j| j.to_le_bytes()).collect();
    let accessor = asset.add(5123, "VEC4", &joints);
    asset.attribute("JOINTS_0", accessor);
    // 1:1, 1:3 short of 1 by quantisation, and none of the first set's.
    let accessor = asset.add(5121, "VEC4", [[127, 127, 0, 0], [60, 180, 0, 0], [0u8; 4]].as_flattened());
    asset.root["accessors"][accessor]["normalized"] = json!(true);
    asset.attribute("WEIGHTS_0", accessor);
    bind_second(&mut asset);
    expect(asset.corners()[0], [vec3(0., 0., 2.), vec3(1., 0., 3.), vec3(0., 1., 100.)]);
}

fn bind_second(asset: &mut Asset) {
    bind(asset, [[2; 4]; 3], [[0.; 4], [0.; 4], [0.25, 0.25, 0.25, 0.25]], 1);
}

#[test]
fn a_mesh_has_a_pose_for_each_skin_and_for_none() {
    let at = |x: f64| json!({ "translation": [x, 0, 0] });
    let nodes = json!([{ "mesh": 0, "skin": 0 }, { "mesh": 0, "skin": 1 }, { "mesh": 0, "translation": [0, 3, 0] }, at(1e6), at(5.0)]);
    let mut asset = Asset::new(nodes, 5);
    bind(&mut asset, [[0; 4]; 3], [[1., 0., 0., 0.]; 3], 0);
    asset.skin(&[3], &[]);
    // A mirror, which keeps the front in front.
    asset.skin(&[4], &[DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0))]);
    let corners = asset.corners();
    expect(corners[0], PLAIN.map(|p| p + 1e6 * Vec3::X));
    expect(corners[1], [vec3(5., 0., 0.), vec3(5., 1., 0.), vec3(4., 0., 0.)]);
    expect(corners[2], PLAIN.map(|p| p + 3.0 * Vec3::Y));
    let (g, _) = asset.load().unwrap();
    assert!(
        (0..3).all(|t| g.normal(t) == Vec3::Z) && g.normals.iter().all(|n| *n == Vec3::Z),
        "{:?}",
        g.normals
    );
    for (pointer, value, expected) in [
        ("/skins/0/joints", json!([]), "vertex 0 names joint 0 of JOINTS_0: expected an index below 0"),
        ("/skins/1/joints", json!([4, 3]), "1 inverse bind matrices: expected one for each of 2 joints"),
        ("/nodes/3/children", json!([3]), "joint 0: node 3 is below itself"),
        ("/nodes/3/translation", json!([1e300, 0, 0]), ""),
    ] {
        let mut broken = Asset { root: asset.root.clone(), binary: asset.binary.clone() };
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        broken.root.pointer_mut(parent).unwrap()[key] = value;
        assert!(broken.error().contains(expected), "{pointer}: {}", broken.error());
    }
    // Without joints of its own it stands at its node.
    asset.root["nodes"][0]["translation"] = json!([0, 9, 0]);
    asset.root["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("JOINTS_0");
    expect(asset.corners()[0], PLAIN.map(|p| p + 9.0 * Vec3::Y));
    let (_, warnings) = asset.load().unwrap();
    assert!(
        warnings.iter().any(|w| w.contains("its skin is not applied: expected JOINTS_0")),
        "{warnings:?}"
    );
}

#[test]
fn morph_targets_have_their_default_weights() {
    let nodes =
        json!([{ "mesh": 0 }, { "mesh": 0, "weights": [0, 0, 1] }, { "mesh": 0, "weights": [0, 0, 0] }]);
    let mut asset = Asset::new(nodes, 3);
    // One of floats, one of normalised bytes, one that is sparse and turns a normal.
    let first = asset.add(5126, "VEC3", &floats(&[0., 0., 2., 0., 0., 0., 0., 0., -4.]));
    let second = asset.add(5120, "VEC3", &[0, 127, 0, 0, 0, 0, 0, 0, 0x81]);
    asset.root["accessors"][second]["normalized"] = json!(true);
    asset.root["accessors"][second]["count"] = json!(3);
    let (at, to) = (asset.view(&[1]), asset.view(&floats(&[3., 0., 0.])));
    let sparse = json!({ "count": 1, "indices": { "bufferView": at, "componentType": 5121 }, "values": { "bufferView": to } });
    let accessors = asset.root["accessors"].as_array_mut().unwrap();
    accessors.push(json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse }));
    let third = accessors.len() - 1;
    let turn = asset.add(5126, "VEC3", &floats(&[0., 1., -1., 0., 0., 0., 0., 0., 0.]));
    let targets =
        json!([{ "POSITION": first }, { "POSITION": second }, { "POSITION": third, "NORMAL": turn }]);
    asset.root["meshes"][0]["primitives"][0]["targets"] = targets;
    asset.root["meshes"][0]["weights"] = json!([0.5, 2, 0]);
    let corners = asset.corners();
    expect(corners[0], [vec3(0., 2., 1.), vec3(1., 0., 0.), vec3(0., 1., -4.)]);
    expect(corners[1], [Vec3::ZERO, vec3(4., 0., 0.), Vec3::Y]);
    expect(corners[2], PLAIN);
    let (g, warnings) = asset.load().unwrap();
    assert!(!warnings.iter().any(|w| w.contains("morph")), "{warnings:?}");
    assert!(g.normals[6..].iter().all(|n| *n == Vec3::Z));
    assert!(g.normals[3].distance(Vec3::Y) < 1e-6 && g.normals[4] == Vec3::Z, "{:?}", g.normals);
    // The skin comes after.
    bind(&mut asset, [[0; 4]; 3], [[1., 0., 0., 0.]; 3], 0);
    asset.skin(&[0], &[DMat4::from_scale(DVec3::splat(2.0))]);
    asset.root["nodes"][1]["skin"] = json!(0);
    expect(asset.corners()[1], [Vec3::ZERO, vec3(8., 0., 0.), 2.0 * Vec3::Y]);
    // Of another length than the mesh.
    asset.root["accessors"][first]["count"] = json!(2);
    assert!(asset.error().contains("a morph target of 2 elements for 3 vertices"), "{}", asset.error());
}

#[test]
fn a_byte_order_mark_and_newer_versions_that_2_0_reads_are_no_hindrance() {
    let mut asset = Asset::new(json!([{ "mesh": 0 }]), 1);
    let with_mark = [b"\xef\xbb\xbf", asset.text().as_bytes()].concat();
    assert_eq!(load(&with_mark, "").unwrap().0.triangles.len(), 1);
    for (version, least, expected) in [
        ("2.0", Some("2.0"), Ok(())),
        ("2.7", None, Ok(())),
        ("2.7", Some("2.0"), Ok(())),
        ("2.7", Some("2.1"), Err("asset.minVersion = \"2.1\": expected glTF 2.0")),
        ("3.0", None, Err("asset.version = \"3.0\": expected glTF 2.0")),
        ("1.0", None, Err("asset.version = \"1.0\": expected glTF 2.0")),
        ("two", None, Err("asset.version = \"two\": expected text such as \"2.0\"")),
    ] {
        asset.root["asset"] = json!({ "version": version });
        if let Some(least) = least {
            asset.root["asset"]["minVersion"] = json!(least);
        }
        match expected {
            Ok(()) => drop(asset.load().unwrap()),
            Err(expected) => assert!(asset.error().contains(expected), "{}", asset.error()),
        }
    }
}
