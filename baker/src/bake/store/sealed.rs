//! Files of the work in progress that can be told to be whole: a header with the length and the checksum of
//! what follows.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `TLMSEAL1`: name and version of this layout |
//! | 8 | length of the payload, little-endian |
//! | 32 | BLAKE3 of the label's length, the label and the payload |
//!
//! The label says what the payload is of (which work, which file of it); it is not stored. A file that was
//! cut short, damaged, or copied from other work therefore does not fit.

use dataset::host::files;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;

const MAGIC: &[u8; 8] = b"TLMSEAL1";
/// Bytes of the header.
const HEADER: usize = 8 + 8 + 32;

/// The header of a payload that is made of these parts.
fn header(label: &str, parts: &[&[u8]]) -> [u8; HEADER] {
    let mut hash = blake3::Hasher::new();
    hash.update(&(label.len() as u64).to_le_bytes()).update(label.as_bytes());
    parts.iter().for_each(|part| {
        hash.update(part);
    });
    let length: usize = parts.iter().map(|part| part.len()).sum();
    let mut header = [0; HEADER];
    header[..8].copy_from_slice(MAGIC);
    header[8..16].copy_from_slice(&(length as u64).to_le_bytes());
    header[16..].copy_from_slice(hash.finalize().as_bytes());
    header
}

/// What [`write`] writes: header and payload.
fn write_to(out: &mut impl Write, label: &str, parts: &[&[u8]]) -> io::Result<()> {
    out.write_all(&header(label, parts))?;
    parts.iter().try_for_each(|part| out.write_all(part))
}

/// Writes a payload, durably: it survives a power failure once this returns.
pub(crate) fn write(path: &Path, label: &str, parts: &[&[u8]]) -> crate::Result<()> {
    files::write_atomically_with(path, |file| write_to(file, label, parts))
}

/// As [`write()`], but durable only once the file and its folder are synced.
pub(crate) fn write_unsynced(path: &Path, label: &str, parts: &[&[u8]]) -> crate::Result<()> {
    files::write_unsynced_with(path, |file| write_to(file, label, parts))
}

/// The payload of a file's bytes; `None` where it is not whole, or has another label.
pub(crate) fn payload<'a>(label: &str, bytes: &'a [u8]) -> Option<&'a [u8]> {
    let (found, payload) = bytes.split_at_checked(HEADER)?;
    (found == header(label, &[payload])).then_some(payload)
}

/// The payload of a file; `None` where it is missing or is not whole. A file of another length than its
/// header says is not read.
pub(crate) fn read(path: &Path, label: &str) -> Option<Vec<u8>> {
    let found = fs::metadata(path).ok().filter(fs::Metadata::is_file)?.len();
    let mut header = [0; HEADER];
    let mut file = File::open(path).ok()?;
    file.read_exact(&mut header).ok()?;
    let (start, length) = header[..16].split_at(8);
    if start != MAGIC || length != found.checked_sub(HEADER as u64)?.to_le_bytes() {
        return None;
    }
    let mut bytes = header.to_vec();
    file.read_to_end(&mut bytes).ok()?;
    payload(label, &bytes)?;
    bytes.drain(..HEADER);
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_torn_damaged_or_of_another_label_is_not_believed() {
        let mut bytes = Vec::new();
        write_to(&mut bytes, "work/block-1", &[b"some ", b"light"]).unwrap();
        assert_eq!(payload("work/block-1", &bytes), Some(&b"some light"[..]));
        assert_eq!(payload("work/block-2", &bytes), None);
        assert_eq!(payload("work/block-", &bytes), None);
        for i in 0..bytes.len() {
            assert_eq!(payload("work/block-1", &bytes[..i]), None, "cut at {i}");
            let mut damaged = bytes.clone();
            damaged[i] ^= 1;
            assert_eq!(payload("work/block-1", &damaged), None, "bit of byte {i}");
        }
        bytes.push(0);
        assert_eq!(payload("work/block-1", &bytes), None);
    }
}
