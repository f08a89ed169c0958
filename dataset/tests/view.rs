//! A scene seen through its geometry file alone.

use dataset::format::{Config, FORMAT, Frame, Page, VERSION};
use dataset::image::{Image, Mask};
use dataset::pictures::{View, tone};
use dataset::store::{Dataset, Writer};
use serde_json::{Value, json};
use std::f32::consts::PI;
use std::path::Path;

/// Side of the page in texels, and of pictures in pixels.
const SIDE: usize = 8;
const PIXELS: usize = 16;

/// A floor of 2 × 2 m about zero whose lightmap coordinates go over the page from north-west to south-east,
/// and above its north-east quarter, at half a metre, a shelf without texels. Both are white.
fn floor_and_shelf() -> Value {
    let place = json!({ "lightmapScale": [1, 1], "lightmapOffset": [0, 0], "lightmapPage": 0 });
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [
            { "name": "floor", "mesh": 0, "extras": place },
            { "name": "shelf", "mesh": 1, "translation": [0.5, 0.5, -0.5], "scale": [0.5, 1, 0.5] },
        ],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 1] } }],
        "meshes": [
            { "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_1": 1 }, "indices": 2, "material": 0 }] },
            { "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 2, "material": 0 }] },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1] },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5125, "count": 6, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 24 },
        ],
        "buffers": [{ "byteLength": 104 }],
    })
}

fn glb(root: &Value) -> Vec<u8> {
    let positions = [-1f32, 0.0, -1.0, -1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0, -1.0];
    let uvs = [0f32, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0];
    let mut binary: Vec<u8> = positions.iter().chain(&uvs).flat_map(|value| value.to_le_bytes()).collect();
    [0u32, 1, 2, 0, 2, 3].iter().for_each(|index| binary.extend(index.to_le_bytes()));
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let head = [*b"glTF", word(2), word(28 + json.len() + binary.len()), word(json.len()), *b"JSON"].concat();
    [head, json, word(binary.len()).to_vec(), b"BIN\0".to_vec(), binary].concat()
}

/// Writes a dataset of this geometry file and first camera, if any.
fn write(root: &Path, glb: Option<&[u8]>, camera: Option<Value>) -> Dataset {
    let mut writer = Writer::create(root).unwrap();
    let mask = Mask { width: SIDE, height: SIDE, valid: vec![true; SIDE * SIDE] };
    let mask = writer.add("mask", "png", &mask.to_png()).unwrap();
    let map = writer.add("map", "exr", &light(|_, _| 1.0).to_exr()).unwrap();
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        instances: Vec::new(),
        scene: "floor".to_owned(),
        generator: "test".to_owned(),
        unit: "arbitrary".to_owned(),
        seed: 1,
        inputs: "0".repeat(64),
        samples: 1,
        pages: vec![Page::atlas(SIDE as u32, SIDE as u32, mask)],
        sun: None,
        sky: None,
        groups: Vec::new(),
        layers: Vec::new(),
        frames: vec![Frame { hour: 12.0, groups_on: Vec::new(), relative_error: None, maps: vec![map] }],
        noise: None,
        geometry: glb.map(|glb| writer.add("scene", "glb", glb).unwrap()),
        settings: camera.map_or(json!({}), |camera| json!({ "cameras": [camera] })),
        source: None,
        sun_path: None,
        visibility: None,
        transfer: None,
    };
    writer.commit(&config).unwrap();
    Dataset::open(root).unwrap()
}

/// Irradiance of π times a value at each texel.
fn light(value: impl Fn(usize, usize) -> f32) -> Image {
    let texels = (0..SIDE * SIDE).map(|i| [PI * value(i % SIDE, i / SIDE); 3]).collect();
    Image { width: SIDE, height: SIDE, texels }
}

fn camera(position: [f64; 3], look_at: [f64; 3]) -> Option<Value> {
    Some(json!({ "name": "c", "position": position, "look_at": look_at, "fov": 60.0 }))
}

fn view(root: &Value, camera: Option<Value>) -> dataset::Result<Option<View>> {
    let folder = tempfile::tempdir().unwrap();
    View::of(&write(folder.path(), Some(&glb(root)), camera), [PIXELS; 2])
}

