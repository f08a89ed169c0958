//! The example `play` of `ndgi-stream` on a small scene: baked, compressed, and walked through on whatever
//! device there is.
//!
//! `NDGI_PLAY` is the example's path; without it this test says that it was skipped.

use baker::bake::run::{Options, bake};
use baker::light::times::schedule::parse_hours;
use compressor::compress;
use dataset::observe::Silent;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

#[test]
fn a_walk_through_a_small_scene_shows_what_the_decoded_pages_do() {
    let Some(play) = std::env::var_os("NDGI_PLAY") else {
        println!("skipped: NDGI_PLAY is not set");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/court.toml");
    let options = Options {
        out: Some(root.clone()),
        extra_times: 0,
        ..Options::new(parse_hours("6,10,11,18,20").unwrap())
    };
    bake(&scene, &options, &Silent).unwrap();
    let options = compress::Options { iterations: 300, ..Default::default() };
    compress::compress(&root, &options, &Silent).unwrap();
    let out = folder.path().join("play");
    let run = Command::new(play)
        .arg(&root)
        .args([
            "--scenario",
            "all",
            "--seconds",
            "1.5",
            "--copies",
            "3",
            "--size",
            "128x72",
            "--every",
            "5",
            "--out",
        ])
        .arg(&out)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found: Value = serde_json::from_slice(&std::fs::read(out.join("play.json")).unwrap()).unwrap();
    let scenarios = found["scenarios"].as_object().unwrap();
    assert_eq!(scenarios.len(), 8);
    for (name, of) in scenarios {
        let number = |path: &str| of.pointer(path).and_then(Value::as_f64).unwrap_or(f64::NAN);
        assert!(number("/psnr/min") >= 40.0, "{name}: {of}");
        assert!(number("/hits_by_pixels") >= 0.98, "{name}: {of}");
        assert_eq!(number("/unlit_pixels"), 0.0, "{name}: {of}");
        // A picture that is one colour would agree with itself.
        let picture = image::open(out.join(format!("{name}-0010.png"))).unwrap().into_rgb8();
        let mut codes: Vec<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
        codes.sort_unstable();
        codes.dedup();
        assert!(codes.len() > 50, "{name}: {} colours", codes.len());
    }
    let html = std::fs::read_to_string(out.join("play.html")).unwrap();
    assert!(html.contains("<svg") && html.contains("time-lapse"));
    for (name, of) in scenarios {
        let psnr = of["psnr"]["min"].as_f64().unwrap();
        assert!(html.contains(&format!(" / {psnr:.1}<td>")), "{name}: {psnr}");
    }
}
