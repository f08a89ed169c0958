//! Dataset folders: what is written is read, generations, and every fault is named.

mod common;

use common::{noise_image, write_set};
use dataset::Error;
use dataset::digest::Digest;
use dataset::format::{Config, Layer, Light};
use dataset::image::Image;
use dataset::store::{Dataset, MANIFEST, Writer};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Every file below the folder with its content.
fn content(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for folder in [root.to_owned(), root.join("data")] {
        for entry in fs::read_dir(folder).unwrap().flatten().filter(|entry| entry.path().is_file()) {
            let name = entry.path().strip_prefix(root).unwrap().display().to_string();
            files.insert(name, fs::read(entry.path()).unwrap());
        }
    }
    files
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(129, 40), (1, 1)], 1).unwrap();
    let dataset = Dataset::open(folder.path()).unwrap();
    assert_eq!(dataset.config, config);
    assert_eq!(dataset.mask(0).unwrap().count(), 129 * 40 - 1);
    assert_eq!(dataset.mask(1).unwrap().count(), 1);
    for set in 0..3 {
        let map = dataset.map(set, 0).unwrap();
        assert_eq!((map.width, map.height), (129, 40));
        assert_eq!(dataset.map_rows(set, 0, 10, 30).unwrap(), map.texels[10 * 129..30 * 129]);
    }
    assert_eq!(dataset.noise().unwrap().unwrap().mse[2], [vec![1e-6; 2], vec![1e-6]]);
    assert_eq!(fs::read(folder.path().join("scene.glb")).unwrap(), common::empty_glb());
    // The midnight frame has neither sun nor sky: it is the porch's direct light, stored once.
    assert_eq!(Some(&config.frames[0].maps[0]), config.layers[3].files[0][0].as_ref());
    let verification = dataset.verify(|| {});
    assert!(verification.faults.is_empty(), "{:?}", verification.faults);
    assert_eq!(verification.dead_texels, [Some(0), Some(0)]);
}

#[test]
fn a_dataset_written_again_has_the_same_bytes_whatever_existed() {
    let [fresh, used] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    write_set(fresh.path(), &[(20, 20)], 1).unwrap();
    write_set(used.path(), &[(20, 20)], 1).unwrap();
    let first = content(used.path());
    write_set(used.path(), &[(20, 20)], 2).unwrap();
    write_set(used.path(), &[(20, 20)], 1).unwrap();
    // The generation before the last stays for its readers; another run of the same removes it.
    assert!(content(used.path()).len() > first.len());
    write_set(used.path(), &[(20, 20)], 1).unwrap();
    assert_eq!(content(used.path()), first);
    assert_eq!(content(fresh.path()), first);
}

#[test]
fn a_reader_keeps_its_generation_while_the_next_is_written() {
    let folder = tempfile::tempdir().unwrap();
    write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let reader = Dataset::open(folder.path()).unwrap();
    let before = reader.map(1, 0).unwrap();
    write_set(folder.path(), &[(20, 20)], 2).unwrap();
    assert_eq!(reader.map(1, 0).unwrap(), before);
    assert!(reader.verify(|| {}).faults.is_empty());
    assert_ne!(Dataset::open(folder.path()).unwrap().map(1, 0).unwrap(), before);
}

#[test]
fn equal_content_is_stored_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = Writer::create(folder.path()).unwrap();
    let black = Image::black(16, 16).to_exr();
    let first = writer.add("night", "exr", &black).unwrap();
    assert_eq!(writer.add("dawn", "exr", &black).unwrap(), first);
    assert_eq!(fs::read_dir(folder.path().join("data")).unwrap().count(), 1);
    assert_eq!(first.blake3, Digest::of(&black));
    assert_eq!(first.path, format!("data/night-{}.exr", first.blake3.first(12)));
    // Stems from scene files may hold anything.
    let odd = writer.add("a/../b lamp: ü", "exr", &noise_image(2, 2, 0).to_exr()).unwrap();
    assert_eq!(Path::new(&odd.path).components().count(), 2, "{}", odd.path);
    assert!(folder.path().join(&odd.path).exists());
    writer.add("empty", "exr", b"").unwrap_err();
    writer.add("", "exr", b"x").unwrap_err();
}

