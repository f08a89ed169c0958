//! A shared layout: the charts of a mesh packed on a small page of their own, which goes on the page once per
//! member, scaled and moved but not turned.

use super::charts::FlatMesh;
use super::fill::{Filler, Filling};
use super::footprint::{BLOCK, ChartPlacement, Footprint, Pages, Turn, last_offset, owned};
use super::outline::outlines;
use glam::DVec2;

/// The scale of the largest member.
pub(super) fn largest_scale(mesh: &FlatMesh) -> f64 {
    mesh.members.iter().map(|m| m.scale).fold(1.0, f64::max)
}

/// The filter width to keep charts of a layout apart by, so that the page's is kept at every member's scale.
/// Where nothing scales, the texels are the same for all. Else they fall differently on the charts: with 2
/// texels more, charts are further apart than the page's filter is wide, wherever they lie.
fn padding(mesh: &FlatMesh, pages: &Pages) -> usize {
    if largest_scale(mesh) == 1.0 { pages.padding } else { pages.padding + 2 }
}

/// The width of a layout that comes out about square, in texels of the smallest member.
pub(super) fn width(mesh: &FlatMesh, texels_per_metre: f64, pages: &Pages) -> f64 {
    let pages = Pages { padding: padding(mesh, pages), ..*pages };
    let margins = pages.start() + pages.reach();
    let sides = mesh.charts.iter().map(|chart| (chart.size * texels_per_metre + margins).ceil());
    let (longest, boxes) =
        sides.fold((0.0f64, 0.0), |(longest, boxes), side| (longest.max(side.x), boxes + side.x * side.y));
    boxes.sqrt().max(longest)
}

/// Packs a mesh's charts into a layout that at the largest member's scale fits a page; `None` if none is
/// found.
pub(super) fn pack(
    mesh: &FlatMesh,
    texels_per_metre: f64,
    pages: &Pages,
    stack: usize,
) -> Option<Vec<ChartPlacement>> {
    let largest = largest_scale(mesh);
    let most = |texels: usize| (texels as f64 / largest) as usize;
    let (widest, height) = (most(pages.width), most(pages.height));
    let square = (width(mesh, texels_per_metre, pages) as usize).next_multiple_of(BLOCK).min(widest);
    let ranks: Vec<u32> = (0..mesh.charts.len() as u32).collect();
    let attempt = |width: usize| {
        let pages = Pages { width, height, padding: padding(mesh, pages), ..*pages };
        let outlines = outlines(&mesh.charts, &ranks, texels_per_metre, &pages);
        let items: Vec<&[Footprint]> = outlines.iter().map(|outline| &outline.turns[..]).collect();
        if items.iter().any(|turns| turns.is_empty()) {
            return None;
        }
        let mut chart_placements = vec![ChartPlacement::default(); mesh.charts.len()];
        let order: Vec<usize> = (0..items.len()).collect();
        let mut filler = Filler::new(pages.blocks(), Filling { stack, start: pages.start(), windows: None });
        let refused = filler.place_all(&items, &order, |item, place| {
            outlines[item].chart_placements(place).for_each(|(chart, place)| chart_placements[chart] = place);
        });
        refused.is_empty().then_some(chart_placements)
    };
    // About square, so that it goes well beside others; else as wide as the page allows.
    attempt(square).or_else(|| if square < widest { attempt(widest) } else { None })
}

/// The highest coordinates of a layout in texels of the smallest member.
pub(super) fn end(mesh: &FlatMesh, layout: &[ChartPlacement], texels_per_metre: f64) -> DVec2 {
    let charts = mesh.charts.iter().zip(layout);
    charts
        .map(|(chart, place)| place.at + place.turn.size(chart.size) * texels_per_metre)
        .fold(DVec2::ZERO, DVec2::max)
}

/// The blocks a layout owns at a scale; `None` if it is larger than the page.
pub(super) fn footprint(
    mesh: &FlatMesh,
    layout: &[ChartPlacement],
    texels_per_metre: f64,
    scale: f64,
    pages: &Pages,
) -> Option<Footprint> {
    let end = end(mesh, layout, texels_per_metre) * scale;
    let last = last_offset(end, pages)?;
    let corners = mesh.charts.iter().zip(layout).flat_map(|(chart, place)| {
        chart.faces.iter().map(move |f| f.corners.map(|c| place.texel(chart, c, texels_per_metre) * scale))
    });
    Some(Footprint::new(Turn::default(), owned(corners, end, pages), last))
}
