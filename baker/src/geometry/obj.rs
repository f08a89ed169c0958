//! Wavefront OBJ with its MTL libraries.

mod emission;

use super::model::{DEFAULT_ALBEDO, FileMaterial, Mesh, Model, NodeMesh, check_albedo, reason};
use super::mtl_glass;
use super::notes::{Notes, plural};
use super::polygon::triangulate;
use super::texture::TextureStore;
use super::{LightmapPlace, Wrap};
use dataset::{Error, Result};
use glam::{DMat4, DVec3, Vec2, Vec3};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};

/// The library that holds a stand-in for every material the OBJ names, so that one that is defined nowhere
/// keeps its name; read first, as a line of its own, so that real definitions replace its.
const STAND_INS: &str = "\u{1}stand-ins";

/// Bytes of a line that an error quotes.
const MOST_QUOTED: usize = 80;

/// What the lines of a material library that are used look like.
const STATEMENTS: &str = "`newmtl` with a name, `Kd` with one number or three, `d` with a number, `map_Kd` and `map_d` with a file";

/// Reads an OBJ. With `vt_is_lightmap` its `vt` are lightmap coordinates too.
pub(super) fn load(
    path: &Path,
    vt_is_lightmap: bool,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<Model> {
    let file = path.display().to_string();
    let folder = path.parent().unwrap_or(Path::new(""));
    let text = std::fs::read(path).map_err(Error::io(path))?;
    let stand_ins: BTreeSet<String> = text.split(|&b| b == b'\n').filter_map(material_name).collect();
    let first = format!("mtllib {STAND_INS}\n");
    let mut reader = LineCounter { inner: first.as_bytes().chain(&text[..]), lines: Cell::new(0) };

    // What the callback meets; it may not fail itself.
    let missing = RefCell::new(Vec::new());
    let failed = RefCell::new(None);
    let options = tobj::LoadOptions {
        single_index: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let loaded = tobj::load_obj_buf(&mut reader, &options, |library| {
        if library == Path::new(STAND_INS) {
            let stand_in = |name: &String| tobj::Material { name: name.clone(), ..Default::default() };
            let map = stand_ins.iter().cloned().zip(0..).collect();
            return Ok((stand_ins.iter().map(stand_in).collect(), map));
        }
        let path = resolve(folder, &library.to_string_lossy());
        match std::fs::read(&path) {
            Ok(written) => {
                let used = statements_used(&written);
                let mut reader = LineCounter { inner: &used[..], lines: Cell::new(0) };
                tobj::load_mtl_buf(&mut reader)
                    .map(|(materials, map)| (materials.into_iter().map(marked).collect(), map))
                    .inspect_err(|_| {
                        let place = format!("{}:{}", path.display(), reader.lines.get());
                        let what =
                            format!("{}: expected {STATEMENTS}", excerpt(&written, reader.lines.get()));
                        failed.borrow_mut().get_or_insert(Error::invalid(place, what));
                    })
            }
            Err(e) => {
                missing.borrow_mut().push(format!("{} ({e})", path.display()));
                Ok((Vec::new(), Default::default()))
            }
        }
    });
    if let Some(error) = failed.into_inner() {
        return Err(error);
    }
    // The first line was ours.
    let line = reader.lines.get().saturating_sub(1);
    let (models, materials) = loaded.map_err(|e| {
        let place = format!("{file}:{line}");
        Error::invalid(place, format!("{}: {e}, here or in the faces above", excerpt(&text, line)))
    })?;
    for library in missing.into_inner() {
        notes.add(&file, "library", library, "mtllib cannot be read: its materials are not defined");
    }
    let short =
        text.split(|&b| b == b'\n').enumerate().filter(|(_, line)| is_short_face(line)).map(|(i, _)| i + 1);
    let mut short = short.peekable();
    if let Some(&first) = short.peek() {
        let name = match short.count() - 1 {
            0 => first.to_string(),
            n => format!("{first} (and {n} more like it)"),
        };
        notes.add(&file, "line", name, "a face of fewer than three vertices is left out");
    }
    // Whatever is wrong with the libraries has been said.
    let materials = materials.unwrap_or_default();

    let mut model = Model::default();
    let mut new_from_old = BTreeMap::new();
    for tobj::Model { mesh, name } in models {
        if mesh.indices.is_empty() {
            continue;
        }
        let material = match new_from_old.get(&mesh.material_id) {
            Some(&index) => index,
            None => {
                let defined = mesh.material_id.and_then(|id| materials.get(id));
                model.materials.push(self::material(defined, &file, folder, textures, notes)?);
                new_from_old.insert(mesh.material_id, model.materials.len() - 1);
                model.materials.len() - 1
            }
        };
        let has_map = model.materials[material].emission.is_some_and(|e| e.texture.is_some());
        let mesh = convert(mesh, name, material, vt_is_lightmap, has_map, &file, notes)?;
        model.placements.push(NodeMesh {
            mesh: model.meshes.len(),
            node: None,
            repeat: None,
            is_skinned: false,
            is_hidden: false,
            file_from_mesh: DMat4::IDENTITY,
            lightmap_place: LightmapPlace::Unsaid,
        });
        model.meshes.push(mesh);
    }
    Ok(model)
}

/// A line, by its number from 1 on, as an error quotes it.
fn excerpt(text: &[u8], line: usize) -> String {
    let line = text.split(|&b| b == b'\n').nth(line.saturating_sub(1)).unwrap_or_default();
    format!("`{}`", String::from_utf8_lossy(&line[..line.len().min(MOST_QUOTED)]).trim())
}

/// The name a `usemtl` line gives.
fn material_name(line: &[u8]) -> Option<String> {
    let line = std::str::from_utf8(line).ok()?.trim_start();
    let name = line.strip_prefix("usemtl")?;
    (name.starts_with([' ', '\t']) && !name.trim().is_empty()).then(|| name.trim().to_owned())
}

/// A material library with nothing in its other lines, so that what the baker does not use cannot be wrong;
/// `Kd r` means `Kd r r r`. A `Kd` of two numbers, which the reader does not survive, becomes one that it
/// refuses.
fn statements_used(library: &[u8]) -> Vec<u8> {
    let mut used = Vec::with_capacity(library.len());
    for line in library.split_inclusive(|&b| b == b'\n') {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"newmtl" | b"d" | b"Tr" | b"map_Kd" | b"map_d" | b"map_Ke") => used.extend(line),
            // (The reader refuses others.)
            Some(b"illum")
                if words.next().is_some_and(|w| w.iter().all(u8::is_ascii_digit) && w.len() < 3) =>
            {
                used.extend(line);
            }
            // By another name: the reader would end at one that is wrong.
            Some(b"Ke") => {
                let numbers: Vec<_> = words.take(4).map(String::from_utf8_lossy).collect();
                used.extend(format!("{} {}\n", emission::KE, numbers.join(" ")).as_bytes());
            }
            Some(key @ (b"Kd" | b"Tf")) => {
                let numbers: Vec<&[u8]> = words.take(3).collect();
                used.extend([key, b" "].concat());
                used.extend(match numbers[..] {
                    [grey] => [grey; 3].join(&b' '),
                    [_, _, _] => numbers.join(&b' '),
                    _ => b"is neither one number nor three".to_vec(),
                });
                used.push(b'\n');
            }
            _ => used.push(b'\n'),
        }
    }
    used
}

