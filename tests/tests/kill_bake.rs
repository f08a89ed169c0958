//! `bake`, killed at every call by which it changes the disk, and left by a power failure there.
//!
//! The program runs under a library ([`pipeline_tests::faults`]) that counts those calls (entries created,
//! linked, renamed, removed; files and folders synced; files cut), and kills the process before call number
//! N: for every N of a run with one thread. What then lies on the disk is looked at as it is, and as a power
//! failure may leave it, in four ways: content that was not synced is gone or half gone, whatever its name is
//! by then; entries of folders that were not synced are undone; all is undone but the last entry. Every state
//! must be whole or clearly unfinished, the same command without `--force` must end well on it with the bytes
//! of an undisturbed run, no temporaries or work folders may stay, and a power failure right after its end
//! must take nothing. States that are equal are looked at once.
//!
//! `cargo test --release -p pipeline-tests --test kill_bake -- --nocapture` prints the calls; `--ignored`
//! sweeps a larger scene.

use dataset::store::{Dataset, MANIFEST};
use pipeline_tests::faults::{Faults, Sweep, Swept, Tree, court, program, text};
use std::fs;
use std::path::Path;
use std::process::Command;

fn bake(scene: &Path, arguments: &[&str], folder: &Path) -> Command {
    let mut command = program("bake");
    command.arg(scene).args(arguments).arg("--quiet").arg("--out").arg(folder.join("court"));
    command
}

/// What is wrong with a dataset: one that is there opens, and breaks no rule.
fn faults_of(folder: &Path) -> Vec<String> {
    let root = folder.join("court");
    if !root.join(MANIFEST).exists() {
        return Vec::new();
    }
    match Dataset::open(&root) {
        Ok(dataset) => dataset.verify(|| {}).faults.iter().map(ToString::to_string).collect(),
        Err(error) => vec![error.to_string()],
    }
}

/// All but what tells of the run: times, and who held the lock.
fn is_same(path: &Path) -> bool {
    !["run.json", "report.html", ".lock"].iter().any(|name| path.ends_with(name))
        && path.extension().is_none_or(|extension| extension != "rounds")
}

/// All but what the manifest before referred to: the bake after the next removes it.
fn counts(files: &Tree, path: &Path) -> bool {
    let manifest = files.0.get(Path::new("court/config.json")).and_then(Option::as_deref).unwrap_or_default();
    let is_named = |name: &str| String::from_utf8_lossy(manifest).contains(name);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    !path.starts_with("court/data/") || name.starts_with('.') || is_named(&name)
}

/// Work that was done with, layers and files of the dataset before, and temporaries.
fn may_return(path: &Path) -> bool {
    let text = path.to_string_lossy();
    ["court/.bake", "court/.layers", "court/data/", ".tmp-"].iter().any(|part| text.contains(part))
}

fn sweep(
    faults: &Faults,
    name: &str,
    start: Option<&Path>,
    command: &(dyn Fn(&Path) -> Command + Sync),
) -> Swept {
    let must_stand = start.is_some();
    let found = |folder: &Path| {
        let is_missing = must_stand && !folder.join("court").join(MANIFEST).exists();
        faults_of(folder).into_iter().chain(is_missing.then(|| "the dataset is gone".to_owned())).collect()
    };
    Sweep { name, start, command, faults: &found, is_same, counts, may_return }.run(faults)
}

/// A bake, and others that replace what it made.
fn all(side: usize, hours: &str, others: &[&[&str]]) {
    let faults = Faults::new();
    let scene = court(&faults.root().join("scene"), side, 800);
    let first = ["--hours", hours, "--samples", "64"];
    let swept = sweep(&faults, "bake", None, &|folder| bake(&scene, &first, folder));
    for kind in ["create", "rename", "link", "unlink", "mkdir", "rmdir", "fsync", "fsync of a folder"] {
        assert!(swept.calls.get(kind).is_some_and(|count| *count > 0), "no {kind}: {:?}", swept.calls);
    }
    let start = faults.root().join("start");
    let output = bake(&scene, &first, &start).output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    let what = fs::read_to_string(start.join("court/run.json")).unwrap();
    let what: serde_json::Value = serde_json::from_str(&what).unwrap();
    assert!(what["rounds"].as_array().unwrap().len() > 1, "one round only");
    for other in others {
        let name = format!("bake again {}", other.join(" ").replace('/', "-"));
        sweep(&faults, &name, Some(&start), &|folder| bake(&scene, other, folder));
    }
    // Other light of the lamp: nothing is traced, the rest is written anew.
    court(&faults.root().join("scene"), side, 900);
    sweep(&faults, "relight", Some(&start), &|folder| bake(&scene, &first, folder));
}

#[test]
fn a_bake_is_killed_at_every_call() {
    all(8, "11,12", &[]);
}

#[test]
#[ignore = "takes minutes: larger scene, more ways to bake again"]
fn a_larger_bake_is_killed_at_every_call() {
    let again: [&[&str]; 5] = [
        &["--hours", "11..15", "--samples", "64"],
        &["--hours", "11..14", "--samples", "64", "--force"],
        &["--hours", "11..14", "--samples", "128", "--integrator", "path"],
        &["--hours", "11..14", "--target-error", "20%"],
        &["--hours", "11..14", "--samples", "64", "--indirect"],
    ];
    all(32, "11..14", &again);
}
