//! Virtual texturing for a day of lightmaps: reads, decodes and shows the tiles of NDGI bundles that a view
//! needs, under a budget.
//!
//! [`Stream`] decides what is to be done. It has no clock, thread or device, so the same trace always gives
//! the same commands. [`Pyramid`] holds the tiles of all levels: their indices and mean light, which are in
//! memory.

#![forbid(unsafe_code)]
#![warn(unreachable_pub)]

#[cfg(all(doctest, feature = "gpu"))]
#[doc = include_str!("../README.md")]
mod guide {}

mod budgets;
mod error;
mod pyramid;
mod machine;
#[cfg(feature = "gpu")]
pub mod gpu;

pub use budgets::Budgets;
pub use error::{Error, Result};
pub use machine::{Answer, Commands, Completion, Decode, Entry, Failure, Load, Read, Seen, Stream, Times};
pub use pyramid::{Now, Pyramid, Spot, Tile};
