//! Which faces nobody can see: found before texels are laid out, so that none are spent on them.
//!
//! A face is hidden if every point of a lattice on it is, on the side that its texels show and, where it is
//! two-sided, on the other one too: inside a body, or pressed against another surface ([`Space::is_hidden`]).
//! One point that can be seen is enough for all of its texels. The same scene has the same hidden faces,
//! whatever the seed, the backend and the number of threads.

use crate::atlas;
use crate::geometry::{Geometry, Solids};
use crate::scene::{HiddenFaces, Lightmap, LightmapSize, UvSource};
use crate::surface::SurfacePoint;
use crate::trace::counts::{RayCounts, sum};
use crate::trace::rays::RayTracer;
use crate::trace::solids::Space;
use glam::Vec3;
use rayon::prelude::*;

/// Fewest intervals between lattice points along a side of a face: 15 points.
const FEWEST_INTERVALS: f64 = 4.0;
/// Most of them: 131,841 points. A face that would need more keeps its texels, since a part of it that can be
/// seen might lie between them.
const MOST_INTERVALS: f64 = 512.0;
/// Intervals along a texel.
const INTERVALS_PER_TEXEL: f64 = 2.0;
/// How far lattice points stay off the edges, as a fraction of the face.
const INSET: f32 = 1e-3;
/// Widest gap between surfaces that are pressed together, as a fraction of a face's height.
const GAP_OF_FACE: f64 = 0.01;
/// The same as a fraction of the scene's length.
const GAP_OF_SCENE: f64 = 1e-4;

/// Faces that nobody can see.
#[derive(Clone, Debug, Default)]
pub(crate) struct Hidden {
    /// Triangles of lightmapped instances, ascending: those hidden in every instance that shares their
    /// layout.
    pub triangles: Vec<u32>,
    /// The rays that it took to find them.
    pub rays: RayCounts,
}

/// Finds the hidden faces of lightmapped instances; none if they are to have texels anyway.
pub(crate) fn find(geometry: &Geometry, lightmap: &Lightmap) -> Hidden {
    if !is_sought(lightmap) {
        return Hidden::default();
    }
    let rays = RayTracer::new(geometry);
    find_in(&Space::new(geometry, &rays).with_solids(Solids::new(geometry)), lightmap)
}

/// Whether faces that nobody can see get no texels.
pub(crate) fn is_sought(lightmap: &Lightmap) -> bool {
    lightmap.hidden != HiddenFaces::Keep && lightmap.uv != UvSource::Keep
}

/// Finds the hidden faces of lightmapped instances. The space is to know its solids.
///
/// Instances that share a layout have texels on a face unless all of them hide it: the first one that shows
/// it ends the search.
pub(crate) fn find_in(space: &Space, lightmap: &Lightmap) -> Hidden {
    let geometry = space.geometry;
    let texel = texel_length(geometry, lightmap);
    let gap = GAP_OF_SCENE * length(geometry);
    let shapes = atlas::shapes(geometry);
    let triangles = |instance: usize| geometry.instances[instance].triangles.clone();
    // A face: the shape it is of, and its place among the triangles of that.
    let faces: Vec<(usize, usize)> = (shapes.iter().enumerate())
        .flat_map(|(shape, members)| (0..triangles(members[0]).len()).map(move |face| (shape, face)))
        .collect();
    let looked_at: Vec<(bool, RayCounts)> = faces
        .par_iter()
        .with_min_len(64)
        .map(|&(shape, face)| {
            let mut counts = RayCounts::default();
            let hidden = shapes[shape].iter().all(|&instance| {
                let triangle = (triangles(instance).start + face) as u32;
                let texel = texel / geometry.instances[instance].density;
                is_hidden(space, triangle, texel, gap, &mut counts)
            });
            (hidden, counts)
        })
        .collect();
    let hidden = faces.iter().zip(&looked_at).filter(|(_, (hidden, _))| *hidden);
    let in_all = hidden.flat_map(|(&(shape, face), _)| {
        shapes[shape].iter().map(move |&instance| (triangles(instance).start + face) as u32)
    });
    let mut hidden: Vec<u32> = in_all.collect();
    hidden.sort_unstable();
    Hidden { triangles: hidden, rays: sum(looked_at.iter().map(|(_, counts)| *counts)) }
}

