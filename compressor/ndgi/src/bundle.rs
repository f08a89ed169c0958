//! The bundle file: header, tile index, payloads, checksums (FORMAT.md has every byte).
//!
//! Opening reads the header and the index; each tile is one more read. Everything from a file is validated
//! before use, so a damaged or hostile file gives an [`Error`]. Allocations are bounded by the file's length:
//! the header and the index by their own size, a tile by its unpacked payload, up to 128 times its bytes
//! (planes: at most 64 MB), and its visibility of the sun by the number of times, at most 50 MB.

mod resident;
mod header;
mod payload;
mod planes;
mod sun;

pub use crate::model::Section;
pub use payload::{Payload, blocks_len, encode_payload, full_len};
pub use planes::UNPACKED_BYTES;
use resident::decode_brightness;
pub use resident::{encode_brightness, rounded_brightness, rounded_means};
pub use sun::SunSections;

use crate::grid::{Grid, Place};
use crate::model::{Brightness, Contents, Knot, Shape, TileParams};
use crate::planes::{MOST_PLANES_OF_TILE, TilePlanes};
use crate::recent::Recent;
use crate::source::{Memory, ReadAt};
use crate::sun::{Sun, SunDecoder};
use crate::time::Timeline;
use crate::{Error, Result};
use std::sync::OnceLock;
#[cfg(feature = "file")]
use std::{fs::File, io::Read, path::Path};

/// The first eight bytes of a bundle; the line ends show a file that went through a text conversion.
pub const MAGIC: [u8; 8] = *b"NDGI\r\n\x1a\n";
/// The version this crate writes and reads.
pub const VERSION: u32 = 5;
/// Bytes before the variable part of the header.
const FIXED: usize = 32;
/// Alignment in bytes of the header's and every payload's start and end.
const ALIGN: usize = 16;
/// Largest length in bytes of a header with its index (about ten million tiles).
const MAX_HEADER: u64 = 1 << 28;
/// Longest side of a page, in texels.
const MAX_SIDE: usize = 1 << 20;

/// The kind of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageKind {
    /// The charts of surfaces.
    Atlas = 0,
    /// The light of points in space.
    Probes = 1,
}

/// How tiles' maps are coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapCoding {
    /// Feature maps and a tiny network: [`TileParams`].
    Neural,
    /// Planes that all frames share: [`TilePlanes`].
    Basis,
}

/// A bundle's metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// The scene's name.
    pub scene: String,
    /// The writer and its settings, as a JSON object; its `unit` names the unit of light: kilolux where
    /// `bake` made the dataset. Decoding does not need it; `compress evaluate` and `bake` check with it
    /// whether the bundle belongs to the dataset.
    pub info: String,
    /// Width and height of each page.
    pub pages: Vec<Grid>,
    /// The kind of each page.
    pub kinds: Vec<PageKind>,
    /// Names of the light groups, in the timeline's order.
    pub groups: Vec<String>,
    /// Per light group: true if its light is apart from the maps' other light, with planes of its own.
    pub apart: Vec<bool>,
    /// Hours of the frames, schedules and states of the groups, and the coding.
    pub timeline: Timeline,
    /// How maps are coded.
    pub coding: MapCoding,
    /// The sun, where its direct light is a separate stream.
    pub sun: Option<Sun>,
    /// True if the bundle has a stream of moving shadows between the times of visibility.
    pub shadows: bool,
}

impl Header {
    /// Number of tiles of all pages.
    pub fn tiles(&self) -> usize {
        self.pages.iter().map(Grid::tiles).sum()
    }

