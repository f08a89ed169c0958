//! Fills the cache: the irradiance of every layer, all bounces, at every entry.
//!
//! A few walks from each entry give a source (their own light and the entry's direct light) and the entries they land on; the
//! balance E = source + T E over all of them is a sparse linear system, solved by passes that trace no rays. In each, light
//! goes one bounce further. Where surfaces are bright, that is slow; each layer and channel is therefore also rescaled as a
//! whole, so that what all entries send out agrees with what they get (a one-group rebalance, known from neutron transport).

use super::block::{Stream, Worker};
use super::indirect::Cache;
use super::state::{ALL_OUTSIDE, StateFolder};
use crate::surface::SurfacePoint;
use crate::trace::cache::{CacheHalf, CacheMap, Patch};
use crate::trace::sampler::{Sample, Sequence};
use crate::trace::walk::{Arrival, RayCounts, Receiver, point_pair, sun_draw};
use crate::{Error, Result, Rgb};
use dataset::console::{Console, stop_if_interrupted};
use dataset::files::write_atomically_with;
use rayon::prelude::*;
use std::io::Write;
use std::path::Path;
use std::sync::Mutex;

/// Walks per entry and half.
pub const PILOT: usize = 16;
/// Samples of direct light per patch and half.
const PATCH_DIRECT: u32 = 4;
/// Most passes.
const MOST_PASSES: usize = 400;
/// Largest change of the rescaling in the last pass.
const SETTLED: f64 = 1e-3;
/// Largest change of the last pass at an entry relative to its own light, on average over each run of entries: a dim room beside
/// a bright yard has to settle too.
const STILL: f64 = 5e-4;
/// Part of a layer's greatest light below which changes are judged by that.
const FAINT: f32 = 1e-6;
/// Turns of the rescaling after which it is given up.
const TURNS: u32 = 3;
/// Entries of a run.
const RUN: usize = 4096;
/// Light of all bounces, as a multiple of that before the first, from which on it is taken to grow without end where surfaces
/// absorb nothing.
const ENDLESS: f64 = 1e4;
/// Memory that the cache and its solution may take, about.
const MEMORY: u64 = 4 << 30;

/// How the passes went.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// Passes made, the more of both halves.
    pub passes: usize,
    /// Whether they settled.
    pub settled: bool,
}

/// A landing of a pilot walk.
#[derive(Clone, Copy)]
struct Landing {
    entry: u32,
    /// Irradiance at the start per unit of it there. (Not half floats: 0.999 would become 0.99902, and what a closed room of
    /// it holds grow by 2.4 %.)
    weight: [f32; 3],
}

const NOWHERE: Landing = Landing { entry: u32::MAX, weight: [0.0; 3] };

/// log₂ of the side of the cache's entries, so that it and its solution take about 4 GiB at most (patches not
/// counted): 0 up to about 1600² texels of 34 layers.
pub fn shift(covered: usize, layers: usize) -> u32 {
    let per_entry = 5 * CacheHalf::bytes_per_entry(layers) + 12 * layers + PILOT * size_of::<Landing>();
    (0..2).find(|shift| ((covered >> (2 * shift)) * per_entry) as u64 <= MEMORY).unwrap_or(2)
}

/// What is found out about a block before the cache is laid out.
#[derive(Default)]
struct Covered {
    /// Its covered texels, as places on the page.
    texels: Vec<usize>,
    /// Those among them that a wall divides, and points of the side they stand for.
    split: Vec<(usize, Vec<Receiver>)>,
    counts: RayCounts,
}

/// The map of the cache for the covered texels of all blocks, which were probed. Those that reach across a wall stand for one
/// side of it: a walk that lands on the other must not carry its light through the wall. `layers` are all of the bake, traced now or not: they
/// decide the size of an entry.
pub fn map<'a>(
    worker: &Worker<'a>,
    folder: &StateFolder,
    blocks: &[usize],
    layers: usize,
) -> Result<(CacheMap<'a>, RayCounts)> {
    let of_block = |&block: &usize| -> Result<Covered> {
        let surface = worker.surface(block);
        let texels: Vec<usize> = surface.covered().collect();
        let outside = folder.read(block, texels.len())?.outside;
        let place = |t: usize| surface.page_index(worker.atlas, t);
        let mut found = Covered { texels: texels.iter().map(|&t| place(t)).collect(), ..Covered::default() };
        for (&texel, &outside) in texels.iter().zip(&outside).filter(|(_, o)| **o != ALL_OUTSIDE) {
            if outside == 0 || worker.is_split(&surface, texel, outside, &mut found.counts) {
                found.split.push((place(texel), worker.witnesses(&surface, texel, outside)));
            }
        }
        Ok(found)
    };
    let found = blocks.par_iter().map(of_block).collect::<Result<Vec<_>>>()?;
    let shift = shift(found.iter().map(|f| f.texels.len()).sum(), layers);
    let covered = found.iter().flat_map(|f| f.texels.iter().copied());
    let mut map = CacheMap::new(worker.atlas, worker.transport.geometry, shift, covered);
    let counts = super::block::sum(found.iter().map(|f| f.counts));
    found.into_iter().flat_map(|f| f.split).for_each(|(texel, witnesses)| map.split(texel, witnesses));
    Ok((map, counts))
}

