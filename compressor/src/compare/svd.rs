//! The linear control: a tile's texels × (frames · RGB) as a truncated singular value decomposition, its maps
//! in 8 bits.
//!
//! Light is relative to each frame's peak, as the PSNR is. The maps (one value a valid texel and component)
//! are rounded to 8 bits between their extremes, then the curves in time, and a constant one, are fitted to
//! the rounded maps by least squares and stored as float16. Like NDGI's training it aims at the mean PSNR:
//! the frames are weighted anew by what is left of their error, some rounds long. The best round of the best
//! of three transfer curves is taken for each tile.

use super::curve::Curve;
use super::method::{CodedTile, ROUNDS, reweighted, timed};
use super::tiles::{Texels, Tile};
use crate::Result;
use crate::linear::{eigen, solve};
use half::f16;

/// Linear light, which the error is measured in, and two that are fairer to the dark.
const TRIED: [Curve; 3] = [Curve::Power(1.0), Curve::Power(2.0), Curve::Log(8.0)];

/// A tile as stored.
struct Stored {
    curve: Curve,
    rank: usize,
    /// Per component: the value of byte 0, and of one step.
    ranges: Vec<[f32; 2]>,
    /// Per valid texel, `rank` bytes.
    maps: Vec<u8>,
    /// Per component, 3 values a frame.
    curves: Vec<f16>,
}

/// Compresses a tile to this many components.
pub(super) fn code(tile: &Tile, rank: usize) -> Result<CodedTile> {
    let encode = || {
        let (stored, _) = best(tile, rank, ROUNDS);
        // With the peaks, and the choice of the curve.
        let bits = 8 * stored.maps.len()
            + 16 * stored.curves.len()
            + 64 * stored.ranges.len()
            + 32 * tile.peaks.len()
            + 8;
        let curve = stored.curve;
        Ok((stored, bits as f64, vec![curve]))
    };
    timed(encode, |stored| Ok(decode(tile, stored)))
}

/// What has the highest mean PSNR after this many rounds by each curve; and the mean over the lit frames of
/// the logarithm of the error.
fn best(tile: &Tile, rank: usize, rounds: usize) -> (Stored, f64) {
    let trial_fits = TRIED.map(|curve| {
        let rows = matrix(tile, curve);
        let encode = |weights: &[f64]| encode(&rows, rank, curve, weights);
        reweighted(tile, rounds, encode, |stored| decode(tile, stored))
    });
    trial_fits.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).expect("there is a curve")
}

/// The matrix that is decomposed: a row a valid texel, a column a frame and channel.
fn matrix(tile: &Tile, curve: Curve) -> Vec<f64> {
    let mut rows = Vec::new();
    for i in tile.valid() {
        for (set, &peak) in tile.source.frames.iter().zip(&tile.peaks) {
            let relative = |c: usize| if peak > 0.0 { f64::from(set[i][c]) / f64::from(peak) } else { 0.0 };
            rows.extend([0, 1, 2].map(|c| curve.encode(relative(c))));
        }
    }
    rows
}

/// The first `rank` components of a matrix of `columns`: its coordinates along them, row by row.
fn components(rows: &[f64], columns: usize, rank: usize) -> Vec<f64> {
    let mut gram = vec![0.0; columns * columns];
    for row in rows.chunks_exact(columns) {
        for (i, &x) in row.iter().enumerate() {
            for (sum, &y) in gram[i * columns..][..=i].iter_mut().zip(row) {
                *sum += x * y;
            }
        }
    }
    for i in 0..columns {
        for j in 0..i {
            gram[j * columns + i] = gram[i * columns + j];
        }
    }
    let pairs = eigen(gram, columns);
    let along = |row: &[f64], v: &[f64]| row.iter().zip(v).map(|(x, y)| x * y).sum::<f64>();
    let mut out = Vec::with_capacity(rows.len() / columns * rank);
    for row in rows.chunks_exact(columns) {
        out.extend(pairs[..rank].iter().map(|(_, v)| along(row, v)));
    }
    out
}

/// The rows of `rank` whose combinations by `maps` are nearest to a matrix: (MᵀM) C = MᵀA.
fn fit(maps: &[f64], rows: &[f64], columns: usize, rank: usize) -> Vec<f64> {
    let (mut normal, mut right) = (vec![0.0; rank * rank], vec![0.0; rank * columns]);
    for (m, row) in maps.chunks_exact(rank).zip(rows.chunks_exact(columns)) {
        for i in 0..rank {
            (0..rank).for_each(|j| normal[i * rank + j] += m[i] * m[j]);
            right[i * columns..][..columns].iter_mut().zip(row).for_each(|(sum, x)| *sum += m[i] * x);
        }
    }
    solve(normal, right, rank, columns)
}

