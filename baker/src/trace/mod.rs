//! Light transport: rays, solids, the lights of a bake, paths, and the irradiance that they read and fill.
//!
//! In: geometry, lights and points of surface. Out: whether rays are blocked and what they meet, and the
//! light of every layer that a path carries. Callers: the rooms of a bake, previews, `bake new`. A folder
//! uses those above it alone.

mod pages;
pub mod counts;
pub mod rays;
pub mod solids;
pub mod sources;
pub mod paths;
pub mod irradiance;
