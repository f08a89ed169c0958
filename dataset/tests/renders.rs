//! Folders of EXR files as people have them: half floats, other channels, masks as pictures.

mod common;

use dataset::exchange::{Origin, import};
use dataset::format::Config;
use dataset::image::Image;
use dataset::observe::Silent;
use dataset::store::Dataset;
use exr::prelude as rs;
use exr::prelude::{WritableImage, f16};
use std::fs;
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (40, 30);

/// The value of a channel at a texel and an hour, exact in half floats.
fn value(hour: f64, x: usize, y: usize, channel: usize) -> f32 {
    f16::from_f32(1.0 + hour as f32 + 0.25 * channel as f32 + (x + 40 * y) as f32 / 512.0).to_f32()
}

/// Writes an EXR file: half floats under the names given, each with what it holds.
fn write_half(path: &Path, names: &[(&str, Option<usize>)], compression: rs::Compression, hour: f64) {
    let channels = names.iter().map(|&(name, component)| {
        let texel = |i: usize| component.map_or(1.0, |c| value(hour, i % SIZE.0, i / SIZE.0, c));
        let texels: Vec<f16> = (0..SIZE.0 * SIZE.1).map(|i| f16::from_f32(texel(i))).collect();
        rs::AnyChannel::new(name, rs::FlatSamples::F16(texels))
    });
    let encoding = rs::Encoding { compression, ..rs::Encoding::SMALL_LOSSLESS };
    let layer = rs::Layer::new(
        SIZE,
        rs::LayerAttributes::default(),
        encoding,
        rs::AnyChannels::sort(channels.collect()),
    );
    rs::Image::from_layer(layer).write().to_file(path).unwrap();
}

fn pattern(folder: &Path, pattern: &str, mask: Option<&str>, layer: Option<&str>) -> Origin {
    Origin::Pattern {
        folder: folder.to_owned(),
        pattern: pattern.to_owned(),
        mask: mask.map(|mask| folder.join(mask)),
        layer: layer.map(str::to_owned),
    }
}

/// Imports, checks and opens.
fn imported(origin: &Origin, out: &Path) -> (Config, Dataset) {
    let config = import(origin, out, &Silent).unwrap();
    let dataset = Dataset::open(out).unwrap();
    let faults = dataset.verify(|| {}).faults;
    assert!(faults.is_empty(), "{faults:?}");
    (config, dataset)
}

fn refused(origin: &Origin, out: &Path, words: &[&str]) {
    let error = import(origin, out, &Silent).expect_err(words[0]).to_string();
    assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    assert!(!out.exists());
}

/// A folder of half floats at four hours with a mask: the first rows are outside.
fn renders(folder: &Path) -> PathBuf {
    let folder = folder.join("renders");
    fs::create_dir(&folder).unwrap();
    let rgba = [("R", Some(0)), ("G", Some(1)), ("B", Some(2)), ("A", None)];
    for (name, hour) in
        [("light_06.exr", 6.0), ("light_18.25.exr", 18.25), ("light_24.exr", 0.0), ("light_9.exr", 9.0)]
    {
        write_half(&folder.join(name), &rgba, rs::Compression::PIZ, hour);
    }
    write_half(&folder.join("albedo.exr"), &rgba, rs::Compression::RLE, 1.0);
    let grey =
        |_: u32, y: u32| image::Rgba([if y < 3 { 20 } else { 250 }, 250, 250, if y < 2 { 0 } else { 255 }]);
    image::RgbaImage::from_fn(40, 30, grey).save(folder.join("mask.png")).unwrap();
    folder
}

