//! The geometry file as far as a picture needs it: triangles at their nodes, base colours, places on the
//! pages.

use super::lens::Camera;
use super::texture::{Texture, Textures};
use crate::format::Config;
use crate::store::geometry::{self, Placed};
use crate::{Error, Result};
use glam::{DMat4, DVec3, Mat2, Vec2, Vec3, Vec4};
use gltf::accessor::{DataType, Dimensions};
use gltf::material::AlphaMode;
use gltf::mesh::Mode;
use gltf::{Document, Node, Primitive, Semantic};
use serde::Deserialize;
use std::path::Path;

/// Default colour.
const GREY: f32 = 0.5;
/// Most triangles of a picture; repeated meshes count each time.
const MOST_TRIANGLES: usize = 100_000_000;

pub(super) struct Model {
    pub shapes: Vec<Shape>,
    pub parts: Vec<Part>,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    /// The cameras of its nodes.
    pub cameras: Vec<Camera>,
    /// The most that a bake lets surfaces reflect.
    albedo_max: f32,
}

/// A primitive of a mesh.
pub(super) struct Shape {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Coordinates of the base colour's texture, as many as positions, or none.
    pub uvs: Vec<Vec2>,
    /// TEXCOORD_1, likewise.
    pub lightmap_uvs: Vec<Vec2>,
    /// Vertex colours, likewise.
    pub colours: Vec<Vec4>,
    pub material: usize,
    /// The box around the positions.
    pub low: Vec3,
    pub high: Vec3,
}

/// A shape at a node.
pub(super) struct Part {
    pub shape: usize,
    pub world_from_shape: DMat4,
    /// Where it has texels: page, and the scale and offset of its coordinates to those of the page.
    pub place: Option<(usize, Vec2, Vec2)>,
}

/// A diffuse surface.
pub(super) struct Material {
    pub albedo: Vec3,
    pub alpha: f32,
    pub texture: Option<usize>,
    /// From texture coordinates of the file to those of the texture.
    pub matrix: Mat2,
    pub offset: Vec2,
    /// Holes are where alpha is below this.
    pub cutoff: Option<f32>,
    pub two_sided: bool,
    /// Panes are not drawn.
    pub is_clear: bool,
}

impl Shape {
    /// A vertex attribute at a point of a triangle.
    fn at<T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>>(
        &self,
        of: &[T],
        triangle: usize,
        [b, c]: [f32; 2],
    ) -> Option<T> {
        let [i, j, k] = self.triangles[triangle].map(|v| of.get(v as usize).copied());
        Some(i? * (1.0 - b - c) + j? * b + k? * c)
    }
}

impl Part {
    /// The corners of the box around it, in the world.
    pub(super) fn corners(&self, model: &Model) -> [DVec3; 8] {
        let Shape { low, high, .. } = &model.shapes[self.shape];
        std::array::from_fn(|i| {
            let of = |axis: usize| f64::from(if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
            self.world_from_shape.transform_point3(DVec3::new(of(0), of(1), of(2)))
        })
    }
}

impl Model {
    /// The box around all parts, or around those with texels, in the world.
    pub(super) fn bounds(&self, with_texels: bool) -> (DVec3, DVec3) {
        let parts = self.parts.iter().filter(|part| !with_texels || part.place.is_some());
        let parts = parts.filter(|part| !self.shapes[part.shape].positions.is_empty());
        let corners = parts.flat_map(|part| part.corners(self));
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = corners.fold(none, |(low, high), p| (low.min(p), high.max(p)));
        if low.is_finite() && high.is_finite() { (low, high) } else { (DVec3::ZERO, DVec3::ZERO) }
    }

    /// The length of the diagonal of the box around all parts.
    pub(super) fn extent(&self) -> f64 {
        let (low, high) = self.bounds(false);
        (high - low).length().max(f64::MIN_POSITIVE)
    }

    /// Base colour and alpha at a point of a triangle, by its second and third barycentric coordinate.
    pub(super) fn colour(&self, shape: &Shape, triangle: usize, at: [f32; 2]) -> (Vec3, f32) {
        let material = &self.materials[shape.material];
        let own = shape.at(&shape.colours, triangle, at).unwrap_or(Vec4::ONE);
        let (mut albedo, mut alpha) = (material.albedo * own.truncate(), material.alpha * own.w);
        let uv = shape.at(&shape.uvs, triangle, at);
        if let Some((texture, uv)) = material.texture.zip(uv) {
            let (colour, opacity) = self.textures[texture].sample(material.matrix * uv + material.offset);
            (albedo, alpha) = (albedo * colour, alpha * opacity);
        }
        (albedo.min(Vec3::splat(self.albedo_max)), alpha)
    }

