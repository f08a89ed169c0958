//! What is wrong with a folder that others made is an error that names it, and leaves nothing behind.

mod common;

use common::layouts;
use dataset::exchange::{Origin, import};
use dataset::layout::Layout;
use dataset::layout::hprc1::Hprc1;
use dataset::layout::hprc2::Hprc2;
use dataset::observe::Silent;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Imports into a folder that must not be there afterwards, with an error that has all the words.
fn refused(layout: &'static dyn Layout, source: &Path, words: &[&str]) {
    let out = source.with_extension("out");
    let error = import(&Origin::Folder(layout, source.to_owned()), &out, &Silent);
    let error = error.expect_err(&format!("{words:?}")).to_string();
    assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    let left: Vec<_> = fs::read_dir(source.parent().unwrap()).unwrap().flatten().collect();
    assert_eq!(left.len(), 1, "{words:?}: {left:?}");
}

/// A change to the configuration, or to the folder, and words of the error that it must give.
type Case = (fn(&mut Value), &'static [&'static str]);

/// Ids are numbers or texts, which become parts of file names.
#[test]
fn every_broken_id_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("contest");
    let place = source.join("config.json");
    type Write = fn(&Path);
    let layouts: [(&dyn Layout, Write); 2] = [
        (&Hprc1, |source| _ = layouts::write1(source, &[(5, (4, 6), 2)], false)),
        (&Hprc2, |source| _ = layouts::write2(source)),
    ];
    let expected = "expected a whole number, or a text of 1 to 64 bytes that can be part of a file name";
    let mut cases = vec![
        (json!(u64::MAX), "id 18446744073709551615; expected at most 9223372036854775807".to_owned()),
        (json!(1.5), format!("invalid type: floating point `1.5`, {expected}")),
        (json!(null), format!("invalid type: null, {expected}")),
        (json!(true), format!("invalid type: boolean `true`, {expected}")),
        (json!([1]), format!("invalid type: sequence, {expected}")),
        (json!({"id": 1}), format!("invalid type: map, {expected}")),
    ];
    let long = "x".repeat(65);
    for text in ["", ".", "..", "../5", "/5", "a/../../b", "a\\b", "C:5", "5\0", "5\n", "\u{9b}5", &long] {
        cases.push((json!(text), format!("id {text:?}; {expected}")));
    }
    for (layout, write) in layouts {
        drop(fs::remove_dir_all(&source));
        write(&source);
        let good: Value = serde_json::from_slice(&fs::read(&place).unwrap()).unwrap();
        for (id, error) in &cases {
            let mut config = good.clone();
            config["lightmap_list"][0]["id"] = id.clone();
            fs::write(&place, config.to_string()).unwrap();
            refused(layout, &source, &["config.json:", error]);
        }
    }
}

