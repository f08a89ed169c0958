//! The header's bytes and the index that ends it.

use super::{
    ALIGN, Entry, FIXED, Header, MAGIC, MAX_HEADER, MAX_SIDE, MapCoding, PageKind, Part, Payload, Section,
    VERSION, checksum, resident,
};
use crate::grid::Grid;
use crate::model::{BORDER, STORED};
use crate::sun::{Sun, SunPath, Tables};
use crate::time::{Coding, Timeline};
use crate::{Error, Result};

/// Bytes of a tile's and of a section's part of one line of the index.
const ENTRY: usize = 8;
const SECTION: usize = 16;
/// The streams that this crate knows: features and decoder, the sun, how its shadows move, planes.
const FEATURES: u32 = 0;
const SUN: u32 = 1;
const SHADOWS: u32 = 2;
const PLANES: u32 = 3;
/// The sections of the whole file that this crate knows: how bright tiles are.
const RESIDENT: u32 = 0;
/// Bytes of a line of the table of those sections.
const TABLE_LINE: usize = 24;
/// The flag of a stream or section without which a bundle must not be decoded.
const REQUIRED: u32 = 1;

/// The header with its index, padded, and the resident block; payloads follow it directly, in order.
pub(super) fn encode(header: &Header, payloads: &[Payload]) -> Result<Vec<u8>> {
    check(header).map_err(|what| Error::invalid("bundle header", what))?;
    let mut out = vec![0; FIXED];
    let u32_ = |out: &mut Vec<u8>, n: usize| out.extend((n as u32).to_le_bytes());
    let time = &header.timeline;
    let resident: Vec<u8> = payloads.iter().flat_map(|payload| payload.resident.iter().copied()).collect();
    let maps = match header.coding {
        MapCoding::Neural => FEATURES,
        MapCoding::Basis => PLANES,
    };
    let streams = [[maps, 0, REQUIRED], [SUN, 0, 0], [SHADOWS, 0, 0]];
    let streams = &streams[..1 + usize::from(header.sun.is_some()) + usize::from(header.shadows)];
    let (path, visible) = header.sun.as_ref().map_or((0, 0), |sun| (sun.path.hours.len(), sun.times.len()));
    for n in [STORED, BORDER, time.hours.len(), time.between.len(), header.pages.len(), header.groups.len()] {
        u32_(&mut out, n);
    }
    for n in [streams.len(), path, visible, 1] {
        u32_(&mut out, n);
    }
    for text in [&header.scene, &header.info] {
        u32_(&mut out, text.len());
        out.extend(text.as_bytes());
    }
    for (page, kind) in header.pages.iter().zip(&header.kinds) {
        u32_(&mut out, *kind as usize);
        u32_(&mut out, page.width);
        u32_(&mut out, page.height);
    }
    out.extend(time.hours.iter().chain(&time.between).flat_map(|hour| hour.to_le_bytes()));
    for (group, (name, on)) in header.groups.iter().zip(&time.intervals).enumerate() {
        u32_(&mut out, name.len());
        out.extend(name.as_bytes());
        u32_(&mut out, on.len());
        out.extend(on.iter().flatten().flat_map(|hour| hour.to_le_bytes()));
        out.extend(time.states.iter().map(|state| u8::from(state[group])));
        out.push(u8::from(header.apart[group]));
    }
    out.extend(streams.iter().flatten().flat_map(|n| n.to_le_bytes()));
    out.extend([RESIDENT, REQUIRED].iter().flat_map(|n| n.to_le_bytes()));
    out.extend([resident.len() as u64, checksum(&[&resident])].iter().flat_map(|n| n.to_le_bytes()));
    if let Some(Sun { path, times, tables }) = &header.sun {
        out.extend(path.hours.iter().chain(times).flat_map(|hour| hour.to_le_bytes()));
        let vectors = path.direction.iter().chain(&path.irradiance);
        out.extend(vectors.flatten().flat_map(|value| value.to_le_bytes()));
        let tables = tables.encode();
        u32_(&mut out, tables.len());
        out.extend(tables);
    }
    // The index, each section right after the one before.
    let lines = (ENTRY + SECTION * streams.len()) * payloads.len();
    let length = (out.len() + lines).next_multiple_of(ALIGN);
    let mut offset = (length + resident.len().next_multiple_of(ALIGN)) as u64;
    for payload in payloads {
        out.extend(offset.to_le_bytes());
        for Section { word, bytes } in
            [&payload.maps, &payload.sun, &payload.shadows].into_iter().take(streams.len())
        {
            u32_(&mut out, bytes.len());
            out.extend(word.to_le_bytes());
            out.extend(if bytes.is_empty() { 0 } else { checksum(&[bytes]) }.to_le_bytes());
            offset += bytes.len() as u64;
        }
    }
    out.resize(length, 0);
    if length as u64 > MAX_HEADER {
        return Err(Error::invalid(
            "bundle header",
            format!("{length} bytes; expected at most {MAX_HEADER}"),
        ));
    }
    // The fixed part comes last: lengths, then the checksum over everything but itself.
    out[..8].copy_from_slice(&MAGIC);
    out[8..12].copy_from_slice(&VERSION.to_le_bytes());
    out[12..16].copy_from_slice(&(length as u32).to_le_bytes());
    out[16..24].copy_from_slice(&offset.to_le_bytes());
    let sum = checksum(&[&out[..24], &out[FIXED..]]);
    out[24..32].copy_from_slice(&sum.to_le_bytes());
    out.extend(resident);
    out.resize(out.len().next_multiple_of(ALIGN), 0);
    Ok(out)
}

