//! Tracing the rounds: block by block, each brought to the samples of the round and written, and what all of them reached.

use super::allocate::{Class, Histogram, Pivot, classes, distinct, log2_shares};
use super::block::{Worker, sum};
use super::endless;
use super::errors::{Errors, Parts, Sums, cell_of, median, of_block};
use super::indirect::Cache;
use super::open::{Block, OpenCells};
use super::rounds::{Limits, Round, Traced, note, schedule, total_of};
use super::solve;
use super::state::{BlockState, CELLS};
use super::work::{CACHE, DIRECT, PIVOT, ROUNDS, UNSETTLED, WorkFolder};
use crate::surface::BlockSurface;
use crate::trace::counts::RayCounts;
use crate::{Error, Result};
use dataset::console::{Console, count, stop_if_interrupted};
use dataset::files::write_atomically;
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// What rounds are traced with.
pub struct Tracer<'a> {
    /// Light, geometry and texels.
    pub worker: Worker<'a>,
    /// Per set, the layers being traced that it is made of.
    pub sets: Vec<Parts>,
    /// Work so far.
    pub folder: &'a WorkFolder,
    /// Whether walks end in the cache.
    pub cached: bool,
    /// Layers of the whole bake, traced now or not.
    pub layers: usize,
}

impl Tracer<'_> {
    /// Traces until a limit is reached.
    pub fn run(&self, limits: &Limits, console: &Console) -> Result<Traced> {
        let blocks = self.worker.blocks();
        let rounds: Vec<Round> = self.folder.read(ROUNDS).unwrap_or_default();
        let before = rounds.last().map_or(0.0, |r| r.seconds);
        let mut traced = Traced { resumed: rounds.len(), rounds, ..Traced::default() };
        let start = Instant::now();
        let schedule = schedule(limits);
        // Towards a target or a time limit nobody knows how many rounds there will be: each has a bar of its own.
        let is_open = limits.target_error.is_some() || limits.deadline.is_some();
        let (direct_means, rays) = self.before_rounds(&blocks, console)?;
        traced.rays += rays;
        // What the cache is solved from is what its light rests on: as much as is known to be drawn anyway.
        let certain = if is_open { schedule[0] } else { total_of(&schedule) };
        let cache = self.cache(&blocks, certain, &direct_means, console, &mut traced)?;
        let work = |samples: u32| u64::from(samples) * blocks.len() as u64;
        let mut progress =
            console.progress("tracing", work(if is_open { schedule[0] } else { total_of(&schedule) }));
        if traced.resumed > 0 {
            console.say(format!("continuing after {} of an earlier run", count(traced.resumed, "round")));
        }
        for (round, &target) in schedule.iter().enumerate() {
            let previous = if round == 0 { 0 } else { schedule[round - 1] };
            if round < traced.resumed {
                progress.advance(work(target - previous));
                continue;
            }
            if limits.target_error.is_some() && traced.rounds.last().is_some_and(|r| r.open_cells == 0) {
                break;
            }
            if round > 0 && limits.deadline.is_some_and(|d| Instant::now() >= d) {
                traced.out_of_time = true;
                break;
            }
            if is_open && round > 0 {
                progress = console.progress(&format!("round of {target} samples"), work(target - previous));
                if let Some(last) = traced.rounds.last() {
                    progress.note(&note(last, limits));
                }
            }
            let step = self.step(target, limits, &traced.rounds, &direct_means, &blocks, console)?;
            let late = AtomicBool::new(false);
            // Per block sums, merged afterwards in block order: floating-point sums must not depend on the threads.
            let of_block = |&block: &usize| {
                let done = self.block(block, &step, cache.as_ref(), &late)?;
                progress.advance(u64::from(target - previous));
                Ok(done)
            };
            let done: Vec<Done> = blocks.par_iter().map(of_block).collect::<Result<_>>()?;
            done.iter().for_each(|block| traced.rays += block.rays);
            if traced.rays.endless > 0 {
                return Err(endless::error(self.worker.transport.space.geometry));
            }
            let mut reached = self.summarise(&done, target, before + start.elapsed().as_secs_f64());
            if let Some(target) = limits.target_error {
                let open =
                    OpenCells::find(self.page(), target, &reached.set_means, done.iter().map(Done::cells));
                reached.open_cells = open.count();
                write_atomically(&self.open_path(step.round), &open.bytes())?;
            }
            progress.note(&note(&reached, limits));
            traced.rounds.push(reached);
            self.folder.write(ROUNDS, &traced.rounds)?;
            if late.into_inner() {
                traced.out_of_time = true;
                break;
            }
        }
        Ok(traced)
    }

    /// The round that comes after `rounds`, which goes for `target` samples.
    fn step<'a>(
        &self,
        target: u32,
        limits: &Limits,
        rounds: &'a [Round],
        direct_means: &'a [f32],
        blocks: &[usize],
        console: &Console,
    ) -> Result<Step<'a>> {
        let (finished, first, last) = (rounds.len(), rounds.first(), rounds.last());
        let is_aimed = limits.target_error.is_some();
        let pivot = match first {
            Some(first) if !is_aimed => Pivot::OfPage(self.pivot(blocks, &first.set_means, console)?),
            _ => Pivot::OfCell,
        };
        let open = last.filter(|_| is_aimed).map(|_| self.open_after(finished as u32)).transpose()?;
        let deadline = limits.deadline.filter(|_| finished > 0);
        Ok(Step { round: finished as u32 + 1, target, deadline, direct_means, pivot, first, last, open })
    }

    /// Width and height in texels.
    fn page(&self) -> (usize, usize) {
        (self.worker.atlas.width as usize, self.worker.atlas.height as usize)
    }

    /// Where the open cells of a round are kept, for a run that continues after it.
    fn open_path(&self, round: u32) -> PathBuf {
        self.folder.path(&format!("open-{round}.bin"))
    }

    /// The cells that were open after a round.
    fn open_after(&self, round: u32) -> Result<OpenCells> {
        let (path, (width, height)) = (self.open_path(round), self.page());
        let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
        let wrong = || {
            Error::invalid(path.display().to_string(), "it does not fit the page; start anew with --force")
        };
        OpenCells::from_bytes(width, height, &bytes).ok_or_else(wrong)
    }

    /// What comes before the rounds: which points are a texel's surface, the trial samples of its direct light, and the first that
    /// count. The mean of each light over the trials of exposed texels, in the sum of its channels.
    fn before_rounds(&self, blocks: &[usize], console: &Console) -> Result<(Vec<f32>, RayCounts)> {
        let progress = console.progress("direct light", blocks.len() as u64);
        let lights = self.worker.transport.lights.sampled();
        let of_block = |&block: &usize| {
            stop_if_interrupted()?;
            let surface = self.worker.surface(block);
            let mut state = self.folder.read_block(block, surface.covered().count())?;
            let mut counts = RayCounts::default();
            if state.probes.is_empty() && !state.taken.is_empty() {
                counts += self.worker.probe(&surface, &mut state);
                counts += self.worker.first_direct(&surface, &mut state);
                stop_if_interrupted()?;
                self.folder.write_block(block, &state)?;
            }
            progress.advance(1);
            Ok((state.trial_sums(lights), counts))
        };
        let (mut means, mut values, mut counts) = (vec![0.0; lights], 0.0, RayCounts::default());
        for ((sums, n), c) in blocks.par_iter().map(of_block).collect::<Result<Vec<_>>>()? {
            means.iter_mut().zip(sums).for_each(|(m, s)| *m += s);
            (values, counts) = (values + n, counts + c);
        }
        // A run that continues finds no trials in blocks that were decided: what is decided by stays what it was.
        let mean = |sum: &f64| (sum / f64::max(values, 1.0)) as f32;
        let means = self.folder.kept(DIRECT, || Ok(means.iter().map(mean).collect()))?;
        Ok((means, counts))
    }

    /// The cache, solved from the direct samples that go with `samples` of indirect light.
    fn cache(
        &self,
        blocks: &[usize],
        samples: u32,
        direct_means: &[f32],
        console: &Console,
        traced: &mut Traced,
    ) -> Result<Option<Cache<'_>>> {
        if !self.cached || self.worker.transport.lights.layers() == 0 {
            return Ok(None);
        }
        // A run that continues finds more direct light than the solver did: it must not try again.
        if let Some(passes) = self.folder.read(UNSETTLED) {
            traced.without_cache(passes);
            return Ok(None);
        }
        let path = self.folder.path(CACHE);
        let (map, counts) = solve::map(&self.worker, self.folder, blocks, self.layers)?;
        traced.rays += counts;
        if let Some(halves) = solve::load(&path, map.entries(), self.worker.transport.lights.layers()) {
            return Ok(Some(Cache::new(&self.worker, map, halves)));
        }
        traced.rays += self.refine_direct(blocks, samples, direct_means, console)?;
        let (cache, solution, counts) =
            solve::fill(&self.worker, self.folder, map, blocks, samples, console)?;
        traced.rays += counts;
        if !solution.settled {
            self.folder.write(UNSETTLED, &solution.passes)?;
            traced.without_cache(solution.passes);
            return Ok(None);
        }
        solve::store(&path, &cache.halves)?;
        Ok(Some(cache))
    }

    /// Brings the direct light of all blocks to the samples that go with `samples` of indirect light.
    fn refine_direct(
        &self,
        blocks: &[usize],
        samples: u32,
        means: &[f32],
        console: &Console,
    ) -> Result<RayCounts> {
        let progress = console.progress("more direct light", blocks.len() as u64);
        let of_block = |&block: &usize| {
            stop_if_interrupted()?;
            let surface = self.worker.surface(block);
            let mut state = self.folder.read_block(block, surface.covered().count())?;
            let counts = self.worker.more_direct(&surface, &mut state, &[true; CELLS], samples, means);
            stop_if_interrupted()?;
            self.folder.write_block(block, &state)?;
            progress.advance(1);
            Ok(counts)
        };
        Ok(sum(blocks.par_iter().map(of_block).collect::<Result<Vec<_>>>()?))
    }

    /// Brings one block through one round and gives its error sums.
    fn block(&self, block: usize, step: &Step, cache: Option<&Cache>, late: &AtomicBool) -> Result<Done> {
        stop_if_interrupted()?;
        let surface = self.worker.surface(block);
        let mut state = self.folder.read_block(block, surface.covered().count())?;
        let mut rays = RayCounts::default();
        if state.round < step.round {
            if step.deadline.is_some_and(|d| Instant::now() >= d) {
                late.store(true, Ordering::Relaxed);
            } else {
                let mut bring_to = |state: &mut BlockState, active: &[bool; CELLS], samples: u32| {
                    rays += self.worker.more_direct(&surface, state, active, samples, step.direct_means);
                    rays += self.worker.indirect(block, &surface, state, active, samples / 2, cache);
                };
                if let (Some(first), true) = (step.first, state.log2_shares.is_empty()) {
                    // (A block whose file was lost begins anew.)
                    if state.round == 0 {
                        bring_to(&mut state, &[true; CELLS], first.samples);
                    }
                    let classes = self.classes(&surface, &state, &first.set_means);
                    state.log2_shares = log2_shares(&classes, &surface, step.pivot);
                }
                let all = [true; CELLS];
                let active = step.open.as_ref().map_or(all, |open| open.of_block(surface.x0, surface.y0));
                for samples in step.slices().filter(|_| active.contains(&true)) {
                    bring_to(&mut state, &active, samples);
                    if samples < step.target && step.deadline.is_some_and(|d| Instant::now() >= d) {
                        late.store(true, Ordering::Relaxed);
                        break;
                    }
                }
                stop_if_interrupted()?;
                state.round = step.round;
                self.folder.write_block(block, &state)?;
            }
        }
        let cells = of_block(&self.sets, self.worker.transport.lights, &surface, &state);
        let mut exposed = [0; CELLS];
        let places = surface.covered().enumerate().filter(|&(texel, _)| state.is_exposed(texel));
        places.for_each(|(_, place)| exposed[cell_of(&surface, place)] += 1);
        let drawn = state.drawn.iter().filter(|drawn| **drawn > 0);
        let (texels, samples) =
            (drawn.clone().count() as u32, drawn.map(|drawn| 2 * u64::from(*drawn)).sum());
        Ok(Done { x0: surface.x0, y0: surface.y0, exposed, cells, texels, samples, rays })
    }

    /// How much samples differ, by the first round; `means` are its.
    fn classes(&self, surface: &BlockSurface, state: &BlockState, means: &[f64]) -> Vec<Class> {
        classes(&distinct(&self.sets, means), self.worker.transport.lights, surface, state)
    }

    /// The class of deviation whose texels get the mean number of samples, from what the first round left.
    fn pivot(&self, blocks: &[usize], means: &[f64], console: &Console) -> Result<Option<i16>> {
        self.folder.kept(PIVOT, || {
            let progress = console.progress("allocating samples", blocks.len() as u64);
            let of_block = |&block: &usize| -> Result<Histogram> {
                stop_if_interrupted()?;
                let surface = self.worker.surface(block);
                let state = self.folder.read_block(block, surface.covered().count())?;
                let mut histogram = Histogram::default();
                histogram.add(self.classes(&surface, &state, means));
                progress.advance(1);
                Ok(histogram)
            };
            let merged = |mut all: Histogram, other: Histogram| {
                all.merge(&other);
                Ok(all)
            };
            Ok(blocks.par_iter().map(of_block).try_reduce(Histogram::default, merged)?.pivot())
        })
    }

    /// What the blocks reached, all together.
    fn summarise(&self, done: &[Done], samples: u32, seconds: f64) -> Round {
        let atlas = self.worker.atlas;
        let mut errors = Errors::new(atlas.width as usize, atlas.height as usize, self.sets.len());
        for block in done {
            for (set, cells) in block.cells.iter().enumerate() {
                let mut all = Sums::default();
                cells.iter().for_each(|c| all.add(c));
                errors.add(set, block.x0, block.y0, &all);
            }
        }
        let set_means: Vec<f64> = (0..self.sets.len()).map(|s| errors.set(s).mean()).collect();
        let mut relative = errors.relative(self.sets.iter().any(|parts| !parts.is_empty()));
        relative.sort_by(f64::total_cmp);
        let at = |q: f64| relative.get(((relative.len() as f64 - 1.0) * q) as usize).copied().unwrap_or(0.0);
        let texels: u64 = done.iter().map(|d| u64::from(d.texels)).sum();
        let drawn: u64 = done.iter().map(|d| d.samples).sum();
        Round {
            samples,
            mean_samples: drawn as f64 / texels.max(1) as f64,
            seconds,
            median_error: median(&relative),
            p95_error: at(0.95),
            worst_error: at(1.0),
            set_errors: (0..self.sets.len()).map(|s| errors.relative_of_set(s)).collect(),
            set_means,
            open_cells: 0,
        }
    }
}

