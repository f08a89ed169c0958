//! Likely mistakes in scenes that bake all the same are warned about by cause and remedy.

// (Not all helpers are used by every target.)
#[allow(dead_code)]
mod common;

use baker::bake::forecast::warnings;
use baker::bake::run::{Options, prepare};
use baker::light::times::schedule::parse_hours;
use common::Stage;
use common::mesh::Obj;
use dataset::observe::Silent;
use glam::{DVec3, dvec3};

const PAGE: &str = "[lightmap]\nsize = 16\n";

/// A scene of a room of 4 × 3 × 4 m with a block of 20 cm in it.
fn room() -> Stage {
    let room = Obj::default().mesh("room").room(dvec3(-2.0, 0.0, -2.0), dvec3(2.0, 3.0, 2.0));
    let block = room.mesh("bulb").block(dvec3(-0.1, 1.9, -0.1), dvec3(0.1, 2.1, 0.1));
    Stage::new(&[("a.obj", block.text())])
}

/// What is likely a mistake in a scene file.
fn mistakes(stage: &Stage, scene: &str) -> Vec<String> {
    stage.write("case.toml", scene.as_bytes());
    let options = Options::new(parse_hours("12").unwrap());
    let prepared = prepare(&stage.path("case.toml"), &options, &Silent).unwrap();
    let (atlas, _) = prepared.atlas().unwrap();
    warnings(&prepared, atlas.texels_per_metre).unwrap()
}

/// What is likely a mistake in the room with these lines after its object and in a group.
fn warned(stage: &Stage, part: &str, lamp: &str) -> Vec<String> {
    let scene = format!(
        "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n{part}\n[[group]]\nname = \"lamp\"\n{lamp}\n{PAGE}"
    );
    mistakes(stage, &scene)
}

fn point([x, y, z]: [f64; 3]) -> String {
    format!("[[group.point]]\nposition = [{x}, {y}, {z}]\nintensity = [1, 1, 1]")
}

fn sphere([x, y, z]: [f64; 3], radius: f64) -> String {
    format!("[[group.sphere]]\ncentre = [{x}, {y}, {z}]\nradius = {radius}\nradiance = [1, 1, 1]")
}

#[test]
fn a_lamp_inside_a_solid_is_named_with_it() {
    let stage = room();
    let told = "a lamp stands inside a closed body, so no light gets out: the point of \"lamp\" at [0.05, 2, 0] in \"a.obj: \
                bulb\". Move the lamp, open the body, or let it pass light (`transmission`)";
    let inside = |part: &str, lamp: &str| warned(&stage, part, lamp).iter().filter(|w| *w == told).count();
    let two_sided = "[[object.part]]\nname = \"bulb\"\ntwo_sided = true";
    for part in ["", two_sided] {
        assert_eq!(inside(part, &point([0.05, 2.0, 0.0])), 1, "{part}");
    }
    // In the air, in the block's face, hardly in it, in the ceiling's plane, or in glass.
    let glass = "[[object.part]]\nname = \"bulb\"\ntransmission = 0.9";
    for (part, at) in [
        ("", [1.0, 2.0, 0.0]),
        ("", [0.1, 2.0, 0.0]),
        ("", [0.098, 2.0, 0.0]),
        ("", [0.0, 3.0, 1.0]),
        (two_sided, [1.0, 2.0, 0.0]),
        (glass, [0.05, 2.0, 0.0]),
    ] {
        let warnings = warned(&stage, part, &point(at));
        assert!(!warnings.iter().any(|w| w.contains("closed body")), "{at:?}: {warnings:?}");
    }
}

#[test]
fn a_sphere_larger_than_its_room_is_named() {
    let stage = room();
    let too_large = |lamp: &str| {
        let warnings = warned(&stage, "", lamp);
        warnings.into_iter().find(|w| w.starts_with("a sphere is too large for its surroundings"))
    };
    let told = too_large(&sphere([0.0, 1.0, 0.0], 2.5)).unwrap();
    assert!(
        told.contains("the sphere of \"lamp\" at [0, 1, 0] (radius 2.5 m, reaching through \"a.obj: "),
        "{told}"
    );
    assert!(told.contains("Is the radius in metres? A bulb has about 0.03"), "{told}");
    // It holds the block, and stands free of the walls.
    let stage = Stage::new(&[(
        "a.obj",
        Obj::default()
            .mesh("room")
            .room(DVec3::splat(-9.0), DVec3::splat(9.0))
            .mesh("block")
            .block(dvec3(0.2, -0.3, -0.3), dvec3(0.5, 0.3, 0.3))
            .text(),
    )]);
    let warnings = warned(&stage, "", &sphere([0.0; 3], 1.0));
    assert!(warnings.iter().any(|w| w.contains("(radius 1 m, containing \"a.obj: block\")")), "{warnings:?}");
    for lamp in [sphere([0.0, 1.5, 0.0], 0.1), sphere([0.0, 1.0, 0.0], 0.9), sphere([1.9, 2.0, 0.0], 0.3)] {
        assert_eq!(too_large(&lamp), None, "{lamp}");
    }
}

#[test]
fn a_wrong_unit_is_told_by_the_size_and_the_density_that_it_gives() {
    let stage = Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())]);
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
    let scene = |keys: &str, page: &str| format!("{sky}[[object]]\nfile = \"a.obj\"\n{keys}\n{page}");
    let warned = |keys: &str, page: &str| mistakes(&stage, &scene(keys, page));
    let of_unit =
        |warnings: Vec<String>| warnings.into_iter().find(|w| w.contains("and lengths are in metres"));
    let told = of_unit(stage.bake("12", 2, &scene("scale = 0.001", PAGE)).outcome.warnings).unwrap();
    assert_eq!(of_unit(warned("scale = 0.001", PAGE)).as_ref(), Some(&told));
    assert!(told.starts_with("the scene is 1.0 mm long, with "), "{told}");
    assert!(told.contains("should the `scale` of an [[object]] be larger? (the object at "), "{told}");
    assert!(told.contains("case.toml:5") && told.contains(" texels per metre"), "{told}");
    let told = of_unit(warned("scale = 2e5", PAGE)).unwrap();
    assert!(told.starts_with("the scene is 200 km long") && told.contains("be smaller?"), "{told}");
    let told = of_unit(warned("scale = 0.12", "[lightmap]\ntexels_per_metre = 1500\n")).unwrap();
    assert!(
        told.starts_with("the scene is 0.12 m long") && told.contains("or the `size` of [lightmap]"),
        "{told}"
    );
    for keys in ["", "scale = 0.2", "scale = 9e4"] {
        assert_eq!(of_unit(warned(keys, PAGE)), None, "{keys}");
    }
}
