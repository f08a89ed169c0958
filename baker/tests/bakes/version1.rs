//! Datasets of version 1 of the format, baked again: what comes of them is of the current version, and as if
//! they had not been there.

use crate::relight::{HOURS, SCENE, stage};
use crate::{Stage, assert_same, data};
use baker::bake::run::{Options, Outcome, bake};
use baker::light::schedule::parse_hours;
use dataset::config::Light;
use dataset::console::Console;
use dataset::store::{Dataset, Writer};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// What a folder of version 1 has beside its lightmaps.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kept {
    /// What was traced, and the share of each light.
    All,
    /// The shares alone, as where hidden folders are not copied.
    Shares,
    /// What was traced alone.
    Traced,
    /// Nothing, as the first archive of a release.
    Nothing,
}

impl Kept {
    const ALL: [Kept; 4] = [Kept::All, Kept::Shares, Kept::Traced, Kept::Nothing];

    fn has_shares(self) -> bool {
        [Kept::All, Kept::Shares].contains(&self)
    }

    fn is_traced(self) -> bool {
        [Kept::All, Kept::Traced].contains(&self)
    }
}

/// Puts a manifest of version 1 in the place of a dataset's: the same lightmaps and, if they are kept, one
/// layer per light.
fn make_old(root: &Path, kept: Kept) {
    let dataset = Dataset::open(root).expect("a dataset");
    let mut writer = Writer::create(root).expect("a dataset's folder");
    let mut share = |light, group, frame| {
        let is_there = kept.has_shares() && !dataset.config.files_of(light, group, frame, 0).is_empty();
        let image = is_there.then(|| dataset.light(light, group, frame, 0).expect("a layer"));
        json!(image.map(|image| writer.add("share", "exr", &image.to_exr()).expect("a file")))
    };
    let mut manifest: Value = serde_json::to_value(&dataset.config).expect("a manifest");
    let mut frames = manifest["frames"].take();
    for (index, frame) in frames.as_array_mut().expect("frames").iter_mut().enumerate() {
        let (file, sun, sky) =
            (frame["maps"][0].take(), share(Light::Sun, None, index), share(Light::Sky, None, index));
        frame["maps"] = json!([{ "file": file, "sun": sun, "sky": sky }]);
    }
    let mut groups = manifest["groups"].take();
    for (index, group) in (0..).zip(groups.as_array_mut().expect("groups")) {
        let night = dataset.config.frames.len() - 1;
        let layer = share(Light::Group, Some(index), night);
        let group = group.as_object_mut().expect("a group");
        group.remove("baked");
        group.insert("layers".to_owned(), if layer.is_null() { json!([]) } else { json!([layer]) });
    }
    let object = manifest.as_object_mut().expect("an object");
    for key in ["frames", "layers", "sun", "sky", "sun_path", "visibility"] {
        object.remove(key);
    }
    object.extend(
        [("version", json!(1)), ("sets", frames), ("groups", groups)].map(|(k, v)| (k.to_owned(), v)),
    );
    manifest["pages"][0].as_object_mut().expect("a page").remove("kind");
    fs::write(root.join("config.json"), manifest.to_string()).expect("written");
    if !kept.is_traced() {
        fs::remove_dir_all(root.join(".layers")).expect("layers");
    }
    let old = Dataset::open(root).expect("a dataset of version 1");
    assert_eq!(old.version, 1);
    assert_eq!(old.config.layers.len(), if kept.has_shares() { 4 } else { 0 });
    assert_whole(&old);
}

/// What `dataset check` says of it: nothing.
#[track_caller]
fn assert_whole(dataset: &Dataset) {
    let faults = dataset.verify(|| ()).faults;
    assert!(faults.is_empty(), "{faults:?}");
}

#[track_caller]
fn assert_new(dataset: &Dataset, fresh: &Dataset) {
    assert_eq!(dataset.version, 2);
    assert_same(dataset, fresh);
    assert_whole(dataset);
}

fn layers(outcome: &Outcome) -> (usize, usize) {
    (outcome.layers.traced, outcome.layers.reused)
}

#[test]
fn the_same_scene_is_written_again_from_what_was_traced() {
    let stage = stage();
    let (_, fresh) = stage.bake(SCENE, "fresh", HOURS, |_| ());
    for kept in Kept::ALL {
        for force in [false, true] {
            let (_, dataset) = stage.bake(SCENE, "set", HOURS, |_| ());
            make_old(&dataset.root, kept);
            let (outcome, dataset) = stage.bake(SCENE, "set", HOURS, |options| options.force = force);
            assert!(!outcome.up_to_date, "{kept:?}");
            let is_reused = kept.is_traced() && !force;
            assert_eq!(layers(&outcome), if is_reused { (0, 4) } else { (4, 0) }, "{kept:?}");
            assert_eq!(outcome.rays.rays() == 0, is_reused, "{kept:?}");
            assert_new(&dataset, &fresh);
            // And is there from now on.
            assert!(stage.bake(SCENE, "set", HOURS, |_| ()).0.up_to_date);
        }
    }
}