/// The green codes of a picture, row by row, at exposure 0.
fn codes(view: &View, image: &Image) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let config = write(folder.path(), None, None).config;
    let rows = |rows: std::ops::Range<usize>| Image {
        width: SIDE,
        height: rows.len(),
        texels: image.texels[rows.start * SIDE..rows.end * SIDE].to_vec(),
    };
    let light = view.light(&config, |_, range| Ok(rows(range))).unwrap();
    let picture = image::load_from_memory(&view.to_png(&light, 0.0)).unwrap().into_rgb8();
    picture.pixels().map(|pixel| pixel.0[1]).collect()
}

#[test]
fn texels_show_where_they_lie() {
    // From 2 m above, ±1.1547 m are seen: a pixel is 0.1443 m, a texel 0.25.
    let view = view(&floor_and_shelf(), camera([0.0, 2.0, 0.0], [0.0; 3])).unwrap().unwrap();
    assert_eq!(view.camera.name, "c");
    let gradient = codes(&view, &light(|x, y| 0.02 * x as f32 + 0.05 * y as f32));
    for (column, row) in [(2, 2), (3, 12), (12, 12), (8, 9), (5, 7)] {
        let place =
            |k: usize| ((k as f32 + 0.5) / PIXELS as f32 * 2.0 - 1.0) * 2.0 * 30f32.to_radians().tan();
        // Texel centres stand at halves; a linear map is met exactly between them.
        let texel = |k: usize| ((place(k) + 1.0) / 2.0 * SIDE as f32 - 0.5).clamp(0.0, SIDE as f32 - 1.0);
        let expected = tone::code(0.02 * texel(column) + 0.05 * texel(row));
        let found = gradient[row * PIXELS + column];
        assert!(found.abs_diff(expected) <= 1, "({column}, {row}): {found}, expected {expected}");
    }
    // The corner is sky; the shelf has no texels, and gets the median light of what has some in view,
    // whatever lies below it.
    let shares = view.with_texels();
    assert_eq!((shares[0], shares[3 * PIXELS + 12], shares[12 * PIXELS + 3]), (0.0, 0.0, 1.0));
    let lit = codes(&view, &light(|_, _| 0.3));
    let shadowed = codes(&view, &light(|x, y| if x >= 4 && y < 4 { 0.0 } else { 0.3 }));
    assert_eq!(lit[3 * PIXELS + 12], tone::code(0.3));
    assert!(shadowed[3 * PIXELS + 12] > tone::code(0.2));
    assert_eq!(lit[0], shadowed[0]);
}

#[test]
fn what_moves_is_not_drawn() {
    for (shelf, above, is_drawn) in [
        (json!(null), json!(null), true),
        (json!(true), json!(null), false),
        (json!(null), json!(true), false),
        (json!(false), json!(true), true),
    ] {
        let mut root = floor_and_shelf();
        root["nodes"][1]["extras"] = json!({ "movable": shelf });
        root["nodes"]
            .as_array_mut()
            .unwrap()
            .push(json!({ "children": [1], "extras": { "movable": above } }));
        root["scenes"][0]["nodes"] = json!([0, 2]);
        let view = view(&root, camera([0.0, 2.0, 0.0], [0.0; 3])).unwrap().unwrap();
        // The shelf hides texels of the floor.
        assert_eq!(view.with_texels()[3 * PIXELS + 12], if is_drawn { 0.0 } else { 1.0 }, "{shelf} {above}");
    }
}

#[test]
fn what_reaches_behind_the_camera_is_cut_off() {
    // Half a metre above the floor's middle, level: the horizon is the middle row, and its edge lies a metre
    // ahead.
    let view = view(&floor_and_shelf(), camera([-0.5, 0.5, 0.0], [-0.5, 0.5, -1.0])).unwrap().unwrap();
    let shares = view.with_texels();
    let row = |y: usize| shares[y * PIXELS + 4];
    // Half a metre down over a metre ahead: 0.5 ÷ tan 30° of the half height.
    let edge = (8.0 + 0.5 / 30f32.to_radians().tan() * 8.0).ceil() as usize;
    assert!((0..edge - 1).all(|y| row(y) == 0.0) && (edge..PIXELS).all(|y| row(y) == 1.0), "{shares:?}");
}