/// Fills both halves from the direct light found so far.
pub fn fill<'a>(
    worker: &Worker<'a>,
    folder: &StateFolder,
    map: CacheMap<'a>,
    blocks: &[usize],
    console: &Console,
) -> Result<(Cache<'a>, Solution, RayCounts)> {
    let progress = console.progress("first bounces", 2 * blocks.len() as u64);
    let mut counts = RayCounts::default();
    let mut solution = Solution { passes: 0, settled: true };
    let mut solved = |half| -> Result<CacheHalf> {
        let (system, c) = System::trace(worker, folder, &map, blocks, half, || progress.advance(1))?;
        counts += c;
        let (values, s) = system.solve(|pass| progress.note(&format!("pass {pass}")))?;
        solution = Solution { passes: solution.passes.max(s.passes), settled: solution.settled && s.settled };
        Ok(values)
    };
    let halves = [solved(0)?, solved(1)?];
    Ok((Cache::new(worker, map, halves), solution, counts))
}

/// E = source + T E.
struct System {
    layers: usize,
    /// `[entry][layer]`.
    source: Vec<Rgb>,
    /// `[entry][PILOT]`.
    landings: Vec<Landing>,
    /// Per entry, 1 ÷ its walks.
    share: Vec<f32>,
}

impl System {
    fn trace(
        worker: &Worker,
        folder: &StateFolder,
        map: &CacheMap,
        blocks: &[usize],
        half: usize,
        each: impl Fn() + Sync,
    ) -> Result<(Self, RayCounts)> {
        let layers = worker.transport.lights.layers();
        let n = map.entries();
        let system = Mutex::new(System {
            layers,
            source: vec![Rgb::ZERO; n * layers],
            landings: vec![NOWHERE; n * PILOT],
            share: vec![0.0; n],
        });
        let keep = |traced: Vec<TracedEntry>| {
            let mut counts = RayCounts::default();
            let mut system = system.lock().unwrap_or_else(|e| e.into_inner());
            for entry in traced {
                let e = entry.entry as usize;
                system.source[e * layers..(e + 1) * layers].copy_from_slice(&entry.source);
                system.landings[e * PILOT..][..entry.landings.len()].copy_from_slice(&entry.landings);
                system.share[e] = entry.share;
                counts += entry.counts;
            }
            counts
        };
        let mut counts = blocks
            .par_iter()
            .map(|&block| {
                stop_if_interrupted()?;
                let counts = keep(trace_block(worker, folder, map, block, half)?);
                each();
                Ok(counts)
            })
            .collect::<Result<Vec<_>>>()?;
        for patches in map.all_patches().chunks(1 << 12) {
            stop_if_interrupted()?;
            counts.push(keep(trace_patches(worker, map, patches, half)));
        }
        Ok((system.into_inner().unwrap_or_else(|e| e.into_inner()), super::block::sum(counts)))
    }

