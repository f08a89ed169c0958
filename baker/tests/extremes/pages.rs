//! Pages of extreme shapes, and lightmap layouts that cannot be used.

use crate::common::mesh::{Obj, gltf};
use crate::common::{Stage, green, mean};
use glam::{DVec3, dvec3};
use std::f64::consts::PI;

const SKY: &str = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";

fn bake(stage: &Stage, lightmap: &str) -> crate::common::Baked {
    stage.bake("12", 16, &format!("{SKY}[[object]]\nfile = \"a.obj\"\n[lightmap]\n{lightmap}\n"))
}

#[test]
fn one_triangle_on_the_smallest_page() {
    // A chart needs two texels each way, for it stays half a texel inside the page: one texel is refused by
    // name.
    let triangle = Obj::default().mesh("floor").polygon(&[DVec3::ZERO, DVec3::Z, DVec3::X]);
    let stage = Stage::new(&[("a.obj", triangle.text())]);
    for lightmap in
        ["size = 5", "size = 4", "size = 3", "size = 2", "size = [2, 7]", "size = 2\npadding = 64"]
    {
        let baked = bake(&stage, lightmap);
        assert!(baked.mask.count() >= 1, "{lightmap}");
        let image = baked.first();
        for (texel, _) in image.texels.iter().zip(&baked.mask.valid).filter(|(_, valid)| **valid) {
            assert!((f64::from(texel[1]) / PI - 1.0).abs() < 1e-5, "{lightmap}: {texel:?}");
        }
    }
    let message = stage.refusal("12", &format!("{SKY}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 1\n"));
    assert!(message.contains("size 1 x 1") && message.contains("at least 2 x 2"), "{message}");
}

#[test]
fn two_charts_that_no_page_of_one_texel_holds_are_refused() {
    let obj = Obj::default().mesh("block").block(DVec3::ZERO, DVec3::ONE);
    let stage = Stage::new(&[("a.obj", obj.text())]);
    let message = stage.refusal("12", &format!("{SKY}[[object]]\nfile = \"a.obj\"\n[lightmap]\nsize = 1\n"));
    assert!(message.contains("size 1 x 1") && message.contains("no chart fits"), "{message}");
}

#[test]
fn pages_of_odd_width() {
    let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0);
    let stage = Stage::new(&[("a.obj", obj.text())]);
    for (width, height) in [(13, 7), (33, 17), (129, 3), (3, 129), (65, 64), (127, 131)] {
        let baked = bake(&stage, &format!("size = [{width}, {height}]"));
        assert_eq!(baked.outcome.size, [width, height]);
        let image = baked.first();
        assert!(baked.mask.count() > 0);
        for (texel, valid) in image.texels.iter().zip(&baked.mask.valid) {
            assert!(!valid || (f64::from(texel[1]) / PI - 1.0).abs() < 1e-5, "{width} x {height}: {texel:?}");
        }
    }
}

/// Two squares with an authored layout.
fn layout(uvs: &[[f64; 2]; 8]) -> Stage {
    let square = |x: f64| {
        let at = |dx: f64, z: f64| dvec3(x + dx, 0.0, z);
        [at(0.0, 1.0), at(1.0, 1.0), at(1.0, 0.0), at(0.0, 0.0)]
    };
    let obj =
        Obj::default().mesh("floor").textured(&square(0.0), &uvs[..4]).textured(&square(2.0), &uvs[4..]);
    Stage::new(&[("a.obj", obj.text())])
}

const OBJECT: &str = "[[object]]\nfile = \"a.obj\"\nvt = \"lightmap\"\n[lightmap]\nsize = 32\n";
const LEFT: [[f64; 2]; 4] = [[0.0, 0.0], [0.4, 0.0], [0.4, 0.4], [0.0, 0.4]];

fn both(right: [[f64; 2]; 4]) -> [[f64; 2]; 8] {
    let mut all = [[0.0; 2]; 8];
    all[..4].copy_from_slice(&LEFT);
    all[4..].copy_from_slice(&right);
    all
}

#[test]
fn unusable_layouts_are_replaced_and_that_is_said() {
    let moved = |x: f64, y: f64| LEFT.map(|[u, v]| [u + x, v + y]);
    let cases: [(_, Option<&str>); 5] = [
        (moved(0.5, 0.5), None),
        (moved(0.9, 0.0), Some("it leaves [0, 1]")),
        (moved(0.0, -0.5), Some("it leaves [0, 1]")),
        (moved(0.2, 0.2), Some("triangles overlap")),
        ([[0.5, 0.5]; 4], Some("a triangle has no area there")),
    ];
    for (right, note) in cases {
        let baked = layout(&both(right)).bake("12", 16, &format!("{SKY}{OBJECT}"));
        let notes: Vec<&String> = baked
            .outcome
            .warnings
            .iter()
            .filter(|f| f.contains("lightmap layout in the file is not used"))
            .collect();
        match note {
            None => assert!(notes.is_empty(), "{notes:?}"),
            Some(why) => assert!(notes.len() == 1 && notes[0].contains(why), "{notes:?}, expected {why}"),
        }
        // Whatever the layout, both squares have the open sky's light.
        let image = baked.first();
        for texel in baked.texels.iter().filter(|t| t.valid) {
            assert!((green(&image, texel) / PI - 1.0).abs() < 1e-5, "{texel:?}");
        }
        assert!(
            baked.on("floor").iter().any(|t| t.centre().x > 2.0) && mean(&image, &baked.on("floor")) > 3.0
        );
    }
}

#[test]
fn a_layout_with_nan_names_file_and_vertex() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut right = LEFT.map(|[u, v]| [u + 0.5, v + 0.5]);
        right[2][0] = bad;
        let message = layout(&both(right)).refusal("12", &format!("{SKY}{OBJECT}"));
        let told = ["a.obj", "floor", "vertex", "coordinate", "expected finite numbers"];
        assert!(told.iter().all(|word| message.contains(word)), "{message}");
    }
    let positions = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
    let text = gltf(&positions, &[[0, 1, 2]], Some(&[[0.0, 0.0], [0.5, f32::NAN], [0.5, 0.5]]), "{}");
    let stage = Stage::new(&[("a.gltf", text)]);
    let message = stage.refusal("12", &format!("{SKY}[[object]]\nfile = \"a.gltf\"\n[lightmap]\nsize = 8\n"));
    assert!(
        message.contains("a.gltf") && message.contains("lightmap coordinate") && message.contains("NaN"),
        "{message}"
    );
}