#[test]
fn a_killed_writer_leaves_the_old_dataset_and_the_next_one_cleans_up() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    write_set(root, &[(20, 20)], 1).unwrap();
    let whole = content(root);
    // A writer that never came to its commit, in the middle of a file.
    let mut killed = Writer::create(root).unwrap();
    let orphan = killed.add("orphan", "exr", &noise_image(4, 4, 9).to_exr()).unwrap();
    drop(killed);
    let this = &dataset::host::Process::this().machine;
    let temporary = root.join("data").join(format!(".set-1.exr.tmp-{this}-{}-0-3", u32::MAX));
    fs::write(&temporary, b"half").unwrap();
    fs::write(root.join("data/notes.txt"), b"mine").unwrap();
    fs::write(root.join("run.json"), b"{}").unwrap();
    let reader = Dataset::open(root).unwrap();
    assert!(reader.verify(|| {}).faults.is_empty());

    write_set(root, &[(20, 20)], 1).unwrap();
    assert!(!root.join(&orphan.path).exists());
    assert_eq!(temporary.exists(), !Path::new("/proc/self").exists());
    // What is not the writer's own stays.
    assert_eq!(fs::read(root.join("data/notes.txt")).unwrap(), b"mine");
    assert_eq!(fs::read(root.join("run.json")).unwrap(), b"{}");
    for (name, bytes) in whole {
        assert_eq!(fs::read(root.join(&name)).unwrap(), bytes, "{name}");
    }
}

#[test]
fn a_damaged_file_is_written_again() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let victim = folder.path().join(&config.frames[1].maps[0].path);
    let whole = fs::read(&victim).unwrap();
    for damage in [whole[..whole.len() - 1].to_vec(), vec![0; whole.len()]] {
        fs::write(&victim, damage).unwrap();
        write_set(folder.path(), &[(20, 20)], 1).unwrap();
        assert_eq!(fs::read(&victim).unwrap(), whole);
    }
}

#[test]
fn a_commit_that_fails_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let before = content(folder.path());
    config.frames.reverse();
    Writer::create(folder.path()).unwrap().commit(&config).unwrap_err();
    config.frames.reverse();
    config.frames[0].maps[0].path = "data/missing-0123456789ab.exr".into();
    Writer::create(folder.path()).unwrap().commit(&config).unwrap_err();
    assert_eq!(content(folder.path()), before);
}

#[test]
fn a_folder_of_something_else_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for foreign in ["{\"name\": \"my project\"}", "not json"] {
        fs::write(folder.path().join(MANIFEST), foreign).unwrap();
        assert!(matches!(Writer::create(folder.path()), Err(Error::Invalid { .. })));
        assert!(matches!(Dataset::open(folder.path()), Err(Error::Invalid { .. })));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    let missing = Dataset::open(&folder.path().join("missing")).unwrap_err().to_string();
    assert!(missing.contains("missing: not a dataset"), "{missing}");
}

