//! Binary glTF 2.0: one buffer holding vertex attributes, indices and PNG images.

use crate::mesh::Mesh;
use crate::model::{Model, Texture};
use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use serde_json::{Value, json};

// Constants of the glTF 2.0 specification.
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The binary chunk and its views and accessors.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Appends bytes on a 4-byte boundary; returns the view's index.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let mut view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    /// Appends `f32` vectors; returns the accessor's index.
    fn floats<const N: usize>(&mut self, values: &[[f32; N]], bounds: bool) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let mut accessor = json!({
            "bufferView": view, "componentType": FLOAT, "count": values.len(), "type": format!("VEC{N}"),
        });
        if bounds {
            let fold = |f: fn(f32, f32) -> f32| -> Vec<f32> {
                (0..N).map(|k| values.iter().map(|v| v[k]).reduce(f).unwrap_or(0.0)).collect()
            };
            accessor["min"] = json!(fold(f32::min));
            accessor["max"] = json!(fold(f32::max));
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Appends triangle indices, 16-bit where they fit (65535 is reserved); returns the accessor's index.
    fn indices(&mut self, mesh: &Mesh) -> usize {
        let short = mesh.positions.len() < 65535;
        let flat = mesh.triangles.iter().flatten();
        let bytes: Vec<u8> = if short {
            flat.flat_map(|&i| (i as u16).to_le_bytes()).collect()
        } else {
            flat.flat_map(|&i| i.to_le_bytes()).collect()
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        self.accessors.push(json!({
            "bufferView": view, "componentType": if short { UNSIGNED_SHORT } else { UNSIGNED_INT },
            "count": mesh.triangles.len() * 3, "type": "SCALAR",
        }));
        self.accessors.len() - 1
    }
}

/// The file's bytes.
pub fn write(model: &Model) -> Vec<u8> {
    let mut buffer = Buffer::default();
    let meshes: Vec<Value> = model
        .meshes
        .iter()
        .map(|mesh| {
            let primitives: Vec<Value> = mesh
                .primitives
                .iter()
                .map(|(material, faces)| {
                    let textured = model.materials[*material].texture.is_some();
                    primitive(&mut buffer, faces, *material, textured)
                })
                .collect();
            json!({"name": mesh.name, "primitives": primitives})
        })
        .collect();
    let images: Vec<Value> = model
        .textures
        .iter()
        .enumerate()
        .map(|(index, texture)| {
            let cut_out = model
                .materials
                .iter()
                .any(|m| m.cutoff.is_some() && m.texture.is_some_and(|(t, _)| t == index));
            let view = buffer.view(&png(texture, cut_out), None);
            json!({"name": texture.name, "mimeType": "image/png", "bufferView": view})
        })
        .collect();
    let textures: Vec<Value> = (0..images.len()).map(|i| json!({"source": i, "sampler": 0})).collect();
    let materials: Vec<Value> = model
        .materials
        .iter()
        .map(|m| {
            let [r, g, b] = m.albedo;
            let mut pbr = json!({
                "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0,
            });
            if let Some((texture, _)) = m.texture {
                pbr["baseColorTexture"] = json!({"index": texture});
            }
            let mut material = json!({"name": m.name, "pbrMetallicRoughness": pbr});
            if let Some(cutoff) = m.cutoff {
                material["alphaMode"] = json!("MASK");
                material["alphaCutoff"] = json!(cutoff);
            }
            if m.double_sided {
                material["doubleSided"] = json!(true);
            }
            material
        })
        .collect();
    let nodes: Vec<Value> = model
        .nodes
        .iter()
        .map(|n| {
            let mut node = json!({"name": n.name, "mesh": n.mesh});
            if n.translation != glam::DVec3::ZERO {
                node["translation"] = json!(n.translation.as_vec3().to_array());
            }
            if n.turn != 0.0 {
                let (sin, cos) = (n.turn.to_radians() / 2.0).sin_cos();
                node["rotation"] = json!([0.0, sin as f32, 0.0, cos as f32]);
            }
            if n.scale != glam::DVec3::ONE {
                node["scale"] = json!(n.scale.as_vec3().to_array());
            }
            node
        })
        .collect();
    while !buffer.bytes.len().is_multiple_of(4) {
        buffer.bytes.push(0);
    }
    let root = json!({
        "asset": {"version": "2.0", "generator": "generate (CC0)"},
        "scene": 0,
        "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "textures": textures,
        "images": images,
        // Trilinear, repeating.
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.bytes.len()}],
    });
    container(root.to_string().into_bytes(), buffer.bytes)
}

/// A file's JSON and its binary chunk, as [`write()`] makes them.
pub fn split(glb: &[u8]) -> (Value, Vec<u8>) {
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let root = serde_json::from_slice(&glb[20..20 + length]).expect("what was just written");
    (root, glb[28 + length..].to_vec())
}

/// The file's bytes with changed JSON, without lists that hold nothing.
pub fn write_with(model: &Model, change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let (mut root, binary) = split(&write(model));
    change(&mut root);
    if let Some(root) = root.as_object_mut() {
        root.retain(|_, value| value.as_array().is_none_or(|list| !list.is_empty()));
    }
    container(root.to_string().into_bytes(), binary)
}

/// One primitive's accessors.
fn primitive(buffer: &mut Buffer, mesh: &Mesh, material: usize, textured: bool) -> Value {
    let vectors =
        |from: &[glam::DVec3]| -> Vec<[f32; 3]> { from.iter().map(|v| v.as_vec3().to_array()).collect() };
    let position = buffer.floats(&vectors(&mesh.positions), true);
    let normal = buffer.floats(&vectors(&mesh.normals), false);
    let mut attributes = json!({"POSITION": position, "NORMAL": normal});
    if textured {
        let uvs: Vec<[f32; 2]> = mesh.uvs.iter().map(|uv| uv.as_vec2().to_array()).collect();
        attributes["TEXCOORD_0"] = json!(buffer.floats(&uvs, false));
    }
    json!({"attributes": attributes, "indices": buffer.indices(mesh), "material": material})
}

/// Encodes an image, with alpha only where a cut-out needs it.
fn png(texture: &Texture, alpha: bool) -> Vec<u8> {
    let mut out = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut out, CompressionType::Best, FilterType::Adaptive);
    let (pixels, kind): (Vec<u8>, _) = if alpha {
        (texture.rgba.as_flattened().to_vec(), image::ExtendedColorType::Rgba8)
    } else {
        (texture.rgba.iter().flat_map(|p| [p[0], p[1], p[2]]).collect(), image::ExtendedColorType::Rgb8)
    };
    encoder.write_image(&pixels, texture.size, texture.size, kind).expect("the buffer has the image's size");
    out
}

/// The GLB container: header, JSON chunk padded with spaces, binary chunk padded with zeros.
pub fn container(mut json: Vec<u8>, binary: Vec<u8>) -> Vec<u8> {
    while !json.len().is_multiple_of(4) {
        json.push(b' ');
    }
    let mut out = Vec::with_capacity(28 + json.len() + binary.len());
    let word = |out: &mut Vec<u8>, v: usize| out.extend_from_slice(&(v as u32).to_le_bytes());
    out.extend_from_slice(b"glTF");
    word(&mut out, 2);
    word(&mut out, 28 + json.len() + binary.len());
    word(&mut out, json.len());
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&json);
    word(&mut out, binary.len());
    out.extend_from_slice(b"BIN\0");
    out.extend_from_slice(&binary);
    out
}
