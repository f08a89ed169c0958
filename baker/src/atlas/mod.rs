//! Lightmap coordinates: unwrapping into charts and packing them on pages.
//!
//! `sharing` says which instances share a layout, `raster` which texels a triangle touches or covers,
//! `islands` what is connected; `charts` flattens each shape once (authored layout, or xatlas through `ffi`;
//! `unwraps` keeps what that gave). `footprint` says which blocks of 4×4 texels a chart owns where it may
//! lie, `outline` which charts share blocks, `locality` the order of space. `page` keeps the free blocks,
//! `fill` fills one page, `spread` several, `layout` packs the charts of a shared layout, `pack` places
//! charts and layouts at a given density, `density` searches for the density or the pages. `owners` tells
//! which chart a texel belongs to. `keep` takes the files' own coordinates instead of all this.

mod sharing;
mod ffi;
pub(crate) mod raster;
mod islands;
pub mod unwraps;
mod charts;
mod footprint;
mod outline;
mod locality;
mod page;
mod fill;
mod spread;
mod layout;
mod pack;
mod density;
pub mod owners;
mod keep;
#[cfg(test)]
mod tests;

use crate::geometry::Geometry;
use crate::scene::{Lightmap, LightmapSize, UvSource};
use crate::{Error, Result};
use dataset::observe::count;
pub use density::LARGEST_SIDE;
use glam::{DVec2, Vec2};
use pack::Origin;
use std::ops::Range;
use unwraps::{AlwaysUnwrap, Unwraps};

/// The layout of the texels over all lightmapped instances: pages of equal size, one below the other on one
/// tall virtual page.
///
/// Page p takes the rows `p × stride .. p × stride + page_height` of the virtual page ([`Atlas::page_rows`]);
/// the rows between pages hold nothing. Everything that works on texels works on the virtual page and need
/// not know of pages.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// Texels of every page, and of the virtual page.
    pub width: u32,
    /// Texels of the virtual page: `(pages − 1) × stride + page_height`.
    pub height: u32,
    /// Number of pages, at least 1; every one has texels.
    pub pages: u32,
    /// Texels of every page.
    pub page_height: u32,
    /// Rows of the virtual page from one page's first row to the next one's. `page_height` where there is one
    /// page; else that plus what dilation reaches, so that it does not go from page to page, rounded up to
    /// whole metric tiles (128), so that no tile and no block of texels lies on two.
    pub stride: u32,
    /// Texels per metre reached (at density 1).
    pub texels_per_metre: f64,
    /// One entry per triangle that has texels, ascending by `triangle`.
    pub faces: Vec<Face>,
    /// Number of charts.
    pub charts: u32,
    /// Triangles that got no texels though their instance is lightmapped (zero area), for the report.
    pub degenerate: usize,
    /// What is omitted because nobody can see it.
    pub skipped: Skipped,
    /// Fraction of the pages' texels that a chart touches, padding excluded.
    pub utilisation: f64,
    /// What was done otherwise than asked, one sentence each, for the report.
    pub notes: Vec<String>,
    /// What the user may not have meant.
    pub warnings: Vec<String>,
    /// Per instance of the geometry, its place on each page that has texels of it, ascending by page: none
    /// where it has no texels, several only where its charts are too many for one page.
    pub placements: Vec<Vec<Placement>>,
    /// The layouts that several instances share.
    pub layouts: Vec<Layout>,
}

/// Where the layout of an instance lies: page coordinates = `scale` × layout coordinates + `offset`, per
/// axis. Page coordinates run from (0, 0), the page's top left corner, to (1, 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The page, below [`Atlas::pages`].
    pub page: u32,
    /// (1, 1) where no other instance shares the layout: its coordinates are the page's.
    pub scale: [f32; 2],
    /// (0, 0) where no other instance shares the layout; else on a 4-texel boundary.
    pub offset: [f32; 2],
    /// Index into `Atlas::layouts`; `None` where no other instance shares the layout.
    pub layout: Option<u32>,
}

