//! Where to look from when nobody says: a place outside all bodies, with room around it and light in view.

use crate::geometry::Geometry;
use crate::trace::rays::{Hit, NO_TRIANGLE, RayTracer};
use glam::{DVec3, Vec3};
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// Directions that tell whether a place is inside a body.
const DIRECTIONS_AROUND: usize = 48;
/// Places along each horizontal side of the box that is searched, and the heights in it.
const POINTS_ALONG: usize = 9;
const HEIGHTS: [f64; 3] = [0.55, 0.4, 0.7];
/// Headings that are tried at a place.
const HEADINGS: usize = 8;
/// Rays across a view, and from top to bottom.
const RAYS_ACROSS: usize = 8;
const RAYS_DOWN: usize = 5;
/// What half of a view may be, horizontally, in degrees.
const MOST_HALF_VIEW: f64 = 35.0;
/// Part of the box's length within which a place has no room.
const LEAST_ROOM: f64 = 0.01;

/// What tells good places from bad ones.
pub(super) struct DefaultViewpoint<'a> {
    pub geometry: &'a Geometry,
    pub ray_tracer: &'a RayTracer<'a>,
    /// Luminance that a surface shows.
    pub luminance: &'a dyn Fn(&Hit) -> f32,
}

/// A place and the point to look at.
pub(super) type View = (DVec3, DVec3);

impl DefaultViewpoint<'_> {
    /// What is met from a place of the world.
    fn hit(&self, place: DVec3, direction: Vec3) -> Option<Hit> {
        self.ray_tracer.nearest_wall((place - self.geometry.origin).as_vec3(), direction, NO_TRIANGLE)
    }

    fn is_back(&self, hit: &Hit, direction: Vec3) -> bool {
        self.geometry.normal(hit.triangle as usize).dot(direction) > 0.0
    }

    /// Whether a place lies outside all bodies, with nothing closer than `room`: of what is seen all around,
    /// hardly anything shows its back. (Whether a material is two-sided says nothing here: many programs
    /// export all of them so.)
    pub(super) fn is_free(&self, place: DVec3, room: f64) -> bool {
        /// Part of what is seen that may show its back: leaves, and sheets.
        const BACKS: usize = DIRECTIONS_AROUND / 4;
        let hits = sphere(DIRECTIONS_AROUND).map(|direction| (direction, self.hit(place, direction)));
        let (mut backs, mut closest) = (0, f64::INFINITY);
        for (direction, hit) in hits.filter_map(|(direction, hit)| Some((direction, hit?))) {
            backs += usize::from(self.is_back(&hit, direction));
            closest = closest.min(f64::from(hit.t));
        }
        backs <= BACKS && closest >= room
    }

    /// How much a view shows: over its ray_tracer: &rays, the root of the distance to what is lit, in units
    /// of `length`, and more for many materials. What is dimmer than `light` counts in proportion.
    pub(super) fn worth(&self, (place, look_at): View, length: f64, light: f32) -> f64 {
        let forward = (look_at - place).normalize_or(DVec3::NEG_Z);
        let right = forward.cross(DVec3::Y).normalize_or(DVec3::X);
        let up = right.cross(forward);
        let reach = MOST_HALF_VIEW.to_radians().tan();
        let side = |i: usize, n: usize| (2.0 * (i as f64 + 0.5) / n as f64 - 1.0) * reach;
        let rays = (0..RAYS_ACROSS * RAYS_DOWN).map(|i| {
            let (x, y) = (side(i % RAYS_ACROSS, RAYS_ACROSS), side(i / RAYS_ACROSS, RAYS_DOWN) * 9.0 / 16.0);
            (forward + right * x + up * y).normalize().as_vec3()
        });
        let mut seen = BTreeSet::new();
        let mut sum = 0.0;
        for direction in rays {
            if let Some(hit) = self.hit(place, direction).filter(|hit| !self.is_back(hit, direction)) {
                let shown = f64::from(((self.luminance)(&hit) / light).min(1.0));
                sum += shown * (f64::from(hit.t) / length).min(1.0).sqrt();
                seen.insert(self.geometry.material_of[hit.triangle as usize]);
            }
        }
        // A bare wall is no view.
        sum / (RAYS_ACROSS * RAYS_DOWN) as f64 * (seen.len() as f64).sqrt()
    }

    /// The mean luminance of what is seen from some places.
    fn light(&self, points: &[DVec3]) -> f32 {
        let (mut sum, mut count) = (0.0, 0);
        for place in points {
            for hit in sphere(DIRECTIONS_AROUND / 4).filter_map(|direction| self.hit(*place, direction)) {
                (sum, count) = (sum + f64::from((self.luminance)(&hit)), count + 1);
            }
        }
        ((sum / f64::from(count.max(1))) as f32).max(f32::MIN_POSITIVE)
    }

    /// Those places of a lattice in a box that lie outside all bodies and have room around them.
    pub(super) fn free_places(&self, low: DVec3, high: DVec3) -> Vec<DVec3> {
        let (size, length) = (high - low, (high - low).length());
        let at = |i: usize, height: f64| {
            let of = |k: usize| (k as f64 + 0.5) / POINTS_ALONG as f64;
            low + size * DVec3::new(of(i % POINTS_ALONG), height, of(i / POINTS_ALONG))
        };
        let points = HEIGHTS
            .into_iter()
            .flat_map(|height| (0..POINTS_ALONG * POINTS_ALONG).map(move |i| at(i, height)));
        points.filter(|place| self.is_free(*place, LEAST_ROOM * length)).collect()
    }

    /// `first`, if it lies outside all bodies and shows half of what the best view does; else the best view
    /// from a lattice of places in a box; `first` all the same where none of them is free.
    pub(super) fn best(&self, first: View, low: DVec3, high: DVec3) -> View {
        let length = (high - low).length();
        let points = self.free_places(low, high);
        let light = self.light(&points);
        let mut best: Option<(f64, View)> = None;
        for &place in &points {
            for heading in 0..HEADINGS {
                let (sin, cos) = (TAU * heading as f64 / HEADINGS as f64).sin_cos();
                // A little downwards, as people look.
                let view = (place, place + DVec3::new(sin, -0.15, -cos) * (0.25 * length));
                let worth = self.worth(view, length, light);
                if best.is_none_or(|(most, _)| worth > most) {
                    best = Some((worth, view));
                }
            }
        }
        match best {
            Some((most, best)) => {
                let is_good = self.is_free(first.0, LEAST_ROOM * length)
                    && self.worth(first, length, light) >= 0.5 * most;
                if is_good { first } else { best }
            }
            None => first,
        }
    }
}

