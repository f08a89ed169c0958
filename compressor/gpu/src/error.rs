//! Errors of this crate.

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The bundle is damaged, or lacks what was requested.
    #[error(transparent)]
    Bundle(#[from] ndgi::Error),
    /// The device does not support the request.
    #[error("{0}")]
    Device(String),
    /// A pool's buffers have no room for a tile: unload others and retry.
    #[error(
        "a tile needs {words} contiguous words of the pool's {buffer} buffer; {free} are free in total: unload other tiles"
    )]
    Full {
        /// Which buffer: `resident` or `interval`.
        buffer: &'static str,
        /// Words of 4 bytes that the tile needs.
        words: u32,
        /// Free words in total.
        free: u32,
    },
    /// An invalid value.
    #[error("{0}")]
    Invalid(String),
}

/// A result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
