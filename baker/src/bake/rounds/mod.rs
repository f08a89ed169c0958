//! The room of tracing: round by round, block by block, until a limit is met.
//!
//! In: what is prepared, a [`Worker`](super::samples::Worker) and the folder of unfinished work. Out: in that
//! folder the sums of every block; [`Traced`], error against time. Callers: `run`.
//!
//! [`Tracer`] does it: `round` says when to stop, `step` what a round asks of a block, `round_summary` what
//! it reached.

pub(super) mod round;
mod step;
mod round_summary;
mod tracer;

pub(super) use round::{Round, Traced, guaranteed_samples};
pub(super) use tracer::{BlockHistory, JudgeTarget, Tracer};
