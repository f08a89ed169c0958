//! A small file in the forms that tools for the web write: meshopt-compressed views, GPU instances, vertex
//! colours.

use crate::shapes::{ALL, block};
use crate::stress::ground;
use serde_json::{Value, json};

/// Where the blocks stand, in metres.
const PLACES: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, -1.0], [-2.0, 0.0, 1.0], [1.0, 0.0, 2.5]];
/// How large they are.
const SCALES: [[f32; 3]; 4] = [[1.0, 1.0, 1.0], [0.5, 0.5, 0.5], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]];

/// A patch of ground and one block with coloured vertices, which stands at four places, all of it compressed.
pub(crate) fn glb() -> Vec<u8> {
    let mut model = ground();
    model.add("block", "pale", block([-0.5, 0.0, -0.5], [0.5, 1.0, 0.5], ALL));
    let (mut root, mut binary) = crate::glb::split(&crate::glb::write(&model));
    let count = {
        let position = &root["meshes"][1]["primitives"][0]["attributes"]["POSITION"];
        index(&root["accessors"][index(position)]["count"])
    };
    // Red at every other vertex.
    let colours: Vec<u8> =
        (0..count).flat_map(|v| if v % 2 == 0 { [255, 64, 64, 255] } else { [255; 4] }).collect();
    let colours = append(
        &mut root,
        &mut binary,
        &colours,
        4,
        json!({ "componentType": 5121, "count": count, "type": "VEC4", "normalized": true }),
    );
    root["meshes"][1]["primitives"][0]["attributes"]["COLOR_0"] = json!(colours);
    let mut vectors = |values: &[[f32; 3]]| {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        append(
            &mut root,
            &mut binary,
            &bytes,
            12,
            json!({ "componentType": 5126, "count": values.len(), "type": "VEC3" }),
        )
    };
    let attributes = json!({ "TRANSLATION": vectors(&PLACES), "SCALE": vectors(&SCALES) });
    root["nodes"][1]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    compress(&mut root, &mut binary);
    let names = json!(["EXT_mesh_gpu_instancing", "KHR_meshopt_compression"]);
    (root["extensionsUsed"], root["extensionsRequired"]) = (names.clone(), names);
    crate::glb::container(root.to_string().into_bytes(), binary)
}

fn index(value: &Value) -> usize {
    value.as_u64().expect("a number") as usize
}

/// Appends an accessor with a view of its own; gives its index.
fn append(root: &mut Value, binary: &mut Vec<u8>, bytes: &[u8], stride: usize, mut accessor: Value) -> usize {
    binary.resize(binary.len().next_multiple_of(4), 0);
    let view =
        json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len(), "byteStride": stride });
    binary.extend(bytes);
    let views = root["bufferViews"].as_array_mut().expect("views");
    views.push(view);
    accessor["bufferView"] = json!(views.len() - 1);
    let accessors = root["accessors"].as_array_mut().expect("accessors");
    accessors.push(accessor);
    accessors.len() - 1
}

/// Compresses every view. What they had been stands in a second buffer, which is not in the file.
fn compress(root: &mut Value, binary: &mut Vec<u8>) {
    let mut packed = Vec::new();
    for accessor in root["accessors"].as_array().expect("accessors").clone() {
        let (view, count) = (index(&accessor["bufferView"]), index(&accessor["count"]));
        let view = &mut root["bufferViews"][view];
        let (start, length) = (index(&view["byteOffset"]), index(&view["byteLength"]));
        let (bytes, stride) = (&binary[start..start + length], length / count);
        let word = |b: &[u8]| b.iter().rev().fold(0u32, |word, &byte| word << 8 | u32::from(byte));
        let (mode, encoded) = if accessor["type"] == "SCALAR" {
            let indices: Vec<u32> = bytes.chunks(stride).map(word).collect();
            ("TRIANGLES", meshopt::encode_index_buffer(&indices, count))
        } else {
            let words: Vec<u32> = bytes.chunks(4).map(word).collect();
            (
                "ATTRIBUTES",
                match stride {
                    4 => meshopt::encode_vertex_buffer(&words),
                    8 => meshopt::encode_vertex_buffer(words.as_chunks::<2>().0),
                    _ => meshopt::encode_vertex_buffer(words.as_chunks::<3>().0),
                },
            )
        };
        let encoded = encoded.expect("room for what is encoded");
        packed.resize(packed.len().next_multiple_of(4), 0);
        let extension = json!({ "buffer": 0, "byteOffset": packed.len(), "byteLength": encoded.len(), "byteStride": stride, "count": count, "mode": mode });
        packed.extend(encoded);
        view["buffer"] = json!(1);
        view["extensions"] = json!({ "KHR_meshopt_compression": extension });
    }
    let fallback = json!({ "KHR_meshopt_compression": { "fallback": true } });
    root["buffers"] =
        json!([{ "byteLength": packed.len() }, { "byteLength": binary.len(), "extensions": fallback }]);
    packed.resize(packed.len().next_multiple_of(4), 0);
    *binary = packed;
}
