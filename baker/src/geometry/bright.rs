//! Which surfaces reflect nearly all light.

use super::Geometry;

impl Geometry {
    /// The most that the material of this number reflects anywhere, in any channel.
    pub fn reflects_at_most(&self, index: usize) -> f32 {
        let material = &self.materials[index];
        let texture = material.texture.map(|index| self.textures[index as usize].brightest());
        let brightest = material.albedo * texture.unwrap_or(glam::Vec3::ONE);
        brightest.max_element().min(material.albedo_max) * self.keeps_at_most(index, material)
    }

    /// Names of the instances that triangles belong to: sorted, each once.
    pub fn names_of(&self, triangles: &[u32]) -> Vec<&str> {
        let of = |&triangle: &u32| {
            let after = self.instances.partition_point(|i| i.triangles.start <= triangle as usize);
            Some(self.instances.get(after.checked_sub(1)?)?.name.as_str())
        };
        let mut names: Vec<&str> = triangles.iter().filter_map(of).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// Names of the instances that reflect at least `least` somewhere: sorted, each once.
    pub fn reflecting(&self, least: f32) -> Vec<&str> {
        let bright: Vec<bool> =
            (0..self.materials.len()).map(|i| self.reflects_at_most(i) >= least).collect();
        let of = |triangle: usize| bright.get(self.material_of[triangle] as usize).copied().unwrap_or(false);
        let named = self.instances.iter().filter(|i| !i.triangles.is_empty() && of(i.triangles.start));
        let mut names: Vec<&str> = named.map(|instance| instance.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        names
    }
}