#[test]
fn half_floats_and_a_mask_become_a_set() {
    let around = tempfile::tempdir().unwrap();
    let (folder, out) = (renders(around.path()), around.path().join("hall"));
    let (config, dataset) = imported(&pattern(&folder, "light_{hour}.exr", Some("mask.png"), None), &out);
    assert_eq!(config.scene, "hall");
    assert_eq!(config.source.as_ref().map(|source| &*source.layout), Some("exr"));
    let hours: Vec<f64> = config.frames.iter().map(|set| set.hour).collect();
    assert_eq!(hours, [0.0, 6.0, 9.0, 18.25]);
    for (set, hour) in hours.into_iter().enumerate() {
        let map = dataset.map(set, 0).unwrap();
        assert_eq!((map.width, map.height), SIZE);
        for (i, texel) in map.texels.iter().enumerate() {
            assert_eq!(*texel, [0, 1, 2].map(|c| value(hour, i % 40, i / 40, c)));
        }
    }
    // Transparent rows are not valid; the third is light enough though one channel is dark.
    let mask = dataset.mask(0).unwrap();
    assert_eq!((mask.count(), mask.valid[2 * 40 - 1], mask.valid[2 * 40]), (40 * 28, false, true));
}

#[test]
fn channels_of_other_names_are_found_or_requested() {
    let around = tempfile::tempdir().unwrap();
    let (folder, out) = (around.path().join("renders"), around.path().join("hall"));
    fs::create_dir(&folder).unwrap();
    let path = folder.join("12.exr");
    let origin = |layer| pattern(&folder, "{hour}.exr", None, layer);
    let first = |layer| {
        let _ = fs::remove_dir_all(&out);
        imported(&origin(layer), &out).1.map(0, 0).unwrap().texels[0]
    };
    let at = |channels: [usize; 3]| channels.map(|c| value(12.0, 0, 0, c));
    let some = |names: [&'static str; 3]| names.into_iter().zip([0, 1, 2].map(Some)).collect::<Vec<_>>();
    for names in [some(["r", "g", "b"]), some(["red", "Green", "BLUE"]), some(["Bake.R", "Bake.G", "Bake.B"])]
    {
        write_half(&path, &names, rs::Compression::ZIP16, 12.0);
        assert_eq!(first(None), at([0, 1, 2]), "{names:?}");
    }
    // Grey, by its usual name or alone.
    for names in [&[("Y", Some(1)), ("A", None)][..], &[("light", Some(1))]] {
        write_half(&path, names, rs::Compression::RLE, 12.0);
        assert_eq!(first(None), at([1, 1, 1]));
    }
    // What has no layer is the image; of several layers one must be named.
    let layers = [("Combined.R", Some(2)), ("Combined.G", Some(1)), ("Combined.B", Some(0))];
    write_half(&path, &[&some(["R", "G", "B"])[..], &layers].concat(), rs::Compression::RLE, 12.0);
    assert_eq!((first(None), first(Some("Combined"))), (at([0, 1, 2]), at([2, 1, 0])));
    let _ = fs::remove_dir_all(&out);
    let others = [("Depth.Y", Some(0))];
    write_half(&path, &[&layers[..], &others].concat(), rs::Compression::RLE, 12.0);
    refused(
        &origin(None),
        &out,
        &["12.exr: channels Combined.B, Combined.G, Combined.R, Depth.Y", "choose it with --layer"],
    );
    refused(&origin(Some("Diffuse")), &out, &["expected R, G, B of the layer \"Diffuse\""]);
    write_half(&path, &[("R", Some(0)), ("G", Some(1))], rs::Compression::RLE, 12.0);
    refused(&origin(None), &out, &["channels G, R; expected R, G, B"]);
}

#[test]
fn a_table_gives_pages_hours_and_light_groups() {
    let around = tempfile::tempdir().unwrap();
    let (folder, out) = (renders(around.path()), around.path().join("hall"));
    fs::write(folder.join("small.exr"), Image { width: 7, height: 5, texels: vec![[2.0; 3]; 35] }.to_exr())
        .unwrap();
    let table = folder.join("hall.toml");
    let good = "unit = \"kilolux\"\n\
                [[page]]\nmask = \"mask.png\"\n[[page]]\n\
                [[frame]]\nhour = 18.1\nfiles = [\"light_18.25.exr\", \"small.exr\"]\n\
                [[frame]]\nhour = 18.0\nfiles = [\"light_9.exr\", \"small.exr\"]\n\
                [[group]]\nname = \"lamps\"\non = [[18.0, 6.0]]\n";
    fs::write(&table, good).unwrap();
    let origin = Origin::Table(table.clone());
    let (config, dataset) = imported(&origin, &out);
    assert_eq!((config.pages[1].width, config.pages[1].height, &*config.unit), (7, 5, "kilolux"));
    assert_eq!(
        config.frames.iter().map(|s| (s.hour, s.groups_on[0])).collect::<Vec<_>>(),
        [(18.0, false), (18.1, true)]
    );
    assert_eq!(dataset.map(1, 0).unwrap().texels[41][1], value(18.25, 1, 1, 1));
    assert_eq!((dataset.mask(0).unwrap().count(), dataset.mask(1).unwrap().count()), (40 * 28, 35));
    assert!(dataset.verify(|| {}).warnings.is_empty());

    fs::remove_dir_all(&out).unwrap();
    for (from, to, words) in [
        ("unit", "units", &["hall.toml:1: unknown field `units`"][..]),
        ("hour = 18.1", "hour = 24.0", &["frame of hour 24: expected an hour from 0 to below 24"]),
        ("hour = 18.1", "hour = nan", &["frame of hour NaN"]),
        ("hour = 18.1", "hour = 18.0", &["hall.toml:", "hour 18 occurs twice"]),
        ("[[18.0, ", "[[36.0, ", &["hall.toml:", "on 36 to", "expected two different hours in [0, 24]"]),
        (
            ", \"small.exr\"]\n[[frame]]",
            "]\n[[frame]]",
            &["frame of hour 18.1: 1 files; expected one for each page: 2"],
        ),
        (
            "\"light_9.exr\"",
            "\"small.exr\"",
            &["light_18.25.exr: size 40×30; expected that of", "small.exr, 7×5"],
        ),
        ("light_9", "light_none", &["light_none.exr"]),
        ("mask.png", "small.exr", &["small.exr: size 7×5; expected 40×30"]),
        ("mask.png", "hall.toml", &["hall.toml: "]),
        ("[[18.0, 6.0]]", "[[18.0, 30.0]]", &["group \"lamps\": on 18 to 30"]),
    ] {
        let text = good.replacen(from, to, 1);
        assert_ne!(text, good, "{from}");
        fs::write(&table, text).unwrap();
        refused(&origin, &out, words);
    }
}

#[test]
fn a_pattern_that_fits_badly_is_refused() {
    let around = tempfile::tempdir().unwrap();
    let (folder, out) = (renders(around.path()), around.path().join("hall"));
    let with = |text: &str| pattern(&folder, text, Some("mask.png"), None);
    refused(&with("light.exr"), &out, &["--pattern light.exr: expected the name of a file with {hour} once"]);
    refused(&with("../{hour}.exr"), &out, &["{hour} once"]);
    refused(&with("lamp_{hour}.exr"), &out, &["no file in", "matches"]);
    fs::copy(folder.join("light_9.exr"), folder.join("light_0590.exr")).unwrap();
    refused(&with("light_{hour}.exr"), &out, &["light_0590.exr: hour 590; expected 0 to 24"]);
    fs::rename(folder.join("light_0590.exr"), folder.join("light_09.exr")).unwrap();
    refused(&with("light_{hour}.exr"), &out, &["light_09.exr and light_9.exr both name 9 h"]);
    // A value that is none of light: named on a surface, 0 elsewhere.
    let mut image = Image { width: 40, height: 30, texels: vec![[1.0; 3]; 1200] };
    image.texels[40] = [-1.0, f32::NAN, 1.0];
    fs::write(folder.join("light_09.exr"), image.to_exr()).unwrap();
    fs::remove_file(folder.join("light_9.exr")).unwrap();
    let config = import(&with("light_{hour}.exr"), &out, &Silent).unwrap();
    assert_eq!(config.source.unwrap().replaced_values, 2);
    fs::remove_dir_all(&out).unwrap();
    image.texels[700][2] = -0.5;
    fs::write(folder.join("light_09.exr"), image.to_exr()).unwrap();
    refused(&with("light_{hour}.exr"), &out, &["light_09.exr, texel (20, 17): channel B is -0.5"]);
}
