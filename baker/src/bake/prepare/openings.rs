//! Window-like openings of rooms: rectangles through which the sky is seen from inside.

use crate::geometry::{Bounds, Geometry};
use crate::scene::Portal;
use crate::trace::rays::NO_TRIANGLE;
use crate::trace::rays::ray_tracer::{RayTracer, offset_point};
use crate::trace::sources::Room;
use dataset::observe::count;
use glam::{DVec3, Vec3};
use std::f32::consts::TAU;

/// Points on surfaces from which rays are sent, and rays of each.
const POINTS: u32 = 4096;
const RAYS: u32 = 32;
/// A point is inside if at most this share of its rays leaves the scene.
const MOST_LEAVING_FROM_INSIDE: f32 = 0.25;
/// Rays from inside that leave the scene and are followed through their opening, at most.
const MOST_FOLLOWED_RAYS: usize = 512;
/// Metres between places looked at along such a ray, and how far from its start it is followed.
const STEP_LENGTH: f32 = 0.08;
const FARTHEST_OPENING: f32 = 40.0;
/// Longest way in metres through the opening of a wall.
const THICKEST_FRAME: f32 = 1.0;
/// Largest side of an opening in metres; a larger one needs no portal to be found.
const WIDEST_OPENING: f32 = 8.0;
/// Smallest side.
const NARROWEST_OPENING: f32 = 0.1;
/// Openings nearer than this are one, with its bars.
const WIDEST_BAR: f32 = 0.25;
/// Most openings that are told, those that most light comes through.
const MOST_OPENINGS: usize = 12;
/// Fewer rays than this through an opening are chance.
const FEWEST_RAYS: usize = 3;

/// A rectangle across an opening, in its own axes.
#[derive(Clone, Copy, Debug)]
struct Opening {
    /// Which of the three axes it is perpendicular to.
    axis: usize,
    /// Place along that axis, and from where to where along the two others.
    depth: f32,
    low: [f32; 2],
    high: [f32; 2],
    /// Rays that left by it.
    votes: usize,
}

impl Opening {
    fn area(&self) -> f32 {
        (self.high[0] - self.low[0]) * (self.high[1] - self.low[1])
    }

    /// The same in space.
    fn rectangle(&self, axes: &[Vec3; 3]) -> Rectangle {
        let [n, u, v] = others(self.axis).map(|i| axes[i]);
        let size = |i: usize| self.high[i] - self.low[i];
        let corner = n * self.depth + u * self.low[0] + v * self.low[1];
        Rectangle { corner, edges: [u * size(0), v * size(1)] }
    }

    /// Whether its four sides are straight: free space across it ends at the same place all along.
    fn is_framed(&self, ray_tracer: &RayTracer, axes: &[Vec3; 3]) -> bool {
        /// Lines across it, and how many of them may end elsewhere.
        const LINES: u32 = 7;
        const MOST_ELSEWHERE: u32 = 1;
        let ([_, u, v], rectangle) = (others(self.axis).map(|i| axes[i]), self.rectangle(axes));
        let is_straight = |along: usize| {
            let (direction, size) = ([u, v][along], self.high[along] - self.low[along]);
            let elsewhere = (0..LINES).filter(|&k| {
                let share = (k as f32 + 0.5) / LINES as f32;
                let p = if along == 0 { rectangle.at(0.5, share) } else { rectangle.at(share, 0.5) };
                let ends_there = |d: Vec3| {
                    let hit = ray_tracer.nearest(p, d, NO_TRIANGLE);
                    hit.is_some_and(|hit| (hit.t - 0.5 * size).abs() <= 0.05 * size + 0.02)
                };
                !(ends_there(direction) && ends_there(-direction))
            });
            elsewhere.count() as u32 <= MOST_ELSEWHERE
        };
        is_straight(0) && is_straight(1)
    }

    /// Whether two are parts of one opening.
    fn touches(&self, other: &Opening) -> bool {
        let near =
            |i: usize| self.low[i] <= other.high[i] + WIDEST_BAR && other.low[i] <= self.high[i] + WIDEST_BAR;
        self.axis == other.axis && (self.depth - other.depth).abs() < 2.0 * WIDEST_BAR && near(0) && near(1)
    }

    /// Both as one.
    fn with(&self, other: &Opening) -> Opening {
        let (a, b) = (self.votes as f32, other.votes as f32);
        Opening {
            axis: self.axis,
            depth: (self.depth * a + other.depth * b) / (a + b),
            low: [0, 1].map(|i| self.low[i].min(other.low[i])),
            high: [0, 1].map(|i| self.high[i].max(other.high[i])),
            votes: self.votes + other.votes,
        }
    }
}

