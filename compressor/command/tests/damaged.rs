//! What is damaged is refused by what shows and judges bundles, and repaired by what made them.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::court::{moving, write};
use common::islands;
use compressor::bundle::Bundle;
use compressor::compress::{DRAFT, Options, compress};
use compressor::decode::Decoder;
use compressor::evaluate::{Measures, evaluate};
use compressor::view::{Options as ViewOptions, Source};
use dataset::observe::Silent;
use dataset::store::Dataset;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn options(out: &Path) -> Options {
    Options { iterations: 60, out: Some(out.to_owned()), ..Options::of(DRAFT) }
}

/// A bundle that was not trained here.
fn bundle() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fuzz/corpus/bundle/lamps.ndgi")
}

fn command(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_compress"));
    command.current_dir(folder);
    command
}

#[test]
fn a_bundle_of_another_version_is_not_replaced_unless_forced() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, moving);
    let out = root.join("court.ndgi");
    compress(&root, &options(&out), &Silent).unwrap();
    let whole = fs::read(&out).unwrap();
    for version in [4u8, 6] {
        let mut other = whole.clone();
        other[8] = version;
        fs::write(&out, &other).unwrap();
        let run = |more: &[&str]| {
            command(&root).args([".", "--iterations", "60", "-q"]).args(more).output().expect("run")
        };
        let output = run(&[]);
        let said = String::from_utf8(output.stderr).unwrap();
        let told = format!("bundle version {version}; this program reads version 5");
        assert!(!output.status.success() && said.contains(&told) && said.contains("--force"), "{said}");
        assert!(fs::read(&out).unwrap() == other, "{version}");
        assert!(run(&["--force"]).status.success(), "{version}");
        assert!(Bundle::open(&out).is_ok(), "{version}");
    }
}

#[test]
fn status_says_why_a_bundle_cannot_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("court.ndgi");
    let status = || {
        let run = |more: &[&str]| {
            command(folder.path()).args(["status", ".", "--out", "court.ndgi"]).args(more).output().unwrap()
        };
        let (plain, json) = (run(&[]), run(&["--json"]));
        assert!(plain.status.success() && json.status.success(), "{plain:?}");
        let object: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
        (String::from_utf8(plain.stdout).unwrap(), object["fault"].clone())
    };
    let (line, fault) = status();
    assert!(line.ends_with(": no shard has started; there is no bundle\n") && fault.is_null(), "{line}");
    fs::copy(bundle(), &out).unwrap();
    let (line, fault) = status();
    assert!(line.ends_with(": no shard is running; the bundle exists\n") && fault.is_null(), "{line}");

    let whole = fs::read(&out).unwrap();
    let changed = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        bytes
    };
    let tile = Bundle::open(&out).unwrap().index[0].maps.offset as usize;
    for (bytes, expected) in [
        (changed(8), "bundle version 4; this program reads version 5"),
        (changed(tile), "the file is damaged; run `compress` to make it again"),
        (whole[..whole.len() / 2].to_vec(), "cut short, or damaged; run `compress` to make it again"),
        (
            b"of somebody else, and longer than 32 bytes".to_vec(),
            "remove it, or give another name with --out",
        ),
        (Vec::new(), "0 bytes; expected at least 32"),
    ] {
        fs::write(&out, bytes).unwrap();
        let (line, fault) = status();
        let said = line.split_once(": no shard is running; the bundle cannot be read: ").unwrap().1;
        assert!(said.contains(expected) && !said.contains("court.ndgi"), "{line}");
        assert_eq!(fault, said.trim_end());
    }
    fs::remove_file(&out).unwrap();
    fs::create_dir(&out).unwrap();
    assert!(status().0.contains("cannot be read: is a folder; expected a bundle"), "{}", status().0);
}

#[test]
fn inputs_that_are_missing_or_of_another_kind_are_named_with_what_was_expected() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, moving);
    fs::write(folder.path().join("file"), b"x").unwrap();
    let of_bundle = |path: &str, found: &str| {
        format!("error: {path}: {found}; expected a bundle, a .ndgi file, as `compress <dataset>` writes it")
    };
    let dataset = |path: &str, found: &str| {
        format!("error: {path}: not a dataset: {found}; expected a folder with config.json")
    };
    let (missing, folder_there) = ("no such file", "is a folder");
    let of_own = "error: court/court.ndgi: no such file; expected a bundle, a .ndgi file, as `compress court` writes it";
    for (arguments, expected) in [
        (&["info", "none"][..], of_bundle("none", missing)),
        (&["info", "file/none"], of_bundle("file/none", missing)),
        (&["info", "court"], of_bundle("court", folder_there)),
        (&["decode", "none", "--hour", "3", "--out", "a.exr"], of_bundle("none", missing)),
        (&["evaluate", "court", "--bundle", "none"], of_bundle("none", missing)),
        (&["evaluate", "court"], of_bundle("court/court.ndgi", missing)),
        (&["view", "court"], of_own.to_owned()),
        (&["view", "court", "--bundle", "none"], of_bundle("none", missing)),
        (&["view", "court", "--bundle", "court"], of_bundle("court", folder_there)),
        (&["view", "none"], "error: none: no such file; expected a dataset's folder, or a bundle".to_owned()),
        (&["none"], dataset("none", "it does not exist")),
        (&["status", "file"], dataset("file", "it is not a folder")),
        (&["sweep", "none"], dataset("none", "it does not exist")),
        (&["compare", "none"], dataset("none", "it does not exist")),
        (&["compare", "court", "--transfer", "none"], dataset("none", "it does not exist")),
    ] {
        let output = command(folder.path()).args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && said.contains(&expected), "{arguments:?}: {said}");
        assert!(!said.contains("os error"), "{said}");
    }
    fs::copy(bundle(), folder.path().join("lamps.ndgi")).unwrap();
    for (path, found) in [("none", "no such file"), ("court", "is a folder")] {
        let output = command(folder.path()).args(["view", "lamps.ndgi", "--scene", path]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        let expected = format!("error: {path}: {found}; expected the scene's geometry, a GLB file (--scene)");
        assert!(output.status.code() == Some(1) && said.contains(&expected), "{said}");
    }
}

