//! Fitting mode-6 blocks: endpoints and indices that come nearest to given texels under a metric of their own.
//!
//! Everything is in units of one 8-bit step. The cost of a block is Σ_q (p_q − f_q)ᵀ M_q (p_q − f_q) over its texels q.

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use crate::bc7::{Mode6, WEIGHTS, palette};
use crate::lanes::{Lanes, Quad};

/// A symmetric 4×4 matrix.
pub type Matrix = [Quad; 4];

/// M v
#[inline(always)]
pub fn times(m: &Matrix, v: Quad) -> Quad {
    let mut sum = [0.0; 4];
    for c in 0..4 {
        sum = Quad::splat(v[c]).mul_add(m[c], sum);
    }
    sum
}

/// a · b
#[inline(always)]
pub fn dot(a: Quad, b: Quad) -> f32 {
    let p = a.mul(b);
    (p[0] + p[1]) + (p[2] + p[3])
}

/// M += s a aᵀ
#[inline(always)]
pub fn add_outer(m: &mut Matrix, s: f32, a: Quad) {
    for c in 0..4 {
        m[c] = Quad::splat(s * a[c]).mul_add(a, m[c]);
    }
}

/// What a block is to come near to.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// f_q
    pub texels: [Quad; 16],
    /// M_q
    pub metric: [Matrix; 16],
}

/// The texels of a block.
pub fn values(block: &Mode6) -> [Quad; 16] {
    block.texels().map(|t| t.map(f32::from))
}

impl Wanted {
    /// The cost of given texels.
    #[inline(always)]
    pub fn cost(&self, texels: &[Quad; 16]) -> f32 {
        (0..16).map(|q| self.texel_cost(q, texels[q])).sum()
    }

    #[inline(always)]
    fn texel_cost(&self, q: usize, value: Quad) -> f32 {
        let d = std::array::from_fn(|c| value[c] - self.texels[q][c]);
        dot(d, times(&self.metric[q], d))
    }

    /// The best index of each texel among 16 values, and the cost.
    #[inline(always)]
    fn select(&self, values: &[Quad; 16]) -> ([u8; 16], f32) {
        let mut total = 0.0;
        let indices = std::array::from_fn(|q| {
            let (mut best, mut least) = (0, f32::INFINITY);
            for (i, value) in values.iter().enumerate() {
                let cost = self.texel_cost(q, *value);
                if cost < least {
                    (best, least) = (i as u8, cost);
                }
            }
            total += least;
            best
        });
        (indices, total)
    }

    /// Fits a block from given endpoints (in 0 ..= 255): rounds of indices ↔ least squares, then the best of the four
    /// pairs of p-bits, then single steps of the endpoints.
    #[inline(always)]
    pub fn fit(&self, start: [Quad; 2], rounds: usize) -> (Mode6, f32) {
        let mut endpoints = start;
        for _ in 0..rounds {
            let values = WEIGHTS.map(|w| {
                let w = f32::from(w) / 64.0;
                std::array::from_fn(|c| endpoints[0][c] + w * (endpoints[1][c] - endpoints[0][c]))
            });
            let (indices, _) = self.select(&values);
            endpoints = self.least_squares(&indices, &endpoints);
        }
        let (mut best, mut least) = (Mode6 { endpoints: [[0; 4]; 2], indices: [0; 16] }, f32::INFINITY);
        for candidate in rounded(&endpoints) {
            let (indices, cost) = self.select(&palette(&candidate).map(|t| t.map(f32::from)));
            if cost < least {
                (best, least) = (Mode6 { endpoints: candidate, indices }, cost);
            }
        }
        self.descend(&mut best, &mut least);
        (best, least)
    }

    /// Moves single endpoint channels by one step of their parity while that helps, then selects the indices anew.
    #[inline(always)]
    fn descend(&self, best: &mut Mode6, least: &mut f32) {
        for _ in 0..2 {
            let before = *least;
            for (e, c, down) in (0..16).map(|i| (i / 8, i / 2 % 4, i % 2 == 0)) {
                let old = best.endpoints[e][c];
                let moved = if down { old.checked_sub(2) } else { old.checked_add(2) };
                let Some(moved) = moved else { continue };
                best.endpoints[e][c] = moved;
                let cost = self.cost(&values(best));
                if cost < *least {
                    *least = cost;
                } else {
                    best.endpoints[e][c] = old;
                }
            }
            if *least == before {
                break;
            }
            let (indices, cost) = self.select(&palette(&best.endpoints).map(|t| t.map(f32::from)));
            if cost < *least {
                (best.indices, *least) = (indices, cost);
            }
        }
    }

    /// The endpoints of least cost for given indices.
    #[inline(always)]
    fn least_squares(&self, indices: &[u8; 16], near: &[Quad; 2]) -> [Quad; 2] {
        let mut system = System::default();
        for q in 0..16 {
            let w = f32::from(WEIGHTS[usize::from(indices[q])]) / 64.0;
            let pull = times(&self.metric[q], self.texels[q]);
            system.add_matrix(&self.metric[q], 1.0 - w, w);
            for c in 0..4 {
                system.right[c] += (1.0 - w) * pull[c];
                system.right[4 + c] += w * pull[c];
            }
        }
        // A weak pull to the present endpoints decides what the texels leave open.
        system.damp(1e-4, near);
        let e = system.solve_within(near, 0.0, 255.0);
        [0, 4].map(|k| std::array::from_fn(|c| e[k + c]))
    }
}

/// The endpoints rounded under each pair of p-bits.
pub fn rounded(endpoints: &[Quad; 2]) -> [[[u8; 4]; 2]; 4] {
    let round = |e: f32, p: u8| {
        let upper = ((e - f32::from(p)) / 2.0).round().clamp(0.0, 127.0) as u8;
        upper << 1 | p
    };
    std::array::from_fn(|pair| {
        std::array::from_fn(|k| {
            let p = (pair >> k & 1) as u8;
            endpoints[k].map(|e| round(e, p))
        })
    })
}

/// Normal equations of the two endpoints of a block.
#[derive(Clone, Debug)]
pub struct System {
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
    /// Adds `[a² M, a b M; a b M, b² M]`.
    #[inline(always)]
    pub fn add_matrix(&mut self, m: &Matrix, a: f32, b: f32) {
        for r in 0..4 {
            for c in 0..4 {
                self.matrix[r][c] += a * a * m[r][c];
                self.matrix[r][4 + c] += a * b * m[r][c];
                self.matrix[4 + r][c] += a * b * m[r][c];
                self.matrix[4 + r][4 + c] += b * b * m[r][c];
            }
        }
    }

    /// Adds a multiple of the mean diagonal, pulling to `near`.
    pub fn damp(&mut self, share: f32, near: &[Quad; 2]) {
        let mean = (0..8).map(|i| self.matrix[i][i]).sum::<f32>() / 8.0;
        for i in 0..8 {
            self.matrix[i][i] += share * mean;
            self.right[i] += share * mean * near[i / 4][i % 4];
        }
    }

    /// ½ vᵀ A v − vᵀ b
    pub fn energy(&self, v: &[f32; 8]) -> f32 {
        (0..8)
            .map(|r| v[r] * (0.5 * (0..8).map(|c| self.matrix[r][c] * v[c]).sum::<f32>() - self.right[r]))
            .sum()
    }

    /// The minimum within bounds: the free minimum clamped, or the present point if that is better, then coordinate
    /// descent within the bounds.
    pub fn solve_within(&self, present: &[Quad; 2], low: f32, high: f32) -> [f32; 8] {
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
    pub fn solve(&self) -> Option<[f32; 8]> {
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
