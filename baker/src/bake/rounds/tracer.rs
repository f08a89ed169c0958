//! Tracing the rounds: block by block, each brought to the samples of the round and written, and what all of
//! them reached.
//!
//! A run that continues trusts no block that is missing, damaged, or behind the finished rounds: such a block
//! is brought through the same steps again, which gives the same sums. Where something else that later work
//! was decided by is lost, all of it starts over.

use super::round::{Round, Traced, note, schedule, stops};
use super::round_summary::{BlockResult, summarise};
use super::step::Step;
use crate::Result;
use crate::atlas::Atlas;
use crate::bake::cache::{Covered, endless_light, solve};
use crate::bake::errors::{CachedLight, CellMap, Floors, TargetJudgement, UnconvergedCells, of_block};
use crate::bake::prepare::Limits;
use crate::bake::samples::{Cache, Class, Histogram, Pivot, Worker, classes, distinct, log2_shares};
use crate::bake::store::{
    BlockState, CELLS, DIRECT_FILE, PIVOT_FILE, Parts, ROUNDS_FILE, UNSETTLED_FILE, WorkFolder, cell_of,
};
use crate::receivers::ReceiverBlock;
use crate::trace::counts::{RayCounts, sum};
use dataset::host::signals::stop_if_interrupted;
use dataset::observe::{Observer, count};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

/// What rounds are traced with.
pub struct Tracer<'a> {
    /// Light, geometry and texels.
    pub worker: Worker<'a>,
    /// The surfaces that the cache lies on.
    pub atlas: &'a Atlas,
    /// Per frame, the layers being traced that it is made of.
    pub frames: Vec<Parts>,
    /// The page's cells.
    pub cell_map: &'a CellMap,
    /// Work so far.
    pub folder: &'a WorkFolder,
    /// Whether paths end in the cache.
    pub cached: bool,
    /// Layers of the whole bake, traced now or not.
    pub layers: usize,
}

/// All that decided what the blocks hold, by which one that is lost is traced again.
pub struct BlockHistory<'t> {
    /// The mean of each light over the pilot samples.
    direct_means: Vec<f32>,
    /// The samples whose direct light was drawn before the rounds, to solve the cache from.
    guaranteed_samples: Option<u32>,
    /// Whether more samples than those may come.
    has_target: bool,
    /// Whether blocks were brought beyond the first round before this run.
    is_beyond_first: bool,
    cache: Option<Cache<'t>>,
    /// The floors of the local light; `None` without a cache.
    floors: Option<Floors>,
    /// The rounds that every block was brought through.
    steps: Vec<Step>,
    /// Blocks that were traced again.
    retraced: AtomicUsize,
}

/// What came of the steps before the rounds.
struct BeforeRounds {
    direct_means: Vec<f32>,
    /// Blocks that were missing, damaged, or behind the finished rounds.
    lost: Vec<usize>,
    /// The last round that some block was brought through.
    furthest: u32,
    rays: RayCounts,
    /// Per block what the cache is laid out by, where there is to be one.
    covered: Vec<Covered>,
}

/// The cache of a run.
struct SolvedCache<'t> {
    /// `None` where it did not settle.
    cache: Option<Cache<'t>>,
    /// Whether an earlier run solved it.
    is_kept: bool,
}

/// A block as a run finds it.
struct FoundBlock {
    pilot_sums: Vec<f64>,
    usable: f64,
    is_lost: bool,
    /// Whether it was decided how many direct samples its texels get.
    is_decided: bool,
    round: u32,
    rays: RayCounts,
    covered: Option<Covered>,
}

/// Judges what was traced so far against a target, after denoising.
pub(crate) type JudgeTarget<'j> = &'j mut dyn FnMut(&Tracer, &BlockHistory, f64) -> Result<TargetJudgement>;

