//! The sun's visibility as a function of time, V(texel, t), and the normals that go with it: times the
//! normal's product with the mean direction towards the sun, times the sun's irradiance, V is the direct
//! light of the sun at any time between the first and the last hour of a bake.
//!
//! At the hours of the bake it is what the layers of direct light hold; between them rays are traced where
//! light moves (`tile`). Each tile is kept beside the layers once it is done: a killed bake goes on after the
//! last one, and a later bake of the same sun traces none.

mod tile;

use crate::atlas::Atlas;
use crate::bake::layers::{Layers, Texel};
use crate::bake::prepare::{Part, Prepared};
use crate::bake::samples::{Stream, Worker};
use crate::bake::store::{json, sealed};
use crate::light::times::VisibilityTimes;
use crate::receivers::ReceiverBlock;
use crate::surface::BLOCK;
use crate::trace::counts::RayCounts;
use crate::trace::paths::path::sun_sample;
use crate::trace::paths::{Sample, Sequence, SequenceKind};
use crate::trace::sources::{SunAtTime, SunSample, VisibilitySampler};
use crate::{Error, Result, Rgb};
use dataset::format::normals::{png_of, samples_of};
use dataset::format::tiles::{Rect, TILE, tiles};
use dataset::format::visibility;
use dataset::host::signals::stop_if_interrupted;
use dataset::observe::Observer;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tile::{Tile, suns_at};

/// Changes whenever the same scene would give other curves.
const METHOD: &str = "visibility-3";

/// All texels have the same points at the same places of the disc: an edge that passes over them then shows
/// each the same steps, which takes few bytes. (It is an index that no texel has.)
const SAME_FOR_ALL_TEXELS: u32 = u32::MAX;

/// Tiles that are found at once, at most: each takes about 100 MB.
const TILES_AT_ONCE: usize = 8;

/// What a tile's file holds beside the payload: bytes of a normal.
const NORMAL_BYTES: usize = 6;

/// The visibility of one page.
pub struct Page {
    /// The bytes of its file.
    pub visibility: Vec<u8>,
    /// The bytes of the file of normals: per texel, the mean of the shading normals there; 0 where there is
    /// no surface.
    pub normals: Vec<u8>,
}

/// Where the sun is seen from, over the time that is baked.
pub struct VisibilityBaker<'a> {
    prepared: &'a Prepared,
    worker: &'a Worker<'a>,
    atlas: &'a Atlas,
    layers: &'a Layers,
    texels: &'a [Texel],
    times: &'a VisibilityTimes,
    suns: Vec<SunAtTime>,
    /// The random numbers of a texel's points, the same for all texels.
    samples: Vec<Sample>,
    /// Per page and tile of it, the positions of its usable texels among `texels`, ascending.
    by_tile: Vec<Vec<u32>>,
    /// The level that stands for 1.
    top: u8,
    /// The folder of finished tiles.
    folder: PathBuf,
    /// What decides them.
    digest: String,
}

impl<'a> VisibilityBaker<'a> {
    /// Prepares to find the visibility of the sun of `prepared` at `times`; `texels` are the covered ones
    /// of the page.
    ///
    /// # Errors
    /// [`Error::Io`].
    ///
    /// # Panics
    /// For more times than [`visibility::MOST_TIMES`].
    pub fn new(
        prepared: &'a Prepared,
        worker: &'a Worker<'a>,
        atlas: &'a Atlas,
        layers: &'a Layers,
        texels: &'a [Texel],
        times: &'a VisibilityTimes,
    ) -> Result<Self> {
        assert!(times.hours.len() <= visibility::MOST_TIMES, "{} times", times.hours.len());
        let decisive_times = (times.minutes, &times.hours, &times.levels);
        let decisive =
            (METHOD, prepared.base(), &prepared.scene.sun, &prepared.scene.location, decisive_times);
        let of_layers = &prepared.digests[..prepared.plan.suns.len()];
        let digest = blake3::hash(&json::bytes(&(decisive, of_layers), "visibility")?).to_hex().to_string();
        let folder = layers.visibility_folder(&digest);
        dataset::host::files::create_folders(&folder).map_err(Error::io(&folder))?;
        dataset::host::files::remove_stale_temporaries(&folder)?;
        let (kind, stream) = (SequenceKind::Texel, Stream::Visibility as u32);
        let sequence = Sequence::new(worker.seed, kind, SAME_FOR_ALL_TEXELS, stream);
        let samples: Vec<Sample> = (0..points(times)).map(|i| sequence.sample(i)).collect();
        let places: Vec<SunSample> = samples.iter().map(|sample| sun_sample(*sample)).collect();
        // (Tiles that a killed run left are used, and may have names that have not reached the disk.)
        dataset::host::files::sync_folder_of(&folder.join("tiles"));
        Ok(VisibilityBaker {
            prepared,
            worker,
            atlas,
            layers,
            texels,
            times,
            suns: suns_at(times, &places),
            samples,
            by_tile: by_tile(atlas, texels),
            top: top(times),
            folder,
            digest,
        })
    }

