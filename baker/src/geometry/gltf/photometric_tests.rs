//! Lamps of `EXT_lights_ies`.

use super::super::pose_tests::Asset;
use super::*;
use crate::geometry;
use serde_json::json;

/// 50 to 200 cd, the same all round.
const PROFILE: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 9\n0 90\n0\n200 50\n";

/// A triangle, and a lamp of this extension with these lights.
fn asset(lamp: Value, lights: Value) -> Asset {
    let mut asset = Asset::new(
        json!([{ "mesh": 0 }, { "name": "lamp", "translation": [0, 2, 0], "scale": [2, 2, 2], "extensions": { EXTENSION: lamp } }]),
        2,
    );
    asset.view(PROFILE.as_bytes());
    asset.root["extensionsUsed"] = json!([EXTENSION]);
    asset.root["extensions"] = json!({ EXTENSION: { "lights": lights } });
    asset
}

fn embedded() -> Value {
    json!([{ "name": "downlight", "bufferView": 2, "mimeType": MIME }])
}

/// The lamps of an asset.
fn lamps(asset: &Asset) -> Vec<FileLamp> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.gltf"), asset.text()).unwrap();
    std::fs::write(folder.path().join("my lamp.ies"), PROFILE).unwrap();
    geometry::contents(&folder.path().join("a.gltf")).unwrap().lamps
}

#[test]
fn a_profile_gives_its_candela_times_multiplier_and_colour() {
    for lights in [embedded(), json!([{ "uri": "my%20lamp.ies" }])] {
        let all = lamps(&asset(json!({ "light": 0, "multiplier": 2.5, "color": [1, 0.5, 3] }), lights));
        let [lamp] = &all[..] else { panic!("{all:?}") };
        // (The format clamps the colour. No scale of a node changes the light.)
        assert_eq!((lamp.intensity, lamp.colour), (500.0, DVec3::new(1.0, 0.5, 1.0)));
        assert_eq!(
            (lamp.name.as_str(), lamp.position(&DMat4::IDENTITY)),
            ("lamp", DVec3::new(0.0, 2.0, 0.0))
        );
        // An untransformed lamp points down −Z.
        assert_eq!(lamp.direction(&DMat4::IDENTITY), Some(DVec3::NEG_Z));
        assert_eq!(lamp.sideways(&DMat4::IDENTITY, DVec3::NEG_Z), DVec3::X);
    }
    let mut unnamed = asset(json!({ "light": 0 }), embedded());
    unnamed.root["nodes"][1].as_object_mut().unwrap().remove("name");
    let all = lamps(&unnamed);
    assert_eq!((all[0].name.as_str(), all[0].intensity, all[0].colour), ("downlight", 200.0, DVec3::ONE));
}

#[test]
fn profiles_of_bad_form_are_errors_and_missing_ones_warnings() {
    for (lamp, lights, expected) in [
        (json!({}), embedded(), "node 1: `light` is missing: expected an index below 1"),
        (json!({ "light": 1 }), embedded(), "node 1: `light` = 1: expected an index below 1"),
        (
            json!({ "light": 0, "multiplier": -1 }),
            embedded(),
            "`multiplier` = -1: expected a number, 0 or more",
        ),
        (json!({ "light": 0, "color": [1, 1] }), embedded(), "`color` = [1,1]: expected three numbers"),
        (
            json!({ "light": 0 }),
            json!([{}]),
            "profile 0: `uri` is missing: expected either `uri` or `bufferView`",
        ),
        (
            json!({ "light": 0 }),
            json!([{ "bufferView": 2 }]),
            "`mimeType` is missing: expected \"application/x-ies-lm-63\"",
        ),
        (
            json!({ "light": 0 }),
            json!([{ "uri": "my%20lamp.ies", "mimeType": "text/plain" }]),
            "`mimeType` = \"text/plain\"",
        ),
        (json!({ "light": 0 }), json!([{ "uri": "a.ies", "bufferView": 2 }]), "no `bufferView` beside it"),
        (
            json!({ "light": 0 }),
            json!([{ "bufferView": 9, "mimeType": MIME }]),
            "`bufferView` = 9: expected an index below 3",
        ),
        // The corners of the triangle are no profile.
        (json!({ "light": 0 }), json!([{ "bufferView": 0, "mimeType": MIME }]), "profile 0: no line TILT="),
    ] {
        let error = asset(lamp, lights).load().expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}");
    }
    let mut missing = asset(json!({ "light": 0 }), json!([{ "uri": "gone.ies" }]));
    let (_, warnings) = missing.load().unwrap();
    let told =
        "lamp lamp (there is no file gone.ies beside it): left out: its photometric profile cannot be read";
    assert!(warnings.iter().any(|w| w.contains(told)), "{warnings:?}");
    missing.root["extensionsRequired"] = json!([EXTENSION]);
    assert!(missing.load().is_err());
}
