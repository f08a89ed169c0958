//! The geometry file: where nodes stand in space and on the page, and what goes over from the files.

use super::*;
use crate::scene::Lightmap;
use crate::{atlas, geometry, scene};
use base64::Engine;
use glam::{DMat3, DMat4, Vec3};

#[path = "scene_glb_look_tests.rs"]
mod looks;

/// A unit cube, and a plate that shares no vertex with it, in an OBJ of two materials.
const THINGS: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    v 2 0 0\nv 4 0 0\nv 4 0 -1\no cube\nusemtl a\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\n\
    f 2 3 7 6\no plate\nusemtl b\nf 9 10 11\n";

fn load(text: &str) -> Geometry {
    load_with(text, &json!({}))
}

/// A scene of THINGS and of an asset, `a.gltf`.
fn load_with(text: &str, asset: &Value) -> Geometry {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.gltf"), asset.to_string()).unwrap();
    std::fs::write(folder.path().join("things.obj"), THINGS).unwrap();
    std::fs::write(folder.path().join("scene.toml"), text).unwrap();
    let (scene, _) = scene::load(&folder.path().join("scene.toml")).unwrap();
    geometry::load(&scene).unwrap().0
}

fn built(geometry: &Geometry, width: u32, height: u32, pages: u32) -> Atlas {
    let size = scene::LightmapSize::Fixed { width, height };
    atlas::build(geometry, &Lightmap { size, pages, padding: 2, ..Lightmap::default() }).unwrap()
}

/// A node with a mesh, as a reader of the file finds it.
struct Shown {
    name: String,
    parent: String,
    world_from_node: DMat4,
    /// What its extras tell of its place: page, scale and offset.
    place: Option<(u64, [Vec2; 2])>,
    primitives: Vec<Primitive>,
}

struct Primitive {
    positions: Vec<Vec3>,
    normals: Option<Vec<Vec3>>,
    uvs: Option<Vec<Vec2>>,
    indices: Vec<usize>,
}

/// All nodes with meshes, depth first.
fn shown(glb: &gltf::Gltf) -> Vec<Shown> {
    let mut stack: Vec<(gltf::Node, DMat4, String)> =
        glb.default_scene().unwrap().nodes().map(|n| (n, DMat4::IDENTITY, String::new())).collect();
    stack.reverse();
    let mut all = Vec::new();
    while let Some((node, world_from_parent, parent)) = stack.pop() {
        let matrix = DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
        let world_from_node = world_from_parent * matrix;
        let name = node.name().unwrap_or("").to_owned();
        let children: Vec<_> = node.children().collect();
        stack.extend(children.into_iter().rev().map(|c| (c, world_from_node, name.clone())));
        let Some(mesh) = node.mesh() else { continue };
        let extras = node.extras().as_ref().map(|e| serde_json::from_str::<Value>(e.get()).unwrap());
        let place = extras.filter(|e| e.get("lightmapPage").is_some()).map(|e| {
            let pair = |key: &str| Vec2::from([0, 1].map(|i| e[key][i].as_f64().unwrap() as f32));
            (e["lightmapPage"].as_u64().unwrap(), [pair("lightmapScale"), pair("lightmapOffset")])
        });
        let primitives = mesh.primitives().map(|primitive| {
            let reader = primitive.reader(|_| glb.blob.as_deref());
            Primitive {
                positions: reader.read_positions().unwrap().map(Vec3::from).collect(),
                normals: reader.read_normals().map(|normals| normals.map(Vec3::from).collect()),
                uvs: reader.read_tex_coords(1).map(|uvs| uvs.into_f32().map(Vec2::from).collect()),
                indices: reader.read_indices().unwrap().into_u32().map(|i| i as usize).collect(),
            }
        });
        all.push(Shown { primitives: primitives.collect(), name, parent, world_from_node, place });
    }
    all
}

fn read(geometry: &Geometry, atlas: &Atlas) -> (gltf::Gltf, Value, Vec<Instance>) {
    let written = to_glb(geometry, atlas).unwrap();
    let length = u32::from_le_bytes(written.glb[12..16].try_into().unwrap()) as usize;
    let root = serde_json::from_slice(&written.glb[20..20 + length]).unwrap();
    (gltf::Gltf::from_slice_without_validation(&written.glb).unwrap(), root, written.instances)
}