/// Each change to the manifest, and a word of the error it must give.
#[test]
fn every_broken_manifest_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let good = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    type Change = fn(&mut Config);
    let changes: [(Change, &str); 25] = [
        (|c| c.format = "other".into(), "format"),
        (|c| c.version = 3, "format version 3; this program reads version 2; use a newer one"),
        (
            |c| c.version = 1,
            "format version 1; this program reads version 2; bake or import the dataset again",
        ),
        (|c| c.scene = "../up".into(), "scene"),
        (|c| c.pages.clear(), "no pages"),
        (|c| c.pages[0].width = 0, "size 0×20"),
        (|c| c.pages[0].height = 70_000, "70000"),
        (|c| c.frames.clear(), "no frames"),
        (|c| c.frames[2].hour = 24.0, "hour 24"),
        (|c| c.frames[0].hour = -0.5, "hour -0.5"),
        (|c| c.frames[2].hour = 12.0, "ascending"),
        (|c| c.frames[1].groups_on.truncate(1), "groups_on has 1"),
        (|c| c.frames[1].maps.clear(), "maps for 0 pages"),
        (|c| c.frames[1].relative_error = Some(-1.0), "relative_error -1"),
        (|c| c.groups[1].name = "porch".into(), "twice"),
        (|c| c.groups[1].on[0] = [3.0, 24.5], "24.5"),
        (|c| c.groups[1].on[0] = [3.0, 3.0], "two different hours"),
        (|c| c.instances[0].page = 1, "page 1; expected one of 1"),
        (|c| c.pages[0].mask.path = "/etc/passwd".into(), "/etc/passwd"),
        (|c| c.pages[0].mask.path = "data/../../x".into(), "inside the dataset's folder"),
        (|c| c.pages[0].mask.path = "data\\x".into(), "inside the dataset's folder"),
        (|c| c.pages[0].mask.path = String::new(), "inside the dataset's folder"),
        (|c| c.pages[0].mask.bytes = 0, "bytes is 0"),
        (|c| c.pages[0].mask.bytes += 1, "bytes; config.json says"),
        (|c| c.pages[0].mask.path = "data/no-0123456789ab.png".into(), "no-0123456789ab.png"),
    ];
    for (change, word) in changes {
        let mut config = good.clone();
        change(&mut config);
        fs::write(folder.path().join(MANIFEST), serde_json::to_vec_pretty(&config).unwrap()).unwrap();
        let message = Dataset::open(folder.path()).expect_err(word).to_string();
        assert!(message.contains(word), "{word}: {message}");
    }
    // Every key is always there.
    for key in serde_json::to_value(&good).unwrap().as_object().unwrap().keys() {
        let mut less = serde_json::to_value(&good).unwrap();
        less.as_object_mut().unwrap().remove(key);
        fs::write(folder.path().join(MANIFEST), less.to_string()).unwrap();
        let message = Dataset::open(folder.path()).expect_err(key).to_string();
        assert!(message.contains(key), "{key}: {message}");
    }
    // Not the manifest's types: the line is named.
    let text = serde_json::to_string_pretty(&good).unwrap();
    let line = 1 + text.lines().position(|line| line.contains("\"samples\"")).unwrap();
    for bad in ["\"samples\": -1", "\"sample\": 1", "\"samples\": 1e999"] {
        fs::write(folder.path().join(MANIFEST), text.replace("\"samples\": 1", bad)).unwrap();
        let message = Dataset::open(folder.path()).expect_err(bad).to_string();
        assert!(message.contains(&format!("{MANIFEST}:{line}: ")), "{message}");
    }
    fs::write(folder.path().join(MANIFEST), &text[..text.len() / 2]).unwrap();
    assert!(matches!(Dataset::open(folder.path()), Err(Error::Invalid { .. })));
}

/// Replaces the content of a file and what the manifest says of it.
fn replace(root: &Path, config: &mut Config, set: usize, bytes: &[u8]) {
    let file = &mut config.frames[set].maps[0];
    file.bytes = bytes.len() as u64;
    file.blake3 = Digest::of(bytes);
    fs::write(root.join(&file.path), bytes).unwrap();
    fs::write(root.join(MANIFEST), serde_json::to_vec_pretty(config).unwrap()).unwrap();
}

#[test]
fn bad_texels_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    for (value, text) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (-0.25, "-0.25")] {
        let mut image = noise_image(20, 20, 5);
        image.texels[15 * 20 + 4][2] = value;
        replace(folder.path(), &mut config, 1, &image.to_exr());
        let dataset = Dataset::open(folder.path()).unwrap();
        let expected = format!("texel (4, 15): channel B is {text}; expected");
        for error in [dataset.map(1, 0).unwrap_err(), dataset.map_rows(1, 0, 15, 16).unwrap_err()] {
            assert!(error.to_string().contains(&expected), "{error}");
        }
        dataset.map_rows(1, 0, 0, 15).unwrap();
        let faults = dataset.verify(|| {}).faults;
        assert!(faults.len() == 1 && faults[0].to_string().contains(&expected), "{faults:?}");
    }
    replace(folder.path(), &mut config, 1, &noise_image(20, 19, 5).to_exr());
    let message = Dataset::open(folder.path()).unwrap().map(1, 0).unwrap_err().to_string();
    assert!(message.contains("size 20×19; the page has 20×20"), "{message}");
}

