//! Light between frames: by curves, visibility and schedules, in Rust and in Python.

mod common;

use common::{python, write_hours};
use dataset::digest::Digest;
use dataset::format::{Config, Curve, Light, Part};
use dataset::image::Image;
use dataset::store::{Dataset, Writer};
use std::fs;
use std::path::Path;
use std::process::Command;

const SIZES: [(usize, usize); 2] = [(20, 9), (3, 2)];
const HOURS: [f64; 4] = [3.0, 12.0, 18.5, 22.0];

/// A day that is brightest at noon. Red is 0 at the first frame, green at the first two; blue stays.
fn curve() -> Curve {
    Curve {
        hours: vec![0.0, 3.0, 12.0, 19.0, 24.0],
        values: vec![[0.0, 1e-6, 1.0], [0.0, 0.0, 1.0], [9.0, 0.0, 1.0], [1.0, 1e-3, 1.0], [0.0, 1e-6, 1.0]],
    }
}

fn write(root: &Path) -> Config {
    let mut config = write_hours(root, &SIZES, 5, &HOURS).unwrap();
    let mut writer = Writer::create(root).unwrap();
    for layer in &mut config.layers {
        if layer.light == Light::Sky || (layer.light, layer.part) == (Light::Sun, Part::Indirect) {
            layer.curve = Some(writer.add("curve", "json", &curve().to_json()).unwrap());
        }
    }
    writer.commit(&config).unwrap();
    config
}

fn image(dataset: &Dataset, light: Light, group: Option<u32>, frame: usize, page: usize) -> Vec<[f32; 3]> {
    dataset.light(light, group, frame, page).unwrap().texels
}

fn assert_close(found: &Image, expected: &[[f64; 3]], what: &str) {
    for (place, (found, expected)) in found.texels.iter().zip(expected).enumerate() {
        for c in 0..3 {
            let error = (f64::from(found[c]) - expected[c]).abs();
            assert!(
                error <= 1e-5 * expected[c].abs() + 1e-6,
                "{what}, texel {place}, {c}: {} {}",
                found[c],
                expected[c]
            );
        }
    }
}

#[test]
fn layers_follow_their_curves_and_groups_their_schedules() {
    let folder = tempfile::tempdir().unwrap();
    let config = write(folder.path());
    let dataset = Dataset::open(folder.path()).unwrap();
    assert!(dataset.verify(|| ()).faults.is_empty());
    let curve = curve();
    // Hour, the frames around it, how far; which groups are on (porch 18 to 6, garden 20 to 23).
    for (hour, before, after, part, on) in [
        (4.5, 0, 1, 1.5 / 9.0, [true, false]),
        (15.0, 1, 2, 3.0 / 6.5, [false, false]),
        (20.25, 2, 3, 0.5, [true, true]),
        (23.0, 3, 0, 0.2, [true, false]),
        (1.0, 3, 0, 0.6, [true, false]),
        (12.0, 1, 2, 0.0, [false, false]),
    ] {
        for (page, size) in SIZES.iter().enumerate() {
            let of_sun = |part| config.layers_of(Light::Sun, None).find(|layer| layer.part == part).unwrap();
            let (direct, indirect) = (of_sun(Part::Direct), of_sun(Part::Indirect));
            let read = |layer: &dataset::format::Layer, frame| {
                let files: Vec<_> = layer.file(frame, page).into_iter().collect();
                dataset.sum_rows(&files, page, 0, size.1).unwrap()
            };
            let of = |frame| {
                (read(direct, frame), read(indirect, frame), image(&dataset, Light::Sky, None, frame, page))
            };
            let ((direct_a, sun_a, sky_a), (direct_b, sun_b, sky_b)) = (of(before), of(after));
            let s = [hour, HOURS[before], HOURS[after]].map(|hour| curve.at(hour));
            let lamps: Vec<_> =
                (0..2).map(|group| image(&dataset, Light::Group, Some(group), 0, page)).collect();
            let expected: Vec<[f64; 3]> = (0..direct_a.len())
                .map(|i| {
                    std::array::from_fn(|c| {
                        let lerp = |a: f64, b: f64| a + (b - a) * part;
                        let value = |texels: &[[f32; 3]]| f64::from(texels[i][c]);
                        let share = |a: &[[f32; 3]], b: &[[f32; 3]]| {
                            let (a, b) = (value(a), value(b));
                            match [s[1][c], s[2][c]] {
                                [0.0, 0.0] => lerp(a, b),
                                [0.0, after] => s[0][c] * b / after,
                                [before, 0.0] => s[0][c] * a / before,
                                [before, after] => s[0][c] * lerp(a / before, b / after),
                            }
                        };
                        let local: f64 =
                            (0..2).filter(|&group| on[group]).map(|group| value(&lamps[group])).sum();
                        lerp(value(&direct_a), value(&direct_b))
                            + share(&sun_a, &sun_b)
                            + share(&sky_a, &sky_b)
                            + local
                    })
                })
                .collect();
            assert_close(
                &dataset.light_at(hour, page).unwrap(),
                &expected,
                &format!("{hour} h, page {page}"),
            );
        }
    }
    let map = dataset.map(2, 0).unwrap().texels.iter().map(|texel| texel.map(f64::from)).collect::<Vec<_>>();
    assert_close(&dataset.light_at(18.5, 0).unwrap(), &map, "a frame");
    for hour in [-0.1, 24.1, f64::NAN] {
        let said = dataset.light_at(hour, 0).unwrap_err().to_string();
        assert!(said.contains("expected 0 to 24"), "{said}");
    }
}

