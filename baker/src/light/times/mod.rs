//! Times: which hours are baked, and how light goes between them.
//!
//! In: hours that people ask for, schedules, and the daylight. Out: the times of frames (`schedule`,
//! `extra_times`), those of the sun's visibility (`visibility_times`), and the curves that smooth light
//! follows from frame to frame (`curves`). Callers: plans, previews, the command.

pub mod schedule;
pub mod visibility_times;
pub(crate) mod curves;
pub mod extra_times;

pub(crate) use extra_times::ExtraTimes;
pub(crate) use schedule::Hours;
pub(crate) use visibility_times::VisibilityTimes;
