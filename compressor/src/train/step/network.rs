//! The decoder network on chunks of samples: forward, backward and Jacobian, one row of lanes per sample.
//!
//! A sample's features (12, in rows of 16) and its hidden values are rows of contiguous f32, so neurons lie
//! in the lanes, feature texels are read and written whole, and every product below is one small matrix
//! product with a broadcast left factor.

use crate::lanes::{Lanes, Longest};
use crate::model::{FEATURES, GELU_BOUND, GELU_COEFFICIENTS, Shape};
use crate::train::targets::{Problem, TimePoint};
use std::ops::Range;

/// Samples that are worked on together; all of a chunk belong to one time point.
pub(crate) const CHUNK: usize = 32;

/// Length of a row of features: V_uvt, V_uv, V_ut, V_vt, zeros. What the tile does not have is zero.
pub(crate) const FEATURE_ROW: usize = 16;
/// Where those of [`Shape::columns`] that are features stand in a row.
const AT: [usize; 4] = [0, 4, 8, 10];

/// Rows of a chunk, aligned to cache lines: a 512-bit access that straddles two lines costs twice.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Rows<const N: usize>([[f32; N]; CHUNK]);

impl<const N: usize> Rows<N> {
    /// Zeros.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        Rows([[0.0; N]; CHUNK])
    }
}

impl<const N: usize> std::ops::Deref for Rows<N> {
    type Target = [[f32; N]; CHUNK];
    #[inline(always)]
    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl<const N: usize> std::ops::DerefMut for Rows<N> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.0
    }
}

/// The network's weights. Both orientations of a matrix are kept.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Network<const H: usize> {
    w1: [[f32; FEATURE_ROW]; H],
    w1_t: [[f32; H]; FEATURES],
    /// Per time point: b₁ and what γ and the gates add to it.
    biases: Vec<[f32; H]>,
    /// Whether the tile has any of the features 0–3, 4–7, 8–11.
    there: [bool; 3],
    w2: [[f32; H]; H],
    w2_t: [[f32; H]; H],
    b2: [f32; H],
    w3: [[f32; H]; 4],
    w3_t: [[f32; 4]; H],
    b3: [f32; 4],
}

#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct NetworkGradient<const H: usize> {
    w1: [[f32; FEATURE_ROW]; H],
    /// Per time point.
    biases: Vec<[f32; H]>,
    w2: [[f32; H]; H],
    b2: [f32; H],
    w3: [[f32; H]; 4],
    b3: [f32; 4],
}

/// What the forward pass leaves for the backward pass: hidden values and slopes of the activations.
#[derive(Debug)]
pub(crate) struct Trace<const H: usize> {
    h1: Rows<H>,
    slope1: Rows<H>,
    h2: Rows<H>,
    slope2: Rows<H>,
}

impl<const H: usize> Trace<H> {
    /// Zeros.
    pub(crate) fn new() -> Self {
        Trace { h1: Rows::new(), slope1: Rows::new(), h2: Rows::new(), slope2: Rows::new() }
    }
}

impl<const H: usize> Network<H> {
    /// From the stored order, W₁ b₁ W₂ b₂ W₃ b₃, and the time points.
    pub(crate) fn new(flat: &[f32], problem: &Problem) -> Self {
        let inputs = problem.shape.inputs();
        let (features, time) = columns(&problem.shape);
        let [stored, b1, w2, b2, w3, b3] = problem.shape.split_mlp(flat);
        let mut w1 = [[0.0; FEATURE_ROW]; H];
        for (j, row) in w1.iter_mut().enumerate() {
            for (at, columns) in AT.into_iter().zip(&features) {
                row[at..at + columns.len()].copy_from_slice(&stored[j * inputs..][columns.clone()]);
            }
        }
        let bias = |point: &TimePoint, j: usize| {
            let weights = &stored[j * inputs..][time.clone()];
            b1[j] + weights.iter().zip(&point.time).map(|(w, x)| w * x).sum::<f32>()
        };
        Network {
            w1_t: std::array::from_fn(|i| std::array::from_fn(|j| w1[j][i])),
            w1,
            biases: problem.points.iter().map(|m| std::array::from_fn(|j| bias(m, j))).collect(),
            there: {
                let [uvt, uv, ut, vt] = &features;
                [!uvt.is_empty(), !uv.is_empty(), !ut.is_empty() || !vt.is_empty()]
            },
            w2: std::array::from_fn(|j| std::array::from_fn(|i| w2[j * H + i])),
            w2_t: std::array::from_fn(|i| std::array::from_fn(|j| w2[j * H + i])),
            b2: std::array::from_fn(|j| b2[j]),
            w3: std::array::from_fn(|c| std::array::from_fn(|i| if c < 3 { w3[c * H + i] } else { 0.0 })),
            w3_t: std::array::from_fn(|i| std::array::from_fn(|c| if c < 3 { w3[c * H + i] } else { 0.0 })),
            b3: [b3[0], b3[1], b3[2], 0.0],
        }
    }

