//! The files' own lightmap coordinates as places on the page (`uv = "keep"`), so that a lightmap that an
//! engine has already can be replaced by one of the same layout. Nothing is packed, moved or turned.

use super::charts::is_degenerate;
use super::density::{LARGEST_SIDE, MOST_ROWS};
use super::footprint::Pages;
use super::islands::laid_islands;
use super::raster::{Bits, TOLERANCE, covered, touched};
use super::{Atlas, Face, Placement, Skipped};
use crate::geometry::{Geometry, Instance, LightmapPlace};
use crate::scene::{Lightmap, LightmapSize};
use crate::{Error, Result};
use dataset::observe::count;
use glam::{DVec2, Vec2};
use std::collections::{BTreeMap, BTreeSet};

/// What a user asked for, for messages.
const KEEP_SETTING: &str = "[lightmap] uv = \"keep\"";
/// Texels by which a coordinate may leave its page: rounding. It is moved to the edge.
const MOST_OUTSIDE: f64 = 0.5;
/// Triangles of less area than this on the page, in texels, have none there.
const LEAST_AREA: f64 = 1e-4;
/// Most meshes that a warning names.
const MOST_NAMED: usize = 5;
/// Most meshes that an error names.
const MOST_LISTED: usize = 50;
/// Cells along a page's longer side on which overlaps are looked for, and most cells along a texel.
const CELLS_PER_PAGE: u32 = 8192;
const MOST_CELLS_PER_TEXEL: u32 = 8;
/// Texels around an island whose squares bilinear filtering reads, but for rounding: those whose centres lie
/// within a texel.
const FILTER_REACH: f64 = 0.5 - 1.0 / 64.0;

/// A triangle where its file puts it.
struct Laid {
    triangle: u32,
    instance: usize,
    page: u32,
    /// In texels of its page.
    corners: [DVec2; 3],
}

/// Triangles with something wrong, by instance: how many, and where the first one lies, in lightmap
/// coordinates.
#[derive(Default)]
struct Named(BTreeMap<usize, (usize, DVec2)>);

/// Lays every lightmapped triangle where its file puts it.
///
/// Of triangles that overlap, the first in the order of the files has the texels: a later one at least half
/// of which lies on them gets none. (Where less of it does, texels hold the mean of both.) Triangles that
/// leave their page get none.
///
/// # Errors
/// `Invalid` where a lightmapped mesh has no lightmap coordinates, a node names a page beyond those asked
/// for, or no triangle is left; `Unsupported` where the pages are too large.
pub(super) fn build(geometry: &Geometry, lightmap: &Lightmap) -> Result<Atlas> {
    let LightmapSize::Fixed { width, height } = lightmap.size else {
        return Err(Error::invalid(KEEP_SETTING, "expected `size`, the page's size in texels"));
    };
    expect_coordinates(geometry)?;
    let pages = expect_pages(geometry, lightmap)?;
    let sheets = Pages {
        width: width as usize,
        height: height as usize,
        count: pages as usize,
        padding: lightmap.padding.max(1) as usize,
    };
    let stride = sheets.stride(sheets.height) as u32;
    let rows = stride * (pages - 1) + height;
    if width.max(height) > LARGEST_SIDE || rows > MOST_ROWS {
        let what = format!(
            "{pages} × {width} × {height} texels: expected at most {LARGEST_SIDE} each way and {MOST_ROWS} rows together"
        );
        return Err(Error::unsupported("lightmap", what));
    }

    let (mut outside, mut flat, mut covering) = (Named::default(), Named::default(), Named::default());
    let size = DVec2::new(width.into(), height.into());
    let mut degenerate = 0;
    let mut all: Vec<Laid> = Vec::new();
    for (i, instance) in lightmapped(geometry) {
        for triangle in instance.triangles.clone() {
            let (page, uvs) = place(geometry, instance, triangle);
            let corners = uvs.map(|uv| uv * size);
            if is_degenerate(geometry.corners(triangle).map(|p| p.as_dvec3())) {
                degenerate += 1;
            } else if corners
                .iter()
                .any(|c| c.min_element() < -MOST_OUTSIDE || (*c - size).max_element() > MOST_OUTSIDE)
            {
                outside.add(i, uvs[0]);
            } else {
                // As they are going to be, rounded.
                let top = DVec2::Y * f64::from(page * stride);
                let corners = corners.map(|c| (c.clamp(DVec2::ZERO, size) + top).as_vec2().as_dvec2() - top);
                if area(corners) < LEAST_AREA {
                    flat.add(i, uvs[0]);
                } else {
                    all.push(Laid { triangle: triangle as u32, instance: i, page, corners });
                }
            }
        }
    }
    let mut mixed = Named::default();
    without_overlaps(&mut all, &sheets, size, &mut covering, &mut mixed);
    if all.is_empty() {
        let what =
            "no triangle lies on the page: are these lightmap coordinates? `uv = \"auto\"` makes new ones";
        return Err(Error::invalid(KEEP_SETTING, what));
    }

    let triangles: Vec<u32> = all.iter().map(|laid| laid.triangle).collect();
    let charts = laid_islands(geometry, &triangles, |i, k| {
        let corner = all[i].corners[k].as_vec2();
        [all[i].page as f32, corner.x, corner.y]
    });
    let (touched_texels, close) = neighbours(&all, &charts, &sheets);
    let mut numbers = charts.clone();
    numbers.sort_unstable();
    numbers.dedup();
    let chart = |label: usize| numbers.partition_point(|&other| other < label) as u32;
    let mut placements = vec![Vec::new(); geometry.instances.len()];
    let mut faces = Vec::with_capacity(all.len());
    for (laid, &label) in all.iter().zip(&charts) {
        let here = Placement { page: laid.page, scale: [1.0; 2], offset: [0.0; 2], layout: None };
        placements[laid.instance] = vec![here];
        let top = DVec2::Y * f64::from(laid.page * stride);
        let corners = laid.corners.map(|c| (c + top).as_vec2());
        faces.push(Face { triangle: laid.triangle, corners, chart: chart(label) });
    }
    let texels: f64 = all.iter().map(|laid| area(laid.corners)).sum();
    let metres: f64 = triangles.iter().map(|&t| geometry.area_f64(t as usize)).sum();
    let nowhere = geometry.instances.iter().filter(|i| i.lightmap && !has_place(i)).count();
    let mut notes = vec![format!(
        "lightmap coordinates of the files are kept as they are: {} of the page",
        count(numbers.len(), "island")
    )];
    if nowhere > 0 {
        notes.push(format!("{} no texels in their files, and get none", of_meshes(nowhere, "has", "have")));
    }
    notes.extend(flat.told(geometry, "triangle", "without area on the page: no texels"));
    let warnings = [
        outside.told(geometry, "triangle", "outside the page, [0, 1] each way: no texels"),
        covering.told(
            geometry,
            "triangle",
            "over others that come first in the files: no texels of their own",
        ),
        mixed.told(
            geometry,
            "triangle",
            "partly over others that come first: texels there hold the mean of both",
        ),
        close.told(
            geometry,
            "island",
            "so near another that bilinear filtering reads the same texels for both: it mixes their light",
        ),
    ];
    Ok(Atlas {
        width,
        height: rows,
        pages,
        page_height: height,
        stride,
        texels_per_metre: (texels / metres).sqrt(),
        faces,
        charts: numbers.len() as u32,
        degenerate,
        skipped: Skipped::default(),
        utilisation: touched_texels as f64 / (size.x * size.y * f64::from(pages)),
        notes,
        warnings: warnings.into_iter().flatten().collect(),
        placements,
        layouts: Vec::new(),
    })
}

