//! The bytes of a glTF asset: the GLB container, data URIs and files beside it.

use base64::Engine;
use dataset::{Error, Result};
use std::path::Path;

/// What some editors put in front of UTF-8, although JSON forbids it.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Splits a file into its JSON and, if it is a GLB with one, its binary chunk.
pub(super) fn split<'a>(bytes: &'a [u8], place: &str) -> Result<(&'a [u8], Option<&'a [u8]>)> {
    if bytes.is_empty() {
        return Err(Error::invalid(place, "the file is empty: expected glTF"));
    }
    let plain = |json: &'a [u8]| json.strip_prefix(BYTE_ORDER_MARK).unwrap_or(json);
    let bytes = plain(bytes);
    if !bytes.starts_with(b"glTF") {
        if place.to_ascii_lowercase().ends_with(".glb") && !bytes.trim_ascii_start().starts_with(b"{") {
            return Err(Error::invalid(place, "not a GLB: expected it to begin with \"glTF\""));
        }
        return Ok((bytes, None));
    }
    let torn = || Error::invalid(place, "the GLB is torn: its chunks do not fill the length it states");
    let word = |at: usize| -> Result<usize> {
        let bytes = bytes.get(at..at + 4).ok_or_else(torn)?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
    };
    // Header: magic, version, length of the whole.
    if word(4)? != 2 {
        return Err(Error::unsupported(place, format!("GLB version {}: expected 2", word(4)?)));
    }
    let length = word(8)?;
    if length > bytes.len() {
        return Err(torn());
    }
    // Chunks: length, type, data padded to 4 bytes.
    let (mut json, mut binary, mut at) = (None, None, 12);
    while at + 8 <= length {
        let end = at + 8 + word(at)?;
        let data = bytes.get(at + 8..end).filter(|_| end <= length).ok_or_else(torn)?;
        match &bytes[at + 4..at + 8] {
            b"JSON" if json.is_none() => json = Some(data),
            b"BIN\0" if binary.is_none() => binary = Some(data),
            _ => {}
        }
        at = end.next_multiple_of(4);
    }
    Ok((plain(json.ok_or_else(torn)?), binary))
}

/// Reads what a URI names: base64 data, or a file beside the asset.
pub(super) fn read_uri(uri: &str, folder: &Path, place: &str) -> Result<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let encoded = data.split_once(";base64,").map(|(_, encoded)| encoded);
        let encoded = encoded.ok_or_else(|| Error::unsupported(place, "a data URI that is not base64"))?;
        return base64::engine::general_purpose::STANDARD
            .decode(encoded.trim_end())
            .map_err(|e| Error::invalid(place, format!("a data URI is not base64: {e}")));
    }
    if uri.contains("://") {
        return Err(Error::unsupported(place, format!("uri {uri}: expected a file beside the asset")));
    }
    let path = folder.join(percent_decoded(uri));
    std::fs::read(&path).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => Error::invalid(place, format!("there is no file {uri} beside it")),
        _ => Error::invalid(place, format!("uri {uri}: {}: {e}", path.display())),
    })
}

/// Undoes %XX; a % without two hexadecimal digits stays.
fn percent_decoded(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let digit = |j: usize| bytes.get(j).and_then(|&b| (b as char).to_digit(16));
        match (bytes[i], digit(i + 1), digit(i + 2)) {
            (b'%', Some(high), Some(low)) => {
                out.push((high * 16 + low) as u8);
                i += 3;
            }
            (byte, ..) => {
                out.push(byte);
                i += 1;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}
