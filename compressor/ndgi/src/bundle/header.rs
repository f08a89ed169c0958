//! The header's bytes and the index that ends it.

use super::{ALIGN, Entry, FIXED, Header, MAGIC, MAX_HEADER, MAX_SIDE, Payload, VERSION, checksum};
use crate::grid::Grid;
use crate::model::{BORDER, STORED};
use crate::time::{Coding, Timeline};
use crate::{Error, Result};

/// Bytes of one line of the index.
const ENTRY: usize = 24;

/// The header with its index, padded; payloads follow it directly, in order.
pub(super) fn encode(header: &Header, payloads: &[Payload]) -> Result<Vec<u8>> {
    check(header).map_err(|what| Error::invalid("bundle header", what))?;
    let mut out = vec![0; FIXED];
    let u32_ = |out: &mut Vec<u8>, n: usize| out.extend((n as u32).to_le_bytes());
    for n in [STORED, BORDER, coding_number(header.timeline.coding)] {
        u32_(&mut out, n);
    }
    for n in [header.timeline.hours.len(), header.pages.len(), header.groups.len()] {
        u32_(&mut out, n);
    }
    for text in [&header.scene, &header.info] {
        u32_(&mut out, text.len());
        out.extend(text.as_bytes());
    }
    for page in &header.pages {
        u32_(&mut out, page.width);
        u32_(&mut out, page.height);
    }
    out.extend(header.timeline.hours.iter().flat_map(|hour| hour.to_le_bytes()));
    for (group, (name, on)) in header.groups.iter().zip(&header.timeline.intervals).enumerate() {
        u32_(&mut out, name.len());
        out.extend(name.as_bytes());
        u32_(&mut out, on.len());
        out.extend(on.iter().flatten().flat_map(|hour| hour.to_le_bytes()));
        out.extend(header.timeline.states.iter().map(|state| u8::from(state[group])));
    }
    // The index, each payload right after the one before.
    let length = (out.len() + ENTRY * payloads.len()).next_multiple_of(ALIGN);
    let mut offset = length as u64;
    for payload in payloads {
        out.extend(offset.to_le_bytes());
        u32_(&mut out, payload.bytes.len());
        out.extend(payload.word.to_le_bytes());
        out.extend(if payload.bytes.is_empty() { 0 } else { checksum(&[&payload.bytes]) }.to_le_bytes());
        offset += payload.bytes.len() as u64;
    }
    out.resize(length, 0);
    if length as u64 > MAX_HEADER {
        return Err(Error::invalid(
            "bundle header",
            format!("{length} bytes; at most {MAX_HEADER} are possible"),
        ));
    }
    // The fixed part comes last: lengths, then the checksum over everything but itself.
    out[..8].copy_from_slice(&MAGIC);
    out[8..12].copy_from_slice(&VERSION.to_le_bytes());
    out[12..16].copy_from_slice(&(length as u32).to_le_bytes());
    out[16..24].copy_from_slice(&offset.to_le_bytes());
    let sum = checksum(&[&out[..24], &out[FIXED..]]);
    out[24..32].copy_from_slice(&sum.to_le_bytes());
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
        let what = format!("bundle version {version}; this program reads version {VERSION}");
        return Err(Error::unsupported(name, what));
    }
    let length = u64::from(cursor.u32("header length")?);
    let total = u64::from_le_bytes(cursor.array("file length")?);
    if total != file_bytes {
        return Err(Error::invalid(name, format!("has {file_bytes} bytes; its header says {total}")));
    }
    if length < FIXED as u64 || length > file_bytes.min(MAX_HEADER) || !length.is_multiple_of(ALIGN as u64) {
        return Err(Error::invalid(name, format!("header of {length} bytes in a file of {file_bytes}")));
    }
    Ok(length as usize)
}

