//! How shadows move between the times of visibility, by the dataset's own visibility there.

use super::words::{Brick, SAMPLES, Search, TEXELS};
use super::{SunBand, Sunlight};
use crate::Result;
use crate::model::BORDER;
use crate::tile::{self, Coverage};
use dataset::format::{Between, Planes, Rect, Visibility};
use ndgi::bundle::Section;
use ndgi::sun::{SIDE, STEPS, TileSun, encode_shadows};

/// The price of a bit in squared error. The error is that of visibility · cosine relative to the interval's
/// brightest texel, mean over the tile, times hours. How bright the sun is does not count, only its colour:
/// shadows at dawn are as dear as at noon.
const PRICE: f32 = 8e-7;
/// A tile is taken to be at least so bright, in the unit of unshadowed light that falls straight.
const DIMMEST: f32 = 0.05;
/// And to have at least this number of texels, so that a sliver of a page does not count as a whole tile.
const FEWEST: f32 = 4096.0;
/// The weight of a gutter texel's error, relative to the valid texel that it repeats.
const GUTTER_WEIGHT: f32 = 0.25;
/// Steps of an interval whose light stands for all.
const EXAMINED: [usize; 3] = [2, 6, 10];

/// The dataset's visibility over the tiles that were read last.
#[derive(Debug)]
pub struct Seen<'a> {
    visibility: &'a Visibility,
    kept: Vec<(usize, Planes)>,
}

impl<'a> Seen<'a> {
    /// Nothing is read yet.
    pub fn new(visibility: &'a Visibility) -> Self {
        Seen { visibility, kept: Vec::new() }
    }

    /// Reads the tiles that have some of these texels of the page, and forgets those that have none.
    fn read(&mut self, texels: &[[usize; 2]]) -> Result<()> {
        let ends = |axis: usize| {
            let along = texels.iter().map(|texel| texel[axis]);
            (along.clone().min().unwrap_or(0), along.max().unwrap_or(0))
        };
        let [(left, right), (top, bottom)] = [ends(0), ends(1)];
        let is_near = |rect: &Rect| rect.x0 <= right && rect.x1 > left && rect.y0 <= bottom && rect.y1 > top;
        let has = |rect: &Rect| is_near(rect) && texels.iter().any(|[x, y]| is_in(rect, *x, *y));
        let wanted: Vec<usize> =
            (0..self.visibility.tiles.len()).filter(|tile| has(&self.visibility.tiles[*tile])).collect();
        self.kept.retain(|(tile, _)| wanted.contains(tile));
        for tile in wanted {
            if !self.kept.iter().any(|(kept, _)| *kept == tile) {
                self.kept.push((tile, self.visibility.tile(tile)?));
            }
        }
        Ok(())
    }

    /// What a texel that was read sees in a channel at some hours.
    fn at(&self, [x, y]: [usize; 2], channel: usize, hours: &[Between]) -> Option<Vec<f32>> {
        let (rect, planes) = self.kept.iter().find_map(|(tile, planes)| {
            let rect = &self.visibility.tiles[*tile];
            is_in(rect, x, y).then_some((rect, planes))
        })?;
        let texel = (y - rect.y0) * rect.width() + x - rect.x0;
        let times = self.visibility.hours.len();
        let plane = channel.min(planes.channels - 1) * times;
        let level = |time: usize| {
            f32::from(planes.levels[(plane + time) * planes.texels + texel]) / f32::from(self.visibility.top)
        };
        Some(hours.iter().map(|between| between.lerp(level(between.before), level(between.after))).collect())
    }
}

fn is_in(rect: &Rect, x: usize, y: usize) -> bool {
    (rect.x0..rect.x1).contains(&x) && (rect.y0..rect.y1).contains(&y)
}

/// The quarters of blocks of 8×8, by channel.
type Blocks = Vec<Vec<[Option<Brick>; 4]>>;

