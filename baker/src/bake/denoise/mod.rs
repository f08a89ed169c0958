//! Takes noise out of indirect light, and tells what error is left.
//!
//! Every layer by itself, on what was traced and on nothing else. Candidates are the unfiltered light and a few filters whose weights hang
//! on where texels lie ([`kernels`]); of those each texel gets the mixture whose estimated error around it is least ([`mix`]). The estimate
//! is without bias, so that the error which is told of the result is as true as that of the light before.
//!
//! Neighbours are those in space ([`places`]): light crosses neither to another surface, nor a wall, nor a gutter of the page, and does
//! cross seams. Work goes block by block, and holds of the layers what the block and its surroundings need.

mod kernels;
mod mix;
mod places;
#[cfg(test)]
mod tests;

use super::block::Worker;
use super::layers::{Filtered, FilteredLayer, Layers, Texel, Value};
use crate::trace::counts::RayCounts;
use crate::{Result, Rgb};
use dataset::console::{Console, stop_if_interrupted};
use kernels::{FILTERS, JUDGED, Kernel};
use mix::{Around, Halves, Judged, halves, mixed};
use places::{Nearby, Neighbour, Places, REACH};
use rayon::prelude::*;
use std::ops::Range;

/// Names the method: other filters are other files.
pub const METHOD: &str = "own-1";

/// Layers that are filtered at once.
const AT_ONCE: usize = 24;

