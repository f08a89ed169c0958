//! From a scene to a dataset: what to trace, tracing it in rounds, and putting the layers together.

pub mod json;
pub mod plan;
pub mod state;
pub mod errors;
pub mod block;
pub mod direct;
pub mod indirect;
pub mod balance;
pub mod pilot;
pub mod solve;
pub mod rounds;
pub mod tracer;
pub mod layers;
pub mod check;
pub mod post;
pub mod seams;
pub mod assemble;
pub mod scene_glb;
pub mod options;
pub mod transfer;
pub mod prepare;
pub mod forecast;
pub mod folder;
pub mod standing;
pub mod facts;
pub mod run;