/// Whether a face is hidden; `texel` is the length of its texels, `gap` the widest gap of any face.
fn is_hidden(space: &Space, triangle: u32, texel: f64, gap: f64, counts: &mut RayCounts) -> bool {
    let geometry = space.geometry;
    let longest = geometry.longest_edge(triangle as usize);
    let height = 2.0 * geometry.area_f64(triangle as usize) / longest;
    let gap = gap.min(GAP_OF_FACE * height) as f32;
    let two_sided = space.material(triangle).two_sided;
    let along = (INTERVALS_PER_TEXEL * longest / texel).ceil().max(FEWEST_INTERVALS);
    if along > MOST_INTERVALS {
        return false;
    }
    // (Of a triangle that is a point, or of no texels, that is no number, and `max` passes over it.)
    let across = (INTERVALS_PER_TEXEL * height / texel).ceil().max(FEWEST_INTERVALS).min(along);
    let apex = opposite_longest(geometry.corners(triangle as usize));
    lattice(along as u32, across as u32).all(|mut barycentric| {
        barycentric.as_mut().rotate_right(apex);
        let point = SurfacePoint { triangle, barycentric };
        let sides = (space.receiver_on(&point, false), space.receiver_on(&point, true));
        let (Some(front), Some(back)) = sides else { return false };
        space.is_hidden(&front, &back, gap, counts)
            && (!two_sided || space.is_hidden(&back, &front, gap, counts))
    })
}

/// The corner opposite a triangle's longest edge.
fn opposite_longest([a, b, c]: [Vec3; 3]) -> usize {
    let opposite = [b.distance_squared(c), c.distance_squared(a), a.distance_squared(b)];
    (1..3).fold(0, |longest, k| if opposite[k] > opposite[longest] { k } else { longest })
}

/// The points of a lattice on a triangle, in barycentric coordinates, in an order that soon comes to all
/// parts. Rows run along the edge opposite the first corner, which has `along` intervals, and there are
/// `across` intervals from there to the corner: a sliver needs few.
fn lattice(along: u32, across: u32) -> impl Iterator<Item = Vec3> {
    // A prime larger than any side: every place of the rectangle is met once.
    const STEP: u32 = 7919;
    let (columns, rows) = (along + 1, across + 1);
    let places = (0..columns * rows).map(move |k| k * STEP % (columns * rows));
    // Rows get shorter towards the corner, their points no further apart.
    let intervals = move |row: u32| (along * (across - row)).div_ceil(across);
    let inside = places.map(move |place| (place / columns, place % columns));
    inside.filter(move |&(row, column)| column <= intervals(row)).map(move |(row, column)| {
        let height = row as f32 / across as f32;
        let part = column as f32 / intervals(row).max(1) as f32;
        let node = Vec3::new(height, (1.0 - height) * (1.0 - part), (1.0 - height) * part);
        node * (1.0 - 3.0 * INSET) + INSET
    })
}

/// The length of a texel at density 1 in metres: no longer than it will be.
fn texel_length(geometry: &Geometry, lightmap: &Lightmap) -> f64 {
    match lightmap.size {
        LightmapSize::TexelsPerMetre(density) => density.recip(),
        LightmapSize::Fixed { width, height } => {
            let lightmapped = geometry.instances.iter().filter(|instance| instance.lightmap);
            let weighed = lightmapped.map(|instance| {
                let area: f64 = instance.triangles.clone().map(|t| geometry.area_f64(t)).sum();
                area * instance.density.powi(2)
            });
            let texels = f64::from(width) * f64::from(height) * f64::from(lightmap.pages);
            (weighed.sum::<f64>() / texels).sqrt()
        }
    }
}

/// The length of the longest side of the box around all positions, which are relative to its centre.
fn length(geometry: &Geometry) -> f64 {
    2.0 * geometry.positions.iter().map(|p| f64::from(p.abs().max_element())).fold(0.0, f64::max)
}

#[cfg(test)]
#[path = "hidden_tests.rs"]
mod tests;
