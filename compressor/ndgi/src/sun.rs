//! The sun: its direction and irradiance over the day, and the times at which a bundle stores which texels
//! see it.

mod bits;
mod normals;
mod tables;
mod planes;
mod shadows;

pub use planes::{Coder, Counts};
pub use shadows::{Block, ENTRIES, MOST, SIDE, STEPS, Shadows, UNIT, Word, encode as encode_shadows};
pub use tables::Tables;

use crate::model::Section;
use planes::Decoder;

/// The sun's path by the minute, or less often where it moves evenly. Between two times direction and
/// irradiance are interpolated linearly, component by component; outside their range there is no sun.
///
/// ```
/// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
/// if let Some(sun) = &bundle.header.sun {
///     match sun.path.at(9.25) {
///         Some((direction, irradiance)) => println!("towards {direction:?}, {irradiance:?} kilolux"),
///         None => println!("below the horizon"),
///     }
/// }
/// # Ok::<(), ndgi::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SunPath {
    /// Ascending, in hours from 0 to 24; at least one.
    pub hours: Vec<f64>,
    /// Per time, the mean direction towards the visible part of the disc, as a vector whose length is 1 for a
    /// small disc and less for a wide one, in the axes of the normals.
    pub direction: Vec<[f32; 3]>,
    /// Per time, the irradiance of a surface that faces the disc, red, green and blue, in the unit of the
    /// lightmaps.
    pub irradiance: Vec<[f32; 3]>,
}

impl SunPath {
    /// Mean direction and irradiance at an hour; `None` before the first time and after the last.
    pub fn at(&self, hour: f64) -> Option<([f32; 3], [f32; 3])> {
        let [first, last] = [self.hours.first()?, self.hours.last()?];
        let (before, after, part) = around(&self.hours, hour);
        let lerp =
            |of: &[[f32; 3]]| std::array::from_fn(|c| of[before][c] * (1.0 - part) + of[after][c] * part);
        (first..=last).contains(&&hour).then(|| (lerp(&self.direction), lerp(&self.irradiance)))
    }
}

/// The indices of the times before and after an hour and the fraction between them; outside their range, the
/// nearest time.
pub(crate) fn around(times: &[f64], hour: f64) -> (usize, usize, f32) {
    let next = times.partition_point(|time| *time <= hour);
    let (before, after) = (next.saturating_sub(1), next.min(times.len() - 1));
    let span = times[after] - times[before];
    let part = if span > 0.0 { (hour - times[before]) / span } else { 0.0 };
    (before, after, part as f32)
}

/// Largest number of times of visibility; it limits a tile to 50 MB, whatever a file says.
const MOST_TIMES: usize = 1024;

/// The sun in a bundle's header.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sun {
    /// Its direction and irradiance over the day.
    pub path: SunPath,
    /// The times of visibility, ascending, in hours from 0 to 24; at least one.
    pub times: Vec<f64>,
    /// How levels are coded.
    pub tables: Tables,
}

impl Sun {
    /// The indices of the visibility times around an hour, and a copy of the sun restricted to them.
    pub(crate) fn near(&self, hour: f64) -> (Vec<usize>, Sun) {
        let (before, after, _) = around(&self.times, hour);
        let near = if before == after { vec![before] } else { vec![before, after] };
        let times = near.iter().map(|&time| self.times[time]).collect();
        (near, Sun { path: self.path.clone(), times, tables: Tables::default() })
    }

    /// Checks the rules of the format.
    ///
    /// # Errors
    /// A message that says which rule is violated.
    pub fn check(&self) -> Result<(), String> {
        let SunPath { hours, direction, irradiance } = &self.path;
        for hours in [hours, &self.times] {
            let ascend =
                hours.is_sorted_by(|a, b| a < b) && hours.iter().all(|hour| (0.0..=24.0).contains(hour));
            if hours.is_empty() || !ascend {
                return Err("times of the sun that are not strictly ascending in [0, 24]".to_owned());
            }
        }
        if self.times.len() > MOST_TIMES {
            return Err(format!("{} times of visibility; expected at most {MOST_TIMES}", self.times.len()));
        }
        let is_direction = |d: &[f32; 3]| d.iter().map(|x| x * x).sum::<f32>().sqrt() <= 1.0 + 1e-5;
        if direction.len() != hours.len() || !direction.iter().all(is_direction) {
            return Err("directions of the sun longer than 1".to_owned());
        }
        let is_light = |e: &f32| e.is_finite() && *e >= 0.0;
        if irradiance.len() != hours.len() || !irradiance.as_flattened().iter().all(is_light) {
            return Err("an irradiance of the sun that is not a finite number ≥ 0".to_owned());
        }
        Ok(())
    }
}

