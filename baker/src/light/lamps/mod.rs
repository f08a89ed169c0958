//! Lights that stand in the scene: each is sampled from a receiving point, and gives the density of its
//! samples.
//!
//! In: lamps of the scene file and emissive triangles. Out: a [`GroupSampler`] per light group. Callers:
//! `daylight` (portals are rectangles), the light of a bake.
//!
//! `lamp` has the shapes (`rectangle`, `ball`, `disc`), `emitter` triangles. Of many lights `tree` chooses.
//! `group` puts a group's lights together.

mod rectangle;
mod ball;
mod disc;
mod lamp;
pub(crate) mod emitter;
mod tree;
pub mod group;

pub(crate) use group::GroupSampler;
pub(crate) use lamp::LampSample;
pub(super) use rectangle::{Rectangle, Seen};
