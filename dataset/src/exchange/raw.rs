//! Raw texels in one file or several equal ones that lie below each other: row by row from the top, no
//! header.

use crate::layout::LIGHT_BYTES;
use crate::observe::count;
use crate::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The byte of a texel on a surface, 127.
const VALID: u8 = 127;
/// The byte of any other texel, −1.
const INVALID: u8 = -1i8 as u8;
/// Bytes of light that are held in memory at once, about.
const BLOCK_BYTES: usize = 4 << 20;

/// Rows that are read or written at once: whole blocks of compressed EXR files, too.
pub(super) fn block_rows(width: usize) -> usize {
    (BLOCK_BYTES / (LIGHT_BYTES * width)).next_multiple_of(32).max(32)
}

/// A lightmap or a mask as raw files.
#[derive(Clone, Debug)]
pub(super) struct Raw {
    /// The files from the top on, of equal size.
    parts: Vec<PathBuf>,
    width: usize,
    height: usize,
    texel_bytes: usize,
}

impl Raw {
    /// Checks that the files hold just this many texels, which is all that the size of what is read later
    /// depends on.
    pub(super) fn open(
        parts: Vec<PathBuf>,
        (width, height): (usize, usize),
        texel_bytes: usize,
    ) -> Result<Self> {
        let rows = height / parts.len();
        let expected = (width * texel_bytes) as u64 * rows as u64;
        for path in &parts {
            let metadata = path.metadata().map_err(Error::io(path))?;
            if !metadata.is_file() {
                return Err(Error::invalid(path.display(), "not a file"));
            }
            if metadata.len() != expected {
                let found = count(metadata.len() as usize, "byte");
                let what =
                    format!("{found}; expected {expected}: {width}×{rows} texels of {texel_bytes} bytes");
                return Err(Error::invalid(path.display(), what));
            }
        }
        Ok(Raw { parts, width, height, texel_bytes })
    }

    /// The file that holds a row.
    pub(super) fn path(&self, y: usize) -> &Path {
        &self.parts[y / (self.height / self.parts.len())]
    }

    /// The bytes of rows `y0 .. y1`.
    fn bytes(&self, y0: usize, y1: usize) -> Result<Vec<u8>> {
        let (line, rows) = (self.width * self.texel_bytes, self.height / self.parts.len());
        let mut bytes = vec![0; (y1 - y0) * line];
        let mut rest = &mut *bytes;
        let mut y = y0;
        while y < y1 {
            let (part, first) = (y / rows, y % rows);
            let end = y1.min((part + 1) * rows);
            let (now, later) = rest.split_at_mut((end - y) * line);
            let path = &self.parts[part];
            let mut file = File::open(path).map_err(Error::io(path))?;
            file.seek(SeekFrom::Start((first * line) as u64)).map_err(Error::io(path))?;
            file.read_exact(now).map_err(Error::io(path))?;
            (rest, y) = (later, end);
        }
        Ok(bytes)
    }

    /// The light of rows `y0 .. y1`; its values are not checked.
    pub(super) fn light(&self, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
        let bytes = self.bytes(y0, y1)?;
        let texel = |texel: &[u8; LIGHT_BYTES]| {
            std::array::from_fn(|c| f32::from_le_bytes([0, 1, 2, 3].map(|byte| texel[4 * c + byte])))
        };
        Ok(bytes.as_chunks::<LIGHT_BYTES>().0.iter().map(texel).collect())
    }

    /// Which texels of rows `y0 .. y1` are valid.
    pub(super) fn valid(&self, y0: usize, y1: usize) -> Result<Vec<bool>> {
        let bytes = self.bytes(y0, y1)?;
        match bytes.iter().position(|&byte| byte != VALID && byte != INVALID) {
            None => Ok(bytes.iter().map(|&byte| byte == VALID).collect()),
            Some(i) => {
                let (x, y) = (i % self.width, y0 + i / self.width);
                let place = format!("{}, texel ({x}, {y})", self.path(y).display());
                Err(Error::invalid(place, format!("mask value {}; expected -1 or 127", bytes[i] as i8)))
            }
        }
    }
}

/// Writes rows to equal files, top to bottom: `rows(y0, y1)` gives the bytes of a block. Returns their total
/// length.
pub(super) fn write(
    parts: &[PathBuf],
    (width, height): (usize, usize),
    mut rows: impl FnMut(usize, usize) -> Result<Vec<u8>>,
) -> Result<u64> {
    let part_rows = height / parts.len();
    let mut total = 0;
    for (part, path) in parts.iter().enumerate() {
        let mut out = BufWriter::new(File::create_new(path).map_err(Error::io(path))?);
        let end = (part + 1) * part_rows;
        for y0 in (part * part_rows..end).step_by(block_rows(width)) {
            crate::host::signals::stop_if_interrupted()?;
            let bytes = rows(y0, (y0 + block_rows(width)).min(end))?;
            total += bytes.len() as u64;
            out.write_all(&bytes).map_err(Error::io(path))?;
        }
        let file = out.into_inner().map_err(|error| Error::io(path)(error.into_error()))?;
        file.sync_all().map_err(Error::io(path))?;
    }
    Ok(total)
}

pub(super) fn light_bytes(texels: &[[f32; 3]]) -> Vec<u8> {
    texels.iter().flatten().flat_map(|value| value.to_le_bytes()).collect()
}

pub(super) fn mask_bytes(valid: &[bool]) -> Vec<u8> {
    valid.iter().map(|&valid| if valid { VALID } else { INVALID }).collect()
}
