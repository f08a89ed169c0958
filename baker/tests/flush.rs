//! Lamps, luminous panels and portals exactly in the plane of a ceiling, through the whole pipeline with
//! every backend that is built: the floor's light against closed forms within 1 %, and every texel's within
//! its noise.
//!
//! Which side of the ceiling's `f32` plane such a light lies on is a matter of rounding, other for each
//! height and placement of the room.

// (Not all helpers are used by every target.)
#[allow(dead_code)]
mod common;

use baker::bake::run::{Denoise, Options, bake};
use baker::light::times::schedule::parse_hours;
use baker::trace::rays::Backend;
use common::mesh::{Obj, gltf};
use common::texels::Texel;
use common::{Stage, green, texels};
use dataset::observe::Silent;
use dataset::store::Dataset;
use glam::{DVec3, dvec3};
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};

/// How the room's files are placed: their unit in metres, mirrored or not, and where.
#[derive(Clone, Copy, Debug)]
struct Placement {
    unit: f64,
    mirror: f64,
    at: DVec3,
}

impl Placement {
    /// A point of the files, for a point of the room.
    fn in_file(&self, p: DVec3) -> [f64; 3] {
        [p.x / (self.unit * self.mirror), p.y / self.unit, p.z / self.unit]
    }

    /// A point in the world, as TOML.
    fn in_world(&self, p: DVec3) -> String {
        format!("{:?}", (self.at + p).to_array())
    }

    /// The transform of an object of the scene file.
    fn object(&self) -> String {
        let Placement { unit, mirror, at } = self;
        format!("scale = [{:?}, {unit:?}, {unit:?}]\ntranslate = {:?}\n", unit * mirror, at.to_array())
    }

    /// The same scale as a node of a glTF.
    fn node(&self) -> Value {
        json!([self.unit * self.mirror, self.unit, self.unit])
    }
}

/// Four walls and a ceiling of 4 × 4 m, seen from inside, as a glTF whose node is placed; with a lamp in the
/// ceiling.
fn shell(height: f64, lamp: DVec3, placement: &Placement) -> String {
    let (low, high) = (dvec3(-2.0, 0.0, -2.0), dvec3(2.0, height, 2.0));
    let corner = |i: usize| {
        let pick = |bit: usize, axis: usize| if i >> bit & 1 == 1 { high[axis] } else { low[axis] };
        placement.in_file(dvec3(pick(0, 0), pick(1, 1), pick(2, 2))).map(|v| v as f32)
    };
    let corners: Vec<[f32; 3]> = (0..8).map(corner).collect();
    let quads = [[2, 3, 7, 6], [0, 1, 3, 2], [5, 4, 6, 7], [4, 0, 2, 6], [1, 5, 7, 3]];
    // (In the file's mirrored space the winding turns; a mirroring node turns it back.)
    let triangles: Vec<[u32; 3]> = quads
        .iter()
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
        .map(|[a, b, c]| if placement.mirror < 0.0 { [a, c, b] } else { [a, b, c] })
        .collect();
    let mut asset: Value = serde_json::from_str(&gltf(&corners, &triangles, None, "{}")).unwrap();
    asset["nodes"] = json!([
        { "name": "shell", "mesh": 0 },
        { "name": "file", "translation": placement.in_file(lamp), "extensions": { "KHR_lights_punctual": { "light": 0 } } },
        { "name": "all", "children": [0, 1], "scale": placement.node() },
    ]);
    asset["scenes"][0]["nodes"] = json!([2]);
    asset["extensions"] =
        json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 1000 }] } });
    asset.to_string()
}

/// Irradiance per unit of radiance at a point of the floor from patches of area `area` that look down.
fn looking_down(points: &[DVec3], area: f64, p: DVec3) -> f64 {
    points.iter().map(|q| (*q - p).y.powi(2) / (*q - p).length_squared().powi(2)).sum::<f64>() * area
}

/// The middles of the cells of a level rectangle.
fn rectangle(corner: DVec3, x: f64, z: f64) -> Vec<DVec3> {
    const N: usize = 8;
    let middle = |i: usize| (i as f64 + 0.5) / N as f64;
    (0..N * N).map(|i| corner + dvec3(middle(i % N) * x, 0.0, middle(i / N) * z)).collect()
}