    /// The unit normal of a triangle in the world, on the side that its corners go round counter-clockwise;
    /// zero of a sliver.
    pub(super) fn normal(&self, part: &Part, triangle: usize) -> DVec3 {
        let shape = &self.shapes[part.shape];
        let corners = shape.triangles[triangle].map(|v| shape.positions[v as usize].as_dvec3());
        let [a, b, c] = corners.map(|corner| part.world_from_shape.transform_point3(corner));
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// The page of a part's point, and its coordinates there from 0 to 1.
    pub(super) fn texel(&self, part: &Part, triangle: usize, at: [f32; 2]) -> Option<(usize, Vec2)> {
        let (page, scale, offset) = part.place?;
        let shape = &self.shapes[part.shape];
        // What has no texels though the node has some stands at (0, 0).
        let corners = shape.triangles[triangle].map(|v| shape.lightmap_uvs.get(v as usize).copied());
        if corners.iter().all(|uv| uv.is_none_or(|uv| uv == Vec2::ZERO)) {
            return None;
        }
        Some((page, scale * shape.at(&shape.lightmap_uvs, triangle, at)? + offset))
    }
}

/// Reads a geometry file.
///
/// # Errors
/// [`Error::Invalid`] with whatever is invalid in it, as `dataset check` reports it; [`Error::Unsupported`]
/// for more than can be drawn.
pub(super) fn read(path: &Path, bytes: &[u8], config: &Config) -> Result<Model> {
    if let Some(fault) = geometry::faults(path, bytes, config).into_iter().next() {
        return Err(fault);
    }
    let wrong = |what: String| Error::invalid(path.display(), what);
    let (document, binary) = geometry::open(bytes).map_err(wrong)?;
    let mut reader = Reader {
        document: &document,
        binary: &binary,
        first_of_mesh: Vec::new(),
        seen: vec![false; document.nodes().count()],
        model: Model {
            shapes: Vec::new(),
            parts: Vec::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            cameras: Vec::new(),
            albedo_max: config.settings["bake"]["albedo_max"].as_f64().unwrap_or(1.0) as f32,
        },
    };
    reader.materials();
    for mesh in document.meshes() {
        let first = reader.model.shapes.len();
        mesh.primitives().for_each(|primitive| reader.shape(&primitive));
        reader.first_of_mesh.push(first..reader.model.shapes.len());
    }
    if let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) {
        scene.nodes().for_each(|node| reader.node(&node, DMat4::IDENTITY, false));
    }
    let model = reader.model;
    let triangles: usize = model.parts.iter().map(|part| model.shapes[part.shape].triangles.len()).sum();
    if triangles > MOST_TRIANGLES {
        let what = format!("{triangles} triangles; expected at most {MOST_TRIANGLES}");
        return Err(Error::unsupported(path.display(), what));
    }
    Ok(model)
}

/// What the extras of a node say of it and all below it, but for those that say something else.
#[derive(Deserialize)]
struct Extras {
    movable: Option<bool>,
}

struct Reader<'a> {
    document: &'a Document,
    binary: &'a [u8],
    /// Of each mesh, its shapes.
    first_of_mesh: Vec<std::ops::Range<usize>>,
    /// A tree has each node once; a file that says otherwise must not keep us for ever.
    seen: Vec<bool>,
    model: Model,
}

