//! Meshes as they are found in the wild, from a file and a few lines of TOML to a bundle: slivers, ten thousand tiny charts, and a
//! compressed file with instances and vertex colours. And what many copies of a scene cost, counted in rays.

use baker::bake::options::Preset;
use baker::bake::run::{Integrator, Options, bake, prepare};
use baker::light::schedule::parse_hours;
use compressor::compress;
use compressor::decode::Decoder;
use dataset::console::{Console, ConsoleArgs};
use dataset::store::Dataset;
use std::path::{Path, PathBuf};

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

/// Copies of the yard on a page, as a scene of their own in a folder.
fn yards(folder: &Path, copies: usize, size: u32) -> PathBuf {
    let big = generate::big("yard", copies, size).unwrap();
    std::fs::write(folder.join("yard.glb"), &big.glb).unwrap();
    let scene = folder.join(format!("yards-{copies}.toml"));
    std::fs::write(&scene, &big.toml).unwrap();
    scene
}

#[test]
fn the_search_for_hidden_faces_does_not_grow_with_copies() {
    let dir = tempfile::tempdir().unwrap();
    let rays = |copies: usize, size: u32| {
        // Texels of the same length, so that faces are looked at as closely.
        let scene = yards(dir.path(), copies, size);
        let prepared =
            prepare(&scene, &Options::new(parse_hours("12").unwrap()), &Console::silent()).unwrap();
        let (atlas, looking) = prepared.atlas().unwrap();
        assert_eq!(prepared.geometry.triangles.len() % copies, 0);
        (looking.inside, atlas.skipped.triangles / copies)
    };
    let (one, nine) = (rays(1, 256), rays(9, 768));
    // Faces that all copies hide are looked at in each.
    assert!(one.0 > 100_000 && nine.0 < 4 * one.0, "{one:?} {nine:?}");
    assert!(one.1 > 500 && nine.1.abs_diff(one.1) < one.1 / 20, "{one:?} {nine:?}");
}

#[test]
fn few_rays_tell_which_texels_are_surface() {
    let dir = tempfile::tempdir().unwrap();
    let scene = yards(dir.path(), 4, 512);
    let options = Options {
        out: Some(dir.path().join("out")),
        samples: Some(2),
        integrator: Integrator::Path,
        ..Options::new(parse_hours("12").unwrap())
    };
    let looking = prepare(&scene, &options, &Console::silent()).unwrap().atlas().unwrap().1;
    let outcome = bake(&scene, &options, &Console::silent()).unwrap();
    let per_texel = (outcome.rays.inside - looking.inside) as f64 / outcome.texels as f64;
    // With every point of every texel asked by itself there were 65.
    assert!(outcome.texels > 50_000 && per_texel < 45.0, "{per_texel} rays, {} texels", outcome.texels);
}
