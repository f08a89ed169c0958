//! Estimated error: over the page, and relative to the light around each cell.
//!
//! In: values of two half-buffers, per texel or summed up, and a [`Worker`](super::samples::Worker) that
//! traces what is seen from each cell. Out: errors of tiles and frames ([`Errors`]), of cells of 16×16 texels
//! ([`LocalErrorSummary`]), and which cells go on ([`UnconvergedCells`]). Callers: all folders below.
//!
//! `sums` estimates, `local_errors` relates errors to the light where they are, `local_light` reads that
//! light from the cache, `unconverged` judges by a target.

mod sums;
pub(super) mod local_errors;
pub(super) mod local_light;
mod unconverged;

pub(super) use local_errors::{COUNTED_ERRORS, of_block};
pub use local_errors::{
    CellMap, EYE_ROOM, LEAST_IRRADIANCE, LocalErrorSummary, PICTURE_STEP, Pieces, VISIBLE_PART,
};
pub(super) use local_light::{CachedLight, Floors};
pub use sums::Sums;
pub(super) use sums::{Errors, median};
pub(super) use unconverged::{BlockErrors, TargetJudgement, UnconvergedCells};
