//! Places charts and shared layouts on a page at a given density: bottom-left first fit over bit maps of touched texels.

use super::block;
use super::charts::{Chart, FlatMesh};
use super::page::Page;
use super::raster::{Bits, TOLERANCE};
use glam::{DVec2, Vec2Swizzles};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Charts start on multiples of this many texels, the block of the GPU formats, so that few blocks see two charts.
pub const BLOCK: usize = 4;

/// Where a chart lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The texel that holds the lower corner of the chart's bounding box, at its centre.
    pub x: usize,
    /// See `x`.
    pub y: usize,
    /// How it is turned.
    turn: Turn,
}

/// A symmetry of the square: swap the axes, then mirror them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Turn {
    swap: bool,
    mirror_x: bool,
    mirror_y: bool,
}

impl Turn {
    const ALL: [Turn; 8] = {
        let mut all = [Turn { swap: false, mirror_x: false, mirror_y: false }; 8];
        let mut i = 0;
        while i < 8 {
            all[i] = Turn { swap: i & 1 != 0, mirror_x: i & 2 != 0, mirror_y: i & 4 != 0 };
            i += 1;
        }
        all
    };
}

impl Place {
    /// From a chart's metres to texels of the page. The chart's lower corner lies on a texel centre.
    pub fn texel(&self, chart: &Chart, corner: DVec2, texels_per_metre: f64) -> DVec2 {
        let (mut p, mut size) = (corner, chart.size);
        if self.turn.swap {
            (p, size) = (p.yx(), size.yx());
        }
        if self.turn.mirror_x {
            p.x = size.x - p.x;
        }
        if self.turn.mirror_y {
            p.y = size.y - p.y;
        }
        p * texels_per_metre + DVec2::new(self.x as f64, self.y as f64) + 0.5
    }
}

/// The texels a turned chart touches.
pub struct Footprint {
    /// How the chart is turned.
    pub turn: Turn,
    /// The texels.
    pub bits: Bits,
    /// Maximal runs of ones, the longest first.
    pub runs: Vec<Run>,
    /// Rows from its offset to half a texel past the chart.
    pub rows: usize,
    /// Largest offset, column and row, at which it stays half a texel inside the page.
    pub last: (usize, usize),
}

/// Touched texels side by side.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// From the footprint's offset.
    pub row: usize,
    /// First column, from the footprint's offset.
    pub start: usize,
    /// Texels.
    pub length: usize,
}

/// A packed page.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed {
    /// One per mesh.
    pub meshes: Vec<PackedMesh>,
    /// Rows used.
    pub height: usize,
    /// Texels touched.
    pub touched: usize,
}

/// Where a mesh's charts lie. A point at texel p of the layout lies at texel `p × member.scale + origin` of the page.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedMesh {
    /// Per chart, its place in the layout: a block of its own if the mesh is shared, else the page.
    pub places: Vec<Place>,
    /// Per member.
    pub origins: Vec<DVec2>,
    /// The highest coordinates of the layout in texels.
    pub end: DVec2,
}

/// Packs all charts and shared layouts on a page of `width` × at most `height` texels, `padding` empty texels apart; `None` if
/// they do not fit.
pub fn pack(
    meshes: &[FlatMesh],
    texels_per_metre: f64,
    width: usize,
    height: usize,
    padding: usize,
) -> Option<Packed> {
    // Quick exits: a chart larger than the page, or more area than the page has.
    let fits = |size: DVec2| last_offset(size * texels_per_metre, width, height).is_some();
    let texels = meshes.iter().map(FlatMesh::area).sum::<f64>() * texels_per_metre.powi(2);
    let mut charts = meshes.iter().flat_map(|m| &m.charts);
    if texels > (width * height) as f64 || !charts.all(|c| fits(c.size) || fits(c.size.yx())) {
        return None;
    }
    let layout = |mesh: &FlatMesh| match mesh.is_shared() {
        true => block::pack(mesh, texels_per_metre, width, height, padding),
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
        Outline::Chart(c) => footprints(&meshes[m].charts[c], texels_per_metre, width, height),
        Outline::Layout(scale) => {
            block::footprint(&meshes[m], &layouts[m], texels_per_metre, scale, width, height)
                .into_iter()
                .collect()
        }
    };
    let footprints: Vec<Vec<Footprint>> = outlines.par_iter().map(draw).collect();
    if footprints.iter().any(|turns| turns.is_empty()) {
        return None;
    }
    let touched = items.iter().map(|&(outline, _)| footprints[outline][0].bits.count()).sum();
    if touched > width * height {
        return None;
    }
    let wanted: Vec<&[Footprint]> = items.iter().map(|&(outline, _)| &footprints[outline][..]).collect();
    let (placed, used) = first_fit(&wanted, width, height, padding)?;
    let packed = |(mesh, layout): (&FlatMesh, Vec<Place>)| PackedMesh {
        end: block::end(mesh, &layout, texels_per_metre),
        places: layout,
        origins: vec![DVec2::ZERO; mesh.members.len()],
    };
    let mut result: Vec<PackedMesh> = meshes.iter().zip(layouts).map(packed).collect();
    for (&(outline, index), place) in items.iter().zip(placed) {
        let (m, kind) = outlines[outline];
        match kind {
            Outline::Chart(_) => result[m].places.push(place),
            Outline::Layout(_) => result[m].origins[index] = DVec2::new(place.x as f64, place.y as f64),
        }
    }
    Some(Packed { meshes: result, height: used, touched })
}

