//! What the scene's files hold beside surfaces: kept, so that they can be written again with a lightmap.

use super::contents::FileCamera;
use super::model::{Asset, Mesh, Model, NodeMesh};
use super::motion::Motion;
use super::movable::{LeftOut, Moving};
use super::names::{Names, Tree};
use super::{Glass, Material};
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
    /// Where everything comes from that is placed: the instances of the geometry, in their order, and what
    /// moves.
    pub(crate) sources: Vec<Source>,
    /// What is made of what moves.
    pub(crate) movable_materials: Vec<Material>,
    /// Per material of what moves, what it lets through; empty where all are opaque.
    pub(crate) movable_glass: Vec<Option<Glass>>,
    /// What the bake leaves out because it moves.
    pub(crate) left_out: LeftOut,
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
    /// What the file hides: it is not baked.
    pub hidden: Vec<Hidden>,
    /// Its nodes.
    tree: Tree,
    /// What only a glTF holds.
    pub gltf: Option<Asset>,
}

/// A mesh of a glTF that the file hides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hidden {
    /// Index into the meshes of its file.
    pub mesh: usize,
    /// Index of its node.
    pub node: usize,
    /// As of [`Source`].
    pub is_skinned: bool,
    /// Where it stands relative to its node, if that has instances.
    pub repeat: Option<DMat4>,
}

/// A file at a place in the world.
#[derive(Clone, Debug)]
pub(crate) struct Object {
    /// Index into `files`.
    pub file: usize,
    pub world_from_file: DMat4,
    /// Which of its nodes move.
    pub moving: Moving,
}

/// Whether something placed is baked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placed {
    /// As an instance of the geometry, by its index.
    Baked(usize),
    /// It moves; its material, by its index among those of what moves.
    Movable(u32),
}

/// Where something placed comes from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Source {
    /// Index into `objects`.
    pub object: usize,
    /// Index into the meshes of its file.
    pub mesh: usize,
    /// Index of its node in the glTF.
    pub node: Option<usize>,
    /// The node's place in the tree of its file.
    pub(super) in_tree: Option<usize>,
    /// Whether a skin places it, in the space of the file.
    pub is_skinned: bool,
    /// Where it stands relative to its node, and as which of the node's instances.
    pub repeat: Option<(usize, DMat4)>,
    /// What of its material the scene file overrides.
    pub changed: Changed,
    /// What became of it.
    pub placed: Placed,
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
    pub(super) fn new(name: String, mut model: Model, keeps_motion: bool) -> Self {
        if let Some(asset) = model.asset.as_mut().filter(|_| !keeps_motion) {
            asset.motion = Motion::default();
        }
        // An OBJ without `o` and `g` has one mesh of no name of its own.
        let unnamed = model.meshes.iter_mut().filter(|mesh| mesh.primitive.is_none() && mesh.name == UNNAMED);
        unnamed.for_each(|mesh| mesh.name.clone_from(&name));
        let materials = model.materials.into_iter().map(|material| material.name).collect();
        let cameras = model.contents.cameras;
        let of = |p: &NodeMesh| {
            let repeat = p.repeat.map(|(_, node_from_instance)| node_from_instance);
            let node = model.tree.nodes.get(p.node?)?.index;
            Some(Hidden { mesh: p.mesh, node, is_skinned: p.is_skinned, repeat })
        };
        let hidden =
            model.placements.iter().filter(|p| p.is_hidden && !model.meshes[p.mesh].triangles.is_empty());
        let hidden = hidden.filter_map(of).collect();
        File { name, meshes: model.meshes, materials, cameras, hidden, tree: model.tree, gltf: model.asset }
    }

    /// The names that apply to something placed of the file, nearest first, as
    /// [`Model::names_of_mesh`](super::model::Model::names_of_mesh).
    pub(crate) fn names_of(&self, source: &Source) -> Names<'_> {
        let mesh = &self.meshes[source.mesh];
        self.tree.names_at(source.in_tree, &self.materials[mesh.material], &mesh.name)
    }
}

impl Originals {
    /// Where the geometry's instances come from, in their order.
    pub(crate) fn baked(&self) -> impl Iterator<Item = &Source> + Clone {
        self.sources.iter().filter(|source| matches!(source.placed, Placed::Baked(_)))
    }

    /// The cameras of all files, each in the space of its file.
    pub fn cameras(&self) -> impl Iterator<Item = &FileCamera> {
        self.files.iter().flat_map(|file| &file.cameras)
    }

    /// What the bake leaves out because it moves, in words, if anything does.
    pub fn left_out(&self) -> Option<String> {
        self.left_out.fact()
    }

    /// Feeds all that is written again, but triangles that are baked, into a hash.
    pub fn update_digest(&self, hash: &mut blake3::Hasher) {
        for file in &self.files {
            hash.update(file.name.as_bytes()).update(&[0]);
            for asset in file.gltf.iter() {
                hash.update(asset.root.to_string().as_bytes());
                asset.images.iter().flatten().chain(asset.profiles.values()).for_each(|bytes| {
                    hash.update(bytes);
                });
                asset.motion.update_digest(hash);
            }
            for attribute in file.meshes.iter().flat_map(|mesh| &mesh.attributes) {
                hash.update(attribute.name.as_bytes()).update(&attribute.bytes);
            }
        }
        for object in &self.objects {
            hash.update(&(object.file as u64).to_le_bytes());
            for nodes in [&object.moving.nodes, &object.moving.joints] {
                for node in nodes.iter().map(|node| *node as u64).chain([u64::MAX]) {
                    hash.update(&node.to_le_bytes());
                }
            }
        }
        for source in &self.sources {
            let Placed::Movable(material) = source.placed else { continue };
            let object = &self.objects[source.object];
            hash.update(bytemuck::cast_slice(&object.world_from_file.to_cols_array()));
            let at = [source.object, source.mesh, source.node.map_or(0, |node| node + 1)];
            hash.update(bytemuck::cast_slice(&at.map(|n| n as u64)));
            let mesh = &self.files[object.file].meshes[source.mesh];
            hash.update(bytemuck::cast_slice(&mesh.origin.to_array()));
            hash.update(bytemuck::cast_slice(&mesh.positions));
            hash.update(bytemuck::cast_slice(&mesh.normals));
            hash.update(bytemuck::cast_slice(&mesh.uvs));
            hash.update(bytemuck::cast_slice(&mesh.lightmap_uvs));
            hash.update(bytemuck::cast_slice(&mesh.triangles));
            if let Some((number, repeat)) = source.repeat {
                hash.update(&(number as u64).to_le_bytes());
                hash.update(bytemuck::cast_slice(&repeat.to_cols_array()));
            }
            // (Its numbers are those of its fields, each in the shortest form that reads as the same.)
            let glass = self.movable_glass.get(material as usize);
            let look = format!("{:?}{glass:?}", self.movable_materials[material as usize]);
            hash.update(look.as_bytes());
        }
    }
}
