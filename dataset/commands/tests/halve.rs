//! Datasets of half the resolution: what their files hold, and that they are datasets like any other.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{Random, share, write_set};
use dataset::Error;
use dataset::format::tiles::{TILE, tiles};
use dataset::format::visibility::{Planes, to_bytes};
use dataset::format::{
    Config, Light, Normals, Part, Source, SunPath, SunVisibility, Transfer, TransferLight, TransferPart,
};
use dataset::halve::{halve, halved_inputs, open};
use dataset::image::{Image, Mask};
use dataset::observe::Silent;
use dataset::store::{Dataset, MANIFEST, Writer};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Odd and even sides, and pages that are one texel wide or high, or one texel.
const SIZES: [(usize, usize); 4] = [(301, 20), (6, 7), (1, 5), (1, 1)];

fn half_of(source: &Path, out: &Path) -> Dataset {
    halve(&Dataset::open(source).unwrap(), out, &Silent).unwrap();
    let half = Dataset::open(out).unwrap();
    let found = half.verify(|| ());
    assert!(found.faults.is_empty(), "{:?}", found.faults);
    half
}

/// The indices of the texels that count for one of the half.
fn counted(mask: &Mask, x: usize, y: usize) -> Vec<usize> {
    let all: Vec<usize> = (2 * y..(2 * y + 2).min(mask.height))
        .flat_map(|y| (2 * x..(2 * x + 2).min(mask.width)).map(move |x| y * mask.width + x))
        .collect();
    let valid: Vec<usize> = all.iter().copied().filter(|&i| mask.valid[i]).collect();
    if valid.is_empty() { all } else { valid }
}

fn expect_mean(mask: &Mask, full: &Image, half: &Image) {
    assert_eq!((half.width, half.height), (full.width.div_ceil(2), full.height.div_ceil(2)));
    for (i, found) in half.texels.iter().enumerate() {
        let counted = counted(mask, i % half.width, i / half.width);
        for c in 0..3 {
            let sum: f64 = counted.iter().map(|&i| f64::from(full.texels[i][c])).sum();
            let expected = sum / counted.len() as f64;
            assert!((f64::from(found[c]) - expected).abs() <= 1e-6 * expected, "texel {i}: {found:?}");
        }
    }
}

#[test]
fn light_is_the_mean_of_valid_texels_in_frames_and_layers() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["full", "half"].map(|name| folder.path().join(name));
    let config = write_set(&source, &SIZES, 3).unwrap();
    let (full, half) = (Dataset::open(&source).unwrap(), half_of(&source, &out));
    for (page, size) in SIZES.into_iter().enumerate() {
        let mask = full.mask(page).unwrap();
        let of_half = half.mask(page).unwrap();
        for (i, valid) in of_half.valid.iter().enumerate() {
            let counted = counted(&mask, i % of_half.width, i / of_half.width);
            assert_eq!(*valid, counted.iter().any(|&i| mask.valid[i]));
        }
        for frame in 0..config.frames.len() {
            expect_mean(&mask, &full.map(frame, page).unwrap(), &half.map(frame, page).unwrap());
        }
        let noon = (Light::Sun, Part::Direct);
        let layer = |set: &Dataset| {
            let mut layers = set.config.layers.iter();
            let layer = layers.find(|layer| (layer.light, layer.part) == noon).unwrap();
            set.image(layer.files[1][page].as_ref().unwrap(), page).unwrap()
        };
        let lit = share((Light::Sun, 0, Part::Direct), 12.0, page, size, 3).unwrap();
        assert_eq!(layer(&full), lit);
        expect_mean(&mask, &lit, &layer(&half));
    }
    // What is not known of means is null; the rest is as it was.
    assert!(half.config.noise.is_none());
    assert!(half.config.frames.iter().all(|frame| frame.relative_error.is_none()));
    assert_eq!(
        (&half.config.scene, half.config.seed, &half.config.groups),
        (&config.scene, 3, &config.groups)
    );
    assert!(
        half.config.generator.starts_with("dataset halve ") && half.config.generator.ends_with(", of test 1")
    );
    assert!(out.join("scene.glb").exists());
}