/// One round, as a block sees it.
struct Step<'a> {
    /// Counted from 1.
    round: u32,
    /// Samples per texel, both halves together.
    target: u32,
    deadline: Option<Instant>,
    /// The mean direct light of each light.
    direct_means: &'a [f32],
    /// Whose texels get as many samples as the target says, after the first round.
    pivot: Pivot,
    /// The first round, if it is done.
    first: Option<&'a Round>,
    /// The round before.
    last: Option<&'a Round>,
    /// The cells that miss a target; without one, and in the first round, all get samples.
    open: Option<OpenCells>,
}

impl Step<'_> {
    /// Samples per texel at which a block looks at the clock. A round takes as long as all before it, and on a small page that is
    /// the time of one block: under a time limit it is traced in sixteen slices, which draw the same samples as the whole.
    fn slices(&self) -> impl Iterator<Item = u32> {
        const SLICES: u32 = 16;
        let before = self.last.map_or(0, |round| round.samples);
        let is_cut = self.deadline.is_some() && self.target >= before + 2 * SLICES;
        let slices = if is_cut { SLICES } else { 1 };
        // (Even numbers, for both halves draw as many.)
        let step = (self.target - before) / slices / 2 * 2;
        let target = self.target;
        (1..=slices).map(move |slice| if slice == slices { target } else { before + slice * step })
    }
}