impl Tracer<'_> {
    /// Traces until a limit is reached. Towards a target, `judge` is asked once that may be near.
    pub fn run(
        &self,
        limits: &Limits,
        mut judge: Option<JudgeTarget>,
        console: &dyn Observer,
    ) -> Result<(Traced, BlockHistory<'_>)> {
        if let Some(done) = self.run_or_resume(limits, &mut judge, console)? {
            return Ok(done);
        }
        console.warn(
            "the unfinished work here cannot be continued, because files that its later steps depend on were lost or damaged: it starts over",
        );
        self.folder.restart()?;
        self.run_or_resume(limits, &mut judge, console)?.ok_or_else(|| self.folder.changed())
    }

    /// Whether there is light for a cache, and one is wanted.
    fn is_cached(&self) -> bool {
        self.cached && self.worker.transport.lights.layers() > 0
    }

    /// Begins the work, or goes on with it; `None` where what is there does not allow that.
    fn run_or_resume(
        &self,
        limits: &Limits,
        judge: &mut Option<JudgeTarget>,
        console: &dyn Observer,
    ) -> Result<Option<(Traced, BlockHistory<'_>)>> {
        let blocks = self.worker.blocks();
        let rounds: Vec<Round> = self.folder.read(ROUNDS_FILE)?.unwrap_or_default();
        let schedule = schedule(limits);
        // (Another version may have gone by other rounds.)
        if rounds.iter().zip(&schedule).any(|(round, &samples)| round.samples != samples)
            || rounds.len() > schedule.len()
        {
            return Ok(None);
        }
        let before = rounds.last().map_or(0.0, |r| r.seconds);
        // An earlier run whose time ran out during its last round had come to its end.
        let out_of_time = rounds.last().is_some_and(|round| round.is_late);
        let mut traced = Traced { resumed: rounds.len(), rounds, out_of_time, ..Traced::default() };
        // The rounds that every block was brought through.
        let whole = traced.resumed - usize::from(out_of_time);
        let start = Instant::now();
        // Towards a target or a time limit nobody knows how many rounds there will be: each has a bar of its
        // own.
        let has_target = limits.have_target();
        let guaranteed_samples = self.worker.guaranteed_samples;
        let Some(before_rounds) =
            self.before_rounds(&blocks, traced.resumed as u32, whole as u32, console)?
        else {
            return Ok(None);
        };
        traced.rays += before_rounds.rays;
        let mut history = BlockHistory {
            direct_means: before_rounds.direct_means,
            guaranteed_samples: None,
            has_target,
            is_beyond_first: before_rounds.furthest > 1 || traced.resumed > 1,
            cache: None,
            floors: None,
            steps: Vec::new(),
            retraced: AtomicUsize::new(0),
        };
        let is_begun = before_rounds.furthest > 0 || traced.resumed > 0;
        let mut is_solved = false;
        if self.is_cached() {
            // What the cache is solved from is what its light rests on: as much as is known to be drawn
            // anyway.
            history.guaranteed_samples = Some(guaranteed_samples);
            let Some(solved) = self.load_or_solve_cache(
                &blocks,
                before_rounds.covered,
                &history,
                is_begun,
                console,
                &mut traced,
            )?
            else {
                return Ok(None);
            };
            (history.cache, is_solved) = (solved.cache, solved.is_kept);
            // (The first round needs none.)
            if schedule.len() > 1 {
                history.floors = self.cached_light(&history).map(|cached| cached.floors()).transpose()?;
            }
        }
        if traced.resumed > 0 {
            console.say(format!("continuing after {} of an earlier run", count(traced.resumed, "round")));
        }
        let Some(steps) =
            self.finished_steps(&traced.rounds[..whole], &schedule, limits, &blocks, &history, console)?
        else {
            return Ok(None);
        };
        history.steps = steps;
        if traced.resumed > 0 || is_solved {
            traced.rays += self.retrace(&before_rounds.lost, &history, console)?;
        }
        let work = |samples: u32| u64::from(samples) * blocks.len() as u64;
        let mut progress = console.progress("tracing", work(guaranteed_samples));
        // What each block reached in the round before, as far as this run knows.
        let mut known: Vec<Option<BlockResult>> = blocks.iter().map(|_| None).collect();
        for (round, &target) in schedule.iter().enumerate() {
            let previous = if round == 0 { 0 } else { schedule[round - 1] };
            if round < traced.resumed {
                progress.advance(work(target - previous));
                continue;
            }
            if traced.out_of_time {
                break;
            }
            if limits.target_error.is_some() && traced.rounds.last().is_some_and(|r| !r.is_missed) {
                break;
            }
            if round > 0 && limits.deadline.is_some_and(|d| Instant::now() >= d) {
                traced.out_of_time = true;
                break;
            }
            if has_target && round > 0 {
                progress = console.progress(&format!("round of {target} samples"), work(target - previous));
                if let Some(last) = traced.rounds.last() {
                    progress.note(&note(last, limits));
                }
            }
            let Some(step) = self.plan_step(target, limits, &traced.rounds, &blocks, &history, console)?
            else {
                return Ok(None);
            };
            let late = AtomicBool::new(false);
            // Per block sums, merged afterwards in block order: floating-point sums must not depend on the
            // threads.
            let of_block = |(&block, known): (&usize, Option<BlockResult>)| {
                let receivers = self.worker.block(block);
                let done = match known.filter(|_| !step.concerns(&receivers)) {
                    Some(known) => BlockResult { rays: RayCounts::default(), ..known },
                    None => self.trace_block(block, &receivers, &step, &history, &late)?,
                };
                progress.advance(u64::from(target - previous));
                Ok(done)
            };
            let done: Vec<BlockResult> = blocks.par_iter().zip(known).map(of_block).collect::<Result<_>>()?;
            done.iter().for_each(|block| traced.rays += block.rays);
            if traced.rays.endless > 0 {
                return Err(endless_light::error(self.worker.transport.space.geometry));
            }
            let mut reached = summarise(
                self.worker.receivers.size(),
                &self.frames,
                self.cell_map,
                &done,
                target,
                before + start.elapsed().as_secs_f64(),
            );
            let number = step.round;
            reached.is_late = late.into_inner();
            if !reached.is_late {
                history.steps.push(Step { deadline: None, ..step });
            }
            if let Some(target) = limits.target_error {
                let mut unconverged = UnconvergedCells::find(
                    self.cell_map,
                    target,
                    self.frames.len(),
                    done.iter().map(BlockResult::cells),
                );
                if let Some(judge) = judge
                    && is_worth_denoising(&unconverged, &reached, target)
                {
                    drop(progress);
                    let judged = judge(self, &history, target)?;
                    progress = console.progress("denoised", 1);
                    progress.advance(1);
                    (unconverged, reached.denoised) = (judged.unconverged, judged.local);
                }
                (reached.unconverged_cells, reached.is_missed) = (unconverged.count(), !unconverged.is_met());
                self.folder.write_sealed(&unconverged_name(number), &[&unconverged.bytes()])?;
            }
            progress.note(&note(&reached, limits));
            traced.out_of_time = reached.is_late;
            traced.rounds.push(reached);
            known = match limits.target_error {
                Some(_) => done.into_iter().map(Some).collect(),
                None => blocks.iter().map(|_| None).collect(),
            };
            // A round reported as finished must be found finished, after a power failure too.
            self.folder.sync_blocks(&blocks)?;
            self.folder.write(ROUNDS_FILE, &traced.rounds)?;
        }
        Ok(Some((traced, history)))
    }

    /// The round that comes after `rounds`, which goes for `target` samples; `None` where what decides it is
    /// lost.
    fn plan_step(
        &self,
        target: u32,
        limits: &Limits,
        rounds: &[Round],
        blocks: &[usize],
        history: &BlockHistory,
        console: &dyn Observer,
    ) -> Result<Option<Step>> {
        let (finished, first) = (rounds.len() as u32, rounds.first());
        let before = rounds.last().map_or(0, |round| round.samples);
        let is_aimed = limits.target_error.is_some();
        let pivot = match first {
            Some(first) if !is_aimed => match self.folder.read(PIVOT_FILE)? {
                Some(kept) => Pivot::OfPage(kept),
                // Decided by the first round's samples: later there are others.
                None if history.is_beyond_first => return Ok(None),
                None => Pivot::OfPage(self.pivot(blocks, &first.frame_means, history, console)?),
            },
            _ => Pivot::OfCell,
        };
        let unconverged = match is_aimed && finished > 0 {
            true => match self.unconverged_after(finished)? {
                Some(unconverged) => Some(unconverged),
                None => return Ok(None),
            },
            false => None,
        };
        Ok(Some(Step {
            round: finished + 1,
            before,
            target,
            stops: stops(limits, before, target),
            deadline: limits.deadline.filter(|_| finished > 0),
            pivot,
            first_means: first.map(|first| first.frame_means.clone()),
            unconverged,
        }))
    }

    /// The cells that were unconverged after a round; `None` where that is not known.
    fn unconverged_after(&self, round: u32) -> Result<Option<UnconvergedCells>> {
        let bytes = self.folder.read_sealed(&unconverged_name(round))?;
        Ok(bytes.and_then(|bytes| UnconvergedCells::from_bytes(self.cell_map.grid(), &bytes)))
    }

    /// What comes before the rounds: which points are a texel's surface, the pilot samples of its direct
    /// light, and the first that count. `None` where the blocks hold more than what is kept of the decisions
    /// about them. Of the `finished` rounds every block was brought through `whole`.
    fn before_rounds(
        &self,
        blocks: &[usize],
        finished: u32,
        whole: u32,
        console: &dyn Observer,
    ) -> Result<Option<BeforeRounds>> {
        let progress = console.progress("direct light", blocks.len() as u64);
        let lights = self.worker.transport.lights.sampled();
        let is_cached = self.is_cached();
        let of_block = |&block: &usize| {
            stop_if_interrupted()?;
            let receivers = self.worker.block(block);
            let texels = receivers.covered().count();
            let found = self.folder.read_block(block, texels)?;
            let is_lost = found.as_ref().is_none_or(|state| state.round < whole);
            let mut state = found.unwrap_or_else(|| self.folder.empty_block(texels));
            let mut rays = RayCounts::default();
            if self.first_light(&receivers, &mut state, &mut rays) {
                stop_if_interrupted()?;
                self.folder.write_block(block, &state)?;
            }
            progress.advance(1);
            let (pilot_sums, usable) = state.pilot_sums(lights);
            let (is_decided, round) = (!state.direct_budgets.is_empty(), state.round);
            // (The cache is laid out by it. The points are at hand now, and are not read again for that.)
            let covered = is_cached.then(|| solve::covered(&self.worker, &receivers, &state.points));
            Ok(FoundBlock { pilot_sums, usable, is_lost, is_decided, round, rays, covered })
        };
        let mut found = blocks.par_iter().map(of_block).collect::<Result<Vec<_>>>()?;
        let furthest = found.iter().map(|block| block.round).max().unwrap_or(0);
        // A block goes one round further than the last finished one, at most. A run that continues finds no
        // pilot samples in blocks that were decided: what is decided by stays what it was.
        let kept = self.folder.read(DIRECT_FILE)?;
        if furthest > finished + 1 || kept.is_none() && found.iter().any(|block| block.is_decided) {
            return Ok(None);
        }
        let (mut means, mut values) = (vec![0.0; lights], 0.0);
        for block in &found {
            means.iter_mut().zip(&block.pilot_sums).for_each(|(mean, sum)| *mean += sum);
            values += block.usable;
        }
        let mean = |sum: &f64| (sum / f64::max(values, 1.0)) as f32;
        let direct_means = match kept {
            Some(kept) => kept,
            None => self.folder.kept(DIRECT_FILE, || Ok(means.iter().map(mean).collect()))?,
        };
        let lost = blocks.iter().zip(&found).filter(|(_, block)| block.is_lost).map(|(&block, _)| block);
        let lost = lost.collect();
        let covered = found.iter_mut().filter_map(|block| block.covered.take()).collect();
        let rays = sum(found.iter().map(|block| block.rays));
        Ok(Some(BeforeRounds { direct_means, lost, furthest, rays, covered }))
    }

    /// Finds the points of a block's texels and draws its pilot samples and its first ones; whether there was
    /// anything to do.
    fn first_light(&self, receivers: &ReceiverBlock, state: &mut BlockState, rays: &mut RayCounts) -> bool {
        let is_new = state.points.is_empty() && !state.taken.is_empty();
        if is_new {
            *rays += self.worker.find_points(receivers, state);
            *rays += self.worker.first_direct(receivers, state);
        }
        is_new
    }

    /// The cache. `None` where it is lost and cannot be made as it was, because rounds came after it
    /// (`is_begun`).
    fn load_or_solve_cache(
        &self,
        blocks: &[usize],
        covered: Vec<Covered>,
        history: &BlockHistory,
        is_begun: bool,
        console: &dyn Observer,
        traced: &mut Traced,
    ) -> Result<Option<SolvedCache<'_>>> {
        // A run that continues finds more direct light than the solver did: it must not try again.
        if let Some(passes) = self.folder.read(UNSETTLED_FILE)? {
            traced.without_cache(passes);
            return Ok(Some(SolvedCache { cache: None, is_kept: true }));
        }
        let (map, counts) = solve::map(&self.worker, self.atlas, covered, self.layers);
        traced.rays += counts;
        let layers = self.worker.transport.lights.layers();
        if let Some(halves) = solve::load(self.folder, map.entries(), layers)? {
            let cache = Some(Cache::new(&self.worker, map, halves));
            return Ok(Some(SolvedCache { cache, is_kept: true }));
        }
        if is_begun {
            return Ok(None);
        }
        let samples = history.guaranteed_samples.unwrap_or(0);
        // The first half is traced block by block, as more direct light comes to it; the second reads what
        // that left.
        let refined = |block: usize, half: usize| match half {
            0 => self.refine_direct(block, samples, &history.direct_means),
            _ => Ok((
                self.folder.expect_block(block, self.worker.block(block).covered().count())?,
                RayCounts::default(),
            )),
        };
        let (cache, solution, counts) =
            solve::fill(&self.worker, &refined, map, blocks, (samples, !history.has_target), console)?;
        traced.rays += counts;
        if !solution.settled {
            self.folder.write(UNSETTLED_FILE, &solution.passes)?;
            traced.without_cache(solution.passes);
            return Ok(Some(SolvedCache { cache: None, is_kept: false }));
        }
        solve::store(self.folder, &cache.halves)?;
        Ok(Some(SolvedCache { cache: Some(cache), is_kept: false }))
    }

    /// Brings the direct light of a block to the samples that go with `samples` of indirect light.
    fn refine_direct(&self, block: usize, samples: u32, means: &[f32]) -> Result<(BlockState, RayCounts)> {
        let receivers = self.worker.block(block);
        let mut state = self.folder.expect_block(block, receivers.covered().count())?;
        let counts = self.worker.more_direct(&receivers, &mut state, &[true; CELLS], samples, means);
        stop_if_interrupted()?;
        self.folder.write_block(block, &state)?;
        Ok((state, counts))
    }

    /// The steps of the finished `rounds`; `None` where what decided one of them is lost.
    fn finished_steps(
        &self,
        rounds: &[Round],
        schedule: &[u32],
        limits: &Limits,
        blocks: &[usize],
        history: &BlockHistory,
        console: &dyn Observer,
    ) -> Result<Option<Vec<Step>>> {
        let mut steps = Vec::new();
        for (round, &target) in schedule.iter().enumerate().take(rounds.len()) {
            match self.plan_step(target, limits, &rounds[..round], blocks, history, console)? {
                // (What is traced again has all the time it takes.)
                Some(step) => steps.push(Step { deadline: None, ..step }),
                None => return Ok(None),
            }
        }
        Ok(Some(steps))
    }

    /// Brings blocks that were lost through the steps of all others.
    fn retrace(&self, lost: &[usize], history: &BlockHistory, console: &dyn Observer) -> Result<RayCounts> {
        let progress = console.progress("tracing again", lost.len() as u64);
        let of_block = |&block: &usize| {
            let mut rays = RayCounts::default();
            self.block_state(block, &self.worker.block(block), history, &mut rays)?;
            progress.advance(1);
            Ok(rays)
        };
        let rays = sum(lost.par_iter().map(of_block).collect::<Result<Vec<_>>>()?);
        history.report_retraced(console);
        Ok(rays)
    }

    /// A block as all steps left it. One that is missing, damaged, or behind them is traced again.
    pub fn block_state(
        &self,
        block: usize,
        receivers: &ReceiverBlock,
        history: &BlockHistory,
        rays: &mut RayCounts,
    ) -> Result<BlockState> {
        stop_if_interrupted()?;
        let texels = receivers.covered().count();
        let found = self.folder.read_block(block, texels)?;
        let is_whole = |state: &BlockState| {
            // (Of a block that has no round yet, the direct light may be less than what the cache was solved
            // from.)
            let is_refined = history.guaranteed_samples.is_none()
                || !state.direct_budgets.is_empty()
                || state.direct.is_empty();
            let mut left = history.steps.iter().skip(state.round as usize);
            is_refined && !left.any(|step| step.concerns(receivers))
        };
        let mut state = match found {
            Some(state) if is_whole(&state) => return Ok(state),
            Some(state) => state,
            None => self.folder.empty_block(texels),
        };
        history.retraced.fetch_add(1, Ordering::Relaxed);
        self.first_light(receivers, &mut state, rays);
        if let Some(samples) = history.guaranteed_samples {
            *rays += self.worker.more_direct(
                receivers,
                &mut state,
                &[true; CELLS],
                samples,
                &history.direct_means,
            );
        }
        for step in history.steps.iter().skip(state.round as usize) {
            self.advance_block(block, receivers, &mut state, step, history, rays);
        }
        stop_if_interrupted()?;
        self.folder.write_block(block, &state)?;
        Ok(state)
    }

    /// Brings one block through one round; whether its time ran out on the way.
    fn advance_block(
        &self,
        block: usize,
        receivers: &ReceiverBlock,
        state: &mut BlockState,
        step: &Step,
        history: &BlockHistory,
        rays: &mut RayCounts,
    ) -> bool {
        // Once the first round is done, shares are decided, once per block.
        if let (Some(means), true) = (&step.first_means, state.log2_shares.is_empty()) {
            let classes = self.classes(receivers, state, means, history);
            state.log2_shares = log2_shares(&classes, receivers, step.pivot);
        }
        let active = step.active(receivers);
        let mut is_late = false;
        for samples in step.slices().filter(|_| active.contains(&true)) {
            *rays += self.worker.more_direct(receivers, state, &active, samples, &history.direct_means);
            *rays +=
                self.worker.indirect(block, receivers, state, &active, samples / 2, history.cache.as_ref());
            if samples < step.target && step.is_late() {
                is_late = true;
                break;
            }
        }
        state.round = step.round;
        is_late
    }

    /// Brings one block through one round and gives its error sums.
    fn trace_block(
        &self,
        block: usize,
        receivers: &ReceiverBlock,
        step: &Step,
        history: &BlockHistory,
        late: &AtomicBool,
    ) -> Result<BlockResult> {
        let mut rays = RayCounts::default();
        let mut state = self.block_state(block, receivers, history, &mut rays)?;
        // (A block without samples to get is left as it is: it need not be written.)
        if state.round < step.round && step.concerns(receivers) {
            if step.is_late() {
                late.store(true, Ordering::Relaxed);
            } else {
                if self.advance_block(block, receivers, &mut state, step, history, &mut rays) {
                    late.store(true, Ordering::Relaxed);
                }
                stop_if_interrupted()?;
                self.folder.write_block(block, &state)?;
            }
        }
        let cells = of_block(&self.frames, self.worker.transport.lights, receivers, &state, self.cell_map);
        let mut usable = [0; CELLS];
        let usable_texels = receivers.covered().enumerate().filter(|&(i, _)| state.is_usable(i));
        usable_texels.for_each(|(_, texel)| usable[cell_of(receivers, texel)] += 1);
        let drawn = state.drawn.iter().filter(|drawn| **drawn > 0);
        let (texels, samples) =
            (drawn.clone().count() as u32, drawn.map(|drawn| 2 * u64::from(*drawn)).sum());
        Ok(BlockResult { x0: receivers.x0, y0: receivers.y0, usable, cells, texels, samples, rays })
    }

    /// The classes of a block's texels, relative to the local light; without a cache, relative to `means`,
    /// each frame's mean over the page in the first round. Frames whose mean is 0 do not count.
    fn classes(
        &self,
        receivers: &ReceiverBlock,
        state: &BlockState,
        means: &[f64],
        history: &BlockHistory,
    ) -> Vec<Class> {
        let lit: Vec<usize> =
            distinct(&self.frames).into_iter().filter(|&frame| means[frame] > 0.0).collect();
        let frames: Vec<&Parts> = lit.iter().map(|&frame| &self.frames[frame]).collect();
        let lights = self.worker.transport.lights;
        match self.cached_light(history).zip(history.floors.as_ref()) {
            Some((cached, floors)) => {
                let local = cached.local_light(receivers, &lit, floors);
                classes(&frames, |place, texel| local[place][texel], lights, receivers, state)
            }
            None => classes(&frames, |place, _| means[lit[place]], lights, receivers, state),
        }
    }

    /// The cached light of the frames; `None` without a cache.
    fn cached_light<'s>(&'s self, history: &'s BlockHistory) -> Option<CachedLight<'s>> {
        let (worker, cell_map, frames) = (&self.worker, self.cell_map, &self.frames);
        Some(CachedLight { worker, cache: history.cache.as_ref()?, cell_map, frames })
    }

    /// The class of deviation whose texels get the mean number of samples, from what the first round left.
    fn pivot(
        &self,
        blocks: &[usize],
        means: &[f64],
        history: &BlockHistory,
        console: &dyn Observer,
    ) -> Result<Option<i16>> {
        let progress = console.progress("allocating samples", blocks.len() as u64);
        let of_block = |&block: &usize| -> Result<Histogram> {
            stop_if_interrupted()?;
            let receivers = self.worker.block(block);
            let state = self.folder.expect_block(block, receivers.covered().count())?;
            let mut histogram = Histogram::default();
            histogram.add(self.classes(&receivers, &state, means, history));
            progress.advance(1);
            Ok(histogram)
        };
        let merged = |mut all: Histogram, other: Histogram| {
            all.merge(&other);
            Ok(all)
        };
        let pivot = blocks.par_iter().map(of_block).try_reduce(Histogram::default, merged)?.pivot();
        self.folder.write(PIVOT_FILE, &pivot)?;
        Ok(pivot)
    }
}

impl BlockHistory<'_> {
    /// Says how many blocks were traced again since it was last asked.
    pub fn report_retraced(&self, console: &dyn Observer) {
        let retraced = self.retraced.swap(0, Ordering::Relaxed);
        if retraced > 0 {
            console.warn(format!(
                "{} of the unfinished work here {} missing, damaged, or older than its finished rounds: traced again",
                count(retraced, "block"),
                if retraced == 1 { "was" } else { "were" }
            ));
        }
    }
}

/// Whether light may meet a target after denoising.
fn is_worth_denoising(unconverged: &UnconvergedCells, reached: &Round, target: f64) -> bool {
    /// Hardly ever does the error that 95 % of the texels keep below fall by more.
    const FALLS: f64 = 4.0;
    let worst = reached.local_frames.iter().flatten().map(|local| local.p95).fold(0.0, f64::max);
    !unconverged.is_dark && worst <= FALLS * target
}

/// The name under which the unconverged cells of a round are kept, for a run that continues after it.
fn unconverged_name(round: u32) -> String {
    format!("unconverged-{round}.bin")
}
