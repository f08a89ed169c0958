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
use crate::Result;
use crate::trace::counts::RayCounts;
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
    let place = |neighbour: &Neighbour| scratch.at_hand[neighbour.texel as usize] as usize;
    let is_own = |texel: u32| block.contains(&texel);
    let own = judged.texels.iter().filter(|&&texel| is_own(texel)).count();
    let mut errors = vec![vec![Judged::NONE; all.len()]; layers];
    let mut filtered = vec![Vec::with_capacity(own); layers];
    let (mut kernel, mut at) = (Kernel::new(), Vec::new());
    for (i, &texel) in judged.texels.iter().enumerate() {
        let neighbours = judged.of(i);
        kernel.find(neighbours);
        at.clear();
        at.extend(neighbours.iter().map(place));
        let own_place = scratch.at_hand[texel as usize] as usize;
        for layer in 0..layers {
            let result = filter(&kernel, &at, &light[layer]);
            errors[layer][own_place] = Judged::new(&values[layer][own_place], &result);
            if is_own(texel) {
                filtered[layer].push(result);
            }
        }
    }
    let mut out = vec![Vec::with_capacity(own); layers];
    let of_own = judged.texels.iter().enumerate().filter(|(_, texel)| is_own(**texel));
    for (number, (i, &texel)) in of_own.enumerate() {
        let neighbours = judged.of(i);
        kernel.find(neighbours);
        let own_place = scratch.at_hand[texel as usize] as usize;
        for layer in 0..layers {
            let value = &values[layer][own_place];
            if neighbours.len() < 2 {
                // Nothing is near: it stays as it is.
                out[layer].push(Filtered::new(value));
                continue;
            }
            let errors = &errors[layer];
            let filtered = &filtered[layer][number];
            let mut around = Around::new(value, filtered, &kernel.weights[0]);
            let judging = neighbours.iter().zip(&kernel.judging).skip(1).filter(|(_, weight)| **weight > 0.0);
            for (neighbour, &weight) in judging {
                around.add(&errors[place(neighbour)], weight);
            }
            let mixtures = around.mixtures(value, filtered);
            out[layer].push(Filtered::new(&around.believed(value, mixed(value, filtered, &mixtures))));
        }
    }
    all.iter().for_each(|&texel| scratch.at_hand[texel as usize] = AWAY);
    Ok(out)
}

/// What the filters make of a texel's light.
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
