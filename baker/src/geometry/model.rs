//! What a geometry file holds, before it is placed in the scene; the same for OBJ and glTF.

mod copies;

pub(super) use copies::MOST_COPIES;

use super::contents::{Contents, FileLamp};
use super::motion::Motion;
use super::names::{Names, Tree};
use super::notes::{Notes, plural};
use super::{Glass, LightmapPlace};
use dataset::{Error, Result};
use glam::{DMat3, DMat4, DVec3, Vec2, Vec3, Vec4};
use serde_json::Value;
use std::collections::BTreeMap;

/// Albedo of surfaces for which a file gives none.
pub(super) const DEFAULT_ALBEDO: f32 = 0.5;

/// A geometry file.
#[derive(Default)]
pub(super) struct Model {
    pub meshes: Vec<Mesh>,
    /// Its nodes.
    pub tree: Tree,
    /// Which meshes stand where, in the order of the file.
    pub placements: Vec<NodeMesh>,
    pub materials: Vec<FileMaterial>,
    /// What only a glTF holds.
    pub asset: Option<Asset>,
    /// Its lamps and cameras.
    pub contents: Contents,
}

/// A mesh at a node.
pub(super) struct NodeMesh {
    /// Index of the mesh.
    pub mesh: usize,
    /// The node's place in the tree; `None` in an OBJ.
    pub node: Option<usize>,
    /// Where it stands relative to the node, and as which of the node's instances, if that has several.
    pub repeat: Option<(usize, DMat4)>,
    pub file_from_mesh: DMat4,
    /// Whether a skin places it, so that it does not stand where its node does.
    pub is_skinned: bool,
    /// Whether the file hides it: it is not baked.
    pub is_hidden: bool,
    /// Where the node says that its lightmap lies.
    pub lightmap_place: LightmapPlace,
}

impl Model {
    /// The names that apply to a placed mesh, nearest first: of its material, node and mesh, and of every
    /// node above.
    pub(super) fn names_of_mesh(&self, placement: &NodeMesh) -> Names<'_> {
        let mesh = &self.meshes[placement.mesh];
        let material = self.materials[mesh.material].name.as_str();
        self.tree.names_at(placement.node, material, &mesh.name)
    }

    /// The names that apply to a lamp, nearest first: of its node and its light, and of every node above.
    pub(super) fn names_of_lamp<'a>(&'a self, lamp: &'a FileLamp) -> Names<'a> {
        self.tree.names(lamp.names.iter().map(String::as_str), Some(lamp.node))
    }

    /// What messages call a placed mesh: its node (or the nearest one above that has a name), mesh and
    /// material.
    pub(super) fn shown_name(&self, placement: &NodeMesh) -> String {
        let mesh = &self.meshes[placement.mesh];
        let node =
            self.tree.path(placement.node).map(|node| node.name.as_str()).find(|name| !name.is_empty());
        let material = self.materials[mesh.material].name.as_str();
        let mut names = vec![node.unwrap_or(""), mesh.name.as_str(), material];
        names.retain(|name| !name.is_empty());
        names.dedup();
        names.join("/")
    }
}

/// Indexed triangles of one material.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    /// Name in the file, or empty.
    pub name: String,
    /// Index of the material.
    pub material: usize,
    /// Of a glTF: the indices of its mesh, and of the primitive in that.
    pub primitive: Option<(usize, usize)>,
    /// What positions are relative to.
    pub origin: DVec3,
    pub positions: Vec<Vec3>,
    /// Any length, zero too; empty: flat.
    pub normals: Vec<Vec3>,
    /// v down; empty: none.
    pub uvs: Vec<Vec2>,
    /// Where its vertices lie on the emission map, v down; empty: it has none.
    pub emission_uvs: Vec<Vec2>,
    /// Empty: none.
    pub lightmap_uvs: Vec<Vec2>,
    /// Linear colour and alpha that multiply the material's, each in [0, 1]; empty: none.
    pub colours: Vec<Vec4>,
    /// The greatest value of each channel of `colours`, where there are any.
    pub brightest: Option<Vec3>,
    /// Attributes as they stand in the file.
    pub attributes: Vec<Attribute>,
    pub triangles: Vec<[u32; 3]>,
}

