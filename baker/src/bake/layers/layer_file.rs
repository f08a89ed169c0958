//! The files of layers: records of texels, one after the other, and a checksum. Written under temporary
//! names, read as a whole or here and there.

use crate::bake::store::{StoredValue, Value};
use crate::{Error, Result};
use bytemuck::Pod;
use dataset::host::ReadExactAt;
use std::fs::File;
use std::io::{Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Bytes of the checksum that layers and texels end in.
pub(crate) const CHECKSUM: usize = 32;

/// A layer's file, opened for reading some of its texels.
pub struct Source {
    path: PathBuf,
    file: File,
    texels: usize,
}

impl Source {
    /// The values at some of the texels, by their positions among all; no others are read.
    pub fn read_at(&self, positions: &[usize]) -> Result<Vec<Value>> {
        Ok(self.records::<StoredValue>(positions)?.iter().map(StoredValue::value).collect())
    }

    /// Opens a file of such records.
    pub fn open<T>(path: PathBuf) -> Result<Self> {
        let file = File::open(&path).map_err(Error::io(&path))?;
        let length = file.metadata().map_err(Error::io(&path))?.len() as usize;
        let values = length.saturating_sub(CHECKSUM);
        if !values.is_multiple_of(size_of::<T>()) {
            return Err(Error::invalid(
                path.display(),
                "cut short: expected whole texels (--force bakes anew)",
            ));
        }
        let texels = values / size_of::<T>();
        Ok(Source { path, file, texels })
    }

    /// Texels that it holds.
    pub fn texels(&self) -> usize {
        self.texels
    }

    /// The records of texels that stand together.
    pub fn run<T: Pod>(&self, positions: Range<usize>) -> Result<Vec<T>> {
        let mut records = vec![T::zeroed(); positions.len()];
        self.fill(positions, &mut records)?;
        Ok(records)
    }

    /// Reads records that stand together.
    fn fill<T: Pod>(&self, positions: Range<usize>, records: &mut [T]) -> Result<()> {
        if positions.end > self.texels {
            let what = format!("holds {} texels, not number {}", self.texels, positions.end - 1);
            return Err(Error::invalid(self.path.display(), what));
        }
        let at = (positions.start * size_of::<T>()) as u64;
        self.file.read_exact_at(bytemuck::cast_slice_mut(records), at).map_err(Error::io(&self.path))
    }

    /// The records of some of the texels, by their positions among all.
    pub fn records<T: Pod>(&self, positions: &[usize]) -> Result<Vec<T>> {
        let mut records = vec![T::zeroed(); positions.len()];
        let mut done = 0;
        // (What stands together is read at once.)
        for run in positions.chunk_by(|a, b| *b == *a + 1) {
            self.fill(run[0]..run[run.len() - 1] + 1, &mut records[done..done + run.len()])?;
            done += run.len();
        }
        Ok(records)
    }
}

/// The name of a file of the folder.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// A file that is written under a temporary name.
pub struct Partial {
    path: PathBuf,
    temporary: PathBuf,
    file: std::io::BufWriter<File>,
    hash: blake3::Hasher,
}

impl Partial {
    /// Begins the file that is to be called so.
    pub fn create(path: PathBuf) -> Result<Self> {
        let temporary = dataset::host::files::temporary_beside(&path)?;
        let file = File::create(&temporary).map_err(Error::io(&path))?;
        let hash = hasher(&path);
        Ok(Partial { path, temporary, file: std::io::BufWriter::new(file), hash })
    }

    /// Appends bytes.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.hash.update(bytes);
        self.file.write_all(bytes).map_err(Error::io(&self.path))
    }

    /// Appends the checksum.
    pub fn seal(mut self) -> Result<Self> {
        let checksum = self.hash.finalize();
        self.write(checksum.as_bytes())?;
        Ok(self)
    }

    /// Makes it durable; its temporary name, and the one it is to get.
    pub fn finish(self) -> Result<(String, String)> {
        let file = self.file.into_inner().map_err(|e| Error::io(&self.path)(e.into_error()))?;
        file.sync_all().map_err(Error::io(&self.path))?;
        Ok((file_name(&self.temporary), file_name(&self.path)))
    }
}

/// The beginning of a file's checksum.
fn hasher(path: &Path) -> blake3::Hasher {
    let mut hash = blake3::Hasher::new();
    hash.update(file_name(path).as_bytes());
    hash
}

/// Whether the file that is to be called `path`, and is at `current_path` now, is there and undamaged.
pub(super) fn is_whole(path: &Path, current_path: &Path) -> bool {
    read_checked(path, current_path, |_| ()).is_some()
}

/// The records before the checksum of the file that is to be called `path`, and is at `current_path` now;
/// `None` where it is damaged or missing, or holds no whole number of them.
pub(super) fn records<T: Pod>(path: &Path, current_path: &Path) -> Option<Vec<T>> {
    let length = std::fs::metadata(current_path).ok()?.len().checked_sub(CHECKSUM as u64)? as usize;
    if !length.is_multiple_of(size_of::<T>()) {
        return None;
    }
    let mut records = vec![T::zeroed(); length / size_of::<T>()];
    let mut rest: &mut [u8] = bytemuck::cast_slice_mut(&mut records);
    read_checked(path, current_path, |bytes| {
        // (A file that has grown meanwhile fails by its checksum.)
        let (part, after) = std::mem::take(&mut rest).split_at_mut_checked(bytes.len()).unwrap_or_default();
        part.copy_from_slice(&bytes[..part.len()]);
        rest = after;
    })?;
    rest.is_empty().then_some(records)
}

/// Gives what stands before a file's checksum piece by piece; `None` where it is not what was written.
fn read_checked(path: &Path, current_path: &Path, mut each: impl FnMut(&[u8])) -> Option<()> {
    /// Bytes at once; no less than a checksum.
    const AT_ONCE: usize = 1 << 20;
    let mut file = File::open(current_path).ok()?;
    let mut left = file.metadata().ok()?.len().checked_sub(CHECKSUM as u64)?;
    let (mut hash, mut bytes) = (hasher(path), vec![0; AT_ONCE]);
    while left > 0 {
        let piece = &mut bytes[..left.min(AT_ONCE as u64) as usize];
        file.read_exact(piece).ok()?;
        hash.update(piece);
        each(piece);
        left -= piece.len() as u64;
    }
    let mut checksum = [0; CHECKSUM];
    file.read_exact(&mut checksum).ok()?;
    (hash.finalize() == checksum).then_some(())
}