/// A rectangle in space.
struct Rectangle {
    corner: Vec3,
    edges: [Vec3; 2],
}

impl Rectangle {
    /// A place in it, by shares of its sides.
    fn at(&self, s: f32, t: f32) -> Vec3 {
        self.corner + self.edges[0] * s + self.edges[1] * t
    }

    fn normal(&self) -> Vec3 {
        self.edges[0].cross(self.edges[1]).normalize_or_zero()
    }

    /// Whether light comes in by one side of it only: there few rays meet anything.
    fn leads_out(&self, ray_tracer: &RayTracer) -> bool {
        /// Least share of the rays that leave the scene on the outside, and how many times that of the
        /// inside.
        const LEAST: f32 = 0.2;
        const TIMES: f32 = 3.0;
        let [a, b] = self.leaving(ray_tracer);
        a.max(b) >= LEAST && a.max(b) >= TIMES * a.min(b)
    }

    /// The box that most rays from it into the room end in, a little larger.
    fn room(&self, ray_tracer: &RayTracer) -> [Vec3; 2] {
        /// Rays, and how many of them may end beyond each side: those that leave by another window.
        const MANY: u32 = 1024;
        const BEYOND: usize = 20;
        let [a, b] = self.leaving(ray_tracer);
        let inwards = if a <= b { self.normal() } else { -self.normal() };
        let end = |i: u32| {
            let [s, t] = [0.754_877_7, 0.569_840_3].map(|step| (i as f32 * step).fract());
            let (from, direction) = (self.at(s, t), around(inwards, i, MANY, s));
            ray_tracer.nearest(from, direction, NO_TRIANGLE).map(|hit| from + direction * hit.t)
        };
        let ends: Vec<Vec3> = (0..MANY).filter_map(end).collect();
        let corners = [self.at(0.0, 0.0), self.at(1.0, 1.0)];
        let (mut low, mut high) = (corners[0].min(corners[1]), corners[0].max(corners[1]));
        for axis in 0..3 {
            let mut places: Vec<f32> = ends.iter().map(|end| end[axis]).collect();
            places.sort_by(f32::total_cmp);
            if let (Some(&first), Some(&last)) =
                (places.get(BEYOND), places.len().checked_sub(BEYOND + 1).and_then(|i| places.get(i)))
            {
                (low[axis], high[axis]) = (low[axis].min(first), high[axis].max(last));
            }
        }
        let more = Room::margin(high - low);
        [low - more, high + more]
    }

    /// Of rays to the one side and to the other, the shares that leave the scene.
    fn leaving(&self, ray_tracer: &RayTracer) -> [f32; 2] {
        let n = self.normal();
        let share = |normal: Vec3| {
            let leaves = |i: u32| {
                let [s, t] = [0.754_877_7, 0.569_840_3].map(|step| (i as f32 * step).fract());
                ray_tracer.nearest(self.at(s, t), around(normal, i, RAYS, s), NO_TRIANGLE).is_none()
            };
            (0..RAYS).filter(|&i| leaves(i)).count() as f32 / RAYS as f32
        };
        [share(n), share(-n)]
    }
}

/// The boxes of the rooms behind portals that lead outdoors, by opposite corners in the world.
pub(crate) fn rooms(portals: &[Portal], geometry: &Geometry, ray_tracer: &RayTracer) -> Vec<[DVec3; 2]> {
    let of_portal = |portal: &Portal| {
        let corner = (portal.corner - geometry.origin).as_vec3();
        let rectangle =
            Rectangle { corner, edges: [portal.edge_u, portal.edge_v].map(|edge| edge.as_vec3()) };
        portal.room.or_else(|| {
            let room = rectangle.leads_out(ray_tracer).then(|| rectangle.room(ray_tracer))?;
            Some(room.map(|corner| geometry.origin + corner.as_dvec3()))
        })
    };
    portals.iter().filter_map(of_portal).collect()
}

