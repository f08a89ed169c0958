//! Files and folders that people name as inputs: what stands there, before it is read.

use crate::{Error, Result};
use std::fs::{self, Metadata};
use std::io::ErrorKind;
use std::path::Path;

/// An error unless a file stands there. `expected` says which one, and who writes it.
///
/// # Errors
/// `Invalid` for a folder or nothing; `Io` where that cannot be told, as of a file server that is away.
pub fn expect_file(path: &Path, expected: &str) -> Result<()> {
    match found(path)? {
        None => Err(Error::invalid(path.display(), format!("no such file; expected {expected}"))),
        Some(there) if there.is_dir() => {
            Err(Error::invalid(path.display(), format!("is a folder; expected {expected}")))
        }
        Some(_) => Ok(()),
    }
}

/// [`expect_file`] for a folder.
///
/// # Errors
/// As there.
pub fn expect_folder(path: &Path, expected: &str) -> Result<()> {
    match found(path)? {
        None => Err(Error::invalid(path.display(), format!("no such folder; expected {expected}"))),
        Some(there) if !there.is_dir() => {
            Err(Error::invalid(path.display(), format!("is not a folder; expected {expected}")))
        }
        Some(_) => Ok(()),
    }
}

/// What stands at a path; `None` if nothing does.
///
/// # Errors
/// `Io` where that cannot be told.
pub fn found(path: &Path) -> Result<Option<Metadata>> {
    match fs::metadata(path) {
        Ok(there) => Ok(Some(there)),
        // (Below a file there is nothing.)
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(error) => Err(Error::io(path)(error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_or_of_another_kind_is_said_with_what_was_expected() {
        let around = tempfile::tempdir().unwrap();
        let [file, folder, none] = ["file", "folder", "none"].map(|name| around.path().join(name));
        fs::write(&file, b"x").unwrap();
        fs::create_dir(&folder).unwrap();
        expect_file(&file, "a").unwrap();
        expect_folder(&folder, "a").unwrap();
        let below = file.join("below");
        for (refused, path, what) in [
            (expect_file(&none, "a picture"), &none, "no such file"),
            (expect_file(&below, "a picture"), &below, "no such file"),
            (expect_file(&folder, "a picture"), &folder, "is a folder"),
            (expect_folder(&none, "a picture"), &none, "no such folder"),
            (expect_folder(&file, "a picture"), &file, "is not a folder"),
        ] {
            let error = refused.unwrap_err();
            assert_eq!(error.to_string(), format!("{}: {what}; expected a picture", path.display()));
            assert_eq!(error.exit_code(), 1);
        }
        // What the system cannot tell is not taken for missing.
        let long = around.path().join("a".repeat(256));
        assert!(matches!(expect_file(&long, "a"), Err(Error::Io { .. })));
    }
}
