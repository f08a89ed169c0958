//! What moves: it is no part of the bake, by the scene file or by the extras of nodes, and `scene.glb` has it
//! with what moves it.

// (Not all helpers are used by every target.)
#[allow(dead_code)]
mod common;

use baker::bake::finish::to_glb;
use baker::bake::run::{Options, prepare};
use baker::light::times::schedule::parse_hours;
use baker::{geometry, scene};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use common::{Stage, mean};
use dataset::observe::Silent;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::Path;
use std::process::Command;

/// A square of 1 m that looks up.
const SQUARE: [f32; 12] = [-0.5, 0.0, 0.5, 0.5, 0.0, 0.5, 0.5, 0.0, -0.5, -0.5, 0.0, -0.5];
/// How far the smile moves its corners.
const SMILE: [f32; 12] = [0.0, 0.1, 0.0, 0.0, 0.2, 0.0, 0.0, 0.3, 0.0, 0.0, 0.4, 0.0];
/// Where the second joint goes.
const STEPS: [f32; 6] = [0.0, 1.0, 0.0, 0.5, 1.0, 0.25];

/// A glTF of these nodes, all of them of its scene that are no children. Mesh 0 is the square, mesh 1 the
/// same with a skin and a morph target.
fn asset(nodes: Value) -> Value {
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |data: &[u8], component: u32, count: usize, kind: &str, range: Option<[&[f32]; 2]>| {
        views.push(json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len() }));
        bytes.extend_from_slice(data);
        let mut accessor = json!({ "bufferView": views.len() - 1, "componentType": component, "count": count, "type": kind });
        if let Some([min, max]) = range {
            (accessor["min"], accessor["max"]) = (json!(min), json!(max));
        }
        accessors.push(accessor);
    };
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    add(&floats(&SQUARE), 5126, 4, "VEC3", Some([&[-0.5, 0.0, -0.5], &[0.5, 0.0, 0.5]]));
    add(&[0, 0, 1, 0, 2, 0, 0, 0, 2, 0, 3, 0], 5123, 6, "SCALAR", None);
    add(&floats(&[0.0, 1.0, 0.0].repeat(4)), 5126, 4, "VEC3", None);
    add(&[0, 1, 0, 0].repeat(4), 5121, 4, "VEC4", None);
    add(&floats(&[0.75, 0.25, 0.0, 0.0].repeat(4)), 5126, 4, "VEC4", None);
    add(&floats(&SMILE), 5126, 4, "VEC3", Some([&[0.0, 0.1, 0.0], &[0.0, 0.4, 0.0]]));
    let identity: Vec<f32> = (0..16).map(|i| if i % 5 == 0 { 1.0 } else { 0.0 }).collect();
    add(&floats(&identity.repeat(2)), 5126, 2, "MAT4", None);
    add(&floats(&[0.0, 2.0]), 5126, 2, "SCALAR", Some([&[0.0], &[2.0]]));
    add(&floats(&STEPS), 5126, 2, "VEC3", None);
    add(&floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0]), 5126, 2, "VEC4", None);
    add(&floats(&[0.0, 1.0]), 5126, 2, "SCALAR", None);
    let children: Vec<u64> =
        nodes.as_array().unwrap().iter().flat_map(|node| numbers(&node["children"])).collect();
    let roots: Vec<u64> =
        (0..nodes.as_array().unwrap().len() as u64).filter(|n| !children.contains(n)).collect();
    let data = STANDARD.encode(&bytes);
    json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": roots }], "nodes": nodes,
        "meshes": [
            { "name": "square", "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] },
            { "name": "skin", "weights": [0.25], "extras": { "targetNames": ["smile"] }, "primitives": [{
                "attributes": { "POSITION": 0, "NORMAL": 2, "JOINTS_0": 3, "WEIGHTS_0": 4 }, "indices": 1,
                "material": 0, "targets": [{ "POSITION": 5 }],
            }] },
        ],
        "materials": [{ "name": "paint" }],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}") }],
    })
}

fn numbers(list: &Value) -> Vec<u64> {
    list.as_array().into_iter().flatten().filter_map(Value::as_u64).collect()
}