#[test]
fn of_a_changed_scene_what_changed_is_traced() {
    let stage = stage();
    let changed = SCENE.replacen(
        "[lightmap]",
        "[[group.sphere]]\ncentre = [-1, 0.6, 0]\nradius = 0.1\nradiance = [1, 1, 1]\n[lightmap]",
        1,
    );
    let (_, fresh) = stage.bake(&changed, "fresh", HOURS, |_| ());
    for kept in Kept::ALL {
        let (_, dataset) = stage.bake(SCENE, "set", HOURS, |options| options.force = true);
        make_old(&dataset.root, kept);
        let (outcome, dataset) = stage.bake(&changed, "set", HOURS, |_| ());
        assert_eq!(layers(&outcome), if kept.is_traced() { (1, 3) } else { (4, 0) }, "{kept:?}");
        assert_new(&dataset, &fresh);
    }
}

/// The court as `bake` 0.1.0 baked it into the fixture of version 1.
fn court() -> Stage {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let stage = Stage::new(&[]);
    let copy = |from: &Path, to: &str| {
        fs::copy(from, stage.path(to)).expect("copied");
    };
    copy(&root.join("tests/fixtures/court.obj"), "court.obj");
    let old = root.join("dataset/tests/fixtures/version1-baked");
    fs::create_dir_all(stage.path("set/data")).expect("a folder");
    copy(&old.join("config.json"), "set/config.json");
    for file in fs::read_dir(old.join("data")).expect("a folder").flatten() {
        copy(&file.path(), &format!("set/data/{}", file.file_name().to_str().expect("a name")));
    }
    stage
}

const COURT: &str = r#"
name = "court"
[place]
latitude = 48.0
longitude = 16.0
utc_offset = 1.0
date = "2026-03-21"
[sun]
[sky]
model = "constant"
radiance = [0.5, 0.6, 0.8]
[[object]]
file = "court.obj"
albedo = 0.5
[[group]]
name = "lamp"
[[group.sphere]]
centre = [2.5, 1.5, 2.5]
radius = 0.1
lumens = 800
kelvin = 3000
[[group]]
name = "sign"
on = [["12:03", "22:00"]]
[[group.rectangle]]
corner = [-3.0, 1.5, -2.9]
edge_u = [1.0, 0.0, 0.0]
edge_v = [0.0, 0.3, 0.0]
radiance = [0.02, 0.0, 0.0]
[lightmap]
size = 22
padding = 2
[bake]
samples = 4
"#;

#[test]
fn a_dataset_of_an_earlier_program_is_kept_until_as_much_is_baked() {
    let stage = court();
    let old = Dataset::open(&stage.path("set")).expect("a dataset");
    let before = data(&old);
    // Less does not take its place.
    let cases = [
        (COURT.to_owned(), "12,20", "1 of its 3 hours would go"),
        (COURT.replace("samples = 4", "samples = 2"), "12,12:06,20", "2 samples per texel instead of 4"),
        (
            COURT.replace("size = 22", "size = 20"),
            "12,12:06,20",
            "pages of 20 × 20 texels instead of 22 × 22",
        ),
        (COURT.replace("\"court\"", "\"yard\""), "12,12:06,20", "it is of the scene \"court\", not \"yard\""),
    ];
    for (text, hours, expected) in cases {
        stage.write("case.toml", text.as_bytes());
        let options =
            Options { out: Some(stage.path("set")), ..Options::new(parse_hours(hours).expect("hours")) };
        let refused = bake(&stage.path("case.toml"), &options, &Console::silent()).expect_err(expected);
        assert!(refused.to_string().contains(expected), "{expected}: {refused}");
        assert!(data(&Dataset::open(&stage.path("set")).expect("a dataset")) == before, "{expected}");
    }
    let (_, fresh) = stage.bake(COURT, "fresh", "12,12:06,20", |_| ());
    let (outcome, dataset) = stage.bake(COURT, "set", "12,12:06,20", |_| ());
    assert_eq!(layers(&outcome), (5, 0));
    assert_new(&dataset, &fresh);
    // It is the same place under the same light.
    assert_eq!(dataset.mask(0).expect("a mask"), old.mask(0).expect("a mask"));
    let hours = |dataset: &Dataset| -> Vec<f64> { dataset.config.frames.iter().map(|f| f.hour).collect() };
    assert_eq!(hours(&dataset), hours(&old));
    // Who reads the old dataset can go on.
    for frame in 0..3 {
        old.map(frame, 0).expect("a lightmap");
    }
    // After one bake more it is gone.
    let (_, dataset) = stage.bake(&COURT.replace("samples = 4", "samples = 8"), "set", "12,12:06,20", |_| ());
    assert_whole(&dataset);
    assert!(old.map(0, 0).is_err());
}