/// Triangles of lightmapped instances that got no texels because nobody can see them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Skipped {
    /// How many.
    pub triangles: usize,
    /// How many triangles the lightmapped instances have.
    pub of: usize,
    /// Their fraction of the area of all those.
    pub area: f64,
}

/// A layout that several instances of a mesh share.
#[derive(Clone, Debug)]
pub struct Layout {
    /// The instance it was made from, an index into `Geometry::instances`.
    pub instance: u32,
    /// Its triangles, ascending, each with the layout coordinates of its corners in [0, 1]: the first number
    /// is an index into `Geometry::triangles`.
    pub faces: Vec<(u32, [Vec2; 3])>,
}

impl Atlas {
    /// The rows of the virtual page that are page `page`'s, from its top to its bottom.
    pub fn page_rows(&self, page: u32) -> Range<u32> {
        let top = page * self.stride;
        top..top + self.page_height
    }

    /// How many texels faces touch: the length of [`Atlas::touched`], which was counted when the atlas was
    /// made.
    pub fn texels(&self) -> usize {
        let all = f64::from(self.width) * f64::from(self.page_height) * f64::from(self.pages);
        (self.utilisation * all).round() as usize
    }

    /// The texels of the virtual page that faces touch, row by row: those that surface covers, and a few that
    /// it only grazes.
    pub fn touched(&self) -> impl Iterator<Item = usize> + '_ {
        let width = self.width as usize;
        (0..self.pages).flat_map(move |number| {
            let mut bits = raster::Bits::new(width, self.page_height as usize);
            let rows = self.page_rows(number);
            for face in self.faces.iter().filter(|face| self.page_of(face) == number) {
                bits.touch(face.corners.map(|c| c.as_dvec2() - DVec2::Y * f64::from(rows.start)), 0.0);
            }
            let first = rows.start as usize * width;
            (0..bits.height * width)
                .filter(move |&i| bits.is_set(i % width, i / width))
                .map(move |i| first + i)
        })
    }

    /// One page with these faces, one chart, one texel per metre.
    #[cfg(test)]
    pub fn for_tests(width: u32, height: u32, faces: Vec<Face>) -> Self {
        Atlas {
            width,
            height,
            pages: 1,
            page_height: height,
            stride: height,
            texels_per_metre: 1.0,
            faces,
            charts: 1,
            degenerate: 0,
            skipped: Skipped::default(),
            utilisation: 1.0,
            notes: Vec::new(),
            warnings: Vec::new(),
            placements: Vec::new(),
            layouts: Vec::new(),
        }
    }

    /// The page a face lies on; no face lies on two.
    pub fn page_of(&self, face: &Face) -> u32 {
        (face.corners[0].y as u32 / self.stride).min(self.pages - 1)
    }
}

/// A triangle's place on the virtual page.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Index into `Geometry::triangles`.
    pub triangle: u32,
    /// Corner positions in texels of the virtual page: (0, 0) is its top left corner, texel (x, y) covers [x,
    /// x+1) × [y, y+1).
    pub corners: [Vec2; 3],
    /// Its chart.
    pub chart: u32,
}

/// The lightmapped instances by shape: all members of a list share one layout, and have their triangles in
/// the same order.
pub fn shapes(geometry: &Geometry) -> Vec<Vec<usize>> {
    let groups = sharing::groups(geometry).into_iter();
    groups.map(|group| group.members.iter().map(|member| member.instance).collect()).collect()
}

/// Lays out all faces: [`build_without`] none.
///
/// # Errors
/// As [`build_from`].
pub fn build(geometry: &Geometry, lightmap: &Lightmap) -> Result<Atlas> {
    build_without(geometry, lightmap, &[])
}

/// Lays out all faces but the hidden ones, unwrapping every mesh: [`build_from`] nothing.
///
/// # Errors
/// As [`build_from`].
pub fn build_without(geometry: &Geometry, lightmap: &Lightmap, hidden: &[u32]) -> Result<Atlas> {
    build_from(geometry, lightmap, hidden, &AlwaysUnwrap)
}