#[test]
fn without_layers_light_is_linear_and_never_crosses_a_switch() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write(folder.path());
    config.layers.clear();
    Writer::create(folder.path()).unwrap().commit(&config).unwrap();
    let dataset = Dataset::open(folder.path()).unwrap();
    let map = |frame| dataset.map(frame, 0).unwrap().texels;
    // Between 3 h (porch) and 12 h (none): the porch is off from 6 h on. 18.5 h has the porch, 22 h both.
    for (hour, frame) in [(5.0, 0), (7.0, 1), (16.0, 1), (18.3, 2), (20.5, 3), (23.5, 0)] {
        assert_eq!(dataset.light_at(hour, 0).unwrap().texels, map(frame), "{hour}");
    }
}

#[test]
fn a_curve_that_is_none_is_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let good = write(folder.path());
    for (bytes, expected) in [
        (&b"{}"[..], "missing field"),
        (b"{\"hours\":[0,24],\"values\":[[1,1,1]]}", "2 hours and 1 values"),
        (b"{\"hours\":[0,23],\"values\":[[1,1,1],[1,1,1]]}", "hours: expected ascending"),
        (b"{\"hours\":[0,24],\"values\":[[1,1,1],[1,-1,1]]}", "value 1"),
        (b"{\"hours\":[0,24],\"values\":[[1,1,1],[1,1e39,1]]}", "number out of range"),
    ] {
        let mut config = good.clone();
        let file = config.layers[2].curve.as_mut().unwrap();
        file.path = "data/other-000000000000.json".to_owned();
        (file.bytes, file.blake3) = (bytes.len() as u64, Digest::of(bytes));
        fs::write(folder.path().join(&file.path), bytes).unwrap();
        fs::write(folder.path().join("config.json"), serde_json::to_vec(&config).unwrap()).unwrap();
        let dataset = Dataset::open(folder.path()).unwrap();
        let faults: Vec<String> = dataset.verify(|| ()).faults.iter().map(ToString::to_string).collect();
        assert!(faults.len() == 1 && faults[0].contains(expected), "{expected}: {faults:?}");
        assert!(dataset.light_at(15.0, 0).unwrap_err().to_string().contains(expected));
    }
}

#[test]
fn a_release_has_curves_beside_their_layers() {
    let folder = tempfile::tempdir().unwrap();
    let (set, out) = (folder.path().join("set"), folder.path().join("release"));
    let config = write(&set);
    let console = dataset::observe::Silent;
    dataset::release::release(std::slice::from_ref(&set), &[], false, &out, &console).unwrap();
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join(dataset::release::MANIFEST)).unwrap()).unwrap();
    let curve = &config.layers[2].curve.as_ref().unwrap().path;
    let holds = |archive: &&serde_json::Value| archive.to_string().contains(curve);
    let archives: Vec<&serde_json::Value> =
        manifest["scenes"][0]["archives"].as_array().unwrap().iter().filter(holds).collect();
    assert!(archives.len() == 1 && archives[0]["holds"] == "sun", "{archives:?}");
    assert!(dataset::release::verify(&out, &console).unwrap().faults.is_empty());
}

#[test]
fn the_reader_in_python_gives_the_same_light() {
    const SCRIPT: &str = "
import sys, numpy as np
sys.path.insert(0, sys.argv[1])
from read_dataset import Dataset
for folder in sys.argv[2:]:
    s = Dataset(folder)
    for hour in (0.5, 4.5, 12, 15, 18.6, 20.25, 23, 24):
        for page in range(len(s.config['pages'])):
            sys.stdout.buffer.write(s.light_at(hour, page).astype(np.float32).tobytes())
";
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let [layers, maps] = ["layers", "maps"].map(|name| folder.path().join(name));
    write(&layers);
    let mut config = write(&maps);
    config.layers.clear();
    Writer::create(&maps).unwrap().commit(&config).unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let [baked, imported] = ["baked", "imported"].map(|name| fixtures.join(name));
    let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("python");
    let mut command = Command::new(python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").args([Path::new("-c"), Path::new(SCRIPT), &reader]);
    let folders = [layers, maps, baked, imported];
    let output = command.args(&folders).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut found =
        output.stdout.chunks_exact(4).map(|bytes| f32::from_ne_bytes(std::array::from_fn(|i| bytes[i])));
    for folder in folders {
        let dataset = Dataset::open(&folder).unwrap();
        for hour in [0.5, 4.5, 12.0, 15.0, 18.6, 20.25, 23.0, 24.0] {
            for page in 0..dataset.config.pages.len() {
                let light = dataset.light_at(hour, page).unwrap();
                for expected in light.texels.into_iter().flatten() {
                    let found = found.next().unwrap();
                    let place = folder.display();
                    assert!(
                        (found - expected).abs() <= 1e-5 * expected + 1e-6,
                        "{place}, {hour} h: {found} {expected}"
                    );
                }
            }
        }
    }
    assert_eq!(found.next(), None);
}