    /// All tiles in the order of the index: page by page, row by row.
    pub fn places(&self) -> impl Iterator<Item = Place> + '_ {
        self.pages.iter().enumerate().flat_map(|(page, grid)| grid.places(page))
    }

    /// A tile's position in the index; `None` for coordinates outside all pages.
    pub fn position(&self, place: Place) -> Option<usize> {
        let grid = self.pages.get(place.page)?;
        let inside = place.column < grid.columns() && place.row < grid.rows();
        let before: usize = self.pages[..place.page].iter().map(Grid::tiles).sum();
        inside.then(|| before + place.row * grid.columns() + place.column)
    }

    /// Number of knots: [`Timeline::knots`].
    pub fn knots(&self) -> usize {
        self.timeline.hours.len() + self.timeline.between.len()
    }

    /// The times of what is not apart: of light groups, only those that switch it.
    pub fn maps_timeline(&self) -> Timeline {
        self.timeline.without(&self.apart)
    }

    /// Number of light groups that are apart.
    pub fn lamps(&self) -> usize {
        self.apart.iter().filter(|apart| **apart).count()
    }

    /// The place of a light group among those that are apart; `None` if it is not.
    pub fn lamp(&self, group: usize) -> Option<usize> {
        let is_apart = self.apart.get(group).copied().unwrap_or(false);
        is_apart.then(|| self.apart[..group].iter().filter(|apart| **apart).count())
    }

    /// Words of a tile's line of the resident block, but for its scale.
    fn resident_words(&self) -> usize {
        self.knots() + self.lamps()
    }

    /// Checks the word and length of a tile's maps.
    ///
    /// # Errors
    /// A message for what no tile of this bundle can have.
    fn check_maps(&self, place: Place, word: u32, length: usize) -> Result<(), String> {
        match self.coding {
            MapCoding::Neural => self.contents(place, word, length).map(drop),
            MapCoding::Basis => match word as usize > MOST_PLANES_OF_TILE || length == 0 && word != 0 {
                true => Err(format!("word {word:#x}; expected at most {MOST_PLANES_OF_TILE} planes")),
                false => Ok(()),
            },
        }
    }

    /// Sizes of a tile's maps. The place must be one of [`Header::places`].
    pub fn shape(&self, place: Place, contents: &Contents) -> Shape {
        let (width, height) = self.pages[place.page].stored(place.column, place.row);
        Shape::new(contents, width, height, self.timeline.hours.len(), self.timeline.coding)
    }

    /// The contents of a tile whose section of features has this word and length; `None` for a black tile.
    ///
    /// # Errors
    /// A message for a word that no tile of this bundle can have, or a length that its maps cannot have.
    fn contents(&self, place: Place, word: u32, length: usize) -> Result<Option<Contents>, String> {
        if length == 0 {
            return if word == 0 { Ok(None) } else { Err(format!("word {word:#x} of a tile of length 0")) };
        }
        let contents = payload::contents(word, self.groups.len())
            .ok_or_else(|| format!("word {word:#x}; expected the word of valid tile contents"))?;
        let [least, largest] = payload::len_bounds(&self.shape(place, &contents), word);
        if !(least..=largest).contains(&length) || !length.is_multiple_of(ALIGN) {
            return Err(format!(
                "length {length}; expected 0 or a multiple of {ALIGN} from {least} to {largest}"
            ));
        }
        Ok(Some(contents))
    }
}

/// The extent of a section in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Part {
    /// Offset in bytes.
    pub offset: u64,
    /// Its length in bytes; 0 where there is nothing.
    pub length: u32,
    /// The stream's word for it: [`Section::word`].
    pub word: u32,
    /// [`checksum`] of it; 0 where there is nothing.
    pub checksum: u64,
}

/// One line of the index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entry {
    /// Maps, by the bundle's coding; empty for a tile without light other than the sun's direct light.
    pub maps: Part,
    /// The sun's visibility.
    pub sun: Part,
    /// Moving shadows between its times.
    pub shadows: Part,
}

impl Entry {
    /// Total bytes.
    pub fn bytes(&self) -> u64 {
        [self.maps, self.sun, self.shadows].iter().map(|part| u64::from(part.length)).sum()
    }
}

/// True if a file is empty or begins like a bundle (of any version, even a damaged one), so it may be
/// replaced.
#[cfg(feature = "file")]
pub fn begins_like_one(path: &Path) -> bool {
    let mut first = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut first));
    read.is_ok() && (first == MAGIC || first.is_empty())
}

