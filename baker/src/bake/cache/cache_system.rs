//! The balance of light, E = source + T E, over all entries of the cache: a sparse linear system.
//!
//! It is solved by passes that trace no rays. In each, light goes one bounce further. Where surfaces are
//! bright, that is slow; each layer and channel is therefore also rescaled as a whole, so that what all
//! entries send out agrees with what they get (a one-group rebalance, known from neutron transport).

use crate::trace::irradiance::CacheHalf;
use crate::{Error, Result, Rgb};
use dataset::host::signals::stop_if_interrupted;
use rayon::prelude::*;

/// Paths per entry and half that ordinary numbers of samples have at least.
pub(crate) const ORDINARY_PATHS: usize = 16;
/// Least paths per entry and half, whatever the samples.
pub(crate) const LEAST_PATHS: usize = 4;
/// Most passes.
const MOST_PASSES: usize = 400;
/// Largest change of the rescaling in the last pass.
const MOST_FACTOR_CHANGE: f64 = 1e-3;
/// Largest change of the last pass at an entry relative to its own light, on average over each run of
/// entries: a dim room beside a bright yard has to settle too.
const MOST_RUN_CHANGE: f64 = 5e-4;
/// Part of a layer's greatest light below which changes are judged by that.
const FAINT_PART: f32 = 1e-6;
/// Turns of the rescaling after which it is given up.
const MOST_TURNS: u32 = 3;
/// Entries of a run.
const RUN_ENTRIES: usize = 4096;
/// Light of all bounces, as a multiple of that before the first, from which on it is taken to grow without
/// end where surfaces absorb nothing.
const ENDLESS_GROWTH: f64 = 1e4;

/// Part of a run's entries that, gaining a four-hundredth of their light by the last pass, keep it from
/// settling.
const ENDLESS_PART: f64 = 0.2;
/// Bounces after which paths that kept half of their weight are without end.
const ENDLESS_BOUNCES: usize = 400;

/// How the passes went.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solution {
    /// Passes made.
    pub passes: usize,
    /// Whether they settled.
    pub settled: bool,
}

/// Where one of the paths that the cache is solved on ended.
#[derive(Clone, Copy)]
pub(crate) struct PathEnd {
    /// Where; none: `u32::MAX`.
    pub entry: u32,
    /// Irradiance at the start per unit of it there. (Not half floats: 0.999 would become 0.99902, and what a
    /// closed room of it holds grow by 2.4 %.)
    pub weight: [f32; 3],
}

/// It left the scene, or carries nothing.
pub(crate) const NO_ENTRY: PathEnd = PathEnd { entry: u32::MAX, weight: [0.0; 3] };

/// E = source + T E.
pub(crate) struct CacheSystem {
    /// Layers.
    pub layers: usize,
    /// `[entry][layer]`.
    pub source: Vec<Rgb>,
    /// Most paths of an entry.
    pub paths: usize,
    /// `[entry][path]`.
    pub path_ends: Vec<PathEnd>,
    /// Per entry, 1 ÷ its paths.
    pub inverse_path_count: Vec<f32>,
}

/// Paths per entry and half where texels get so many `samples`: a sixteenth of those, and more where entries
/// are few. What the cache finds by chance moves the light of a whole page alike, and no number of paths that
/// read it mends that. Few samples are a quick look: below sixteen of them there are as few paths, so that
/// the cache does not cost many times what reads it.
pub(crate) fn paths_per_entry(entries: usize, samples: u32) -> usize {
    /// From so many over all entries on, few entries are no reason for more.
    const ENOUGH: usize = 1 << 17;
    /// More over all entries take more than 256 MiB.
    const MOST: usize = 1 << 24;
    let of = |all: usize| all / entries.max(1);
    let least = (samples as usize).clamp(LEAST_PATHS, ORDINARY_PATHS);
    let worth = (samples as usize / 16).max(of(ENOUGH)).min(of(MOST)).clamp(least, 1 << 10);
    1 << worth.ilog2()
}

impl CacheSystem {
    /// Bytes of an entry with this number of paths.
    pub(crate) fn bytes_per_entry(layers: usize, paths: usize) -> usize {
        size_of::<Rgb>() * layers + paths * size_of::<PathEnd>()
    }