/// Unwraps and packs. Deterministic: the same geometry and settings give the same atlas, whatever the thread
/// count.
///
/// Charts keep their shape (one scale, quarter turns and mirror images only) and stay half a texel inside
/// their page. No texel is read for two charts by a filter `padding` texels wide (2, the least, is bilinear,
/// 4 bicubic), and no block of 4×4 texels on a 4-texel boundary holds texels that are read for two, except
/// charts less than a texel wide, of which up to four share a block. So the GPU's block formats and the first
/// two mips mix no charts either. On a page with more charts than blocks for them, several of the smallest
/// lie on each other, with a warning.
///
/// What is near in space lies near on the page, where that costs no more than 3 % of its texels.
///
/// Instances of one mesh share one layout, which lies on the page once for each, scaled to its density and
/// moved: see [`Placement`]. They do when they are of the same shape ([`crate::geometry::Similarity`]) and
/// differ in texels per metre of the mesh by a factor of 4 at most. Shared layouts start on 4-texel
/// boundaries, their charts too where nothing scales them. (Charts of one that is scaled are further apart,
/// but may share blocks with each other.)
///
/// A mesh's charts lie on one page, and so does every member of a shared layout, unless a mesh that shares
/// with none is so large that it would fill the emptiest page by a tenth more than its share: then its charts
/// lie on several. Pages that would be empty are left out.
///
/// Triangles of `hidden`, ascending, get no texels where they are hidden in every instance that shares their
/// layout.
///
/// Meshes whose unwrap `kept` has are not unwrapped again; that changes nothing in the atlas.
///
/// # Errors
/// `Invalid` when no triangle is to be lightmapped; `Unsupported` when a page has less than 2×2 texels, the
/// density asked for needs pages larger than 16384 texels, or all pages together have more than 131072 rows.
pub fn build_from(
    geometry: &Geometry,
    lightmap: &Lightmap,
    hidden: &[u32],
    kept: &dyn Unwraps,
) -> Result<Atlas> {
    if !geometry.instances.iter().any(|instance| instance.lightmap) {
        return Err(Error::invalid(
            "lightmap",
            format!(
                "nothing to bake: no mesh gets texels ({}), because of `lightmap = false` or glass that reflects nothing. Remove \
                 `lightmap = false`, or add an [[object.part]] with `lightmap = true`",
                count(geometry.instances.len(), "instance")
            ),
        ));
    }
    if lightmap.uv == UvSource::Keep {
        return keep::build(geometry, lightmap);
    }
    let flat = charts::flatten(geometry, hidden, kept)?;
    let lightmapped = || geometry.instances.iter().filter(|instance| instance.lightmap);
    let triangles: usize = lightmapped().map(|instance| instance.triangles.len()).sum();
    if flat.meshes.is_empty() {
        return Err(Error::invalid(
            "lightmap",
            format!(
                "nothing to bake: no lightmapped instance has a triangle of nonzero area{} ({}, {})",
                match hidden.len() {
                    0 => String::new(),
                    n => format!(" that can be seen; {n} cannot, and `hidden = \"keep\"` gives them texels"),
                },
                count(geometry.instances.len(), "instance"),
                count(triangles - hidden.len(), "degenerate triangle"),
            ),
        ));
    }
    let page = density::fit(&flat.meshes, lightmap)?;
    let stride = page.stride;
    let mut notes = Vec::new();
    if flat.authored > 0 {
        let instances = count(geometry.instances.len(), "instance");
        notes.push(format!("lightmap layouts of the files are used for {} of {instances}", flat.authored));
    }
    if page.pages < lightmap.pages && matches!(lightmap.size, LightmapSize::Fixed { .. }) {
        notes.push(format!(
            "{} of the {} pages {} everything; the others are left out",
            page.pages,
            lightmap.pages,
            if page.pages == 1 { "holds" } else { "hold" }
        ));
    }
    if page.padding < lightmap.padding {
        let least = page.padding;
        notes.push(format!(
            "padding is {least} texels, not {}: an eighth of the page's side at most",
            lightmap.padding
        ));
    }
    let page_size = DVec2::new(page.width.into(), page.height.into());
    let mut faces: Vec<Face> = Vec::new();
    let mut charts = 0;
    let mut placements = vec![Vec::new(); geometry.instances.len()];
    let mut layouts = Vec::new();
    for (mesh, packed) in flat.meshes.iter().zip(&page.meshes) {
        let texel = |chart: usize, corner| {
            packed.chart_placements[chart].texel(&mesh.charts[chart], corner, page.texels_per_metre)
        };
        let first = &geometry.instances[mesh.members[0].instance];
        let page_of =
            |chart: usize, origin: Origin| if mesh.is_shared() { origin.page } else { packed.chart_placements[chart].page } as u32;
        // The layout's unit square in texels of the smallest member: whole texels, half a one at least past
        // the last chart.
        let layout_size = (packed.end + 0.5).ceil();
        for (member, &origin) in mesh.members.iter().zip(&packed.origins) {
            let instance = &geometry.instances[member.instance];
            for (c, chart) in mesh.charts.iter().enumerate() {
                for face in &chart.faces {
                    let triangle =
                        instance.triangles.start + (face.triangle as usize - first.triangles.start);
                    if charts::is_degenerate(geometry.corners(triangle).map(|p| p.as_dvec3())) {
                        continue;
                    }
                    let shift = origin.texel + DVec2::Y * f64::from(page_of(c, origin) * stride);
                    let [p, q, r] =
                        face.corners.map(|corner| (texel(c, corner) * member.scale + shift).as_vec2());
                    let corners = if member.mirrored { [p, r, q] } else { [p, q, r] };
                    faces.push(Face { triangle: triangle as u32, corners, chart: charts + c as u32 });
                }
            }
            charts += mesh.charts.len() as u32;
            let mut pages: Vec<u32> = (0..mesh.charts.len()).map(|c| page_of(c, origin)).collect();
            pages.sort_unstable();
            pages.dedup();
            let place = |page: u32| match mesh.is_shared() {
                true => Placement {
                    page,
                    scale: (layout_size * member.scale / page_size).as_vec2().to_array(),
                    offset: (origin.texel / page_size).as_vec2().to_array(),
                    layout: Some(layouts.len() as u32),
                },
                false => Placement { page, scale: [1.0; 2], offset: [0.0; 2], layout: None },
            };
            placements[member.instance] = pages.into_iter().map(place).collect();
        }
        if mesh.is_shared() {
            let mut faces: Vec<(u32, [Vec2; 3])> = Vec::new();
            for (c, chart) in mesh.charts.iter().enumerate() {
                let place = |corner| (texel(c, corner) / layout_size).as_vec2();
                faces.extend(chart.faces.iter().map(|face| (face.triangle, face.corners.map(place))));
            }
            faces.sort_unstable_by_key(|face| face.0);
            layouts.push(Layout { instance: mesh.members[0].instance as u32, faces });
        }
    }
    faces.sort_unstable_by_key(|face| face.triangle);
    let skipped = skipped(geometry, &faces, hidden);
    let mut atlas = Atlas {
        width: page.width,
        height: stride * (page.pages - 1) + page.height,
        pages: page.pages,
        page_height: page.height,
        stride,
        texels_per_metre: page.texels_per_metre,
        degenerate: triangles - faces.len() - skipped.triangles,
        skipped,
        faces,
        charts,
        utilisation: 0.0,
        notes,
        warnings: warnings(geometry, &flat, &page, lightmap, &skipped),
        placements,
        layouts,
    };
    let texels = page_size.element_product() * f64::from(page.pages);
    atlas.utilisation = atlas.touched().count() as f64 / texels;
    Ok(atlas)
}

