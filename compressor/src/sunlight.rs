//! The sun as a separate stream: which texels see it at the times of visibility, and how they face it. The
//! times are the hours of the sunlit frames and, where shadows are to move, sunrise, sunset and some in
//! between.
//!
//! Visibility at a frame is its direct light over an unshadowed sun's, normal · direction · irradiance. So
//! the frames are met up to the rounding of levels, normals (about a degree) and the sun's path (0.3 %).
//! Where the sun grazes a texel, and its light is next to none, the dataset's own visibility counts.

pub mod words;
mod moving;

pub use moving::Seen;

use crate::Result;
use crate::grid::{Grid, Place};
use crate::tile::{self, Band, Coverage, GUTTER};
use dataset::format::curve::kept;
use dataset::format::{Between, Layer, Planes, Visibility};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Mask;
use dataset::observe::Observer;
use dataset::store::Dataset;
use ndgi::bundle::Section;
use ndgi::sun::{Coder, Counts, Shadows, Sun, SunDecoder, SunPath, Tables, TileSun};
use rayon::prelude::*;
use std::ops::Range;
use words::Search;

/// The cosine below which there is too little light to derive visibility.
const GRAZING: f32 = 0.02;
/// Tolerance of the thinned path: absolute for directions, relative for irradiance.
const PATH: f32 = 3e-3;
/// The longest gap between times of visibility in hours, give or take [`CLOSE`], where shadows move.
const APART: f64 = 1.0;
/// Sunrise and sunset get a time of their own only if they are farther than this from a frame, in hours.
const CLOSE: f64 = 0.1;

/// The sun of a dataset that stores it separately.
#[derive(Debug)]
pub struct Sunlight<'a> {
    dataset: &'a Dataset,
    /// What the bundle's header says of it.
    pub sun: Sun,
    /// Per time of visibility, the frame of that hour.
    frames: Vec<Option<usize>>,
    moves: bool,
}

impl<'a> Sunlight<'a> {
    /// Of a dataset; `None` if the sun lights nothing directly at any frame. `moves`: whether shadows are to
    /// move between the times.
    pub fn new(dataset: &'a Dataset, moves: bool) -> Result<Option<Self>> {
        let config = &dataset.config;
        let Some(path) = dataset.sun_path()?.filter(|_| crate::law::is_sun_apart(config)) else {
            return Ok(None);
        };
        let is_lit = |&frame: &usize| {
            let mut direct = config.layers.iter().filter(|layer| layer.is_direct_sun());
            let is_there =
                direct.any(|layer| (0..config.pages.len()).any(|page| layer.file(frame, page).is_some()));
            is_there
                && path.at(config.frames[frame].hour).is_some_and(|(_, irradiance)| irradiance != [0.0; 3])
        };
        let frames: Vec<usize> = (0..config.frames.len()).filter(is_lit).collect();
        if frames.is_empty() {
            return Ok(None);
        }
        let mut times: Vec<(f64, Option<usize>)> =
            frames.into_iter().map(|frame| (config.frames[frame].hour, Some(frame))).collect();
        if moves {
            add_times(&mut times, &path);
        }
        let (times, frames) = times.into_iter().unzip();
        Ok(Some(Sunlight {
            dataset,
            sun: Sun { path: thinned(&path), times, tables: Tables::default() },
            frames,
            moves,
        }))
    }

    /// True if there are moving shadows.
    pub fn moves(&self) -> bool {
        self.moves && self.sun.times.len() > 1
    }

    /// What the header says of the sun, with the tables that code its tiles in few bits: found by coding them
    /// twice.
    pub fn coded(&self, masks: &[Mask], console: &dyn Observer) -> Result<Sun> {
        let mut sun = self.sun.clone();
        for round in 0..2 {
            let coder = (round > 0).then(|| Coder::new(&sun.tables));
            let counts = self.each_tile("the sun", masks, console, |band, column, _| {
                let mut counts = Counts::default();
                band.tile(column).count(coder.as_ref(), &mut counts);
                Ok(counts)
            })?;
            let mut all = Counts::default();
            counts.iter().flatten().for_each(|counts| all.add(counts));
            sun.tables = all.tables();
        }
        sun.check().map_err(|what| dataset::Error::invalid("the bundle's sun", what))?;
        Ok(sun)
    }