/// One tile's visibility of the sun and its normals, unpacked.
#[derive(Clone, Debug, PartialEq)]
pub struct TileSun {
    /// Stored texels across, a multiple of 4.
    pub width: usize,
    /// Stored texels down, a multiple of 4.
    pub height: usize,
    /// Number of [`Sun::times`].
    pub times: usize,
    /// By channel (one, or red, green and blue behind coloured glass), time and texel. Level 0: the sun is
    /// hidden;
    /// [`TileSun::TOP`]: all of it is visible; [`TileSun::ANY`], only before encoding: any level will do.
    pub levels: Vec<u8>,
    /// Per texel, the mean shading normal; before encoding, 0 where it does not matter.
    pub normals: Vec<[f32; 3]>,
    /// Moving shadows between the times. By default there are none: visibility is linear.
    pub shadows: Shadows,
}

impl TileSun {
    /// The level of full visibility.
    pub const TOP: u8 = 7;
    /// A level that does not matter.
    pub const ANY: u8 = u8::MAX;

    /// Approximate bytes of memory.
    pub(crate) fn bytes(&self) -> usize {
        self.levels.len() + size_of_val(&self.normals[..])
    }

    /// Channels of its levels: one, or three.
    pub fn channels(&self) -> usize {
        self.levels.len() / (self.times * self.width * self.height).max(1)
    }

    /// The share of the sun that each texel sees at an hour, row by row: red, green, blue. `sun` is the one
    /// that the tile was decoded with. Between its times visibility is linear, plus moving shadows where
    /// there are any; outside their range it is held.
    pub fn visibility(&self, sun: &Sun, hour: f64) -> Vec<[f32; 3]> {
        let planes: Vec<Vec<f32>> = (0..self.channels()).map(|c| self.seen(sun, hour, c)).collect();
        (0..self.width * self.height).map(|i| [0, 1, 2].map(|c| planes[c.min(planes.len() - 1)][i])).collect()
    }

    fn level(&self, channel: usize, time: usize, i: usize) -> f32 {
        let level = self.levels[(channel * self.times + time) * self.width * self.height + i];
        f32::from(level.min(Self::TOP)) / f32::from(Self::TOP)
    }

    /// The share of the sun that each texel sees at an hour in one channel.
    fn seen(&self, sun: &Sun, hour: f64, channel: usize) -> Vec<f32> {
        let (before, after, part) = around(&sun.times, hour);
        // By both levels, what is seen.
        let top = f32::from(Self::TOP);
        let seen: [f32; 64] = std::array::from_fn(|i| {
            let [a, b] = [i / 8, i % 8].map(|level| level as f32 / top);
            a * (1.0 - part) + b * part
        });
        let texels = self.width * self.height;
        let plane = |time: usize| &self.levels[(channel * self.times + time) * texels..][..texels];
        let of = |(a, b): (&u8, &u8)| seen[usize::from((*a).min(Self::TOP) * 8 + (*b).min(Self::TOP))];
        let mut seen: Vec<f32> = plane(before).iter().zip(plane(after)).map(of).collect();
        if before != after {
            let ends = |i: usize| [before, after].map(|time| self.level(channel, time, i));
            self.shadows.apply((self.channels(), channel, before), part, self.width, ends, &mut seen);
        }
        seen
    }

    /// The sun's direct light on one texel at an hour.
    pub fn texel(&self, sun: &Sun, hour: f64, i: usize) -> [f32; 3] {
        let Some((direction, irradiance)) = sun.path.at(hour) else { return [0.0; 3] };
        let (before, after, part) = around(&sun.times, hour);
        let cosine = cosine(self.normals[i], direction);
        let channels = self.channels();
        let seen = |c: usize| {
            let ends = [before, after].map(|time| self.level(c, time, i));
            let place = [i % self.width, i / self.width];
            let moved = if before == after {
                None
            } else {
                self.shadows.texel((channels, c, before), part, place, ends)
            };
            moved.unwrap_or(ends[0] * (1.0 - part) + ends[1] * part)
        };
        let seen: [f32; 3] = match channels {
            1 => [seen(0); 3],
            _ => [0, 1, 2].map(seen),
        };
        [0, 1, 2].map(|c| seen[c] * cosine * irradiance[c])
    }

