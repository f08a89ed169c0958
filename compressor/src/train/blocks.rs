//! Fitting blocks: endpoints and indices that come nearest to given texels under a metric of their own.
//!
//! Everything is in units of one 8-bit step. The cost of a block is Σ_q (p_q − f_q)ᵀ M_q (p_q − f_q) over its texels q.

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use crate::bc7::{Block, GREY, MOST_VALUES, Mode, expand, palette};
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
pub fn values(block: &Block) -> [Quad; 16] {
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

    /// The best index of each texel among given values, and the cost.
    #[inline(always)]
    fn select(&self, values: &[Quad]) -> ([u8; 16], f32) {
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

    /// The same among the values of a block.
    #[inline(always)]
    fn select_of(&self, mode: Mode, endpoints: &[[u8; 4]; 2]) -> ([u8; 16], f32) {
        self.select(&palette(mode, endpoints).map(|t| t.map(f32::from))[..mode.values()])
    }

    /// Endpoints after rounds of indices ↔ least squares from given ones (in 0 ..= 255), and the cost before the last round.
    #[inline(always)]
    fn approach(&self, mode: Mode, start: [Quad; 2], rounds: usize) -> ([Quad; 2], f32) {
        let (mut endpoints, mut cost) = (start, f32::INFINITY);
        for _ in 0..rounds {
            let mut values = [[0.0; 4]; MOST_VALUES];
            for (i, value) in (0..).zip(&mut values[..mode.values()]) {
                let w = weights(mode, i);
                *value =
                    std::array::from_fn(|c| endpoints[0][c] + w[c] * (endpoints[1][c] - endpoints[0][c]));
            }
            let (indices, selected) = self.select(&values[..mode.values()]);
            cost = selected;
            endpoints = self.least_squares(mode, &indices, &endpoints);
        }
        (endpoints, cost)
    }

    /// Fits a block from given endpoints (in 0 ..= 255): rounds of indices ↔ least squares, then the best of the ways to
    /// round, then single steps of the endpoints.
    #[inline(always)]
    pub fn fit(&self, mode: Mode, start: [Quad; 2], rounds: usize) -> (Block, f32) {
        let (endpoints, _) = self.approach(mode, start, rounds);
        let (mut best, mut least) = (Block { mode, endpoints: [[0; 4]; 2], indices: [0; 16] }, f32::INFINITY);
        for endpoints in rounded(mode, &endpoints) {
            let (indices, cost) = self.select_of(mode, &endpoints);
            if cost < least {
                (best, least) = (Block { mode, endpoints, indices }, cost);
            }
        }
        self.descend(&mut best, &mut least);
        (best, least)
    }

    /// Fits a block of mode 4: of its eight forms the two that look best after a first round.
    #[inline(always)]
    pub fn fit_four(&self, rounds: usize) -> (Block, f32) {
        let mut tried = Mode::FOURS.map(|mode| {
            let (endpoints, cost) = self.approach(mode, self.spread(mode), 2);
            (cost, mode, endpoints)
        });
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut best, mut least) = (GREY, f32::INFINITY);
        for &(_, mode, endpoints) in &tried[..2] {
            let (block, cost) = self.fit(mode, endpoints, rounds);
            if cost < least {
                (best, least) = (block, cost);
            }
        }
        (best, least)
    }

    /// Endpoints for a form of mode 4: the range of the channel alone, the ends of the others' principal axis.
    fn spread(&self, mode: Mode) -> [Quad; 2] {
        let Mode::Four { alone, .. } = mode else { return principal(&self.texels) };
        let alone = usize::from(alone);
        let mut others = self.texels;
        others.iter_mut().for_each(|t| t[alone] = 0.0);
        let mut ends = principal(&others);
        let own = self.texels.map(|t| t[alone].clamp(0.0, 255.0));
        ends[0][alone] = own.iter().copied().fold(255.0, f32::min);
        ends[1][alone] = own.iter().copied().fold(0.0, f32::max);
        ends
    }

    /// Moves single endpoint channels to the next value on either side while that helps, then selects the indices anew.
    #[inline(always)]
    fn descend(&self, best: &mut Block, least: &mut f32) {
        for _ in 0..2 {
            let before = *least;
            for (e, c, down) in (0..16).map(|i| (i / 8, i / 2 % 4, i % 2 == 0)) {
                let old = best.endpoints[e][c];
                let Some(moved) = next(best.mode, c, old, down) else { continue };
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
            let (indices, cost) = self.select_of(best.mode, &best.endpoints);
            if cost < *least {
                (best.indices, *least) = (indices, cost);
            }
        }
    }

    /// The endpoints of least cost for given indices.
    #[inline(always)]
    fn least_squares(&self, mode: Mode, indices: &[u8; 16], near: &[Quad; 2]) -> [Quad; 2] {
        let mut system = System::default();
        for q in 0..16 {
            let w = weights(mode, indices[q]);
            let v = w.map(|w| 1.0 - w);
            let pull = times(&self.metric[q], self.texels[q]);
            system.add_matrix(&self.metric[q], v, w);
            for c in 0..4 {
                system.right[c] += v[c] * pull[c];
                system.right[4 + c] += w[c] * pull[c];
            }
        }
        // A weak pull to the present endpoints decides what the texels leave open.
        system.damp(1e-4, near);
        let e = system.solve_within(near, 0.0, 255.0);
        [0, 4].map(|k| std::array::from_fn(|c| e[k + c]))
    }
}

/// The weights of the four channels at an index.
#[inline(always)]
pub fn weights(mode: Mode, index: u8) -> Quad {
    mode.weights(index).map(|w| f32::from(w) / 64.0)
}

/// The endpoints rounded: in mode 6 under each pair of p-bits.
#[inline(always)]
pub fn rounded(mode: Mode, endpoints: &[Quad; 2]) -> impl Iterator<Item = [[u8; 4]; 2]> {
    let level = move |value: f32, c: usize| {
        let bits = mode.bits(c);
        let most = ((1u32 << bits) - 1) as f32;
        expand((value * most / 255.0).round().clamp(0.0, most) as u8, bits)
    };
    let of_parity =
        |value: f32, p: u8| (((value - f32::from(p)) / 2.0).round().clamp(0.0, 127.0) as u8) << 1 | p;
    let ways = if mode == Mode::Six { 4 } else { 1 };
    (0..ways).map(move |pair| {
        std::array::from_fn(|k| {
            let value = |c: usize| match mode {
                Mode::Six => of_parity(endpoints[k][c], pair >> k & 1),
                Mode::Four { .. } => level(endpoints[k][c], c),
            };
            std::array::from_fn(value)
        })
    })
}

/// The next value of an endpoint's channel, down or up; in mode 6 of the same parity.
fn next(mode: Mode, channel: usize, value: u8, down: bool) -> Option<u8> {
    if mode == Mode::Six {
        return if down { value.checked_sub(2) } else { value.checked_add(2) };
    }
    let bits = mode.bits(channel);
    let level = value >> (8 - bits);
    let level = if down { level.checked_sub(1) } else { Some(level + 1).filter(|l| l >> bits == 0) };
    level.map(|level| expand(level, bits))
}

/// The ends of the principal axis of a block's texels.
pub fn principal(texels: &[Quad; 16]) -> [Quad; 2] {
    let mean: Quad = std::array::from_fn(|c| texels.iter().map(|t| t[c]).sum::<f32>() / 16.0);
    let from_mean = texels.map(|t| -> Quad { std::array::from_fn(|c| t[c] - mean[c]) });
    // Power iteration from the texel farthest from the mean: v ← Σ (tᵀv) t.
    let farthest = from_mean.iter().max_by(|a, b| dot(**a, **a).total_cmp(&dot(**b, **b)));
    let mut axis = farthest.copied().unwrap_or_default();
    for _ in 0..8 {
        let mut next = [0.0; 4];
        for t in &from_mean {
            next = Quad::splat(dot(*t, axis)).mul_add(*t, next);
        }
        let length = dot(next, next).sqrt();
        if length < 1e-6 {
            break;
        }
        axis = next.map(|v| v / length);
    }
    let length = dot(axis, axis).sqrt().max(1e-6);
    axis = axis.map(|v| v / length);
    let along = from_mean.map(|t| dot(t, axis));
    let (low, high) = along.iter().fold((0.0f32, 0.0f32), |(l, h), &x| (l.min(x), h.max(x)));
    [low, high].map(|end| std::array::from_fn(|c| (mean[c] + end * axis[c]).clamp(0.0, 255.0)))
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
    /// Adds `[A M A, A M B; B M A, B M B]`, A and B diagonal.
    #[inline(always)]
    pub fn add_matrix(&mut self, m: &Matrix, a: Quad, b: Quad) {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Texels on a line in three channels, whose channel `alone` goes its own way.
    fn apart(alone: usize) -> Wanted {
        let texel = |q: usize| {
            let (along, own) = (q as f32, (q * 7 % 16) as f32);
            let mut texel = [40.0 + 8.0 * along, 200.0 - 5.0 * along, 90.0 + 3.0 * along, 60.0 + 6.0 * along];
            texel[alone] = 30.0 + 12.0 * own;
            texel
        };
        let identity = std::array::from_fn(|r| std::array::from_fn(|c| if r == c { 1.0 } else { 0.0 }));
        Wanted { texels: std::array::from_fn(texel), metric: [identity; 16] }
    }

    #[test]
    fn a_channel_that_stands_apart_has_indices_of_its_own() {
        for alone in 0..4 {
            let wanted = apart(alone);
            let (six, cost_of_six) = wanted.fit(Mode::Six, principal(&wanted.texels), 6);
            let (four, cost_of_four) = wanted.fit_four(6);
            assert!(matches!(four.mode, Mode::Four { alone: a, .. } if usize::from(a) == alone), "{four:?}");
            assert!(cost_of_four < 0.2 * cost_of_six, "{alone}: {cost_of_four}, mode 6 {cost_of_six}");
            for (block, cost) in [(six, cost_of_six), (four, cost_of_four)] {
                assert!((wanted.cost(&values(&block)) - cost).abs() < 1e-3 * cost, "{block:?} costs {cost}");
                // What is stored is what was fitted.
                assert_eq!(crate::bc7::decode(&crate::bc7::encode(&block)).unwrap(), block.texels());
            }
        }
    }

    #[test]
    fn endpoints_are_rounded_and_moved_to_what_their_mode_has() {
        let endpoints = [[0.0, 255.0, 100.3, 77.7], [3.4, 250.1, 128.0, 12.0]];
        for mode in Mode::FOURS {
            let all: Vec<_> = rounded(mode, &endpoints).collect();
            assert_eq!(all.len(), 1);
            for (c, e) in (0..4).flat_map(|c| all[0].iter().map(move |e| (c, e[c]))) {
                let bits = mode.bits(c);
                assert_eq!(expand(e >> (8 - bits), bits), e);
                let up = next(mode, c, e, false);
                assert_eq!(up.is_none(), e == 255);
                assert!(up.is_none_or(|up| up > e && next(mode, c, up, true) == Some(e)), "{mode:?} {c} {e}");
            }
            assert!((0..4).all(|c| (f32::from(all[0][0][c]) - endpoints[0][c]).abs() <= 4.2));
        }
        assert_eq!(rounded(Mode::Six, &endpoints).count(), 4);
        assert_eq!((next(Mode::Six, 0, 1, true), next(Mode::Six, 0, 1, false)), (None, Some(3)));
    }
}
