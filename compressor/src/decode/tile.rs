//! A tile unpacked for decoding whole: what depends on the time alone is folded once per moment.

use super::kernel::{self, EXPANDED, Folded, LANES};
use super::{clamped, lerp, means_at, periodic, tau_at};
use crate::bc7;
use crate::lanes::Tier;
use crate::model::TileParams;
use crate::time::{Moment, Timeline};
use crate::{Error, Result};

/// `c(q/255) = SCALE q − 3/2`.
const SCALE: f32 = 3.0 / 255.0;

/// A tile with F_uv unpacked; of F_uvt only the two slices around a moment are unpacked when they are needed.
#[derive(Clone, Debug)]
pub struct TileDecoder<'a> {
    tile: TileParams,
    timeline: &'a Timeline,
    tier: Tier,
    /// Stored width rounded up to whole vectors.
    padded: usize,
    /// F_uv by channel, row, column (`4 × height × padded`), as bytes; empty without it.
    uv: Vec<u8>,
    /// All weights in single precision, in the tile's order.
    mlp: Vec<f32>,
}

impl<'a> TileDecoder<'a> {
    /// Unpacks a tile, to be decoded with the best instructions this processor has. The timeline is its bundle's.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a shape that no contents give, lists of other lengths, or a block of another mode of BC7 than 6 and 4.
    pub fn new(tile: &TileParams, timeline: &'a Timeline) -> Result<Self> {
        tile.check_lengths().map_err(|what| Error::invalid("tile", what))?;
        let shape = &tile.shape;
        let padded = shape.width.next_multiple_of(LANES);
        let mut uv = vec![0; if shape.contents.uv { 4 * shape.height * padded } else { 0 }];
        for (x, y, texel) in unpack(&tile.f_uv, shape.width)? {
            for (c, q) in texel.into_iter().enumerate() {
                uv[(c * shape.height + y) * padded + x] = q;
            }
        }
        // Checked once here, so that decoding cannot fail.
        for block in &tile.f_uvt {
            bc7::unpack(block)?;
        }
        let mlp = tile.mlp.iter().map(|w| w.to_f32()).collect();
        Ok(TileDecoder { tile: tile.clone(), timeline, tier: Tier::detect(), padded, uv, mlp })
    }

    /// The same with the instructions of another tier of this processor.
    #[cfg(test)]
    pub(super) fn with_tier(self, tier: Tier) -> Self {
        TileDecoder { tier, ..self }
    }

    /// Irradiance of all stored texels, row by row, at a moment of the bundle's timeline, whose sets are the tile's.
    pub fn decode_tile(&self, moment: &Moment) -> Vec<[f32; 3]> {
        let shape = &self.tile.shape;
        let mut out = vec![[0.0; 3]; shape.width * shape.height];
        let means = means_at(&self.tile, moment);
        if means != [0.0; 3] {
            kernel::decode(self.tier, &self.fold(moment, means), &mut out);
        }
        out
    }

    /// Blends the maps in time and folds what depends on the row or the time alone into the first layer's bias.
    fn fold(&self, moment: &Moment, means: [f32; 3]) -> Folded<'_> {
        let (shape, hidden, padded) = (&self.tile.shape, self.tile.shape.hidden, self.padded);
        let (has, inputs) = (&shape.contents, shape.inputs());
        let [w1, b1, w2, b2, w3, b3] = shape.split_mlp(&self.mlp);
        // Weight `i` of the inputs in a range of columns: 0 of what the tile does not have.
        let [uvt, uv, ut, vt, gamma, gates] = shape.columns();
        let weight = |j: usize, columns: &std::ops::Range<usize>, i: usize| {
            if i < columns.len() { w1[j * inputs + columns.start + i] } else { 0.0 }
        };
        let tau = tau_at(&self.tile, self.timeline, moment);
        let coordinate = |x: usize, n: usize| (x as f32 + 0.5) / n as f32;

