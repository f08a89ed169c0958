//! The room after tracing: the dataset's files, and the error measured.
//!
//! In: layers and a plan. Out: frames and what stands beside them ([`Stored`]), the sun's visibility, the
//! geometry, and a [`Check`] against long paths. Callers: `run`; previews and forecasts use parts.
//!
//! `post` dilates and `seams` stitches, in bands of rows (`page_bands`); [`Assembler`] (`assemble`) sums
//! layers up to frames; `scene_glb` writes the geometry, `visibility` the sun's visibility over time, `check`
//! measures.

mod check;
mod post;
mod seams;
mod page_bands;
mod assemble;
mod scene_glb;
mod visibility;

pub use assemble::{Assembler, BakedParts, Stored};
pub use check::{Check, FrameCheck};
pub(super) use check::{check, choose};
pub(super) use page_bands::{LEAST_FILLED, TEXELS_OF_BAND};
pub use post::Dilation;
pub(super) use scene_glb::NAME;
pub use scene_glb::to_glb;
pub use seams::Seams;
pub use visibility::{Page, VisibilityBaker};