/// Every triangle of an instance, in space and on the page, is where the geometry and the atlas say.
fn expect_same(geometry: &Geometry, atlas: &Atlas, i: usize, shown: &Shown, primitive: &Primitive) {
    let instance = &geometry.instances[i];
    assert_eq!(primitive.indices.len(), 3 * instance.triangles.len());
    assert_eq!(shown.place.is_some(), primitive.uvs.is_some());
    assert_eq!(shown.place.is_some(), !atlas.placements[i].is_empty());
    // A negative determinant turns the winding round (glTF 2.0, 3.7.4).
    let order = if shown.world_from_node.determinant() < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
    let normal_matrix = DMat3::from_mat4(shown.world_from_node).inverse().transpose();
    let page = Vec2::new(atlas.width as f32, atlas.page_height as f32);
    for (triangle, corners) in instance.triangles.clone().zip(primitive.indices.chunks_exact(3)) {
        let face = atlas.faces.iter().find(|f| f.triangle as usize == triangle);
        for k in 0..3 {
            let (vertex, wanted) = (corners[order[k]], geometry.triangles[triangle][k] as usize);
            let position = shown.world_from_node.transform_point3(primitive.positions[vertex].as_dvec3());
            let wanted_position = geometry.positions[wanted].as_dvec3() + geometry.origin;
            assert!(
                position.distance(wanted_position) < 2e-5,
                "{}: {position} {wanted_position}",
                instance.name
            );
            if let Some(normals) = &primitive.normals {
                let normal = (normal_matrix * normals[vertex].as_dvec3()).normalize();
                assert!(normal.distance(geometry.normals[wanted].as_dvec3()) < 1e-5, "{}", instance.name);
            }
            if let (Some((number, [scale, offset])), Some(uvs), Some(face)) =
                (shown.place, &primitive.uvs, face)
            {
                let top = Vec2::new(0.0, atlas.page_rows(number as u32).start as f32);
                let texel = (scale * uvs[vertex] + offset) * page + top;
                assert!(
                    texel.distance(face.corners[k]) < 1e-3,
                    "{}: {texel} {:?}",
                    instance.name,
                    face.corners[k]
                );
            }
        }
    }
}

#[test]
fn nodes_lie_where_the_instances_do_in_space_and_on_the_page() {
    let geometry = load(
        "[[object]]\nfile = \"things.obj\"\nrotate = [10, 20, 30]\ntranslate = [1e5, 0, 0]\ninstances = [\n\
         { scale = [1, 2, 3] }, { scale = [1, 2, 3], rotate = [0, 40, 0], translate = [9, 0, 0] },\n\
         { scale = [-2, 4, 6], translate = [0, 0, 20] }, { scale = [0.5, 1, -1.5], rotate = [5, 6, 7], translate = [0, 9, 0] },\n\
         { scale = [3, 2, 1], translate = [-9, 0, 0] } ]\n\
         [[object.part]]\nname = \"plate\"\nlightmap = false\n",
    );
    let atlas = built(&geometry, 256, 200, 1);
    let (glb, _, places) = read(&geometry, &atlas);
    // The cubes: one shape four times, one stretched otherwise; all plates.
    assert_eq!((geometry.instances.len(), atlas.layouts.len(), glb.meshes().count()), (10, 1, 3));
    let shown = shown(&glb);
    assert_eq!(shown.len(), 10);
    let mut mirrored = 0;
    for (i, node) in shown.iter().enumerate() {
        assert_eq!((&node.name[..], &node.parent[..]), (["cube", "plate"][i % 2], "things"));
        mirrored += usize::from(node.world_from_node.determinant() < 0.0);
        expect_same(&geometry, &atlas, i, node, &node.primitives[0]);
    }
    // Two instances of both meshes.
    assert_eq!(mirrored, 4);
    assert!(places.iter().map(|place| &place.name[..]).eq(["cube"; 5]));
}

