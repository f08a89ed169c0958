//! Fitting blocks: endpoints and indices that come nearest to given texels under a metric of their own.
//!
//! Everything is in units of one 8-bit step. The cost of a block is Σ_q (p_q − f_q)ᵀ M_q (p_q − f_q) over its
//! texels q. Costs are taken of all 16 texels at once, so what belongs to a texel is stored channel by
//! channel. (Loops where one would write `map`: of larger closures the compiler makes functions for the
//! lowest instruction set.)

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use super::matrices::{Matrix, System, add_outer, dot, times};
use crate::bc7::{Block, GREY, MOST_VALUES, Mode, expand, interpolate, palette};
use crate::lanes::{Lanes, Quad};

/// A number a texel.
type Texels = [f32; 16];

/// Rounds of indices ↔ endpoints in which a block is fitted.
const ROUNDS: usize = 6;

/// A mode, and endpoints initially.
pub(crate) type Start = (Mode, [Quad; 2]);

/// What a block is to come near to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted {
    /// f_q
    texels: [Quad; 16],
    /// M_q
    metric: [Matrix; 16],
    /// f by channel.
    texels_by: [Texels; 4],
    /// M by row and column.
    metric_by: [[Texels; 4]; 4],
}

/// The texels of a block.
pub(crate) fn values(block: &Block) -> [Quad; 16] {
    block.texels().map(|t| t.map(f32::from))
}

/// One channel of a block's texels.
#[inline(always)]
fn channel(block: &Block, c: usize) -> Texels {
    let mut values = [0.0; 16];
    for q in 0..16 {
        let weight = block.mode.weights(block.indices[q])[c];
        values[q] = f32::from(interpolate(block.endpoints[0][c], block.endpoints[1][c], weight));
    }
    values
}

impl Wanted {
    /// Texels f_q and their metrics M_q.
    #[inline(always)]
    pub(crate) fn new(texels: &[Quad; 16], metric: &[Matrix; 16]) -> Self {
        let mut wanted = Wanted {
            texels: *texels,
            metric: *metric,
            texels_by: [[0.0; 16]; 4],
            metric_by: [[[0.0; 16]; 4]; 4],
        };
        for q in 0..16 {
            for r in 0..4 {
                wanted.texels_by[r][q] = texels[q][r];
                for c in 0..4 {
                    wanted.metric_by[r][c][q] = metric[q][r][c];
                }
            }
        }
        wanted
    }

    /// The cost of each texel at values that `value` gives for a channel and, from a texel on, N texels.
    #[inline(always)]
    fn costs<V: Lanes>(&self, value: impl Fn(usize, usize) -> V) -> Texels {
        let mut costs = [0.0; 16];
        for q in (0..16).step_by(V::N) {
            let mut d = [V::splat(0.0); 4];
            for c in 0..4 {
                d[c] = V::load(&self.texels_by[c][q..]).mul_add(V::splat(-1.0), value(c, q));
            }
            let mut cost = V::splat(0.0);
            for r in 0..4 {
                let mut sum = V::splat(0.0);
                for c in 0..4 {
                    sum = V::load(&self.metric_by[r][c][q..]).mul_add(d[c], sum);
                }
                cost = d[r].mul_add(sum, cost);
            }
            cost.store(&mut costs[q..]);
        }
        costs
    }

    /// The cost of a block whose texels are these.
    #[inline(always)]
    fn cost<V: Lanes>(&self, texels: &[Texels; 4]) -> f32 {
        total(&self.costs::<V>(|c, q| V::load(&texels[c][q..])))
    }

    /// The best index of each texel among given values, and the cost.
    #[inline(always)]
    fn select<V: Lanes>(&self, values: &[Quad]) -> ([u8; 16], f32) {
        let (mut best, mut least) = ([0u32; 16], [f32::INFINITY; 16]);
        for i in 0..values.len() {
            let costs = self.costs::<V>(|c, _| V::splat(values[i][c]));
            for q in 0..16 {
                if costs[q] < least[q] {
                    (best[q], least[q]) = (i as u32, costs[q]);
                }
            }
        }
        (best.map(|i| i as u8), total(&least))
    }

    /// The same among the values of a block.
    #[inline(always)]
    fn select_of<V: Lanes>(&self, mode: Mode, endpoints: &[[u8; 4]; 2]) -> ([u8; 16], f32) {
        self.select::<V>(&palette(mode, endpoints).map(|t| t.map(f32::from))[..mode.values()])
    }

    /// Endpoints after rounds of indices ↔ least squares from given ones (in 0 ..= 255), and the cost before
    /// the last round.
    #[inline(always)]
    fn approach<V: Lanes>(&self, mode: Mode, start: [Quad; 2], rounds: usize) -> ([Quad; 2], f32) {
        let (mut endpoints, mut cost) = (start, f32::INFINITY);
        for _ in 0..rounds {
            let mut values = [[0.0; 4]; MOST_VALUES];
            for i in 0..mode.values() {
                let w = weights(mode, i as u8);
                for c in 0..4 {
                    values[i][c] = endpoints[0][c] + w[c] * (endpoints[1][c] - endpoints[0][c]);
                }
            }
            let (indices, selected) = self.select::<V>(&values[..mode.values()]);
            cost = selected;
            endpoints = self.least_squares(mode, &indices, &endpoints);
        }
        (endpoints, cost)
    }

