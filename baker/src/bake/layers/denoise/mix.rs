//! How much of each candidate: the mixture with the least error, as estimated around a texel.
//!
//! Filters run on each half by itself. With F the mean of what they give, C that of the halves, and e and h
//! half the differences of the halves before and after, the squared error of F is estimated without bias by
//! (F − C)² − e² + 2eh, whatever the filter, as long as what it makes of a half depends on that half alone.
//! The same of two candidates i and j is (Fⁱ − C)(Fʲ − C) − e² + e(hⁱ + hʲ); a mixture's error is a quadratic
//! form in it.
//!
//! The choice for one half leaves out the texel's own errors, and with them the other half's value there
//! (leave-one-out). Otherwise the least of many noisy estimates would be chosen, and it would be too low. The
//! texel still enters weakly, through its neighbours' filtered light. (A half that is an outlier against its
//! surroundings does enter its own choice: so a firefly is spread, and not both kept and spread.)

use super::kernels::FILTERS;
use crate::Rgb;
use crate::bake::store::Value;

/// Candidates: the unfiltered light first.
pub(super) const CANDIDATES: usize = FILTERS + 1;
/// Rows of eight that hold the triangle of a symmetric matrix: entry (i, j), i ≤ j, is number j (j + 1) / 2 +
/// i.
const ROWS: usize = (CANDIDATES * (CANDIDATES + 1) / 2).div_ceil(8);

/// Both halves of a texel's light, and a place for what else a vector holds: (A, B).
pub(super) type Halves = [f32; 8];

/// The halves of a value.
pub(super) fn halves(value: &Value) -> Halves {
    let (a, b) = (value.mean + value.noise, value.mean - value.noise);
    [a.x, a.y, a.z, 0.0, b.x, b.y, b.z, 0.0]
}

/// Errors of all candidates at a texel, and its light.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub(super) struct ErrorMatrix {
    rows: [[f32; 8]; ROWS],
    /// The light around: what says which texels are alike.
    light: f32,
}

impl ErrorMatrix {
    /// Nothing known.
    pub(super) const NONE: ErrorMatrix = ErrorMatrix { rows: [[0.0; 8]; ROWS], light: 0.0 };

    /// Of a texel's light, what the filters made of it, and the median light of the texels around it, without
    /// its own.
    pub(super) fn new(value: &Value, filtered: &[Halves; FILTERS], light: f32) -> Self {
        let parts = filtered.map(|f| Effect::new(value, &f));
        let mut errors = ErrorMatrix::NONE;
        let e2 = value.noise * value.noise;
        for j in 0..CANDIDATES {
            for i in 0..=j {
                let sum = match (i, j) {
                    (0, 0) => e2,
                    // (The unfiltered light: no shift, all of the noise.)
                    (0, j) => value.noise * parts[j - 1].noise,
                    (i, j) => {
                        let (a, b) = (&parts[i - 1], &parts[j - 1]);
                        a.shift * b.shift - e2 + value.noise * (a.noise + b.noise)
                    }
                };
                *errors.entry(i, j) = sum.element_sum();
            }
        }
        errors.light = light;
        errors
    }

    fn at(&self, i: usize, j: usize) -> f32 {
        let number = number(i, j);
        self.rows[number / 8][number % 8]
    }

    fn entry(&mut self, i: usize, j: usize) -> &mut f32 {
        let number = number(i, j);
        &mut self.rows[number / 8][number % 8]
    }
}

/// The number of an entry.
fn number(i: usize, j: usize) -> usize {
    let (i, j) = if i < j { (i, j) } else { (j, i) };
    j * (j + 1) / 2 + i
}

/// The filter whose light a texel is compared with.
const GUIDE: usize = 2;
/// What a candidate gives at a texel.
#[derive(Clone, Copy)]
struct Effect {
    /// Beside the unfiltered light.
    shift: Rgb,
    /// Half the difference of its halves.
    noise: Rgb,
}

impl Effect {
    fn new(value: &Value, f: &Halves) -> Self {
        let (a, b) = (of_half(f, 0), of_half(f, 1));
        Effect { shift: (a + b) * 0.5 - value.mean, noise: (a - b) * 0.5 }
    }
}