    /// y (three channels and a zero) of a chunk of inputs at a time point.
    #[inline(always)]
    pub(crate) fn forward<V: Longest>(
        &self,
        x: &Rows<FEATURE_ROW>,
        point: usize,
        trace: &mut Trace<H>,
    ) -> Rows<4> {
        // h₁ = gelu(W₁ x + b₁)
        let Trace { h1, slope1, h2, slope2 } = trace;
        first_layer::<V, H>(x, &self.w1_t, self.there, &self.biases[point], To::Gelu(h1, slope1));
        // h₂ = gelu(W₂ h₁ + b₂)
        product::<V, H, H>(h1, &self.w2_t, Some(&self.b2), To::Gelu(h2, slope2));
        // y = W₃ h₂ + b₃
        let mut y = Rows::new();
        product::<V::Four, H, 4>(h2, &self.w3_t, Some(&self.b3), To::Rows(&mut y));
        y
    }

    /// From ∂L/∂y: adds the weights' gradients, and gives ∂L/∂x in `dx` where there is one.
    #[inline(always)]
    pub(crate) fn backward<V: Longest>(
        &self,
        x: &Rows<FEATURE_ROW>,
        point: usize,
        trace: &Trace<H>,
        dy: &Rows<4>,
        gradient: &mut NetworkGradient<H>,
        dx: Option<&mut Rows<FEATURE_ROW>>,
    ) {
        let (mut d2, mut d1) = (Rows::new(), Rows::new());
        // ∂W₃ = dyᵀ h₂, ∂b₃ = Σ dy
        outer::<V, 4, 4, H>(dy, &trace.h2, &mut gradient.w3);
        column_sums::<V::Four, 4>(dy, &mut gradient.b3);
        // d₂ = (W₃ᵀ dy) ∘ gelu′
        product::<V, 4, H>(dy, &self.w3, None, To::Scaled(&mut d2, &trace.slope2));
        outer::<V, 8, H, H>(&d2, &trace.h1, &mut gradient.w2);
        column_sums::<V, H>(&d2, &mut gradient.b2);
        // d₁ = (W₂ᵀ d₂) ∘ gelu′
        product::<V, H, H>(&d2, &self.w2, None, To::Scaled(&mut d1, &trace.slope1));
        outer::<V, 8, H, FEATURE_ROW>(&d1, x, &mut gradient.w1);
        column_sums::<V, H>(&d1, &mut gradient.biases[point]);
        // dx = W₁ᵀ d₁
        if let Some(dx) = dx {
            product::<V, H, FEATURE_ROW>(&d1, &self.w1, None, To::Rows(dx));
        }
    }

    /// ∂y_c/∂x for the three channels c.
    #[inline(always)]
    pub(crate) fn jacobian<V: Lanes>(&self, trace: &Trace<H>, jacobian: &mut [Rows<FEATURE_ROW>; 3]) {
        let (mut d2, mut d1) = (Rows::new(), Rows::new());
        for (row, dx) in self.w3.iter().zip(jacobian) {
            for (d2, slope2) in d2.iter_mut().zip(trace.slope2.iter()) {
                for lane in (0..H).step_by(V::N) {
                    V::load(&row[lane..]).mul(V::load(&slope2[lane..])).store(&mut d2[lane..]);
                }
            }
            product::<V, H, H>(&d2, &self.w2, None, To::Scaled(&mut d1, &trace.slope1));
            product::<V, H, FEATURE_ROW>(&d1, &self.w1, None, To::Rows(dx));
        }
    }
}

