//! Reads and decodes NDGI bundles (`../FORMAT.md`): temporal lightmaps, neurally compressed, with random
//! access to any (u, v, t). Equations follow the paper "Neural Dynamic GI: Random-Access Neural Compression
//! for Temporal Lightmaps in Dynamic Lighting Environments".
//!
//! Modules are listed in the order of the data flow; a module imports only those above it. The crate depends
//! on nothing else of this repository.

#![deny(unsafe_code)]
#![warn(unreachable_pub)]

mod error;
mod recent;
pub mod source;
pub mod half;
pub mod lanes;
pub mod time;
pub mod model;
pub mod bc7;
pub mod grid;
pub mod sun;
pub mod planes;
pub mod bundle;
pub mod decode;
pub mod pack;
pub mod at;
#[cfg(feature = "capi")]
mod c;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}

#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod testing;

pub use bundle::Bundle;
pub use error::{Error, Result};