#[test]
fn verification_finds_what_opening_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let victim = folder.path().join(&config.frames[1].maps[0].path);
    let whole = fs::read(&victim).unwrap();
    let faults = || {
        let dataset = Dataset::open_manifest(folder.path()).unwrap();
        let steps = std::sync::atomic::AtomicUsize::new(0);
        let found = dataset.verify(|| _ = steps.fetch_add(1, std::sync::atomic::Ordering::Relaxed));
        assert_eq!(steps.into_inner(), dataset.verify_steps());
        found.faults.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    // One bit of the last texel.
    let mut flipped = whole.clone();
    *flipped.last_mut().unwrap() ^= 1;
    fs::write(&victim, &flipped).unwrap();
    Dataset::open(folder.path()).unwrap();
    let found = faults();
    assert!(found.len() == 1 && found[0].contains("checksum"), "{found:?}");
    let message = Dataset::open(folder.path()).unwrap().map(1, 0).unwrap_err().to_string();
    assert!(message.contains(&config.frames[1].maps[0].path), "{message}");

    // A truncated file, and a missing one: both are named.
    fs::write(&victim, &whole[..whole.len() / 2]).unwrap();
    fs::remove_file(folder.path().join(&config.pages[0].mask.path)).unwrap();
    let found = faults();
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].contains("mask-0") && found[1].contains("config.json says"), "{found:?}");
}

#[test]
fn a_sum_that_is_off_by_one_bit_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let mut image = Dataset::open(folder.path()).unwrap().map(2, 0).unwrap();
    let value = &mut image.texels[3 * 20 + 9][0];
    *value = f32::from_bits(value.to_bits() + 1);
    replace(folder.path(), &mut config, 2, &image.to_exr());
    let faults = Dataset::open(folder.path()).unwrap().verify(|| {}).faults;
    assert_eq!(faults.len(), 1);
    assert!(
        faults[0].to_string().contains("texel (9, 3)") && faults[0].to_string().contains("layers sum to")
    );
}

#[test]
fn all_bad_texels_and_files_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write_set(folder.path(), &[(20, 300)], 1).unwrap();
    for (set, places) in [(1, &[5, 6, 280 * 20][..]), (2, &[7])] {
        let mut image = Dataset::open_manifest(folder.path()).unwrap().map(set, 0).unwrap();
        places.iter().for_each(|&i| image.texels[i][1] = -1.0);
        replace(folder.path(), &mut config, set, &image.to_exr());
    }
    let verification = Dataset::open(folder.path()).unwrap().verify(|| {});
    let faults: Vec<String> = verification.faults.iter().map(ToString::to_string).collect();
    assert_eq!((faults.len(), &*verification.dead_texels), (2, &[None][..]), "{faults:?}");
    assert!(
        faults[0].contains("texel (5, 0)") && faults[0].contains("(2 texels more like it)"),
        "{faults:?}"
    );
    assert!(faults[1].contains("texel (7, 0)") && !faults[1].contains("more"), "{faults:?}");
}

