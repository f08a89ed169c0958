//! Reads the lightmap pages that a GLB file refers to.

use crate::{Error, Result};
use serde_json::Value;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes of the header, and of a chunk's length and kind.
const HEADER: usize = 12;
const CHUNK: usize = 8;

/// The lightmap pages on which the nodes of a GLB file are placed, one a node.
///
/// # Errors
/// A file that cannot be read, or is no GLB file of version 2.
pub(super) fn pages(path: &Path) -> Result<Vec<u64>> {
    let mut file = File::open(path).map_err(Error::io(path))?;
    let length = file.metadata().map_err(Error::io(path))?.len();
    let refuse = |what: String| Err(Error::invalid(path.display(), what));
    let mut head = [0; HEADER + CHUNK];
    match file.read_exact(&mut head) {
        Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => return Err(Error::io(path)(error)),
        Err(_) => return refuse("is not a GLB file; expected a glTF 2 binary".to_owned()),
        Ok(()) => {}
    }
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    if &head[..4] != b"glTF" || word(4) != 2 {
        return refuse("is not a GLB file; expected a glTF 2 binary".to_owned());
    }
    let (reported, json) = (u64::from(word(8)), u64::from(word(HEADER)));
    if reported > length || json > length {
        return refuse(format!("is cut short: it has {length} bytes of {}", reported.max(json)));
    }
    let mut text = Vec::new();
    file.take(json).read_to_end(&mut text).map_err(Error::io(path))?;
    let Ok(root) = serde_json::from_slice::<Value>(&text) else {
        return refuse("is not a GLB file: its first chunk is not JSON".to_owned());
    };
    let nodes = root["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    Ok(nodes.iter().filter_map(|node| node["extras"]["lightmapPage"].as_u64()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_known_by_its_header_and_says_its_pages() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.glb");
        let reported = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            pages(&path).map_err(|error| error.to_string())
        };
        let json = br#"{"nodes":[{"extras":{"lightmapPage":2}},{"name":"sky"}]}"#;
        let length = (HEADER + CHUNK + json.len()) as u32;
        let words = |words: [u32; 2]| words.map(u32::to_le_bytes).concat();
        let whole =
            [&b"glTF"[..], &words([2, length]), &words([json.len() as u32, 0x4e4f_534a]), json].concat();
        assert_eq!(reported(&whole), Ok(vec![2]));
        for (bytes, what) in [
            (&b"notes"[..], "is not a GLB file"),
            (b"notes that are longer than a header", "is not a GLB file"),
            (&whole[..whole.len() - 1], "is cut short"),
        ] {
            let error = reported(bytes).unwrap_err();
            assert!(error.contains(what) && error.contains("scene.glb"), "{error}");
        }
    }
}