/// Parses a whole header. `bytes` passed [`check_start`] and are as long as it says.
pub(super) fn decode(bytes: &[u8], file_bytes: u64, name: &str) -> Result<(Header, Vec<Entry>)> {
    let wrong = |what: String| Error::invalid(name, what);
    let mut cursor = Cursor { bytes, at: 24, name };
    let expected = u64::from_le_bytes(cursor.array("checksum")?);
    let found = checksum(&[&bytes[..24], &bytes[FIXED..]]);
    if found != expected {
        return Err(wrong(format!("header checksum {found:016x}; the file says {expected:016x}")));
    }
    let [stored, border] = [cursor.u32("stored side")? as usize, cursor.u32("border")? as usize];
    if (stored, border) != (STORED, BORDER) {
        let what = format!(
            "tiles of {stored} texels with borders of {border}; this program reads {STORED} and {BORDER}"
        );
        return Err(Error::unsupported(name, what));
    }
    let coding = match cursor.u32("coding")? {
        0 => Coding::Standard,
        1 => Coding::Paper,
        other => return Err(Error::unsupported(name, format!("coding {other}; this program reads 0 and 1"))),
    };
    let sets = cursor.count("sets", 8)?;
    let pages = cursor.count("pages", 8)?;
    let groups = cursor.count("groups", 8)?;
    let (scene, info) = (cursor.text("scene")?, cursor.text("info")?);
    cursor.has(pages, 8, "pages")?;
    let mut grids = Vec::with_capacity(pages);
    for _ in 0..pages {
        let (width, height) = (cursor.u32("page width")? as usize, cursor.u32("page height")? as usize);
        grids.push(Grid { width, height });
    }
    let hours = cursor.doubles(sets, "hours")?;
    let mut timeline = Timeline { hours, intervals: Vec::new(), states: Vec::new(), coding };
    // Each group takes at least a byte per set, so the table of states is no longer than the header.
    cursor.has(groups, 8 + sets, "groups")?;
    timeline.states = vec![Vec::with_capacity(groups); sets];
    let mut names = Vec::with_capacity(groups);
    for _ in 0..groups {
        names.push(cursor.text("group name")?);
        let intervals = cursor.u32("intervals")? as usize;
        cursor.has(intervals, 16, "intervals")?;
        timeline.intervals.push(cursor.doubles(2 * intervals, "intervals")?.as_chunks::<2>().0.to_vec());
        for state in &mut timeline.states {
            match cursor.array::<1>("state")? {
                [flag @ (0 | 1)] => state.push(flag == 1),
                [flag] => {
                    return Err(wrong(format!("byte {}: state {flag}; expected 0 or 1", cursor.at - 1)));
                }
            }
        }
    }
    let header = Header { scene, info, pages: grids, groups: names, timeline };
    check(&header).map_err(wrong)?;
    let index = decode_index(&mut cursor, &header, file_bytes)?;
    if cursor.bytes.len() - cursor.at >= ALIGN || cursor.bytes[cursor.at..].iter().any(|&byte| byte != 0) {
        return Err(wrong(format!(
            "byte {}: only zeros up to the next multiple of {ALIGN} may follow the index",
            cursor.at
        )));
    }
    Ok((header, index))
}

/// The index: payloads lie one after another, each empty or of a length that its tile's contents can have, and end with the file.
fn decode_index(cursor: &mut Cursor, header: &Header, file_bytes: u64) -> Result<Vec<Entry>> {
    cursor.has(header.tiles(), ENTRY, "tiles")?;
    let mut index = Vec::with_capacity(header.tiles());
    let mut end = cursor.bytes.len() as u64;
    for place in header.places() {
        let (at, name) = (cursor.at, cursor.name);
        let wrong =
            |what: String| Error::invalid(name, format!("byte {at}, index line of {place:?}: {what}"));
        let offset = u64::from_le_bytes(cursor.array("offset")?);
        let (length, word) = (cursor.u32("length")?, cursor.u32("contents")?);
        let sum = u64::from_le_bytes(cursor.array("checksum")?);
        if offset != end {
            return Err(wrong(format!("offset {offset}; expected {end}")));
        }
        if length == 0 && sum != 0 {
            return Err(wrong("a checksum of a tile of length 0".to_owned()));
        }
        header.contents(place, word, length as usize).map_err(wrong)?;
        end += u64::from(length);
        index.push(Entry { offset, length, word, checksum: sum });
    }
    if end != file_bytes {
        return Err(Error::invalid(cursor.name, format!("payloads end at byte {end} of {file_bytes}")));
    }
    Ok(index)
}

/// The number FORMAT.md gives a coding.
fn coding_number(coding: Coding) -> usize {
    match coding {
        Coding::Standard => 0,
        Coding::Paper => 1,
    }
}

/// The rules on values, the same for writing and reading.
fn check(header: &Header) -> Result<(), String> {
    let time = &header.timeline;
    if header.pages.is_empty() || time.hours.is_empty() {
        return Err(format!(
            "{} pages and {} sets; expected at least one",
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
    let shaped = time.intervals.len() == header.groups.len()
        && time.states.len() == time.hours.len()
        && time.states.iter().all(|state| state.len() == header.groups.len());
    if shaped { Ok(()) } else { Err("groups, intervals and states that differ in number".to_owned()) }
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
            Error::invalid(self.name, format!("byte {}: {n} bytes of {what} expected, {left} left", self.at))
        })?;
        self.at += n;
        Ok(part)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    fn u32(&mut self, what: &str) -> Result<u32> {
        self.array(what).map(u32::from_le_bytes)
    }

    /// That `n` things of at least `each` bytes can still follow: checked before anything is allocated for them.
    fn has(&self, n: usize, each: usize, what: &str) -> Result<()> {
        let left = self.bytes.len() - self.at;
        if n <= left / each {
            return Ok(());
        }
        Err(Error::invalid(self.name, format!("byte {}: {n} {what} announced, {left} bytes left", self.at)))
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

    fn doubles(&mut self, n: usize, what: &str) -> Result<Vec<f64>> {
        self.has(n, 8, what)?;
        (0..n).map(|_| self.array(what).map(f64::from_le_bytes)).collect()
    }
}
