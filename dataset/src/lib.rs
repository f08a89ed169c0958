//! The dataset on disk: the interface between baker and compressor.
//!
//! The baker writes it, the compressor reads it; neither rendering nor training happens here.
//! Modules are listed in the order of the data flow; a module imports only those above it.

#![warn(unreachable_pub)]
// (Folders tell what is in them, which others need not see.)
#![allow(rustdoc::private_intra_doc_links)]

pub mod error;
pub mod host;
pub mod observe;
pub mod typed;
pub mod digest;
pub mod image;
pub mod layout;
pub mod format;
pub mod store;
pub mod halve;
pub mod exchange;
pub mod pictures;
pub mod release;

pub use error::{Error, Result};
