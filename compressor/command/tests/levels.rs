//! Coarser levels of a bundle: each a bundle of the halved dataset, and what a stopped run left is used or
//! made again.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::islands;
use compressor::bundle::Bundle;
use compressor::compress::{Options, light_of};
use compressor::decode::Decoder;
use compressor::levels::levels;
use compressor::run::compress_and_judge;
use dataset::halve::halve;
use dataset::observe::Silent;
use dataset::store::Dataset;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_compress")).args(arguments).current_dir(folder).output().unwrap()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn levels_are_bundles_of_the_halved_light() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("isles");
    islands().write(&root);
    let arguments = ["isles", "--levels", "--iterations", "300", "--json", "--quiet"];
    let object = json(&run(&arguments, folder.path()));
    let of = &object["levels"];
    assert_eq!(of.as_array().unwrap().len(), 1, "{of}");
    assert_eq!(
        (&of[0]["level"], &of[0]["pages"], &of[0]["tiles"]),
        (&1.into(), &serde_json::json!([[75, 70]]), &1.into())
    );
    assert_eq!(of[0]["up_to_date"], false);
    assert!(of[0]["psnr_db"].as_f64().unwrap() > 30.0, "{of}");
    let expected = [
        "config.json",
        "data",
        "isles.1.ndgi",
        "isles.1.ndgi.run.json",
        "isles.html",
        "isles.ndgi",
        "isles.ndgi.run.json",
    ];
    assert_eq!(names(&root), expected);
    let report = fs::read_to_string(root.join("isles.html")).unwrap();
    assert!(report.contains("Coarser levels") && report.contains("isles.1.ndgi"));

    // It is of the light that `dataset halve` makes, and says what it is a level of.
    let full = Dataset::open(&root).unwrap();
    let half = folder.path().join("half");
    halve(&full, &half, &Silent).unwrap();
    let bundle = Bundle::open(&root.join("isles.1.ndgi")).unwrap();
    let half = Dataset::open(&half).unwrap();
    assert_eq!(light_of(&bundle.header), Some(half.config.digest_of_light()));
    let info: Value = serde_json::from_str(&bundle.header.info).unwrap();
    assert_eq!(
        (&info["level"], info["level_of"].as_str()),
        (&1.into(), Some(&*full.config.digest_of_light()))
    );
    let page = Decoder::new(bundle).decode_page(0, 12.0).unwrap();
    assert_eq!((page.width, page.height), (75, 70));
    let output = run(&["info", "isles/isles.1.ndgi"], folder.path());
    let reported = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        reported.contains("1: a texel is the mean of 2 × 2 texels") && reported.contains("p / 2 here"),
        "{reported}"
    );
    let output = run(&["info", "isles/isles.ndgi"], folder.path());
    assert!(!String::from_utf8_lossy(&output.stdout).contains("level"), "{output:?}");
    let output =
        run(&["evaluate", "half", "--bundle", "isles/isles.1.ndgi", "--json", "--quiet"], folder.path());
    assert_eq!(json(&output)["matches_dataset"], true);

    // A second run trains nothing.
    let object = json(&run(&arguments, folder.path()));
    assert_eq!((&object["up_to_date"], &object["levels"][0]["up_to_date"]), (&true.into(), &true.into()));
    // Without the option nothing is said of levels.
    assert!(
        json(&run(&["isles", "--iterations", "300", "--json", "--quiet"], folder.path()))["levels"].is_null()
    );
    // A release takes it along.
    dataset::release::release(&[root], &[], false, &folder.path().join("release"), &Silent).unwrap();
    assert!(names(&folder.path().join("release")).contains(&"isles.1.ndgi".to_owned()));
}

#[test]
fn what_a_stopped_run_left_is_used_or_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("isles");
    islands().write(&root);
    let options = Options { iterations: 60, ..Options::default() };
    let bundle = compress_and_judge(&root, &options, &Silent).unwrap().outcome.bundle;
    let work = root.join("isles.ndgi.levels");
    let make = || levels(&root, &options, &bundle, &Silent).unwrap();
    // A folder that is no dataset, and half of another dataset.
    fs::create_dir_all(work.join("1/data")).unwrap();
    make();
    let level = fs::read(root.join("isles.1.ndgi")).unwrap();
    assert!(!work.exists());
    let mut other = islands();
    other.light = |_, _, _, _| [7.0; 3];
    other.write(&folder.path().join("other"));
    fs::create_dir(&work).unwrap();
    halve(&Dataset::open(&folder.path().join("other")).unwrap(), &work.join("1"), &Silent).unwrap();
    assert!(make()[0].up_to_date);
    assert_eq!(fs::read(root.join("isles.1.ndgi")).unwrap(), level);
    // Files of others stay; a page of one tile has no coarser level.
    fs::create_dir(&work).unwrap();
    fs::write(work.join("notes.txt"), b"mine").unwrap();
    make();
    assert_eq!(names(&work), ["notes.txt"]);
    let mut small = islands();
    (small.width, small.height) = (100, 126);
    small.write(&folder.path().join("small"));
    let none = levels(&folder.path().join("small"), &options, &folder.path().join("small.ndgi"), &Silent);
    assert_eq!(none.unwrap(), []);
}

#[test]
fn a_level_that_is_left_of_other_light_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("isles");
    islands().write(&root);
    let reported = |arguments: &[&str]| {
        let output = run(arguments, folder.path());
        assert!(output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let plain = ["isles", "--iterations", "50"];
    assert!(!reported(&["isles", "--levels", "--iterations", "50"]).contains("different light"));
    assert!(!reported(&plain).contains("different light"), "it is of this light");
    // A level of unknown origin.
    fs::copy(root.join("isles.ndgi"), root.join("isles.1.ndgi")).unwrap();
    let text = reported(&plain);
    assert!(
        text.contains("isles.1.ndgi: this coarser level was made from different light")
            && text.contains("--levels"),
        "{text}"
    );
}