#[test]
fn the_source_is_recorded_and_equal_sources_give_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let config = write_set(&at("full"), &[(9, 5)], 3).unwrap();
    let (one, again) = (half_of(&at("full"), &at("one")), half_of(&at("full"), &at("again")));
    assert_eq!(one.config, again.config);
    assert_eq!(one.config.inputs, halved_inputs(&config));
    assert_ne!(one.config.inputs, config.inputs);
    let two = half_of(&at("one"), &at("two"));
    let halved = two.config.halved().unwrap();
    assert_eq!(
        (halved.times, halved.inputs, halved.light),
        (2, config.inputs.clone(), config.digest_of_light())
    );
    assert_eq!(two.config.generator, one.config.generator);
    assert_eq!(config.halved(), None);
    // Down to one texel, and that again.
    let mut last = at("two");
    for name in ["three", "four", "five"] {
        half_of(&last, &at(name));
        last = at(name);
    }
    let page = &Dataset::open(&last).unwrap().config.pages[0];
    assert_eq!((page.width, page.height), (1, 1));
    // Another source's half is not believed, nor half of a source that changed.
    assert!(open(&at("one"), &config).is_ok());
    assert!(open(&at("two"), &config).unwrap_err().to_string().contains("not made from the present state"));
    let other = write_set(&at("other"), &[(9, 5)], 4).unwrap();
    assert!(open(&at("one"), &other).is_err());
}

#[test]
fn files_of_equal_content_stay_shared() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["full", "half"].map(|name| folder.path().join(name));
    let mut config = write_set(&source, &[(8, 8), (8, 8)], 3).unwrap();
    // Without layers, frames are halved themselves; all of them are the first.
    config.layers.clear();
    let map = config.frames[0].maps[0].clone();
    config.frames.iter_mut().for_each(|frame| frame.maps = vec![map.clone(); 2]);
    fs::write(source.join(MANIFEST), serde_json::to_vec(&config).unwrap()).unwrap();
    let half = half_of(&source, &out);
    let maps: BTreeSet<&str> =
        half.config.frames.iter().flat_map(|frame| &frame.maps).map(|map| &*map.path).collect();
    assert_eq!(maps.len(), 1, "{maps:?}");
    let mask = Dataset::open(&source).unwrap().mask(0).unwrap();
    expect_mean(&mask, &Dataset::open(&source).unwrap().map(2, 1).unwrap(), &half.map(2, 1).unwrap());
}

#[test]
fn the_largest_light_does_not_overflow() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["full", "half"].map(|name| folder.path().join(name));
    let mut config = write_set(&source, &[(4, 3)], 3).unwrap();
    let mut writer = Writer::create(&source).unwrap();
    let bright = Image { width: 4, height: 3, texels: vec![[f32::MAX, 0.0, 1e-45]; 12] };
    let bright = writer.add("bright", "exr", &bright.to_exr()).unwrap();
    config.layers.clear();
    config.frames.iter_mut().for_each(|frame| frame.maps = vec![bright.clone()]);
    writer.commit(&config).unwrap();
    assert!(half_of(&source, &out).map(0, 0).unwrap().texels.iter().all(|t| *t == [f32::MAX, 0.0, 1e-45]));
}

#[test]
fn a_point_stays_where_it_was_on_pages_of_odd_sides() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["full", "half"].map(|name| folder.path().join(name));
    let mut config = write_set(&source, &[(301, 20)], 3).unwrap();
    let mut writer = Writer::create(&source).unwrap();
    let json = serde_json::json!({
        "asset": { "version": "2.0" },
        "nodes": [
            { "name": "crate", "extras": { "lightmapScale": [0.5, 0.25], "lightmapOffset": [0.0, 0.75], "lightmapPage": 0, "side": "l" } },
            { "name": "sky" },
        ],
    });
    config.geometry = Some(writer.add("scene", "glb", &glb(&json)).unwrap());
    writer.commit(&config).unwrap();
    halve(&Dataset::open(&source).unwrap(), &out, &Silent).unwrap();
    let half = Dataset::open(&out).unwrap();
    let (before, after) = (&config.instances[0], &half.config.instances[0]);
    for uv in [[0.0, 0.0], [1.0, 1.0], [0.3, 0.6]] {
        for (axis, (full, side)) in [(301.0, 151.0), (20.0, 10.0)].into_iter().enumerate() {
            let at =
                |scale: f32, offset: f32, side: f64| (f64::from(scale) * uv[axis] + f64::from(offset)) * side;
            let texel = at(before.scale[axis], before.offset[axis], full);
            let found = at(after.scale[axis], after.offset[axis], side);
            assert!((found - 0.5 * texel).abs() < 1e-4, "axis {axis}: {texel} → {found}");
        }
    }
    // The nodes say the same, and keep what else they say.
    let path = half.path(half.config.geometry.as_ref().unwrap());
    let bytes = fs::read(path).unwrap();
    assert_eq!(bytes, fs::read(out.join("scene.glb")).unwrap());
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let root: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let extras = &root["nodes"][0]["extras"];
    let number = |key: &str, axis: usize| extras[key][axis].as_f64().unwrap() as f32;
    for axis in 0..2 {
        assert_eq!(number("lightmapScale", axis), after.scale[axis]);
        assert_eq!(number("lightmapOffset", axis), after.offset[axis]);
    }
    assert_eq!((&extras["side"], &root["nodes"][1]["name"]), (&"l".into(), &"sky".into()));
}

