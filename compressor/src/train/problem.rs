//! What the training of one tile is given: its samples' targets and weights, and where each sample reads the maps.

use super::lanes::Quad;
use crate::model::{INPUTS, Shape};
use crate::tile::{Coverage, TileSource};
use crate::time::Coding;

/// An epoch of training visits one of so many gutter texels.
pub const GUTTER_SHARE: usize = 5;
/// Weight of a gutter texel in the loss; a valid one has 1.
pub const GUTTER_WEIGHT: f32 = 0.1;
/// A set's channel is divided by at least this share of its largest texel, so that no ratio to the mean exceeds 1 / share.
const LEAST_MEAN_OF_PEAK: f64 = 0.01;
/// A channel is divided by at least this share of the set's strongest channel.
const LEAST_MEAN_OF_CHANNELS: f64 = 0.003;

/// Two neighbouring texels of a map along one axis: offsets, and the weight of the second.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pair {
    /// Texel (or offset) of weight 1 − f, and of weight f.
    pub at: [usize; 2],
    /// f
    pub f: f32,
}

impl Pair {
    /// Both with their weights.
    #[inline(always)]
    pub fn ends(&self) -> [(usize, f32); 2] {
        [(self.at[0], 1.0 - self.f), (self.at[1], self.f)]
    }
}

/// Bilinear neighbours of a coordinate in [0, 1] with centres at (i + ½)/size, clamped at the ends.
pub fn clamped(coordinate: f64, size: usize) -> Pair {
    let p = (coordinate * size as f64 - 0.5).clamp(0.0, (size - 1) as f64);
    let i = p.floor() as usize;
    Pair { at: [i, (i + 1).min(size - 1)], f: (p - i as f64) as f32 }
}

/// The same for an axis of period 1.
pub fn periodic(coordinate: f64, size: usize) -> Pair {
    let p = coordinate * size as f64 - 0.5;
    let i = p.floor();
    let wrap = |i: f64| (i as i64).rem_euclid(size as i64) as usize;
    Pair { at: [wrap(i), wrap(i + 1.0)], f: (p - i) as f32 }
}

/// Where a column (or row) of stored texels reads the maps. Texels of F_uv and F_uvt lie block by block, so offsets of
/// a column and a row add up.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Part of the offset into F_uv.
    pub uv: usize,
    /// Parts of the offsets into a slice of F_uvt.
    pub uvt: Pair,
    /// Texels of a row of F_ut (or F_vt).
    pub plane: Pair,
}

/// One set that is trained on.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Index among the tile's sets.
    #[cfg(test)]
    pub index: usize,
    /// First texels of the two slices of F_uvt.
    pub slices: Pair,
    /// Rows of F_ut and F_vt.
    pub rows: Pair,
    /// γ(τ)
    pub gamma: [f32; 4],
    /// Scale of each channel: E = mean · y^p; 0 for a black channel.
    pub means: [f32; 3],
    /// Largest valid value of the set.
    pub peak: f32,
    /// Loss weight of a channel: `base + slope · target`, at most [`super::kernel::WEIGHT_CAP`].
    pub base: Quad,
    /// See `base`.
    pub slope: Quad,
}

/// A stored texel that is trained on.
#[derive(Clone, Copy, Debug)]
pub struct Texel {
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
}

/// All samples of a tile.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Sizes of the maps.
    pub shape: Shape,
    /// What τ, γ and a target are.
    pub coding: Coding,
    /// Per stored column.
    pub columns: Vec<Site>,
    /// Per stored row.
    pub rows: Vec<Site>,
    /// The sets that are not black.
    pub moments: Vec<Moment>,
    /// Valid texels, then gutter texels.
    pub texels: Vec<Texel>,
    /// How many of them are valid.
    pub valid: usize,
    /// Per moment and texel: (E/mean)^(1/p) of three channels, and its loss weight when an epoch visits it.
    pub targets: Vec<Quad>,
    /// Means of all sets, zero where black.
    pub means: Vec<[f32; 3]>,
}