/// Openings in the walls and roofs of rooms, the most important one first; none in a scene without rooms, or
/// where walls are sheets without thickness.
pub(crate) fn openings(geometry: &Geometry, ray_tracer: &RayTracer) -> Vec<Portal> {
    let axes = axes(geometry);
    let leaving = leaving(geometry, ray_tracer);
    let bounds = Bounds::of(geometry.positions.iter().copied());
    let stride = leaving.len().div_ceil(MOST_FOLLOWED_RAYS).max(1);
    let mut found: Vec<Opening> = Vec::new();
    for &ray in leaving.iter().step_by(stride) {
        let Some(opening) = narrowest(ray_tracer, &axes, ray, leave_distance(bounds, ray)) else { continue };
        // The same opening was met before, a little deeper in its wall or by another pane.
        match found.iter_mut().find(|known| known.touches(&opening)) {
            Some(known) => *known = known.with(&opening),
            None => found.push(opening),
        }
    }
    // Those that grew may touch by now.
    let mut merged: Vec<Opening> = Vec::new();
    for opening in found {
        match merged.iter_mut().find(|known| known.touches(&opening)) {
            Some(known) => *known = known.with(&opening),
            None => merged.push(opening),
        }
    }
    merged.retain(|opening| {
        let is_wide = opening.high.iter().zip(opening.low).all(|(h, l)| h - l >= NARROWEST_OPENING);
        opening.votes >= FEWEST_RAYS && is_wide && opening.rectangle(&axes).leads_out(ray_tracer)
    });
    merged.sort_by(|a, b| b.votes.cmp(&a.votes).then(b.area().total_cmp(&a.area())));
    merged.truncate(MOST_OPENINGS);
    merged
        .iter()
        .map(|opening| portal(opening, &axes, geometry.origin, opening.rectangle(&axes).room(ray_tracer)))
        .collect()
}

/// The opening as a portal in the world, to the centimetre.
fn portal(opening: &Opening, axes: &[Vec3; 3], origin: DVec3, room: [Vec3; 2]) -> Portal {
    let [n, u, v] = others(opening.axis).map(|i| axes[i].as_dvec3());
    let round = |x: DVec3| (x * 100.0).round() / 100.0;
    let size = [0, 1].map(|i| f64::from(opening.high[i] - opening.low[i]));
    let corner =
        origin + n * f64::from(opening.depth) + u * f64::from(opening.low[0]) + v * f64::from(opening.low[1]);
    // Edges along the axes of the world stay perpendicular when rounded; others are left as they are.
    let is_straight = axes[0] == Vec3::X;
    let edge = |edge: DVec3| if is_straight { round(edge) } else { edge };
    let room = Some(room.map(|corner| round(origin + corner.as_dvec3())));
    Portal { corner: round(corner), edge_u: edge(u * size[0]), edge_v: edge(v * size[1]), room }
}

/// Direction `i` of `n` about a normal: by the cosine, turned by a share of a full circle.
fn around(normal: Vec3, i: u32, n: u32, turn: f32) -> Vec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let (r2, phi) = ((i as f32 + 0.5) / n as f32, (i as f32 * 0.618_034 + turn) * TAU);
    let (r, z) = (r2.sqrt(), (1.0 - r2).sqrt());
    (tangent * (r * phi.cos()) + bitangent * (r * phi.sin()) + normal * z).normalize()
}

/// An axis and the two others, in an order that turns right.
fn others(axis: usize) -> [usize; 3] {
    [axis, (axis + 1) % 3, (axis + 2) % 3]
}

/// Up, and the two horizontal directions that most walls face.
fn axes(geometry: &Geometry) -> [Vec3; 3] {
    // Walls that stand square to each other have the same direction once it is multiplied by four.
    let (mut sin, mut cos) = (0.0f64, 0.0f64);
    for t in 0..geometry.triangles.len() {
        let [a, b, c] = geometry.corners(t);
        let normal = (b - a).cross(c - a);
        let flat = normal.with_y(0.0);
        if flat.length() > 0.9 * normal.length() && flat.length() > 0.0 {
            let (s, c) = (4.0 * flat.z.atan2(flat.x)).sin_cos();
            sin += f64::from(s * flat.length());
            cos += f64::from(c * flat.length());
        }
    }
    let yaw = (sin.atan2(cos) / 4.0) as f32;
    // Walls along the axes of the world, but for rounding, are.
    let yaw = if yaw.abs() < 1e-3 { 0.0 } else { yaw };
    let x = Vec3::new(yaw.cos(), 0.0, yaw.sin());
    [x, Vec3::Y, x.cross(Vec3::Y)]
}