/// A vertex attribute that nothing here reads, as it stands in the file.
#[derive(Clone, Debug)]
pub(crate) struct Attribute {
    /// Such as `TANGENT`.
    pub name: String,
    /// glTF's number for the type of a component.
    pub component: u32,
    /// Such as `VEC4`.
    pub kind: &'static str,
    pub normalized: bool,
    /// Bytes per vertex, a multiple of 4.
    pub stride: usize,
    /// Vertex by vertex.
    pub bytes: Vec<u8>,
}

impl Attribute {
    /// The bytes of one vertex.
    pub(crate) fn of(&self, vertex: usize) -> &[u8] {
        &self.bytes[vertex * self.stride..][..self.stride]
    }
}

/// What a glTF holds beside triangles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Asset {
    /// Its JSON, without what describes bytes.
    pub root: Value,
    /// Indices of the nodes of its scene, every parent before its children.
    pub nodes: Vec<usize>,
    /// Those of them that have no parent.
    pub roots: Vec<usize>,
    /// The scene's own JSON.
    pub scene: Value,
    /// The encoded bytes of its images; `None` for one that cannot be read.
    pub images: Vec<Option<Vec<u8>>>,
    /// What lets it move; an error says why that cannot be read.
    pub motion: Motion,
    /// The bytes of its photometric profiles, by their index.
    pub profiles: BTreeMap<usize, Vec<u8>>,
}

/// A material of a file.
pub(super) struct FileMaterial {
    /// Name in the file, or empty.
    pub name: String,
    /// Linear, in [0, 1].
    pub albedo: Vec3,
    pub alpha: f32,
    /// Index into the texture store.
    pub texture: Option<u32>,
    pub alpha_cutoff: Option<f32>,
    pub two_sided: bool,
    /// What it lets through, if it is glass.
    pub glass: Option<Glass>,
    /// The file defines none: the default albedo.
    pub undefined: bool,
    /// What it emits; `None`: nothing.
    pub emission: Option<FileEmission>,
}

/// What a material of a file emits.
#[derive(Clone, Copy)]
pub(super) struct FileEmission {
    /// As the file gives it, strength included.
    pub value: Vec3,
    /// Multiplies it: index into the store's emission maps.
    pub texture: Option<u32>,
}

impl Mesh {
    /// Digest of all that the baker reads of its surface, but what it is made of.
    pub(crate) fn digest(&self) -> blake3::Hash {
        let mut hash = blake3::Hasher::new();
        hash.update(bytemuck::cast_slice(&self.origin.to_array()));
        let mut add = |numbers: &[u8]| {
            hash.update(&(numbers.len() as u64).to_le_bytes()).update(numbers);
        };
        add(bytemuck::cast_slice(&self.positions));
        add(bytemuck::cast_slice(&self.normals));
        add(bytemuck::cast_slice(&self.uvs));
        add(bytemuck::cast_slice(&self.emission_uvs));
        add(bytemuck::cast_slice(&self.lightmap_uvs));
        add(bytemuck::cast_slice(&self.colours));
        add(bytemuck::cast_slice(&self.triangles));
        hash.finalize()
    }

