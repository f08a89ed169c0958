//! Virtual texturing of a day of lightmaps: which tiles of NDGI bundles are read, put on a device, decoded and shown, under a budget.
//!
//! [`Stream`] decides; it has no clock, no thread and no device, so the same trace always gives the same commands. [`Pyramid`] holds what is known of
//! all tiles without reading one.

#![forbid(unsafe_code)]

#[cfg(all(doctest, feature = "gpu"))]
#[doc = include_str!("../README.md")]
mod guide {}

mod budgets;
mod error;
mod machine;
mod pyramid;
#[cfg(feature = "gpu")]
pub mod gpu;

pub use budgets::Budgets;
pub use error::{Error, Result};
pub use machine::{Answer, Commands, Completion, Decode, Entry, Failure, Load, Read, Seen, Stream, Times};
pub use pyramid::{Now, Pyramid, Spot, Tile};
