use super::*;
use crate::format::FORMAT;
use serde_json::{Value, json};

/// A manifest with one page.
fn config() -> Config {
    let file = json!({ "path": "data/mask-0123456789ab.png", "bytes": 1, "blake3": "0".repeat(64) });
    serde_json::from_value(json!({
        "format": FORMAT, "version": 2, "scene": "a", "generator": "", "unit": "", "seed": 0, "inputs": "", "samples": 1,
        "pages": [{ "kind": "atlas", "width": 8, "height": 8, "mask": file }], "sun": null, "sky": null, "groups": [],
        "layers": [], "frames": [], "noise": null, "geometry": null,
        "instances": [], "settings": {},
    }))
    .unwrap()
}

/// A triangle with lightmap coordinates: JSON and binary part.
fn triangle() -> (Value, Vec<u8>) {
    let positions = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0];
    let uvs = [0f32, 0.0, 1.0, 0.0, 0.0, 1.0];
    let mut binary: Vec<u8> = positions.iter().chain(&uvs).flat_map(|value| value.to_le_bytes()).collect();
    [0u32, 1, 2].iter().for_each(|index| binary.extend(index.to_le_bytes()));
    let accessor = |view: usize, component: u32, kind: &str| json!({ "bufferView": view, "componentType": component, "count": 3, "type": kind });
    let mut position = accessor(0, 5126, "VEC3");
    (position["min"], position["max"]) = (json!([0, 0, -1]), json!([1, 0, 0]));
    let root = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "floor", "mesh": 0, "extras": {
            "lightmapScale": [0.5, 0.5], "lightmapOffset": [0.25, 0.5], "lightmapPage": 0 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_1": 1 }, "indices": 2 }] }],
        "accessors": [position, accessor(1, 5126, "VEC2"), accessor(2, 5125, "SCALAR")],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 60, "byteLength": 12 },
        ],
        "buffers": [{ "byteLength": binary.len() }],
    });
    (root, binary)
}

fn glb((root, binary): (Value, Vec<u8>)) -> Vec<u8> {
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = Vec::new();
    bytes.extend(b"glTF");
    let word = |n: usize| (n as u32).to_le_bytes();
    bytes.extend([word(2), word(12 + 8 + json.len() + 8 + binary.len()), word(json.len())].concat());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend(word(binary.len()));
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

fn reported(bytes: &[u8]) -> String {
    let faults = faults(Path::new("data/scene.glb"), bytes, &config());
    faults.iter().map(|fault| format!("{fault}\n")).collect()
}

#[test]
fn a_whole_file_has_no_fault() {
    assert_eq!(reported(&glb(triangle())), "");
}

#[test]
fn so_has_one_with_a_hierarchy_two_primitives_and_required_extensions() {
    let (mut root, binary) = triangle();
    let primitive = root["meshes"][0]["primitives"][0].clone();
    root["meshes"][0]["primitives"] = json!([primitive, primitive]);
    root["nodes"] =
        json!([{ "name": "root", "children": [1] }, { "name": "group", "children": [2] }, root["nodes"][0]]);
    root["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    root["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    root["textures"] = json!([{ "extensions": { "KHR_texture_basisu": { "source": 0 } } }]);
    root["images"] = json!([{ "bufferView": 0, "mimeType": "image/ktx2" }]);
    assert_eq!(reported(&glb((root.clone(), binary.clone()))), "");
    root["nodes"][2]["extras"]["lightmapPage"] = json!(3);
    assert!(reported(&glb((root, binary))).contains("node 2, \"floor\": lightmapPage is 3"));
}

/// What is done to a file's JSON and its binary part.
type Spoil = fn(&mut Value, &mut Vec<u8>);

#[test]
fn what_is_wrong_is_named() {
    let cases: [(Spoil, &str); 17] = [
        (|r, _| r["accessors"] = json!([]), "mesh 0: POSITION names accessor 0; expected one of 0"),
        (|_, b| b[60..64].copy_from_slice(&3u32.to_le_bytes()), "index 0 is 3; expected one of 3"),
        (|_, b| b[36..40].copy_from_slice(&f32::NAN.to_le_bytes()), "TEXCOORD_1 of vertex 0 is NaN"),
        (|_, b| b[44..48].copy_from_slice(&2f32.to_le_bytes()), "coordinate u is 1.25 on its page"),
        (|_, b| b[0..4].copy_from_slice(&f32::INFINITY.to_le_bytes()), "POSITION of vertex 0 is inf"),
        (|r, _| r["nodes"][0]["extras"]["lightmapPage"] = json!(1), "lightmapPage is 1; expected one of 1"),
        (|r, _| r["nodes"][0]["extras"]["lightmapPage"] = json!("x"), "extras: "),
        (|r, _| r["nodes"][0]["extras"]["lightmapOffset"] = json!([0.6, 0]), "u is 1.1 on its page"),
        (
            |r, _| {
                drop(
                    r["meshes"][0]["primitives"][0]["attributes"]
                        .as_object_mut()
                        .unwrap()
                        .remove("TEXCOORD_1"),
                )
            },
            "no TEXCOORD_1",
        ),
        (|r, _| r["accessors"][2]["count"] = json!(4), "accessor 2: ends outside its buffer view"),
        (|r, _| r["accessors"][1]["count"] = json!(2), "TEXCOORD_1 of 2 vertex"),
        (|r, _| r["accessors"][2]["componentType"] = json!(5126), "indices are F32"),
        (|r, _| r["bufferViews"][2]["byteLength"] = json!(13), "buffer view 2: ends outside its buffer"),
        (
            |r, _| r["buffers"][0]["byteLength"] = json!(1000),
            "expected one buffer, inside the file's binary part",
        ),
        (|r, _| r["meshes"][0]["primitives"][0]["indices"] = json!(9), "its JSON is not glTF"),
        (|r, _| r["nodes"] = json!("floor"), "its JSON is not glTF"),
        (|r, _| r["nodes"][0]["mesh"] = json!(5), "its JSON is not glTF"),
    ];
    for (spoil, expected) in cases {
        let (mut root, mut binary) = triangle();
        spoil(&mut root, &mut binary);
        let reported = reported(&glb((root, binary)));
        assert!(
            reported.contains(expected) && reported.contains("data/scene.glb: "),
            "{expected}: {reported}"
        );
    }
}

#[test]
fn a_torn_file_is_named_wherever_it_ends_and_any_byte_may_be_wrong() {
    let whole = glb(triangle());
    for end in 0..whole.len() {
        assert_ne!(reported(&whole[..end]), "", "cut at {end}");
    }
    // No panic, whatever is changed; in the header and the JSON's start it is a fault.
    for i in 0..whole.len() {
        for flip in [1, 0x20, 0xff] {
            let mut bytes = whole.clone();
            bytes[i] ^= flip;
            let reported = reported(&bytes);
            assert!(i >= 21 || !reported.is_empty(), "byte {i} ^ {flip}");
        }
    }
}
