//! glTF extensions: GPU instances, compressed views, quantised attributes, vertex colours, textures and what
//! is not read.

use baker::geometry::{self, Geometry};
use baker::scene;
use base64::Engine;
use glam::{Vec3, Vec4, vec3};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const TEXT: &str = "[bake]\nalbedo_max = 1\n[[object]]\nfile = \"a.gltf\"\n";

fn load_as(folder: &Path, asset: &Value, text: &str) -> dataset::Result<(Geometry, Vec<String>)> {
    fs::write(folder.join("a.gltf"), asset.to_string()).unwrap();
    fs::write(folder.join("scene.toml"), text).unwrap();
    let (scene, _) = scene::load(&folder.join("scene.toml"))?;
    geometry::load(&scene)
}

fn load(asset: &Value) -> dataset::Result<(Geometry, Vec<String>)> {
    let folder = tempfile::tempdir().unwrap();
    load_as(folder.path(), asset, TEXT)
}

fn bytes<const N: usize, T: Copy>(values: &[T], of: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|&v| of(v)).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    bytes(values, f32::to_le_bytes)
}

fn shorts(values: &[i16]) -> Vec<u8> {
    bytes(values, i16::to_le_bytes)
}

/// An asset under construction: every attribute has a view of its own.
struct Asset {
    root: Value,
    binary: Vec<u8>,
}

impl Asset {
    /// One node with one mesh of a triangle list.
    fn new() -> Self {
        let root = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0, "name": "sheet" }],
            "meshes": [{ "primitives": [{ "attributes": {} , "material": 0 }] }],
            "materials": [{ "name": "paint", "pbrMetallicRoughness": { "baseColorFactor": [1, 0.5, 1, 1] } }],
            "accessors": [], "bufferViews": [],
        });
        Asset { root, binary: Vec::new() }
    }

    fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        let at = self.binary.len();
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": at, "byteLength": bytes.len() });
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        let views = self.root["bufferViews"].as_array_mut().unwrap();
        views.push(view);
        views.len() - 1
    }

    fn accessor(&mut self, view: usize, kind: u32, count: usize, of: &str, normalized: bool) -> usize {
        let accessors = self.root["accessors"].as_array_mut().unwrap();
        accessors.push(json!({ "bufferView": view, "componentType": kind, "count": count, "type": of, "normalized": normalized }));
        accessors.len() - 1
    }

    fn attribute(&mut self, name: &str, accessor: usize) {
        self.root["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    }

    /// The unit square in the XY plane, two triangles.
    fn square() -> Self {
        let mut asset = Asset::new();
        let view = asset.view(&floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]), None);
        let accessor = asset.accessor(view, 5126, 4, "VEC3", false);
        asset.root["accessors"][accessor]["min"] = json!([0, 0, 0]);
        asset.root["accessors"][accessor]["max"] = json!([1, 1, 0]);
        asset.attribute("POSITION", accessor);
        let view = asset.view(&[0u8, 1, 2, 0, 2, 3], None);
        let accessor = asset.accessor(view, 5121, 6, "SCALAR", false);
        asset.root["meshes"][0]["primitives"][0]["indices"] = json!(accessor);
        asset
    }

    fn finish(mut self) -> Value {
        let encoded = base64::engine::general_purpose::STANDARD.encode(&self.binary);
        let own = json!({ "byteLength": self.binary.len(), "uri": format!("data:application/octet-stream;base64,{encoded}") });
        match self.root.get_mut("buffers").and_then(Value::as_array_mut) {
            Some(buffers) => buffers[0] = own,
            None => self.root["buffers"] = json!([own]),
        }
        self.root
    }
}

