//! Steps under a time limit: as many per tile as the remaining time allows for it and all later tiles, at the
//! measured pace.

use super::stats::TileStats;
use crate::grid::Place;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Fewest steps of a tile, however little time remains: the learning rate's warm-up, and as many again.
pub(super) const FLOOR: usize = 200;
/// Share of the remaining time that is planned for; the rest covers reading bands, and threads that wait for
/// the last tile of those read together.
const PLANNED: f64 = 0.95;
/// Weight of earlier measurements relative to that of a full tile.
const MEMORY: f64 = 0.75;
/// Cost of a tile with almost no texels relative to the largest: for a step, which has as many samples but
/// fewer maps to read (0.65 measured, of slivers of the yard); and for all else, which goes through its
/// texels (0.12 measured).
const LEAST_STEP: f64 = 0.65;
const LEAST_REST: f64 = 0.1;

/// Plans the steps of the next tile.
pub(super) struct Pace {
    /// Steps that no tile exceeds.
    most: usize,
    /// `None` without a limit.
    limit: Option<Limit>,
}

struct Limit {
    start: Instant,
    deadline: Instant,
    state: Mutex<State>,
}

/// Tiles and their measured costs; seconds are wall-clock seconds since the start.
#[derive(Clone, Debug, Default)]
struct State {
    /// Tiles that are trained at a time.
    threads: usize,
    /// Tiles not begun, in the order in which they are, about.
    open: Vec<(Place, Size)>,
    /// Tiles being trained, and when they are thought to end.
    running: Vec<(Place, Size, f64)>,
    /// Of the tiles measured, older ones weighing less: their cost in steps of the largest tile, in all else
    /// of the largest tile, and the seconds of both.
    step_cost: f64,
    rest_cost: f64,
    step_seconds: f64,
    rest_seconds: f64,
}

/// A tile's valid texels as a share of the largest tile's.
#[derive(Clone, Copy, Debug)]
struct Size(f64);

impl Size {
    /// Cost of a step, in those of the largest tile.
    fn step(self) -> f64 {
        LEAST_STEP + (1.0 - LEAST_STEP) * self.0
    }

    /// Cost of all but steps, likewise.
    fn rest(self) -> f64 {
        LEAST_REST + (1.0 - LEAST_REST) * self.0
    }
}

impl Pace {
    /// A plan without a limit: every tile gets `most` steps.
    pub(super) fn unlimited(most: usize) -> Self {
        Pace { most, limit: None }
    }

    /// A plan until `deadline`, for `open` tiles with their valid texels, in the order in which they are
    /// trained.
    pub(super) fn until(deadline: Instant, most: usize, open: Vec<(Place, usize)>) -> Self {
        let state = Mutex::new(State::new(rayon::current_num_threads(), open));
        Pace { most, limit: Some(Limit { start: Instant::now(), deadline, state }) }
    }

    /// Whether the deadline has passed.
    pub(super) fn late(&self) -> bool {
        self.limit.as_ref().is_some_and(|limit| limit.deadline <= Instant::now())
    }

    /// Steps of a tile that begins now.
    pub(super) fn begin(&self, place: Place) -> usize {
        let Some(limit) = &self.limit else { return self.most };
        let end = limit.deadline.saturating_duration_since(limit.start).as_secs_f64();
        limit.state().begin(place, limit.start.elapsed().as_secs_f64(), end, self.most)
    }

    /// Learns from a tile that has ended and took so long by the clock.
    pub(super) fn measure(&self, place: Place, stats: &TileStats, took: Duration) {
        if let Some(limit) = &self.limit {
            // A tile's own seconds are those of its thread's CPU; the share of its steps in them is what
            // counts.
            let share = stats.trained.stepping_seconds / stats.seconds;
            let stepping = if share.is_finite() { share.min(1.0) * took.as_secs_f64() } else { 0.0 };
            limit.state().ended(place, stats.trained.steps, stepping, took.as_secs_f64() - stepping);
        }
    }
}

impl Limit {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn new(threads: usize, open: Vec<(Place, usize)>) -> Self {
        let largest = open.iter().map(|(_, texels)| *texels).max().unwrap_or(0).max(1) as f64;
        let open = open.into_iter().map(|(place, texels)| (place, Size(texels as f64 / largest))).collect();
        State { threads, open, ..State::default() }
    }

