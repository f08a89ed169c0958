//! Precomputed radiance transfer beside the other methods: a dataset, its scene's transfer, and
//! `compress compare --transfer`.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{Scene, lamp_is_on};
use compressor::compress::{Options, compress};
use dataset::format::{Config, Layer, Light, Part, Transfer, TransferLight, TransferPart};
use dataset::image::Image;
use dataset::observe::Silent;
use dataset::store::{Dataset, Writer};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

const SIZE: [usize; 2] = [20, 12];
const HOURS: [f64; 4] = [0.0, 5.9, 6.0, 12.0];

/// By what the two functions are multiplied at an hour, red, green and blue.
fn coefficients(hour: f64) -> [[f64; 3]; 2] {
    [[1.0 + hour, 2.0 + hour, 3.0], [-0.5, 0.25 * hour, 0.1]]
}

/// The light of function 0, of the positive and the negative part of function 1, and of the lamp.
fn of_source(source: usize, x: usize, y: usize) -> [f32; 3] {
    let (x, y) = (x as f32 / 20.0, y as f32 / 12.0);
    match source {
        0 => [1.0, 1.0 + 0.5 * x, 1.2],
        1 => [(x - 0.3).max(0.0); 3],
        2 => [(0.3 - x).max(0.0); 3],
        _ => [2.0 * y, y, 0.3 * y * y],
    }
}

/// A texel that no daylight arrives at; the transfer's lightmaps have light of its neighbours there, as
/// dilation leaves it.
fn is_dark(x: usize, y: usize) -> bool {
    (x, y) == (18, 11)
}

/// The dataset `isles` as those sources light it.
fn scene() -> Scene {
    let light = |x: usize, y: usize, hour: f64, lamp: bool| {
        let of = |source: usize| of_source(source, x, y);
        let [first, second] = coefficients(hour);
        [0, 1, 2].map(|c| {
            let daylight = first[c] as f32 * of(0)[c] + second[c] as f32 * (of(1)[c] - of(2)[c]);
            let daylight = if is_dark(x, y) { 0.0 } else { daylight };
            daylight + if lamp { of(3)[c] } else { 0.0 }
        })
    };
    let [width, height] = SIZE;
    Scene { width, height, hours: HOURS.to_vec(), valid: |x, y| (x + y) % 5 > 0, light }
}

fn image(size: [usize; 2], source: usize) -> Image {
    let [width, height] = size;
    let texels = (0..width * height).map(|i| of_source(source, i % width, i / width)).collect();
    Image { width, height, texels }
}

/// Changes the manifest of a dataset, with what it adds to the files.
fn change(root: &Path, with: impl FnOnce(&mut Config, &mut Writer)) {
    let mut config = Dataset::open(root).unwrap().config;
    let mut writer = Writer::create(root).unwrap();
    with(&mut config, &mut writer);
    writer.commit(&config).unwrap();
}

/// The dataset `set` with its lamp's layer, and `transfer` beside it.
fn write(folder: &Path) {
    let scene = scene();
    scene.write(&folder.join("set"));
    change(&folder.join("set"), |config, writer| {
        let file = writer.add("lamp", "exr", &image(SIZE, 3).to_exr()).unwrap();
        // What surfaces reflect of it is black.
        config.layers = [(Part::Direct, Some(file)), (Part::Indirect, None)]
            .map(|(part, file)| Layer {
                light: Light::Group,
                group: Some(0),
                part,
                files: vec![vec![file]],
                curve: None,
            })
            .into();
    });
    let parts = [(0, false), (1, false), (1, true)];
    let hours = vec![0.0, 0.5, 1.0];
    let root = folder.join("transfer");
    Scene { hours, valid: |x, y| (x + y) % 5 > 0 && !is_dark(x, y), ..scene }.write(&root);
    change(&root, |config, writer| {
        config.groups.clear();
        for (source, set) in config.frames.iter_mut().enumerate() {
            set.groups_on.clear();
            set.maps[0] = writer.add("part", "exr", &image(SIZE, source).to_exr()).unwrap();
        }
        let light = |hour: &f64| TransferLight { hour: *hour, coefficients: coefficients(*hour).to_vec() };
        config.scene = "isles-transfer".to_owned();
        config.transfer = Some(Transfer {
            scene: "isles".to_owned(),
            inputs: config.inputs.clone(),
            parts: parts.map(|(function, negative)| TransferPart { function, negative }).to_vec(),
            light: HOURS.iter().map(light).collect(),
        });
    });
}