fn lightmapped(geometry: &Geometry) -> impl Iterator<Item = (usize, &Instance)> {
    geometry.instances.iter().enumerate().filter(|(_, instance)| instance.lightmap && has_place(instance))
}

/// Whether an instance has texels for all that its file says.
fn has_place(instance: &Instance) -> bool {
    instance.has_lightmap_uvs || instance.lightmap_place != LightmapPlace::Nowhere
}

/// The page of a triangle, and its lightmap coordinates there.
fn place(geometry: &Geometry, instance: &Instance, triangle: usize) -> (u32, [DVec2; 3]) {
    let uvs = geometry.triangles[triangle].map(|v| geometry.lightmap_uvs[v as usize].as_dvec2());
    match instance.lightmap_place {
        LightmapPlace::Unsaid | LightmapPlace::Nowhere => (0, uvs),
        LightmapPlace::At { page, scale, offset } => {
            let (scale, offset) = (Vec2::from(scale).as_dvec2(), Vec2::from(offset).as_dvec2());
            (page, uvs.map(|uv| uv * scale + offset))
        }
    }
}

/// An error that lists the lightmapped meshes without lightmap coordinates.
fn expect_coordinates(geometry: &Geometry) -> Result<()> {
    let mut names: Vec<&str> = Vec::new();
    for (_, instance) in lightmapped(geometry).filter(|(_, instance)| !instance.has_lightmap_uvs) {
        if !names.contains(&&instance.name[..]) {
            names.push(&instance.name);
        }
    }
    if names.is_empty() {
        return Ok(());
    }
    let more = if names.len() > MOST_LISTED {
        format!(" and {} more", names.len() - MOST_LISTED)
    } else {
        String::new()
    };
    let what = format!(
        "{} no lightmap coordinates (glTF: TEXCOORD_1; OBJ: vt, with `vt = \"lightmap\"`): {}{more}; give them `lightmap = false` in an \
         [[object.part]], or all new coordinates by uv = \"auto\"",
        of_meshes(names.len(), "has", "have"),
        names[..names.len().min(MOST_LISTED)].join(", ")
    );
    Err(Error::invalid(KEEP_SETTING, what))
}

