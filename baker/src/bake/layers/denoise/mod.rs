//! Denoises indirect light, and estimates the error that is left.
//!
//! Every layer is filtered by itself, from what was traced alone. Candidates are the unfiltered light and a
//! few filters whose weights depend only on where texels lie (`kernels`). Each texel gets the mixture of them
//! whose estimated error around it is least (`mix`). For a given filter that estimate is unbiased. The choice
//! of a mixture leaves the texel's own errors out, so that the error reported for the result stays close to
//! the true one.
//!
//! Neighbours are those in space (`neighbours`): light crosses neither to another surface, nor a wall, nor a
//! gutter of the page, and does cross seams. Work goes block by block, and holds of the layers what the block
//! and its surroundings need.

mod texel_in_space;
mod stored_blocks;
mod neighbours;
mod kernels;
mod mix;
#[cfg(test)]
mod tests;

use super::folder::{FilteredLayer, Layers, Texel};
use crate::bake::prepare::Part;
use crate::bake::samples::Worker;
use crate::bake::store::{Filtered, Value};
use crate::trace::counts::RayCounts;
use crate::{Result, Rgb};
use dataset::host::signals::stop_if_interrupted;
use dataset::observe::Observer;
use kernels::{ERROR_RADIUS, FILTERS, Kernel};
use mix::{Around, ErrorMatrix, Halves, apply_mixtures, halves};
use neighbours::{Nearby, Neighbour, REACH, TexelsInSpace};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::ops::Range;
use std::time::Instant;
pub(crate) use stored_blocks::{BLOCK_BYTES, BLOCKS_AT_ONCE, TEXEL_BYTES};

/// Layers of a block that are held in memory at once.
pub(crate) const LAYERS_AT_ONCE: usize = 16;
/// Layers whose files are open at once.
pub(crate) const OPEN_FILES: usize = 200;

/// What came of denoising.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Denoised {
    /// The method.
    pub method: String,
    /// Layers from which noise was taken.
    pub layers: usize,
    /// Those of them that this run filtered.
    pub new_layers: usize,
    /// Seconds that it took this run.
    pub seconds: f64,
}

/// Denoises layers, and keeps account of it.
pub struct Denoiser {
    method: String,
    /// The names of what it has made.
    made: BTreeSet<String>,
    seconds: f64,
    /// Those traced for it.
    pub rays: RayCounts,
}

impl Denoiser {
    /// By a method.
    pub fn new(method: &str) -> Self {
        let (made, rays) = (BTreeSet::new(), RayCounts::default());
        Denoiser { method: method.to_owned(), made, seconds: 0.0, rays }
    }

    /// Denoises those layers of a page that have not been yet. `texels`: the covered ones; `valid`: which of
    /// them count. Per layer, what came of it; `None` where nothing is noise.
    ///
    /// # Errors
    /// Layers that cannot be read or written, or [`crate::Error::Interrupted`].
    pub fn denoise(
        &mut self,
        worker: &Worker,
        layers: &Layers,
        digests: &[String],
        (texels, valid): (&[Texel], &[bool]),
        console: &dyn Observer,
    ) -> Result<Vec<Option<FilteredLayer>>> {
        let start = Instant::now();
        let mut hash = blake3::Hasher::new();
        hash.update(&valid.iter().map(|valid| u8::from(*valid)).collect::<Vec<u8>>());
        let digest_of_valid = *hash.finalize().as_bytes();
        let of_layer = |digest: &String| {
            let mut is_noisy = false;
            layers.each(digest, Part::Rest, |_, value| is_noisy |= value.noise != Rgb::ZERO)?;
            is_noisy.then(|| layers.filtered(digest, &self.method, &digest_of_valid)).transpose()
        };
        let filtered = digests.iter().map(of_layer).collect::<Result<Vec<_>>>()?;
        let is_missing = |layer: &&FilteredLayer| !layers.has_filtered(layer, texels.len());
        let missing: Vec<FilteredLayer> = filtered.iter().flatten().filter(is_missing).cloned().collect();
        if !missing.is_empty() {
            self.rays += run(worker, layers, texels, &|position| valid[position], &missing, console)?;
        }
        self.made.extend(missing.into_iter().map(|layer| layer.name));
        self.seconds += start.elapsed().as_secs_f64();
        Ok(filtered)
    }

    /// What came of it, if anything was there to denoise.
    pub fn outcome(&self, filtered: &[Option<FilteredLayer>]) -> Option<Denoised> {
        let layers = filtered.iter().flatten().count();
        let new_layers = filtered.iter().flatten().filter(|layer| self.made.contains(&layer.name)).count();
        (layers > 0).then(|| Denoised {
            method: self.method.clone(),
            layers,
            new_layers,
            seconds: self.seconds,
        })
    }
}