    /// Steps of the tile at `place`, which begins `now` and of which none is to run past `end`.
    fn begin(&mut self, place: Place, now: f64, end: f64, most: usize) -> usize {
        let Some(at) = self.open.iter().position(|(open, _)| *open == place) else { return FLOOR.min(most) };
        let (_, size) = self.open.remove(at);
        let left = PLANNED * (end - now).max(0.0);
        // The most steps for each with which all end in time, by bisection.
        let (mut enough, mut too_many) = (0.0, most as f64);
        if self.step_cost > 0.0 {
            if self.needed(now, size, too_many) <= left {
                enough = too_many;
            }
            while too_many - enough > 1.0 {
                let middle = 0.5 * (enough + too_many);
                *(if self.needed(now, size, middle) <= left { &mut enough } else { &mut too_many }) = middle;
            }
        }
        let steps = (enough as usize).max(FLOOR).min(most);
        let ends = if self.step_cost > 0.0 { now + self.seconds(size, steps as f64) } else { now };
        self.running.push((place, size, ends));
        steps
    }

    /// Seconds from now to the end of a tile that begins now and of all open ones, at this many steps each.
    /// Each begins on the thread that is free first.
    fn needed(&self, now: f64, first: Size, steps: f64) -> f64 {
        let mut free: Vec<f64> = self.running.iter().map(|(.., ends)| (ends - now).max(0.0)).collect();
        free.resize(self.threads.max(1), 0.0);
        let mut last = 0.0f64;
        // This tile's thread is free: the running ones have the others.
        for size in std::iter::once(first).chain(self.open.iter().map(|(_, size)| *size)) {
            let thread = free.iter_mut().min_by(|a, b| a.total_cmp(b)).expect("one thread at least");
            *thread += self.seconds(size, steps);
            last = last.max(*thread);
        }
        last
    }

    /// Seconds of a tile.
    fn seconds(&self, size: Size, steps: f64) -> f64 {
        size.step() * steps * self.step_seconds / self.step_cost
            + size.rest() * self.rest_seconds / self.rest_cost
    }

