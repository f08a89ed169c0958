//! Glass under a sky and what shines in geometry files: goldens of each, and beside them a scene that says
//! the same in other words.

use super::{OF_TEXELS, golden_pair};
use crate::Stage;
use crate::scenes::{Case, Obj, shell};
use crate::statistics::bakes;
use baker::bake::run::Integrator;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::{ImageFormat, Rgb, RgbImage};
use serde_json::{Value, json};
use std::io::Cursor;

/// The samples of a bake by paths, as many as those of a golden's reference.
const SAMPLES: u32 = 64;

/// A case by paths must have the light of the golden's reference, texel by texel.
#[track_caller]
fn expect_same(golden: &Case, twin: &Case, name: &str, scale: [f64; 3], bound: f64) {
    let [reference, _] = golden_pair(golden, name, bound);
    let twin = bakes(twin, 501, SAMPLES, |o| o.integrator = Integrator::Path).scaled(scale);
    reference.expect_texels_of(&twin, &format!("{name}, said otherwise"));
}

#[test]
fn a_pane_under_a_sky_dims_by_its_transmittance() {
    // A shaft whose lid reflects nothing: all light comes in through it once, and what goes out stays out.
    let shaft = || {
        let shaft = Obj::default().mesh("floor").floor([-1.0, 0.0, -1.0], 2.0, 2.0).mesh("walls");
        let shaft = shaft
            .quad([-1.0, 0.0, -1.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0])
            .quad([1.0, 0.0, 1.0], [-2.0, 0.0, 0.0], [0.0, 1.0, 0.0])
            .quad([-1.0, 0.0, 1.0], [0.0, 0.0, -2.0], [0.0, 1.0, 0.0])
            .quad([1.0, 0.0, -1.0], [0.0, 0.0, 2.0], [0.0, 1.0, 0.0]);
        let lid = Obj::default().mesh("lid").floor([-1.0, 1.0, -1.0], 2.0, 2.0);
        Stage::new(&[("shaft.obj", shaft.bytes()), ("lid.obj", lid.bytes())])
    };
    let case = |lid: &str| Case {
        stage: shaft(),
        text: format!(
            "[place]\nlatitude = 48.0\nlongitude = 16.0\nutc_offset = 1.0\ndate = 2026-06-21\n\
             [sky]\nmodel = \"hosek-wilkie\"\n[[object]]\nfile = \"shaft.obj\"\nalbedo = 0.6\n{lid}\
             [lightmap]\nsize = 40\n"
        ),
        hours: "12",
    };
    // (Without texels, so that both have the same page.)
    let lid =
        "[[object]]\nfile = \"lid.obj\"\nlightmap = false\nalbedo = 0\ntransmission = [0.7, 0.6, 0.4]\n";
    expect_same(&case(lid), &case(""), "glass lid", [0.7, 0.6, 0.4], OF_TEXELS);
}

