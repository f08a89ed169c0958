//! Rounds of tracing: each brings more samples where they are wanted, so that an estimate with its error
//! exists early and improves to the end. Here: when to stop, and what a round and all of them reached.

use crate::bake::errors::LocalErrorSummary;
use crate::bake::prepare::Limits;
use crate::trace::counts::RayCounts;
use dataset::observe::count;
use serde::{Deserialize, Serialize};

/// What a round reached.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Round {
    /// Samples of indirect light per texel that it went for: what a texel of mean deviation has.
    pub samples: u32,
    /// Those that were drawn, on average over the texels.
    pub mean_samples: f64,
    /// Seconds of tracing up to its end, over all runs of this bake.
    pub seconds: f64,
    /// Median relative error over (tile, frame).
    pub median_error: f64,
    /// 95th percentile.
    pub p95_error: f64,
    /// The largest.
    pub worst_error: f64,
    /// Relative error of every frame over the whole page, of the layers this run traces.
    pub frame_errors: Vec<Option<f64>>,
    /// Mean light of every frame over the whole page, of the layers this run traces.
    pub frame_means: Vec<f64>,
    /// Local errors over all cells and frames, of the layers this run traces
    /// ([`crate::bake::errors::local_errors`]); `None` without light.
    pub local: Option<LocalErrorSummary>,
    /// Those of every frame.
    pub local_frames: Vec<Option<LocalErrorSummary>>,
    /// Those of all frames after denoising, where the round was judged by them.
    pub denoised: Option<LocalErrorSummary>,
    /// Cells that have not reached the target; 0 without one.
    pub unconverged_cells: usize,
    /// Whether they are too many for the target to be met.
    pub is_missed: bool,
    /// Whether the time ran out during it: some blocks got fewer samples than it went for, or none.
    pub is_late: bool,
}

/// The result of tracing; kept with the layers, but for what is of one run alone.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Traced {
    /// One entry per round.
    pub rounds: Vec<Round>,
    /// Rays traced by this run (not by earlier runs it continued).
    #[serde(skip)]
    pub rays: RayCounts,
    /// Rounds this run found done.
    #[serde(skip)]
    pub resumed: usize,
    /// What should be known about the way to the result, in words.
    pub notes: Vec<String>,
    /// Whether the time ran out.
    pub out_of_time: bool,
    /// Whether the cache did not settle, and paths were traced to their end instead.
    pub is_unsettled: bool,
    /// The most samples of layers that were kept from earlier bakes, as [`Round::samples`].
    pub kept_samples: u32,
}

impl Traced {
    /// Samples of indirect light per texel of the layer that has most; `None` where none was traced.
    pub fn samples(&self) -> Option<u32> {
        self.rounds.last().map(|round| round.samples.max(self.kept_samples))
    }

    /// Takes over what holds for the layers that are kept, as the tracing that left them reported.
    pub fn keep(&mut self, kept: &Traced) {
        self.kept_samples = kept.samples().unwrap_or(0);
        self.out_of_time |= kept.out_of_time;
        self.is_unsettled |= kept.is_unsettled;
        let new: Vec<String> = kept.notes.iter().filter(|note| !self.notes.contains(note)).cloned().collect();
        self.notes.extend(new);
    }

    /// Notes that paths go to their end, for the cache did not settle.
    pub fn without_cache(&mut self, passes: usize) {
        self.is_unsettled = true;
        self.notes.push(format!(
            "the cache had not settled after {passes} passes (light fades too slowly): paths were traced to their end"
        ));
    }
}

/// Samples of the first round towards a target error or under a time limit.
const FIRST_ROUND: u32 = 16;

/// The samples per texel after each round: of a fixed number, an eighth, by which it is decided who gets how
/// many, and all; towards a target or under a time limit, doublings from 16.
pub(crate) fn schedule(limits: &Limits) -> Vec<u32> {
    let most = limits.samples;
    if !limits.have_target() {
        // (Nothing is decided between the first round and the last, and each one moves the sums of all blocks
        // to the disk and back.)
        let mut rounds = doublings(most);
        let first = rounds.next();
        return first.into_iter().chain(rounds.last()).collect();
    }
    let doublings = std::iter::successors(Some(FIRST_ROUND), |n| n.checked_mul(2)).take_while(|&n| n < most);
    doublings.chain([most]).collect()
}

