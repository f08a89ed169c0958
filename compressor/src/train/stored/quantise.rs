//! From the trained float model to the stored tile: BC7 blocks, 8-bit planes, f16 network.
//!
//! Blocks are chosen by the loss itself, or (the paper's recipe) by a plain encoder that looks at the
//! features alone. Around the present model the loss is a quadratic form of the features: with J = ∂y/∂f of a
//! sample, residual r and weight w, a change δ of its features costs w |r + J δ|². F_uv's texels do not share
//! samples, so their blocks are fitted to the minimum of their own form. F_uvt's texels share samples through
//! interpolation: its blocks are first fitted under Σ w a² Jᵀ J, a a texel's share, then improved by
//! coordinate descent ([`super::descent`], and of one block [`super::form`]).

#![allow(
    clippy::needless_range_loop,
    reason = "rows and columns of small matrices, as the formulas index them"
)]

use super::blocks::{Start, Wanted, principal};
use super::descent::{Descent, Sample};
use super::matrices::{Matrix, add_outer, solve};
use crate::bc7::{Block, GREY, Mode, encode};
use crate::lanes::{Lanes, Longest, Quad};
use crate::model::TileParams;
use crate::train::Coded;
use crate::train::step::kernel::{BlockLosses, Kernel, Linearise, Linearised, residual, run};
use crate::train::step::{CHUNK, Samples, Trainer};
use crate::train::targets::Texel;
use crate::train::targets::features::{CENTRE_SLOPE, centred, corners, in_blocks};
use std::ops::Range;

/// One 8-bit step in centred features.
const STEP: f32 = CENTRE_SLOPE / 255.0;
/// Share of the mean metric that is added to every texel's.
const DAMPING: f32 = 0.003;
/// F_uvt looks at no more frames than about this many (evenly spread): its memory is 64 bytes a texel and
/// frame.
const MOST_SETS: usize = 64;

/// The blocks of both maps.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    /// F_uv, row by row.
    pub uv: Vec<Block>,
    /// F_uvt, slice by slice.
    pub uvt: Vec<Block>,
}

impl<const H: usize> Trainer<H> {
    /// Blocks of the learned endpoints and weights under the loss's metric, of F_uvt, then of F_uv; freezes
    /// both first.
    pub(crate) fn freeze_blocks(&mut self) -> Blocks {
        self.freeze();
        let mut uvt = self.fit_uvt();
        show(&uvt, self.problem.shape.uvt[0], &mut self.maps.uvt);
        self.refine_uvt(&mut uvt);
        self.refine_uvt(&mut uvt);
        let start = self.learned(self.layout.uv_endpoints.start, self.maps.uv.len() / 16);
        let mut blocks = Blocks { uv: Vec::new(), uvt };
        self.fit_uv(&mut blocks, &start);
        blocks
    }

    /// The learned texels rounded to 8 bits and encoded under the plain squared error, all channels alike;
    /// freezes both maps.
    pub(crate) fn encode_blocks(&mut self) -> Blocks {
        self.freeze();
        let identity = std::array::from_fn(|r| std::array::from_fn(|c| if r == c { 1.0 } else { 0.0 }));
        let tier = self.tier();
        let texel_by_texel = self.problem.coded == Coded::TexelByTexel;
        let plain = |across: usize, map: &mut [Quad], start: Vec<[Quad; 2]>| {
            round_texels(map);
            let texels = &in_blocks(map, across);
            let start: Vec<[Quad; 2]> = if texel_by_texel {
                texels.iter().map(|t| principal(&t.map(in_steps))).collect()
            } else {
                start
            };
            let metric = vec![[identity; 16]; texels.len()];
            let blocks = run(tier, Fit { texels, metric: &metric, start: Some(&start) });
            show(&blocks, across, map);
            blocks
        };
        let learned = |trainer: &Self, first: usize, map: &[Quad]| match texel_by_texel {
            true => Vec::new(),
            false => trainer.learned(first, map.len() / 16),
        };
        let uv = learned(self, self.layout.uv_endpoints.start, &self.maps.uv);
        let uvt = learned(self, self.layout.uvt_endpoints.start, &self.maps.uvt);
        let across = self.problem.shape.uvt[0];
        Blocks { uv: plain(4, &mut self.maps.uv, uv), uvt: plain(across, &mut self.maps.uvt, uvt) }
    }

