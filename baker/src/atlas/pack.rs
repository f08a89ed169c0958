//! Places charts and shared layouts on pages at a given density.

use super::charts::FlatMesh;
use super::fill::Filling;
use super::footprint::{ChartPlacement, Footprint, Pages, last_offset};
use super::layout;
use super::outline::{Outline, outlines};
use super::spread::spread;
use glam::{DVec2, Vec2Swizzles};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Packed pages.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Packed {
    /// One per mesh.
    pub meshes: Vec<PackedMesh>,
    /// Rows used, of the page that uses the most.
    pub height: usize,
    /// Pages used.
    pub pages: usize,
}

/// Where a mesh's charts lie. A point at texel p of the layout lies at texel `p × member.scale + origin` of
/// the page.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PackedMesh {
    /// Per chart, its place in the layout: a block of its own if the mesh is shared, else a page.
    pub chart_placements: Vec<ChartPlacement>,
    /// Per member; of a mesh that is not shared, zero: its charts say where they lie.
    pub origins: Vec<Origin>,
    /// The highest coordinates of the layout in texels.
    pub end: DVec2,
    /// Blocks that its charts own, of all members together.
    pub blocks: usize,
}

/// Where a member's layout lies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Origin {
    /// The page.
    pub page: usize,
    /// Texels of the page.
    pub texel: DVec2,
}

/// What is placed at one density: outlines of charts and of layouts.
pub(super) struct Items {
    /// Per mesh that is shared, its layout.
    layouts: Vec<Vec<ChartPlacement>>,
    /// Per mesh, what has one outline: charts, or a layout at one scale.
    kinds: Vec<(usize, Kind)>,
    /// What is to be placed: an index into `kinds`, for charts or a member.
    placed: Vec<(usize, usize)>,
}

/// What is placed as one: charts of a mesh, or its layout at a scale. Members of equal scale share theirs.
enum Kind {
    Charts(Outline),
    Layout(f64, Vec<Footprint>),
}

impl Kind {
    fn turns(&self) -> &[Footprint] {
        match self {
            Kind::Charts(outline) => &outline.turns,
            Kind::Layout(_, turns) => turns,
        }
    }
}

impl Items {
    /// Draws all outlines; `None` if one does not fit a page. `ranks` as given by [`super::locality::ranks`].
    pub(super) fn new(
        meshes: &[FlatMesh],
        ranks: &[Vec<u32>],
        texels_per_metre: f64,
        pages: &Pages,
        stack: usize,
    ) -> Option<Self> {
        // A quick exit: a chart larger than a page.
        let fits = |size: DVec2| last_offset(size * texels_per_metre, pages).is_some();
        if !meshes.iter().flat_map(|m| &m.charts).all(|c| fits(c.size) || fits(c.size.yx())) {
            return None;
        }
        let layout = |mesh: &FlatMesh| match mesh.is_shared() {
            true => layout::pack(mesh, texels_per_metre, pages, stack),
            false => Some(Vec::new()),
        };
        let layouts: Vec<Vec<ChartPlacement>> = meshes.par_iter().map(layout).collect::<Option<_>>()?;
        let draw = |(m, mesh): (usize, &FlatMesh)| -> Vec<Kind> {
            if !mesh.is_shared() {
                let outlines = outlines(&mesh.charts, &ranks[m], texels_per_metre, pages);
                return outlines.into_iter().map(Kind::Charts).collect();
            }
            // Each scale once, in the order of the members.
            let mut known = BTreeSet::new();
            let scales = mesh.members.iter().map(|member| member.scale);
            let scales: Vec<f64> = scales.filter(|scale| known.insert(scale.to_bits())).collect();
            let footprint = |scale| {
                layout::footprint(mesh, &layouts[m], texels_per_metre, scale, pages).into_iter().collect()
            };
            scales.into_iter().map(|scale| Kind::Layout(scale, footprint(scale))).collect()
        };
        let drawn: Vec<Vec<Kind>> = meshes.par_iter().enumerate().map(draw).collect();
        let (mut kinds, mut placed) = (Vec::new(), Vec::new());
        for (m, of_mesh) in drawn.into_iter().enumerate() {
            let first = kinds.len();
            if of_mesh.iter().any(|kind| kind.turns().is_empty()) {
                return None;
            }
            if meshes[m].is_shared() {
                let scale_of = |kind: &Kind| match kind {
                    Kind::Layout(scale, _) => Some(scale.to_bits()),
                    Kind::Charts(_) => None,
                };
                let kinds =
                    of_mesh.iter().enumerate().filter_map(|(k, kind)| Some((scale_of(kind)?, first + k)));
                let kind_of: BTreeMap<u64, usize> = kinds.collect();
                let members = meshes[m].members.iter().enumerate();
                placed.extend(
                    members.filter_map(|(i, member)| Some((*kind_of.get(&member.scale.to_bits())?, i))),
                );
            } else {
                placed.extend((0..of_mesh.len()).map(|k| (first + k, k)));
            }
            kinds.extend(of_mesh.into_iter().map(|kind| (m, kind)));
        }
        Some(Items { layouts, kinds, placed })
    }

    /// The blocks that all of them own.
    pub(super) fn blocks(&self) -> usize {
        self.placed.iter().map(|&(kind, _)| self.kinds[kind].1.turns()[0].bits.count()).sum()
    }

    /// Puts them on pages; `None` if they do not fit.
    pub(super) fn pack(
        &self,
        meshes: &[FlatMesh],
        ranks: &[Vec<u32>],
        texels_per_metre: f64,
        pages: &Pages,
        filling: Filling,
    ) -> Option<Packed> {
        let footprints: Vec<&[Footprint]> =
            self.placed.iter().map(|&(kind, _)| self.kinds[kind].1.turns()).collect();
        // The charts of a mesh belong together; every layout stands for itself.
        let mut units = Vec::with_capacity(self.placed.len());
        let mut rank = Vec::with_capacity(self.placed.len());
        for (i, &(kind, index)) in self.placed.iter().enumerate() {
            let (m, kind) = &self.kinds[kind];
            let joins = matches!(kind, Kind::Charts(_)) && index > 0;
            units.push(if joins { units[i - 1] } else { i });
            rank.push(match kind {
                Kind::Charts(outline) => ranks[*m][outline.parts[0].0],
                Kind::Layout(..) => ranks[*m][index],
            });
        }
        let (chart_placements, height, pages) = spread(&footprints, &units, &rank, pages, filling)?;
        let packed = |(mesh, layout): (&FlatMesh, Vec<ChartPlacement>)| PackedMesh {
            end: layout::end(mesh, &layout, texels_per_metre),
            chart_placements: if mesh.is_shared() {
                layout
            } else {
                vec![ChartPlacement::default(); mesh.charts.len()]
            },
            origins: vec![Origin::default(); mesh.members.len()],
            blocks: 0,
        };
        let mut result: Vec<PackedMesh> = meshes.iter().zip(self.layouts.clone()).map(packed).collect();
        for (&(kind, index), place) in self.placed.iter().zip(chart_placements) {
            let (m, kind) = &self.kinds[kind];
            result[*m].blocks += kind.turns()[0].bits.count();
            match kind {
                Kind::Charts(outline) => {
                    outline
                        .chart_placements(place)
                        .for_each(|(chart, place)| result[*m].chart_placements[chart] = place);
                }
                Kind::Layout(..) => {
                    let texel = (place.at - filling.start).round();
                    result[*m].origins[index] = Origin { page: place.page, texel };
                }
            }
        }
        Some(Packed { meshes: result, height, pages })
    }
}