/// What is placed as one: a chart of a mesh, or its layout at a scale.
#[derive(Clone, Copy)]
enum Outline {
    Chart(usize),
    Layout(f64),
}

/// Places one of the turns of every item; gives the places and the rows used, or `None` if they do not fit.
pub fn first_fit(
    items: &[&[Footprint]],
    width: usize,
    height: usize,
    padding: usize,
) -> Option<(Vec<Place>, usize)> {
    // Large ones first; equal ones in the order of the geometry.
    let mut order: Vec<usize> = (0..items.len()).collect();
    let key = |i: usize| {
        let bits = &items[i][0].bits;
        (bits.width.max(bits.height), bits.width * bits.height)
    };
    order.sort_by_key(|&i| (std::cmp::Reverse(key(i)), i));

    let mut page = Page::new(width, height);
    let mut places = vec![Place::default(); items.len()];
    // Texels are only ever taken, so a footprint never fits above the row where the same one was placed or refused before.
    let mut first_row: BTreeMap<&[u64], BTreeMap<(usize, usize), usize>> = BTreeMap::new();
    for i in order {
        let mut best: Option<(usize, usize, usize, usize)> = None;
        for (t, footprint) in items[i].iter().enumerate() {
            let bits = &footprint.bits;
            let from =
                first_row.entry(&bits.words).or_default().entry((bits.width, bits.height)).or_insert(0);
            // The lowest end wins, then the lowest and leftmost start, then the first turn.
            let limit =
                best.map_or(footprint.last.1, |b| footprint.last.1.min(b.0.saturating_sub(bits.height)));
            let (row, column) = page.find(footprint, *from, limit);
            *from = row;
            if let Some(x) = column {
                let candidate = (row + bits.height, row, x, t);
                best = Some(best.map_or(candidate, |b| b.min(candidate)));
            }
        }
        let (_, y, x, t) = best?;
        page.take(&items[i][t], x, y, padding);
        places[i] = Place { x, y, turn: items[i][t].turn };
    }
    Some((places, page.used()))
}

/// The largest offsets for a chart of this size in texels, so that it ends half a texel inside the page.
pub fn last_offset(size: DVec2, width: usize, height: usize) -> Option<(usize, usize)> {
    let room = DVec2::new(width as f64, height as f64) - 1.0 - size;
    (room.min_element() >= 0.0).then(|| (room.x as usize / BLOCK * BLOCK, room.y as usize / BLOCK * BLOCK))
}

/// The distinct footprints of a chart's turns that fit the page.
pub fn footprints(chart: &Chart, texels_per_metre: f64, width: usize, height: usize) -> Vec<Footprint> {
    let mut all: Vec<Footprint> = Vec::new();
    for turn in Turn::ALL {
        let size = if turn.swap { chart.size.yx() } else { chart.size } * texels_per_metre;
        let Some(last) = last_offset(size, width, height) else { continue };
        let cells = |length: f64| (length + 0.5 + TOLERANCE) as usize + 1;
        let mut bits = Bits::new(cells(size.x), cells(size.y));
        let place = Place { x: 0, y: 0, turn };
        for face in &chart.faces {
            bits.touch(face.corners.map(|c| place.texel(chart, c, texels_per_metre)));
        }
        if all.iter().all(|other| other.bits != bits) {
            let runs = runs(&bits);
            all.push(Footprint { turn, bits, runs, rows: (size.y + 1.0).ceil() as usize, last });
        }
    }
    all
}

pub fn runs(bits: &Bits) -> Vec<Run> {
    let mut runs = Vec::new();
    for row in 0..bits.height {
        let mut end = 0;
        while let Some(start) = bits.next(row, end, true) {
            end = bits.next(row, start, false).unwrap_or(bits.width);
            runs.push(Run { row, start, length: end - start });
        }
    }
    // A long run rules out most columns at once.
    runs.sort_by_key(|run| (std::cmp::Reverse(run.length), run.row));
    runs
}