    /// The folder of finished tiles, which a later bake may use again.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Finds one page after the other, and what rays that took.
    ///
    /// # Errors
    /// [`Error::Io`], and [`Error::Interrupted`]: finished tiles are kept.
    pub fn pages(
        &self,
        console: &dyn Observer,
        mut each: impl FnMut(usize, Page) -> Result<()>,
    ) -> Result<RayCounts> {
        let atlas = self.atlas;
        let (width, height) = (atlas.width as usize, atlas.page_height as usize);
        let rects = tiles(width, height, TILE);
        let progress = console.progress("the sun's visibility", (rects.len() * atlas.pages as usize) as u64);
        let mut counts = RayCounts::default();
        for page in 0..atlas.pages as usize {
            let mut normals = vec![samples_of([0.0; 3]); width * height];
            let mut payloads = Vec::with_capacity(rects.len());
            let numbered: Vec<(usize, &Rect)> = rects.iter().enumerate().collect();
            // Several at once: what takes one thread in one of them leaves the others to the next.
            for several in numbered.chunks(rayon::current_num_threads().min(TILES_AT_ONCE)) {
                stop_if_interrupted()?;
                let found = several.par_iter().map(|(number, rect)| {
                    let (done, rays) = self.kept_or_found(page, *number, rect)?;
                    progress.advance(1);
                    Ok((done, rays))
                });
                let found: Vec<Result<(FinishedTile, RayCounts)>> = found.collect();
                for ((_, rect), found) in several.iter().zip(found) {
                    let (done, rays) = found?;
                    counts += rays;
                    for (i, normal) in done.normals.iter().enumerate() {
                        let (x, y) = (rect.x0 + i % rect.width(), rect.y0 + i / rect.width());
                        normals[y * width + x] =
                            samples_of(normal.map(|n| f32::from(n) / f32::from(i16::MAX)));
                    }
                    payloads.push((done.payload, done.channels));
                }
            }
            let bytes = visibility::to_bytes(
                [atlas.width, atlas.page_height],
                self.top,
                &self.times.hours,
                &payloads,
            );
            each(page, Page { visibility: bytes, normals: png_of(&normals, width, height) })?;
        }
        Ok(counts)
    }

    /// The tile of a page as it was kept; else finds and keeps it.
    fn kept_or_found(&self, page: usize, number: usize, rect: &Rect) -> Result<(FinishedTile, RayCounts)> {
        let atlas = self.atlas;
        let name = format!("{page}-{number}.tile");
        let (path, label) = (self.folder.join(&name), format!("{}/{name}", self.digest));
        let texels = rect.width() * rect.height();
        if let Some(done) =
            sealed::read(&path, &label).and_then(|bytes| FinishedTile::from_bytes(&bytes, texels))
        {
            return Ok((done, RayCounts::default()));
        }
        let tiles = self.by_tile.len() / atlas.pages as usize;
        let (done, rays) = self.tile(page * tiles + number, rect, page * atlas.stride as usize)?;
        stop_if_interrupted()?;
        sealed::write(&path, &label, &[&done.to_bytes()])?;
        Ok((done, rays))
    }

