//! Stiff and extreme cases, each baked through the real pipeline against a stated expectation. `NUMERICS.md`
//! lists them.
//!
//! Never a NaN, an infinity or a negative value in a stored image (every bake here is checked), energy within
//! three standard errors where there is a closed form, a clear error where the input is meaningless.

#[path = "../common/mod.rs"]
mod common;

mod bodies;
mod emitters;
mod errors;
mod geometry;
mod glass;
mod ground;
mod hard;
mod keyhole;
mod leaks;
mod needs;
mod pages;
mod rooms;
mod schedules;
mod sun;
mod surfaces;
mod visibility;
mod window;
