//! Neural texture compression (Vaidyanathan et al. 2023), the paper's neural baseline.
//!
//! A texture set has at most 16 channels, so the day is cut into segments of at most five frames, each
//! compressed on its own: per tile a grid of high resolution, whose four cells around a texel are read side
//! by side, and one of low resolution, read bilinearly; both of few bits. One network, shared by all tiles of
//! a run, reads them with a positional encoding and gives all frames of the segment at once. Light is
//! relative to the peak of its tile and frame. What the original does to other mip levels has no counterpart
//! here.

mod network;
mod grids;
mod train;

use super::Effort;
use super::curve::Curve;
use super::method::{Coded, CodedTiles};
use super::tiles::{Texels, TileSet};
use crate::Result;
use crate::clock::Clock;
use grids::Layout;
use network::Weights;
use rayon::prelude::*;
use std::ops::Range;

/// Frames of a segment, at most: 15 channels of 16.
const SETS: usize = 5;
/// The curve from light to what the network gives: on the scene `room` a little better than the square root
/// by every measure.
const CURVE: Curve = Curve::Power(3.0);

/// A rate: the sizes of both grids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Preset {
    pub name: &'static str,
    /// Texels of a cell of the high-resolution grid, along a side; one of the low-resolution grid has twice
    /// as many.
    scale: usize,
    /// Features of both grids.
    features: [usize; 2],
    /// Bits of a feature of both grids.
    bits: [u32; 2],
}

/// The published ones of 3.5, 5 and 8 bits a texel.
pub(super) const PRESETS: [Preset; 3] = [
    Preset { name: "NTC L", scale: 4, features: [12, 8], bits: [4, 4] },
    Preset { name: "NTC M", scale: 4, features: [16, 16], bits: [4, 4] },
    Preset { name: "NTC H", scale: 2, features: [8, 16], bits: [2, 4] },
];

/// Steps of a segment's training.
fn steps(effort: Effort) -> usize {
    match effort {
        Effort::Draft => 1500,
        Effort::Full => 20_000,
    }
}

/// Compresses all tiles. Bits are those of the grids and peaks, as published rates are; what the networks
/// would add if these tiles alone shared them is given too, in bits per texel and frame.
pub(super) fn code(set: &TileSet, preset: &Preset, effort: Effort, seed: u64) -> Result<(CodedTiles, f64)> {
    let layout = Layout::new(set, preset);
    let n = set.timeline.hours.len();
    let segments = segments(n);
    let done: Vec<Segment> = segments
        .par_iter()
        .enumerate()
        .with_max_len(1)
        .map(|(i, frames)| {
            segment(set, &layout, preset, frames.clone(), steps(effort), seed ^ (i as u64) << 32)
        })
        .collect::<Result<_>>()?;
    let bits = layout.bits(preset) * segments.len() as f64 + 32.0 * (n * set.tiles.len()) as f64;
    let networks = 16.0 * (segments.len() * Weights::stored(preset)) as f64;
    let mut coded = Coded {
        decoded: vec![Vec::with_capacity(n); set.tiles.len()],
        bits,
        encode_seconds: 0.0,
        decode_seconds: 0.0,
        curves: Vec::new(),
    };
    for segment in done {
        coded.encode_seconds += segment.encode_seconds;
        coded.decode_seconds += segment.decode_seconds;
        coded.decoded.iter_mut().zip(segment.decoded).for_each(|(all, frames)| all.extend(frames));
    }
    Ok((coded, networks / set.values()))
}

/// The frames of each segment: as few segments as possible, of nearly equal length.
fn segments(n: usize) -> Vec<Range<usize>> {
    let number = n.div_ceil(SETS);
    (0..number).map(|i| i * n / number..(i + 1) * n / number).collect()
}

struct Segment {
    /// Per tile, per frame of the segment.
    decoded: Vec<Vec<Texels>>,
    encode_seconds: f64,
    decode_seconds: f64,
}

fn segment(
    set: &TileSet,
    layout: &Layout,
    preset: &Preset,
    frames: Range<usize>,
    steps: usize,
    seed: u64,
) -> Result<Segment> {
    let clock = Clock::start();
    let trained = train::train(set, layout, preset, frames.clone(), steps, seed)?;
    let encode_seconds = clock.seconds();
    let clock = Clock::start();
    let decoded = train::decode(set, layout, &trained, frames);
    Ok(Segment { decoded, encode_seconds, decode_seconds: clock.seconds() })
}

#[cfg(test)]
mod tests {
    use super::super::testing::{set_of, tile_of};
    use super::*;

    #[test]
    fn segments_are_consecutive_and_the_rates_the_published_ones() {
        assert_eq!(segments(12), [0..4, 4..8, 8..12]);
        assert_eq!(
            (segments(27).len(), segments(26).len(), segments(5).len(), segments(1).len()),
            (6, 6, 1, 1)
        );
        let hours: Vec<f64> = (0..27).map(|k| 0.8 * f64::from(k)).collect();
        let set = set_of(vec![tile_of(128, 128, vec![vec![[1.0; 3]; 128 * 128]; 27])], &hours);
        for (preset, bpp) in PRESETS.iter().zip([3.5, 5.0, 8.0]) {
            let bits = Layout::new(&set, preset).bits(preset);
            assert_eq!(bits / (128.0 * 128.0), bpp, "{}", preset.name);
        }
    }

    #[test]
    fn a_brief_training_meets_smooth_light() {
        let light = |k: usize, i: usize| {
            let (x, y) = ((i % 16) as f32 / 16.0, (i / 16) as f32 / 16.0);
            [1.0 + x, 2.0 + (1.0 + k as f32) * y * x, 0.5 + y]
        };
        let frames: Vec<Texels> = (0..6).map(|k| (0..256).map(|i| light(k, i)).collect()).collect();
        let hours: Vec<f64> = (0..6).map(|k| 4.0 * f64::from(k)).collect();
        let set = set_of(vec![tile_of(16, 16, frames.clone())], &hours);
        let layout = Layout::new(&set, &PRESETS[0]);
        let error = |steps: usize| {
            let segment = segment(&set, &layout, &PRESETS[0], 3..6, steps, 1).unwrap();
            let decoded = segment.decoded[0].iter().flatten().flatten();
            let wanted = frames[3..].iter().flatten().flatten();
            (decoded.zip(wanted).map(|(a, b)| (a - b).powi(2)).sum::<f32>() / 2304.0).sqrt()
        };
        let (short, long) = (error(10), error(400));
        assert!(long < 0.06 && long < 0.5 * short, "{short} {long}");
        assert_eq!(error(20), error(20));
    }
}