/// Rays that leave the scene from points from where few do.
fn leaving(geometry: &Geometry, ray_tracer: &RayTracer) -> Vec<(Vec3, Vec3)> {
    // Points spread evenly by area.
    let areas = (0..geometry.triangles.len()).map(|t| {
        let [a, b, c] = geometry.corners(t);
        f64::from((b - a).cross(c - a).length())
    });
    let sums: Vec<f64> = areas
        .scan(0.0, |sum, area| {
            *sum += area;
            Some(*sum)
        })
        .collect();
    let whole = sums.last().copied().unwrap_or(0.0);
    let mut result = Vec::new();
    if whole <= 0.0 {
        return result;
    }
    for i in 0..POINTS {
        let at = (f64::from(i) + 0.5) / f64::from(POINTS) * whole;
        let triangle = sums.partition_point(|&sum| sum <= at).min(sums.len() - 1);
        let normal = geometry.normal(triangle);
        if normal == Vec3::ZERO {
            continue;
        }
        let [s, t] = [0.754_877_7, 0.569_840_3].map(|step| (i as f32 * step).fract());
        let root = s.sqrt();
        let barycentric = Vec3::new(1.0 - root, root * (1.0 - t), root * t);
        let origin = offset_point(&geometry.corners(triangle), barycentric, normal);
        let directions = (0..RAYS).map(|k| around(normal, k, RAYS, s));
        let start = result.len();
        result.extend(
            directions
                .filter(|&d| ray_tracer.nearest(origin, d, triangle as u32).is_none())
                .map(|d| (origin, d)),
        );
        if (result.len() - start) as f32 > MOST_LEAVING_FROM_INSIDE * RAYS as f32 {
            result.truncate(start);
        }
    }
    result
}

/// The place by which a ray leaves its room: the narrowest one across any of the axes.
fn narrowest(ray_tracer: &RayTracer, axes: &[Vec3; 3], ray: (Vec3, Vec3), reach: f32) -> Option<Opening> {
    let found = (0..3).filter_map(|axis| opening_along(ray_tracer, axes, axis, ray, reach));
    found.min_by(|a, b| a.area().total_cmp(&b.area())).filter(|opening| opening.is_framed(ray_tracer, axes))
}

/// The narrowest of the last places along a ray that are bounded on all four sides across an axis.
fn opening_along(
    ray_tracer: &RayTracer,
    axes: &[Vec3; 3],
    axis: usize,
    ray: (Vec3, Vec3),
    reach: f32,
) -> Option<Opening> {
    let (origin, direction) = ray;
    let [n, u, v] = others(axis).map(|i| axes[i]);
    // Free space to both sides of a place.
    let across = |p: Vec3, d: Vec3| {
        let [plus, minus] = [d, -d].map(|d| ray_tracer.nearest(p, d, NO_TRIANGLE).map(|hit| hit.t));
        Some([minus?, plus?]).filter(|[minus, plus]| minus + plus <= WIDEST_OPENING)
    };
    let mut best: Option<(Opening, f32)> = None;
    for step in (1..=(reach / STEP_LENGTH) as u32).rev() {
        let t = step as f32 * STEP_LENGTH;
        let p = origin + direction * t;
        let bounded = across(p, v).and_then(|vs| Some((across(p, u)?, vs)));
        let Some((us, vs)) = bounded else {
            // Past the outer end of the opening, or before its inner one.
            if best.is_some() { break } else { continue }
        };
        let [at_u, at_v] = [u.dot(p), v.dot(p)];
        let low = [at_u - us[0], at_v - vs[0]];
        let high = [at_u + us[1], at_v + vs[1]];
        let opening = Opening { axis, depth: n.dot(p), low, high, votes: 1 };
        match &mut best {
            None => best = Some((opening, t)),
            Some((_, outer)) if *outer - t > THICKEST_FRAME => break,
            Some((narrowest, _)) if opening.area() < 0.98 * narrowest.area() => *narrowest = opening,
            Some(_) => {}
        }
    }
    best.map(|(opening, _)| opening)
}

/// How far along a ray anything of the box may lie.
fn leave_distance(Bounds { low, high }: Bounds, (origin, direction): (Vec3, Vec3)) -> f32 {
    let far = |i: usize| {
        let side = if direction[i] > 0.0 { high[i] } else { low[i] };
        if direction[i] == 0.0 { f32::INFINITY } else { (side - origin[i]) / direction[i] }
    };
    (0..3).map(far).fold(FARTHEST_OPENING, f32::min).max(0.0)
}

