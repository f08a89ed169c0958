//! The bundle file: header, tile index, payloads, checksums (FORMAT.md has every byte).
//!
//! Opening reads the header and the index; a tile is one more read. Everything that comes from a file is checked before it is
//! believed, so a damaged or hostile file gives an [`Error`]. What is allocated is bounded by the file's own length: the header and
//! the index by what stands there, a tile by what its payload unpacks to, up to 128 times its bytes.

mod header;
mod payload;

pub use payload::{Payload, blocks_len, decode_payload, encode_payload, full_len};

use crate::grid::{Grid, Place};
use crate::model::{Contents, Shape, TileParams};
use crate::time::{Coding, Timeline};
use crate::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The first eight bytes of a bundle; the line ends show a file that went through a text conversion.
pub const MAGIC: [u8; 8] = *b"NDGI\r\n\x1a\n";
/// The version this crate writes; readers refuse others.
pub const VERSION: u32 = 3;
/// Bytes before the variable part of the header.
const FIXED: usize = 32;
/// Headers, and every payload, start and end on multiples of this.
const ALIGN: usize = 16;
/// A header and its index are at most this long (about ten million tiles).
const MAX_HEADER: u64 = 1 << 28;
/// A page's sides are at most this long.
const MAX_SIDE: usize = 1 << 20;

/// What a bundle says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// The scene's name.
    pub scene: String,
    /// What wrote the bundle and how, as a JSON object. Decoding does not need it; `compress evaluate` and `bake` tell by it whether
    /// the bundle is of the dataset there.
    pub info: String,
    /// Width and height of each page.
    pub pages: Vec<Grid>,
    /// Names of the light groups, in the timeline's order.
    pub groups: Vec<String>,
    /// Hours of the sets, schedules and states of the groups, and the coding.
    pub timeline: Timeline,
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

    /// Where a tile stands in the index. `None` for a place that no page has.
    pub fn position(&self, place: Place) -> Option<usize> {
        let grid = self.pages.get(place.page)?;
        let inside = place.column < grid.columns() && place.row < grid.rows();
        let before: usize = self.pages[..place.page].iter().map(Grid::tiles).sum();
        inside.then(|| before + place.row * grid.columns() + place.column)
    }

    /// Sizes of a tile's maps. The place must be one of [`Header::places`].
    pub fn shape(&self, place: Place, contents: &Contents) -> Shape {
        let (width, height) = self.pages[place.page].stored(place.column, place.row);
        Shape::new(contents, width, height, self.timeline.hours.len(), self.timeline.coding)
    }

    /// What a tile of a payload's word and length has; `None` for a black tile.
    ///
    /// # Errors
    /// What is wrong: a word that no tile of this bundle can have, or a length that its maps cannot have.
    fn contents(&self, place: Place, word: u32, length: usize) -> Result<Option<Contents>, String> {
        if length == 0 {
            return if word == 0 { Ok(None) } else { Err(format!("word {word:#x} of a tile of length 0")) };
        }
        let axis = self.timeline.coding == Coding::Standard;
        let contents = payload::contents(word, self.groups.len(), axis).ok_or_else(|| {
            format!("word {word:#x}, which stands for no contents that a tile here can have")
        })?;
        let [least, largest] = payload::len_bounds(&self.shape(place, &contents), word);
        if !(least..=largest).contains(&length) || !length.is_multiple_of(ALIGN) {
            return Err(format!(
                "length {length}; expected 0 or a multiple of {ALIGN} from {least} to {largest}"
            ));
        }
        Ok(Some(contents))
    }
}

/// One line of the index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Where the payload starts in the file.
    pub offset: u64,
    /// Its length in bytes; 0 for a tile without light, which decodes to black.
    pub length: u32,
    /// What the tile has ([`Contents::word`]), and which maps leave out blocks; 0 for an empty tile.
    pub word: u32,
    /// [`checksum`] of the payload; 0 for an empty tile.
    pub checksum: u64,
}

/// Whether a file is a bundle, of any version and however broken, or is empty, so that nothing else is lost with it.
pub fn begins_like_one(path: &Path) -> bool {
    let mut first = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut first));
    read.is_ok() && (first == MAGIC || first.is_empty())
}

/// The first eight bytes of the BLAKE3 digest of the parts one after another, as a little-endian number.
pub fn checksum(parts: &[&[u8]]) -> u64 {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(part);
    }
    let mut first = [0; 8];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(first)
}