    /// Adds the sun's direct light at an hour, visibility · (normal · direction)⁺ · irradiance, to that of
    /// all texels, row by row.
    ///
    /// # Panics
    /// Unless `light` has as many texels as the tile.
    pub fn add_light(&self, sun: &Sun, hour: f64, out: &mut [[f32; 3]]) {
        assert_eq!(out.len(), self.width * self.height, "texels of the tile");
        if let Some((_, irradiance)) = sun.path.at(hour) {
            add_shares(&self.shares(sun, hour), irradiance, out);
        }
    }

    /// By channel, one or three, and texel: the share of the sun's irradiance at an hour, visibility ·
    /// (normal · direction)⁺.
    pub(crate) fn shares(&self, sun: &Sun, hour: f64) -> Vec<Vec<f32>> {
        let direction = sun.path.at(hour).map_or([0.0; 3], |(direction, _)| direction);
        let of_channel = |channel: usize| {
            let mut shares = self.seen(sun, hour, channel);
            shares
                .iter_mut()
                .zip(&self.normals)
                .for_each(|(share, normal)| *share *= cosine(*normal, direction));
            shares
        };
        (0..self.channels()).map(of_channel).collect()
    }
}

/// Adds light of the sun to that of texels, by the shares of its irradiance that [`TileSun::shares`] gives.
pub(crate) fn add_shares(shares: &[Vec<f32>], irradiance: [f32; 3], out: &mut [[f32; 3]]) {
    for (channel, of_channel) in shares.iter().enumerate() {
        let of = if shares.len() == 1 { 0..3 } else { channel..channel + 1 };
        for (light, share) in out.iter_mut().zip(of_channel) {
            of.clone().for_each(|c| light[c] = (light[c] + share * irradiance[c]).min(f32::MAX));
        }
    }
}

fn cosine(normal: [f32; 3], direction: [f32; 3]) -> f32 {
    (0..3).map(|axis| normal[axis] * direction[axis]).sum::<f32>().max(0.0)
}

/// A level that all texels have at one time, instead of a length in bytes.
const DARK: u16 = 0;
const LIT: u16 = 1;

impl TileSun {
    fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The levels by channel and time.
    fn planes(&self) -> impl Iterator<Item = &[u8]> {
        self.levels.chunks_exact(self.width * self.height)
    }

    /// The level that all texels of a plane may have: dark or lit.
    fn even(plane: &[u8]) -> Option<u16> {
        let all = |level: u8| plane.iter().all(|l| [level, Self::ANY].contains(l));
        if all(0) { Some(DARK) } else { all(Self::TOP).then_some(LIT) }
    }

    /// Counts symbols for building tables. With a `coder`, levels that do not matter get the values it would
    /// choose.
    pub fn count(&self, coder: Option<&Coder>, counts: &mut Counts) {
        let mixed = self.planes().filter(|plane| Self::even(plane).is_none());
        mixed.for_each(|plane| planes::count(plane, self.size(), coder, counts));
    }

    /// The tile's encoded section; empty if it sees nothing of the sun.
    ///
    /// # Panics
    /// Unless there is a level for each texel, time and channel.
    pub fn encode(&self, coder: &Coder) -> Section {
        let channels = self.channels();
        assert_eq!(self.levels.len(), channels * self.times * self.width * self.height, "levels of the tile");
        let even: Vec<Option<u16>> = self.planes().map(Self::even).collect();
        // (Where it may see something between its times, it has normals.)
        if even.iter().all(|even| *even == Some(DARK))
            && self.normals.as_flattened().iter().all(|n| *n == 0.0)
        {
            return Section::default();
        }
        let (count, normals) = normals::encode(&self.normals, self.width);
        let mut bytes = Vec::new();
        let is_lit = even.iter().all(|even| *even == Some(LIT));
        if !is_lit {
            let mut streams: Vec<u8> = Vec::new();
            for (plane, even) in self.planes().zip(even) {
                let length = even.unwrap_or_else(|| {
                    let stream = coder.plane(plane, self.size());
                    streams.extend(&stream);
                    stream.len() as u16
                });
                bytes.extend(length.to_le_bytes());
            }
            bytes.extend(streams);
        }
        let channels = if is_lit { 0 } else { channels as u32 };
        let has_normals = if normals.is_empty() { 0 } else { 4 };
        bytes.extend(normals);
        bytes.resize(bytes.len().next_multiple_of(16), 0);
        Section { word: channels | has_normals | (count as u32) << 8, bytes }
    }
}

