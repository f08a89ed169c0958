//! The sun's path, visibility and normals of a dataset: each rule that they can break is named; what they
//! give is light.

mod common;

use common::{Random, python, write_set};
use dataset::digest::Digest;
use dataset::format::tiles::{Rect, TILE, tiles};
use dataset::format::{Config, FileRef, Normals, Planes, SunPath, SunVisibility, visibility};
use dataset::store::{Dataset, MANIFEST, Writer};
use std::fs;
use std::path::Path;
use std::process::Command;

const SIZES: [(usize, usize); 2] = [(150, 20), (3, 2)];
const HOURS: [f64; 3] = [6.0, 12.0, 18.5];

fn path() -> SunPath {
    SunPath {
        hours: vec![6.0, 12.0, 18.5],
        direction: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]],
        irradiance: vec![[10.0, 5.0, 1.0], [100.0, 90.0, 80.0], [0.0; 3]],
    }
}

/// Levels of 0 to 4; the second tile of a page has three channels.
fn levels(tile: usize, texels: usize, random: &mut Random) -> Planes {
    let channels = if tile == 1 { 3 } else { 1 };
    let levels = (0..channels * HOURS.len() * texels).map(|_| random.below(5) as u8).collect();
    Planes { texels, channels, levels }
}

fn normals(width: usize, height: usize, random: &mut Random) -> Normals {
    let mut normal = || [0; 3].map(|_| (random.unit() - 0.5) / 0.87);
    Normals { width, height, normals: (0..width * height).map(|_| normal()).collect() }
}

/// A dataset with a sun of [`path`].
fn write(root: &Path) -> Config {
    let mut config = write_set(root, &SIZES, 7).unwrap();
    let mut writer = Writer::create(root).unwrap();
    let mut random = Random(1);
    let (mut files, mut of_normals) = (Vec::new(), Vec::new());
    for (width, height) in SIZES {
        let mut payload = |(tile, rect): (usize, &Rect)| {
            levels(tile, rect.width() * rect.height(), &mut random).to_payload()
        };
        let payloads: Vec<(Vec<u8>, u32)> =
            tiles(width, height, TILE).iter().enumerate().map(&mut payload).collect();
        let bytes = visibility::to_bytes([width as u32, height as u32], 4, &HOURS, &payloads);
        files.push(writer.add("visibility", "vis", &bytes).unwrap());
        let png = normals(width, height, &mut Random(2)).to_png();
        of_normals.push(writer.add("normals", "png", &png).unwrap());
    }
    config.sun_path = Some(writer.add("sun", "json", &path().to_json()).unwrap());
    config.visibility = Some(SunVisibility { minutes: 15.0, files, normals: of_normals });
    writer.commit(&config).unwrap();
    config
}

/// What opening a dataset with this manifest says.
fn reported(root: &Path, config: &Config) -> String {
    fs::write(root.join(MANIFEST), serde_json::to_vec(config).unwrap()).unwrap();
    Dataset::open(root).map_or_else(|error| error.to_string(), |_| String::new())
}

/// The faults of a dataset one of whose files has this content instead.
fn faults(root: &Path, good: &Config, of: fn(&mut Config) -> &mut FileRef, bytes: &[u8]) -> Vec<String> {
    let mut config = good.clone();
    let file = of(&mut config);
    file.path = "data/other-000000000000.x".to_owned();
    file.bytes = bytes.len() as u64;
    file.blake3 = Digest::of(bytes);
    fs::write(root.join(&file.path), bytes).unwrap();
    assert_eq!(reported(root, &config), "");
    let faults = Dataset::open(root).unwrap().verify(|| ()).faults;
    faults.iter().map(ToString::to_string).collect()
}