/// Checks the first [`FIXED`] bytes of a file of `file_bytes`; the header's length.
pub(super) fn check_start(start: &[u8], file_bytes: u64, name: &str) -> Result<usize> {
    let mut cursor = Cursor { bytes: start, at: 0, name };
    if cursor.array::<8>("magic")? != MAGIC {
        return Err(Error::invalid(name, "does not begin with the magic bytes of an NDGI bundle"));
    }
    let version = cursor.u32("version")?;
    if version != VERSION {
        let what = match version < VERSION {
            true => "compress its dataset again",
            false => "use the program that wrote it, or a newer one than this",
        };
        let what = format!("bundle version {version}; this program reads version {VERSION}: {what}");
        return Err(Error::unsupported(name, what));
    }
    let length = u64::from(cursor.u32("header length")?);
    let total = u64::from_le_bytes(cursor.array("file length")?);
    if total != file_bytes {
        return Err(Error::invalid(
            name,
            format!("has {file_bytes} bytes; its header says {total}: it is cut short, or damaged"),
        ));
    }
    if length < FIXED as u64 || length > file_bytes.min(MAX_HEADER) || !length.is_multiple_of(ALIGN as u64) {
        return Err(Error::invalid(name, format!("header of {length} bytes in a file of {file_bytes}")));
    }
    Ok(length as usize)
}

/// A header as it was read.
pub(super) struct Read {
    pub header: Header,
    pub index: Vec<Entry>,
    /// Sections of tiles and of the whole file that are not known.
    pub unknown: Vec<Part>,
    /// All sections of the file, in order.
    pub of_file: Vec<Part>,
    /// Of these, the resident block.
    pub resident: Part,
}