#[test]
fn damage_in_any_section_is_refused_by_the_viewer_and_repaired_by_a_rerun() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("court");
    write(&root, moving);
    let out = root.join("court.ndgi");
    compress(&root, &options(&out), &Silent).unwrap();
    let (whole, record) = (fs::read(&out).unwrap(), fs::read(root.join("court.ndgi.run.json")).unwrap());
    let bundle = Bundle::open(&out).unwrap();
    let first = bundle.index[0];
    let last = bundle.index.last().unwrap();
    assert!(first.maps.length > 0 && first.sun.length > 0 && first.shadows.length > 0);
    // One section at a time, then several of two tiles.
    let all = [first.maps, last.maps, first.sun];
    for parts in [&[first.maps][..], &[first.sun], &[first.shadows], &all] {
        let mut damaged = whole.clone();
        parts.iter().for_each(|part| damaged[part.offset as usize + 9] ^= 4);
        fs::write(&out, &damaged).unwrap();
        let error = Source::open(&root, &ViewOptions::default()).unwrap_err().to_string();
        assert!(error.contains("tile (") && error.contains("the file is damaged"), "{error}");
        let outcome = compress(&root, &options(&out), &Silent).unwrap();
        assert!(!outcome.up_to_date);
        assert!(fs::read(&out).unwrap() == whole, "{parts:?}");
        // (Nothing else was trained: the record is the first run's, with its seconds.)
        assert!(fs::read(root.join("court.ndgi.run.json")).unwrap() == record);
        assert!(compress(&root, &options(&out), &Silent).unwrap().up_to_date);
    }
    // Bytes of no tile: all is made again.
    let start = bundle.index[0].maps.offset as usize;
    if !bundle.bytes_resident.is_multiple_of(16) {
        let mut damaged = whole.clone();
        damaged[start - 1] = 1;
        fs::write(&out, damaged).unwrap();
        assert!(!compress(&root, &options(&out), &Silent).unwrap().up_to_date);
        assert!(fs::read(&out).unwrap() == whole);
    }
    assert!(!root.join("court.ndgi.part").exists());

    // A layer with other light, of the same length: what is compared with it would be wrong.
    let dataset = Dataset::open(&root).unwrap();
    let file = dataset.config.layers.last().unwrap().files().next().unwrap().clone();
    let path = dataset.path(&file);
    let intact = fs::read(&path).unwrap();
    let mut other = intact.clone();
    *other.last_mut().unwrap() ^= 1;
    fs::write(&path, &other).unwrap();
    let decoder = Decoder::open(&out).unwrap();
    let error = evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap_err().to_string();
    assert!(error.contains(&file.path) && error.contains("the content changed"), "{error}");
    fs::write(&path, &intact).unwrap();
    evaluate(&dataset, &decoder, Measures::default(), &Silent).unwrap();
}

#[test]
fn names_are_refused_at_once_or_written() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(&folder.path().join("isles"));
    let names = || {
        let entries = fs::read_dir(folder.path()).unwrap().flatten();
        entries.map(|entry| entry.file_name()).collect::<Vec<_>>()
    };
    // The record is named after the bundle, 9 bytes longer.
    let refused = |out: &std::ffi::OsStr, code: i32, what: &str| {
        let output = command(folder.path()).args(["isles", "--draft", "--out"]).arg(out).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && said.contains(what), "{said}");
        assert_eq!(names(), ["isles"]);
    };
    let long = |bytes: usize| format!("{}.ndgi", "a".repeat(bytes - 5));
    refused(long(256).as_ref(), 1, "a name of 256 bytes is too long here");
    refused(long(247).as_ref(), 1, "a name of 256 bytes is too long here");
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;
        let latin = std::ffi::OsStr::from_bytes(b"map\xe9.ndgi");
        refused(latin, 2, r#"argument 4, "map\xE9.ndgi", is not UTF-8"#);
    }
    let out = folder.path().join(long(246));
    let options = Options { iterations: 10, ..options(&out) };
    compress(&folder.path().join("isles"), &options, &Silent).unwrap();
    assert!(compress(&folder.path().join("isles"), &options, &Silent).unwrap().up_to_date);
    Bundle::open(&out).unwrap().verify().unwrap();
}

#[cfg(unix)]
#[test]
fn a_stopped_server_says_by_which_signal() {
    let folder = tempfile::tempdir().unwrap();
    islands().write(folder.path());
    let out = folder.path().join("isles.ndgi");
    compress(folder.path(), &Options { iterations: 10, ..options(&out) }, &Silent).unwrap();
    let mut command = command(folder.path());
    let mut server =
        command.args(["view", "--serve=0", ".", "--quiet"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut url = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut url).unwrap();
    assert!(url.starts_with("http://127.0.0.1:"), "{url}");
    // (Not SIGINT: a shell that ran these tests in the background would have it ignored, which servers
    // respect.)
    let id = server.id().to_string();
    assert!(Command::new("kill").args(["-s", "TERM", &id]).status().unwrap().success());
    assert_eq!(server.wait().unwrap().code(), Some(143));
}