#[test]
fn a_mesh_on_two_pages_is_two_nodes() {
    let geometry = load(
        "[[object]]\nfile = \"things.obj\"\n[[object.part]]\nname = \"plate\"\ndensity = 0.5\n\
         [[object]]\nfile = \"things.obj\"\ntranslate = [9, 0, 0]\nlightmap = false\n",
    );
    let atlas = built(&geometry, 60, 50, 2);
    assert_eq!((atlas.pages, atlas.page_height, atlas.stride, atlas.height), (2, 50, 128, 178));
    let pages: Vec<Vec<u32>> = atlas.placements.iter().map(|p| p.iter().map(|p| p.page).collect()).collect();
    assert_eq!(pages[0], [0, 1]);
    let (glb, _, places) = read(&geometry, &atlas);
    assert_eq!(places.len(), atlas.placements.iter().map(Vec::len).sum::<usize>());
    let all = shown(&glb);
    let mut nodes = all.iter();
    let mut seen = Vec::new();
    for (i, (instance, placements)) in geometry.instances.iter().zip(&atlas.placements).enumerate() {
        if placements.is_empty() {
            let node = nodes.next().unwrap();
            expect_same(&geometry, &atlas, i, node, &node.primitives[0]);
        }
        for placement in placements {
            let node = nodes.next().unwrap();
            assert_eq!(node.place.unwrap().0, u64::from(placement.page));
            // Parts of one mesh are children of the node that has its name.
            assert_eq!(node.parent == node.name, placements.len() > 1);
            let Primitive { positions, uvs, indices, .. } = &node.primitives[0];
            let uvs = uvs.as_ref().unwrap();
            // Every triangle is one of the instance's on this page, and lies there where the atlas says.
            for corners in indices.chunks_exact(3) {
                let is_it = |face: &&Face| {
                    let wanted = geometry.triangles[face.triangle as usize];
                    (0..3).all(|k| {
                        let world = node.world_from_node.transform_point3(positions[corners[k]].as_dvec3());
                        (world - geometry.origin).distance(geometry.positions[wanted[k] as usize].as_dvec3())
                            < 1e-5
                    })
                };
                let face = atlas.faces.iter().find(is_it).unwrap();
                assert!(instance.triangles.contains(&(face.triangle as usize)));
                assert_eq!(atlas.page_of(face), placement.page);
                let top = Vec2::new(0.0, atlas.page_rows(placement.page).start as f32);
                for k in 0..3 {
                    let texel = uvs[corners[k]] * Vec2::new(60.0, 50.0) + top;
                    assert!(texel.distance(face.corners[k]) < 1e-3, "{texel} {:?}", face.corners[k]);
                }
                seen.push(face.triangle);
            }
        }
    }
    seen.sort_unstable();
    assert!(seen.iter().copied().eq(atlas.faces.iter().map(|face| face.triangle)), "{seen:?}");
}

#[test]
fn sheared_and_far_files_stand_where_they_do_in_the_scene() {
    let geometry = load(
        "[[object]]\nfile = \"things.obj\"\nscale = [1, 2, 3]\ntranslate = [1e6, 0.25, -2e6]\ninstances = [\n\
         { rotate = [10, 20, 30] }, { rotate = [0, 50, 0], scale = [-1, 1, 2], translate = [40, 0, 0] } ]\n",
    );
    let atlas = built(&geometry, 256, 256, 1);
    let (glb, root, _) = read(&geometry, &atlas);
    assert_eq!(root["nodes"][root["scenes"][0]["nodes"][0].as_u64().unwrap() as usize]["name"], "scene");
    for (i, node) in shown(&glb).iter().enumerate() {
        expect_same(&geometry, &atlas, i, node, &node.primitives[0]);
    }
}

