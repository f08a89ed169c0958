//! The irradiance cache: all bounces of light at its entries, before the rounds.
//!
//! In: texels that have surface, with their direct light, and surfaces without texels. Out: a filled
//! [`Cache`](super::samples::Cache). Callers: `rounds`, `finish`, `forecast`, `run`.
//!
//! `solve::fill` does it: `solver_paths` traces a few paths from each entry, `cache_system` is the balance of
//! light over all of them, `endless_light` finds places where nothing absorbs it.

pub(super) mod cache_system;
mod solver_paths;
pub(super) mod endless_light;
pub(super) mod solve;

pub(super) use solve::Covered;
