//! The room of the dataset's folder, and of what a bake tells when done.
//!
//! In: the folder that is written to, and results of all rooms before. Out: the [`Outcome`] that `run.json`
//! holds. Callers: `run` and the command.
//!
//! `folder` makes it this bake's own, `existing` says what stands there and what would be lost, `outcome` and
//! `facts` what a bake gave, `prediction` foretells a bake by the rounds of an earlier one.

pub mod folder;
mod outcome;
pub(super) mod existing;
pub(super) mod prediction;
pub(super) mod facts;

pub(super) use existing::RUN;
pub use existing::{ERRORS, REPORT, replacement_note};
pub use facts::{skipped, unwrapped};
pub(super) use folder::OutputFolder;
pub(crate) use folder::relative_to;
pub use outcome::{LayerCount, LocalErrors, Outcome};
pub use prediction::{Point, Prediction, predict};
