//! The learned parameters, and how maps of blocks are laid out.
//!
//! F_uv and each slice of F_uvt are blocks of 4×4 texels between two endpoints, `f = e₀ + w (e₁ − e₀)`
//! (paper, eq. 7). Maps hold *centred* values, c(f) = 3 (f − ½): F_uv's block by block, F_uvt's slice by
//! slice and row by row, so that the two texels a sample reads of a row lie side by side.

use super::random::Random;
use crate::lanes::Quad;
use crate::model::Shape;
use std::ops::Range;

/// Slope of c(f).
pub(crate) const CENTRE_SLOPE: f32 = 3.0;

/// c(f)
#[inline(always)]
pub(crate) fn centred(f: f32) -> f32 {
    CENTRE_SLOPE * (f - 0.5)
}

/// Where the parameters lie in their flat vector; features first, in [0, 1], then the decoder network.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
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
    pub(crate) fn new(shape: &Shape, texel_by_texel: bool) -> Self {
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
    pub(crate) fn initial(&self, shape: &Shape, random: &mut Random) -> Vec<f32> {
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
pub(crate) fn corners(across: usize) -> impl Iterator<Item = usize> {
    let across = across.max(4);
    (0..).step_by(4 * across).flat_map(move |row| (row..row + across).step_by(4))
}

/// The 16 values of each block of a map.
pub(crate) fn in_blocks<T: Copy>(map: &[T], across: usize) -> Vec<[T; 16]> {
    let block = |corner| std::array::from_fn(|i| map[corner + i / 4 * across + i % 4]);
    corners(across).take(map.len() / 16).map(block).collect()
}

/// Two texels that lie side by side.
#[inline(always)]
pub(crate) fn two(map: &[Quad], at: usize) -> &[f32] {
    map[at..at + 2].as_flattened()
}

/// The same, to write.
#[inline(always)]
pub(crate) fn two_mut(map: &mut [Quad], at: usize) -> &mut [f32] {
    map[at..at + 2].as_flattened_mut()
}
