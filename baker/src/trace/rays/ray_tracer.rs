//! Rays against the scene's triangles: nearest hit and occlusion, with cut-outs really open.
//!
//! Glass is asked about by what a ray is for: [`RayTracer::nearest`] meets it as any surface and
//! [`RayTracer::nearest_behind`] goes on behind it, [`RayTracer::transmittance`] tells how much light passes,
//! and to [`RayTracer::nearest_wall`] and [`RayTracer::occluded`] it is as if it were not there. In a scene
//! without glass all of these are the plain queries.

use super::backend::Backend;
use super::bvh8::{Bvh8, Line, Reach};
#[cfg(feature = "embree")]
use super::embree;
use super::light_point::LightPoint;
use super::triangle::{Hit, TriangleHit};
use crate::geometry::{BLOCKED_BELOW, Geometry};
use crate::{Result, Rgb};
use glam::Vec3;
use std::cell::Cell;
use std::sync::Arc;

/// The ray tracer: a hierarchy over all triangles, and what decides whether a hit counts.
pub struct RayTracer<'a> {
    geometry: &'a Geometry,
    hierarchy: Hierarchy<'a>,
}

enum Hierarchy<'a> {
    Own(Arc<Bvh8>, std::marker::PhantomData<&'a ()>),
    #[cfg(feature = "embree")]
    Embree(embree::Scene<'a>),
}

impl<'a> RayTracer<'a> {
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
                Ok(RayTracer { geometry, hierarchy: Hierarchy::Embree(embree::Scene::new(geometry)?) })
            }
            #[cfg(not(feature = "embree"))]
            Backend::Embree => backend.expect_built().map(|()| Self::new(geometry)),
        }
    }

    /// Rays through a hierarchy already built over `geometry`.
    pub fn with_hierarchy(geometry: &'a Geometry, hierarchy: impl Into<Arc<Bvh8>>) -> Self {
        RayTracer { geometry, hierarchy: Hierarchy::Own(hierarchy.into(), std::marker::PhantomData) }
    }

    /// The nearest hit along the unit `direction`, glass included; `from` is the triangle the ray starts on,
    /// which it cannot hit. What lies behind the origin or exactly at it does not count.
    #[inline]
    pub fn nearest(&self, origin: Vec3, direction: Vec3, from: u32) -> Option<Hit> {
        self.nearest_unless(origin, direction, from, &|_| false)
    }

    /// The nearest hit behind those that were passed, all of which are glass: [`RayTracer::nearest`] where
    /// none was.
    #[inline]
    pub fn nearest_behind(
        &self,
        origin: Vec3,
        direction: Vec3,
        from: u32,
        passed: &PassedGlass,
    ) -> Option<Hit> {
        self.nearest_unless(origin, direction, from, &|hit| passed.holds(hit))
    }

    /// The nearest hit that is not on glass.
    #[inline]
    pub fn nearest_wall(&self, origin: Vec3, direction: Vec3, from: u32) -> Option<Hit> {
        if !self.geometry.has_glass() {
            return self.nearest(origin, direction, from);
        }
        self.nearest_unless(origin, direction, from, &|hit| self.is_glass(hit))
    }

    /// Whether anything but glass stands between `origin` and the point at distance `t_max` along the unit
    /// `direction`.
    #[inline]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32, from: u32) -> bool {
        if !self.geometry.has_glass() {
            return self.occluded_unless(origin, direction, t_max, None, from, &|_| false);
        }
        self.occluded_unless(origin, direction, t_max, None, from, &|hit| self.is_glass(hit))
    }

    /// Per channel, how much of the light from the point at distance `t_max` along the unit `direction`
    /// arrives at `origin`: 1 where nothing stands between, the product over all glass that does, 0 behind
    /// anything else.
    #[inline]
    pub fn transmittance(&self, origin: Vec3, direction: Vec3, t_max: f32, from: u32) -> Rgb {
        self.transmittance_from(origin, direction, t_max, None, from)
    }

    /// The same from a point of a light: what that touches (see `light_point`) does not stand between.
    #[inline]
    pub fn transmittance_of_light(&self, origin: Vec3, direction: Vec3, t_max: f32, from: u32) -> Rgb {
        let end = LightPoint::new(origin, direction, t_max);
        self.transmittance_from(origin, direction, t_max, Some(end), from)
    }

    #[inline]
    fn transmittance_from(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        end: Option<LightPoint>,
        from: u32,
    ) -> Rgb {
        if !self.geometry.has_glass() {
            let is_blocked = self.occluded_unless(origin, direction, t_max, end, from, &|_| false);
            return if is_blocked { Rgb::ZERO } else { Rgb::ONE };
        }
        self.transmittance_of_glass(origin, direction, t_max, end, from)
    }

    #[cold]
    fn transmittance_of_glass(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        end: Option<LightPoint>,
        from: u32,
    ) -> Rgb {
        let left = Cell::new(Rgb::ONE);
        // All that the ray meets is asked about in turn, in an order that is a function of the ray and the
        // hierarchy.
        let passes = |hit: &Hit| {
            let triangle = hit.triangle as usize;
            self.geometry.is_glass(triangle) && {
                left.set(left.get() * self.geometry.transmittance_at(triangle, hit.barycentric));
                left.get().max_element() >= BLOCKED_BELOW
            }
        };
        if self.occluded_unless(origin, direction, t_max, end, from, &passes) {
            Rgb::ZERO
        } else {
            left.get()
        }
    }

    fn is_glass(&self, hit: &Hit) -> bool {
        !self.geometry.is_wall_at(hit.triangle as usize, hit.barycentric)
    }

    /// The nearest hit that does not pass; `passes` is asked about glass alone.
    #[inline]
    fn nearest_unless(
        &self,
        origin: Vec3,
        direction: Vec3,
        from: u32,
        passes: &dyn Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        match &self.hierarchy {
            Hierarchy::Own(bvh, _) => {
                let line = Line::new(origin, direction)?;
                let is_open = |t: u32, m: &TriangleHit| self.is_open(&hit_of(t, m), passes);
                let (triangle, triangle_hit) = bvh.nearest(&line, from, &is_open)?;
                Some(hit_of(triangle, &triangle_hit))
            }
            #[cfg(feature = "embree")]
            Hierarchy::Embree(scene) => scene.nearest(origin, direction, from, passes),
        }
    }

    /// Whether a hit that does not pass stands before `t_max`; `passes` is asked about glass alone. What
    /// `end` touches does not count.
    #[inline]
    fn occluded_unless(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        end: Option<LightPoint>,
        from: u32,
        passes: &dyn Fn(&Hit) -> bool,
    ) -> bool {
        match &self.hierarchy {
            Hierarchy::Own(bvh, _) => Line::new(origin, direction).is_some_and(|line| {
                let ask_from = end.as_ref().map_or(f32::INFINITY, LightPoint::ask_from);
                bvh.occluded(&line, Reach { t_max, ask_from }, from, &|t, m| {
                    let hit = hit_of(t, m);
                    let touches = |end: &LightPoint| hit.t >= ask_from && end.touches(self.geometry, t);
                    end.as_ref().is_some_and(touches) || self.is_open(&hit, passes)
                })
            }),
            #[cfg(feature = "embree")]
            Hierarchy::Embree(scene) => scene.occluded(origin, direction, t_max, end, from, passes),
        }
    }

    /// Whether this triangle alone stands between `origin` and the point at distance `t_max`: then
    /// [`RayTracer::occluded`] is true. Neither a cut-out nor glass ever does here.
    pub fn is_blocked_by(&self, origin: Vec3, direction: Vec3, t_max: f32, triangle: u32) -> bool {
        let material = &self.geometry.materials[self.geometry.material_of[triangle as usize] as usize];
        let corners = self.geometry.corners(triangle as usize);
        material.alpha_cutoff.is_none()
            && !self.geometry.is_glass(triangle as usize)
            && Line::new(origin, direction)
                .is_some_and(|line| line.exact.intersect(&corners, f64::from(t_max)).is_some())
    }

    /// How far along a ray a triangle is met, about `distance` away.
    #[inline]
    pub fn distance_to(&self, origin: Vec3, direction: Vec3, distance: f32, triangle: u32) -> f32 {
        let corners = self.geometry.corners(triangle as usize);
        let triangle_hit =
            Line::new(origin, direction).and_then(|line| line.exact.intersect(&corners, f64::INFINITY));
        triangle_hit.map_or(distance, |triangle_hit| triangle_hit.t as f32)
    }

    /// Whether `stands` holds for a triangle (its index and corners) whose box meets the one from `low` to
    /// `high`; true where that cannot be asked (Embree).
    pub fn any_in_box(&self, low: Vec3, high: Vec3, stands: impl FnMut(u32, [Vec3; 3]) -> bool) -> bool {
        match &self.hierarchy {
            Hierarchy::Own(bvh, _) => bvh.any_in_box(low, high, stands),
            #[cfg(feature = "embree")]
            Hierarchy::Embree(_) => true,
        }
    }

    /// Our own hierarchy: with Embree, built for this call.
    pub fn own_hierarchy(&self) -> Arc<Bvh8> {
        match &self.hierarchy {
            Hierarchy::Own(bvh, _) => bvh.clone(),
            #[cfg(feature = "embree")]
            Hierarchy::Embree(_) => Arc::new(Bvh8::new(self.geometry)),
        }
    }

    /// Where a ray meets one triangle, be it the nearest or not; `None` also where that is cut out.
    pub fn hit_on(&self, origin: Vec3, direction: Vec3, triangle: u32) -> Option<Hit> {
        let corners = self.geometry.corners(triangle as usize);
        let triangle_hit = Line::new(origin, direction)?.exact.intersect(&corners, f64::INFINITY)?;
        let hit = hit_of(triangle, &triangle_hit);
        self.geometry.is_solid_at(triangle as usize, hit.barycentric).then_some(hit)
    }

    #[cold]
    fn is_open(&self, hit: &Hit, passes: &dyn Fn(&Hit) -> bool) -> bool {
        !self.geometry.is_solid_at(hit.triangle as usize, hit.barycentric)
            || self.geometry.is_glass(hit.triangle as usize)
                && (self.geometry.is_of_neighbour(hit.triangle as usize, hit.barycentric) || passes(hit))
    }
}

