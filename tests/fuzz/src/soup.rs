//! Scenes that no modeller would make, baked from end to end: slivers, points, coincident and inside-out
//! triangles, sizes from 1e-12 to 1e9 m, coordinates and normals without meaning, flattened nodes. A bake
//! ends in a sound dataset or in an error that says what is wrong. Used by libFuzzer and by the ordinary test
//! `soup`.

use baker::bake::forecast::LayoutEstimate;
use baker::bake::forecast::forecast;
use baker::bake::run::{Integrator, Options, bake, prepare};
use baker::light::times::schedule::parse_hours;
use baker::preview;
use dataset::Error;
use dataset::observe::Silent;
use dataset::store::Dataset;
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Bakes the scene that the bytes choose; whether the bake was accepted.
pub fn soup(scratch: &Path, bytes: &[u8]) -> bool {
    let folder = scratch.join("soup");
    drop(fs::remove_dir_all(&folder));
    fs::create_dir_all(&folder).expect("a folder");
    let mut choices = Choices { bytes, at: 0 };
    let meshes: Vec<Mesh> = (0..1 + choices.below(3)).map(|_| mesh(&mut choices)).collect();
    let model = if choices.one_in(3) { obj(&folder, &meshes) } else { gltf(&folder, &meshes, &mut choices) };
    fs::write(folder.join("soup.toml"), scene(model, &mut choices)).expect("a file");
    let integrator = if choices.one_in(3) { Integrator::Path } else { Integrator::Cached };
    let hours = parse_hours(if choices.one_in(4) { "12,18" } else { "12" }).expect("hours");
    let out = folder.join("set");
    let options = Options { integrator, out: Some(out.clone()), force: true, ..Options::new(hours) };
    let (scene, console) = (folder.join("soup.toml"), Silent);
    let planned = choices.one_in(4).then(|| {
        prepare(&scene, &options, &console)
            .and_then(|p| {
                let (atlas, rays) = p.atlas()?;
                Ok(forecast(&p, &LayoutEstimate::exact(atlas, rays)).is_ok())
            })
            .is_ok()
    });
    match bake(&scene, &options, &console) {
        Ok(outcome) => {
            assert!(planned.is_none_or(|planned| planned), "the plan was refused, the bake was not");
            assert!(outcome.relative_error.is_finite() && outcome.relative_error >= 0.0);
            sound(&out);
            if choices.one_in(3) {
                shown(&scene, &out, choices.of(&[1, 3]));
            }
            true
        }
        Err(Error::Invalid { place, what } | Error::Unsupported { place, what }) => {
            assert!(!place.is_empty() && !what.is_empty());
            false
        }
        Err(other) => panic!("{other}"),
    }
}

/// A picture of the dataset is drawn, or the error says why there is none.
fn shown(scene: &Path, out: &Path, samples: u32) {
    let options = preview::options::Options {
        dataset: Some(out.to_owned()),
        out: Some(out.join("picture.png")),
        size: [16, 9],
        samples,
        ..preview::options::Options::new(12.5)
    };
    match preview::run::preview(scene, &options, &Silent) {
        Ok(told) => assert!(told["exposure"].as_f64().is_some_and(f64::is_finite), "{told}"),
        Err(Error::Invalid { place, what } | Error::Unsupported { place, what }) => {
            assert!(!place.is_empty() && !what.is_empty());
        }
        Err(other) => panic!("{other}"),
    }
}

/// Every image of a dataset is finite and not negative, and the whole of it keeps its rules.
fn sound(folder: &Path) {
    let dataset = Dataset::open(folder).expect("a dataset");
    for set in 0..dataset.config.frames.len() {
        for page in 0..dataset.config.pages.len() {
            let map = dataset.map(set, page).expect("a map");
            assert!(map.texels.as_flattened().iter().all(|value| value.is_finite() && *value >= 0.0));
        }
    }
    let faults = dataset.verify(|| ()).faults;
    assert!(faults.is_empty(), "{faults:?}");
}

