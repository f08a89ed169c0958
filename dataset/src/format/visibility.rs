//! The sun's visibility as a function of time: the file of one page.
//!
//! A value from 0 to 1 per texel and time, in tiles of 128 × 128 texels, each of which can be read alone.
//! Between two times the values are interpolated linearly; before the first time and after the last they
//! hold.
//!
//! | bytes | what (integers little-endian) |
//! |---|---|
//! | 8 | `TLMVIS01`: name and version |
//! | 4, 4 | width and height of the page in texels |
//! | 4 | L, the level of full visibility: from 1 to 255 |
//! | 4 | number of times, N: from 1 to 4096 |
//! | 8 N | the times in hours (f64), ascending, from 0 to 24 |
//! | 8 per tile, row by row | two u32: length of the tile's payload and its channels C: 1, or 3 (red, green, blue) where coloured glass stands before the sun; both 0 for a tile that is 0 at all times |
//! | | the payloads, one after the other, each an .xz stream whose dictionary is at most 1.5 times what it unpacks to, or 64 KiB |
//!
//! A payload unpacked is C × N images of the tile's size, channel by channel, time by time, row by row: one
//! byte a texel, the level (0 to L); the value is level ÷ L.

use super::tiles::{Rect, TILE, tiles};
use crate::{Error, Result};
use lzma_rust2::{LzmaOptions, XzOptions, XzReader, XzWriter};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"TLMVIS01";
/// Bytes before the times.
const HEAD: usize = 8 + 4 * 4;
/// The most times: a tile is then 201 MB at most, whatever a file says.
pub const MOST_TIMES: usize = 4096;
/// The greatest side of a page in texels.
const MOST_TEXELS: u32 = 65536;

/// The visibility over one tile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Planes {
    /// Texels.
    pub texels: usize,
    /// 1, or 3: red, green, blue.
    pub channels: usize,
    /// The levels, by channel, time and texel.
    pub levels: Vec<u8>,
}

impl Planes {
    /// The levels at a texel and the time with this index: red, green, blue.
    pub fn level(&self, texel: usize, time: usize) -> [u8; 3] {
        let times = self.levels.len() / (self.channels * self.texels).max(1);
        let plane = |channel: usize| channel.min(self.channels - 1) * times + time;
        [0, 1, 2].map(|channel| self.levels[plane(channel) * self.texels + texel])
    }

    /// The payload of a file and its channels: of one, where all three are equal; empty where all is 0.
    pub fn to_payload(&self) -> (Vec<u8>, u32) {
        if self.levels.iter().all(|level| *level == 0) {
            return (Vec::new(), 0);
        }
        let plane = self.levels.len() / self.channels;
        let is_grey = self.levels.chunks_exact(plane).all(|channel| channel == &self.levels[..plane]);
        let channels = if is_grey { 1 } else { self.channels };
        (pack(&self.levels[..channels * plane]), channels as u32)
    }
}

/// Compresses bytes to an .xz stream. A byte is like those of the same place at other times, and little like
/// the one before it: so neither that one nor the position is part of its context.
fn pack(bytes: &[u8]) -> Vec<u8> {
    const PRESET: u32 = 6;
    /// Matches examined for each byte.
    const DEPTH: i32 = 200;
    let mut lzma = LzmaOptions::with_preset(PRESET);
    (lzma.lc, lzma.lp, lzma.pb, lzma.nice_len) = (0, 0, 0, 273);
    lzma.depth_limit = DEPTH;
    lzma.dict_size = (bytes.len() as u32).clamp(1 << 12, 1 << 26);
    let options = XzOptions { lzma_options: lzma, ..XzOptions::with_preset(PRESET) };
    let mut packed = XzWriter::new(Vec::new(), options).expect("valid options");
    packed.write_all(bytes).expect("memory takes all bytes");
    packed.finish().expect("memory takes all bytes")
}

