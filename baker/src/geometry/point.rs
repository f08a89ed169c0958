//! What stands at a point of a triangle.

use super::Geometry;
use crate::Rgb;
use glam::{Vec2, Vec3, Vec4};

/// Points on triangles are given by their barycentric weights (of the three vertices, in order, summing to
/// 1).
impl Geometry {
    /// The corners, relative to the origin.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// Half the cross product of two edges: its length is the area in m², its direction the front side.
    /// Differences and product in `f64`, so that slivers keep their direction.
    fn area_vector(&self, triangle: usize) -> glam::DVec3 {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        0.5 * (b - a).cross(c - a)
    }

    /// Area in m².
    pub fn area(&self, triangle: usize) -> f32 {
        self.area_f64(triangle) as f32
    }

    /// Area in m², in double precision.
    pub fn area_f64(&self, triangle: usize) -> f64 {
        self.area_vector(triangle).length()
    }

    /// Length of the longest edge in m.
    pub fn longest_edge(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        a.distance(b).max(b.distance(c)).max(c.distance(a))
    }

    /// Unit normal of the plane, on the front side; zero for a triangle without area.
    pub fn normal(&self, triangle: usize) -> Vec3 {
        self.area_vector(triangle).normalize_or_zero().as_vec3()
    }

    /// Interpolated unit vertex normal; that of the plane where the vertex normals cancel.
    pub fn shading_normal_at(&self, triangle: usize, barycentrics: Vec3) -> Vec3 {
        let [a, b, c] = self.triangles[triangle].map(|v| self.normals[v as usize]);
        (a * barycentrics.x + b * barycentrics.y + c * barycentrics.z)
            .try_normalize()
            .unwrap_or_else(|| self.normal(triangle))
    }

    /// Texture coordinates.
    pub fn uv_at(&self, triangle: usize, barycentrics: Vec3) -> Vec2 {
        let [a, b, c] = self.triangles[triangle].map(|v| self.uvs[v as usize]);
        a * barycentrics.x + b * barycentrics.y + c * barycentrics.z
    }

    /// The colour and alpha of the vertices, interpolated; `None` where no file of the scene gives any.
    pub(super) fn vertex_colour_at(&self, triangle: usize, barycentrics: Vec3) -> Option<Vec4> {
        if self.colours.is_empty() {
            return None;
        }
        let [a, b, c] = self.triangles[triangle].map(|v| self.colours[v as usize]);
        Some(a * barycentrics.x + b * barycentrics.y + c * barycentrics.z)
    }

    /// Linear diffuse albedo, factor times texture times vertex colour, from 0 to the material's limit; of
    /// glass, what it does not let through of that.
    pub fn albedo_at(&self, triangle: usize, barycentrics: Vec3) -> Rgb {
        let albedo = self.whole_albedo_at(triangle, barycentrics);
        if self.has_glass() { albedo * self.kept_at(triangle, barycentrics) } else { albedo }
    }

    /// The same without regard to what passes.
    fn whole_albedo_at(&self, triangle: usize, barycentrics: Vec3) -> Rgb {
        let material = &self.materials[self.material_of[triangle] as usize];
        let colour = self.vertex_colour_at(triangle, barycentrics);
        let own = match colour {
            None => material.albedo,
            Some(colour) => material.albedo * colour.truncate(),
        };
        match material.texture {
            None if colour.is_none() => own,
            None => own.min(Rgb::splat(material.albedo_max)),
            Some(index) => {
                let texture = &self.textures[index as usize];
                let albedo = own * texture.sample(self.uv_at(triangle, barycentrics)).0;
                albedo.min(Rgb::splat(material.albedo_max))
            }
        }
    }

    /// Alpha, factor times texture times that of the vertices, in [0, 1].
    pub fn alpha_at(&self, triangle: usize, barycentrics: Vec3) -> f32 {
        let material = &self.materials[self.material_of[triangle] as usize];
        let alpha = match self.vertex_colour_at(triangle, barycentrics) {
            None => material.alpha,
            Some(colour) => material.alpha * colour.w,
        };
        match material.texture {
            None => alpha,
            Some(index) => {
                let texture = &self.textures[index as usize];
                alpha * texture.sample_alpha(self.uv_at(triangle, barycentrics))
            }
        }
    }

    /// Whether there is surface: false where a cut-out's alpha is below its cutoff.
    pub fn is_solid_at(&self, triangle: usize, barycentrics: Vec3) -> bool {
        let material = &self.materials[self.material_of[triangle] as usize];
        material.alpha_cutoff.is_none_or(|cutoff| self.alpha_at(triangle, barycentrics) >= cutoff)
    }
}