    /// Improves frozen blocks around the present planes and network.
    pub(crate) fn refine_blocks(&mut self, blocks: &mut Blocks) {
        self.refine_uvt(&mut blocks.uvt);
        self.refine_uv(blocks);
    }

    /// Improves F_uv alone.
    pub(crate) fn refine_uv(&mut self, blocks: &mut Blocks) {
        let start: Vec<[Quad; 2]> = blocks.uv.iter().map(|b| b.endpoints.map(|e| e.map(f32::from))).collect();
        self.fit_uv(blocks, &start);
    }

    /// Rounds F_ut and F_vt to 8 bits.
    pub(crate) fn round_planes(&mut self) {
        for v in &mut self.params[self.layout.ut.start..self.layout.vt.end] {
            *v = (*v * 255.0).round() / 255.0;
        }
        self.refresh();
    }

    /// The PSNR of the float model with all its features rounded to 8 bits: what there would be without BC7.
    pub(crate) fn psnr_8bit(&mut self) -> f64 {
        let planes = self.layout.ut.start..self.layout.vt.end;
        let kept = self.params[planes.clone()].to_vec();
        self.round_planes();
        self.freeze();
        round_texels(&mut self.maps.uv);
        round_texels(&mut self.maps.uvt);
        let psnr = self.psnr(1);
        self.params[planes].copy_from_slice(&kept);
        self.thaw();
        psnr
    }

    /// Rounds the decoder network to 16 bits.
    pub(crate) fn round_network(&mut self) {
        for v in &mut self.params[self.layout.network.clone()] {
            *v = half::f16::from_f32(v.clamp(-65504.0, 65504.0)).to_f32();
        }
        self.refresh();
    }

    /// The stored form of rounded parameters and blocks. Blocks that no sample reads are grey: the bundle
    /// leaves them out.
    pub(crate) fn store(&self, blocks: &Blocks) -> TileParams {
        let [uv, uvt] = self.problem.blocks_read();
        let stored = |blocks: &[Block], read: &[bool]| {
            blocks.iter().zip(read).map(|(block, read)| encode(if *read { block } else { &GREY })).collect()
        };
        let plane = |range: &Range<usize>| {
            let (pairs, _) = self.params[range.clone()].as_chunks::<2>();
            pairs.iter().map(|p| p.map(|v| (v * 255.0).round() as u8)).collect()
        };
        TileParams {
            shape: self.problem.shape,
            f_uv: stored(&blocks.uv, &uv),
            f_uvt: stored(&blocks.uvt, &uvt),
            f_ut: plane(&self.layout.ut),
            f_vt: plane(&self.layout.vt),
            mlp: self.params[self.layout.network.clone()]
                .iter()
                .map(|v| ndgi::half::F16::from_f32(*v))
                .collect(),
            knots: self.problem.knots.clone(),
            axis: self.problem.axis.clone(),
            gates: self.problem.gates.clone(),
        }
    }

    /// Learned endpoints in 8-bit steps.
    fn learned(&self, first: usize, blocks: usize) -> Vec<[Quad; 2]> {
        let (endpoints, _) = self.params[first..][..blocks * 8].as_chunks::<8>();
        endpoints.iter().map(|e| [0, 4].map(|k| std::array::from_fn(|c| 255.0 * e[k + c]))).collect()
    }

