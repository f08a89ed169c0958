//! What can go wrong.

use std::fmt;

/// What can go wrong.
#[derive(Debug)]
pub enum Error {
    /// A bundle is damaged, or what was asked for is not in it.
    Bundle(ndgi::Error),
    /// Bundles that are no levels of one scene, or budgets under which nothing can be shown.
    Invalid(String),
}

/// A result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Bundle(error) => write!(f, "{error}"),
            Error::Invalid(what) => write!(f, "{what}"),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Bundle(error) => Some(error),
            Error::Invalid(_) => None,
        }
    }
}

impl From<ndgi::Error> for Error {
    fn from(error: ndgi::Error) -> Self {
        Error::Bundle(error)
    }
}
