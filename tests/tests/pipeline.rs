//! The real pipeline in process, on a small scene: geometry → dataset → bundle → light, probed at named
//! places.

use baker::bake::run::{Options, bake};
use baker::light::times::schedule::parse_hours;
use compressor::compress;
use dataset::format::Light;
use dataset::image::{Image, Mask};
use dataset::observe::Silent;
use dataset::release::{release, verify};
use dataset::store::Dataset;
use pipeline_tests::Probe;
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn quiet() -> Silent {
    Silent
}

fn options(hours: &str, out: &Path) -> Options {
    Options { out: Some(out.to_owned()), extra_times: 0, ..Options::new(parse_hours(hours).unwrap()) }
}

/// Everything that breaks a rule of the format.
fn faults(dataset: &Path) -> Vec<String> {
    Dataset::open(dataset).unwrap().verify(|| {}).faults.iter().map(|f| f.to_string()).collect()
}

fn at_hour(dataset: &Dataset, hour: f64) -> Image {
    let set = dataset.config.frames.iter().position(|s| (s.hour - hour).abs() < 1e-9).unwrap();
    dataset.map(set, 0).unwrap()
}

/// What the lamps give at an hour: the sum of the layers of the groups that are on.
fn local(dataset: &Dataset, hour: f64) -> Image {
    let set = dataset.config.frames.iter().find(|s| (s.hour - hour).abs() < 1e-9).unwrap();
    let page = &dataset.config.pages[0];
    let mut sum = Image::black(page.width as usize, page.height as usize);
    for (group, _) in (0..).zip(&set.groups_on).filter(|(_, on)| **on) {
        let layer = dataset.light(Light::Group, Some(group), 0, 0).unwrap();
        for (s, l) in sum.texels.iter_mut().zip(&layer.texels) {
            (0..3).for_each(|c| s[c] += l[c]);
        }
    }
    sum
}

fn mean(image: &Image, mask: &Mask) -> f64 {
    let valid: Vec<_> =
        image.texels.iter().zip(&mask.valid).filter(|(_, v)| **v).map(|(t, _)| t[1]).collect();
    valid.iter().map(|&v| f64::from(v)).sum::<f64>() / valid.len() as f64
}

#[test]
fn a_day_in_the_court() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let outcome = bake(&fixture("court.toml"), &options("0..24", &out), &quiet()).unwrap();
    let dataset = Dataset::open(&out).unwrap();
    assert_eq!(faults(&out), Vec::<String>::new());

    // The hours, and both sides of each switch. 18:00, 6:00 and 22:00 stand as sets and show the lamp off
    // themselves.
    let hours: Vec<f64> = dataset.config.frames.iter().map(|s| s.hour).collect();
    let mut expected: Vec<f64> = (0..24).map(f64::from).collect();
    expected.extend([5.9, 18.1, 20.4, 20.6, 21.9]);
    expected.sort_by(f64::total_cmp);
    assert_eq!(hours, expected);

    let mask = dataset.mask(0).unwrap();
    let below_lamp = Probe::new(&dataset, [2.5, 0.0, 2.5], [0.0, 1.0, 0.0], 0.4);
    let below_sign = Probe::new(&dataset, [-2.5, 0.0, -2.0], [0.0, 1.0, 0.0], 0.4);
    let north_of_crate = Probe::new(&dataset, [-0.5, 0.0, -0.4], [0.0, 1.0, 0.0], 0.15);
    let open_ground = Probe::new(&dataset, [2.5, 0.0, 0.0], [0.0, 1.0, 0.0], 0.4);

    // The lamp jumps within six minutes: on at 18.1 and 5.9, off at 18.0 and 6.0.
    let lamp = 800.0 / 1000.0 / (4.0 * std::f64::consts::PI * 1.5 * 1.5);
    let lit = below_lamp.mean(&at_hour(&dataset, 23.0));
    assert!((0.7..1.6).contains(&(lit / lamp)), "{lit} against Φ/(4πd²) = {lamp}");
    for (hour, on) in [(5.9, true), (6.0, false), (18.0, false), (18.1, true)] {
        let share = below_lamp.mean(&local(&dataset, hour));
        assert!(if on { (share / lit - 1.0).abs() < 0.1 } else { share == 0.0 }, "{share} at {hour}");
    }
    // The sign is red and shines at 20.6, not at 20.4.
    let red = |hour: f64| {
        let image = at_hour(&dataset, hour);
        below_sign.texels.iter().map(|&t| f64::from(image.texels[t][0] - image.texels[t][1])).sum::<f64>()
    };
    assert!(red(20.6) > 2.0 * red(20.4).abs() && red(21.0) > 2.0 * red(22.0).abs());

    // At noon the sun stands in the south: the crate shades the ground north of it, not the open ground.
    let noon = at_hour(&dataset, 12.0);
    assert!(north_of_crate.mean(&noon) < 0.4 * open_ground.mean(&noon));
    assert!((30.0..110.0).contains(&open_ground.mean(&noon)), "{} kilolux at noon", open_ground.mean(&noon));
    // Night is dark, but no set is negative or not finite (checked on reading).
    assert!(mean(&at_hour(&dataset, 1.0), &mask) < 1e-2 * mean(&noon, &mask));
    // The ground beneath the crate lies inside it: invalid, not black-but-valid.
    assert!(outcome.facts.iter().any(|f| f.contains("lying in solids") && !f.starts_with("0 ")));
}

