//! Tracing, round by round and block by block, until a limit is met.
//!
//! In: limits, frames and cells, a [`Worker`](super::samples::Worker) and the folder of unfinished work. Out:
//! the sums of every block, in that folder; [`Traced`], error against time; [`BlockHistory`], by which a lost
//! block is traced again. Callers: `run`; `layers` reads the blocks; `forecast` and `output` use `round`.
//!
//! [`Tracer`] does it: `round` says when to stop, `step` what a round asks of a block, `round_summary` what
//! it reached.

pub(super) mod round;
mod step;
mod round_summary;
mod tracer;

pub(super) use round::{Round, Traced, guaranteed_samples};
pub(super) use tracer::{BlockHistory, JudgeTarget, Tracer};