    /// Learns from a tile: the seconds of its steps, and all others. (One that was only tried stays open.)
    fn ended(&mut self, place: Place, steps: usize, stepping: f64, rest: f64) {
        let running = self.running.iter().position(|(running, ..)| *running == place);
        let trial_fits = || self.open.iter().find(|(open, _)| *open == place).map(|(_, size)| *size);
        let Some(size) = running.map(|at| self.running.swap_remove(at).1).or_else(trial_fits) else { return };
        // A tile without light has no steps and is not measured.
        if steps == 0 || stepping <= 0.0 {
            return;
        }
        let keep = 1.0 - (1.0 - MEMORY) * size.0;
        let learn = |old: &mut f64, new: f64| *old = keep * *old + new;
        learn(&mut self.step_cost, size.step() * steps as f64);
        learn(&mut self.rest_cost, size.rest());
        learn(&mut self.step_seconds, stepping);
        learn(&mut self.rest_seconds, rest.max(0.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::TrainedTile;

    const WHOLE: usize = 14_000;
    const SLIVER: usize = 300;

    fn place(column: usize) -> Place {
        Place { page: 0, column, row: 0 }
    }

    /// Tiles of this many texels trained on this many threads until `limit` at most: the steps of each, and
    /// when the last one ended. `rate`: the seconds of a step of a whole tile that begins at a time; all else
    /// takes it 1.5. Small tiles take less, not quite as `State` thinks.
    fn simulate(
        texels: &[usize],
        threads: usize,
        limit: f64,
        most: usize,
        rate: impl Fn(f64) -> f64,
    ) -> (Vec<usize>, f64) {
        let size = |i: usize| texels[i] as f64 / WHOLE as f64;
        let stepping = |i: usize, steps: usize, now: f64| (0.55 + 0.45 * size(i)) * rate(now) * steps as f64;
        let rest = |i: usize| 0.15 + 1.35 * size(i);
        let tiles = texels.iter().enumerate().map(|(i, texels)| (place(i), *texels));
        let mut state = State::new(threads, tiles.collect());
        let trial_fits = texels.iter().position(|n| *n == WHOLE).unwrap();
        state.ended(place(trial_fits), FLOOR, stepping(trial_fits, FLOOR, 0.0), rest(trial_fits));
        // When each thread is free, and what it did.
        let mut busy: Vec<(f64, Option<(usize, f64)>)> = vec![(2.0, None); threads];
        let (mut steps, mut open) = (vec![0; texels.len()], 0..texels.len());
        loop {
            let (now, did) = busy.iter_mut().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
            if let Some((i, stepping)) = did.take() {
                state.ended(place(i), steps[i], stepping, rest(i));
            }
            match open.next() {
                Some(i) => {
                    steps[i] = state.begin(place(i), *now, limit, most);
                    let took = stepping(i, steps[i], *now);
                    *did = Some((i, took));
                    *now += took + rest(i);
                }
                None => break,
            }
        }
        (steps, busy.iter().map(|(end, _)| *end).fold(0.0, f64::max))
    }

    /// A page as tiles of 126 texels cut it: whole tiles, and slivers at the end of each row and in the last.
    fn page(columns: usize) -> Vec<usize> {
        (0..columns * columns)
            .map(|i| if i % columns == columns - 1 || i / columns == columns - 1 { SLIVER } else { WHOLE })
            .collect()
    }

    #[test]
    fn every_tile_gets_its_share_in_time() {
        for threads in [1, 2, 3, 7] {
            for texels in &[vec![WHOLE; 30], page(5), page(9), vec![WHOLE; 4], vec![WHOLE]] {
                let limit = 20.0 * texels.len().div_ceil(threads) as f64;
                let (steps, end) = simulate(texels, threads, limit, 1_000_000, |_| 1e-3);
                let of = |size: usize| (0..steps.len()).filter(move |i| texels[*i] == size).map(|i| steps[i]);
                let (least, most) = (of(WHOLE).min().unwrap(), of(WHOLE).max().unwrap());
                let said = format!("{threads} threads, {limit} s: {end:.1} s, {steps:?}");
                assert!(end <= limit && 4 * most < 5 * least, "{said}");
                // The slivers of the last row get what was kept back for the rest.
                assert!(of(SLIVER).all(|steps| steps < 2 * least), "{said}");
                // What is left over is the share kept back, and threads without a tile at the end.
                assert!(end >= 0.9 * limit, "{said}");
            }
        }
    }

    #[test]
    fn a_machine_that_turns_slow_costs_the_later_tiles_alone() {
        let (steps, end) =
            simulate(&page(6), 2, 300.0, 1_000_000, |now| if now < 150.0 { 1e-3 } else { 2e-3 });
        assert!((270.0..=300.0).contains(&end), "{end} {steps:?}");
        assert!(3 * steps.iter().min().unwrap() > *steps.iter().max().unwrap(), "{steps:?}");
    }

    #[test]
    fn enough_time_gives_all_steps_and_none_gives_the_fewest() {
        assert_eq!(simulate(&page(5), 2, 3000.0, 12_000, |_| 1e-3).0, [12_000; 25]);
        assert_eq!(simulate(&page(5), 2, 1.0, 12_000, |_| 1e-3).0, [FLOOR; 25]);
        assert_eq!(simulate(&page(5), 2, 1.0, 10, |_| 1e-3).0, [10; 25]);
        assert_eq!(Pace::unlimited(777).begin(place(0)), 777);
    }

    #[test]
    fn a_tile_is_measured_by_the_clock() {
        let pace = Pace::until(
            Instant::now() + Duration::from_secs(3600),
            10_000_000,
            vec![(place(0), 5), (place(1), 5)],
        );
        assert_eq!(pace.begin(place(0)), FLOOR, "nothing was measured yet");
        // 1000 steps in 1 of 3 CPU seconds, which took 6 seconds.
        let trained = TrainedTile { steps: 1000, stepping_seconds: 1.0, ..TrainedTile::default() };
        let stats = TileStats { trained, seconds: 3.0, ..TileStats::default() };
        pace.measure(place(0), &stats, Duration::from_secs(6));
        let expected = (PLANNED * 3600.0 - 4.0) / 2e-3;
        let steps = pace.begin(place(1)) as f64;
        assert!((steps - expected).abs() < 0.001 * expected, "{steps} {expected}");
    }

    #[test]
    fn a_tile_without_light_does_not_change_the_pace() {
        let mut state = State::new(1, vec![(place(0), 5), (place(1), 5)]);
        state.ended(place(1), 200, 0.2, 1.0);
        let before = state.clone();
        assert!(state.begin(place(0), 0.0, 100.0, 1_000_000) > FLOOR);
        state.ended(place(0), 0, 0.0, 0.1);
        assert_eq!(
            (state.step_cost, state.rest_seconds, state.running.len()),
            (before.step_cost, before.rest_seconds, 0)
        );
    }
}
