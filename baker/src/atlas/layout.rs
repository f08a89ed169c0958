//! A shared layout: the charts of a mesh packed on a small page of their own, which goes on the page once per member, scaled and
//! moved but not turned.

use super::charts::FlatMesh;
use super::fill::first_fit;
use super::footprint::{BLOCK, Footprint, Pages, Place, Turn, footprints, last_offset, runs};
use super::raster::Bits;
use glam::DVec2;
use rayon::prelude::*;

/// The scale of the largest member.
pub fn largest_scale(mesh: &FlatMesh) -> f64 {
    mesh.members.iter().map(|m| m.scale).fold(1.0, f64::max)
}

/// Empty texels between the charts of a layout, so that `padding` are left at every member's scale. Where nothing scales, the
/// texels are the same for all. Else they fall differently on the charts, and a gap of n texels between what two charts touch,
/// wider than n between the charts themselves, is only sure to hold n − 1 whole ones.
fn gap(mesh: &FlatMesh, padding: usize) -> usize {
    if largest_scale(mesh) == 1.0 { padding } else { padding + 1 }
}

/// The width of a layout that comes out about square, in texels of the smallest member.
pub fn width(mesh: &FlatMesh, texels_per_metre: f64, padding: usize) -> f64 {
    let cells = |length: f64| length * texels_per_metre + 1.0;
    let gap = gap(mesh, padding) as f64;
    let longest = mesh.charts.iter().map(|c| cells(c.size.x)).fold(0.0, f64::max);
    let boxes: f64 = mesh.charts.iter().map(|c| (cells(c.size.x) + gap) * (cells(c.size.y) + gap)).sum();
    boxes.sqrt().max(longest)
}

/// Packs a mesh's charts into a layout that at the largest member's scale fits a page; `None` if none is found.
pub fn pack(mesh: &FlatMesh, texels_per_metre: f64, pages: &Pages) -> Option<Vec<Place>> {
    let padding = pages.padding;
    let largest = largest_scale(mesh);
    let most = |texels: usize| (texels as f64 / largest) as usize;
    let (widest, height) = (most(pages.width), most(pages.height));
    let square = (width(mesh, texels_per_metre, padding).ceil() as usize).next_multiple_of(BLOCK).min(widest);
    let attempt = |width: usize| {
        let charts = mesh.charts.par_iter();
        let turns: Vec<_> =
            charts.map(|c| footprints(c, texels_per_metre, &Pages { width, height, ..*pages })).collect();
        if turns.iter().any(|t| t.is_empty()) {
            return None;
        }
        let items: Vec<&[Footprint]> = turns.iter().map(|t| &t[..]).collect();
        first_fit(&items, width, height, gap(mesh, padding)).map(|(places, _)| places)
    };
    // About square, so that it goes well beside others; else as wide as the page allows.
    attempt(square).or_else(|| if square < widest { attempt(widest) } else { None })
}

/// The highest coordinates of a layout in texels of the smallest member.
pub fn end(mesh: &FlatMesh, layout: &[Place], texels_per_metre: f64) -> DVec2 {
    let charts = mesh.charts.iter().zip(layout);
    let corners = charts.flat_map(|(chart, place)| {
        let faces = chart.faces.iter().flat_map(|f| f.corners);
        faces.map(move |corner| place.texel(chart, corner, texels_per_metre))
    });
    corners.fold(DVec2::ZERO, DVec2::max)
}

/// The texels a layout touches at a scale; `None` if it is larger than the page.
pub fn footprint(
    mesh: &FlatMesh,
    layout: &[Place],
    texels_per_metre: f64,
    scale: f64,
    pages: &Pages,
) -> Option<Footprint> {
    let tolerance = pages.tolerance();
    let end = end(mesh, layout, texels_per_metre) * scale;
    // Half a texel lies before the layout; `last_offset` leaves that and another half at the far side.
    let last = last_offset(end - 0.5, pages.width, pages.height)?;
    let cells = |length: f64| (length + tolerance) as usize + 1;
    let mut bits = Bits::new(cells(end.x), cells(end.y));
    for (chart, place) in mesh.charts.iter().zip(layout) {
        for face in &chart.faces {
            bits.touch(face.corners.map(|c| place.texel(chart, c, texels_per_metre) * scale), tolerance);
        }
    }
    let runs = runs(&bits);
    Some(Footprint { turn: Turn::default(), bits, runs, rows: (end.y + 0.5).ceil() as usize, last })
}