#[test]
fn every_broken_configuration_of_layout_2_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("contest");
    layouts::write2(&source);
    let place = source.join("config.json");
    let good: Value = serde_json::from_slice(&fs::read(&place).unwrap()).unwrap();
    let cases: [Case; 28] = [
        (|c| c["lightmap_count"] = json!(3), &["lightmap_count is 3, but lightmap_list has 2"]),
        (|c| c["lightmap_count"] = json!(u64::MAX), &["lightmap_count is 18446744073709551615"]),
        (|c| *c = json!({"lightmap_count": 0, "lightmap_list": []}), &["expected equal numbers ≥ 1"]),
        (|c| c["extra"] = json!(1), &["config.json:", "unknown field `extra`"]),
        (|c| c["lightmap_list"][0]["extra"] = json!(1), &["unknown field `extra`"]),
        (
            |c| drop(c["lightmap_list"][0].as_object_mut().unwrap().remove("masks")),
            &["missing field `masks`"],
        ),
        (
            |c| {
                c["lightmap_list"][1]["id"] = json!(4);
                c["lightmap_list"][1]["level"] = json!("Level_A");
            },
            &["lightmap 4 of Level_A occurs twice; expected distinct pairs of level and id"],
        ),
        // As a text it is the same id.
        (
            |c| {
                c["lightmap_list"][1]["id"] = json!("4");
                c["lightmap_list"][1]["level"] = json!("Level_A");
            },
            &["lightmap 4 of Level_A occurs twice"],
        ),
        (|c| c["lightmap_list"][1]["level"] = json!(4), &["invalid type: integer `4`, expected a string"]),
        (
            |c| c["lightmap_list"][0]["resolution"]["width"] = json!(0),
            &["resolution 0×6; expected 1 to 65536"],
        ),
        (
            |c| c["lightmap_list"][0]["resolution"]["height"] = json!(70_000),
            &["9×70000; expected 1 to 65536"],
        ),
        (|c| c["lightmap_list"][0]["resolution"]["height"] = json!(u64::MAX), &["invalid value"]),
        (|c| c["lightmap_list"][0]["resolution"]["height"] = json!(-1), &["invalid value"]),
        // Dimensions that no file fills.
        (
            |c| c["lightmap_list"][0]["resolution"] = json!({"width": 65536, "height": 65536}),
            &["54 bytes; expected 4294967296"],
        ),
        (
            |c| c["lightmap_list"][0]["resolution"]["width"] = json!(8),
            &["mask_4_0.bin_0", "54 bytes; expected 48: 8×6"],
        ),
        (
            |c| c["lightmap_list"][0]["lightmaps"]["0"] = json!("/etc/passwd"),
            &["lightmap 4 of Level_A: lightmaps, time key 0: \"/etc/passwd\""],
        ),
        (
            |c| c["lightmap_list"][0]["lightmaps"]["0"] = json!("../config.json"),
            &["\"../config.json\"; expected the name"],
        ),
        (
            |c| c["lightmap_list"][0]["lightmaps"]["0"] = json!("a\\..\\b"),
            &["expected the name of a file in Data/"],
        ),
        (|c| c["lightmap_list"][0]["masks"]["0"] = json!(".."), &["masks, time key 0: \"..\""]),
        (|c| c["lightmap_list"][0]["masks"]["0"] = json!(""), &["masks, time key 0: \"\""]),
        (
            |c| c["lightmap_list"][0]["lightmaps"]["0"] = json!("none.bin_0"),
            &["lightmap 4 of Level_A: 1 file missing: Data/none.bin_0"],
        ),
        (
            |c| c["lightmap_list"][0]["lightmaps"]["2400"] = json!("raw_4_0.bin_0"),
            &["time key \"2400\"; expected the hour × 100"],
        ),
        (|c| c["lightmap_list"][0]["lightmaps"]["06"] = json!("raw_4_0.bin_0"), &["time key \"06\""]),
        (|c| c["lightmap_list"][0]["lightmaps"]["noon"] = json!("raw_4_0.bin_0"), &["time key \"noon\""]),
        (|c| c["lightmap_list"][0]["lightmaps"] = json!({}), &["lightmaps is empty"]),
        (|c| c["lightmap_list"][0]["masks"] = json!({}), &["masks is empty"]),
        (
            |c| drop(c["lightmap_list"][1]["lightmaps"].as_object_mut().unwrap().remove("750")),
            &["masks has 7.5 h, which lightmaps lacks"],
        ),
        (
            |c| {
                ["lightmaps", "masks"].into_iter().for_each(|key| {
                    drop(c["lightmap_list"][1][key].as_object_mut().unwrap().remove("750"));
                })
            },
            &["lightmap -1 of Level \u{e9} lacks 7.5 h, which lightmap 4 of Level_A has"],
        ),
    ];
    for (change, words) in cases {
        let mut config = good.clone();
        change(&mut config);
        fs::write(&place, serde_json::to_vec_pretty(&config).unwrap()).unwrap();
        refused(&Hprc2, &source, words);
    }
    let text = serde_json::to_string_pretty(&good).unwrap();
    fs::write(&place, text.replacen("\"590\":", "\"0\":", 1)).unwrap();
    refused(&Hprc2, &source, &["config.json:", "time key \"0\" occurs twice"]);
    fs::write(&place, &text[..text.len() / 2]).unwrap();
    refused(&Hprc2, &source, &["config.json:", "EOF"]);
    fs::remove_file(&place).unwrap();
    refused(&Hprc2, &source, &["config.json"]);
}

