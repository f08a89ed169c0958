//! Files of the unfinished work that are lost, damaged or older than the rest: what depends on them is traced
//! again, to the same bytes.

use crate::{court, data, fixture, kill_midway, text};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs a bake up to its last round and no further: a file stands where the folder of finished layers is to
/// be made.
pub fn stop_after_the_last_round(command: &mut Command, out: &Path) {
    std::fs::create_dir_all(out.join(".bake")).unwrap();
    // (Charts that an earlier run kept there are no part of the work.)
    let _ = std::fs::remove_dir_all(out.join(".layers"));
    std::fs::write(out.join(".layers"), b"").unwrap();
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    std::fs::remove_file(out.join(".layers")).unwrap();
    assert!(work(out, "rounds.json").exists() && !out.join("config.json").exists());
}

/// Copies a folder with all that is in it.
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &target),
            false => drop(std::fs::copy(entry.path(), target).unwrap()),
        }
    }
}

/// A file of the only work in a folder.
fn work(out: &Path, name: &str) -> PathBuf {
    let mut folders = std::fs::read_dir(out.join(".bake")).unwrap();
    folders.next().unwrap().unwrap().path().join(name)
}

/// The blocks of the work, in order.
fn blocks(out: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(work(out, "")).unwrap().map(|entry| entry.unwrap().path());
    let is_block = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with("block-");
    let mut blocks: Vec<PathBuf> = entries.filter(is_block).collect();
    blocks.sort();
    assert!(blocks.len() > 2, "{blocks:?}");
    blocks
}

/// What a run that goes on says, and that it comes to the bytes of an undisturbed one.
fn goes_on(command: &mut Command, whole: &Path, out: &Path, what: &str) -> String {
    let output: Output = command.output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{what}: {said}");
    assert!(data(whole) == data(out), "{what}: other bytes; {said}");
    assert!(!out.join(".bake").exists(), "{what}");
    said
}

/// What happens to the blocks of a work.
type Loss = fn(&[PathBuf]);

/// Ways in which a block can be lost.
const LOSSES: [(&str, Loss); 4] = [
    ("removed", |blocks| std::fs::remove_file(&blocks[0]).unwrap()),
    ("cut short", |blocks| {
        let file = std::fs::OpenOptions::new().write(true).open(&blocks[1]).unwrap();
        file.set_len(file.metadata().unwrap().len() / 2).unwrap();
    }),
    ("one bit wrong", |blocks| {
        let mut bytes = std::fs::read(&blocks[0]).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&blocks[0], bytes).unwrap();
    }),
    ("another block's", |blocks| {
        std::fs::copy(&blocks[1], &blocks[0]).unwrap();
    }),
];

#[test]
fn a_lost_block_is_traced_again() {
    let dir = tempfile::tempdir().unwrap();
    for (mode, arguments) in [
        ("cached", &["--samples", "16"][..]),
        ("path", &["--samples", "16", "--integrator", "path"]),
        ("target", &["--samples", "64", "--target-error", "3%"]),
        ("limit", &["--samples", "32", "--time-limit", "1h"]),
    ] {
        let bake = |out: &Path| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
            command.arg(fixture("court.toml")).args(["--hours", "12,18.1", "--quiet", "--out", text(out)]);
            command.args(arguments);
            command
        };
        let whole = dir.path().join(mode);
        assert!(bake(&whole).status().unwrap().success());
        let stopped = dir.path().join(format!("{mode}, stopped"));
        stop_after_the_last_round(&mut bake(&stopped), &stopped);
        for (how, lose) in LOSSES {
            let out = dir.path().join(format!("{mode}, {how}"));
            copy(&stopped, &out);
            lose(&blocks(&out));
            let said = goes_on(&mut bake(&out), &whole, &out, &format!("{mode}, {how}"));
            assert!(said.contains("1 block of the unfinished work here was missing, damaged"), "{said}");
        }
        // All of them.
        let out = dir.path().join(format!("{mode}, all"));
        copy(&stopped, &out);
        blocks(&out).iter().for_each(|block| std::fs::remove_file(block).unwrap());
        goes_on(&mut bake(&out), &whole, &out, &format!("{mode}, all"));
    }
}

#[test]
fn a_block_that_is_older_than_the_finished_rounds_is_brought_on() {
    let dir = tempfile::tempdir().unwrap();
    let (whole, out) = (dir.path().join("whole"), dir.path().join("out"));
    assert!(court(&whole, "128", "cached").status().unwrap().success());
    assert!(kill_midway(&out, "128", "cached"), "the bake ended before it was killed");
    let old: Vec<Vec<u8>> = blocks(&out).iter().map(|block| std::fs::read(block).unwrap()).collect();
    stop_after_the_last_round(&mut court(&out, "128", "cached"), &out);
    let blocks = blocks(&out);
    assert!(old[0] != std::fs::read(&blocks[0]).unwrap() && old[2] != std::fs::read(&blocks[2]).unwrap());
    for block in [0, 2] {
        std::fs::write(&blocks[block], &old[block]).unwrap();
    }
    let said = goes_on(&mut court(&out, "128", "cached"), &whole, &out, "older blocks");
    assert!(said.contains("2 blocks of the unfinished work here were"), "{said}");
}

