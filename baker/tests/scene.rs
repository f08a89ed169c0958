//! Scene files: every broken one under `tests/invalid` gives the error it names, and a full one resolves to
//! what it says.

use baker::scene::colour::black_body;
use baker::scene::{self, Lamp, LightmapSize, Scene, Sky, SunTrack};
use dataset::image::Image;
use glam::{DVec3, dvec3};
use std::f64::consts::PI;
use std::fs;
use std::path::Path;

fn write(folder: &Path, text: &str) -> dataset::Result<(Scene, Vec<String>)> {
    fs::write(folder.join("triangle.obj"), "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n").unwrap();
    fs::write(folder.join("yard.toml"), text).unwrap();
    scene::load(&folder.join("yard.toml"))
}

#[test]
fn every_invalid_scene_file_gives_the_error_it_names() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/invalid");
    let mut seen = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let expected = text.lines().next().and_then(|l| l.strip_prefix("# expect: ")).expect("first line");
        match scene::load(&path) {
            Ok(_) => panic!("{} was accepted", path.display()),
            Err(error) => {
                let message = error.to_string();
                assert!(message.contains(expected), "expected: {expected}\n     got: {message}");
                assert!(message.starts_with(&path.display().to_string()), "{message}");
            }
        }
        seen += 1;
    }
    assert!(seen > 50, "saw {seen} files");
}

#[test]
fn numbers_that_toml_does_not_take_are_told_how_to_write() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("yard.toml");
    for (typed, hint) in [
        ("radius = 0,05", "not TOML: |(a number has a decimal point, not a comma: 0.05)"),
        ("kelvin = 2700K", "not TOML: |(a number stands without its unit: 2700)"),
        ("lumens = 800 lm # bright", "not TOML: |(a number stands without its unit: 800)"),
        (
            "radius = -1,5 m",
            "not TOML: |(a number has a decimal point, not a comma, and stands without its unit: -1.5)",
        ),
        ("on = 6:00", "not TOML: |(dates and times of day stand in quotes)"),
    ] {
        fs::write(&path, format!("[[group]]\n[[group.sphere]]\n{typed}\nradiance = [1, 1, 1]\n")).unwrap();
        let message = scene::load(&path).unwrap_err().to_string();
        let (start, end) = hint.split_once('|').unwrap();
        assert!(message.contains(&format!("yard.toml:3: {start}")) && message.ends_with(end), "{message}");
    }
}

#[test]
fn all_missing_geometry_files_are_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("yard.toml");
    fs::write(folder.path().join("there.obj"), "v 0 0 0\n").unwrap();
    let object = |file: &str| format!("[[object]]\nfile = \"{file}\"\n");
    fs::write(&path, object("one.glb") + &object("there.obj") + &object("two.obj")).unwrap();
    let message = scene::load(&path).unwrap_err().to_string();
    for part in ["2 files are missing", "yard.toml:2: file = \"one.glb\"", "yard.toml:6: file = \"two.obj\""]
    {
        assert!(message.contains(part), "{message}");
    }
    fs::write(&path, object("one.glb")).unwrap();
    let message = scene::load(&path).unwrap_err().to_string();
    assert!(message.contains("yard.toml:2: file = \"one.glb\": there is no file"), "{message}");
}

#[test]
fn a_file_that_is_not_there_or_not_text_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("yard.toml");
    let message = scene::load(&path).unwrap_err().to_string();
    assert!(message.contains("yard.toml: no such file; expected a scene"), "{message}");
    fs::write(&path, b"name = \"a\"\n# \xff\n").unwrap();
    assert!(scene::load(&path).unwrap_err().to_string().contains("yard.toml:2: expected UTF-8 text"));
}

#[test]
fn the_least_scene_has_the_documented_defaults() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, warnings) = write(folder.path(), "[[object]]\nfile = \"triangle.obj\"\n").unwrap();
    assert_eq!(warnings, Vec::<String>::new());
    assert_eq!(scene.name, "yard");
    assert!(
        scene.location.is_none() && scene.sun.is_none() && scene.sky.is_none() && scene.groups.is_empty()
    );
    assert!(matches!(scene.lightmap.size, LightmapSize::Fixed { width: 512, height: 512 }));
    assert_eq!(
        (scene.lightmap.padding, scene.bake.samples, scene.bake.bounces, scene.bake.seed),
        (2, 64, None, 1)
    );
    assert!(scene.lightmap.pages == 1 && scene.portals.is_empty());
    assert_eq!(scene.objects[0].world_from_file, [glam::DMat4::IDENTITY]);
}

