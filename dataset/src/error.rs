//! The one error type of the three crates: what was wrong, and where.

use crate::signals;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// A result whose error names the place.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong with input or output. Libraries return it; the binaries print the chain and exit with [`Error::exit_code`].
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
    /// Nothing is wrong with the input: another process works there, or others have not finished their part. The same command can succeed later.
    #[error("{place}: {what}")]
    Unready {
        /// The folder or file.
        place: String,
        /// What is in the way or missing, and what to do.
        what: String,
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

    /// An [`Error::Unready`].
    pub fn unready(place: impl ToString, what: impl ToString) -> Self {
        Error::Unready { place: place.to_string(), what: what.to_string() }
    }

    /// Wraps an I/O error with its path: `fs::read(p).map_err(Error::io(p))`.
    pub fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Error::Io { path: path.to_owned(), source }
    }

    /// The exit code of a command that failed so: [`TRY_AGAIN`] where the same command can succeed later (a busy folder, parts that are
    /// missing, a full disk, a file server that is away), 1 where it cannot, 128 + the signal's number where one ended it.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Invalid { .. } | Error::Unsupported { .. } => 1,
            Error::Unready { .. } => TRY_AGAIN,
            Error::Io { source, .. } if passes(source) => TRY_AGAIN,
            Error::Io { .. } => 1,
            Error::Interrupted => signals::exit_code(),
        }
    }
}

/// `EX_TEMPFAIL` of sysexits.h: what schedulers are told to run again.
pub const TRY_AGAIN: u8 = 75;

/// Whether an error of the system may go away without a change of the command.
fn passes(error: &io::Error) -> bool {
    let of_kind = matches!(
        error.kind(),
        ErrorKind::StorageFull
            | ErrorKind::QuotaExceeded
            | ErrorKind::StaleNetworkFileHandle
            | ErrorKind::TimedOut
            | ErrorKind::ResourceBusy
            | ErrorKind::OutOfMemory
    );
    // (EIO, which has no kind, is what file servers answer in trouble.)
    of_kind || error.raw_os_error() == Some(5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_may_pass_is_to_be_tried_again() {
        let of_system = |code| Error::io(Path::new("a"))(io::Error::from_raw_os_error(code)).exit_code();
        // ENOSPC, EDQUOT, ESTALE, EIO; ENOENT, EACCES.
        assert_eq!([28, 122, 116, 5].map(of_system), [TRY_AGAIN; 4]);
        assert_eq!([2, 13].map(of_system), [1; 2]);
        assert_eq!(
            (Error::unready("a", "b").exit_code(), Error::invalid("a", "b").exit_code()),
            (TRY_AGAIN, 1)
        );
    }
}