/// The room with a panel of 80 × 80 cm under its ceiling, which looks down and emits what `material` says and
/// the picture shows.
fn screen_room(material: &str, picture: impl Fn(u32, u32) -> u8) -> Case {
    let [floor, walls] = shell();
    let panel = Obj::default().line("mtllib panel.mtl").mesh("panel").line("usemtl screen");
    let panel = panel.quad([-0.4, 1.8, -0.4], [0.8, 0.0, 0.0], [0.0, 0.0, 0.8]);
    let mut png = Cursor::new(Vec::new());
    let grey = |x: u32, y: u32| Rgb([picture(x, y); 3]);
    RgbImage::from_fn(8, 8, grey).write_to(&mut png, ImageFormat::Png).expect("a PNG");
    let text = "[[object]]\nfile = \"floor.obj\"\nalbedo = [0.7, 0.6, 0.5]\n\
        [[object]]\nfile = \"walls.obj\"\nalbedo = [0.7, 0.6, 0.5]\n\
        [[object]]\nfile = \"panel.obj\"\nlightmap = false\n[lightmap]\nsize = 40\n";
    let files = [
        ("floor.obj", floor.bytes()),
        ("walls.obj", walls.bytes()),
        ("panel.obj", panel.bytes()),
        ("panel.mtl", format!("newmtl screen\nKd 0 0 0\n{material}\n").into_bytes()),
        ("panel.png", png.into_inner()),
    ];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

#[test]
fn an_emissive_texture_shines_where_it_is_bright() {
    // A bright corner of one in sixteen, the rest dark grey.
    let corner = |x: u32, y: u32| if x < 2 && y < 2 { 255 } else { 60 };
    golden_pair(&screen_room("Ke 9 8 7\nmap_Ke panel.png", corner), "screen", OF_TEXELS);
}

#[test]
fn an_emissive_texture_of_one_colour_is_that_colour() {
    // sRGB 188 is 0.502886.
    let textured = screen_room("Ke 9 8 7\nmap_Ke panel.png", |_, _| 188);
    expect_same(&textured, &screen_room("Ke 9 8 7", |_, _| 0), "grey screen", [0.502_886_5; 3], OF_TEXELS);
}

/// A glTF of a speck far below the room with lamps in the room and a directional light from its window.
fn lamps() -> Vec<u8> {
    let corners: [[f32; 3]; 3] = [[0.0, -9.0, 0.0], [0.1, -9.0, 0.0], [0.0, -9.0, -0.1]];
    let bytes: Vec<u8> = corners.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&bytes));
    let lamp = |index: usize| json!({ "KHR_lights_punctual": { "light": index } });
    // A light shines along −Z of its node; turned by −90° about X, down.
    let down = json!([-(0.5f64.sqrt()), 0, 0, 0.5f64.sqrt()]);
    let root: Value = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2, 3] }],
        "nodes": [
            { "mesh": 0 },
            { "name": "bulb", "translation": [-0.5, 1.4, 0.2], "extensions": lamp(0) },
            { "name": "spot", "translation": [0.4, 1.7, -0.3], "rotation": down, "extensions": lamp(1) },
            { "name": "sun", "extensions": lamp(2) },
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "buffers": [{ "byteLength": bytes.len(), "uri": uri }],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [0, -9, -0.1], "max": [0.1, -9, 0] }],
        "extensions": { "KHR_lights_punctual": { "lights": [
            { "type": "point", "color": [1, 0.8, 0.6], "intensity": 500 },
            { "type": "spot", "color": [0.6, 0.8, 1], "intensity": 2000,
              "spot": { "innerConeAngle": 0.3, "outerConeAngle": 0.6 } },
            { "type": "directional", "color": [1, 1, 0.9], "intensity": 20000 },
        ] } },
    });
    root.to_string().into_bytes()
}

#[test]
fn lamps_of_a_gltf_are_those_of_the_scene_file() {
    let room = |text: &str| {
        let [floor, walls] = shell();
        let text = format!(
            "{text}[[object]]\nfile = \"floor.obj\"\nalbedo = [0.7, 0.6, 0.5]\n\
             [[object]]\nfile = \"walls.obj\"\nalbedo = [0.7, 0.6, 0.5]\n[lightmap]\nsize = 40\n"
        );
        let files = [("floor.obj", floor.bytes()), ("walls.obj", walls.bytes()), ("lamps.gltf", lamps())];
        Case { stage: Stage::new(&files), text, hours: "12" }
    };
    // (The window is towards +Z, from where an unturned directional light comes.)
    let in_file = room("[[object]]\nfile = \"lamps.gltf\"\nlightmap = false\n");
    let written = room(
        "[sun]\ntrack = [{ hour = 0, direction = [0, 0, 1], irradiance = [20, 20, 18] }]\n\
         [[group]]\nname = \"bulb\"\n[[group.point]]\nposition = [-0.5, 1.4, 0.2]\nintensity = [0.5, 0.4, 0.3]\n\
         [[group]]\nname = \"spot\"\n[[group.spot]]\nposition = [0.4, 1.7, -0.3]\ndirection = [0, -1, 0]\n\
         inner = 17.188733853924695\nouter = 34.37746770784939\nintensity = [1.2, 1.6, 2]\n",
    );
    expect_same(&in_file, &written, "lamps of a file", [1.0; 3], OF_TEXELS);
}
