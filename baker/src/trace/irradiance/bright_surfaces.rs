//! Bright surfaces as lights. Cosine-sampled paths that read the cache are noisy where much of the light
//! comes from little surface: a patch of sun on the floor, the inside of a lampshade. Once the cache is
//! solved, those are known: they are cut into facets, sampled, and weighted against the path by the balance
//! heuristic.
//!
//! Daylight has facets of its own, shared by all its layers, and so has every group. In a room behind a
//! portal, daylight has others: what is bright there may be dim beside the sunlit outside. Of more than a few
//! groups some are sampled with each path ([`crate::trace::sources::light_subset`]). A facet is chosen in
//! proportion to √Σ (its light ÷ the layer's mean)² over those layers, the best choice for the sum of their
//! relative variances; and by how much of it arrives at the receiver, which a [`BrightSurfaceView`] holds for
//! clusters of facets, shadows included.

use super::bright_facets::{BrightFacet, BrightFacets, BrightSelection, Cluster, TriangleSide, point_of};
use super::cache_half::CacheHalf;
use super::cache_map::CacheMap;
use crate::Rgb;
use crate::geometry::Geometry;
use crate::trace::counts::RayCounts;
use crate::trace::paths::Sample;
use crate::trace::rays::Hit;
use crate::trace::solids::{Receiver, Space};
use crate::trace::sources::Room;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;
use std::ops::Range;

/// The bright facets of a scene, for some of its layers.
pub struct BrightSurfaces {
    /// The layers.
    pub layers: Range<usize>,
    /// Tells its random numbers from those of other layers.
    pub key: u32,
    /// The room they are in; `None`: anywhere.
    pub room: Option<Room>,
    facets: Vec<BrightFacet>,
    /// Per facet, the sum of the powers of its cluster's facets up to and with it, over that of all.
    up_to: Vec<f32>,
    clusters: Vec<Cluster>,
}

/// A point of a facet.
#[derive(Clone, Copy, Debug)]
struct BrightFacetPoint {
    triangle: u32,
    is_back: bool,
    barycentric: Vec3,
    /// The same in space.
    point: Vec3,
    /// Unit normal of that side.
    normal: Vec3,
    /// Density over area with which it was chosen.
    density: f32,
}

/// How much of each cluster's light arrives somewhere: sums of probabilities, up to 1.
#[derive(Clone, Debug)]
pub struct BrightSurfaceView {
    up_to: Vec<f32>,
    arrives: f32,
}

impl BrightSurfaceView {
    /// Light that arrives from all of them, relative to the mean of their layers: what sampling them is
    /// worth.
    pub fn worth(&self) -> f32 {
        self.arrives
    }
}

impl BrightSurfaces {
    /// The bright facets among the `sides` of all surfaces of the cache; `None` where little comes from them.
    pub fn new(
        geometry: &Geometry,
        map: &CacheMap,
        halves: &[CacheHalf; 2],
        sides: &[TriangleSide],
        selection: BrightSelection,
    ) -> Option<Self> {
        let bright = BrightFacets::find(geometry, map, halves, sides, &selection)?;
        let (BrightSelection { layers, key, room, .. }, BrightFacets { facets, up_to, clusters }) =
            (selection, bright);
        Some(BrightSurfaces { layers, key, room, facets, up_to, clusters })
    }

    /// What of their light arrives around some receivers; the samples are those the receivers were chosen by.
    /// `None` where nothing does.
    pub fn view(
        &self,
        space: &Space,
        receivers: &[(Receiver, Sample)],
        counts: &mut RayCounts,
    ) -> Option<BrightSurfaceView> {
        let is_free = |r: usize, direction: Vec3, distance: f32| {
            counts.bright_surface += 1;
            let at = &receivers[r].0;
            !space.ray_tracer.occluded(at.origin, direction, distance * (1.0 - 1e-3), at.triangle)
        };
        let points: Vec<(Vec3, Vec3)> = receivers.iter().map(|(r, _)| (r.origin, r.normal)).collect();
        let number = |r: usize, k: usize| receivers[r].1.number(dimension(k as u32));
        self.view_from(&points, number, is_free)
    }

