//! What is damaged is refused, however it is read.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::write_set;
use dataset::format::{FileRef, Light};
use dataset::store::{Dataset, MANIFEST};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_dataset")).args(arguments).arg(folder).output().unwrap()
}

/// Flips the last bit of a file: images can be decoded still, with another last texel.
fn damage(dataset: &Dataset, file: &FileRef) {
    let path = dataset.path(file);
    let mut bytes = fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(path, bytes).unwrap();
}

/// Reads something of a dataset.
type Read = fn(&Dataset) -> dataset::Result<()>;

#[test]
fn every_way_to_read_a_file_refuses_other_content() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let open = || Dataset::open(folder.path()).unwrap();
    let (map, sky) = (config.frames[1].maps[0].clone(), config.layers[2].files[1][0].clone().unwrap());
    let porch = config.layers[3].files[0][0].clone().unwrap();
    let reads: &[(&FileRef, Read)] = &[
        (&map, |set| set.map(1, 0).map(drop)),
        (&map, |set| set.map_rows(1, 0, 0, 1).map(drop)),
        (&sky, |set| set.image(set.config.layers[2].file(1, 0).unwrap(), 0).map(drop)),
        (&sky, |set| set.image_rows(set.config.layers[2].file(1, 0).unwrap(), 0, 3, 4).map(drop)),
        (&sky, |set| set.sum_rows(&set.config.files_of(Light::Sky, None, 1, 0), 0, 3, 4).map(drop)),
        (&sky, |set| set.light(Light::Sky, None, 1, 0).map(drop)),
        (&sky, |set| set.light_at(13.0, 0).map(drop)),
        (&porch, |set| set.light_at(18.5, 0).map(drop)),
        (&config.pages[0].mask, |set| set.mask(0).map(drop)),
        (config.noise.as_ref().unwrap(), |set| set.noise().map(drop)),
        (config.geometry.as_ref().unwrap(), |set| dataset::pictures::View::of(set, [8, 8]).map(drop)),
        (config.geometry.as_ref().unwrap(), |set| set.read(set.config.geometry.as_ref().unwrap()).map(drop)),
    ];
    for (number, (file, read)) in reads.iter().enumerate() {
        let opened = open();
        damage(&opened, file);
        let error = read(&opened).expect_err(&number.to_string()).to_string();
        assert!(error.contains(&file.path) && error.contains("the content changed"), "{number}: {error}");
        // What was refused is looked at again: it may be whole by then.
        damage(&opened, file);
        read(&opened).unwrap();
    }
    // A shard's rows alone are another process's to verify.
    let opened = open().with_unverified_rows();
    damage(&opened, &map);
    opened.map_rows(1, 0, 0, 1).unwrap();
    opened.map(1, 0).unwrap_err();
}

#[test]
fn a_digest_that_is_none_is_named_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let path = folder.path().join(MANIFEST);
    let text = fs::read_to_string(&path).unwrap();
    let file = config.frames[1].maps[0].blake3.to_string();
    // (Of the brace behind it, which ends the file's object.)
    let line = 2 + text.lines().position(|line| line.contains(&file)).unwrap();
    for wrong in
        ["", "abc", &file[..15], &file[1..], &format!("{file}0"), &file.to_uppercase(), &"é".repeat(32)]
    {
        fs::write(&path, text.replacen(&file, wrong, 1)).unwrap();
        for command in ["check", "info"] {
            let output = run(&[command], folder.path());
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{wrong}: {said}");
            for what in [&format!("{MANIFEST}:{line}: digest {wrong:?}"), "64 lower-case hexadecimal digits"]
            {
                assert!(said.contains(what), "{wrong}: {said}");
            }
        }
    }
}

#[cfg(unix)]
#[test]
fn an_argument_that_is_not_utf_8_is_refused_at_once() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    write_set(&folder.path().join("set"), &[(8, 8)], 1).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_dataset"));
    command.current_dir(folder.path()).args(["export", "set", "--layout", "hprc2", "--out"]);
    let output = command.arg(std::ffi::OsStr::from_bytes(b"map\xe9")).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains(r#"argument 6, "map\xE9", is not UTF-8"#), "{said}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
