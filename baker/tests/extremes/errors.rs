//! Input without a meaning: the message names file, line or vertex, and the value.

use crate::common::Stage;

const TRIANGLE: &str = "o floor\nv 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n";

#[track_caller]
fn refused(obj: &str, scene: &str, words: &[&str]) {
    let stage = Stage::new(&[("a.obj", obj.to_owned())]);
    let message = stage.refusal("12", scene);
    for word in words {
        assert!(message.contains(word), "{message}\nexpected {word}");
    }
}

const OBJECT: &str = "[[object]]\nfile = \"a.obj\"\n";

#[test]
fn positions_that_are_no_numbers() {
    for bad in ["nan", "inf", "-inf", "1e39", "1e400"] {
        let obj = TRIANGLE.replace("v 1 0 0", &format!("v 1 {bad} 0"));
        refused(&obj, OBJECT, &["a.obj", "expected finite numbers"]);
    }
    refused(&TRIANGLE.replace("v 1 0 0", "v 1 x 0"), OBJECT, &["a.obj:3"]);
}

#[test]
fn faces_of_vertices_that_are_not_there() {
    for face in ["f 1 2 4", "f 0 1 2", "f -4 1 2"] {
        refused(&TRIANGLE.replace("f 1 2 3", face), OBJECT, &["a.obj"]);
    }
}

#[test]
fn normals_that_are_no_numbers() {
    let obj = "o floor\nv 0 0 0\nv 1 0 0\nv 0 0 -1\nvn 0 nan 0\nf 1//1 2//1 3//1\n";
    refused(obj, OBJECT, &["a.obj: floor", "normal", "NaN", "expected finite numbers"]);
}

#[test]
fn a_file_whose_triangles_have_no_area() {
    let line = TRIANGLE.replace("v 0 0 -1", "v 2 0 0");
    refused(&line, OBJECT, &["nothing to bake", "1 degenerate triangle)"]);
    refused("o floor\nv 0 0 0\nv 1 0 0\n", OBJECT, &["a.obj", "expected at least one triangle"]);
}

#[test]
fn nothing_to_bake() {
    refused(TRIANGLE, &format!("{OBJECT}lightmap = false\n"), &["nothing to bake"]);
}

#[test]
fn transforms_out_of_range() {
    refused(TRIANGLE, &format!("{OBJECT}scale = 1e200\n"), &["spans"]);
    refused(TRIANGLE, &format!("{OBJECT}scale = 1e308\ntranslate = [1e308, 1e308, 0]\n"), &["a.obj: floor"]);
    refused(TRIANGLE, &format!("{OBJECT}scale = [1, 0, 1]\n"), &["case.toml:3", "scale = [1, 0, 1]"]);
    refused(
        TRIANGLE,
        &format!("{OBJECT}translate = [nan, 0, 0]\n"),
        &["case.toml:3", "translate = [nan, 0, 0]"],
    );
}

#[test]
fn light_that_is_no_light() {
    let group = "[[group]]\nname = \"g\"\n[[group.sphere]]\ncentre = [0, 1, 0]\n";
    let cases = [
        ("radius = 0\nradiance = [1, 1, 1]\n", "radius = 0"),
        ("radius = -1\nradiance = [1, 1, 1]\n", "radius = -1"),
        ("radius = nan\nradiance = [1, 1, 1]\n", "radius = nan"),
        ("radius = 1\nradiance = [1, -1, 1]\n", "radiance = [1, -1, 1]"),
        ("radius = 1\nradiance = [1, inf, 1]\n", "radiance = [1, inf, 1]"),
        ("radius = 1\nradiance = [1, 1e300, 1]\n", "radiance = [1, 1e300, 1]"),
    ];
    for (lamp, value) in cases {
        refused(TRIANGLE, &format!("{OBJECT}{group}{lamp}"), &["case.toml:", value, "expected"]);
    }
    refused(
        TRIANGLE,
        &format!("{OBJECT}albedo = 1.001\n"),
        &["case.toml:3", "albedo = 1.001", "from 0 to 1"],
    );
}

#[test]
fn a_page_too_large_for_its_density() {
    let scene = format!("{OBJECT}[lightmap]\ntexels_per_metre = 1e9\n");
    refused(TRIANGLE, &scene, &["texels_per_metre = 1000000000", "16384"]);
}
