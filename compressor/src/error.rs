//! One error type for all that this crate does.

use dataset::Error;

/// An error of the decoding crate as one of this: `Bundle::open(path).map_err(of_bundle)`.
pub fn of_bundle(error: ndgi::Error) -> Error {
    match error {
        ndgi::Error::Invalid { place, what } => Error::Invalid { place, what },
        ndgi::Error::Unsupported { place, what } => Error::Unsupported { place, what },
        ndgi::Error::Io { path, source } => Error::Io { path, source },
    }
}
