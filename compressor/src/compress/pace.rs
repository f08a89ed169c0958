//! Steps under a time limit: every tile gets its share of the time that is left, at the pace of the tiles before it.

use super::stats::TileStats;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Fewest steps of a tile, however little time is left: the rise of the rate, and as many again.
pub(super) const FLOOR: usize = 200;
/// Share of the time left that is planned for; the rest is for what a plan does not know.
const PLANNED: f64 = 0.95;
/// How much the measures before a tile weigh beside its own.
const MEMORY: f64 = 0.75;

/// What decides the steps of the next tile.
pub(super) struct Pace {
    /// When training is to end; `None` without a limit.
    deadline: Option<Instant>,
    /// Steps that no tile exceeds.
    most: usize,
    /// Tiles that are trained at a time.
    threads: usize,
    state: Mutex<State>,
}

/// What changes from tile to tile.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    /// Tiles not begun.
    open: usize,
    /// Of the tiles measured, older ones weighing less: their number, their steps, the seconds of these, and all other seconds.
    tiles: f64,
    steps: f64,
    stepping: f64,
    rest: f64,
}

impl Pace {
    /// For so many `open` tiles.
    pub(super) fn new(deadline: Option<Instant>, most: usize, open: usize) -> Self {
        let state = Mutex::new(State { open, ..State::default() });
        Pace { deadline, most, threads: rayon::current_num_threads(), state }
    }

    /// Time until the deadline; `None` without one, or once it has passed.
    pub(super) fn left(&self) -> Option<Duration> {
        self.deadline?.checked_duration_since(Instant::now()).filter(|left| !left.is_zero())
    }

    /// Steps of a tile that begins now.
    pub(super) fn begin(&self) -> usize {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let open = state.open;
        state.open = open.saturating_sub(1);
        match self.deadline {
            None => self.most,
            Some(_) => {
                let left = self.left().map_or(0.0, |left| left.as_secs_f64());
                state.steps(left, open.max(1).div_ceil(self.threads)).clamp(FLOOR.min(self.most), self.most)
            }
        }
    }

    /// Learns from a finished tile, which took so long by the clock.
    pub(super) fn measure(&self, stats: &TileStats, took: Duration) {
        // The tile's own curve is in CPU seconds; the share of its steps in them is what counts. (The point at 7/8 of the steps is
        // the last that is surely one of the main phase.)
        let near_end = stats.curve.iter().find(|(step, ..)| 8 * step >= 7 * stats.steps);
        if let Some(&(step, seconds, _)) = near_end
            && step > 0
            && stats.seconds > 0.0
        {
            let share = (seconds / step as f64 * stats.steps as f64 / stats.seconds).min(1.0);
            let took = took.as_secs_f64();
            let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            state.learn(stats.steps, share * took, (1.0 - share) * took);
        }
    }
}

impl State {
    /// Steps of each of `tiles` one after another in so many seconds; 0 where nothing was measured.
    fn steps(&self, left: f64, tiles: usize) -> usize {
        if self.stepping <= 0.0 {
            return 0;
        }
        let stepping = PLANNED * left / tiles as f64 - self.rest / self.tiles;
        (stepping * self.steps / self.stepping).max(0.0) as usize
    }

    fn learn(&mut self, steps: usize, stepping: f64, rest: f64) {
        let add = |old: &mut f64, new: f64| *old = MEMORY * *old + new;
        add(&mut self.tiles, 1.0);
        add(&mut self.steps, steps as f64);
        add(&mut self.stepping, stepping);
        add(&mut self.rest, rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_shared_by_the_tiles_that_are_left() {
        let mut state = State { open: 10, ..State::default() };
        assert_eq!(state.steps(100.0, 5), 0, "nothing was measured yet");
        // A millisecond a step, and a second for the rest.
        state.learn(200, 0.2, 1.0);
        assert_eq!(state.steps(100.0, 5), 18_000);
        assert_eq!(state.steps(5.0, 5), 0);
        // Twice as slow from now on: later tiles count more.
        (0..20).for_each(|_| state.learn(1000, 2.0, 2.0));
        assert!(state.steps(100.0, 5).abs_diff(8_500) < 50, "{state:?}");
    }

    /// Steps of `tiles` trained one after another, and the seconds of all; `rate` gives the seconds of a step of the i-th.
    fn simulate(tiles: usize, limit: f64, most: usize, rate: impl Fn(usize) -> f64) -> (Vec<usize>, f64) {
        let mut state = State { open: tiles, ..State::default() };
        state.learn(FLOOR, rate(0) * FLOOR as f64, 1.5);
        let mut now = 2.0;
        let steps = (0..tiles).map(|i| {
            let steps = state.steps(limit - now, tiles - i).clamp(FLOOR, most);
            let stepping = rate(i) * steps as f64;
            state.learn(steps, stepping, 1.5);
            now += stepping + 1.5;
            steps
        });
        (steps.collect(), now)
    }

    #[test]
    fn every_tile_gets_its_share_in_time() {
        let (steps, end) = simulate(30, 300.0, 1_000_000, |_| 1e-3);
        let (least, most) = (steps.iter().min().unwrap(), steps.iter().max().unwrap());
        assert!((290.0..=300.0).contains(&end) && 10 * most < 13 * least, "{end} {steps:?}");
        // A machine that turns twice as slow half-way: the later tiles take it, not the clock.
        let (steps, end) = simulate(30, 300.0, 1_000_000, |i| if i < 15 { 1e-3 } else { 2e-3 });
        assert!((285.0..=300.0).contains(&end) && steps.iter().all(|n| *n > 2500), "{end} {steps:?}");
        // Time for all that is asked; and for nothing: no tile is left out.
        assert_eq!(simulate(30, 3000.0, 12_000, |_| 1e-3).0, [12_000; 30]);
        assert_eq!(simulate(30, 1.0, 12_000, |_| 1e-3).0, [FLOOR; 30]);
    }

    #[test]
    fn a_tile_is_measured_by_the_clock() {
        let pace = Pace::new(Some(Instant::now() + Duration::from_secs(3600)), 10_000_000, 1);
        assert_eq!(pace.begin(), FLOOR, "nothing was measured yet");
        // 1000 steps in 1 of 3 CPU seconds, which took 6 seconds.
        let curve = vec![(500, 0.5, 30.0), (875, 0.875, 31.0), (1000, 1.0, 31.0), (1000, 2.0, 30.0)];
        let stats = TileStats {
            texels: 1,
            steps: 1000,
            psnr_unquantised_db: None,
            psnr_8bit_features_db: None,
            psnr_db: None,
            error: None,
            curve,
            left_out: vec![],
            seconds: 3.0,
        };
        pace.measure(&stats, Duration::from_secs(6));
        let expected = (PLANNED * 3600.0 - 4.0) / 2e-3;
        assert!((pace.begin() as f64 - expected).abs() < 0.001 * expected);
        assert_eq!(Pace::new(None, 777, 1).begin(), 777);
    }
}