impl Reader<'_> {
    fn materials(&mut self) {
        let mut textures = Textures::new(self.document, self.binary);
        for material in self.document.materials() {
            let (factor, info) = match material.pbr_specular_glossiness() {
                Some(base) => (base.diffuse_factor(), base.diffuse_texture()),
                None => {
                    let base = material.pbr_metallic_roughness();
                    (base.base_color_factor(), base.base_color_texture())
                }
            };
            let [r, g, b, alpha] = factor;
            let mut albedo = Vec3::new(r, g, b);
            let (matrix, offset) = info.as_ref().map_or((Mat2::IDENTITY, Vec2::ZERO), transform);
            let texture = info.and_then(|info| {
                let read = textures.add(&info.texture());
                // (Formats that this crate does not read.)
                albedo *= if read.is_none() { GREY } else { 1.0 };
                read
            });
            let mode = material.alpha_mode();
            let passes = material.transmission().is_some_and(|glass| glass.transmission_factor() > 0.0);
            self.model.materials.push(Material {
                albedo,
                alpha,
                texture,
                matrix,
                offset,
                cutoff: match mode {
                    AlphaMode::Opaque => None,
                    AlphaMode::Mask => Some(material.alpha_cutoff().unwrap_or(0.5)),
                    AlphaMode::Blend => Some(0.5),
                },
                two_sided: material.double_sided(),
                is_clear: passes || mode == AlphaMode::Blend && alpha < 1.0,
            });
        }
        self.model.textures = textures.list;
        // Of primitives that name none.
        self.model.materials.push(Material {
            albedo: Vec3::splat(GREY),
            alpha: 1.0,
            texture: None,
            matrix: Mat2::IDENTITY,
            offset: Vec2::ZERO,
            cutoff: None,
            two_sided: false,
            is_clear: false,
        });
    }

    /// Adds a primitive; one that is no triangles is an empty shape.
    fn shape(&mut self, primitive: &Primitive) {
        let reader = primitive.reader(|_| Some(self.binary));
        let mut positions: Vec<Vec3> = Vec::new();
        if primitive.mode() == Mode::Triangles {
            positions.extend(reader.read_positions().into_iter().flatten().map(Vec3::from));
        }
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..positions.len() as u32).collect(),
        };
        let uvs = |set: u32| {
            let read = reader.read_tex_coords(set).into_iter().flat_map(|uvs| uvs.into_f32());
            read.map(Vec2::from).collect::<Vec<_>>()
        };
        let material = primitive.material();
        let set = match material.pbr_specular_glossiness() {
            Some(base) => base.diffuse_texture(),
            None => material.pbr_metallic_roughness().base_color_texture(),
        };
        let set =
            set.map(|info| info.texture_transform().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord()));
        let colours = primitive.get(&Semantic::Colors(0)).filter(|accessor| {
            matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::F32)
                && matches!(accessor.dimensions(), Dimensions::Vec3 | Dimensions::Vec4)
        });
        let colours = colours.and_then(|_| reader.read_colors(0)).into_iter();
        let low = positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
        self.model.shapes.push(Shape {
            triangles: match positions.is_empty() {
                true => Vec::new(),
                false => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            },
            positions,
            uvs: set.map_or(Vec::new(), uvs),
            lightmap_uvs: uvs(1),
            colours: colours.flat_map(|colours| colours.into_rgba_f32()).map(Vec4::from).collect(),
            material: material.index().unwrap_or(self.model.materials.len() - 1),
            low,
            high,
        });
    }

    /// Adds a node and all below it; not the meshes of those that move, since no light of theirs is baked.
    fn node(&mut self, node: &Node, world_from_parent: DMat4, parent_moves: bool) {
        if std::mem::replace(&mut self.seen[node.index()], true) {
            return;
        }
        let matrix = node.transform().matrix().map(|column| column.map(f64::from));
        let world_from_node = world_from_parent * DMat4::from_cols_array_2d(&matrix);
        let extras = node.extras().as_ref();
        let said = extras.and_then(|extras| serde_json::from_str::<Extras>(extras.get()).ok());
        let moves = said.and_then(|said| said.movable).unwrap_or(parent_moves);
        if let Some(mesh) = node.mesh().filter(|_| !moves) {
            // (The check has reported invalid placements.)
            let placed = extras.and_then(|extras| serde_json::from_str::<Placed>(extras.get()).ok());
            let place = placed.map(|placed| {
                (placed.lightmap_page, placed.lightmap_scale.into(), placed.lightmap_offset.into())
            });
            for shape in self.first_of_mesh[mesh.index()].clone() {
                self.model.parts.push(Part { shape, world_from_shape: world_from_node, place });
            }
        }
        let camera = node.camera();
        if let Some(gltf::camera::Projection::Perspective(lens)) = camera.as_ref().map(|c| c.projection()) {
            self.camera(node, &world_from_node, f64::from(lens.yfov()));
        }
        node.children().for_each(|child| self.node(&child, world_from_node, moves));
    }

    /// A camera of the file, for pictures that are 16 by 9.
    fn camera(&mut self, node: &Node, world_from_node: &DMat4, yfov: f64) {
        let position = world_from_node.w_axis.truncate();
        let forward = world_from_node.transform_vector3(DVec3::NEG_Z).normalize_or_zero();
        let fov = 2.0 * ((0.5 * yfov).tan() * 16.0 / 9.0).atan().to_degrees();
        let name = node.name().unwrap_or("camera").to_owned();
        let camera = Camera { name, position, look_at: position + forward, fov };
        self.model.cameras.extend(Some(camera).filter(Camera::is_usable));
    }
}

/// `KHR_texture_transform`: scale, then rotate, then offset.
fn transform(info: &gltf::texture::Info) -> (Mat2, Vec2) {
    let Some(transform) = info.texture_transform() else { return (Mat2::IDENTITY, Vec2::ZERO) };
    // Counter-clockwise as seen with v down.
    let (sin, cos) = transform.rotation().sin_cos();
    let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    (rotation * Mat2::from_diagonal(transform.scale().into()), transform.offset().into())
}
