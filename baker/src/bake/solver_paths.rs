//! The paths the cache is solved on: a few from each of its entries.

use super::block::{Stream, Worker, sum};
use super::cache_system::{CacheSystem, NO_ENTRY, PathEnd};
use super::state::BlockState;
use crate::surface::SurfacePoint;
use crate::trace::cache::{CacheMap, Patch};
use crate::trace::counts::RayCounts;
use crate::trace::path::{Arrival, point_pair};
use crate::trace::sampler::{Sample, Sequence, SequenceKind};
use crate::trace::space::Receiver;
use crate::{Result, Rgb};
use dataset::signals::stop_if_interrupted;
use rayon::prelude::*;
use std::sync::Mutex;

/// The direct light of a block.
type StateOf<'s> = &'s (dyn Fn(usize) -> Result<(BlockState, RayCounts)> + Sync);

/// `paths` from each entry of one half, from patches `of_patches` of them; `each` is called after each block.
pub fn trace(
    worker: &Worker,
    state: StateOf,
    map: &CacheMap,
    blocks: &[usize],
    (paths, of_patches): (usize, usize),
    half: usize,
    each: impl Fn() + Sync,
) -> Result<(CacheSystem, RayCounts)> {
    let layers = worker.transport.lights.layers();
    let n = map.entries();
    let system = Mutex::new(CacheSystem {
        layers,
        source: vec![Rgb::ZERO; n * layers],
        paths,
        path_ends: vec![NO_ENTRY; n * paths],
        inverse_path_count: vec![0.0; n],
    });
    let keep = |traced: Vec<TracedEntry>| {
        let mut counts = RayCounts::default();
        let mut system = system.lock().unwrap_or_else(|e| e.into_inner());
        for entry in traced {
            let e = entry.entry as usize;
            system.source[e * layers..(e + 1) * layers].copy_from_slice(&entry.source);
            system.path_ends[e * paths..][..entry.path_ends.len()].copy_from_slice(&entry.path_ends);
            system.inverse_path_count[e] = entry.inverse_path_count;
            counts += entry.counts;
        }
        counts
    };
    let mut counts = blocks
        .par_iter()
        .map(|&block| {
            stop_if_interrupted()?;
            let (state, mut counts) = state(block)?;
            counts += keep(trace_block(worker, map, (block, &state), paths, half));
            each();
            Ok(counts)
        })
        .collect::<Result<Vec<_>>>()?;
    for patches in map.all_patches().chunks(1 << 12) {
        stop_if_interrupted()?;
        counts.push(keep(trace_patches(worker, map, patches, of_patches, half)));
    }
    Ok((system.into_inner().unwrap_or_else(|e| e.into_inner()), sum(counts)))
}

/// Paths from a patch for each sample of its direct light.
const PATHS_A_DIRECT: usize = 4;

/// What the paths from one entry found.
struct TracedEntry {
    entry: u32,
    source: Vec<Rgb>,
    path_ends: Vec<PathEnd>,
    inverse_path_count: f32,
    counts: RayCounts,
}

fn trace_block(
    worker: &Worker,
    map: &CacheMap,
    (block, state): (usize, &BlockState),
    paths: usize,
    half: usize,
) -> Vec<TracedEntry> {
    let surface = worker.surface(block);
    let covered: Vec<usize> = surface.covered().collect();
    let lights = worker.transport.lights;
    // The usable texels of each entry, as (entry, texel of the block's file).
    let mut texels: Vec<(u32, usize)> = covered
        .iter()
        .enumerate()
        .filter(|&(i, _)| state.is_usable(i))
        .filter_map(|(i, &t)| Some((map.of_texel(surface.page_index(worker.atlas, t))?, i)))
        .collect();
    texels.sort_unstable();
    let groups: Vec<&[(u32, usize)]> = texels.chunk_by(|a, b| a.0 == b.0).collect();
    groups
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
            // Paths from points spread over its texels.
            let sequence = worker.sequence(&surface, covered[group[0].1], Stream::Solver, half);
            let start = |i: usize, counts: &mut RayCounts| {
                let (_, texel) = group[i * group.len() / paths];
                let sample = sequence.sample(i as u32);
                Some((
                    worker.receiver(&surface, covered[texel], sample, state.probes[texel], counts)?,
                    sample,
                ))
            };
            follow(worker, map, group[0].0, source, paths, start)
        })
        .collect()
}

/// As [`trace_block`], for the patches; their direct light is sampled here too.
fn trace_patches(
    worker: &Worker,
    map: &CacheMap,
    patches: &[Patch],
    paths: usize,
    half: usize,
) -> Vec<TracedEntry> {
    let direct = (paths / PATHS_A_DIRECT).max(1);
    let lights = worker.transport.lights;
    let one = |patch: &Patch| {
        let sequence =
            Sequence::new(worker.seed, SequenceKind::Patch, patch.entry, Stream::Solver as u32 + half as u32);
        let at = |sample: Sample| {
            let barycentric = patch.sample(point_pair(sample));
            let point = SurfacePoint { triangle: patch.triangle, barycentric };
            worker.transport.space.receiver_on(&point, patch.is_back)
        };
        let mut counts = RayCounts::default();
        let mut source = vec![Rgb::ZERO; lights.layers()];
        for i in 0..direct {
            let sample = sequence.sample((paths + i) as u32);
            let Some(at) = at(sample) else { continue };
            let weight = Rgb::splat(1.0 / direct as f32);
            worker.transport.add_direct(&at, weight, sample, 0, &mut source, &mut counts);
        }
        let start = |i: usize, _: &mut RayCounts| {
            let sample = sequence.sample(i as u32);
            Some((at(sample)?, sample))
        };
        let mut traced = follow(worker, map, patch.entry, source, paths, start);
        traced.counts += counts;
        traced
    };
    patches.par_iter().with_min_len(32).map(one).collect()
}

/// The paths of one entry, from where `start` puts each; `source` is its direct light.
fn follow(
    worker: &Worker,
    map: &CacheMap,
    entry: u32,
    mut source: Vec<Rgb>,
    paths: usize,
    start: impl Fn(usize, &mut RayCounts) -> Option<(Receiver, Sample)>,
) -> TracedEntry {
    let mut counts = RayCounts::default();
    let (mut path_ends, mut followed) = (Vec::new(), 0);
    let mut found = vec![Rgb::ZERO; source.len()];
    for i in 0..paths {
        let Some((at, sample)) = start(i, &mut counts) else { continue };
        followed += 1;
        let on_arrival = |at: &Arrival, _: &mut [Rgb], counts: &mut RayCounts| {
            let entry = map.entry(&worker.transport.space, &at.hit, at.is_back, counts);
            path_ends.extend(entry.map(|entry| PathEnd { entry, weight: at.weight.to_array() }));
            entry.is_some()
        };
        worker.transport.indirect(&at, sample, on_arrival, &mut found, None, &mut counts);
    }
    let inverse_path_count = if followed > 0 { 1.0 / followed as f32 } else { 0.0 };
    source.iter_mut().zip(&found).for_each(|(s, m)| *s += *m * inverse_path_count);
    TracedEntry { entry, source, path_ends, inverse_path_count, counts }
}
