//! From a scene to a dataset: what to trace, tracing it in rounds, and putting the layers together.

pub mod json;
pub mod plan;
pub mod state;
pub mod errors;
pub mod rounds;
pub mod post;
pub mod assemble;
pub mod scene_glb;
pub mod run;