/// Which of the hidden triangles have no texels.
fn skipped(geometry: &Geometry, faces: &[Face], hidden: &[u32]) -> Skipped {
    let area = |triangle: usize| geometry.area_f64(triangle);
    let is_skipped = |triangle: &usize| {
        faces.binary_search_by_key(&(*triangle as u32), |face| face.triangle).is_err()
            && !charts::is_degenerate(geometry.corners(*triangle).map(|p| p.as_dvec3()))
    };
    let lightmapped = || geometry.instances.iter().filter(|i| i.lightmap).flat_map(|i| i.triangles.clone());
    let skipped = || hidden.iter().map(|&triangle| triangle as usize).filter(is_skipped);
    let part: f64 = skipped().map(area).sum();
    let triangles = skipped().count();
    let share = if triangles == 0 { 0.0 } else { part / lightmapped().map(area).sum::<f64>() };
    Skipped { triangles, of: lightmapped().count(), area: share }
}

/// Texels of the pages per texel of surface above which small charts cost more than what they show.
const COSTLY: f64 = 3.0;

/// How many parts such a warning names.
const MOST_COSTLY: usize = 10;

/// What the user may not have meant: layouts of files that are not used, more hidden than not, texels so wide
/// that the model may not be in metres, and parts in so many pieces that little of the page is surface.
fn warnings(
    geometry: &Geometry,
    flat: &charts::Flat,
    page: &density::Filled,
    lightmap: &Lightmap,
    skipped: &Skipped,
) -> Vec<String> {
    let (refused, texels_per_metre) = (&flat.refused[..], page.texels_per_metre);
    let mut warnings = Vec::new();
    if let [first, others @ ..] = refused {
        let others = match others.len() {
            0 => String::new(),
            n => format!("; {} more, too", count(n, "layout")),
        };
        warnings.push(format!(
            "a lightmap layout in the file is not used, {first}; the mesh is unwrapped{others}"
        ));
    }
    if skipped.area > 0.5 {
        warnings.push(format!(
            "{:.0} % of the lightmapped area gets no texels because nobody can see it: it lies in bodies of one-sided faces that look \
             outwards. Are faces turned inside out? [lightmap] hidden = \"keep\" gives it texels",
            100.0 * skipped.area
        ));
    }
    if texels_per_metre < 1.0 && matches!(lightmap.size, LightmapSize::Fixed { .. }) {
        warnings.push(format!(
            "texels are {} m wide: if a model is in millimetres, its [[object]] needs `scale = 0.001` (0.01 for centimetres); if it is in \
             metres, [lightmap] size may be too small: 1 texel per metre takes {} times that",
            digits(1.0 / texels_per_metre),
            digits(1.0 / texels_per_metre)
        ));
    }
    warnings.extend(costly(geometry, flat, page));
    warnings
}

