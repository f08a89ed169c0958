//! Meshes as they are found in the wild, from a file and a few lines of TOML to a bundle: slivers, ten thousand tiny charts, and a
//! compressed file with instances and vertex colours.

use baker::bake::options::Preset;
use baker::bake::run::{Options, bake};
use baker::light::schedule::parse_hours;
use compressor::compress;
use compressor::decode::Decoder;
use dataset::console::{Console, ConsoleArgs};
use dataset::store::Dataset;

fn bake_and_compress(mesh: &str, size: u32, warning: Option<&str>) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("mesh.glb"), generate::generate(mesh).unwrap().glb).unwrap();
    let scene = dir.path().join("stress.toml");
    let text = format!(
        "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"mesh.glb\"\n[lightmap]\nsize = {size}\n"
    );
    std::fs::write(&scene, text).unwrap();
    let out = dir.path().join("out");
    let console = Console::new(ConsoleArgs { quiet: true, json: false, threads: None });
    let options = Options {
        out: Some(out.clone()),
        preset: Preset::Draft,
        samples: Some(2),
        ..Options::new(parse_hours("12").unwrap())
    };
    let outcome = bake(&scene, &options, &console).unwrap();
    match warning {
        Some(part) => assert!(outcome.warnings.iter().any(|w| w.contains(part)), "{:?}", outcome.warnings),
        None => assert!(outcome.warnings.is_empty(), "{:?}", outcome.warnings),
    }
    let dataset = Dataset::open(&out).unwrap();
    let faults = dataset.verify(|| {}).faults;
    assert!(faults.is_empty(), "{faults:?}");
    let (map, mask) = (dataset.map(0, 0).unwrap(), dataset.mask(0).unwrap());
    assert!(mask.count() > 0);
    assert!(map.texels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    let options = compress::Options { iterations: 50, ..Default::default() };
    compress::compress(&out, &options, &console).unwrap();
    let bundle =
        Decoder::open(&out.join("out.ndgi")).or_else(|_| Decoder::open(&out.join("stress.ndgi"))).unwrap();
    assert!(bundle.sample(0, 0.5, 0.5, 12.0).unwrap().iter().all(|v| v.is_finite()));
}

#[test]
fn slivers() {
    bake_and_compress("slivers", 512, None);
}

#[test]
fn ten_thousand_tiny_charts() {
    bake_and_compress("charts", 512, None);
}

#[test]
fn more_charts_than_the_page_has_blocks() {
    bake_and_compress("charts", 64, Some("lie on each other"));
}

#[test]
fn compressed_instances_with_coloured_vertices() {
    bake_and_compress("packed", 128, None);
}