#[inline]
fn hit_of(triangle: u32, triangle_hit: &TriangleHit) -> Hit {
    Hit { triangle, barycentric: triangle_hit.barycentric(), t: triangle_hit.t as f32 }
}

/// The glass a ray has passed: what is nearer than the last, and what lies where that does.
#[derive(Clone, Copy, Debug, Default)]
pub struct PassedGlass {
    t: f32,
    /// Those exactly at `t`: panes that coincide, and both triangles at an edge.
    triangles: [u32; PassedGlass::MOST],
    count: usize,
}

impl PassedGlass {
    /// Surfaces that coincide, of which a path meets each; were there more, the rest would count as passed.
    const MOST: usize = 8;

    /// Adds a hit that is no nearer than any before.
    pub fn add(&mut self, hit: &Hit) {
        if hit.t != self.t {
            (self.t, self.count) = (hit.t, 0);
        }
        if let Some(place) = self.triangles.get_mut(self.count) {
            *place = hit.triangle;
            self.count += 1;
        }
    }

    fn holds(&self, hit: &Hit) -> bool {
        let at_last = &self.triangles[..self.count];
        hit.t < self.t || hit.t == self.t && (self.count == Self::MOST || at_last.contains(&hit.triangle))
    }
}

/// A point of a triangle, moved off its surface to the side of `normal` by more than rounding can have sunk
/// it (Pharr, Jakob & Humphreys 2023, "Physically Based Rendering", section 6.8).
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
#[path = "ray_tracer_tests.rs"]
mod tests;
