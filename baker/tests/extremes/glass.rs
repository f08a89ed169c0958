//! Glass as files and scene files say it is, through whole bakes.

use crate::common::mesh::{Obj, gltf};
use crate::common::texels::Texel;
use crate::common::{Baked, INTEGRATORS, Measured, Stage, mean};
use glam::{DVec3, Vec3, dvec3, vec3};

/// A black floor of 4 × 4 m under the sheet of `file`, in the sun at noon straight above; its irradiance
/// without a sheet is 8.
fn under(files: &[(&str, String)], sheet: &str) -> Vec3 {
    let floor = Obj::default().mesh("floor").floor(DVec3::ZERO, 4.0).text();
    let stage = Stage::new(&[files, &[("floor.obj", floor)]].concat());
    let scene = format!(
        "[sun]\ndisc_angle = 0\ntrack = [{{ hour = 12, direction = [0, 1, 0], irradiance = [8, 8, 8] }}]\n\
         [[object]]\nfile = \"floor.obj\"\nalbedo = 0\n[[object]]\n{sheet}\n[lightmap]\nsize = 32\n"
    );
    let baked = stage.bake("12", 4, &scene);
    let image = baked.first();
    // (Texels without any light are not valid.)
    let light = |t: &Texel| if t.valid { Vec3::from_array(image.texels[t.index]) } else { Vec3::ZERO };
    let texels: Vec<Vec3> = baked.covered("floor").into_iter().filter(|t| t.whole).map(light).collect();
    assert!(!texels.is_empty());
    texels.iter().sum::<Vec3>() / texels.len() as f32 / 8.0
}

/// A level sheet of 6 × 6 m, 1 m up.
fn sheet_obj(material: &str) -> Vec<(&'static str, String)> {
    let sheet = Obj::default().library("a.mtl").mesh("sheet").material("pane");
    let sheet = sheet.floor(dvec3(0.0, 1.0, 0.0), 6.0).text();
    vec![("sheet.obj", sheet), ("a.mtl", format!("newmtl pane\nKd 0.5 0.5 0.5\n{material}\n"))]
}

#[test]
fn files_and_scene_files_say_what_glass_lets_through() {
    let of_mtl = |material: &str| under(&sheet_obj(material), "file = \"sheet.obj\"");
    for (material, expected) in [
        ("d 0.4", Vec3::splat(0.6)),
        ("Tr 0.25", Vec3::splat(0.25)),
        ("d 0.5\nTf 1 0.5 0.2", vec3(0.5, 0.25, 0.1)),
        ("Tf 0.9 0.5 0.1\nillum 7", vec3(0.9, 0.5, 0.1)),
        // Opaque ones as exporters write them.
        ("Tf 1 1 1\nd 1\nillum 2", Vec3::ZERO),
        ("Tf spectral glass.rfl", Vec3::ZERO),
        ("Tr 1", Vec3::ZERO),
    ] {
        let found = of_mtl(material);
        assert!(found.abs_diff_eq(expected, 1e-5), "{material}: {found}, expected {expected}");
    }
    let keyed = |keys: &str| under(&sheet_obj("d 0.4"), &format!("file = \"sheet.obj\"\n{keys}"));
    assert!(keyed("transmission = [0.9, 0.5, 0.1]").abs_diff_eq(vec3(0.9, 0.5, 0.1), 1e-5));
    assert!(keyed("transmission = 1").abs_diff_eq(Vec3::ONE, 1e-5));
    assert_eq!(keyed("transmission = 0"), Vec3::ZERO);
    let part = "transmission = 0.5\n[[object.part]]\nname = \"pane\"\ntransmission = 0.25";
    assert!(keyed(part).abs_diff_eq(Vec3::splat(0.25), 1e-5));

    let corners = [[-3.0, 1.0, 3.0], [3.0, 1.0, 3.0], [3.0, 1.0, -3.0], [-3.0, 1.0, -3.0]];
    let of_gltf = |material: &str| {
        let text = gltf(&corners, &[[0, 1, 2], [0, 2, 3]], None, material);
        under(&[("sheet.gltf", text)], "file = \"sheet.gltf\"")
    };
    let transmission = r#"{"pbrMetallicRoughness":{"baseColorFactor":[0.8,0.4,1,1]},
        "extensions":{"KHR_materials_transmission":{"transmissionFactor":0.5}}}"#;
    assert!(of_gltf(transmission).abs_diff_eq(vec3(0.4, 0.2, 0.5), 1e-5));
    let blend = r#"{"alphaMode":"BLEND","pbrMetallicRoughness":{"baseColorFactor":[0.8,0.4,1,0.3]}}"#;
    assert!(of_gltf(blend).abs_diff_eq(Vec3::splat(0.7), 1e-5));
}

