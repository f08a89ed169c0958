//! The decoder network on blocks of samples: forward, backward and Jacobian, one row of lanes per sample.
//!
//! A sample's 16 inputs and its hidden values are rows of contiguous f32, so neurons lie in the lanes, feature texels
//! are read and written whole, and every product below is one small matrix product with a broadcast left factor.

use super::lanes::{Lanes, Quad};
use crate::model::{GELU_BOUND, GELU_COEFFICIENTS, INPUTS};

/// Samples per block; all of one block belong to one set.
pub const BLOCK: usize = 32;

/// Rows of a block, aligned to cache lines: a 512-bit access that straddles two lines costs twice.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Rows<const N: usize>([[f32; N]; BLOCK]);

impl<const N: usize> Rows<N> {
    /// Zeros.
    #[inline(always)]
    pub fn new() -> Self {
        Rows([[0.0; N]; BLOCK])
    }
}

impl<const N: usize> std::ops::Deref for Rows<N> {
    type Target = [[f32; N]; BLOCK];
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

/// The decoder's weights and, by the same layout, their gradients. Both orientations of a matrix are kept.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Network<const H: usize> {
    w1: [[f32; INPUTS]; H],
    w1_t: [[f32; H]; INPUTS],
    b1: [f32; H],
    w2: [[f32; H]; H],
    w2_t: [[f32; H]; H],
    b2: [f32; H],
    w3: [[f32; H]; 4],
    w3_t: [[f32; 4]; H],
    b3: [f32; 4],
}

/// Gradients of the decoder's weights.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct NetworkGradient<const H: usize> {
    w1: [[f32; INPUTS]; H],
    b1: [f32; H],
    w2: [[f32; H]; H],
    b2: [f32; H],
    w3: [[f32; H]; 4],
    b3: [f32; 4],
}

/// What the forward pass leaves for the backward pass: hidden values and slopes of the activations.
#[derive(Debug)]
pub struct Trace<const H: usize> {
    h1: Rows<H>,
    slope1: Rows<H>,
    h2: Rows<H>,
    slope2: Rows<H>,
}

impl<const H: usize> Trace<H> {
    /// Zeros.
    pub fn new() -> Self {
        Trace { h1: Rows::new(), slope1: Rows::new(), h2: Rows::new(), slope2: Rows::new() }
    }
}

impl<const H: usize> Network<H> {
    /// From the stored order: W₁ b₁ W₂ b₂ W₃ b₃.
    pub fn new(flat: &[f32]) -> Self {
        let (w1, rest) = flat.split_at(H * INPUTS);
        let (b1, rest) = rest.split_at(H);
        let (w2, rest) = rest.split_at(H * H);
        let (b2, rest) = rest.split_at(H);
        let (w3, b3) = rest.split_at(3 * H);
        Network {
            w1: std::array::from_fn(|j| std::array::from_fn(|i| w1[j * INPUTS + i])),
            w1_t: std::array::from_fn(|i| std::array::from_fn(|j| w1[j * INPUTS + i])),
            b1: std::array::from_fn(|j| b1[j]),
            w2: std::array::from_fn(|j| std::array::from_fn(|i| w2[j * H + i])),
            w2_t: std::array::from_fn(|i| std::array::from_fn(|j| w2[j * H + i])),
            b2: std::array::from_fn(|j| b2[j]),
            w3: std::array::from_fn(|c| std::array::from_fn(|i| if c < 3 { w3[c * H + i] } else { 0.0 })),
            w3_t: std::array::from_fn(|i| std::array::from_fn(|c| if c < 3 { w3[c * H + i] } else { 0.0 })),
            b3: [b3[0], b3[1], b3[2], 0.0],
        }
    }

    /// y (three channels and a zero) of a block of inputs.
    #[inline(always)]
    pub fn forward<V: Lanes>(&self, x: &Rows<INPUTS>, trace: &mut Trace<H>) -> Rows<4> {
        // h₁ = gelu(W₁ x + b₁)
        product::<V, INPUTS, H>(x, &self.w1_t, Some(&self.b1), &mut trace.h1);
        gelu::<V, H>(&mut trace.h1, &mut trace.slope1);
        // h₂ = gelu(W₂ h₁ + b₂)
        product::<V, H, H>(&trace.h1, &self.w2_t, Some(&self.b2), &mut trace.h2);
        gelu::<V, H>(&mut trace.h2, &mut trace.slope2);
        // y = W₃ h₂ + b₃
        let mut y = Rows::new();
        product::<Quad, H, 4>(&trace.h2, &self.w3_t, Some(&self.b3), &mut y);
        y
    }

    /// From ∂L/∂y: adds the weights' gradients, and gives ∂L/∂x in `dx` where there is one.
    #[inline(always)]
    pub fn backward<V: Lanes>(
        &self,
        x: &Rows<INPUTS>,
        trace: &Trace<H>,
        dy: &Rows<4>,
        gradient: &mut NetworkGradient<H>,
        dx: Option<&mut Rows<INPUTS>>,
    ) {
        let (mut d2, mut d1) = (Rows::new(), Rows::new());
        // ∂W₃ = dyᵀ h₂, ∂b₃ = Σ dy
        outer::<V, 4, 4, H>(dy, &trace.h2, &mut gradient.w3);
        column_sums::<Quad, 4>(dy, &mut gradient.b3);
        // d₂ = (W₃ᵀ dy) ∘ gelu′
        product::<V, 4, H>(dy, &self.w3, None, &mut d2);
        scale::<V, H>(&mut d2, &trace.slope2);
        outer::<V, 8, H, H>(&d2, &trace.h1, &mut gradient.w2);
        column_sums::<V, H>(&d2, &mut gradient.b2);
        // d₁ = (W₂ᵀ d₂) ∘ gelu′
        product::<V, H, H>(&d2, &self.w2, None, &mut d1);
        scale::<V, H>(&mut d1, &trace.slope1);
        outer::<V, 8, H, INPUTS>(&d1, x, &mut gradient.w1);
        column_sums::<V, H>(&d1, &mut gradient.b1);
        // dx = W₁ᵀ d₁
        if let Some(dx) = dx {
            product::<V, H, INPUTS>(&d1, &self.w1, None, dx);
        }
    }

