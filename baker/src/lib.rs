//! A path-traced baker of temporal lightmaps: from a scene file to a dataset of hourly HDR irradiance.
//!
//! Modules in the order the data passes them; a module imports only what stands above it.
//! Space: metres, right-handed, +Y up. With `north = 0`, north is −Z and east is +X.
//! Unit: linear Rec. 709 whose luminance is in kilolux (irradiance) or kcd/m² (radiance).

#![warn(unreachable_pub)]
// (Folders tell what is in them, which others need not see.)
#![allow(rustdoc::private_intra_doc_links)]

mod text;
pub mod scene;
pub mod geometry;
pub mod light;
pub mod atlas;
pub mod surface;
pub mod trace;
pub mod receivers;
pub mod bake;
pub mod preview;
pub mod starter;

pub use dataset::{Error, Result};

/// Linear Rec. 709.
pub type Rgb = glam::Vec3;
