//! The dataset's folder, and what a bake tells when done.
//!
//! In: the folder that is written to, and results of all folders above. Out: the [`Outcome`] that `run.json`
//! holds. Callers: `run`, `bake new` and the command.
//!
//! `folder` makes it this bake's own. `existing` says what stands there and what would be lost. `outcome` and
//! `facts` tell what a bake gave. `prediction` foretells a bake by the rounds of an earlier one.

pub mod folder;
mod outcome;
pub(super) mod existing;
pub(super) mod prediction;
pub(super) mod facts;

pub(super) use existing::RUN_FILE;
pub use existing::{ERRORS_FILE, REPORT_FILE, replacement_note};
pub use facts::{skipped, unwrapped};
pub(super) use folder::OutputFolder;
pub(crate) use folder::relative_to;
pub use outcome::{LayerCount, LocalErrors, Outcome};
pub use prediction::{Point, Prediction, predict};
