//! The learned parameters, maps of blocks made of them, and the way back of the gradient.
//!
//! F_uv and each slice of F_uvt are blocks of 4×4 texels between two endpoints, `f = e₀ + w (e₁ − e₀)` (paper, eq. 7).
//! Maps hold *centred* values, c(f) = 3 (f − ½), block by block.

use super::random::Random;
use crate::lanes::{Lanes, Quad};
use crate::model::Shape;
use std::ops::Range;

/// Slope of c(f).
pub const CENTRE_SLOPE: f32 = 3.0;

/// c(f)
#[inline(always)]
pub fn centred(f: f32) -> f32 {
    CENTRE_SLOPE * (f - 0.5)
}

/// Where the parameters lie in their flat vector; features first, in [0, 1], then the decoder.
#[derive(Clone, Debug)]
pub struct Layout {
    /// e₀, e₁ of each block of F_uv, 8 values a block; texel by texel 64 values, and no weights.
    pub uv_endpoints: Range<usize>,
    /// 16 weights a block.
    pub uv_weights: Range<usize>,
    /// The same for F_uvt.
    pub uvt_endpoints: Range<usize>,
    /// The same for F_uvt.
    pub uvt_weights: Range<usize>,
    /// F_ut, row (τ) by row, 2 channels.
    pub ut: Range<usize>,
    /// F_vt likewise.
    pub vt: Range<usize>,
    /// W₁ b₁ W₂ b₂ W₃ b₃.
    pub mlp: Range<usize>,
}

impl Layout {
    /// The layout of a shape.
    pub fn new(shape: &Shape, texel_by_texel: bool) -> Self {
        let mut end = 0;
        let mut next = |n: usize| {
            end += n;
            end - n..end
        };
        let [uv, uvt, ..] = shape.counts();
        let (endpoints, weights) = if texel_by_texel { (64, 0) } else { (8, 16) };
        Layout {
            uv_endpoints: next(uv * endpoints),
            uv_weights: next(uv * weights),
            uvt_endpoints: next(uvt * endpoints),
            uvt_weights: next(uvt * weights),
            ut: next(shape.rows * shape.ut * 2),
            vt: next(shape.rows * shape.vt * 2),
            mlp: next(shape.mlp_len()),
        }
    }

    /// Parameters before training: features near the middle with a small spread, decoder weights of variance 1/fan-in.
    pub fn initial(&self, shape: &Shape, random: &mut Random) -> Vec<f32> {
        let mut p = vec![0.0; self.mlp.end];
        let blocks = !self.uv_weights.is_empty() || !self.uvt_weights.is_empty();
        for endpoints in [&self.uv_endpoints, &self.uvt_endpoints] {
            if !blocks {
                p[endpoints.clone()].fill_with(|| 0.5 + random.uniform(-0.2, 0.2));
                continue;
            }
            for (i, e) in p[endpoints.clone()].iter_mut().enumerate() {
                let middle = if i % 8 < 4 { 0.3 } else { 0.7 };
                *e = middle + random.uniform(-0.1, 0.1);
            }
        }
        for weights in [&self.uv_weights, &self.uvt_weights] {
            p[weights.clone()].fill_with(|| 0.5 + random.uniform(-0.1, 0.1));
        }
        p[self.ut.start..self.vt.end].fill_with(|| 0.5 + random.uniform(-0.15, 0.15));
        let (mut at, hidden) = (self.mlp.start, shape.hidden);
        for (inputs, outputs, bias) in
            [(shape.inputs(), hidden, 0.0), (hidden, hidden, 0.0), (hidden, 3, 1.0)]
        {
            let bound = (3.0 / inputs as f32).sqrt();
            p[at..at + inputs * outputs].fill_with(|| random.uniform(-bound, bound));
            at += inputs * outputs;
            p[at..at + outputs].fill(bias);
            at += outputs;
        }
        p
    }
}

/// A centred map of its endpoints and weights.
#[inline(always)]
pub fn fill(endpoints: &[f32], weights: &[f32], map: &mut [Quad]) {
    if weights.is_empty() {
        // Texel by texel, or no map.
        map.as_flattened_mut().iter_mut().zip(endpoints).for_each(|(to, f)| *to = centred(*f));
        return;
    }
    let (endpoints, _) = endpoints.as_chunks::<8>();
    let (weights, _) = weights.as_chunks::<16>();
    let (map, _) = map.as_chunks_mut::<16>();
    for ((e, w), texels) in endpoints.iter().zip(weights).zip(map) {
        let e0: Quad = std::array::from_fn(|c| centred(e[c]));
        let d: Quad = std::array::from_fn(|c| CENTRE_SLOPE * (e[4 + c] - e[c]));
        for i in 0..16 {
            texels[i] = Quad::splat(w[i]).mul(d).add(e0);
        }
    }
}

/// From the gradient with respect to a centred map (zeroed on the way) to that of endpoints and weights, which is overwritten.
#[inline(always)]
pub fn contract(
    endpoints: &[f32],
    weights: &[f32],
    map: &mut [Quad],
    d_endpoints: &mut [f32],
    d_weights: &mut [f32],
) {
    if weights.is_empty() {
        let texels = map.as_flattened_mut();
        d_endpoints.iter_mut().zip(texels).for_each(|(d, g)| *d = CENTRE_SLOPE * std::mem::take(g));
        return;
    }
    let (endpoints, _) = endpoints.as_chunks::<8>();
    let (weights, _) = weights.as_chunks::<16>();
    let (d_endpoints, _) = d_endpoints.as_chunks_mut::<8>();
    let (d_weights, _) = d_weights.as_chunks_mut::<16>();
    let (map, _) = map.as_chunks_mut::<16>();
    for ((((e, w), de), dw), g) in endpoints.iter().zip(weights).zip(d_endpoints).zip(d_weights).zip(map) {
        let d: Quad = std::array::from_fn(|c| CENTRE_SLOPE * (e[4 + c] - e[c]));
        // ∂e₁ = Σ w g, ∂e₀ = Σ g − ∂e₁, ∂w = g · (e₁ − e₀)
        let (mut all, mut second) = ([0.0; 4], [0.0; 4]);
        for i in 0..16 {
            all = all.add(g[i]);
            second = second.add(g[i].mul(Quad::splat(w[i])));
            let p = g[i].mul(d);
            dw[i] = (p[0] + p[1]) + (p[2] + p[3]);
        }
        *g = [[0.0; 4]; 16];
        for c in 0..4 {
            de[4 + c] = CENTRE_SLOPE * second[c];
            de[c] = CENTRE_SLOPE * (all[c] - second[c]);
        }
    }
}