/// A hierarchy: `lamp post` with a light and a camera holds `left` and `right`, which show one mesh of two
/// primitives.
fn asset() -> Value {
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_pixel(2, 2, image::Rgba([200, 100, 50, 255]))
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    let png = png.into_inner();
    let mut bytes = floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]);
    bytes.extend(floats(&[0., 0., 2., 0., 0., 1., 0., 0., 1., 0., 0., 0.]));
    bytes.extend(floats(&[0., 1., 1., 1., 1., 0., 0., 0.]));
    bytes.extend([255u8, 0, 0, 255].repeat(4));
    bytes.extend([0u8, 1, 2, 0, 2, 3, 0, 0]);
    let at = bytes.len();
    bytes.extend(&png);
    let uri = format!(
        "data:application/octet-stream;base64,{}",
        base64::engine::general_purpose::STANDARD.encode(&bytes)
    );
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "TEXCOORD_1": 2, "COLOR_0": 3 });
    let primitive = |material: usize| json!({ "attributes": attributes, "indices": 4, "material": material, "extras": { "p": material } });
    json!({
        "asset": { "version": "2.0", "copyright": "nobody", "extras": { "author": "someone" } },
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_clearcoat"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": {} }, { "type": "point", "name": "bulb", "intensity": 5 }] } },
        "scene": 1,
        "scenes": [{ "nodes": [4] }, { "nodes": [3, 0], "extras": { "scene": true } }],
        "nodes": [
            { "name": "lamp post", "translation": [1, 2, 3], "rotation": [0, 0.5f64.sqrt(), 0, 0.5f64.sqrt()], "children": [1, 2],
              "extras": { "keep": [1, "two"] }, "camera": 1, "extensions": { "KHR_lights_punctual": { "light": 1 } } },
            { "name": "left", "mesh": 0, "translation": [-5, 0, 0], "extras": { "lightmapScale": [1, 1], "lightmapOffset": [0, 0], "side": "l" } },
            { "name": "right", "mesh": 0, "matrix": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 5, 0, 0, 1] },
            { "name": "alone", "mesh": 1, "skin": 0 },
            { "name": "of another scene", "mesh": 1 },
        ],
        "skins": [{ "joints": [0] }],
        "animations": [{ "channels": [], "samplers": [] }],
        "cameras": [
            { "type": "perspective", "perspective": { "yfov": 1, "znear": 0.1 } },
            { "type": "perspective", "name": "view", "perspective": { "yfov": 0.7, "znear": 0.1 } },
        ],
        "meshes": [
            { "name": "pair", "extras": { "m": 1 }, "primitives": [primitive(1), primitive(2)] },
            { "name": "single", "primitives": [primitive(2)] },
        ],
        "materials": [
            { "name": "unused" },
            { "name": "plain", "extras": { "a": 1 }, "emissiveFactor": [0.1, 0.2, 0.3] },
            { "name": "glossy", "pbrMetallicRoughness": { "baseColorTexture": { "index": 1 }, "roughnessFactor": 0.25 },
              "occlusionTexture": { "index": 1, "texCoord": 1, "strength": 0.5 }, "normalTexture": { "index": 0 },
              "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 0.5, "clearcoatTexture": { "index": 1 } } } },
        ],
        "textures": [{ "source": 0 }, { "source": 1, "sampler": 0, "name": "wood" }],
        "samplers": [{ "wrapS": 33071 }],
        "images": [{ "uri": "lost.png" }, { "bufferView": 5, "mimeType": "image/png", "name": "wood" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 3, "componentType": 5121, "count": 4, "type": "VEC4", "normalized": true },
            { "bufferView": 4, "componentType": 5121, "count": 6, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 32 }, { "buffer": 0, "byteOffset": 128, "byteLength": 16 },
            { "buffer": 0, "byteOffset": 144, "byteLength": 6 }, { "buffer": 0, "byteOffset": at, "byteLength": png.len() },
        ],
        "buffers": [{ "byteLength": bytes.len(), "uri": uri }],
    })
}

fn named<'a>(root: &'a Value, list: &str, name: &str) -> &'a Value {
    let found = root[list].as_array().unwrap().iter().find(|one| one["name"] == name);
    found.unwrap_or_else(|| panic!("{list} {name}: {}", root[list]))
}

