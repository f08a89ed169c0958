//! The section of a dataset's lightmaps.

#[path = "../../../tests/common/mod.rs"]
mod common;

use common::write_set;
use dataset::store::Dataset;
use reports::{Report, preview};
use std::fs;

#[test]
fn a_report_shows_every_set() {
    let folder = tempfile::tempdir().unwrap();
    write_set(folder.path(), &[(300, 20), (1, 1)], 1).unwrap();
    let mut report = Report::new("test");
    report.push(preview::section(&Dataset::open(folder.path()).unwrap()).unwrap());
    let path = folder.path().join("report.html");
    report.write(&path).unwrap();
    let html = fs::read_to_string(path).unwrap();
    for text in
        ["12 h", "21.5 h · page 1 · porch, garden on", "0 h · page 0 · porch on", "18 to 6 h", "kilolux"]
    {
        assert!(html.contains(text), "{text}");
    }
    // Two masks, three frames of two pages, and those again that are much darker, if any.
    assert!(html.matches("<img").count() >= 8);
}