    /// Passes until nothing changes.
    fn solve(&self, mut note: impl FnMut(usize)) -> Result<(CacheHalf, Solution)> {
        let values = 3 * self.layers;
        let n = self.share.len();
        let mut most = vec![0f32; self.layers];
        for entry in self.source.chunks(self.layers.max(1)) {
            for (most, value) in most.iter_mut().zip(entry) {
                *most = most.max(value.max_element());
            }
        }
        let source =
            self.sums(|_, e, out| out.copy_from_slice(&self.source[e * self.layers..][..self.layers]));
        let mut light = CacheHalf::new(n, &most);
        light.set_all(|e, out| out.copy_from_slice(&self.source[e as usize * self.layers..][..self.layers]));
        // The most that any surface reflects: only where it is all can light grow without end.
        let brightest = self.landings.iter().flat_map(|l| l.weight).fold(0.0, f32::max).min(1.0);
        let brightest = f64::from(brightest);
        // A layer is taken as soon as it settles, whatever the others do: it does not depend on what it is traced with.
        let mut result = CacheHalf::new(n, &vec![0.0; self.layers]);
        let mut taken = vec![false; self.layers];
        // What of the light of each layer and channel arrives again after a bounce.
        let (mut total, mut passes) = (source.clone(), 0);
        // The last rescaling of each, and how often it turned from growing to shrinking or back.
        let (mut last, mut turns) = (vec![1.0f64; values], vec![0u32; values]);
        loop {
            stop_if_interrupted()?;
            passes += 1;
            note(passes);
            let mut next = CacheHalf::new(n, &most);
            next.set_all(|e, out| self.pass(&light, e as usize, out));
            let again = self.sums(|_, e, out| next.read(e as u32, out));
            let change = self.most_of_runs(|old, e, out| {
                next.read(e as u32, out);
                light.read(e as u32, old);
                for ((n, o), most) in out.iter_mut().zip(old.iter()).zip(&most) {
                    let change = (*n - *o).abs();
                    *n = change / (*n + Rgb::splat(FAINT * most)).max(Rgb::splat(f32::MIN_POSITIVE));
                }
            });
            // Rescale: with r the part of what was sent out that arrived again, light is in balance at source ÷ (1 − r).
            let mut settled = vec![true; self.layers];
            let mut factors = vec![1.0; values];
            for i in (0..values).filter(|&i| source[i] > 0.0) {
                // (In the first passes chance may bring back more than was sent out; a sum without end goes on growing.)
                let r = (again[i] - source[i]) / total[i];
                if brightest > 1.0 - 1e-6 && total[i] > ENDLESS * source[i] {
                    return Err(Error::invalid(
                        "scene",
                        "light grows without end: nothing absorbs it (albedo 1 in a closed space, with light inside)",
                    ));
                }
                let mut factor =
                    if r < 1.0 { (source[i] / (1.0 - r) / again[i]).clamp(0.25, 8.0) } else { 8.0 };
                turns[i] += u32::from((factor > 1.1 && last[i] < 0.9) || (factor < 0.9 && last[i] > 1.1));
                last[i] = factor;
                // Where few entries exchange light with many, one number for all may swing for ever: passes alone settle there.
                let swings = turns[i] >= TURNS;
                if swings {
                    factor = 1.0;
                }
                factors[i] = factor as f32;
                let still = if swings { 0.1 * STILL } else { STILL };
                settled[i / 3] &= (factor - 1.0).abs() < SETTLED && change[i] < still;
                total[i] = again[i] * factor;
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

    /// source + T light, at one entry.
    fn pass(&self, light: &CacheHalf, entry: usize, out: &mut [Rgb]) {
        for landing in &self.landings[entry * PILOT..(entry + 1) * PILOT] {
            if landing.entry != NOWHERE.entry {
                let weight = Rgb::from_array(landing.weight) * self.share[entry];
                light.add(landing.entry, weight, out);
            }
        }
        for (out, source) in out.iter_mut().zip(&self.source[entry * self.layers..]) {
            *out += *source;
        }
    }

    /// Sums over the entries of what `value(spare, entry, out)` puts into `out`, per layer and channel, in an order that does
    /// not depend on the threads.
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
        let n = self.share.len();
        (0..n.div_ceil(RUN))
            .into_par_iter()
            .map(|run| {
                let mut sums = vec![0.0; 3 * self.layers];
                let (mut spare, mut out) = (vec![Rgb::ZERO; self.layers], vec![Rgb::ZERO; self.layers]);
                for entry in run * RUN..n.min((run + 1) * RUN) {
                    value(&mut spare, entry, &mut out);
                    let values: &[f32] = bytemuck::cast_slice(&out);
                    sums.iter_mut().zip(values).for_each(|(s, v)| *s += f64::from(*v));
                }
                (sums, n.min((run + 1) * RUN) - run * RUN)
            })
            .collect()
    }
}

/// What the walks from one entry found.
struct TracedEntry {
    entry: u32,
    source: Vec<Rgb>,
    landings: Vec<Landing>,
    share: f32,
    counts: RayCounts,
}

fn trace_block(
    worker: &Worker,
    folder: &StateFolder,
    map: &CacheMap,
    block: usize,
    half: usize,
) -> Result<Vec<TracedEntry>> {
    let surface = worker.surface(block);
    let covered: Vec<usize> = surface.covered().collect();
    let state = folder.read(block, covered.len())?;
    let lights = worker.transport.lights;
    // The exposed texels of each entry, as (entry, texel of the block's file).
    let mut texels: Vec<(u32, usize)> = covered
        .iter()
        .enumerate()
        .filter(|&(i, _)| state.is_exposed(i))
        .filter_map(|(i, &t)| Some((map.of_texel(surface.page_index(worker.atlas, t))?, i)))
        .collect();
    texels.sort_unstable();
    let groups: Vec<&[(u32, usize)]> = texels.chunk_by(|a, b| a.0 == b.0).collect();
    Ok(groups
        .into_par_iter()
        .with_min_len(32)
        .map(|group| {
            // The mean direct light of the entry's texels.
            let mut source = vec![Rgb::ZERO; lights.layers()];
            for &(_, i) in group {
                let from = (i * 2 + half) * lights.sampled();
                for (light, direct) in state.direct[from..from + lights.sampled()].iter().enumerate() {
                    source[lights.layer_of_sampled(light)] += direct.mean() / group.len() as f32;
                }
            }
            // Walks from points spread over its texels.
            let sequence = worker.sequence(&surface, covered[group[0].1], Stream::Pilot, half);
            let start = |i: usize, counts: &mut RayCounts| {
                let (_, texel) = group[i * group.len() / PILOT];
                let sample = sequence.sample(i as u32);
                Some((
                    worker.receiver(&surface, covered[texel], sample, state.outside[texel], counts)?,
                    sample,
                ))
            };
            pilot(worker, map, group[0].0, source, start)
        })
        .collect())
}

/// As [`trace_block`], for the patches; their direct light is sampled here too.
fn trace_patches(worker: &Worker, map: &CacheMap, patches: &[Patch], half: usize) -> Vec<TracedEntry> {
    let lights = worker.transport.lights;
    let one = |patch: &Patch| {
        let sequence = Sequence::new(worker.seed, 1, patch.entry, Stream::Pilot as u32 + half as u32);
        let at = |sample: Sample| {
            let barycentric = patch.sample(point_pair(sample));
            let point = SurfacePoint { triangle: patch.triangle, barycentric };
            worker.transport.flat_receiver(&point, patch.is_back)
        };
        let mut counts = RayCounts::default();
        let mut source = vec![Rgb::ZERO; lights.layers()];
        for i in 0..PATCH_DIRECT {
            let sample = sequence.sample(PILOT as u32 + i);
            let Some(at) = at(sample) else { continue };
            let draw = sun_draw(sample);
            for light in 0..lights.sampled() {
                source[lights.layer_of_sampled(light)] +=
                    worker.transport.direct(&at, light, sample, &draw, &mut counts) / PATCH_DIRECT as f32;
            }
        }
        let start = |i: usize, _: &mut RayCounts| {
            let sample = sequence.sample(i as u32);
            Some((at(sample)?, sample))
        };
        let mut traced = pilot(worker, map, patch.entry, source, start);
        traced.counts += counts;
        traced
    };
    patches.par_iter().with_min_len(32).map(one).collect()
}

/// The walks of one entry, from where `start` puts each; `source` is its direct light.
fn pilot(
    worker: &Worker,
    map: &CacheMap,
    entry: u32,
    mut source: Vec<Rgb>,
    start: impl Fn(usize, &mut RayCounts) -> Option<(Receiver, Sample)>,
) -> TracedEntry {
    let mut counts = RayCounts::default();
    let (mut landings, mut walks) = (Vec::new(), 0);
    let mut met = vec![Rgb::ZERO; source.len()];
    for i in 0..PILOT {
        let Some((at, sample)) = start(i, &mut counts) else { continue };
        walks += 1;
        let land = |at: &Arrival, _: &mut [Rgb], counts: &mut RayCounts| {
            let entry = map.entry(&worker.transport, &at.hit, at.is_back, counts);
            landings.extend(entry.map(|entry| Landing { entry, weight: at.weight.to_array() }));
            entry.is_some()
        };
        worker.transport.indirect(&at, sample, land, &mut met, &mut counts);
    }
    let share = if walks > 0 { 1.0 / walks as f32 } else { 0.0 };
    source.iter_mut().zip(&met).for_each(|(s, m)| *s += *m * share);
    TracedEntry { entry, source, landings, share, counts }
}

const MAGIC: &[u8; 8] = b"TLMCACH1";

/// Keeps a filled cache beside the work, for a run that continues it.
pub fn store(path: &Path, halves: &[CacheHalf; 2]) -> Result<()> {
    write_atomically_with(path, |file| {
        let mut file = std::io::BufWriter::new(file);
        file.write_all(MAGIC)?;
        for half in halves {
            file.write_all(bytemuck::cast_slice(half.scales()))?;
            file.write_all(half.bytes())?;
        }
        file.flush()
    })
}

/// What [`store`] kept; `None` where there is nothing fitting.
pub fn load(path: &Path, entries: usize, layers: usize) -> Option<[CacheHalf; 2]> {
    let bytes = std::fs::read(path).ok()?;
    let rest = bytes.strip_prefix(MAGIC)?;
    let values = entries * CacheHalf::bytes_per_entry(layers);
    let scales = CacheHalf::bytes_per_entry(layers) * 2;
    if rest.len() != 2 * (values + scales) {
        return None;
    }
    let half = |bytes: &[u8]| {
        CacheHalf::from_parts(layers, bytemuck::pod_collect_to_vec(&bytes[..scales]), &bytes[scales..])
    };
    let (a, b) = rest.split_at(values + scales);
    Some([half(a)?, half(b)?])
}