/// Whether a line is a face of one or two vertices.
fn is_short_face(line: &[u8]) -> bool {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    words.next() == Some(b"f") && (1..3).contains(&words.count())
}

/// Marks a material that a library defines, against stand-ins.
fn marked(mut material: tobj::Material) -> tobj::Material {
    material.unknown_param.insert(STAND_INS.to_owned(), String::new());
    material
}

fn is_marked(material: &tobj::Material) -> bool {
    material.unknown_param.contains_key(STAND_INS)
}

/// A path of an OBJ or MTL, with either kind of slash.
fn resolve(folder: &Path, name: &str) -> PathBuf {
    folder.join(name.trim().replace('\\', "/"))
}

/// `Kd` (linear) and `map_Kd`, `Ke` and `map_Ke`; a `map_d` that is the same file makes a cut-out.
fn material(
    material: Option<&tobj::Material>,
    file: &str,
    folder: &Path,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<FileMaterial> {
    let mut result = FileMaterial {
        name: material.map_or(String::new(), |m| m.name.clone()),
        albedo: Vec3::splat(DEFAULT_ALBEDO),
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: false,
        glass: None,
        undefined: material.is_none_or(|m| !is_marked(m)),
        emission: None,
    };
    let Some(material) = material else { return Ok(result) };
    let place = format!("{file}: material {}", material.name);
    if let Some(kd) = material.diffuse {
        result.albedo = check_albedo(kd.map(|c| c as f32), &place, "Kd")?;
    }
    if let Some(map) = &material.diffuse_texture {
        let (name, wrap) = map_options(map);
        let path = resolve(folder, name);
        let bytes = std::fs::read(&path).map_err(Error::io(&path));
        match bytes.and_then(|bytes| textures.add(&bytes, wrap, wrap, &place)) {
            Ok(texture) => {
                result.texture = Some(texture);
                // Exporters write Kd 0 beside a texture that is meant to be seen.
                if material.diffuse.is_none() || result.albedo == Vec3::ZERO {
                    result.albedo = Vec3::ONE;
                }
            }
            Err(error) => {
                let error = match error {
                    Error::Io { .. } => error.to_string(),
                    _ => format!("{}: {}", path.display(), reason(&error)),
                };
                let what =
                    "map_Kd cannot be read: Kd alone is used; add the file, or give the part an `albedo`";
                notes.add(file, "material", format!("{} ({error})", material.name), what);
            }
        }
    }
    if let Some(map) = &material.dissolve_texture {
        let same =
            material.diffuse_texture.as_ref().is_some_and(|kd| map_options(kd).0 == map_options(map).0);
        if same {
            result.alpha_cutoff = Some(0.5);
        } else {
            let what = "map_d is not used: put the cut-out into map_Kd's alpha";
            notes.add(file, "material", format!("{} ({map})", material.name), what);
        }
    }
    result.emission = emission::read(material, file, folder, textures, notes);
    result.glass = mtl_glass::read(material, file, notes);
    Ok(result)
}

/// The file name of a map statement, and `-clamp on`; options of a known number of arguments are skipped.
fn map_options(statement: &str) -> (&str, Wrap) {
    let mut rest = statement.trim();
    let mut wrap = Wrap::Repeat;
    while rest.starts_with('-') {
        let words: Vec<&str> = rest.split_whitespace().collect();
        let numbers = words[1..].iter().take(3).take_while(|w| w.parse::<f64>().is_ok()).count();
        let arguments = match words[0] {
            "-o" | "-s" | "-t" => numbers,
            "-mm" => 2,
            _ => 1,
        };
        if words[0] == "-clamp" && words.get(1) == Some(&"on") {
            wrap = Wrap::Clamp;
        }
        if words.len() <= arguments + 1 {
            break;
        }
        for word in &words[..=arguments] {
            rest = rest.trim_start()[word.len()..].trim_start();
        }
    }
    (rest, wrap)
}

/// Triangulates, recentres and checks a mesh.
fn convert(
    mesh: tobj::Mesh,
    name: String,
    material: usize,
    vt_is_lightmap: bool,
    has_emission_map: bool,
    file: &str,
    notes: &mut Notes,
) -> Result<Mesh> {
    let place = format!("{file}: {name}");
    let mut note = |what: &str| notes.add(file, "mesh", &name, what);
    let corners: Vec<DVec3> = mesh.positions.chunks_exact(3).map(DVec3::from_slice).collect();
    if let Some(bad) = mesh.indices.iter().map(|&v| corners[v as usize]).find(|p| !p.is_finite()) {
        let what = format!("v {} {} {}: expected finite numbers", bad.x, bad.y, bad.z);
        return Err(Error::invalid(&place, what));
    }
    // A finite place near the vertices (those that no face uses may be none).
    let origin = corners.iter().copied().find(|p| p.is_finite()).unwrap_or_default();
    let mut result = Mesh { name: name.clone(), material, origin, ..Default::default() };
    result.positions = corners.iter().map(|p| (p - origin).as_vec3()).collect();
    let all = |length: usize, per: usize| length == corners.len() * per;
    if all(mesh.normals.len(), 3) {
        let normal = |n: &[f64]| DVec3::from_slice(n).as_vec3();
        result.normals = mesh.normals.chunks_exact(3).map(normal).collect();
    } else if !mesh.normals.is_empty() {
        note("some faces have no vn: all are shaded flat");
    }
    if all(mesh.texcoords.len(), 2) {
        // v runs up in OBJ.
        result.uvs =
            mesh.texcoords.chunks_exact(2).map(|t| Vec2::new(t[0] as f32, (1.0 - t[1]) as f32)).collect();
    } else if !mesh.texcoords.is_empty() {
        note("some faces have no vt: none are used");
    }
    if vt_is_lightmap {
        if result.uvs.is_empty() {
            note("vt = \"lightmap\", but there are no vt: it is unwrapped");
        }
        result.lightmap_uvs = result.uvs.clone();
    }
    if mesh.face_arities.is_empty() {
        result.triangles = mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    } else {
        let (mut polygon, mut cut) = (Vec::new(), Vec::new());
        let mut rest = &mesh.indices[..];
        for &arity in &mesh.face_arities {
            let Some((face, after)) = rest.split_at_checked(arity as usize) else { break };
            rest = after;
            polygon.clear();
            polygon.extend(face.iter().map(|&v| corners[v as usize]));
            cut.clear();
            triangulate(&polygon, &mut cut);
            result.triangles.extend(cut.iter().map(|t| t.map(|i| face[i])));
        }
    }
    if has_emission_map {
        result.emission_uvs = result.uvs.clone();
    }
    let dropped = result.finish(&place)?;
    if dropped > 0 {
        let what = "faces that name a vertex twice have no area and are left out";
        notes.add(file, "mesh", format!("{name} ({})", plural(dropped, "triangle")), what);
    }
    Ok(result)
}

/// Counts the lines a reader has given.
struct LineCounter<R> {
    inner: R,
    lines: Cell<usize>,
}

impl<R: BufRead> Read for LineCounter<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.inner.read(buffer)
    }
}