    /// The tiles of all pages in the order of a bundle's index, coded: what they see of the sun, and, where
    /// that is requested, how shadows move.
    pub fn sections(&self, sun: &Sun, masks: &[Mask], console: &dyn Observer) -> Result<Vec<[Section; 2]>> {
        let (coder, decoder) = (Coder::new(&sun.tables), SunDecoder::new(sun));
        let search = self.moves().then(Search::of_table);
        let what = if search.is_some() { "moving shadows" } else { "the sun" };
        let sections = self.each_tile(what, masks, console, |band, column, seen| {
            let (section, reported) = band.reported(column, &coder, &decoder)?;
            let moving = match search.as_ref().zip(reported) {
                Some((search, reported)) => self.moving(search, band, column, &reported, seen)?,
                None => Section::default(),
            };
            Ok([section, moving])
        })?;
        Ok(sections.into_iter().map(Option::unwrap_or_default).collect())
    }

    /// Something of every tile in the order of a bundle's index, in parallel; nothing of one without a valid
    /// texel.
    pub fn each_tile<T: Send>(
        &self,
        what: &str,
        masks: &[Mask],
        console: &dyn Observer,
        work: impl Fn(&SunBand, usize, &mut Seen) -> Result<T> + Sync,
    ) -> Result<Vec<Option<T>>> {
        let grid = |page: usize| Grid { width: masks[page].width, height: masks[page].height };
        let rows = |page: usize| (0..grid(page).rows()).map(move |row| (page, row));
        let bands: Vec<(usize, usize)> = (0..masks.len()).flat_map(rows).collect();
        let tiles: usize = bands.iter().map(|(page, _)| grid(*page).columns()).sum();
        let progress = console.progress(what, tiles as u64);
        let done: Vec<Result<Vec<Option<T>>>> = bands
            .par_iter()
            .with_max_len(1)
            .map(|&(page, row)| {
                stop_if_interrupted()?;
                let columns = grid(page).columns();
                let is_lit =
                    |column: usize| tile::valid_texels(&masks[page], Place { page, column, row }) > 0;
                let sunlight = match (0..columns).any(is_lit) {
                    true => self.dataset.sunlight(page)?,
                    false => None,
                };
                let Some(sunlight) = sunlight else {
                    progress.advance(columns as u64);
                    return Ok((0..columns).map(|_| None).collect());
                };
                let band = self.band(&masks[page], page, row, &sunlight)?;
                let mut seen = Seen::new(&sunlight.visibility);
                let mut of = |column: usize| {
                    stop_if_interrupted()?;
                    progress.advance(1);
                    is_lit(column).then(|| work(&band, column, &mut seen)).transpose()
                };
                (0..columns).map(&mut of).collect()
            })
            .collect();
        let mut all = Vec::new();
        for done in done {
            all.extend(done?);
        }
        Ok(all)
    }

    /// What a band's rows see of the sun.
    fn band(
        &self,
        mask: &Mask,
        page: usize,
        row: usize,
        sunlight: &dataset::store::Sunlight,
    ) -> Result<SunBand> {
        let grid = Grid { width: mask.width, height: mask.height };
        let rows = Band::rows(grid, row);
        let texels = grid.width * rows.len();
        let offset = rows.start * grid.width;
        let coverage = tile::coverage(mask, rows.clone());
        let normals = &sunlight.normals.normals[offset..offset + texels];
        // First what the visibility says, in 255ths; then, in its place, the level.
        let (mut levels, ever) = seen(&sunlight.visibility, &rows, &self.sun.times)?;
        for (time, &frame) in self.frames.iter().enumerate() {
            let hour = self.sun.times[time];
            let levels = &mut levels[time * texels..][..texels];
            // As a reader will have it.
            let Some((direction, irradiance)) = self.sun.path.at(hour) else {
                levels.fill([ANY; 3]);
                continue;
            };
            let direct = frame.map(|frame| self.direct(frame, page, &rows)).transpose()?;
            for i in 0..texels {
                let cosine: f32 = (0..3).map(|axis| normals[i][axis] * direction[axis]).sum();
                if coverage[i] != Coverage::Valid || cosine <= 0.0 {
                    levels[i] = [ANY; 3];
                    continue;
                }
                let seen = levels[i].map(|seen| f32::from(seen) / 255.0);
                let is_grey = seen[0] == seen[1] && seen[1] == seen[2];
                let share = |channels: Range<usize>| {
                    let light =
                        direct.as_ref().map(|direct| channels.clone().map(|c| direct[i][c]).sum::<f32>());
                    let whole = cosine * channels.clone().map(|c| irradiance[c]).sum::<f32>();
                    light.map_or(seen[channels.start], |light| light / whole)
                };
                let of_channel = |c: usize| match () {
                    () if cosine <= GRAZING || irradiance[c] <= 0.0 => seen[c],
                    () if is_grey => share(0..3),
                    () => share(c..c + 1),
                };
                let level =
                    |c: usize| (f32::from(TileSun::TOP) * of_channel(c).clamp(0.0, 1.0)).round() as u8;
                levels[i] = [level(0), level(1), level(2)];
            }
        }
        let mut band = SunBand {
            grid,
            page,
            row,
            rows,
            times: self.frames.len(),
            normals: normals.to_vec(),
            levels,
            nearest: vec![None; texels],
            // Where shadows move, what the sun lights between two times alone is not dark.
            ever: if self.moves() { ever } else { vec![false; texels] },
            coverage,
            path: sunlight.path.clone(),
        };
        band.fill();
        Ok(band)
    }

