//! Datasets that are a scene's transfer: what their manifest must hold, and that all commands take them.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::write_set;
use dataset::exchange::export;
use dataset::format::{Config, Transfer, TransferLight, TransferPart};
use dataset::layout::Layout;
use dataset::layout::hprc1::Hprc1;
use dataset::layout::hprc2::Hprc2;
use dataset::observe::Silent;
use dataset::release::{release, verify};
use dataset::store::{Dataset, Writer};
use std::path::Path;
use std::process::Command;

/// A frame of three parts of two functions.
fn write(root: &Path) -> Config {
    let mut config = write_set(root, &[(9, 5)], 3).unwrap();
    let light = |hour: f64| TransferLight { hour, coefficients: vec![[1.0, -2.0, 0.5]; 2] };
    config.transfer = Some(Transfer {
        scene: "yard".into(),
        inputs: "0123".into(),
        parts: [(0, false), (1, false), (1, true)]
            .map(|(function, negative)| TransferPart { function, negative })
            .into(),
        light: vec![light(0.0), light(12.5)],
    });
    Writer::create(root).unwrap().commit(&config).unwrap();
    config
}

#[test]
fn a_transfer_is_read_checked_shown_and_released() {
    let folder = tempfile::tempdir().unwrap();
    let (set, out) = (folder.path().join("set"), folder.path().join("release"));
    let config = write(&set);
    let dataset = Dataset::open(&set).unwrap();
    assert_eq!(dataset.config, config);
    assert!(dataset.verify(|| ()).faults.is_empty());
    let output = Command::new(env!("CARGO_BIN_EXE_dataset"))
        .args(["info", "set", "--json"])
        .current_dir(&folder)
        .output();
    let reported: serde_json::Value = serde_json::from_slice(&output.unwrap().stdout).unwrap();
    assert_eq!(reported["transfer"], serde_json::json!({ "scene": "yard", "functions": 2, "times": 2 }));
    release(std::slice::from_ref(&set), &[], false, &out, &Silent).unwrap();
    assert!(verify(&out, &Silent).unwrap().faults.is_empty());
    let datasheet = std::fs::read_to_string(out.join("test.md")).unwrap();
    assert!(datasheet.contains("The transfer of the scene yard"), "{datasheet}");
}

#[test]
fn a_transfer_is_not_taken_for_a_day() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("set"));
    let dataset = Dataset::open(&folder.path().join("set")).unwrap();
    let out = folder.path().join("out");
    for layout in [&Hprc1 as &dyn Layout, &Hprc2] {
        let error = export(&dataset, layout, &out, &Silent).unwrap_err().to_string();
        assert!(error.contains("is the transfer of yard; expected a dataset of a day"), "{error}");
        assert!(!out.exists());
    }
}

/// A change, and words of the error that it must give.
type Case = (fn(&mut Transfer), &'static str);

#[test]
fn what_breaks_a_transfer_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let good = write(folder.path());
    let cases: [Case; 9] = [
        (|t| t.scene = "a/b".into(), "transfer: scene is \"a/b\""),
        (|t| t.parts.truncate(2), "transfer: 2 parts; expected 3, one per frame"),
        (|t| t.parts[2].negative = false, "the positive part of function 1 occurs twice"),
        (|t| t.parts[0].function = 2, "no part of function 0; expected functions from 0 on"),
        (|t| t.light.clear(), "light has no entries"),
        (|t| t.light[1].hour = 24.0, "light at hour 24; expected ascending hours in [0, 24)"),
        (|t| t.light.swap(0, 1), "light at hour 0; expected ascending"),
        (|t| t.light[1].coefficients.truncate(1), "light at hour 12.5 has 1 coefficient; expected 2"),
        (|t| t.light[0].coefficients[1][2] = f64::INFINITY, "light at hour 0 has a coefficient inf"),
    ];
    for (change, expected) in cases {
        let mut config = good.clone();
        change(config.transfer.as_mut().unwrap());
        let error = Writer::create(folder.path()).unwrap().commit(&config).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    assert_eq!(Dataset::open(folder.path()).unwrap().config, good);
}