    /// Finds the tile of this number, whose page begins at row `top` of the virtual page.
    fn tile(&self, number: usize, rect: &Rect, top: usize) -> Result<(FinishedTile, RayCounts)> {
        let mut counts = RayCounts::default();
        let TileTexels { texels, by_texel } = self.texels_of_tile(number, rect, top);
        if texels.is_empty() {
            let normals = vec![[0; 3]; by_texel.len()];
            return Ok((FinishedTile { payload: Vec::new(), channels: 0, normals }, counts));
        }
        let surfaces = self.surfaces(rect, top);
        let visibility_sampler = |position: &Option<usize>| {
            let mut counts = RayCounts::default();
            let visibility_sampler = position
                .and_then(|position| self.visibility_sampler(&surfaces, &self.texels[position], &mut counts));
            (visibility_sampler, counts)
        };
        let visibility_samplers: Vec<(Option<VisibilitySampler>, RayCounts)> =
            by_texel.par_iter().with_min_len(64).map(visibility_sampler).collect();
        visibility_samplers.iter().for_each(|(_, rays)| counts += *rays);
        let visibility_samplers: Vec<Option<VisibilitySampler>> =
            visibility_samplers.into_iter().map(|(visibility_sampler, _)| visibility_sampler).collect();
        let to_number = |x: f32| (x * f32::from(i16::MAX)).round() as i16;
        let normal = |w: &Option<VisibilitySampler>| {
            w.as_ref().map_or(Vec3::ZERO, |w| w.normal).to_array().map(to_number)
        };
        let normals = visibility_samplers.iter().map(normal).collect();
        if visibility_samplers.iter().all(Option::is_none) {
            return Ok((FinishedTile { payload: Vec::new(), channels: 0, normals }, counts));
        }
        let traced = self.traced(&texels, &by_texel)?;
        let space = &self.worker.transport.space;
        let tile = Tile {
            width: rect.width(),
            visibility_samplers,
            traced,
            times: self.times,
            suns: &self.suns,
            space,
        };
        let (planes, rays) = tile.planes(self.top);
        let (payload, channels) = planes.to_payload();
        Ok((FinishedTile { payload, channels, normals }, counts + rays))
    }

    /// Where the texels of a tile stand among all. `number`: of the tile, of all pages one after the other.
    fn texels_of_tile(&self, number: usize, rect: &Rect, top: usize) -> TileTexels {
        let across = self.atlas.width as usize;
        let texels: Vec<usize> = self.by_tile[number].iter().map(|position| *position as usize).collect();
        let mut by_texel = vec![None; rect.width() * rect.height()];
        for &position in &texels {
            let index = self.texels[position].index as usize;
            let (x, y) = (index % across, index / across);
            by_texel[(y - top - rect.y0) * rect.width() + x - rect.x0] = Some(position);
        }
        TileTexels { texels, by_texel }
    }