/// A floor, and a roof whose name stands on the node above it.
fn shed(lift: Value) -> Value {
    let mut nodes = json!([
        { "name": "floor", "mesh": 0 },
        { "name": "lift", "children": [2] },
        { "mesh": 0, "translation": [0, 0.3, 0], "scale": [8, 1, 8] },
    ]);
    if !lift.is_null() {
        nodes[1]["extras"] = json!({ "movable": lift });
    }
    let mut asset = asset(nodes);
    // Black, and no lid of a solid.
    asset["materials"][0]["pbrMetallicRoughness"] = json!({ "baseColorFactor": [0, 0, 0, 1] });
    asset["materials"][0]["doubleSided"] = json!(true);
    asset
}

fn stage(asset: &Value) -> Stage {
    Stage::new(&[("a.gltf", asset.to_string())])
}

const SKY: &str = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[lightmap]\nsize = 24\n";
const OBJECT: &str = "[[object]]\nfile = \"a.gltf\"\n";

/// Groups with their numbers of lamps, the geometry, and the warnings.
type Loaded = (Vec<(String, usize)>, geometry::Geometry, Vec<String>);

/// Loads a scene of `a.gltf`.
fn load(stage: &Stage, text: &str) -> dataset::Result<Loaded> {
    stage.write("scene.toml", text.as_bytes());
    let (mut scene, mut warnings) = scene::load(&stage.path("scene.toml"))?;
    let geometry = geometry::load_with(&scene, &mut warnings)?;
    geometry.lights.add_to(&mut scene);
    let groups = scene.groups.iter().map(|group| (group.name.clone(), group.lamps.len()));
    Ok((groups.collect(), geometry, warnings))
}

/// A moving roof leaves the floor the light π of the whole sky; one that stands takes most of it.
#[test]
fn a_roof_that_moves_shades_nothing() {
    for (lift, moves) in [(json!(null), false), (json!(true), true)] {
        let stage = stage(&shed(lift));
        let roof = "[[object.part]]\nname = \"lift\"\nlightmap = false\n";
        let baked = stage.bake("12", 8, &format!("{SKY}{OBJECT}{roof}"));
        let light = mean(&baked.first(), &baked.on("floor")) / PI;
        match moves {
            true => assert!((light - 1.0).abs() < 1e-4, "{light}"),
            false => assert!(light < 0.5, "{light}"),
        }
        let told = baked.outcome.skipped.iter().find(|line| line.contains("they move"));
        let expected = "left out because they move: 1 mesh (a.gltf: lift/square/paint), 2 triangles";
        assert_eq!(told.map(String::as_str), moves.then_some(expected));
        assert!(baked.dataset.verify(|| {}).faults.is_empty());
    }
}

/// The last part that fits says whether something moves, else its object, else its file.
#[test]
fn the_scene_file_goes_before_the_file() {
    let part = |movable: bool| format!("[[object.part]]\nname = \"lift\"\nmovable = {movable}\n");
    for (lift, keys, moves) in [
        (json!(null), String::new(), false),
        (json!(null), part(true), true),
        (json!(true), String::new(), true),
        (json!(1), String::new(), true),
        (json!(true), part(false), false),
        (json!(true), "movable = false\n".to_owned(), false),
        (json!(true), format!("movable = false\n{}", part(true)), true),
        (json!(null), format!("{}{}", part(true), part(false)), false),
    ] {
        let (_, geometry, _) = load(&stage(&shed(lift.clone())), &format!("{OBJECT}{keys}")).unwrap();
        assert_eq!(geometry.instances.len(), if moves { 1 } else { 2 }, "{lift} {keys}");
    }
}