/// The first eight bytes of the BLAKE3 digest of the concatenated parts, as a little-endian number.
pub fn checksum(parts: &[&[u8]]) -> u64 {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(part);
    }
    let mut first = [0; 8];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(first)
}

/// The bytes of a bundle. `payloads` has one entry per [`Header::places`], made by [`encode_payload`]; the
/// default for a black tile.
///
/// # Errors
/// [`Error::Invalid`] for a header that the format cannot hold (see FORMAT.md) or a payload of the wrong
/// length.
pub fn encode(header: &Header, payloads: &[Payload]) -> Result<Vec<u8>> {
    let wrong = |what: String| Error::invalid("bundle", what);
    if payloads.len() != header.tiles() {
        return Err(wrong(format!("{} payloads given for {} tiles", payloads.len(), header.tiles())));
    }
    for (payload, place) in payloads.iter().zip(header.places()) {
        let wrong = |what: String| wrong(format!("payload of {place:?}: {what}"));
        let Payload { maps, sun, shadows, resident } = payload;
        header.check_maps(place, maps.word, maps.bytes.len()).map_err(wrong)?;
        if !maps.bytes.len().is_multiple_of(ALIGN) {
            return Err(wrong(format!("{} bytes of maps", maps.bytes.len())));
        }
        let line = if maps.bytes.is_empty() { 0 } else { resident::len(header.resident_words()) };
        if resident.len() != line {
            return Err(wrong(format!("{} resident bytes; expected {line}", resident.len())));
        }
        if !sun.bytes.is_empty() && header.sun.is_none() || !sun.bytes.len().is_multiple_of(ALIGN) {
            return Err(wrong(format!("{} bytes of a sun", sun.bytes.len())));
        }
        let is_moving = !shadows.bytes.is_empty();
        if is_moving && (sun.bytes.is_empty() || !header.shadows)
            || !shadows.bytes.len().is_multiple_of(ALIGN)
        {
            return Err(wrong(format!("{} bytes of moving shadows", shadows.bytes.len())));
        }
    }
    let mut bytes = header::encode(header, payloads)?;
    for payload in payloads {
        bytes.extend_from_slice(&payload.maps.bytes);
        bytes.extend_from_slice(&payload.sun.bytes);
        bytes.extend_from_slice(&payload.shadows.bytes);
    }
    Ok(bytes)
}

/// An opened bundle: header, index and resident block in memory, payloads where they were.
#[derive(Debug)]
pub struct Bundle {
    /// The bundle's metadata.
    pub header: Header,
    /// One line per [`Header::places`].
    pub index: Vec<Entry>,
    /// Length of the whole file in bytes.
    pub bytes: u64,
    /// Length in bytes of the resident block: means and peaks of all tiles.
    pub bytes_resident: u64,
    /// Sections of the file and of tiles that this crate does not know.
    unknown: Vec<Part>,
    /// All sections of the file, in order.
    of_file: Vec<Part>,
    /// Per tile, how bright it is; empty for a tile without maps.
    brightness: Vec<Brightness>,
    /// The same with the light groups that are apart, at each knot; nothing if there are none.
    knots: Vec<Vec<Knot>>,
    /// The times of what is not apart.
    maps_timeline: Timeline,
    /// Planes that were unpacked lately.
    unpacked: Recent<TilePlanes>,
    sun_decoder: OnceLock<SunDecoder>,
    source: Box<dyn ReadAt>,
    name: String,
}