    /// As [`BrightSurfaces::view`], from places (origin, normal); `number` chooses a facet of the k-th
    /// cluster for a place, and `is_free` tells whether nothing stands between a place and the point in a
    /// direction at a distance.
    fn view_from(
        &self,
        points: &[(Vec3, Vec3)],
        number: impl Fn(usize, usize) -> f32,
        mut is_free: impl FnMut(usize, Vec3, f32) -> bool,
    ) -> Option<BrightSurfaceView> {
        /// Part of a cluster's light that is taken to arrive although no ray did.
        const HIDDEN: f32 = 0.05;
        /// Distances count for no less than this part of a cluster's size: one facet beside the receiver is
        /// not all of it.
        const NEAR2: f32 = 0.05;
        let mut arrives = vec![0f32; self.clusters.len()];
        for (k, cluster) in self.clusters.iter().enumerate() {
            for (r, &(origin, normal)) in points.iter().enumerate() {
                let facet = &self.facets[self.facet_of_cluster(cluster, number(r, k))];
                let (direction, distance) = (facet.middle - origin).normalize_and_length();
                let (at, from) = (direction.dot(normal), -direction.dot(facet.normal));
                if at <= 0.0 || from <= 0.0 {
                    continue;
                }
                let form = at * from / (distance * distance).max(NEAR2 * cluster.extent2);
                let free = is_free(r, direction, distance);
                arrives[k] += cluster.power * form * if free { 1.0 } else { HIDDEN };
            }
        }
        let total: f32 = arrives.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mut sum = 0.0;
        let mut up_to: Vec<f32> = arrives
            .iter()
            .map(|a| {
                sum += a / total;
                sum
            })
            .collect();
        if let Some(last) = up_to.last_mut() {
            *last = last.max(1.0);
        }
        Some(BrightSurfaceView { up_to, arrives: total / points.len() as f32 })
    }

    /// One sample of the light that they reflect to `at`: where from, from which side, and the irradiance at
    /// `at` per unit of it there, weighted against the path that may meet them. `chance`: the probability
    /// with which such a sample is taken at all.
    pub fn reflected(
        &self,
        space: &Space,
        at: &Receiver,
        view: &BrightSurfaceView,
        chance: f32,
        sample: Sample,
        counts: &mut RayCounts,
    ) -> Option<(Hit, bool, Rgb)> {
        let dimension = dimension(self.key);
        let point = self.sample(view, sample.number(dimension), sample.pair(dimension))?;
        let (direction, distance) = (point.point - at.origin).normalize_and_length();
        let from = -direction.dot(point.normal);
        let cosine = direction.dot(at.normal);
        if from <= 0.0 || cosine <= 0.0 || direction.dot(at.face_normal) <= 0.0 {
            return None;
        }
        // (A hole of a cut-out reflects nothing.)
        let BrightFacetPoint { triangle, barycentric, is_back, .. } = point;
        if !space.geometry.is_solid_at(triangle as usize, barycentric) {
            return None;
        }
        // Radiance is albedo ÷ π times the irradiance there; over the densities of both ways to find it.
        let pdf = chance * point.density * distance * distance / from;
        let weight = cosine / (pdf + cosine / PI);
        if !(weight.is_finite() && weight > 0.0) {
            return None;
        }
        counts.bright_surface += 1;
        let reach = space.ray_tracer.distance_to(at.origin, direction, distance, triangle);
        let through = space.ray_tracer.transmittance_of_light(at.origin, direction, reach, at.triangle);
        if through == Rgb::ZERO {
            return None;
        }
        let albedo = space.geometry.albedo_at(triangle as usize, barycentric) * through;
        Some((Hit { triangle, barycentric, t: distance }, is_back, albedo * (weight / PI)))
    }

    /// A facet of a cluster, in proportion to power.
    fn facet_of_cluster(&self, cluster: &Cluster, u: f32) -> usize {
        let up_to = &self.up_to[cluster.first as usize..(cluster.first + cluster.count) as usize];
        let i = up_to.partition_point(|sum| *sum <= u).min(up_to.len() - 1);
        cluster.first as usize + i
    }

    /// A point in proportion to what arrives. `choice` chooses the facet, `u` the point on it.
    fn sample(&self, view: &BrightSurfaceView, choice: f32, u: Vec2) -> Option<BrightFacetPoint> {
        let k = view.up_to.partition_point(|p| *p <= choice).min(view.up_to.len() - 1);
        let before = if k > 0 { view.up_to[k - 1] } else { 0.0 };
        let left = (choice - before) / (view.up_to[k] - before);
        if !(0.0..=1.0).contains(&left) {
            return None;
        }
        let i = self.facet_of_cluster(&self.clusters[k], left);
        let facet = &self.facets[i];
        let fold = if u.x + u.y > 1.0 { Vec2::ONE - u } else { u };
        Some(BrightFacetPoint {
            triangle: facet.triangle,
            is_back: facet.is_back,
            barycentric: point_of(facet.along, facet.number, fold),
            point: facet.corner + facet.edges[0] * fold.x + facet.edges[1] * fold.y,
            normal: facet.normal,
            density: self.density(view, i),
        })
    }

    /// The bright facets.
    pub fn facets(&self) -> &[BrightFacet] {
        &self.facets
    }

    /// The density over area with which a sample gives a point of a facet.
    pub fn density(&self, view: &BrightSurfaceView, facet: usize) -> f32 {
        let facet = &self.facets[facet];
        let k = facet.cluster as usize;
        let before = if k > 0 { view.up_to[k - 1] } else { 0.0 };
        (view.up_to[k] - before) * (facet.power / self.clusters[k].power) / facet.area
    }
}

/// Dimensions of the samples' numbers.
fn dimension(key: u32) -> u32 {
    key.wrapping_add(0x7265_666c)
}

#[cfg(test)]
#[path = "bright_surfaces_tests.rs"]
mod tests;
