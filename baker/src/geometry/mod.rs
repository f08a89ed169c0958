//! Triangles in world space, flattened from files and instances, and what they are made of.

mod bounds;
mod notes;
mod contents;
mod names;
mod motion;
mod model;
mod movable;
mod originals;
mod texture;
mod polygon;
mod glass;
mod obj;
mod gltf;
mod survey;
mod overrides;
mod near;
mod lights;
mod lamps;
mod place;
mod load;
mod point;
mod bright;
mod emission;
mod digest;
mod similarity;
mod solids;

pub use bounds::Bounds;
pub use contents::{Contents, FileCamera, FileLamp, FileLampKind};
pub use glass::{BLOCKED_BELOW, Glass};
pub use lights::FileLights;
pub use load::{load, load_with};
pub(crate) use model::{Asset, Mesh};
pub(crate) use motion::{Elements, Motion, Use, index, is_deformable, use_of};
pub(crate) use names::fits;
pub use originals::Originals;
pub(crate) use originals::{File, Placed, Source};
pub use similarity::Similarity;
pub use solids::Solids;
pub use survey::contents;

use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};

/// All triangles of a scene. Positions are relative to `origin`, so that `f32` keeps its precision far from
/// zero.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// World position of the local origin (centre of the bounding box).
    pub origin: DVec3,
    /// Vertex positions in metres, relative to `origin`.
    pub positions: Vec<Vec3>,
    /// Unit vertex normals (from the file, else flat), on the front side.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, (0, 0) where the file has none; v runs down, as in glTF.
    pub uvs: Vec<Vec2>,
    /// Authored lightmap coordinates (TEXCOORD_1), zero where absent.
    pub lightmap_uvs: Vec<Vec2>,
    /// Linear colour and alpha of each vertex, which multiply those of its material; empty where no file
    /// gives any.
    pub colours: Vec<Vec4>,
    /// Vertex indices, front face counter-clockwise (also for mirrored instances).
    pub triangles: Vec<[u32; 3]>,
    /// Per triangle, index into `materials`.
    pub material_of: Vec<u32>,
    /// Contiguous runs of triangles and vertices, one per placed mesh.
    pub instances: Vec<Instance>,
    /// What surfaces are made of.
    pub materials: Vec<Material>,
    /// Per material, what it lets through; empty where all are opaque.
    pub glass: Vec<Option<Glass>>,
    /// Textures of base colour and of transmission.
    pub textures: Vec<Texture>,
    /// The files that all this was read from, so that they can be written again.
    pub originals: Originals,
    /// Textures of what surfaces emit.
    pub emission_maps: Vec<Texture>,
    /// Where vertices lie on the emission map of their material; empty: there are no maps.
    pub emission_uvs: Vec<Vec2>,
    /// Lamps of the files, and the light groups of all that shines in them.
    pub lights: FileLights,
}

/// One placed mesh (glTF primitive, OBJ object and material): a run of triangles with vertices of its own.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Node, mesh and material names for messages, e.g. `yard.glb: shed/planks`.
    pub name: String,
    /// Which mesh was placed: instances of one mesh, material and choice of `lightmap` have the same number,
    /// their triangles and vertices in the same order (a mirrored one with the last two corners of each
    /// triangle swapped). Dense, by first appearance.
    pub mesh: u32,
    /// The transform that placed it: metres in the world (not relative to the geometry's origin) from the
    /// mesh's coordinates.
    pub world_from_mesh: DAffine3,
    /// Its triangles.
    pub triangles: std::ops::Range<usize>,
    /// Its vertices.
    pub vertices: std::ops::Range<usize>,
    /// Whether it gets texels.
    pub lightmap: bool,
    /// Whether `lightmap_uvs` hold an authored layout for it.
    pub has_lightmap_uvs: bool,
    /// Where its file says that its lightmap lies.
    pub lightmap_place: LightmapPlace,
    /// Texel density relative to the scene's.
    pub density: f64,
}

/// Where a file says that the lightmap of an instance lies: a glTF by the `extras` of its nodes, as the
/// baker's own `scene.glb` does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LightmapPlace {
    /// The file tells of no mesh where its lightmap lies.
    #[default]
    Unsaid,
    /// It tells of others, and not of this one.
    Nowhere,
    /// Page coordinates = `scale` × lightmap coordinates + `offset`.
    At {
        /// The page.
        page: u32,
        /// Per axis.
        scale: [f32; 2],
        /// Per axis.
        offset: [f32; 2],
    },
}

/// A diffuse material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Linear albedo factor in [0, 1].
    pub albedo: Vec3,
    /// The most that a channel reflects, factor times texture.
    pub albedo_max: f32,
    /// Alpha factor.
    pub alpha: f32,
    /// Index into textures: multiplies albedo and alpha.
    pub texture: Option<u32>,
    /// `alphaMode MASK`: where alpha is below it, there is no surface.
    pub alpha_cutoff: Option<f32>,
    /// Whether the back reflects; if not, it absorbs.
    pub two_sided: bool,
    /// What it emits; `None`: nothing.
    pub emission: Option<Emission>,
}

/// What a material emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Radiance in kcd/m².
    pub radiance: Vec3,
    /// Index of the light group that switches it.
    pub group: u32,
    /// Index into the emission maps: multiplies the radiance.
    pub map: Option<u32>,
}

/// A texture of 8-bit sRGB colour and linear alpha, sampled bilinearly, decoded before filtering.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Row by row from the top (v = 0).
    pub rgba: Vec<[u8; 4]>,
    /// Horizontal addressing.
    pub wrap_u: Wrap,
    /// Vertical addressing.
    pub wrap_v: Wrap,
}

/// Texture addressing outside [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wrap {
    /// Tiles.
    Repeat,
    /// Repeats the edge.
    Clamp,
    /// Tiles, every other one mirrored.
    Mirror,
}
