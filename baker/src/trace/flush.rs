//! Emissive triangles flush with other surfaces, such as luminous panels in a ceiling. Rounding decides which
//! of the two a path meets; either way the path finds the emission.

use super::light_point::is_in_plane;
use super::lights::Lights;
use super::space::Space;
use crate::Rgb;
use glam::{DVec3, Vec3};

/// Pairs of a triangle and an emissive one flush with it.
#[derive(Debug, Default)]
pub(super) struct FlushEmitters {
    /// (Triangle, emissive triangle), sorted.
    pairs: Vec<(u32, u32)>,
}

impl FlushEmitters {
    /// Finds those that emit into one of the groups.
    pub fn new(space: &Space, lights: &Lights) -> Self {
        let geometry = space.geometry;
        let emits = |material: usize| {
            lights
                .groups
                .iter()
                .any(|group| group.emission.get(material).is_some_and(|radiance| *radiance != Rgb::ZERO))
        };
        let emits: Vec<bool> = (0..geometry.materials.len()).map(emits).collect();
        let mut pairs = Vec::new();
        if emits.contains(&true) {
            let hierarchy = space.ray_tracer.own_hierarchy();
            // (Emissive glass is passed, and so met, in any case.)
            let is_emitter = |triangle: &usize| {
                emits[geometry.material_of[*triangle] as usize] && !geometry.is_glass(*triangle)
            };
            for emitter in (0..geometry.triangles.len()).filter(is_emitter) {
                let corners = geometry.corners(emitter);
                let [low, high] = bounds(&corners);
                // (Twice what counts as in a plane.)
                let margin = 2e-6 * low.abs().max(high.abs()).max_element();
                hierarchy.any_in_box(low - margin, high + margin, |triangle, others| {
                    if triangle != emitter as u32 && are_flush(&corners, &others) {
                        pairs.push((triangle, emitter as u32));
                    }
                    false
                });
            }
            pairs.sort_unstable();
        }
        FlushEmitters { pairs }
    }

    /// The emissive triangles flush with a triangle.
    #[inline]
    pub fn of(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        let first =
            if self.pairs.is_empty() { 0 } else { self.pairs.partition_point(|pair| pair.0 < triangle) };
        self.pairs[first..].iter().take_while(move |pair| pair.0 == triangle).map(|pair| pair.1)
    }
}

fn bounds(corners: &[Vec3; 3]) -> [Vec3; 2] {
    let [a, b, c] = *corners;
    [a.min(b).min(c), a.max(b).max(c)]
}

/// Whether two triangles lie in one plane, where they overlap.
fn are_flush(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    let size =
        |corners: &[Vec3; 3]| f64::from(corners.iter().fold(Vec3::ZERO, |m, c| m.max(c.abs())).max_element());
    let lies_in = |a: &[Vec3; 3], b: &[Vec3; 3]| a.iter().all(|c| is_in_plane(c.as_dvec3(), size(a), b));
    (lies_in(a, b) || lies_in(b, a)) && overlap(a, b)
}

/// Whether the interiors of two triangles of one plane overlap: no edge of either parts them.
fn overlap(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    /// What overlaps by less than this part of the larger triangle only touches.
    const LEAST: f64 = 1e-4;
    let (a, b) = (a.map(Vec3::as_dvec3), b.map(Vec3::as_dvec3));
    let normal = (a[1] - a[0]).cross(a[2] - a[0]);
    let parts = |corners: &[DVec3; 3]| {
        (0..3).any(|i| {
            let axis = normal.cross(corners[(i + 1) % 3] - corners[i]);
            let range = |of: &[DVec3; 3]| {
                let at = of.map(|c| (c - corners[i]).dot(axis));
                [at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2])]
            };
            let ([a0, a1], [b0, b1]) = (range(&a), range(&b));
            a1.min(b1) - a0.max(b0) <= LEAST * (a1 - a0).max(b1 - b0)
        })
    };
    !parts(&a) && !parts(&b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    #[test]
    fn only_triangles_that_overlap_in_one_plane_are_flush() {
        let a = [vec3(0.0, 2.4, 0.0), vec3(1.0, 2.4, 0.0), vec3(0.0, 2.4, 1.0)];
        let moved = |by: Vec3| a.map(|corner| corner + by);
        assert!(are_flush(&a, &a) && are_flush(&a, &moved(vec3(0.3, 0.0, 0.3))));
        assert!(are_flush(&a, &moved(vec3(0.1, 1e-6, 0.1))) && !are_flush(&a, &moved(vec3(0.1, 1e-4, 0.1))));
        assert!(!are_flush(&a, &moved(vec3(1.0, 0.0, 0.0))), "corner to corner");
        let other_half = [a[1], vec3(1.0, 2.4, 1.0), a[2]];
        assert!(!are_flush(&a, &other_half), "both halves of a quad");
        let wall = [a[0], a[1], vec3(0.0, 0.0, 0.0)];
        assert!(!are_flush(&a, &wall), "a wall");
        let ceiling = [vec3(-50.0, 2.4, -50.0), vec3(50.0, 2.4, -50.0), vec3(0.0, 2.4, 80.0)];
        assert!(are_flush(&a, &ceiling) && are_flush(&ceiling, &a));
    }
}
