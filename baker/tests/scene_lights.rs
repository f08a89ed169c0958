//! What shines in geometry files: lamps, glowing materials, and the groups they become.

use baker::geometry::{self, FileLampKind, Geometry};
use baker::scene::{self, Lamp, Scene, SunTrack};
use base64::Engine;
use glam::{DMat4, DVec3};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::fs;
use std::path::Path;

/// A triangle, and whatever else nodes and materials are given.
fn asset(nodes: Value, lights: Value, materials: Value) -> Value {
    let bytes: Vec<u8> =
        [0f32, 0., 0., 1., 0., 0., 0., 0., -1.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let uri = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let mut all = vec![json!({ "mesh": 0, "name": "floor" })];
    all.extend(nodes.as_array().unwrap().iter().cloned());
    let is_child = |i: usize| {
        all.iter()
            .any(|n| n["children"].as_array().is_some_and(|c| c.iter().any(|c| c.as_u64() == Some(i as u64))))
    };
    let roots: Vec<usize> = (0..all.len()).filter(|&i| !is_child(i)).collect();
    json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": lights } },
        "scenes": [{ "nodes": roots }],
        "nodes": all,
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1 } }],
        "materials": materials,
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, -1], "max": [1, 0, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": format!("data:application/octet-stream;base64,{uri}") }],
    })
}

fn light(index: usize) -> Value {
    json!({ "KHR_lights_punctual": { "light": index } })
}

#[test]
fn lamps_and_cameras_of_a_file_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    let nodes = json!([
        { "name": "post", "translation": [1, 2, 3], "scale": [2, 2, 2], "children": [2, 3] },
        // A quarter turn about X: −Z becomes −Y.
        { "name": " lantern\n", "translation": [0, 1, 0], "rotation": [-(0.5f64.sqrt()), 0, 0, 0.5f64.sqrt()], "extensions": light(1) },
        { "extensions": light(0) },
        { "name": "sun", "extensions": light(2) },
        { "name": "eye", "camera": 0, "translation": [0, 0, 5] },
    ]);
    let lights = json!([
        { "name": "bulb", "type": "point", "intensity": 40, "color": [1, 0.5, 0.25], "range": 3 },
        { "type": "spot", "intensity": 100, "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.4 } },
        { "type": "directional", "intensity": 90000 },
    ]);
    fs::write(&path, asset(nodes, lights, json!([{}])).to_string()).unwrap();
    let contents = geometry::contents(&path).unwrap();
    let [spot, bulb, sun] = &contents.lamps[..] else { panic!("{:?}", contents.lamps) };
    assert_eq!((spot.name.as_str(), &spot.names[..]), ("lantern", &["lantern".to_owned()][..]));
    assert_eq!(spot.kind, FileLampKind::Spot { inner: f64::from(0.2f32), outer: f64::from(0.4f32) });
    assert!((spot.position(&DMat4::IDENTITY) - DVec3::new(1.0, 4.0, 3.0)).length() < 1e-6);
    assert!((spot.direction(&DMat4::IDENTITY).unwrap() - DVec3::NEG_Y).length() < 1e-6);
    // A node without a name has its light's.
    assert_eq!((bulb.name.as_str(), &bulb.kind, bulb.intensity), ("bulb", &FileLampKind::Point, 40.0));
    assert_eq!(bulb.colour, DVec3::new(1.0, 0.5, 0.25));
    assert_eq!((sun.name.as_str(), &sun.kind, sun.intensity), ("sun", &FileLampKind::Directional, 90000.0));
    let [eye] = &contents.cameras[..] else { panic!("{:?}", contents.cameras) };
    assert_eq!(
        (eye.name.as_str(), eye.position, eye.direction),
        ("eye", DVec3::new(0.0, 0.0, 5.0), DVec3::NEG_Z)
    );
    // Twice as wide as high: tan(fov / 2) = 2 tan(½).
    assert!((eye.fov - (2.0 * 0.5f64.tan()).atan().to_degrees() * 2.0).abs() < 1e-4);
}

/// Loads `a.gltf` by a scene file with these lines above its object: the scene with the files' lights, its
/// geometry, the warnings.
fn load(asset: &Value, lines: &str, keys: &str) -> (Scene, Geometry, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.gltf"), asset.to_string()).unwrap();
    load_from(folder.path(), lines, "a.gltf", keys)
}

