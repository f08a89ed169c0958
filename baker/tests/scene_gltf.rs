//! glTF: hierarchies, index and component types, textures, cut-outs, and hostile files.

use baker::geometry::{self, Geometry};
use baker::scene;
use base64::Engine;
use glam::{Vec2, Vec3};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const TEXT: &str = "[bake]\nalbedo_max = 1\n[[object]]\nfile = \"a.gltf\"\n";

fn load(folder: &Path, asset: &Value) -> dataset::Result<(Geometry, Vec<String>)> {
    fs::write(folder.join("a.gltf"), asset.to_string()).unwrap();
    fs::write(folder.join("scene.toml"), TEXT).unwrap();
    let (scene, _) = scene::load(&folder.join("scene.toml"))?;
    geometry::load(&scene)
}

fn data_uri(bytes: &[u8]) -> String {
    let encoded = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:application/octet-stream;base64,{encoded}")
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Four corners of a unit square in the XY plane, u along x and v down from y = 1.
const CORNERS: [f32; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
const UVS: [f32; 8] = [0., 1., 1., 1., 1., 0., 0., 0.];

/// An asset of one square at one node; views 0 positions, 1 texture coordinates, 2 byte indices, 3 the PNG.
fn square() -> Value {
    let (positions, uvs, indices) = (floats(&CORNERS), floats(&UVS), [0u8, 1, 2, 0, 2, 3, 0, 0]);
    let png = png();
    let bytes = [&positions[..], &uvs, &indices, &png].concat();
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "sheet" }],
        "meshes": [{ "name": "square", "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 }] }],
        "materials": [{ "name": "leaf", "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
            "pbrMetallicRoughness": { "baseColorFactor": [1, 0.5, 1, 1], "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "wrapS": 33071, "wrapT": 33648 }],
        "images": [{ "bufferView": 3, "mimeType": "image/png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5121, "count": 6, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 6 },
            { "buffer": 0, "byteOffset": 88, "byteLength": png.len() },
        ],
        "buffers": [{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }],
    })
}

/// 2 × 2 texels: red and a hole above, grey and blue below.
fn png() -> Vec<u8> {
    let texels = [[255, 0, 0, 255], [0, 0, 0, 0], [188, 188, 188, 255], [0, 0, 255, 255]].concat();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_raw(2, 2, texels).unwrap().write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Changes what stands at a JSON pointer.
fn with(mut asset: Value, changes: &[(&str, Value)]) -> Value {
    for (pointer, value) in changes {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match asset.pointer_mut(parent).unwrap_or_else(|| panic!("{pointer}")) {
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value.clone(),
            Value::Object(map) => drop(map.insert(key.to_owned(), value.clone())),
            other => panic!("{pointer}: {other}"),
        }
    }
    asset
}

#[test]
fn textures_factors_and_cut_outs_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let (g, warnings) = load(folder.path(), &square()).unwrap();
    assert_eq!(warnings, Vec::<String>::new());
    assert_eq!((g.triangles.len(), g.instances.len(), g.textures.len()), (2, 1, 1));
    assert_eq!(g.instances[0].name, "a.gltf: sheet/square/leaf");
    assert!(g.materials[0].two_sided && g.normal(0) == Vec3::Z);
    // The first triangle's corners are (0, 0), (1, 0), (1, 1); clamped and mirrored edges repeat the corner
    // texel.
    assert!((g.albedo_at(0, Vec3::X) - Vec3::new(0.502_886_5, 0.251_443_2, 0.502_886_5)).length() < 1e-6);
    assert_eq!(g.albedo_at(0, Vec3::Y), Vec3::Z);
    assert_eq!((g.alpha_at(0, Vec3::Y), g.alpha_at(0, Vec3::Z)), (1.0, 0.0));
    assert!(g.is_solid_at(0, Vec3::Y) && !g.is_solid_at(0, Vec3::Z));
    // Half way between them alpha is a half, above the cutoff of a quarter.
    assert!(g.is_solid_at(0, Vec3::new(0.0, 0.5, 0.5)) && !g.is_solid_at(0, Vec3::new(0.0, 0.3, 0.7)));
}

#[test]
fn a_texture_is_held_once_however_often_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("my leaf.png"), png()).unwrap();
    let asset = with(
        square(),
        &[
            ("/images", json!([{ "uri": "my%20leaf.png" }, { "bufferView": 3, "mimeType": "image/png" }])),
            (
                "/textures",
                json!([{ "source": 0, "sampler": 0 }, { "source": 1, "sampler": 0 }, { "source": 1 }]),
            ),
            (
                "/materials",
                json!(
                    (0..3)
                        .map(|t| json!({ "pbrMetallicRoughness": {
                "baseColorTexture": { "index": t } } }))
                        .collect::<Vec<_>>()
                ),
            ),
            (
                "/meshes/0/primitives",
                json!(
                    (0..3)
                        .map(|m| json!({
                "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": m }))
                        .collect::<Vec<_>>()
                ),
            ),
        ],
    );
    let (g, _) = load(folder.path(), &asset).unwrap();
    // The third has other addressing.
    assert_eq!((g.textures.len(), g.materials.len(), g.instances.len()), (2, 2, 3));
}

#[test]
fn nodes_place_meshes_by_their_hierarchy() {
    let folder = tempfile::tempdir().unwrap();
    // A parent 10 up and turned by 90° about Y has the square twice, one mirrored; a matrix node has it a
    // third time.
    let asset = with(
        square(),
        &[
            ("/scenes/0/nodes", json!([0, 3])),
            (
                "/nodes",
                json!([
                    { "translation": [0, 10, 0], "rotation": [0, 0.5f64.sqrt(), 0, 0.5f64.sqrt()], "children": [1, 2] },
                    { "mesh": 0, "translation": [1, 0, 0] },
                    { "mesh": 0, "scale": [-1, 1, 1] },
                    { "mesh": 0, "matrix": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 5, 1] },
                ]),
            ),
        ],
    );
    let (g, _) = load(folder.path(), &asset).unwrap();
    assert_eq!((g.instances.len(), g.materials.len()), (3, 1));
    let at = |t: usize, corner: usize| g.origin.as_vec3() + g.corners(t)[corner];
    // Rotation about Y takes x to −z and z to x; the front, +Z, looks along +X, mirrored or not.
    let close = |a: Vec3, b: Vec3| assert!((a - b).length() < 1e-5, "{a} {b}");
    close(at(0, 1), Vec3::new(0.0, 10.0, -2.0));
    (0..4).for_each(|t| close(g.normal(t), Vec3::X));
    close(at(2, 2), Vec3::new(0.0, 10.0, 1.0));
    close(at(4, 2), Vec3::new(2.0, 2.0, 5.0));
    assert!((g.area(4) - 2.0).abs() < 1e-6);
}

#[test]
fn strips_fans_wide_indices_and_quantised_positions_agree() {
    let folder = tempfile::tempdir().unwrap();
    let reference: f32 = 1.0;
    let shorts: Vec<u8> = CORNERS
        .iter()
        .map(|&c| (c * 32767.0) as i16)
        .collect::<Vec<_>>()
        .chunks(3)
        .flat_map(|c| [c[0].to_le_bytes(), c[1].to_le_bytes(), c[2].to_le_bytes(), [0; 2]].concat())
        .collect();
    let words: Vec<u8> = [0u32, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
    let cases = [
        with(
            square(),
            &[
                ("/meshes/0/primitives/0/mode", json!(6)),
                ("/accessors/2/count", json!(4)),
                ("/buffers/0/uri", json!(replaced(80, &[0, 1, 2, 3]))),
            ],
        ),
        with(
            square(),
            &[
                ("/meshes/0/primitives/0/mode", json!(5)),
                ("/accessors/2/count", json!(5)),
                ("/buffers/0/uri", json!(replaced(80, &[0, 1, 3, 2, 2]))),
            ],
        ),
        with(
            square(),
            &[
                ("/bufferViews/2", json!({ "buffer": 1, "byteLength": 24 })),
                ("/accessors/2/componentType", json!(5125)),
                ("/buffers", json!([square()["buffers"][0], { "byteLength": 24, "uri": data_uri(&words) }])),
            ],
        ),
        with(
            square(),
            &[
                ("/bufferViews/0", json!({ "buffer": 1, "byteLength": 32, "byteStride": 8 })),
                ("/accessors/0/componentType", json!(5122)),
                ("/accessors/0/normalized", json!(true)),
                ("/extensionsUsed", json!(["KHR_mesh_quantization"])),
                ("/extensionsRequired", json!(["KHR_mesh_quantization"])),
                ("/buffers", json!([square()["buffers"][0], { "byteLength": 32, "uri": data_uri(&shorts) }])),
            ],
        ),
    ];
    for (i, asset) in cases.iter().enumerate() {
        let (g, warnings) = load(folder.path(), asset).unwrap_or_else(|e| panic!("case {i}: {e}"));
        assert_eq!(warnings, Vec::<String>::new(), "case {i}");
        assert_eq!(g.triangles.len(), 2, "case {i}");
        for t in 0..2 {
            assert!((g.area(t) - reference / 2.0).abs() < 1e-6 && g.normal(t) == Vec3::Z, "case {i}");
        }
    }
}

/// The square's buffer with other bytes from `at`.
fn replaced(at: usize, bytes: &[u8]) -> String {
    let uri = square()["buffers"][0]["uri"].as_str().unwrap().to_owned();
    let mut data = base64::engine::general_purpose::STANDARD.decode(uri.split_once(',').unwrap().1).unwrap();
    data[at..at + bytes.len()].copy_from_slice(bytes);
    data_uri(&data)
}

#[test]
fn texture_transforms_and_second_coordinates_apply() {
    let folder = tempfile::tempdir().unwrap();
    // Offset (0, 1), a quarter turn, half size: the lower left quadrant (the extension's own example).
    let transform = json!({ "KHR_texture_transform": {
        "offset": [0, 1], "rotation": std::f64::consts::FRAC_PI_2, "scale": [0.5, 0.5] } });
    let asset = with(
        square(),
        &[
            (
                "/materials/0/pbrMetallicRoughness/baseColorTexture",
                json!({ "index": 0, "extensions": transform }),
            ),
            ("/meshes/0/primitives/0/attributes", json!({ "POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 1 })),
        ],
    );
    let (g, _) = load(folder.path(), &asset).unwrap();
    for (uv, plain) in g.uvs.iter().zip(&g.lightmap_uvs) {
        assert!((uv - Vec2::new(0.5 * plain.y, 1.0 - 0.5 * plain.x)).length() < 1e-6);
    }
    assert!(g.instances[0].has_lightmap_uvs);
}

#[test]
fn what_cannot_be_baked_is_warned_about() {
    let folder = tempfile::tempdir().unwrap();
    let lines = json!({ "attributes": { "POSITION": 0 }, "mode": 1 });
    let triangles = json!({ "attributes": { "POSITION": 0, "_CUSTOM": 1 }, "indices": 2 });
    let asset = with(square(), &[("/meshes/0/primitives", json!([lines, triangles]))]);
    let (g, warnings) = load(folder.path(), &asset).unwrap();
    assert_eq!(g.albedo_at(0, Vec3::X), Vec3::splat(0.5));
    for expected in
        ["1 primitive: points and lines have no surface", "albedo 0.5 for want of a defined material: 1 mesh"]
    {
        assert!(warnings.iter().any(|w| w.contains(expected)), "{expected}: {warnings:?}");
    }
}

#[test]
fn blended_alpha_is_coverage_unless_it_cuts_out() {
    let folder = tempfile::tempdir().unwrap();
    let blend = |more: &[(&str, Value)]| {
        let changes = [&[("/materials/0/alphaMode", json!("BLEND"))], more].concat();
        load(folder.path(), &with(square(), &changes)).unwrap()
    };
    // The texture's alpha is 0 or 1: a cut-out, as leaves are.
    let (g, warnings) = blend(&[]);
    assert!(
        g.materials[0].alpha_cutoff == Some(0.5) && !g.has_glass() && warnings.is_empty(),
        "{warnings:?}"
    );
    // An alpha of 0.25 lets ¾ through, untinted, and reflects as a quarter.
    let pbr = |alpha: f32| json!({ "baseColorFactor": [1, 0.5, 0.25, alpha] });
    let (g, warnings) = blend(&[("/materials/0/pbrMetallicRoughness", pbr(0.25))]);
    assert!(g.materials[0].alpha_cutoff.is_none() && warnings.is_empty(), "{warnings:?}");
    assert_eq!(g.transmittance_at(0, Vec3::X), Vec3::splat(0.75));
    assert_eq!(g.albedo_at(0, Vec3::X), Vec3::new(0.25, 0.125, 0.0625));
    // Alpha of 1 everywhere is opaque.
    let (g, _) = blend(&[("/materials/0/pbrMetallicRoughness", pbr(1.0))]);
    assert!(!g.has_glass() && g.materials[0].alpha_cutoff.is_none());
}

#[test]
fn transmission_is_tinted_by_the_base_colour() {
    let folder = tempfile::tempdir().unwrap();
    let glass = |transmission: Value, more: &[(&str, Value)]| {
        let material = json!({ "name": "pane", "pbrMetallicRoughness": { "baseColorFactor": [1, 0.5, 0.25, 1] },
            "extensions": { "KHR_materials_transmission": transmission } });
        load(folder.path(), &with(square(), &[&[("/materials/0", material)], more].concat()))
    };
    let required = ("/extensionsRequired", json!(["KHR_materials_transmission"]));
    let (g, warnings) = glass(json!({ "transmissionFactor": 0.8 }), &[required]).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert!(g.transmittance_at(0, Vec3::X).abs_diff_eq(Vec3::new(0.8, 0.4, 0.2), 1e-6));
    assert!(g.albedo_at(0, Vec3::X).abs_diff_eq(Vec3::new(0.2, 0.1, 0.05), 1e-6));
    assert!(g.instances[0].lightmap);
    // All of it: nothing is reflected, and it gets no texels. The base colour's limit of 0.95 is none for
    // glass.
    let (g, warnings) = glass(json!({ "transmissionFactor": 1 }), &[]).unwrap();
    assert!(warnings.is_empty() && !g.instances[0].lightmap, "{warnings:?}");
    assert_eq!(g.transmittance_at(0, Vec3::X), Vec3::new(1.0, 0.5, 0.25));
    // A texture's red channel, linear: texel 0 is red, texel 2 of 188/255; beside it the coordinates are
    // used.
    let textured = json!({ "transmissionFactor": 0.5, "transmissionTexture": { "index": 0 } });
    let (g, _) = glass(textured.clone(), &[]).unwrap();
    let corners = [Vec3::X, Vec3::Y, Vec3::Z].map(|at| g.transmittance_at(0, at).x);
    let expected = [188.0 / 255.0 * 0.5, 0.0, 0.0];
    assert!(corners.iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-5), "{corners:?}");
    // What is not used is told, what is wrong is refused.
    let volume = json!({ "KHR_materials_transmission": { "transmissionFactor": 1 },
        "KHR_materials_volume": { "thicknessFactor": 1 } });
    let (_, warnings) = glass(json!({}), &[("/materials/0/extensions", volume)]).unwrap();
    assert!(warnings[0].contains("KHR_materials_volume is not used"), "{warnings:?}");
    let (g, _) = glass(json!({ "transmissionFactor": 0 }), &[]).unwrap();
    assert!(!g.has_glass());
    let (g, warnings) = glass(textured, &[("/images/0", json!({ "uri": "lost.png" }))]).unwrap();
    assert!(warnings[0].contains("transmission texture cannot be read"), "{warnings:?}");
    assert_eq!(g.transmittance_at(0, Vec3::X).x, 0.5);
    for wrong in [-0.1, 1.5] {
        let error = glass(json!({ "transmissionFactor": wrong }), &[]).unwrap_err().to_string();
        assert!(error.contains("transmissionFactor") && error.contains("from 0 to 1"), "{error}");
    }
}

#[test]
fn a_texture_that_cannot_be_read_is_warned_about_and_grey_stands_in_for_it() {
    let folder = tempfile::tempdir().unwrap();
    for (pointer, value, reason) in [
        ("/images/0", json!({}), "expected a uri or a bufferView"),
        ("/images/0", json!({ "uri": "lost.png" }), "there is no file lost.png"),
        ("/images/0", json!({ "bufferView": 0 }), "the texture is neither PNG nor JPEG"),
        ("/bufferViews/3/byteLength", json!(60), "the texture cannot be decoded"),
        ("/bufferViews/3/byteLength", json!(1 << 30), "it ends outside its buffer"),
    ] {
        let (g, warnings) = load(folder.path(), &with(square(), &[(pointer, value)])).unwrap();
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(warning.contains("a.gltf: material leaf (") && warning.contains(reason), "{warning}");
        assert!(warning.contains("add the file"), "{warning}");
        // The factor [1, ½, 1] times ½.
        assert_eq!(g.albedo_at(0, Vec3::X), Vec3::new(0.5, 0.25, 0.5));
    }
}

#[test]
fn whites_of_files_are_limited_and_those_of_the_scene_file_are_not() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.gltf"), square().to_string()).unwrap();
    let write = |text: &str| {
        fs::write(folder.path().join("scene.toml"), text).unwrap();
        let (scene, _) = scene::load(&folder.path().join("scene.toml")).unwrap();
        geometry::load(&scene).unwrap()
    };
    // A corner whose texel is pure red; the factor is 1 there.
    let red = |g: &Geometry| {
        let places = [[0.0, 1.0, 0.0], [0.0, 0.9, 0.1], [0.0, 0.5, 0.5], [0.1, 0.1, 0.8], [0.0, 0.0, 1.0]];
        let of = |t: usize| places.map(|weights| g.albedo_at(t, Vec3::from(weights)).x);
        [of(0), of(1)].concat().into_iter().fold(0.0, f32::max)
    };
    let object = "[[object]]\nfile = \"a.gltf\"\n";
    let (g, warnings) = write(object);
    assert_eq!(red(&g), 0.95);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(warning.contains("1 material of files (a.gltf: leaf): albedo above 0.95"), "{warning}");
    assert!(warning.contains("albedo_max = 1"), "{warning}");
    let (g, warnings) = write(&format!("[bake]\nalbedo_max = 0.25\n{object}"));
    assert!(red(&g) == 0.25 && warnings.len() == 1);
    let (g, warnings) = write(&format!("[bake]\nalbedo_max = 1\n{object}"));
    assert!(red(&g) > 0.99 && warnings.is_empty(), "{warnings:?}");
    let (g, warnings) = write(&format!("{object}albedo = 0.97\n"));
    assert!(red(&g) > 0.969 && warnings.is_empty(), "{warnings:?}");
}

#[test]
fn warnings_of_one_kind_are_one_line_and_come_with_errors_too() {
    let folder = tempfile::tempdir().unwrap();
    // Four problems: a texture lost by each of 500 materials, a volume, a white material, lines.
    let asset = square();
    let lost = json!({ "name": "m", "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
        "extensions": { "KHR_materials_transmission": { "transmissionFactor": 0.5 }, "KHR_materials_volume": {} } });
    let materials: Vec<Value> = (0..500).map(|_| lost.clone()).chain([json!({ "name": "white" })]).collect();
    let part = |material: usize| json!({ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": material });
    let parts: Vec<Value> =
        (0..501).map(part).chain([json!({ "attributes": { "POSITION": 0 }, "mode": 1 })]).collect();
    let asset = with(
        asset,
        &[
            ("/images/0", json!({ "uri": "lost.png" })),
            ("/materials", json!(materials)),
            ("/meshes/0/primitives", json!(parts)),
        ],
    );
    fs::write(folder.path().join("a.gltf"), asset.to_string()).unwrap();
    let text = "[[object]]\nfile = \"a.gltf\"\n";
    let tell = |text: &str| {
        fs::write(folder.path().join("scene.toml"), text).unwrap();
        let (scene, _) = scene::load(&folder.path().join("scene.toml")).unwrap();
        let mut warnings = Vec::new();
        let loaded = geometry::load_with(&scene, &mut warnings);
        (loaded, warnings)
    };
    let (loaded, warnings) = tell(text);
    assert!(loaded.is_ok());
    // (One is of 500 equal meshes in one place, of which eight stay.)
    assert_eq!(warnings.len(), 5, "{warnings:#?}");
    for expected in [
        "500 materials (m (there is no file lost.png",
        "500 materials (m, m, m, m, m, …): KHR_materials_volume",
        "1 primitive: points and lines",
        "1 material of files (a.gltf: white)",
    ] {
        assert!(warnings.iter().any(|w| w.contains(expected)), "{expected}: {warnings:#?}");
    }
    // Errors of two objects are told together, and the warnings with them.
    fs::write(folder.path().join("b.gltf"), "{}").unwrap();
    let wrong = "[[object.part]]\nname = \"nobody\"\nalbedo = 0.5\n[[object]]\nfile = \"b.gltf\"\n";
    let (loaded, warnings) = tell(&format!("{text}{wrong}"));
    // (One is of 500 equal meshes in one place, of which eight stay.)
    assert_eq!(warnings.len(), 5, "{warnings:#?}");
    let error = loaded.unwrap_err().to_string();
    assert!(error.contains("2 errors") && error.contains("nobody") && error.contains("b.gltf"), "{error}");
}

#[test]
fn hostile_assets_give_errors_that_say_where() {
    let folder = tempfile::tempdir().unwrap();
    let nan = replaced(16, &f32::NAN.to_le_bytes());
    let uv_nan = replaced(52, &f32::NAN.to_le_bytes());
    let cases: Vec<(&str, Value, &str)> = vec![
        ("/buffers/0/uri", json!(nan), "square, primitive 0: vertex 1: position"),
        ("/buffers/0/uri", json!(uv_nan), "square, primitive 0: vertex 0: texture coordinate"),
        ("/buffers/0/uri", json!(replaced(82, &[9])), "a triangle names vertex 9: expected an index below 4"),
        ("/buffers/0/uri", json!("nothing.bin"), "buffer 0: there is no file nothing.bin"),
        ("/buffers/0/uri", json!("https://example.org/a.bin"), "expected a file beside the asset"),
        ("/buffers/0/uri", json!("data:;base64,@@"), "buffer 0: a data URI is not base64"),
        ("/buffers/0", json!({ "byteLength": 200 }), "the file no BIN chunk"),
        ("/buffers/0/byteLength", json!(1u64 << 40), "buffer 0: "),
        ("/accessors/2/count", json!(5), "5 indices: expected a multiple of 3"),
        ("/accessors/2/count", json!(1u64 << 62), "accessor 2: "),
        ("/accessors/0/count", json!(400), "accessor 0: it ends outside its buffer"),
        ("/accessors/0/type", json!("VEC2"), "accessor 0: Vec2, expected 3 components"),
        ("/accessors/1/count", json!(3), "3 texture coordinates for 4 positions"),
        ("/accessors/2/componentType", json!(5126), "primitive 0: accessor 2: "),
        ("/bufferViews/0/byteOffset", json!(u64::MAX / 2), "accessor 0: it ends outside its buffer"),
        (
            "/accessors/0/sparse",
            json!({ "count": 1, "indices": { "bufferView": 2, "byteOffset": 5, "componentType": 5121 },
            "values": { "bufferView": 0, "byteOffset": 40 } }),
            "accessor 0: its sparse part ends outside",
        ),
        ("/meshes/0/primitives/0/attributes", json!({ "TEXCOORD_0": 1 }), "POSITION"),
        ("/meshes/0/primitives/0/indices", json!(7), "meshes[0].primitives[0].indices"),
        ("/nodes", json!([{ "children": [1] }, { "children": [0], "mesh": 0 }]), "the node has two parents"),
        ("/nodes/0/translation", json!([1e39, 0, 0]), ""),
        ("/nodes/0/rotation", json!([0, 0, 0, 0]), "sheet: its transform: expected finite numbers"),
        (
            "/materials/0/pbrMetallicRoughness/baseColorFactor",
            json!([2, 0, 0, 1]),
            "material leaf: baseColorFactor = [2.0, 0.0, 0.0]: expected numbers from 0 to 1",
        ),
        ("/extensionsRequired", json!(["KHR_draco_mesh_compression"]), "requires KHR_draco_mesh_compression"),
        ("/asset", json!({}), "not glTF 2.0"),
        ("/scenes/0/nodes", json!([]), "expected at least one triangle"),
    ];
    for (pointer, value, expected) in cases {
        let asset = with(square(), &[(pointer, value)]);
        match load(folder.path(), &asset) {
            Ok(_) => panic!("{pointer} was accepted; expected: {expected}"),
            Err(e) => {
                let message = e.to_string();
                assert!(
                    message.contains(expected) && message.contains("a.gltf"),
                    "{pointer}: {expected}\ngot: {message}"
                );
            }
        }
    }
}

#[test]
fn glbs_load_and_torn_ones_do_not() {
    let folder = tempfile::tempdir().unwrap();
    let asset = square();
    let uri = asset["buffers"][0]["uri"].as_str().unwrap();
    let mut binary =
        base64::engine::general_purpose::STANDARD.decode(uri.split_once(',').unwrap().1).unwrap();
    let length = binary.len();
    binary.resize(length.next_multiple_of(4), 0);
    let mut text = with(asset, &[("/buffers/0", json!({ "byteLength": length }))]).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let glb = [
        b"glTF",
        &word(2)[..],
        &word(28 + text.len() + binary.len()),
        &word(text.len()),
        b"JSON",
        &text,
        &word(binary.len()),
        b"BIN\0",
        &binary,
    ]
    .concat();
    let path = folder.path().join("a.glb");
    let scene_path = folder.path().join("scene.toml");
    fs::write(&path, &glb).unwrap();
    fs::write(&scene_path, "[[object]]\nfile = \"a.glb\"\n").unwrap();
    let (scene, _) = scene::load(&scene_path).unwrap();
    let (g, _) = geometry::load(&scene).unwrap();
    assert_eq!((g.triangles.len(), g.textures.len()), (2, 1));
    // Every prefix is refused.
    for length in (0..glb.len()).step_by(7) {
        fs::write(&path, &glb[..length]).unwrap();
        assert!(geometry::load(&scene).is_err(), "{length} bytes were accepted");
    }
    // A byte changed anywhere in the headers or the JSON gives an error or a scene, never a panic.
    for at in 0..20 + text.len() {
        let mut bytes = glb.clone();
        bytes[at] ^= 0x15;
        fs::write(&path, &bytes).unwrap();
        let _ = geometry::load(&scene);
    }
}