#[test]
fn backs_are_not_drawn_and_a_picture_of_nothing_is_none() {
    // A camera that sees no texels is passed over: from below there is nothing, or backs without any.
    let mut two_sided = floor_and_shelf();
    two_sided["materials"][0]["doubleSided"] = json!(true);
    for root in [floor_and_shelf(), two_sided] {
        let seen = view(&root, camera([0.0, -2.0, 0.0], [0.0; 3])).unwrap().unwrap();
        assert_eq!(seen.camera.name, "default");
    }
    // A mirrored node keeps its front.
    let mut mirrored = floor_and_shelf();
    mirrored["nodes"][0]["scale"] = json!([-1, 1, 1]);
    assert!(view(&mirrored, camera([0.0, 2.0, 0.0], [0.0; 3])).unwrap().is_some());
    // Nothing has texels; no geometry file.
    let mut plain = floor_and_shelf();
    plain["nodes"][0].as_object_mut().unwrap().remove("extras");
    assert!(view(&plain, camera([0.0, 2.0, 0.0], [0.0; 3])).unwrap().is_none());
    let folder = tempfile::tempdir().unwrap();
    assert!(View::of(&write(folder.path(), None, None), [PIXELS; 2]).unwrap().is_none());
}

#[test]
fn holes_show_what_is_behind_them_and_panes_are_omitted() {
    let from_above = || camera([0.0, 2.0, 0.0], [0.0; 3]);
    for change in [
        json!({ "alphaMode": "MASK", "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.3] } }),
        json!({ "extensions": { "KHR_materials_transmission": { "transmissionFactor": 0.9 } } }),
    ] {
        let mut root = floor_and_shelf();
        root["materials"].as_array_mut().unwrap().push(change.clone());
        root["meshes"][1]["primitives"][0]["material"] = json!(1);
        let shares = view(&root, from_above()).unwrap().unwrap().with_texels();
        assert_eq!(shares[4 * PIXELS + 11], 1.0, "{change}");
    }
}

#[test]
fn a_camera_is_found_where_none_is_known() {
    let own = view(&floor_and_shelf(), None).unwrap().unwrap();
    assert_eq!(own.camera.name, "default");
    assert!(own.with_texels().iter().sum::<f32>() > 20.0);
    // A node's, a metre and a half above the floor and looking down.
    let mut root = floor_and_shelf();
    root["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 1.2, "znear": 0.1 } }]);
    let half = 0.5f64.sqrt();
    root["nodes"].as_array_mut().unwrap().push(
        json!({ "name": "from above", "camera": 0, "translation": [0, 1.5, 0], "rotation": [-half, 0, 0, half] }),
    );
    root["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let camera = view(&root, None).unwrap().unwrap().camera;
    assert_eq!(camera.name, "from above");
    assert!((camera.look_at - camera.position).normalize().y < -0.999, "{camera:?}");
    // One of the manifest goes before it; one that looks nowhere is none.
    for (of_manifest, expected) in [([0.0, 2.0, 0.0], "c"), ([0.0; 3], "from above")] {
        let seen = view(&root, self::camera(of_manifest, [0.0; 3])).unwrap().unwrap();
        assert_eq!(seen.camera.name, expected);
    }
}

#[test]
fn damaged_files_are_errors() {
    let from_above = || camera([0.0, 2.0, 0.0], [0.0; 3]);
    let refused = |change: &dyn Fn(&mut Value)| {
        let mut root = floor_and_shelf();
        change(&mut root);
        view(&root, from_above()).map(|_| ()).unwrap_err().to_string()
    };
    assert!(
        refused(&|root| root["accessors"][0]["count"] = json!(5)).contains("ends outside its buffer view")
    );
    assert!(
        refused(&|root| root["nodes"][0]["extras"]["lightmapPage"] = json!(7)).contains("lightmapPage is 7")
    );
    assert!(refused(&|root| root["buffers"][0]["byteLength"] = json!(4000)).contains("expected one buffer"));
    let folder = tempfile::tempdir().unwrap();
    let dataset = write(folder.path(), Some(b"no file of geometry"), from_above());
    assert!(View::of(&dataset, [PIXELS; 2]).is_err());
    // A node that is its own child ends, as does one with numbers that overflow.
    let mut root = floor_and_shelf();
    root["nodes"][0]["children"] = json!([0, 1]);
    root["nodes"][1]["scale"] = json!([1e38, 1e38, 1e38]);
    let _ = view(&root, from_above());
}
