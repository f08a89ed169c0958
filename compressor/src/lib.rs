//! NDGI compression of temporal lightmaps (terms and equations follow the paper "Neural Dynamic GI:
//! Random-Access Neural Compression for Temporal Lightmaps in Dynamic Lighting Environments").
//!
//! Modules are listed in the order of the data flow; a module imports only those above it. The decoder is a
//! separate crate, [`ndgi`], whose modules are re-exported here. Of the modules below, `evaluate` needs only
//! `law`, `mean` and `seen`.

#![warn(unreachable_pub)]
// (Folders tell what is in them, which others need not see.)
#![allow(rustdoc::private_intra_doc_links)]

pub use ndgi::{bc7, bundle, decode, grid, lanes, model, planes, sun, time};

mod printable;
mod clock;
mod mean;
mod linear;
pub mod seen;
pub mod law;
pub mod tile;
pub mod sunlight;
pub mod train;
pub mod basis;
pub mod compress;
pub mod evaluate;
pub mod report;
pub mod levels;
pub mod run;
pub mod sweep;
pub mod compare;
pub mod view;

pub use dataset::error::of_bundle;
pub use dataset::{Error, Result};
pub use printable::printable;