#[test]
fn hierarchy_materials_cameras_lights_and_extras_go_over() {
    let geometry = load_with("[[object]]\nfile = \"a.gltf\"\n", &asset());
    let atlas = built(&geometry, 128, 128, 1);
    let (glb, root, places) = read(&geometry, &atlas);
    // Two parts of `left` and `right`, which share layouts, and `alone`.
    assert_eq!((geometry.instances.len(), places.len()), (5, 5));
    let shown = shown(&glb);
    for (i, node) in shown.iter().enumerate() {
        assert_eq!(
            (&node.name[..], &node.parent[..]),
            [("alone", "a"), ("left", "left"), ("left", "left"), ("right", "right"), ("right", "right")][i]
        );
        expect_same(&geometry, &atlas, i, node, &node.primitives[0]);
        // Those of length 2, 1 and 0 alike.
        assert!(node.primitives[0].normals.as_ref().unwrap().iter().all(|n| *n == Vec3::Z));
    }
    assert_eq!(root["meshes"].as_array().unwrap().len(), 3);
    let post = named(&root, "nodes", "lamp post");
    assert_eq!(post["extras"], json!({ "keep": [1, "two"] }));
    assert_eq!(post["translation"], json!([1, 2, 3]));
    assert_eq!(
        root["cameras"],
        json!([{ "type": "perspective", "name": "view", "perspective": { "yfov": 0.7, "znear": 0.1 } }])
    );
    assert_eq!(post["camera"], 0);
    assert_eq!(post["extensions"]["KHR_lights_punctual"]["light"], 0);
    assert_eq!(
        root["extensions"]["KHR_lights_punctual"]["lights"],
        json!([{ "type": "point", "name": "bulb", "intensity": 5 }])
    );
    let left = root["nodes"].as_array().unwrap().iter().find(|n| n["name"] == "left").unwrap();
    assert_eq!(left["extras"], json!({ "side": "l" }));
    assert_eq!(named(&root, "nodes", "a")["extras"], json!({ "scene": true }));
    assert_eq!(
        (&root["asset"]["copyright"], &root["asset"]["extras"]),
        (&json!("nobody"), &json!({ "author": "someone" }))
    );
    assert!(root.get("skins").is_none() && root.get("animations").is_none());
    assert!(
        !root["nodes"]
            .as_array()
            .unwrap()
            .iter()
            .any(|n| n["name"] == "of another scene" || n.get("skin").is_some())
    );
    let mesh = named(&root, "meshes", "pair");
    assert_eq!((&mesh["extras"], &mesh["primitives"][0]["extras"]), (&json!({ "m": 1 }), &json!({ "p": 1 })));
    assert_eq!(
        root["accessors"][mesh["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize]["normalized"],
        true
    );
    // The file's second set of coordinates now is the third, where a material reads it.
    let glossy = named(&root, "materials", "glossy");
    assert_eq!(
        (&glossy["occlusionTexture"]["texCoord"], &glossy["occlusionTexture"]["strength"]),
        (&json!(2), &json!(0.5))
    );
    assert_eq!(
        glossy["pbrMetallicRoughness"],
        json!({ "baseColorTexture": { "index": 0 }, "roughnessFactor": 0.25 })
    );
    assert_eq!(glossy["extensions"]["KHR_materials_clearcoat"]["clearcoatTexture"]["index"], 0);
    assert!(glossy.get("normalTexture").is_none());
    assert_eq!(
        named(&root, "materials", "plain"),
        &json!({ "name": "plain", "extras": { "a": 1 }, "emissiveFactor": [0.1, 0.2, 0.3] })
    );
    assert_eq!(root["materials"].as_array().unwrap().len(), 2);
    assert_eq!(
        (root["textures"][0]["name"].as_str(), root["images"].as_array().unwrap().len()),
        (Some("wood"), 1)
    );
    assert_eq!(root["samplers"], json!([{ "wrapS": 33071 }]));
    assert_eq!(root["extensionsUsed"], json!(["KHR_lights_punctual", "KHR_materials_clearcoat"]));
    let single = &named(&root, "meshes", "single")["primitives"][0]["attributes"];
    assert!(single.get("TEXCOORD_2").is_some());
    assert!(single["TEXCOORD_1"] != single["TEXCOORD_2"]);
}

#[test]
fn parts_of_one_place_stay_one_mesh_and_instances_become_nodes() {
    let mut asset = asset();
    asset["nodes"][0]["children"] = json!([1]);
    let only = load_with("[[object]]\nfile = \"a.gltf\"\n", &asset);
    let atlas = built(&only, 128, 128, 1);
    let (glb, root, places) = read(&only, &atlas);
    let all = shown(&glb);
    assert_eq!((all.len(), all[1].primitives.len(), places.len()), (2, 2, 2));
    expect_same(&only, &atlas, 2, &all[1], &all[1].primitives[1]);
    // Its extras hold both what was there and its place.
    let left = named(&root, "nodes", "left");
    assert!(left["extras"]["side"] == "l" && left["extras"]["lightmapPage"] == 0);
    // Four instances of `alone`.
    asset["nodes"][3]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 0 } } });
    let geometry = load_with(
        "[[object]]\nfile = \"a.gltf\"\n[[object.part]]\nname = \"pair\"\nlightmap = false\nalbedo = 0.25\n",
        &asset,
    );
    let atlas = built(&geometry, 128, 128, 1);
    let (glb, root, places) = read(&geometry, &atlas);
    let all = shown(&glb);
    assert_eq!((all.len(), places.len()), (5, 4));
    for (i, node) in all[..4].iter().enumerate() {
        assert_eq!((&node.name[..], &node.parent[..]), ("alone", "alone"));
        expect_same(&geometry, &atlas, i, node, &node.primitives[0]);
    }
    assert!(!root.to_string().contains("EXT_mesh_gpu_instancing"));
    // The look that the scene file gives, on the material's own terms for the rest.
    let plain = named(&root, "materials", "plain");
    assert_eq!(plain["pbrMetallicRoughness"]["baseColorFactor"], json!([0.25, 0.25, 0.25, 1.0]));
    assert_eq!(plain["emissiveFactor"], json!([0.1, 0.2, 0.3]));
}

