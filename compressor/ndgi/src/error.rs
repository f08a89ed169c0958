//! The error type: what is wrong, and where.

use std::fmt;
#[cfg(feature = "file")]
use std::path::Path;
use std::path::PathBuf;

/// A result of this crate; its error says where.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An error when reading a bundle.
#[derive(Debug)]
pub enum Error {
    /// A bundle violates its format, or lacks what was requested.
    Invalid {
        /// Where: a file, a page, a tile.
        place: String,
        /// What was found and what was expected.
        what: String,
    },
    /// A bundle of another version, or one that needs more memory than this machine has.
    Unsupported {
        /// Where, as in [`Error::Invalid`].
        place: String,
        /// What is not supported.
        what: String,
    },
    /// The operating system reported an error.
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Invalid { place, what } | Error::Unsupported { place, what } => {
                write!(f, "{place}: {what}")
            }
            Error::Io { path, source } => write!(f, "{}: {source}", path.display()),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Io { source, .. } => Some(source),
            Error::Invalid { .. } | Error::Unsupported { .. } => None,
        }
    }
}

impl Error {
    pub(crate) fn invalid(place: impl ToString, what: impl ToString) -> Self {
        Error::Invalid { place: place.to_string(), what: what.to_string() }
    }

    pub(crate) fn unsupported(place: impl ToString, what: impl ToString) -> Self {
        Error::Unsupported { place: place.to_string(), what: what.to_string() }
    }

    #[cfg(feature = "file")]
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Error::Io { path: path.to_owned(), source }
    }
}
