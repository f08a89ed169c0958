//! The density that fills the pages, or the pages that hold a density.

use super::charts::FlatMesh;
use super::fill::{Filling, Windows};
use super::footprint::{BLOCK, Pages};
use super::layout;
use super::locality::ranks;
use super::pack::{Items, Packed, PackedMesh};
use crate::scene::{Lightmap, LightmapSize};
use crate::{Error, Result};
use dataset::format::TILE;

/// Longest side of a page in texels.
pub const LARGEST_SIDE: u32 = 16384;

/// Most rows of the virtual page: its texels' numbers fit 32 bits, and corners are rounded to no worse than
/// 1/256 of a texel.
pub(super) const MOST_ROWS: u32 = 131_072;

/// A page is at least this many times as long as its padding is wide.
const PADDING_OF_PAGE: u32 = 8;

/// Width of the bilinear filter in texels.
const LEAST_PADDING: u32 = 2;

/// The part of the density that remains where charts that lie together in space do so on the page: 3 % of the
/// texels go.
const FOR_LOCALITY: f64 = 0.985;

/// Pages with every chart on them.
pub(super) struct Filled {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Number of pages, none of them empty.
    pub pages: u32,
    /// See [`super::Atlas::stride`].
    pub stride: u32,
    /// The padding that was kept: less than asked on a page that is short beside it.
    pub padding: u32,
    /// The scale of all charts.
    pub texels_per_metre: f64,
    /// One per mesh.
    pub meshes: Vec<PackedMesh>,
    /// How many of the smallest charts share a block of texels: 1, unless there are more than blocks.
    pub stack: usize,
}

/// Packs the charts as the settings ask.
pub(super) fn fit(meshes: &[FlatMesh], lightmap: &Lightmap) -> Result<Filled> {
    let (pages, padding) = (lightmap.pages.max(1), lightmap.padding.max(LEAST_PADDING));
    match lightmap.size {
        LightmapSize::Fixed { width, height } => {
            // Each chart owns half of it on every side: more would leave small pages nothing else.
            let most = (width.min(height) / PADDING_OF_PAGE).max(LEAST_PADDING);
            fill(meshes, width, height, pages, padding.min(most))
        }
        LightmapSize::TexelsPerMetre(density) => grow(meshes, density, pages, padding, LARGEST_SIDE),
    }
}

impl Filled {
    fn new(height: u32, texels_per_metre: f64, packed: Packed, asked: &Pages, stack: usize) -> Self {
        let (width, pages) = (asked.width as u32, packed.pages as u32);
        let stride = Pages { count: packed.pages, ..*asked }.stride(height as usize) as u32;
        let padding = asked.padding as u32;
        Filled { width, height, pages, stride, padding, texels_per_metre, meshes: packed.meshes, stack }
    }
}