#[test]
fn ten_thousand_nodes_below_each_other_go_over() {
    let mut asset = asset();
    let mut nodes: Vec<Value> =
        (1..10_000).map(|child| json!({ "children": [child], "translation": [0.001, 0, 0] })).collect();
    nodes.push(json!({ "mesh": 1 }));
    asset["nodes"] = json!(nodes);
    asset["scenes"] = json!([{ "nodes": [0] }]);
    asset["scene"] = json!(0);
    let geometry = load_with("[[object]]\nfile = \"a.gltf\"\n", &asset);
    let atlas = built(&geometry, 64, 64, 1);
    let (glb, root, _) = read(&geometry, &atlas);
    assert_eq!(root["nodes"].as_array().unwrap().len(), 10_001);
    expect_same(&geometry, &atlas, 0, &shown(&glb)[0], &shown(&glb)[0].primitives[0]);
}

/// Triangles of an asset's mesh 0, as a skin and morph targets make them, and what is hidden.
fn posed() -> Value {
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let corners = [0., 0., 0., 1., 0., 0., 0., 1., 0.];
    let (up, tangents) = ([0., 0., 1.].repeat(3), [1., 0., 0., 1.].repeat(3));
    let weights = [0.5, 0.25, 0., 0.].repeat(3);
    let bytes =
        [floats(&corners), floats(&up), floats(&tangents), floats(&weights), [0, 1, 0, 0].repeat(3)].concat();
    let uri = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let view = |at: usize, length: usize| json!({ "buffer": 0, "byteOffset": at, "byteLength": length });
    let accessor =
        |view: usize, of: &str| json!({ "bufferView": view, "componentType": 5126, "count": 3, "type": of });
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "TANGENT": 2, "WEIGHTS_0": 3, "JOINTS_0": 4 });
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    json!({
        "asset": { "version": "2.0" }, "extensionsUsed": ["KHR_node_visibility", "EXT_lights_ies"],
        "extensionsRequired": ["KHR_node_visibility"],
        "extensions": { "EXT_lights_ies": { "lights": [{ "uri": "data:application/x-ies-lm-63;base64,SUVTTkE6TE0tNjMtMjAwMgpUSUxUPU5PTkUKMSAtMSAxIDIgMSAxIDIgMCAwIDAKMSAxIDkKMCA5MAowCjIwMCA1MAo=" }] } },
        "scenes": [{ "nodes": [0, 1, 3, 4] }],
        "nodes": [
            { "name": "ground", "mesh": 1, "translation": [0, -3, 0], "scale": [9, 9, 9] },
            { "name": "body", "mesh": 0, "skin": 0, "translation": [0, 70, 0], "scale": [3, 3, -3], "children": [2],
              "extensions": { "EXT_lights_ies": { "light": 0, "multiplier": 3 } } },
            { "name": "left", "translation": [0, 0, 2], "rotation": [0, 0.6, 0, 0.8] },
            { "name": "right", "translation": [5, 1, 0] },
            { "name": "store", "extensions": hidden, "children": [5, 6] },
            { "name": "spare", "mesh": 1, "translation": [0, 0, 7] },
            { "name": "spare body", "mesh": 0, "skin": 0 },
        ],
        "skins": [{ "joints": [2, 3] }],
        "meshes": [
            { "name": "figure", "weights": [2], "primitives": [{ "attributes": attributes, "targets": [{ "POSITION": 1 }] }] },
            { "name": "plate", "primitives": [{ "attributes": { "POSITION": 0 } }] },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            accessor(1, "VEC3"), accessor(2, "VEC4"), accessor(3, "VEC4"),
            { "bufferView": 4, "componentType": 5121, "count": 3, "type": "VEC4" },
        ],
        "bufferViews": [view(0, 36), view(36, 36), view(72, 48), view(120, 48), view(168, 12)],
        "buffers": [{ "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{uri}") }],
    })
}

