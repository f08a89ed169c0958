//! What stands where a bake is to write: kept, replaced, or refused.

use crate::{bake, court, data, fixture, text};
use std::path::Path;
use std::process::Command;

/// A bake that must be refused, and what it said.
fn refused(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn a_folder_that_cannot_be_written_is_refused_before_the_bake() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("file");
    std::fs::write(&file, b"mine").unwrap();
    let below = file.join("court");
    for out in [&file, &below, Path::new("/proc/none/court")] {
        for more in [&[][..], &["--force"]] {
            let scene = fixture("court.toml");
            let output = bake(&[&[text(&scene), "--hours", "12", "--out", text(out)], more].concat());
            let message = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{message}");
            let expected = format!("error: {}: ", out.display());
            assert!(message.contains(&expected) && message.contains("expected a folder"), "{message}");
            // A path that is itself in the way is named once.
            assert!(out != file || message.matches(text(&file)).count() == 1, "{message}");
            assert!(!message.contains("triangles"), "{message}");
        }
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"mine");
    // Missing parents are made.
    let deep = dir.path().join("a/b/court");
    assert!(court(&deep, "2", "path").status().unwrap().success());
}

#[test]
fn a_second_run_says_in_a_line_that_nothing_is_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let run = || {
        let scene = fixture("court.toml");
        let output = bake(&[text(&scene), "--hours", "12", "--samples", "2", "--out", text(&out)]);
        assert!(output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let first = run();
    assert!(
        first.contains("1 frame,") && first.contains("1 frame of") && first.contains("no alpha tests"),
        "{first}"
    );
    let second = run();
    assert!(second.contains("already holds this bake (--force bakes it again): 1 frame of"), "{second}");
    let said = second.lines().filter(|line| !line.starts_with("warning"));
    assert_eq!(said.count(), 2, "{second}");
}

#[test]
fn a_damaged_image_or_copy_of_the_geometry_is_made_again() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    assert!(court(&out, "2", "path").status().unwrap().success());
    let (before, plain) = (data(&out), out.join("scene.glb"));
    let whole = std::fs::read(&plain).unwrap();
    let stored = before.iter().find(|(name, _)| name.starts_with("scene-")).unwrap();
    let (stored, is_same) = (out.join("data").join(&stored.0), stored.1 == whole);
    assert!(is_same);
    let flip = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        bytes
    };
    let flipped = || flip(&whole);
    let (frame, image) = before.iter().find(|(name, _)| name.starts_with("frame-")).unwrap();
    // A copy takes the link's place, or both names are of one damaged file.
    let copy = |bytes: &[u8]| {
        std::fs::remove_file(&plain).unwrap();
        std::fs::write(&plain, bytes).unwrap();
    };
    type Damage<'a> = (&'a str, &'a dyn Fn());
    let damages: [Damage; 6] = [
        ("copy cut short", &|| copy(&whole[..whole.len() / 2])),
        ("copy with a bit flipped", &|| copy(&flipped())),
        ("no copy", &|| std::fs::remove_file(&plain).unwrap()),
        ("file with a bit flipped", &|| std::fs::write(&stored, flipped()).unwrap()),
        ("file cut short", &|| std::fs::write(&stored, &whole[..9]).unwrap()),
        ("image with a bit flipped", &|| std::fs::write(out.join("data").join(frame), flip(image)).unwrap()),
    ];
    for (how, damage) in damages {
        damage();
        let output = court(&out, "2", "path").arg("--json").output().unwrap();
        assert!(output.status.success(), "{how}: {output:?}");
        let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((&object["up_to_date"], &object["layers"]["traced"]), (&false.into(), &0.into()), "{how}");
        assert!(data(&out) == before && std::fs::read(&plain).unwrap() == whole, "{how}");
    }
    let output = court(&out, "2", "path").arg("--json").output().unwrap();
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["up_to_date"], true);
}

