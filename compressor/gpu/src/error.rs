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
    /// A pool's buffers have no room for a tile: unload others, and try again.
    #[error("a tile needs {words} words of the pool's {buffer} buffer in one part; {free} are free in all")]
    Full {
        /// Which buffer: `resident` or `interval`.
        buffer: &'static str,
        /// Words of 4 bytes that the tile needs.
        words: u32,
        /// Words that are free in all.
        free: u32,
    },
    /// A value that makes no sense.
    #[error("{0}")]
    Invalid(String),
}

/// A result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
