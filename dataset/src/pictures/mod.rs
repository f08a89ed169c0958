//! The room of pictures of light: tone curves, metrics between pictures, views of a scene, previews of pages.
//!
//! In: images and datasets. Out: pixels and numbers. Callers: reports, the viewer, comparisons.

pub mod tone;
pub mod metrics;
mod view;
pub mod preview;

pub use metrics::{Brightnesses, Lpips, StepError, TileQuality};
pub use view::{Camera, Light, View};