/// Points of a level disc, each of the same area.
fn disc(centre: DVec3, radius: f64) -> Vec<DVec3> {
    const N: usize = 8;
    let point = |i: usize| {
        let (r, phi) = (radius * (((i % N) as f64 + 0.5) / N as f64).sqrt(), TAU * (i / N) as f64 / N as f64);
        centre + dvec3(r * phi.cos(), 0.0, r * phi.sin())
    };
    (0..N * N).map(point).collect()
}

/// Bakes a scene file with a backend; gives the dataset and the floor's whole texels.
fn floor_of(stage: &Stage, backend: Backend, samples: u32, scene: &str) -> (Dataset, Vec<Texel>) {
    stage.write(
        "case.toml",
        format!("{scene}[lightmap]\nsize = 24\n[bake]\nsamples = {samples}\n").as_bytes(),
    );
    let out = stage.path("out");
    let options = Options {
        extra_times: 0,
        backend,
        denoise: Denoise::Off,
        out: Some(out.clone()),
        force: true,
        ..Options::new(parse_hours("12").expect("hours"))
    };
    bake(&stage.path("case.toml"), &options, &Silent).unwrap_or_else(|error| panic!("{error}"));
    let dataset = Dataset::open(&out).expect("a dataset");
    let mask = dataset.mask(0).expect("a mask");
    let floor =
        texels::of(&dataset, &mask).into_iter().filter(|t| t.whole && t.valid && t.name.contains("floor"));
    let floor: Vec<Texel> = floor.collect();
    assert!(floor.len() > 200, "{}", floor.len());
    (dataset, floor)
}

#[test]
fn lamps_in_the_plane_of_a_ceiling_light_the_room() {
    let placements = [
        Placement { unit: 1.0, mirror: 1.0, at: DVec3::ZERO },
        Placement { unit: 0.01, mirror: -1.0, at: dvec3(0.1, 0.7, 0.3) },
        Placement { unit: 0.3048, mirror: 1.0, at: dvec3(1e6, 12.3, -1e6) },
    ];
    for (i, height) in [2.4, 2.5, 2.65, 2.7, 3.0, 3.2].into_iter().enumerate() {
        for placement in [placements[0], placements[1 + i % 2]] {
            for backend in Backend::built() {
                room(height, placement, backend);
            }
        }
    }
}

