//! What a GLB holds: textures, materials, meshes of one primitive per material, and nodes that place them.

use crate::mesh::Mesh;
use glam::DVec3;
use std::fmt::Write;

/// An 8-bit sRGB image, row by row from the top.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Unique.
    pub name: &'static str,
    /// Texels; square.
    pub size: u32,
    /// `size`² × RGBA; alpha is kept only by cut-out materials.
    pub rgba: Vec<[u8; 4]>,
}

/// A diffuse material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Unique.
    pub name: &'static str,
    /// Linear albedo, multiplied with the texture.
    pub albedo: [f64; 3],
    /// Index of a texture, and the metres it covers.
    pub texture: Option<(usize, f64)>,
    /// Alpha below which there is no surface.
    pub cutoff: Option<f64>,
    /// Whether the back reflects as well.
    pub double_sided: bool,
}

/// A named mesh: one primitive per material index.
#[derive(Clone, Debug)]
pub struct NamedMesh {
    /// Unique.
    pub name: String,
    /// Material index and faces.
    pub primitives: Vec<(usize, Mesh)>,
}

/// A mesh placed in the world: scaled, turned about +Y, moved.
#[derive(Clone, Debug)]
pub struct Node {
    /// Unique.
    pub name: String,
    /// Index into the meshes.
    pub mesh: usize,
    /// Metres.
    pub translation: DVec3,
    /// Degrees about +Y.
    pub turn: f64,
    /// Per local axis.
    pub scale: DVec3,
}

/// A whole file.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// Images.
    pub textures: Vec<Texture>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Meshes.
    pub meshes: Vec<NamedMesh>,
    /// Placements.
    pub nodes: Vec<Node>,
}

impl Model {
    /// Adds faces to the mesh `name` in a material; a new name makes a mesh, not yet placed. Returns its
    /// index.
    pub fn shape(&mut self, name: &str, material: &str, mut mesh: Mesh) -> usize {
        let material = self
            .materials
            .iter()
            .position(|m| m.name == material)
            .unwrap_or_else(|| panic!("no material `{material}`"));
        if let Some((_, metres)) = self.materials[material].texture {
            mesh.uvs.iter_mut().for_each(|uv| *uv /= metres);
        }
        let index = self.meshes.iter().position(|m| m.name == name).unwrap_or_else(|| {
            self.meshes.push(NamedMesh { name: name.into(), primitives: Vec::new() });
            self.meshes.len() - 1
        });
        let primitives = &mut self.meshes[index].primitives;
        match primitives.iter_mut().find(|(m, _)| *m == material) {
            Some((_, faces)) => faces.append(mesh),
            None => primitives.push((material, mesh)),
        }
        index
    }

    /// Adds faces to the mesh `name`, which stands once, where it was built.
    pub fn add(&mut self, name: &str, material: &str, mesh: Mesh) {
        let known = self.meshes.len();
        let index = self.shape(name, material, mesh);
        if index == known {
            self.place(name.into(), index, DVec3::ZERO, 0.0, DVec3::ONE);
        }
    }

    /// Adds a body whose faces towards `lit` directions get texels, in the mesh `name`; the others, too thin
    /// for texels, go to `name_detail`.
    pub fn add_split(&mut self, name: &str, material: &str, body: Mesh, lit: impl Fn(DVec3) -> bool) {
        let (broad, thin) = body.split(lit);
        self.add(name, material, broad);
        self.add(&format!("{name}_detail"), material, thin);
    }

    /// Places a mesh.
    pub fn place(&mut self, name: String, mesh: usize, translation: DVec3, turn: f64, scale: DVec3) {
        self.nodes.push(Node { name, mesh, translation, turn, scale });
    }

    /// Places several meshes as one thing; each node is called by the mesh's name and a number.
    pub fn place_all(&mut self, meshes: &[usize], translation: DVec3, turn: f64, scale: DVec3) {
        for &mesh in meshes {
            let number = 1 + self.nodes.iter().filter(|n| n.mesh == mesh).count();
            let name = format!("{} {number}", self.meshes[mesh].name);
            self.place(name, mesh, translation, turn, scale);
        }
    }

    /// Every placed primitive in world space: node name, material index, faces.
    pub fn placed(&self) -> Vec<(&str, usize, Mesh)> {
        let mut out = Vec::new();
        for node in &self.nodes {
            let map = glam::DAffine3::from_scale_rotation_translation(
                node.scale,
                glam::DQuat::from_rotation_y(node.turn.to_radians()),
                node.translation,
            );
            for (material, mesh) in &self.meshes[node.mesh].primitives {
                out.push((node.name.as_str(), *material, mesh.clone().transformed(map)));
            }
        }
        out
    }

    /// Per mesh and material: instances, triangles and area of all instances together.
    pub fn table(&self) -> String {
        let placed = self.placed();
        let mut out = String::new();
        let mut total = (0, 0.0);
        let _ = writeln!(
            out,
            "{:<24} {:<12} {:>6} {:>10} {:>9}",
            "mesh", "material", "placed", "triangles", "area m²"
        );
        for mesh in &self.meshes {
            for &(material, ref faces) in &mesh.primitives {
                let of_mesh: Vec<&str> = self
                    .nodes
                    .iter()
                    .filter(|n| self.meshes[n.mesh].name == mesh.name)
                    .map(|n| n.name.as_str())
                    .collect();
                let area: f64 = placed
                    .iter()
                    .filter(|(name, m, _)| *m == material && of_mesh.contains(name))
                    .map(|(_, _, faces)| faces.area())
                    .sum();
                let triangles = faces.triangles.len() * of_mesh.len();
                total = (total.0 + triangles, total.1 + area);
                let material = self.materials[material].name;
                let _ = writeln!(
                    out,
                    "{:<24} {material:<12} {:>6} {triangles:>10} {area:>9.2}",
                    mesh.name,
                    of_mesh.len()
                );
            }
        }
        let _ = writeln!(
            out,
            "{:<24} {:<12} {:>6} {:>10} {:>9.2}",
            "total",
            "",
            self.nodes.len(),
            total.0,
            total.1
        );
        out
    }
}
