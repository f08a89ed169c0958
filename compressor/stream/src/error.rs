//! What can go wrong.

use std::fmt;

/// What can go wrong.
#[derive(Debug)]
pub enum Error {
    /// A bundle is damaged, or what was asked for is not in it.
    Bundle(ndgi::Error),
    /// Bundles that are no levels of one scene, or budgets under which nothing can be shown.
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
