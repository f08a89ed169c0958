//! Datasets of an earlier `bake` and `dataset import`: read, checked, exported and released with the same
//! light as when they were new.

#[path = "../../tests/common/mod.rs"]
mod common;

use dataset::exchange::{Origin, export, import};
use dataset::format::{Baked, Config, Daylight, Layer, Light, Part, VERSION};
use dataset::layout::hprc1::Hprc1;
use dataset::observe::Silent;
use dataset::release::{release, verify};
use dataset::store::{Dataset, MANIFEST};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The court on 22 × 22 texels, by `bake` 0.1.0: three frames, a lamp that is always on, a sign that
/// switches.
const BAKED: &str = "baked";
/// A lightmap of 4 × 3 texels at 24 hours with its shares, by `dataset import` 0.1.0 from the layout hprc1.
const IMPORTED: &str = "imported";
/// What `digest_of_light` gives of them: bundles that were made then hold it.
const DIGESTS: [(&str, &str); 2] = [
    (BAKED, "de955576d230f127f696af57db4acfbef0e425412d500c857d1738253fe414e3"),
    (IMPORTED, "d4f3feaa852d714a4dfcb7125dc2afdcfb0c5d0119dc7fbcab469c27f6e1d3da"),
];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures").join(name)
}

fn open(name: &str) -> Dataset {
    Dataset::open(&fixture(name)).unwrap()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to.join("data")).unwrap();
    fs::copy(from.join(MANIFEST), to.join(MANIFEST)).unwrap();
    for entry in fs::read_dir(from.join("data")).unwrap().flatten() {
        fs::copy(entry.path(), to.join("data").join(entry.file_name())).unwrap();
    }
}

fn command(arguments: &[&str], folder: &Path) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_dataset")).args(arguments).arg(folder).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn light_has_the_digest_that_it_had() {
    for (name, digest) in DIGESTS {
        let dataset = open(name);
        assert_eq!(dataset.config.digest_of_light(), digest, "{name}");
    }
}

#[test]
fn each_light_has_one_layer_and_maps_are_their_sums() {
    let layers = |config: &Config| -> Vec<(Light, Option<u32>, Part, usize)> {
        let layer = |l: &Layer| (l.light, l.group, l.part, l.files().count());
        config.layers.iter().map(layer).collect()
    };
    let all = Some(Daylight { baked: Baked::All });
    let Dataset { config, .. } = open(BAKED);
    assert_eq!((config.sun, config.sky, config.frames.len()), (all, all, 3));
    assert!(config.groups.iter().all(|group| group.baked == Baked::All));
    // The sun is down at 20 h.
    let expected = [
        (Light::Sun, None, Part::All, 2),
        (Light::Sky, None, Part::All, 3),
        (Light::Group, Some(0), Part::All, 1),
        (Light::Group, Some(1), Part::All, 1),
    ];
    assert_eq!(layers(&config), expected);
    let Dataset { config, .. } = open(IMPORTED);
    assert_eq!((config.sun, config.sky, config.frames.len()), (all, all, 24));
    let expected = [
        (Light::Sun, None, Part::All, 11),
        (Light::Sky, None, Part::All, 15),
        (Light::Lamps, None, Part::All, 11),
    ];
    assert_eq!(layers(&config), expected);
    for (name, frames) in [(BAKED, 3), (IMPORTED, 24)] {
        let dataset = open(name);
        // Sums among it.
        let images = dataset.verify_steps()
            - dataset.files().map(|f| &f.path).collect::<std::collections::BTreeSet<_>>().len();
        assert!(images > frames, "{name}");
        assert!(dataset.verify(|| ()).faults.is_empty(), "{name}");
        let reported = command(&["check", "--json"], &fixture(name));
        assert_eq!((&reported["ok"], &reported["frames"]), (&true.into(), &frames.into()), "{name}");
        assert_eq!(command(&["info", "--json"], &fixture(name))["version"], VERSION, "{name}");
    }
}

#[test]
fn a_sum_that_is_wrong_is_found() {
    let folder = tempfile::tempdir().unwrap();
    copy(&fixture(BAKED), folder.path());
    // The maps of two frames change places.
    let text = fs::read_to_string(folder.path().join(MANIFEST)).unwrap();
    let mut manifest: Value = serde_json::from_str(&text).unwrap();
    let [first, second] = [0, 1].map(|frame| manifest["frames"][frame]["maps"][0].clone());
    manifest["frames"][0]["maps"][0] = second;
    manifest["frames"][1]["maps"][0] = first;
    fs::write(folder.path().join(MANIFEST), manifest.to_string()).unwrap();
    let faults = Dataset::open(folder.path()).unwrap().verify(|| ()).faults;
    assert_eq!(faults.len(), 2);
    assert!(faults.iter().all(|fault| fault.to_string().contains("its layers sum to")), "{faults:?}");
}

#[test]
fn an_imported_dataset_goes_out_and_comes_back_with_the_same_light() {
    let folder = tempfile::tempdir().unwrap();
    let [out, back] = ["out", "imported"].map(|name| folder.path().join(name));
    let dataset = open(IMPORTED);
    let exported = export(&dataset, &Hprc1, &out, &Silent).unwrap();
    assert_eq!((exported.hours.len(), &*exported.omitted), (24, &[][..]));
    let again = import(&Origin::Folder(&Hprc1, out), &back, &Silent).unwrap();
    assert_eq!(again.digest_of_light(), dataset.config.digest_of_light());
    assert_eq!(again.inputs, dataset.config.inputs);
    // Files of equal content may have other names.
    let content = |config: &Config| -> Vec<_> {
        let hashes = |l: &Layer| -> Vec<Vec<_>> {
            l.files.iter().map(|row| row.iter().map(|f| f.as_ref().map(|f| f.blake3)).collect()).collect()
        };
        config.layers.iter().map(|l| (l.light, l.group, l.part, hashes(l))).collect()
    };
    assert_eq!(content(&again), content(&dataset.config));
}

#[test]
fn they_are_released_with_the_manifest_that_they_have() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("release");
    let [baked, imported] = [BAKED, IMPORTED].map(fixture);
    release(&[baked, imported], &[], false, &out, &Silent).unwrap();
    let verified = verify(&out, &Silent).unwrap();
    assert!(verified.faults.is_empty(), "{:?}", verified.faults);
    let reported: Value = serde_json::from_slice(&fs::read(out.join("release.json")).unwrap()).unwrap();
    for scene in reported["scenes"].as_array().unwrap() {
        let holds: Vec<&str> =
            scene["archives"].as_array().unwrap().iter().map(|a| a["holds"].as_str().unwrap()).collect();
        // At night the imported lightmaps are the lamps' light, so that its files are in the first archive.
        let expected: &[&str] = match scene["scene"] == "imported" {
            true => &["sets", "sun", "sky"],
            false => &["sets", "sun", "sky", "lamps"],
        };
        assert_eq!(holds, expected);
    }
}