/// Tells of parts whose charts are so small that the page is mostly what keeps them apart.
fn costly(geometry: &Geometry, flat: &charts::Flat, page: &density::Filled) -> Option<String> {
    let texels = |blocks: usize| (blocks * footprint::BLOCK * footprint::BLOCK) as f64;
    let surface: f64 =
        flat.meshes.iter().map(charts::FlatMesh::area).sum::<f64>() * page.texels_per_metre.powi(2);
    let owned: usize = page.meshes.iter().map(|mesh| mesh.blocks).sum();
    if page.stack == 1 && texels(owned) < COSTLY * surface {
        return None;
    }
    let mut parts: Vec<(f64, &str)> = Vec::new();
    for (mesh, packed) in flat.meshes.iter().zip(&page.meshes) {
        let name = &geometry.instances[mesh.members[0].instance].name;
        parts.push((texels(packed.blocks) / mesh.area(), name));
    }
    parts.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    parts.dedup_by(|a, b| a.1 == b.1);
    let named: Vec<String> = parts
        .iter()
        .take(MOST_COSTLY)
        .map(|(cost, name)| format!("{name} ({} texels per m²)", digits(*cost)))
        .collect();
    let shared = match page.stack {
        1 => String::new(),
        n => format!(
            "; there are more charts than the page has room for, so that up to {n} of the smallest lie on each other"
        ),
    };
    Some(format!(
        "small charts take {:.0} % of the texels in use and leave {} texels per metre{shared}. A larger [lightmap] size helps, and \
         `lightmap = false` for small parts; most texels per square metre go to {}",
        100.0 * (1.0 - (surface / texels(owned)).min(1.0)),
        digits(page.texels_per_metre),
        named.join(", ")
    ))
}

/// A positive number to two or three digits.
fn digits(value: f64) -> String {
    match value {
        9.95..1e6 => format!("{value:.0}"),
        0.095..9.95 => format!("{value:.1}"),
        _ => format!("{value:.1e}"),
    }
}
