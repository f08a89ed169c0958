//! The binary `bake` as a user meets it: killed and continued, bad input, one JSON object.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

fn bake(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_bake")).args(arguments).output().unwrap()
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures").join(name)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The content of every file the manifest stands for, by name.
fn data(dataset: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(dataset.join("data"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .map(|p| (p.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(p).unwrap()))
        .collect();
    files.push(("config.json".to_owned(), std::fs::read(dataset.join("config.json")).unwrap()));
    files.sort();
    files
}

/// Bakes three hours of the court; `samples` per texel.
fn court(out: &Path, samples: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
    command.args(["--hours", "9,12,18.1", "--quiet", "--samples", samples, "--out", text(out)]);
    command.arg(fixture("court.toml"));
    command
}

/// Starts a bake and kills it with SIGKILL as soon as a round is on disk; whether it was still running.
fn kill_midway(out: &Path, samples: &str) -> bool {
    let mut child = court(out, samples).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    let has_rounds = || {
        let folders = std::fs::read_dir(out.join(".bake")).into_iter().flatten().flatten();
        folders.map(|f| f.path().join("rounds.json")).any(|p| p.exists())
    };
    while !has_rounds() && child.try_wait().unwrap().is_none() && start.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    let killed = !child.wait().unwrap().success();
    assert!(!killed || !out.join("config.json").exists());
    killed
}

#[test]
fn a_killed_bake_continues_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let (whole, killed) = (dir.path().join("whole"), dir.path().join("killed"));
    assert!(court(&whole, "256").status().unwrap().success());
    // Killed twice.
    let midway = usize::from(kill_midway(&killed, "256")) + usize::from(kill_midway(&killed, "256"));
    assert!(midway > 0, "the bake was too quick to be killed");
    assert!(court(&killed, "256").status().unwrap().success());
    assert_eq!(data(&whole), data(&killed));
    assert!(!killed.join(".bake").exists());
}

#[test]
fn what_a_killed_bake_left_does_not_change_a_smaller_one() {
    let dir = tempfile::tempdir().unwrap();
    let (fresh, left) = (dir.path().join("fresh"), dir.path().join("left"));
    assert!(court(&fresh, "4").status().unwrap().success());
    // Its first round alone has twice the samples asked for next.
    assert!(kill_midway(&left, "256"), "the bake was too quick to be killed");
    assert!(court(&left, "4").status().unwrap().success());
    assert_eq!(data(&fresh), data(&left));
}

#[test]
fn json_is_one_object_with_the_documented_keys() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let output = bake(&[
        text(&fixture("court.toml")),
        "--hours",
        "12",
        "--samples",
        "4",
        "--json",
        "--out",
        text(&out),
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for key in [
        "scene",
        "dataset",
        "up_to_date",
        "size",
        "sets",
        "texels",
        "samples",
        "relative_error",
        "seconds",
        "rays",
        "rounds",
        "facts",
        "left_out",
        "warnings",
        "report",
    ] {
        assert!(object.get(key).is_some(), "no key {key}");
    }
    assert_eq!(object["sets"], 1);
    assert!(Path::new(object["report"].as_str().unwrap()).exists());
    // At noon the lamps are off: nothing of them is traced, and the run says so.
    assert_eq!(object["rays"]["lamp"], 0);
    assert!(object["left_out"].to_string().contains("lamp"));
}

#[test]
fn bad_input_is_refused_with_its_place_and_nothing_is_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    assert!(
        bake(&[
            text(&fixture("court.toml")),
            "--hours",
            "12",
            "--samples",
            "2",
            "--quiet",
            "--out",
            text(&out)
        ])
        .status
        .success()
    );
    let before = data(&out);

    let obj = std::fs::read_to_string(fixture("court.obj")).unwrap();
    std::fs::write(dir.path().join("court.obj"), obj.replacen("v 4 0 -4", "v 4 nan -4", 1)).unwrap();
    std::fs::copy(fixture("court.toml"), dir.path().join("court.toml")).unwrap();
    let scene = dir.path().join("court.toml");
    let check = |arguments: &[&str], expected: &[&str]| {
        let output = bake(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{message}");
        for word in expected {
            assert!(message.contains(word), "{message:?} does not say {word:?}");
        }
        assert_eq!(data(&out), before);
    };
    check(&[text(&scene), "--hours", "12", "--out", text(&out)], &["court.obj"]);
    check(&[text(&scene), "--hours", "25", "--out", text(&out)], &["--hours", "25"]);
    check(&["no-such.toml", "--out", text(&out)], &["no-such.toml"]);
    check(
        &[text(&fixture("court.toml")), "--samples", "3", "--out", text(&out)],
        &["--samples", "power of two"],
    );
}
