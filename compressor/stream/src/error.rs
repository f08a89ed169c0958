//! Errors of this crate.

use std::fmt;

/// An error of this crate.
#[derive(Debug)]
pub enum Error {
    /// A bundle is damaged or unreadable, or lacks what was requested.
    Bundle(ndgi::Error),
    /// The bundles are not levels of one scene, or the budgets are too small to show anything.
    Invalid(String),
    /// The device does not support the request.
    Device(String),
}

/// A result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Bundle(error) => write!(f, "{error}"),
            Error::Invalid(what) | Error::Device(what) => write!(f, "{what}"),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Bundle(error) => Some(error),
            Error::Invalid(_) | Error::Device(_) => None,
        }
    }
}

impl From<ndgi::Error> for Error {
    fn from(error: ndgi::Error) -> Self {
        Error::Bundle(error)
    }
}

#[cfg(feature = "gpu")]
impl From<ndgi_gpu::Error> for Error {
    fn from(error: ndgi_gpu::Error) -> Self {
        match error {
            ndgi_gpu::Error::Bundle(error) => Error::Bundle(error),
            ndgi_gpu::Error::Invalid(what) => Error::Invalid(what),
            error => Error::Device(error.to_string()),
        }
    }
}
