//! The room of the irradiance cache: all bounces of light at its entries, before the rounds.
//!
//! In: texels that have surface, with their direct light. Out: the two halves of a
//! [`Cache`](super::samples::Cache), filled. Callers: the rounds, checks and forecasts.
//!
//! `solve::fill` does it: `solver_paths` traces a few paths from each entry, `cache_system` is the balance of
//! light over all of them, `endless_light` finds places where nothing absorbs it.

pub(super) mod cache_system;
mod solver_paths;
pub(super) mod endless_light;
pub(super) mod solve;

pub(super) use solve::Covered;