/// A decoder of the tiles of a bundle's sun.
#[derive(Clone, Debug)]
pub struct SunDecoder {
    decoder: Decoder,
    times: usize,
}

impl SunDecoder {
    /// A decoder with the tables of a bundle's header.
    pub fn new(sun: &Sun) -> Self {
        SunDecoder { decoder: Decoder::new(&sun.tables), times: sun.times.len() }
    }

    /// Decodes a tile from its section, its word in the index, and its size in stored texels.
    ///
    /// # Errors
    /// A message that says which rule of the format is violated.
    pub fn tile(&self, bytes: &[u8], word: u32, size: [usize; 2]) -> Result<TileSun, String> {
        let all: Vec<usize> = (0..self.times).collect();
        self.tile_at(bytes, word, size, &all)
    }

    /// Bytes of memory at one time for a section that [`SunDecoder::tile`] reads, in a compact layout: levels
    /// of two times in 3 bits, and normals as stored, with four bytes a block of 4×4 in place of runs: its
    /// kind, and where its directions are. `ndgi-gpu` needs more.
    pub(crate) fn held(&self, bytes: &[u8], word: u32, [width, height]: [usize; 2]) -> usize {
        let channels = (word & 3) as usize;
        let list = 2 * channels * self.times;
        let lengths = bytes[..list].as_chunks::<2>().0.iter().map(|length| u16::from_le_bytes(*length));
        let streams: usize = lengths.filter(|length| ![DARK, LIT].contains(length)).map(usize::from).sum();
        let levels = channels * 2 * (width * height * 3).div_ceil(8);
        let blocks = if word & 4 != 0 { width * height / 16 * 4 } else { 0 };
        levels + bytes.len() - list - streams + blocks
    }

    /// Decodes a tile at only some of the times, ascending; these become the tile's times.
    ///
    /// # Errors
    /// As [`SunDecoder::tile`]; errors at other times are not found.
    pub fn tile_at(
        &self,
        bytes: &[u8],
        word: u32,
        size: [usize; 2],
        times: &[usize],
    ) -> Result<TileSun, String> {
        let (channels, has_normals, count) = (word & 3, word & 4 != 0, (word >> 8 & 255) as usize);
        if channels == 2 || word & 0xffff_00f8 != 0 || count > 0 && !has_normals {
            return Err(format!("word {word:#x} of a sun's section; expected a valid word"));
        }
        let [width, height] = size;
        let texels = width * height;
        let (mut levels, mut rest) = (Vec::new(), bytes);
        if channels == 0 {
            levels.resize(times.len() * texels, TileSun::TOP);
        } else {
            let planes = channels as usize * self.times;
            let (lengths, streams) =
                rest.split_at_checked(2 * planes).ok_or("lengths of planes are cut short")?;
            rest = streams;
            levels.reserve_exact(channels as usize * times.len() * texels);
            for (plane, length) in lengths.as_chunks::<2>().0.iter().enumerate() {
                let length = u16::from_le_bytes(*length);
                let is_even = [DARK, LIT].contains(&length);
                let stream = if is_even { 0 } else { usize::from(length) };
                let (stream, tail) = rest.split_at_checked(stream).ok_or("levels are cut short")?;
                rest = tail;
                match times.contains(&(plane % self.times)) {
                    false => {}
                    true if is_even => {
                        levels.resize(levels.len() + texels, if length == LIT { TileSun::TOP } else { 0 });
                    }
                    true => self.decoder.plane(stream, size, &mut levels)?,
                }
            }
        }
        let (normals, rest) = match has_normals {
            true => normals::decode(count, rest, size)?,
            false => (vec![[0.0; 3]; texels], rest),
        };
        if rest.len() >= 16 || rest.iter().any(|byte| *byte != 0) {
            return Err("only zeros up to the next multiple of 16 may follow the normals".to_owned());
        }
        Ok(TileSun { width, height, times: times.len(), levels, normals, shadows: Shadows::default() })
    }
}

#[cfg(test)]
mod tests;
