//! Rays against the scene's triangles: nearest hit and occlusion, with cut-outs really open.

use super::backend::Backend;
use super::bvh8::{Bvh8, Line};
#[cfg(feature = "embree")]
use super::embree;
use super::triangle::{Hit, Meeting};
use crate::Result;
use crate::geometry::Geometry;
use glam::Vec3;
use std::sync::Arc;

/// The ray tracer: a hierarchy over all triangles, and what decides whether a hit counts.
pub struct Rays<'a> {
    geometry: &'a Geometry,
    hierarchy: Hierarchy<'a>,
}

enum Hierarchy<'a> {
    Own(Arc<Bvh8>, std::marker::PhantomData<&'a ()>),
    #[cfg(feature = "embree")]
    Embree(embree::Scene<'a>),
}

impl<'a> Rays<'a> {
    /// Builds our own hierarchy ([`Backend::Obvhs`]). Triangles without area neither hit nor harm.
    pub fn new(geometry: &'a Geometry) -> Self {
        Self::with_hierarchy(geometry, Bvh8::new(geometry))
    }

    /// Builds the ray tracer of `backend`.
    ///
    /// # Errors
    /// `Unsupported` where this build lacks the backend or its library refuses to start.
    pub fn with_backend(geometry: &'a Geometry, backend: Backend) -> Result<Self> {
        match backend {
            Backend::Obvhs => Ok(Self::new(geometry)),
            #[cfg(feature = "embree")]
            Backend::Embree => {
                Ok(Rays { geometry, hierarchy: Hierarchy::Embree(embree::Scene::new(geometry)?) })
            }
            #[cfg(not(feature = "embree"))]
            Backend::Embree => backend.expect_built().map(|()| Self::new(geometry)),
        }
    }

    /// Rays through a hierarchy already built over `geometry`.
    pub fn with_hierarchy(geometry: &'a Geometry, hierarchy: impl Into<Arc<Bvh8>>) -> Self {
        Rays { geometry, hierarchy: Hierarchy::Own(hierarchy.into(), std::marker::PhantomData) }
    }

    /// The nearest hit along the unit `direction`; `from` is the triangle the ray starts on, which it cannot hit.
    /// What lies behind the origin or exactly at it does not count.
    #[inline]
    pub fn nearest(&self, origin: Vec3, direction: Vec3, from: u32) -> Option<Hit> {
        match &self.hierarchy {
            Hierarchy::Own(bvh, _) => {
                let line = Line::new(origin, direction)?;
                let (triangle, meeting) = bvh.nearest(&line, from, &|t, m| self.is_open(t, m))?;
                Some(Hit { triangle, barycentric: meeting.barycentric(), t: meeting.t as f32 })
            }
            #[cfg(feature = "embree")]
            Hierarchy::Embree(scene) => scene.nearest(origin, direction, from),
        }
    }

    /// Whether anything stands between `origin` and the point at distance `t_max` along the unit `direction`.
    #[inline]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32, from: u32) -> bool {
        match &self.hierarchy {
            Hierarchy::Own(bvh, _) => Line::new(origin, direction)
                .is_some_and(|line| bvh.occluded(&line, t_max, from, &|t, m| self.is_open(t, m))),
            #[cfg(feature = "embree")]
            Hierarchy::Embree(scene) => scene.occluded(origin, direction, t_max, from),
        }
    }

    /// Whether this triangle alone stands between `origin` and the point at distance `t_max`: then [`Rays::occluded`] is true.
    /// A cut-out never does here.
    pub fn stands_in(&self, origin: Vec3, direction: Vec3, t_max: f32, triangle: u32) -> bool {
        let material = &self.geometry.materials[self.geometry.material_of[triangle as usize] as usize];
        let corners = self.geometry.corners(triangle as usize);
        material.alpha_cutoff.is_none()
            && Line::new(origin, direction)
                .is_some_and(|line| line.exact.meet(&corners, f64::from(t_max)).is_some())
    }

    /// Whether `stands` holds for a triangle (its index and corners) whose box meets the one from `low` to `high`; true where that
    /// cannot be asked (Embree).
    pub fn any_in_box(&self, low: Vec3, high: Vec3, stands: impl FnMut(u32, [Vec3; 3]) -> bool) -> bool {
        match &self.hierarchy {
            Hierarchy::Own(bvh, _) => bvh.any_in_box(low, high, stands),
            #[cfg(feature = "embree")]
            Hierarchy::Embree(_) => true,
        }
    }

    #[cold]
    fn is_open(&self, triangle: u32, meeting: &Meeting) -> bool {
        !self.geometry.is_solid_at(triangle as usize, meeting.barycentric())
    }
}

/// A point of a triangle, moved off its surface to the side of `normal` by more than rounding can have sunk it
/// (Pharr, Jakob & Humphreys 2023, "Physically Based Rendering", section 6.8).
#[inline]
pub fn offset_point(corners: &[Vec3; 3], barycentric: Vec3, normal: Vec3) -> Vec3 {
    let parts = [corners[0] * barycentric.x, corners[1] * barycentric.y, corners[2] * barycentric.z];
    let point = parts[0] + parts[1] + parts[2];
    // γ₇ of the interpolation, and as much again for the translation in the triangle test.
    let gamma = 14.0 * f32::EPSILON * 0.5;
    let error = (parts[0].abs() + parts[1].abs() + parts[2].abs()) * gamma
        + corners.iter().fold(Vec3::ZERO, |m, c| m.max(c.abs())) * gamma;
    // (Of the worst axis: the test's shear brings the others' rounding into the height above the plane.)
    point + normal * (error.max_element() + f32::MIN_POSITIVE)
}

#[cfg(test)]
#[path = "rays_tests.rs"]
mod tests;
