//! Training as array jobs: shares of the tiles by processes that know nothing of each other, then a merge.
//! Whatever their number, order, repetition and deaths, the bundle has the bytes of one process alone.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{Scene, islands};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Enough tiles for several shards: islands on 3 × 3 tiles, one of them without a valid texel.
fn archipelago() -> Scene {
    Scene {
        width: 378,
        height: 378,
        valid: |x, y| {
            let (column, row) = (x / 126, y / 126);
            (column, row) != (1, 1) && (20..70).contains(&(x % 126)) && (20..60).contains(&(y % 126))
        },
        light: |x, y, hour, lamp| {
            let lamp = if lamp { 2.0 / (1.0 + 0.01 * (x % 126) as f32) } else { 0.0 };
            let day = (1.0 - ((hour - 12.0) / 6.5).powi(2)).max(0.0) as f32;
            [day + lamp, day * (1.0 + 0.005 * y as f32) + 0.5 * lamp, 1.5 * day + 0.1 * lamp]
        },
        ..islands()
    }
}

fn command(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_compress"));
    command.args(arguments).current_dir(folder).args(["--threads", "1"]);
    command
}

fn run(arguments: &[&str], folder: &Path) -> Output {
    command(arguments, folder).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The command's answer; it succeeded.
fn json(arguments: &[&str], folder: &Path) -> Value {
    let output = run(&[arguments, &["--json"]].concat(), folder);
    assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What the command says; it failed with that exit code.
fn refused(arguments: &[&str], folder: &Path, code: i32) -> String {
    let output = run(arguments, folder);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", said(&output));
    said(&output)
}

fn start(arguments: &[&str], folder: &Path) -> Child {
    command(arguments, folder).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// The tiles and other parts in a bundle's work folder.
fn parts(folder: &Path, bundle: &str) -> usize {
    let entries = fs::read_dir(folder.join(format!("{bundle}.part"))).into_iter().flatten().flatten();
    entries.filter(|entry| entry.path().extension().is_some_and(|e| e == "tile")).count()
}

#[test]
fn shards_give_the_bytes_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    archipelago().write(folder);
    let recipe = ["--iterations", "200"];
    json(&[&["."][..], &recipe, &["--out", "whole.ndgi"]].concat(), folder);
    let whole = fs::read(folder.join("whole.ndgi")).unwrap();
    // 1; 3 backwards, one twice; 7 at the same time; more shards than tiles.
    for (of, order) in [(1, vec![1]), (3, vec![3, 2, 2, 1]), (7, (1..=7).collect()), (11, (1..=11).collect())]
    {
        let out = format!("{of}.ndgi");
        let merge = [&["."][..], &recipe, &["--out", &out, "--merge"]].concat();
        assert!(refused(&merge, folder, 75).contains("trained tiles of 8 of 8 tiles are missing"));
        let names: Vec<String> = order.iter().map(|number| format!("{number}/{of}")).collect();
        let shard = |name| [&["."][..], &recipe, &["--out", &out, "--shard", name]].concat();
        match of {
            7 => {
                let mut children: Vec<Child> = names.iter().map(|name| start(&shard(name), folder)).collect();
                assert!(children.iter_mut().all(|child| child.wait().unwrap().success()));
            }
            _ => names.iter().for_each(|name| assert_eq!(json(&shard(name), folder)["stage"], "training")),
        }
        let status = json(&["status", ".", "--out", &out], folder);
        assert_eq!([&status["done"], &status["tiles"]], [8, 8], "{status}");
        assert!(!folder.join(&out).exists());
        let merged = json(&merge, folder);
        assert_eq!([&merged["tiles_resumed"], &merged["tiles_empty"]], [8, 1], "{merged}");
        assert!(whole == fs::read(folder.join(&out)).unwrap(), "{of} shards: other bytes");
        assert!(!folder.join(format!("{out}.part")).exists());
        // Whoever comes late finds it done.
        assert_eq!(json(&shard(&names[0]), folder)["stage"], "up to date");
        assert_eq!(json(&merge, folder)["up_to_date"], true);
        assert!(!folder.join(format!("{out}.part")).exists());
        // Not even a folder that others may be using is touched.
        let used = folder.join(format!("{out}.part"));
        fs::create_dir(&used).unwrap();
        fs::write(used.join("a.tile"), b"of another").unwrap();
        assert_eq!(json(&shard(&names[0]), folder)["stage"], "up to date");
        assert_eq!(fs::read_dir(&used).unwrap().count(), 1);
        fs::remove_dir_all(used).unwrap();
    }
}

#[test]
fn a_killed_shard_is_named_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    archipelago().write(folder);
    let recipe = [".", "--iterations", "1500", "--out", "a.ndgi"];
    let shard = |name| [&recipe[..], &["--shard", name]].concat();
    let merge = [&recipe[..], &["--merge"]].concat();
    let mut child = start(&shard("1/2"), folder);
    let begun = Instant::now();
    while parts(folder, "a.ndgi") < 2 {
        assert!(begun.elapsed() < Duration::from_secs(120) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(2));
    }
    // While it works nobody else has the folder alone; callers that share it may come in, and a merge that
    // asks how far it is keeps nobody out.
    assert!(refused(&recipe, folder, 75).contains("another run is writing this bundle"));
    assert!(refused(&merge, folder, 75).contains("of 8 tiles are missing"));
    child.kill().unwrap();
    child.wait().unwrap();
    json(&shard("2/2"), folder);
    let reported = refused(&merge, folder, 75);
    assert!(
        reported.contains("of 8 tiles are missing: page 0 (") && reported.contains("unfinished: 1/2 on "),
        "{reported}"
    );
    let status = json(&["status", ".", "--out", "a.ndgi"], folder);
    assert!(status["done"].as_u64() < Some(8) && status["tiles"] == 8, "{status}");
    assert!(json(&shard("1/2"), folder)["tiles_resumed"].as_u64() > Some(0));
    json(&merge, folder);
    let merged = fs::read(folder.join("a.ndgi")).unwrap();
    json(&[&recipe[..], &["--force"]].concat(), folder);
    assert!(merged == fs::read(folder.join("a.ndgi")).unwrap());
    // A bundle of longer training gives way to none of shorter, unless that is requested; nobody retries
    // that.
    let shorter = [".", "--iterations", "100", "--out", "a.ndgi"];
    let reported = refused(&[&shorter[..], &["--shard", "1/1"]].concat(), folder, 1);
    assert!(reported.contains("trained for 1500 steps") && reported.contains("--force"), "{reported}");
    json(&[&shorter[..], &["--shard", "1/1", "--force"]].concat(), folder);
    json(&[&shorter[..], &["--merge", "--force"]].concat(), folder);
    assert!(!folder.join("a.ndgi.part").exists());
    assert!(merged != fs::read(folder.join("a.ndgi")).unwrap());
}

#[test]
fn a_target_is_tried_chosen_and_trained_by_shards() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // (A merge that chooses for a PSNR trains four tiles to learn what training gains; here are five.)
    Scene { width: 252, ..archipelago() }.write(folder);
    for target in [["--target-psnr", "42"], ["--target-bpp", "0.2"]] {
        let recipe = [&["."][..], &target, &["--iterations", "300"]].concat();
        let with = |more: &[&'static str]| [&recipe[..], more].concat();
        json(&with(&["--out", "whole.ndgi", "--force"]), folder);
        let shards = |stage: &str| {
            for name in ["2/2", "1/2"] {
                assert_eq!(
                    json(&with(&["--out", "b.ndgi", "--force", "--shard", name]), folder)["stage"],
                    stage
                );
            }
        };
        let merge = with(&["--out", "b.ndgi", "--merge", "--force"]);
        assert_eq!(json(&with(&["--out", "b.ndgi", "--force", "--shard", "1/2"]), folder)["stage"], "trials");
        let reported = refused(&merge, folder, 75);
        assert!(
            reported.contains("trial fits of 3 of 5 tiles are missing")
                && reported.contains("2/2 not started"),
            "{reported}"
        );
        shards("trials");
        assert!(refused(&merge, folder, 75).contains("trained tiles of "));
        shards("training");
        json(&merge, folder);
        assert!(fs::read(folder.join("whole.ndgi")).unwrap() == fs::read(folder.join("b.ndgi")).unwrap());
        assert!(!folder.join("b.ndgi.part").exists());
    }
}

#[test]
fn of_a_dataset_without_a_valid_texel_nothing_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    Scene { valid: |_, _| false, ..archipelago() }.write(folder);
    for target in [&[][..], &["--target-psnr", "40"]] {
        let with = |more: &[&'static str]| [&[".", "--iterations", "50"][..], target, more].concat();
        json(&with(&["--out", "whole.ndgi", "--force"]), folder);
        for name in ["1/2", "2/2"] {
            json(&with(&["--out", "a.ndgi", "--force", "--shard", name]), folder);
        }
        let output = run(&["status", ".", "--out", "a.ndgi"], folder);
        let line = String::from_utf8(output.stdout).unwrap();
        assert!(line.contains(": 0 of 0 tiles (100 %); 2 of 2 shards finished\n"), "{line}");
        json(&with(&["--out", "a.ndgi", "--force", "--merge"]), folder);
        assert!(fs::read(folder.join("whole.ndgi")).unwrap() == fs::read(folder.join("a.ndgi")).unwrap());
    }
}

#[test]
fn what_shards_cannot_do_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    archipelago().write(folder);
    for (words, what) in [
        (&["--shard", "0/3"][..], "numbered from 1"),
        (&["--shard", "4/3"], "such as 2/7"),
        (&["--shard", "1/3", "--time-limit", "1m"], "cannot be used with"),
        (&["--shard", "1/3", "--levels"], "cannot be used with"),
        (&["--shard", "1/3", "--merge"], "cannot be used with"),
        (&["--instructions", "mmx"], "this processor has portable"),
    ] {
        let reported = refused(&[&["."], words].concat(), folder, 2);
        assert!(reported.contains(what), "{words:?}: {reported}");
    }
    // Machines of unlike processors: the merge says so, and the option that makes them alike.
    let tiers = compressor::lanes::Tier::available().len();
    if tiers > 1 {
        let recipe = [".", "--iterations", "50", "--out", "a.ndgi"];
        json(&[&recipe[..], &["--shard", "1/1", "--instructions", "portable"]].concat(), folder);
        let reported = refused(&[&recipe[..], &["--merge"]].concat(), folder, 75);
        assert!(
            reported.contains("uses Portable instructions") && reported.contains("--instructions"),
            "{reported}"
        );
        json(&[&recipe[..], &["--merge", "--instructions", "portable"]].concat(), folder);
    }
    // A bad texel stops the shards that read its rows, and the merge, for good.
    let maps = fs::read_dir(folder.join("data")).unwrap().flatten().map(|entry| entry.path());
    let map = maps.filter(|path| path.extension().is_some_and(|e| e == "exr")).max().unwrap();
    let intact = fs::read(&map).unwrap();
    let mut bytes = intact.clone();
    let middle = bytes.len() / 2;
    bytes[middle..].iter_mut().for_each(|byte| *byte ^= 0x55);
    fs::write(&map, bytes).unwrap();
    assert!(!folder.join("b.ndgi.part").exists());
    refused(&[".", "--iterations", "60", "--out", "b.ndgi", "--merge"], folder, 75);
    assert!(!folder.join("b.ndgi.part").exists());
    let recipe = [".", "--iterations", "60", "--out", "b.ndgi"];
    for number in ["1/3", "2/3", "3/3"] {
        run(&[&recipe[..], &["--shard", number]].concat(), folder);
    }
    let reported = refused(&[&recipe[..], &["--merge"]].concat(), folder, 1);
    assert!(reported.contains(" failed: ") && reported.contains(".exr"), "{reported}");
    // Of other options nothing is known.
    let reported = refused(&[".", "--iterations", "61", "--out", "b.ndgi", "--merge"], folder, 75);
    assert!(reported.contains("had other options"), "{reported}");
    // Once the file is restored, shards that run again take their words back.
    fs::write(&map, intact).unwrap();
    for number in ["1/3", "2/3", "3/3"] {
        assert!(!folder.join("b.ndgi").exists());
        json(&[&recipe[..], &["--shard", number]].concat(), folder);
    }
    json(&[&recipe[..], &["--merge"]].concat(), folder);
    fs::remove_file(folder.join("b.ndgi")).unwrap();
    assert!(!folder.join("b.ndgi").exists());
}
