//! Fills the cache: the irradiance of every layer, all bounces, at every entry.
//!
//! Its entries are laid out; a few paths from each (`solver_paths`) give a source, their own light and the
//! entry's direct light, and the entries they land on; the balance of all of them (`cache_system`) is the
//! light.

use super::cache_system::{CacheSystem, LEAST_PATHS, ORDINARY_PATHS, Solution, paths_per_entry};
use super::endless_light;
use super::solver_paths::trace;
use crate::Result;
use crate::atlas::Atlas;
use crate::bake::samples::{Cache, Worker};
use crate::bake::store::{ALL_POINTS, BlockState, CACHE_FILE, WorkFolder, is_usable};
use crate::receivers::ReceiverBlock;
use crate::surface::BLOCK;
use crate::trace::counts::{RayCounts, sum};
use crate::trace::irradiance::{CacheHalf, CacheMap};
use crate::trace::solids::Receiver;
use dataset::observe::Observer;

/// Memory that the cache and its solution may take, about.
const MOST_MEMORY: u64 = 4 << 30;

/// log₂ of the side of the largest entries: no entry may lie in two blocks.
const LARGEST_SHIFT: u32 = BLOCK.ilog2();

/// log₂ of the side of the cache's entries, so that those of lightmapped surfaces and their solution take
/// about 4 GiB at most: 0 up to about 1600² texels of 34 layers. (Whatever the samples, for they are no part
/// of what an entry is.)
pub(crate) fn shift(covered: usize, layers: usize) -> u32 {
    (0..LARGEST_SHIFT).find(|shift| covered >> (2 * shift) <= most_entries(layers)).unwrap_or(LARGEST_SHIFT)
}

/// Entries that take that much memory: patches are made only as far as there is room for them.
pub(crate) fn most_entries(layers: usize) -> usize {
    (MOST_MEMORY / bytes(1, layers, ORDINARY_PATHS)) as usize
}

/// Memory in bytes that this number of entries takes while they are solved for: both halves, what the passes
/// hold, and their system with `paths` per entry.
pub(crate) fn bytes(entries: usize, layers: usize, paths: usize) -> u64 {
    (entries * (5 * CacheHalf::bytes_per_entry(layers) + CacheSystem::bytes_per_entry(layers, paths))) as u64
}

/// What is found out about a block before the cache is laid out.
pub(crate) struct Covered {
    /// Its covered texels, as page indices.
    texels: Vec<u32>,
    /// Those among them that a wall divides, and points of the side they stand for.
    split: Vec<(u32, Vec<Receiver>)>,
    counts: RayCounts,
}

/// Of a block, with the points of its texels that are surface. Those texels that reach across a wall stand
/// for one side of it: a path that lands on the other must not carry its light through the wall.
pub(crate) fn covered(worker: &Worker, receivers: &ReceiverBlock, points: &[u16]) -> Covered {
    let page_index = |texel: usize| receivers.page_index(texel) as u32;
    let mut found = Covered {
        texels: receivers.covered().map(page_index).collect(),
        split: Vec::new(),
        counts: RayCounts::default(),
    };
    for (texel, &points) in receivers.covered().zip(points).filter(|(_, points)| **points != ALL_POINTS) {
        // (What counts as no surface is not solved for: a path that lands there goes on.)
        if !is_usable(points) {
            found.split.push((page_index(texel), Vec::new()));
        } else if worker.is_split(receivers, texel, points, &mut found.counts) {
            found.split.push((page_index(texel), worker.some_points(receivers, texel, points)));
        }
    }
    found
}

/// The map of the cache for what is covered of the surfaces of an atlas. `layers` are all of the bake, traced
/// now or not: they decide the size of an entry.
pub(crate) fn map<'a>(
    worker: &Worker<'a>,
    atlas: &'a Atlas,
    found: Vec<Covered>,
    layers: usize,
) -> (CacheMap<'a>, RayCounts) {
    let shift = shift(found.iter().map(|f| f.texels.len()).sum(), layers);
    let covered = found.iter().flat_map(|f| f.texels.iter().map(|&texel| texel as usize));
    let mut map =
        CacheMap::new(atlas, worker.transport.space.geometry, (shift, most_entries(layers)), covered);
    let counts = sum(found.iter().map(|f| f.counts));
    let split = found.into_iter().flat_map(|f| f.split);
    split.for_each(|(texel, surface_points)| map.split(texel as usize, surface_points));
    (map, counts)
}

