//! Edges at which two faces meet in space but not on the page.

use super::weld::Welder;
use crate::atlas::Atlas;
use crate::geometry::{Bounds, Geometry};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Corners nearer than this are one, in texels.
const WELD_TEXELS: f64 = 0.01;
/// And nearer than this, in extents of the geometry: a few roundings of `f32` coordinates.
const WELD_EXTENT: f64 = 1.0 / (1 << 22) as f64;
/// Edges this near on the page are one there, in texels: `f32` resolves 1/1024 at 16384.
const SAME_PLACE: f32 = 1.0 / 256.0;
/// Cosine of the largest angle between the normals of a smooth edge: 15°.
const SMOOTH: f32 = 0.965_925_8;
/// Angles around an edge that are rounding, in radians.
const FLAT: f64 = 1e-3;
/// An edge with more faces than this is no edge of a surface.
const MOST_FACES: usize = 64;

/// An edge that lies on the page twice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SeamEdge {
    /// Per side, the page coordinates of the edge's ends in texels; the same end of the edge first.
    pub sides: [[Vec2; 2]; 2],
}

/// The side of a triangle from a corner to the next.
#[derive(Clone, Copy, Debug)]
struct HalfEdge {
    /// Welded points, ascending.
    ends: [u32; 2],
    /// Whether it runs from the first to the second.
    forward: bool,
    /// Index into `Geometry::triangles`.
    triangle: u32,
    /// The corner it starts at.
    corner: u8,
    /// Index into `Atlas::faces`; not used for triangles without texels.
    face: u32,
}

/// Two faces at an edge.
struct Pair {
    sides: [HalfEdge; 2],
    /// From the first face through the space in front of it to the second, in radians.
    angle: f64,
}

/// Finds the edges at which light must agree though the page does not join it.
///
/// Two faces meet at an edge when its ends are the same points in space (within a hundredth of a texel), they
/// run through it in opposite directions, as neighbours of one orientation do, and no other surface stands on
/// the edge in front of them, which could keep the light from one of them. The edge is smooth when the vertex
/// normals of the two differ by at most 15° at both ends.
pub(super) fn find(geometry: &Geometry, atlas: &Atlas) -> Vec<SeamEdge> {
    let mut welder = Welder::new(tolerance(geometry, atlas));
    let half_edges = half_edges(geometry, atlas, &mut welder);
    let groups: Vec<&[HalfEdge]> = half_edges.chunk_by(|a, b| a.ends == b.ends).collect();
    let mut pairs: Vec<Pair> =
        groups.par_iter().flat_map_iter(|group| pairs_of(geometry, atlas, group)).collect();
    remove_obstructed(geometry, atlas, &welder, &mut pairs);
    let place = |h: &HalfEdge| page_ends(atlas, h);
    pairs.iter().map(|pair| SeamEdge { sides: [place(&pair.sides[0]), place(&pair.sides[1])] }).collect()
}

/// In metres.
fn tolerance(geometry: &Geometry, atlas: &Atlas) -> f64 {
    let corners = atlas.faces.iter().flat_map(|f| geometry.corners(f.triangle as usize));
    let extent = Bounds::of(corners).size().max_element();
    // Not zero where all is one point.
    (WELD_TEXELS / atlas.texels_per_metre).max(WELD_EXTENT * extent).max(1e-30)
}

/// All sides of all faces that have two ends, those of an edge together, in the order of the triangles.
fn half_edges(geometry: &Geometry, atlas: &Atlas, welder: &mut Welder) -> Vec<HalfEdge> {
    let mut point_of = vec![u32::MAX; geometry.positions.len()];
    let mut all = Vec::with_capacity(3 * atlas.faces.len());
    for (index, face) in atlas.faces.iter().enumerate() {
        let points = geometry.triangles[face.triangle as usize].map(|v| {
            let point = &mut point_of[v as usize];
            if *point == u32::MAX {
                *point = welder.weld(geometry.positions[v as usize]);
            }
            *point
        });
        sides(points, face.triangle, index as u32, |half_edge| all.push(half_edge));
    }
    all.par_sort_unstable_by_key(|h: &HalfEdge| (h.ends, h.triangle, h.corner));
    all
}

/// The sides of a triangle whose corners are these points.
fn sides(points: [u32; 3], triangle: u32, face: u32, mut each: impl FnMut(HalfEdge)) {
    for corner in 0..3u8 {
        let [a, b] = [points[corner as usize], points[(corner as usize + 1) % 3]];
        if a != b {
            each(HalfEdge { ends: [a.min(b), a.max(b)], forward: a < b, triangle, corner, face });
        }
    }
}

/// The smooth pairs at one edge that the page does not join.
fn pairs_of(geometry: &Geometry, atlas: &Atlas, group: &[HalfEdge]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    // The common case first: two faces, neighbours on the page too.
    let joined = |a: &HalfEdge, b: &HalfEdge| is_same_place(page_ends(atlas, a), page_ends(atlas, b));
    if !(2..=MOST_FACES).contains(&group.len()) || (group.len() == 2 && joined(&group[0], &group[1])) {
        return pairs;
    }
    let mut found: Vec<(usize, usize)> = Vec::new();
    for (i, side) in group.iter().enumerate() {
        let Some(plane) = EdgePlane::new(geometry, side) else { continue };
        // The first face met on the way round in front of this one.
        let others = (0..group.len()).filter(|&j| j != i);
        let angles = others.filter_map(|j| Some((plane.angle(geometry, &group[j])?, j)));
        let Some((_, j)) = angles.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))) else { continue };
        let other = &group[j];
        if side.forward != other.forward && !joined(side, other) && is_smooth(geometry, side, other) {
            found.push((i.min(j), i.max(j)));
        }
    }
    found.sort_unstable();
    found.dedup();
    for (i, j) in found {
        let angle = EdgePlane::new(geometry, &group[i]).and_then(|plane| plane.angle(geometry, &group[j]));
        pairs.extend(angle.map(|angle| Pair { sides: [group[i], group[j]], angle }));
    }
    pairs
}

