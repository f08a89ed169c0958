//! The layers of a manifest: each rule that they can break is named.

mod common;

use common::write_set;
use dataset::format::{Baked, Config, Daylight, Layer, Light, Part, Source};
use dataset::store::{Dataset, MANIFEST};
use std::fs;
use std::path::Path;

/// What opening a dataset with this manifest says.
fn reported(root: &Path, manifest: &impl serde::Serialize) -> Result<(), String> {
    fs::write(root.join(MANIFEST), serde_json::to_vec(manifest).unwrap()).unwrap();
    Dataset::open(root).map(drop).map_err(|error| error.to_string())
}

/// A layer of the sun (its direct and its indirect part are layers 0 and 1), the sky (2), the porch (3, 4) or
/// the garden (5, 6).
fn layer(config: &Config, index: usize) -> Layer {
    config.layers[index].clone()
}

fn imported(config: &mut Config) {
    config.source = Some(Source { layout: "hprc1".to_owned(), config: None, replaced_values: 0 });
}

#[test]
fn every_rule_that_layers_break_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let good = write_set(folder.path(), &[(20, 20), (3, 3)], 1).unwrap();
    assert_eq!(reported(folder.path(), &good), Ok(()));
    type Change = fn(&mut Config);
    let changes: &[(Change, &str)] = &[
        // Shapes.
        (|c| drop(c.layers[0].files.pop()), "layer 0 (sun, direct): files for 2 frames; expected 3"),
        (|c| c.layers[2].files.clear(), "layer 2 (sky, all): files for 0 frames; expected 3"),
        (
            |c| c.layers[3].files.push(vec![None; 2]),
            "(group \"porch\", direct): files for 2 frames; expected 1",
        ),
        (|c| c.layers[3].files.clear(), "(group \"porch\", direct): files for 0 frames; expected 1"),
        (
            |c| drop(c.layers[1].files[2].pop()),
            "layer 1 (sun, indirect), row 2: files for 1 page; expected 2",
        ),
        (|c| c.layers[6].files[0].push(None), "row 0: files for 3 pages; expected 2"),
        // Lights.
        (|c| c.layers[6].group = Some(2), "layer 6 (group 2, indirect): group is 2; expected one of 2"),
        (|c| c.layers[6].group = Some(u32::MAX), "group is 4294967295; expected one of 2"),
        (|c| c.layers[3].group = None, "(group, direct): group is null; expected the index"),
        (|c| c.layers[2].group = Some(0), "(sky \"porch\", all): group is 0; expected null"),
        (|c| c.layers[2].light = Light::Lamps, "light is \"lamps\"; expected this only in imported datasets"),
        (imported, "a light group's layer in an imported dataset"),
        (
            |c| {
                imported(c);
                c.layers.truncate(3);
                c.layers.push(Layer { light: Light::Lamps, part: Part::Direct, ..layer(c, 0) });
            },
            "layer 3 (lamps, direct): part is \"direct\"; expected \"all\" of lamps",
        ),
        (
            |c| c.layers[4].curve = c.noise.clone(),
            "(group \"porch\", indirect): curve: expected none (a group's light",
        ),
        // Order.
        (
            |c| c.layers.swap(0, 1),
            "layer 1 (sun, direct) comes after that of sun, indirect; expected the order",
        ),
        (|c| c.layers.swap(2, 3), "layer 3 (sky, all) comes after that of group \"porch\", direct"),
        (|c| c.layers.swap(4, 5), "layer 5 (group \"porch\", indirect) comes after"),
        (|c| c.layers.insert(1, layer(c, 0)), "layer 1 (sun, direct) comes after that of sun, direct"),
        // All lights or none, and of each what is baked.
        (
            |c| drop(c.layers.remove(0)),
            "sun: layers of the parts indirect; expected direct and indirect, or all (baked",
        ),
        (
            |c| drop(c.layers.drain(..2)),
            "sun: layers of the parts none; expected direct and indirect, or all",
        ),
        (|c| drop(c.layers.remove(2)), "sky: layers of the parts none; expected all (baked is \"all\""),
        (|c| c.layers[2].part = Part::Direct, "sky: layers of the parts direct; expected all"),
        (
            |c| drop(c.layers.pop()),
            "group \"garden\": layers of the parts direct; expected direct and indirect",
        ),
        (|c| c.layers.push(Layer { part: Part::All, ..layer(c, 6) }), "parts direct and indirect and all"),
        (|c| c.sun = None, "sun is null: layers of the parts direct and indirect; expected none"),
        (|c| c.sky = None, "sky is null: layers of the parts all; expected none"),
        (|c| c.sun = Some(Daylight { baked: Baked::Indirect }), "expected indirect (baked is \"indirect\""),
        (|c| c.sun = Some(Daylight { baked: Baked::None }), "expected none (baked is \"none\""),
        (
            |c| c.sky = Some(Daylight { baked: Baked::Indirect }),
            "sky: layers of the parts all; expected indirect",
        ),
        (
            |c| c.groups[1].baked = Baked::Indirect,
            "group \"garden\": layers of the parts direct and indirect",
        ),
    ];
    for (change, word) in changes {
        let mut config = good.clone();
        change(&mut config);
        let message = reported(folder.path(), &config).expect_err(word);
        assert!(message.contains(word), "{word}: {message}");
    }
    // What is baked in part, with the layers of that part; none are kept; one of all of a light.
    let allowed: [Change; 4] = [
        |c| {
            c.sun = Some(Daylight { baked: Baked::Indirect });
            c.layers.remove(0);
        },
        |c| {
            c.sky = Some(Daylight { baked: Baked::Indirect });
            c.layers[2].part = Part::Indirect;
        },
        |c| c.layers.clear(),
        |c| {
            c.layers.remove(0);
            c.layers[0].part = Part::All;
        },
    ];
    for (index, change) in allowed.iter().enumerate() {
        let mut config = good.clone();
        change(&mut config);
        assert_eq!(reported(folder.path(), &config), Ok(()), "{index}");
    }
}

