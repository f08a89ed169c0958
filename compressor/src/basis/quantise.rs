//! From principal components to the whole numbers of a set of planes.

use super::klt::Transformed;
use crate::planes::{MOST_PLANES, PlaneSet, encode_towards};
use crate::tile::Coverage;

/// Blocks of 8×8 texels.
const SIDE: usize = 8;

/// What is quantised how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantiser {
    /// Step of coefficients in eighths of an octave, 2^(−step/8), of a frame whose weight is 1.
    pub step: u8,
    /// Components of less variance than this, in units of the step's own error, are left out.
    pub cut: f64,
    /// Error, in squared steps, that a bit is worth.
    pub lambda: f32,
}

/// Largest value of a plane in steps.
const MOST_STEPS: f64 = 2000.0;

/// Part of a step that a row's share of a plane may be wrong by.
const FACTOR_ERROR: f64 = 0.016;

/// The blocks of a tile of stored width.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    width: usize,
    columns: usize,
    /// Row by row: whether a texel of it is on a surface, or so near one that filtering reads it.
    covered: Vec<bool>,
}

impl Blocks {
    pub(super) fn new(coverage: &[Coverage], [width, height]: [usize; 2]) -> Self {
        let columns = width.div_ceil(SIDE);
        let mut covered = vec![false; columns * height.div_ceil(SIDE)];
        for i in (0..coverage.len()).filter(|&i| coverage[i] != Coverage::Outside) {
            covered[i / width / SIDE * columns + i % width / SIDE] = true;
        }
        Blocks { width, columns, covered }
    }
}

/// The planes of a source's light, and their bytes. `set` has what is known before.
pub(super) fn quantise(
    of: &Transformed,
    blocks: &Blocks,
    set: PlaneSet,
    quantiser: &Quantiser,
) -> (PlaneSet, Vec<u8>) {
    let stored = (i32::from(quantiser.step) + of.gain).clamp(0, 255);
    // A value is at most 32767 sixteenths of a step.
    let largest = of.rows.iter().flatten().fold(0.0f32, |largest, value| largest.max(value.abs()));
    let largest = f64::from(largest) * (of.rows.len() as f64).sqrt();
    let finest = if largest > 0.0 { (8.0 * (MOST_STEPS / largest).log2()).floor() as i32 } else { 255 };
    let stored = stored.min(finest.clamp(0, 255));
    let step = (-f64::from(stored) / 8.0).exp2();
    let noise = step * step / 12.0;
    let planes = of.components.iter().take_while(|(square, _)| *square > noise * quantiser.cut).count();
    let planes = planes.min(MOST_PLANES);
    let Blocks { width, columns, covered } = blocks;
    let across = columns * SIDE;
    let down = covered.len() / columns * SIDE;
    let frames = of.distinct.len();
    // Per frame and component, its row.
    let row = |at: usize| 3 * of.distinct[at / 3] + at % 3;
    let (weights, covered) = (of.weights.clone(), covered.clone());
    let mut set = PlaneSet { step: stored as u8, weights, covered, ..set };
    let cosines = cosines();
    let mut exact = Vec::with_capacity(planes * set.covered.len());
    let mut plane = vec![0.0f32; across * down];
    for (square, shares) in &of.components[..planes] {
        // (A small tile has fewer texels that an error touches.)
        let finest = FACTOR_ERROR * step / square.sqrt() * (16384.0 / of.texels.len() as f64).sqrt();
        let scale = (-8.0 * finest.log2()).round().clamp(0.0, 255.0);
        let unit = (-scale / 8.0).exp2();
        set.scales.push(scale as u8);
        set.factors
            .extend((0..3 * frames).map(|at| (shares[row(at)] / unit).round().clamp(-1e7, 1e7) as i32));
        // The plane: how much of this component each texel has.
        plane.fill(f32::NAN);
        let mut along = vec![0.0f32; of.texels.len()];
        for (share, row) in shares.iter().zip(&of.rows) {
            along.iter_mut().zip(row).for_each(|(sum, value)| *sum += *share as f32 * value);
        }
        for (n, i) in of.texels.iter().enumerate() {
            plane[i / width * across + i % width] = along[n];
        }
        fill(&mut plane, across, down);
        for (block, covered) in set.covered.iter().enumerate() {
            let mut in_steps = [0.0; 64];
            if *covered {
                let (x, y) = (SIDE * (block % columns), SIDE * (block / columns));
                let at = |v: usize, u: usize| plane[(y + v) * across + x + u];
                let values = forward(&cosines, at);
                let scale = 1.0 / step as f32;
                in_steps.iter_mut().zip(values.as_flattened()).for_each(|(to, value)| *to = value * scale);
            }
            exact.push(in_steps);
        }
    }
    let bytes = encode_towards(&mut set, &exact, quantiser.lambda, *width);
    (set, bytes)
}