/// Numbers drawn from bytes; when those end, from a hash of them.
struct Choices<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Choices<'_> {
    fn byte(&mut self) -> u8 {
        self.at += 1;
        if let Some(&byte) = self.bytes.get(self.at - 1) {
            return byte;
        }
        // SplitMix64's finaliser.
        let seed = self.bytes.iter().fold(7u64, |h, &b| h.wrapping_mul(0x0100_0000_01b3) ^ u64::from(b));
        let mut z = seed.wrapping_add((self.at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z >> 56) as u8
    }

    fn below(&mut self, n: usize) -> usize {
        usize::from(self.byte()) % n
    }

    fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }

    /// From −1 to 1, often a multiple of a quarter, so that places meet.
    fn unit(&mut self) -> f64 {
        let fine = u16::from_le_bytes([self.byte(), self.byte()]);
        if self.one_in(3) { f64::from(fine % 9) / 4.0 - 1.0 } else { f64::from(fine) / 32767.5 - 1.0 }
    }

    fn place(&mut self) -> [f64; 3] {
        [self.unit(), self.unit(), self.unit()]
    }
}

/// Triangles of one material, and what they say of themselves.
struct Mesh {
    corners: Vec<[f64; 3]>,
    triangles: Vec<[usize; 3]>,
    normals: Option<Vec<[f64; 3]>>,
    uvs: Option<Vec<[f64; 2]>>,
    lightmap_uvs: Option<Vec<[f64; 2]>>,
    albedo: f64,
    two_sided: bool,
}

