//! The learned parameters, maps of blocks made of them, and the way back of the gradient.
//!
//! F_uv and each slice of F_uvt are blocks of 4×4 texels between two endpoints, `f = e₀ + w (e₁ − e₀)`
//! (paper, eq. 7). Maps hold *centred* values, c(f) = 3 (f − ½): F_uv's block by block, F_uvt's slice by
//! slice and row by row, so that the two texels a sample reads of a row lie side by side.

use super::random::Random;
use crate::lanes::{Lanes, Longest, Quad, TwoQuads};
use crate::model::Shape;
use std::ops::Range;

/// Slope of c(f).
pub const CENTRE_SLOPE: f32 = 3.0;

/// c(f)
#[inline(always)]
pub fn centred(f: f32) -> f32 {
    CENTRE_SLOPE * (f - 0.5)
}

/// Where the parameters lie in their flat vector; features first, in [0, 1], then the decoder network.
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
    pub network: Range<usize>,
}

impl Layout {
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
            network: next(shape.mlp_len()),
        }
    }

    /// Parameters before training: features near the middle with a small spread, network weights of variance
    /// 1/fan-in.
    pub fn initial(&self, shape: &Shape, random: &mut Random) -> Vec<f32> {
        let mut p = vec![0.0; self.network.end];
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
        let (mut at, hidden) = (self.network.start, shape.hidden);
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

/// The first texels of the blocks of maps of this many texels across, row by row; with 4, block by block.
pub fn corners(across: usize) -> impl Iterator<Item = usize> {
    let across = across.max(4);
    (0..).step_by(4 * across).flat_map(move |row| (row..row + across).step_by(4))
}

/// The 16 values of each block of a map.
pub fn in_blocks<T: Copy>(map: &[T], across: usize) -> Vec<[T; 16]> {
    let block = |corner| std::array::from_fn(|i| map[corner + i / 4 * across + i % 4]);
    corners(across).take(map.len() / 16).map(block).collect()
}

/// Two texels that lie side by side.
#[inline(always)]
pub fn two(map: &[Quad], at: usize) -> &[f32] {
    map[at..at + 2].as_flattened()
}

/// The same, to write.
#[inline(always)]
pub fn two_mut(map: &mut [Quad], at: usize) -> &mut [f32] {
    map[at..at + 2].as_flattened_mut()
}

/// A centred map of its endpoints and weights.
#[inline(always)]
pub fn interpolate_blocks<V: Longest>(endpoints: &[f32], weights: &[f32], across: usize, map: &mut [Quad]) {
    if weights.is_empty() {
        // Texel by texel, or no map.
        let (texels, _) = endpoints.as_chunks::<64>();
        for (texels, corner) in texels.iter().zip(corners(across)) {
            let (texels, _) = texels.as_chunks::<4>();
            for (i, f) in texels.iter().enumerate() {
                map[corner + i / 4 * across + i % 4] = f.map(centred);
            }
        }
        return;
    }
    let (endpoints, _) = endpoints.as_chunks::<8>();
    let (weights, _) = weights.as_chunks::<16>();
    for ((e, w), corner) in endpoints.iter().zip(weights).zip(corners(across)) {
        let e0: Quad = std::array::from_fn(|c| centred(e[c]));
        let d: Quad = std::array::from_fn(|c| CENTRE_SLOPE * (e[4 + c] - e[c]));
        let (e0, d) = (V::Eight::twice(V::Four::load(&e0)), V::Eight::twice(V::Four::load(&d)));
        let (pairs, _) = w.as_chunks::<2>();
        for (i, pair) in pairs.iter().enumerate() {
            let texels = V::Eight::spread(*pair).mul_add(d, e0);
            texels.store(two_mut(map, corner + i / 2 * across + i % 2 * 2));
        }
    }
}

/// From the gradient with respect to a centred map (zeroed on the way) to that of endpoints and weights,
/// which is overwritten.
#[inline(always)]
pub fn backpropagate_blocks<V: Longest>(
    endpoints: &[f32],
    weights: &[f32],
    across: usize,
    map: &mut [Quad],
    d_endpoints: &mut [f32],
    d_weights: &mut [f32],
) {
    if weights.is_empty() {
        let (d_texels, _) = d_endpoints.as_chunks_mut::<64>();
        for (d_texels, corner) in d_texels.iter_mut().zip(corners(across)) {
            let (d_texels, _) = d_texels.as_chunks_mut::<4>();
            for (i, d) in d_texels.iter_mut().enumerate() {
                let g = std::mem::take(&mut map[corner + i / 4 * across + i % 4]);
                *d = g.map(|g| CENTRE_SLOPE * g);
            }
        }
        return;
    }
    let (endpoints, _) = endpoints.as_chunks::<8>();
    let (weights, _) = weights.as_chunks::<16>();
    let (d_endpoints, _) = d_endpoints.as_chunks_mut::<8>();
    let (d_weights, _) = d_weights.as_chunks_mut::<16>();
    let zero = V::Eight::splat(0.0);
    for ((((e, w), de), dw), corner) in
        endpoints.iter().zip(weights).zip(d_endpoints).zip(d_weights).zip(corners(across))
    {
        let d: Quad = std::array::from_fn(|c| CENTRE_SLOPE * (e[4 + c] - e[c]));
        let d = V::Eight::twice(V::Four::load(&d));
        // ∂e₁ = Σ w g, ∂e₀ = Σ g − ∂e₁, ∂w = g · (e₁ − e₀)
        let (mut all, mut second) = (zero, zero);
        let (pairs, _) = w.as_chunks::<2>();
        for (half, dw) in dw.chunks_exact_mut(8).enumerate() {
            let mut products = [zero; 4];
            for (k, product) in products.iter_mut().enumerate() {
                let i = 4 * half + k;
                let texels = two_mut(map, corner + i / 2 * across + i % 2 * 2);
                let g = V::Eight::load(texels);
                zero.store(texels);
                all = all.add(g);
                second = V::Eight::spread(pairs[i]).mul_add(g, second);
                *product = g.mul(d);
            }
            V::Eight::sums(products).store(dw);
        }
        let slope = V::Four::splat(CENTRE_SLOPE);
        let second = second.folded().mul(slope);
        second.store(&mut de[4..]);
        second.mul_add(V::Four::splat(-1.0), all.folded().mul(slope)).store(&mut de[..4]);
    }
}
