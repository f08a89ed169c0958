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