/// A lamp below a node that moves, and a surface that shines there, give no light, and their groups say so.
#[test]
fn what_shines_and_moves_gives_no_light() {
    let mut lit = asset(json!([
        { "name": "floor", "mesh": 0 },
        { "name": "car", "children": [2, 3] },
        { "name": "headlamp", "translation": [0, 0.5, 0], "extensions": { "KHR_lights_punctual": { "light": 0 } } },
        { "mesh": 1, "translation": [0, 0.6, 0], "rotation": [1, 0, 0, 0] },
    ]));
    lit["extensions"] =
        json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 500 }] } });
    lit["meshes"][1]["primitives"][0]["material"] = json!(1);
    lit["materials"] = json!([{ "name": "paint" }, { "name": "glow", "emissiveFactor": [1, 1, 1] }]);
    let stage = stage(&lit);
    let text = |movable: bool| {
        let groups = "[[group]]\nname = \"evening\"\nlights = [\"car\"]\n[[group]]\nname = \"headlamp\"\n";
        format!(
            "{groups}[lightmap]\nsize = 24\n{OBJECT}[[object.part]]\nname = \"c*r\"\nmovable = {movable}\n"
        )
    };
    let light = |movable: bool| {
        let baked = stage.bake("12", 8, &text(movable));
        mean(&baked.first(), &baked.on("floor"))
    };
    assert!(light(false) > 0.1);
    assert_eq!(light(true), 0.0);
    // The name of the node above is further away than its own, and nearer than none.
    let (groups, geometry, warnings) = load(&stage, &text(false)).unwrap();
    assert_eq!(groups, [("evening".to_owned(), 0), ("headlamp".to_owned(), 1)]);
    let emission = geometry.materials.iter().find_map(|material| material.emission).unwrap();
    assert_eq!(emission.group, 0);
    assert!(warnings.iter().all(|warning| !warning.contains("moves")), "{warnings:?}");
    let (groups, geometry, warnings) = load(&stage, &text(true)).unwrap();
    assert_eq!(groups, [("evening".to_owned(), 0), ("headlamp".to_owned(), 0)]);
    assert!(geometry.materials.iter().all(|material| material.emission.is_none()));
    for told in [
        "\"evening\" lacks the light of lamps and materials that move (glow)",
        "\"headlamp\" lacks the light of lamps and materials that move (headlamp)",
    ] {
        assert!(warnings.iter().any(|warning| warning.contains(told)), "{told}: {warnings:?}");
    }
    // A part may name a lamp alone, if it says whether that moves.
    let lamp = |keys: &str| load(&stage, &format!("{OBJECT}[[object.part]]\nname = \"headlamp\"\n{keys}\n"));
    assert!(lamp("movable = true").unwrap().0.iter().all(|(_, lamps)| *lamps == 0));
    assert!(lamp("albedo = 0.5").map(|_| ()).unwrap_err().to_string().contains("is a lamp: to switch it"));
}

#[test]
fn parts_are_what_stands_below_a_name() {
    let stage = stage(&asset(json!([
        { "name": "yard", "children": [1, 4] },
        { "name": "swing", "children": [2, 3] },
        { "mesh": 0, "name": "seat" },
        { "mesh": 0, "name": "rope" },
        { "mesh": 0, "name": "fence" },
    ])));
    let part = |name: &str, keys: &str| format!("[[object.part]]\nname = \"{name}\"\n{keys}\n");
    let text = format!("{OBJECT}{}{}", part("swing", "density = 2"), part("rope", "density = 3"));
    let (_, geometry, _) = load(&stage, &text).unwrap();
    assert_eq!(geometry.instances.iter().map(|i| i.density).collect::<Vec<_>>(), [2.0, 3.0, 1.0]);
    let error = load(&stage, &format!("{OBJECT}{}", part("roep", ""))).map(|_| ()).unwrap_err().to_string();
    let told = "scene.toml:4: part name = \"roep\": no node, mesh or material of ";
    assert!(
        error.contains(told) && error.ends_with("similar names: node \"rope\" (of \"swing\")"),
        "{error}"
    );
    let error =
        load(&stage, &format!("{OBJECT}{}", part("chimney", ""))).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("no name is similar; it has 7 names: node \"fence\" (of \"yard\")"), "{error}");
}

#[test]
fn nothing_left_to_bake_is_an_error_with_its_remedy() {
    let stage = stage(&shed(json!(null)));
    let error = load(&stage, &format!("{OBJECT}movable = true\n")).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("every mesh moves (2 meshes: a.gltf: floor/square/paint"), "{error}");
    assert!(error.contains("`movable = false` in its [[object]]"), "{error}");
    let error = stage.refusal("12", &format!("{SKY}{OBJECT}lightmap = false\n"));
    assert!(
        error.contains("no mesh gets texels (2 instances), because of `lightmap = false`")
            && error.contains("[[object.part]]"),
        "{error}"
    );
}

#[test]
fn other_values_than_booleans_are_warned_of() {
    let (_, geometry, warnings) = load(&stage(&shed(json!("yes"))), OBJECT).unwrap();
    assert_eq!(geometry.instances.len(), 2);
    let told = "a.gltf: node lift: `movable` in its extras is not used: expected true or false";
    assert!(warnings.iter().any(|warning| warning.ends_with(told)), "{warnings:?}");
}

