//! One block of F_uvt where the loss is a quadratic form of its texels: indices, endpoints and mode that
//! lower it.

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use super::blocks::{Wanted, rounded, values, weights};
use super::matrices::{Matrix, System, solve, times};
use crate::bc7::{Block, Mode, palette};
use crate::lanes::{Lanes, Quad};

/// Free texels are held this much more than endpoints: the form holds near the present ones alone, and they
/// could go anywhere.
const FREE: f32 = 10.0;

/// Of changes δ_q of the block's texels the loss changes by Σ_pq δ_pᵀ G_pq δ_q + 2 Σ_q g_qᵀ δ_q.
#[derive(Clone, Debug)]
pub(crate) struct Form {
    /// G_pq
    pub matrix: [[Matrix; 16]; 16],
    /// g_q
    pub slope: [Quad; 16],
}

/// Texels somewhere along the way.
#[derive(Clone, Copy, Debug)]
struct State {
    texels: [Quad; 16],
    /// g_q here.
    slope: [Quad; 16],
    /// By how much the loss has changed.
    change: f32,
}

impl Form {
    /// Of no sample.
    pub(crate) const NONE: Form = Form { matrix: [[[[0.0; 4]; 4]; 16]; 16], slope: [[0.0; 4]; 16] };

    /// Where a block's texels are.
    #[inline(always)]
    fn start(&self, block: &Block) -> State {
        State { texels: values(block), slope: self.slope, change: 0.0 }
    }

    /// The block moved so that the loss is less, or as it is.
    #[inline(always)]
    pub(crate) fn improve<V: Lanes>(&self, block: &Block, damping: f32) -> Block {
        let mut block = *block;
        let mut place = self.start(&block);
        self.choose_indices(&mut block, &mut place);
        self.fit_endpoints(&mut block, &mut place, damping);
        self.choose_mode::<V>(&block, &place, damping)
    }

    /// The change of the loss if one texel moves by `d`.
    #[inline(always)]
    fn change(&self, place: &State, q: usize, d: Quad) -> f32 {
        let md = times(&self.matrix[q][q], d);
        let mut change = 0.0;
        for c in 0..4 {
            change += d[c] * (2.0 * place.slope[q][c] + md[c]);
        }
        change
    }

    /// Moves one texel.
    #[inline(always)]
    fn shift(&self, place: &mut State, q: usize, to: Quad) {
        let d = place.texels[q].mul_add([-1.0; 4], to);
        place.change += self.change(place, q, d);
        place.texels[q] = to;
        for p in 0..16 {
            place.slope[p] = place.slope[p].add(times(&self.matrix[p][q], d));
        }
    }

    /// Moves all texels to those of a block.
    #[inline(always)]
    fn shift_all(&self, place: &mut State, block: &Block) {
        let to = values(block);
        for q in 0..16 {
            if to[q] != place.texels[q] {
                self.shift(place, q, to[q]);
            }
        }
    }

    /// Texel by texel, the value that lowers the loss most, given all others.
    #[inline(always)]
    fn choose_indices(&self, block: &mut Block, place: &mut State) {
        let choices = palette(block.mode, &block.endpoints).map(|t| t.map(f32::from));
        for q in 0..16 {
            let (mut best, mut least) = (block.indices[q], 0.0);
            for i in 0..block.mode.values() {
                let change = self.change(place, q, place.texels[q].mul_add([-1.0; 4], choices[i]));
                if change < least {
                    (best, least) = (i as u8, change);
                }
            }
            if best != block.indices[q] {
                block.indices[q] = best;
                self.shift(place, q, choices[usize::from(best)]);
            }
        }
    }

    /// Both endpoints by least squares, the indices given, if that lowers the loss.
    #[inline(always)]
    fn fit_endpoints(&self, block: &mut Block, place: &mut State, damping: f32) {
        let system = self.normal_equations(block, place);
        let present = block.endpoints.map(|e| e.map(f32::from));
        let mut damped = system.clone();
        damped.damp(damping, &[[0.0; 4]; 2]);
        let Some(step) = damped.solve() else { return };
        let mut goal = present;
        for i in 0..8 {
            goal[i / 4][i % 4] = (goal[i / 4][i % 4] + step[i]).clamp(0.0, 255.0);
        }
        let (mut best, mut least) = (block.endpoints, 0.0);
        for candidate in rounded(block.mode, &goal) {
            let change = std::array::from_fn(|i| f32::from(candidate[i / 4][i % 4]) - present[i / 4][i % 4]);
            let energy = system.energy(&change);
            if energy < least {
                (best, least) = (candidate, energy);
            }
        }
        let (moved, mut there) = (Block { endpoints: best, ..*block }, *place);
        self.shift_all(&mut there, &moved);
        // The system does not know that texels between the endpoints are rounded.
        if there.change < place.change {
            (*block, *place) = (moved, there);
        }
    }