/// Parses a whole header. `bytes` passed [`check_start`] and are as long as it says.
pub(super) fn decode(bytes: &[u8], file_bytes: u64, name: &str) -> Result<Read> {
    let wrong = |what: String| Error::invalid(name, what);
    let mut cursor = Cursor { bytes, at: 24, name };
    let expected = u64::from_le_bytes(cursor.array("checksum")?);
    let found = checksum(&[&bytes[..24], &bytes[FIXED..]]);
    if found != expected {
        return Err(wrong(format!(
            "header checksum {found:016x}, but the file says {expected:016x}: the file is damaged"
        )));
    }
    let [stored, border] = [cursor.u32("stored side")? as usize, cursor.u32("border")? as usize];
    if (stored, border) != (STORED, BORDER) {
        let what = format!(
            "tiles of {stored} texels with borders of {border}; this program reads {STORED} and {BORDER}"
        );
        return Err(Error::unsupported(name, what));
    }
    let frames = cursor.count("frames", 8)?;
    let between = cursor.count("hours between frames", 8)?;
    let pages = cursor.count("pages", 8)?;
    let groups = cursor.count("groups", 8)?;
    let streams = cursor.count("streams", 12)?;
    let path = cursor.count("times of the sun's path", 32)?;
    let visible = cursor.count("times of visibility", 8)?;
    let sections = cursor.count("sections of the file", TABLE_LINE)?;
    let (scene, info) = (cursor.text("scene")?, cursor.text("info")?);
    cursor.has(pages, 8, "pages")?;
    let (mut grids, mut kinds) = (Vec::with_capacity(pages), Vec::with_capacity(pages));
    for _ in 0..pages {
        kinds.push(match cursor.u32("kind of a page")? {
            0 => PageKind::Atlas,
            1 => PageKind::Probes,
            other => return Err(Error::unsupported(name, format!("a page of kind {other}"))),
        });
        let (width, height) = (cursor.u32("page width")? as usize, cursor.u32("page height")? as usize);
        grids.push(Grid { width, height });
    }
    let (hours, between) =
        (cursor.doubles(frames, "hours")?, cursor.doubles(between, "hours between frames")?);
    let coding = Coding::Standard;
    let mut timeline = Timeline { hours, between, intervals: Vec::new(), states: Vec::new(), coding };
    timeline.states.resize(frames, Vec::new());
    let (mut names, mut apart) = (Vec::new(), Vec::new());
    for _ in 0..groups {
        names.push(cursor.text("group name")?);
        let intervals = cursor.u32("intervals")? as usize;
        cursor.has(intervals, 16, "intervals")?;
        timeline.intervals.push(cursor.doubles(2 * intervals, "intervals")?.as_chunks::<2>().0.to_vec());
        for state in &mut timeline.states {
            state.push(cursor.flag("state")?);
        }
        apart.push(cursor.flag("whether a light group is apart")?);
    }
    let kinds_of_streams = cursor.streams(streams)?;
    let mut unknown = Vec::new();
    let (resident, of_file, end) = cursor.sections(sections, &mut unknown)?;
    let mut sun = None;
    if path > 0 || visible > 0 {
        let (hours, times) = (cursor.doubles(path, "sun's path")?, cursor.doubles(visible, "visibility")?);
        let (direction, irradiance) =
            (cursor.vectors(path, "direction")?, cursor.vectors(path, "irradiance")?);
        let count = cursor.count("bytes of tables", 1)?;
        let tables = Tables::decode(cursor.take(count, "tables")?).map_err(wrong)?;
        sun = Some(Sun { path: SunPath { hours, direction, irradiance }, times, tables });
    }
    if sun.is_some() != kinds_of_streams.contains(&SUN) {
        return Err(wrong(
            "a stream of the sun without its path, or a path without a stream; expected both or neither"
                .to_owned(),
        ));
    }
    let shadows = kinds_of_streams.contains(&SHADOWS);
    let coding = match kinds_of_streams.contains(&PLANES) {
        true => MapCoding::Basis,
        false => MapCoding::Neural,
    };
    let header =
        Header { scene, info, pages: grids, kinds, groups: names, apart, timeline, coding, sun, shadows };
    check(&header).map_err(wrong)?;
    let index =
        decode_index(&mut cursor, &header, &kinds_of_streams, [end, file_bytes], &resident, &mut unknown)?;
    if cursor.bytes.len() - cursor.at >= ALIGN || cursor.bytes[cursor.at..].iter().any(|&byte| byte != 0) {
        return Err(wrong(format!(
            "byte {}: only zeros up to the next multiple of {ALIGN} may follow the index",
            cursor.at
        )));
    }
    Ok(Read { header, index, unknown, of_file, resident })
}