/// Errors around a texel.
pub(super) struct Around {
    sums: ErrorMatrix,
    /// The light around it, without its own.
    outside: Rgb,
    light: f32,
    weight: f32,
    /// The greatest squared noise of a neighbour.
    most: f32,
}

impl Around {
    /// Around a texel, whose own errors and own weight among those of the filters are given.
    pub(super) fn new(
        value: &Value,
        filtered: &[Halves; FILTERS],
        errors: &ErrorMatrix,
        own: &[f32; FILTERS],
    ) -> Self {
        let f = &filtered[GUIDE];
        let all = Rgb::new(f[0] + f[4], f[1] + f[5], f[2] + f[6]) * 0.5;
        let own = own[GUIDE];
        // (A texel without neighbours is all there is.)
        let outside = if own < 0.999 { (all - value.mean * own) / (1.0 - own) } else { value.mean };
        Around { sums: ErrorMatrix::NONE, outside, light: errors.light, weight: 0.0, most: 0.0 }
    }

    /// Adds neighbours, given their places and weights, each as far as its light is alike.
    #[inline(always)]
    pub(super) fn add(&mut self, errors: &[ErrorMatrix], at: &[usize], weights: &[f32]) {
        /// Difference of light, as a part of the greater, at which a neighbour counts half.
        const UNLIKE: f32 = 0.25;
        let (mut rows, mut total, mut most) = (self.sums.rows, self.weight, self.most);
        for (&place, &weight) in at.iter().zip(weights) {
            if weight == 0.0 {
                continue;
            }
            let other = &errors[place];
            let noise = other.rows[0][0];
            let brighter = self.light.abs().max(other.light.abs()).max(f32::MIN_POSITIVE);
            // (Lights around differ by noise, too.)
            let tolerated = (UNLIKE * brighter).powi(2) + noise;
            let difference = (self.light - other.light).powi(2) / tolerated.max(f32::MIN_POSITIVE);
            // (The squared errors of brighter light count relative to that.)
            let relative = (self.light / brighter).powi(2);
            let weight = weight * relative / (1.0 + difference).powi(2);
            most = most.max(relative * noise);
            for (sums, row) in rows.iter_mut().zip(&other.rows) {
                sums.iter_mut().zip(row).for_each(|(sum, entry)| *sum += weight * entry);
            }
            total += weight;
        }
        (self.sums.rows, self.weight, self.most) = (rows, total, most);
    }

    /// The mixtures of the candidates for both halves; each sums up to 1.
    pub(super) fn mixtures(&self, value: &Value, filtered: &[Halves; FILTERS]) -> [[f32; CANDIDATES]; 2] {
        if self.weight <= 0.0 {
            return [UNFILTERED; 2];
        }
        match [0, 1].map(|half| self.with_own(value, filtered, half)) {
            [None, None] => [self.sums.mixture(); 2],
            of_halves => of_halves.map(|m| m.unwrap_or(self.sums).mixture()),
        }
    }

    /// The errors with what half of the texel tells, if it lies far off what is around.
    fn with_own(&self, value: &Value, filtered: &[Halves; FILTERS], half: usize) -> Option<ErrorMatrix> {
        /// A half is an outlier where its squared distance from the light around exceeds this many times the
        /// expected one.
        const FAR: f32 = 4.0;
        /// Greatest weight of an outlier's own half, where a neighbour at distance 0 has 1: one half has
        /// twice the variance of the mean of both.
        const OWN: f32 = 0.5;
        let unfiltered = if half == 0 { value.mean + value.noise } else { value.mean - value.noise };
        // Expected: twice the squared error of the mean of both, and that of the light around.
        let errors = self.sums.at(0, 0) + self.sums.at(GUIDE + 1, GUIDE + 1);
        let expected = 2.0 * errors.max(0.0) / self.weight.max(f32::MIN_POSITIVE);
        let squared = (unfiltered - self.outside).length_squared();
        let excess = squared / (FAR * expected).max(f32::MIN_POSITIVE);
        if excess <= 1.0 {
            return None;
        }
        let own = OWN * (1.0 - 1.0 / excess);
        let off: [Rgb; CANDIDATES] = std::array::from_fn(|i| match i {
            0 => unfiltered - self.outside,
            i => of_half(&filtered[i - 1], half) - self.outside,
        });
        let mut sums = self.sums;
        for j in 0..CANDIDATES {
            for i in 0..=j {
                *sums.entry(i, j) += own * off[i].dot(off[j]);
            }
        }
        Some(sums)
    }
}

