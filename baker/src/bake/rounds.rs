//! Tracing in rounds: each doubles the samples of every block, so that an estimate with its error exists early and
//! improves to the end.

use super::errors::{Errors, of_block};
use super::json;
use super::plan::Plan;
use super::state::{BlockState, StateFolder};
use crate::atlas::Atlas;
use crate::surface::{BlockSurface, FaceBins};
use crate::trace::sampler::Sequence;
use crate::trace::walk::{RayCounts, Transport};
use crate::{Error, Result, Rgb};
use dataset::console::{Console, interrupted, stop_if_interrupted};
use dataset::files::write_atomically;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Mutex;
use std::time::Instant;

/// What a round reached.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Round {
    /// Samples per texel after it.
    pub samples: u32,
    /// Seconds of tracing up to its end, over all runs of this bake.
    pub seconds: f64,
    /// Median relative error over (tile, set).
    pub median_error: f64,
    /// 95th percentile.
    pub p95_error: f64,
    /// The largest.
    pub worst_error: f64,
    /// Relative error of every set over the whole page.
    pub set_errors: Vec<Option<f64>>,
}

/// The result of tracing.
#[derive(Debug)]
pub struct Traced {
    /// One entry per round.
    pub rounds: Vec<Round>,
    /// The last round's error table.
    pub errors: Errors,
    /// Rays traced by this run (not by earlier runs it continued).
    pub rays: RayCounts,
    /// Samples per texel this run found done.
    pub resumed_samples: u32,
}

/// The sample counts after each round: up to six doublings that end at `samples`.
pub fn schedule(samples: u32) -> Vec<u32> {
    (0..6).rev().map(|k| samples >> k).filter(|&n| n >= 2).collect()
}

/// What a round's tracing works with.
pub struct Tracer<'a> {
    /// Light and geometry.
    pub transport: Transport<'a>,
    /// What is traced.
    pub plan: &'a Plan,
    /// Where texels lie.
    pub atlas: &'a Atlas,
    /// The faces of each block.
    pub bins: &'a FaceBins,
    /// Work so far.
    pub folder: &'a StateFolder,
    /// Seed of all randomness.
    pub seed: u64,
}