    /// Checks indices and that every used value is finite, drops triangles with two corners in one place,
    /// copies of others and vertices that no triangle names; tells how many triangles it dropped. `place`
    /// names file and mesh.
    pub(super) fn finish(&mut self, place: &str) -> Result<Dropped> {
        let count = self.positions.len();
        let mut new_from_old = vec![u32::MAX; count];
        let mut used = Vec::new();
        for triangle in &self.triangles {
            if let Some(&v) = triangle.iter().find(|&&v| v as usize >= count) {
                return Err(Error::invalid(
                    place,
                    format!("a triangle names vertex {v}: expected an index below {count}"),
                ));
            }
        }
        let all = self.triangles.len();
        let at = |v: u32| self.positions[v as usize];
        let differ = |a: u32, b: u32| a != b && at(a) != at(b);
        self.triangles.retain(|&[a, b, c]| differ(a, b) && differ(b, c) && differ(c, a));
        let repeated = all - self.triangles.len();
        let copies = copies::remove(self);
        for triangle in &mut self.triangles {
            for v in triangle {
                let new = &mut new_from_old[*v as usize];
                if *new == u32::MAX {
                    *new = used.len() as u32;
                    used.push(*v);
                }
                *v = *new;
            }
        }
        drop(new_from_old);
        compact(&mut self.positions, &used, |p| p.is_finite(), place, "position")?;
        compact(&mut self.normals, &used, |n| n.is_finite(), place, "normal")?;
        compact(&mut self.uvs, &used, |t| t.is_finite(), place, "texture coordinate")?;
        compact(&mut self.colours, &used, |c| c.is_finite(), place, "vertex colour")?;
        compact(&mut self.emission_uvs, &used, |t| t.is_finite(), place, "texture coordinate")?;
        compact(&mut self.lightmap_uvs, &used, |t| t.is_finite(), place, "lightmap coordinate")?;
        for attribute in &mut self.attributes {
            attribute.bytes = used.iter().flat_map(|&v| attribute.of(v as usize)).copied().collect();
        }
        self.brightest = self.colours.iter().map(|c| c.truncate()).reduce(Vec3::max);
        Ok(Dropped { repeated, copies })
    }
}

/// Triangles that [`Mesh::finish`] drops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dropped {
    /// Those with two corners in one place.
    pub repeated: usize,
    /// Those that are the same as others.
    pub copies: usize,
}

impl Dropped {
    /// Notes the copies of a mesh.
    pub(super) fn note_copies(self, file: &str, mesh: &str, notes: &mut Notes) {
        if self.copies > 0 {
            let what = "copies of other triangles of the mesh change no light and are left out: merge double faces in the modeller";
            notes.add(file, "mesh", format!("{mesh} ({})", plural(self.copies, "triangle")), what);
        }
    }
}

/// Keeps the used values, which must be `good`.
fn compact<T: Copy + std::fmt::Debug>(
    values: &mut Vec<T>,
    used: &[u32],
    good: impl Fn(&T) -> bool,
    place: &str,
    what: &str,
) -> Result<()> {
    if values.is_empty() {
        return Ok(());
    }
    if let Some(&v) = used.iter().find(|&&v| !good(&values[v as usize])) {
        let value = values[v as usize];
        let what = format!("vertex {v}: {what} {value:?}: expected finite numbers");
        return Err(Error::invalid(place, what));
    }
    // In order already: nothing to move.
    if used.len() != values.len() || used.iter().enumerate().any(|(i, &v)| i != v as usize) {
        *values = used.iter().map(|&v| values[v as usize]).collect();
    }
    Ok(())
}

/// Checks an albedo factor of a file.
pub(super) fn check_albedo(albedo: [f32; 3], place: &str, key: &str) -> Result<Vec3> {
    if albedo.iter().all(|c| (0.0..=1.0).contains(c)) {
        Ok(Vec3::from(albedo))
    } else {
        Err(Error::invalid(place, format!("{key} = {albedo:?}: expected numbers from 0 to 1")))
    }
}

/// What an error says, without the place.
pub(super) fn reason(error: &Error) -> String {
    match error {
        Error::Invalid { what, .. } | Error::Unsupported { what, .. } => what.clone(),
        other => other.to_string(),
    }
}

/// The inverse transpose up to a positive factor: cofactors, which exist for flattening transforms too, with
/// the sign of the determinant.
pub(super) fn normal_matrix(linear: DMat3) -> DMat3 {
    let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    if linear.determinant() < 0.0 { -cofactors } else { cofactors }
}