/// Up to four numbers of samples that double and end at `samples`.
fn doublings(samples: u32) -> impl Iterator<Item = u32> {
    (0..4).rev().map(move |k| samples >> k).filter(|&n| n >= 2)
}

/// The samples at which a block stops on its way from `before` to `target`, the last of them the target.
/// (Sums are taken from one to the next: they decide the bytes of a bake, whatever the rounds.)
pub(crate) fn stops(limits: &Limits, before: u32, target: u32) -> Vec<u32> {
    match limits.have_target() {
        true => vec![target],
        false => doublings(limits.samples).filter(|n| (before + 1..=target).contains(n)).collect(),
    }
}

/// The samples that are sure to be drawn: all of them, or towards a target or under a time limit those of the
/// first round.
pub(crate) fn guaranteed_samples(limits: &Limits) -> u32 {
    let schedule = schedule(limits);
    if limits.have_target() { schedule[0] } else { total_of(&schedule) }
}

/// The samples of the last round.
pub(crate) fn total_of(schedule: &[u32]) -> u32 {
    schedule.last().copied().unwrap_or(0)
}

/// What a progress bar tells of a round.
pub(crate) fn note(round: &Round, limits: &Limits) -> String {
    let unconverged = match limits.target_error {
        Some(_) => format!(", {} of 16×16 texels above the target", count(round.unconverged_cells, "cell")),
        None => String::new(),
    };
    let in_words = |local: LocalErrorSummary| {
        let [median, p95] = [local.median, local.p95].map(|error| error * 100.0);
        format!("median {median:.1} %, 95 % below {p95:.1} %")
    };
    let denoised = round.denoised.map_or(String::new(), |local| format!("; denoised: {}", in_words(local)));
    let traced = in_words(round.local.unwrap_or_default());
    format!("local error: {traced}, at {} samples{denoised}{unconverged}", round.samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn what_kept_layers_were_traced_with_is_not_forgotten() {
        let of =
            |samples| Traced { rounds: vec![Round { samples, ..Round::default() }], ..Traced::default() };
        let kept = Traced { out_of_time: true, notes: vec!["slow".to_owned()], ..of(512) };
        let mut traced = Traced { notes: vec!["new".to_owned()], ..of(64) };
        traced.keep(&kept);
        assert_eq!((traced.samples(), traced.out_of_time, traced.is_unsettled), (Some(512), true, false));
        assert_eq!(traced.notes, ["new", "slow"]);
        // And once more.
        let mut again = of(16);
        again.keep(&traced);
        assert_eq!((again.samples(), again.out_of_time), (Some(512), true));
        assert_eq!(Traced::default().samples(), None);
    }

    #[test]
    fn rounds_end_at_the_samples_asked_for() {
        let fixed = |samples| schedule(&Limits { samples, target_error: None, deadline: None });
        assert_eq!(fixed(64), [8, 64]);
        assert_eq!(fixed(2), [2]);
        assert_eq!(fixed(4), [2, 4]);
        let limits = Limits { samples: 64, target_error: None, deadline: None };
        assert_eq!([stops(&limits, 0, 8), stops(&limits, 8, 64)], [vec![8], vec![16, 32, 64]]);
        assert_eq!(stops(&Limits { target_error: Some(0.01), ..limits }, 16, 32), [32]);
        assert_eq!(stops(&Limits { deadline: Some(Instant::now()), ..limits }, 16, 32), [32]);
        let target = |samples| schedule(&Limits { samples, target_error: Some(0.01), deadline: None });
        assert_eq!(target(128), [16, 32, 64, 128]);
        assert_eq!(target(8), [8]);
        let guaranteed_samples =
            |samples, target_error| guaranteed_samples(&Limits { samples, target_error, deadline: None });
        assert_eq!([guaranteed_samples(64, None), guaranteed_samples(2, None)], [64, 2]);
        assert_eq!([guaranteed_samples(128, Some(0.01)), guaranteed_samples(8, Some(0.01))], [16, 8]);
    }
}
