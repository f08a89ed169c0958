//! Before tracing: what is asked for, and the scene read and planned accordingly.
//!
//! In: a scene file and [`Options`]. Out: [`Prepared`], with the [`Plan`] of its layers, the [`Limits`] of
//! its rounds, and the digests by which layers and dataset are recognised. Callers: `run`, `forecast`, and
//! all that need a layer's part or name.
//!
//! `hidden` finds faces that need no texels, `openings` the windows of rooms. `transfer` is the scene under
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
