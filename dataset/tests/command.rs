//! The `dataset` command as a user runs it.

mod common;

use common::write_set;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_dataset")).args(arguments).arg(folder).output().unwrap()
}

fn json(output: &Output) -> serde_json::Value {
    let text = std::str::from_utf8(&output.stdout).unwrap();
    assert_eq!(text.lines().count(), 1, "one object on stdout: {text}");
    serde_json::from_str(text).unwrap()
}

#[test]
fn a_whole_set_passes_and_a_torn_one_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let output = run(&["check", "--json"], folder.path());
    assert!(output.status.success(), "{output:?}");
    assert_eq!((&json(&output)["ok"], &json(&output)["sets"]), (&true.into(), &3.into()));

    let victim = folder.path().join(&config.sets[1].maps[0].file.path);
    fs::write(&victim, b"torn").unwrap();
    let output = run(&["check", "--json", "--quiet"], folder.path());
    assert_eq!(output.status.code(), Some(1));
    assert_eq!((&json(&output)["ok"], json(&output)["faults"].as_array().unwrap().len()), (&false.into(), 1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("4 bytes"), "{output:?}");

    let output = run(&["check"], &folder.path().join("missing"));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("config.json"), "{output:?}");
}

#[test]
fn info_names_hours_and_lamps() {
    let folder = tempfile::tempdir().unwrap();
    write_set(folder.path(), &[(20, 20), (7, 3)], 1).unwrap();
    let object = json(&run(&["info", "--json"], folder.path()));
    assert_eq!(
        object["sets"][2],
        serde_json::json!({"hour": 21.5, "on": ["porch", "garden"], "relative_error": 0.01})
    );
    assert_eq!(object["pages"][1], serde_json::json!({"width": 7, "height": 3, "valid_texels": 20}));
    let output = run(&["info"], folder.path());
    assert!(String::from_utf8_lossy(&output.stdout).contains("21.5 h  porch, garden"), "{output:?}");
}

#[test]
fn what_is_no_set_is_said_with_its_name_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hut.toml");
    fs::write(&file, "name = 1").unwrap();
    for command in ["info", "check"] {
        for (path, found) in [
            (file.clone(), "it is a file"),
            (folder.path().join("none"), "it does not exist"),
            (folder.path().to_owned(), "there is no config.json in it"),
        ] {
            let output = run(&[command], &path);
            let message = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{message}");
            let error = message.lines().find(|line| line.starts_with("error: ")).unwrap();
            assert!(error.contains(found) && error.contains("expected the folder"), "{error}");
            assert_eq!(error.matches(path.to_str().unwrap()).count(), 1, "{error}");
        }
    }
}
