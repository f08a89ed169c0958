//! `bake new`: a scene file for a model, which bakes as it is.

use super::{bake, common, fixture, text};
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

/// The message of a refusal.
fn refused(arguments: &[&str]) -> String {
    let output = bake(&[&["new"], arguments].concat());
    assert!(!output.status.success(), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn what_is_no_model_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    std::fs::create_dir(dir.path().join("models")).unwrap();
    for (path, expected) in [
        (file("scene.toml", ""), "expected a model"),
        (dir.path().join("absent.glb"), "no such file"),
        (dir.path().join("models"), "is a folder; expected models"),
        (file("empty.obj", ""), "empty.obj: expected at least one triangle: the file has no faces"),
        (
            file("notes.obj", "Dear all,\nthe house comes on Monday.\n"),
            "notes.obj: expected at least one triangle",
        ),
        (
            file("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
            "the file has no faces with an area (points, lines and curves are not baked)",
        ),
        (file("point.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n"), "the file has no faces with an area"),
        (file("notes.glb", "Dear all"), "notes.glb:"),
        (file("notes.gltf", "Dear all"), "notes.gltf:"),
    ] {
        let said = refused(&[text(&path)]);
        assert!(said.contains(expected), "{said}");
    }
    // All at once.
    let said = refused(&[text(&dir.path().join("absent.glb")), text(&dir.path().join("models"))]);
    assert!(
        said.contains("2 errors") && said.contains("no such file") && said.contains("is a folder"),
        "{said}"
    );
}

#[test]
fn several_models_are_one_scene() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("court.obj"), dir.path().join("sub/other.obj"));
    std::fs::create_dir(dir.path().join("sub")).unwrap();
    scaled(&a, 1000.0);
    std::fs::write(&b, "v 0 0 0\nv 900 0 0\nv 0 0 -900\nf 1 2 3\n").unwrap();
    let found = json(&bake(&["new", text(&a), text(&b), "--json"]));
    let scene = dir.path().join("court.toml");
    assert_eq!((&found["scene"], &found["unit"]), (&text(&scene).into(), &"millimetres".into()));
    let extents: Vec<f64> =
        found["models"].as_array().unwrap().iter().map(|m| m["extent"][0].as_f64().unwrap()).collect();
    assert!((extents[1] - 0.9).abs() < 1e-6 && extents[0] > 2.0, "{extents:?}");
    let written: toml::Value = toml::from_str(&std::fs::read_to_string(&scene).unwrap()).unwrap();
    let objects = written["object"].as_array().unwrap();
    let of = |key: &str| objects.iter().map(|object| object[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("file"), ["court.obj".into(), "sub/other.obj".into()]);
    assert_eq!(of("scale"), [0.001.into(), 0.001.into()]);
    assert!(bake(&[text(&scene), "--hours", "12", "--plan", "--quiet"]).status.success());

    let said = refused(&[text(&a), text(&b), text(&dir.path().join("sub/../court.obj"))]);
    assert!(said.contains("sub/../court.obj: is given twice"), "{said}");
    // A house in metres and one in millimetres.
    scaled(&b, 1.0);
    let said = refused(&[text(&a), text(&b), "--force"]);
    assert!(
        said.contains("the models seem to be in different units: ") && said.contains("other.obj ("),
        "{said}"
    );
    assert!(said.contains("--unit metres|centimetres|millimetres"), "{said}");
    let found = json(&bake(&["new", text(&a), text(&b), "--unit", "millimetres", "--force", "--json"]));
    assert_eq!(found["unit"], "millimetres");
    assert!(refused(&[text(&a), "--unit", "furlongs"]).contains("expected metres, centimetres, millimetres"));
}

#[test]
fn a_model_whose_z_axis_points_up_is_turned() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("court.obj");
    scaled(&model, 1.0);
    let upright = json(&bake(&["new", text(&model), "--json"]));
    // (x, y, z) becomes (x, −z, y).
    let obj = std::fs::read_to_string(&model).unwrap();
    let turned = obj.lines().map(|line| match line.split_whitespace().collect::<Vec<_>>()[..] {
        ["v", x, y, z] => format!("v {x} {} {y}", -z.parse::<f64>().unwrap()),
        _ => line.to_owned(),
    });
    std::fs::write(&model, turned.collect::<Vec<_>>().join("\n")).unwrap();
    let output = bake(&["new", text(&model), "--json", "--force"]);
    let found = json(&output);
    assert_eq!((&upright["models"][0]["up"], &found["models"][0]["up"]), (&"y".into(), &"z".into()));
    let (a, b) = (upright["extent"].as_array().unwrap(), found["extent"].as_array().unwrap());
    assert!(
        a.iter().zip(b).all(|(a, b)| (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-4),
        "{a:?} {b:?}"
    );
    assert!(
        found["warnings"]
            .to_string()
            .contains("court.obj: judging by its floors and height, its z axis points up"),
        "{found}"
    );
    let written: toml::Value =
        toml::from_str(&std::fs::read_to_string(dir.path().join("court.toml")).unwrap()).unwrap();
    assert_eq!(written["object"][0]["rotate"], vec![-90, 0, 0].into());
}

#[test]
fn emission_of_leaves_and_faint_emission_are_switched_off() {
    let dir = tempfile::tempdir().unwrap();
    // Squares of one metre: a cut-out, one that is faint, one that is small, and two lamps.
    let mut obj = "mtllib a.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n".to_owned();
    let names = ["leaf", "faint", "dot", "panel", "dot_lamp"];
    for (i, name) in names.into_iter().enumerate() {
        let (x, side) = (2.0 * i as f64, if name.starts_with("dot") { 0.03 } else { 1.0 });
        obj += &format!(
            "o mesh{i}\nusemtl {name}\nv {x} 0 0\nv {0} 0 0\nv {0} {side} 0\nv {x} {side} 0\n",
            x + side
        );
        obj += "f -4/1 -3/2 -2/3 -1/4\n";
    }
    let emission = [1.0, 0.01, 1.0, 1.0, 1.0];
    let mut mtl: String = names
        .iter()
        .zip(emission)
        .map(|(name, e)| format!("newmtl {name}\nKd 0.5 0.5 0.5\nKe {e} {e} {e}\n"))
        .collect();
    mtl = mtl.replace("Ke 1 1 1\nnewmtl faint", "Ke 1 1 1\nmap_Kd leaf.png\nmap_d leaf.png\nnewmtl faint");
    std::fs::write(dir.path().join("a.mtl"), mtl).unwrap();
    std::fs::write(dir.path().join("leaf.png"), common::mesh::png(&[[0, 255, 0, 255], [0, 255, 0, 0]]))
        .unwrap();
    let model = dir.path().join("a.obj");
    std::fs::write(&model, obj).unwrap();
    let found = json(&bake(&["new", text(&model), "--json"]));
    assert_eq!(found["models"][0]["switched_off"], serde_json::json!(["dot", "faint", "leaf"]));
    assert_eq!(found["groups"], serde_json::json!(["panel", "dot_lamp"]));
    let scene = dir.path().join("a.toml");
    let written = std::fs::read_to_string(&scene).unwrap();
    for line in [
        "name = \"leaf\"\nemission = [0, 0, 0] # cut out by its alpha, as leaves are",
        "name = \"faint\"\nemission = [0, 0, 0] # nowhere brighter than 0.02 kcd/m²",
        "name = \"dot\"\nemission = [0, 0, 0] # less than 5 lm in all",
    ] {
        assert!(written.contains(line), "{written}");
    }
    let plan = bake(&[text(&scene), "--hours", "0", "--plan", "--json"]);
    let warnings = json(&plan)["warnings"].to_string();
    assert!(!warnings.contains("lit all day"), "{warnings}");
    // A part by that name would take the panel's mesh, too.
    let obj = std::fs::read_to_string(&model).unwrap().replace("o mesh3", "o dot");
    std::fs::write(&model, obj).unwrap();
    let found = json(&bake(&["new", text(&model), "--force", "--json"]));
    assert_eq!(found["models"][0]["switched_off"], serde_json::json!(["faint", "leaf"]));
}

#[test]
fn paths_of_models_hold_whatever_the_way_to_them() {
    let dir = tempfile::tempdir().unwrap();
    let [models, scenes] = ["models", "scenes"].map(|folder| dir.path().join(folder));
    [&models, &scenes].into_iter().for_each(|folder| std::fs::create_dir(folder).unwrap());
    std::fs::copy(fixture("court.obj"), models.join("court.obj")).unwrap();
    let out = models.join("../scenes/one.toml");
    bake(&["new", text(&scenes.join("../models/court.obj")), "--out", text(&out)]);
    let written = std::fs::read_to_string(scenes.join("one.toml")).unwrap();
    assert!(written.contains("file = \"../models/court.obj\""), "{written}");
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
