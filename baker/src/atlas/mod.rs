//! Lightmap coordinates: unwrapping into charts and packing them on a page.
//!
//! `sharing` says which instances share a layout, `charts` flattens each shape once (authored layout, or xatlas through `ffi`),
//! `raster` says which texels a chart covers, `page` keeps the free texels, `block` packs the charts of a shared layout, `pack`
//! places charts and layouts at a given density, `density` searches for the density or the page.

mod block;
mod charts;
mod density;
mod ffi;
mod pack;
mod page;
mod raster;
mod sharing;
#[cfg(test)]
mod tests;

use crate::geometry::Geometry;
use crate::scene::Lightmap;
use crate::{Error, Result};
use glam::{DVec2, Vec2};

/// The layout of one page of texels over all lightmapped instances.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Texels per metre reached (at density 1).
    pub texels_per_metre: f64,
    /// One entry per triangle that has texels, ascending by `triangle`.
    pub faces: Vec<Face>,
    /// Number of charts.
    pub charts: u32,
    /// Triangles that got no texels though their instance is lightmapped (zero area), for the report.
    pub degenerate: usize,
    /// Fraction of the page's texels that a chart touches, padding excluded.
    pub utilisation: f64,
    /// What was done otherwise than asked, one sentence each, for the report.
    pub notes: Vec<String>,
    /// Per instance of the geometry, its place on the page; `None` where it has no texels.
    pub placements: Vec<Option<Placement>>,
    /// The layouts that several instances share.
    pub layouts: Vec<Layout>,
}

/// Where the layout of an instance lies: page coordinates = `scale` × layout coordinates + `offset`, per axis. Page coordinates
/// run from (0, 0), the page's top left corner, to (1, 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// (1, 1) where no other instance shares the layout: its coordinates are the page's.
    pub scale: [f32; 2],
    /// (0, 0) where no other instance shares the layout; else on a 4-texel boundary.
    pub offset: [f32; 2],
    /// Index into `Atlas::layouts`; `None` where no other instance shares the layout.
    pub layout: Option<u32>,
}

/// A layout that several instances of a mesh share.
#[derive(Clone, Debug)]
pub struct Layout {
    /// The instance it was made from, an index into `Geometry::instances`.
    pub instance: u32,
    /// Its triangles, ascending, each with the layout coordinates of its corners in [0, 1]: the first number is an index into
    /// `Geometry::triangles`.
    pub faces: Vec<(u32, [Vec2; 3])>,
}

/// A triangle's place on the page.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Index into `Geometry::triangles`.
    pub triangle: u32,
    /// Corner positions in texels: (0, 0) is the page's top left corner, texel (x, y) covers [x, x+1) × [y, y+1).
    pub corners: [Vec2; 3],
    /// Its chart.
    pub chart: u32,
}

/// Unwraps and packs. Deterministic: the same geometry and settings give the same atlas, whatever the thread count.
///
/// Charts keep their shape (one scale, quarter turns and mirror images only), start on 4-texel boundaries, stay half a texel
/// inside the page, and the texels that two charts touch are at least `padding` (and never less than 2) empty texels apart, so
/// that bilinear taps never mix charts.
///
/// Instances of one mesh share one layout, which lies on the page once for each, scaled to its density and moved: see
/// [`Placement`]. They do when they are of the same shape ([`crate::geometry::Similarity`]) and differ in texels per metre of the
/// mesh by a factor of 4 at most. Shared layouts start on 4-texel boundaries, their charts too where nothing scales them.
///
/// # Errors
/// `Invalid` when no triangle is to be lightmapped; `Unsupported` when the charts do not fit the page at any density, or the
/// density asked for needs a page larger than 16384 texels.
pub fn build(geometry: &Geometry, lightmap: &Lightmap) -> Result<Atlas> {
    let flat = charts::flatten(geometry)?;
    let lightmapped = || geometry.instances.iter().filter(|instance| instance.lightmap);
    let triangles: usize = lightmapped().map(|instance| instance.triangles.len()).sum();
    if flat.meshes.is_empty() {
        return Err(Error::invalid(
            "lightmap",
            format!(
                "nothing to bake: no lightmapped instance has a triangle of nonzero area ({} instances, {triangles} degenerate triangles)",
                geometry.instances.len(),
            ),
        ));
    }
    let page = density::fit(&flat.meshes, lightmap)?;
    let page_size = DVec2::new(page.width.into(), page.height.into());
    let mut faces: Vec<Face> = Vec::new();
    let mut charts = 0;
    let mut placements = vec![None; geometry.instances.len()];
    let mut layouts = Vec::new();
    for (mesh, packed) in flat.meshes.iter().zip(&page.meshes) {
        let texel = |chart: usize, corner| {
            packed.places[chart].texel(&mesh.charts[chart], corner, page.texels_per_metre)
        };
        let first = &geometry.instances[mesh.members[0].instance];
        // The layout's unit square in texels of the smallest member: whole texels, half a one past the last chart.
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
                    let [p, q, r] =
                        face.corners.map(|corner| (texel(c, corner) * member.scale + origin).as_vec2());
                    let corners = if member.mirrored { [p, r, q] } else { [p, q, r] };
                    faces.push(Face { triangle: triangle as u32, corners, chart: charts + c as u32 });
                }
            }
            charts += mesh.charts.len() as u32;
            placements[member.instance] = Some(match mesh.is_shared() {
                true => Placement {
                    scale: (layout_size * member.scale / page_size).as_vec2().to_array(),
                    offset: (origin / page_size).as_vec2().to_array(),
                    layout: Some(layouts.len() as u32),
                },
                false => Placement { scale: [1.0; 2], offset: [0.0; 2], layout: None },
            });
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
    Ok(Atlas {
        width: page.width,
        height: page.height,
        texels_per_metre: page.texels_per_metre,
        degenerate: triangles - faces.len(),
        faces,
        charts,
        utilisation: page.utilisation,
        notes: flat.notes,
        placements,
        layouts,
    })
}
