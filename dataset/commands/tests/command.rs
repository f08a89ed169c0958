//! The `dataset` command as a user runs it.

#[path = "../../tests/common/mod.rs"]
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
fn a_complete_dataset_passes_and_a_truncated_one_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let output = run(&["check", "--json"], folder.path());
    assert!(output.status.success(), "{output:?}");
    assert_eq!((&json(&output)["ok"], &json(&output)["frames"]), (&true.into(), &3.into()));

    let victim = folder.path().join(&config.frames[1].maps[0].path);
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
fn info_names_hours_and_light_groups() {
    let folder = tempfile::tempdir().unwrap();
    write_set(folder.path(), &[(20, 20), (7, 3)], 1).unwrap();
    let object = json(&run(&["info", "--json"], folder.path()));
    assert_eq!(
        object["frames"][2],
        serde_json::json!({"hour": 21.5, "on": ["porch", "garden"], "relative_error": 0.01})
    );
    assert_eq!(object["pages"][1], serde_json::json!({"width": 7, "height": 3, "valid_texels": 20}));
    assert_eq!((&object["version"], &object["sun"]), (&2.into(), &"all".into()));
    assert_eq!(
        object["layers"][3],
        serde_json::json!({"light": "group", "group": "porch", "part": "direct", "images": 2, "curve": false})
    );
    let output = run(&["info"], folder.path());
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("21.5 h  porch, garden"), "{text}");
    // At noon alone, on two pages.
    assert!(
        text.contains("layer  sun, indirect: 2 images") && text.contains("layer  garden, indirect: 2"),
        "{text}"
    );
}

#[test]
fn what_is_not_a_dataset_is_named_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hut.toml");
    fs::write(&file, "name = 1").unwrap();
    for command in ["info", "check"] {
        for (path, found) in [
            (file.clone(), "it is not a folder"),
            (folder.path().join("none"), "it does not exist"),
            (folder.path().to_owned(), "it has no config.json"),
        ] {
            let output = run(&[command], &path);
            let message = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{message}");
            let error = message.lines().find(|line| line.starts_with("error: ")).unwrap();
            assert!(error.contains(found) && error.contains("expected a folder"), "{error}");
            assert_eq!(error.matches(path.to_str().unwrap()).count(), 1, "{error}");
        }
    }
}

#[test]
fn inputs_that_are_missing_or_of_another_kind_are_named_with_what_was_expected() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let out = at("out").display().to_string();
    fs::write(at("file"), b"x").unwrap();
    fs::create_dir(at("folder.toml")).unwrap();
    let frame = "[[frame]]\nhour = 5\nfiles = [\"dawn.exr\"]\n";
    fs::write(at("frames.toml"), frame).unwrap();
    fs::write(at("masks.toml"), format!("[[page]]\nmask = \"mask.png\"\n{frame}")).unwrap();
    let mask = at("mask.png").display().to_string();
    let of_layout = |layout| vec!["import", "--out", &out, "--layout", layout];
    let of_pattern = ["import", "--out", &out, "--pattern", "{hour}.exr"];
    for (arguments, path, named, expected) in [
        (of_layout("hprc1"), "none", "none", "no such folder; expected a folder in the layout hprc1"),
        (of_layout("hprc2"), "none", "none", "no such folder; expected a folder in the layout hprc2"),
        (
            of_layout("hprc2"),
            "",
            "config.json",
            "no such file; expected the configuration of the layout hprc2",
        ),
        (of_pattern.to_vec(), "none", "none", "no such folder; expected a folder of EXR files"),
        ([&of_pattern[..], &["--mask", &mask]].concat(), "", "mask.png", "no such file; expected the mask"),
        (
            of_pattern[..3].to_vec(),
            "none",
            "none",
            "no such file or folder; expected a folder, with --layout",
        ),
        (of_pattern[..3].to_vec(), "none.toml", "none.toml", "no such file; expected a TOML file"),
        (of_pattern[..3].to_vec(), "folder.toml", "folder.toml", "is a folder; expected a TOML file"),
        (of_pattern[..3].to_vec(), "frames.toml", "dawn.exr", "no such file; expected an EXR image: "),
        (
            of_pattern[..3].to_vec(),
            "masks.toml",
            "mask.png",
            "no such file; expected a PNG, JPEG or EXR image: ",
        ),
        (vec!["verify"], "none", "none", "no such folder; expected a release"),
        (vec!["verify"], "file", "file", "is not a folder; expected a release"),
        (vec!["verify"], "folder.toml", "folder.toml/SHA256SUMS", "no such file; expected a release"),
    ] {
        let output = run(&arguments, &folder.path().join(path));
        let message = String::from_utf8_lossy(&output.stderr);
        let place = folder.path().join(named);
        assert!(
            message.contains(&format!("error: {}: {expected}", place.display())),
            "{arguments:?}: {message}"
        );
        assert!(!message.contains("os error") && output.status.code() == Some(1), "{message}");
        assert!(!at("out").exists());
    }
}

#[test]
fn import_and_export_report_what_they_did() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    common::layouts::write2(Path::new(&at("contest")));
    let output =
        run(&["import", "--json", "--layout", "hprc2", "--out", &at("set")], Path::new(&at("contest")));
    assert!(output.status.success(), "{output:?}");
    let object = json(&output);
    assert_eq!(
        (&object["scene"], &object["pages"], &object["groups"]),
        (&"set".into(), &2.into(), &["local"].into())
    );
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("2 pages, 7 frames, layers unknown"),
        "{output:?}"
    );

    let output = run(&["info", "--json"], Path::new(&at("set")));
    let source = &json(&output)["source"];
    assert_eq!((&source["layout"], &source["lightmaps"][1]["id"]), (&"hprc2".into(), &(-1).into()));
    let output = run(&["info"], Path::new(&at("set")));
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(
        text.contains("imported from the layout hprc2") && text.contains("lightmap 4 of Level_A"),
        "{text}"
    );

    let output =
        run(&["export", "--quiet", "--layout", "hprc2", "--out", &at("back")], Path::new(&at("set")));
    assert!(output.status.success() && output.stderr.is_empty() && output.stdout.is_empty(), "{output:?}");
    let [before, after] = ["contest", "back"].map(|name| common::layouts::content(Path::new(&at(name))));
    assert!(before == after);
    // The layout must be told, and a dataset is not written over.
    let output = run(&["import", "--out", &at("other")], Path::new(&at("contest")));
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("expected --layout hprc1 or hprc2"),
        "{output:?}"
    );
    let output = run(&["import", "--layout", "hprc2", "--out", &at("set")], Path::new(&at("contest")));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("stands there already"), "{output:?}");
}

#[test]
fn every_fault_of_a_manifest_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    config.frames[1].hour = 25.0;
    config.groups[1].name.clear();
    config.pages[0].mask.path = "../mask.png".into();
    fs::write(folder.path().join(&config.frames[1].maps[0].path), b"torn").unwrap();
    fs::write(folder.path().join("config.json"), serde_json::to_vec(&config).unwrap()).unwrap();
    let output = run(&["check", "--json"], folder.path());
    let faults =
        json(&output)["faults"].as_array().unwrap().iter().map(|f| f.to_string()).collect::<Vec<_>>();
    for word in ["hour 25", "hour 21.5; expected ascending", "name is empty", "../mask.png", "4 bytes"] {
        assert!(faults.iter().any(|fault| fault.contains(word)), "{word}: {faults:?}");
    }
    assert_eq!((faults.len(), output.status.code()), (5, Some(1)));
}