/// The bytes of a file. `hours`: the times; `payloads`: of its tiles row by row, as [`Planes::to_payload`]
/// gave them.
///
/// # Panics
/// If there are more than [`MOST_TIMES`] times or none, or not as many payloads as tiles.
pub fn to_bytes(size: [u32; 2], top: u8, hours: &[f64], payloads: &[(Vec<u8>, u32)]) -> Vec<u8> {
    assert!((1..=MOST_TIMES).contains(&hours.len()), "{} times", hours.len());
    assert_eq!(payloads.len(), tiles(size[0] as usize, size[1] as usize, TILE).len(), "tiles");
    let mut bytes = MAGIC.to_vec();
    [size[0], size[1], u32::from(top), hours.len() as u32].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    hours.iter().for_each(|hour| bytes.extend(hour.to_le_bytes()));
    for (packed, channels) in payloads {
        [packed.len() as u32, *channels].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    }
    payloads.iter().for_each(|(packed, _)| bytes.extend(packed));
    bytes
}

/// A time between two times: the indices of both, and how far it is from the first to the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Between {
    /// The time before, or the first.
    pub before: usize,
    /// The time after, or the last.
    pub after: usize,
    /// From 0 at `before` to 1 at `after`.
    pub part: f64,
}

impl Between {
    /// Where an hour lies among ascending `hours`, of which there is at least one.
    pub fn new(hours: &[f64], hour: f64) -> Self {
        let next = hours.partition_point(|time| *time <= hour);
        let (before, after) = (next.saturating_sub(1), next.min(hours.len() - 1));
        let (from, to) = (hours[before], hours[after]);
        let part = if after > before { (hour - from) / (to - from) } else { 0.0 };
        Between { before, after, part }
    }

    /// The value between those of the two times.
    pub fn lerp(&self, before: f32, after: f32) -> f32 {
        before + (after - before) * self.part as f32
    }
}

/// The visibility of one page, opened: its tiles are read one by one.
#[derive(Debug)]
pub struct Visibility {
    path: PathBuf,
    /// Width and height of the page in texels.
    pub size: [u32; 2],
    /// The level of full visibility.
    pub top: u8,
    /// The times in hours, ascending; at least one.
    pub hours: Vec<f64>,
    /// The tiles of the page, row by row.
    pub tiles: Vec<Rect>,
    /// Per tile, its payload's offset, length and channels.
    places: Vec<(u64, u32, u32)>,
}