impl<const H: usize> NetworkGradient<H> {
    /// Zeros.
    pub(crate) fn new(points: usize) -> Self {
        NetworkGradient {
            w1: [[0.0; FEATURE_ROW]; H],
            biases: vec![[0.0; H]; points],
            w2: [[0.0; H]; H],
            b2: [0.0; H],
            w3: [[0.0; H]; 4],
            b3: [0.0; 4],
        }
    }

    /// Writes the gradient in the stored order: W₁ b₁ W₂ b₂ W₃ b₃.
    pub(crate) fn flatten(&self, problem: &Problem, flat: &mut [f32]) {
        let inputs = problem.shape.inputs();
        let (features, time) = columns(&problem.shape);
        let (w1, rest) = flat.split_at_mut(H * inputs);
        let (b1, mut rest) = rest.split_at_mut(H);
        b1.fill(0.0);
        for (j, (b1, row)) in b1.iter_mut().zip(&self.w1).enumerate() {
            let w1 = &mut w1[j * inputs..][..inputs];
            for (at, columns) in AT.into_iter().zip(&features) {
                w1[columns.clone()].copy_from_slice(&row[at..at + columns.len()]);
            }
            // Inputs of a time point see the gradient of its bias.
            w1[time.clone()].fill(0.0);
            for (bias, point) in self.biases.iter().zip(&problem.points) {
                *b1 += bias[j];
                for (w, x) in w1[time.clone()].iter_mut().zip(&point.time) {
                    *w += bias[j] * x;
                }
            }
        }
        let parts = [self.w2.as_flattened(), &self.b2, self.w3[..3].as_flattened(), &self.b3[..3]];
        for part in parts {
            let (head, tail) = rest.split_at_mut(part.len());
            head.copy_from_slice(part);
            rest = tail;
        }
    }
}

/// The stored columns of W₁ of the four kinds of features, and those of γ and the gates.
fn columns(shape: &Shape) -> ([Range<usize>; 4], Range<usize>) {
    let [uvt, uv, ut, vt, gamma, gates] = shape.columns();
    ([uvt, uv, ut, vt], gamma.start..gates.end)
}

/// Where the rows of a product go.
pub(crate) enum To<'a, const O: usize> {
    /// As they are.
    Rows(&'a mut Rows<O>),
    /// Activated, and the activation's slopes.
    Gelu(&'a mut Rows<O>, &'a mut Rows<O>),
    /// Times these factors.
    Scaled(&'a mut Rows<O>, &'a Rows<O>),
}

impl<const O: usize> To<'_, O> {
    #[inline(always)]
    fn put<V: Lanes>(&mut self, row: usize, lane: usize, value: V) {
        match self {
            To::Rows(rows) => value.store(&mut rows[row][lane..]),
            To::Gelu(rows, slopes) => {
                let (activated, slope) = gelu(value);
                activated.store(&mut rows[row][lane..]);
                slope.store(&mut slopes[row][lane..]);
            }
            To::Scaled(rows, factors) => {
                value.mul(V::load(&factors[row][lane..])).store(&mut rows[row][lane..]);
            }
        }
    }
}

/// [`crate::model::gelu`] and its derivative.
#[inline(always)]
fn gelu<V: Lanes>(x: V) -> (V, V) {
    const TERMS: usize = GELU_COEFFICIENTS.len();
    let slope = |k: usize| (2 * k + 1) as f32 * GELU_COEFFICIENTS[k];
    let y = x.max(V::splat(-GELU_BOUND)).min(V::splat(GELU_BOUND));
    let s = y.mul(y);
    let (mut a, mut b) = (V::splat(GELU_COEFFICIENTS[TERMS - 1]), V::splat(slope(TERMS - 1)));
    for k in (0..TERMS - 1).rev() {
        a = a.mul_add(s, V::splat(GELU_COEFFICIENTS[k]));
        b = b.mul_add(s, V::splat(slope(k)));
    }
    // Φ ≈ ½ + y P(y²), its slope ½ + y P(y²) + y (P(y²) + 2 y² P′(y²)) from the same polynomial; 0 or 1
    // beyond the bound.
    let cdf = y.mul_add(a, V::splat(0.5));
    (x.mul(cdf), y.mul_add(b, cdf))
}