        // F_uvt: one slice at τ, then along u to every column. F_ut: one row at τ, along u to every column.
        // Without F_uvt there is one row of lines, for F_ut.
        let [width, height, _] = if has.uvt > 0 { shape.uvt } else { [1; 3] };
        let slice = if has.uvt > 0 { self.slice(tau as f32) } else { vec![[0.0; 4]] };
        let v_ut = if has.ut {
            plane(&self.tile.f_ut, shape.ut, shape.rows, tau as f32, shape.width)
        } else {
            vec![[0.0; 2]; shape.width]
        };
        let along: Vec<_> = (0..shape.width).map(|x| clamped(coordinate(x, shape.width), width)).collect();
        let mut lines = vec![0.0; height * EXPANDED * padded];
        for (row, line) in lines.chunks_exact_mut(EXPANDED * padded).enumerate() {
            let texels = &slice[row * width..(row + 1) * width];
            for (c, line) in line.chunks_exact_mut(padded).enumerate() {
                for (x, (value, &(x0, x1, s))) in line.iter_mut().zip(&along).enumerate() {
                    *value = if c < 4 { lerp(texels[x0][c], texels[x1][c], s) } else { v_ut[x][c - 4] };
                }
            }
        }
        let line_weight = |j: usize, c: usize| if c < 4 { weight(j, &uvt, c) } else { weight(j, &ut, c - 4) };
        let w_lines = (0..hidden).map(|j| std::array::from_fn(|c| SCALE * line_weight(j, c))).collect();

        // b₁, γ, the gates, and the −3/2 of every feature; by row, F_vt.
        let of_gamma = self.timeline.coding.gamma(tau);
        let of_gates: Vec<f32> = self.tile.gate_inputs(&self.timeline.states[moment.a]).collect();
        let bias: Vec<f32> = (0..hidden)
            .map(|j| {
                let centre: f32 = w1[j * inputs..][..vt.end].iter().sum();
                let gamma: f32 = (0..gamma.len()).map(|i| weight(j, &gamma, i) * of_gamma[i]).sum();
                let gates: f32 = of_gates.iter().enumerate().map(|(i, g)| weight(j, &gates, i) * g).sum();
                b1[j] - 1.5 * centre + gamma + gates
            })
            .collect();
        let v_vt = if has.vt {
            plane(&self.tile.f_vt, shape.vt, shape.rows, tau as f32, shape.height)
        } else {
            vec![[0.0; 2]; shape.height]
        };
        let mut rows = Vec::with_capacity(shape.height * hidden);
        for v in v_vt {
            let share = |j| weight(j, &vt, 0) * v[0] + weight(j, &vt, 1) * v[1];
            rows.extend((0..hidden).map(|j| bias[j] + SCALE * share(j)));
        }
        let w_uv = (0..hidden).map(|j| std::array::from_fn(|c| SCALE * weight(j, &uv, c))).collect();
        let across = (0..shape.height).map(|y| clamped(coordinate(y, shape.height), height)).collect();
        Folded {
            width: shape.width,
            height: shape.height,
            padded,
            hidden,
            uv: &self.uv,
            lines,
            w_lines,
            across,
            rows,
            w_uv,
            w2,
            b2,
            w3,
            b3,
            means,
            coding: self.timeline.coding,
        }
    }

    /// F_uvt at τ, row by row, in 255ths.
    fn slice(&self, tau: f32) -> Vec<[f32; 4]> {
        let [width, height, slices] = self.tile.shape.uvt;
        let blocks = width * height / 16;
        let (k0, k1, share) = periodic(tau, slices);
        let mut slice = vec![[0.0; 4]; width * height];
        for (k, weight) in [(k0, 1.0 - share), (k1, share)] {
            let texels = unpack(&self.tile.f_uvt[k * blocks..(k + 1) * blocks], width);
            for (x, y, texel) in texels.into_iter().flatten() {
                for (value, q) in slice[y * width + x].iter_mut().zip(texel) {
                    *value += weight * f32::from(q);
                }
            }
        }
        slice
    }
}

/// F_ut or F_vt at τ, at every texel of a side of `side` texels, in 255ths.
fn plane(map: &[[u8; 2]], n: usize, rows: usize, tau: f32, side: usize) -> Vec<[f32; 2]> {
    let (r0, r1, share) = periodic(tau, rows);
    let at = |i: usize, c: usize| lerp(f32::from(map[r0 * n + i][c]), f32::from(map[r1 * n + i][c]), share);
    (0..side)
        .map(|i| {
            let (i0, i1, s) = clamped((i as f32 + 0.5) / side as f32, n);
            std::array::from_fn(|c| lerp(at(i0, c), at(i1, c), s))
        })
        .collect()
}

/// Every texel of blocks in rows of `width` texels, block by block, with its place.
fn unpack(blocks: &[[u8; 16]], width: usize) -> Result<impl Iterator<Item = (usize, usize, [u8; 4])>> {
    let texels = blocks.iter().map(bc7::decode).collect::<Result<Vec<_>>>()?;
    Ok(texels.into_iter().enumerate().flat_map(move |(i, texels)| {
        let (left, top) = (4 * (i % (width / 4)), 4 * (i / (width / 4)));
        texels.into_iter().enumerate().map(move |(j, texel)| (left + j % 4, top + j / 4, texel))
    }))
}