/// Filters layers of a page and stores the results beside them. Gives the rays traced.
fn run(
    worker: &Worker,
    layers: &Layers,
    texels: &[Texel],
    valid: &(dyn Fn(usize) -> bool + Sync),
    filtered: &[FilteredLayer],
    console: &dyn Observer,
) -> Result<RayCounts> {
    let mut blocks = Vec::new();
    let mut next = 0;
    for block in worker.blocks() {
        let from = next;
        next += worker.block(block).covered().count();
        blocks.push((block, from as u32..next as u32));
    }
    let (texels_in_space, rays) = TexelsInSpace::find(worker, &blocks, texels, valid, layers.root())?;
    let passes = filtered.chunks(OPEN_FILES);
    let progress = console.progress("denoising", (filtered.len() * blocks.len()) as u64);
    for layers_of_pass in passes {
        let sources = layers_of_pass.iter().map(|layer| layers.open(layer)).collect::<Result<Vec<_>>>()?;
        let mut files =
            layers_of_pass.iter().map(|layer| layers.create_filtered(layer)).collect::<Result<Vec<_>>>()?;
        // (As many at once as there are threads: what is done waits in memory for what comes before it.)
        for some in blocks.chunks(rayon::current_num_threads()) {
            let done = some.par_iter().map(|(_, block)| {
                let block = Block::new(&texels_in_space, block.clone())?;
                let mut values = Vec::with_capacity(sources.len());
                for batch in sources.chunks(LAYERS_AT_ONCE) {
                    stop_if_interrupted()?;
                    let batch_values: Vec<_> =
                        batch.iter().map(|layer| layer.read_at(&block.all)).collect::<Result<_>>()?;
                    values.extend(block.filter(&batch_values));
                    progress.advance(batch.len() as u64);
                }
                Ok(values)
            });
            for block in done.collect::<Result<Vec<Vec<Vec<Filtered>>>>>()? {
                for (file, values) in files.iter_mut().zip(&block) {
                    file.write(bytemuck::cast_slice(values))?;
                }
            }
        }
        layers.keep_filtered(files)?;
    }
    Ok(rays)
}

/// The neighbours of some texels.
struct Surroundings {
    /// The texels, ascending.
    texels: Vec<u32>,
    neighbours: Vec<Neighbour>,
    starts: Vec<usize>,
}

impl Surroundings {
    fn new(texels_in_space: &TexelsInSpace, texels: Vec<u32>) -> Result<Self> {
        let (mut neighbours, mut starts, mut found) = (Vec::new(), vec![0], Vec::new());
        let mut nearby = Nearby::default();
        for &texel in &texels {
            texels_in_space.neighbours(texel, &mut nearby, &mut found)?;
            neighbours.extend_from_slice(&found);
            starts.push(neighbours.len());
        }
        Ok(Surroundings { texels, neighbours, starts })
    }

    /// The neighbours of one of them.
    fn of(&self, i: usize) -> &[Neighbour] {
        &self.neighbours[self.starts[i]..self.starts[i + 1]]
    }