/// All kinds of lamps in the ceiling of a black room, each a light group.
fn room(height: f64, placement: Placement, backend: Backend) {
    let up = dvec3(0.0, height, 0.0);
    // Where the lamps are.
    let (point, file, ball) =
        (up + dvec3(0.3, 0.0, 0.2), up + dvec3(-0.7, 0.0, 0.6), up + dvec3(0.9, 0.0, -0.4));
    let (corner, centre) = (up + dvec3(0.1, 0.0, -0.1), up + dvec3(-0.6, 0.0, -0.8));
    let hanging = up + dvec3(-1.2, -0.05, 0.1);
    let panel = up + dvec3(-1.5, 0.0, -1.5);
    let files = Obj::default().mesh("floor").floor(DVec3::ZERO, 4.0).text();
    let in_file = |p: DVec3| DVec3::from_array(placement.in_file(p));
    let edge = |v: DVec3| in_file(v) - in_file(DVec3::ZERO);
    let (x, z) = (edge(DVec3::X * 0.4), edge(DVec3::Z * 0.4));
    let (u, v) = if placement.mirror > 0.0 { (x, z) } else { (z, x) };
    let panel_file = Obj::default().mesh("panel").quad(in_file(panel), u, v).text();
    let stage = Stage::new(&[
        ("floor.obj", files),
        ("panel.obj", panel_file),
        ("shell.gltf", shell(height, file, &placement)),
        (
            "lamp.ies",
            "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 9\n0 180\n0\n500 500\n".to_owned(),
        ),
    ]);
    let object = placement.object();
    let at = |p: DVec3| placement.in_world(p);
    let scene = format!(
        "[[object]]\nfile = \"floor.obj\"\nalbedo = 0\ntranslate = {}\n\
         [[object]]\nfile = \"shell.gltf\"\nalbedo = 0\nlightmap = false\ntranslate = {}\n\
         [[object]]\nfile = \"panel.obj\"\nalbedo = 0\nlightmap = false\nemission = [4, 4, 4]\ngroup = \"panel\"\n{object}\
         [[group]]\nname = \"panel\"\n\
         [[group]]\nname = \"file\"\n\
         [[group]]\nname = \"point\"\n[[group.point]]\nposition = {}\nintensity = [2, 2, 2]\n\
         [[group]]\nname = \"spot\"\n[[group.spot]]\nposition = {}\ndirection = [0, -1, 0]\ninner = 75\nouter = 80\nintensity = [3, 3, 3]\n\
         [[group]]\nname = \"ies\"\n[[group.point]]\nposition = {}\nies = \"lamp.ies\"\n\
         [[group]]\nname = \"rectangle\"\n[[group.rectangle]]\ncorner = {}\nedge_u = [0.4, 0, 0]\nedge_v = [0, 0, 0.2]\nradiance = [25, 25, 25]\n\
         [[group]]\nname = \"disc\"\n[[group.disc]]\ncentre = {}\ndirection = [0, -1, 0]\nradius = 0.15\nradiance = [7, 7, 7]\n\
         [[group]]\nname = \"ball\"\n[[group.sphere]]\ncentre = {}\nradius = 1e-3\nradiance = [1e5, 1e5, 1e5]\n\
         [[group]]\nname = \"hanging\"\n[[group.sphere]]\ncentre = {}\nradius = 0.05\nradiance = [50, 50, 50]\n",
        at(DVec3::ZERO),
        at(DVec3::ZERO),
        at(point),
        at(point),
        at(point),
        at(corner),
        at(centre),
        at(ball),
        at(hanging),
    );
    let (dataset, floor) = floor_of(&stage, backend, 16, &scene);
    let (rectangle, disc) = (rectangle(corner, 0.4, 0.2), disc(centre, 0.15));
    let panel = self::rectangle(panel, 0.4, 0.4);
    let from_point = |lamp: DVec3, p: DVec3| (lamp - p).y / (lamp - p).length().powi(3);
    let group = |name: &str, p: DVec3| match name {
        "point" => 2.0 * from_point(point, p),
        "spot" => 3.0 * from_point(point, p),
        "ies" => 0.5 * from_point(point, p),
        "file" => from_point(file, p),
        "rectangle" => 25.0 * looking_down(&rectangle, 0.08 / 64.0, p),
        "disc" => 7.0 * looking_down(&disc, PI * 0.15 * 0.15 / 64.0, p),
        "panel" => 4.0 * looking_down(&panel, 0.16 / 64.0, p),
        // The half below the ceiling, as seen from the side.
        "ball" => {
            let cosine = (ball - p).normalize().y;
            1e5 * PI * 1e-6 * 0.5 * (1.0 + cosine) * from_point(ball, p)
        }
        "hanging" => 50.0 * PI * 0.05 * 0.05 * from_point(hanging, p),
        name => panic!("{name}"),
    };
    let groups = &dataset.config.groups;
    assert_eq!(groups.len(), 9);
    for (index, g) in groups.iter().enumerate() {
        let image =
            dataset.light(dataset::format::Light::Group, Some(index as u32), 0, 0).expect("its light");
        let (mut light, mut expected) = (0.0, 0.0);
        for texel in &floor {
            let (found, right) = (green(&image, texel), texel.average(|p| group(&g.name, p - placement.at)));
            // (Of a few samples.)
            let noise = if g.name == "ball" { 0.8 } else { 0.25 };
            let place = || format!("{height} {placement:?} {backend:?} {} at {}", g.name, texel.centre());
            assert!((found / right - 1.0).abs() < noise, "{}: {found}, expected {right}", place());
            (light, expected) = (light + found, expected + right);
        }
        let ratio = light / expected;
        assert!((ratio - 1.0).abs() < 0.01, "{height} {placement:?} {backend:?} {}: {ratio}", g.name);
    }
}