const FULL: &str = r#"
name = "full-yard"
description = "every key once"
[place]
latitude = 48.1
longitude = 11.6
utc_offset = 2
date = 2026-06-21
north = 30
refraction = false
[sun]
disc_angle = 0
[sky]
model = "hosek-wilkie"
turbidity = 5
[[object]]
file = "triangle.obj"
translate = [10, 0, 0]
rotate = [90, 90, 0]
scale = 2
instances = [{ translate = [1, 2, 3] }, { scale = [-1, 1, 1] }]
albedo = 0.99
vt = "lightmap"
[[object.part]]
name = "leaf*"
two_sided = true
emission = [1, 2, 3]
group = "porch"
[[group]]
name = "porch"
on = [["18:00", "24:00"], [0, 6.5]]
[[group.sphere]]
centre = [0, 3, 0]
radius = 0.1
lumens = 800
kelvin = 2700
[[group.rectangle]]
corner = [0, 0, 0]
edge_u = [2, 0, 0]
edge_v = [0, 0.5, 0]
lumens = 3000
kelvin = 4000
[[group.spot]]
position = [0, 2, 0]
direction = [0, -3, 0]
inner = 20
outer = 40
lumens = 500
kelvin = 6500
[[group.disc]]
centre = [0, 2, 0]
direction = [0, -2, 0]
radius = 0.25
lumens = 1200
kelvin = 3000
[[group.point]]
position = [0, 2, 1]
lumens = 100
kelvin = 2000
[[portal]]
corner = [0, 1, 0]
edge_u = [1, 0, 0]
edge_v = [0, 1.5, 0]
[[group]]
name = "idle"
[lightmap]
texels_per_metre = 12.5
padding = 2
pages = 3
[bake]
samples = 128
bounces = 3
seed = 7
"#;

