//! Releases: the same bytes again, every damage found, nothing half done.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::layouts::content;
use common::{write_hours, write_set};
use dataset::layout::Layout;
use dataset::layout::hprc1::Hprc1;
use dataset::layout::hprc2::Hprc2;
use dataset::observe::Silent;
use dataset::release::{LAYERS, MANIFEST, SUMS, release, verify};
use dataset::store::Dataset;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Two datasets, one with a bundle beside it, and their release with a layout of exchange.
struct Released {
    folder: tempfile::TempDir,
}

impl Released {
    fn new() -> Self {
        let released = Released { folder: tempfile::tempdir().unwrap() };
        let (hut, yard) = (released.at("hut"), released.at("yard"));
        rename(&hut, "hut", &[(20, 20)]);
        rename(&yard, "yard", &[(33, 20), (8, 8)]);
        let light = Dataset::open(&hut).unwrap().config.digest_of_light();
        fs::write(hut.join("hut-h.ndgi"), bundle_of(&light)).unwrap();
        let level = format!(r#"{{"inputs":"another","level":1,"level_of":"{light}"}}"#);
        fs::write(hut.join("other.ndgi"), bundle(&level)).unwrap();
        fs::write(hut.join("run.json"), b"not part of the set").unwrap();
        released.package("release");
        released
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn package(&self, name: &str) {
        let sets = [self.at("hut"), self.at("yard")];
        release(&sets, &[&Hprc2], true, &self.at(name), &Silent).unwrap();
    }

    fn faults(&self) -> Vec<String> {
        let verified = verify(&self.at("release"), &Silent).unwrap();
        verified.faults.iter().map(ToString::to_string).collect()
    }

    /// One fault that speaks of all these words.
    fn expect_fault(&self, words: &[&str]) {
        let faults = self.faults();
        let found = faults.iter().any(|fault| words.iter().all(|word| fault.contains(word)));
        assert!(found, "{words:?}: {faults:?}");
    }
}

/// A bundle that says this of itself.
fn bundle(info: &str) -> Vec<u8> {
    let (header, payloads) = ndgi::testing::sunny();
    let header = ndgi::bundle::Header { info: info.to_owned(), ..header };
    ndgi::bundle::encode(&header, &payloads).unwrap()
}

/// One that says that it was made from this light.
fn bundle_of(light: &str) -> Vec<u8> {
    bundle(&format!(r#"{{"inputs":"{light}"}}"#))
}

/// [`write_set`] of another name.
fn rename(root: &Path, scene: &str, sizes: &[(usize, usize)]) {
    let mut config = write_hours(root, sizes, 7, &[0.0, 12.0, 18.1]).unwrap();
    config.scene = scene.to_owned();
    fs::write(root.join("config.json"), serde_json::to_vec_pretty(&config).unwrap()).unwrap();
}

/// Unpacks an archive with the system's programs.
fn unpack(archive: &Path, into: &Path) {
    fs::create_dir_all(into).unwrap();
    let mut decoder = zstd::Decoder::new(File::open(archive).unwrap()).unwrap();
    let mut tar = Command::new("tar").arg("-x").arg("-C").arg(into).stdin(Stdio::piped()).spawn().unwrap();
    std::io::copy(&mut decoder, tar.stdin.as_mut().unwrap()).unwrap();
    drop(tar.stdin.take());
    assert!(tar.wait().unwrap().success());
}

#[test]
fn a_release_verifies_and_unpacks_to_the_same_set() {
    let released = Released::new();
    assert!(released.faults().is_empty(), "{:?}", released.faults());
    let folder = released.at("release");
    let mut names: Vec<String> = content(&folder).into_keys().collect();
    names.retain(|name| name.starts_with("hut"));
    let expected = [
        "hut-0h.png",
        "hut-12h.png",
        "hut-18.1h.png",
        "hut-h.ndgi",
        "hut-hprc2.tar.zst",
        "hut-lamps.tar.zst",
        "hut-other.ndgi",
        "hut-sets.tar.zst",
        "hut-sky.tar.zst",
        "hut-sun.tar.zst",
        "hut.md",
    ];
    assert_eq!(names, expected);
    let sums =
        Command::new("sha256sum").args(["-c", "--strict", SUMS]).current_dir(&folder).output().unwrap();
    assert!(sums.status.success(), "{sums:?}");
    let datasheet = fs::read_to_string(folder.join("hut.md")).unwrap();
    for word in [
        "CC0 1.0",
        "| 18.1 | porch | 1.00 |",
        "hut-12h.png",
        "hut-sun.tar.zst",
        "\"a\": [",
        "Omitted from hut-hprc2",
    ] {
        assert!(datasheet.contains(word), "{word}: {datasheet}");
    }

    // The datasets alone are a dataset; with the layers and the manifest that names them, it is the one that
    // was packaged.
    let unpacked = released.at("unpacked");
    unpack(&folder.join("hut-sets.tar.zst"), &unpacked);
    let sets = Dataset::open(&unpacked.join("hut")).unwrap();
    assert!(sets.verify(|| ()).faults.is_empty());
    for layer in ["sun", "sky", "lamps"] {
        unpack(&folder.join(format!("hut-{layer}.tar.zst")), &unpacked);
    }
    fs::rename(unpacked.join("hut").join(LAYERS), unpacked.join("hut/config.json")).unwrap();
    let mut before = content(&released.at("hut"));
    before.retain(|path, _| path.starts_with("data") || path.ends_with("config.json"));
    assert!(before == content(&unpacked.join("hut")));
    // A layout unpacks as it is exported.
    unpack(&folder.join("hut-hprc2.tar.zst"), &unpacked);
    let exported = released.at("exported");
    let hut = Dataset::open(&released.at("hut")).unwrap();
    dataset::exchange::export(&hut, &Hprc2, &exported, &Silent).unwrap();
    assert!(content(&exported) == content(&unpacked.join("hut-hprc2")));
}

#[test]
fn bundles_that_are_damaged_or_of_other_light_are_refused_and_found() {
    let released = Released::new();
    let [light, other] =
        ["hut", "yard"].map(|name| Dataset::open(&released.at(name)).unwrap().config.digest_of_light());
    let foreign = bundle_of(&other);
    let refused = |bytes: &[u8], words: &str| {
        fs::write(released.at("hut").join("other.ndgi"), bytes).unwrap();
        let out = released.at("again");
        let error = release(&[released.at("hut")], &[], true, &out, &Silent).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("other.ndgi") && error.contains(words), "{error}");
        assert!(!out.exists());
    };
    refused(&foreign, "made from different light than the dataset's");
    // Whoever says nothing, or nothing that can be read, may be another's.
    for info in ["{}", "[]", "null", "", "not JSON", r#"{"inputs":1}"#, r#"["inputs"]"#] {
        refused(&bundle(info), "does not say from which light it was made");
    }
    refused(b"bundle", "cut short");
    refused(&[0; 100], "does not begin with the magic bytes");
    let whole = bundle_of(&light);
    for version in [4, 6] {
        let mut other = whole.clone();
        other[8] = version;
        refused(&other, &format!("bundle version {version}"));
    }
    refused(&whole[..whole.len() - 1], "cut short, or damaged");
    // A flipped bit in the header, the resident block, features, the sun's sections, the last of them.
    let opened = ndgi::Bundle::from_bytes(whole.clone()).unwrap();
    let lit = opened.index.iter().find(|entry| entry.maps.length > 0 && entry.shadows.length > 0).unwrap();
    let resident = opened.index[0].maps.offset - opened.bytes_resident;
    for at in [100, resident, lit.maps.offset, lit.sun.offset, lit.shadows.offset, opened.bytes - 1] {
        let mut damaged = whole.clone();
        damaged[at as usize] ^= 1;
        refused(&damaged, "damaged");
    }
    // The same where sums were made to agree.
    let release = released.at("release");
    let sums = fs::read_to_string(release.join(SUMS)).unwrap();
    let mut damaged = whole.clone();
    damaged[lit.shadows.offset as usize] ^= 1;
    let silent = bundle("[]");
    for (bytes, words) in [
        (&foreign, "made from different light"),
        (&damaged, "the file is damaged"),
        (&silent, "does not say from which light"),
    ] {
        fs::write(release.join("hut-h.ndgi"), bytes).unwrap();
        let sum = Command::new("sha256sum").arg("hut-h.ndgi").current_dir(&release).output().unwrap();
        let line = String::from_utf8(sum.stdout).unwrap();
        let lines = sums.lines().map(|old| if old.ends_with("  hut-h.ndgi") { line.trim_end() } else { old });
        fs::write(release.join(SUMS), lines.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
        released.expect_fault(&["hut-h.ndgi", words]);
    }
}

#[test]
fn two_bundles_of_one_name_are_refused() {
    let released = Released::new();
    let hut = released.at("hut");
    // The release names `h.ndgi` after its scene.
    fs::copy(hut.join("hut-h.ndgi"), hut.join("h.ndgi")).unwrap();
    let out = released.at("again");
    let error = release(&[hut], &[], false, &out, &Silent).unwrap_err().to_string();
    assert!(
        ["would be hut-h.ndgi", "hut/h.ndgi", "rename one"].iter().all(|what| error.contains(what)),
        "{error}"
    );
    assert!(!out.exists());
}

#[test]
fn the_bytes_do_not_depend_on_the_run_or_the_threads() {
    let released = Released::new();
    let first = content(&released.at("release"));
    for threads in [1, 2] {
        let name = format!("again{threads}");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        // Other times of the files are no other content.
        let mask = Dataset::open(&released.at("hut")).unwrap().config.pages[0].mask.path.clone();
        let file = File::options().append(true).open(released.at("hut").join(mask)).unwrap();
        file.set_modified(std::time::UNIX_EPOCH + std::time::Duration::from_secs(threads as u64)).unwrap();
        pool.install(|| released.package(&name));
        assert!(content(&released.at(&name)) == first, "{threads} threads");
    }
}

#[test]
fn every_damage_is_found() {
    let released = Released::new();
    let folder = released.at("release");
    let archive = folder.join("yard-sets.tar.zst");
    let whole = fs::read(&archive).unwrap();
    for at in [0, 10, whole.len() / 2, whole.len() - 1] {
        let mut bytes = whole.clone();
        bytes[at] ^= 4;
        fs::write(&archive, bytes).unwrap();
        released.expect_fault(&["yard-sets.tar.zst", "SHA-256"]);
    }
    for length in [0, 1, 600, whole.len() - 1] {
        fs::write(&archive, &whole[..length]).unwrap();
        released.expect_fault(&["yard-sets.tar.zst", "SHA-256"]);
        released.expect_fault(&["yard-sets.tar.zst", "damaged archive"]);
    }
    fs::remove_file(&archive).unwrap();
    released.expect_fault(&["yard-sets.tar.zst", "No such file"]);
    std::os::unix::fs::symlink("/dev/zero", &archive).unwrap();
    released.expect_fault(&["yard-sets.tar.zst", "not a regular file"]);
    fs::remove_file(&archive).unwrap();
    fs::write(&archive, &whole).unwrap();
    assert!(released.faults().is_empty());

    fs::write(folder.join("notes.txt"), b"hello").unwrap();
    released.expect_fault(&["notes.txt", "not in SHA256SUMS"]);
    fs::remove_file(folder.join("notes.txt")).unwrap();
    for name in ["hut-12h.png", "hut.md", "hut-h.ndgi", "read_dataset.py", MANIFEST] {
        let whole = fs::read(folder.join(name)).unwrap();
        let mut bytes = whole.clone();
        bytes[whole.len() / 2] ^= 1;
        fs::write(folder.join(name), bytes).unwrap();
        released.expect_fault(&[name, "SHA-256"]);
        fs::write(folder.join(name), whole).unwrap();
    }
    let sums = fs::read_to_string(folder.join(SUMS)).unwrap();
    for (wrong, word) in [
        (sums.replace("  hut.md", "  ../hut.md"), "expected the name of a file in the same folder"),
        (sums.replace("  hut.md", "  /etc/passwd"), "expected the name of a file in the same folder"),
        (format!("{sums}{sums}"), "twice"),
        (sums.replace("  hut.md", " hut.md"), "64 hexadecimal digits"),
        (sums.lines().skip(1).collect::<Vec<_>>().join("\n"), "not in SHA256SUMS"),
    ] {
        fs::write(folder.join(SUMS), wrong).unwrap();
        released.expect_fault(&[SUMS, word]);
    }
    fs::remove_file(folder.join(SUMS)).unwrap();
    released.expect_fault(&[SUMS]);
}

/// An entry of a hostile archive: name, kind, size as its header says, content.
type Entry<'a> = (&'a str, u8, u64, &'a [u8]);

fn hostile(entries: &[Entry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for &(name, kind, size, content) in entries {
        let mut header = tar::Header::new_ustar();
        // By hand: the library refuses such names.
        header.as_old_mut().name[..name.len()].copy_from_slice(name.as_bytes());
        header.set_entry_type(tar::EntryType::new(kind));
        header.set_mode(0o644);
        header.set_size(size);
        if kind == b'2' || kind == b'1' {
            header.set_link_name("/etc/passwd").unwrap();
        }
        header.set_cksum();
        bytes.extend_from_slice(header.as_bytes());
        bytes.extend_from_slice(content);
        bytes.resize(bytes.len().next_multiple_of(512), 0);
    }
    bytes.resize(bytes.len() + 1024, 0);
    bytes
}

#[test]
fn hostile_archives_are_refused_and_write_nothing() {
    let released = Released::new();
    let folder = released.at("release");
    let archive = folder.join("hut-sun.tar.zst");
    let manifest = fs::read_to_string(folder.join(MANIFEST)).unwrap();
    let sums = fs::read_to_string(folder.join(SUMS)).unwrap();
    let cases: &[(&[Entry], &str)] = &[
        (&[("../escaped", b'0', 2, b"hi")], "leads out of the folder"),
        (&[("hut/../../escaped", b'0', 2, b"hi")], "leads out of the folder"),
        (&[("/tmp/escaped", b'0', 2, b"hi")], "leads out of the folder"),
        (&[("hut/link", b'2', 0, b"")], "expected only regular files"),
        (&[("hut/link", b'1', 0, b"")], "expected only regular files"),
        (&[("hut/fifo", b'6', 0, b"")], "expected only regular files"),
        (&[("hut/", b'5', 0, b"")], "expected only regular files"),
        // A long name of eight exbibytes, which a reader would hold in memory.
        (&[("././@LongLink", b'L', 1 << 62, b"")], "expected only regular files"),
        (&[("pax", b'x', 1 << 62, b"")], "expected only regular files"),
        (&[("hut/huge", b'0', 1 << 62, b"")], "not in release.json"),
        (&[("hut/extra", b'0', 2, b"hi")], "not in release.json"),
        (&[], "not in the archive"),
    ];
    for (entries, expected) in cases {
        let tar = hostile(entries);
        fs::write(&archive, zstd::encode_all(&*tar, 1).unwrap()).unwrap();
        released.expect_fault(&["hut-sun.tar.zst", expected]);
    }
    // Sizes that the manifest itself says, and a name that it says.
    let set: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let sun = |value: &mut serde_json::Value| {
        let archives = value["scenes"][0]["archives"].as_array_mut().unwrap();
        let archive = archives.iter_mut().find(|archive| archive["holds"] == "sun").unwrap();
        archive["files"][0]
            .clone_from(&serde_json::json!({"path": "../escaped", "bytes": 2, "blake3": "0".repeat(64)}));
    };
    let mut value = set.clone();
    sun(&mut value);
    fs::write(folder.join(MANIFEST), value.to_string()).unwrap();
    fs::write(&archive, zstd::encode_all(&*hostile(&[("../escaped", b'0', 2, b"hi")]), 1).unwrap()).unwrap();
    released.expect_fault(&["hut-sun.tar.zst", "leads out of the folder"]);
    // Names of files elsewhere are not followed: the list of checksums has none.
    let named = manifest.replace("\"hut.md\"", "\"../hut/config.json\"");
    fs::write(folder.join(MANIFEST), named).unwrap();
    released.expect_fault(&[SUMS, "../hut/config.json", "it does not list"]);
    fs::write(folder.join(MANIFEST), &manifest).unwrap();
    // A gigabyte of zeros behind the end takes a few kilobytes.
    let mut bomb = zstd::Encoder::new(Vec::new(), 1).unwrap();
    bomb.write_all(&hostile(&[])).unwrap();
    std::io::copy(&mut std::io::Read::take(std::io::repeat(0), 1 << 30), &mut bomb).unwrap();
    fs::write(&archive, bomb.finish().unwrap()).unwrap();
    released.expect_fault(&["hut-sun.tar.zst", "data after the end"]);

    assert_eq!(fs::read_to_string(folder.join(SUMS)).unwrap(), sums);
    let mut names: Vec<_> =
        fs::read_dir(released.folder.path()).unwrap().flatten().map(|e| e.file_name()).collect();
    names.sort();
    assert_eq!(names, ["hut", "release", "yard"]);
    assert!(!Path::new("/tmp/escaped").exists());
}

#[test]
fn archives_that_lack_files_of_the_manifest_are_found() {
    let released = Released::new();
    let folder = released.at("release");
    let mut value: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join(MANIFEST)).unwrap()).unwrap();
    value["scenes"][0]["archives"].as_array_mut().unwrap().retain(|archive| archive["holds"] != "lamps");
    fs::write(folder.join(MANIFEST), value.to_string()).unwrap();
    released.expect_fault(&["hut/layers.json", "group1-direct", "in no archive"]);
    value["scenes"][0]["archives"].as_array_mut().unwrap().clear();
    fs::write(folder.join(MANIFEST), value.to_string()).unwrap();
    released.expect_fault(&["no archive contains hut/config.json"]);
}

#[test]
fn a_licence_is_stated_only_where_one_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let config = write_set(&at("set"), &[(8, 8)], 1).unwrap();
    release(&[at("set")], &[], false, &at("release"), &Silent).unwrap();
    let datasheet = fs::read_to_string(at("release").join(format!("{}.md", config.scene))).unwrap();
    assert!(datasheet.contains("## Licence\n\nNot stated") && !datasheet.contains("CC0"), "{datasheet}");
}

#[test]
fn what_cannot_be_released_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let config = write_set(&at("set"), &[(20, 20)], 1).unwrap();
    let refused = |sets: &[PathBuf], layouts: &[&dyn Layout], word: &str| {
        let error = release(sets, layouts, false, &at("release"), &Silent).unwrap_err().to_string();
        assert!(error.contains(word), "{word}: {error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "{word}");
    };
    refused(&[at("set"), at("set")], &[], "occurs twice");
    refused(&[at("set"), at("none")], &[], "does not exist");
    refused(&[at("set")], &[&Hprc1], "no frame at 1, 2");
    // A fault that only the check finds.
    let map = at("set").join(&config.frames[1].maps[0].path);
    let whole = fs::read(&map).unwrap();
    let mut bytes = whole.clone();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&map, bytes).unwrap();
    refused(&[at("set")], &[], "checksum");
    fs::write(&map, whole).unwrap();
    // What stands there stays.
    fs::create_dir(at("taken")).unwrap();
    fs::write(at("taken/file"), b"x").unwrap();
    let error = release(&[at("set")], &[], false, &at("taken"), &Silent).unwrap_err().to_string();
    assert!(error.contains("stands there already"), "{error}");
    assert_eq!(fs::read_dir(at("taken")).unwrap().count(), 1);
}

/// Files cannot grow beyond some kilobytes: writing fails as on a full disk, or the process is killed.
#[test]
fn a_full_disk_and_a_killed_process_leave_no_release() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_set(&at("set"), &[(200, 200)], 1).unwrap();
    let packaged = |shell: &str| {
        let script = format!("{shell} exec \"$0\" release \"$1\" --out \"$2\"");
        let binary = env!("CARGO_BIN_EXE_dataset");
        Command::new("sh").args(["-c", &script, binary]).args([at("set"), at("release")]).output().unwrap()
    };
    let names = || {
        let entries = fs::read_dir(folder.path()).unwrap().flatten();
        entries.map(|entry| entry.file_name().into_string().unwrap()).collect::<Vec<_>>()
    };
    let output = packaged("trap '' XFSZ; ulimit -f 64;");
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("File too large"), "{output:?}");
    assert_eq!(names(), ["set"]);
    let output = packaged("ulimit -c 0; ulimit -f 64;");
    assert_eq!(output.status.code(), None, "{output:?}");
    let left: Vec<String> = names().into_iter().filter(|name| name != "set").collect();
    assert!(left.len() == 1 && left[0].starts_with(".release.tmp-"), "{left:?}");
    // The next one removes it.
    assert!(packaged("").status.success());
    let mut names = names();
    names.sort();
    assert_eq!(names, ["release", "set"]);
}