#[test]
fn gpu_instances_stand_where_their_attributes_say() {
    let mut asset = Asset::square();
    let view = asset.view(&floats(&[1., 0., 0., 0., 2., 0., 0., 0., 3.]), None);
    let translation = asset.accessor(view, 5126, 3, "VEC3", false);
    // No turn, a half turn about Y and a quarter turn about X, as normalised 16-bit integers.
    let half = (32767.0 * 0.5f64.sqrt()).round() as i16;
    let turns = [[0, 0, 0, 32767], [0, 32767, 0, 0], [half, 0, 0, half]].concat();
    let view = asset.view(&shorts(&turns), None);
    let rotation = asset.accessor(view, 5122, 3, "VEC4", true);
    let view = asset.view(&floats(&[1., 1., 1., 2., 2., 2., 1., 3., 1.]), None);
    let scale = asset.accessor(view, 5126, 3, "VEC3", false);
    let attributes = json!({ "TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale });
    asset.root["nodes"][0]["translation"] = json!([0, 0, 10]);
    asset.root["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    // Merely used, not required: the instances stand there all the same.
    asset.root["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    let base = asset.root.clone();
    let finished = Asset { root: base.clone(), binary: asset.binary.clone() }.finish();
    let (g, warnings) = load(&finished).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!((g.instances.len(), g.triangles.len()), (3, 6));
    assert!(g.instances.iter().all(|i| i.mesh == 0));
    // The far corner, (1, 1, 0): scaled, turned, moved, and moved with the node.
    let far = |i: usize| g.corners(2 * i)[2] + g.origin.as_vec3();
    for (i, expected) in [vec3(2., 1., 10.), vec3(-2., 4., 10.), vec3(1., 0., 16.)].into_iter().enumerate() {
        assert!(far(i).distance(expected) < 1e-3, "{i}: {}", far(i));
    }
    // What does not fit together is told.
    for (pointer, value, expected) in [
        ("/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes/SCALE", json!(99), "SCALE = 99"),
        (
            "/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes",
            json!({}),
            "expected an attribute TRANSLATION",
        ),
        ("/accessors/2/count", json!(2), "attributes of 2 and 3 elements"),
        ("/accessors/3/count", json!(1u64 << 40), "accessor 3"),
        ("/accessors/4/type", json!("VEC2"), "expected 3 components"),
    ] {
        let mut broken = base.clone();
        *broken.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
        let error =
            load(&Asset { root: broken, binary: asset.binary.clone() }.finish()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("a.gltf"), "{expected}: {error}");
    }
    // A rotation of no length.
    let mut nowhere = asset.binary.clone();
    let at = base["bufferViews"][3]["byteOffset"].as_u64().unwrap() as usize;
    nowhere[at..at + 8].fill(0);
    let error = load(&Asset { root: base, binary: nowhere }.finish()).unwrap_err().to_string();
    assert!(error.contains("instance 0: its transform"), "{error}");
}

/// The square with both views compressed; the plain buffer is a fallback without bytes.
fn compressed(name: &str) -> Asset {
    let corners: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let indices = [0u32, 1, 2, 0, 2, 3];
    let vertices = meshopt::encode_vertex_buffer(&corners).unwrap();
    let triangles = meshopt::encode_index_buffer(&indices, 4).unwrap();
    let mut asset = Asset::square();
    asset.binary.clear();
    asset.binary.extend_from_slice(&vertices);
    let at = asset.binary.len();
    asset.binary.extend_from_slice(&triangles);
    asset.root["buffers"] = json!([null, { "byteLength": 72, "extensions": { name: { "fallback": true } } }]);
    asset.root["bufferViews"] = json!([
        { "buffer": 1, "byteLength": 48, "extensions": { name: {
            "buffer": 0, "byteOffset": 0, "byteLength": at, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES" } } },
        { "buffer": 1, "byteOffset": 48, "byteLength": 24, "extensions": { name: {
            "buffer": 0, "byteOffset": at, "byteLength": triangles.len(), "byteStride": 4, "count": 6, "mode": "TRIANGLES" } } },
    ]);
    asset.root["accessors"][1]["componentType"] = json!(5125);
    asset.root["extensionsUsed"] = json!([name]);
    asset.root["extensionsRequired"] = json!([name]);
    asset
}

#[test]
fn compressed_views_give_the_same_geometry() {
    let (plain, _) = load(&Asset::square().finish()).unwrap();
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let (g, warnings) = load(&compressed(name).finish()).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!((&g.positions, &g.triangles), (&plain.positions, &plain.triangles));
    }
}

#[test]
fn filters_are_undone() {
    // A normal that the octahedral filter holds as (x, y, 1) of 8 bits each; positions that the exponential
    // one does.
    let mut asset = compressed("EXT_meshopt_compression");
    let normals: Vec<[f32; 4]> = (0..4).map(|_| [0.6, 0.0, 0.8, 0.0]).collect();
    let filtered: Vec<[i8; 4]> = meshopt::encode_filter_oct(&normals, 8);
    let encoded = meshopt::encode_vertex_buffer(&filtered).unwrap();
    let at = asset.binary.len();
    asset.binary.extend_from_slice(&encoded);
    let view = json!({ "buffer": 1, "byteLength": 16, "byteStride": 4, "extensions": { "EXT_meshopt_compression": {
        "buffer": 0, "byteOffset": at, "byteLength": encoded.len(), "byteStride": 4, "count": 4, "mode": "ATTRIBUTES",
        "filter": "OCTAHEDRAL" } } });
    asset.root["bufferViews"].as_array_mut().unwrap().push(view);
    let accessor = asset.accessor(2, 5120, 4, "VEC3", true);
    asset.attribute("NORMAL", accessor);
    let (g, _) = load(&asset.finish()).unwrap();
    assert!(g.normals.iter().all(|n| n.distance(vec3(0.6, 0.0, 0.8)) < 0.02), "{:?}", g.normals);
}

#[test]
fn damaged_compressed_views_give_errors_or_a_scene_and_never_a_panic() {
    let whole = compressed("EXT_meshopt_compression");
    let change = |pointer: &str, value: Value| {
        let mut root = whole.root.clone();
        *root.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
        load(&Asset { root, binary: whole.binary.clone() }.finish())
    };
    let at = |view: usize, key: &str| format!("/bufferViews/{view}/extensions/EXT_meshopt_compression/{key}");
    for (pointer, value, expected) in [
        (at(0, "byteStride"), json!(13), "expected as many bytes as the view has"),
        (at(0, "count"), json!(1u64 << 40), "expected as many bytes as the view has"),
        (at(0, "count"), json!(u64::MAX), "expected as many bytes as the view has"),
        (at(0, "byteLength"), json!(1 << 20), "ends outside its buffer"),
        (at(0, "byteOffset"), json!(u64::MAX), "ends outside its buffer"),
        (at(0, "byteLength"), json!(9), "cannot be decoded"),
        (at(0, "buffer"), json!(7), "expected an index below 2"),
        (at(0, "mode"), json!("TRIANGLES"), "byteStride = 12 with mode TRIANGLES"),
        (at(1, "mode"), json!("ATTRIBUTES"), "cannot be decoded"),
        (at(1, "mode"), json!("LINES"), "expected ATTRIBUTES, TRIANGLES or INDICES"),
        (at(0, "mode"), json!(5), "EXT_meshopt_compression"),
    ] {
        let error = change(&pointer, value).map(|_| ()).expect_err(&pointer).to_string();
        assert!(
            error.contains(expected) && error.contains("a.gltf: buffer view"),
            "{pointer}: {expected}\n{error}"
        );
    }
    // A view that claims gigabytes out of a few bytes.
    let mut root = whole.root.clone();
    root["bufferViews"][0]["byteLength"] = json!(12u64 << 33);
    root["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]["count"] = json!(1u64 << 33);
    let error = load(&Asset { root, binary: whole.binary.clone() }.finish()).unwrap_err().to_string();
    assert!(error.contains("times as many at most"), "{error}");
    // Every byte with one bit turned, and every length cut short.
    for at in 0..whole.binary.len() {
        for bit in [0, 3, 7] {
            let mut binary = whole.binary.clone();
            binary[at] ^= 1 << bit;
            let _ = load(&Asset { root: whole.root.clone(), binary }.finish());
        }
    }
    for view in 0..2 {
        let length = whole.root["bufferViews"][view]["extensions"]["EXT_meshopt_compression"]["byteLength"]
            .as_u64()
            .unwrap();
        for length in 0..length {
            assert!(
                change(&at(view, "byteLength"), json!(length)).is_err(),
                "view {view}: {length} bytes were accepted"
            );
        }
    }
}

#[test]
fn quantised_attributes_are_read_as_fractions_or_as_they_are() {
    let reference = load(&Asset::square().finish()).unwrap().0;
    let mesh = |positions: &[u8], stride: usize, kind: u32, normalized: bool, scale: f64| {
        let mut asset = Asset::square();
        let view = asset.view(positions, Some(stride));
        let accessor = asset.accessor(view, kind, 4, "VEC3", normalized);
        // (Nothing reads them, but there must be some.)
        asset.root["accessors"][accessor]["min"] = json!([0, 0, 0]);
        asset.root["accessors"][accessor]["max"] = json!([0, 0, 0]);
        asset.attribute("POSITION", accessor);
        let view = asset.view(&bytes(&[[0i8, 0, 127, 0]; 4], |n| n.map(|c| c as u8)), Some(4));
        let accessor = asset.accessor(view, 5120, 4, "VEC3", true);
        asset.attribute("NORMAL", accessor);
        let view = asset.view(
            &bytes(&[[0u16, 65535], [65535, 65535], [65535, 0], [0, 0]], |[u, v]| {
                let ([a, b], [c, d]) = (u.to_le_bytes(), v.to_le_bytes());
                [a, b, c, d]
            }),
            None,
        );
        let accessor = asset.accessor(view, 5123, 4, "VEC2", true);
        asset.attribute("TEXCOORD_1", accessor);
        asset.root["nodes"][0]["scale"] = json!([scale, scale, scale]);
        asset.root["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        asset.finish()
    };
    let corners = [[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0], [0, 1, 0, 0]].concat();
    let scaled = |by: i32| corners.iter().map(|c| c * by).collect::<Vec<i32>>();
    let cases = [
        mesh(&bytes(&scaled(127), |c| (c as i8).to_le_bytes()), 4, 5120, true, 1.0),
        mesh(&bytes(&scaled(255), |c| (c as u8).to_le_bytes()), 4, 5121, true, 1.0),
        mesh(&bytes(&scaled(50), |c| (c as u8).to_le_bytes()), 4, 5121, false, 0.02),
        mesh(&bytes(&scaled(-32767), |c| (c as i16).to_le_bytes()), 8, 5122, true, -1.0),
        mesh(&bytes(&scaled(-4096), |c| (c as i16).to_le_bytes()), 8, 5122, false, -1.0 / 4096.0),
        mesh(&bytes(&scaled(65535), |c| (c as u16).to_le_bytes()), 8, 5123, true, 1.0),
    ];
    for (i, asset) in cases.iter().enumerate() {
        let (g, warnings) = load(asset).unwrap_or_else(|e| panic!("case {i}: {e}"));
        assert!(warnings.is_empty(), "case {i}: {warnings:?}");
        for t in 0..2 {
            // A mirrored node has two corners swapped.
            let mut found = g.corners(t);
            found.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap());
            let mut wanted = reference.corners(t);
            wanted.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap());
            assert!(found.iter().zip(&wanted).all(|(a, b)| a.distance(*b) < 1e-6), "case {i}: {found:?}");
        }
        assert!(
            g.lightmap_uvs
                .iter()
                .all(|uv| uv.cmpge(glam::Vec2::ZERO).all() && uv.cmple(glam::Vec2::ONE).all())
        );
        assert!(g.instances[0].has_lightmap_uvs);
    }
}

#[test]
fn vertex_colours_multiply_the_base_colour_and_are_interpolated() {
    let colours = [[1.0f32, 1., 1., 1.], [0.5, 1., 0., 1.], [0., 0., 0., 0.25], [1., 1., 1., 1.]];
    let with = |data: Vec<u8>, kind: u32, of: &str, normalized: bool, stride: Option<usize>| {
        let mut asset = Asset::square();
        let view = asset.view(&data, stride);
        let accessor = asset.accessor(view, kind, 4, of, normalized);
        asset.attribute("COLOR_0", accessor);
        asset
    };
    let byte = |scale: f32| move |c: [f32; 4]| c.map(|v| (v * scale).round() as u8);
    let cases = [
        with(bytes(&colours.concat(), f32::to_le_bytes), 5126, "VEC4", false, None),
        with(bytes(&colours, byte(255.0)), 5121, "VEC4", true, None),
        with(bytes(&colours, byte(255.0)), 5121, "VEC4", false, None),
        with(
            bytes(&colours.concat(), |c| ((c * 65535.0).round() as u16).to_le_bytes()),
            5123,
            "VEC4",
            true,
            None,
        ),
        with(bytes(&colours, byte(255.0)), 5121, "VEC3", true, Some(4)),
    ];
    for (i, asset) in cases.into_iter().enumerate() {
        let (g, warnings) = load(&asset.finish()).unwrap();
        assert!(warnings.is_empty(), "case {i}: {warnings:?}");
        let close = |a: Vec3, b: Vec3| assert!(a.distance(b) < 0.005, "case {i}: {a} {b}");
        close(g.albedo_at(0, Vec3::X), vec3(1.0, 0.5, 1.0));
        close(g.albedo_at(0, Vec3::Y), vec3(0.5, 0.5, 0.0));
        close(g.albedo_at(0, Vec3::new(0.5, 0.5, 0.0)), vec3(0.75, 0.5, 0.5));
        close(g.albedo_at(0, Vec3::Z), Vec3::ZERO);
        let alpha = if i == 4 { 1.0 } else { 0.25 };
        assert!((g.alpha_at(0, Vec3::Z) - alpha).abs() < 0.005, "case {i}");
    }
    // Cut out by the vertices' alpha; the scene file's albedo replaces the colour and leaves the hole.
    let mut asset = with(bytes(&colours.concat(), f32::to_le_bytes), 5126, "VEC4", false, None);
    asset.root["materials"][0]["alphaMode"] = json!("MASK");
    let asset = asset.finish();
    let (g, _) = load(&asset).unwrap();
    assert!(g.is_solid_at(0, Vec3::X) && !g.is_solid_at(0, Vec3::Z));
    let folder = tempfile::tempdir().unwrap();
    let (g, _) = load_as(folder.path(), &asset, &format!("{TEXT}albedo = 0.3\n")).unwrap();
    assert!(g.albedo_at(0, Vec3::Y).distance(Vec3::splat(0.3)) < 1e-6 && !g.is_solid_at(0, Vec3::Z));
    // Whites are limited, and only they.
    let (g, warnings) = load_as(folder.path(), &asset, "[[object]]\nfile = \"a.gltf\"\n").unwrap();
    assert!(warnings.iter().any(|w| w.contains("albedo above 0.95")), "{warnings:?}");
    assert_eq!((g.albedo_at(0, Vec3::X).x, g.albedo_at(0, Vec3::Y).x), (0.95, 0.5));
    // Not a number.
    let mut broken = colours.concat();
    broken[4] = f32::NAN;
    let error = load(&with(floats(&broken), 5126, "VEC4", false, None).finish()).unwrap_err().to_string();
    assert!(error.contains("vertex 1: vertex colour"), "{error}");
}

#[test]
fn a_blend_whose_alpha_comes_from_its_vertices_is_glass() {
    let with = |alphas: [f32; 4], mode: &str| {
        let mut asset = Asset::square();
        let colours = alphas.map(|alpha| [1.0f32, 1.0, 1.0, alpha]).concat();
        let view = asset.view(&floats(&colours), None);
        let accessor = asset.accessor(view, 5126, 4, "VEC4", false);
        asset.attribute("COLOR_0", accessor);
        asset.root["materials"][0]["alphaMode"] = json!(mode);
        asset
    };
    let (g, warnings) = load(&with([0.25, 0.25, 0.75, 0.25], "BLEND").finish()).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let middle = Vec3::new(0.5, 0.0, 0.5);
    for (at, open) in [(Vec3::X, 0.75), (Vec3::Z, 0.25), (middle, 0.5)] {
        assert!(g.transmittance_at(0, at).distance(Vec3::splat(open)) < 1e-6, "{at}");
    }
    // Opaque vertices, and a material that does not blend, are no glass.
    for asset in [with([1.0; 4], "BLEND"), with([0.25; 4], "OPAQUE")] {
        assert!(!load(&asset.finish()).unwrap().0.has_glass());
    }
    // Two primitives share the material, and one of them has no colours: that one is opaque.
    let mut asset = with([0.25; 4], "BLEND");
    let mut plain = asset.root["meshes"][0]["primitives"][0].clone();
    plain["attributes"].as_object_mut().unwrap().remove("COLOR_0");
    asset.root["meshes"][0]["primitives"].as_array_mut().unwrap().push(plain);
    let (g, _) = load(&asset.finish()).unwrap();
    assert!(g.is_glass(0) && !g.is_glass(2));
}

#[test]
fn a_scene_without_vertex_colours_holds_none() {
    let (plain, _) = load(&Asset::square().finish()).unwrap();
    assert!(plain.colours.is_empty());
    let digest = |g: &Geometry| {
        let mut hash = blake3::Hasher::new();
        g.update_digest(&mut hash);
        hash.finalize()
    };
    let mut coloured = plain.clone();
    coloured.colours = vec![Vec4::ONE; plain.positions.len()];
    assert_ne!(digest(&plain), digest(&coloured));
}

#[test]
fn what_is_in_the_way_is_told_with_the_command_that_converts_it() {
    let refused = |key: &str, value: Value| {
        let mut asset = Asset::square();
        asset.root[key] = value;
        load(&asset.finish()).unwrap_err().to_string()
    };
    let error = refused("extensionsRequired", json!(["KHR_draco_mesh_compression"]));
    // The command can be pasted: it names the file.
    let out = error.split("npx @gltf-transform/cli copy ").nth(1).expect("the command");
    assert!(out.contains("a.gltf ") && out.contains("a-plain.glb` writes it without"), "{error}");
    let error = refused("extensionsRequired", json!(["ACME_spheres"]));
    assert!(error.contains("requires ACME_spheres, which is not read: export it without"), "{error}");
    // Draco without a plain copy, though nothing says that it is required.
    let mut asset = Asset::square();
    asset.root["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    asset.root["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_draco_mesh_compression": { "bufferView": 0 } });
    let error = load(&asset.finish()).unwrap_err().to_string();
    assert!(
        error.contains("mesh 0: its positions are compressed with KHR_draco_mesh_compression"),
        "{error}"
    );
    // Used, not required: one warning for all.
    let mut asset = Asset::square();
    asset.root["extensionsUsed"] =
        json!(["EXT_lights_area", "MSFT_lod", "KHR_materials_sheen", "KHR_audio_emitter", "ACME_spheres"]);
    let (_, warnings) = load(&asset.finish()).unwrap();
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(warning.contains("extensions that are not read: EXT_lights_area (write"), "{warning}");
    assert!(warning.contains("; MSFT_lod (only the first"), "{warning}");
    // What nobody here has heard of could add, move or hide anything.
    assert!(warning.contains(", and an extension that is not known: ACME_spheres ("), "{warning}");
    assert!(!warning.contains("KHR_"), "{warning}");
}

#[test]
fn textures_in_ktx2_use_their_fallback_and_are_told_where_there_is_none() {
    let png = {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::RgbaImage::from_raw(1, 1, vec![255, 0, 0, 255]).unwrap();
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    let textured = |texture: Value, image: &[u8]| {
        let mut asset = Asset::square();
        let uvs = asset.view(&floats(&[0.5; 8]), None);
        let accessor = asset.accessor(uvs, 5126, 4, "VEC2", false);
        asset.attribute("TEXCOORD_0", accessor);
        let view = asset.view(image, None);
        asset.root["images"] =
            json!([{ "bufferView": view, "mimeType": "image/png" }, { "uri": "there-is-none.ktx2" }]);
        asset.root["textures"] = json!([texture]);
        asset.root["materials"][0]["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": 0 } });
        load(&asset.finish()).unwrap()
    };
    let ktx2 = json!({ "KHR_texture_basisu": { "source": 1 } });
    let (g, warnings) = textured(json!({ "source": 0, "extensions": ktx2 }), &png);
    assert!(warnings.is_empty() && g.albedo_at(0, Vec3::X) == Vec3::X, "{warnings:?}");
    let (g, warnings) = textured(json!({ "extensions": ktx2 }), &png);
    assert_eq!(g.albedo_at(0, Vec3::X), Vec3::splat(0.5));
    assert!(warnings[0].contains("npx @gltf-transform/cli ktxdecompress"), "{warnings:?}");
    // Where the file requires it, there is nothing to stand in for it.
    let mut asset = Asset::square();
    asset.root["textures"] = json!([{ "extensions": ktx2 }]);
    asset.root["materials"][0]["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": 0 } });
    asset.root["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    let error = load(&asset.finish()).unwrap_err().to_string();
    assert!(error.contains("material paint") && error.contains("ktxdecompress"), "{error}");
    let (_, warnings) = textured(json!({}), &png);
    assert!(warnings[0].contains("expected a source"), "{warnings:?}");
    #[cfg(feature = "webp")]
    {
        // One red texel, lossless.
        let mut webp = std::io::Cursor::new(Vec::new());
        image::RgbaImage::from_raw(1, 1, vec![255, 0, 0, 255])
            .unwrap()
            .write_to(&mut webp, image::ImageFormat::WebP)
            .unwrap();
        let webp = webp.into_inner();
        let (g, warnings) = textured(json!({ "extensions": { "EXT_texture_webp": { "source": 0 } } }), &webp);
        assert!(warnings.is_empty() && g.albedo_at(0, Vec3::X) == Vec3::X, "{warnings:?}");
        let (_, warnings) =
            textured(json!({ "extensions": { "EXT_texture_webp": { "source": 0 } } }), &webp[..20]);
        assert!(warnings[0].contains("cannot be decoded"), "{warnings:?}");
    }
}