#[test]
fn a_scene_file_may_not_let_more_through_than_there_is() {
    let stage = Stage::new(&sheet_obj(""));
    for wrong in ["1.1", "-0.1", "[0.5, 0.5]", "[0.5, 2, 0]", "\"half\""] {
        let scene = format!("[[object]]\nfile = \"sheet.obj\"\ntransmission = {wrong}\n");
        let error = stage.refusal("12", &scene);
        assert!(error.contains("case.toml:3: transmission = ") && error.contains("from 0 to 1"), "{error}");
    }
}

#[test]
fn bakes_under_glass_are_those_in_the_open_dimmed() {
    // A shaft with black walls and a lid of glass under an even sky: its floor, which reflects, has τ of what
    // it has without the lid.
    let shaft = Obj::default().mesh("floor").floor(DVec3::ZERO, 2.0).mesh("walls");
    let shaft = shaft.sides(dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 1.5, 1.0), true, &[0, 1, 4, 5]).text();
    let lid = Obj::default().mesh("lid").floor(dvec3(0.0, 1.5, 0.0), 2.0).text();
    let stage = || Stage::new(&[("shaft.obj", shaft.clone()), ("lid.obj", lid.clone())]);
    let scene = |lid: &str| {
        format!(
            "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"shaft.obj\"\nalbedo = 0.5\n{lid}\
             [lightmap]\nsize = 24\n"
        )
    };
    let lid = "[[object]]\nfile = \"lid.obj\"\nalbedo = 0\ntransmission = 0.4\n";
    for integrator in INTEGRATORS {
        let stage = stage().by(integrator);
        let floor = |baked: &Baked| mean(&baked.first(), &baked.on("floor"));
        let open = stage.measure("12", 64, &scene(""), floor);
        let glazed = stage.measure("12", 64, &scene(lid), floor);
        Measured { mean: glazed.mean / 0.4, sigma: glazed.sigma / 0.4 }.agree(open, 0.01);
    }
}

#[test]
fn a_ground_is_lit_by_sun_and_sky_of_the_hour() {
    // A sheet that looks down, 1 m over nothing, has the albedo of what a sheet that looks up has; with the
    // sun or without.
    let sheets = Obj::default().mesh("up").floor(dvec3(0.0, 2.0, 0.0), 2.0);
    let sheets = sheets.mesh("down").ceiling(dvec3(5.0, 1.0, 0.0), 2.0).text();
    let stage = Stage::new(&[("sheets.obj", sheets)]);
    let place = "[place]\nlatitude = 48\nlongitude = 16\nutc_offset = 1\ndate = 2026-06-21\n";
    let object = "[[object]]\nfile = \"sheets.obj\"\nalbedo = 0\n[lightmap]\nsize = 32\n";
    let bake = |sun: &str, ground: &str| {
        stage.bake("10", 256, &format!("{place}{sun}[sky]\nmodel = \"hosek-wilkie\"\n{ground}{object}"))
    };
    for sun in ["", "[sun]\n"] {
        let baked = bake(sun, "ground = [0.1, 0.3, 0.5]\n");
        let map = baked.first();
        let light = |name: &str| {
            let texels = baked.on(name);
            texels.iter().map(|t| Vec3::from_array(map.texels[t.index])).sum::<Vec3>() / texels.len() as f32
        };
        let ratio = light("down") / light("up");
        assert!(ratio.abs_diff_eq(vec3(0.1, 0.3, 0.5), 0.01), "{sun:?}: {ratio}");
    }
    // Without a ground there is none, as before; and one that is no albedo, or of another sky, is refused.
    let dark = bake("[sun]\n", "ground = false\n");
    assert!(dark.covered("down").iter().all(|t| !t.valid || dark.first().texels[t.index] == [0.0; 3]));
    for (ground, expected) in
        [("1.2", "false, a number from 0 to 1"), ("true", "false, a number from 0 to 1")]
    {
        let scene = format!("{place}[sky]\nmodel = \"hosek-wilkie\"\nground = {ground}\n{object}");
        let error = stage.refusal("10", &scene);
        assert!(error.contains(&format!("ground = {ground}")) && error.contains(expected), "{error}");
    }
    let scene = format!("[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\nground = 0.2\n{object}");
    assert!(stage.refusal("10", &scene).contains("not a key of this sky"));
}
