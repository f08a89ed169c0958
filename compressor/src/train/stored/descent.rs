//! Coordinate descent of F_uvt's blocks on the linearised loss Σ |√w (r + J δ)|²: block by block, each given
//! all others, keeping every sample's residual up to date.

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use super::blocks::values;
use super::form::Form;
use super::matrices::{add_outer, dot};
use crate::bc7::Block;
use crate::lanes::{Lanes, Longest, Quad};
use crate::train::step::Kernel;
use crate::train::targets::{Pair, Problem};

/// √w J with respect to F_uvt's four features, in 8-bit steps, and √w r, of one sample.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    /// √w ∂y_c/∂f of the three channels c.
    pub jacobian: [Quad; 3],
    /// √w r
    pub residual: Quad,
}

/// One pass over all blocks of F_uvt.
pub(crate) struct Descent<'a> {
    pub problem: &'a Problem,
    /// Every this many frames are looked at.
    pub stride: usize,
    /// Per looked-at time point and stored texel; zero where a texel does not count. Residuals follow the
    /// blocks.
    pub samples: &'a mut [Sample],
    /// F_uvt, slice by slice.
    pub blocks: &'a mut [Block],
    /// Share of the mean diagonal that holds endpoints where they are.
    pub damping: f32,
}

/// Columns (or rows) that read one of a block's four columns (rows), with their weights on them.
type Readers = Vec<(usize, Quad)>;

/// The readers of four texels along an axis, from their offsets.
fn readers(pairs: impl Iterator<Item = Pair>, texels: [usize; 4]) -> Readers {
    let weights = |pair: Pair| {
        texels.map(|texel| pair.ends().iter().filter(|(at, _)| *at == texel).map(|(_, f)| f).sum::<f32>())
    };
    pairs.map(weights).enumerate().filter(|(_, weights)| weights.iter().any(|f| *f > 0.0)).collect()
}

impl Kernel for Descent<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Longest>(self) {
        let Descent { problem, stride, samples, blocks, damping } = self;
        let shape = &problem.shape;
        let [across, down, slices] = shape.uvt;
        let columns: Vec<Readers> = (0..across / 4)
            .map(|b| readers(problem.columns.iter().map(|s| s.uvt), [0, 1, 2, 3].map(|x| b * 4 + x)))
            .collect();
        let rows: Vec<Readers> = (0..down / 4)
            .map(|b| readers(problem.rows.iter().map(|s| s.uvt), [0, 1, 2, 3].map(|y| (b * 4 + y) * across)))
            .collect();
        let mut blocks = blocks.iter_mut();
        for slice in 0..slices {
            let of_slice = |pair: &Pair| {
                let ends = pair.ends();
                ends.iter().filter(|(at, _)| *at == slice * across * down).map(|(_, f)| f).sum::<f32>()
            };
            let examined = problem.points[..problem.frames].iter().step_by(stride);
            let points = examined.map(|m| of_slice(&m.slices)).enumerate().filter(|(_, f)| *f > 0.0);
            let points: Vec<(usize, f32)> = points.collect();
            for rows in &rows {
                for columns in &columns {
                    let block =
                        blocks.next().expect("there is a block for all columns and rows of all slices");
                    let reach =
                        Reach { columns, rows, points: &points, width: shape.width, height: shape.height };
                    let form = reach.form(samples);
                    let improved = form.improve::<V>(block, damping);
                    if improved != *block {
                        reach.shift(samples, &values(block), &values(&improved));
                        *block = improved;
                    }
                }
            }
        }
    }
}

/// The samples that read one block.
struct Reach<'a> {
    columns: &'a Readers,
    rows: &'a Readers,
    /// Looked-at time points that read the block's slice, with their weights on it.
    points: &'a [(usize, f32)],
    /// Stored width.
    width: usize,
    /// Stored height.
    height: usize,
}

