//! Wavefront OBJ with its MTL libraries.

mod statements;
mod material;
mod map;
mod emission;
mod glass;
mod mtl;
mod mesh;

use super::LightmapPlace;
use super::model::{Model, NodeMesh};
use super::notes::Notes;
use super::texture::TextureStore;
use crate::text;
use dataset::{Error, Result};
use glam::DMat4;
use mesh::{Faces, MISSING, Vertices};
use mtl::Materials;
use statements::{Statement, find, name, path_of};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The name of faces before any `o` or `g`.
const UNNAMED: &str = "unnamed_object";

/// Reads an OBJ. With `vt_is_lightmap` its `vt` are lightmap coordinates too.
pub(super) fn load(
    path: &Path,
    vt_is_lightmap: bool,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<Model> {
    let file = path.display().to_string();
    let folder = path.parent().unwrap_or(Path::new(""));
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let mut reader = Reader::new(&file, folder, notes);
    statements::read(&text::decode(&bytes), |statement| reader.read(&statement))?;
    drop(bytes);
    let Reader { vertices, meshes, materials, names, .. } = reader.finish()?;

    let mut model = Model::default();
    let mut known = BTreeMap::new();
    let mut placements = Vec::new();
    for faces in &meshes {
        let has_colours = faces.has_colours(&vertices);
        let index = match known.get(&(faces.material, has_colours)) {
            Some(&index) => index,
            None => {
                let name = faces.material.map_or("", |index| names[index].as_str());
                let defined = materials.get(name).filter(|_| faces.material.is_some());
                let mtl::Read { material, texture, emission } =
                    mtl::read(name, defined, has_colours, &file, folder, textures, notes)?;
                model.materials.push(material);
                placements.push((texture, emission));
                known.insert((faces.material, has_colours), model.materials.len() - 1);
                model.materials.len() - 1
            }
        };
        let (texture, emission) = placements[index];
        let uses = mesh::Uses { material: index, texture, emission, vt_is_lightmap };
        let mesh = mesh::convert(faces, &vertices, &uses, &file, notes)?;
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

/// An OBJ as it is read.
struct Reader<'a> {
    file: &'a str,
    folder: &'a Path,
    notes: &'a mut Notes,
    vertices: Vertices,
    meshes: Vec<Faces>,
    /// The mesh that is being read.
    faces: Faces,
    /// Those that were looked for.
    libraries: BTreeSet<PathBuf>,
    materials: Materials,
    /// Of the materials that are used, in the order of their first use.
    names: Vec<String>,
    indices: BTreeMap<String, usize>,
    /// Per kind of index, the greatest and the line that has it.
    greatest: [(u32, usize); 3],
    /// Number of faces too short to have an area, and the first one's line.
    short: (usize, usize),
    /// Number of statements of free-form geometry, and the first one's line.
    free_form: (usize, usize),
}

impl<'a> Reader<'a> {
    fn new(file: &'a str, folder: &'a Path, notes: &'a mut Notes) -> Self {
        Self {
            file,
            folder,
            notes,
            vertices: Vertices::default(),
            meshes: Vec::new(),
            faces: Faces { name: UNNAMED.to_owned(), ..Faces::default() },
            libraries: BTreeSet::new(),
            materials: Materials::new(),
            names: Vec::new(),
            indices: BTreeMap::new(),
            greatest: Default::default(),
            short: (0, 0),
            free_form: (0, 0),
        }
    }

    fn read(&mut self, statement: &Statement) -> Result<()> {
        match statement.keyword {
            "v" => {
                let expected = "three numbers after `v`, and a colour of three or none";
                let (numbers, count) = self.numbers(statement, 3, expected)?;
                self.vertices.add(&numbers[..count]);
            }
            "vt" => {
                let ([u, v, ..], _) = self.numbers(statement, 1, "one number after `vt`, or two")?;
                self.vertices.vt.push([u, v]);
            }
            "vn" => {
                let ([x, y, z, ..], _) = self.numbers(statement, 3, "three numbers after `vn`")?;
                self.vertices.vn.push([x, y, z]);
            }
            "f" => self.face(statement)?,
            "o" | "g" => {
                let name = name(statement.rest);
                let name = if name.is_empty() { UNNAMED } else { name };
                self.close(name.to_owned(), self.faces.material);
            }
            "usemtl" => {
                let material = Some(self.material(name(statement.rest)));
                if material != self.faces.material {
                    self.close(self.faces.name.clone(), material);
                }
            }
            "mtllib" => self.libraries(statement)?,
            // How ZBrush writes the colours of vertices.
            "#MRGB" => self.vertices.paint(statement.rest),
            "curv" | "curv2" | "surf" => count(&mut self.free_form, statement.line),
            _ => {}
        }
        Ok(())
    }

    /// The first numbers of a statement and how many there are, `least` or more.
    fn numbers(&self, statement: &Statement, least: usize, expected: &str) -> Result<([f64; 6], usize)> {
        let mut numbers = [0.0; 6];
        let mut count = 0;
        for word in statement.words() {
            let number = word.parse().map_err(|_| statement.error(self.file, expected))?;
            if let Some(place) = numbers.get_mut(count) {
                *place = number;
                count += 1;
            }
        }
        if count < least { Err(statement.error(self.file, expected)) } else { Ok((numbers, count)) }
    }

    fn face(&mut self, statement: &Statement) -> Result<()> {
        let counts = [self.vertices.v.len(), self.vertices.vt.len(), self.vertices.vn.len()];
        let before = self.faces.corners.len();
        for word in statement.words() {
            let mut corner = [MISSING; 3];
            for (kind, text) in word.split('/').enumerate() {
                if text.is_empty() && kind > 0 {
                    continue;
                }
                // From 1 on, or negative: counted back from the last one.
                let index = text.parse::<i64>().ok().and_then(|index| match index {
                    ..0 => (counts.get(kind)?).checked_add_signed(isize::try_from(index).ok()?),
                    _ => usize::try_from(index.checked_sub(1)?).ok(),
                });
                let index = index.and_then(|index| u32::try_from(index).ok()).filter(|i| *i < MISSING);
                let (Some(index), true) = (index, kind < 3) else {
                    let what = "v, v/vt, v//vn or v/vt/vn at each corner, each an index from 1 on, or one that counts back from -1";
                    return Err(statement.error(self.file, what));
                };
                corner[kind] = index;
                if index > self.greatest[kind].0 || self.greatest[kind].1 == 0 {
                    self.greatest[kind] = (index, statement.line);
                }
            }
            self.faces.corners.push(corner);
        }
        let corners = self.faces.corners.len() - before;
        if corners < 3 {
            self.faces.corners.truncate(before);
            count(&mut self.short, statement.line);
        } else {
            self.faces.arities.push(corners as u32);
        }
        Ok(())
    }

    /// The index of a material.
    fn material(&mut self, name: &str) -> usize {
        let next = self.names.len();
        let index = *self.indices.entry(name.to_owned()).or_insert(next);
        if index == next {
            self.names.push(name.to_owned());
        }
        index
    }

    /// Ends the mesh that is being read, and begins another.
    fn close(&mut self, name: String, material: Option<usize>) {
        let next = Faces { name, material, ..Faces::default() };
        let faces = std::mem::replace(&mut self.faces, next);
        if !faces.arities.is_empty() {
            self.meshes.push(faces);
        }
    }

    fn libraries(&mut self, statement: &Statement) -> Result<()> {
        for path in library_paths(self.folder, name(statement.rest)) {
            if !self.libraries.insert(path.clone()) {
                continue;
            }
            match mtl::load(&path, &mut self.materials) {
                Err(Error::Io { source, .. }) => {
                    let library = format!("{} ({source})", path.display());
                    let what = "mtllib cannot be read: its materials are not defined";
                    self.notes.add(self.file, "library", library, what);
                }
                result => result?,
            }
        }
        Ok(())
    }

    /// Ends the file: checks its indices, and notes what is left out.
    fn finish(mut self) -> Result<Self> {
        self.close(String::new(), None);
        let counts = [self.vertices.v.len(), self.vertices.vt.len(), self.vertices.vn.len()];
        for ((keyword, count), (greatest, line)) in
            ["v", "vt", "vn"].into_iter().zip(counts).zip(self.greatest)
        {
            // (Some exporters write indices of lists that they leave out.)
            let is_left_out = count == 0 && keyword != "v";
            if line > 0 && greatest as usize >= count && !is_left_out {
                let what = format!(
                    "a face names {keyword} {}, but the file has {count}: expected indices of statements that are there",
                    u64::from(greatest) + 1
                );
                return Err(Error::invalid(format!("{}:{line}", self.file), what));
            }
        }
        self.vertices.finish();
        for ((count, first), what) in [
            (self.short, "a face of fewer than three vertices is left out"),
            (self.free_form, "free-form curves and surfaces are left out: export polygons"),
        ] {
            let name = match count {
                0 => continue,
                1 => first.to_string(),
                n => format!("{first} (and {} more like it)", n - 1),
            };
            self.notes.add(self.file, "line", name, what);
        }
        Ok(self)
    }
}

/// Counts something, and keeps the first one's line.
fn count((count, first): &mut (usize, usize), line: usize) {
    if *count == 0 {
        *first = line;
    }
    *count += 1;
}

/// The libraries of one `mtllib`: a file of that name, which may hold blanks, or several.
fn library_paths(folder: &Path, names: &str) -> Vec<PathBuf> {
    let whole = folder.join(path_of(names));
    if whole.is_file() {
        return vec![whole];
    }
    // Names end in `.mtl`, or stand in quotes.
    let ends = names.to_ascii_lowercase();
    let (mut paths, mut begin) = (Vec::new(), 0);
    while begin < names.len() {
        let (open, mark) = if names[begin..].starts_with('"') { (1, "\"") } else { (0, ".mtl ") };
        let end = ends[begin + open..].find(mark).map_or(names.len(), |at| begin + open + at + mark.len());
        paths.push(find(&[folder], names[begin..end].trim().trim_matches('"')));
        begin = end + names[end..].find(|c: char| !c.is_whitespace()).unwrap_or(names.len() - end);
    }
    paths
}

#[cfg(test)]
#[path = "obj_tests.rs"]
mod tests;