/// The highest density, to half a percent, whose charts fit pages of the given size.
fn fill(meshes: &[FlatMesh], width: u32, height: u32, pages: u32, padding: u32) -> Result<Filled> {
    let size = format!("size {width} x {height}");
    if width == 0 || height == 0 {
        return Err(Error::invalid("lightmap", format!("{size}: expected at least 1 texel each way")));
    }
    if width.max(height) > LARGEST_SIDE {
        return Err(Error::Unsupported {
            place: "lightmap".into(),
            what: format!("{size}: expected at most {LARGEST_SIDE} texels each way"),
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
    let texels = f64::from(width) * f64::from(height) * f64::from(pages);
    let ranks = ranks(meshes);
    let too_small = || Error::Unsupported {
        place: "lightmap".into(),
        what: format!(
            "{size}: no chart fits at any density; expected at least 2 x 2 texels, more for instances of several sizes"
        ),
    };
    let draw = |density: f64, stack| Items::new(meshes, &ranks, density, &sheets, stack);
    // As many to a block as it takes for all to fit when they are points.
    let vanishing = 1e-9 * (texels / area(meshes)).sqrt();
    let doubled = (0..32).map(|k| 1usize << k);
    let mut stacks = doubled.filter(|&stack| {
        let filling = Filling { stack, start: sheets.start(), windows: None };
        draw(vanishing, stack)
            .is_some_and(|items| items.pack(meshes, &ranks, vanishing, &sheets, filling).is_some())
    });
    let stack = stacks.next().ok_or_else(too_small)?;
    let limit = limit(vanishing, (texels / area(meshes)).sqrt(), |density| {
        let blocks = sheets.blocks().0 * sheets.blocks().1 * sheets.count;
        draw(density, stack).is_some_and(|items| stack > 1 || items.blocks() <= blocks)
    });
    let attempt = |density: f64, windows| {
        let filling = Filling { stack, start: sheets.start(), windows };
        Some((density, draw(density, stack)?.pack(meshes, &ranks, density, &sheets, filling)?))
    };
    // Down until they fit, then bisection between a density that fits and one that does not.
    let (mut fails, mut probe) = (limit, 0.97 * limit);
    let mut best: Option<(f64, Packed)> = None;
    while best.as_ref().is_none_or(|best| fails > best.0 * 1.005) {
        if probe < vanishing {
            return Err(too_small());
        }
        match attempt(probe, None) {
            Some(packed) => best = Some(packed),
            None => fails = probe,
        }
        probe = best.as_ref().map_or(0.95 * probe, |best| (fails * best.0).sqrt());
    }
    // Then the way of filling that keeps most together at little less.
    let mut best = best.ok_or_else(too_small)?;
    let densities = [0.5 * (1.0 + FOR_LOCALITY), FOR_LOCALITY].map(|part| part * best.0);
    let mut together =
        Windows::ALL.into_iter().flat_map(|windows| densities.map(|density| (density, windows)));
    best = together.find_map(|(density, windows)| attempt(density, Some(windows))).unwrap_or(best);
    Ok(Filled::new(height, best.0, best.1, &sheets, stack))
}

/// The highest density that may fit, to half a percent: at a higher one charts own more blocks than there
/// are. Found by areas, without packing pages. `may_fit` holds at `low`.
fn limit(low: f64, high: f64, may_fit: impl Fn(f64) -> bool) -> f64 {
    let (mut fits, mut fails) = (low, high);
    let mut probe = 0.8 * high;
    while fails > fits * 1.005 {
        match may_fit(probe) {
            true => fits = probe,
            false => fails = probe,
        }
        probe = if fits > low { (fails * fits).sqrt() } else { (0.7 * probe).max(low) };
    }
    fails
}

/// Pages about square, as large as the density needs: one of at most `largest` texels each way, or as few
/// more as it takes up to `pages`, of one size.
pub(super) fn grow(
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
    let ranks = ranks(meshes);
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
            let items = Items::new(meshes, &ranks, texels_per_metre, &sheets, 1);
            let filling = Filling { stack: 1, start: sheets.start(), windows: None };
            let packed = items.and_then(|i| i.pack(meshes, &ranks, texels_per_metre, &sheets, filling));
            if let Some(packed) = packed {
                let rows = (packed.height as u32).min(largest);
                let sheets = Pages { height: rows as usize, count: packed.pages, ..sheets };
                return Ok(together(meshes, &ranks, texels_per_metre, &sheets, largest)
                    .unwrap_or_else(|| Filled::new(rows, texels_per_metre, packed, &sheets, 1)));
            }
            if columns == largest {
                break;
            }
            width = (width * 1.2).min(side);
        }
    }
    // The remedies: a density at which the boxes, each rounded to whole blocks, leave a quarter of the pages
    // free, or pages enough to do so.
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

/// Pages of at most 3 % more texels than `sheets`, which hold everything at this density, on which what lies
/// together in space does so on the page. `None` where that takes more, and for a page of one tile.
fn together(
    meshes: &[FlatMesh],
    ranks: &[Vec<u32>],
    texels_per_metre: f64,
    sheets: &Pages,
    largest: u32,
) -> Option<Filled> {
    if sheets.count == 1 && sheets.width.max(sheets.height) <= TILE {
        return None;
    }
    let most = (sheets.height as f64 / FOR_LOCALITY.powi(2)) as usize;
    let sheets = Pages { height: most.next_multiple_of(BLOCK).min(largest as usize), ..*sheets };
    let items = Items::new(meshes, ranks, texels_per_metre, &sheets, 1)?;
    Windows::ALL.into_iter().find_map(|windows| {
        let filling = Filling { stack: 1, start: sheets.start(), windows: Some(windows) };
        let packed = items.pack(meshes, ranks, texels_per_metre, &sheets, filling)?;
        let rows = packed.height.min(sheets.height) as u32;
        Some(Filled::new(rows, texels_per_metre, packed, &sheets, 1))
    })
}

/// Texels at a density: the longest thing to be placed, and the area of the boxes of all, with padding and
/// rounded.
fn demand(
    meshes: &[FlatMesh],
    texels_per_metre: f64,
    padding: u32,
    round: impl Fn(f64) -> f64,
) -> (f64, f64) {
    let cells = |length: f64| length * texels_per_metre + 1.0;
    let sheet = Pages {
        width: LARGEST_SIDE as usize,
        height: LARGEST_SIDE as usize,
        count: 1,
        padding: padding as usize,
    };
    let measure = |mesh: &FlatMesh| {
        let padding = f64::from(padding);
        if mesh.is_shared() {
            let square = layout::width(mesh, texels_per_metre, &sheet);
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