/// The openings that were found, by which the sky is looked for; `None` without any.
pub(crate) fn found_portals(portals: &[Portal]) -> Option<String> {
    let size = |portal: &Portal| format!("{:.2} × {:.2} m", portal.edge_u.length(), portal.edge_v.length());
    let sizes: Vec<String> = portals.iter().map(size).collect();
    (!portals.is_empty()).then(|| {
        format!(
            "the sky is looked for through {} of {} (`find_portals = false` in [sky] does without; [[portal]] says where)",
            count(portals.len(), "opening"),
            sizes.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box, its fronts outwards or inwards.
    fn block(geometry: &mut Geometry, low: Vec3, high: Vec3, inwards: bool) {
        let first = geometry.positions.len() as u32;
        for i in 0..8 {
            let pick = |bit: u32, l: f32, h: f32| if i >> bit & 1 == 0 { l } else { h };
            geometry.positions.push(Vec3::new(
                pick(0, low.x, high.x),
                pick(1, low.y, high.y),
                pick(2, low.z, high.z),
            ));
        }
        for [a, b, c, d] in
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        {
            for [a, b, c] in [[a, b, c], [a, c, d]] {
                let [b, c] = if inwards { [c, b] } else { [b, c] };
                geometry.triangles.push([a, b, c].map(|v| first + v));
            }
        }
    }

    /// A room of 6 × 3 × 4 m with walls 30 cm thick, and in its wall at +Z a window from (1, 1) to (2.4,
    /// 2.2).
    fn room() -> Geometry {
        let mut g = Geometry::default();
        let mut block =
            |low: [f32; 3], high: [f32; 3]| block(&mut g, Vec3::from(low), Vec3::from(high), false);
        block([-0.3, -0.3, -0.3], [6.3, 0.0, 4.3]);
        block([-0.3, 3.0, -0.3], [6.3, 3.3, 4.3]);
        block([-0.3, 0.0, -0.3], [6.3, 3.0, 0.0]);
        block([-0.3, 0.0, 0.0], [0.0, 3.0, 4.0]);
        block([6.0, 0.0, 0.0], [6.3, 3.0, 4.0]);
        block([-0.3, 0.0, 4.0], [1.0, 3.0, 4.3]);
        block([2.4, 0.0, 4.0], [6.3, 3.0, 4.3]);
        block([1.0, 0.0, 4.0], [2.4, 1.0, 4.3]);
        block([1.0, 2.2, 4.0], [2.4, 3.0, 4.3]);
        finish(g)
    }

    /// What rays ask for besides positions and triangles.
    fn finish(mut g: Geometry) -> Geometry {
        g.material_of = vec![0; g.triangles.len()];
        g.materials.push(crate::geometry::Material {
            albedo: Vec3::splat(0.5),
            albedo_max: 1.0,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: false,
            emission: None,
        });
        g
    }

    #[test]
    fn a_window_is_found_to_the_centimetre() {
        let g = room();
        let found = openings(&g, &RayTracer::new(&g));
        assert_eq!(found.len(), 1, "{found:?}");
        let Portal { corner, edge_u, edge_v, .. } = found[0];
        let far = corner + edge_u + edge_v;
        let (low, high) = (corner.min(far), corner.max(far));
        assert!((low.truncate() - glam::DVec2::new(1.0, 1.0)).length() < 0.02, "{low}");
        assert!((high.truncate() - glam::DVec2::new(2.4, 2.2)).length() < 0.02, "{high}");
        assert!((4.0..=4.3).contains(&low.z) && low.z == high.z, "{low} {high}");
        assert_eq!(edge_u.dot(edge_v), 0.0);
        // Its room is that behind it, not the field in front.
        let bounds = Bounds::of(g.positions.iter().copied());
        let [low, high] = found[0].room.unwrap();
        assert!(low.z < 0.5 && high.z < 4.8 && low.x < 0.5 && high.x > 3.5, "{low} {high} {bounds:?}");
    }

    #[test]
    fn bars_divide_no_window() {
        let mut g = room();
        block(&mut g, Vec3::new(1.68, 1.0, 4.1), Vec3::new(1.72, 2.2, 4.2), false);
        let g = finish(g);
        let found = openings(&g, &RayTracer::new(&g));
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0].edge_u.length().max(found[0].edge_v.length()) - 1.4).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn neither_a_closed_room_nor_a_field_has_openings() {
        let mut closed = Geometry::default();
        block(&mut closed, Vec3::ZERO, Vec3::splat(3.0), true);
        let mut field = Geometry::default();
        block(&mut field, Vec3::new(-50.0, -1.0, -50.0), Vec3::new(50.0, 0.0, 50.0), false);
        block(&mut field, Vec3::new(-1.0, 0.0, -1.0), Vec3::new(1.0, 2.0, 1.0), false);
        for g in [closed, field, Geometry::default()].map(finish) {
            assert!(openings(&g, &RayTracer::new(&g)).is_empty());
        }
    }
}
