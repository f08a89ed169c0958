//! The irradiance at which paths end, and the bright surfaces that it shows.
//!
//! In: points of surface, and the solution for them. Out: a [`CacheMap`] of entries, [`CacheHalf`]s with
//! their values, and [`BrightSurfaces`] to be sampled, found by `bright_facets`. Callers: the cache and the
//! samples of a bake.

mod cache_half;
mod cache_map;
pub(crate) mod bright_facets;
mod bright_facet_index;
mod bright_surfaces;

pub(crate) use bright_facet_index::BrightFacetIndex;
pub(crate) use bright_surfaces::{BrightSurfaceView, BrightSurfaces};
pub(crate) use cache_half::CacheHalf;
pub(crate) use cache_map::{CacheMap, Patch};