/// A walking figure of two joints with a face that smiles, a fan that turns, and a floor.
fn figure() -> Value {
    let mut asset = asset(json!([
        { "name": "floor", "mesh": 0, "extras": { "movable": false, "kept": 1 } },
        { "name": "figure", "children": [2, 3] },
        { "name": "body", "mesh": 1, "skin": 0 },
        { "name": "hip", "translation": [0, 1, 0], "children": [4] },
        { "name": "knee", "translation": [0, 1, 0] },
        { "name": "fan", "mesh": 0, "translation": [3, 0, 0] },
    ]));
    let channel = |node: usize, path: &str, sampler: usize| json!({ "sampler": sampler, "target": { "node": node, "path": path } });
    let sampler = |output: usize| json!({ "input": 7, "output": output, "interpolation": "LINEAR" });
    asset["skins"] = json!([{ "name": "bones", "inverseBindMatrices": 6, "joints": [3, 4], "skeleton": 3 }]);
    asset["animations"] = json!([
        { "name": "spin", "channels": [channel(5, "rotation", 0)], "samplers": [sampler(9)] },
        {
            "name": "walk", "samplers": [sampler(8), sampler(9), sampler(10)],
            "channels": [channel(5, "translation", 0), channel(3, "rotation", 1), channel(4, "translation", 0), channel(2, "weights", 2)],
        },
    ]);
    asset
}

/// Writes what a bake of a scene file would write as its geometry; gives its JSON and its binary part.
fn geometry_file(stage: &Stage, text: &str) -> (Value, Vec<u8>) {
    stage.write("figure.toml", text.as_bytes());
    let options = Options::new(parse_hours("12").unwrap());
    let prepared = prepare(&stage.path("figure.toml"), &options, &Silent).unwrap();
    let (atlas, _) = prepared.atlas().unwrap();
    let glb = to_glb(&prepared.geometry, &atlas).unwrap().glb;
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    stage.write("figure.glb", &glb);
    (serde_json::from_slice(&glb[20..20 + length]).unwrap(), glb[28 + length..].to_vec())
}

