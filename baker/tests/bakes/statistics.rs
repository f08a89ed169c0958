//! Bakes over many seeds: mean and variance of every texel, and tests of whether two ways to bake have the
//! same mean.

use crate::scenes::Case;
use baker::bake::run::{Denoise, Options, Outcome};

/// Independent seeds behind every σ.
pub const SEEDS: u64 = 16;
/// Probability that a test of this kind fails by chance alone.
const SIGNIFICANCE: f64 = 1e-3;

/// What many bakes of one scene gave.
pub struct Bakes {
    /// Mean over the seeds, per frame, texel and channel; only texels valid in all.
    mean: Vec<f64>,
    /// Variance of one bake, estimated from the seeds.
    variance: Vec<f64>,
    /// Whether the texel is valid with every seed, as long as `mean`.
    valid: Vec<bool>,
    /// Per seed, the mean over all that is valid with it.
    page_means: Vec<f64>,
    /// Mean over seeds and values of the squared standard error the datasets tell.
    reported: f64,
    /// What the runs told.
    pub outcomes: Vec<Outcome>,
}

/// Bakes a case with [`SEEDS`] seeds from `first` on; what is traced is left as it is, unless `change` says
/// otherwise.
#[track_caller]
pub fn bakes(case: &Case, first: u64, samples: u32, change: impl Fn(&mut Options)) -> Bakes {
    let mut values: Vec<Vec<f64>> = Vec::new();
    let (mut valid, mut page_means, mut outcomes): (Vec<bool>, Vec<f64>, Vec<Outcome>) = Default::default();
    let mut reported = 0.0;
    for seed in first..first + SEEDS {
        let text = format!("{}[bake]\nseed = {seed}\nsamples = {samples}\n", case.text);
        let (outcome, dataset) = case.stage.bake(&text, "seed", case.hours, |options| {
            options.force = true;
            options.denoise = Denoise::Off;
            change(options);
        });
        let noise = dataset.noise().expect("readable").expect("a noise table");
        let mask = dataset.mask(0).expect("a mask");
        let (mut all, mut all_valid) = (Vec::new(), Vec::new());
        for (frame, mse) in noise.mse.iter().enumerate() {
            let image = dataset.map(frame, 0).expect("a map");
            all.extend(image.texels.iter().flatten().map(|v| f64::from(*v)));
            all_valid.extend(mask.valid.iter().flat_map(|v| [*v; 3]));
            // One tile: the page is smaller.
            assert_eq!(mse[0].len(), 1);
            reported += mse[0][0] / (noise.mse.len() as f64 * SEEDS as f64);
        }
        let lit: Vec<f64> = all.iter().zip(&all_valid).filter(|(_, v)| **v).map(|(x, _)| *x).collect();
        page_means.push(lit.iter().sum::<f64>() / lit.len() as f64);
        if valid.is_empty() {
            valid = all_valid;
        } else {
            assert_eq!(valid.len(), all_valid.len());
            valid.iter_mut().zip(all_valid).for_each(|(all, one)| *all &= one);
        }
        values.push(all);
        outcomes.push(outcome);
    }
    let moments: Vec<(f64, f64)> = (0..valid.len()).map(|i| moments(values.iter().map(|v| v[i]))).collect();
    let (mean, variance) = moments.into_iter().unzip();
    Bakes { mean, variance, valid, page_means, reported, outcomes }
}

/// Mean and unbiased variance.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0))
}

/// The difference of two means of [`SEEDS`] values each in standard deviations of a normal distribution:
/// Student's t with Welch's degrees of freedom, brought to the normal scale (Wallace 1959).
fn deviations(a: (f64, f64), b: (f64, f64)) -> f64 {
    let n = SEEDS as f64;
    // Sums in single precision.
    let rounding = (1e-6 * (a.0 + b.0)).powi(2);
    let (va, vb) = (a.1 / n + rounding, b.1 / n + rounding);
    if va + vb == 0.0 {
        return if a.0 == b.0 { 0.0 } else { f64::INFINITY };
    }
    let t2 = (a.0 - b.0).powi(2) / (va + vb);
    let freedom = (va + vb).powi(2) * (n - 1.0) / (va * va + vb * vb);
    (freedom * (t2 / freedom).ln_1p()).sqrt() * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
}

/// Probability that a normal value lies farther than `z` from its mean (Laplace's continued fraction; for z ≥
/// 2).
fn two_sided(z: f64) -> f64 {
    let fraction = (1..=30).rev().fold(z, |tail, k| z + f64::from(k) / tail);
    2.0 * (-0.5 * z * z).exp() / ((2.0 * std::f64::consts::PI).sqrt() * fraction)
}

/// Probability that the greatest of `n` deviations is this great or greater by chance (Šidák's correction).
fn by_chance(worst: f64, n: usize) -> f64 {
    if worst < 2.0 { 1.0 } else { -((n as f64) * (-two_sided(worst)).ln_1p()).exp_m1() }
}

#[track_caller]
fn expect_chance(worst: f64, n: usize, what: &str) {
    let probability = by_chance(worst, n);
    assert!(probability >= SIGNIFICANCE, "{what}: {worst:.2} σ among {n}: p = {probability:.1e}");
}

