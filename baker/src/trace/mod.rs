//! Light transport: rays, random numbers, the samples of every layer of a texel at once, the cache they read,
//! its bright surfaces.

pub mod room;
pub mod sampler;
pub mod triangle;
mod lanes;
mod pages;
pub mod bvh8;
mod kernel;
#[cfg(target_arch = "x86_64")]
mod lanes_x86;
mod bvh8_traversal;
mod bvh8_box;
mod bvh8_build;
pub mod backend;
mod light_point;
#[cfg(feature = "embree")]
mod embree;
pub mod ray_tracer;
pub mod lens;
pub mod light_subset;
pub mod lights;
pub mod counts;
pub mod space;
mod flush;
pub mod clear;
pub mod closed_in;
mod pane;
pub mod visibility_sampler;
pub mod path;
pub mod endless_path;
pub mod cache;
pub mod cache_half;
pub mod bright_facets;
pub mod bright_facet_index;
pub mod bright_surfaces;