#[test]
fn poses_are_written_as_they_were_baked_and_what_is_hidden_stays() {
    let geometry = load_with("[[object]]\nfile = \"a.gltf\"\ntranslate = [1, 2, 3]\n", &posed());
    let atlas = built(&geometry, 128, 128, 1);
    assert_eq!(geometry.instances.len(), 2);
    let (glb, root, _) = read(&geometry, &atlas);
    let all = shown(&glb);
    let named = |name: &str| all.iter().find(|s| s.name == name).unwrap_or_else(|| panic!("{name}"));
    for (i, instance) in geometry.instances.iter().enumerate() {
        let node = named(if instance.name.contains("body") { "body" } else { "ground" });
        expect_same(&geometry, &atlas, i, node, &node.primitives[0]);
    }
    // What is baked needs no joints to be drawn; the node that has them not any more keeps its lamp.
    assert!(
        root.get("skins").is_none()
            && !root.to_string().contains("JOINTS_0")
            && root["meshes"][1].get("weights").is_none()
    );
    let lamp = root["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .find(|node| node["extensions"].get("EXT_lights_ies").is_some());
    assert_eq!(lamp.unwrap()["extensions"]["EXT_lights_ies"], json!({ "light": 0, "multiplier": 3 }));
    let profile = &root["extensions"]["EXT_lights_ies"]["lights"][0];
    let view = &root["bufferViews"][profile["bufferView"].as_u64().unwrap() as usize];
    let at = view["byteOffset"].as_u64().unwrap_or(0) as usize;
    assert!(glb.blob.as_ref().unwrap()[at..].starts_with(b"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2"));
    // Hidden by the node above, or, in the space of the file, by its own.
    let (spare, body) = (named("spare"), named("spare body"));
    assert_eq!(
        (spare.parent.as_str(), spare.place, body.parent.as_str(), body.place),
        ("store", None, "a", None)
    );
    assert_eq!(spare.primitives[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    let hidden: Vec<_> = root["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|n| n["extensions"]["KHR_node_visibility"]["visible"] == false)
        .collect();
    assert_eq!(
        hidden.iter().map(|node| node["name"].as_str().unwrap()).collect::<Vec<_>>(),
        ["store", "spare body"]
    );
    assert_eq!(root["extensionsRequired"], json!(["KHR_node_visibility"]));
}