/// The bytes of a bundle. `payloads` has one entry per [`Header::places`], made by [`encode_payload`]; the default for a black tile.
///
/// # Errors
/// [`Error::Invalid`] for a header that the format cannot hold (see FORMAT.md) or a payload of the wrong length.
pub fn encode(header: &Header, payloads: &[Payload]) -> Result<Vec<u8>> {
    let wrong = |what: String| Error::invalid("bundle", what);
    if payloads.len() != header.tiles() {
        return Err(wrong(format!("{} payloads given for {} tiles", payloads.len(), header.tiles())));
    }
    for (payload, place) in payloads.iter().zip(header.places()) {
        header
            .contents(place, payload.word, payload.bytes.len())
            .map_err(|what| wrong(format!("payload of {place:?}: {what}")))?;
    }
    let mut bytes = header::encode(header, payloads)?;
    for payload in payloads {
        bytes.extend_from_slice(&payload.bytes);
    }
    Ok(bytes)
}

/// Where the bytes of a bundle come from.
#[derive(Debug)]
enum Source {
    File(File),
    Memory(Vec<u8>),
}

impl Source {
    fn len(&self) -> std::io::Result<u64> {
        match self {
            Source::File(file) => Ok(file.metadata()?.len()),
            Source::Memory(bytes) => Ok(bytes.len() as u64),
        }
    }

    /// `length` bytes at `offset`; the caller has checked that the source is that long.
    fn read(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        match self {
            Source::File(file) => {
                let mut bytes = vec![0; length];
                read_exact_at(file, &mut bytes, offset)?;
                Ok(bytes)
            }
            Source::Memory(bytes) => {
                let range = offset as usize..(offset as usize).saturating_add(length);
                bytes.get(range).map(<[u8]>::to_vec).ok_or(std::io::ErrorKind::UnexpectedEof.into())
            }
        }
    }
}

fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// An opened bundle: header and index in memory, payloads where they were.
#[derive(Debug)]
pub struct Bundle {
    /// What the bundle says of itself.
    pub header: Header,
    /// One line per [`Header::places`].
    pub index: Vec<Entry>,
    /// Length of the whole file in bytes.
    pub bytes: u64,
    source: Source,
    name: String,
}

impl Bundle {
    /// Opens a bundle file; reads its header and index only.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Unsupported`] for another version; [`Error::Invalid`] for anything else that breaks FORMAT.md.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path))?;
        Self::parse(Source::File(file), path.display().to_string())
    }

    /// A bundle in memory. Errors as [`Bundle::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self> {
        Self::parse(Source::Memory(bytes), "bundle".to_owned())
    }

    fn parse(source: Source, name: String) -> Result<Self> {
        let io = |source| Error::Io { path: name.clone().into(), source };
        let bytes = source.len().map_err(io)?;
        if bytes < FIXED as u64 {
            return Err(Error::invalid(&name, format!("{bytes} bytes; a bundle has at least {FIXED}")));
        }
        let start = source.read(0, FIXED).map_err(io)?;
        let length = header::check_start(&start, bytes, &name)?;
        let head = source.read(0, length).map_err(io)?;
        let (header, index) = header::decode(&head, bytes, &name)?;
        Ok(Bundle { header, index, bytes, source, name })
    }

    /// Reads and checks one tile; `None` for a black one.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a place that the bundle does not have, a checksum that differs, or a value that the format forbids.
    pub fn tile(&self, place: Place) -> Result<Option<TileParams>> {
        let at = || format!("{}, page {}, tile ({}, {})", self.name, place.page, place.column, place.row);
        let position = self.header.position(place).ok_or_else(|| Error::invalid(at(), "no such tile"))?;
        let entry = self.index[position];
        // The index was checked when it was read.
        let Some(contents) = Contents::of_word(entry.word).filter(|_| entry.length > 0) else {
            return Ok(None);
        };
        let io = |source| Error::Io { path: self.name.clone().into(), source };
        let payload = self.source.read(entry.offset, entry.length as usize).map_err(io)?;
        let found = checksum(&[&payload]);
        if found != entry.checksum {
            let what = format!("checksum {found:016x}; the index says {:016x}", entry.checksum);
            return Err(Error::invalid(at(), what));
        }
        let shape = self.header.shape(place, &contents);
        decode_payload(&payload, entry.word, shape, self.header.groups.len())
            .map_err(|what| Error::invalid(at(), what))
            .map(Some)
    }
}

#[cfg(test)]
mod tests;
