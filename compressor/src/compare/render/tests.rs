//! A floor lit by a day and a lamp: methods that are exact are seen to be, and others are not.

use super::super::method::Coded;
use super::super::table::Row;
use super::super::{Effort, Options};
use super::*;
use dataset::format::{Baked, Config, FORMAT, Frame, Group, Page, VERSION};
use dataset::observe::Silent;
use dataset::store::Writer;
use serde_json::{Value, json};
use std::path::Path;

/// Side of the page in texels.
const SIDE: usize = 16;
const HOURS: [f64; 8] = [0.0, 5.9, 6.0, 8.0, 12.0, 18.0, 18.1, 20.0];

/// A floor of 2 × 2 m whose lightmap coordinates go over the page.
fn floor() -> Vec<u8> {
    let place = json!({ "lightmapScale": [1, 1], "lightmapOffset": [0, 0], "lightmapPage": 0 });
    let root = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "floor", "mesh": 0, "extras": place }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 1] } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_1": 1 }, "indices": 2, "material": 0 }] }],
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
    });
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

/// On from 18 to 6, off at both ends.
fn lamp_is_on(hour: f64) -> bool {
    !(6.0..=18.0).contains(&hour)
}

/// A slope by day, a warm corner under the lamp.
fn light(hour: f64) -> Image {
    let day = (1.0 - ((hour - 12.0) / 7.0).powi(2)).max(0.05) as f32;
    let lamp = if lamp_is_on(hour) { 1.0 } else { 0.0 };
    let texel = |i: usize| {
        let (x, y) = ((i % SIDE) as f32 / SIDE as f32, (i / SIDE) as f32 / SIDE as f32);
        [day * (0.5 + x) + lamp * x * y, day * (0.5 + y) + 0.5 * lamp * x * y, day + 0.2 * lamp * x * y]
    };
    Image { width: SIDE, height: SIDE, texels: (0..SIDE * SIDE).map(texel).collect() }
}

fn write(root: &Path, geometry: Option<&[u8]>, cameras: Value) -> Dataset {
    let mut writer = Writer::create(root).unwrap();
    let mask = Mask { width: SIDE, height: SIDE, valid: (0..SIDE * SIDE).map(|i| i % 11 > 0).collect() };
    let mask = writer.add("mask", "png", &mask.to_png()).unwrap();
    let mut frame = |hour: f64| Frame {
        hour,
        groups_on: vec![lamp_is_on(hour)],
        relative_error: None,
        maps: vec![writer.add(&format!("map-{hour}"), "exr", &light(hour).to_exr()).unwrap()],
    };
    let frames = HOURS.map(&mut frame).to_vec();
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
        groups: vec![Group { name: "lamp".to_owned(), on: vec![[18.0, 6.0]], baked: Baked::All }],
        layers: Vec::new(),
        frames,
        noise: None,
        geometry: geometry.map(|glb| writer.add("scene", "glb", glb).unwrap()),
        settings: json!({ "cameras": cameras }),
        source: None,
        sun_path: None,
        visibility: None,
        transfer: None,
    };
    writer.commit(&config).unwrap();
    Dataset::open(root).unwrap()
}

fn cameras() -> Value {
    let camera = |name: &str, x: f64| json!({ "name": name, "position": [x, 2.0, 2.0], "look_at": [0, 0, 0], "fov": 60.0 });
    json!([camera("left", -1.0), camera("right", 1.0), camera("left", -2.0)])
}

fn options() -> Options {
    Options { tiles: None, effort: Effort::Draft, ablations: false, methods: vec![], render: true, seed: 1 }
}

/// A method that has the light of every frame as `change` leaves it.
fn way(set: &TileSet, change: impl Fn(f64, f32) -> f32) -> Way<'static> {
    let tile = |tile: &super::super::tiles::Tile| {
        let frames = tile.source.frames.iter().zip(HOURS);
        frames.map(|(texels, hour)| texels.iter().map(|t| t.map(|v| change(hour, v))).collect()).collect()
    };
    let decoded = set.tiles.iter().map(tile).collect();
    let coded = Coded { decoded, bits: 8e3, encode_seconds: 0.0, decode_seconds: 0.0, curves: vec![] };
    Way::new(coded, String::new())
}

