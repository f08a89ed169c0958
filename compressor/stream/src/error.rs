//! What can go wrong.

use std::fmt;

/// What can go wrong.
#[derive(Debug)]
pub enum Error {
    /// A bundle is damaged or unreadable, or does not hold what was asked for.
    Bundle(ndgi::Error),
    /// The bundles are not levels of one scene, or nothing can be shown under the budgets.
    Invalid(String),
    /// The device cannot do what was asked for.
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