/// The index: payloads lie one after another behind the sections of the file, which end at the first of
/// `extent`, each a section per stream, up to its second.
fn decode_index(
    cursor: &mut Cursor,
    header: &Header,
    streams: &[u32],
    extent: [u64; 2],
    resident: &Part,
    unknown: &mut Vec<Part>,
) -> Result<Vec<Entry>> {
    let line = ENTRY + SECTION * streams.len();
    cursor.has(header.tiles(), line, "tiles")?;
    // How long the resident block is, the maps of the tiles tell.
    let maps = streams.iter().position(|&stream| is_maps(stream)).unwrap_or_default();
    let lengths = cursor.bytes[cursor.at..].chunks_exact(line).take(header.tiles());
    let lit = lengths.filter(|line| line[ENTRY + SECTION * maps..][..4] != [0; 4]).count();
    let length = lit * resident::len(header.resident_words());
    if resident.length as usize != length {
        let what = format!("a resident block of {} bytes; expected {length}", resident.length);
        return Err(Error::invalid(cursor.name, what));
    }
    let [mut end, file_bytes] = extent;
    let mut index = Vec::with_capacity(header.tiles());
    for place in header.places() {
        let (at, name) = (cursor.at, cursor.name);
        let wrong =
            |what: String| Error::invalid(name, format!("byte {at}, index line of {place:?}: {what}"));
        let offset = u64::from_le_bytes(cursor.array("offset")?);
        if offset != end {
            return Err(wrong(format!("offset {offset}; expected {end}")));
        }
        let mut entry = Entry::default();
        for &stream in streams {
            let (length, word) = (cursor.u32("length")?, cursor.u32("word")?);
            let part =
                Part { offset: end, length, word, checksum: u64::from_le_bytes(cursor.array("checksum")?) };
            if length == 0 && part.checksum != 0 || !length.is_multiple_of(ALIGN as u32) {
                return Err(wrong(format!(
                    "length {length}: expected a multiple of {ALIGN}, 0 without a checksum"
                )));
            }
            if word != 0 && (stream == SHADOWS || stream == SUN && length == 0) {
                return Err(wrong(format!("word {word:#x} of a section of {length} bytes, stream {stream}")));
            }
            match stream {
                FEATURES | PLANES => {
                    header.check_maps(place, word, length as usize).map_err(wrong)?;
                    entry.maps = part;
                }
                SUN => entry.sun = part,
                SHADOWS => entry.shadows = part,
                _ => unknown.push(part),
            }
            end += u64::from(length);
        }
        if entry.shadows.length > 0 && entry.sun.length == 0 {
            return Err(wrong("moving shadows of a tile without direct light of the sun".to_owned()));
        }
        index.push(entry);
    }
    if end != file_bytes {
        return Err(Error::invalid(cursor.name, format!("payloads end at byte {end} of {file_bytes}")));
    }
    Ok(index)
}

/// Whether a stream holds maps.
fn is_maps(stream: u32) -> bool {
    [FEATURES, PLANES].contains(&stream)
}

/// The rules on values, the same for writing and reading.
fn check(header: &Header) -> Result<(), String> {
    let time = &header.timeline;
    if header.pages.is_empty() || time.hours.is_empty() {
        return Err(format!(
            "{} pages and {} frames; expected at least one of each",
            header.pages.len(),
            time.hours.len()
        ));
    }
    for page in &header.pages {
        if ![page.width, page.height].iter().all(|side| (1..=MAX_SIDE).contains(side)) {
            return Err(format!(
                "page of {} × {} texels; expected sides of 1 to {MAX_SIDE}",
                page.width, page.height
            ));
        }
    }
    if time.hours.iter().any(|hour| !(0.0..24.0).contains(hour)) || !time.hours.is_sorted_by(|a, b| a < b) {
        return Err("hours that are not strictly ascending in [0, 24)".to_owned());
    }
    if time.intervals.iter().flatten().flatten().any(|hour| !(0.0..=24.0).contains(hour)) {
        return Err("an on-interval outside [0, 24]".to_owned());
    }
    if header.apart.len() != header.groups.len()
        || header.coding == MapCoding::Neural && header.apart.contains(&true)
    {
        return Err("light groups that are apart from neural maps".to_owned());
    }
    if header.kinds.len() != header.pages.len() {
        return Err("different numbers of pages and of their kinds".to_owned());
    }
    if time.coding != Coding::Standard {
        return Err("the paper's coding; expected the standard one".to_owned());
    }
    if let Some(sun) = &header.sun {
        sun.check()?;
    }
    if header.shadows && header.sun.is_none() {
        return Err("moving shadows without a sun".to_owned());
    }
    let shaped = time.intervals.len() == header.groups.len()
        && time.states.len() == time.hours.len()
        && time.states.iter().all(|state| state.len() == header.groups.len());
    if !shaped {
        return Err("different numbers of groups, intervals and states".to_owned());
    }
    header.maps_timeline().check_between()
}