#[test]
fn a_dataset_is_not_replaced_by_less_unless_forced() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let scene = dir.path().join("court.toml");
    let words = std::fs::read_to_string(fixture("court.toml")).unwrap().replace("size = 96", "size = 32");
    std::fs::write(&scene, &words).unwrap();
    std::fs::copy(fixture("court.obj"), dir.path().join("court.obj")).unwrap();
    let run = |arguments: &[&str]| {
        let output = bake(&[&[text(&scene), "--out", text(&out)], arguments].concat());
        (output.status.success(), String::from_utf8(output.stderr).unwrap())
    };
    let (done, said) = run(&["--hours", "9,12,18.1"]);
    assert!(done && !said.contains("replaced"), "{said}");
    let before = data(&out);
    let layers = || std::fs::read_dir(out.join(".layers")).unwrap().count();
    let kept = layers();
    for (arguments, expected) in [
        (&["--hours", "12"][..], "2 of its 3 hours would go"),
        (&["--hours", "9,12,18.1", "--samples", "8"], "8 samples per texel instead of 16"),
        (&["--hours", "9,12,18.1", "--draft"], "pages of 16 × 16 texels instead of 32 × 32"),
        (&["--hours", "9,12", "--time-limit", "10s"], "1 of its 3 hours would go"),
    ] {
        let (done, said) = run(arguments);
        assert!(!done && said.contains(expected), "{arguments:?}: {said}");
        let place =
            format!("error: {}: holds a dataset of 4 frames, baked with 16 samples per texel", out.display());
        assert!(said.contains(&place) && said.contains("--out DIR") && said.contains("--force"), "{said}");
        // Nothing was touched.
        assert!(before == data(&out) && kept == layers());
    }
    // More hours, and schedules that move the sets beside a switch, lose nothing: done without a flag, and
    // told.
    let replaced = "(4 frames, baked with 16 samples per texel) is replaced when this bake is done";
    let (done, said) = run(&["--hours", "9,12,13,18.1"]);
    assert!(done && said.contains(replaced) && said.contains("kept from an earlier bake"), "{said}");
    std::fs::write(&scene, words.replace("\"18:00\"", "\"17:00\"")).unwrap();
    assert!(run(&["--hours", "9,12,13,18.1"]).0);
    // So do more samples, and bakes towards a target, of which nobody knows beforehand how many samples they
    // take.
    assert!(run(&["--hours", "9,12,13,18.1", "--samples", "32"]).0);
    assert!(run(&["--hours", "9,12,13,18.1", "--target-error", "50%"]).0);
    assert!(run(&["--hours", "9,12,13,18.1", "--samples", "16"]).0);
    // Another scene under this --out.
    let other = dir.path().join("other.toml");
    std::fs::write(&other, words.replace("name = \"court\"", "")).unwrap();
    let refused = bake(&[text(&other), "--hours", "9,12,13,18.1", "--out", text(&out)]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && said.contains("of the scene \"court\", not \"other\""), "{said}");
    let (done, said) = run(&["--hours", "12", "--force"]);
    assert!(done && said.contains("is replaced when this bake is done"), "{said}");
    assert_eq!(dataset::store::Dataset::open(&out).unwrap().config.frames.len(), 1);
    // A manifest that cannot be read may be another's: not even `--force` writes over it, or touches what is
    // kept.
    let kept = layers();
    let whole = std::fs::read(out.join("config.json")).unwrap();
    std::fs::write(out.join("config.json"), b"{").unwrap();
    let (done, said) = run(&["--hours", "12,13", "--force"]);
    assert!(!done && said.contains("what stands there is not known") && said.contains("--out DIR"), "{said}");
    assert!(kept == layers() && kept > 0);
    std::fs::write(out.join("config.json"), whole).unwrap();
    assert!(run(&["--hours", "12,13"]).0);
}

#[test]
fn a_bundle_of_an_earlier_bake_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let run = |arguments: &[&str]| {
        let scene = fixture("court.toml");
        let all = [&[text(&scene), "--draft", "--quiet", "--out", text(&out)], arguments].concat();
        let output = bake(&all);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let bundle = out.join("court.ndgi");
    let told =
        format!("{} was compressed from a different bake; run `compress {}`", text(&bundle), text(&out));
    assert!(!run(&["--hours", "12", "--compress"]).contains("another bake"));
    assert!(bundle.exists() && !run(&["--hours", "12"]).contains("another bake"));
    // Until it is renewed, also where the bake itself is done.
    for _ in 0..2 {
        let said = run(&["--hours", "12,13"]);
        assert!(said.contains(&told), "{said}");
    }
    assert!(!run(&["--hours", "12,13", "--compress"]).contains("another bake"));
}

#[test]
fn files_of_others_are_not_written_over() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["scene.glb", "report.html", "run.json", "data"] {
        let out = dir.path().join(format!("with-{name}"));
        std::fs::create_dir(&out).unwrap();
        std::fs::write(out.join(name), b"mine").unwrap();
        let said = refused(&mut court(&out, "2", "cached"));
        assert!(said.contains("is no dataset") && said.contains(name), "{said}");
        assert_eq!(std::fs::read(out.join(name)).unwrap(), b"mine");
    }
    // Other files are in nobody's way.
    let out = dir.path().join("with-notes");
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("notes.txt"), b"mine").unwrap();
    assert!(court(&out, "2", "cached").status().unwrap().success());
    // The dataset's own geometry, read by a scene that is to be baked there.
    let scene = dir.path().join("again.toml");
    let object =
        "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"with-notes/scene.glb\"\n";
    std::fs::write(&scene, object).unwrap();
    let glb = std::fs::read(out.join("scene.glb")).unwrap();
    let said = refused(Command::new(env!("CARGO_BIN_EXE_bake")).args([
        text(&scene),
        "--force",
        "--out",
        text(&out),
    ]));
    assert!(said.contains("the scene reads it"), "{said}");
    assert_eq!(std::fs::read(out.join("scene.glb")).unwrap(), glb);
}

