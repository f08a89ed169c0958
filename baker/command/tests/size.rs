//! Time and memory of the command as a user runs it: a page that is all but empty, and scenes of many
//! triangles. That of ten million is run by hand; its time and memory stand in `NUMERICS.md`.

// (Not all helpers are used by every target.)
#[allow(dead_code)]
#[path = "../../tests/common/mod.rs"]
mod common;

use common::mesh::Obj;
use common::{Stage, assert_sane};
use dataset::store::Dataset;
use glam::DVec3;
use std::f64::consts::PI;
use std::process::Command;
use std::time::{Duration, Instant};

/// A terrain of `side`² squares, 4 km across, as glTF binary; its heights lie below −1 m.
fn terrain(side: u32) -> Vec<u8> {
    let vertices = side + 1;
    let mut positions: Vec<u8> = Vec::with_capacity(vertices as usize * vertices as usize * 12);
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for j in 0..vertices {
        for i in 0..vertices {
            let at = |k: u32| (f64::from(k) / f64::from(side) - 0.5) * 4000.0;
            let (x, z) = (at(i), at(j));
            let y = -60.0
                + 30.0 * (x * 0.004).sin() * (z * 0.005).cos()
                + 2.0 * (x * 0.31).sin() * (z * 0.27).sin();
            for (a, v) in [x, y, z].into_iter().enumerate() {
                let v = v as f32;
                (low[a], high[a]) = (low[a].min(v), high[a].max(v));
                positions.extend(v.to_le_bytes());
            }
        }
    }
    let mut indices: Vec<u8> = Vec::with_capacity(side as usize * side as usize * 24);
    for j in 0..side {
        for i in 0..side {
            let v = j * vertices + i;
            for k in [v, v + vertices, v + 1, v + 1, v + vertices, v + vertices + 1] {
                indices.extend(k.to_le_bytes());
            }
        }
    }
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"name":"terrain"}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
"bufferViews":[{{"buffer":0,"byteLength":{p}}},{{"buffer":0,"byteOffset":{p},"byteLength":{i}}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3","min":{low:?},"max":{high:?}}},
{{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}],"buffers":[{{"byteLength":{}}}]}}"#,
        u64::from(vertices) * u64::from(vertices),
        u64::from(side) * u64::from(side) * 6,
        positions.len() + indices.len(),
        p = positions.len(),
        i = indices.len(),
    );
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + positions.len() + indices.len();
    let mut glb = Vec::with_capacity(total);
    let word = |glb: &mut Vec<u8>, w: usize| glb.extend((w as u32).to_le_bytes());
    glb.extend(b"glTF");
    word(&mut glb, 2);
    word(&mut glb, total);
    word(&mut glb, json.len());
    glb.extend(b"JSON");
    glb.extend(&json);
    word(&mut glb, positions.len() + indices.len());
    glb.extend(b"BIN\0");
    glb.extend(&positions);
    glb.extend(&indices);
    glb
}

/// A small floor above a terrain without texels, under sky and sun; wall seconds and bytes.
fn bake_above(side: u32) -> (f64, u64) {
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 10.0).text())]);
    stage.write("terrain.glb", &terrain(side));
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[sun]\n\
                 track = [{ hour = 12, direction = [1, 2, 0.5], irradiance = [10, 10, 10] }]\n[[object]]\nfile = \"a.obj\"\n\
                 [[object]]\nfile = \"terrain.glb\"\nlightmap = false\n[lightmap]\nsize = 128\n[bake]\nsamples = 16\n";
    stage.write("terrain.toml", scene.as_bytes());
    let out = stage.path("terrain");
    let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
    command.arg(stage.path("terrain.toml")).args(["--hours", "12", "--quiet", "--out"]).arg(&out);
    let cost = run_and_watch(&mut command);
    let dataset = Dataset::open(&out).unwrap();
    assert_sane(&dataset);
    let (map, mask) = (dataset.map(0, 0).unwrap(), dataset.mask(0).unwrap());
    // The floor looks away from the terrain: π of the sky and the sun's cosine.
    let expected = std::f64::consts::PI + 10.0 * 2.0 / 5.25f64.sqrt();
    for (texel, _) in map.texels.iter().zip(&mask.valid).filter(|(_, valid)| **valid) {
        assert!((f64::from(texel[1]) / expected - 1.0).abs() < 1e-3, "{texel:?} {expected}");
    }
    cost
}

#[test]
fn a_hundred_thousand_triangles() {
    let (seconds, bytes) = bake_above(224);
    println!("{} triangles: {seconds:.1} s, {:.2} GiB", 224 * 224 * 2, bytes as f64 / f64::from(1 << 30));
}

#[test]
#[ignore = "ten million triangles take minutes and gigabytes"]
fn ten_million_triangles() {
    let (seconds, bytes) = bake_above(2237);
    println!("{} triangles: {seconds:.1} s, {:.2} GiB", 2237 * 2237 * 2, bytes as f64 / f64::from(1 << 30));
    assert!(bytes < 12 << 30, "{bytes}");
}

#[test]
fn an_all_but_empty_page_of_16384_by_256() {
    // One square fills 1.5 % of it. Time and memory are those of the command as a user runs it.
    let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0);
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = [16384, 256]\n[bake]\nsamples = 2\nbounces = 0\n";
    stage.write("wide.toml", scene.as_bytes());
    let out = stage.path("wide");
    let (seconds, bytes) = run_and_watch(
        Command::new(env!("CARGO_BIN_EXE_bake"))
            .arg(stage.path("wide.toml"))
            .args(["--hours", "12", "--quiet", "--out"])
            .arg(&out),
    );
    println!("16384 x 256: {seconds:.1} s, {:.0} MiB", bytes as f64 / f64::from(1 << 20));
    let dataset = Dataset::open(&out).unwrap();
    let mask = dataset.mask(0).unwrap();
    assert_eq!((mask.width, mask.height), (16384, 256));
    assert!(mask.count() > 60_000 && mask.count() < 67_000, "{}", mask.count());
    assert_sane(&dataset);
    let image = dataset.map(0, 0).unwrap();
    let lit = image.texels.iter().zip(&mask.valid).filter(|(_, valid)| **valid);
    assert!(lit.map(|(t, _)| t[1]).all(|v| (f64::from(v) / PI - 1.0).abs() < 1e-5));
    // An image of it is 48 MiB.
    assert!(bytes < 1 << 30 && seconds < 60.0, "{seconds} s, {bytes} bytes");
}

/// Wall seconds of a command, which must succeed, and the most memory it had resident, in bytes.
fn run_and_watch(command: &mut Command) -> (f64, u64) {
    let start = Instant::now();
    let mut child = command.spawn().expect("started");
    let status = format!("/proc/{}/status", child.id());
    let mut most = 0;
    loop {
        if let Ok(text) = std::fs::read_to_string(&status) {
            let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
            let kib = line.and_then(|l| l.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok());
            most = most.max(kib.unwrap_or(0) * 1024);
        }
        if let Some(exit) = child.try_wait().expect("waited for") {
            assert!(exit.success(), "{exit}");
            return (start.elapsed().as_secs_f64(), most);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
