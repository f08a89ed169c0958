//! What a bake will need, told before its light is traced.
//!
//! In: what is prepared. Out: a [`Forecast`] of texels, memory and disk, and warnings. Callers: `run`,
//! `output`, `bake --plan`, `bake new`.
//!
//! `layout_estimate` lays a coarser page out, [`DiskSpace`] compares with what is free, `views` counts the
//! tiles that cameras see, `needs` puts it together, `mistakes` finds likely mistakes in the scene.

mod layout_estimate;
mod disk_space;
pub mod views;
mod needs;
pub mod mistakes;

pub use disk_space::{DiskSpace, in_words};
pub use layout_estimate::LayoutEstimate;
pub(crate) use mistakes::is_usual_length;
pub use mistakes::warnings;
pub use needs::{ESCAPE_RAYS, Forecast, forecast, scale};
pub(super) use needs::{density, extent};
