//! `compress`, killed at every call by which it changes the disk, and left by a power failure there: see
//! `kill_bake.rs` for how.
//!
//! Whatever happened, a bundle that is there is the one of before or the one that is made, byte for byte, and
//! opens.
//!
//! `cargo test --release -p pipeline-tests --test kill_compress -- --nocapture` prints the calls; `--ignored`
//! sweeps more ways to compress.

use ndgi::Bundle;
use pipeline_tests::faults::{Faults, Sweep, Swept, copy, court, program, text};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Bakes the court with pages of so many texels a side, for two sets.
fn baked(root: &Path, side: usize) -> PathBuf {
    let (scene, out) = (court(root, side, 800), root.join("dataset"));
    let output = program("bake")
        .arg(&scene)
        .args(["--hours", "11,12", "--samples", "4"])
        .arg("--out")
        .arg(&out)
        .output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", text(&output));
    out
}

fn compress(dataset: &Path, arguments: &[&str], folder: &Path) -> Command {
    let mut command = program("compress");
    command.arg(dataset).args(arguments).arg("--quiet").arg("--out").arg(folder.join("court.ndgi"));
    command
}

/// The bundles in a folder, by name and content.
fn bundles(folder: &Path) -> BTreeSet<(PathBuf, Vec<u8>)> {
    let paths = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    let bundles = paths.filter(|path| path.extension().is_some_and(|extension| extension == "ndgi"));
    bundles.map(|path| (PathBuf::from(path.file_name().unwrap()), fs::read(&path).unwrap())).collect()
}

/// All but what tells of the run.
fn is_same(path: &Path) -> bool {
    let name = path.to_string_lossy();
    !name.ends_with(".run.json") && !name.ends_with(".html") && !name.ends_with(".lock")
}

/// Work that was done with, and temporaries.
fn may_return(path: &Path) -> bool {
    let text = path.to_string_lossy();
    [".ndgi.part", ".ndgi.levels", ".tmp-"].iter().any(|part| text.contains(part))
}

fn sweep(
    faults: &Faults,
    name: &str,
    start: Option<&Path>,
    command: &(dyn Fn(&Path) -> Command + Sync),
) -> Swept {
    let whole = faults.root().join(format!("bundles-{}", name.replace(' ', "-")));
    start.map_or_else(|| fs::create_dir_all(&whole).unwrap(), |start| copy(start, &whole));
    let mut good = bundles(&whole);
    let output = command(&whole).output().unwrap();
    assert!(output.status.success(), "{name}: {}", text(&output));
    good.extend(bundles(&whole));
    assert!(!good.is_empty());
    let found = |folder: &Path| {
        let mut wrong = Vec::new();
        let there = bundles(folder);
        for of in there.difference(&good) {
            wrong.push(format!("{}: neither the old bundle nor the new", of.0.display()));
        }
        for (name, _) in &there {
            wrong.extend(
                Bundle::open(&folder.join(name)).err().map(|error| format!("{}: {error}", name.display())),
            );
        }
        if start.is_some() && !folder.join("court.ndgi").exists() {
            wrong.push("the bundle is gone".to_owned());
        }
        wrong
    };
    Sweep { name, start, command, faults: &found, is_same, counts: |_, _| true, may_return }.run(faults)
}

/// Compresses, and compresses again in the place of that.
fn all(side: usize, ways: &[&[&str]], others: &[&[&str]]) {
    let faults = Faults::new();
    let dataset = baked(faults.root(), side);
    let first = ["--iterations", "20"];
    for way in ways {
        let name = format!("compress {}", way.join(" ")).trim_end().to_owned();
        let swept =
            sweep(&faults, &name, None, &|folder| compress(&dataset, &[&first[..], way].concat(), folder));
        for kind in ["create", "rename", "unlink", "mkdir", "rmdir", "fsync", "fsync of a folder"] {
            assert!(swept.calls.get(kind).is_some_and(|count| *count > 0), "no {kind}: {:?}", swept.calls);
        }
    }
    let start = faults.root().join("start");
    fs::create_dir(&start).unwrap();
    let output = compress(&dataset, &[&first[..], ways[0]].concat(), &start).output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    for other in others {
        let name = format!("compress again {}", other.join(" "));
        sweep(&faults, &name, Some(&start), &|folder| {
            compress(&dataset, &[&first[..], other].concat(), folder)
        });
    }
}

#[test]
fn a_compression_is_killed_at_every_call() {
    all(64, &[&[]], &[&["--seed", "2"]]);
}

#[test]
fn a_compression_to_planes_is_killed_at_every_call() {
    let faults = Faults::new();
    let dataset = baked(faults.root(), 64);
    for way in [&["--coding", "basis"][..], &["--coding", "basis", "--target-bpp", "1"]] {
        sweep(&faults, &way.join(" "), None, &|folder| compress(&dataset, way, folder));
    }
}

#[test]
#[ignore = "takes minutes: more ways to compress"]
fn more_compressions_are_killed_at_every_call() {
    let ways: [&[&str]; 3] = [&["--levels"], &["--target-psnr", "30"], &["--target-bpp", "2"]];
    all(130, &ways, &[&["--levels", "--seed", "2"], &["--levels", "--force"], &["--target-psnr", "35"]]);
}
