//! Coordinate descent of F_uvt's blocks on the linearised loss Σ |√w (r + J δ)|²: one texel's index, then one block's
//! endpoints, then its mode at a time, keeping every sample's residual up to date.

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use super::blocks::{Matrix, System, Wanted, add_outer, dot, rounded, times, values, weights};
use super::kernel::Kernel;
use super::problem::{Pair, Problem};
use super::quantise::solve;
use crate::bc7::{Block, Mode, palette};
use crate::lanes::{Lanes, Quad};

/// √w J with respect to F_uvt's four features, in 8-bit steps, and √w r, of one sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sample {
    /// √w ∂y_c/∂f of the three channels c.
    pub jacobian: [Quad; 3],
    /// √w r
    pub residual: Quad,
}

/// Free texels are held this much more than endpoints.
const FREE: f32 = 10.0;

/// Positions along an axis (columns, rows, looked-at moments) that read a texel or slice of F_uvt, with their weights.
type Readers = Vec<(usize, f32)>;

fn readers(pairs: impl Iterator<Item = Pair>, texel: usize) -> Readers {
    let weight = |pair: &Pair| pair.ends().iter().filter(|(at, _)| *at == texel).map(|(_, f)| f).sum::<f32>();
    pairs.map(|pair| weight(&pair)).enumerate().filter(|(_, f)| *f > 0.0).collect()
}

/// One pass over all blocks of F_uvt.
pub struct Descent<'a> {
    /// The tile.
    pub problem: &'a Problem,
    /// Every so many sets are looked at.
    pub stride: usize,
    /// Per looked-at moment and stored texel; zero where a texel does not count. Residuals follow the blocks.
    pub samples: &'a mut [Sample],
    /// F_uvt, slice by slice.
    pub blocks: &'a mut [Block],
    /// Share of the mean diagonal that holds endpoints where they are.
    pub damping: f32,
}

impl Kernel for Descent<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Descent { problem, stride, samples, blocks, damping } = self;
        let shape = &problem.shape;
        let [across, down, slices] = shape.uvt;
        // Offsets of columns and rows run block by block; see `Site`.
        let along_x = |x: usize| readers(problem.columns.iter().map(|s| s.uvt), x / 4 * 16 + x % 4);
        let along_y =
            |y: usize| readers(problem.rows.iter().map(|s| s.uvt), y / 4 * (across / 4) * 16 + y % 4 * 4);
        let along_t = |s: usize| {
            let moments = problem.moments[..problem.sets].iter().step_by(stride);
            readers(moments.map(|m| m.slices), s * across * down)
        };
        let columns: Vec<_> = (0..across).map(along_x).collect();
        let rows: Vec<_> = (0..down).map(along_y).collect();
        let moments: Vec<_> = (0..slices).map(along_t).collect();
        let mut blocks = blocks.iter_mut();
        for moments in &moments {
            for rows in rows.chunks_exact(4) {
                for (columns, block) in columns.chunks_exact(4).zip(&mut blocks) {
                    let reach = Reach { columns, rows, moments, width: shape.width, height: shape.height };
                    reach.choose_indices(block, samples);
                    reach.fit_endpoints(block, samples, damping);
                    reach.choose_mode(block, samples, damping);
                }
            }
        }
    }
}

/// The samples that read one block.
struct Reach<'a> {
    /// Of each of the block's four columns.
    columns: &'a [Readers],
    /// Of each of its four rows.
    rows: &'a [Readers],
    /// Of its slice.
    moments: &'a [(usize, f32)],
    /// Stored width.
    width: usize,
    /// Stored height.
    height: usize,
}