/// Reads little-endian fields one after another.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    name: &'a str,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8]> {
        let part = self.bytes[self.at..].get(..n).ok_or_else(|| {
            let left = self.bytes.len() - self.at;
            Error::invalid(
                self.name,
                format!("byte {}: expected {n} bytes of {what}, but only {left} remain", self.at),
            )
        })?;
        self.at += n;
        Ok(part)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    fn flag(&mut self, what: &str) -> Result<bool> {
        match self.array::<1>(what)? {
            [flag @ (0 | 1)] => Ok(flag == 1),
            [flag] => {
                let what = format!("byte {}: {what}: {flag}; expected 0 or 1", self.at - 1);
                Err(Error::invalid(self.name, what))
            }
        }
    }

    fn u32(&mut self, what: &str) -> Result<u32> {
        self.array(what).map(u32::from_le_bytes)
    }

    /// That `n` things of at least `each` bytes can still follow: checked before anything is allocated for
    /// them.
    fn has(&self, n: usize, each: usize, what: &str) -> Result<()> {
        let left = self.bytes.len() - self.at;
        if n <= left / each {
            return Ok(());
        }
        Err(Error::invalid(self.name, format!("byte {}: {n} {what}, but only {left} bytes remain", self.at)))
    }

    fn count(&mut self, what: &str, each: usize) -> Result<usize> {
        let n = self.u32(what)? as usize;
        self.has(n, each, what)?;
        Ok(n)
    }

    fn text(&mut self, what: &str) -> Result<String> {
        let n = self.count(what, 1)?;
        let at = self.at;
        let bytes = self.take(n, what)?.to_vec();
        String::from_utf8(bytes)
            .map_err(|_| Error::invalid(self.name, format!("byte {at}: {what} is not UTF-8")))
    }

    /// The table of the file's sections, which follow the header: the resident block, all, and where the last
    /// ends. Unknown ones must not be required.
    fn sections(&mut self, n: usize, unknown: &mut Vec<Part>) -> Result<(Part, Vec<Part>, u64)> {
        let (mut resident, mut all) = (None, Vec::new());
        let mut end = self.bytes.len() as u64;
        let mut seen = std::collections::BTreeSet::new();
        self.has(n, TABLE_LINE, "sections of the file")?;
        for _ in 0..n {
            let at = self.at;
            let (kind, flags) = (self.u32("section")?, self.u32("flags")?);
            let [length, checksum] = [self.array("length")?, self.array("checksum")?].map(u64::from_le_bytes);
            let wrong = |what: String| Error::invalid(self.name, format!("byte {at}: {what}"));
            if kind != RESIDENT && flags & REQUIRED != 0 {
                let what = format!("required section of unknown kind {kind}");
                return Err(Error::unsupported(self.name, what));
            }
            if !seen.insert(kind) || kind == RESIDENT && flags != REQUIRED {
                return Err(wrong(format!("a section of kind {kind}, flags {flags}")));
            }
            let length = u32::try_from(length).map_err(|_| wrong(format!("a section of {length} bytes")))?;
            let part = Part { offset: end, length, word: 0, checksum };
            end += u64::from(length).next_multiple_of(ALIGN as u64);
            all.push(part);
            match kind {
                RESIDENT => resident = Some(part),
                _ => unknown.push(part),
            }
        }
        let resident = resident.ok_or_else(|| Error::invalid(self.name, "no resident block"))?;
        Ok((resident, all, end))
    }

    /// The kinds of the streams, each of which is there once, maps of one coding among them; unknown ones
    /// must not be required.
    fn streams(&mut self, n: usize) -> Result<Vec<u32>> {
        let mut kinds = Vec::new();
        self.has(n, 12, "streams")?;
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..n {
            let [kind, light, flags] = [self.u32("stream")?, self.u32("light")?, self.u32("flags")?];
            let is_known = [FEATURES, SUN, SHADOWS, PLANES].contains(&kind);
            if !is_known && flags & REQUIRED != 0 {
                let what = format!("required stream of unknown kind {kind}");
                return Err(Error::unsupported(self.name, what));
            }
            let is_wrong = is_known && (light != 0 || flags != if is_maps(kind) { REQUIRED } else { 0 });
            if !seen.insert((kind, light)) || is_wrong {
                let what =
                    format!("byte {}: a stream of kind {kind}, light {light}, flags {flags}", self.at - 12);
                return Err(Error::invalid(self.name, what));
            }
            kinds.push(kind);
        }
        match kinds.iter().filter(|kind| is_maps(**kind)).count() {
            1 => Ok(kinds),
            n => Err(Error::invalid(self.name, format!("{n} streams of maps; expected one"))),
        }
    }

    fn vectors(&mut self, n: usize, what: &str) -> Result<Vec<[f32; 3]>> {
        self.has(n, 12, what)?;
        let mut number = || self.array(what).map(f32::from_le_bytes);
        (0..n).map(|_| Ok([number()?, number()?, number()?])).collect()
    }

    fn doubles(&mut self, n: usize, what: &str) -> Result<Vec<f64>> {
        self.has(n, 8, what)?;
        (0..n).map(|_| self.array(what).map(f64::from_le_bytes)).collect()
    }
}
