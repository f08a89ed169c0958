//! The one way to a file's content: it is compared with the manifest's checksum first.

use super::{Dataset, MANIFEST, ROWS, check, refuse_light};
use crate::digest::Digest;
use crate::format::FileRef;
use crate::host::signals::stop_if_interrupted;
use crate::image::{self, Mask};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Which files were found to be what the manifest says. Copies of a dataset share it.
#[derive(Clone, Debug, Default)]
pub(super) struct Known(Arc<Mutex<BTreeMap<FileRef, Arc<Mutex<bool>>>>>);

impl Known {
    /// Runs `verify` unless it succeeded for this file before. Threads that ask for one file at the same time
    /// wait for the first of them.
    fn once(&self, file: &FileRef, verify: impl FnOnce() -> Result<()>) -> Result<()> {
        let entry = {
            let mut files = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            match files.get(file) {
                Some(entry) => Arc::clone(entry),
                None => Arc::clone(files.entry(file.clone()).or_default()),
            }
        };
        let mut is_verified = entry.lock().unwrap_or_else(PoisonError::into_inner);
        if !*is_verified {
            verify()?;
            *is_verified = true;
        }
        Ok(())
    }
}

impl Dataset {
    /// The path of a file that has the length and checksum of the manifest. Each file is read for this once,
    /// whatever the number of calls.
    ///
    /// # Errors
    /// [`Error::Invalid`] for other content, [`Error::Io`].
    pub fn verified(&self, file: &FileRef) -> Result<PathBuf> {
        let path = self.path(file);
        self.known.once(file, || {
            check::length(&self.root, file)?;
            let opened = File::open(&path).map_err(Error::io(&path))?;
            let (found, _) = Digest::read(opened).map_err(Error::io(&path))?;
            if found != file.blake3 {
                let (found, expected) = (found.first(16), file.blake3.first(16));
                let what = format!("checksum {found}…; {MANIFEST} says {expected}…: the content changed");
                return Err(Error::invalid(path.display(), what));
            }
            Ok(())
        })?;
        Ok(path)
    }

    /// The bytes of a file, verified as by [`Dataset::verified`].
    ///
    /// # Errors
    /// Those of [`Dataset::verified`].
    pub fn read(&self, file: &FileRef) -> Result<Vec<u8>> {
        let path = self.verified(file)?;
        fs::read(&path).map_err(Error::io(&path))
    }

    /// The path of a page's image, verified. The error for a damaged one names the first texel that is wrong,
    /// or what its decoder says, if that says more.
    pub(super) fn verified_image(&self, file: &FileRef, page: usize) -> Result<PathBuf> {
        self.verified(file).map_err(|fault| self.explained(file, fault, || self.decode(file, page)))
    }

    /// The path of a page's mask, verified, with an error as of [`Dataset::verified_image`].
    pub(super) fn verified_mask(&self, file: &FileRef) -> Result<PathBuf> {
        let decode = || Mask::read_png(&self.path(file)).map(drop);
        self.verified(file).map_err(|fault| self.explained(file, fault, decode))
    }

    /// The fault of a file with other content than the manifest's, with what its decoder says.
    fn explained(&self, file: &FileRef, fault: Error, decode: impl FnOnce() -> Result<()>) -> Error {
        match (fault, decode()) {
            (_, Err(Error::Interrupted)) => Error::Interrupted,
            (Error::Invalid { what, .. }, Err(Error::Invalid { place, what: decoded })) => {
                Error::invalid(place, format!("{decoded} ({what})"))
            }
            (Error::Invalid { what, .. }, Err(Error::Unsupported { what: decoded, .. })) => {
                Error::invalid(self.path(file).display(), format!("{decoded} ({what})"))
            }
            (fault, _) => fault,
        }
    }

    fn decode(&self, file: &FileRef, page: usize) -> Result<()> {
        let (path, page) = (self.path(file), &self.config.pages[page]);
        let [width, height] = page.size();
        check::size(&path, image::read_exr_size(&path)?, page)?;
        for y in (0..height).step_by(ROWS) {
            stop_if_interrupted()?;
            let texels = image::read_exr_rows(&path, y, (y + ROWS).min(height))?;
            refuse_light(&path, width, y, &texels)?;
        }
        Ok(())
    }
}