#[test]
fn a_bake_whose_time_ran_out_in_its_last_round_is_not_traced_on() {
    let dir = tempfile::tempdir().unwrap();
    let bake = |out: &Path, limit: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
        command.arg(fixture("court.toml")).args(["--hours", "12,18.1", "--time-limit", limit, "--json"]);
        command.args(["--out", text(out)]);
        command
    };
    let rounds = |out: &Path| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(work(out, "rounds.json")).unwrap()).unwrap()
    };
    // (Between two rounds the time runs out seldom.)
    let is_late = |limit: &&str| {
        let out = dir.path().join(limit);
        stop_after_the_last_round(&mut bake(&out, limit), &out);
        rounds(&out).as_array().unwrap().last().unwrap()["is_late"] == true
    };
    let limit = ["1s", "1.3s", "1.7s", "2s", "3s", "5s", "8s", "13s"]
        .into_iter()
        .find(is_late)
        .expect("a round cut by the limit");
    let out = dir.path().join(limit);
    let before = rounds(&out);
    let output = bake(&out, limit).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && !said.contains("unfinished work"), "{said}");
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&object["rays"]["path"], &object["out_of_time"]), (&0.into(), &true.into()), "{object}");
    assert_eq!(object["rounds"], before);
}

#[test]
fn where_a_decision_is_lost_the_work_starts_over() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole");
    assert!(court(&whole, "16", "cached").status().unwrap().success());
    let stopped = dir.path().join("stopped");
    stop_after_the_last_round(&mut court(&stopped, "16", "cached"), &stopped);
    for name in ["rounds.json", "direct.json", "pivot.json", "cache.bin"] {
        for torn in [false, true] {
            let out = dir.path().join(format!("{name}-{torn}"));
            copy(&stopped, &out);
            match torn {
                true => std::fs::write(work(&out, name), b"[1").unwrap(),
                false => std::fs::remove_file(work(&out, name)).unwrap(),
            }
            let said = goes_on(&mut court(&out, "16", "cached"), &whole, &out, name);
            assert!(said.contains("it starts over"), "{name}: {said}");
        }
    }
    // Nothing lost: nothing said.
    let said = goes_on(&mut court(&stopped, "16", "cached"), &whole, &stopped, "nothing lost");
    assert!(!said.contains("unfinished work"), "{said}");
}

#[test]
fn a_bake_that_was_killed_between_the_names_of_two_layers_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let (whole, out) = (dir.path().join("whole"), dir.path().join("out"));
    for out in [&whole, &out] {
        assert!(court(out, "2", "cached").status().unwrap().success());
    }
    let layers = std::fs::read_dir(out.join(".layers")).unwrap().map(|e| e.unwrap().path());
    let layers: Vec<PathBuf> = layers.filter(|p| p.extension().is_some_and(|e| e == "layer")).collect();
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    let temporary = |path: &Path| format!(".{}.tmp-of-a-killed-run", name(path));
    // As a run leaves it that was killed when some of its layers had their names.
    let leave = || {
        let names: Vec<[String; 2]> = layers.iter().map(|path| [temporary(path), name(path)]).collect();
        let changes = serde_json::json!({ "name": names });
        std::fs::write(out.join(".layers/changes.json"), changes.to_string()).unwrap();
        for path in &layers[1..] {
            std::fs::rename(path, path.with_file_name(temporary(path))).unwrap();
        }
        std::fs::remove_file(out.join("config.json")).unwrap();
        let digests = layers.iter().map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned());
        let work = out.join(".bake/0123456789abcdef");
        std::fs::create_dir_all(&work).unwrap();
        std::fs::write(work.join("layers.json"), format!("{:?}", digests.collect::<Vec<_>>())).unwrap();
        std::fs::write(work.join("rounds.json"), "[]").unwrap();
    };
    leave();
    let output = court(&out, "2", "cached").arg("--json").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["layers"]["traced"], 0, "{object}");
    assert!(data(&whole) == data(&out));
    let count = |out: &Path| std::fs::read_dir(out.join(".layers")).unwrap().count();
    assert!(count(&out) == count(&whole) && !out.join(".bake").exists());
    // A plan finds them, and writes nothing.
    leave();
    let planned = court(&out, "2", "cached").arg("--plan").output().unwrap();
    let words = String::from_utf8(planned.stdout).unwrap();
    assert!(words.contains("not traced again") && !words.contains("refused"), "{words}");
    assert!(out.join(".layers/changes.json").exists());
}