#[test]
fn a_full_scene_resolves_to_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, warnings) = write(folder.path(), FULL).unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("yard.toml:22: albedo = 0.99"), "{warnings:?}");
    assert_eq!(scene.name, "full-yard");
    let location = scene.location.unwrap();
    assert_eq!((location.date, location.refraction), ((2026, 6, 21), false));
    let (usual, _) = write(folder.path(), &FULL.replace("refraction = false\n", "")).unwrap();
    assert!(usual.location.unwrap().refraction);
    assert!(matches!(scene.sky, Some(Sky::HosekWilkie { turbidity: 5.0, ground_albedo: 0.2 })));
    // The sun takes the sky's turbidity.
    assert!(matches!(scene.sun.as_ref().unwrap().track, SunTrack::Computed { turbidity: 5.0 }));
    assert_eq!(scene.groups[0].on, [[18.0, 6.5]]);
    assert_eq!(scene.groups[1].on, [[0.0, 24.0]]);

    // scale, rotate X then Y, translate: (0, 1, 0) → (0, 2, 0) → (0, 0, 2) → (2, 0, 0) → (12, 0, 0).
    let object = &scene.objects[0];
    assert!(object.vt_is_lightmap);
    let up = object.world_from_file[0].transform_point3(DVec3::Y - dvec3(1.0, 2.0, 3.0));
    assert_eq!(up, dvec3(12.0, 0.0, 0.0));
    assert!(object.world_from_file[1].determinant() < 0.0);
    assert_eq!(object.parts[0].overrides.group.as_deref(), Some("porch"));

    // Lumens come back when the lamp's light is integrated (1 unit = 1000 lm).
    let luminance = |rgb: DVec3| rgb.dot(dvec3(0.2126390, 0.7151687, 0.0721923));
    for lamp in &scene.groups[0].lamps {
        let (lumens, expected) = match *lamp {
            Lamp::Sphere { radius, radiance, .. } => {
                (luminance(radiance) * PI * 4.0 * PI * radius * radius, 800.0)
            }
            Lamp::Rectangle { radiance, .. } => (luminance(radiance) * PI, 3000.0),
            Lamp::Disc { radius, radiance, direction, .. } => {
                assert_eq!(direction, -DVec3::Y);
                (luminance(radiance) * PI * PI * radius * radius, 1200.0)
            }
            Lamp::Point { intensity, .. } => (luminance(intensity) * 4.0 * PI, 100.0),
            Lamp::Ies { .. } => unreachable!("no lamp has an IES file"),
            Lamp::Spot { inner, outer, intensity, direction, .. } => {
                assert_eq!(direction, -DVec3::Y);
                let steps = 100_000;
                let falloff = |cos: f64| {
                    let t = ((cos - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
                    t * t * (3.0 - 2.0 * t)
                };
                let integral: f64 = (0..steps)
                    .map(|i| falloff(-1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(steps)))
                    .sum::<f64>()
                    * 2.0
                    / f64::from(steps);
                (luminance(intensity) * 2.0 * PI * integral, 500.0)
            }
        };
        assert!((lumens * 1000.0 - expected).abs() < 1e-4 * expected, "{lumens} klm, expected {expected} lm");
    }
    let Lamp::Sphere { radiance, .. } = scene.groups[0].lamps[0] else { panic!() };
    assert!((radiance / luminance(radiance) - black_body(2700.0)).length() < 1e-6);

    assert_eq!(scene.groups[0].lamps.len(), 5);
    assert_eq!((scene.portals.len(), scene.portals[0].edge_v), (1, dvec3(0.0, 1.5, 0.0)));
    assert!(matches!(scene.lightmap.size, LightmapSize::TexelsPerMetre(12.5)));
    assert_eq!(scene.lightmap.pages, 3);
    assert_eq!((scene.bake.samples, scene.bake.bounces, scene.bake.seed), (128, Some(3), 7));
}

fn write_sky(path: &Path, width: usize, height: usize, change: impl Fn(&mut Vec<[f32; 3]>)) {
    let mut texels = vec![[0.5, 1.0, 2.0]; width * height];
    change(&mut texels);
    fs::write(path, Image { width, height, texels }.to_exr()).unwrap();
}

#[test]
fn a_sky_picture_is_read_and_scaled() {
    let folder = tempfile::tempdir().unwrap();
    write_sky(&folder.path().join("dusk.exr"), 8, 4, |_| ());
    let text = |keys: &str| {
        format!(
            "[sky]\nmodel = \"image\"\nfile = \"dusk.exr\"\n{keys}\n[[object]]\nfile = \"triangle.obj\"\n"
        )
    };
    let (scene, warnings) = write(folder.path(), &text("scale = 2.5\nrotation = -30")).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let Some(Sky::Image(sky)) = &scene.sky else { panic!("{:?}", scene.sky) };
    assert_eq!((sky.file.as_str(), sky.scale, sky.rotation), ("dusk.exr", 2.5, -30.0));
    assert_eq!(sky.radiance.texels, vec![[1.25, 2.5, 5.0]; 32]);
    // What is kept of it tells one picture from another, without its texels.
    let kept = |scene: &Scene| serde_json::to_string(&scene.sky).unwrap();
    let before = kept(&scene);
    assert!(before.len() < 300, "{before}");
    write_sky(&folder.path().join("dusk.exr"), 8, 4, |texels| texels[3][1] = 1.5);
    assert_ne!(before, kept(&write(folder.path(), &text("scale = 2.5\nrotation = -30")).unwrap().0));
}

#[test]
fn a_bad_sky_picture_is_told_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let message = |scale: &str| {
        let text = format!(
            "[sky]\nmodel = \"image\"\nfile = \"dusk.exr\"\n{scale}\n[[object]]\nfile = \"triangle.obj\"\n"
        );
        write(folder.path(), &text).unwrap_err().to_string()
    };
    let path = folder.path().join("dusk.exr");
    let expect = |expected: &str, scale: &str| {
        let message = message(scale);
        assert!(message.contains("yard.toml:3: file = \"dusk.exr\": "), "{message}");
        assert!(message.contains(expected), "expected: {expected}\n     got: {message}");
    };
    expect("dusk.exr: No such file", "");
    write_sky(&path, 8, 8, |_| ());
    expect("8 × 8 texels: expected a lat-long picture, twice as wide as high", "");
    write_sky(&path, 8, 4, |texels| texels[11][2] = -0.5);
    expect("texel (3, 1), channel B: -0.5: expected a radiance, 0 or more", "");
    write_sky(&path, 8, 4, |texels| texels[11][2] = f32::NAN);
    expect("(3, 1)", "");
    write_sky(&path, 8, 4, |texels| texels[11][0] = f32::INFINITY);
    expect("(3, 1)", "");
    // Finite in the file, not when scaled.
    write_sky(&path, 8, 4, |texels| texels[0][0] = 1e30);
    expect("texel (0, 0), channel R", "");
    write_sky(&path, 8, 4, |_| ());
    expect("texel (0, 0), channel R: 0.5: expected a radiance", "scale = 1e300");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    expect("dusk.exr", "");
    fs::write(&path, "").unwrap();
    expect("dusk.exr", "");
}

