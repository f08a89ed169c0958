//! The room before tracing: what is asked for, and a scene read and planned by it.
//!
//! In: a scene file and [`Options`]. Out: [`Prepared`], with the [`Plan`] of its layers, the [`Limits`] of
//! its rounds, and the digests by which layers and dataset are known again. Callers: `run`, forecasts, and
//! all that asks what a layer is a layer of.
//!
//! `hidden` finds faces that need no texels, `openings` the windows of rooms, `transfer` the scene under
//! spherical harmonics.

mod limits;
mod options;
pub(crate) mod plan;
mod transfer;
pub(crate) mod hidden;
pub(crate) mod openings;
mod prepared;

pub(super) use limits::Limits;
pub(crate) use openings::openings;
pub use options::Preset;
pub use options::{Denoise, Integrator, Options};
pub(crate) use plan::Plan;
pub use plan::{Part, hour};
pub use prepared::{Prepared, prepare};