#[test]
fn every_broken_file_of_layout_2_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("contest");
    let lightmaps = layouts::write2(&source);
    let valid = lightmaps[0].valid.iter().rposition(|valid| *valid).unwrap();
    let (x, y) = (valid % 9, valid / 9);
    let light = source.join("Data/raw_4_600.bin_0");
    let mask = source.join("Data/mask_4_600.bin_0");
    let with = |path: &Path, bytes: &[u8], words: &[&str]| {
        let good = fs::read(path).unwrap();
        fs::write(path, bytes).unwrap();
        refused(&Hprc2, &source, words);
        fs::write(path, good).unwrap();
    };
    let (whole, whole_mask) = (fs::read(&light).unwrap(), fs::read(&mask).unwrap());
    with(
        &light,
        &whole[..whole.len() - 1],
        &["raw_4_600.bin_0: 647 bytes; expected 648: 9×6 texels of 12 bytes"],
    );
    with(&light, &[&*whole, &[0]].concat(), &["649 bytes; expected 648"]);
    with(&light, &[], &["0 bytes; expected 648"]);
    for (value, reported) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (-0.25, "-0.25")] {
        let mut bytes = whole.clone();
        bytes[4 * (3 * valid + 1)..][..4].copy_from_slice(&value.to_le_bytes());
        let place =
            format!("raw_4_600.bin_0, texel ({x}, {y}): channel G is {reported}; expected a finite value");
        with(&light, &bytes, &[&place]);
    }
    let mut bytes = whole_mask.clone();
    bytes[10] = 1;
    with(&mask, &bytes, &["mask_4_600.bin_0, texel (1, 1): mask value 1; expected -1 or 127"]);
    bytes[10] = if whole_mask[10] == 127 { 255 } else { 127 };
    with(&mask, &bytes, &["mask_4_", ".bin_0, texel (1, 1)", "expected the same mask at all hours"]);

    // Links: inside the folder they are files like any other, outside they are refused.
    #[cfg(unix)]
    {
        let outside = tempfile::tempdir().unwrap();
        fs::rename(&light, outside.path().join("light")).unwrap();
        std::os::unix::fs::symlink(outside.path().join("light"), &light).unwrap();
        refused(&Hprc2, &source, &["raw_4_600.bin_0: leads to", "expected a file inside"]);
        fs::remove_file(&light).unwrap();
        fs::create_dir(&light).unwrap();
        refused(&Hprc2, &source, &["raw_4_600.bin_0: not a file"]);
        fs::remove_dir(&light).unwrap();
        fs::write(source.join("light"), &whole).unwrap();
        std::os::unix::fs::symlink(source.join("light"), &light).unwrap();
        let out = folder.path().join("set");
        import(&Origin::Folder(&Hprc2, source), &out, &Silent).unwrap();
    }
}

#[test]
fn every_broken_folder_of_layout_1_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("contest");
    layouts::write1(&source, &[(5, (4, 6), 2)], true);
    let place = source.join("config.json");
    let good: Value = serde_json::from_slice(&fs::read(&place).unwrap()).unwrap();
    let cases: [Case; 6] = [
        (
            |c| c["lightmap_list"][0]["parts"] = json!(0),
            &["lightmap 5: 0 parts; expected a divisor of the height, 6, from 1 to 256"],
        ),
        (|c| c["lightmap_list"][0]["parts"] = json!(4), &["4 parts"]),
        (|c| c["lightmap_list"][0]["parts"] = json!(u32::MAX), &["4294967295 parts"]),
        // A claim of many files is met by the first that is not there.
        (|c| c["lightmap_list"][0]["parts"] = json!(3), &["missing: Mask/", "_1.00.bin_2", " more"]),
        (|c| c["lightmap_list"][0]["level"] = json!("x"), &["unknown field `level`"]),
        (|c| c["lightmap_list"][0]["id"] = json!(6), &["lightmap 6:", "missing"]),
    ];
    for (change, words) in cases {
        let mut config = good.clone();
        change(&mut config);
        fs::write(&place, config.to_string()).unwrap();
        refused(&Hprc1, &source, words);
    }
    fs::write(&place, good.to_string()).unwrap();
    // Hours that are missing are all named.
    let name = |t: u32| format!("Original/lightmapRawData_Dilate_VirtualTexture0_5_HQ_4_6_{t}.00.bin_1");
    for t in [3, 24] {
        fs::rename(source.join(name(t)), source.join(format!("{t}"))).unwrap();
    }
    refused(&Hprc1, &source, &["lightmap 5: 2 files missing", &name(3), &name(24)]);
    for t in [3, 24] {
        fs::rename(source.join(format!("{t}")), source.join(name(t))).unwrap();
    }
    fs::write(source.join(name(9)), b"short").unwrap();
    refused(&Hprc1, &source, &["9.00.bin_1: 5 bytes; expected 144: 4×3 texels of 12 bytes"]);
    fs::remove_dir_all(source.join("LocalOnly")).unwrap();
    refused(&Hprc1, &source, &["only DirectionalOnly, SkyLightOnly exists; expected"]);
}