#[test]
fn unfinished_work_is_not_dropped_for_other_settings() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    crate::lost::stop_after_the_last_round(&mut court(&out, "4", "cached"), &out);
    let said = refused(&mut court(&out, "2", "cached"));
    assert!(said.contains("unfinished work") && said.contains("--force"), "{said}");
    assert!(std::fs::read_dir(out.join(".bake")).unwrap().count() == 1);
    assert!(court(&out, "2", "cached").arg("--force").status().unwrap().success());
}

#[test]
fn work_of_which_all_layers_are_kept_is_in_nobodys_way() {
    // As a bake leaves it that was killed after the last layer was kept, and before its work was removed.
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    assert!(court(&out, "2", "cached").status().unwrap().success());
    let names = std::fs::read_dir(out.join(".layers")).unwrap().map(|e| e.unwrap().path());
    let layers = names.filter(|path| path.extension().is_some_and(|e| e == "layer"));
    let mut kept: Vec<String> =
        layers.map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned()).collect();
    assert!(kept.len() > 2);
    let work = out.join(".bake/0123456789abcdef");
    let leave = |layers: &[String]| {
        std::fs::create_dir_all(&work).unwrap();
        std::fs::write(work.join("layers.json"), format!("{layers:?}")).unwrap();
        std::fs::write(work.join("rounds.json"), "[]").unwrap();
    };
    leave(&kept);
    assert!(court(&out, "4", "cached").status().unwrap().success());
    assert!(!out.join(".bake").exists());
    // One layer that is not kept makes it unfinished.
    kept.push("f".repeat(64));
    leave(&kept);
    assert!(refused(&mut court(&out, "8", "cached")).contains("unfinished work"));
    assert!(work.exists());
}

#[test]
fn a_scene_of_the_same_name_and_other_geometry_does_not_replace_a_dataset() {
    let dir = tempfile::tempdir().unwrap();
    let scene = |folder: &str, file: &str| {
        let folder = dir.path().join(folder);
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join(file), "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n").unwrap();
        let text = format!(
            "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"{file}\"\n[lightmap]\nsize = 8\n"
        );
        std::fs::write(folder.join("level.toml"), text).unwrap();
        folder.join("level.toml")
    };
    let (a, b, out) = (scene("a", "hall.obj"), scene("b", "yard.obj"), dir.path().join("out"));
    let bake = |scene: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
        command.args([text(scene), "--hours", "12", "--samples", "2", "--out", text(&out)]);
        command
    };
    assert!(bake(&a).status().unwrap().success());
    let said = refused(&mut bake(&b));
    assert!(said.contains("it is of hall.obj, not of yard.obj"), "{said}");
    // And `--plan` says so beforehand, as it says what is there already.
    let planned =
        |scene: &Path| String::from_utf8(bake(scene).arg("--plan").output().unwrap().stdout).unwrap();
    // First, since the lists after it can be long.
    assert!(planned(&b).starts_with("this bake would be refused"), "{}", planned(&b));
    let first = format!("{} already holds this bake: nothing would be traced\n", out.display());
    assert!(planned(&a).starts_with(&first), "{}", planned(&a));
}

#[test]
fn another_scene_file_of_the_same_name_is_told_from_one_that_was_moved() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("dataset/court");
    let words = std::fs::read_to_string(fixture("court.toml")).unwrap().replace("size = 96", "size = 32");
    let scene = |folder: &str, words: &str| {
        std::fs::create_dir_all(dir.path().join(folder)).unwrap();
        std::fs::copy(fixture("court.obj"), dir.path().join(folder).join("court.obj")).unwrap();
        let path = dir.path().join(folder).join("court.toml");
        std::fs::write(&path, words).unwrap();
        path
    };
    let run = |scene: &Path, more: &[&str]| {
        let output = bake(&[&[text(scene), "--hours", "12", "--out", text(&out)], more].concat());
        (output.status.success(), String::from_utf8(output.stderr).unwrap())
    };
    let (first, second) = (scene("a", &words), scene("b", &words.replace("kelvin = 3000", "kelvin = 4000")));
    assert!(run(&first, &[]).0);
    let before = data(&out);
    let (done, said) = run(&second, &[]);
    assert!(
        !done && said.contains("a/court.toml, which has the same name as") && said.contains("--force"),
        "{said}"
    );
    assert!(before == data(&out));
    // Its copy is the same bake.
    assert!(run(&scene("c", &words), &[]).0);
    // A changed file is the same scene.
    std::fs::write(&first, words.replace("kelvin = 3000", "kelvin = 3500")).unwrap();
    assert!(run(&first, &[]).0);
    // So is one that is no longer where it was, and one that was moved together with its dataset.
    std::fs::remove_file(&first).unwrap();
    assert!(run(&second, &[]).0);
    let (done, said) = run(&scene("d", &words), &["--force"]);
    assert!(done, "{said}");
}