#[test]
fn exact_light_is_met_and_a_wrong_one_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = write(folder.path(), Some(&floor()), cameras());
    let set = TileSet::load(&dataset, &options()).unwrap();
    let mut stage = Stage::new(&dataset, &set, &Silent).unwrap();
    let row = |method: &str| Row::bare("test", method, 0.5, None);
    stage.show(&row("NDGI M"), &way(&set, |_, v| v)).unwrap();
    // Wrong at noon alone.
    let wrong = |hour: f64, v: f32| if hour == 12.0 { 0.8 * v } else { v };
    stage.show(&row("ASTC 12×12"), &way(&set, wrong)).unwrap();
    stage.show(&row("SVD 4"), &way(&set, |_, v| v)).unwrap();
    // A decoder that has its own light between frames is asked for it.
    let mut own = way(&set, |_, v| v);
    own.at_hour = Some(Box::new(|hour| Ok(vec![light(hour).texels])));
    stage.show(&row("NTC L"), &own).unwrap();
    let images: Vec<Texels> = set.tiles.iter().map(|tile| tile.source.frames[4].clone()).collect();
    let shown = ["NDGI M", "BC7"].map(|method| ShownTiles {
        method: method.to_owned(),
        images: images.iter().map(|image| (image.clone(), Some(50.0))).collect(),
    });
    let mut comparison = Comparison::new(&set, &options());
    let reported = stage.finish(&comparison, &[4], &shown).unwrap();

    // A name twice is one camera; five times.
    assert_eq!(reported.cameras, ["left", "right"]);
    let times: Vec<(f64, Option<usize>)> = reported.times.iter().map(|m| (m.hour, m.frame)).collect();
    assert_eq!(times, [(8.0, Some(3)), (12.0, Some(4)), (20.0, Some(7)), (8.25, None), (18.05, None)]);
    let db = |method: &str, hour: f64| {
        let of = reported.views.iter().filter(|seen| (&*seen.method, seen.hour) == (method, hour));
        let all: Vec<f64> = of.map(|seen| seen.psnr_db).collect();
        assert!(all.is_empty() || all.len() == 2, "{method} at {hour}: {all:?}");
        all.into_iter().reduce(f64::min)
    };
    for (hour, set) in &times {
        let exact = db("NDGI M", *hour).unwrap();
        assert!(exact >= 99.0, "{hour}: {exact}");
        // Uncompressed frames are shown between frames alone.
        assert_eq!(db(FRAMES, *hour).is_some(), set.is_none(), "{hour}");
        let wrong = db("ASTC 12×12", *hour).unwrap();
        let is_off = *hour == 12.0 || *hour == 8.25;
        assert!(if is_off { wrong < 55.0 } else { wrong >= 99.0 }, "{hour}: {wrong}");
    }
    assert!(db("ASTC 12×12", 12.0).unwrap() < 35.0 && db("SVD 4", 12.0).is_none());
    // What is not linear in time differs from what is, a little.
    assert!((30.0..99.0).contains(&db("NTC L", 8.25).unwrap()));

    let line = |method: &str| reported.lapse.iter().find(|line| line.method == method).unwrap();
    for exact in ["NDGI M", FRAMES] {
        assert!(line(exact).error < 1e-6 && line(exact).steps.len() == 48, "{:?}", line(exact));
    }
    let wrong = line("ASTC 12×12");
    assert!(wrong.error > 3e-4 && wrong.relative_error.unwrap() > 0.01, "{wrong:?}");
    assert!((8.0..18.0).contains(&wrong.worst.0), "{wrong:?}");
    // The mean is that of the steps.
    let mean = wrong.steps.iter().map(|(_, error)| error).sum::<f64>() / 48.0;
    assert!((mean - wrong.error).abs() < 1e-12);

    assert_eq!(reported.crops.iter().map(|crop| &*crop.method).collect::<Vec<_>>(), ["NDGI M", "BC7"]);
    assert_eq!(reported.skipped.len(), 1, "{:?}", reported.skipped);
    let html = reported.report(&comparison).to_html();
    // References and three methods at all times, frames at two; a crop's three.
    assert_eq!(html.matches("data:image/png").count(), 2 * (5 * 4 + 2) + 3);
    assert!(html.contains("100.0 dB") && html.contains("<svg") && html.contains("<details>"), "{html}");
    assert!(reported.table().iter().any(|line| line.contains("ASTC 12×12")));
    comparison.rendered = Some(reported);
    let json = serde_json::to_value(&comparison).unwrap();
    assert_eq!(json["rendered"]["views"].as_array().unwrap().len(), 2 * (5 * 3 + 2));
}

#[test]
fn without_cameras_there_is_a_lookout_and_without_geometry_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = write(&folder.path().join("a"), Some(&floor()), json!([]));
    let set = TileSet::load(&dataset, &options()).unwrap();
    let stage = Stage::new(&dataset, &set, &Silent).unwrap();
    assert_eq!(stage.reported.cameras, ["default"]);
    let dataset = write(&folder.path().join("b"), None, cameras());
    let error = Stage::new(&dataset, &set, &Silent).err().unwrap().to_string();
    assert!(error.contains("no geometry file") && error.contains("--render"), "{error}");
}
