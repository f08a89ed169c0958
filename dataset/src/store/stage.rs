//! Files of a dataset that are too large to be held in memory: written first, named by their content after.

use super::{DATA, HASH_DIGITS, Writer, content_hash, plain_stem};
use crate::digest::Digest;
use crate::format::FileRef;
use crate::host::files;
use crate::{Error, Result, image};
use std::fs::{self, File};
use std::io::{BufWriter, Seek};
use std::path::{Path, PathBuf};

/// A file that is written but has no name in the dataset yet; dropped, it is removed.
#[derive(Debug)]
pub(crate) struct Staged {
    temporary: PathBuf,
    bytes: u64,
    blake3: Digest,
}

impl Drop for Staged {
    fn drop(&mut self) {
        // Gone if it was renamed.
        let _ = fs::remove_file(&self.temporary);
    }
}

impl Writer {
    /// Writes a file that [`Writer::adopt`] is to name. Callable from any thread.
    pub(crate) fn stage(
        &self,
        write: impl FnOnce(&Path, &mut BufWriter<&File>) -> Result<()>,
    ) -> Result<Staged> {
        let temporary = files::temporary_beside(&self.root.join(DATA).join("staged"))?;
        let io = || Error::io(&temporary);
        let file = File::options().read(true).write(true).create_new(true).open(&temporary).map_err(io())?;
        // From here on the file goes with the value.
        let mut staged = Staged { temporary: temporary.clone(), bytes: 0, blake3: Digest::of(&[]) };
        let mut out = BufWriter::with_capacity(1 << 16, &file);
        write(&temporary, &mut out)?;
        out.into_inner().map_err(|error| Error::io(&temporary)(error.into_error()))?;
        file.sync_all().map_err(io())?;
        (&file).rewind().map_err(io())?;
        (staged.blake3, staged.bytes) = Digest::read(&file).map_err(io())?;
        Ok(staged)
    }

    /// Adds an EXR file as [`Writer::add`] does. Neither its image nor its bytes need be in memory:
    /// `fill(y, row)` writes the texels of row y, from the top to the bottom.
    ///
    /// # Errors
    /// `Io`; an error of `fill`, which ends the writing.
    ///
    /// # Panics
    /// If the image has no texels.
    pub fn add_exr(
        &mut self,
        stem: &str,
        size: (usize, usize),
        fill: impl FnMut(usize, &mut [[f32; 3]]) -> Result<()>,
    ) -> Result<FileRef> {
        let staged = self.stage(|path, out| image::write_exr(path, out, size, fill))?;
        self.adopt(staged, stem, "exr")
    }

    /// Names a staged file as [`Writer::add`] does, or finds that content among what this writer added.
    pub(crate) fn adopt(&mut self, staged: Staged, stem: &str, extension: &str) -> Result<FileRef> {
        if let Some(known) = self.added.get(&staged.blake3) {
            return Ok(known.clone());
        }
        let path = format!("{DATA}/{}-{}.{extension}", plain_stem(stem), staged.blake3.first(HASH_DIGITS));
        let on_disk = self.root.join(&path);
        if staged.bytes == 0 || content_hash(&path).is_none() {
            return Err(no_content(&on_disk));
        }
        // A file of that name and content may exist from an earlier run; a damaged one is replaced.
        if !has_digest(&on_disk, &staged) {
            fs::rename(&staged.temporary, &on_disk).map_err(Error::io(&on_disk))?;
            files::sync_folder_of(&on_disk);
        }
        let file = FileRef { path, bytes: staged.bytes, blake3: staged.blake3 };
        self.added.insert(file.blake3, file.clone());
        Ok(file)
    }
}

/// Whether a file has the content of a staged one.
fn has_digest(path: &Path, staged: &Staged) -> bool {
    let is_as_long = fs::metadata(path).is_ok_and(|metadata| metadata.len() == staged.bytes);
    let digest = || Digest::read(File::open(path)?);
    is_as_long && digest().is_ok_and(|(digest, _)| digest == staged.blake3)
}

/// What cannot be a file of a dataset.
pub(super) fn no_content(path: &Path) -> Error {
    Error::invalid(path.display(), "a file of a dataset needs a stem, an extension and content")
}