#[test]
fn frames_must_show_the_groups_as_the_schedule_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let hours = [0.0, 5.95, 6.0, 12.0, 18.0, 18.05, 19.95, 20.0, 20.05];
    let mut config = common::write_hours(folder.path(), &[(4, 4)], 1, &hours).unwrap();
    let verify = |config: &Config| {
        fs::write(folder.path().join(MANIFEST), serde_json::to_vec_pretty(config).unwrap()).unwrap();
        let found = Dataset::open(folder.path()).unwrap().verify(|| {});
        (found.faults.iter().map(ToString::to_string).collect::<Vec<_>>(), found.warnings)
    };
    assert_eq!(verify(&config), (vec![], vec![]));
    // A switch without a frame on its lit side is told, and is no fault. (The noise file is of all frames.)
    config.noise = None;
    let frame = config.frames.remove(5);
    let by_hour = |layer: &&mut Layer| layer.light != Light::Group;
    let rows: Vec<_> = config.layers.iter_mut().filter(by_hour).map(|layer| layer.files.remove(5)).collect();
    let (faults, warnings) = verify(&config);
    assert!(faults.is_empty() && warnings.len() == 1, "{faults:?} {warnings:?}");
    assert!(
        warnings[0].contains("\"porch\" switches at 18 h, but no frame within 0.1 h has it on"),
        "{warnings:?}"
    );
    config.frames.insert(5, frame);
    config.layers.iter_mut().filter(by_hour).zip(rows).for_each(|(layer, row)| layer.files.insert(5, row));
    // The garden's lamps at noon: nor do the layers sum up.
    config.frames[3].groups_on[1] = true;
    let (faults, _) = verify(&config);
    assert_eq!(faults.len(), 2, "{faults:?}");
    assert!(
        faults[0].contains("hour 12: groups_on is true for \"garden\"; its schedule says false"),
        "{faults:?}"
    );
}

#[test]
fn a_noise_file_of_the_wrong_shape_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let bad = [
        "{\"tile\": 64, \"mse\": []}",
        "{\"tile\": 128, \"mse\": [[[0]]]}",
        "{\"tile\": 128, \"mse\": [[[0]],[[0]],[[-1]]]}",
        "{",
    ];
    for (text, word) in bad.into_iter().zip(["64", "1 frame;", "-1", "noise"]) {
        let file = config.noise.as_mut().unwrap();
        fs::write(folder.path().join(&file.path), text).unwrap();
        file.bytes = text.len() as u64;
        file.blake3 = Digest::of(text.as_bytes());
        fs::write(folder.path().join(MANIFEST), serde_json::to_vec(&config).unwrap()).unwrap();
        let dataset = Dataset::open(folder.path()).unwrap();
        let message = dataset.noise().expect_err(text).to_string();
        assert!(message.contains(word), "{message}");
        assert_eq!(dataset.verify(|| {}).faults.len(), 1);
    }
}

#[test]
fn a_corrupt_geometry_file_is_a_named_fault_though_its_checksum_is_right() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_set(folder.path(), &[(20, 20)], 1).unwrap();
    let whole = common::empty_glb();
    let check = |bytes: &[u8]| {
        let mut writer = Writer::create(folder.path()).unwrap();
        let geometry = writer.add("scene", "glb", bytes).unwrap();
        writer.commit(&Config { geometry: Some(geometry), ..config.clone() }).unwrap();
        let found = Dataset::open(folder.path()).unwrap().verify(|| {});
        found.faults.iter().map(|fault| format!("{fault}\n")).collect::<String>()
    };
    assert_eq!(check(&whole), "");
    let torn = check(&whole[..whole.len() - 4]);
    assert!(torn.contains(".glb: ") && torn.contains("expected a complete GLB file"), "{torn}");
    let mut flipped = whole.clone();
    flipped[20] = b'[';
    let flipped = check(&flipped);
    assert!(flipped.contains(".glb: its JSON is not glTF"), "{flipped}");
}

#[test]
fn leftovers_of_killed_writers_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    write_set(root, &[(20, 20)], 1).unwrap();
    let warnings = || {
        let found = Dataset::open(root).unwrap().verify(|| {});
        assert!(found.faults.is_empty(), "{:?}", found.faults);
        found.warnings.into_iter().filter(|warning| warning.contains("removed")).collect::<Vec<_>>()
    };
    assert_eq!(warnings(), Vec::<String>::new());
    let left = dataset::host::files::temporary_beside(&root.join("data/set.exr")).unwrap();
    fs::write(&left, b"half").unwrap();
    fs::create_dir(root.join(".bake")).unwrap();
    let warnings = warnings();
    assert_eq!(warnings.len(), 2);
    assert!(warnings[0].contains(left.to_str().unwrap()), "{warnings:?}");
    assert!(warnings[1].contains("the same `bake` command continues it"), "{warnings:?}");
}