#[test]
fn light_is_visibility_times_cosine_times_irradiance() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let dataset = Dataset::open(folder.path()).unwrap();
    assert!(dataset.verify(|| ()).faults.is_empty());
    let mut random = Random(1);
    for (page, (width, height)) in SIZES.into_iter().enumerate() {
        let sunlight = dataset.sunlight(page).unwrap().unwrap();
        let normals = normals(width, height, &mut Random(2));
        let light = [9.0, 12.0].map(|hour| sunlight.at(hour).unwrap());
        for (tile, rect) in tiles(width, height, TILE).into_iter().enumerate() {
            let planes = levels(tile, rect.width() * rect.height(), &mut random);
            for texel in 0..planes.texels {
                let place = (rect.y0 + texel / rect.width()) * width + rect.x0 + texel % rect.width();
                let part = |time: usize| planes.level(texel, time).map(|level| f32::from(level) / 4.0);
                let (morning, noon) = (part(0), part(1));
                let [x, y, _] = normals.normals[place];
                for c in 0..3 {
                    // Half of the way from east to zenith.
                    let (seen, sun) = (0.5 * (morning[c] + noon[c]), [55.0, 47.5, 40.5][c]);
                    let expected = seen * (0.5 * x + 0.5 * y).max(0.0) * sun;
                    let found = light[0].texels[place][c];
                    assert!((found - expected).abs() < 5e-3, "{page} {place} {c}: {found} {expected}");
                    let expected = noon[c] * y.max(0.0) * [100.0, 90.0, 80.0][c];
                    assert!((light[1].texels[place][c] - expected).abs() < 5e-3);
                }
            }
        }
        // Its irradiance at the last time is 0.
        assert!(sunlight.at(18.5).unwrap().texels.iter().all(|texel| *texel == [0.0; 3]));
        let said = sunlight.at(5.9).unwrap_err().to_string();
        assert!(said.contains("hour 5.9; expected 6 to 18.5"), "{said}");
    }
}

#[test]
fn light_between_frames_has_the_suns_by_its_visibility() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write(folder.path());
    let with = Dataset::open(folder.path()).unwrap();
    for hour in [5.9, 18.6] {
        let said = with.light_at(hour, 0).unwrap_err().to_string();
        assert!(said.contains("expected 6 to 18.5"), "{said}");
    }
    let light =
        |dataset: &Dataset| [6.0, 9.3, 12.0, 17.0].map(|hour| dataset.light_at(hour, 0).unwrap().texels);
    let (found, sun) = (light(&with), with.sunlight(0).unwrap().unwrap());
    assert!(!with.mask(0).unwrap().valid[0]);
    // At noon a frame: there the layer's light is what is filled in.
    let (filled, map) = (
        found[2][0],
        with.map(with.config.frames.iter().position(|f| f.hour == 12.0).unwrap(), 0).unwrap().texels[0],
    );
    assert!(
        filled.iter().zip(map).all(|(a, b)| (a - b).abs() <= 1e-5 * b) && map[0] > 0.0,
        "{filled:?} {map:?}"
    );
    // Without the visibility and the layer whose place it takes.
    config.visibility = None;
    let direct = config.layers.iter_mut().find(|layer| layer.is_direct_sun()).unwrap();
    direct.files.iter_mut().flatten().for_each(|file| *file = None);
    assert_eq!(reported(folder.path(), &config), "");
    let without = light(&Dataset::open(folder.path()).unwrap());
    for (place, hour) in [6.0, 9.3, 12.0, 17.0].into_iter().enumerate() {
        let direct = sun.at(hour).unwrap().texels;
        // (The first texel is off the mask.)
        for (i, texel) in direct.iter().enumerate().skip(1) {
            for (c, value) in texel.iter().enumerate() {
                let expected = without[place][i][c] + value;
                assert!(
                    (found[place][i][c] - expected).abs() <= 1e-5 * expected + 1e-6,
                    "{hour} h, texel {i}"
                );
            }
        }
    }
}

#[test]
fn every_rule_that_the_manifest_breaks_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let good = write(folder.path());
    assert_eq!(reported(folder.path(), &good), "");
    type Change = fn(&mut Config);
    fn of(config: &mut Config) -> &mut SunVisibility {
        config.visibility.as_mut().unwrap()
    }
    let changes: [(Change, &str); 6] = [
        (
            |c| {
                c.sun = None;
                c.layers.clear();
            },
            "sun_path: expected none where sun is null",
        ),
        (|c| c.sun_path = None, "visibility without sun_path; expected both or neither"),
        (|c| of(c).minutes = 0.0, "minutes is 0; expected a number above 0"),
        (|c| drop(of(c).files.pop()), "visibility: files for 1 page; expected 2"),
        (|c| of(c).normals.clear(), "visibility: normals for 0 pages; expected 2"),
        (|c| of(c).files[1].path = "../x".to_owned(), "expected one inside the dataset's folder"),
    ];
    for (change, expected) in changes {
        let mut config = good.clone();
        change(&mut config);
        let said = reported(folder.path(), &config);
        assert!(said.contains(expected), "{expected}: {said:?}");
    }
}