/// Takes out the pairs with a triangle without texels between them: it throws shadows all the same.
fn remove_obstructed(geometry: &Geometry, atlas: &Atlas, welder: &Welder, pairs: &mut Vec<Pair>) {
    if pairs.is_empty() || geometry.triangles.len() == atlas.faces.len() {
        return;
    }
    // Only the ends of seams are looked for.
    let mut ends: Vec<u32> = pairs.iter().flat_map(|pair| pair.sides[0].ends).collect();
    ends.sort_unstable();
    ends.dedup();
    let mut near = Welder::new(welder.tolerance);
    ends.iter().for_each(|&end| _ = near.weld(welder.position(end)));
    // Ascending like the points they are.
    let key = |pair: &Pair| pair.sides[0].ends.map(|end| ends.partition_point(|&e| e < end) as u32);
    let mut keys: Vec<([u32; 2], usize)> = pairs.iter().enumerate().map(|(i, pair)| (key(pair), i)).collect();
    keys.sort_unstable();
    let without_texels = |t: &u32| atlas.faces.binary_search_by_key(t, |f| f.triangle).is_err();
    let mut obstructed: Vec<usize> = (0..geometry.triangles.len() as u32)
        .into_par_iter()
        .filter(without_texels)
        .flat_map_iter(|triangle| {
            let mut met = Vec::new();
            let points = geometry.corners(triangle as usize).map(|p| near.find(p));
            // A side needs two ends.
            if points.iter().flatten().count() > 1 {
                // Unknown points differ from each other and from all known ones.
                let points = [0, 1, 2].map(|c| points[c].unwrap_or(u32::MAX - c as u32));
                sides(points, triangle, u32::MAX, |side| {
                    let from = keys.partition_point(|k| k.0 < side.ends);
                    for &(_, i) in keys[from..].iter().take_while(|k| k.0 == side.ends) {
                        let plane = EdgePlane::new(geometry, &pairs[i].sides[0]);
                        let angle = plane.and_then(|plane| plane.angle(geometry, &side));
                        met.extend(angle.filter(|&angle| angle < pairs[i].angle - FLAT).map(|_| i));
                    }
                });
            }
            met
        })
        .collect();
    obstructed.sort_unstable();
    let mut index = 0;
    pairs.retain(|_| {
        index += 1;
        obstructed.binary_search(&(index - 1)).is_err()
    });
}

/// The plane across an edge as a face sees it.
struct EdgePlane {
    along: DVec3,
    /// From the edge into the face, unit.
    into: DVec3,
    /// Of the face, unit, on the front side.
    normal: DVec3,
}

impl EdgePlane {
    /// `None` for a face without area.
    fn new(geometry: &Geometry, side: &HalfEdge) -> Option<EdgePlane> {
        let [a, b, c] = corners_from(geometry, side);
        let along = (b - a).try_normalize()?;
        let into = (c - a).reject_from_normalized(along).try_normalize()?;
        Some(EdgePlane { along, into, normal: along.cross(into) })
    }

    /// The angle to another face at the edge, turning through the space in front of this one, in (0, 2π]
    /// radians: a face that lies on this one is behind it.
    fn angle(&self, geometry: &Geometry, other: &HalfEdge) -> Option<f64> {
        let [a, _, c] = corners_from(geometry, other);
        let into = (c - a).reject_from_normalized(self.along).try_normalize()?;
        let angle = into.dot(self.normal).atan2(into.dot(self.into));
        Some(if angle < FLAT { angle + TAU } else { angle })
    }
}

/// The corners of its triangle from its start on.
fn corners_from(geometry: &Geometry, side: &HalfEdge) -> [DVec3; 3] {
    let corners = geometry.corners(side.triangle as usize).map(Vec3::as_dvec3);
    [0, 1, 2].map(|i| corners[(side.corner as usize + i) % 3])
}

/// What stands at the two ends, the lower point's first.
fn at_ends<T: Copy>(side: &HalfEdge, at_corners: [T; 3]) -> [T; 2] {
    let [start, end] = [0, 1].map(|i| at_corners[(side.corner as usize + i) % 3]);
    if side.forward { [start, end] } else { [end, start] }
}

fn page_ends(atlas: &Atlas, side: &HalfEdge) -> [Vec2; 2] {
    at_ends(side, atlas.faces[side.face as usize].corners)
}

fn is_same_place(a: [Vec2; 2], b: [Vec2; 2]) -> bool {
    (0..2).all(|end| (a[end] - b[end]).abs().max_element() <= SAME_PLACE)
}

fn is_smooth(geometry: &Geometry, a: &HalfEdge, b: &HalfEdge) -> bool {
    let normals = |side: &HalfEdge| {
        at_ends(side, geometry.triangles[side.triangle as usize]).map(|v| geometry.normals[v as usize])
    };
    let (a, b) = (normals(a), normals(b));
    (0..2).all(|end| a[end].dot(b[end]) >= SMOOTH)
}
