//! Where Adam sees the decoder network's matrices: in the eigenbases of their gradients (SOAP: Vyas et al.
//! 2024, "Improving and Stabilizing Shampoo using Adam").
//!
//! Of a matrix the gradients G have the covariances E[G Gᵀ] and E[Gᵀ G]. With their eigenvectors as rows of U
//! and V, Adam's moments are those of U G Vᵀ, and its step S moves the matrix by Uᵀ S V: directions that the
//! features' correlations mix have a rate each. Biases stay as they are.

use super::kernel::{Kernel, run};
use crate::lanes::{Longest, Tier};
use crate::model::Shape;
use std::ops::Range;

/// What a step leaves of a covariance.
const MEMORY: f32 = 0.95;
/// Eigenvectors are updated from their covariance every this many steps, by one round of orthogonal
/// iteration.
const EVERY: u32 = 10;
/// Rounds at the first step, from the axes.
const FIRST_ROUNDS: usize = 10;
/// Share of the mean eigenvalue that is added to all, so that no direction vanishes.
const FLOOR: f32 = 1e-5;

/// The bases of all matrices of a decoder network.
#[derive(Clone, Debug)]
pub(crate) struct Bases {
    matrices: Vec<Sides>,
    steps: u32,
}

/// A matrix, by its place among the network's weights, and its bases.
#[derive(Clone, Debug)]
struct Sides {
    at: Range<usize>,
    rows: Basis,
    columns: Basis,
}

/// An orthonormal basis that follows a covariance.
#[derive(Clone, Debug)]
struct Basis {
    size: usize,
    covariance: Vec<f32>,
    /// One a row.
    vectors: Vec<f32>,
    /// One a column.
    transposed: Vec<f32>,
}

impl Bases {
    /// The axes, before the first step.
    pub(crate) fn new(shape: &Shape) -> Self {
        let (inputs, hidden) = (shape.inputs(), shape.hidden);
        let mut next = 0;
        let mut matrix = |rows: usize, columns: usize| {
            let at = next..next + rows * columns;
            // Its bias follows.
            next = at.end + rows;
            Sides { at, rows: Basis::new(rows), columns: Basis::new(columns) }
        };
        let mut matrices = vec![matrix(hidden, inputs), matrix(hidden, hidden), matrix(3, hidden)];
        // A network may have no input.
        matrices.retain(|sides| !sides.at.is_empty());
        Bases { matrices, steps: 0 }
    }

    /// Updates the bases with a step's gradient, and rotates it and Adam's first moment into them. The
    /// second, a square, has no meaning in other axes; the bases rotate slowly, and it is forgotten within
    /// some twenty steps (SOAP keeps it likewise).
    pub(crate) fn rotate(&mut self, tier: Tier, gradient: &mut [f32], mean: &mut [f32]) {
        run(tier, Rotate { bases: self, gradient, mean });
    }

    /// Rotates a step out of the bases.
    pub(crate) fn rotate_back(&self, tier: Tier, step: &mut [f32]) {
        run(tier, RotateBack { bases: self, step });
    }
}

struct Rotate<'a> {
    bases: &'a mut Bases,
    gradient: &'a mut [f32],
    mean: &'a mut [f32],
}

impl Kernel for Rotate<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Longest>(self) {
        let Rotate { bases, gradient, mean } = self;
        let rounds = match bases.steps {
            0 => FIRST_ROUNDS,
            steps => usize::from(steps.is_multiple_of(EVERY)),
        };
        bases.steps += 1;
        for sides in &mut bases.matrices {
            let (gradient, mean) = (&mut gradient[sides.at.clone()], &mut mean[sides.at.clone()]);
            sides.accumulate(gradient);
            if rounds > 0 {
                sides.rotate_back(mean);
                sides.rows.update(rounds);
                sides.columns.update(rounds);
                sides.rotate(mean);
            }
            sides.rotate(gradient);
        }
    }
}

