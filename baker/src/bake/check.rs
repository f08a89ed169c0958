//! How wrong a bake really is: seeded texels, traced again by long walks to their end.
//!
//! Walks to the end have no bias; their own noise is known from two independent halves and taken out of the difference. What is
//! left of the difference beyond the noise that the bake itself reports is its bias.

use super::block::{Stream, Worker};
use super::errors::Parts;
use super::layers::{Texel, Value};
use super::rounds::endless;
use crate::Rgb;
use crate::trace::walk::{RayCounts, sun_draw};
use dataset::console::{Console, stop_if_interrupted};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Texels that are checked.
pub const TEXELS: usize = 512;

/// What a check found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Check {
    /// Texels compared.
    pub texels: usize,
    /// Walks per texel of the reference.
    pub samples: u32,
    /// One entry per set with light.
    pub sets: Vec<SetCheck>,
}

/// A set, over the checked texels; all numbers relative to their mean light.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct SetCheck {
    /// Which set.
    pub set: usize,
    /// Root mean square difference from the reference, its noise taken out: the true error.
    pub true_error: f64,
    /// Root mean square of the errors that the bake estimates for these texels.
    pub estimated_error: f64,
    /// What of the true error the estimate does not explain: √(true² − estimated²), 0 where that is negative.
    pub bias: f64,
    /// Mean difference, with its sign: light lost or gained.
    pub mean_difference: f64,
    /// Root mean square of the reference's own standard error.
    pub reference_error: f64,
}

/// One checked texel at one set.
#[derive(Clone, Copy, Default)]
struct Sums {
    light: f64,
    difference: f64,
    difference2: f64,
    estimated2: f64,
    reference2: f64,
}

/// Checks [`TEXELS`] of the valid texels, chosen by the seed. `layers` holds each layer's values in the order of `texels`;
/// `sets` are made of the worker's layers.
pub fn check(
    worker: &Worker,
    texels: &[Texel],
    layers: &[Vec<Value>],
    sets: &[Parts],
    samples: u32,
    console: &Console,
) -> crate::Result<Check> {
    // The texels whose hashes are smallest.
    let mut chosen: Vec<(blake3::Hash, usize)> = (0..texels.len())
        .filter(|&i| texels[i].exposed == 1 && layers.iter().any(|l| l[i].mean != Rgb::ZERO))
        .map(|i| {
            (blake3::hash(&[worker.seed.to_le_bytes(), u64::from(texels[i].index).to_le_bytes()].concat()), i)
        })
        .collect();
    chosen.sort_unstable_by(|a, b| a.0.as_bytes().cmp(b.0.as_bytes()));
    chosen.truncate(TEXELS);
    let progress = console.progress("checking", chosen.len() as u64);
    let checked: Vec<Vec<Sums>> = chosen
        .par_iter()
        .map(|&(_, i)| {
            stop_if_interrupted()?;
            let [a, b] = reference(worker, texels[i].index, samples)?;
            progress.advance(1);
            let of_set = |parts: &Parts| {
                let sum = |value: &dyn Fn(usize) -> Rgb| {
                    parts.iter().map(|&(l, s)| value(l) * s).sum::<Rgb>().as_dvec3()
                };
                let (a, b) = (sum(&|l| a[l]), sum(&|l| b[l]));
                let difference = sum(&|l| layers[l][i].mean) - (a + b) * 0.5;
                Sums {
                    light: (a + b).element_sum() * 0.5,
                    difference: difference.element_sum(),
                    difference2: difference.length_squared(),
                    estimated2: sum(&|l| layers[l][i].error).length_squared(),
                    reference2: ((a - b) * 0.5).length_squared(),
                }
            };
            Ok(sets.iter().map(of_set).collect())
        })
        .collect::<crate::Result<_>>()?;
    let n = (3 * checked.len().max(1)) as f64;
    let summary = (0..sets.len()).filter_map(|set| {
        let total = |f: fn(&Sums) -> f64| checked.iter().map(|c| f(&c[set])).sum::<f64>() / n;
        let mean = total(|s| s.light);
        let (true2, estimated2) =
            (total(|s| s.difference2) - total(|s| s.reference2), total(|s| s.estimated2));
        (mean > 0.0).then(|| SetCheck {
            set,
            true_error: true2.max(0.0).sqrt() / mean,
            estimated_error: estimated2.sqrt() / mean,
            bias: (true2 - estimated2).max(0.0).sqrt() / mean,
            mean_difference: total(|s| s.difference) / mean,
            reference_error: total(|s| s.reference2).sqrt() / mean,
        })
    });
    Ok(Check { texels: checked.len(), samples, sets: summary.collect() })
}

/// Both halves of a texel's light in every layer, by walks to their end.
fn reference(worker: &Worker, index: u32, samples: u32) -> crate::Result<[Vec<Rgb>; 2]> {
    let (x, y) = ((index % worker.atlas.width) as usize, (index / worker.atlas.width) as usize);
    let block = worker.bins.block_of(x, y);
    let surface = worker.surface(block);
    let texel = (y - surface.y0) * surface.width + x - surface.x0;
    let lights = worker.transport.lights;
    let mut counts = RayCounts::default();
    let outside = worker.outside(&surface, texel, &mut counts);
    let halves = [0, 1].map(|half| {
        let sequence = worker.sequence(&surface, texel, Stream::Check, half);
        let mut sums = vec![Rgb::ZERO; lights.layers()];
        let mut taken = 0u32;
        for i in 0..samples / 2 {
            let sample = sequence.sample(i);
            let Some(at) = worker.receiver(&surface, texel, sample, outside, &mut counts) else { continue };
            taken += 1;
            let draw = sun_draw(sample);
            for light in 0..lights.sampled() {
                sums[lights.layer_of_sampled(light)] +=
                    worker.transport.direct(&at, light, sample, &draw, &mut counts);
            }
            worker.walk(&at, sample, None, &mut sums, &mut counts);
        }
        sums.iter_mut().for_each(|s| *s /= taken.max(1) as f32);
        sums
    });
    if counts.endless > 0 { Err(endless()) } else { Ok(halves) }
}
