//! The paths the cache is solved on: a few from each of its entries.

use super::cache_system::{CacheSystem, NO_ENTRY, PathEnd};
use crate::bake::samples::{Stream, Worker};
use crate::bake::store::BlockState;
use crate::surface::SurfacePoint;
use crate::trace::counts::{RayCounts, sum};
use crate::trace::irradiance::{CacheMap, Patch};
use crate::trace::paths::path::{Arrival, FirstHit, point_pair};
use crate::trace::paths::{Sample, Sequence, SequenceKind};
use crate::trace::solids::{Receiver, Space, SurroundingHits};
use crate::{Result, Rgb};
use dataset::host::signals::stop_if_interrupted;
use rayon::prelude::*;
use std::sync::Mutex;

/// The direct light of a block.
type StateOf<'s> = &'s (dyn Fn(usize) -> Result<(BlockState, RayCounts)> + Sync);

/// `paths` from each entry of one half, from patches `of_patches` of them; `each` is called after each block.
pub(super) fn trace(
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
/// Points of an entry that are tried at most, where it has fewer paths and some lie in solids.
const MOST_TRIED_POINTS: usize = 16;

/// What the paths from one entry found.
struct TracedEntry {
    entry: u32,
    source: Vec<Rgb>,
    /// The sums of what the paths found other than path ends.
    found: Vec<Rgb>,
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
    let receivers = worker.block(block);
    let covered: Vec<usize> = receivers.covered().collect();
    let lights = worker.transport.lights;
    // The usable texels of each entry, as (entry, texel of the block's file).
    let mut texels: Vec<(u32, usize)> = covered
        .iter()
        .enumerate()
        .filter(|&(i, _)| state.is_usable(i))
        .filter_map(|(i, &t)| Some((map.of_texel(receivers.page_index(t))?, i)))
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
            let sequence = worker.sequence(&receivers, covered[group[0].1], Stream::Solver, half);
            let start = |i: usize, counts: &mut RayCounts| {
                let (_, texel) = group[i * group.len() / paths];
                let sample = sequence.sample(i as u32);
                let at = worker.receiver(&receivers, covered[texel], sample, state.points[texel], counts)?;
                Some(Start { number: i, at, sample })
            };
            // (None of the points that are a texel's surface is in a solid.)
            let mut traced = TracedEntry::new(group[0].0, source);
            let mut followed = 0;
            for i in 0..paths {
                if let Some(start) = start(i, &mut traced.counts) {
                    traced.follow(worker, map, &start);
                    followed += 1;
                }
            }
            traced.finish(followed)
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
        let start = |i: usize| {
            let sample = sequence.sample(i as u32);
            let barycentric = patch.sample(point_pair(sample));
            let point = SurfacePoint { triangle: patch.triangle, barycentric };
            let at = transport.space.receiver_on(&point, patch.is_back)?;
            Some(Start { number: i, at, sample })
        };
        let mut traced = TracedEntry::new(patch.entry, vec![Rgb::ZERO; lights.layers()]);
        let (mut free, mut at_backs) = (Vec::new(), Vec::new());
        for start in (0..paths).filter_map(start) {
            match traced.follow(worker, map, &start) {
                FirstHit::Back => at_backs.push(start),
                FirstHit::Other => free.push(start),
            }
        }
        if !at_backs.is_empty() {
            let space = &transport.space;
            let buried = Buried::sort_out(space, &mut free, at_backs, &mut traced.counts);
            for start in (paths..MOST_TRIED_POINTS).filter_map(start) {
                if free.len() >= paths || buried.is_empty() {
                    break;
                }
                if !buried.holds(space, &start.at, &mut traced.counts) {
                    traced.follow(worker, map, &start);
                    free.push(start);
                }
            }
        }
        let mut traced = traced.finish(free.len());
        // (In the order they were drawn in: what a path met must not choose where direct light is sampled.)
        free.sort_by_key(|start| start.number);
        let direct = free.len().div_ceil(PATHS_A_DIRECT);
        for Start { at, sample, .. } in &free[..direct] {
            let weight = Rgb::splat(1.0 / direct as f32);
            transport.add_direct(at, weight, *sample, 0, &mut traced.source, &mut traced.counts);
        }
        traced
    };
    patches.par_iter().with_min_len(32).map(one).collect()
}

