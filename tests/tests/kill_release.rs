//! `dataset release`, and what else makes a new folder (`export`, `halve`), killed at every call by which it
//! changes the disk, and left by a power failure there: see `kill_bake.rs` for how.
//!
//! The folder is there whole or not at all.
//!
//! `cargo test --release -p pipeline-tests --test kill_release -- --nocapture` prints the calls.

use dataset::observe::Silent;
use dataset::release::verify;
use dataset::store::Dataset;
use pipeline_tests::faults::{Faults, Sweep, Tree, court, differences, program, text};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A small dataset with its bundle.
fn dataset(root: &Path) -> PathBuf {
    let (scene, dataset) = (court(root, 32, 800), root.join("court"));
    let mut bake = program("bake");
    bake.arg(&scene).args(["--hours", "12", "--samples", "4"]).arg("--out").arg(&dataset);
    let mut compress = program("compress");
    compress.arg(&dataset).args(["--iterations", "20"]);
    for command in [&mut bake, &mut compress] {
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", text(&output));
    }
    dataset
}

/// Sweeps a command of `dataset` that makes a new folder. `faults_of` says what is wrong with one.
fn sweep(
    faults: &Faults,
    dataset: &Path,
    arguments: &[&str],
    faults_of: &(dyn Fn(&Path) -> Vec<String> + Sync),
) {
    let name = arguments.join(" ");
    let command = |folder: &Path| {
        let mut command = program("dataset");
        command.args(arguments).arg(dataset).arg("--quiet").arg("--out").arg(folder.join("new"));
        command
    };
    let whole = faults.root().join(format!("whole-{}", name.replace(' ', "-")));
    fs::create_dir(&whole).unwrap();
    let output = command(&whole).output().unwrap();
    assert!(output.status.success(), "{name}: {}", text(&output));
    let expected = Tree::read(&whole.join("new"));
    let found = |folder: &Path| {
        let new = folder.join("new");
        match new.exists() {
            true => faults_of(&new)
                .into_iter()
                .chain(differences(&Tree::read(&new), &expected, |_| true))
                .collect(),
            false => Vec::new(),
        }
    };
    // A folder that is there is not made again: that is refused, and no fault. (Whoever goes on with it makes
    // its name durable.)
    let again = |folder: &Path| match folder.join("new").exists() {
        true => {
            let mut command = Command::new("sync");
            command.arg(folder);
            command
        }
        false => command(folder),
    };
    let swept = Sweep {
        name: &name,
        start: None,
        command: &again,
        faults: &found,
        is_same: |_| true,
        counts: |_, _| true,
        may_return: |path| path.to_string_lossy().contains(".tmp-"),
    };
    let swept = swept.run(faults);
    for kind in ["create", "rename", "mkdir", "fsync", "fsync of a folder"] {
        assert!(swept.calls.get(kind).is_some_and(|count| *count > 0), "no {kind}: {:?}", swept.calls);
    }
}

/// What is wrong with a release.
fn of_release(folder: &Path) -> Vec<String> {
    let quiet = Silent;
    match verify(folder, &quiet) {
        Ok(found) => found.faults.iter().map(ToString::to_string).collect(),
        Err(error) => vec![error.to_string()],
    }
}

/// Functions of the C library by which what is on a disk changes.
const CHANGES: &str = "open open64 openat openat64 creat creat64 fopen fopen64 freopen freopen64 tmpfile mkstemp mkstemp64 mkdtemp rename \
    renameat renameat2 link linkat symlink symlinkat unlink unlinkat remove rmdir mkdir mkdirat mknod mknodat truncate truncate64 \
    ftruncate ftruncate64 fallocate fallocate64 posix_fallocate fsync fdatasync sync syncfs sync_file_range";

/// The names in a program's or library's table of symbols, of those that it has or of those that it asks for.
fn symbols(file: &Path, which: &str) -> BTreeSet<String> {
    let output = Command::new("nm").args(["-D", "--format=posix", which]).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    let lines = String::from_utf8(output.stdout).unwrap();
    lines.lines().filter_map(|line| Some(line.split([' ', '@']).next()?.to_owned())).collect()
}

#[test]
fn the_library_stands_before_every_call_that_changes_the_disk() {
    let faults = Faults::new();
    let known = symbols(faults.library(), "--defined-only");
    for name in ["bake", "compress", "dataset"] {
        let asked = symbols(Path::new(program(name).get_program()), "--undefined-only");
        let used: Vec<&str> = CHANGES.split_whitespace().filter(|call| asked.contains(*call)).collect();
        println!("{name} calls {}", used.join(", "));
        assert!(used.contains(&"rename") && used.contains(&"fsync") && used.contains(&"open64"), "{used:?}");
        let unknown: Vec<&&str> = used.iter().filter(|call| !known.contains(**call)).collect();
        assert!(unknown.is_empty(), "{name}: not counted: {unknown:?}");
    }
}

#[test]
fn a_release_is_killed_at_every_call() {
    let faults = Faults::new();
    let dataset = dataset(faults.root());
    assert!(dataset.join("court.ndgi").exists());
    sweep(&faults, &dataset, &["release"], &of_release);
}

#[test]
fn other_new_folders_are_there_whole_or_not_at_all() {
    let faults = Faults::new();
    let dataset = dataset(faults.root());
    sweep(&faults, &dataset, &["export", "--layout", "hprc2"], &|_| Vec::new());
    sweep(&faults, &dataset, &["halve"], &|folder| {
        Dataset::open(folder).err().map(|e| e.to_string()).into_iter().collect()
    });
}

#[test]
#[ignore = "takes a minute more: with a layout of exchange"]
fn a_release_with_a_layout_is_killed_at_every_call() {
    let faults = Faults::new();
    let dataset = dataset(faults.root());
    sweep(&faults, &dataset, &["release", "--layout", "hprc2"], &of_release);
}
