//! The sun's visibility and the normals of a page of half the resolution.
//!
//! A normal is the mean of those of the texels that count. Visibility is their mean too, weighted by how much
//! each of them faces the sun at that time: then visibility · (normal · direction)⁺ is the mean of what the
//! texels have, unless one of them faces away. A mean of four levels needs finer levels, so the half has four
//! times as many, up to 255: with those of the source the yard's direct light errs by 2.3 % instead of 0.7
//! (`compressor/examples/halved_error.rs`).

use super::half::{Counted, Half};
use crate::Result;
use crate::format::tiles::{Rect, TILE, grid, tiles};
use crate::format::visibility::{Planes, to_bytes};
use crate::format::{Config, FileRef, Normals};
use crate::host::signals::stop_if_interrupted;
use crate::observe::Meter;
use crate::store::{Dataset, Sunlight, Writer, stem_of};
use rayon::prelude::*;

/// Largest number of levels of the half per level of the source.
const FINER: u8 = 4;

/// What the progress counts for a page.
pub(super) fn work(config: &Config, page: usize) -> u64 {
    let page = &config.pages[page];
    let [width, height] = [page.width, page.height].map(|side| side.div_ceil(2) as usize);
    config.visibility.as_ref().map_or(0, |_| tiles(width, height, TILE).len() as u64 * TILE as u64)
}

/// Writes a page's levels and normals; the files of both, if the dataset has them.
pub(super) fn write(
    dataset: &Dataset,
    page: usize,
    half: &Half,
    writer: &mut Writer,
    progress: &dyn Meter,
) -> Result<[Option<FileRef>; 2]> {
    let Some((files, sunlight)) = dataset.config.visibility.as_ref().zip(dataset.sunlight(page)?) else {
        return Ok([None, None]);
    };
    let size = [half.width as u32, half.height as u32];
    let rects = tiles(half.width, half.height, TILE);
    let top = sunlight.visibility.top.saturating_mul(FINER);
    let page_of = Page { half, sunlight: &sunlight, top };
    let payloads: Vec<Result<(Vec<u8>, u32)>> = rects
        .par_iter()
        .map(|rect| {
            stop_if_interrupted()?;
            let payload = page_of.tile(rect)?.to_payload();
            progress.advance(TILE as u64);
            Ok(payload)
        })
        .collect();
    let payloads = payloads.into_iter().collect::<Result<Vec<_>>>()?;
    let Sunlight { visibility, normals, .. } = &sunlight;
    let bytes = to_bytes(size, top, &visibility.hours, &payloads);
    let levels = writer.add(stem_of(&files.files[page].path), "vis", &bytes)?;
    let png = half_normals(half, normals).to_png();
    Ok([Some(levels), Some(writer.add(stem_of(&files.normals[page].path), "png", &png)?)])
}

/// The means of the normals.
fn half_normals(half: &Half, source: &Normals) -> Normals {
    let normal = |(x, y): (usize, usize)| source.normals[y * source.width + x];
    let places = (0..half.height).flat_map(|y| (0..half.width).map(move |x| (x, y)));
    let normals = places.map(|(x, y)| half.counted(x, y).mean(normal)).collect();
    Normals { width: half.width, height: half.height, normals }
}

/// A page at work.
struct Page<'a> {
    half: &'a Half,
    sunlight: &'a Sunlight,
    /// The half's level of full visibility.
    top: u8,
}

impl Page<'_> {
    /// The levels over a tile of the half: of the four tiles under it, or fewer at the edges.
    fn tile(&self, rect: &Rect) -> Result<Planes> {
        let visibility = &self.sunlight.visibility;
        let (across, _) = grid(self.half.source.width, self.half.source.height, TILE);
        let (x0, y0) = (2 * rect.x0 / TILE, 2 * rect.y0 / TILE);
        let mut under: [Option<(Rect, Planes)>; 4] = [const { None }; 4];
        for (i, slot) in under.iter_mut().enumerate() {
            let (column, row) = (x0 + i % 2, y0 + i / 2);
            let tile = row * across + column;
            if column < across && tile < visibility.tiles.len() {
                *slot = Some((visibility.tiles[tile], visibility.tile(tile)?));
            }
        }
        let channels = under.iter().flatten().map(|(_, planes)| planes.channels).max().unwrap_or(1);
        let level = |(x, y): (usize, usize), time: usize| {
            let slot = (y / TILE - y0) * 2 + x / TILE - x0;
            under[slot].as_ref().map_or([0; 3], |(rect, planes)| {
                planes.level((y - rect.y0) * rect.width() + x - rect.x0, time)
            })
        };
        let texels = rect.width() * rect.height();
        let times = visibility.hours.len();
        let mut levels = vec![0; channels * times * texels];
        for texel in 0..texels {
            let at = (rect.x0 + texel % rect.width(), rect.y0 + texel / rect.width());
            let counted = self.half.counted(at.0, at.1);
            for time in 0..times {
                let mean = self.mean(&counted, time, |place| level(place, time));
                for channel in 0..channels {
                    levels[(channel * times + time) * texels + texel] = mean[channel];
                }
            }
        }
        Ok(Planes { texels, channels, levels })
    }

    /// The level of a texel of the half at a time.
    fn mean(&self, counted: &Counted, time: usize, level: impl Fn((usize, usize)) -> [u8; 3]) -> [u8; 3] {
        let Sunlight { path, visibility, normals } = self.sunlight;
        let direction = path.at(visibility.hours[time]).map_or([0.0; 3], |(direction, _)| direction);
        // Levels, those weighted by the cosine where it is positive, and the cosine of the mean normal.
        let (mut plain, mut lit, mut cosine, mut number) = ([0.0; 3], [0.0; 3], 0.0, 0.0);
        for (x, y) in counted.places() {
            let normal = normals.normals[y * normals.width + x];
            let facing: f64 = (0..3).map(|axis| f64::from(normal[axis]) * f64::from(direction[axis])).sum();
            let levels = level((x, y)).map(f64::from);
            for channel in 0..3 {
                plain[channel] += levels[channel];
                lit[channel] += levels[channel] * facing.max(0.0);
            }
            (cosine, number) = (cosine + facing, number + 1.0);
        }
        let (sums, by) = if cosine > 0.0 { (lit, cosine) } else { (plain, number) };
        let top = f64::from(self.top);
        sums.map(|sum| (sum / by * top / f64::from(visibility.top)).round().min(top) as u8)
    }
}