/// Directions spread evenly over the sphere, by the golden ratio.
fn sphere(count: usize) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |i| {
        let (y, phi) = (1.0 - 2.0 * (i as f64 + 0.5) / count as f64, i as f64 * TAU * 0.618_034);
        let r = (1.0 - y * y).sqrt();
        DVec3::new(r * phi.cos(), y, r * phi.sin()).as_vec3()
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::Material;
    use glam::{Vec2, dvec3};

    /// A room of 6 × 3 × 6 m, divided by a wall half a metre thick through its middle; all materials
    /// two-sided. In the eastern half (x > 0) there is light.
    pub(crate) fn divided() -> Geometry {
        let material = Material {
            albedo: Vec3::splat(0.5),
            albedo_max: 1.0,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: true,
            emission: None,
        };
        let mut g = Geometry { materials: vec![material], ..Geometry::default() };
        block(&mut g, Vec3::new(-3.0, 0.0, -3.0), Vec3::new(3.0, 3.0, 3.0), true);
        block(&mut g, Vec3::new(-0.25, -0.1, -3.1), Vec3::new(0.25, 3.1, 3.1), false);
        g
    }

    /// The six sides of a box, seen from inside or outside.
    pub(crate) fn block(g: &mut Geometry, low: Vec3, high: Vec3, inside: bool) {
        for axis in 0..3 {
            for upper in [false, true] {
                let (size, one) = (high - low, Vec3::AXES);
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let corner = if upper { low + one[axis] * size[axis] } else { low };
                let (u, v) = (one[u] * size[u], one[v] * size[v]);
                let (u, v) = if upper != inside { (u, v) } else { (v, u) };
                let first = g.positions.len() as u32;
                for p in [corner, corner + u, corner + u + v, corner + v] {
                    g.positions.push(p);
                    g.normals.push(u.cross(v).normalize());
                    g.uvs.push(Vec2::ZERO);
                    g.lightmap_uvs.push(Vec2::ZERO);
                }
                g.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
                g.material_of.extend([0, 0]);
            }
        }
    }

    #[test]
    fn the_inside_of_a_wall_is_left_for_the_half_with_light() {
        let g = divided();
        let rays = RayTracer::new(&g);
        let is_east = |hit: &Hit| {
            let [a, b, c] = g.corners(hit.triangle as usize);
            let at = a * hit.barycentric.x + b * hit.barycentric.y + c * hit.barycentric.z;
            f32::from(u8::from(at.x > 0.2))
        };
        let viewpoint = DefaultViewpoint { geometry: &g, ray_tracer: &rays, luminance: &is_east };
        let middle = dvec3(0.0, 1.5, 0.0);
        assert!(!viewpoint.is_free(middle, 0.0) && viewpoint.is_free(dvec3(1.5, 1.5, 0.0), 0.5));
        let (low, high) = (dvec3(-3.0, 0.0, -3.0), dvec3(3.0, 3.0, 3.0));
        let (place, look_at) = viewpoint.best((middle, DVec3::ZERO), low, high);
        assert!(place.x > 0.3, "{place}");
        assert!(viewpoint.worth((place, look_at), 8.0, 1.0) > 0.2);
        // A place that does as well is kept.
        let good = (place + dvec3(0.1, 0.0, 0.1), look_at);
        assert_eq!(viewpoint.best(good, low, high), good);
    }
}