impl Tracer<'_> {
    /// Traces until every texel has `samples` samples.
    pub fn run(&self, samples: u32, console: &Console) -> Result<Traced> {
        let blocks: Vec<usize> =
            (0..self.bins.columns * self.bins.rows).filter(|&b| !self.bins.faces(b).is_empty()).collect();
        let log_path = self.folder.root().join("rounds.json");
        let mut rounds: Vec<Round> =
            std::fs::read(&log_path).ok().and_then(|b| serde_json::from_slice(&b).ok()).unwrap_or_default();
        rounds.retain(|r| r.samples < samples);
        let before = rounds.last().map_or(0.0, |r| r.seconds);
        let resumed_samples = rounds.last().map_or(0, |r| r.samples);
        let start = Instant::now();
        let total = u64::from(samples - resumed_samples.min(samples)) * blocks.len() as u64;
        let progress = console.progress("tracing", total);
        let mut rays = RayCounts::default();
        let mut errors = None;
        for target in schedule(samples) {
            if target <= resumed_samples && target < samples {
                continue;
            }
            let previous = rounds.last().map_or(0, |r| r.samples);
            let counted = Mutex::new(RayCounts::default());
            // Per block sums, merged afterwards in block order: floating-point sums must not depend on the threads.
            let sums: Vec<_> = blocks
                .par_iter()
                .map(|&block| {
                    let result = self.block(block, target, samples)?;
                    *counted.lock().unwrap_or_else(|e| e.into_inner()) += result.1;
                    progress.advance(u64::from(target - previous));
                    Ok((block, result.0))
                })
                .collect::<Result<_>>()?;
            let (width, height) = (self.atlas.width as usize, self.atlas.height as usize);
            let mut table = Errors::new(width, height, self.plan.moments.len());
            for (block, sums) in &sums {
                let (x0, y0) = self.corner(*block);
                table.add(x0, y0, sums);
            }
            rays += counted.into_inner().unwrap_or_else(|e| e.into_inner());
            let round = summarise(&table, target, before + start.elapsed().as_secs_f64());
            progress.note(&format!("error {:.2} % at {target} samples", round.median_error * 100.0));
            rounds.push(round);
            write_atomically(&log_path, &json::bytes(&rounds, "rounds")?)?;
            errors = Some(table);
        }
        let Some(errors) = errors else {
            return Err(Error::invalid("bake", "needs at least 2 samples per texel"));
        };
        Ok(Traced { rounds, errors, rays, resumed_samples })
    }

    fn corner(&self, block: usize) -> (usize, usize) {
        use crate::surface::BLOCK;
        ((block % self.bins.columns) * BLOCK, (block / self.bins.columns) * BLOCK)
    }

    /// Brings one block to at least `target` samples and gives its error sums. An earlier run that asked for more than
    /// `most` left too many: the block starts again, so that the texels never depend on what stood there.
    fn block(&self, block: usize, target: u32, most: u32) -> Result<(Vec<super::errors::Sums>, RayCounts)> {
        let surface = BlockSurface::new(self.atlas, self.bins, block);
        let covered: Vec<usize> =
            (0..surface.width * surface.height).filter(|&t| surface.is_covered(t)).collect();
        let layers = self.plan.layers();
        let mut state = self.folder.read(block, covered.len())?;
        if state.samples > most {
            state = BlockState::empty(covered.len(), layers);
        }
        let mut counts = RayCounts::default();
        if state.samples < target && !covered.is_empty() {
            let range = state.samples / 2..target / 2;
            let traced: Vec<RayCounts> = state
                .sums
                .par_chunks_mut((2 * layers).max(1))
                .zip(&mut state.exposed)
                .zip(&covered)
                .with_min_len(64)
                .map(|((sums, exposed), &texel)| self.texel(&surface, texel, range.clone(), sums, exposed))
                .collect();
            stop_if_interrupted()?;
            traced.into_iter().for_each(|c| counts += c);
            state.samples = target;
            self.folder.write(block, &state)?;
        }
        Ok((of_block(self.plan, &state), counts))
    }

    /// Adds samples to one texel: the same points in both halves' numbering, independently scrambled.
    fn texel(
        &self,
        surface: &BlockSurface,
        texel: usize,
        samples: std::ops::Range<u32>,
        sums: &mut [Rgb],
        exposed: &mut [u32; 2],
    ) -> RayCounts {
        let mut counts = RayCounts::default();
        if interrupted() {
            return counts;
        }
        let (x, y) = (surface.x0 + texel % surface.width, surface.y0 + texel / surface.width);
        let index = y as u32 * self.atlas.width + x as u32;
        let layers = self.plan.layers();
        for half in 0..2 {
            let sequence = Sequence::new(self.seed, 0, index, half as u32);
            let out = &mut sums[half * layers..(half + 1) * layers];
            for sample in samples.clone().map(|index| sequence.sample(index)) {
                let point = surface.sample(self.atlas, texel, sample.pair(0));
                exposed[half] += u32::from(self.transport.gather(&point, sample, out, &mut counts));
            }
        }
        counts
    }
}

fn summarise(errors: &Errors, samples: u32, seconds: f64) -> Round {
    let mut relative = errors.relative();
    relative.sort_by(f64::total_cmp);
    let at = |q: f64| relative.get(((relative.len() as f64 - 1.0) * q) as usize).copied().unwrap_or(0.0);
    Round {
        samples,
        seconds,
        median_error: at(0.5),
        p95_error: at(0.95),
        worst_error: at(1.0),
        set_errors: (0..errors.tiles.len()).map(|s| errors.relative_of_set(s)).collect(),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn rounds_double_and_end_at_the_samples_asked_for() {
        assert_eq!(super::schedule(64), [2, 4, 8, 16, 32, 64]);
        assert_eq!(super::schedule(2), [2]);
        assert_eq!(super::schedule(1024), [32, 64, 128, 256, 512, 1024]);
    }
}