    /// ∂y_c/∂x for the three channels c.
    #[inline(always)]
    pub fn jacobian<V: Lanes>(&self, trace: &Trace<H>, jacobian: &mut [Rows<INPUTS>; 3]) {
        let (mut d2, mut d1) = (Rows::new(), Rows::new());
        for (row, dx) in self.w3.iter().zip(jacobian) {
            d2.fill(*row);
            scale::<V, H>(&mut d2, &trace.slope2);
            product::<V, H, H>(&d2, &self.w2, None, &mut d1);
            scale::<V, H>(&mut d1, &trace.slope1);
            product::<V, H, INPUTS>(&d1, &self.w1, None, dx);
        }
    }
}

impl<const H: usize> NetworkGradient<H> {
    /// Zeros.
    pub fn new() -> Self {
        NetworkGradient {
            w1: [[0.0; INPUTS]; H],
            b1: [0.0; H],
            w2: [[0.0; H]; H],
            b2: [0.0; H],
            w3: [[0.0; H]; 4],
            b3: [0.0; 4],
        }
    }

    /// Writes the gradient in the stored order: W₁ b₁ W₂ b₂ W₃ b₃.
    pub fn flatten(&self, flat: &mut [f32]) {
        let parts = [
            self.w1.as_flattened(),
            &self.b1,
            self.w2.as_flattened(),
            &self.b2,
            self.w3[..3].as_flattened(),
            &self.b3[..3],
        ];
        let mut rest = flat;
        for part in parts {
            let (head, tail) = rest.split_at_mut(part.len());
            head.copy_from_slice(part);
            rest = tail;
        }
    }
}

/// `out[s] = bias + Σ_i input[s][i] · weights[i]`: eight rows at a time, so that multiply-adds overlap.
#[inline(always)]
fn product<V: Lanes, const I: usize, const O: usize>(
    input: &Rows<I>,
    weights: &[[f32; O]; I],
    bias: Option<&[f32; O]>,
    out: &mut Rows<O>,
) {
    const GROUP: usize = 8;
    for first in (0..BLOCK).step_by(GROUP) {
        for lane in (0..O).step_by(V::N) {
            let start = bias.map_or(V::splat(0.0), |b| V::load(&b[lane..]));
            let mut sums = [start; GROUP];
            for i in 0..I {
                let w = V::load(&weights[i][lane..]);
                for s in 0..GROUP {
                    sums[s] = V::splat(input[first + s][i]).mul_add(w, sums[s]);
                }
            }
            for s in 0..GROUP {
                sums[s].store(&mut out[first + s][lane..]);
            }
        }
    }
}

/// `out[j] += Σ_s d[s][j] · input[s]`, G rows of the sum in registers at a time.
#[inline(always)]
fn outer<V: Lanes, const G: usize, const J: usize, const I: usize>(
    d: &Rows<J>,
    input: &Rows<I>,
    out: &mut [[f32; I]; J],
) {
    for first in (0..J).step_by(G) {
        for lane in (0..I).step_by(V::N) {
            let mut sums = [V::splat(0.0); G];
            for s in 0..BLOCK {
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
fn column_sums<V: Lanes, const N: usize>(rows: &Rows<N>, out: &mut [f32; N]) {
    for lane in (0..N).step_by(V::N) {
        let mut sum = V::load(&out[lane..]);
        for row in rows.iter() {
            sum = sum.add(V::load(&row[lane..]));
        }
        sum.store(&mut out[lane..]);
    }
}

/// `rows ∘= factors`
#[inline(always)]
fn scale<V: Lanes, const N: usize>(rows: &mut Rows<N>, factors: &Rows<N>) {
    for (row, factor) in rows.iter_mut().zip(factors.iter()) {
        for lane in (0..N).step_by(V::N) {
            V::load(&row[lane..]).mul(V::load(&factor[lane..])).store(&mut row[lane..]);
        }
    }
}

/// [`crate::model::gelu`] in place, and its derivative.
#[inline(always)]
fn gelu<V: Lanes, const N: usize>(rows: &mut Rows<N>, slopes: &mut Rows<N>) {
    let p = GELU_COEFFICIENTS.map(V::splat);
    let q: [V; 6] = std::array::from_fn(|k| V::splat((2 * k + 1) as f32 * GELU_COEFFICIENTS[k]));
    let (low, high, half) = (V::splat(-GELU_BOUND), V::splat(GELU_BOUND), V::splat(0.5));
    for (row, slope) in rows.iter_mut().zip(slopes.iter_mut()) {
        for lane in (0..N).step_by(V::N) {
            let x = V::load(&row[lane..]);
            let y = x.max(low).min(high);
            let s = y.mul(y);
            let horner = |k: &[V; 6]| {
                k[5].mul_add(s, k[4]).mul_add(s, k[3]).mul_add(s, k[2]).mul_add(s, k[1]).mul_add(s, k[0])
            };
            // Φ ≈ ½ + y P(y²), its slope from the same polynomial (model::gelu_derivative).
            let cdf = y.mul_add(horner(&p), half);
            x.mul(cdf).store(&mut row[lane..]);
            y.mul_add(horner(&q), cdf).store(&mut slope[lane..]);
        }
    }
}
