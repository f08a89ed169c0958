//! The error type: what was wrong, and where.

use std::path::{Path, PathBuf};

/// A result whose error names the place.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong when a bundle is read.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A bundle breaks a rule of its format, or something is asked for that it does not have.
    #[error("{place}: {what}")]
    Invalid {
        /// Where: a file, a page, a tile.
        place: String,
        /// What stands there and what was expected.
        what: String,
    },
    /// A bundle of another version, or more than this machine holds.
    #[error("{place}: {what}")]
    Unsupported {
        /// Where, as in [`Error::Invalid`].
        place: String,
        /// What is not supported.
        what: String,
    },
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Error {
    pub(crate) fn invalid(place: impl ToString, what: impl ToString) -> Self {
        Error::Invalid { place: place.to_string(), what: what.to_string() }
    }

    pub(crate) fn unsupported(place: impl ToString, what: impl ToString) -> Self {
        Error::Unsupported { place: place.to_string(), what: what.to_string() }
    }

    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Error::Io { path: path.to_owned(), source }
    }
}