#[test]
fn words_that_the_manifest_does_not_know_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let good = serde_json::to_value(write_set(folder.path(), &[(20, 20)], 1).unwrap()).unwrap();
    let file = good["frames"][0]["maps"][0].clone();
    let cases = [
        (
            "/pages/0/kind",
            "probes".into(),
            "page 0: kind is \"probes\"; this program reads only pages of the kind \"atlas\"",
        ),
        ("/pages/0/kind", "voxels".into(), "unknown variant `voxels`"),
        ("/sun/baked", "half".into(), "unknown variant `half`"),
        ("/sky", "all".into(), "expected struct Daylight"),
        ("/layers/0/light", "moon".into(), "unknown variant `moon`"),
        ("/layers/0/part", "glossy".into(), "unknown variant `glossy`"),
        ("/layers/3/group", (-1).into(), "-1"),
        ("/layers/0/files/0", file.clone(), "expected a sequence"),
        (
            "/frames/0/maps/0",
            serde_json::json!({"file": file, "sun": null, "sky": null}),
            "unknown field `file`",
        ),
        (
            "/groups/0",
            serde_json::json!({"name": "porch", "on": [[18.0, 6.0]], "layers": []}),
            "unknown field `layers`",
        ),
        ("/version", 1.into(), "format version 1; this program reads version 2"),
        ("/version", "2".into(), "format version \"2\"; this program reads version 2; expected that number"),
    ];
    for (pointer, value, word) in cases {
        let mut bad = good.clone();
        *bad.pointer_mut(pointer).unwrap() = value;
        let message = reported(folder.path(), &bad).expect_err(pointer);
        assert!(message.contains(word), "{pointer}: {message}");
    }
    // Every key is always there.
    for (pointer, keys) in [
        ("/pages/0", &["kind", "mask"][..]),
        ("/sun", &["baked"]),
        ("/groups/1", &["baked"]),
        ("/layers/0", &["light", "group", "part", "files"]),
        ("/frames/0", &["hour", "groups_on", "relative_error", "maps"]),
    ] {
        for key in keys {
            let mut less = good.clone();
            less.pointer_mut(pointer).unwrap().as_object_mut().unwrap().remove(*key).unwrap();
            let message = reported(folder.path(), &less).expect_err(key);
            assert!(message.contains(&format!("missing field `{key}`")), "{pointer}: {message}");
        }
    }
}
