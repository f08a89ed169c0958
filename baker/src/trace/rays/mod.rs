//! Rays: the nearest hit, and whether anything is hit at all.
//!
//! In: triangles. Out: a [`RayTracer`], over our own hierarchy of eight children a node (`bvh8`) or over
//! Embree; a [`Lens`] for pictures. Callers: all folders below, layouts of hidden faces, previews.
//!
//! `bvh8_build` builds the hierarchy, `kernel` walks it (`lanes`, `lanes_x86`), `bvh8_traversal` picks the
//! kernel, `bvh8_box` finds triangles near a box. `triangle` is the watertight test, `light_point` says what
//! hides a point of a light, `pane` what glass does.

mod triangle;
mod lanes;
mod bvh8;
mod kernel;
#[cfg(target_arch = "x86_64")]
mod lanes_x86;
mod bvh8_traversal;
mod bvh8_box;
mod bvh8_build;
mod backend;
pub(super) mod light_point;
#[cfg(feature = "embree")]
mod embree;
pub mod ray_tracer;
mod lens;
pub(super) mod pane;

pub use backend::Backend;
pub use bvh8::{Bvh8, Tier};
pub(crate) use lens::{Lens, NO_TRIANGLE};
pub use ray_tracer::{PassedGlass, RayTracer};
pub(crate) use triangle::Hit;