    /// The block in mode 6 and in mode 4 near to where its texels would go if they were free, if that lowers
    /// the loss.
    #[inline(always)]
    fn choose_mode<V: Lanes>(&self, block: &Block, place: &State, damping: f32) -> Block {
        let mut metric = [[[0.0; 4]; 4]; 16];
        for q in 0..16 {
            metric[q] = self.matrix[q][q];
            let mean = (0..4).map(|c| metric[q][c][c]).sum::<f32>() / 4.0;
            (0..4).for_each(|c| metric[q][c][c] += FREE * damping * mean + 1e-12);
        }
        let mut free = *place;
        for q in (0..32).map(|i| i % 16) {
            let (step, mut to) = (solve(&metric[q], &free.slope[q]), free.texels[q]);
            for c in 0..4 {
                to[c] = (to[c] - step[c]).clamp(0.0, 255.0);
            }
            self.shift(&mut free, q, to);
        }
        let wanted = Wanted::new(&free.texels, &metric);
        let six = (Mode::Six, block.endpoints.map(|e| e.map(f32::from)));
        let (mut best, mut least) = (*block, place.change);
        let [four, other] = wanted.fours::<V>();
        for start in [six, four, other] {
            let (mut candidate, _) = wanted.fit::<V>(&[start]);
            let mut there = *place;
            self.shift_all(&mut there, &candidate);
            self.choose_indices(&mut candidate, &mut there);
            self.fit_endpoints(&mut candidate, &mut there, damping);
            if there.change < least {
                (best, least) = (candidate, there.change);
            }
        }
        best
    }

    /// Of a change of both endpoints e₀, e₁: δ_q = (1 − w_q) δe₀ + w_q δe₁, channel by channel.
    #[inline(always)]
    fn normal_equations(&self, block: &Block, place: &State) -> System {
        let mut shares = [[[0.0; 4]; 16]; 2];
        for q in 0..16 {
            let w = weights(block.mode, block.indices[q]);
            shares[1][q] = w;
            shares[0][q] = w.mul_add([-1.0; 4], [1.0; 4]);
        }
        let mut system = System::default();
        for p in 0..16 {
            // Rows of Σ_q G_pq A_q, A diagonal, for both endpoints.
            let mut rows = [[[0.0; 4]; 4]; 2];
            for q in 0..16 {
                for r in 0..4 {
                    for k in 0..2 {
                        rows[k][r] = self.matrix[p][q][r].mul_add(shares[k][q], rows[k][r]);
                    }
                }
            }
            for (k, l, r, c) in (0..64).map(|i| (i / 32, i / 16 % 2, i / 4 % 4, i % 4)) {
                system.matrix[4 * k + r][4 * l + c] += shares[k][p][r] * rows[l][r][c];
            }
            for (k, c) in (0..8).map(|i| (i / 4, i % 4)) {
                system.right[4 * k + c] -= shares[k][p][c] * place.slope[p][c];
            }
        }
        system
    }
}

#[cfg(test)]
mod tests {
    use super::super::matrices::{add_outer, dot};
    use super::*;
    use crate::bc7::encode;
    use crate::train::targets::Random;

    /// Residuals r + a Jᵀδ_p + b Jᵀδ_q; their squares are the loss.
    struct Residual {
        reads: [(usize, f32); 2],
        jacobian: Quad,
        value: f32,
    }

    fn residuals(seed: u64, least: impl Fn(usize) -> Quad, at: &[Quad; 16]) -> Vec<Residual> {
        let mut random = Random::new(seed);
        let mut residual = |i: usize| {
            let f = random.uniform(0.0, 1.0);
            let reads = [(i % 16, 1.0 - f), (random.below(16), f)];
            let jacobian: Quad = std::array::from_fn(|_| random.uniform(-1.0, 1.0));
            // 0 at the least place.
            let away =
                |(q, a): (usize, f32)| a * dot(jacobian, at[q].mul_add([1.0; 4], least(q).map(|x| -x)));
            Residual {
                reads,
                jacobian,
                value: away(reads[0]) + away(reads[1]) + 0.1 * random.uniform(-1.0, 1.0),
            }
        };
        (0..400).map(&mut residual).collect()
    }

