//! The error type of all three crates: what is wrong, and where.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// A result of this crate; its error says where.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An error of input or output. Libraries return it; the binaries print its chain and exit with
/// [`Error::exit_code`].
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The input is invalid: a bad value, a truncated file, a wrong checksum.
    #[error("{place}: {what}")]
    Invalid {
        /// Where: `file`, `file:line`, or `file, texel (x, y)`.
        place: String,
        /// What was found and what was expected.
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
    /// The operating system reported an error.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The input is valid, but another process is using it or has not finished its part. The same command can
    /// succeed later.
    #[error("{place}: {what}")]
    Unready {
        /// The folder or file.
        place: String,
        /// What blocks it or is missing, and what to do.
        what: String,
    },
    /// The process was asked to stop (Ctrl-C, a termination request). Bakes and compressions keep finished
    /// work.
    #[error("interrupted; run the same command again to continue")]
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

    /// Wraps a syntax or type error of a JSON file with its line.
    pub(crate) fn json(path: &Path) -> impl FnOnce(serde_json::Error) -> Self + '_ {
        move |error| match error.line() {
            0 => Error::invalid(path.display(), error),
            line => {
                let text = error.to_string();
                // The place names the line already.
                let what = text.rsplit_once(" at line ").map_or(text.as_str(), |(what, _)| what);
                Error::invalid(format!("{}:{line}", path.display()), what)
            }
        }
    }

    /// The exit code of a command that failed with this error: [`TRY_AGAIN`] if the same command can succeed
    /// later (a busy folder, missing parts, a full disk, an unavailable file server), 1 if it cannot, 130 if
    /// it was interrupted (a command tells by which signal: [`crate::host::signals::exit_code`]).
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Invalid { .. } | Error::Unsupported { .. } => 1,
            Error::Unready { .. } => TRY_AGAIN,
            Error::Io { source, .. } if passes(source) => TRY_AGAIN,
            Error::Io { .. } => 1,
            Error::Interrupted => INTERRUPTED,
        }
    }
}

/// Converts an error of the decoding crate: `Bundle::open(path).map_err(of_bundle)`.
pub fn of_bundle(error: ndgi::Error) -> Error {
    match error {
        ndgi::Error::Invalid { place, what } => Error::Invalid { place, what },
        ndgi::Error::Unsupported { place, what } => Error::Unsupported { place, what },
        ndgi::Error::Io { path, source } => Error::Io { path, source },
    }
}

/// Exit code `EX_TEMPFAIL` of sysexits.h: schedulers can be set to rerun such jobs.
pub const TRY_AGAIN: u8 = 75;
/// Exit code of an interrupted job: 128 + SIGINT, as of shells.
const INTERRUPTED: u8 = 130;

/// True if a system error can go away without changing the command.
fn passes(error: &io::Error) -> bool {
    let of_kind = matches!(
        error.kind(),
        ErrorKind::StorageFull
            | ErrorKind::QuotaExceeded
            | ErrorKind::StaleNetworkFileHandle
            | ErrorKind::TimedOut
            | ErrorKind::ResourceBusy
            | ErrorKind::OutOfMemory
            | ErrorKind::WouldBlock
            | ErrorKind::NotConnected
            | ErrorKind::ConnectionReset
            | ErrorKind::ConnectionAborted
            | ErrorKind::ConnectionRefused
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::NetworkDown
    );
    // Without a kind: EIO, which file servers in trouble return; ENFILE and EMFILE; ENOLCK, ESHUTDOWN and
    // EHOSTDOWN.
    let of_code: &[i32] = if cfg!(target_os = "linux") { &[5, 23, 24, 37, 108, 112] } else { &[5] };
    of_kind || error.raw_os_error().is_some_and(|code| of_code.contains(&code))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_temporary_errors_ask_for_a_retry() {
        let of_system = |code| Error::io(Path::new("a"))(io::Error::from_raw_os_error(code)).exit_code();
        // ENOSPC, EDQUOT, ESTALE, EIO; ENOENT, EACCES.
        assert_eq!([28, 122, 116, 5].map(of_system), [TRY_AGAIN; 4]);
        // EAGAIN, ENFILE, EMFILE, ENOLCK, ENETDOWN, ENETUNREACH, ECONNRESET, ENOTCONN, ESHUTDOWN, ETIMEDOUT,
        // ECONNREFUSED, EHOSTDOWN, EHOSTUNREACH.
        let of_network = [11, 23, 24, 37, 100, 101, 104, 107, 108, 110, 111, 112, 113];
        if cfg!(target_os = "linux") {
            assert_eq!(of_network.map(of_system), [TRY_AGAIN; 13]);
        }
        assert_eq!([2, 13].map(of_system), [1; 2]);
        assert_eq!(
            (Error::unready("a", "b").exit_code(), Error::invalid("a", "b").exit_code()),
            (TRY_AGAIN, 1)
        );
    }
}
