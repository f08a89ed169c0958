//! What the scene's files hold beside surfaces: kept, so that they can be written again with a lightmap.

use super::contents::FileCamera;
use super::model::{Asset, Mesh, Model};
use crate::scene::SurfaceOverrides;
use glam::DMat4;

/// What the reader of OBJ files calls a mesh without a name.
const UNNAMED: &str = "unnamed_object";

/// The files of a scene as they were read, and where everything in the geometry comes from.
#[derive(Clone, Debug, Default)]
pub struct Originals {
    /// Each file once.
    pub(crate) files: Vec<File>,
    /// Every placing of a file, in the order of the scene.
    pub(crate) objects: Vec<Object>,
    /// Where each instance of the geometry comes from, in the same order.
    pub(crate) sources: Vec<Source>,
    /// Radiance in kcd/m² where a file's emission is 1.
    pub(crate) emission_unit: f64,
}

/// A geometry file.
#[derive(Clone, Debug)]
pub(crate) struct File {
    /// Its name without folder and ending.
    pub name: String,
    pub meshes: Vec<Mesh>,
    /// Names of the materials that meshes name by index.
    pub materials: Vec<String>,
    /// Its cameras.
    pub cameras: Vec<FileCamera>,
    /// What only a glTF holds.
    pub gltf: Option<Asset>,
}

/// A file at a place in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Object {
    /// Index into `files`.
    pub file: usize,
    pub world_from_file: DMat4,
}

/// Where an instance of the geometry comes from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Source {
    /// Index into `objects`.
    pub object: usize,
    /// Index into the meshes of its file.
    pub mesh: usize,
    /// Index of its node in the glTF.
    pub node: Option<usize>,
    /// Where it stands relative to its node, and as which of the node's instances.
    pub repeat: Option<(usize, DMat4)>,
    /// What of its material the scene file overrides.
    pub changed: Changed,
}

/// What of a material the scene file replaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Changed {
    /// Colour, sides or what passes.
    pub surface: bool,
    /// The colour, and with it the colours of the vertices.
    pub colour: bool,
    /// What it emits.
    pub emission: bool,
}

impl Changed {
    /// What overrides replace.
    pub(super) fn by(overrides: &SurfaceOverrides) -> Self {
        let colour = overrides.albedo.is_some();
        Changed {
            surface: colour || overrides.two_sided.is_some() || overrides.transmission.is_some(),
            colour,
            emission: overrides.emission.is_some(),
        }
    }
}

impl File {
    /// Keeps what is left of a model when its meshes are placed.
    pub(super) fn new(name: String, mut model: Model) -> Self {
        // An OBJ without `o` and `g` has one mesh of no name of its own.
        let unnamed = model.meshes.iter_mut().filter(|mesh| mesh.primitive.is_none() && mesh.name == UNNAMED);
        unnamed.for_each(|mesh| mesh.name.clone_from(&name));
        let materials = model.materials.into_iter().map(|material| material.name).collect();
        let cameras = model.contents.cameras;
        File { name, meshes: model.meshes, materials, cameras, gltf: model.asset }
    }
}

impl Originals {
    /// The cameras of all files, each in the space of its file.
    pub fn cameras(&self) -> impl Iterator<Item = &FileCamera> {
        self.files.iter().flat_map(|file| &file.cameras)
    }

    /// Feeds all that is written again, but triangles, into a hash.
    pub fn update_digest(&self, hash: &mut blake3::Hasher) {
        for file in &self.files {
            hash.update(file.name.as_bytes()).update(&[0]);
            for asset in file.gltf.iter() {
                hash.update(asset.root.to_string().as_bytes());
                for image in asset.images.iter().flatten() {
                    hash.update(image);
                }
            }
            for attribute in file.meshes.iter().flat_map(|mesh| &mesh.attributes) {
                hash.update(attribute.name.as_bytes()).update(&attribute.bytes);
            }
        }
        for object in &self.objects {
            hash.update(&(object.file as u64).to_le_bytes());
        }
    }
}
