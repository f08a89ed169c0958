//! A tile's vectors as bits: per cluster a mean and components in float16, per texel its cluster and 8 bits a
//! component.
//!
//! What counts is the error of the light, so components are those of the vectors under the metric M = Σ w
//! AᵀA, with A from a vector to a frame's light. Like the SVD it aims at the mean PSNR: the frames' weights
//! follow what is left of their errors, some rounds long.

use super::super::method::{CodedTile, ROUNDS, reweighted, timed};
use super::super::tiles::{Texels, Tile};
use super::Vectors;
use super::cluster::Points;
use crate::Result;
use crate::linear::{eigen, solve};
use half::f16;

/// Passes in which texels go to the nearest cluster, at first, and in each later round.
const PASSES: [usize; 2] = [8, 3];
/// Most clusters, and most components, of a tile.
const MOST: [usize; 2] = [64, 16];
/// Bits that are taken, as shares of those that are wanted; where no numbers lie between, the nearest from
/// above.
const NEAR: std::ops::RangeInclusive<f64> = 0.95..=1.05;
/// Share of the variance that may be lost before clusters are sought: 70 dB below the light.
const LOST: f64 = 1e-7;
/// Largest number that float16 holds.
const LARGEST: f64 = 65504.0;

/// A tile as stored.
struct Stored {
    rank: usize,
    /// Per cluster, its mean and components one after the other.
    clusters: Vec<Vec<f16>>,
    /// Per valid texel, its cluster.
    of: Vec<usize>,
    /// Per valid texel, `rank` bytes: a component's coordinate from −1 to 1.
    bytes: Vec<u8>,
}

/// Vectors in float16, each for itself.
pub(super) fn plain(tile: &Tile, vectors: &Vectors) -> Result<CodedTile> {
    let encode = || {
        let stored: Vec<f16> = vectors.rows.iter().map(|&x| half(x)).collect();
        let bits = 16 * stored.len() + 32 * vectors.scales;
        Ok((stored, bits as f64, Vec::new()))
    };
    timed(encode, |stored| {
        let rows = stored.chunks_exact(vectors.numbers()).map(|row| {
            let row: Vec<f64> = row.iter().map(|x| x.to_f64()).collect();
            vectors.light(&row)
        });
        Ok(images(tile, rows))
    })
}

/// Vectors by clustered principal components, within this many bits or as near to them as can be.
pub(super) fn clustered(tile: &Tile, vectors: &Vectors, bits: f64) -> Result<CodedTile> {
    let encode = || {
        let sizes = sizes(tile.valid().count(), vectors, bits);
        let trial_fits =
            sizes.into_iter().map(|(clusters, rank)| best(tile, vectors, clusters, rank, ROUNDS));
        let (stored, _) = trial_fits.min_by(|a, b| a.1.total_cmp(&b.1)).expect("there is a size");
        let bits = stored.bits(vectors);
        Ok((stored, bits as f64, Vec::new()))
    };
    timed(encode, |stored| Ok(decode(tile, vectors, stored)))
}

fn half(x: f64) -> f16 {
    f16::from_f64(x.clamp(-LARGEST, LARGEST))
}

/// All bits of a tile: texels, clusters, the largest values, the two numbers themselves.
fn bits(texels: usize, vectors: &Vectors, clusters: usize, rank: usize) -> usize {
    let index = clusters.next_power_of_two().ilog2() as usize;
    texels * (8 * rank + index) + 16 * clusters * (rank + 1) * vectors.numbers() + 32 * vectors.scales + 16
}

/// Numbers of clusters and components that take about this many bits: for each number of components the
/// nearest; where none is near, the one of all that is nearest from above, else the largest.
fn sizes(texels: usize, vectors: &Vectors, wanted: f64) -> Vec<(usize, usize)> {
    let share = |(clusters, rank): (usize, usize)| bits(texels, vectors, clusters, rank) as f64 / wanted;
    let ranks = 1..=MOST[1].min(vectors.numbers());
    let enough = |rank: usize| {
        let all = (1..=MOST[0].min(texels)).map(move |clusters| (clusters, rank));
        let enough = all.filter(|size| share(*size) >= *NEAR.start());
        enough.min_by(|a, b| (share(*a) - 1.0).abs().total_cmp(&(share(*b) - 1.0).abs()))
    };
    let nearest: Vec<(usize, usize)> = ranks.clone().filter_map(enough).collect();
    let near: Vec<(usize, usize)> =
        nearest.iter().copied().filter(|size| NEAR.contains(&share(*size))).collect();
    if !near.is_empty() {
        return near;
    }
    let least = nearest.into_iter().min_by(|a, b| share(*a).total_cmp(&share(*b)));
    vec![least.unwrap_or((MOST[0].min(texels), *ranks.end()))]
}

/// The round with the highest mean PSNR, and its mean over the lit frames of the logarithm of the error.
fn best(tile: &Tile, vectors: &Vectors, clusters: usize, rank: usize, rounds: usize) -> (Stored, f64) {
    let mut of: Option<Vec<usize>> = None;
    let encode = |weights: &[f64]| {
        // Of light relative to the peak.
        let relative =
            |(weight, &peak): (&f64, &f32)| if peak > 0.0 { weight / f64::from(peak).powi(2) } else { 0.0 };
        let weights: Vec<f64> = weights.iter().zip(&tile.peaks).map(relative).collect();
        let points = in_metric(vectors, &weights).reduced(LOST);
        let passes = PASSES[usize::from(of.is_some())];
        let of = of.get_or_insert_with(|| points.divided(clusters, rank));
        fitted(vectors, &points, of, rank, passes)
    };
    reweighted(tile, rounds, encode, |stored| decode(tile, vectors, stored))
}