/// A geometry file of this JSON.
fn glb(json: &serde_json::Value) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let header = [word(2), word(20 + json.len()), word(json.len())].concat();
    [&b"glTF"[..], &header, b"JSON", &json].concat()
}

const HOURS: [f64; 3] = [6.0, 12.0, 18.0];

/// Adds a sun to a dataset of one page: every block of 2×2 texels looks one way, one in four of which is
/// split over two ways. Glass in the second tile.
fn add_sun(root: &Path, config: &mut Config) {
    let (width, height) = (config.pages[0].width as usize, config.pages[0].height as usize);
    let mut random = Random(5);
    let ways = [[0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.8, 0.6]];
    let normals = (0..width * height)
        .map(|i| ways[((i % width) / 2 + (i / width) / 2 + usize::from((i % width) % 8 == 3)) % 3])
        .collect();
    let normals = Normals { width, height, normals };
    let payloads: Vec<(Vec<u8>, u32)> = tiles(width, height, TILE)
        .iter()
        .enumerate()
        .map(|(tile, rect)| {
            let (texels, channels) = (rect.width() * rect.height(), if tile == 1 { 3 } else { 1 });
            let levels = (0..channels * HOURS.len() * texels).map(|_| random.below(9) as u8).collect();
            Planes { texels, channels, levels }.to_payload()
        })
        .collect();
    let path = SunPath {
        hours: vec![5.0, 12.0, 19.0],
        direction: vec![[0.6, 0.2, 0.3], [0.0, 1.0, 0.0], [0.3, 0.2, 0.6]],
        irradiance: vec![[10.0, 5.0, 1.0], [100.0, 90.0, 80.0], [10.0, 5.0, 1.0]],
    };
    let mut writer = Writer::create(root).unwrap();
    let bytes = to_bytes([width as u32, height as u32], 8, &HOURS, &payloads);
    let files = vec![writer.add("visibility-0", "vis", &bytes).unwrap()];
    let normals = vec![writer.add("normals-0", "png", &normals.to_png()).unwrap()];
    config.sun_path = Some(writer.add("sun", "json", &path.to_json()).unwrap());
    config.visibility = Some(SunVisibility { minutes: 15.0, files, normals });
    writer.commit(config).unwrap();
}

#[test]
fn the_suns_light_by_visibility_is_the_mean_of_what_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["full", "half"].map(|name| folder.path().join(name));
    let mut config = write_set(&source, &[(301, 139)], 3).unwrap();
    add_sun(&source, &mut config);
    let (full, half) = (Dataset::open(&source).unwrap(), half_of(&source, &out));
    let mask = full.mask(0).unwrap();
    let [before, after] = [&full, &half].map(|set| set.sunlight(0).unwrap().unwrap());
    assert_eq!((after.visibility.size, after.visibility.top), ([151, 70], 32));
    assert_eq!((&after.visibility.hours, &after.path), (&before.visibility.hours, &before.path));
    for hour in HOURS {
        let (light, found) = (before.at(hour).unwrap(), after.at(hour).unwrap());
        let (_, irradiance) = before.path.at(hour).unwrap();
        for (i, texel) in found.texels.iter().enumerate() {
            let counted = counted(&mask, i % found.width, i / found.width);
            for c in 0..3 {
                let sum: f32 = counted.iter().map(|&i| light.texels[i][c]).sum();
                let error = (texel[c] - sum / counted.len() as f32).abs();
                // Half a level, and the normals' own rounding.
                assert!(error <= irradiance[c] * (0.5 / 32.0 + 1e-3), "{hour} h, texel {i}: {error}");
            }
        }
    }
    let mean: Vec<usize> = counted(&mask, 1, 0);
    let length = |normal: [f32; 3]| normal.iter().map(|x| x * x).sum::<f32>().sqrt();
    assert_eq!(mean.len(), 4);
    assert!(length(after.normals.normals[1]) < 0.99, "a block that looks two ways");
    assert!(length(after.normals.normals[0]) > 0.999, "one that looks one way");
}

