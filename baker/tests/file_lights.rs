//! Light of geometry files and photometric files through the whole pipeline, against closed forms.

// (Not all helpers are used by every target.)
#[allow(dead_code)]
mod common;

use base64::Engine;
use common::mesh::{Obj, png};
use common::{Baked, Stage};
use glam::{DVec3, dvec3};
use serde_json::{Value, json};

/// A black floor of side 1 m around the origin, and what `files` adds.
fn floor(files: &[(&str, Vec<u8>)]) -> Stage {
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())]);
    files.iter().for_each(|(name, bytes)| stage.write(name, bytes));
    stage
}

const BLACK: &str = "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n";
const LAMPS: &str = "[[object]]\nfile = \"lamps.gltf\"\nalbedo = 0\nlightmap = false\n";
const PAGE: &str = "[lightmap]\nsize = 16\n";

/// A glTF of a speck far below the floor, and these nodes with these lights.
fn lamps(nodes: Value, lights: Value) -> Vec<u8> {
    let mut asset: Value = serde_json::from_str(&common::mesh::gltf(
        &[[0.0, -9.0, 0.0], [0.1, -9.0, 0.0], [0.0, -9.0, -0.1]],
        &[[0, 1, 2]],
        None,
        "{}",
    ))
    .unwrap();
    for node in nodes.as_array().unwrap() {
        asset["nodes"].as_array_mut().unwrap().push(node.clone());
    }
    let all: Vec<usize> = (0..asset["nodes"].as_array().unwrap().len()).collect();
    asset["scenes"][0]["nodes"] = json!(all);
    asset["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    asset.to_string().into_bytes()
}

fn light(index: usize) -> Value {
    json!({ "KHR_lights_punctual": { "light": index } })
}

/// I cos θ/d² of a level receiver.
fn from_point(lamp: DVec3, p: DVec3) -> f64 {
    let to = lamp - p;
    to.y / to.length().powi(3)
}

#[test]
fn a_point_lamp_of_a_gltf_gives_its_intensity() {
    let node = json!([{ "name": "lamp", "translation": [0.1, 0.8, -0.2], "scale": [3, 3, 3], "extensions": light(0) }]);
    let stage = floor(&[("lamps.gltf", lamps(node, json!([{ "type": "point", "intensity": 500 }])))]);
    let read = |b: &Baked| {
        // 0.5 kcd × 2.
        let point = |p| from_point(dvec3(0.1, 0.8, -0.2), p);
        b.ratio(&b.group("lamp"), &b.on("floor"), |t| t.average(point))
    };
    stage.measure("12", 16, &format!("[lights]\nscale = 2\n{BLACK}{LAMPS}{PAGE}"), read).expect(1.0, 2e-3);
}

#[test]
fn a_photometric_profile_of_a_gltf_shines_along_its_axis() {
    // The same at all heights, another at each quarter turn: 100 to 400 cd.
    let profile = "IES:LM-63-2019\nTILT=NONE\n1 -1 1 2 5 1 2 0 0 0\n1 1 9\n0 90\n0 90 180 270 360\n\
        100 100\n200 200\n300 300\n400 400\n100 100\n";
    // −Z, the axis, becomes −Y; +X stays, and +Y, the horizontal angle 90°, becomes −Z.
    let node = json!([{ "name": "lamp", "translation": [0, 0.6, 0], "rotation": [-(0.5f64.sqrt()), 0, 0, 0.5f64.sqrt()],
        "extensions": { "EXT_lights_ies": { "light": 0, "multiplier": 0.5, "color": [1, 1, 1] } } }]);
    let mut asset: Value = serde_json::from_slice(&lamps(node, json!([]))).unwrap();
    let uri = base64::engine::general_purpose::STANDARD.encode(profile);
    asset["extensions"] = json!({ "EXT_lights_ies": { "lights": [
        { "uri": format!("data:application/x-ies-lm-63;base64,{uri}") }] } });
    let stage = floor(&[("lamps.gltf", asset.to_string().into_bytes())]);
    let lamp = dvec3(0.0, 0.6, 0.0);
    let kilocandela = |p: DVec3| {
        let turn = (-p.z).atan2(p.x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::FRAC_PI_2;
        let values = [0.1, 0.2, 0.3, 0.4, 0.1];
        let low = (turn as usize).min(3);
        // Half of it, by [lights] three times that.
        1.5 * (values[low] + (values[low + 1] - values[low]) * (turn - low as f64))
    };
    for side in [-1.0, 1.0] {
        let read = |b: &Baked| {
            let texels: Vec<_> = b
                .on("floor")
                .into_iter()
                .filter(|t| t.centre().z * side > 0.1 && t.centre().x > 0.1)
                .collect();
            b.ratio(&b.group("lamp"), &texels, |t| t.average(|p| kilocandela(p) * from_point(lamp, p)))
        };
        stage
            .measure("12", 16, &format!("[lights]\nscale = 3\n{BLACK}{LAMPS}{PAGE}"), read)
            .expect(1.0, 3e-3);
    }
}

#[test]
fn what_a_gltf_hides_neither_shines_nor_shades() {
    let hidden = |rest: Value| {
        let mut node = rest;
        node["extensions"]["KHR_node_visibility"] = json!({ "visible": false });
        node
    };
    // The speck, a hundred times as wide, as a roof.
    let roof = json!({ "name": "roof", "mesh": 0, "scale": [100, 1, 100], "translation": [-2.5, 10, 2.5] });
    let lamp = json!({ "name": "lamp", "translation": [0, 0.5, 0], "extensions": light(0) });
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
    let bake = |nodes: Value| {
        let stage = floor(&[("lamps.gltf", lamps(nodes, json!([{ "type": "point", "intensity": 1000 }])))]);
        stage.bake("12", 16, &format!("{sky}{BLACK}{LAMPS}{PAGE}"))
    };
    let baked = bake(json!([hidden(roof.clone()), hidden(lamp.clone())]));
    assert!(baked.dataset.config.groups.is_empty());
    for texel in baked.on("floor") {
        let light = common::green(&baked.first(), texel);
        assert!((light - std::f64::consts::PI).abs() < 0.02, "{light}");
    }
    assert_eq!(bake(json!([roof, lamp])).dataset.config.groups.len(), 1);
}

#[test]
fn a_spot_of_a_gltf_has_its_cone() {
    let node = json!([{ "name": "spot", "translation": [0, 1, 0],
        "rotation": [-(0.5f64.sqrt()), 0, 0, 0.5f64.sqrt()], "extensions": light(0) }]);
    let spot = json!([{ "type": "spot", "intensity": 1000, "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.45 } }]);
    let stage = floor(&[("lamps.gltf", lamps(node, spot))]);
    let read = |b: &Baked| {
        let at = |p: DVec3| {
            let to = dvec3(0.0, 1.0, 0.0) - p;
            let cosine = to.y / to.length();
            let t = ((cosine - 0.45f64.cos()) / (0.2f64.cos() - 0.45f64.cos())).clamp(0.0, 1.0);
            cosine / to.length_squared() * t * t * (3.0 - 2.0 * t)
        };
        b.ratio(&b.first(), &b.on("floor"), |t| t.average(at))
    };
    stage.measure("12", 64, &format!("{BLACK}{LAMPS}{PAGE}"), read).expect(1.0, 3e-3);
}

#[test]
fn two_lamps_of_ten_to_the_eighth_apart_share_a_group() {
    let node = |name: &str, x: f64, index: usize| json!({ "name": name, "translation": [x, 0.5, 0], "extensions": light(index) });
    let nodes = json!([node("a", -0.2, 0), node("b", 0.3, 1)]);
    let lights = json!([{ "type": "point", "intensity": 1e-3 }, { "type": "point", "intensity": 1e5 }]);
    let stage = floor(&[("lamps.gltf", lamps(nodes, lights))]);
    let read = |b: &Baked| {
        let both =
            |p| 1e-6 * from_point(dvec3(-0.2, 0.5, 0.0), p) + 100.0 * from_point(dvec3(0.3, 0.5, 0.0), p);
        b.ratio(&b.first(), &b.on("floor"), |t| t.average(both))
    };
    let scene = format!("[[group]]\nname = \"file\"\n{BLACK}{LAMPS}{PAGE}");
    stage.measure("12", 16, &scene, read).expect(1.0, 2e-3);
}

/// A square of 40 × 40 cm, 30 cm above the floor, that looks down; u runs along x, v along z.
fn panel(library: &str) -> Vec<u8> {
    let corners =
        [dvec3(-0.2, 0.3, -0.2), dvec3(0.2, 0.3, -0.2), dvec3(0.2, 0.3, 0.2), dvec3(-0.2, 0.3, 0.2)];
    let uvs = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    Obj::default()
        .library(library)
        .mesh("panel")
        .material("screen")
        .textured(&corners, &uvs)
        .text()
        .into_bytes()
}

const PANEL: &str = "[[object]]\nfile = \"panel.obj\"\nalbedo = 0\nlightmap = false\n";

#[test]
fn an_emissive_texture_gives_the_integral_of_its_light() {
    let library = b"newmtl screen\nKd 0 0 0\nKe 2 2 2\nmap_Ke -clamp on m.png\n".to_vec();
    let map = png(&[[255, 255, 255, 255], [0, 0, 0, 255], [0, 0, 0, 255], [188, 188, 188, 255]]);
    let stage = floor(&[("panel.obj", panel("p.mtl")), ("p.mtl", library), ("m.png", map)]);
    // Linear between the middles of its four columns; sRGB 188 is 0.50289.
    let radiance = |u: f64| {
        let columns = [1.0, 0.0, 0.0, 0.502_886_5];
        let x = (4.0 * u - 0.5).clamp(0.0, 3.0);
        let low = (x as usize).min(2);
        2.0 * (columns[low] + (columns[low + 1] - columns[low]) * (x - low as f64))
    };
    let irradiance = |p: DVec3| {
        const N: usize = 40;
        let cell = 0.4 / N as f64;
        let sum: f64 = (0..N * N)
            .map(|i| {
                let (x, z) = ((i % N) as f64 + 0.5, (i / N) as f64 + 0.5);
                let to = dvec3(-0.2 + x * cell, 0.3, -0.2 + z * cell) - p;
                radiance(x / N as f64) * to.y * to.y / to.length_squared().powi(2)
            })
            .sum();
        sum * cell * cell
    };
    let scene = format!("{BLACK}{PANEL}{PAGE}");
    // One side is lit by the bright end, the other by the dim one.
    for side in [-1.0, 1.0] {
        let read = |b: &Baked| {
            let texels: Vec<_> = b.on("floor").into_iter().filter(|t| t.centre().x * side > 0.0).collect();
            b.ratio(&b.group("screen"), &texels, |t| irradiance(t.centre()))
        };
        stage.measure("12", 64, &scene, read).expect(1.0, 5e-3);
    }
}

#[test]
fn a_black_emissive_texture_is_no_light() {
    let library = b"newmtl screen\nKd 0 0 0\nKe 2 2 2\nmap_Ke m.png\n".to_vec();
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
    let bake = |map: &[[u8; 4]], lines: &str| {
        let files = [("panel.obj", panel("p.mtl")), ("p.mtl", library.clone()), ("m.png", png(map))];
        let baked = floor(&files).bake("12", 8, &format!("{sky}{lines}{BLACK}{PANEL}{PAGE}"));
        (baked.dataset.config.groups.len(), baked.first().texels, baked.dataset.config.inputs.clone())
    };
    let black = bake(&[[0, 0, 0, 255], [0, 0, 0, 0]], "");
    let off = bake(&[[255, 255, 255, 255]], "[lights]\nfrom_file = false\n");
    assert!(black.0 == 0 && black == off, "nothing is traced that was not without it");
    assert_eq!(bake(&[[255, 255, 255, 255]], "").0, 1);
}

#[test]
fn a_photometric_file_shines_as_it_says() {
    let ies = |candela: &str| {
        // (1.1 is no factor: the file is of an accredited laboratory.)
        format!("IES:LM-63-2019\nTILT=NONE\n1 1000 1 3 3 1 2 0 0 0\n1 1.1 9\n0 30 60\n0 90 180\n{candela}\n")
            .into_bytes()
    };
    let stage = floor(&[
        ("a.ies", ies("900 500 100\n900 400 80\n900 300 60")),
        ("dark.ies", ies("0 0 0 0 0 0 0 0 0")),
        // Only straight down, fading to nothing at 30°.
        ("needle.ies", ies("900 0 0 900 0 0 900 0 0")),
    ]);
    // Vertical angle and horizontal angle from +X, mirrored at the plane of 0° and 180°.
    let candela = |name: &str, p: DVec3| {
        let out = (p - dvec3(0.0, 0.7, 0.0)).normalize();
        let vertical = (-out.y).acos().to_degrees();
        let horizontal = out.z.abs().atan2(out.x).to_degrees();
        let rows: [[f64; 3]; 3] = match name {
            "a" => [[900.0, 500.0, 100.0], [900.0, 400.0, 80.0], [900.0, 300.0, 60.0]],
            _ => [[900.0, 0.0, 0.0]; 3],
        };
        if vertical > 60.0 {
            return 0.0;
        }
        let (v, h) = (((vertical / 30.0) as usize).min(1), ((horizontal / 90.0) as usize).min(1));
        let (fv, fh) = (vertical / 30.0 - v as f64, horizontal / 90.0 - h as f64);
        let row = |h: usize| rows[h][v] + (rows[h][v + 1] - rows[h][v]) * fv;
        (row(h) + (row(h + 1) - row(h)) * fh) / 1000.0
    };
    for name in ["a", "needle"] {
        let scene = format!(
            "{BLACK}[[group]]\nname = \"lamp\"\n[[group.point]]\nposition = [0, 0.7, 0]\nies = \"{name}.ies\"\nup = [1, 0, 0]\n{PAGE}"
        );
        for side in [-1.0, 1.0] {
            let read = |b: &Baked| {
                let texels: Vec<_> =
                    b.on("floor").into_iter().filter(|t| t.centre().x * side > 0.0).collect();
                let at = |p| candela(name, p) * from_point(dvec3(0.0, 0.7, 0.0), p);
                b.ratio(&b.first(), &texels, |t| t.average(at))
            };
            stage.measure("12", 64, &scene, read).expect(1.0, 5e-3);
        }
    }
    let dark = format!(
        "{BLACK}[[group]]\nname = \"lamp\"\n[[group.point]]\nposition = [0, 0.7, 0]\nies = \"dark.ies\"\nup = [1, 0, 0]\n{PAGE}"
    );
    let baked = stage.bake("12", 4, &dark);
    let told = "case.toml:8: ies = \"dark.ies\": the lamp gives no light";
    assert!(baked.outcome.warnings.iter().any(|w| w.contains(told)), "{:?}", baked.outcome.warnings);
    assert!(baked.first().texels.iter().all(|t| *t == [0.0; 3]));
    let no_up = stage.refusal("12", &dark.replace("up = [1, 0, 0]\n", ""));
    assert!(no_up.contains("case.toml:8") && no_up.contains("expected `up` beside it"), "{no_up}");
}