    /// Fits a block from each of the given modes and endpoints (in 0 ..= 255): rounds of indices ↔ least
    /// squares, then the best of the ways to round, then single steps of the endpoints. The best block, and
    /// its cost.
    #[inline(always)]
    pub(crate) fn fit<V: Lanes>(&self, starts: &[Start]) -> (Block, f32) {
        let (mut best, mut least) = (GREY, f32::INFINITY);
        for &(mode, start) in starts {
            let (endpoints, _) = self.approach::<V>(mode, start, ROUNDS);
            let (mut here, mut least_here) = (GREY, f32::INFINITY);
            for endpoints in rounded(mode, &endpoints) {
                let (indices, cost) = self.select_of::<V>(mode, &endpoints);
                if cost < least_here {
                    (here, least_here) = (Block { mode, endpoints, indices }, cost);
                }
            }
            self.descend::<V>(&mut here, &mut least_here);
            if least_here < least {
                (best, least) = (here, least_here);
            }
        }
        (best, least)
    }

    /// Where to begin in mode 4: of its eight forms the two that look best after two rounds.
    #[inline(always)]
    pub(crate) fn fours<V: Lanes>(&self) -> [Start; 2] {
        let mut trial_fits = [(0.0, (Mode::Six, [[0.0; 4]; 2])); 8];
        for i in 0..8 {
            // The forms of one channel follow each other.
            let (mode, spread) = (Mode::FOURS[i], self.spread(i / 2));
            let (endpoints, cost) = self.approach::<V>(mode, spread, 2);
            trial_fits[i] = (cost, (mode, endpoints));
        }
        trial_fits.sort_by(|a, b| a.0.total_cmp(&b.0));
        [trial_fits[0].1, trial_fits[1].1]
    }

    /// Endpoints for a form of mode 4: the range of the channel alone, the ends of the others' principal
    /// axis.
    #[inline(always)]
    fn spread(&self, alone: usize) -> [Quad; 2] {
        let (mut others, mut low, mut high) = (self.texels, 255.0f32, 0.0f32);
        for q in 0..16 {
            let own = others[q][alone].clamp(0.0, 255.0);
            (low, high) = (low.min(own), high.max(own));
            others[q][alone] = 0.0;
        }
        let mut ends = principal(&others);
        (ends[0][alone], ends[1][alone]) = (low, high);
        ends
    }

    /// Moves single endpoint channels to the next value on either side while that helps, then selects the
    /// indices anew.
    #[inline(always)]
    fn descend<V: Lanes>(&self, best: &mut Block, least: &mut f32) {
        for _ in 0..2 {
            let before = *least;
            let mut texels = [[0.0; 16]; 4];
            for c in 0..4 {
                texels[c] = channel(best, c);
            }
            for i in 0..16 {
                let (e, c, down) = (i / 8, i / 2 % 4, i % 2 == 0);
                let (old, old_texels) = (best.endpoints[e][c], texels[c]);
                let Some(moved) = next(best.mode, c, old, down) else { continue };
                best.endpoints[e][c] = moved;
                texels[c] = channel(best, c);
                let cost = self.cost::<V>(&texels);
                if cost < *least {
                    *least = cost;
                } else {
                    (best.endpoints[e][c], texels[c]) = (old, old_texels);
                }
            }
            if *least == before {
                break;
            }
            let (indices, cost) = self.select_of::<V>(best.mode, &best.endpoints);
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

/// The sum over the texels.
#[inline(always)]
fn total(costs: &Texels) -> f32 {
    let mut sums = [0.0; 4];
    for q in (0..16).step_by(4) {
        sums = sums.add(Quad::load(&costs[q..]));
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// The weights of the four channels at an index.
#[inline(always)]
pub(crate) fn weights(mode: Mode, index: u8) -> Quad {
    mode.weights(index).map(|w| f32::from(w) / 64.0)
}

/// The endpoints rounded: in mode 6 under each pair of p-bits.
#[inline(always)]
pub(crate) fn rounded(mode: Mode, endpoints: &[Quad; 2]) -> impl Iterator<Item = [[u8; 4]; 2]> {
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
#[inline(always)]
pub(crate) fn principal(texels: &[Quad; 16]) -> [Quad; 2] {
    let mut mean = [0.0; 4];
    for q in 0..16 {
        mean = Quad::splat(1.0 / 16.0).mul_add(texels[q], mean);
    }
    let (mut covariance, mut farthest) = ([[0.0; 4]; 4], [0.0; 4]);
    let mut from_mean = *texels;
    for q in 0..16 {
        from_mean[q] = mean.mul_add([-1.0; 4], texels[q]);
        add_outer(&mut covariance, 1.0, from_mean[q]);
        if dot(from_mean[q], from_mean[q]) > dot(farthest, farthest) {
            farthest = from_mean[q];
        }
    }
    // Power iteration from the texel farthest from the mean.
    let mut axis = farthest;
    for _ in 0..8 {
        let next = times(&covariance, axis);
        let length = dot(next, next).sqrt();
        if length < 1e-6 {
            break;
        }
        axis = next.mul([1.0 / length; 4]);
    }
    axis = axis.mul([1.0 / dot(axis, axis).sqrt().max(1e-6); 4]);
    let (mut low, mut high) = (0.0f32, 0.0f32);
    for q in 0..16 {
        let along = dot(from_mean[q], axis);
        (low, high) = (low.min(along), high.max(along));
    }
    let mut ends = [mean; 2];
    for c in 0..4 {
        ends[0][c] = (mean[c] + low * axis[c]).clamp(0.0, 255.0);
        ends[1][c] = (mean[c] + high * axis[c]).clamp(0.0, 255.0);
    }
    ends
}

#[cfg(test)]
#[path = "blocks_tests.rs"]
mod tests;