#[test]
fn a_radiance_picture_is_a_sky() {
    let folder = tempfile::tempdir().unwrap();
    let text =
        "[sky]\nmodel = \"image\"\nfile = \"dusk.hdr\"\nscale = 3\n[[object]]\nfile = \"triangle.obj\"\n";
    let row = [128, 64, 32, 130].repeat(8);
    let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=0.5\n\n-Y 4 +X 8\n";
    fs::write(folder.path().join("dusk.hdr"), [&head[..], &row.repeat(4)].concat()).unwrap();
    let (scene, _) = write(folder.path(), text).unwrap();
    let Some(Sky::Image(sky)) = scene.sky else { panic!() };
    // 2 / 0.5 × 3.
    assert_eq!(sky.radiance.texels, [[12.0, 6.0, 3.0]; 32]);
    fs::write(folder.path().join("dusk.hdr"), [&head[..], &row].concat()).unwrap();
    let message = write(folder.path(), text).unwrap_err().to_string();
    assert!(message.contains("yard.toml:3: file = \"dusk.hdr\": "), "{message}");
    assert!(message.contains("damaged Radiance picture"), "{message}");
}

#[test]
fn models_of_other_formats_are_told_how_to_convert() {
    let folder = tempfile::tempdir().unwrap();
    for (file, told) in [
        ("house.fbx", "house.glb -fglb2`"),
        ("House.DAE", "open it in Blender and export glTF 2.0 (.glb), or run `assimp export "),
        ("house.3ds", "`assimp export "),
        ("house.stl", "`assimp export "),
        ("house.blend", "; open it in Blender and export glTF 2.0 (.glb)"),
        ("house.usdz", "; open it in Blender and export glTF 2.0 (.glb)"),
        ("house.skp", "; export glTF 2.0 (.glb) or OBJ from the program that wrote it"),
    ] {
        let path = folder.path().join(file);
        fs::write(&path, b"\xff").unwrap();
        let object =
            write(folder.path(), &format!("[[object]]\nfile = \"{file}\"\n")).unwrap_err().to_string();
        let model = Scene::of_models(std::slice::from_ref(&path)).unwrap_err().to_string();
        let scene = scene::load(&path).unwrap_err().to_string();
        for message in [object, model, scene] {
            assert!(message.contains(file) && message.contains(told), "{message}");
        }
    }
}

#[test]
fn a_portal_without_a_sky_is_warned_about() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[[portal]]\ncorner = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n[[object]]\nfile = \"triangle.obj\"\n";
    let (scene, warnings) = write(folder.path(), text).unwrap();
    assert_eq!(scene.portals.len(), 1);
    assert!(warnings.len() == 1 && warnings[0].contains("[[portal]] has no use"), "{warnings:?}");
}

/// Every example of scenes/README.md is a scene that loads, beside files of the names it uses.
#[test]
fn the_documented_examples_load() {
    let readme = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/README.md");
    let text = fs::read_to_string(readme).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for file in ["shed.glb", "tree.glb", "chair.obj"] {
        fs::write(folder.path().join(file), "").unwrap();
    }
    write_sky(&folder.path().join("dusk.exr"), 8, 4, |_| ());
    let examples: Vec<&str> =
        text.split("```toml\n").skip(1).map(|t| t.split("```").next().unwrap()).collect();
    assert!(examples.len() >= 5);
    for example in examples {
        let (_, warnings) = write(folder.path(), example).unwrap_or_else(|e| panic!("{e}\n{example}"));
        assert!(warnings.is_empty(), "{warnings:?}");
    }
}