    /// Every texel of every `stride`-th frame, in blocks.
    fn all_samples(&self, stride: usize) -> Vec<Samples<'_>> {
        let blocks = |point| self.problem.texels.chunks(CHUNK).map(move |texels| Samples { point, texels });
        (0..self.problem.frames).step_by(stride).flat_map(blocks).collect()
    }

    fn set_stride(&self) -> usize {
        self.problem.frames.div_ceil(MOST_SETS)
    }

    /// Calls `each(time point, texel, ∂y/∂x per channel, r, w)` for all samples.
    fn linearise(&self, stride: usize, mut each: impl FnMut(usize, Texel, [&[f32; 16]; 3], Quad, Quad)) {
        let samples = self.all_samples(stride);
        let problem = &self.problem;
        let block = |samples: &Samples, out: &Linearised| {
            let point = &problem.points[samples.point];
            let targets = problem.targets_at(samples.point);
            for (s, &texel) in samples.texels.iter().enumerate() {
                let target = targets[texel.index()];
                let (r, w) = residual(out.y[s], target, &point.base, &point.slope);
                let jacobian = [&out.jacobian[0][s], &out.jacobian[1][s], &out.jacobian[2][s]];
                each(samples.point, texel, jacobian, r, w.mul(Quad::splat(problem.weight_in_blocks(texel))));
            }
        };
        let (features, network) = (self.features(), &self.network);
        run(self.tier(), Linearise { problem, features, network, samples: &samples, each: block });
    }

    /// F_uvt's blocks nearest to the learned texels under Σ w a² Jᵀ J.
    fn fit_uvt(&self) -> Vec<Block> {
        let problem = &self.problem;
        if self.maps.uvt.is_empty() {
            return Vec::new();
        }
        let mut metric: Vec<Matrix> = vec![[[0.0; 4]; 4]; self.maps.uvt.len()];
        self.linearise(self.set_stride(), |a, texel, jacobian, _, w| {
            let (column, row) = problem.sites(texel);
            let mut form = [[0.0; 4]; 4];
            for c in 0..3 {
                let j = jacobian[c];
                add_outer(&mut form, w[c] * STEP * STEP, [j[0], j[1], j[2], j[3]]);
            }
            let slices = &problem.points[a].slices;
            for (slice, fs) in slices.ends() {
                for (y, fy) in row.uvt.ends() {
                    for (x, fx) in column.uvt.ends() {
                        let share = Quad::splat((fs * fy * fx).powi(2));
                        let m = &mut metric[slice + y + x];
                        for c in 0..4 {
                            m[c] = share.mul_add(form[c], m[c]);
                        }
                    }
                }
            }
        });
        damp(&mut metric, DAMPING);
        let start = self.learned(self.layout.uvt_endpoints.start, metric.len() / 16);
        let across = problem.shape.uvt[0];
        let (texels, metric) = (&in_blocks(&self.maps.uvt, across), &in_blocks(&metric, across));
        run(self.tier(), Fit { texels, metric, start: Some(&start) })
    }

    /// F_uv's blocks: of the present ones (or else those fitted to the learned texels) and those fitted to
    /// the minimum of each texel's form (under weak and strong damping) in mode 6 and in mode 4, every block
    /// takes the one of least true loss. What was learned lies on lines, where mode 4 has nothing to win.
    fn fit_uv(&mut self, blocks: &mut Blocks, start: &[[Quad; 2]]) {
        let problem = &self.problem;
        let count = self.maps.uv.len();
        if count == 0 {
            return;
        }
        let (mut metric, mut slope) = (vec![[[0.0; 4]; 4]; count], vec![[0.0; 4]; count]);
        self.linearise(1, |_, texel, jacobian, r, w| {
            let (column, row) = problem.sites(texel);
            let at = column.uv + row.uv;
            for c in 0..3 {
                let j: Quad = std::array::from_fn(|i| STEP * jacobian[c][4 + i]);
                add_outer(&mut metric[at], w[c], j);
                slope[at] = Quad::splat(w[c] * r[c]).mul_add(j, slope[at]);
            }
        });
        // The blocks there are, or else those fitted to the learned texels.
        let mut candidates = Vec::new();
        let mut fits = vec![(DAMPING, true), (10.0 * DAMPING, true)];
        match blocks.uv.is_empty() {
            true => fits.insert(0, (DAMPING, false)),
            false => candidates.push(std::mem::take(&mut blocks.uv)),
        }
        for (damping, newton) in fits {
            let mut metric = metric.clone();
            damp(&mut metric, damping);
            let mut texels = self.maps.uv.clone();
            if newton {
                // The minimum of slopeᵀ δ + ½ δᵀ M δ lies at −M⁻¹ slope.
                for ((texel, m), g) in texels.iter_mut().zip(&metric).zip(&slope) {
                    let delta = solve(m, g);
                    *texel = std::array::from_fn(|c| texel[c] - STEP * delta[c]);
                }
            }
            let (metric, _) = metric.as_chunks::<16>();
            let (texels, _) = texels.as_chunks::<16>();
            candidates.push(run(self.tier(), Fit { texels, metric, start: Some(start) }));
            if newton {
                candidates.push(run(self.tier(), Fit { texels, metric, start: None }));
            }
        }
        let mut best: Vec<(f32, Block)> = Vec::new();
        for candidate in candidates {
            show(&candidate, 4, &mut self.maps.uv);
            let losses = self.block_losses();
            match best.is_empty() {
                true => best = losses.into_iter().zip(candidate).collect(),
                false => {
                    for ((best, loss), block) in best.iter_mut().zip(losses).zip(candidate) {
                        if loss < best.0 {
                            *best = (loss, block);
                        }
                    }
                }
            }
        }
        blocks.uv = best.into_iter().map(|(_, block)| block).collect();
        show(&blocks.uv, 4, &mut self.maps.uv);
    }

    /// The loss over each block of F_uv.
    fn block_losses(&self) -> Vec<f32> {
        let (problem, features, network) = (&self.problem, self.features(), &self.network);
        let (samples, blocks) = (&self.all_samples(1), self.maps.uv.len() / 16);
        run(self.tier(), BlockLosses { problem, features, network, samples, blocks })
    }

    /// Coordinate descent of F_uvt on the linearised loss.
    fn refine_uvt(&mut self, blocks: &mut [Block]) {
        if blocks.is_empty() {
            return;
        }
        let problem = &self.problem;
        let stride = self.set_stride();
        let (width, height) = (problem.shape.width, problem.shape.height);
        let kept = problem.frames.div_ceil(stride);
        let mut samples = vec![Sample::default(); kept * width * height];
        self.linearise(stride, |a, texel, jacobian, r, w| {
            let at = (a / stride * height + texel.y()) * width + texel.x();
            let root = w.map(f32::sqrt);
            samples[at] = Sample {
                jacobian: [0, 1, 2].map(|c| std::array::from_fn(|i| root[c] * STEP * jacobian[c][i])),
                residual: r.mul(root),
            };
        });
        let descent = Descent { problem, stride, samples: &mut samples, blocks, damping: DAMPING };
        run(self.tier(), descent);
        show(blocks, self.problem.shape.uvt[0], &mut self.maps.uvt);
    }
}

