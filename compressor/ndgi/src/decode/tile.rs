//! A tile unpacked for decoding whole: what depends on the time alone is folded once per time.

use super::kernel::{self, Fold, Folded, LANES};
use super::{clamped, lerp, means_at, periodic, tau_at};
use crate::bc7;
use crate::lanes::Tier;
use crate::model::TileParams;
use crate::time::{TimePoint, Timeline};
use crate::{Error, Result};

/// `c(q/255) = SCALE q − 3/2`.
const SCALE: f32 = 3.0 / 255.0;

/// A tile with F_uv unpacked; of F_uvt only the two slices around a time are unpacked when they are needed.
#[derive(Clone, Debug)]
pub struct TileDecoder<'a> {
    tile: TileParams,
    timeline: &'a Timeline,
    pub(super) tier: Tier,
    /// Stored width rounded up to whole vectors.
    pub(super) padded: usize,
    /// F_uv by channel, row, column (`4 × height × padded`), as bytes; empty without it.
    pub(super) uv: Vec<u8>,
    /// All weights in single precision, in the tile's order.
    pub(super) mlp: Vec<f32>,
}

impl<'a> TileDecoder<'a> {
    /// Unpacks a tile, to be decoded with the best instructions this processor has. The timeline is its
    /// bundle's.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a shape that no contents give, lists of other lengths, or a block of another
    /// mode of BC7 than 6 and 4.
    pub fn new(tile: &TileParams, timeline: &'a Timeline) -> Result<Self> {
        tile.check_lengths().map_err(|what| Error::invalid("tile", what))?;
        let shape = &tile.shape;
        let padded = shape.width.next_multiple_of(LANES);
        let size = [shape.width, shape.height, padded];
        let tier = Tier::detect();
        let uv = if shape.contents.uv { kernel::unpack(tier, &tile.f_uv, size)? } else { Vec::new() };
        // Checked once here, so that decoding cannot fail.
        tile.f_uvt.iter().try_for_each(bc7::check)?;
        let mlp = tile.mlp.iter().map(|w| w.to_f32()).collect();
        Ok(TileDecoder { tile: tile.clone(), timeline, tier, padded, uv, mlp })
    }

    /// The same with the instructions of another tier of this processor.
    pub fn with_tier(self, tier: Tier) -> Self {
        TileDecoder { tier, ..self }
    }

    /// Irradiance of all stored texels, row by row, at a time of the bundle's timeline, whose frames are the
    /// tile's.
    pub fn decode_tile(&self, point: &TimePoint) -> Vec<[f32; 3]> {
        let mut out = vec![[0.0; 3]; self.tile.shape.width * self.tile.shape.height];
        self.decode_into(point, &mut out);
        out
    }

    /// The same, into memory that already exists.
    ///
    /// # Panics
    /// Unless it holds as many texels as the tile.
    pub fn decode_into(&self, point: &TimePoint, out: &mut [[f32; 3]]) {
        assert_eq!(out.len(), self.tile.shape.width * self.tile.shape.height, "texels of the tile");
        let means = means_at(&self.tile, point);
        if means == [0.0; 3] {
            out.fill([0.0; 3]);
        } else {
            let fold = self.fold(point, means);
            let folded =
                Folded::new(&self.tile.shape, &fold, self.timeline.coding, self.padded, &self.uv, &self.mlp);
            kernel::decode(self.tier, &folded, out);
        }
    }