#[test]
fn files_that_do_not_fit_are_faults() {
    let folder = tempfile::tempdir().unwrap();
    let good = write(folder.path());
    let at = |file: &FileRef| fs::read(folder.path().join(&file.path)).unwrap();
    let of_good = good.visibility.as_ref().unwrap();
    let (first, second) = (at(&of_good.files[0]), at(&of_good.files[1]));
    let expect = |of: fn(&mut Config) -> &mut FileRef, bytes: &[u8], expected: &str| {
        let faults = faults(folder.path(), &good, of, bytes);
        assert!(faults.iter().any(|fault| fault.contains(expected)), "{expected}: {faults:?}");
    };
    let visibility: fn(&mut Config) -> &mut FileRef = |c| &mut c.visibility.as_mut().unwrap().files[0];
    let normals: fn(&mut Config) -> &mut FileRef = |c| &mut c.visibility.as_mut().unwrap().normals[1];
    let sun: fn(&mut Config) -> &mut FileRef = |c| c.sun_path.as_mut().unwrap();
    expect(visibility, &second, "size 3×2; the page has 150×20");
    expect(visibility, &first[..first.len() - 1], "by the lengths of its tiles");
    let mut torn = first.clone();
    *torn.last_mut().unwrap() ^= 1;
    expect(visibility, &torn, "tile at texel (128, 0)");
    expect(normals, &at(&of_good.normals[0]), "size 150×20; the page has 3×2");
    expect(normals, b"PNG", "damaged PNG file");
    expect(sun, b"{}", "missing field");
    let short = SunPath { hours: vec![6.0, 12.0, 18.0], ..path() };
    expect(sun, &short.to_json(), "time 18.5 h; expected a time of the sun's path");
}

#[test]
fn a_release_has_them_with_the_lightmaps() {
    let folder = tempfile::tempdir().unwrap();
    let (set, out) = (folder.path().join("set"), folder.path().join("release"));
    let config = write(&set);
    let console = dataset::observe::Silent;
    dataset::release::release(std::slice::from_ref(&set), &[], false, &out, &console).unwrap();
    let manifest = fs::read_to_string(out.join(dataset::release::MANIFEST)).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let archives = manifest["scenes"][0]["archives"].as_array().unwrap();
    let frames = archives.iter().find(|archive| archive["holds"] == "sets").unwrap().to_string();
    let of_config = config.visibility.as_ref().unwrap();
    for file in of_config.references().chain(&config.sun_path) {
        assert!(frames.contains(&file.path), "{}", file.path);
    }
    assert!(dataset::release::verify(&out, &console).unwrap().faults.is_empty());
}

#[test]
fn the_reader_in_python_gives_the_same_light() {
    const SCRIPT: &str = "
import sys, numpy as np
sys.path.insert(0, sys.argv[1])
from read_dataset import Dataset
s = Dataset(sys.argv[2])
for hour in (9.3, 12, 18.5):
    for page in (0, 1):
        sys.stdout.buffer.write(s.sun_direct(hour, page).astype(np.float32).tobytes())
for light in (s.sun_direct, s.light_at):
    try:
        light(5.9)
        sys.exit('no error at 5.9 h')
    except ValueError as problem:
        assert 'expected 6' in str(problem), problem
";
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("python");
    let mut command = Command::new(python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").args([
        Path::new("-c"),
        Path::new(SCRIPT),
        &reader,
        folder.path(),
    ]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut found =
        output.stdout.chunks_exact(4).map(|bytes| f32::from_ne_bytes(std::array::from_fn(|i| bytes[i])));
    let dataset = Dataset::open(folder.path()).unwrap();
    for hour in [9.3, 12.0, 18.5] {
        for page in 0..SIZES.len() {
            let light = dataset.sunlight(page).unwrap().unwrap().at(hour).unwrap();
            for expected in light.texels.into_iter().flatten() {
                let found = found.next().unwrap();
                assert!((found - expected).abs() <= 1e-5 * 100.0, "{hour} h: {found} {expected}");
            }
        }
    }
    assert_eq!(found.next(), None);
}
