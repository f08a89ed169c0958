//! The room of irradiance that paths read instead of going on, and of the bright surfaces that it shows.
//!
//! In: points of surface, and the solution for them. Out: a [`CacheMap`] with two halves of values
//! (`cache_half`), and [`BrightSurfaces`] to be sampled, found by `bright_facets`.

mod cache_half;
mod cache;
pub(crate) mod bright_facets;
mod bright_facet_index;
mod bright_surfaces;

pub(crate) use bright_facet_index::BrightFacetIndex;
pub(crate) use bright_surfaces::{BrightSurfaceView, BrightSurfaces};
pub(crate) use cache::{CacheMap, Patch};
pub(crate) use cache_half::CacheHalf;