    /// The texels themselves, and their neighbours up to a distance, ascending.
    fn all(&self, distance: f32) -> Vec<u32> {
        let mut all = self.texels.clone();
        all.extend(self.neighbours.iter().filter(|n| n.squared <= distance * distance).map(|n| n.texel));
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// A block's texels, and what filtering them takes.
struct Block {
    own: Range<u32>,
    /// Errors are estimated for the block's texels and their neighbours.
    estimated: Surroundings,
    /// The neighbours of all those, ascending.
    all: Vec<usize>,
    /// Where each of the estimated texels stands in `all`.
    loaded_index: Vec<u32>,
    /// Where each of their neighbours stands in `all`, in the order of `estimated.neighbours`.
    loaded_neighbours: Vec<u32>,
}

impl Block {
    fn new(texels_in_space: &TexelsInSpace, own: Range<u32>) -> Result<Self> {
        let estimated = Surroundings::new(texels_in_space, own.clone().collect())?.all(ERROR_RADIUS);
        let estimated = Surroundings::new(texels_in_space, estimated)?;
        let all = estimated.all(REACH);
        let positions = SortedIndex::of(&all);
        let loaded_index = estimated.texels.iter().map(|&texel| positions.find(texel)).collect();
        let loaded_neighbours = estimated.neighbours.iter().map(|n| positions.find(n.texel)).collect();
        let all = all.into_iter().map(|texel| texel as usize).collect();
        Ok(Block { own, estimated, all, loaded_index, loaded_neighbours })
    }

    /// Filters layers, given their values at `all`: per layer, the block's texels.
    fn filter(&self, values: &[Vec<Value>]) -> Vec<Vec<Filtered>> {
        let light: Vec<Vec<Halves>> =
            values.iter().map(|values| values.iter().map(halves).collect()).collect();
        LoadedBlock { block: self, values, light: &light }.filter_block()
    }
}

/// Finds where a number stands in an ascending list. A table in pieces: only those with numbers are made.
struct SortedIndex {
    piece_of: Vec<u32>,
    positions: Vec<u32>,
}

impl SortedIndex {
    /// Numbers that share a piece.
    const PIECE: u32 = 4096;

    fn of(list: &[u32]) -> Self {
        let pieces = list.last().map_or(0, |last| last / Self::PIECE + 1);
        let mut index = SortedIndex { piece_of: vec![0; pieces as usize], positions: Vec::new() };
        for some in list.chunk_by(|a, b| a / Self::PIECE == b / Self::PIECE) {
            let piece = index.positions.len() as u32;
            index.piece_of[(some[0] / Self::PIECE) as usize] = piece;
            index.positions.resize((piece + Self::PIECE) as usize, u32::MAX);
        }
        for (&number, position) in list.iter().zip(0..) {
            let place = index.place(number);
            index.positions[place] = position;
        }
        index
    }

    fn place(&self, number: u32) -> usize {
        (self.piece_of[(number / Self::PIECE) as usize] + number % Self::PIECE) as usize
    }

    fn find(&self, number: u32) -> u32 {
        self.positions[self.place(number)]
    }
}

/// A block and its surroundings.
struct LoadedBlock<'a> {
    block: &'a Block,
    /// By layer and index.
    values: &'a [Vec<Value>],
    light: &'a [Vec<Halves>],
}

impl LoadedBlock<'_> {
    /// Per layer, what the filters make of the block's texels.
    fn filter_block(&self) -> Vec<Vec<Filtered>> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has it.
            return unsafe { self.filter_block_avx2() };
        }
        self.filter_block_portable()
    }

    /// [`LoadedBlock::filter_block_portable`], the same to the bit: wider vectors, and no sums in another
    /// order.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn filter_block_avx2(&self) -> Vec<Vec<Filtered>> {
        self.filter_block_portable()
    }

    #[inline(always)]
    fn filter_block_portable(&self) -> Vec<Vec<Filtered>> {
        let Block { own: own_texels, estimated, .. } = self.block;
        let is_own = |texel: u32| own_texels.contains(&texel);
        let layers: Vec<usize> = (0..self.values.len())
            .filter(|&layer| self.values[layer].iter().any(|value| value.noise != Rgb::ZERO))
            .collect();
        let own = estimated.texels.iter().filter(|&&texel| is_own(texel)).count();
        let count = self.light.first().map_or(0, Vec::len);
        let mut errors = vec![vec![ErrorMatrix::NONE; count]; layers.len()];
        let mut filtered = vec![Vec::with_capacity(own); layers.len()];
        let (mut kernel, mut at, mut lights) = (Kernel::new(), Vec::new(), Vec::new());
        for (i, &texel) in estimated.texels.iter().enumerate() {
            let own_index = self.find(i, &mut kernel, &mut at);
            for (k, &layer) in layers.iter().enumerate() {
                let result = filter(&kernel, &at, &self.light[layer]);
                let values = &self.values[layer];
                lights.clear();
                lights.extend(kernel.nearest.iter().map(|&i| values[at[i]].mean.element_sum()));
                errors[k][own_index] = ErrorMatrix::new(&values[own_index], &result, median(&mut lights));
                if is_own(texel) {
                    filtered[k].push(result);
                }
            }
        }
        let mut out = vec![Vec::with_capacity(own); self.values.len()];
        let of_own = (0..estimated.texels.len()).filter(|&i| is_own(estimated.texels[i]));
        for (number, i) in of_own.enumerate() {
            let own_index = self.find(i, &mut kernel, &mut at);
            // What has no noise, and what has no neighbours, stays as it is.
            let mut next = layers.iter().zip(&errors).zip(&filtered).peekable();
            for (layer, out) in out.iter_mut().enumerate() {
                let value = &self.values[layer][own_index];
                let noisy = next.next_if(|((of, _), _)| **of == layer).filter(|_| at.len() > 1);
                let Some(((_, errors), filtered)) = noisy else {
                    out.push(Filtered::new(value));
                    continue;
                };
                let filtered = &filtered[number];
                let mut around = Around::new(value, filtered, &errors[own_index], &kernel.weights[0]);
                around.add(errors, &at[1..], &kernel.error_weights[1..]);
                let mixtures = around.mixtures(value, filtered);
                out.push(Filtered::new(
                    &around.unless_implausible(value, apply_mixtures(value, filtered, &mixtures)),
                ));
            }
        }
        out
    }

    /// Finds the weights and indices of the neighbours of one of the estimated texels, and its own index.
    fn find(&self, i: usize, kernel: &mut Kernel, at: &mut Vec<usize>) -> usize {
        let Block { estimated, loaded_index, loaded_neighbours, .. } = self.block;
        kernel.find(estimated.of(i));
        at.clear();
        let neighbours = &loaded_neighbours[estimated.starts[i]..estimated.starts[i + 1]];
        at.extend(neighbours.iter().map(|&i| i as usize));
        loaded_index[i] as usize
    }
}

/// The median of some lights; 0 of none.
fn median(lights: &mut [f32]) -> f32 {
    match lights.len() {
        0 => 0.0,
        count => *lights.select_nth_unstable_by(count / 2, f32::total_cmp).1,
    }
}

/// What the filters make of a texel's light.
#[inline(always)]
fn filter(kernel: &Kernel, at: &[usize], light: &[Halves]) -> [Halves; FILTERS] {
    let mut sums = [[0.0f32; 8]; FILTERS];
    for (weights, &index) in kernel.weights.iter().zip(at) {
        let light = &light[index];
        for (sum, weight) in sums.iter_mut().zip(weights) {
            sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += weight * light);
        }
    }
    sums
}