impl<R: BufRead> BufRead for LineCounter<R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.inner.consume(amount);
    }

    fn read_line(&mut self, line: &mut String) -> std::io::Result<usize> {
        let read = self.inner.read_line(line)?;
        self.lines.set(self.lines.get() + usize::from(read > 0));
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn map_statements_give_file_and_clamping() {
        assert_eq!(map_options("my bark.png"), ("my bark.png", Wrap::Repeat));
        assert_eq!(map_options("-s 1 1 1 -clamp on bark.png"), ("bark.png", Wrap::Clamp));
        assert_eq!(map_options("-o 0.5  -bm 2 a b.png"), ("a b.png", Wrap::Repeat));
        assert_eq!(map_options("-clamp off bark.png"), ("bark.png", Wrap::Repeat));
    }

    #[test]
    fn a_library_is_read_for_what_the_baker_uses() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
        std::fs::write(&path, text).unwrap();
        let albedo = |library: &[u8]| {
            std::fs::write(folder.path().join("a.mtl"), library).unwrap();
            let model = load(&path, false, &mut TextureStore::default(), &mut Notes::default())?;
            Ok::<_, Error>(model.materials[0].albedo)
        };
        assert_eq!(albedo(b"newmtl m\n Kd 0.1 0.2 0.3\n").unwrap(), Vec3::new(0.1, 0.2, 0.3));
        assert_eq!(albedo(b"newmtl m\nKd 0.25").unwrap(), Vec3::splat(0.25));
        // A statement that is wrong, another of two numbers, and a comment that is no UTF-8.
        assert_eq!(
            albedo(b"newmtl m\nNs bright\nKe 2 1\n# \xe9\nKd 0.5 0.5 0.5\n").unwrap(),
            Vec3::splat(0.5)
        );
        for wrong in ["Kd 0.1 0.2", "Kd", "Kd red", "Kd 0.1 0.2 z"] {
            let error = albedo(format!("newmtl m\n{wrong}\nd 1\n").as_bytes()).unwrap_err().to_string();
            let told = format!("a.mtl:2: `{wrong}`: expected `newmtl` with a name");
            assert!(error.contains(&told), "{error}");
        }
    }

    #[test]
    fn faces_that_name_a_vertex_twice_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 2 2 3\nf 3 1 1\n").unwrap();
        let mut notes = Notes::default();
        let model = load(&path, false, &mut TextureStore::default(), &mut notes).unwrap();
        let warnings: Vec<String> = notes.lines().collect();
        assert_eq!(model.meshes[0].triangles.len(), 1);
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(warning.contains("a.obj") && warning.contains("(2 triangles): faces that name"), "{warning}");
    }

    #[test]
    fn faces_too_short_to_have_an_area_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n f 1 2\nl 1 2\nf 3\n").unwrap();
        let mut notes = Notes::default();
        let model = load(&path, false, &mut TextureStore::default(), &mut notes).unwrap();
        let warnings: Vec<String> = notes.lines().collect();
        assert_eq!(model.meshes.len(), 1);
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(warning.contains("a.obj: line 5 ") && warning.contains("and 1 more"), "{warning}");
    }
}