impl Problem {
    /// Prepares a tile. The problem has no moments or no valid texels where there is nothing to train.
    pub fn new(source: &TileSource, shape: Shape, coding: Coding) -> Self {
        let place = |i: usize| Texel { x: (i % source.width) as u16, y: (i / source.width) as u16 };
        let of = |coverage| (0..source.coverage.len()).filter(move |&i| source.coverage[i] == coverage);
        let valid: Vec<usize> = of(Coverage::Valid).collect();
        let all: Vec<usize> = valid.iter().copied().chain(of(Coverage::Gutter)).collect();
        let mut means = vec![[0.0f32; 3]; source.sets.len()];
        let mut moments = Vec::new();
        let mut targets = Vec::new();
        for (index, light) in source.sets.iter().enumerate() {
            let (scale, peak) = scales(light, &valid);
            if peak == 0.0 {
                continue;
            }
            means[index] = scale;
            moments.push(moment(index, &source.hours, coding, &shape, scale, peak));
            targets.extend(all.iter().enumerate().map(|(j, &i)| {
                let weight = if j < valid.len() { 1.0 } else { GUTTER_WEIGHT * GUTTER_SHARE as f32 };
                // A gutter texel may outshine all valid ones; it is only there to filter with.
                let target = |c: usize| match scale[c] {
                    0.0 => 0.0,
                    mean => {
                        let ratio = f64::from(light[i][c]) / f64::from(mean);
                        coding.output(ratio.min(1.0 / LEAST_MEAN_OF_PEAK)) as f32
                    }
                };
                [target(0), target(1), target(2), weight]
            }));
        }
        let uvt_row = shape.uvt[0] / 4;
        Problem {
            columns: (0..shape.width)
                .map(|x| {
                    site(
                        x,
                        shape.width,
                        shape.uvt[0],
                        shape.ut,
                        |x| x / 4 * 16 + x % 4,
                        |x| x / 4 * 16 + x % 4,
                    )
                })
                .collect(),
            rows: (0..shape.height)
                .map(|y| {
                    let within = |y: usize, across: usize| y / 4 * across * 16 + y % 4 * 4;
                    let uv = |y| within(y, shape.width / 4);
                    site(y, shape.height, shape.uvt[1], shape.vt, uv, |y| within(y, uvt_row))
                })
                .collect(),
            moments,
            texels: all.into_iter().map(place).collect(),
            valid: valid.len(),
            targets,
            means,
            shape,
            coding,
        }
    }
}

impl Problem {
    /// How often an epoch visits a texel: factor of its weight where every texel is visited.
    #[inline(always)]
    pub fn share(&self, texel: usize) -> f32 {
        if texel < self.valid { 1.0 } else { 1.0 / GUTTER_SHARE as f32 }
    }
}

/// The value each channel of a set is divided by, and the set's largest value. Both over valid texels.
fn scales(light: &[[f32; 3]], valid: &[usize]) -> ([f32; 3], f32) {
    let (mut sum, mut peak) = ([0.0f64; 3], [0.0f64; 3]);
    for &i in valid {
        for c in 0..3 {
            sum[c] += f64::from(light[i][c]);
            peak[c] = peak[c].max(f64::from(light[i][c]));
        }
    }
    let mean = sum.map(|s| s / valid.len().max(1) as f64);
    let strongest = mean.iter().fold(0.0f64, |a, &b| a.max(b));
    let scale = |c: usize| match peak[c] {
        0.0 => 0.0,
        peak => mean[c].max(LEAST_MEAN_OF_PEAK * peak).max(LEAST_MEAN_OF_CHANNELS * strongest) as f32,
    };
    ([scale(0), scale(1), scale(2)], peak.iter().fold(0.0f64, |a, &b| a.max(b)) as f32)
}

fn moment(index: usize, hours: &[f64], coding: Coding, shape: &Shape, means: [f32; 3], peak: f32) -> Moment {
    let tau = coding.set_tau(hours, index);
    let slice = shape.uvt[0] * shape.uvt[1];
    let slices = periodic(tau, shape.uvt[2]);
    Moment {
        #[cfg(test)]
        index,
        slices: Pair { at: slices.at.map(|i| i * slice), f: slices.f },
        rows: periodic(tau, shape.rows),
        gamma: coding.gamma(tau),
        means,
        peak,
        base: [0, 1, 2, 3].map(|c| if c < 3 && means[c] > 0.0 { 1.0 } else { 0.0 }),
        slope: [0.0; 4],
    }
}

fn site(
    at: usize,
    stored: usize,
    uvt: usize,
    plane: usize,
    uv_offset: impl Fn(usize) -> usize,
    uvt_offset: impl Fn(usize) -> usize,
) -> Site {
    let coordinate = (at as f64 + 0.5) / stored as f64;
    let pair = clamped(coordinate, uvt);
    Site {
        uv: uv_offset(at),
        uvt: Pair { at: pair.at.map(uvt_offset), f: pair.f },
        plane: clamped(coordinate, plane),
    }
}

/// Inputs 12 … 15 of a sample are γ; the rest are features.
pub const FEATURES: usize = INPUTS - 4;
