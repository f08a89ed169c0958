//! What can go wrong.

/// What can go wrong.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The bundle is damaged, or what was asked for is not in it.
    #[error(transparent)]
    Bundle(#[from] ndgi::Error),
    /// The device cannot do what was asked for.
    #[error("{0}")]
    Device(String),
    /// A value that makes no sense.
    #[error("{0}")]
    Invalid(String),
}

/// A result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