#[test]
fn what_cannot_be_halved_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["full", "half"].map(|name| folder.path().join(name));
    let config = write_set(&source, &[(20, 20)], 3).unwrap();
    let reported = || halve(&Dataset::open(&source).unwrap(), &out, &Silent).unwrap_err().to_string();

    // A file whose content changed; one that is torn is told when the dataset is opened.
    for file in [
        &config.frames[2].maps[0],
        config.layers[0].files[1][0].as_ref().unwrap(),
        config.geometry.as_ref().unwrap(),
    ] {
        let path = source.join(&file.path);
        let good = fs::read(&path).unwrap();
        let mut bad = good.clone();
        *bad.last_mut().unwrap() ^= 1;
        fs::write(&path, bad).unwrap();
        // Lightmaps are summed anew, so that only their layers are read.
        if file != &config.frames[2].maps[0] {
            let error = reported();
            assert!(error.contains(&file.path), "{error}");
        }
        fs::write(&path, good).unwrap();
    }

    let mut transfer = config.clone();
    let part = |function| TransferPart { function, negative: false };
    let light = vec![TransferLight { hour: 12.0, coefficients: vec![[1.0; 3]; 3] }];
    let parts = vec![part(0), part(1), part(2)];
    transfer.transfer = Some(Transfer { scene: "yard".into(), inputs: "none".into(), parts, light });
    fs::write(source.join(MANIFEST), serde_json::to_vec(&transfer).unwrap()).unwrap();
    let error = halve(&Dataset::open(&source).unwrap(), &out, &Silent).unwrap_err();
    assert!(
        matches!(error, Error::Unsupported { .. }) && error.to_string().contains("transfer of \"yard\""),
        "{error}"
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    fs::write(source.join(MANIFEST), serde_json::to_vec(&config).unwrap()).unwrap();

    fs::create_dir(&out).unwrap();
    fs::write(out.join("mine"), b"x").unwrap();
    assert!(reported().contains("stands there already"));
    assert_eq!(fs::read_dir(&out).unwrap().count(), 1);
}

#[test]
fn an_imported_dataset_keeps_its_source_without_the_layouts_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["full", "half"].map(|name| folder.path().join(name));
    let mut config = write_set(&source, &[(7, 6)], 3).unwrap();
    config.layers.retain(|layer| layer.light != Light::Group);
    // The rule of imported datasets: lamps of all groups are one layer, black here.
    config.frames.iter_mut().for_each(|frame| frame.groups_on.clear());
    config.groups.clear();
    config.frames.truncate(2);
    config.layers.iter_mut().for_each(|layer| layer.files.truncate(2));
    // Light at noon is that of sun and sky; at midnight lamps would be missing from the sum.
    config.frames.remove(0);
    config.layers.iter_mut().for_each(|layer| drop(layer.files.remove(0)));
    let mut writer = Writer::create(&source).unwrap();
    let reported = writer.add("source", "json", b"{}").unwrap();
    config.source = Some(Source { layout: "hprc2".to_owned(), config: Some(reported), replaced_values: 3 });
    config.noise = None;
    writer.commit(&config).unwrap();
    let half = half_of(&source, &out);
    let of_half = half.config.source.as_ref().unwrap();
    assert_eq!((&*of_half.layout, &of_half.config, of_half.replaced_values), ("hprc2", &None, 3));
    let full = Dataset::open(&source).unwrap();
    expect_mean(&full.mask(0).unwrap(), &full.map(0, 0).unwrap(), &half.map(0, 0).unwrap());
}

#[test]
fn the_command_makes_a_level_and_names_it() {
    let folder = tempfile::tempdir().unwrap();
    write_set(&folder.path().join("full"), &[(20, 9), (7, 3)], 3).unwrap();
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_dataset"))
            .args(arguments)
            .current_dir(folder.path())
            .output()
            .unwrap()
    };
    let json = |bytes: &[u8]| -> serde_json::Value { serde_json::from_slice(bytes).unwrap() };
    let output = run(&["halve", "full", "--out", "half", "--json"]);
    assert!(output.status.success(), "{output:?}");
    let object = json(&output.stdout);
    assert_eq!((&object["level"], &object["pages"]), (&1.into(), &serde_json::json!([[10, 5], [4, 2]])));
    assert!(run(&["check", "half"]).status.success());
    let info = run(&["info", "half"]);
    assert!(
        String::from_utf8_lossy(&info.stdout).contains("level 1: the resolution was halved 1 time"),
        "{info:?}"
    );
    assert_eq!(json(&run(&["info", "half", "--json"]).stdout)["level"], 1);
    assert!(json(&run(&["info", "full", "--json"]).stdout)["level"].is_null());
    let again = run(&["halve", "full", "--out", "half"]);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&again.stderr).contains("half: stands there already"), "{again:?}");
    let missing = run(&["halve", "none", "--out", "other"]);
    assert!(String::from_utf8_lossy(&missing.stderr).contains("not a dataset"), "{missing:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}