impl Bundle {
    /// Opens a bundle file; reads its header, its index and its resident block.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Unsupported`] for another version; [`Error::Invalid`] for anything else that
    /// breaks FORMAT.md.
    #[cfg(all(feature = "file", any(unix, windows)))]
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path))?;
        Self::parse(Box::new(file), path.display().to_string())
    }

    /// A bundle in memory: a `Vec<u8>`, an `Arc<[u8]>`, a `&'static [u8]`. Errors as [`Bundle::open`].
    ///
    /// ```
    /// # let bytes: std::sync::Arc<[u8]> = ndgi::testing::sunny_bundle().into();
    /// let bundle = ndgi::Bundle::from_bytes(std::sync::Arc::clone(&bytes))?;
    /// println!("{}: {} frames, {} tiles", bundle.header.scene, bundle.header.timeline.hours.len(), bundle.header.tiles());
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    pub fn from_bytes(bytes: impl AsRef<[u8]> + Send + Sync + 'static) -> Result<Self> {
        Self::parse(Box::new(Memory(bytes)), "bundle".to_owned())
    }

    /// A bundle read through a custom source, such as an archive or a network. Errors as [`Bundle::open`].
    pub fn from_source(source: impl ReadAt + 'static) -> Result<Self> {
        Self::parse(Box::new(source), "bundle".to_owned())
    }

    fn parse(source: Box<dyn ReadAt>, name: String) -> Result<Self> {
        let io = |source| Error::Io { path: name.clone().into(), source };
        let bytes = source.size().map_err(io)?;
        if bytes < FIXED as u64 {
            return Err(Error::invalid(
                &name,
                format!("{bytes} bytes; expected at least {FIXED}: it is not a bundle, or cut short"),
            ));
        }
        let read = |offset: u64, length: usize| {
            let mut bytes = vec![0; length];
            source.read_at(offset, &mut bytes).map(|()| bytes)
        };
        let start = read(0, FIXED).map_err(io)?;
        let length = header::check_start(&start, bytes, &name)?;
        let head = read(0, length).map_err(io)?;
        let header::Read { header, index, unknown, of_file, resident } = header::decode(&head, bytes, &name)?;
        let mut bundle = Bundle {
            unknown,
            of_file,
            brightness: Vec::new(),
            knots: Vec::new(),
            maps_timeline: header.maps_timeline(),
            unpacked: Recent::new(usize::MAX, UNPACKED_BYTES, TilePlanes::bytes),
            sun_decoder: OnceLock::new(),
            header,
            index,
            bytes,
            bytes_resident: u64::from(resident.length),
            source,
            name,
        };
        bundle.brightness = bundle.read_brightness(&resident)?;
        if bundle.header.lamps() > 0 {
            bundle.knots = bundle.brightness.iter().map(|of| bundle.all_light(of)).collect();
        }
        Ok(bundle)
    }

    fn read_brightness(&self, part: &Part) -> Result<Vec<Brightness>> {
        let bytes = self.read(part, || format!("{}, resident block", self.name))?;
        let mut lines = bytes.chunks_exact(resident::len(self.header.resident_words()));
        let line = |entry: &Entry| match entry.maps.length {
            0 => Ok(Brightness::default()),
            _ => decode_brightness(lines.next().unwrap_or_default(), self.header.knots()),
        };
        let wrong = |what| Error::invalid(format!("{}, resident block", self.name), what);
        self.index.iter().map(line).collect::<Result<_, String>>().map_err(wrong)
    }

    /// A tile's knots with the light groups that are apart and on.
    fn all_light(&self, of: &Brightness) -> Vec<Knot> {
        let header = &self.header;
        let hours = header.timeline.knots();
        let with_lamps = |(hour, knot): (&f64, &Knot)| {
            let mut knot = *knot;
            for group in 0..header.groups.len() {
                let Some(lamp) = header.lamp(group).and_then(|at| of.lamps.get(at)) else { continue };
                if header.timeline.is_on(group, *hour) {
                    (0..3).for_each(|c| knot.mean[c] = (knot.mean[c] + lamp.mean[c]).min(f32::MAX));
                    knot.peak = (knot.peak + lamp.peak).min(f32::MAX);
                }
            }
            knot
        };
        hours.iter().zip(&of.knots).map(with_lamps).collect()
    }

    /// The bytes of a section after verifying its checksum; `at` names it in errors.
    fn read(&self, part: &Part, at: impl Fn() -> String) -> Result<Vec<u8>> {
        let io = |source| Error::Io { path: self.name.clone().into(), source };
        let mut bytes = vec![0; part.length as usize];
        self.source.read_at(part.offset, &mut bytes).map_err(io)?;
        let found = checksum(&[&bytes]);
        if found != part.checksum {
            let what = format!(
                "checksum {found:016x}, but the index says {:016x}: the file is damaged",
                part.checksum
            );
            return Err(Error::invalid(at(), what));
        }
        Ok(bytes)
    }

    /// Reads the whole bundle and compares it with all its checksums; decodes features too. (A bundle that is
    /// only opened is verified tile by tile, as tiles are read.)
    ///
    /// ```
    /// # let mut bytes = ndgi::testing::sunny_bundle();
    /// *bytes.last_mut().unwrap() ^= 1;
    /// let bundle = ndgi::Bundle::from_bytes(bytes)?;
    /// assert!(bundle.verify().unwrap_err().to_string().contains("the file is damaged"));
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Bundle::tile`], for the first tile that is damaged; [`Error::Io`].
    pub fn verify(&self) -> Result<()> {
        self.verify_padding()?;
        self.header.places().try_for_each(|place| self.verify_tile(place))?;
        let sections = self.unknown.iter().filter(|part| part.length > 0);
        sections.into_iter().try_for_each(|part| {
            self.read(part, || format!("{}, a section of an unknown kind", self.name)).map(drop)
        })
    }

    /// The zeros behind the sections of the file, which no checksum covers.
    fn verify_padding(&self) -> Result<()> {
        for part in &self.of_file {
            let end = part.offset + u64::from(part.length);
            let mut bytes = vec![0; (end.next_multiple_of(ALIGN as u64) - end) as usize];
            let io = |source| Error::Io { path: self.name.clone().into(), source };
            self.source.read_at(end, &mut bytes).map_err(io)?;
            if bytes.iter().any(|byte| *byte != 0) {
                let what = "bytes behind a section that are not zero: the file is damaged";
                return Err(Error::invalid(&self.name, what));
            }
        }
        Ok(())
    }

    /// [`Bundle::verify`] of one tile.
    ///
    /// # Errors
    /// As [`Bundle::tile`].
    pub fn verify_tile(&self, place: Place) -> Result<()> {
        self.verify_maps(place)?;
        self.sun_sections(place).map(drop)
    }

    /// The same of its maps alone.
    ///
    /// # Errors
    /// As [`Bundle::tile`].
    pub fn verify_maps(&self, place: Place) -> Result<()> {
        match self.header.coding {
            MapCoding::Neural => self.tile(place).map(drop),
            MapCoding::Basis => self.sets(place).map(drop),
        }
    }

    fn position(&self, place: Place) -> Result<usize> {
        let grid = self.grid(place.page)?;
        let missing = || {
            let size =
                format!("no such tile; the page has {} × {}, counted from 0", grid.columns(), grid.rows());
            Error::invalid(self.name_of(place), size)
        };
        self.header.position(place).ok_or_else(missing)
    }

    /// A page's size in texels, and its tiles.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a page that the bundle does not have.
    pub fn grid(&self, page: usize) -> Result<Grid> {
        let missing = || {
            let count = match self.header.pages.len() {
                1 => "1 page".to_owned(),
                n => format!("{n} pages"),
            };
            let what = format!("the bundle has {count}, counted from 0");
            Error::invalid(format!("{}, page {page}", self.name), what)
        };
        self.header.pages.get(page).copied().ok_or_else(missing)
    }

    fn name_of(&self, place: Place) -> String {
        format!("{}, page {}, tile ({}, {})", self.name, place.page, place.column, place.row)
    }

    /// A tile's brightness at each of [`Timeline::knots`], without reading the tile: a fallback colour, and a
    /// measure of how much its light changes. Empty for a black tile.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// use ndgi::grid::Place;
    ///
    /// // A tile's brightness over the day, without reading the tile.
    /// let place = Place { page: 0, column: 1, row: 0 };
    /// for (hour, knot) in bundle.header.timeline.knots().iter().zip(bundle.knots(place)?) {
    ///     println!("{hour} h: mean {:?}, at most about {}", knot.mean, knot.peak);
    /// }
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] for a place that the bundle does not have.
    pub fn knots(&self, place: Place) -> Result<&[Knot]> {
        Ok(self.knots_at(self.position(place)?))
    }

    /// The same by the tile's number in [`Bundle::index`]; empty for a number that no tile has.
    pub fn knots_at(&self, number: usize) -> &[Knot] {
        match self.header.lamps() {
            0 => self.brightness.get(number).map_or(&[], |of| &of.knots),
            _ => self.knots.get(number).map_or(&[], Vec::as_slice),
        }
    }

    /// How bright a tile is without the light groups that are apart, and each of those; empty for a tile
    /// without maps.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a place that the bundle does not have.
    pub fn brightness(&self, place: Place) -> Result<&Brightness> {
        Ok(&self.brightness[self.position(place)?])
    }

    /// The times of what is not apart from the maps: [`Header::maps_timeline`].
    pub fn maps_timeline(&self) -> &Timeline {
        &self.maps_timeline
    }

    /// Reads and checks one tile's features and decoder; `None` if it has no light other than the sun's
    /// stream.
    ///
    /// ```
    /// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
    /// for place in bundle.header.places() {
    ///     match bundle.tile(place)? {
    ///         Some(tile) => println!("{place:?}: {}", tile.shape.contents),
    ///         None => println!("{place:?}: no light but the sun's"),
    ///     }
    /// }
    /// # Ok::<(), ndgi::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] for a place that the bundle does not have, a checksum that differs, or a value that
    /// the format forbids; [`Error::Unsupported`] for a bundle of planes.
    pub fn tile(&self, place: Place) -> Result<Option<TileParams>> {
        let position = self.position(place)?;
        let part = &self.index[position].maps;
        if self.header.coding != MapCoding::Neural {
            let what = "its maps are planes (coding basis), not features: read them with Bundle::planes, or use a bundle made with --coding neural";
            return Err(Error::unsupported(&self.name, what));
        }
        // The index was checked when it was read.
        let Some(contents) = Contents::of_word(part.word).filter(|_| part.length > 0) else {
            return Ok(None);
        };
        let section = self.read(part, || self.name_of(place))?;
        let knots = self.brightness[position].knots.clone();
        let shape = self.header.shape(place, &contents);
        payload::decode_section(&section, part.word, shape, self.header.groups.len(), knots)
            .map_err(|what| Error::invalid(self.name_of(place), what))
            .map(Some)
    }
}

