//! What the commands share and readers of datasets do not need: arguments that people type, and reports.

pub mod typed;
pub mod report;