    /// Makes passes until nothing changes; `note` is called before each. `endless` makes the error for light
    /// that grows without end.
    pub(crate) fn solve(
        &self,
        mut note: impl FnMut(usize),
        endless: impl Fn() -> Error,
    ) -> Result<(CacheHalf, Solution)> {
        let values = 3 * self.layers;
        let n = self.inverse_path_count.len();
        let mut most = vec![0f32; self.layers];
        for entry in self.source.chunks(self.layers.max(1)) {
            for (most, value) in most.iter_mut().zip(entry) {
                *most = most.max(value.max_element());
            }
        }
        let mut light = CacheHalf::new(n, &most);
        let source = light
            .set_all(|e, out| out.copy_from_slice(&self.source[e as usize * self.layers..][..self.layers]));
        // The most that any surface reflects: only where it is all can light grow without end.
        let brightest = self.path_ends.iter().flat_map(|l| l.weight).fold(0.0, f32::max).min(1.0);
        let brightest = f64::from(brightest);
        if brightest > 1.0 - 1e-6 && self.is_endless() {
            return Err(endless());
        }
        // A layer is taken as soon as it settles, whatever the others do: it does not depend on what it is
        // traced with.
        let mut result = CacheHalf::new(n, &vec![0.0; self.layers]);
        let mut taken = vec![false; self.layers];
        // The light of each layer and channel over all entries as it is stored, and the passes made.
        let (mut total, mut passes) = (self.sums(|_, e, out| light.read(e as u32, out)), 0);
        // The last rescaling of each, and how often it turned from growing to shrinking or back.
        let (mut last, mut turns) = (vec![1.0f64; values], vec![0u32; values]);
        loop {
            stop_if_interrupted()?;
            passes += 1;
            note(passes);
            let mut next = CacheHalf::new(n, &most);
            let again = next.set_all(|e, out| self.pass(&light, e as usize, out));
            let stored = self.sums(|_, e, out| next.read(e as u32, out));
            let change = self.most_of_runs(|old, e, out| {
                next.read(e as u32, out);
                light.read(e as u32, old);
                for ((n, o), most) in out.iter_mut().zip(old.iter()).zip(&most) {
                    let change = (*n - *o).abs();
                    *n = change / (*n + Rgb::splat(FAINT_PART * most)).max(Rgb::splat(f32::MIN_POSITIVE));
                }
            });
            // Rescale: with r the part of what was sent out that arrived again, light is in balance at source
            // ÷ (1 − r). (What arrived is taken before it is rounded: at albedo 0.999 a thousandth of it
            // decides.)
            let mut settled = vec![true; self.layers];
            let mut factors = vec![1.0; values];
            for i in (0..values).filter(|&i| source[i] > 0.0) {
                // (In the first passes chance may bring back more than was sent out; a sum without end goes
                // on growing.)
                let r = (again[i] - source[i]) / total[i];
                if brightest > 1.0 - 1e-6 && total[i] > ENDLESS_GROWTH * source[i] {
                    return Err(endless());
                }
                let mut factor =
                    if r < 1.0 { (source[i] / (1.0 - r) / stored[i]).clamp(0.25, 8.0) } else { 8.0 };
                turns[i] += u32::from((factor > 1.1 && last[i] < 0.9) || (factor < 0.9 && last[i] > 1.1));
                last[i] = factor;
                // Where few entries exchange light with many, one number for all may swing for ever: passes
                // alone settle there.
                let swings = turns[i] >= MOST_TURNS;
                if swings {
                    factor = 1.0;
                }
                factors[i] = factor as f32;
                let still = if swings { 0.1 * MOST_RUN_CHANGE } else { MOST_RUN_CHANGE };
                settled[i / 3] &= (factor - 1.0).abs() < MOST_FACTOR_CHANGE && change[i] < still;
                total[i] = stored[i] * factor;
            }
            next.scale_by(&factors);
            most = next.most();
            light = next;
            let is_last = passes == MOST_PASSES;
            let ready: Vec<bool> = (0..self.layers).map(|l| !taken[l] && (settled[l] || is_last)).collect();
            result.take(&light, &ready);
            taken.iter_mut().zip(&ready).for_each(|(taken, ready)| *taken |= ready);
            if taken.iter().all(|t| *t) {
                let settled = ready.iter().zip(&settled).all(|(ready, settled)| !ready || *settled);
                return Ok((result, Solution { passes, settled }));
            }
        }
    }

    /// Whether light goes round without end in so many entries that they would never settle: found without
    /// any light, by what part of the weight of paths is left after [`ENDLESS_BOUNCES`] of them.
    fn is_endless(&self) -> bool {
        let n = self.inverse_path_count.len();
        let mut left = vec![1f32; n];
        // Entries that lost half are given up, and what comes from there with them.
        let mut going: Vec<u32> = (0..n as u32).collect();
        for _ in 0..ENDLESS_BOUNCES {
            let of = |&entry: &u32| {
                let e = entry as usize;
                let path_ends = self.path_ends[e * self.paths..][..self.paths].iter();
                let landed = path_ends.filter(|l| l.entry != NO_ENTRY.entry);
                let most = |l: &PathEnd| l.weight.into_iter().fold(0.0, f32::max);
                let sum: f32 = landed.map(|l| most(l) * left[l.entry as usize]).sum();
                (entry, sum * self.inverse_path_count[e])
            };
            let next: Vec<(u32, f32)> = going.par_iter().map(of).collect();
            going.clear();
            for (entry, part) in next {
                left[entry as usize] = if part < 0.5 { 0.0 } else { part };
                if part >= 0.5 {
                    going.push(entry);
                }
            }
        }
        let is_lit = |e: u32| {
            let source = &self.source[e as usize * self.layers..][..self.layers];
            source.iter().any(|light| *light != Rgb::ZERO)
        };
        let runs = going.chunk_by(|a, b| *a as usize / RUN_ENTRIES == *b as usize / RUN_ENTRIES);
        let mut many = runs.filter(|run| run.len() as f64 > ENDLESS_PART * n.min(RUN_ENTRIES) as f64);
        many.any(|run| run.iter().any(|&entry| is_lit(entry)))
    }

