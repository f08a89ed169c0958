//! Cut-outs, sides, textures and instances, at named texels.

use crate::common::closed::level_rectangle;
use crate::common::mesh::{Obj, gltf, png};
use crate::common::{Baked, INTEGRATORS, Stage, green, mean};
use glam::{DVec3, dvec3};
use std::f64::consts::PI;

const SKY: &str = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n";
const SUN: &str =
    "[sun]\ndisc_angle = 0\ntrack = [{ hour = 0, direction = [0, 1, 0], irradiance = [10, 10, 10] }]\n";

/// `count` level squares of side 2, 1 mm apart from 0.1 m up, with a material of their own.
fn layers(count: usize, material: &str) -> String {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..count {
        let y = 0.1 + 1e-3 * i as f32;
        let first = positions.len() as u32;
        positions.extend([[-1.0, y, 1.0], [1.0, y, 1.0], [1.0, y, -1.0], [-1.0, y, -1.0]]);
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    gltf(&positions, &triangles, None, material)
}

/// A material that is a cut-out with this alpha everywhere.
fn cut_out(alpha: &str, cutoff: &str) -> String {
    format!(
        r#"{{"alphaMode":"MASK","alphaCutoff":{cutoff},"doubleSided":true,
            "pbrMetallicRoughness":{{"baseColorFactor":[0,0,0,{alpha}]}}}}"#
    )
}

/// The floor's light under a stack of layers, in the sun straight above.
fn under(stack: String) -> f64 {
    let floor = Obj::default().mesh("floor").floor(DVec3::ZERO, 0.5).text();
    let stage = Stage::new(&[("a.obj", floor), ("stack.gltf", stack)]);
    let scene = format!(
        "{SUN}[[object]]\nfile = \"a.obj\"\n[[object]]\nfile = \"stack.gltf\"\nlightmap = false\n[lightmap]\nsize = 8\n"
    );
    let baked = stage.bake("12", 4, &scene);
    let texels: Vec<_> = baked.covered("floor").into_iter().filter(|t| t.whole).collect();
    mean(&baked.first(), &texels)
}

#[test]
fn two_hundred_open_cut_outs_let_everything_through() {
    assert!((under(layers(200, &cut_out("0.2", "0.5"))) / 10.0 - 1.0).abs() < 1e-6);
    assert_eq!(under(layers(200, &cut_out("0.8", "0.5"))), 0.0);
}

#[test]
fn one_solid_layer_among_two_hundred_open_ones_blocks() {
    // The solid one stands in the middle of the stack; two-sided, for under a wide one-sided sheet would be
    // inside a solid.
    let solid = Obj::default().mesh("solid").floor(dvec3(0.0, 0.2005, 0.0), 2.0).text();
    let floor = Obj::default().mesh("floor").floor(DVec3::ZERO, 0.5).text();
    let stage = Stage::new(&[
        ("a.obj", floor),
        ("solid.obj", solid),
        ("stack.gltf", layers(200, &cut_out("0.2", "0.5"))),
    ]);
    let scene = format!(
        "{SUN}{SKY}[[object]]\nfile = \"a.obj\"\n[[object]]\nfile = \"stack.gltf\"\nlightmap = false\n\
         [[object]]\nfile = \"solid.obj\"\nlightmap = false\ntwo_sided = true\n[lightmap]\nsize = 8\n"
    );
    let baked = stage.bake("12", 16, &scene);
    let light = mean(&baked.first(), &baked.on("floor"));
    // Some sky comes in below the sheet; no sun.
    assert!(light > 0.0 && light < PI, "{light}");
}

#[test]
fn an_alpha_exactly_at_its_cutoff_is_solid() {
    // glTF: rendered where alpha ≥ cutoff.
    assert_eq!(under(layers(1, &cut_out("0.5", "0.5"))), 0.0);
    assert!((under(layers(1, &cut_out("0.49999997", "0.5"))) / 10.0 - 1.0).abs() < 1e-6);
    // The ends of the range: 0 is solid everywhere, 1 where alpha is 1.
    assert_eq!(under(layers(1, &cut_out("0", "0"))), 0.0);
    assert_eq!(under(layers(1, &cut_out("1", "1"))), 0.0);
    assert!((under(layers(1, &cut_out("1", "1.5"))) / 10.0 - 1.0).abs() < 1e-6);
}

