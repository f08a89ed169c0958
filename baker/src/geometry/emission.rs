//! What surfaces emit, from point to point.

use super::Geometry;
use crate::Rgb;
use glam::{DVec3, Vec2, Vec3};

/// Fewest steps along each side of a triangle.
const LEAST_STEPS: u32 = 4;
/// Most points along each side of the grid by which the mean of an emission map over a triangle is found.
const MOST_STEPS: u32 = 64;

impl Geometry {
    /// What the emission of the triangle's material is multiplied by at a point, in [0, 1]: its map there,
    /// or 1.
    pub fn emission_map_at(&self, triangle: usize, barycentrics: Vec3) -> Rgb {
        let material = &self.materials[self.material_of[triangle] as usize];
        match material.emission.and_then(|emission| emission.map) {
            None => Rgb::ONE,
            Some(map) => {
                let [a, b, c] = self.emission_corners(triangle);
                let uv = a * barycentrics.x + b * barycentrics.y + c * barycentrics.z;
                self.emission_maps[map as usize].sample(uv).0
            }
        }
    }

    /// The mean of [`Geometry::emission_map_at`] over a triangle, by points as far apart as the map's texels
    /// (farther on large triangles).
    pub fn emission_map_mean(&self, triangle: usize) -> Rgb {
        let material = &self.materials[self.material_of[triangle] as usize];
        let Some(map) = material.emission.and_then(|emission| emission.map) else { return Rgb::ONE };
        let map = &self.emission_maps[map as usize];
        let size = Vec2::new(map.width as f32, map.height as f32);
        let [a, b, c] = self.emission_corners(triangle).map(|uv| uv * size);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let steps = (longest.ceil() as u32).clamp(LEAST_STEPS, MOST_STEPS);
        let mut sum = DVec3::ZERO;
        for i in 0..steps {
            for j in 0..steps - i {
                // The middles of the small triangles that stand upright, and of those that stand on their
                // heads.
                let middle = |third: f32| {
                    let (u, v) = ((i as f32 + third) / steps as f32, (j as f32 + third) / steps as f32);
                    self.emission_map_at(triangle, Vec3::new(1.0 - u - v, u, v)).as_dvec3()
                };
                sum += middle(1.0 / 3.0);
                if i + j + 1 < steps {
                    sum += middle(2.0 / 3.0);
                }
            }
        }
        (sum / f64::from(steps * steps)).as_vec3()
    }

    /// Coordinates of the corners on the emission map.
    fn emission_corners(&self, triangle: usize) -> [Vec2; 3] {
        let of = |v: u32| self.emission_uvs.get(v as usize).copied().unwrap_or(Vec2::ZERO);
        self.triangles[triangle].map(of)
    }

    /// The weights of the corners at a point near a triangle's plane, none below 0.
    pub fn barycentric_of(&self, triangle: usize, point: Vec3) -> Vec3 {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        let (ab, ac, ap) = (b - a, c - a, point.as_dvec3() - a);
        let normal = ab.cross(ac);
        let square = normal.length_squared();
        let (v, w) = (ap.cross(ac).dot(normal) / square, ab.cross(ap).dot(normal) / square);
        let weights = DVec3::new(1.0 - v - w, v, w).max(DVec3::ZERO);
        let sum = weights.element_sum();
        if sum.is_finite() && sum > 0.0 { (weights / sum).as_vec3() } else { Vec3::splat(1.0 / 3.0) }
    }

    /// Digest of where the materials of a light group emit: the maps, and how they lie on the surfaces.
    /// `None`: it has no maps.
    pub fn emission_map_digest(&self, group: u32) -> Option<blake3::Hash> {
        let mut hash = blake3::Hasher::new();
        let mut has_maps = false;
        for (index, material) in self.materials.iter().enumerate() {
            let Some(map) = material.emission.filter(|e| e.group == group).and_then(|e| e.map) else {
                continue;
            };
            if !has_maps {
                hash.update(bytemuck::cast_slice(&self.emission_uvs));
                has_maps = true;
            }
            hash.update(&(index as u64).to_le_bytes());
            self.emission_maps[map as usize].update_digest(&mut hash);
        }
        has_maps.then(|| hash.finalize())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Emission, Material, Texture, Wrap};
    use super::*;

    /// A right triangle of one square metre with a map, whose coordinates are its x and y.
    fn mapped(rgba: Vec<[u8; 4]>, width: u32) -> Geometry {
        let height = rgba.len() as u32 / width;
        let map = Texture { width, height, rgba, wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp };
        let emission = Emission { radiance: Vec3::ONE, group: 0, map: Some(0) };
        let material = Material {
            albedo: Vec3::ZERO,
            albedo_max: 1.0,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: false,
            emission: Some(emission),
        };
        Geometry {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            uvs: vec![Vec2::ZERO; 3],
            emission_uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
            triangles: vec![[0, 1, 2]],
            material_of: vec![0],
            materials: vec![material],
            emission_maps: vec![map],
            ..Default::default()
        }
    }

    #[test]
    fn a_map_is_read_at_a_point_and_averaged_over_a_triangle() {
        // White on the left, black on the right: linear between the texels' middles at ¼ and ¾.
        let g = mapped(vec![[255; 4], [0, 0, 0, 255]], 2);
        for (x, expected) in [(0.1, 1.0), (0.25, 1.0), (0.5, 0.5), (0.7, 0.1), (0.8, 0.0)] {
            let barycentrics = g.barycentric_of(0, Vec3::new(x, 0.05, 0.0));
            assert!((barycentrics - Vec3::new(0.95 - x, x, 0.05)).length() < 1e-6);
            assert!((g.emission_map_at(0, barycentrics).x - expected).abs() < 1e-5, "{x}");
        }
        // Twice the integral of (1 − x) f(x): 7/16 + ∫ over ¼ … ¾ of 2 (1 − x)(3/2 − 2x) = 7/16 + 7/24.
        let mean = g.emission_map_mean(0).x;
        assert!((mean - (7.0 / 16.0 + 7.0 / 24.0)).abs() < 0.02, "{mean}");
        // A uniform map has exactly its value, whatever the grid.
        for width in [1, 3, 100] {
            let g = mapped(vec![[255, 0, 255, 255]; width], width as u32);
            assert!((g.emission_map_mean(0) - Vec3::new(1.0, 0.0, 1.0)).length() < 1e-6);
        }
        // 64 columns, white up to half: ¾ of the triangle.
        let half: Vec<[u8; 4]> = (0..64).map(|x| if x < 32 { [255; 4] } else { [0, 0, 0, 255] }).collect();
        let mean = mapped(half, 64).emission_map_mean(0).x;
        assert!((mean - 0.75).abs() < 0.01, "{mean}");
    }

    #[test]
    fn digests_tell_maps_and_their_place_apart() {
        let g = mapped(vec![[255; 4], [0, 0, 0, 255]], 2);
        assert!(g.emission_map_digest(0).is_some() && g.emission_map_digest(1).is_none());
        let mut moved = g.clone();
        moved.emission_uvs[1].x = 0.9;
        let other = mapped(vec![[255; 4], [1, 0, 0, 255]], 2);
        assert!(g.emission_map_digest(0) != moved.emission_map_digest(0));
        assert!(g.emission_map_digest(0) != other.emission_map_digest(0));
    }
}
