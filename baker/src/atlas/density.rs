//! The density that fills a page, or the page that holds a density.

use super::block;
use super::charts::FlatMesh;
use super::pack::{BLOCK, Packed, PackedMesh, pack};
use crate::scene::{Lightmap, LightmapSize};
use crate::{Error, Result};

/// Longest side of a page in texels.
const LARGEST: u32 = 16384;

/// Charts closer than this many empty texels would share a texel under bilinear filtering.
const LEAST_PADDING: u32 = 2;

/// A page with every chart on it.
pub struct Page {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// The scale of all charts.
    pub texels_per_metre: f64,
    /// One per mesh.
    pub meshes: Vec<PackedMesh>,
    /// Fraction of texels touched by charts.
    pub utilisation: f64,
}

/// Packs the charts as the settings ask.
pub fn fit(meshes: &[FlatMesh], lightmap: &Lightmap) -> Result<Page> {
    let padding = lightmap.padding.max(LEAST_PADDING);
    match lightmap.size {
        LightmapSize::Fixed { width, height } => fill_page(meshes, width, height, padding),
        LightmapSize::TexelsPerMetre(texels_per_metre) => grow_page(meshes, texels_per_metre, padding),
    }
}

impl Page {
    fn new(width: u32, height: u32, texels_per_metre: f64, packed: Packed) -> Self {
        let utilisation = packed.touched as f64 / (f64::from(width) * f64::from(height));
        Page { width, height, texels_per_metre, meshes: packed.meshes, utilisation }
    }
}

/// The highest density, to half a percent, whose charts fit a page of the given size.
fn fill_page(meshes: &[FlatMesh], width: u32, height: u32, padding: u32) -> Result<Page> {
    let size = format!("size {width} x {height}");
    if width == 0 || height == 0 {
        return Err(Error::invalid("lightmap", format!("{size}: expected at least 1 texel each way")));
    }
    if width.max(height) > LARGEST {
        return Err(Error::Unsupported {
            place: "lightmap".into(),
            what: format!("{size}: expected at most {LARGEST} texels each way"),
        });
    }
    let attempt = |density: f64| pack(meshes, density, width as usize, height as usize, padding as usize);
    // No density above this one fits: the charts' area is the page's.
    let limit = (f64::from(width) * f64::from(height) / area(meshes)).sqrt();
    let (mut fails, mut density) = (limit, 0.8 * limit);
    // Down until they fit; a density at which every chart is a point tells early whether any does.
    let mut attempts = 0;
    let mut best = loop {
        if let Some(packed) = attempt(density) {
            break (density, packed);
        }
        (fails, density, attempts) = (density, 0.8 * density, attempts + 1);
        let vanishing = 1e-9 * limit;
        if (attempts == 8 && attempt(vanishing).is_none()) || density < vanishing {
            return Err(Error::Unsupported {
                place: "lightmap".into(),
                what: format!(
                    "{size}: {} charts with {padding} texels of padding do not fit at any density; use a larger size",
                    meshes.iter().map(|m| m.charts.len() * m.members.len()).sum::<usize>()
                ),
            });
        }
    };
    // Bisection between a density that fits and one that does not.
    while fails > best.0 * 1.005 {
        let density = (fails * best.0).sqrt();
        match attempt(density) {
            Some(packed) => best = (density, packed),
            None => fails = density,
        }
    }
    Ok(Page::new(width, height, best.0, best.1))
}

/// One page, about square, as large as the density needs.
fn grow_page(meshes: &[FlatMesh], texels_per_metre: f64, padding: u32) -> Result<Page> {
    if !(texels_per_metre.is_finite() && texels_per_metre > 0.0) {
        let what = format!("texels_per_metre is {texels_per_metre}, expected a positive number");
        return Err(Error::invalid("lightmap", what));
    }
    let cells = |length: f64| length * texels_per_metre + 1.0;
    // Per mesh, the longest thing to be placed and the area of all, with padding.
    let measure = |mesh: &FlatMesh| {
        let padding = f64::from(padding);
        if mesh.is_shared() {
            let square = block::width(mesh, texels_per_metre, padding as usize);
            let sides = mesh.members.iter().map(|m| square * m.scale);
            (sides.clone().fold(0.0, f64::max), sides.map(|s| (s + padding).powi(2)).sum::<f64>())
        } else {
            let sides = mesh.charts.iter().map(|c| (cells(c.size.x), cells(c.size.y)));
            let boxes = sides.clone().map(|(x, y)| (x + padding) * (y + padding)).sum::<f64>();
            (sides.map(|s| s.0).fold(0.0, f64::max), boxes)
        }
    };
    // Wide enough for the longest, and so that the page comes out about square.
    let (longest, boxes) = meshes.iter().map(measure).fold((0.0f64, 0.0), |a, b| (a.0.max(b.0), a.1 + b.1));
    let mut width = boxes.sqrt().max(longest);
    while width <= f64::from(LARGEST) && area(meshes) * texels_per_metre.powi(2) <= f64::from(LARGEST).powi(2)
    {
        let columns = (width.ceil() as u32).next_multiple_of(BLOCK as u32).min(LARGEST);
        if let Some(packed) =
            pack(meshes, texels_per_metre, columns as usize, LARGEST as usize, padding as usize)
        {
            let rows = (packed.height as u32).next_multiple_of(BLOCK as u32);
            return Ok(Page::new(columns, rows, texels_per_metre, packed));
        }
        if columns == LARGEST {
            break;
        }
        width = (width * 1.2).min(f64::from(LARGEST));
    }
    // Charts and the padding around them take more than the page: shrink both sides alike, with a tenth to spare.
    let largest = f64::from(LARGEST);
    let shrink = (largest / longest).min(largest / boxes.sqrt()).min(1.0) * 0.9;
    Err(Error::Unsupported {
        place: "lightmap".into(),
        what: format!(
            "texels_per_metre = {texels_per_metre} needs a page of more than {LARGEST} x {LARGEST} texels; about {:.2e} would fit",
            texels_per_metre * shrink
        ),
    })
}

fn area(meshes: &[FlatMesh]) -> f64 {
    meshes.iter().map(FlatMesh::area).sum()
}