#[test]
fn a_cut_outs_hole_throws_a_spot_of_sun_on_its_texels() {
    // A sheet of side 2 whose texture is open in its right half: the sun reaches the floor's right half only.
    let corners =
        |y: f64| [dvec3(-1.0, y, 1.0), dvec3(1.0, y, 1.0), dvec3(1.0, y, -1.0), dvec3(-1.0, y, -1.0)];
    let obj =
        Obj::default().library("a.mtl").mesh("floor").floor(DVec3::ZERO, 1.8).mesh("sheet").material("holed");
    let obj = obj.textured(&corners(0.5), &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let mtl = "newmtl holed\nKd 1 1 1\nmap_Kd -clamp on holed.png\nmap_d -clamp on holed.png\n".to_owned();
    let stage = Stage::new(&[("a.obj", obj.text()), ("a.mtl", mtl)]);
    stage.write("holed.png", &png(&[[255, 255, 255, 255], [255, 255, 255, 0]]));
    let scene = format!(
        "{SUN}[[object]]\nfile = \"a.obj\"\n[[object.part]]\nname = \"sheet\"\nlightmap = false\n[lightmap]\nsize = 32\n\
         [bake]\nbounces = 0\n"
    );
    let baked = stage.bake("12", 16, &scene);
    let image = baked.first();
    let (mut open, mut shut) = (0, 0);
    for texel in baked.covered("floor").into_iter().filter(|t| t.whole) {
        // Alpha falls from 1 to 0 between the centres of the two texels, through ½ in the middle.
        let (x, light) = (texel.centre().x, green(&image, texel));
        if x > texel.size() {
            assert!(texel.valid && (light / 10.0 - 1.0).abs() < 1e-5, "{texel:?}: {light}");
            open += 1;
        } else if x < -texel.size() {
            assert!(!texel.valid || light == 0.0, "{texel:?}: {light}");
            shut += 1;
        }
    }
    assert!(open > 100 && shut > 100, "{open} {shut}");
}

/// A black floor of 5 mm under a sheet of 40 × 40 cm, 10 cm up, whose front looks up; the sky is even all
/// around.
fn under_a_sheet(look: &str, sheet: impl Fn(Obj) -> Obj, mtl: &str) -> Stage {
    let obj = Obj::default().library("a.mtl").mesh("floor").floor(DVec3::ZERO, 0.005).mesh("sheet");
    let stage = Stage::new(&[("a.obj", sheet(obj).text()), ("a.mtl", mtl.to_owned())]);
    stage.write(
        "scene.txt",
        format!(
            "{SKY}[[object]]\nfile = \"a.obj\"\n[[object.part]]\nname = \"floor\"\nalbedo = 0\n[[object.part]]\nname = \"sheet\"\n\
             lightmap = false\n{look}\n[lightmap]\nsize = 4\n[bake]\nbounces = 1\n"
        )
        .as_bytes(),
    );
    stage
}

fn channels(baked: &Baked) -> [f64; 3] {
    let image = baked.first();
    let texels: Vec<_> = baked.texels.iter().filter(|t| t.valid).collect();
    assert!(!texels.is_empty(), "{:?}", baked.outcome.facts);
    [0, 1, 2].map(|c| {
        texels.iter().map(|t| f64::from(image.texels[t.index][c])).sum::<f64>() / texels.len() as f64
    })
}

#[test]
fn the_back_of_a_one_sided_sheet_absorbs_and_a_two_sided_one_reflects() {
    // The sheet fills F of the floor's sky; its underside, lit by the sky below with π, shows ρ.
    let f = level_rectangle(-0.2, 0.2, -0.2, 0.2, 0.1);
    for (look, reflected) in [("two_sided = false", 0.0), ("two_sided = true", 0.5)] {
        let stage = under_a_sheet(look, |obj| obj.floor(dvec3(0.0, 0.1, 0.0), 0.4), "");
        let scene = std::fs::read_to_string(stage.path("scene.txt")).unwrap();
        let exact = PI * (1.0 - f + reflected * f);
        stage.measure("12", 256, &scene, |b| channels(b)[1]).expect(exact, 0.01);
    }
}

#[test]
fn a_texture_colours_the_light_below_it() {
    // Left half red, right half green at half brightness (sRGB 188 is 0.5 linear): a floor below the left
    // quarter sees more of the red half, and of each exactly its rectangle's share.
    let corners =
        [dvec3(-0.2, 0.1, 0.2), dvec3(0.2, 0.1, 0.2), dvec3(0.2, 0.1, -0.2), dvec3(-0.2, 0.1, -0.2)]
            .map(|p| p + DVec3::X * 0.1);
    let mtl = "newmtl red-green\nKd 1 1 1\nmap_Kd -clamp on red-green.png\n";
    let uvs = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let stage =
        under_a_sheet("two_sided = true", |obj| obj.material("red-green").textured(&corners, &uvs), mtl);
    // Many texels, so that the blend between the halves is narrow.
    let row: Vec<[u8; 4]> =
        (0..256).map(|i| if i < 128 { [255, 0, 0, 255] } else { [0, 188, 0, 255] }).collect();
    stage.write("red-green.png", &png(&row));
    let scene = std::fs::read_to_string(stage.path("scene.txt")).unwrap() + "albedo_max = 1\n";
    let half = f64::from(188u8) / 255.0;
    let green_albedo = ((half + 0.055) / 1.055).powf(2.4);
    let (left, right) =
        (level_rectangle(-0.1, 0.1, -0.2, 0.2, 0.1), level_rectangle(0.1, 0.3, -0.2, 0.2, 0.1));
    let open = 1.0 - left - right;
    for (channel, exact) in [(0, open + left), (1, open + green_albedo * right), (2, open)] {
        stage.measure("12", 256, &scene, |b| channels(b)[channel]).expect(PI * exact, 0.01);
    }
}

/// A lopsided body: a block with a fin, so that mirror images differ. Corners as the transform puts them.
fn body(obj: Obj, place: impl Fn(DVec3) -> DVec3, mirrored: bool) -> Obj {
    let (low, high) = (dvec3(0.1, 0.0, -0.3), dvec3(0.5, 0.6, 0.3));
    let mut out = obj;
    for axis in 0..3 {
        for upper in [false, true] {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut corners = [(false, false), (true, false), (true, true), (false, true)].map(|(a, b)| {
                let mut p = low;
                p[axis] = if upper { high[axis] } else { low[axis] };
                p[u] = if a { high[u] } else { low[u] };
                p[v] = if b { high[v] } else { low[v] };
                place(p)
            });
            if upper == mirrored {
                corners.reverse();
            }
            out = out.polygon(&corners);
        }
    }
    out
}

#[test]
fn mirrored_and_stretched_instances_have_the_light_of_explicit_geometry() {
    let lights = format!(
        "{SKY}[sun]\ntrack = [{{ hour = 12, direction = [1, 2, 0.7], irradiance = [10, 10, 10] }}]\n[[group]]\n\
         name = \"lamp\"\n[[group.sphere]]\ncentre = [-0.5, 1.5, 1.2]\nradius = 0.1\nradiance = [30, 30, 30]\n\
         [lightmap]\nsize = 64\n"
    );
    let (lights_before, lights_after) = lights.split_once("[[group]]").unwrap();
    for (scale, mirrored) in [
        ([-1.0, 1.0, 1.0], true),
        ([-1.5, 1.0, -0.5], false),
        ([2.0, 0.5, 1.0], false),
        ([1.0, 1.3, -2.0], true),
    ] {
        let factor = DVec3::from(scale);
        let files = |text: String| {
            Stage::new(&[
                ("floor.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 3.0).text()),
                ("body.obj", text),
            ])
        };
        let scene = |extra: &str| {
            format!(
                "{lights_before}[[object]]\nfile = \"floor.obj\"\n[[object]]\nfile = \"body.obj\"\n{extra}\n\
                 [[group]]{lights_after}"
            )
        };
        let instanced = files(body(Obj::default().mesh("body"), |p| p, false).text());
        let explicit = files(body(Obj::default().mesh("body"), |p| p * factor, mirrored).text());
        // The light on the floor, and on the body's sides that look to +x and to +z.
        let sides = [("floor", DVec3::Y), ("body", DVec3::X), ("body", DVec3::Z)];
        let read = |b: &Baked| {
            let image = b.first();
            sides.map(|(name, normal)| {
                let facing: Vec<_> = b.on(name).into_iter().filter(|t| t.normal.dot(normal) > 0.99).collect();
                mean(&image, &facing)
            })
        };
        let a = instanced.measure_each("12", 16, &scene(&format!("scale = {scale:?}")), read);
        let b = explicit.measure_each("12", 16, &scene(""), read);
        for (((name, _), a), b) in sides.into_iter().zip(a).zip(b) {
            // The charts lie elsewhere on the page, so the texels' means differ by what the grids cut off.
            assert!(
                (a.mean / b.mean - 1.0).abs() < 0.01 + 3.2 * (a.sigma + b.sigma) / b.mean,
                "{scale:?} {name}: {a:?} {b:?}"
            );
        }
    }
}

#[test]
fn instances_stand_in_light_of_their_own() {
    // Three floors from one file: in the open, under a roof, and mirrored in the open.
    let obj = Obj::default().mesh("tile").floor(DVec3::ZERO, 1.0).text();
    let roof = Obj::default().mesh("roof").block(dvec3(4.0, 0.5, -1.0), dvec3(6.0, 0.6, 1.0)).text();
    let stage = Stage::new(&[("tile.obj", obj), ("roof.obj", roof)]);
    let scene = format!(
        "{SUN}{SKY}[[object]]\nfile = \"tile.obj\"\ninstances = [{{ }}, {{ translate = [5, 0, 0] }}, \
         {{ translate = [-5, 0, 0], scale = [-1, 1, 1] }}]\n[[object]]\nfile = \"roof.obj\"\nlightmap = false\n\
         [lightmap]\nsize = 64\n"
    );
    let baked = stage.bake("12", 64, &scene);
    let image = baked.first();
    for name in ["tile #0", "tile #2"] {
        for texel in baked.on(name) {
            // The roof takes a little of the sky.
            let light = green(&image, texel);
            assert!(light < 10.0 + PI + 1e-3 && light > 10.0 + 0.97 * PI, "{texel:?}: {light}");
        }
    }
    for texel in baked.on("tile #1") {
        let light = green(&image, texel);
        assert!(light > 0.0 && light < 0.8 * PI, "{texel:?}: {light}");
    }
}

#[test]
fn what_a_surface_sends_out_goes_by_the_normals_its_texels_show() {
    // A floor whose smooth normals lean 30° towards a sun 60° high gets all of its light, not 0.87; a black
    // ceiling beside its way sees that, be the floor traced or read from the cache, by texels or by patches.
    let (c, s) = (0.75f64.sqrt(), 0.5);
    let floor =
        format!("o floor\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvn {s} {c} 0\nf 1//1 2//1 3//1 4//1\n");
    let ceiling = Obj::default().mesh("ceiling").ceiling(dvec3(-0.9, 1.0, 0.0), 0.2).text();
    let stage = || Stage::new(&[("a.obj", floor.clone()), ("b.obj", ceiling.clone())]);
    for integrator in INTEGRATORS {
        for has_texels in [true, false] {
            let scene = format!(
                "[sun]\ndisc_angle = 0\ntrack = [{{ hour = 0, direction = [{s}, {c}, 0], irradiance = [10, 10, 10] }}]\n\
                 [[object]]\nfile = \"a.obj\"\nalbedo = 0.5\nlightmap = {has_texels}\n[[object]]\nfile = \"b.obj\"\nalbedo = 0\n\
                 density = 4\n[lightmap]\nsize = 64\n"
            );
            let seen = |p: DVec3| level_rectangle(-1.0 - p.x, 1.0 - p.x, -1.0 - p.z, 1.0 - p.z, 1.0);
            let read =
                |b: &Baked| b.ratio(&b.first(), &b.on("ceiling"), |t| t.average(|p| 0.5 * 10.0 * seen(p)));
            stage().by(integrator).measure("12", 64, &scene, read).expect(1.0, 0.005);
        }
    }
}