fn mesh(choices: &mut Choices) -> Mesh {
    let (mut corners, mut triangles): (Vec<[f64; 3]>, Vec<[usize; 3]>) = (Vec::new(), Vec::new());
    let scale = choices.of(&[1.0, 1.0, 1.0, 1.0, 1e-3, 1e-6, 1e3, 1e6]);
    let offset = choices.of(&[0.0, 0.0, 0.0, 1.0, 1e3, 1e6]);
    for _ in 0..1 + choices.below(20) {
        let last = triangles.last().copied();
        let a = choices.place();
        let kind = choices.below(14);
        let along = match kind {
            8 => choices.place().map(|x| x * 1e6),
            9 => choices.place().map(|x| x * 1e-12),
            _ => choices.place(),
        };
        let plus = |t: f64, v: [f64; 3], s: f64| std::array::from_fn(|k| a[k] + t * along[k] + s * v[k]);
        let across = choices.place();
        let put = |corners: &mut Vec<[f64; 3]>, new: [[f64; 3]; 3]| {
            corners.extend(new.map(|c: [f64; 3]| c.map(|x| x * scale + offset)));
            [3, 2, 1].map(|back| corners.len() - back)
        };
        match (kind, last) {
            // A sliver.
            (0 | 1, _) => {
                let width = 10f64.powi(-(choices.below(13) as i32));
                let t = choices.of(&[0.0, 0.25, 0.5, 0.999, 1.0]);
                triangles.push(put(&mut corners, [a, plus(1.0, across, 0.0), plus(t, across, width)]));
            }
            // A line, a point.
            (2, _) => triangles.push(put(
                &mut corners,
                [a, plus(1.0, across, 0.0), plus(choices.of(&[0.25, 0.5, 2.0, -1.0]), across, 0.0)],
            )),
            (3, _) => triangles.push(put(&mut corners, [a, a, a])),
            // The last one again, the other way round, with its own vertices or not.
            (4, Some(last)) => triangles.push(last),
            (5, Some([a, b, c])) => triangles.push([a, c, b]),
            (6, Some([a, b, c])) => {
                let first = corners.len();
                corners.extend([a, c, b].map(|v| corners[v]));
                triangles.push([first, first + 1, first + 2]);
            }
            // A fan about a corner of the last one.
            (7, Some([a, b, _])) => {
                corners.push(across.map(|x| x * scale + offset));
                triangles.push([a, b, corners.len() - 1]);
            }
            // A closed box, seen from outside or from inside.
            (10 | 11, _) => {
                let first = corners.len();
                let side = choices.of(&[1e-9, 0.1, 0.5, 0.5]);
                let corner = |i: usize, k: usize| a[k] + side * (((i >> k) & 1) as f64 * 2.0 - 1.0);
                corners.extend((0..8).map(|i| [0, 1, 2].map(|k| corner(i, k) * scale + offset)));
                let faces =
                    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
                for [p, q, r, s] in faces {
                    for [p, q, r] in [[p, q, r], [p, r, s]] {
                        let [q, r] = if kind == 10 { [q, r] } else { [r, q] };
                        triangles.push([first + p, first + q, first + r]);
                    }
                }
            }
            _ => triangles.push(put(&mut corners, [a, plus(1.0, across, 0.0), plus(0.0, across, 1.0)])),
        }
    }
    if choices.one_in(40) {
        let (at, axis) = (choices.below(corners.len()), choices.below(3));
        corners[at][axis] = choices.of(&[f64::NAN, f64::INFINITY, 1e39]);
    }
    let n = corners.len();
    let bad = choices.one_in(40);
    let normals = match choices.below(5) {
        0 => Some(vec![[0.0; 3]; n]),
        1 => Some((0..n).map(|_| choices.place()).collect()),
        2 => Some(vec![if bad { [f64::NAN; 3] } else { [0.0, 1e-30, 0.0] }; n]),
        _ => None,
    };
    let coordinates = |choices: &mut Choices| -> Option<Vec<[f64; 2]>> {
        let bad = choices.one_in(40);
        match choices.below(6) {
            0 => Some(vec![[if bad { f64::NAN } else { 0.5 }, 0.5]; n]),
            1 => Some((0..n).map(|_| [choices.unit(), choices.unit()].map(|x| 0.5 + 0.5 * x)).collect()),
            2 => Some((0..n).map(|_| [choices.unit(), choices.unit()].map(|x| 1e6 * x)).collect()),
            // One after another along a line, and cells of a grid.
            3 => Some((0..n).map(|i| [i as f64 / n as f64, 0.5]).collect()),
            4 => {
                let side = (n as f64 / 3.0).sqrt().ceil();
                let cell = |i: usize| [(i / 3) as f64 % side, ((i / 3) as f64 / side).floor()];
                let within = [[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]];
                Some((0..n).map(|i| [0, 1].map(|k| (cell(i)[k] + within[i % 3][k]) / side)).collect())
            }
            _ => None,
        }
    };
    let (uvs, lightmap_uvs) = (coordinates(choices), coordinates(choices));
    let albedo = choices.of(&[0.0, 0.2, 0.5, 0.8, 0.95, 0.999, 1.0]);
    Mesh { corners, triangles, normals, uvs, lightmap_uvs, albedo, two_sided: choices.one_in(3) }
}

