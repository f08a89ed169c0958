//! What `compress` writes for people: the scene, a summary, and tables behind their headings.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{Scene, islands};
use dataset::store::{Dataset, Writer};
use serde_json::json;
use std::path::Path;
use std::process::Command;

/// A floor of 3 × 2.8 m whose lightmap coordinates go over the page.
fn floor() -> Vec<u8> {
    let positions = [0f32, 0.0, 0.0, 0.0, 0.0, 2.8, 3.0, 0.0, 2.8, 3.0, 0.0, 0.0];
    let uvs = [0f32, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0];
    let mut binary: Vec<u8> = positions.iter().chain(&uvs).flat_map(|value| value.to_le_bytes()).collect();
    [0u32, 1, 2, 0, 2, 3].iter().for_each(|index| binary.extend(index.to_le_bytes()));
    let root = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "extras": { "lightmapScale": [1, 1], "lightmapOffset": [0, 0], "lightmapPage": 0 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_1": 1 }, "indices": 2 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [3, 0, 2.8] },
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
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let head = [*b"glTF", word(2), word(28 + json.len() + binary.len()), word(json.len()), *b"JSON"].concat();
    [head, json, word(binary.len()).to_vec(), b"BIN\0".to_vec(), binary].concat()
}

/// A page of light with this geometry file, compressed.
fn compressed(geometry: Option<&[u8]>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    // (Where a map is not valid, the bundle may hold anything, and the floor would show it.)
    Scene { valid: |_, _| true, ..islands() }.write(folder.path());
    if let Some(glb) = geometry {
        let mut config = Dataset::open(folder.path()).unwrap().config;
        let mut writer = Writer::create(folder.path()).unwrap();
        config.geometry = Some(writer.add("scene", "glb", glb).unwrap());
        writer.commit(&config).unwrap();
    }
    run(folder.path(), &[".", "--iterations", "600", "--quiet"]);
    folder
}

/// The report of that.
fn report(geometry: Option<&[u8]>) -> String {
    std::fs::read_to_string(compressed(geometry).path().join("isles.html")).unwrap()
}

/// What the command prints.
fn run(folder: &Path, arguments: &[&str]) -> String {
    let output =
        Command::new(env!("CARGO_BIN_EXE_compress")).args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The pictures in a part of a report.
fn pictures(html: &str) -> Vec<image::RgbImage> {
    let parts = html.split("data:image/png;base64,").skip(1).map(|rest| rest.split('"').next().unwrap());
    let decode = |text| image::load_from_memory(&base64::Engine::decode(&BASE64, text).unwrap()).unwrap();
    parts.map(|text| decode(text).into_rgb8()).collect()
}

const BASE64: base64::engine::GeneralPurpose = base64::engine::general_purpose::STANDARD;

#[test]
fn the_scene_comes_first_then_a_summary_then_tables_folded() {
    let html = report(Some(&floor()));
    let (lead, rest) = html.split_once("<nav>").unwrap();
    let (scene, summary) = lead.split_once("<dl>").unwrap();
    // Four hours in the order of a day's events, each the bake above the decoded.
    let captions: Vec<&str> =
        scene.split("<figcaption>").skip(1).map(|rest| rest.split(" h").next().unwrap()).collect();
    assert_eq!(captions, ["6", "12", "18.1", "0"]);
    assert!(scene.contains("Above: baked. Below: decoded from the bundle"));
    let pictures = pictures(scene);
    assert_eq!(pictures.len(), 8);
    let mean_difference = |a: &image::RgbImage, b: &image::RgbImage| {
        let sum: f64 = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
        sum / a.as_raw().len() as f64
    };
    for pair in pictures.chunks(2) {
        let apart = mean_difference(&pair[0], &pair[1]);
        assert!(apart > 0.0 && apart < 3.0, "{apart}");
    }
    assert!(mean_difference(&pictures[0], &pictures[2]) > 3.0, "6 h and 12 h");
    let titles: Vec<&str> =
        summary.split("<dt>").skip(1).map(|rest| rest.split('<').next().unwrap()).collect();
    assert_eq!(titles, ["How good", "How large, how long", "What next"]);
    assert!(summary.contains("PSNR ") && summary.contains("bits per texel and frame"), "{summary}");
    // Everything else is behind its heading.
    assert_eq!(rest.matches("<section").count(), 6);
    assert_eq!(rest.matches("<details>").count(), 6);
    assert!(rest.find("<details>").unwrap() < rest.find("<table>").unwrap());
}

#[test]
fn without_a_geometry_file_pages_are_shown() {
    let html = report(None);
    let (lead, rest) = html.split_once("<nav>").unwrap();
    assert!(!lead.contains("<img") && lead.contains("<dt>How good</dt>") && !lead.contains("bake preview"));
    let (pages, _) = rest.split_once("<details>").unwrap();
    assert!(pages.contains("<h2>Decoded and reference</h2>"));
    assert_eq!(pictures(pages).len(), 12);
}

#[test]
fn a_damaged_geometry_file_costs_its_picture_alone() {
    let html = report(Some(&floor()[..200]));
    let (lead, _) = html.split_once("<nav>").unwrap();
    assert!(
        lead.contains("The scene is not shown: ") && lead.contains("expected a complete GLB file"),
        "{lead}"
    );
    assert!(lead.contains("<dt>How good</dt>") && html.contains("<h2>Decoded and reference</h2>"));
}

#[test]
fn the_summary_begins_with_what_is_seen_and_the_worst_tile_has_its_pictures() {
    let html = report(Some(&floor()));
    let (_, summary) = html.split_once("<dt>How good</dt><dd>").unwrap();
    assert!(summary.starts_with("At ") && summary.contains(" one texel in twenty is off by "), "{summary}");
    let (_, seen) = html.split_once("<h2>What is seen</h2>").unwrap();
    let (seen, _) = seen.split_once("</details>").unwrap();
    assert!(seen.contains("The worst tile") && seen.contains("Δu′v′") && seen.contains("<svg"));
    // Dataset, bundle and difference, of a tile of 128 × 128 texels and two pixels each.
    let pictures = pictures(seen);
    assert_eq!(pictures.iter().map(|picture| picture.dimensions()).collect::<Vec<_>>(), [(256, 256); 3]);
    let mean = |picture: &image::RgbImage| {
        picture.as_raw().iter().map(|&code| f64::from(code)).sum::<f64>() / picture.as_raw().len() as f64
    };
    assert!((mean(&pictures[0]) - mean(&pictures[1])).abs() < 10.0);
    assert!(mean(&pictures[2]) < mean(&pictures[0]));
}

#[test]
fn pictures_of_the_scene_are_compared_at_each_hour() {
    let folder = compressed(Some(&floor()));
    let evaluate = |more: &[&str]| -> serde_json::Value {
        let text = run(folder.path(), &[&["evaluate", ".", "--json", "--quiet"], more].concat());
        serde_json::from_str(&text).unwrap()
    };
    let with = evaluate(&["--flip"]);
    let hours = with["hours"].as_array().unwrap();
    let mut sum = 0.0;
    for hour in hours {
        let [mean, p95, p99] =
            ["scene_flip", "scene_flip_p95", "scene_flip_p99"].map(|key| hour[key].as_f64().unwrap());
        assert!(0.0 < mean && mean < p95 && p95 <= p99 && p99 < 0.5, "{hour}");
        sum += mean;
    }
    assert!((with["scene_flip"].as_f64().unwrap() - sum / hours.len() as f64).abs() < 1e-12);
    let without = evaluate(&[]);
    assert!(without["scene_flip"].is_null() && without["hours"][0]["scene_flip"].is_null());
    // Against itself as the reference the dataset is exact.
    let reference = evaluate(&["--reference", "."]);
    assert_eq!(reference["reference"]["dataset"]["local_error_p99"], 0.0);
    assert_eq!(reference["reference"]["bundle"]["local_error_p95"], without["local_error_p95"]);
}
