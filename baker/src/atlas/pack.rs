//! Places charts and shared layouts on pages at a given density.

use super::charts::FlatMesh;
use super::footprint::{Footprint, Pages, Place, footprints, last_offset};
use super::layout;
use super::spread::spread;
use glam::{DVec2, Vec2Swizzles};
use rayon::prelude::*;

/// Packed pages.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed {
    /// One per mesh.
    pub meshes: Vec<PackedMesh>,
    /// Rows used, of the page that uses the most.
    pub height: usize,
    /// Pages used.
    pub pages: usize,
    /// Texels touched.
    pub touched: usize,
}

/// Where a mesh's charts lie. A point at texel p of the layout lies at texel `p × member.scale + origin` of the page.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedMesh {
    /// Per chart, its place in the layout: a block of its own if the mesh is shared, else a page.
    pub places: Vec<Place>,
    /// Per member; of a mesh that is not shared, zero: its charts say where they lie.
    pub origins: Vec<Origin>,
    /// The highest coordinates of the layout in texels.
    pub end: DVec2,
}

/// Where a member's layout lies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Origin {
    /// The page.
    pub page: usize,
    /// Texels of the page.
    pub texel: DVec2,
}

/// Packs all charts and shared layouts on pages; `None` if they do not fit.
pub fn pack(meshes: &[FlatMesh], texels_per_metre: f64, pages: &Pages) -> Option<Packed> {
    // Quick exits: a chart larger than a page, or more area than the pages have.
    let most = pages.width * pages.height * pages.count;
    let fits = |size: DVec2| last_offset(size * texels_per_metre, pages.width, pages.height).is_some();
    let texels = meshes.iter().map(FlatMesh::area).sum::<f64>() * texels_per_metre.powi(2);
    let mut charts = meshes.iter().flat_map(|m| &m.charts);
    if texels > most as f64 || !charts.all(|c| fits(c.size) || fits(c.size.yx())) {
        return None;
    }
    let layout = |mesh: &FlatMesh| match mesh.is_shared() {
        true => layout::pack(mesh, texels_per_metre, pages),
        false => Some(Vec::new()),
    };
    let layouts: Vec<Vec<Place>> = meshes.par_iter().map(layout).collect::<Option<_>>()?;

    // What has one outline: a chart, or a layout at one scale. Members of equal scale share theirs.
    let mut outlines: Vec<(usize, Outline)> = Vec::new();
    // What is to be placed: an outline, for a chart or a member.
    let mut items: Vec<(usize, usize)> = Vec::new();
    for (m, mesh) in meshes.iter().enumerate() {
        let first = outlines.len();
        if mesh.is_shared() {
            for (i, member) in mesh.members.iter().enumerate() {
                let same = |(_, o): &(usize, Outline)| matches!(o, Outline::Layout(s) if *s == member.scale);
                let known = outlines[first..].iter().position(same).map(|at| first + at);
                items.push((known.unwrap_or(outlines.len()), i));
                if known.is_none() {
                    outlines.push((m, Outline::Layout(member.scale)));
                }
            }
        } else {
            items.extend((0..mesh.charts.len()).map(|c| (first + c, c)));
            outlines.extend((0..mesh.charts.len()).map(|c| (m, Outline::Chart(c))));
        }
    }
    let draw = |&(m, outline): &(usize, Outline)| match outline {
        Outline::Chart(c) => footprints(&meshes[m].charts[c], texels_per_metre, pages),
        Outline::Layout(scale) => {
            layout::footprint(&meshes[m], &layouts[m], texels_per_metre, scale, pages).into_iter().collect()
        }
    };
    let footprints: Vec<Vec<Footprint>> = outlines.par_iter().map(draw).collect();
    if footprints.iter().any(|turns| turns.is_empty()) {
        return None;
    }
    let touched = items.iter().map(|&(outline, _)| footprints[outline][0].bits.count()).sum();
    if touched > most {
        return None;
    }
    let wanted: Vec<&[Footprint]> = items.iter().map(|&(outline, _)| &footprints[outline][..]).collect();
    // The charts of a mesh belong together; every layout stands for itself.
    let mut units = Vec::with_capacity(items.len());
    for (i, &(outline, index)) in items.iter().enumerate() {
        let joins = matches!(outlines[outline].1, Outline::Chart(_)) && index > 0;
        units.push(if joins { units[i - 1] } else { i });
    }
    let (placed, height, pages) = spread(&wanted, &units, pages)?;
    let packed = |(mesh, layout): (&FlatMesh, Vec<Place>)| PackedMesh {
        end: layout::end(mesh, &layout, texels_per_metre),
        places: layout,
        origins: vec![Origin::default(); mesh.members.len()],
    };
    let mut result: Vec<PackedMesh> = meshes.iter().zip(layouts).map(packed).collect();
    for (&(outline, index), place) in items.iter().zip(placed) {
        let (m, kind) = outlines[outline];
        match kind {
            Outline::Chart(_) => result[m].places.push(place),
            Outline::Layout(_) => {
                let texel = DVec2::new(place.x as f64, place.y as f64);
                result[m].origins[index] = Origin { page: place.page, texel };
            }
        }
    }
    Some(Packed { meshes: result, height, pages, touched })
}

/// What is placed as one: a chart of a mesh, or its layout at a scale.
#[derive(Clone, Copy)]
enum Outline {
    Chart(usize),
    Layout(f64),
}