impl Reach<'_> {
    /// The first sample of a row of stored texels at a time point.
    #[inline(always)]
    fn line(&self, point: usize, y: usize) -> usize {
        (point * self.height + y) * self.width
    }

    /// The loss as a form of the block's texels.
    #[inline(always)]
    fn form(&self, samples: &[Sample]) -> Form {
        let mut form = Form::NONE;
        for (y, on_rows) in self.rows {
            for (x, on_columns) in self.columns {
                // What all time points have in common is where the sample lies.
                let (mut square, mut slope) = ([[0.0; 4]; 4], [0.0; 4]);
                for &(m, f) in self.points {
                    let sample = &samples[self.line(m, *y) + x];
                    for c in 0..3 {
                        add_outer(&mut square, f * f, sample.jacobian[c]);
                        slope = Quad::splat(f * sample.residual[c]).mul_add(sample.jacobian[c], slope);
                    }
                }
                let (texels, count) = read(on_rows, on_columns);
                for &(p, a) in &texels[..count] {
                    form.slope[p] = Quad::splat(a).mul_add(slope, form.slope[p]);
                    for &(q, b) in &texels[..count] {
                        for r in 0..4 {
                            let row = &mut form.matrix[p][q][r];
                            *row = Quad::splat(a * b).mul_add(square[r], *row);
                        }
                    }
                }
            }
        }
        form
    }

    /// The residuals after the block's texels moved.
    #[inline(always)]
    fn shift(&self, samples: &mut [Sample], from: &[Quad; 16], to: &[Quad; 16]) {
        for (y, on_rows) in self.rows {
            for (x, on_columns) in self.columns {
                let (texels, count) = read(on_rows, on_columns);
                let mut moved = [0.0; 4];
                for &(q, a) in &texels[..count] {
                    moved = Quad::splat(a).mul_add(from[q].mul_add([-1.0; 4], to[q]), moved);
                }
                for &(m, f) in self.points {
                    let sample = &mut samples[self.line(m, *y) + x];
                    for c in 0..3 {
                        sample.residual[c] += f * dot(sample.jacobian[c], moved);
                    }
                }
            }
        }
    }
}

/// The texels that a sample reads, of which at most two columns and two rows are the block's, with their
/// weights; and how many.
#[inline(always)]
fn read(on_rows: &Quad, on_columns: &Quad) -> ([(usize, f32); 4], usize) {
    let (mut texels, mut count) = ([(0, 0.0); 4], 0);
    for q in 0..16 {
        let weight = on_rows[q / 4] * on_columns[q % 4];
        if weight > 0.0 {
            texels[count] = (q, weight);
            count += 1;
        }
    }
    (texels, count)
}

#[cfg(test)]
mod tests {
    use super::super::matrices::times;
    use super::*;
    use crate::train::targets::Random;

    #[test]
    fn the_form_is_the_loss_of_what_the_texels_are_moved_to() {
        let mut random = Random::new(1);
        // Twelve columns and ten rows of stored texels, of which the block's four columns and rows are read
        // by some; three time points.
        let (width, height) = (12, 10);
        let pair = |at: usize, texels: usize| Pair { at: [at, (at + 1).min(texels - 1)], f: 0.3 };
        let columns = readers((0..width).map(|x| pair(x / 2, 6)), [1, 2, 3, 4]);
        let rows = readers((0..height).map(|y| pair(y / 2, 5)), [0, 1, 2, 3]);
        assert_eq!(columns.first(), Some(&(0, [0.3, 0.0, 0.0, 0.0])));
        assert_eq!((columns.len(), rows.len()), (10, 8));
        let reach = Reach { columns: &columns, rows: &rows, points: &[(0, 0.25), (2, 1.0)], width, height };
        let mut number = || random.uniform(-1.0, 1.0);
        let sample = |_| Sample {
            jacobian: std::array::from_fn(|_| std::array::from_fn(|_| number())),
            residual: std::array::from_fn(|c| if c < 3 { number() } else { 0.0 }),
        };
        let before: Vec<Sample> = (0..3 * width * height).map(sample).collect();
        let from = [[100.0; 4]; 16];
        let to: [Quad; 16] = std::array::from_fn(|_| std::array::from_fn(|_| 100.0 + 3.0 * number()));
        let form = reach.form(&before);
        let mut after = before.clone();
        reach.shift(&mut after, &from, &to);
        let loss = |samples: &[Sample]| -> f32 {
            samples.iter().map(|sample| dot(sample.residual, sample.residual)).sum()
        };
        let moved: [Quad; 16] = std::array::from_fn(|q| std::array::from_fn(|c| to[q][c] - from[q][c]));
        let mut reported = 0.0;
        for p in 0..16 {
            reported += 2.0 * dot(form.slope[p], moved[p]);
            (0..16).for_each(|q| reported += dot(moved[p], times(&form.matrix[p][q], moved[q])));
        }
        let changed = loss(&after) - loss(&before);
        assert!((reported - changed).abs() < 1e-4 * loss(&after), "{reported} {changed}");
        // One sample by hand: at time point 2 column 5 lies between texels 2 and 3 and row 4 on texels 2 and
        // 3 of the page, the block's columns 1 and 2 and rows 2 and 3.
        let at = (2 * height + 4) * width + 5;
        let weights = [(9, 0.7 * 0.7), (10, 0.7 * 0.3), (13, 0.3 * 0.7), (14, 0.3 * 0.3)];
        let shift: f32 = weights.iter().map(|&(q, a)| a * dot(before[at].jacobian[1], moved[q])).sum();
        assert!((after[at].residual[1] - before[at].residual[1] - shift).abs() < 1e-5);
        // What reads nothing of it stays: the time point between, the first columns.
        assert_eq!(after[height * width + 5].residual, before[height * width + 5].residual);
    }
}