impl Visibility {
    /// Opens a file and reads all but its tiles.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Invalid`] where a value is not what the format allows, [`Error::Unsupported`]
    /// for another version.
    pub fn open(path: &Path) -> Result<Self> {
        let invalid = |what: String| Error::invalid(path.display(), what);
        let mut file = File::open(path).map_err(Error::io(path))?;
        let length = file.metadata().map_err(Error::io(path))?.len();
        let mut read = |bytes: usize, what: &str| {
            let mut buffer = Vec::new();
            Read::by_ref(&mut file).take(bytes as u64).read_to_end(&mut buffer).map_err(Error::io(path))?;
            match buffer.len() == bytes {
                true => Ok(buffer),
                false => Err(invalid(format!("cut short: expected {bytes} bytes of {what}"))),
            }
        };
        let head = read(HEAD, "a header")?;
        if head[..6] != MAGIC[..6] {
            return Err(invalid("not a visibility file; expected it to begin with TLMVIS01".into()));
        }
        if head[..8] != *MAGIC {
            let found = String::from_utf8_lossy(&head[6..8]).into_owned();
            let what =
                format!("version {found:?} of the visibility format; this program reads version \"01\"");
            return Err(Error::unsupported(path.display(), what));
        }
        let [width, height, top, count] = std::array::from_fn(|i| word(&head[8..], i));
        if [width, height].iter().any(|side| !(1..=MOST_TEXELS).contains(side)) {
            return Err(invalid(format!(
                "a page of {width} × {height} texels: expected 1 to {MOST_TEXELS} each"
            )));
        }
        if !(1..=255).contains(&top) {
            return Err(invalid(format!("level {top} for 1: expected 1 to 255")));
        }
        if !(1..=MOST_TIMES as u32).contains(&count) {
            return Err(invalid(format!("{count} times: expected 1 to {MOST_TIMES}")));
        }
        let times = read(8 * count as usize, "times")?;
        let hour = |bytes: &[u8]| f64::from_le_bytes(std::array::from_fn(|i| bytes[i]));
        let hours: Vec<f64> = times.chunks_exact(8).map(hour).collect();
        let ascend = hours.windows(2).all(|pair| pair[0] < pair[1]);
        if !ascend || hours.iter().any(|hour| !(0.0..=24.0).contains(hour)) {
            return Err(invalid("its times are not ascending hours from 0 to 24".into()));
        }
        let tiles = tiles(width as usize, height as usize, TILE);
        let index = read(8 * tiles.len(), "lengths of tiles")?;
        let mut at = (HEAD + times.len() + index.len()) as u64;
        let mut places = Vec::with_capacity(tiles.len());
        for (tile, rect) in tiles.iter().enumerate() {
            let (bytes, channels) = (word(&index, 2 * tile), word(&index, 2 * tile + 1));
            if !matches!((bytes, channels), (0, 0) | (1.., 1 | 3)) {
                let expected = "expected 1 or 3 channels, or 0 of no bytes";
                let place = format!("tile at texel ({}, {})", rect.x0, rect.y0);
                return Err(invalid(format!("{place}: {channels} channels in {bytes} bytes; {expected}")));
            }
            places.push((at, bytes, channels));
            at += u64::from(bytes);
        }
        if at != length {
            return Err(invalid(format!("{length} bytes: expected {at} by the lengths of its tiles")));
        }
        Ok(Visibility { path: path.to_owned(), size: [width, height], top: top as u8, hours, tiles, places })
    }

    /// The visibility over a tile.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Invalid`] with the tile whose payload is not what the format allows.
    pub fn tile(&self, tile: usize) -> Result<Planes> {
        let (rect, (at, length, channels)) = (self.tiles[tile], self.places[tile]);
        let texels = rect.width() * rect.height();
        let channels = channels as usize;
        if channels == 0 {
            return Ok(Planes { texels, channels: 1, levels: vec![0; texels * self.hours.len()] });
        }
        let mut file = File::open(&self.path).map_err(Error::io(&self.path))?;
        file.seek(SeekFrom::Start(at)).map_err(Error::io(&self.path))?;
        let mut packed = Vec::new();
        file.take(u64::from(length)).read_to_end(&mut packed).map_err(Error::io(&self.path))?;
        let expected = channels * self.hours.len() * texels;
        let levels = self.unpack(&packed, expected).map_err(|what| {
            let place = format!("{}, tile at texel ({}, {})", self.path.display(), rect.x0, rect.y0);
            Error::invalid(place, what)
        })?;
        Ok(Planes { texels, channels, levels })
    }

    /// The levels of a payload; what is wrong with it, else.
    fn unpack(&self, packed: &[u8], expected: usize) -> Result<Vec<u8>, String> {
        let mut levels = Vec::new();
        // Its dictionary is no larger than what it unpacks to, rounded up, whatever its header says.
        let most_kilobytes = 1024 + 2 * (expected >> 10) as u32;
        let stream = XzReader::new_mem_limit(packed, false, most_kilobytes);
        stream
            .take(expected as u64 + 1)
            .read_to_end(&mut levels)
            .map_err(|error| format!("not a complete .xz stream: {error}"))?;
        if levels.len() != expected {
            return Err(format!("unpacks to {} bytes or more, expected {expected}", levels.len()));
        }
        match levels.iter().find(|level| **level > self.top) {
            Some(level) => Err(format!("level {level}, expected 0 to {}", self.top)),
            None => Ok(levels),
        }
    }
}

/// Number `i` of little-endian words.
fn word(bytes: &[u8], i: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|byte| bytes[4 * i + byte]))
}

#[cfg(test)]
#[path = "visibility_tests.rs"]
mod tests;
