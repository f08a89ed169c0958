//! The crate's error type.

use dataset::Error;

/// Converts an error of the decoding crate: `Bundle::open(path).map_err(of_bundle)`.
pub fn of_bundle(error: ndgi::Error) -> Error {
    match error {
        ndgi::Error::Invalid { place, what } => Error::Invalid { place, what },
        ndgi::Error::Unsupported { place, what } => Error::Unsupported { place, what },
        ndgi::Error::Io { path, source } => Error::Io { path, source },
    }
}