    /// The sun's direct light of a frame.
    fn direct(&self, frame: usize, page: usize, rows: &Range<usize>) -> Result<Vec<[f32; 3]>> {
        let layers = self.dataset.config.layers.iter().filter(|layer| layer.is_direct_sun());
        let files: Vec<_> = layers.filter_map(|layer: &Layer| layer.file(frame, page)).collect();
        self.dataset.sum_rows(&files, page, rows.start, rows.end)
    }
}

/// A level that may be any, because it is never read.
const ANY: u8 = TileSun::ANY;

/// A row of tiles with what it sees of the sun.
#[derive(Debug)]
pub struct SunBand {
    grid: Grid,
    page: usize,
    row: usize,
    rows: Range<usize>,
    times: usize,
    normals: Vec<[f32; 3]>,
    /// By time and texel.
    levels: Vec<[u8; 3]>,
    /// Whether a texel may see the sun between times, if at none of them.
    ever: Vec<bool>,
    /// Of a gutter texel, the valid one that it repeats.
    nearest: Vec<Option<usize>>,
    coverage: Vec<Coverage>,
    /// The dataset's own.
    path: dataset::format::SunPath,
}

impl SunBand {
    /// Gutter texels see what the nearest valid one does.
    fn fill(&mut self) {
        let coverage = &self.coverage;
        let (width, height) = (self.grid.width as isize, self.rows.len() as isize);
        let reach = GUTTER as isize;
        let mut near: Vec<(isize, isize)> =
            (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))).collect();
        near.sort_by_key(|(dx, dy)| dx * dx + dy * dy);
        let texels = coverage.len();
        for i in (0..texels).filter(|&i| coverage[i] == Coverage::Gutter) {
            let (x, y) = (i as isize % width, i as isize / width);
            let inside = near.iter().map(|(dx, dy)| (x + dx, y + dy));
            let mut inside = inside.filter(|(x, y)| (0..width).contains(x) && (0..height).contains(y));
            let valid = inside.find(|(x, y)| coverage[(y * width + x) as usize] == Coverage::Valid);
            if let Some((x, y)) = valid {
                let from = (y * width + x) as usize;
                self.nearest[i] = Some(from);
                self.normals[i] = self.normals[from];
                self.ever[i] = self.ever[from];
                (0..self.times)
                    .for_each(|time| self.levels[time * texels + i] = self.levels[time * texels + from]);
            }
        }
        // A texel that never sees the sun needs no normal, if its levels are stored as 0: levels that do not
        // matter would become whatever is cheapest.
        for (i, coverage) in coverage.iter().enumerate() {
            let is_seen = |level: &u8| (1..=TileSun::TOP).contains(level);
            let never = (0..self.times).all(|time| !self.levels[time * texels + i].iter().any(is_seen));
            if never && (!self.ever[i] || *coverage == Coverage::Outside) {
                self.normals[i] = [0.0; 3];
            }
            if never && *coverage != Coverage::Outside {
                (0..self.times).for_each(|time| self.levels[time * texels + i] = [0; 3]);
            }
        }
    }

    /// The encoded section of one tile, and the tile decoded from it: levels that did not matter at the times
    /// have some value there, which may matter between them.
    pub fn reported(
        &self,
        column: usize,
        coder: &Coder,
        decoder: &SunDecoder,
    ) -> Result<(Section, Option<TileSun>)> {
        let tile = self.tile(column);
        let section = tile.encode(coder);
        if section.bytes.is_empty() {
            return Ok((section, None));
        }
        let reported = decoder
            .tile(&section.bytes, section.word, [tile.width, tile.height])
            .map_err(|what| dataset::Error::invalid("a tile of the sun", what))?;
        Ok((section, Some(reported)))
    }

    /// One tile; texels past its border are ignored.
    pub fn tile(&self, column: usize) -> TileSun {
        let (width, height) = self.grid.stored(column, self.row);
        let read = self.stored(column, [width, height]);
        let mut by_channel = [0, 1, 2].map(|_| Vec::with_capacity(self.times * read.len()));
        for of_time in self.levels.chunks_exact(self.grid.width * self.rows.len()) {
            for i in &read {
                let level = i.map_or([ANY; 3], |i| of_time[i]);
                (0..3).for_each(|c| by_channel[c].push(level[c]));
            }
        }
        let [red, green, blue] = by_channel;
        let levels = if red == green && green == blue { red } else { [red, green, blue].concat() };
        let normals = read.iter().map(|i| i.map_or([0.0; 3], |i| self.normals[i])).collect();
        TileSun { width, height, times: self.times, levels, normals, shadows: Shadows::default() }
    }
}