    /// Blends the maps in time and folds what depends on the row or the time alone into the first layer's
    /// bias.
    pub(super) fn fold(&self, point: &TimePoint, means: [f32; 3]) -> Fold {
        let (shape, hidden, padded) = (&self.tile.shape, self.tile.shape.hidden, self.padded);
        let (has, inputs) = (&shape.contents, shape.inputs());
        let [w1, b1, ..] = shape.split_mlp(&self.mlp);
        // Weight `i` of the inputs in a range of columns: 0 of what the tile does not have.
        let [uvt, uv, ut, vt, gamma, gates] = shape.columns();
        let weight = |j: usize, columns: &std::ops::Range<usize>, i: usize| {
            if i < columns.len() { w1[j * inputs + columns.start + i] } else { 0.0 }
        };
        let tau = tau_at(&self.tile, self.timeline, point);
        let coordinate = |x: usize, n: usize| (x as f32 + 0.5) / n as f32;

        // F_uvt: one slice at τ. F_ut: one row at τ, along u to every column. Without F_uvt its slice is one
        // texel of 0.
        let [width, height, _] = if has.uvt > 0 { shape.uvt } else { [1; 3] };
        let slice = if has.uvt > 0 { self.slice(tau) } else { vec![[0.0; 4]] };
        let mut of_ut = [vec![0.0; padded], vec![0.0; padded]];
        if has.ut {
            let v_ut = plane(&self.tile.f_ut, shape.ut, shape.rows, tau, shape.width);
            for (c, line) in of_ut.iter_mut().enumerate() {
                line.iter_mut().zip(&v_ut).for_each(|(value, v)| *value = v[c]);
            }
        }
        let weights_of = |columns: &std::ops::Range<usize>| -> Vec<[f32; 4]> {
            (0..hidden).map(|j| std::array::from_fn(|c| SCALE * weight(j, columns, c))).collect()
        };

        // b₁, γ, the gates, and the −3/2 of every feature; by row, F_vt.
        let of_gamma = self.timeline.coding.gamma(tau);
        let of_gates: Vec<f32> = self.tile.gate_inputs(&self.timeline.states[point.a]).collect();
        let bias: Vec<f32> = (0..hidden)
            .map(|j| {
                let centre: f32 = w1[j * inputs..][..vt.end].iter().sum();
                let gamma: f32 = (0..gamma.len()).map(|i| weight(j, &gamma, i) * of_gamma[i]).sum();
                let gates: f32 = of_gates.iter().enumerate().map(|(i, g)| weight(j, &gates, i) * g).sum();
                b1[j] - 1.5 * centre + gamma + gates
            })
            .collect();
        let v_vt = if has.vt {
            plane(&self.tile.f_vt, shape.vt, shape.rows, tau, shape.height)
        } else {
            vec![[0.0; 2]; shape.height]
        };
        let w_vt = weights_of(&vt);
        let mut rows = Vec::with_capacity(shape.height * hidden);
        for v in v_vt {
            rows.extend(bias.iter().zip(&w_vt).map(|(bias, w)| bias + w[0] * v[0] + w[1] * v[1]));
        }
        Fold {
            slice,
            slice_width: width,
            along: (0..shape.width).map(|x| clamped(coordinate(x, shape.width), width)).collect(),
            across: (0..shape.height).map(|y| clamped(coordinate(y, shape.height), height)).collect(),
            ut: of_ut,
            rows,
            w_uvt: weights_of(&uvt),
            w_uv: weights_of(&uv),
            w_ut: weights_of(&ut),
            means,
        }
    }

    /// F_uvt at τ, row by row, in 255ths.
    fn slice(&self, tau: f64) -> Vec<[f32; 4]> {
        let [width, height, slices] = self.tile.shape.uvt;
        let blocks = width * height / 16;
        let (k0, k1, share) = periodic(tau, slices);
        let mut slice = vec![[0.0; 4]; width * height];
        let of = |k: usize, i: usize| bc7::decode(&self.tile.f_uvt[k * blocks + i]).unwrap_or([[0; 4]; 16]);
        for i in 0..blocks {
            let (left, top) = corner(i, width);
            for (j, (a, b)) in of(k0, i).iter().zip(&of(k1, i)).enumerate() {
                let value = &mut slice[(top + j / 4) * width + left + j % 4];
                *value = std::array::from_fn(|c| lerp(f32::from(a[c]), f32::from(b[c]), share));
            }
        }
        slice
    }
}

/// The first texel of a block, in rows of `width` texels.
fn corner(block: usize, width: usize) -> (usize, usize) {
    (4 * (block % (width / 4)), 4 * (block / (width / 4)))
}

/// F_ut or F_vt at τ, at every texel of a side of `side` texels, in 255ths.
fn plane(map: &[[u8; 2]], n: usize, rows: usize, tau: f64, side: usize) -> Vec<[f32; 2]> {
    let (r0, r1, share) = periodic(tau, rows);
    let at = |i: usize, c: usize| lerp(f32::from(map[r0 * n + i][c]), f32::from(map[r1 * n + i][c]), share);
    (0..side)
        .map(|i| {
            let (i0, i1, s) = clamped((i as f32 + 0.5) / side as f32, n);
            std::array::from_fn(|c| lerp(at(i0, c), at(i1, c), s))
        })
        .collect()
}