#[test]
fn a_portal_in_the_plane_of_a_ceiling_lets_the_sky_in() {
    // A sheet with a hole of 1 × 1 m, which the portal covers.
    for height in [2.4, 2.65, 3.2] {
        let part = |x: f64, z: f64, dx: f64, dz: f64| (dvec3(x, height, z), DVec3::X * dx, DVec3::Z * dz);
        let parts = [
            part(-9.0, -9.0, 18.0, 8.5),
            part(-9.0, 0.5, 18.0, 8.5),
            part(-9.0, -0.5, 8.5, 1.0),
            part(0.5, -0.5, 8.5, 1.0),
        ];
        let sheet = parts.into_iter().fold(Obj::default().mesh("sheet"), |obj, (p, u, v)| obj.quad(p, u, v));
        let walls = sheet.sides(dvec3(-9.0, 0.0, -9.0), dvec3(9.0, height, 9.0), true, &[0, 1, 4, 5]);
        let stage = Stage::new(&[
            ("floor.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 4.0).text()),
            ("sheet.obj", walls.text()),
        ]);
        let scene = format!(
            "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n\
             [[object]]\nfile = \"floor.obj\"\nalbedo = 0\n\
             [[object]]\nfile = \"sheet.obj\"\nalbedo = 0\nlightmap = false\n\
             [[portal]]\ncorner = [-0.5, {height:?}, -0.5]\nedge_u = [1, 0, 0]\nedge_v = [0, 0, 1]\n"
        );
        let hole = rectangle(dvec3(-0.5, height, -0.5), 1.0, 1.0);
        for backend in Backend::built() {
            let (dataset, floor) = floor_of(&stage, backend, 64, &scene);
            let image = dataset.map(0, 0).expect("a map");
            let light: f64 = floor.iter().map(|t| green(&image, t)).sum();
            let expected: f64 = floor.iter().map(|t| t.average(|p| looking_down(&hole, 1.0 / 64.0, p))).sum();
            assert!((light / expected - 1.0).abs() < 0.01, "{height} {backend:?}: {}", light / expected);
        }
    }
}

#[test]
fn emissive_faces_in_one_place_shine_once() {
    // A panel that looks down; the same with other texture coordinates; a half of it; and one turned up.
    let corners =
        |x: f64| [dvec3(0.0, 1.5, 0.0), dvec3(x, 1.5, 0.0), dvec3(x, 1.5, 0.4), dvec3(0.0, 1.5, 0.4)];
    let mut turned = corners(0.4);
    turned.reverse();
    let uvs = |at: f64| [[at, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let panel = || Obj::default().mesh("panel").textured(&corners(0.4), &uvs(0.0));
    let more = [
        panel(),
        (0..9).fold(panel(), |obj, i| obj.textured(&corners(0.4), &uvs(f64::from(i) / 9.0))),
        panel().mesh("half").textured(&corners(0.2), &uvs(0.0)),
        panel().mesh("up").textured(&turned, &uvs(0.0)),
    ];
    let panel = rectangle(dvec3(0.0, 1.5, 0.0), 0.4, 0.4);
    for (i, obj) in more.into_iter().enumerate() {
        let floor = Obj::default().mesh("floor").floor(DVec3::ZERO, 4.0).text();
        let stage = Stage::new(&[("floor.obj", floor), ("panel.obj", obj.text())]);
        let scene = "[[object]]\nfile = \"floor.obj\"\nalbedo = 0\n\
                     [[object]]\nfile = \"panel.obj\"\nalbedo = 0\nlightmap = false\nemission = [4, 4, 4]\ngroup = \"panel\"\n\
                     [[group]]\nname = \"panel\"\n";
        for backend in Backend::built() {
            let (dataset, floor) = floor_of(&stage, backend, 16, scene);
            let image = dataset.map(0, 0).expect("a map");
            let light: f64 = floor.iter().map(|t| green(&image, t)).sum();
            let expected: f64 =
                floor.iter().map(|t| t.average(|p| 4.0 * looking_down(&panel, 0.16 / 64.0, p))).sum();
            assert!((light / expected - 1.0).abs() < 0.01, "{i} {backend:?}: {}", light / expected);
        }
    }
}
