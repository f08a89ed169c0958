//! Matrices of four features, and the system of a block's two endpoints.

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use crate::lanes::{Lanes, Quad};

/// A symmetric 4×4 matrix.
pub(crate) type Matrix = [Quad; 4];

/// M v
#[inline(always)]
pub(crate) fn times(m: &Matrix, v: Quad) -> Quad {
    let mut sum = [0.0; 4];
    for c in 0..4 {
        sum = Quad::splat(v[c]).mul_add(m[c], sum);
    }
    sum
}

/// a · b
#[inline(always)]
pub(crate) fn dot(a: Quad, b: Quad) -> f32 {
    let p = a.mul(b);
    (p[0] + p[1]) + (p[2] + p[3])
}

/// M += s a aᵀ
#[inline(always)]
pub(crate) fn add_outer(m: &mut Matrix, s: f32, a: Quad) {
    for c in 0..4 {
        m[c] = Quad::splat(s * a[c]).mul_add(a, m[c]);
    }
}

/// M⁻¹ v of a positive definite matrix, by elimination.
#[inline(always)]
pub(crate) fn solve(m: &Matrix, v: &Quad) -> Quad {
    let (mut m, mut v) = (*m, *v);
    for k in 0..4 {
        for r in k + 1..4 {
            let f = m[r][k] / m[k][k];
            for c in k..4 {
                m[r][c] -= f * m[k][c];
            }
            v[r] -= f * v[k];
        }
    }
    for k in (0..4).rev() {
        for c in k + 1..4 {
            v[k] -= m[k][c] * v[c];
        }
        v[k] /= m[k][k];
    }
    v
}

/// Normal equations of the two endpoints of a block.
#[derive(Clone, Debug)]
pub(crate) struct System {
    /// The matrix, rows of e₀ then e₁.
    pub matrix: [[f32; 8]; 8],
    /// The right-hand side.
    pub right: [f32; 8],
}

impl Default for System {
    fn default() -> Self {
        System { matrix: [[0.0; 8]; 8], right: [0.0; 8] }
    }
}

impl System {
    /// Adds `[A M A, A M B; B M A, B M B]`, A and B diagonal.
    #[inline(always)]
    pub(crate) fn add_matrix(&mut self, m: &Matrix, a: Quad, b: Quad) {
        for r in 0..4 {
            for c in 0..4 {
                self.matrix[r][c] += a[r] * a[c] * m[r][c];
                self.matrix[r][4 + c] += a[r] * b[c] * m[r][c];
                self.matrix[4 + r][c] += b[r] * a[c] * m[r][c];
                self.matrix[4 + r][4 + c] += b[r] * b[c] * m[r][c];
            }
        }
    }

    /// Adds a multiple of the mean diagonal, pulling to `near`.
    #[inline(always)]
    pub(crate) fn damp(&mut self, share: f32, near: &[Quad; 2]) {
        let mean = (0..8).map(|i| self.matrix[i][i]).sum::<f32>() / 8.0;
        for i in 0..8 {
            self.matrix[i][i] += share * mean;
            self.right[i] += share * mean * near[i / 4][i % 4];
        }
    }

    /// ½ vᵀ A v − vᵀ b
    pub(crate) fn energy(&self, v: &[f32; 8]) -> f32 {
        (0..8)
            .map(|r| v[r] * (0.5 * (0..8).map(|c| self.matrix[r][c] * v[c]).sum::<f32>() - self.right[r]))
            .sum()
    }

    /// The minimum within bounds: the free minimum clamped, or the present point if that is better, then
    /// coordinate descent within the bounds.
    pub(crate) fn solve_within(&self, present: &[Quad; 2], low: f32, high: f32) -> [f32; 8] {
        let mut v: [f32; 8] = std::array::from_fn(|i| present[i / 4][i % 4]);
        if let Some(free) = self.solve() {
            let clamped = free.map(|x| x.clamp(low, high));
            if clamped == free {
                return free;
            }
            if self.energy(&clamped) < self.energy(&v) {
                v = clamped;
            }
        }
        for _ in 0..16 {
            for i in 0..8 {
                let diagonal = self.matrix[i][i];
                if diagonal > 0.0 {
                    let pull = self.right[i] - (0..8).map(|j| self.matrix[i][j] * v[j]).sum::<f32>();
                    v[i] = (v[i] + pull / diagonal).clamp(low, high);
                }
            }
        }
        v
    }

    /// By Cholesky's factors; `None` unless positive definite.
    pub(crate) fn solve(&self) -> Option<[f32; 8]> {
        let mut l = self.matrix;
        for j in 0..8 {
            for k in 0..j {
                for i in j..8 {
                    l[i][j] -= l[i][k] * l[j][k];
                }
            }
            let pivot = l[j][j];
            if pivot.is_nan() || pivot <= 1e-20 {
                return None;
            }
            let root = pivot.sqrt();
            for i in j..8 {
                l[i][j] /= root;
            }
        }
        let mut v = self.right;
        for i in 0..8 {
            for k in 0..i {
                v[i] -= l[i][k] * v[k];
            }
            v[i] /= l[i][i];
        }
        for i in (0..8).rev() {
            for k in i + 1..8 {
                v[i] -= l[k][i] * v[k];
            }
            v[i] /= l[i][i];
        }
        v.iter().all(|x| x.is_finite()).then_some(v)
    }
}