/// A block after a round.
struct Done {
    x0: usize,
    y0: usize,
    /// The texels of each cell that light could reach.
    exposed: [u32; CELLS],
    cells: Vec<[Sums; CELLS]>,
    /// Texels that were given samples.
    texels: u32,
    /// Samples of indirect light over all of them.
    samples: u64,
    rays: RayCounts,
}

impl Done {
    fn cells(&self) -> Block<'_> {
        Block { x0: self.x0, y0: self.y0, exposed: self.exposed, sums: &self.cells }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_end_at_the_target_and_there_is_one_without_a_deadline() {
        let slices = |before: Option<u32>, target: u32, deadline| {
            let last = before.map(|samples| Round { samples, ..Round::default() });
            let step = Step {
                round: 2,
                target,
                deadline,
                direct_means: &[],
                pivot: Pivot::OfCell,
                first: None,
                last: last.as_ref(),
                open: None,
            };
            step.slices().collect::<Vec<u32>>()
        };
        assert_eq!(slices(Some(1 << 15), 1 << 16, None), [1 << 16]);
        let now = Some(Instant::now());
        let many = slices(Some(1 << 15), 1 << 16, now);
        assert_eq!((many.len(), many[0], many[15]), (16, (1 << 15) + (1 << 11), 1 << 16));
        assert!(many.windows(2).all(|pair| pair[0] < pair[1]) && many.iter().all(|n| n % 2 == 0));
        // A power of two need not lie between: what was asked for may be less than twice what was drawn.
        assert_eq!(slices(Some(16), 32, now), [32]);
        assert_eq!(slices(None, 2, now), [2]);
    }
}
