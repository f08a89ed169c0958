//! After tracing: the dataset's files, and the error measured.
//!
//! In: layers and a plan. Out: frames and what belongs to them ([`Assembled`]), the sun's visibility, the
//! geometry, and a [`Check`] against long paths. Callers: `run`, `output`; previews and `forecast` use parts.
//!
//! `dilate` fills gutters and `seams` stitches, in bands of rows (`page_bands`). [`Assembler`] (`assemble`)
//! sums layers to frames. `scene_glb` writes the geometry, `visibility` the sun's visibility over time;
//! `check` measures.

mod check;
mod dilate;
mod seams;
mod page_bands;
mod assemble;
mod scene_glb;
mod visibility;

pub use assemble::{Assembled, Assembler, BakedParts};
pub use check::{Check, FrameCheck};
pub(super) use check::{check, choose};
pub use dilate::Dilation;
pub(super) use page_bands::{LEAST_FILLED, TEXELS_OF_BAND};
pub(super) use scene_glb::GLB_FILE;
pub use scene_glb::to_glb;
pub use seams::Seams;
pub use visibility::{Page, VisibilityBaker};