/// Fills both halves from the direct light of the blocks, which `state` gives for a half: all of the first
/// before any of the second. `samples`: those that a texel is sure to get; `are_all`: it gets no more.
pub(crate) fn fill<'a>(
    worker: &Worker<'a>,
    state: &(dyn Fn(usize, usize) -> Result<(BlockState, RayCounts)> + Sync),
    map: CacheMap<'a>,
    blocks: &[usize],
    (samples, are_all): (u32, bool),
    console: &dyn Observer,
) -> Result<(Cache<'a>, Solution, RayCounts)> {
    let progress = console.progress("first bounces", 2 * blocks.len() as u64);
    let (paths, mut counts) = (paths_per_entry(map.entries(), samples), RayCounts::default());
    let of_patches = if are_all { patch_paths(&map, paths, samples) } else { paths };
    let mut solution = Solution { passes: 0, settled: true };
    let endless = || endless_light::error(worker.transport.space.geometry);
    let mut solved = |half| -> Result<CacheHalf> {
        let (system, c) =
            trace(worker, &|block| state(block, half), &map, blocks, (paths, of_patches), half, || {
                progress.advance(1)
            })?;
        counts += c;
        let (values, s) = system.solve(|pass| progress.note(&format!("pass {pass}")), endless)?;
        solution = Solution { passes: solution.passes.max(s.passes), settled: solution.settled && s.settled };
        Ok(values)
    };
    let halves = [solved(0)?, solved(1)?];
    Ok((Cache::new(worker, map, halves), solution, counts))
}

/// Paths per patch and half where a texel gets `samples` paths, both halves together: all patches together
/// get at most as many paths per half as all squares of the cache get samples, and each at least
/// [`LEAST_PATHS`]. (What a city has without texels is mostly small triangles: they are many, and none
/// matters much by itself.)
fn patch_paths(map: &CacheMap, paths: usize, samples: u32) -> usize {
    let reads = map.squares() * samples as usize;
    let worth = reads / map.patches().max(1);
    1 << worth.clamp(LEAST_PATHS.min(paths), paths).ilog2()
}

/// Keeps a filled cache beside the work, for a run that continues it.
pub(crate) fn store(folder: &WorkFolder, halves: &[CacheHalf; 2]) -> Result<()> {
    let [a, b] = halves;
    folder.write_sealed(
        CACHE_FILE,
        &[bytemuck::cast_slice(a.scales()), a.bytes(), bytemuck::cast_slice(b.scales()), b.bytes()],
    )
}

/// What [`store`] kept; `None` where there is nothing whole and fitting.
pub(crate) fn load(folder: &WorkFolder, entries: usize, layers: usize) -> Result<Option<[CacheHalf; 2]>> {
    let Some(bytes) = folder.read_sealed(CACHE_FILE)? else { return Ok(None) };
    let values = entries * CacheHalf::bytes_per_entry(layers);
    let scales = CacheHalf::bytes_per_entry(layers) * 2;
    if bytes.len() != 2 * (values + scales) {
        return Ok(None);
    }
    let half = |bytes: &[u8]| {
        CacheHalf::from_parts(layers, bytemuck::pod_collect_to_vec(&bytes[..scales]), &bytes[scales..])
    };
    let (a, b) = bytes.split_at(values + scales);
    Ok(half(a).zip(half(b)).map(|(a, b)| [a, b]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_grow_with_the_page_and_the_cache_does_not() {
        let side = |side: usize| 1 << shift(side * side, 33);
        assert_eq!([512, 1500, 2048, 4096, 8192, 16384].map(side), [1, 1, 2, 4, 8, 16]);
        for side in [512, 1500, 2048, 4096, 8192, 16384] {
            let entries = (side * side) >> (2 * shift(side * side, 33));
            assert!(bytes(entries, 33, ORDINARY_PATHS) <= MOST_MEMORY);
        }
        assert!(bytes(most_entries(33), 33, ORDINARY_PATHS) <= MOST_MEMORY);
        assert_eq!(shift(usize::MAX, 33), LARGEST_SHIFT);
    }
}
