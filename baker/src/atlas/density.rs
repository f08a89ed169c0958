//! The density that fills the pages, or the pages that hold a density.

use super::charts::FlatMesh;
use super::footprint::{BLOCK, Pages};
use super::layout;
use super::pack::{Packed, PackedMesh, pack};
use crate::scene::{Lightmap, LightmapSize};
use crate::{Error, Result};
use dataset::console::count;
use dataset::tiles::TILE;

/// Longest side of a page in texels.
pub const LARGEST: u32 = 16384;

/// Most rows of the virtual page: its texels' numbers fit 32 bits, and corners are rounded to no worse than 1/256 of a texel.
pub const MOST_ROWS: u32 = 131_072;

/// Charts closer than this many empty texels would share a texel under bilinear filtering.
const LEAST_PADDING: u32 = 2;

/// Pages with every chart on them.
pub struct Filled {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Number of pages, none of them empty.
    pub pages: u32,
    /// See [`super::Atlas::stride`].
    pub stride: u32,
    /// The scale of all charts.
    pub texels_per_metre: f64,
    /// One per mesh.
    pub meshes: Vec<PackedMesh>,
    /// Fraction of texels touched by charts.
    pub utilisation: f64,
}

/// Packs the charts as the settings ask.
pub fn fit(meshes: &[FlatMesh], lightmap: &Lightmap) -> Result<Filled> {
    let (pages, padding) = (lightmap.pages.max(1), lightmap.padding.max(LEAST_PADDING));
    match lightmap.size {
        LightmapSize::Fixed { width, height } => fill(meshes, width, height, pages, padding),
        LightmapSize::TexelsPerMetre(density) => grow(meshes, density, pages, padding, LARGEST),
    }
}

impl Filled {
    fn new(height: u32, texels_per_metre: f64, packed: Packed, asked: &Pages) -> Self {
        let (width, pages) = (asked.width as u32, packed.pages as u32);
        let stride = Pages { count: packed.pages, ..*asked }.stride(height as usize) as u32;
        let texels = f64::from(width) * f64::from(height) * f64::from(pages);
        let utilisation = packed.touched as f64 / texels;
        Filled { width, height, pages, stride, texels_per_metre, meshes: packed.meshes, utilisation }
    }
}