impl Reach<'_> {
    /// The samples of a row of stored texels at a moment.
    #[inline(always)]
    fn line(&self, moment: usize, y: usize) -> std::ops::Range<usize> {
        let first = (moment * self.height + y) * self.width;
        first..first + self.width
    }

    /// Texel by texel, the value that lowers Σ |r + a J δ|² most, given all others.
    #[inline(always)]
    fn choose_indices(&self, block: &mut Block, samples: &mut [Sample]) {
        let choices = palette(block.mode, &block.endpoints).map(|t| t.map(f32::from));
        let choices = &choices[..block.mode.values()];
        for q in 0..16 {
            let old = choices[usize::from(block.indices[q])];
            let (form, slope) = self.around(samples, q);
            let (mut best, mut least) = (block.indices[q], 0.0);
            for (i, value) in choices.iter().enumerate() {
                let d: Quad = std::array::from_fn(|c| value[c] - old[c]);
                let md = times(&form, d);
                let change: f32 = (0..4).map(|c| d[c] * (2.0 * slope[c] + md[c])).sum();
                if change < least {
                    (best, least) = (i as u8, change);
                }
            }
            if best != block.indices[q] {
                block.indices[q] = best;
                let value = choices[usize::from(best)];
                self.shift(samples, q, std::array::from_fn(|c| value[c] - old[c]));
            }
        }
    }

    /// Both endpoints by least squares, the indices given, if that lowers the loss.
    #[inline(always)]
    fn fit_endpoints(&self, block: &mut Block, samples: &mut [Sample], damping: f32) {
        let system = self.normal_equations(block, samples);
        let present = block.endpoints.map(|e| e.map(f32::from));
        let mut damped = system.clone();
        damped.damp(damping, &[[0.0; 4]; 2]);
        let Some(step) = damped.solve() else { return };
        let goal =
            [0, 4].map(|k| std::array::from_fn(|c| (present[k / 4][c] + step[k + c]).clamp(0.0, 255.0)));
        let (mut best, mut least) = (block.endpoints, 0.0);
        for candidate in rounded(block.mode, &goal) {
            let change = std::array::from_fn(|i| f32::from(candidate[i / 4][i % 4]) - present[i / 4][i % 4]);
            let energy = system.energy(&change);
            if energy < least {
                (best, least) = (candidate, energy);
            }
        }
        if best == block.endpoints {
            return;
        }
        let old = values(block);
        block.endpoints = best;
        self.shift_all(samples, &old, &values(block));
    }

    /// Of a change d of texel q: the loss changes by 2 slopeᵀ d + dᵀ form d.
    #[inline(always)]
    fn around(&self, samples: &[Sample], q: usize) -> (Matrix, Quad) {
        let (mut form, mut slope) = ([[0.0; 4]; 4], [0.0; 4]);
        for &(m, fm) in self.moments {
            for &(y, fy) in &self.rows[q / 4] {
                let line = &samples[self.line(m, y)];
                for &(x, fx) in &self.columns[q % 4] {
                    let (sample, a) = (&line[x], fm * fy * fx);
                    for c in 0..3 {
                        let j = Quad::splat(a).mul(sample.jacobian[c]);
                        add_outer(&mut form, 1.0, j);
                        slope = Quad::splat(sample.residual[c]).mul_add(j, slope);
                    }
                }
            }
        }
        (form, slope)
    }

    /// The block in mode 6 and in mode 4 near to where its texels would go if they were free, if that lowers the loss.
    #[inline(always)]
    fn choose_mode(&self, block: &mut Block, samples: &mut [Sample], damping: f32) {
        let mut least = self.loss(samples);
        let mut wanted = Wanted { texels: values(block), metric: [[[0.0; 4]; 4]; 16] };
        for q in (0..32).map(|i| i % 16) {
            let (mut form, slope) = self.around(samples, q);
            let mean = (0..4).map(|c| form[c][c]).sum::<f32>() / 4.0;
            (0..4).for_each(|c| form[c][c] += FREE * damping * mean + 1e-12);
            let (step, old) = (solve(&form, &slope), wanted.texels[q]);
            wanted.texels[q] = std::array::from_fn(|c| (old[c] - step[c]).clamp(0.0, 255.0));
            wanted.metric[q] = form;
            self.shift(samples, q, std::array::from_fn(|c| wanted.texels[q][c] - old[c]));
        }
        let six = wanted.fit(Mode::Six, block.endpoints.map(|e| e.map(f32::from)), 6).0;
        let (mut best, mut at) = (*block, wanted.texels);
        for mut candidate in [six, wanted.fit_four(6).0] {
            self.shift_all(samples, &at, &values(&candidate));
            self.choose_indices(&mut candidate, samples);
            self.fit_endpoints(&mut candidate, samples, damping);
            at = values(&candidate);
            let loss = self.loss(samples);
            if loss < least {
                (best, least) = (candidate, loss);
            }
        }
        self.shift_all(samples, &at, &values(&best));
        *block = best;
    }

    /// The loss of the samples that read the block.
    #[inline(always)]
    fn loss(&self, samples: &[Sample]) -> f32 {
        let (xs, ys) = (merged(self.columns), merged(self.rows));
        let mut sum = 0.0;
        for &(m, _) in self.moments {
            for (y, _) in &ys {
                let line = &samples[self.line(m, *y)];
                sum += xs.iter().map(|(x, _)| dot(line[*x].residual, line[*x].residual)).sum::<f32>();
            }
        }
        sum
    }

    /// Of a change of both endpoints: the block adds (a − B) e₀ + B e₁ to a sample, a = Σ a_q, B = Σ a_q w_q for each channel.
    #[inline(always)]
    fn normal_equations(&self, block: &Block, samples: &[Sample]) -> System {
        let (xs, ys) = (merged(self.columns), merged(self.rows));
        let weight = block.indices.map(|i| weights(block.mode, i));
        let mut system = System::default();
        for (y, wy) in &ys {
            // Columns' sums down the block's rows.
            let (mut mass, mut bend) = (0.0, [[0.0; 4]; 4]);
            for i in 0..4 {
                mass += wy[i];
                for x in 0..4 {
                    bend[x] = Quad::splat(wy[i]).mul_add(weight[4 * i + x], bend[x]);
                }
            }
            for (x, wx) in &xs {
                let all = mass * (wx[0] + wx[1] + wx[2] + wx[3]);
                let b = times(&bend, *wx);
                let (mut form, mut pull) = ([[0.0; 4]; 4], [0.0; 4]);
                for &(m, fm) in self.moments {
                    let sample = &samples[self.line(m, *y)][*x];
                    for c in 0..3 {
                        let j = Quad::splat(fm).mul(sample.jacobian[c]);
                        add_outer(&mut form, 1.0, j);
                        pull = Quad::splat(sample.residual[c]).mul_add(j, pull);
                    }
                }
                let a = b.map(|b| all - b);
                system.add_matrix(&form, a, b);
                for c in 0..4 {
                    system.right[c] -= a[c] * pull[c];
                    system.right[4 + c] -= b[c] * pull[c];
                }
            }
        }
        system
    }

    /// The residuals after all texels moved.
    #[inline(always)]
    fn shift_all(&self, samples: &mut [Sample], from: &[Quad; 16], to: &[Quad; 16]) {
        for q in 0..16 {
            self.shift(samples, q, std::array::from_fn(|c| to[q][c] - from[q][c]));
        }
    }

    /// The residuals after texel `q` moved by `d`.
    #[inline(always)]
    fn shift(&self, samples: &mut [Sample], q: usize, d: Quad) {
        for &(m, fm) in self.moments {
            for &(y, fy) in &self.rows[q / 4] {
                let line = &mut samples[self.line(m, y)];
                for &(x, fx) in &self.columns[q % 4] {
                    let (sample, a) = (&mut line[x], fm * fy * fx);
                    for c in 0..3 {
                        sample.residual[c] += a * dot(sample.jacobian[c], d);
                    }
                }
            }
        }
    }
}

/// The positions that read any of a block's four columns (or rows), each with its weights on the four.
#[inline(always)]
fn merged(lists: &[Readers]) -> Vec<(usize, Quad)> {
    let mut merged: Vec<(usize, Quad)> = Vec::new();
    for (i, list) in lists.iter().enumerate() {
        for &(at, f) in list {
            match merged.iter_mut().find(|(x, _)| *x == at) {
                Some((_, weights)) => weights[i] += f,
                None => {
                    let mut weights = [0.0; 4];
                    weights[i] = f;
                    merged.push((at, weights));
                }
            }
        }
    }
    merged
}
