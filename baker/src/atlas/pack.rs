//! Places charts and shared layouts on pages at a given density.

use super::block;
use super::charts::{Chart, FlatMesh};
use super::raster::{Bits, TOLERANCE};
use super::spread::spread;
use dataset::tiles::TILE;
use glam::{DVec2, Vec2Swizzles};
use rayon::prelude::*;

/// Charts start on multiples of this many texels, the block of the GPU formats, so that few blocks see two charts.
pub const BLOCK: usize = 4;

/// The pages to pack, all alike.
#[derive(Clone, Copy, Debug)]
pub struct Pages {
    /// Texels.
    pub width: usize,
    /// Texels, at most.
    pub height: usize,
    /// How many there are.
    pub count: usize,
    /// Empty texels between charts.
    pub padding: usize,
}

impl Pages {
    /// Rows of the virtual page from one page's first row to the next one's, for pages of this height: see
    /// [`super::Atlas::stride`].
    pub fn stride(&self, height: usize) -> usize {
        if self.count > 1 { (height + self.padding).next_multiple_of(TILE) } else { height }
    }

    /// Texels: what is nearer to a triangle than this counts as touched. Twice the rounding of a corner to `f32` on the virtual
    /// page of all pages.
    pub fn tolerance(&self) -> f64 {
        let rows = self.stride(self.height) * (self.count - 1) + self.height;
        TOLERANCE.max(rows.max(self.width).next_power_of_two() as f64 / f64::from(1 << 24))
    }
}

/// Where a chart lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The page.
    pub page: usize,
    /// The texel that holds the lower corner of the chart's bounding box, at its centre.
    pub x: usize,
    /// See `x`.
    pub y: usize,
    /// How it is turned.
    pub turn: Turn,
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
    /// From a chart's metres to texels of its page. The chart's lower corner lies on a texel centre.
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
        true => block::pack(mesh, texels_per_metre, pages),
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
            block::footprint(&meshes[m], &layouts[m], texels_per_metre, scale, pages).into_iter().collect()
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
        end: block::end(mesh, &layout, texels_per_metre),
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

/// The largest offsets for a chart of this size in texels, so that it ends half a texel inside the page.
pub fn last_offset(size: DVec2, width: usize, height: usize) -> Option<(usize, usize)> {
    let room = DVec2::new(width as f64, height as f64) - 1.0 - size;
    (room.min_element() >= 0.0).then(|| (room.x as usize / BLOCK * BLOCK, room.y as usize / BLOCK * BLOCK))
}

/// The distinct footprints of a chart's turns that fit a page.
pub fn footprints(chart: &Chart, texels_per_metre: f64, pages: &Pages) -> Vec<Footprint> {
    let tolerance = pages.tolerance();
    let mut all: Vec<Footprint> = Vec::new();
    for turn in Turn::ALL {
        let size = if turn.swap { chart.size.yx() } else { chart.size } * texels_per_metre;
        let Some(last) = last_offset(size, pages.width, pages.height) else { continue };
        let cells = |length: f64| (length + 0.5 + tolerance) as usize + 1;
        let mut bits = Bits::new(cells(size.x), cells(size.y));
        let place = Place { turn, ..Place::default() };
        for face in &chart.faces {
            bits.touch(face.corners.map(|c| place.texel(chart, c, texels_per_metre)), tolerance);
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