/// Which points of a patch no path from outside arrives at, such as those of a floor under a wall: their dark
/// must not count in the patch's mean.
struct Buried {
    /// Those in closed solids.
    in_solids: bool,
    /// Those in bodies that may be open.
    enclosed: bool,
}

impl Buried {
    /// Adds to the starts of `free` paths those that met backs, if they count, and says which do not.
    ///
    /// From a closed solid no path gets out: its points never count. In a body that may be open, as a shed of
    /// outer walls with a door, points count if a path from one of them got out, or if there are no others:
    /// were only those counted whose paths got out, it would be too bright inside.
    fn sort_out(space: &Space, free: &mut Vec<Start>, at_backs: Vec<Start>, counts: &mut RayCounts) -> Self {
        let (mut in_solids, mut enclosed, mut others) = (false, Vec::new(), Vec::new());
        for start in at_backs {
            let mut known_hits = SurroundingHits::default();
            if space.is_in_solid(&start.at, &mut known_hits, counts) {
                in_solids = true;
            } else if space.is_enclosed(&start.at, &mut known_hits, counts) {
                enclosed.push(start);
            } else {
                others.push(start);
            }
        }
        let is_open = enclosed.is_empty() || free.iter().any(|start| space.is_inside(&start.at, counts));
        free.extend(others);
        if is_open || free.is_empty() {
            free.append(&mut enclosed);
        }
        Buried { in_solids, enclosed: !enclosed.is_empty() }
    }

    /// Whether all points count.
    fn is_empty(&self) -> bool {
        !self.in_solids && !self.enclosed
    }

    fn holds(&self, space: &Space, at: &Receiver, counts: &mut RayCounts) -> bool {
        let mut known_hits = SurroundingHits::default();
        self.in_solids && space.is_in_solid(at, &mut known_hits, counts)
            || self.enclosed && space.is_enclosed(at, &mut known_hits, counts)
    }
}

/// Where a path starts.
struct Start {
    /// Its number among those of its entry.
    number: usize,
    at: Receiver,
    /// The random numbers it takes.
    sample: Sample,
}

impl TracedEntry {
    /// Without paths; `source` is what is known of its direct light.
    fn new(entry: u32, source: Vec<Rgb>) -> Self {
        let found = vec![Rgb::ZERO; source.len()];
        let (path_ends, counts) = (Vec::new(), RayCounts::default());
        TracedEntry { entry, source, found, path_ends, inverse_path_count: 0.0, counts }
    }

    /// Follows a path.
    fn follow(&mut self, worker: &Worker, map: &CacheMap, start: &Start) -> FirstHit {
        let path_ends = &mut self.path_ends;
        let on_arrival = |at: &Arrival, _: &mut [Rgb], counts: &mut RayCounts| {
            let entry = map.entry(&worker.transport.space, &at.hit, at.is_back, counts);
            path_ends.extend(entry.map(|entry| PathEnd { entry, weight: at.weight.to_array() }));
            entry.is_some()
        };
        let (at, sample) = (&start.at, start.sample);
        worker.transport.indirect(at, sample, on_arrival, &mut self.found, None, &mut self.counts)
    }

    /// Adds what the paths found, where so many count.
    fn finish(mut self, paths: usize) -> Self {
        self.inverse_path_count = if paths > 0 { 1.0 / paths as f32 } else { 0.0 };
        let found = self.source.iter_mut().zip(std::mem::take(&mut self.found));
        found.for_each(|(source, found)| *source += found * self.inverse_path_count);
        self
    }
}
