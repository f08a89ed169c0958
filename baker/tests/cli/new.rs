//! `bake new`: a scene file for a model, which bakes as it is.

use super::{bake, fixture, text};
use std::path::Path;

/// The court's OBJ with every length multiplied.
fn scaled(out: &Path, factor: f64) {
    let obj = std::fs::read_to_string(fixture("court.obj")).unwrap();
    let line = |line: &str| match line.strip_prefix("v ") {
        Some(numbers) => {
            let numbers = numbers.split_whitespace().map(|n| n.parse::<f64>().unwrap() * factor);
            format!("v {}", numbers.map(|n| n.to_string()).collect::<Vec<_>>().join(" "))
        }
        None => line.to_owned(),
    };
    std::fs::write(out, obj.lines().map(line).collect::<Vec<_>>().join("\n")).unwrap();
}

/// What `--json` printed.
fn json(output: &std::process::Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_scene_file_for_a_model_in_any_unit_is_planned_at_its_true_size() {
    let dir = tempfile::tempdir().unwrap();
    let mut extents = Vec::new();
    for (factor, unit) in [(1.0, "metres"), (100.0, "centimetres"), (1000.0, "millimetres")] {
        let model = dir.path().join(format!("my court in {unit}.obj"));
        scaled(&model, factor);
        let found = json(&bake(&["new", text(&model), "--json"]));
        assert_eq!(found["unit"], unit);
        let scene = dir.path().join(format!("my-court-in-{unit}.toml"));
        assert_eq!(found["scene"], text(&scene));
        let plan = json(&bake(&[text(&scene), "--hours", "12", "--plan", "--json"]));
        assert_eq!(plan["scene"], format!("my-court-in-{unit}"));
        extents.push(plan["forecast"]["extent"].as_array().unwrap().clone());
    }
    for extent in &extents[1..] {
        for (a, b) in extent.iter().zip(&extents[0]) {
            assert!((a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-3, "{extents:?}");
        }
    }
}

#[test]
fn a_scene_file_that_is_there_is_replaced_only_by_force() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("court.obj");
    scaled(&model, 1.0);
    let scene = dir.path().join("court.toml");
    std::fs::write(&scene, "mine").unwrap();
    let refused = bake(&["new", text(&model)]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && said.contains("--force"), "{said}");
    assert_eq!(std::fs::read_to_string(&scene).unwrap(), "mine");
    assert!(bake(&["new", text(&model), "--force", "--quiet"]).status.success());
    assert!(std::fs::read_to_string(&scene).unwrap().contains("court.obj"));
    // Elsewhere: the model is named from there.
    let out = dir.path().join("scenes/other.toml");
    std::fs::create_dir(dir.path().join("scenes")).unwrap();
    assert!(bake(&["new", text(&model), "--out", text(&out), "--quiet"]).status.success());
    assert!(std::fs::read_to_string(&out).unwrap().contains("\"../court.obj\""));
}

#[test]
fn what_is_no_model_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    for (name, expected) in [("scene.toml", "expected a model"), ("absent.glb", "no such file")] {
        let path = dir.path().join(name);
        if name == "scene.toml" {
            std::fs::write(&path, "").unwrap();
        }
        let refused = bake(&["new", text(&path)]);
        let said = String::from_utf8_lossy(&refused.stderr);
        assert!(!refused.status.success() && said.contains(expected), "{said}");
    }
}

#[test]
fn a_prop_has_no_windows_and_is_seen_from_outside() {
    let dir = tempfile::tempdir().unwrap();
    // A lantern: posts between two plates, with four openings that a room would call windows.
    let mut obj = String::new();
    let mut count = 0;
    let mut block = |low: [f64; 3], high: [f64; 3]| {
        for i in 0..8 {
            let at = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
            obj += &format!("v {} {} {}\n", at(0), at(1), at(2));
        }
        for side in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
            obj += &format!("f {}\n", side.map(|v| (v + count).to_string()).join(" "));
        }
        count += 8;
    };
    block([-0.5, 0.0, -0.5], [0.5, 0.1, 0.5]);
    block([-0.5, 1.1, -0.5], [0.5, 1.2, 0.5]);
    for (x, z) in [(-0.5, -0.5), (0.4, -0.5), (-0.5, 0.4), (0.4, 0.4)] {
        block([x, 0.1, z], [x + 0.1, 1.1, z + 0.1]);
    }
    let model = dir.path().join("lantern.obj");
    std::fs::write(&model, obj).unwrap();
    let found = json(&bake(&["new", text(&model), "--json"]));
    assert_eq!((&found["unit"], &found["portals"]), (&"metres".into(), &0.into()));
    let written = std::fs::read_to_string(dir.path().join("lantern.toml")).unwrap();
    let scene: toml::Value = toml::from_str(&written).unwrap();
    let position: Vec<f64> = scene["camera"][0]["position"].clone().try_into().unwrap();
    assert!(position.iter().any(|x| x.abs() > 1.2), "{position:?}");
}