/// √(1/8) for k = 0, else ½, times cos((2n + 1) k π/16), by k, n.
fn cosines() -> [[f32; SIDE]; SIDE] {
    let cosine = |k: usize, n: usize| {
        let scale = if k == 0 { 0.125f64.sqrt() } else { 0.5 };
        (scale * (std::f64::consts::PI * ((2 * n + 1) * k) as f64 / 16.0).cos()) as f32
    };
    std::array::from_fn(|k| std::array::from_fn(|n| cosine(k, n)))
}

/// A block's coefficients.
fn forward(cosines: &[[f32; SIDE]; SIDE], at: impl Fn(usize, usize) -> f32) -> [[f32; SIDE]; SIDE] {
    let mut across = [[0.0; SIDE]; SIDE];
    for (y, row) in across.iter_mut().enumerate() {
        let line: [f32; SIDE] = std::array::from_fn(|x| at(y, x));
        *row = std::array::from_fn(|u| cosines[u].iter().zip(&line).map(|(c, value)| c * value).sum());
    }
    std::array::from_fn(|v| std::array::from_fn(|u| (0..SIDE).map(|y| cosines[v][y] * across[y][u]).sum()))
}

/// Fills what is not a number with means of ever larger squares around it, so that blocks that are used in
/// part cost little.
fn fill(values: &mut [f32], width: usize, height: usize) {
    let gap = |values: &[f32]| values.iter().any(|value| value.is_nan());
    if !gap(values) {
        return;
    }
    // Means of 2×2, again and again, until no gap is left or all is one.
    let mut levels: Vec<(Vec<f32>, usize, usize)> = vec![(values.to_vec(), width, height)];
    loop {
        let (finer, w, h) = levels.last().expect("there is one level");
        if !gap(finer) || (*w == 1 && *h == 1) {
            break;
        }
        let (cw, ch) = (w.div_ceil(2), h.div_ceil(2));
        let mut coarse = vec![f32::NAN; cw * ch];
        for (i, out) in coarse.iter_mut().enumerate() {
            let (x, y) = (2 * (i % cw), 2 * (i / cw));
            let (mut sum, mut count) = (0.0, 0.0);
            for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
                if x < *w && y < *h && !finer[y * w + x].is_nan() {
                    sum += finer[y * w + x];
                    count += 1.0;
                }
            }
            if count > 0.0 {
                *out = sum / count;
            }
        }
        levels.push((coarse, cw, ch));
    }
    for at in (1..levels.len()).rev() {
        let (finer, coarser) = levels.split_at_mut(at);
        let ((fine, w, _), (coarse, cw, _)) = (&mut finer[at - 1], &coarser[0]);
        for (i, value) in fine.iter_mut().enumerate().filter(|(_, value)| value.is_nan()) {
            *value = coarse[i / *w / 2 * cw + i % *w / 2];
        }
    }
    for (to, from) in values.iter_mut().zip(&levels[0].0) {
        *to = if from.is_nan() { 0.0 } else { *from };
    }
}