    /// The blocks that a tile lies in, by their number.
    fn surfaces(&self, rect: &Rect, top: usize) -> BTreeMap<usize, ReceiverBlock<'_>> {
        let rows = (top + rect.y0) / BLOCK..(top + rect.y1).div_ceil(BLOCK);
        let columns = rect.x0 / BLOCK..rect.x1.div_ceil(BLOCK);
        let blocks = rows.flat_map(|row| {
            columns.clone().map(move |column| row * self.worker.receivers.columns() + column)
        });
        blocks.map(|block| (block, self.worker.block(block))).collect()
    }

    fn visibility_sampler(
        &self,
        surfaces: &BTreeMap<usize, ReceiverBlock<'_>>,
        texel: &Texel,
        counts: &mut RayCounts,
    ) -> Option<VisibilitySampler> {
        let across = self.atlas.width as usize;
        let (x, y) = (texel.index as usize % across, texel.index as usize / across);
        let receivers = surfaces.get(&self.worker.receivers.block_of(x, y))?;
        let in_block = (y - receivers.y0) * receivers.width + x - receivers.x0;
        let points = self.samples.iter().enumerate().filter_map(|(place, &sample)| {
            Some((self.worker.receiver(receivers, in_block, sample, texel.points, counts)?, place))
        });
        VisibilitySampler::new(points.collect())
    }

    /// Per time, the light that came straight from its sun where a layer holds it, ÷ the sun's
    /// irradiance: per texel of a tile. (Black where the sun gives none of a colour.)
    fn traced(&self, texels: &[usize], by_texel: &[Option<usize>]) -> Result<Vec<Option<Vec<Rgb>>>> {
        let plan = &self.prepared.plan;
        let of_time = |hour: &f64| {
            let time = plan.times.iter().position(|time| time.hour == *hour);
            let Some(layer) = time.and_then(|time| plan.sun_of[time]) else { return Ok(None) };
            let light = self.layers.read_at(&self.prepared.digests[layer], Part::Direct, texels)?;
            let irradiance = plan.suns[layer].irradiance;
            let brightest = irradiance.max_element();
            let share = |light: Rgb| {
                let grey = light.max_element() / brightest;
                Rgb::from_array(std::array::from_fn(|c| {
                    if irradiance[c] > 0.0 { light[c] / irradiance[c] } else { grey }
                }))
            };
            let at = |position: &Option<usize>| {
                let i = position.and_then(|position| texels.binary_search(&position).ok());
                i.map_or(Rgb::ZERO, |i| share(light[i].mean))
            };
            Ok(Some(by_texel.iter().map(at).collect()))
        };
        self.times.hours.iter().map(of_time).collect()
    }
}

/// Per page and tile of it, the positions of its usable texels among `texels`, ascending.
fn by_tile(atlas: &Atlas, texels: &[Texel]) -> Vec<Vec<u32>> {
    let (width, stride) = (atlas.width as usize, atlas.stride as usize);
    let [columns, rows] = [width, atlas.page_height as usize].map(|side| side.div_ceil(TILE));
    let mut by_tile = vec![Vec::new(); columns * rows * atlas.pages as usize];
    for (position, texel) in (0..).zip(texels).filter(|(_, texel)| texel.usable == 1) {
        let (x, y) = (texel.index as usize % width, texel.index as usize / width);
        // (Texels lie on pages, never on the rows between them.)
        let tile = (y / stride * rows + y % stride / TILE) * columns + x / TILE;
        by_tile[tile].push(position);
    }
    by_tile
}

/// Points of a texel that look at the sun where they do not all see the same.
fn points(times: &VisibilityTimes) -> u32 {
    if times.minutes < 15.0 { 64 } else { 32 }
}

/// The level that stands for 1: between quarters of an hour the line is off by more than eighths are.
fn top(times: &VisibilityTimes) -> u8 {
    if times.minutes < 15.0 { 15 } else { 8 }
}

/// The texels of a tile among all.
struct TileTexels {
    /// Ascending.
    texels: Vec<usize>,
    /// Row by row.
    by_texel: Vec<Option<usize>>,
}

/// A finished tile.
struct FinishedTile {
    payload: Vec<u8>,
    channels: u32,
    normals: Vec<[i16; 3]>,
}

impl FinishedTile {
    fn to_bytes(&self) -> Vec<u8> {
        let normals = self.normals.iter().flatten().flat_map(|n| n.to_le_bytes());
        self.channels.to_le_bytes().into_iter().chain(normals).chain(self.payload.iter().copied()).collect()
    }

    fn from_bytes(bytes: &[u8], texels: usize) -> Option<Self> {
        let (channels, rest) = bytes.split_first_chunk()?;
        let (normals, payload) = rest.split_at_checked(NORMAL_BYTES * texels)?;
        let component = |bytes: &[u8]| i16::from_le_bytes([bytes[0], bytes[1]]);
        let normal = |bytes: &[u8]| [0, 2, 4].map(|i| component(&bytes[i..i + 2]));
        let normals = normals.chunks_exact(NORMAL_BYTES).map(normal).collect();
        Some(FinishedTile { payload: payload.to_vec(), channels: u32::from_le_bytes(*channels), normals })
    }
}