struct RotateBack<'a> {
    bases: &'a Bases,
    step: &'a mut [f32],
}

impl Kernel for RotateBack<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Longest>(self) {
        for sides in &self.bases.matrices {
            sides.rotate_back(&mut self.step[sides.at.clone()]);
        }
    }
}

impl Sides {
    /// Adds a gradient to both covariances.
    #[inline(always)]
    fn accumulate(&mut self, gradient: &[f32]) {
        let (rows, columns) = (self.rows.size, self.columns.size);
        let transposed = transposed(gradient, columns);
        self.rows.accumulate(&product(gradient, &transposed, rows));
        self.columns.accumulate(&product(&transposed, gradient, columns));
    }

    /// G becomes U G Vᵀ.
    #[inline(always)]
    fn rotate(&self, matrix: &mut [f32]) {
        let half = product(&self.rows.vectors, matrix, self.columns.size);
        matrix.copy_from_slice(&product(&half, &self.columns.transposed, self.columns.size));
    }

    /// S becomes Uᵀ S V.
    #[inline(always)]
    fn rotate_back(&self, matrix: &mut [f32]) {
        let half = product(&self.rows.transposed, matrix, self.columns.size);
        matrix.copy_from_slice(&product(&half, &self.columns.vectors, self.columns.size));
    }
}

impl Basis {
    fn new(size: usize) -> Self {
        let mut axes = vec![0.0; size * size];
        axes.iter_mut().step_by(size + 1).for_each(|one| *one = 1.0);
        Basis { size, covariance: vec![0.0; size * size], vectors: axes.clone(), transposed: axes }
    }

    #[inline(always)]
    fn accumulate(&mut self, square: &[f32]) {
        for (kept, new) in self.covariance.iter_mut().zip(square) {
            *kept = MEMORY * *kept + (1.0 - MEMORY) * new;
        }
    }

    /// Rounds of orthogonal iteration. Without a gradient so far, or with one that is not finite, the basis
    /// stays.
    #[inline(always)]
    fn update(&mut self, rounds: usize) {
        let size = self.size;
        let trace: f32 = self.covariance.iter().step_by(size + 1).sum();
        if !trace.is_normal() {
            return;
        }
        let mut scaled: Vec<f32> = self.covariance.iter().map(|c| c * (size as f32 / trace)).collect();
        scaled.iter_mut().step_by(size + 1).for_each(|c| *c += FLOOR);
        for _ in 0..rounds {
            self.vectors = product(&self.vectors, &scaled, size);
            // Once leaves what rounding mixed into the weak directions.
            orthonormalise(&mut self.vectors, size);
            orthonormalise(&mut self.vectors, size);
        }
        self.transposed = transposed(&self.vectors, size);
    }
}

/// Makes rows orthonormal, first to last (modified Gram–Schmidt).
#[inline(always)]
fn orthonormalise(rows: &mut [f32], size: usize) {
    for i in 0..size {
        let (row, rest) = rows[i * size..].split_at_mut(size);
        let length = dot(row, row).sqrt();
        row.iter_mut().for_each(|x| *x /= length);
        for other in rest.chunks_exact_mut(size) {
            let along = dot(row, other);
            other.iter_mut().zip(&*row).for_each(|(x, r)| *x -= along * r);
        }
    }
}

/// The product of a matrix and one of this many columns.
#[inline(always)]
fn product(a: &[f32], b: &[f32], columns: usize) -> Vec<f32> {
    let inner = b.len() / columns;
    let mut out = vec![0.0; a.len() / inner * columns];
    for (row, out) in a.chunks_exact(inner).zip(out.chunks_exact_mut(columns)) {
        for (factor, b) in row.iter().zip(b.chunks_exact(columns)) {
            out.iter_mut().zip(b).for_each(|(sum, b)| *sum += factor * b);
        }
    }
    out
}

#[inline(always)]
fn transposed(matrix: &[f32], columns: usize) -> Vec<f32> {
    (0..columns).flat_map(|c| matrix.iter().skip(c).step_by(columns)).copied().collect()
}

