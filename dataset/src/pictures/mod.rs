//! Metrics of lightmaps and pictures, tone curves, views of a scene, previews of pages.
//!
//! In: images and datasets. Out: pixels and numbers. Callers: reports, evaluation, training, the baker.

pub mod tone;
pub mod metrics;
mod view;
pub mod preview;

pub use metrics::{Brightnesses, Lpips, StepError, TileQuality};
pub use view::{Camera, Light, View};
