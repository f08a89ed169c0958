//! Meshes as they are found in the wild, from a file and a few lines of TOML to a bundle: slivers, ten
//! thousand tiny charts, a compressed file with instances and vertex colours, glass, and what shines. And
//! what many copies of a scene cost, counted in rays.

use baker::bake::prepare::Preset;
use baker::bake::run::{Denoise, Integrator, Options, bake, prepare};
use baker::light::times::schedule::parse_hours;
use compressor::compress;
use compressor::decode::Decoder;
use dataset::format::Light;
use dataset::observe::Silent;
use dataset::store::Dataset;
use pipeline_tests::Probe;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Bakes and compresses a stress scene under an even sky; warnings must be none, or some of which one holds
/// `warning`.
fn bake_and_compress(mesh: &str, size: u32, warning: Option<&str>) {
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
    bake_and_compress_under(sky, mesh, [size, 2], warning);
}

/// The same under any light, with this size of page and these samples. Gives the dataset and the folder it
/// lies in.
fn bake_and_compress_under(
    light: &str,
    mesh: &str,
    [size, samples]: [u32; 2],
    warning: Option<&str>,
) -> (Dataset, TempDir) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("mesh.glb"), models::generate(mesh).unwrap().glb).unwrap();
    let scene = dir.path().join("stress.toml");
    let text = format!("{light}[[object]]\nfile = \"mesh.glb\"\n[lightmap]\nsize = {size}\n");
    std::fs::write(&scene, text).unwrap();
    let out = dir.path().join("out");
    let console = Silent;
    let options = Options {
        out: Some(out.clone()),
        preset: Preset::Draft,
        samples: Some(samples),
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
    (dataset, dir)
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

/// What noise and the size of texels may do to the mean over some hundred texels of 64 samples, relative to
/// it: each sample's light has a standard deviation of about its mean, so a ratio of two such means one of 2
/// %, and ten deviations never happen.
const NOISE: f64 = 0.1;

#[test]
fn bays_behind_glass_have_what_it_lets_through() {
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
    let (dataset, _dir) = bake_and_compress_under(sky, "glass", [256, 64], None);
    let map = dataset.map(0, 0).unwrap();
    let floor = |bay: f32| {
        let probe = Probe::new(&dataset, [1.1 * bay, 0.0, 0.1], [0.0, 1.0, 0.0], 0.25);
        assert!(probe.texels.len() > 20, "{} texels", probe.texels.len());
        probe.mean(&map)
    };
    let open = floor(0.0);
    // Tinted: the mean of its channels. Blended: what its alpha leaves. The body: two faces.
    for (bay, expected) in [(1.0, (0.8 + 0.5 + 0.2) / 3.0), (2.0, 1.0 - 0.7), (3.0, 0.8 * 0.8)] {
        let found = floor(bay) / open;
        assert!((found / expected - 1.0).abs() < NOISE, "bay {bay}: {found}, expected {expected}");
    }
}

#[test]
fn what_shines_in_a_file_lights_what_is_near_it() {
    let (dataset, _dir) = bake_and_compress_under("", "glow", [256, 64], Some("lit all day"));
    let names: Vec<&str> = dataset.config.groups.iter().map(|group| group.name.as_str()).collect();
    assert_eq!(names.len(), 4, "{names:?}");
    let at = |group: &str, x: f32, z: f32| {
        let group = names.iter().position(|name| *name == group).expect("the group");
        let probe = Probe::new(&dataset, [x, 0.0, z], [0.0, 1.0, 0.0], 0.2);
        probe.mean(&dataset.light(Light::Group, Some(group as u32), 0, 0).unwrap())
    };
    // In front of the screen's bright side and of its dark one, which has 1/128 of that light.
    let (bright, dark) = (at("screen", 0.5, -0.6), at("screen", 1.5, -0.6));
    assert!(bright > 2.0 * dark && dark > 0.0, "{bright} {dark}");
    assert!(at("sign", -3.0, -2.5) > 10.0 * at("sign", 3.0, 3.0));
    // Under the bulb I / h² = 0.4 kcd / 4 m², a little of it as reflections of the screen; under the spot 0.9
    // / 4, and beside its cone nothing but reflections.
    let (bulb, spot) = (at("bulb", -2.0, 2.0), at("spot", 2.5, 2.5));
    assert!((bulb / 0.1 - 1.0).abs() < NOISE && (spot / 0.225 - 1.0).abs() < NOISE, "{bulb} {spot}");
    assert!(at("spot", -2.0, 2.0) < 0.01 * spot);
    // The directional light is the sun, 5 klx on level ground.
    let probe = Probe::new(&dataset, [-1.0, 0.0, 3.0], [0.0, 1.0, 0.0], 0.2);
    let sun = probe.mean(&dataset.light(Light::Sun, None, 0, 0).unwrap());
    assert!((sun / 5.0 - 1.0).abs() < NOISE, "{sun}");
}

/// Copies of the yard on a page, as a scene of their own in a folder.
fn yards(folder: &Path, copies: usize, size: u32) -> PathBuf {
    let yard = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/yard.glb");
    std::fs::copy(yard, folder.join("yard.glb")).unwrap();
    let scene = folder.join(format!("yards-{copies}.toml"));
    std::fs::write(&scene, models::big::scene("yard.glb", copies, size)).unwrap();
    scene
}

#[test]
fn the_search_for_hidden_faces_does_not_grow_with_copies() {
    let dir = tempfile::tempdir().unwrap();
    let rays = |copies: usize, size: u32| {
        // Texels of the same length, so that faces are looked at as closely.
        let scene = yards(dir.path(), copies, size);
        let prepared = prepare(&scene, &Options::new(parse_hours("12").unwrap()), &Silent).unwrap();
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
        // (Which has rays of its own.)
        denoise: Denoise::Off,
        ..Options::new(parse_hours("12").unwrap())
    };
    let looking = prepare(&scene, &options, &Silent).unwrap().atlas().unwrap().1;
    let outcome = bake(&scene, &options, &Silent).unwrap();
    let per_texel = (outcome.rays.inside - looking.inside) as f64 / outcome.texels as f64;
    // With every point of every texel asked by itself there were 65.
    assert!(outcome.texels > 50_000 && per_texel < 45.0, "{per_texel} rays, {} texels", outcome.texels);
}
