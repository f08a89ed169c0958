//! What surfaces look like when the geometry file is read again.

use super::*;

/// What a triangle shows.
#[derive(Debug, PartialEq)]
struct Shown {
    /// Not of glass: glTF has one colour for what passes and what is reflected.
    albedo: Option<Vec3>,
    alpha: f32,
    cutoff: Option<f32>,
    has_texture: bool,
    two_sided: bool,
    emission: Option<Vec3>,
    has_map: bool,
    transmission: Option<(Vec3, bool)>,
    colour: Option<glam::Vec4>,
}

fn looks(geometry: &Geometry) -> Vec<Shown> {
    let look = |triangle: usize| {
        let index = geometry.material_of[triangle];
        let material = &geometry.materials[index as usize];
        let glass = geometry.glass_of(index);
        let colour = geometry.colours.get(geometry.triangles[triangle][0] as usize);
        Shown {
            albedo: glass.is_none().then_some(material.albedo),
            alpha: material.alpha,
            cutoff: material.alpha_cutoff,
            has_texture: material.texture.is_some(),
            two_sided: material.two_sided,
            emission: material.emission.map(|e| e.radiance),
            has_map: material.emission.is_some_and(|e| e.map.is_some()),
            transmission: glass.map(|g| (g.transmission * g.tint.unwrap_or(Vec3::ONE), g.is_blended)),
            // (White is what none is.)
            colour: colour.copied().filter(|colour| *colour != glam::Vec4::ONE),
        }
    };
    (0..geometry.triangles.len()).map(look).collect()
}

/// A scene in a folder, and a scene of nothing but the geometry file that it gives.
fn there_and_back(folder: &std::path::Path, text: &str) -> (Geometry, Geometry, Value) {
    let scene_of = |name: &str, text: &str| {
        std::fs::write(folder.join(name), text).unwrap();
        let (scene, _) = scene::load(&folder.join(name)).unwrap();
        geometry::load(&scene).unwrap().0
    };
    let first = scene_of("first.toml", text);
    let (_, root, _) = read(&first, &built(&first, 128, 128, 1));
    let glb = to_glb(&first, &built(&first, 128, 128, 1)).unwrap().glb;
    std::fs::write(folder.join("back.glb"), glb).unwrap();
    let back = scene_of("back.toml", "[bake]\nalbedo_max = 1\n[[object]]\nfile = \"back.glb\"\n");
    (first, back, root)
}

#[test]
fn looks_of_a_gltf_and_of_the_scene_file_come_back() {
    let mut asset = asset();
    let extension = |name: &str, value: Value| json!({ name: value });
    asset["materials"][1] = json!({
        "name": "plain", "emissiveFactor": [0.5, 0.25, 0], "emissiveTexture": { "index": 1 },
        "extensions": extension("KHR_materials_emissive_strength", json!({ "emissiveStrength": 8 })),
    });
    asset["materials"][2] = json!({
        "name": "glossy", "alphaMode": "BLEND",
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 1 }, "baseColorFactor": [1, 1, 1, 0.5] },
        "extensions": extension("KHR_materials_transmission", json!({ "transmissionFactor": 0.5 })),
    });
    let part = |what: &str| format!("[[object.part]]\nname = \"plain\"\n{what}\n");
    for (look, keeps_colours) in [
        (String::new(), true),
        (part("albedo = 0.25\ntwo_sided = true"), false),
        (part("emission = [16, 8, 4]\ngroup = \"lamps\""), true),
        (part("emission = [0, 0, 0]"), true),
        (part("transmission = [0.5, 0.25, 0.125]"), true),
        (part("albedo = [0.5, 0.25, 0.125]\nemission = [0.25, 0, 0]\ngroup = \"lamps\""), false),
    ] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.gltf"), asset.to_string()).unwrap();
        let group =
            if look.contains("lamps") { "[[group]]\nname = \"lamps\"\non = \"always\"\n" } else { "" };
        let text = format!("{group}[bake]\nalbedo_max = 1\n[[object]]\nfile = \"a.gltf\"\n{look}");
        let (first, back, root) = there_and_back(folder.path(), &text);
        assert_eq!(looks(&first), looks(&back), "{look}");
        // The vertices are red where the file's colours count.
        let plain = named(&root, "materials", "plain");
        let reds = looks(&back).iter().filter(|shown| shown.colour.is_some()).count();
        assert_eq!(reds, if keeps_colours { 10 } else { 6 }, "{look} {plain}");
        // The file's own map goes over with its own emission alone.
        assert_eq!(plain.get("emissiveTexture").is_some(), !look.contains("emission"), "{look} {plain}");
    }
}

