//! The learned parameters, the feature maps made of them, and the way back of the gradient.
//!
//! F_uv and each slice of F_uvt are blocks of 4×4 texels between two endpoints, `f = e₀ + w (e₁ − e₀)` (paper, eq. 7).
//! The maps hold *centred* values, c(f) = 3 (f − ½), block by block; planes are held as sampled at every (moment, column).

use super::problem::{Problem, Site};
use super::random::Random;
use crate::lanes::{Lanes, Quad};
use crate::model::{STORED, Shape};
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

/// Centred features where samples read them, of the maps that the tile has; or the gradient with respect to them.
#[derive(Clone, Debug)]
pub struct Maps {
    /// F_uv, block by block, x + 4 y within a block.
    pub uv: Vec<Quad>,
    /// F_uvt, slice by slice, likewise.
    pub uvt: Vec<Quad>,
    /// F_ut sampled per moment and column.
    pub ut: Vec<[f32; 2]>,
    /// F_vt sampled per moment and row.
    pub vt: Vec<[f32; 2]>,
}

impl Maps {
    /// Zeros.
    pub fn new(problem: &Problem) -> Self {
        let shape = &problem.shape;
        let [uv, uvt, ..] = shape.counts();
        let plane =
            |there: bool, side: usize| vec![[0.0; 2]; if there { problem.moments.len() * side } else { 0 }];
        Maps {
            uv: vec![[0.0; 4]; 16 * uv],
            uvt: vec![[0.0; 4]; 16 * uvt],
            ut: plane(shape.contents.ut, shape.width),
            vt: plane(shape.contents.vt, shape.height),
        }
    }

    /// The maps of a parameter vector; blocks only if they are not frozen.
    #[inline(always)]
    pub fn fill(&mut self, problem: &Problem, layout: &Layout, params: &[f32], blocks: bool) {
        if blocks {
            fill_blocks(
                &params[layout.uv_endpoints.clone()],
                &params[layout.uv_weights.clone()],
                &mut self.uv,
            );
            fill_blocks(
                &params[layout.uvt_endpoints.clone()],
                &params[layout.uvt_weights.clone()],
                &mut self.uvt,
            );
        }
        let shape = &problem.shape;
        fill_plane(&params[layout.ut.clone()], shape.ut, problem, &problem.columns, &mut self.ut);
        fill_plane(&params[layout.vt.clone()], shape.vt, problem, &problem.rows, &mut self.vt);
    }

    /// From the gradient with respect to the maps (zeroed on the way) to that of the parameters, which is overwritten.
    #[inline(always)]
    pub fn contract(
        &mut self,
        problem: &Problem,
        layout: &Layout,
        params: &[f32],
        gradient: &mut [f32],
        blocks: bool,
    ) {
        if blocks {
            let ranges =
                [(&layout.uv_endpoints, &layout.uv_weights), (&layout.uvt_endpoints, &layout.uvt_weights)];
            for ((endpoints, weights), map) in ranges.into_iter().zip([&mut self.uv, &mut self.uvt]) {
                // The weights of a kind follow its endpoints.
                let (d_endpoints, d_weights) =
                    gradient[endpoints.start..weights.end].split_at_mut(endpoints.len());
                contract_blocks(
                    &params[endpoints.clone()],
                    &params[weights.clone()],
                    map,
                    d_endpoints,
                    d_weights,
                );
            }
        }
        gradient[layout.ut.start..layout.vt.end].fill(0.0);
        let shape = &problem.shape;
        contract_plane(&mut gradient[layout.ut.clone()], shape.ut, problem, &problem.columns, &mut self.ut);
        contract_plane(&mut gradient[layout.vt.clone()], shape.vt, problem, &problem.rows, &mut self.vt);
    }
}

#[inline(always)]
fn fill_blocks(endpoints: &[f32], weights: &[f32], map: &mut [Quad]) {
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

#[inline(always)]
fn contract_blocks(
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

/// Most values of one row of a plane: 64 texels of 2 channels.
const ROW: usize = STORED;

/// Samples a plane at every moment and site: rows first, then texels of the mixed row.
#[inline(always)]
fn fill_plane(values: &[f32], across: usize, problem: &Problem, sites: &[Site], out: &mut [[f32; 2]]) {
    let mut mixed = [0.0; ROW];
    for (m, out) in problem.moments.iter().zip(out.chunks_exact_mut(sites.len())) {
        let [a, b] = m.rows.at.map(|row| &values[row * across * 2..][..across * 2]);
        for ((mixed, a), b) in mixed.iter_mut().zip(a).zip(b) {
            *mixed = centred(a + m.rows.f * (b - a));
        }
        let (texels, _) = mixed.as_chunks::<2>();
        for (site, out) in sites.iter().zip(out) {
            let [a, b] = site.plane.at.map(|i| texels[i]);
            *out = std::array::from_fn(|c| a[c] + site.plane.f * (b[c] - a[c]));
        }
    }
}

/// The way back of [`fill_plane`]; takes what `g` holds.
#[inline(always)]
fn contract_plane(d: &mut [f32], across: usize, problem: &Problem, sites: &[Site], g: &mut [[f32; 2]]) {
    for (m, g) in problem.moments.iter().zip(g.chunks_exact_mut(sites.len())) {
        let mut mixed = [[0.0; 2]; ROW / 2];
        for (site, g) in sites.iter().zip(g) {
            let g = std::mem::take(g);
            for (at, weight) in [(site.plane.at[0], 1.0 - site.plane.f), (site.plane.at[1], site.plane.f)] {
                mixed[at][0] += weight * g[0];
                mixed[at][1] += weight * g[1];
            }
        }
        for (row, weight) in [(m.rows.at[0], 1.0 - m.rows.f), (m.rows.at[1], m.rows.f)] {
            let row = &mut d[row * across * 2..][..across * 2];
            for (d, g) in row.iter_mut().zip(mixed.as_flattened()) {
                *d += CENTRE_SLOPE * weight * g;
            }
        }
    }
}