impl Sunlight<'_> {
    /// The section of a tile. `told` is what a reader decodes of its section of the sun.
    pub fn moving(
        &self,
        search: &Search,
        band: &SunBand,
        column: usize,
        reported: &TileSun,
        seen: &mut Seen,
    ) -> Result<Section> {
        let size = [reported.width, reported.height];
        let intervals = self.sun.times.len() - 1;
        let place = self.place(band, column, size, seen)?;
        let mut planes = vec![Vec::new(); reported.channels() * intervals];
        for interval in 0..intervals {
            let blocks = self.interval(band, reported, &place, seen, interval);
            for (channel, blocks) in blocks.into_iter().enumerate() {
                planes[channel * intervals + interval] =
                    search.blocks(blocks, reported.width.div_ceil(2 * SIDE), PRICE);
            }
        }
        Ok(encode_shadows(&planes, size))
    }

    /// The bricks of a tile over all intervals, for the search of a table.
    pub fn bricks(
        &self,
        band: &SunBand,
        column: usize,
        reported: &TileSun,
        seen: &mut Seen,
    ) -> Result<Vec<[Option<Brick>; 4]>> {
        let place = self.place(band, column, [reported.width, reported.height], seen)?;
        let intervals = 0..self.sun.times.len() - 1;
        Ok(intervals.flat_map(|i| self.interval(band, reported, &place, seen, i).concat()).collect())
    }

    /// Per stored texel of a tile, the texel of the page whose visibility it has, by its place in the band,
    /// and what it counts.
    fn place(
        &self,
        band: &SunBand,
        column: usize,
        size: [usize; 2],
        seen: &mut Seen,
    ) -> Result<Vec<Option<(usize, f32)>>> {
        let from = band.stored(column, size);
        let of = |i: Option<usize>| {
            let i = i?;
            match band.coverage[i] {
                Coverage::Outside => None,
                Coverage::Gutter => band.nearest[i].map(|near| (near, GUTTER_WEIGHT)),
                Coverage::Valid => Some((i, 1.0)),
            }
        };
        let place: Vec<Option<(usize, f32)>> = from.into_iter().map(of).collect();
        let texels: Vec<[usize; 2]> = place.iter().flatten().map(|(i, _)| band.texel(*i)).collect();
        seen.read(&texels)?;
        Ok(place)
    }

    /// Decoded and true visibility over one interval, with the weights of errors.
    fn interval(
        &self,
        band: &SunBand,
        reported: &TileSun,
        place: &[Option<(usize, f32)>],
        seen: &Seen,
        interval: usize,
    ) -> Blocks {
        let [from, to] = [self.sun.times[interval], self.sun.times[interval + 1]];
        let hours: [f64; STEPS - 1] =
            std::array::from_fn(|k| from + (to - from) * (k + 1) as f64 / STEPS as f64);
        let between = hours.map(|hour| Between::new(&seen.visibility.hours, hour));
        let (width, height, channels) = (reported.width, reported.height, reported.channels());
        // How texels face the sun, at the steps that are looked at.
        let suns = EXAMINED.map(|step| band.path.at(hours[step - 1]).unwrap_or_default());
        let faces = |i: usize| {
            suns.map(|(direction, _)| {
                let normal = band.normals[i];
                (0..3).map(|axis| normal[axis] * direction[axis]).sum::<f32>().max(0.0)
            })
        };
        let wanted = |c: usize| {
            let of = |place: &Option<(usize, f32)>| seen.at(band.texel(place.as_ref()?.0), c, &between);
            place.iter().map(of).collect::<Vec<Option<Vec<f32>>>>()
        };
        let wanted: Vec<_> = (0..channels).map(wanted).collect();
        // The brightest texel, and how many there are.
        let (mut peak, mut count) = (DIMMEST, 0.0f32);
        for (i, place) in place.iter().enumerate() {
            let Some((from, 1.0)) = place else { continue };
            count += 1.0;
            let most =
                wanted.iter().filter_map(|of| of[i].as_ref()).flatten().fold(0.0, |a: f32, b| a.max(*b));
            peak = faces(*from).into_iter().fold(peak, |peak, cosine| peak.max(cosine * most));
        }
        let span = (to - from) as f32;
        let weight = |i: usize| {
            let Some((from, share)) = place[i] else { return 0.0 };
            let cosines = faces(from);
            let light: f32 = suns
                .iter()
                .zip(cosines)
                .map(|((_, irradiance), cosine)| {
                    let most = irradiance.iter().fold(0.0, |a: f32, b| a.max(*b));
                    let squares = irradiance.iter().map(|e| (e / most).powi(2)).sum::<f32>() / 3.0;
                    if most > 0.0 { cosine * cosine * squares } else { 0.0 }
                })
                .sum();
            share * span * light / (EXAMINED.len() as f32 * peak * peak * count.max(FEWEST) * channels as f32)
        };
        let weights: Vec<f32> = (0..width * height).map(weight).collect();
        let brick = |channel: usize, x0: usize, y0: usize| {
            if x0 >= width || y0 >= height {
                return None;
            }
            let mut brick =
                Brick { reported: [0.0; SAMPLES], wanted: [0.0; SAMPLES], weights: [0.0; TEXELS] };
            let texels = width * height;
            for i in 0..TEXELS {
                let texel = (y0 + i / SIDE) * width + x0 + i % SIDE;
                let level = |time: usize| {
                    let level = reported.levels[(channel * reported.times + time) * texels + texel];
                    f32::from(level.min(TileSun::TOP)) / f32::from(TileSun::TOP)
                };
                let [a, b] = [level(interval), level(interval + 1)];
                let wanted = wanted[channel][texel].as_ref();
                brick.weights[i] = wanted.map_or(0.0, |_| weights[texel]);
                for k in 0..STEPS - 1 {
                    let reported = a + (b - a) * (k + 1) as f32 / STEPS as f32;
                    brick.reported[k * TEXELS + i] = reported;
                    brick.wanted[k * TEXELS + i] = wanted.map_or(reported, |wanted| wanted[k]);
                }
            }
            Some(brick)
        };
        let block = |channel: usize, block: usize| {
            let across = width.div_ceil(2 * SIDE);
            let [x, y] = [block % across * 2 * SIDE, block / across * 2 * SIDE];
            [0, 1, 2, 3].map(|quarter| brick(channel, x + quarter % 2 * SIDE, y + quarter / 2 * SIDE))
        };
        let count = width.div_ceil(2 * SIDE) * height.div_ceil(2 * SIDE);
        (0..channels).map(|c| (0..count).map(|i| block(c, i)).collect()).collect()
    }
}

impl SunBand {
    /// Per stored texel of a tile, the texel of the band; none past the border.
    pub(super) fn stored(&self, column: usize, [width, height]: [usize; 2]) -> Vec<Option<usize>> {
        let (own_width, own_height) = self.grid.payload(column, self.row);
        let (left, top) = crate::grid::Place { page: self.page, column, row: self.row }.origin();
        let from = tile::stored(self.grid, &self.rows, [left, top], [width, height]);
        let is_read = |i: usize| i % width < own_width + 2 * BORDER && i / width < own_height + 2 * BORDER;
        (0..from.len()).map(|i| is_read(i).then_some(from[i])).collect()
    }

    /// Column and row of the page of a texel of the band.
    fn texel(&self, i: usize) -> [usize; 2] {
        [i % self.grid.width, self.rows.start + i / self.grid.width]
    }
}