/// The number of pages that the files use.
fn expect_pages(geometry: &Geometry, lightmap: &Lightmap) -> Result<u32> {
    let page = |(_, instance): (usize, &Instance)| match instance.lightmap_place {
        LightmapPlace::At { page, .. } => page,
        LightmapPlace::Unsaid | LightmapPlace::Nowhere => 0,
    };
    let last = lightmapped(geometry).max_by_key(|&of| page(of));
    let pages = last.map_or(1, |of| page(of).saturating_add(1));
    match last {
        Some((_, instance)) if pages > lightmap.pages => {
            let what = format!(
                "{} lies on page {} of its file: expected `pages = {pages}`",
                instance.name,
                pages - 1
            );
            Err(Error::invalid(KEEP_SETTING, what))
        }
        _ => Ok(pages),
    }
}

/// Takes out triangles at least half of which lie on earlier ones, and notes those of which less does.
fn without_overlaps(
    all: &mut Vec<Laid>,
    sheets: &Pages,
    size: DVec2,
    covering: &mut Named,
    mixed: &mut Named,
) {
    let cells = (CELLS_PER_PAGE / sheets.width.max(sheets.height) as u32).clamp(1, MOST_CELLS_PER_TEXEL);
    let (width, height) = (sheets.width * cells as usize, sheets.height * cells as usize);
    let mut taken: Vec<Bits> = (0..sheets.count).map(|_| Bits::new(width, height)).collect();
    all.retain(|laid| {
        let bits = &mut taken[laid.page as usize];
        let spans: Vec<_> = covered(laid.corners.map(|c| c * f64::from(cells)), width, height).collect();
        let whole: usize = spans.iter().map(|(_, columns)| columns.len()).sum();
        let of_others: usize =
            spans.iter().map(|(y, columns)| bits.count_span(*y, columns.start, columns.end)).sum();
        let at = laid.corners[0] / size;
        if of_others > 0 && 2 * of_others >= whole {
            covering.add(laid.instance, at);
            return false;
        }
        // A cell or two along an edge is rounding.
        if 50 * of_others > whole && of_others > 2 {
            mixed.add(laid.instance, at);
        }
        spans.into_iter().for_each(|(y, columns)| {
            bits.set_span(y, columns.start, columns.end);
        });
        true
    });
}

/// The number of texels touched, and the islands of which bilinear filtering reads a texel that it reads for
/// another, too.
fn neighbours(all: &[Laid], charts: &[usize], sheets: &Pages) -> (usize, Named) {
    let mut bits: Vec<Bits> = (0..sheets.count).map(|_| Bits::new(sheets.width, sheets.height)).collect();
    // What is read: page, row, columns and island.
    let mut runs: Vec<(u32, usize, usize, usize, usize)> = Vec::new();
    for (laid, &chart) in all.iter().zip(charts) {
        bits[laid.page as usize].touch(laid.corners, TOLERANCE);
        let rows = touched(laid.corners, FILTER_REACH, sheets.width, sheets.height);
        runs.extend(rows.map(|(y, columns)| (laid.page, y, columns.start, columns.end, chart)));
    }
    runs.sort_unstable();
    const NONE: usize = usize::MAX;
    let mut close = BTreeSet::new();
    for row in runs.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        let mut readers = vec![NONE; sheets.width];
        for &(_, _, from, to, chart) in row {
            for reader in &mut readers[from..to] {
                if *reader != NONE && *reader != chart {
                    close.extend([*reader, chart]);
                }
                *reader = chart;
            }
        }
    }
    let mut named = Named::default();
    let size = DVec2::new(sheets.width as f64, sheets.height as f64);
    close.iter().for_each(|&first| named.add(all[first].instance, all[first].corners[0] / size));
    (bits.iter().map(Bits::count).sum(), named)
}

fn area([a, b, c]: [DVec2; 3]) -> f64 {
    0.5 * (b - a).perp_dot(c - a).abs()
}

/// Such as `1 mesh has` or `2 meshes have`.
fn of_meshes(n: usize, one: &str, many: &str) -> String {
    if n == 1 { format!("1 mesh {one}") } else { format!("{n} meshes {many}") }
}

impl Named {
    fn add(&mut self, instance: usize, at: DVec2) {
        self.0.entry(instance).or_insert((0, at)).0 += 1;
    }

    /// A warning, if there is something to name.
    fn told(&self, geometry: &Geometry, unit: &str, what: &str) -> Option<String> {
        let of_instance = |(&instance, &(n, at)): (&usize, &(usize, DVec2))| {
            format!(
                "{}: {n} (the first at u = {:.3}, v = {:.3})",
                geometry.instances[instance].name, at.x, at.y
            )
        };
        let mut names: Vec<String> = self.0.iter().take(MOST_NAMED).map(of_instance).collect();
        if self.0.len() > MOST_NAMED {
            names.push(format!("and {} more", of_meshes(self.0.len() - MOST_NAMED, "", "").trim_end()));
        }
        let all: usize = self.0.values().map(|named| named.0).sum();
        (all > 0).then(|| format!("{KEEP_SETTING}: {} {what}: {}", count(all, unit), names.join("; ")))
    }
}
