//! The Karhunen–Loève transform of a source's light over time and colour: what planes are best, and how much
//! each is worth.

use super::light::{SourceLight, counted, transformed};
use crate::linear::eigen;
use crate::tile::Coverage;

/// Rows of more than this are reduced first, to this many dimensions.
const DIRECT: usize = 150;
const REDUCED: usize = 80;
/// Rounds of the reduction: each multiplies what is kept of the smallest by the ratio of eigenvalues.
const ROUNDS: usize = 8;
/// The least weight of a frame, as a share of the largest.
const LEAST_WEIGHT: f64 = 0.003;

/// A source's light by rows (three a frame), and its principal components.
#[derive(Clone, Debug)]
pub(super) struct Transformed {
    /// Indices of the texels that count.
    pub texels: Vec<usize>,
    /// Per distinct frame and component, weighted, by texel that counts. (With its mean: so texels without
    /// light are exactly black.)
    pub rows: Vec<Vec<f32>>,
    /// Per frame, its distinct frame.
    pub distinct: Vec<usize>,
    /// Per frame: its weight in eighths of an octave.
    pub weights: Vec<i32>,
    /// The largest weight, in eighths of an octave, that all are relative to.
    pub gain: i32,
    /// Principal components: the mean square along each over the valid texels, and the share of each row.
    pub components: Vec<(f64, Vec<f64>)>,
}

impl Transformed {
    /// Of a source on a tile; `chroma`: what colour differences are multiplied by.
    pub(super) fn new(light: &SourceLight, coverage: &[Coverage], chroma: f64) -> Self {
        let texels = counted(coverage);
        // Frames that look the same share their rows.
        let mut first: Vec<usize> = Vec::new();
        let mut distinct = Vec::new();
        for (k, frame) in light.frames.iter().enumerate() {
            let same = |&j: &usize| {
                light.means[j] == light.means[k]
                    && (std::ptr::eq(light.frames[j], *frame) || light.frames[j] == *frame)
            };
            let at = first.iter().position(same).unwrap_or(first.len());
            if at == first.len() {
                first.push(k);
            }
            distinct.push(at);
        }
        let mut squares = vec![0.0; first.len()];
        for (&at, weight) in distinct.iter().zip(light.weights) {
            squares[at] += weight * weight;
        }
        let largest = squares.iter().fold(0.0f64, |a, b| a.max(*b)).sqrt();
        let gain = if largest > 0.0 { (8.0 * largest.log2()).round() as i32 } else { 0 };
        let stored = |square: &f64| {
            let weight = if largest > 0.0 { (square.sqrt() / largest).max(LEAST_WEIGHT) } else { 1.0 };
            (8.0 * weight.log2()).round() as i32
        };
        // Weights are at most 1: the step takes the rest.
        let of_distinct: Vec<i32> = squares.iter().map(stored).collect();
        let weights = distinct.iter().map(|&at| of_distinct[at]).collect();
        let mut rows = Vec::new();
        for (&k, weight) in first.iter().zip(&of_distinct) {
            let weight = (f64::from(*weight) / 8.0).exp2();
            let of_frame = transformed(light.frames[k], light.means[k], &texels);
            for (j, mut row) in of_frame.into_iter().enumerate() {
                let scale = if j == 0 { weight } else { weight * chroma };
                row.iter_mut().for_each(|value| *value *= scale as f32);
                rows.push(row);
            }
        }
        let components = components(&rows, texels.len());
        Transformed { texels, rows, distinct, weights, gain, components }
    }
}

/// Principal components of rows, the largest first; each row's share is of unit length over the rows.
fn components(rows: &[Vec<f32>], texels: usize) -> Vec<(f64, Vec<f64>)> {
    let n = rows.len();
    let mut covariance = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let product = dot(&rows[i], &rows[j]) / texels.max(1) as f64;
            (covariance[i * n + j], covariance[j * n + i]) = (product, product);
        }
    }
    if n <= DIRECT {
        return eigen(covariance, n);
    }
    // Orthogonal iteration, from waves in time, then the small problem in what it found.
    let wave = |i: usize, row: usize| (std::f64::consts::PI * (row as f64 + 0.5) * i as f64 / n as f64).cos();
    let mut vectors: Vec<Vec<f64>> = (0..REDUCED).map(|i| (0..n).map(|row| wave(i, row)).collect()).collect();
    let times = |vector: &[f64]| -> Vec<f64> {
        covariance.chunks_exact(n).map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum()).collect()
    };
    for _ in 0..ROUNDS {
        vectors = vectors.iter().map(|vector| times(vector)).collect();
        orthonormalise(&mut vectors);
    }
    let images: Vec<Vec<f64>> = vectors.iter().map(|vector| times(vector)).collect();
    let m = vectors.len();
    let small = (0..m * m)
        .map(|i| vectors[i / m].iter().zip(&images[i % m]).map(|(a, b)| a * b).sum::<f64>())
        .collect();
    let back = |(value, share): (f64, Vec<f64>)| {
        let mut row = vec![0.0; n];
        for (share, vector) in share.iter().zip(&vectors) {
            row.iter_mut().zip(vector).for_each(|(to, from)| *to += share * from);
        }
        (value, row)
    };
    eigen(small, m).into_iter().map(back).collect()
}

/// In single precision by pieces, then in double.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut total = 0.0;
    for (a, b) in a.chunks(256).zip(b.chunks(256)) {
        let mut sums = [0.0f32; 16];
        let (whole_a, rest_a) = a.as_chunks::<16>();
        let (whole_b, rest_b) = b.as_chunks::<16>();
        for (a, b) in whole_a.iter().zip(whole_b) {
            (0..16).for_each(|i| sums[i] += a[i] * b[i]);
        }
        let rest: f32 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
        total += f64::from(sums.iter().sum::<f32>() + rest);
    }
    total
}

/// Gram and Schmidt's, twice for precision; what vanishes is dropped.
fn orthonormalise(vectors: &mut Vec<Vec<f64>>) {
    let mut done: Vec<Vec<f64>> = Vec::with_capacity(vectors.len());
    for mut vector in vectors.drain(..) {
        let length = |vector: &[f64]| vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        let before = length(&vector);
        for _ in 0..2 {
            for other in &done {
                let along: f64 = vector.iter().zip(other).map(|(a, b)| a * b).sum();
                vector.iter_mut().zip(other).for_each(|(to, from)| *to -= along * from);
            }
        }
        let after = length(&vector);
        if after > 1e-12 * before {
            vector.iter_mut().for_each(|x| *x /= after);
            done.push(vector);
        }
    }
    *vectors = done;
}
