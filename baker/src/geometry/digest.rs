//! What of a geometry decides the light on it.

use super::{Geometry, LightmapPlace};

impl Geometry {
    /// Feeds everything but light that a bake depends on into a hash. Neither names nor what materials emit
    /// count.
    pub fn update_digest(&self, hash: &mut blake3::Hasher) {
        hash.update(bytemuck::cast_slice(&self.origin.to_array()));
        hash.update(bytemuck::cast_slice(&self.positions));
        hash.update(bytemuck::cast_slice(&self.normals));
        hash.update(bytemuck::cast_slice(&self.uvs));
        hash.update(bytemuck::cast_slice(&self.lightmap_uvs));
        hash.update(bytemuck::cast_slice(&self.colours));
        hash.update(bytemuck::cast_slice(&self.triangles));
        hash.update(bytemuck::cast_slice(&self.material_of));
        for i in &self.instances {
            let numbers = [i.triangles.start, i.triangles.end, i.vertices.start, i.vertices.end];
            hash.update(bytemuck::cast_slice(&numbers.map(|n| n as u64)));
            hash.update(&[u8::from(i.lightmap), u8::from(i.has_lightmap_uvs)]);
            hash.update(&i.density.to_le_bytes());
            let (kind, page, [a, b], [c, d]) = match i.lightmap_place {
                LightmapPlace::Unsaid => (0, 0, [0.0; 2], [0.0; 2]),
                LightmapPlace::Nowhere => (1, 0, [0.0; 2], [0.0; 2]),
                LightmapPlace::At { page, scale, offset } => (2, page, scale, offset),
            };
            hash.update(bytemuck::cast_slice(&[kind, page]));
            hash.update(bytemuck::cast_slice(&[a, b, c, d]));
            // What shares a layout: the number of the mesh, and how each instance lies to the others.
            hash.update(&i.mesh.to_le_bytes());
            hash.update(bytemuck::cast_slice(&i.world_from_mesh.to_cols_array()));
        }
        for m in &self.materials {
            hash.update(bytemuck::bytes_of(&m.albedo));
            hash.update(&m.albedo_max.to_le_bytes());
            hash.update(&m.alpha.to_le_bytes());
            hash.update(&m.texture.map_or(u32::MAX, |t| t).to_le_bytes());
            hash.update(&m.alpha_cutoff.unwrap_or(-1.0).to_le_bytes());
            hash.update(&[u8::from(m.two_sided)]);
        }
        // (Only where there is any, so that glass changes no digest of what has none.)
        for (i, glass) in self.glass.iter().enumerate() {
            if let Some(glass) = glass {
                hash.update(bytemuck::cast_slice(&[[i as u32; 1].as_slice(), &glass.key()].concat()));
            }
        }
        self.textures.iter().for_each(|texture| texture.update_digest(hash));
    }
}