/// Writes `model.obj` and its library.
fn obj(folder: &Path, meshes: &[Mesh]) -> &'static str {
    let (mut text, mut library) = ("mtllib model.mtl\n".to_owned(), String::new());
    let (mut first, mut first_uv, mut first_normal) = (1, 1, 1);
    for (number, mesh) in meshes.iter().enumerate() {
        let _ = writeln!(library, "newmtl m{number}\nKd {0} {0} {0}", mesh.albedo);
        let _ = writeln!(text, "o part{number}\nusemtl m{number}");
        mesh.corners.iter().for_each(|[x, y, z]| text += &format!("v {x:e} {y:e} {z:e}\n"));
        let uvs = mesh.uvs.iter().flatten();
        uvs.for_each(|[u, v]| text += &format!("vt {u:e} {v:e}\n"));
        let normals = mesh.normals.iter().flatten();
        normals.for_each(|[x, y, z]| text += &format!("vn {x:e} {y:e} {z:e}\n"));
        for triangle in &mesh.triangles {
            let corner = |&v: &usize| {
                let uv = mesh.uvs.as_ref().map_or(String::new(), |_| (v + first_uv).to_string());
                let normal = mesh.normals.as_ref().map_or(String::new(), |_| (v + first_normal).to_string());
                match (uv.is_empty(), normal.is_empty()) {
                    (true, true) => format!(" {}", v + first),
                    (false, true) => format!(" {}/{uv}", v + first),
                    _ => format!(" {}/{uv}/{normal}", v + first),
                }
            };
            let _ = writeln!(text, "f{}", triangle.iter().map(corner).collect::<String>());
        }
        first += mesh.corners.len();
        first_uv += mesh.uvs.as_ref().map_or(0, Vec::len);
        first_normal += mesh.normals.as_ref().map_or(0, Vec::len);
    }
    fs::write(folder.join("model.mtl"), library).expect("a file");
    fs::write(folder.join("model.obj"), text).expect("a file");
    "model.obj"
}