#[test]
fn looks_of_an_obj_come_back_under_its_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(
        path("things.obj"),
        format!(
            "mtllib things.mtl\n{}",
            THINGS
                .replace("v 4 0 -1", "v 4 0 -1\nvt 0 0\nvt 1 0\nvt 1 1")
                .replace("f 9 10 11", "f 9/1 10/2 11/3")
        ),
    )
    .unwrap();
    let library = "newmtl a\nKd 0.5 0.25 0.125\nd 0.75\nnewmtl b\nKd 0 0 0\nKe 4 2 1\nmap_Ke glow.png\n";
    std::fs::write(path("things.mtl"), library).unwrap();
    image::RgbaImage::from_pixel(2, 2, image::Rgba([200, 100, 50, 255])).save(path("glow.png")).unwrap();
    let text = "[lights]\nemission = 8\n[bake]\nalbedo_max = 1\n[[object]]\nfile = \"things.obj\"\n";
    let (first, back, root) = there_and_back(folder.path(), text);
    let (mut first, back) = (looks(&first), looks(&back));
    // The file's own numbers go over: 4, which this scene multiplies by 8.
    let glowing: Vec<&mut Vec3> = first.iter_mut().filter_map(|shown| shown.emission.as_mut()).collect();
    assert_eq!(glowing.len(), 1);
    glowing.into_iter().for_each(|radiance| *radiance /= 8.0);
    assert!(first == back && first.iter().any(|shown| shown.has_map), "{first:?} {back:?}");
    assert!(first.iter().any(|shown| shown.transmission.is_some()));
    for name in ["cube", "plate"] {
        named(&root, "meshes", name);
        named(&root, "nodes", name);
    }
    named(&root, "nodes", "things");
    assert_eq!(named(&root, "materials", "b")["emissiveTexture"]["index"], 0);
}

#[test]
fn an_obj_without_names_is_called_after_its_file() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("hut.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let (_, _, root) = there_and_back(folder.path(), "[[object]]\nfile = \"hut.obj\"\n");
    assert_eq!(named(&root, "meshes", "hut")["primitives"].as_array().map(Vec::len), Some(1));
    assert!(root["nodes"].as_array().unwrap().iter().all(|node| node["name"] == "hut"));
}

#[test]
fn the_scene_of_a_single_file_keeps_its_name() {
    let mut asset = asset();
    asset["scenes"][1]["name"] = json!("the yard");
    let geometry = load_with("[[object]]\nfile = \"a.gltf\"\n", &asset);
    let (_, root, _) = read(&geometry, &built(&geometry, 128, 128, 1));
    assert_eq!(root["scenes"][0]["name"], "the yard");
    let of_two = "[[object]]\nfile = \"a.gltf\"\n[[object]]\nfile = \"things.obj\"\ntranslate = [0, 9, 0]\n";
    let geometry = load_with(of_two, &asset);
    let (_, root, _) = read(&geometry, &built(&geometry, 128, 128, 1));
    assert!(root["scenes"][0].get("name").is_none());
}

#[test]
fn animations_are_warned_of_once() {
    let folder = tempfile::tempdir().unwrap();
    let warnings = |animations: usize| {
        let mut asset = asset();
        asset["animations"] = json!(vec![json!({ "channels": [], "samplers": [] }); animations]);
        std::fs::write(folder.path().join("a.gltf"), asset.to_string()).unwrap();
        let text = "[[object]]\nfile = \"a.gltf\"\n[[object]]\nfile = \"a.gltf\"\ntranslate = [9, 0, 0]\n";
        std::fs::write(folder.path().join("scene.toml"), text).unwrap();
        let (scene, _) = scene::load(&folder.path().join("scene.toml")).unwrap();
        let (_, warnings) = geometry::load(&scene).unwrap();
        warnings.into_iter().filter(|line| line.contains("animation")).collect::<Vec<_>>()
    };
    assert!(warnings(0).is_empty());
    let [line] = &warnings(3)[..] else { panic!("one line is expected") };
    assert!(line.contains("a.gltf: 3 animations"), "{line}");
}