/// `out[s] = bias + Σ_i input[s][i] · weights[i]` over the quads of features that are there, eight rows at a
/// time.
#[inline(always)]
fn first_layer<V: Lanes, const H: usize>(
    input: &Rows<FEATURE_ROW>,
    weights: &[[f32; H]; FEATURES],
    there: [bool; 3],
    bias: &[f32; H],
    mut out: To<H>,
) {
    const GROUP: usize = 8;
    for first in (0..CHUNK).step_by(GROUP) {
        for lane in (0..H).step_by(V::N) {
            let mut sums = [V::load(&bias[lane..]); GROUP];
            for (quad, there) in there.into_iter().enumerate() {
                if there {
                    for i in 4 * quad..4 * quad + 4 {
                        let w = V::load(&weights[i][lane..]);
                        for s in 0..GROUP {
                            sums[s] = V::splat(input[first + s][i]).mul_add(w, sums[s]);
                        }
                    }
                }
            }
            for (s, sum) in sums.into_iter().enumerate() {
                out.put(first + s, lane, sum);
            }
        }
    }
}

/// `out[s] = bias + Σ_i input[s][i] · weights[i]`: eight rows at a time, so that multiply-adds overlap.
#[inline(always)]
pub(crate) fn product<V: Lanes, const I: usize, const O: usize>(
    input: &Rows<I>,
    weights: &[[f32; O]; I],
    bias: Option<&[f32; O]>,
    mut out: To<O>,
) {
    const GROUP: usize = 8;
    for first in (0..CHUNK).step_by(GROUP) {
        for lane in (0..O).step_by(V::N) {
            let start = match bias {
                Some(bias) => V::load(&bias[lane..]),
                None => V::splat(0.0),
            };
            let mut sums = [start; GROUP];
            for i in 0..I {
                let w = V::load(&weights[i][lane..]);
                for s in 0..GROUP {
                    sums[s] = V::splat(input[first + s][i]).mul_add(w, sums[s]);
                }
            }
            for (s, sum) in sums.into_iter().enumerate() {
                out.put(first + s, lane, sum);
            }
        }
    }
}

/// `out[j] += Σ_s d[s][j] · input[s]`, G rows of the sum in registers at a time.
#[inline(always)]
pub(crate) fn outer<V: Lanes, const G: usize, const J: usize, const I: usize>(
    d: &Rows<J>,
    input: &Rows<I>,
    out: &mut [[f32; I]; J],
) {
    for first in (0..J).step_by(G) {
        for lane in (0..I).step_by(V::N) {
            let mut sums = [V::splat(0.0); G];
            for s in 0..CHUNK {
                let x = V::load(&input[s][lane..]);
                for j in 0..G {
                    sums[j] = V::splat(d[s][first + j]).mul_add(x, sums[j]);
                }
            }
            for j in 0..G {
                let to = &mut out[first + j][lane..];
                sums[j].add(V::load(to)).store(to);
            }
        }
    }
}

/// `out += Σ_s rows[s]`
#[inline(always)]
pub(crate) fn column_sums<V: Lanes, const N: usize>(rows: &Rows<N>, out: &mut [f32; N]) {
    for lane in (0..N).step_by(V::N) {
        let mut sum = V::load(&out[lane..]);
        for row in rows.iter() {
            sum = sum.add(V::load(&row[lane..]));
        }
        sum.store(&mut out[lane..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_activation_is_the_model_s_and_its_slope_that_of_the_activation() {
        let at = |x: f32| {
            let (value, slope) = gelu([x; 4]);
            (value[0], slope[0])
        };
        for i in -500..=500 {
            let (x, h) = (i as f32 / 100.0, 1e-3);
            let (value, slope) = at(x);
            assert!((value - crate::model::gelu(x)).abs() < 1e-6, "{x}: {value}");
            let difference = (at(x + h).0 - at(x - h).0) / (2.0 * h);
            assert!((difference - slope).abs() < 6e-4, "{x}: {difference} {slope}");
        }
    }
}
