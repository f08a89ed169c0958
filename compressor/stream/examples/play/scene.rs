//! The geometry of a dataset, and its copies side by side.

use crate::Result;
use dataset::pictures::Camera;
use glam::{Mat4, Vec2, Vec3};
use std::path::Path;

/// A corner as shaders read it.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    pub position: [f32; 3],
    pub page: f32,
    /// Page coordinates.
    pub uv: [f32; 2],
    pub albedo: [f32; 3],
}

/// The triangles of a scene, and where its copies stand.
#[derive(Debug)]
pub struct Scene {
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
    /// Corners of the box around what has texels.
    pub bounds: [Vec3; 2],
    pub copies: Vec<Vec3>,
}

impl Scene {
    /// Reads `scene.glb` of a dataset.
    pub fn read(path: &Path, copies: usize) -> Result<Self> {
        let wrong = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
        let bytes = std::fs::read(path).map_err(|error| wrong(&error))?;
        // (The crate refuses files that require `KHR_node_visibility`. What is hidden has no texels.)
        let gltf::Gltf { document, blob } =
            gltf::Gltf::from_slice_without_validation(&bytes).map_err(|error| wrong(&error))?;
        let blob = blob.unwrap_or_default();
        let mut scene = Scene {
            vertices: Vec::new(),
            indices: Vec::new(),
            bounds: [Vec3::INFINITY, Vec3::NEG_INFINITY],
            copies: Vec::new(),
        };
        let Some(root) = document.default_scene().or(document.scenes().next()) else {
            return Err(wrong(&"it contains no scene").into());
        };
        for node in root.nodes() {
            scene.add(&node, Mat4::IDENTITY, &blob);
        }
        if scene.indices.is_empty() || scene.bounds[0].x > scene.bounds[1].x {
            return Err(wrong(&"nothing in it has texels").into());
        }
        // Rows of copies, the first in the middle.
        let size = scene.bounds[1] - scene.bounds[0];
        let across = (copies as f64).sqrt().ceil() as i32;
        let mut places: Vec<[i32; 2]> =
            (0..across * across).map(|i| [i % across - across / 2, i / across - across / 2]).collect();
        places.sort_by_key(|[x, z]| (x.abs().max(z.abs()), *x, *z));
        scene.copies = places[..copies]
            .iter()
            .map(|[x, z]| Vec3::new(*x as f32 * size.x, 0.0, *z as f32 * size.z))
            .collect();
        Ok(scene)
    }

    fn add(&mut self, node: &gltf::Node, parent: Mat4, blob: &[u8]) {
        let world = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        let extras: serde_json::Value =
            node.extras().as_ref().and_then(|text| serde_json::from_str(text.get()).ok()).unwrap_or_default();
        let page = extras["lightmapPage"].as_u64();
        let pair = |key: &str, other: f64| {
            let of = |i: usize| extras[key][i].as_f64().unwrap_or(other) as f32;
            Vec2::new(of(0), of(1))
        };
        let (scale, offset) = (pair("lightmapScale", 1.0), pair("lightmapOffset", 0.0));
        for primitive in node.mesh().into_iter().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
            let reader = primitive.reader(|_| Some(blob));
            let Some(positions) = reader.read_positions() else { continue };
            let positions: Vec<Vec3> = positions.map(|p| world.transform_point3(p.into())).collect();
            let material = primitive.material();
            // And panes.
            if material.alpha_mode() == gltf::material::AlphaMode::Blend {
                continue;
            }
            let [r, g, b, _] = material.pbr_metallic_roughness().base_color_factor();
            let uvs: Vec<[f32; 2]> =
                reader.read_tex_coords(1).map(|uvs| uvs.into_f32().collect()).unwrap_or_default();
            // What has no texels is omitted: the backdrop of a copy would hide the others.
            let Some(page) = page.filter(|_| uvs.len() == positions.len()) else { continue };
            let first = self.vertices.len() as u32;
            for (i, position) in positions.iter().enumerate() {
                let uv = uvs.get(i).map_or(Vec2::ZERO, |uv| scale * Vec2::from(*uv) + offset);
                self.bounds = [self.bounds[0].min(*position), self.bounds[1].max(*position)];
                self.vertices.push(Vertex {
                    position: position.to_array(),
                    page: page as f32,
                    uv: uv.to_array(),
                    albedo: [r, g, b],
                });
            }
            match reader.read_indices() {
                Some(indices) => self.indices.extend(indices.into_u32().map(|i| first + i)),
                None => self.indices.extend(first..self.vertices.len() as u32),
            }
        }
        for child in node.children() {
            self.add(&child, world, blob);
        }
    }

    /// A camera above a corner of the first copy, where the dataset names none.
    pub fn camera(&self) -> Camera {
        let [low, high] = self.bounds.map(|corner| corner.as_dvec3());
        let middle = (low + high) / 2.0;
        let position = middle + 0.7 * (high - low) + 0.3 * (high - low).length() * glam::DVec3::Y;
        Camera { name: String::new(), position, look_at: middle, fov: 60.0 }
    }

    /// The copies that a camera may see.
    pub fn in_view(&self, camera: &Mat4) -> Vec<u32> {
        let corners = |copy: Vec3| {
            (0..8).map(move |i| {
                let pick = |bit: usize| usize::from(i & 1 << bit > 0);
                Vec3::new(self.bounds[pick(0)].x, self.bounds[pick(1)].y, self.bounds[pick(2)].z) + copy
            })
        };
        let is_seen = |copy: Vec3| {
            let clip: Vec<glam::Vec4> = corners(copy).map(|corner| *camera * corner.extend(1.0)).collect();
            // Not wholly behind one of the planes.
            let beyond: [fn(&glam::Vec4) -> bool; 6] =
                [|p| p.x < -p.w, |p| p.x > p.w, |p| p.y < -p.w, |p| p.y > p.w, |p| p.z < 0.0, |p| p.z > p.w];
            !beyond.iter().any(|beyond| clip.iter().all(beyond))
        };
        (0..self.copies.len() as u32).filter(|i| is_seen(self.copies[*i as usize])).collect()
    }
}