    fn form(residuals: &[Residual]) -> Form {
        let mut form = Form::NONE;
        for Residual { reads, jacobian, value } in residuals {
            for &(p, a) in reads {
                form.slope[p] = Quad::splat(a * value).mul_add(*jacobian, form.slope[p]);
                reads.iter().for_each(|&(q, b)| add_outer(&mut form.matrix[p][q], a * b, *jacobian));
            }
        }
        form
    }

    fn loss(residuals: &[Residual], from: &[Quad; 16], to: &[Quad; 16]) -> f32 {
        let moved = |q: usize| -> Quad { std::array::from_fn(|c| to[q][c] - from[q][c]) };
        let of = |r: &Residual| {
            (r.value + r.reads.iter().map(|&(q, a)| a * dot(r.jacobian, moved(q))).sum::<f32>()).powi(2)
        };
        residuals.iter().map(of).sum()
    }

    fn block(seed: u64) -> Block {
        let mut random = Random::new(seed);
        let mut ends = || std::array::from_fn(|_| random.below(128) as u8 * 2);
        Block {
            mode: Mode::Six,
            endpoints: [ends(), ends()],
            indices: std::array::from_fn(|_| random.below(16) as u8),
        }
    }

    #[test]
    fn changes_are_reported_whatever_moved() {
        let block = block(1);
        let from = values(&block);
        let residuals = residuals(2, |q| [q as f32 * 10.0; 4], &from);
        let form = form(&residuals);
        let mut place = form.start(&block);
        let mut random = Random::new(3);
        for q in (0..40).map(|i| i * 7 % 16) {
            form.shift(&mut place, q, std::array::from_fn(|_| random.uniform(0.0, 255.0)));
        }
        let [before, after] = [&from, &place.texels].map(|to| loss(&residuals, &from, to));
        assert!(
            (place.change - (after - before)).abs() < 1e-4 * (before + after),
            "{} {before} {after}",
            place.change
        );
    }

    #[test]
    fn normal_equations_are_the_loss_of_moved_endpoints() {
        let block = block(4);
        let from = values(&block);
        let residuals = residuals(5, |q| [q as f32 * 10.0; 4], &from);
        let form = form(&residuals);
        let system = form.normal_equations(&block, &form.start(&block));
        let mut random = Random::new(6);
        for _ in 0..10 {
            let step: [f32; 8] = std::array::from_fn(|_| random.uniform(-20.0, 20.0));
            let to = std::array::from_fn(|q| {
                let w = weights(block.mode, block.indices[q]);
                std::array::from_fn(|c| from[q][c] + (1.0 - w[c]) * step[c] + w[c] * step[4 + c])
            });
            let [before, after] = [&from, &to].map(|to| loss(&residuals, &from, to));
            let reported = 2.0 * system.energy(&step);
            assert!(
                (reported - (after - before)).abs() < 1e-4 * (before + after),
                "{reported} {before} {after}"
            );
        }
    }

    #[test]
    fn the_mode_that_fits_is_found() {
        for seed in 0..20 {
            let start = block(seed);
            let from = values(&start);
            // Three channels on a line, the fourth for itself.
            let least = |q: usize| {
                let along = q as f32 * 9.0;
                [40.0 + along, 200.0 - along, 70.0 + 0.5 * along, 20.0 + 13.0 * (q * 7 % 16) as f32]
            };
            let residuals = residuals(seed + 100, least, &from);
            let improved = form(&residuals).improve::<Quad>(&start, 0.003);
            let [before, after] = [&from, &values(&improved)].map(|to| loss(&residuals, &from, to));
            assert!(after < 0.02 * before, "{seed}: {before} {after}");
            assert!(matches!(improved.mode, Mode::Four { alone: 3, .. }), "{improved:?}");
            assert_eq!(crate::bc7::decode(&encode(&improved)).unwrap(), improved.texels());
        }
    }

    #[test]
    fn endpoints_move_only_where_rounded_texels_gain() {
        let mut moved = 0;
        for seed in 0..200 {
            let start = block(seed);
            let from = values(&start);
            // A step or two is left to gain, as much as rounding costs.
            let least = |q: usize| from[q].map(|value| value + if q.is_multiple_of(2) { 1.5 } else { -1.0 });
            let residuals = residuals(seed + 300, least, &from);
            let form = form(&residuals);
            let (mut block, mut place) = (start, form.start(&start));
            form.fit_endpoints(&mut block, &mut place, 0.003);
            let [before, after] = [&from, &values(&block)].map(|to| loss(&residuals, &from, to));
            assert!(after <= before * (1.0 + 1e-5), "{seed}: {before} {after}");
            moved += usize::from(block != start);
        }
        assert!(moved > 20, "{moved}");
    }
}
