//! Reads from a bundle's first bytes which light it was made from (compressor/FORMAT.md, section 1).

use crate::{Error, Result};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

const MAGIC: [u8; 8] = *b"NDGI\r\n\x1a\n";
/// The versions that are known, and where the scene's name begins in each, and after it what wrote the bundle
/// and how.
const TEXTS: [(u32, usize); 2] = [(3, 56), (4, 80)];
/// Longest text that is read.
const MOST_TEXT: u64 = 1 << 20;

/// An error if a bundle says that it was made from other light than that of this digest, and that it is no
/// coarser level of it; bundles that say nothing of it pass.
pub(super) fn expect_light(bundle: &Path, digest: &str) -> Result<()> {
    let torn = |error| Error::invalid(bundle.display(), format!("not a complete bundle: {error}"));
    let mut file = File::open(bundle).map_err(Error::io(bundle))?;
    let mut start = [0; 24];
    file.read_exact(&mut start).map_err(torn)?;
    if start[..8] != MAGIC {
        return Err(Error::invalid(bundle.display(), "not a bundle: its first bytes are not a bundle's"));
    }
    let version = u32::from_le_bytes([start[8], start[9], start[10], start[11]]);
    let Some((_, texts)) = TEXTS.iter().find(|(known, _)| *known == version) else {
        let what = format!("a bundle of version {version}; expected {} or {}", TEXTS[0].0, TEXTS[1].0);
        return Err(Error::unsupported(bundle.display(), what));
    };
    let reported = u64::from_le_bytes(std::array::from_fn(|i| start[16 + i]));
    let length = file.metadata().map_err(Error::io(bundle))?.len();
    if reported != length {
        let what = format!("not a complete bundle: {length} bytes; expected {reported}");
        return Err(Error::invalid(bundle.display(), what));
    }
    file.seek(SeekFrom::Start(*texts as u64)).map_err(torn)?;
    text(&mut file).map_err(torn)?;
    let info = text(&mut file).map_err(torn)?;
    let info: serde_json::Value = serde_json::from_slice(&info).unwrap_or_default();
    match info["inputs"].as_str() {
        Some(inputs) if inputs != digest && info["level_of"] != digest => Err(Error::invalid(
            bundle.display(),
            "made from different light than the dataset's; run `compress` on this dataset again",
        )),
        _ => Ok(()),
    }
}

/// A length and as many bytes.
fn text(file: &mut File) -> std::io::Result<Vec<u8>> {
    let mut length = [0; 4];
    file.read_exact(&mut length)?;
    let length = u64::from(u32::from_le_bytes(length));
    if length > MOST_TEXT {
        return Err(std::io::Error::other(format!("a text of {length} bytes; expected up to {MOST_TEXT}")));
    }
    let mut text = vec![0; length as usize];
    file.read_exact(&mut text)?;
    Ok(text)
}