fn compare(folder: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_compress"));
    command.args(["compare", "set", "--draft", "--json", "--report", "c.html"]).args(more);
    command.current_dir(folder).output().unwrap()
}

#[test]
fn light_that_the_functions_hold_comes_back_and_counts_its_bits() {
    assert!(HOURS.iter().any(|&hour| lamp_is_on(hour)) && !lamp_is_on(12.0));
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let output = compare(folder.path(), &["--transfer", "transfer"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let reported: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = reported["rows"].as_array().unwrap();
    let row = |name: &str| rows.iter().find(|row| row["method"] == name).unwrap();
    // Nine numbers a texel, and the largest values of the functions and of the lamp.
    let (texels, valid) = (240.0, (0..240).filter(|i| (i % 20 + i / 20) % 5 > 0).count() as f64);
    let plain = row("PRT, no codec");
    assert_eq!(plain["family"], "PRT");
    let stored = |row: &Value| row["bpp"].as_f64().unwrap() * 4.0 * texels;
    assert!((stored(plain) - (16.0 * 9.0 * valid + 64.0)).abs() < 1e-6, "{plain}");
    assert!(plain["psnr_db"].as_f64().unwrap() > 65.0, "{plain}");
    // A mean and components take more than a bit of so few texels: the smallest of both is what there is.
    let coded = row("PRT, clustered PCA");
    let bits = 8.0 * valid + 16.0 * 2.0 * 9.0 + 64.0 + 16.0;
    assert!((stored(coded) - bits).abs() < 1e-6, "{coded}");
    let (coded, plain) = (&coded["psnr_db"].as_f64().unwrap(), &plain["psnr_db"].as_f64().unwrap());
    assert!((20.0..*plain).contains(coded), "{coded}");
    let skipped = &reported["skipped"];
    assert!(skipped.is_array() && !skipped.to_string().contains("PRT"), "{skipped}");
}

#[test]
fn what_does_not_belong_together_is_refused_and_what_is_missing_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |more: &[&str], words: &[&str]| {
        let output = compare(folder.path(), more);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{words:?}");
        assert!(words.iter().all(|word| said.contains(word)), "{words:?}: {said}");
        assert!(!folder.path().join("c.html").exists());
    };
    let [set, transfer] = ["set", "transfer"].map(|name| folder.path().join(name));
    let with: &[&str] = &["--transfer", "transfer"];
    let light = |change: fn(&mut Transfer)| {
        write(folder.path());
        self::change(&transfer, |config, _| change(config.transfer.as_mut().unwrap()));
    };
    light(|transfer| drop(transfer.light.remove(1)));
    refused(with, &["transfer: has no light for 5.9 h", "--hours 0..24"]);
    let refusal = compress(&transfer, &Options::default(), &Silent).unwrap_err().to_string();
    assert!(refusal.contains("is the transfer of isles; expected a dataset of a day"), "{refusal}");
    light(|transfer| transfer.scene = "other".to_owned());
    refused(with, &["transfer: is the transfer of other; expected that of isles"]);
    light(|transfer| transfer.inputs.replace_range(..1, "1"));
    refused(with, &["transfer: belongs to a different bake than set", "the same `bake` command"]);
    write(folder.path());
    refused(&["--transfer", "set"], &["set: is not a transfer", "`bake --transfer` of the scene isles"]);
    refused(&["--transfer", "transfer", "--ablations"], &["--ablations"]);
    change(&set, |config, _| config.layers.clear());
    refused(with, &["set: has no layer of the light group \"lamp\""]);
    // A page of another size.
    let size = [20, 16];
    write(folder.path());
    let scene = Scene { height: 16, ..scene() };
    change(&transfer, |config, writer| {
        config.pages[0].height = 16;
        config.pages[0].mask = writer.add("mask", "png", &scene.mask().to_png()).unwrap();
        for (source, set) in config.frames.iter_mut().enumerate() {
            set.maps[0] = writer.add("part", "exr", &image(size, source).to_exr()).unwrap();
        }
    });
    refused(with, &["transfer: pages of 20×16; set has 20×12", "bake both alike"]);
}