    /// source + T light, at one entry.
    fn pass(&self, light: &CacheHalf, entry: usize, out: &mut [Rgb]) {
        let path_ends = &self.path_ends[entry * self.paths..][..self.paths];
        let landed = || path_ends.iter().filter(|l| l.entry != NO_ENTRY.entry);
        landed().for_each(|l| light.prefetch(l.entry));
        for path_end in landed() {
            let weight = Rgb::from_array(path_end.weight) * self.inverse_path_count[entry];
            light.add(path_end.entry, weight, out);
        }
        for (out, source) in out.iter_mut().zip(&self.source[entry * self.layers..]) {
            *out += *source;
        }
    }

    /// Sums over the entries of what `value(spare, entry, out)` puts into `out`, per layer and channel, in an
    /// order that does not depend on the threads.
    fn sums(&self, value: impl Fn(&mut [Rgb], usize, &mut [Rgb]) + Sync) -> Vec<f64> {
        let mut all = vec![0.0; 3 * self.layers];
        for (run, _) in self.runs(value) {
            all.iter_mut().zip(run).for_each(|(a, r)| *a += r);
        }
        all
    }

    /// The greatest mean of a run, per layer and channel.
    fn most_of_runs(&self, value: impl Fn(&mut [Rgb], usize, &mut [Rgb]) + Sync) -> Vec<f64> {
        let mut most = vec![0.0f64; 3 * self.layers];
        for (run, entries) in self.runs(value) {
            most.iter_mut().zip(run).for_each(|(m, r)| *m = m.max(r / entries as f64));
        }
        most
    }

    /// The sums of each run of entries, and how many they are.
    fn runs(&self, value: impl Fn(&mut [Rgb], usize, &mut [Rgb]) + Sync) -> Vec<(Vec<f64>, usize)> {
        let n = self.inverse_path_count.len();
        (0..n.div_ceil(RUN_ENTRIES))
            .into_par_iter()
            .map(|run| {
                let mut sums = vec![0.0; 3 * self.layers];
                let (mut spare, mut out) = (vec![Rgb::ZERO; self.layers], vec![Rgb::ZERO; self.layers]);
                for entry in run * RUN_ENTRIES..n.min((run + 1) * RUN_ENTRIES) {
                    value(&mut spare, entry, &mut out);
                    let values: &[f32] = bytemuck::cast_slice(&out);
                    sums.iter_mut().zip(values).for_each(|(s, v)| *s += f64::from(*v));
                }
                (sums, n.min((run + 1) * RUN_ENTRIES) - run * RUN_ENTRIES)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `pocket` entries that pass all their light round, `albedo` of it each time, and as many that lose
    /// half.
    fn system(pocket: usize, albedo: f32, light: Rgb) -> CacheSystem {
        let path_end = |entry: usize| {
            let (next, weight) = if entry < pocket {
                ((entry + 1) % pocket, albedo)
            } else {
                (pocket + (entry + 1 - pocket) % pocket, 0.5)
            };
            PathEnd { entry: next as u32, weight: [weight; 3] }
        };
        // One white surface elsewhere: whether there are such does not decide.
        let mut path_ends: Vec<PathEnd> = (0..2 * pocket).map(path_end).collect();
        path_ends[pocket].weight = [1.0; 3];
        let source = (0..2 * pocket).map(|e| if e < pocket { light } else { Rgb::ONE }).collect();
        CacheSystem { layers: 1, source, paths: 1, path_ends, inverse_path_count: vec![1.0; 2 * pocket] }
    }

    #[test]
    fn few_samples_take_few_paths() {
        let of = |samples| paths_per_entry(1 << 21, samples);
        assert_eq!([2, 4, 8, 16, 64, 256].map(of), [4, 4, 8, 16, 16, 16]);
        assert_eq!([512, 1024].map(|samples| paths_per_entry(1 << 18, samples)), [32, 64]);
        // Few entries are solved from many paths, however few the samples.
        assert_eq!([paths_per_entry(1 << 10, 2), paths_per_entry(1, 2)], [128, 1 << 10]);
    }

    #[test]
    fn light_that_goes_round_without_end_is_found_before_the_first_pass() {
        let solve = |system: CacheSystem| {
            let mut passes = 0;
            let solved = system.solve(|pass| passes = pass, || Error::invalid("scene", "endless"));
            (solved.map(|(_, solution)| solution.settled).map_err(|e| e.to_string()), passes)
        };
        let (refused, passes) = solve(system(1000, 1.0, Rgb::ONE));
        assert!(refused.unwrap_err().contains("endless") && passes == 0);
        // Absorption of one part in a hundred, and a pocket without light, are none.
        assert_eq!(solve(system(1000, 0.99, Rgb::ONE)).0, Ok(true));
        assert_eq!(solve(system(1000, 1.0, Rgb::ZERO)).0, Ok(true));
    }
}