impl Bakes {
    /// Variance ÷ squared mean, averaged over the valid values whose mean in klx lies in `means`.
    pub fn relative_variance(&self, means: std::ops::Range<f64>) -> f64 {
        let values = (0..self.mean.len()).filter(|&i| self.valid[i] && means.contains(&self.mean[i]));
        let relative: Vec<f64> = values.map(|i| self.variance[i] / self.mean[i].powi(2)).collect();
        relative.iter().sum::<f64>() / relative.len() as f64
    }

    /// Mean over the seeds of the mean over the page.
    pub fn mean(&self) -> f64 {
        moments(self.page_means.iter().copied()).0
    }

    /// Relative standard error of [`Bakes::mean`].
    pub fn relative_error_of_mean(&self) -> f64 {
        let (mean, variance) = moments(self.page_means.iter().copied());
        (variance / SEEDS as f64).sqrt() / mean
    }

    /// Texels times sets, valid in all bakes.
    fn texels(&self, other: &Self) -> Vec<usize> {
        assert_eq!(self.mean.len(), other.mean.len());
        // The green channel: the others are not independent of it.
        (1..self.mean.len()).step_by(3).filter(|&i| self.valid[i] && other.valid[i]).collect()
    }

    /// Root mean square over texels of what their expected values differ by, relative to the mean light: the
    /// means' difference less what chance adds to it.
    pub fn bias_of_texels(&self, other: &Self) -> f64 {
        let texels = self.texels(other);
        let square = |i: &usize| {
            let chance = (self.variance[*i] + other.variance[*i]) / SEEDS as f64;
            (self.mean[*i] - other.mean[*i]).powi(2) - chance
        };
        let mean = texels.iter().map(|&i| other.mean[i]).sum::<f64>() / texels.len() as f64;
        (texels.iter().map(square).sum::<f64>() / texels.len() as f64).max(0.0).sqrt() / mean
    }

    /// No texel's mean may differ from the other's by more than chance.
    #[track_caller]
    pub fn expect_texels_of(&self, other: &Self, what: &str) {
        let texels = self.texels(other);
        assert!(texels.len() > 300, "{what}: {} texels", texels.len());
        let of = |bakes: &Self, i: usize| (bakes.mean[i], bakes.variance[i]);
        let worst = texels.iter().map(|&i| deviations(of(self, i), of(other, i))).fold(0.0, f64::max);
        expect_chance(worst, texels.len(), what);
    }

    /// The mean over the page may not differ from the other's by more than chance.
    #[track_caller]
    pub fn expect_mean_of(&self, other: &Self, what: &str) {
        let of = |bakes: &Self| moments(bakes.page_means.iter().copied());
        let (a, b) = (of(self), of(other));
        println!("{what}: mean {:.5} against {:.5}, {:.2} σ", a.0, b.0, deviations(a, b));
        expect_chance(deviations(a, b), 1, what);
    }

    /// The same bakes with all light of each channel multiplied.
    pub fn scaled(mut self, by: [f64; 3]) -> Self {
        self.mean.iter_mut().enumerate().for_each(|(i, mean)| *mean *= by[i % 3]);
        self.variance.iter_mut().enumerate().for_each(|(i, variance)| *variance *= by[i % 3].powi(2));
        self
    }

    /// All values must be `expected`, but for chance.
    #[track_caller]
    pub fn expect_everywhere(&self, expected: f64, what: &str) {
        let texels = self.texels(self);
        let exact = (expected, 0.0);
        let worst = texels.iter().map(|&i| deviations((self.mean[i], self.variance[i]), exact));
        expect_chance(worst.fold(0.0, f64::max), texels.len(), what);
    }

    /// Mean squared error of one bake against the mean of `reference`, with the noise of both means taken
    /// out.
    pub fn squared_error(&self, reference: &Self) -> f64 {
        let valid: Vec<usize> =
            (0..self.mean.len()).filter(|&i| self.valid[i] && reference.valid[i]).collect();
        let square = |i: &usize| {
            let off = self.mean[*i] - reference.mean[*i];
            // (The mean of these bakes has an n-th of the variance, which is in the difference already.)
            let chance = (self.variance[*i] + reference.variance[*i]) / SEEDS as f64;
            self.variance[*i] + off * off - chance
        };
        valid.iter().map(square).sum::<f64>() / valid.len() as f64
    }

    /// Mean squared error that the bakes reported.
    pub fn reported_squared_error(&self) -> f64 {
        self.reported
    }

    /// Mean squared standard error the bakes told ÷ the variance they had.
    pub fn honesty(&self) -> f64 {
        let valid: Vec<f64> =
            self.variance.iter().zip(&self.valid).filter(|(_, v)| **v).map(|(x, _)| *x).collect();
        self.reported / (valid.iter().sum::<f64>() / valid.len() as f64)
    }
}

#[test]
fn the_tests_themselves_find_a_difference_and_none_where_there_is_none() {
    // 3.29 σ has a probability of 0.1 %.
    assert!((two_sided(3.2905) - 1e-3).abs() < 1e-6);
    // Student's t with 30 degrees of freedom: 3.646 has a probability of 0.1 %.
    let se = (2.0f64 / SEEDS as f64).sqrt();
    let z = deviations((3.646 * se, 1.0), (0.0, 1.0));
    assert!((z - 3.29).abs() < 0.01, "{z}");
    assert_eq!(deviations((0.0, 0.0), (0.0, 0.0)), 0.0);
    assert!(by_chance(3.29, 100) > 0.09 && by_chance(5.5, 100) < 1e-5);
}
