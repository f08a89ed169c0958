//! Emissive triangles flush with other surfaces, such as luminous panels in a ceiling. Rounding decides which
//! of the two a ray meets; either way it finds the emission, and of emissive triangles in one place only that
//! of the first.

use super::lights::Lights;
use crate::Rgb;
use crate::geometry::Geometry;
use crate::trace::rays::light_point::{is_in_plane, tolerance};
use crate::trace::rays::{Bvh8, Hit};
use crate::trace::solids::Space;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Where emissive triangles are flush with others.
#[derive(Debug, Default)]
pub(crate) struct FlushEmitters {
    /// Per triangle, whether an emissive one is flush with it; empty where none is.
    covers: Vec<bool>,
    /// Per material, whether it emits into one of the groups.
    emits: Vec<bool>,
    hierarchy: Option<Arc<Bvh8>>,
}

impl FlushEmitters {
    /// Finds those that emit into one of the groups.
    pub(crate) fn new(space: &Space, lights: &Lights) -> Self {
        let geometry = space.geometry;
        let emits = |material: usize| {
            let radiance = lights.groups.iter().filter_map(|group| group.emission.get(material));
            radiance.into_iter().any(|radiance| *radiance != Rgb::ZERO)
        };
        let mut flush = FlushEmitters {
            emits: (0..geometry.materials.len()).map(emits).collect(),
            ..FlushEmitters::default()
        };
        if !flush.emits.contains(&true) {
            return flush;
        }
        let hierarchy = space.ray_tracer.own_hierarchy();
        let mut covers = vec![false; geometry.triangles.len()];
        for emitter in (0..geometry.triangles.len()).filter(|triangle| flush.is_emitter(geometry, *triangle))
        {
            let corners = geometry.corners(emitter);
            let [a, b, c] = corners;
            let margin = margin(geometry, &corners);
            let [low, high] = [a.min(b).min(c) - margin, a.max(b).max(c) + margin];
            hierarchy.any_in_box(low, high, |triangle, others| {
                let of_others = &mut covers[triangle as usize];
                *of_others |= triangle != emitter as u32 && are_flush(geometry, &corners, &others);
                false
            });
        }
        if covers.contains(&true) {
            (flush.covers, flush.hierarchy) = (covers, Some(hierarchy));
        }
        flush
    }

    /// (Emissive glass is passed, and so met, in any case.)
    fn is_emitter(&self, geometry: &Geometry, triangle: usize) -> bool {
        self.emits[geometry.material_of[triangle] as usize] && !geometry.is_glass(triangle)
    }

    /// Whether an emissive triangle is flush with this one.
    #[inline]
    pub(crate) fn is_covered(&self, triangle: u32) -> bool {
        self.covers.get(triangle as usize).copied().unwrap_or(false)
    }

    /// The triangle whose emission counts where a ray meets a covered one: the first, by index, of those
    /// there that emit towards the ray.
    #[cold]
    pub(crate) fn owner(&self, space: &Space, origin: Vec3, direction: Vec3, hit: &Hit) -> Option<Hit> {
        let geometry = space.geometry;
        let point = origin + direction * hit.t;
        let corners = geometry.corners(hit.triangle as usize);
        let margin = margin(geometry, &corners);
        let mut owner: Option<Hit> = None;
        self.hierarchy.as_ref()?.any_in_box(point - margin, point + margin, |triangle, others| {
            let is_first = owner.is_none_or(|owner| triangle < owner.triangle);
            let emits_here = || {
                let is_back = space.front(triangle).dot(direction) > 0.0;
                self.is_emitter(geometry, triangle as usize)
                    && (!is_back || space.material(triangle).two_sided)
                    && (triangle == hit.triangle || are_flush(geometry, &corners, &others))
            };
            if is_first && emits_here() {
                owner = space.ray_tracer.hit_on(origin, direction, triangle).or(owner);
            }
            false
        });
        owner
    }
}

/// Twice how far apart triangles are that are flush.
fn margin(geometry: &Geometry, corners: &[Vec3; 3]) -> f32 {
    2.0 * tolerance(geometry, size(corners), corners) as f32
}

/// The largest coordinate of a triangle.
fn size(corners: &[Vec3; 3]) -> f64 {
    f64::from(corners.iter().fold(Vec3::ZERO, |m, c| m.max(c.abs())).max_element())
}

/// Whether two triangles lie in one plane, where they overlap.
fn are_flush(geometry: &Geometry, a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    let lies_in = |a: &[Vec3; 3], b: &[Vec3; 3]| {
        let tolerance = tolerance(geometry, size(a), b);
        a.iter().all(|corner| is_in_plane(corner.as_dvec3(), b, tolerance))
    };
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
        let geometry = Geometry::default();
        let are_flush = |a: &[Vec3; 3], b: &[Vec3; 3]| are_flush(&geometry, a, b);
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
