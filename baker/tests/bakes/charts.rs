//! Charts that an earlier bake left are those that unwrapping gives.

use crate::scenes::Obj;
use crate::{Stage, assert_same};
use baker::bake::run::{Options, prepare};
use baker::bake::store::{Charts, Counts};
use baker::light::times::schedule::parse_hours;
use dataset::observe::Silent;
use std::path::{Path, PathBuf};

const SCENE: &str = r#"
[sky]
model = "constant"
radiance = [3, 4, 5]
[[object]]
file = "a.obj"
[lightmap]
size = 64
"#;

/// A floor, a crate of this height on it, and a wall that is higher: coordinates are about the scene's
/// centre, which the crate does not move.
fn obj(height: f64) -> Vec<u8> {
    let obj = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 4.0, 4.0);
    let obj = obj.mesh("crate").block([-0.5, -0.05, -0.5], [1.0, height, 1.0]);
    obj.mesh("wall").block([1.0, -0.05, -1.0], [0.2, 2.0, 2.0]).bytes()
}

/// A stage with the scene, baked once, and the file of its charts.
fn baked() -> (Stage, PathBuf) {
    let stage = Stage::new(&[("a.obj", obj(1.0))]);
    stage.bake(SCENE, "set", "12", |options| options.samples = Some(2));
    let file = stage.path("set").join(".layers/meshes.charts");
    (stage, file)
}

/// The layout of the scene's texels in full, and how many meshes were unwrapped for it. What was asked for is
/// kept.
fn layout(stage: &Stage, dataset: &Path) -> (String, Counts) {
    let options = Options::new(parse_hours("12").expect("hours"));
    let prepared = prepare(&stage.path("case.toml"), &options, &Silent).expect("a scene");
    let charts = Charts::beside(dataset);
    let (atlas, _) = prepared.atlas_from(&charts).expect("an atlas");
    let counts = charts.counts();
    charts.keep(dataset);
    (format!("{atlas:?}"), counts)
}

#[test]
fn a_later_bake_unwraps_nothing_and_gives_the_same_bytes() {
    let (stage, file) = baked();
    let kept = std::fs::read(&file).expect("charts");
    // Another seed: everything is traced again.
    let scene = format!("{SCENE}[bake]\nseed = 2\nsamples = 2\n");
    let (_, later) = stage.bake(&scene, "set", "12", |_| ());
    assert_eq!(std::fs::read(&file).expect("charts"), kept);
    assert_eq!(layout(&stage, &stage.path("set")).1, Counts { made: 0, kept: 3 });
    let (_, fresh) = stage.bake(&scene, "fresh", "12", |_| ());
    assert_same(&later, &fresh);
}

#[test]
fn a_changed_vertex_unwraps_its_mesh_alone_and_the_old_one_is_dropped() {
    let (stage, file) = baked();
    let length = std::fs::metadata(&file).expect("charts").len();
    stage.write("a.obj", &obj(1.25));
    let (fresh, counts) = layout(&stage, &stage.path("nowhere"));
    assert_eq!(counts, Counts { made: 3, kept: 0 });
    let (changed, counts) = layout(&stage, &stage.path("set"));
    assert_eq!(counts, Counts { made: 1, kept: 2 });
    assert_eq!(changed, fresh);
    assert_eq!(std::fs::metadata(&file).expect("charts").len(), length);
    assert_eq!(layout(&stage, &stage.path("set")).1, Counts { made: 0, kept: 3 });
}

#[test]
fn what_is_no_whole_file_of_charts_is_made_again() {
    let (stage, file) = baked();
    let dataset = stage.path("set");
    let whole = std::fs::read(&file).expect("charts");
    let (fresh, _) = layout(&stage, &stage.path("nowhere"));
    let layer = std::fs::read_dir(dataset.join(".layers")).expect("layers").flatten().map(|e| e.path());
    let layer =
        layer.into_iter().find(|path| path.extension().is_some_and(|e| e == "layer")).expect("a layer");
    let mut damaged = vec![Vec::new(), std::fs::read(layer).expect("a layer"), vec![0xff; whole.len()]];
    damaged.extend((0..whole.len()).step_by(97).map(|length| whole[..length].to_vec()));
    for i in (0..48).chain((48..whole.len()).step_by(89)) {
        let mut bytes = whole.clone();
        bytes[i] ^= 1 << (i % 8);
        damaged.push(bytes);
    }
    // The length of the header, and the number of triangles of the first mesh.
    for at in [8, 48 + 32] {
        let mut bytes = whole.clone();
        bytes[at..at + 8].fill(0xff);
        damaged.push(bytes);
    }
    for bytes in damaged {
        std::fs::write(&file, &bytes).expect("written");
        let (again, counts) = layout(&stage, &dataset);
        assert_eq!(counts, Counts { made: 3, kept: 0 });
        assert_eq!(again, fresh);
        assert_eq!(std::fs::read(&file).expect("charts"), whole);
    }
}

#[test]
fn a_plan_creates_no_folder() {
    let (stage, _) = baked();
    let nowhere = stage.path("nowhere");
    layout(&stage, &nowhere);
    assert!(!nowhere.exists());
    std::fs::create_dir(&nowhere).expect("a folder");
    layout(&stage, &nowhere);
    assert_eq!(std::fs::read_dir(&nowhere).expect("a folder").count(), 0);
    // A folder where the file would be is no reason to fail.
    std::fs::create_dir_all(nowhere.join(".layers/meshes.charts")).expect("a folder");
    assert_eq!(layout(&stage, &nowhere).1.made, 3);
}