/// The vectors in coordinates whose distance is the weighted error of the light: M = V Λ Vᵀ for each channel,
/// and √Λ Vᵀ x.
fn in_metric(vectors: &Vectors, weights: &[f64]) -> Points {
    let n = vectors.sources;
    let mut maps = Vec::new();
    for c in 0..3 {
        let mut metric = vec![0.0; n * n];
        for (k, weight) in weights.iter().enumerate() {
            let a = &vectors.weights[(3 * k + c) * n..][..n];
            for (i, x) in a.iter().enumerate() {
                metric[i * n..][..n].iter_mut().zip(a).for_each(|(sum, y)| *sum += weight * x * y);
            }
        }
        let pairs = eigen(metric, n).into_iter().filter(|(value, _)| *value > 0.0);
        maps.extend(pairs.map(|(value, v)| (c, v.iter().map(|v| v * value.sqrt()).collect::<Vec<f64>>())));
    }
    let along = |row: &[f64], (c, map): &(usize, Vec<f64>)| -> f64 {
        row[c * n..][..n].iter().zip(map).map(|(x, m)| x * m).sum()
    };
    let rows = vectors.rows.chunks_exact(vectors.numbers());
    Points {
        dimensions: maps.len(),
        values: rows.flat_map(|row| maps.iter().map(move |map| along(row, map))).collect(),
    }
}

/// Clusters that the points settle in, coordinates in bytes, and the means and components that are best for
/// those bytes.
fn fitted(vectors: &Vectors, points: &Points, of: &mut [usize], rank: usize, passes: usize) -> Stored {
    let rank = rank.min(points.dimensions);
    let spaces = points.settled(of, rank, passes);
    let coordinates: Vec<f64> = points.coordinates(of, &spaces).collect();
    // Per cluster and component, the extremes.
    let mut ranges = vec![[f64::MAX, f64::MIN]; spaces.len() * rank];
    for (i, &x) in coordinates.iter().enumerate() {
        let [low, high] = &mut ranges[of[i / rank] * rank + i % rank];
        (*low, *high) = (low.min(x), high.max(x));
    }
    let byte = |(i, x): (usize, &f64)| {
        let [low, high] = ranges[of[i / rank] * rank + i % rank];
        if high > low { ((x - low) / (high - low) * 255.0).round() as u8 } else { 0 }
    };
    let bytes: Vec<u8> = coordinates.iter().enumerate().map(byte).collect();
    let (n, m) = (vectors.numbers(), rank + 1);
    let mut normal = vec![vec![0.0; m * m]; spaces.len()];
    let mut right = vec![vec![0.0; m * n]; spaces.len()];
    for (i, (row, &of)) in vectors.rows.chunks_exact(n).zip(of.iter()).enumerate() {
        let terms: Vec<f64> = terms(&bytes[i * rank..][..rank]).collect();
        for (p, x) in terms.iter().enumerate() {
            normal[of][p * m..][..m].iter_mut().zip(&terms).for_each(|(sum, y)| *sum += x * y);
            right[of][p * n..][..n].iter_mut().zip(row).for_each(|(sum, y)| *sum += x * y);
        }
    }
    let solved = normal.into_iter().zip(right).map(|(normal, right)| solve(normal, right, m, n));
    let clusters = solved.map(|values| values.into_iter().map(half).collect()).collect();
    Stored { rank, clusters, of: of.to_vec(), bytes }
}

/// By what the mean and the components are multiplied.
fn terms(bytes: &[u8]) -> impl Iterator<Item = f64> + '_ {
    std::iter::once(1.0).chain(bytes.iter().map(|&byte| f64::from(byte) / 127.5 - 1.0))
}

fn decode(tile: &Tile, vectors: &Vectors, stored: &Stored) -> Vec<Texels> {
    // Means and components are lit once for all texels.
    let lit = |cluster: &Vec<f16>| -> Vec<Vec<f64>> {
        let values: Vec<f64> = cluster.iter().map(|x| x.to_f64()).collect();
        values.chunks_exact(vectors.numbers()).map(|vector| vectors.light(vector)).collect()
    };
    let clusters: Vec<Vec<Vec<f64>>> = stored.clusters.iter().map(lit).collect();
    let rows = stored.of.iter().enumerate().map(|(i, &of)| {
        let mut row = vec![0.0; 3 * tile.peaks.len()];
        for (term, light) in terms(&stored.bytes[i * stored.rank..][..stored.rank]).zip(&clusters[of]) {
            row.iter_mut().zip(light).for_each(|(sum, x)| *sum += term * x);
        }
        row
    });
    images(tile, rows)
}

/// The valid texels' light, 3 values a frame each, as images; there is no light below 0.
fn images(tile: &Tile, rows: impl Iterator<Item = Vec<f64>>) -> Vec<Texels> {
    let mut frames: Vec<Texels> = vec![vec![[0.0; 3]; tile.texels()]; tile.peaks.len()];
    for (i, row) in tile.valid().zip(rows) {
        for (set, rgb) in frames.iter_mut().zip(row.as_chunks::<3>().0) {
            set[i] = rgb.map(|x| x.max(0.0) as f32);
        }
    }
    frames
}

impl Stored {
    fn bits(&self, vectors: &Vectors) -> usize {
        bits(self.of.len(), vectors, self.clusters.len(), self.rank)
    }
}

#[cfg(test)]
#[path = "code_tests.rs"]
mod tests;