/// Maps that serve the frames by the weights of their squared errors, and the curves that are best for each
/// frame by them.
fn encode(rows: &[f64], rank: usize, curve: Curve, weights: &[f64]) -> Stored {
    let columns = 3 * weights.len();
    let rank = rank.min(columns);
    // Components of what differs from the mean: the curves have a constant term too.
    let mut means = vec![0.0; columns];
    let texels = (rows.len() / columns).max(1) as f64;
    rows.iter().enumerate().for_each(|(i, x)| means[i % columns] += x / texels);
    let weighted: Vec<f64> = (rows.iter().enumerate())
        .map(|(i, x)| (x - means[i % columns]) * weights[i % columns / 3].sqrt())
        .collect();
    let coordinates = components(&weighted, columns, rank);
    let ranges: Vec<[f32; 2]> = (0..rank)
        .map(|r| {
            let of = coordinates[r..].iter().step_by(rank);
            let (low, high) = of.fold((f64::MAX, f64::MIN), |(l, h), &x| (l.min(x), h.max(x)));
            [low as f32, ((high - low) / 255.0) as f32]
        })
        .collect();
    let byte = |(i, &x): (usize, &f64)| {
        let [low, step] = ranges[i % rank].map(f64::from);
        if step > 0.0 { ((x - low) / step).round().clamp(0.0, 255.0) as u8 } else { 0 }
    };
    let maps: Vec<u8> = coordinates.iter().enumerate().map(byte).collect();
    let terms: Vec<f64> = (maps.chunks_exact(rank))
        .flat_map(|bytes| {
            let values = bytes.iter().enumerate().map(|(r, &byte)| value(&ranges, r, byte));
            std::iter::once(1.0).chain(values)
        })
        .collect();
    let curves = fit(&terms, rows, columns, rank + 1).into_iter().map(f16::from_f64).collect();
    Stored { curve, rank, ranges, maps, curves }
}

/// What a byte of a component stands for.
fn value(ranges: &[[f32; 2]], component: usize, byte: u8) -> f64 {
    let [low, step] = ranges[component].map(f64::from);
    low + step * f64::from(byte)
}

fn decode(tile: &Tile, stored: &Stored) -> Vec<Texels> {
    let columns = 3 * tile.peaks.len();
    let curves: Vec<f64> = stored.curves.iter().map(|value| value.to_f64()).collect();
    let mut frames: Vec<Texels> = vec![vec![[0.0; 3]; tile.texels()]; tile.peaks.len()];
    let mut row = vec![0.0; columns];
    for (i, bytes) in tile.valid().zip(stored.maps.chunks_exact(stored.rank)) {
        row.copy_from_slice(&curves[..columns]);
        for (component, &byte) in bytes.iter().enumerate() {
            let weight = value(&stored.ranges, component, byte);
            let curve = &curves[(component + 1) * columns..][..columns];
            row.iter_mut().zip(curve).for_each(|(sum, x)| *sum += weight * x);
        }
        for (k, set) in frames.iter_mut().enumerate() {
            set[i] = [0, 1, 2].map(|c| tile.peaks[k] * stored.curve.decode(row[3 * k + c]) as f32);
        }
    }
    frames
}

#[cfg(test)]
mod tests {
    use super::super::method::squared_error;
    use super::super::testing::{tile, tile_of};
    use super::*;

    #[test]
    fn at_full_rank_the_components_are_the_matrix() {
        let tile = tile(12, 8, 3, 5);
        let columns = 9;
        let rows = matrix(&tile, Curve::Power(2.0));
        let error = |rank: usize| {
            let maps = components(&rows, columns, rank);
            let fitted = fit(&maps, &rows, columns, rank);
            let product = |i: usize, j: usize| -> f64 {
                (0..rank).map(|r| maps[i * rank + r] * fitted[r * columns + j]).sum()
            };
            rows.iter().enumerate().map(|(i, x)| (x - product(i / columns, i % columns)).powi(2)).sum::<f64>()
        };
        // The first is by far the largest.
        assert!(error(1) < 0.2 * rows.iter().map(|x| x * x).sum::<f64>());
        assert!(error(9) < 1e-20, "{}", error(9));
        assert!((1..9).all(|rank| error(rank) > 1e-4 && error(rank) > error(rank + 1)));
    }

    #[test]
    fn weighted_rounds_raise_the_mean_psnr() {
        // Three frames that are one picture, three that are noise.
        let noise = tile(12, 8, 6, 5);
        let mut frames = noise.source.frames;
        for k in [1, 2] {
            frames[k] = frames[0].iter().map(|texel| texel.map(|x| x * (1.0 - 0.2 * k as f32))).collect();
        }
        let tile = tile_of(12, 8, frames);
        let [plain, weighted] = [1, ROUNDS].map(|rounds| best(&tile, 3, rounds).1);
        // One decibel at least, in natural logarithms.
        assert!(weighted < plain - 0.23, "{weighted} {plain}");
    }

    #[test]
    fn what_is_the_same_for_all_texels_needs_no_component() {
        let moving = tile(12, 8, 1, 2).source.frames.remove(0);
        let grey = |k: u8| moving.iter().map(|texel| [0.5 + f32::from(k) * 0.2 * texel[0]; 3]).collect();
        let error = best(&tile_of(12, 8, (0..4).map(grey).collect()), 1, ROUNDS).1;
        assert!(error < (1e-5f64).ln(), "{error}");
    }

    #[test]
    fn eight_bits_cost_little_and_each_component_costs_a_byte_a_texel() {
        let tile = tile(12, 8, 3, 5);
        let error = |coded: &CodedTile| {
            (0..3).map(|k| squared_error(&coded.decoded[k], &tile.source.frames[k], &tile)).sum::<f64>()
        };
        let [one, all] = [1, 9].map(|rank| code(&tile, rank).unwrap());
        assert!(error(&all) < 1e-3 * error(&one), "{} {}", error(&all), error(&one));
        let valid = tile.valid().count() as f64;
        assert_eq!(all.bits - one.bits, 8.0 * (8.0 * valid + 16.0 * 9.0 + 64.0));
    }
}