/// Adds times to those of the frames: where the sun rises and sets, and between any two that are more than
/// [`APART`] hours from each other.
fn add_times(times: &mut Vec<(f64, Option<usize>)>, path: &dataset::format::SunPath) {
    let is_up = |i: &usize| path.irradiance[*i] != [0.0; 3];
    let ends = [(0..path.hours.len()).find(is_up), (0..path.hours.len()).rfind(is_up)];
    for (end, hour) in ends.into_iter().flatten().map(|i| path.hours[i]).enumerate() {
        let nearest = if end == 0 { times[0].0 - hour } else { hour - times[times.len() - 1].0 };
        if nearest > CLOSE {
            times.insert(if end == 0 { 0 } else { times.len() }, (hour, None));
        }
    }
    let reported = std::mem::take(times);
    for pair in reported.windows(2) {
        let [from, to] = [pair[0].0, pair[1].0];
        // Where the sun is down in between, as by the poles or where hours were omitted, there is nothing to
        // store.
        let parts = ((to - from - CLOSE) / APART).ceil().max(1.0);
        times.push(pair[0]);
        let between = (1..parts as usize).map(|k| from + (to - from) * k as f64 / parts);
        let is_lit = |hour: &f64| path.at(*hour).is_some_and(|(_, irradiance)| irradiance != [0.0; 3]);
        times.extend(between.filter(is_lit).map(|hour| (hour, None)));
    }
    times.extend(reported.last());
}

/// What a dataset's visibility says of rows of a page at some times, by time and texel, in 255ths; and
/// whether a texel sees the sun at any time.
fn seen(visibility: &Visibility, rows: &Range<usize>, times: &[f64]) -> Result<(Vec<[u8; 3]>, Vec<bool>)> {
    let width = visibility.size[0] as usize;
    let mut seen = vec![[0; 3]; width * rows.len() * times.len()];
    let mut ever = vec![false; width * rows.len()];
    let top = f32::from(visibility.top);
    for (tile, rect) in visibility.tiles.iter().enumerate() {
        if rect.y0 >= rows.end || rect.y1 <= rows.start {
            continue;
        }
        let planes: Planes = visibility.tile(tile)?;
        for plane in planes.levels.chunks_exact(planes.texels) {
            for (texel, _) in plane.iter().enumerate().filter(|(_, level)| **level > 0) {
                let (x, y) = (rect.x0 + texel % rect.width(), rect.y0 + texel / rect.width());
                if rows.contains(&y) {
                    ever[(y - rows.start) * width + x] = true;
                }
            }
        }
        for (time, &hour) in times.iter().enumerate() {
            let between = Between::new(&visibility.hours, hour);
            for y in rect.y0.max(rows.start)..rect.y1.min(rows.end) {
                for x in rect.x0..rect.x1 {
                    let texel = (y - rect.y0) * rect.width() + x - rect.x0;
                    let [before, after] =
                        [between.before, between.after].map(|time| planes.level(texel, time));
                    let value = |c: usize| {
                        let share = between.lerp(f32::from(before[c]) / top, f32::from(after[c]) / top);
                        (share * 255.0).round() as u8
                    };
                    seen[(time * rows.len() + y - rows.start) * width + x] = [value(0), value(1), value(2)];
                }
            }
        }
    }
    Ok((seen, ever))
}

/// As few of the path's times as hold it.
fn thinned(path: &dataset::format::SunPath) -> SunPath {
    let values = |i: usize| {
        let (direction, light) = (path.direction[i], path.irradiance[i]);
        [direction[0], direction[1], direction[2], light[0], light[1], light[2]]
    };
    let is_on_line = |from: usize, i: usize, to: usize| {
        let part = ((path.hours[i] - path.hours[from]) / (path.hours[to] - path.hours[from])) as f32;
        let (a, value, b) = (values(from), values(i), values(to));
        (0..6).all(|k| {
            let unit = if k < 3 { 1.0 } else { value[k] };
            (a[k] + (b[k] - a[k]) * part - value[k]).abs() <= PATH * unit
        })
    };
    let kept = kept(path.hours.len() - 1, is_on_line);
    let pick = |of: &[[f32; 3]]| kept.iter().map(|&i| of[i]).collect();
    SunPath {
        hours: kept.iter().map(|&i| path.hours[i]).collect(),
        direction: pick(&path.direction),
        irradiance: pick(&path.irradiance),
    }
}
