//! The paths the cache is solved on: a few from each of its entries.

use super::block::{Stream, Worker, sum};
use super::cache_system::{CacheSystem, NO_ENTRY, PathEnd};
use super::state::BlockState;
use crate::surface::SurfacePoint;
use crate::trace::cache::{CacheMap, Patch};
use crate::trace::counts::RayCounts;
use crate::trace::path::{Arrival, FirstHit, point_pair};
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
/// Most points of an entry that are tried to replace those in solids; no fewer than it has paths.
const MOST_TRIED_POINTS: usize = 16;

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
            // (Texels' starts are probed: none is in a solid.)
            let is_buried = |_: &Receiver, _: &mut RayCounts| false;
            follow(worker, map, (group[0].0, paths), source, start, is_buried).0
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
    let (transport, lights) = (&worker.transport, worker.transport.lights);
    let one = |patch: &Patch| {
        let sequence =
            Sequence::new(worker.seed, SequenceKind::Patch, patch.entry, Stream::Solver as u32 + half as u32);
        let start = |i: usize, _: &mut RayCounts| {
            let sample = sequence.sample(i as u32);
            let barycentric = patch.sample(point_pair(sample));
            let point = SurfacePoint { triangle: patch.triangle, barycentric };
            Some((transport.space.receiver_on(&point, patch.is_back)?, sample))
        };
        // No path from outside arrives at a point in a solid, such as the floor under a wall. Its dark must
        // not count in the patch's mean.
        let is_buried = |at: &Receiver, counts: &mut RayCounts| transport.space.is_inside(at, counts);
        let black = vec![Rgb::ZERO; lights.layers()];
        let (mut traced, starts) = follow(worker, map, (patch.entry, paths), black, start, is_buried);
        let direct = starts.len().div_ceil(PATHS_A_DIRECT);
        for (at, sample) in &starts[..direct] {
            let weight = Rgb::splat(1.0 / direct as f32);
            transport.add_direct(at, weight, *sample, 0, &mut traced.source, &mut traced.counts);
        }
        traced
    };
    patches.par_iter().with_min_len(32).map(one).collect()
}

/// Traces an entry's paths from where `start` puts each. Gives what they found and the starts that count.
/// `source` is what is known of its direct light. A start does not count where its path meets an absorbing
/// back at once and `is_buried` holds.
fn follow(
    worker: &Worker,
    map: &CacheMap,
    (entry, paths): (u32, usize),
    mut source: Vec<Rgb>,
    start: impl Fn(usize, &mut RayCounts) -> Option<(Receiver, Sample)>,
    is_buried: impl Fn(&Receiver, &mut RayCounts) -> bool,
) -> (TracedEntry, Vec<(Receiver, Sample)>) {
    let mut counts = RayCounts::default();
    let (mut path_ends, mut starts) = (Vec::new(), Vec::with_capacity(paths));
    let mut found = vec![Rgb::ZERO; source.len()];
    let mut buried = 0;
    for i in 0.. {
        // Starts in solids are replaced while few points were tried.
        if i - buried == paths || i >= paths.max(MOST_TRIED_POINTS) {
            break;
        }
        let Some((at, sample)) = start(i, &mut counts) else { continue };
        let on_arrival = |at: &Arrival, _: &mut [Rgb], counts: &mut RayCounts| {
            let entry = map.entry(&worker.transport.space, &at.hit, at.is_back, counts);
            path_ends.extend(entry.map(|entry| PathEnd { entry, weight: at.weight.to_array() }));
            entry.is_some()
        };
        let begun = worker.transport.indirect(&at, sample, on_arrival, &mut found, None, &mut counts);
        if begun == FirstHit::Back && is_buried(&at, &mut counts) {
            buried += 1;
        } else {
            starts.push((at, sample));
        }
    }
    let inverse_path_count = if starts.is_empty() { 0.0 } else { 1.0 / starts.len() as f32 };
    source.iter_mut().zip(&found).for_each(|(s, m)| *s += *m * inverse_path_count);
    (TracedEntry { entry, source, path_ends, inverse_path_count, counts }, starts)
}