fn round_texels(map: &mut [Quad]) {
    for v in map.as_flattened_mut() {
        *v = centred(((*v / CENTRE_SLOPE + 0.5) * 255.0).round() / 255.0);
    }
}

/// Adds a share of the mean diagonal of all texels, so that no form is singular.
fn damp(metric: &mut [Matrix], share: f32) {
    let trace: f64 = metric.iter().map(|m| f64::from(m[0][0] + m[1][1] + m[2][2] + m[3][3])).sum();
    let mean = (trace / (4 * metric.len()) as f64) as f32;
    for m in metric {
        for c in 0..4 {
            m[c][c] += share * mean + 1e-12;
        }
    }
}

/// Writes blocks' texels into a map of this many texels across.
fn show(blocks: &[Block], across: usize, map: &mut [Quad]) {
    for (block, corner) in blocks.iter().zip(corners(across)) {
        for (i, texel) in block.texels().iter().enumerate() {
            map[corner + i / 4 * across + i % 4] = texel.map(|b| centred(f32::from(b) / 255.0));
        }
    }
}

/// From c(f) = 3 (f − ½) to 8-bit steps.
#[inline(always)]
fn in_steps(texel: Quad) -> Quad {
    texel.map(|v| v / STEP + 127.5)
}

/// Fits all blocks of a map.
struct Fit<'a> {
    texels: &'a [[Quad; 16]],
    metric: &'a [[Matrix; 16]],
    /// Where mode 6 begins; without it the blocks are of mode 4.
    start: Option<&'a [[Quad; 2]]>,
}

impl Kernel for Fit<'_> {
    type Output = Vec<Block>;
    #[inline(always)]
    fn run<V: Longest>(self) -> Self::Output {
        let mut blocks = Vec::with_capacity(self.texels.len());
        for (i, (texels, metric)) in self.texels.iter().zip(self.metric).enumerate() {
            let wanted = Wanted::new(&texels.map(in_steps), metric);
            let starts: &[Start] = match self.start {
                Some(start) => &[(Mode::Six, start[i])],
                None => &wanted.fours::<V>(),
            };
            blocks.push(wanted.fit::<V>(starts).0);
        }
        blocks
    }
}