impl ErrorMatrix {
    /// The convex mixture with the least estimated error, found by moving weight between two candidates at a
    /// time.
    fn mixture(&self) -> [f32; CANDIDATES] {
        let m = self;
        let raw = m.at(0, 0);
        let mut mixture = [0.0; CANDIDATES];
        let best = (0..CANDIDATES).min_by(|&i, &j| m.at(i, i).total_cmp(&m.at(j, j))).unwrap_or(0);
        mixture[best] = 1.0;
        if raw <= 0.0 || !raw.is_finite() || best == 0 {
            return UNFILTERED;
        }
        // Each step moves weight from the used candidate with the largest gradient to the one with the
        // smallest.
        let mut slopes: [f32; CANDIDATES] = std::array::from_fn(|i| m.at(i, best));
        for _ in 0..2 * CANDIDATES {
            let (mut to, mut from) = (best, best);
            for i in 0..CANDIDATES {
                if slopes[i] < slopes[to] {
                    to = i;
                }
                if mixture[i] > 0.0 && (mixture[from] <= 0.0 || slopes[i] > slopes[from]) {
                    from = i;
                }
            }
            let gain = slopes[from] - slopes[to];
            if gain <= 1e-3 * raw {
                break;
            }
            let curvature = m.at(from, from) + m.at(to, to) - 2.0 * m.at(from, to);
            let step = if curvature > 0.0 { (gain / curvature).min(mixture[from]) } else { mixture[from] };
            mixture[from] -= step;
            mixture[to] += step;
            (0..CANDIDATES).for_each(|i| slopes[i] += step * (m.at(i, to) - m.at(i, from)));
        }
        mixture
    }
}

impl Around {
    /// The filtered light, or the unfiltered where the shift is too large to be noise. (Both halves of the
    /// texel decide that, so here the choice and the estimate are not independent; it is for shifts that
    /// chance hardly ever gives.)
    pub(super) fn unless_implausible(&self, value: &Value, filtered: Value) -> Value {
        /// Largest squared shift that may be noise, relative to the greatest squared noise of a neighbour or
        /// its own. (A rare path in both halves shifts a texel by four times what it does in one.)
        const CERTAIN: f32 = 6.0;
        let noise = self.most.max(value.noise.length_squared());
        if filtered.shift.length_squared() > CERTAIN * noise { *value } else { filtered }
    }
}

/// Nothing but the unfiltered light.
pub(super) const UNFILTERED: [f32; CANDIDATES] = {
    let mut mixture = [0.0; CANDIDATES];
    mixture[0] = 1.0;
    mixture
};

/// One half of what a filter gave.
fn of_half(f: &Halves, half: usize) -> Rgb {
    let at = 4 * half;
    Rgb::new(f[at], f[at + 1], f[at + 2])
}

/// The light that the mixtures of both halves give at a texel.
pub(super) fn apply_mixtures(
    value: &Value,
    filtered: &[Halves; FILTERS],
    mixtures: &[[f32; CANDIDATES]; 2],
) -> Value {
    if mixtures.iter().all(|mixture| mixture[0] >= 1.0) {
        return *value;
    }
    // What they add to each half.
    let [a, b] = [0, 1].map(|half| {
        let unfiltered = if half == 0 { value.mean + value.noise } else { value.mean - value.noise };
        let parts = filtered.iter().zip(&mixtures[half][1..]);
        parts.map(|(f, weight)| (of_half(f, half) - unfiltered) * *weight).sum::<Rgb>()
    });
    let (shift, noise) = ((a + b) * 0.5, value.noise + (a - b) * 0.5);
    // (Fits of first order may fall below zero.)
    let mean = (value.mean + shift).max(Rgb::ZERO);
    Value { mean, noise: value.noise, shift: mean - value.mean, residual: noise }
}