fn load_from(folder: &Path, lines: &str, file: &str, keys: &str) -> (Scene, Geometry, Vec<String>) {
    fs::write(
        folder.join("scene.toml"),
        format!("{lines}\n[bake]\nalbedo_max = 1\n[[object]]\nfile = \"{file}\"\n{keys}\n"),
    )
    .unwrap();
    let (mut scene, mut warnings) = scene::load(&folder.join("scene.toml")).unwrap_or_else(|e| panic!("{e}"));
    let geometry = geometry::load_with(&scene, &mut warnings).unwrap_or_else(|e| panic!("{e}"));
    geometry.lights.add_to(&mut scene);
    (scene, geometry, warnings)
}

fn names(scene: &Scene) -> Vec<(&str, usize)> {
    scene.groups.iter().map(|g| (g.name.as_str(), g.lamps.len())).collect()
}

/// Two lanterns below a post, and a spot.
fn lanterns() -> Value {
    let nodes = json!([
        { "name": "post", "children": [2, 3] },
        { "name": "left", "translation": [-1, 2, 0], "extensions": light(0) },
        { "name": "right", "translation": [1, 2, 0], "extensions": light(0) },
        { "name": "spot", "translation": [5, 3, 0], "extensions": light(1) },
    ]);
    let lights = json!([
        { "type": "point", "intensity": 50, "color": [1, 0.5, 0.25] },
        { "type": "spot", "intensity": 2000, "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.4 } },
    ]);
    asset(nodes, lights, json!([{}]))
}

#[test]
fn lamps_of_a_file_are_groups_by_the_name_of_their_node() {
    let (scene, _, warnings) = load(&lanterns(), "", "");
    assert_eq!(names(&scene), [("left", 1), ("right", 1), ("spot", 1)]);
    assert!(scene.groups.iter().all(|g| g.on == [[0.0, 24.0]]));
    let Lamp::Point { position, intensity } = scene.groups[0].lamps[0] else { panic!("{:?}", scene.groups) };
    // 50 cd are 0.05 kcd.
    assert!((position - DVec3::new(-1.0, 2.0, 0.0)).length() < 1e-6);
    assert!((intensity - DVec3::new(0.05, 0.025, 0.0125)).length() < 1e-9);
    let Lamp::Spot { direction, inner, outer, intensity, .. } = scene.groups[2].lamps[0] else { panic!() };
    assert!((direction - DVec3::NEG_Z).length() < 1e-9 && (intensity - DVec3::splat(2.0)).length() < 1e-9);
    assert_eq!((inner, outer), (f64::from(0.2f32), f64::from(0.4f32)));
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(
        warning.starts_with("lit all day: 3 lamps of files")
            && warning.contains(r#""left", "right", "spot""#),
        "{warning}"
    );

    // By the name of the node above them, by a list with a star, by the name of the rest.
    for (groups, expected) in [
        ("[[group]]\nname = \"post\"\non = [[18, 6]]", vec![("post", 2), ("spot", 1)]),
        ("[[group]]\nname = \"a\"\nlights = [\"*t\"]", vec![("a", 3)]),
        (
            "[[group]]\nname = \"right\"\n[[group]]\nname = \"a\"\nlights = [\"post\"]",
            vec![("right", 1), ("a", 1), ("spot", 1)],
        ),
        (
            "[[group]]\nname = \"spot\"\n[[group]]\nname = \"file\"\non = [[18, 6]]",
            vec![("spot", 1), ("file", 2)],
        ),
    ] {
        let (scene, _, warnings) = load(&lanterns(), groups, "");
        assert_eq!(names(&scene), expected, "{groups}");
        let free = expected.iter().any(|(name, _)| *name == "spot") && !groups.contains("\"spot\"");
        assert_eq!(warnings.len(), usize::from(free), "{warnings:?}");
    }
    let (scene, _, _) = load(&lanterns(), "[[group]]\nname = \"post\"\non = [[18, 6]]", "");
    assert_eq!(scene.groups[0].on, [[18.0, 6.0]]);
}

#[test]
fn scale_instances_and_switching_off() {
    let keys = "scale = 3\ninstances = [{ translate = [0, 0, 0] }, { translate = [0, 0, 10], rotate = [-90, 0, 0] }]";
    let (scene, _, _) = load(&lanterns(), "[lights]\nscale = 0.5", keys);
    // The scale of a node moves lamps and does not change their intensity.
    assert_eq!(names(&scene), [("left", 2), ("right", 2), ("spot", 2)]);
    let Lamp::Spot { position, direction, intensity, .. } = scene.groups[2].lamps[1] else { panic!() };
    assert!((position - DVec3::new(15.0, 0.0, 21.0)).length() < 1e-5, "{position}");
    assert!((direction - DVec3::NEG_Y).length() < 1e-6, "{direction}");
    assert!((intensity - DVec3::ONE).length() < 1e-9);

    let (scene, _, warnings) = load(&lanterns(), "[lights]\nfrom_file = false", "");
    assert!(scene.groups.is_empty() && warnings.is_empty(), "{warnings:?}");
    let (_, _, warnings) = load(&lanterns(), "[[group]]\nname = \"porch\"", "");
    assert!(
        warnings[1].contains(
            "\"porch\" has no lamp and no emission (the lights of the files are called left, right, spot)"
        ),
        "{warnings:?}"
    );
}

#[test]
fn each_lighting_mode_of_blender_gives_the_same_light() {
    // A sun of 5 W/m² and a point of 1000 W, as each mode exports them.
    let watts_per_steradian = 1000.0 / (4.0 * PI);
    for (unit, sun, lamp) in [
        ("standard", 683.0 * 5.0, 683.0 * watts_per_steradian),
        ("unitless", 5.0, watts_per_steradian),
        ("raw", 5.0, 1000.0),
    ] {
        let nodes =
            json!([{ "name": "sun", "extensions": light(0) }, { "name": "lamp", "extensions": light(1) }]);
        let lights =
            json!([{ "type": "directional", "intensity": sun }, { "type": "point", "intensity": lamp }]);
        let asset = asset(nodes, lights, json!([{}]));
        for scale in [1.0, 2.0] {
            let (scene, ..) = load(&asset, &format!("[lights]\nunit = \"{unit}\"\nscale = {scale}"), "");
            let SunTrack::Authored(track) = &scene.sun.as_ref().unwrap().track else { panic!("{unit}") };
            // (glTF holds single precision.)
            let klx = track[0].irradiance / scale;
            assert!((klx - DVec3::splat(3.415)).length() < 1e-6, "{unit}: {klx}");
            let Lamp::Point { intensity, .. } = scene.groups[0].lamps[0] else { panic!("{unit}") };
            let kcd = intensity / scale;
            assert!((kcd / (0.683 * watts_per_steradian) - 1.0).length() < 1e-6, "{unit}: {kcd}");
        }
    }
}

#[test]
fn a_lamp_beside_one_of_the_scene_file_is_left_out() {
    let group = "[[group]]\nname = \"a\"\n[[group.point]]\nposition = [-1.05, 2, 0]\nintensity = [1, 1, 1]";
    let (scene, _, warnings) = load(&lanterns(), group, "");
    assert_eq!(names(&scene), [("a", 1), ("right", 1), ("spot", 1)]);
    assert!(
        warnings[0].ends_with("lamp left: left out: a lamp of the scene file stands within 0.1 m of it"),
        "{warnings:?}"
    );
}

#[test]
fn many_names_become_one_group() {
    let nodes: Vec<Value> =
        (0..17).map(|i| json!({ "name": format!("lamp.{i:03}"), "extensions": light(0) })).collect();
    let materials = json!([{ "name": "glass", "emissiveFactor": [1, 1, 1] }]);
    let asset = asset(json!(nodes), json!([{ "type": "point" }]), materials);
    let (scene, geometry, warnings) =
        load(&asset, "[[group]]\nname = \"a\"\nlights = [\"lamp.000\", \"lamp.001\"]", "");
    assert_eq!(names(&scene)[..2], [("a", 2), ("lamp.002", 1)]);
    assert_eq!((scene.groups.len(), geometry.materials[0].emission.unwrap().group), (17, 16));
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let (scene, geometry, warnings) = load(&asset, "[[group]]\nname = \"a\"\nlights = [\"lamp.000\"]", "");
    assert_eq!(names(&scene), [("a", 1), ("file", 16)]);
    assert_eq!(geometry.materials[0].emission.unwrap().group, 1);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(
        warning.starts_with(
            "lit all day: 16 lamps and 1 glowing material of files, in one light group, \"file\""
        ),
        "{warning}"
    );
    // Patterns that take all, and those of one kind.
    assert!(
        warning.contains("`lights = [\"*\"]`") && warning.contains("`lights = [\"lamp*\"]`"),
        "{warning}"
    );
}

#[test]
fn a_directional_light_is_the_sun_where_the_scene_has_no_other() {
    let quarter = json!([-(0.5f64.sqrt()), 0, 0, 0.5f64.sqrt()]);
    let nodes = json!([
        { "name": "moon", "extensions": light(0) },
        { "name": "sun", "rotation": quarter, "extensions": light(1) },
    ]);
    let lights = json!([
        { "type": "directional", "intensity": 1 },
        { "type": "directional", "intensity": 50000, "color": [1, 0.9, 0.8] },
    ]);
    let asset = asset(nodes, lights, json!([{}]));
    let (scene, _, warnings) = load(&asset, "", "");
    let sun = scene.sun.as_ref().unwrap();
    let scene::SunTrack::Authored(keys) = &sun.track else { panic!("{sun:?}") };
    assert!((keys[0].direction - DVec3::Y).length() < 1e-6, "{keys:?}");
    assert!((keys[0].irradiance - DVec3::new(50.0, 45.0, 40.0)).length() < 1e-4, "{keys:?}");
    assert!(warnings.len() == 1 && warnings[0].contains("1 other left out"), "{warnings:?}");

    let place = "[place]\nlatitude = 48\nlongitude = 11\nutc_offset = 1\ndate = 2026-03-01";
    for (lines, has_sun, told) in [
        (format!("{place}\n[sun]"), true, "left out: the scene file has a [sun]"),
        (place.to_owned(), false, "track = [{ hour = 0, direction = [0, 1, 0], irradiance = [50, 45, 40] }]"),
    ] {
        let (scene, _, warnings) = load(&asset, &lines, "");
        assert_eq!(scene.sun.is_some(), has_sun);
        assert!(warnings.iter().any(|w| w.contains(told)), "{warnings:?}");
    }
}

#[test]
fn glowing_materials_shine_in_a_group_of_their_name() {
    let materials = json!([{ "name": "glass", "emissiveFactor": [1, 0.5, 0], "extensions": {
        "KHR_materials_emissive_strength": { "emissiveStrength": 4 } } }]);
    let asset = asset(json!([]), json!([]), materials);
    let emission = |lines: &str, keys: &str| {
        let (scene, geometry, _) = load(&asset, lines, keys);
        geometry.materials[0]
            .emission
            .map(|e| (e.radiance.to_array(), scene.groups[e.group as usize].name.clone()))
    };
    assert_eq!(emission("", ""), Some(([4.0, 2.0, 0.0], "glass".to_owned())));
    assert_eq!(emission("[lights]\nemission = 0.001", "").unwrap().0, [0.004, 0.002, 0.0]);
    assert_eq!(emission("[lights]\nemission = 0", ""), None);
    assert_eq!(emission("[lights]\nfrom_file = false", ""), None);
    // What the scene file says goes before.
    let group = "[[group]]\nname = \"night\"";
    assert_eq!(
        emission(group, "emission = [1, 1, 1]\ngroup = \"night\""),
        Some(([1.0; 3], "night".to_owned()))
    );
    assert_eq!(emission(group, "group = \"night\""), Some(([4.0, 2.0, 0.0], "night".to_owned())));
    assert_eq!(emission("", "emission = [0, 0, 0]"), None);
    // By the node's name too.
    assert_eq!(emission("[[group]]\nname = \"floor\"", "").unwrap().1, "floor");
}

#[test]
fn an_obj_glows_by_ke() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    file("a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
    for (library, expected) in [
        ("newmtl m\nKd 0.5 0.5 0.5\nKe 3 2 1\n", Some([3.0, 2.0, 1.0])),
        ("newmtl m\nKe 0 0 0\n", None),
        ("newmtl m\nKd 0.5 0.5 0.5\n", None),
        ("newmtl m\nKe 1 -1 1\n", None),
        ("newmtl m\nKe bright\n", None),
        ("newmtl m\nKe 1 1 1\nmap_Ke missing.png\n", None),
    ] {
        file("a.mtl", library);
        let (scene, geometry, warnings) = load_from(folder.path(), "", "a.obj", "");
        assert_eq!(geometry.materials[0].emission.map(|e| e.radiance.to_array()), expected, "{library}");
        let is_told = ["-1", "bright", "missing"].iter().any(|odd| library.contains(odd));
        assert_eq!(warnings.len(), usize::from(is_told || expected.is_some()), "{library}: {warnings:?}");
        assert_eq!(scene.groups.len(), usize::from(expected.is_some()));
    }
}

#[test]
fn lamps_that_break_their_rules_are_left_out_or_refused() {
    for (light_json, told) in [
        (json!({ "type": "point", "intensity": 0 }), "gives no light"),
        (json!({ "type": "point", "intensity": -3 }), "expected a colour and an intensity"),
        (json!({ "type": "point", "color": [-1, 0, 0] }), "expected a colour and an intensity"),
        (
            json!({ "type": "spot", "spot": { "innerConeAngle": 0.5, "outerConeAngle": 0.2 } }),
            "expected 0 ≤ innerConeAngle",
        ),
        (json!({ "type": "spot", "spot": { "outerConeAngle": 2.0 } }), "expected 0 ≤ innerConeAngle"),
    ] {
        let nodes = json!([{ "name": "a", "extensions": light(0) }]);
        let (scene, _, warnings) = load(&asset(nodes, json!([light_json]), json!([{}])), "", "");
        assert!(scene.groups.is_empty() && warnings.len() == 1 && warnings[0].contains(told), "{warnings:?}");
    }
    // A light that is not there, a kind that is not, a spot without a cone: the format is broken.
    for (lights, index) in [
        (json!([{ "type": "point" }]), 1),
        (json!([{ "type": "area" }]), 0),
        (json!([{ "type": "spot" }]), 0),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        let nodes = json!([{ "name": "a", "extensions": light(index) }]);
        fs::write(&path, asset(nodes, lights, json!([{}])).to_string()).unwrap();
        let error = geometry::contents(&path).unwrap_err().to_string();
        assert!(error.contains("not glTF 2.0: KHR_lights_punctual, "), "{error}");
        assert!(!error.contains("khrLightsPunctual"), "{error}");
    }
}

#[test]
fn a_lamp_that_is_none_is_told_with_its_key_and_value() {
    for (lights, nodes, told) in [
        (json!([{ "type": "area", "name": "big" }]), json!([]), "lamp 0 (\"big\"): `type` = \"area\""),
        (json!([{ "type": "point" }, {}]), json!([]), "lamp 1: `type` is missing"),
        (json!([{ "type": "point", "intensity": "9" }]), json!([]), "lamp 0: `intensity` = \"9\""),
        (json!([{ "type": "point", "color": [1, 1] }]), json!([]), "lamp 0: `color` = [1,1]: expected three"),
        (json!([{ "type": "spot", "spot": 3 }]), json!([]), "lamp 0: `spot` = 3: expected an object"),
        (json!({}), json!([]), "the file: `lights` = {}: expected a list"),
        (
            json!([{ "type": "point" }]),
            json!([{ "extensions": light(7) }]),
            "node 1: `light` = 7: expected an index below 1",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        fs::write(&path, asset(nodes, lights, json!([{}])).to_string()).unwrap();
        let error = geometry::contents(&path).unwrap_err().to_string();
        assert!(
            error.contains("a.gltf: not glTF 2.0: KHR_lights_punctual, ") && error.contains(told),
            "{error}"
        );
    }
}

#[test]
fn a_group_that_lists_what_another_has_is_told_which() {
    let groups = "[[group]]\nname = \"all\"\nlights = [\"*\"]\n[[group]]\nname = \"one\"\nlights = [\"le*\"]";
    let (scene, _, warnings) = load(&lanterns(), groups, "");
    assert_eq!(names(&scene), [("all", 3), ("one", 0)]);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(
        warning.contains("group \"one\" has no lamp") && warning.contains("lights = [\"le*\"]"),
        "{warning}"
    );
    assert!(warning.contains("belongs to group \"all\""), "{warning}");
    // The narrow one first: both have something.
    let groups = "[[group]]\nname = \"one\"\nlights = [\"le*\"]\n[[group]]\nname = \"all\"\nlights = [\"*\"]";
    let (scene, _, warnings) = load(&lanterns(), groups, "");
    assert_eq!((names(&scene), warnings.len()), (vec![("one", 1), ("all", 2)], 0));
}

#[test]
fn a_part_with_the_name_of_a_lamp_is_pointed_to_groups() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.gltf"), lanterns().to_string()).unwrap();
    let error = |part: &str| {
        let path = folder.path().join("scene.toml");
        let text =
            format!("[[object]]\nfile = \"a.gltf\"\n[[object.part]]\nname = \"{part}\"\nalbedo = 0.5\n");
        fs::write(&path, text).unwrap();
        geometry::load(&scene::load(&path).unwrap().0).unwrap_err().to_string()
    };
    let told = error("le*t");
    assert!(
        told.contains("\"left\" is a lamp: to switch it, write a [[group]] with `lights = [\"le*t\"]`"),
        "{told}"
    );
    assert!(!error("nothing").contains("lamp"));
}