#[test]
fn what_moves_keeps_skin_animation_and_morph_targets() {
    let stage = stage(&figure());
    let placed = format!("{SKY}{OBJECT}instances = [{{}}, {{ translate = [0, 0, 9] }}]\n");
    let moving = format!("{placed}[[object.part]]\nname = \"figure\"\nmovable = true\n");
    let (root, binary) = geometry_file(&stage, &moving);
    let list = |key: &str| root[key].as_array().cloned().unwrap_or_default();
    let nodes = list("nodes");
    let name = |node: &Value| nodes[node.as_u64().unwrap() as usize]["name"].as_str().unwrap().to_owned();
    let at = |accessor: &Value| {
        let accessor = &root["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let [from, length] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
        binary[from..from + length].to_vec()
    };
    let floats = |accessor: &Value| bytemuck::pod_collect_to_vec::<u8, f32>(&at(accessor));
    // A skin for each of the two places, with their own joints.
    let skins = list("skins");
    assert_eq!(skins.len(), 2);
    assert!(skins[0]["joints"] != skins[1]["joints"] && skins[0]["name"] == "bones");
    for skin in &skins {
        let joints: Vec<String> = skin["joints"].as_array().unwrap().iter().map(name).collect();
        assert_eq!(
            (joints, name(&skin["skeleton"])),
            (vec!["hip".to_owned(), "knee".to_owned()], "hip".to_owned())
        );
        assert_eq!(floats(&skin["inverseBindMatrices"]).len(), 32);
    }
    // Of the mixed animation, the channels of what moves, in both places; of the other, none.
    let [walk] = &list("animations")[..] else { panic!("{}", root["animations"]) };
    assert_eq!((&walk["name"], walk["samplers"].as_array().unwrap().len()), (&json!("walk"), 3));
    let channels: Vec<(String, &str)> = (walk["channels"].as_array().unwrap().iter())
        .map(|channel| (name(&channel["target"]["node"]), channel["target"]["path"].as_str().unwrap()))
        .collect();
    let of_one = [("hip", "rotation"), ("knee", "translation"), ("body", "weights")];
    let expected: Vec<(String, &str)> =
        of_one.repeat(2).into_iter().map(|(node, path)| (node.to_owned(), path)).collect();
    assert_eq!(channels, expected);
    let steps = walk["channels"][1]["sampler"].as_u64().unwrap() as usize;
    assert_eq!(floats(&walk["samplers"][steps]["output"]), STEPS);
    assert_eq!(floats(&walk["samplers"][steps]["input"]), [0.0, 2.0]);
    // The mesh is that of the file, not deformed, with its weights.
    let bodies: Vec<&Value> = nodes.iter().filter(|node| node["name"] == "body").collect();
    assert!(bodies.len() == 2 && bodies[0]["mesh"] == bodies[1]["mesh"]);
    assert_eq!([&bodies[0]["skin"], &bodies[1]["skin"]], [&json!(0), &json!(1)]);
    let mesh = &root["meshes"][bodies[0]["mesh"].as_u64().unwrap() as usize];
    assert_eq!((&mesh["weights"], &mesh["extras"]["targetNames"]), (&json!([0.25]), &json!(["smile"])));
    let primitive = &mesh["primitives"][0];
    assert_eq!(floats(&primitive["attributes"]["POSITION"]), SQUARE);
    assert_eq!(floats(&primitive["targets"][0]["POSITION"]), SMILE);
    assert_eq!(at(&primitive["attributes"]["JOINTS_0"]), [0, 1, 0, 0].repeat(4));
    assert_eq!(floats(&primitive["attributes"]["WEIGHTS_0"]), [0.75, 0.25, 0.0, 0.0].repeat(4));
    // What moves says so, what is baked has texels.
    for node in &nodes {
        let extras = &node["extras"];
        assert_eq!(extras["movable"] == true, node["name"] == "figure", "{node}");
        assert_eq!(extras["lightmapPage"] == 0, node["name"] == "floor" || node["name"] == "fan", "{node}");
        assert_eq!(extras["kept"] == 1, node["name"] == "floor", "{node}");
    }
    validate(&stage.path("figure.glb"));
    // Baked again, the same is left out.
    let (_, geometry, _) = load(&stage, "[[object]]\nfile = \"figure.glb\"\n").unwrap();
    assert_eq!(geometry.instances.len(), 4);
    // Where nothing moves there is nothing of all this, and both animations give a warning.
    let (root, _) = geometry_file(&stage, &placed);
    let all = root.to_string();
    assert!(
        ["skin\":", "animations", "targets", "JOINTS_0", "movable"].iter().all(|key| !all.contains(key)),
        "{all}"
    );
    let animations = |text: &str| {
        let (_, _, warnings) = load(&stage, text).unwrap();
        warnings.into_iter().filter(|warning| warning.contains("not played")).collect::<Vec<_>>()
    };
    assert!(animations(&placed)[0].contains("a.gltf: 2 animations not played"), "{:?}", animations(&placed));
    assert!(animations(&moving)[0].contains("a.gltf: 1 animation not played"), "{:?}", animations(&moving));
}

/// Where only the mesh is said to move, its joints do too, and a mesh that they carry gives a warning.
#[test]
fn joints_move_with_their_mesh() {
    let mut asset = figure();
    asset["nodes"][4]["mesh"] = json!(0);
    asset["nodes"][4]["name"] = json!("lantern");
    let stage = stage(&asset);
    let text = format!("{SKY}{OBJECT}[[object.part]]\nname = \"body\"\nmovable = true\n");
    let (root, _) = geometry_file(&stage, &text);
    assert_eq!(root["animations"][0]["channels"].as_array().map(Vec::len), Some(3));
    let lantern = root["nodes"].as_array().unwrap().iter().find(|node| node["name"] == "lantern").unwrap();
    assert!(
        lantern["extras"]["lightmapPage"] == 0 && lantern["extras"].get("movable").is_none(),
        "{lantern}"
    );
    let (_, _, warnings) = load(&stage, &text).unwrap();
    let told = "a.gltf: mesh lantern/square/paint: is baked, but a joint of a movable mesh carries it";
    assert!(warnings.iter().any(|warning| warning.contains(told)), "{warnings:?}");
}

/// Runs Khronos' validator, where it is.
fn validate(file: &Path) {
    let Ok(folder) = std::env::var("NDGI_GLTF_VALIDATOR") else {
        eprintln!("skipped: NDGI_GLTF_VALIDATOR names no folder with the npm package gltf-validator");
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/gltf/validate.mjs");
    let output = Command::new("node").arg(script).arg(folder).arg(file).output().unwrap();
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{told}{}", String::from_utf8_lossy(&output.stderr));
}