#[cfg(any(test, feature = "testing"))]
impl Bundle {
    /// The bytes of a bundle that repeats this one's pages `copies` times: for tests with many tiles.
    ///
    /// # Errors
    /// As [`Bundle::tile`].
    pub fn repeated(&self, copies: usize) -> Result<Vec<u8>> {
        let section = |part: &Part| {
            let bytes = if part.length > 0 { self.read(part, || self.name.clone())? } else { Vec::new() };
            Ok::<_, Error>(Section { word: part.word, bytes })
        };
        let payload = |(entry, brightness): (&Entry, &Brightness)| {
            let Entry { maps, sun, shadows } = entry;
            let resident = if maps.length > 0 {
                encode_brightness(brightness).map_err(|what| Error::invalid(&self.name, what))?
            } else {
                Vec::new()
            };
            Ok(Payload { maps: section(maps)?, sun: section(sun)?, shadows: section(shadows)?, resident })
        };
        let payloads: Vec<Payload> =
            self.index.iter().zip(&self.brightness).map(payload).collect::<Result<_>>()?;
        let mut header = self.header.clone();
        header.pages = self.header.pages.repeat(copies);
        header.kinds = self.header.kinds.repeat(copies);
        let count = payloads.len() * copies;
        let payloads: Vec<Payload> = payloads.into_iter().cycle().take(count).collect();
        encode(&header, &payloads)
    }
}

#[cfg(test)]
mod tests;
