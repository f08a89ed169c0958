//! The one error type of the three crates: what was wrong, and where.

use std::path::{Path, PathBuf};

/// A result whose error names the place.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong with input or output. Libraries return it; the binaries print the chain and exit with 1.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The input breaks a rule: a bad value, a torn file, a checksum that differs.
    #[error("{place}: {what}")]
    Invalid {
        /// Where: `file`, `file:line`, or `file, texel (x, y)`.
        place: String,
        /// What stands there and what was expected.
        what: String,
    },
    /// The input is well-formed, but this version does not handle it.
    #[error("{place}: {what}")]
    Unsupported {
        /// Where, as in [`Error::Invalid`].
        place: String,
        /// What is not supported, and what to do instead.
        what: String,
    },
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The process was asked to stop (Ctrl-C, a termination request). Bakes and compressions keep what was finished.
    #[error("interrupted; run the same command again to go on")]
    Interrupted,
}

impl Error {
    /// An [`Error::Invalid`].
    pub fn invalid(place: impl ToString, what: impl ToString) -> Self {
        Error::Invalid { place: place.to_string(), what: what.to_string() }
    }

    /// An [`Error::Unsupported`].
    pub fn unsupported(place: impl ToString, what: impl ToString) -> Self {
        Error::Unsupported { place: place.to_string(), what: what.to_string() }
    }

    /// Wraps an I/O error with its path: `fs::read(p).map_err(Error::io(p))`.
    pub fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Error::Io { path: path.to_owned(), source }
    }
}