#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut sums = [0.0; LANES];
    for (a, b) in a.chunks(LANES).zip(b.chunks(LANES)) {
        sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Profile;
    use crate::time::Coding;
    use crate::train::targets::Random;

    /// Rotates gradients into the bases of M's network; the last as it was and rotated, and the bases.
    fn rotated(steps: usize, mut gradient: impl FnMut(&mut Random) -> f32) -> (Bases, Vec<f32>, Vec<f32>) {
        let shape = Shape::new(&Profile::M.contents(4, 1), 128, 128, 4, Coding::Standard);
        let (mut random, mut bases) = (Random::new(1), Bases::new(&shape));
        let mut mean = vec![0.0; shape.mlp_len()];
        let (mut plain, mut there) = (Vec::new(), Vec::new());
        for _ in 0..steps {
            plain = (0..shape.mlp_len()).map(|_| gradient(&mut random)).collect();
            there = plain.clone();
            bases.rotate(Tier::detect(), &mut there, &mut mean);
        }
        (bases, plain, there)
    }

    #[test]
    fn what_is_rotated_is_rotated_back() {
        let mut scale = 1.0;
        let uneven = |random: &mut Random| {
            scale = if scale < 1e-6 { 1.0 } else { scale * 0.97 };
            scale * random.uniform(-1.0, 1.0)
        };
        let (bases, plain, mut there) = rotated(35, uneven);
        assert!(plain.iter().zip(&there).any(|(a, b)| (a - b).abs() > 0.1), "nothing was rotated");
        bases.rotate_back(Tier::detect(), &mut there);
        for (i, (a, b)) in plain.iter().zip(&there).enumerate() {
            assert!((a - b).abs() < 2e-5, "weight {i}: {a} {b}");
        }
    }

    #[test]
    fn bases_become_the_directions_of_the_gradients() {
        // Every gradient is a multiple of one outer product.
        let unit = |k: usize| -> Vec<f32> {
            let v: Vec<f32> = (0..16).map(|i| ((i * (k + 2) + k + 1) as f32).sin()).collect();
            let length = dot(&v, &v).sqrt();
            v.iter().map(|x| x / length).collect()
        };
        let (left, right) = (unit(0), unit(5));
        let mut sides = Sides { at: 0..256, rows: Basis::new(16), columns: Basis::new(16) };
        let mut random = Random::new(2);
        let rank_one =
            |s: f32| -> Vec<f32> { left.iter().flat_map(|l| right.iter().map(move |r| s * l * r)).collect() };
        for _ in 0..50 {
            sides.accumulate(&rank_one(random.uniform(-3.0, 3.0)));
            sides.rows.update(1);
            sides.columns.update(1);
        }
        let mut there = rank_one(2.0);
        sides.rotate(&mut there);
        // All of it along the first pair of directions.
        assert!((there[0].abs() - 2.0).abs() < 1e-4, "{}", there[0]);
        assert!(there[1..].iter().all(|v| v.abs() < 1e-3));
        for basis in [&sides.rows, &sides.columns] {
            let gram = product(&basis.vectors, &basis.transposed, 16);
            for (i, value) in gram.iter().enumerate() {
                let expected = if i % 17 == 0 { 1.0 } else { 0.0 };
                assert!((value - expected).abs() < 1e-5, "{i}: {value}");
            }
        }
    }

    #[test]
    fn gradients_that_are_none_leave_the_axes() {
        for gradient in [0.0, 1e-30, f32::NAN] {
            let (bases, ..) = rotated(12, |_| gradient);
            let axes = Bases::new(&Shape::new(&Profile::M.contents(4, 1), 128, 128, 4, Coding::Standard));
            for (now, before) in bases.matrices.iter().zip(&axes.matrices) {
                assert_eq!(now.rows.vectors, before.rows.vectors);
                assert_eq!(now.columns.vectors, before.columns.vectors);
            }
        }
    }
}