#[test]
fn threads_change_no_byte() {
    let dir = tempfile::tempdir().unwrap();
    let run = |threads: usize| {
        let out = dir.path().join(format!("t{threads}"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            bake(&fixture("court.toml"), &options("10,18,18.1", &out), &quiet()).unwrap();
            let options = compress::Options {
                iterations: 200,
                out: Some(out.join("court.ndgi")),
                ..Default::default()
            };
            compress::compress(&out, &options, &quiet()).unwrap();
        });
        let bundle = std::fs::read(out.join("court.ndgi")).unwrap();
        (std::fs::read(out.join("config.json")).unwrap(), bundle)
    };
    let (one, two) = (run(1), run(2));
    assert!(one.0 == two.0, "config.json differs");
    assert!(one.1 == two.1, "the bundle differs");
}

#[test]
fn a_set_and_its_bundle_are_released_and_another_bakes_bundle_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let (out, other) = (dir.path().join("court"), dir.path().join("other"));
    bake(&fixture("court.toml"), &options("12", &out), &quiet()).unwrap();
    bake(&fixture("court.toml"), &options("13", &other), &quiet()).unwrap();
    let bundle = |of: &Path| {
        let to = Some(out.join("court.ndgi"));
        let options = compress::Options { iterations: 200, out: to, force: true, ..Default::default() };
        compress::compress(of, &options, &quiet()).unwrap();
    };
    let packed =
        |name: &str| release(std::slice::from_ref(&out), &[], false, &dir.path().join(name), &quiet());
    bundle(&out);
    packed("release").unwrap();
    assert!(dir.path().join("release/court.ndgi").exists());
    let faults = verify(&dir.path().join("release"), &quiet()).unwrap().faults;
    assert!(faults.is_empty(), "{faults:?}");
    // What `dataset` reads of a bundle is what `compress` writes there.
    bundle(&other);
    let error = packed("again").unwrap_err().to_string();
    assert!(error.contains("made from different light"), "{error}");
}

#[test]
fn a_second_run_finds_its_work_done() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    assert!(!bake(&fixture("court.toml"), &options("12", &out), &quiet()).unwrap().up_to_date);
    let before = std::fs::read(out.join("config.json")).unwrap();
    assert!(bake(&fixture("court.toml"), &options("12", &out), &quiet()).unwrap().up_to_date);
    // More hours are more work; the folder stays whole.
    let outcome = bake(&fixture("court.toml"), &options("12,13", &out), &quiet()).unwrap();
    assert!(!outcome.up_to_date && outcome.layers.reused > 0, "{:?}", outcome.layers);
    assert_ne!(before, std::fs::read(out.join("config.json")).unwrap());
    assert_eq!(faults(&out), Vec::<String>::new());
}