/// Filters layers of a page whose covered texels are given, of which some are valid, and keeps what comes of it beside them; gives the rays
/// that it took.
///
/// # Errors
/// Layers that cannot be read or written, or [`crate::Error::Interrupted`].
pub fn run(
    worker: &Worker,
    layers: &Layers,
    texels: &[Texel],
    valid: &(dyn Fn(usize) -> bool + Sync),
    filtered: &[FilteredLayer],
    console: &Console,
) -> Result<RayCounts> {
    let mut blocks = Vec::new();
    let mut next = 0;
    for block in worker.blocks() {
        let from = next;
        next += worker.surface(block).covered().count();
        blocks.push(from as u32..next as u32);
    }
    let (places, rays) = Places::find(worker, texels, valid);
    let batches: Vec<&[FilteredLayer]> = filtered.chunks(AT_ONCE).collect();
    let progress = console.progress("denoising", (batches.len() * blocks.len()) as u64);
    for batch in batches {
        let sources = batch.iter().map(|layer| layers.open(layer)).collect::<Result<Vec<_>>>()?;
        let mut files =
            batch.iter().map(|layer| layers.create_filtered(layer)).collect::<Result<Vec<_>>>()?;
        // (As many at once as there are threads: what is done waits in memory for what comes before it.)
        for some in blocks.chunks(rayon::current_num_threads()) {
            let done = some.par_iter().map_init(
                || Scratch::new(texels.len()),
                |scratch, block| {
                    stop_if_interrupted()?;
                    let read = |layer: usize, wanted: &[usize]| sources[layer].read_at(wanted);
                    let values = of_block(&places, block.clone(), batch.len(), read, scratch)?;
                    progress.advance(1);
                    Ok(values)
                },
            );
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

/// What is used again from block to block.
struct Scratch {
    /// Per covered texel, its place among those at hand.
    at_hand: Vec<u32>,
}

/// Not at hand.
const AWAY: u32 = u32::MAX;

impl Scratch {
    fn new(texels: usize) -> Self {
        Scratch { at_hand: vec![AWAY; texels] }
    }
}

/// The neighbours of some texels.
struct Surroundings {
    /// The texels, ascending.
    texels: Vec<u32>,
    neighbours: Vec<Neighbour>,
    starts: Vec<usize>,
}

impl Surroundings {
    fn new(places: &Places, texels: Vec<u32>) -> Self {
        let (mut neighbours, mut starts, mut found) = (Vec::new(), vec![0], Vec::new());
        let mut nearby = Nearby::default();
        for &texel in &texels {
            places.neighbours(texel, &mut nearby, &mut found);
            neighbours.extend_from_slice(&found);
            starts.push(neighbours.len());
        }
        Surroundings { texels, neighbours, starts }
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

/// Filters the layers of a block: per layer, its texels.
fn of_block(
    places: &Places,
    block: Range<u32>,
    layers: usize,
    read: impl Fn(usize, &[usize]) -> Result<Vec<Value>>,
    scratch: &mut Scratch,
) -> Result<Vec<Vec<Filtered>>> {
    // Errors are estimated for the block's texels and their neighbours: that takes the neighbours of both.
    let judged = Surroundings::new(places, Surroundings::new(places, block.clone().collect()).all(JUDGED));
    let all = judged.all(REACH);
    all.iter().enumerate().for_each(|(i, &texel)| scratch.at_hand[texel as usize] = i as u32);
    let wanted: Vec<usize> = all.iter().map(|&texel| texel as usize).collect();
    let values = (0..layers).map(|layer| read(layer, &wanted)).collect::<Result<Vec<Vec<Value>>>>()?;
    let light: Vec<Vec<Halves>> = values.iter().map(|values| values.iter().map(halves).collect()).collect();
    let out =
        AtHand { judged: &judged, block, places: &scratch.at_hand, values: &values, light: &light }.mixed();
    all.iter().for_each(|&texel| scratch.at_hand[texel as usize] = AWAY);
    Ok(out)
}

/// A block and its surroundings.
struct AtHand<'a> {
    judged: &'a Surroundings,
    block: Range<u32>,
    /// Per covered texel of the page, its place in what follows.
    places: &'a [u32],
    /// By layer and place.
    values: &'a [Vec<Value>],
    light: &'a [Vec<Halves>],
}

impl AtHand<'_> {
    /// Per layer, what the filters make of the block's texels.
    fn mixed(&self) -> Vec<Vec<Filtered>> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has it.
            return unsafe { self.mixed_avx2() };
        }
        self.mixed_portable()
    }

    /// [`AtHand::mixed_portable`], the same to the bit: wider vectors, and no sums in another order.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn mixed_avx2(&self) -> Vec<Vec<Filtered>> {
        self.mixed_portable()
    }

    #[inline(always)]
    fn mixed_portable(&self) -> Vec<Vec<Filtered>> {
        let is_own = |texel: u32| self.block.contains(&texel);
        let layers: Vec<usize> = (0..self.values.len())
            .filter(|&layer| self.values[layer].iter().any(|value| value.noise != Rgb::ZERO))
            .collect();
        let own = self.judged.texels.iter().filter(|&&texel| is_own(texel)).count();
        let count = self.light.first().map_or(0, Vec::len);
        let mut errors = vec![vec![Judged::NONE; count]; layers.len()];
        let mut filtered = vec![Vec::with_capacity(own); layers.len()];
        let (mut kernel, mut at) = (Kernel::new(), Vec::new());
        for (i, &texel) in self.judged.texels.iter().enumerate() {
            let own_place = self.find(i, &mut kernel, &mut at);
            for (k, &layer) in layers.iter().enumerate() {
                let result = filter(&kernel, &at, &self.light[layer]);
                errors[k][own_place] = Judged::new(&self.values[layer][own_place], &result);
                if is_own(texel) {
                    filtered[k].push(result);
                }
            }
        }
        let mut out = vec![Vec::with_capacity(own); self.values.len()];
        let of_own = (0..self.judged.texels.len()).filter(|&i| is_own(self.judged.texels[i]));
        for (number, i) in of_own.enumerate() {
            let own_place = self.find(i, &mut kernel, &mut at);
            // What has no noise, and what has no neighbours, stays as it is.
            let mut next = layers.iter().zip(&errors).zip(&filtered).peekable();
            for (layer, out) in out.iter_mut().enumerate() {
                let value = &self.values[layer][own_place];
                let noisy = next.next_if(|((of, _), _)| **of == layer).filter(|_| at.len() > 1);
                let Some(((_, errors), filtered)) = noisy else {
                    out.push(Filtered::new(value));
                    continue;
                };
                let filtered = &filtered[number];
                let mut around = Around::new(value, filtered, &kernel.weights[0]);
                for (&other, &weight) in at.iter().zip(&kernel.judging).skip(1) {
                    if weight > 0.0 {
                        around.add(&errors[other], weight);
                    }
                }
                let mixtures = around.mixtures(value, filtered);
                out.push(Filtered::new(&around.believed(value, mixed(value, filtered, &mixtures))));
            }
        }
        out
    }

    /// Finds the weights and places of the neighbours of one of the judged texels, and its own place.
    fn find(&self, i: usize, kernel: &mut Kernel, at: &mut Vec<usize>) -> usize {
        let neighbours = self.judged.of(i);
        kernel.find(neighbours);
        at.clear();
        at.extend(neighbours.iter().map(|neighbour| self.places[neighbour.texel as usize] as usize));
        self.places[self.judged.texels[i] as usize] as usize
    }
}

/// What the filters make of a texel's light.
#[inline(always)]
fn filter(kernel: &Kernel, at: &[usize], light: &[Halves]) -> [Halves; FILTERS] {
    let mut sums = [[0.0f32; 8]; FILTERS];
    for (weights, &place) in kernel.weights.iter().zip(at) {
        let light = &light[place];
        for (sum, weight) in sums.iter_mut().zip(weights) {
            sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += weight * light);
        }
    }
    sums
}