/// The highest density, to half a percent, whose charts fit pages of the given size.
fn fill(meshes: &[FlatMesh], width: u32, height: u32, pages: u32, padding: u32) -> Result<Filled> {
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
    let sheets = Pages {
        width: width as usize,
        height: height as usize,
        count: pages as usize,
        padding: padding as usize,
    };
    let rows = sheets.stride(sheets.height) * (sheets.count - 1) + sheets.height;
    if rows > MOST_ROWS as usize {
        return Err(Error::Unsupported {
            place: "lightmap".into(),
            what: format!(
                "pages = {pages} of {height} texels in height take {rows} rows: expected at most {MOST_ROWS} together"
            ),
        });
    }
    let attempt = |density: f64| pack(meshes, density, &sheets);
    // No density above this one fits: the charts' area is the pages'.
    let limit = (f64::from(width) * f64::from(height) * f64::from(pages) / area(meshes)).sqrt();
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
            // The least of the doubled sizes that holds them all, be they points.
            let doubled =
                (1..15).map(|k| Pages { width: sheets.width << k, height: sheets.height << k, ..sheets });
            let mut doubled =
                doubled.take_while(|sheets| sheets.width.max(sheets.height) <= LARGEST as usize);
            let larger = doubled.find(|sheets| pack(meshes, vanishing, sheets).is_some());
            return Err(Error::Unsupported {
                place: "lightmap".into(),
                what: format!(
                    "{size}: {} with {} of padding do not fit {} at any density; use a larger size{} or less padding{}{}",
                    count(meshes.iter().map(|m| m.charts.len() * m.members.len()).sum::<usize>(), "chart"),
                    count(padding as usize, "texel"),
                    if pages == 1 { "the page".to_owned() } else { format!("{pages} pages") },
                    if width.min(height) < 2 && larger.is_none() { " (at least 2 x 2)" } else { "" },
                    if pages == 1 { ", or more `pages`" } else { "" },
                    larger.map_or(String::new(), |s| format!(" (they fit {} x {})", s.width, s.height)),
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
    Ok(Filled::new(height, best.0, best.1, &sheets))
}

/// Pages about square, as large as the density needs: one of at most `largest` texels each way, or as few more as it takes up to
/// `pages`, of one size.
pub fn grow(
    meshes: &[FlatMesh],
    texels_per_metre: f64,
    pages: u32,
    padding: u32,
    largest: u32,
) -> Result<Filled> {
    if !(texels_per_metre.is_finite() && texels_per_metre > 0.0) {
        let what = format!("texels_per_metre is {texels_per_metre}, expected a positive number");
        return Err(Error::invalid("lightmap", what));
    }
    let (longest, boxes) = demand(meshes, texels_per_metre, padding, |side| side);
    let (side, texels) = (f64::from(largest), area(meshes) * texels_per_metre.powi(2));
    let most = MOST_ROWS / (largest + padding).next_multiple_of(TILE as u32);
    for count in 1..=pages.min(most) {
        // Wide enough for the longest, and so that the pages come out about square.
        let mut width = (boxes / f64::from(count)).sqrt().max(longest);
        while width <= side && texels <= f64::from(count) * side.powi(2) {
            let columns = (width.ceil() as u32).next_multiple_of(BLOCK as u32).min(largest);
            let sheets = Pages {
                width: columns as usize,
                height: largest as usize,
                count: count as usize,
                padding: padding as usize,
            };
            if let Some(packed) = pack(meshes, texels_per_metre, &sheets) {
                let rows = (packed.height as u32).next_multiple_of(BLOCK as u32);
                return Ok(Filled::new(rows, texels_per_metre, packed, &sheets));
            }
            if columns == largest {
                break;
            }
            width = (width * 1.2).min(side);
        }
    }
    // The remedies: a density at which the boxes, each rounded to whole blocks, leave a quarter of the pages free, or pages
    // enough to do so.
    let blocks = |side: f64| (side / BLOCK as f64).ceil() * BLOCK as f64;
    let pages = pages.min(most);
    let room = |pages: f64| pages * (0.85 * side).powi(2);
    let fits = |&density: &f64| {
        let (longest, boxes) = demand(meshes, density, padding, blocks);
        longest <= 0.9 * side && boxes <= room(pages.into())
    };
    let lower = (1..400).map(|step| texels_per_metre * 0.95f64.powi(step)).find(fits);
    let enough = (demand(meshes, texels_per_metre, padding, blocks).1 / room(1.0)).ceil();
    let more = longest <= 0.9 * side && enough > f64::from(pages) && enough <= f64::from(most);
    let mut remedies = Vec::new();
    remedies.extend(lower.map(|density| format!("about {density:.2e} would fit")));
    remedies.extend(more.then(|| format!("`pages = {enough}` would do")));
    if remedies.is_empty() {
        remedies.push("expected less padding or fewer charts".to_owned());
    }
    let what = if pages == 1 { "a page".to_owned() } else { format!("{pages} pages") };
    Err(Error::Unsupported {
        place: "lightmap".into(),
        what: format!(
            "texels_per_metre = {texels_per_metre} needs more than {what} of {largest} x {largest} texels; {}",
            remedies.join(", or ")
        ),
    })
}

/// Texels at a density: the longest thing to be placed, and the area of the boxes of all, with padding and rounded.
fn demand(
    meshes: &[FlatMesh],
    texels_per_metre: f64,
    padding: u32,
    round: impl Fn(f64) -> f64,
) -> (f64, f64) {
    let cells = |length: f64| length * texels_per_metre + 1.0;
    let measure = |mesh: &FlatMesh| {
        let padding = f64::from(padding);
        if mesh.is_shared() {
            let square = layout::width(mesh, texels_per_metre, padding as usize);
            let sides = mesh.members.iter().map(|m| square * m.scale);
            (sides.clone().fold(0.0, f64::max), sides.map(|s| round(s + padding).powi(2)).sum::<f64>())
        } else {
            let sides = mesh.charts.iter().map(|c| (cells(c.size.x), cells(c.size.y)));
            let boxes = sides.clone().map(|(x, y)| round(x + padding) * round(y + padding)).sum::<f64>();
            (sides.map(|s| s.0).fold(0.0, f64::max), boxes)
        }
    };
    meshes.iter().map(measure).fold((0.0f64, 0.0), |a, b| (a.0.max(b.0), a.1 + b.1))
}

fn area(meshes: &[FlatMesh]) -> f64 {
    meshes.iter().map(FlatMesh::area).sum()
}
