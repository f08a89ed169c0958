//! The room of lights that stand in the scene: each is sampled from a receiving point, and gives the density
//! of its samples.
//!
//! In: lamps of the scene file and emissive triangles. Out: a [`GroupSampler`] per light group.
//!
//! `lamp` has the shapes (`rectangle`, `cone`, `disc`), `emitter` triangles; of many lights `tree` chooses;
//! `group` puts a group's lights together.

mod rectangle;
mod cone;
mod disc;
mod lamp;
pub(crate) mod emitter;
mod tree;
pub mod group;

pub(crate) use group::GroupSampler;
pub(crate) use lamp::LampSample;
pub(super) use rectangle::{Rectangle, Seen};