/// Writes `model.gltf` and `model.bin`; some nodes flatten, mirror or move their meshes far away.
fn gltf(folder: &Path, meshes: &[Mesh], choices: &mut Choices) -> &'static str {
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut store = |data: Vec<u8>, kind: u32, count: usize, shape: &str| {
        views.push(json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len() }));
        bytes.extend(data);
        accessors.push(
            json!({ "bufferView": views.len() - 1, "componentType": kind, "count": count, "type": shape,
            "min": [0, 0, 0], "max": [0, 0, 0] }),
        );
        if shape != "VEC3" {
            let accessor = accessors.last_mut().and_then(Value::as_object_mut).expect("just added");
            accessor.retain(|key, _| key != "min" && key != "max");
        }
        accessors.len() - 1
    };
    fn floats<const N: usize>(values: &[[f64; N]]) -> Vec<u8> {
        values.as_flattened().iter().flat_map(|&x| (x as f32).to_le_bytes()).collect()
    }
    let (mut listed, mut materials, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    for (number, mesh) in meshes.iter().enumerate() {
        let n = mesh.corners.len();
        let mut attributes = json!({ "POSITION": store(floats(&mesh.corners), 5126, n, "VEC3") });
        if let Some(normals) = &mesh.normals {
            attributes["NORMAL"] = json!(store(floats(normals), 5126, n, "VEC3"));
        }
        for (name, uvs) in [("TEXCOORD_0", &mesh.uvs), ("TEXCOORD_1", &mesh.lightmap_uvs)] {
            if let Some(uvs) = uvs {
                attributes[name] = json!(store(floats(uvs), 5126, n, "VEC2"));
            }
        }
        let flat = mesh.triangles.as_flattened();
        let indices = flat.iter().flat_map(|&i| (i as u32).to_le_bytes()).collect();
        let indices = store(indices, 5125, flat.len(), "SCALAR");
        let primitive = json!({ "attributes": attributes, "indices": indices, "material": number });
        listed.push(json!({ "name": format!("part{number}"), "primitives": [primitive] }));
        let a = mesh.albedo;
        materials.push(json!({ "name": format!("m{number}"), "doubleSided": mesh.two_sided,
            "pbrMetallicRoughness": { "baseColorFactor": [a, a, a, 1] } }));
        for _ in 0..1 + choices.below(2) {
            let mut node = json!({ "mesh": number });
            match choices.below(9) {
                0 => node["scale"] = json!([1, 1, 0]),
                1 => node["scale"] = json!([1e-9, 1, 1e-9]),
                2 => node["scale"] = json!([-1, 1, 1]),
                3 => node["scale"] = json!([1e9, 1, 1e-9]),
                4 => node["translation"] = json!([1e6, -1e6, 0]),
                5 => node["rotation"] = json!([0.5, 0.5, 0.5, 0.5]),
                6 => node["matrix"] = json!([1, 0, 0, 0, 1, 1e-7, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
                _ => {}
            }
            nodes.push(node);
        }
    }
    let asset = json!({ "asset": { "version": "2.0" }, "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }], "nodes": nodes, "meshes": listed,
        "materials": materials, "accessors": accessors, "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len(), "uri": "model.bin" }] });
    fs::write(folder.join("model.bin"), &bytes).expect("a file");
    fs::write(folder.join("model.gltf"), asset.to_string()).expect("a file");
    "model.gltf"
}

/// The scene file.
fn scene(model: &str, choices: &mut Choices) -> String {
    let mut text = String::new();
    if choices.one_in(2) {
        let angle = choices.of(&[0.0, 0.5, 30.0]);
        let turn = choices.unit() * TAU;
        let [x, z] = [turn.cos(), turn.sin()];
        let _ = writeln!(text, "[sun]\ndisc_angle = {angle}");
        let _ = writeln!(
            text,
            "track = [{{ hour = 12, direction = [{x}, 1.0, {z}], irradiance = [90, 80, 70] }}]"
        );
    }
    if choices.one_in(2) {
        text += "[sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n";
    }
    let _ = writeln!(text, "[lightmap]\nsize = [{}, {}]", 1 + choices.below(40), 1 + choices.below(40));
    let _ = writeln!(text, "padding = {}\npages = {}", choices.below(5), 1 + choices.below(3));
    text += "[bake]\nsamples = 2\n";
    if choices.one_in(3) {
        text += "albedo_max = 1\n";
    }
    if choices.one_in(6) {
        let _ = writeln!(text, "bounces = {}", choices.below(4));
    }
    let _ = writeln!(text, "[[object]]\nfile = \"{model}\"");
    if choices.one_in(3) {
        let scale = choices.of(&["0.001", "1000.0", "1e-8", "[1, 1e-8, 1]", "[-1, 2, 3]"]);
        let _ = writeln!(text, "scale = {scale}");
    }
    if choices.one_in(4) {
        text += "two_sided = true\n";
    }
    let is_lit = choices.one_in(3);
    if is_lit {
        text += "emission = [1, 2, 3]\ngroup = \"g\"\n";
    }
    if is_lit || choices.one_in(2) {
        text += "[[group]]\nname = \"g\"\n";
        // Few lamps, or as many as a tree is made of, at places of their own or all at one, on surfaces, in
        // them or far beyond all.
        let (lamps, far) = (choices.of(&[0, 1, 2, 3, 20]), choices.of(&[1.0, 1.0, 1.0, 1e9, 1e30, 1e200]));
        let one_place = choices.one_in(3).then(|| choices.place());
        for _ in 0..lamps {
            let [x, y, z] = one_place.unwrap_or_else(|| choices.place()).map(|c| c * far);
            let light = choices.of(&["1e-9", "1", "1e6"]);
            let size = choices.of(&[1e-9, 1e-3, 0.5, 1e3]);
            let _ = match choices.below(4) {
                0 => {
                    writeln!(
                        text,
                        "[[group.point]]\nposition = [{x:?}, {y:?}, {z:?}]\nintensity = [{light}, 1, 1]"
                    )
                }
                1 => writeln!(
                    text,
                    "[[group.sphere]]\ncentre = [{x:?}, {y:?}, {z:?}]\nradius = {size}\nradiance = [{light}, 1, 1]"
                ),
                2 => writeln!(
                    text,
                    "[[group.disc]]\ncentre = [{x:?}, {y:?}, {z:?}]\ndirection = [0, -1, 0]\nradius = {size}\nradiance = [{light}, 1, 1]"
                ),
                _ => writeln!(
                    text,
                    "[[group.rectangle]]\ncorner = [{x:?}, {y:?}, {z:?}]\nedge_u = [{size}, 0, 0]\nedge_v = [0, 0, {size}]\nradiance = [{light}, 1, 1]"
                ),
            };
        }
    }
    text
}
