//! A tile at one time, ready for sampling: what depends on time alone is computed once.

use super::kernel::{self, Fold};
use super::{TileDecoder, irradiance, means_at};
use crate::Result;
use crate::lanes::Tier;
use crate::model::{Shape, TileParams, gelu};
use crate::time::{Coding, TimePoint, Timeline};

/// What a tile's maps hold at one time.
#[derive(Clone, Debug)]
pub(crate) struct Prepared {
    tier: Tier,
    shape: Shape,
    coding: Coding,
    padded: usize,
    /// F_uv by channel, row, column, as bytes; empty without it.
    uv: Vec<u8>,
    mlp: Vec<f32>,
    fold: Fold,
    /// The first layer's weights by input, ten of them (V_uvt, V_uv, V_ut), then unit.
    first: Vec<f32>,
    /// The second's by input, then unit.
    second: Vec<f32>,
    /// The third's by input, then channel; one more that is 0.
    third: Vec<[f32; 4]>,
}

impl Prepared {
    /// Of a tile; `None` if it is black at the time.
    pub(crate) fn new(tile: &TileParams, timeline: &Timeline, point: &TimePoint) -> Result<Option<Self>> {
        let means = means_at(tile, point);
        if means == [0.0; 3] {
            return Ok(None);
        }
        let decoder = TileDecoder::new(tile, timeline)?;
        let fold = decoder.fold(point, means);
        let (shape, hidden) = (tile.shape, tile.shape.hidden);
        let by_input = |weights: &[[f32; 4]], inputs: usize| -> Vec<f32> {
            (0..inputs).flat_map(|c| weights.iter().map(move |of_unit| of_unit[c])).collect()
        };
        let first = [by_input(&fold.w_uvt, 4), by_input(&fold.w_uv, 4), by_input(&fold.w_ut, 2)].concat();
        let [.., w2, _, w3, _] = shape.split_mlp(&decoder.mlp);
        let second = (0..hidden).flat_map(|k| (0..hidden).map(move |j| w2[j * hidden + k])).collect();
        let third = (0..hidden).map(|k| [w3[k], w3[hidden + k], w3[2 * hidden + k], 0.0]).collect();
        Ok(Some(Prepared {
            tier: decoder.tier,
            coding: timeline.coding,
            padded: decoder.padded,
            shape,
            fold,
            first,
            second,
            third,
            uv: decoder.uv,
            mlp: decoder.mlp,
        }))
    }

    /// All stored texels, row by row.
    pub(crate) fn decode_into(&self, out: &mut [[f32; 3]]) {
        let folded =
            kernel::Folded::new(&self.shape, &self.fold, self.coding, self.padded, &self.uv, &self.mlp);
        kernel::decode(self.tier, &folded, out);
    }

    /// One stored texel.
    pub(crate) fn texel(&self, x: usize, y: usize) -> [f32; 3] {
        match self.shape.hidden {
            16 => self.texel_of::<16>(x, y),
            32 => self.texel_of::<32>(x, y),
            _ => self.texel_of::<64>(x, y),
        }
    }

    fn texel_of<const HIDDEN: usize>(&self, x: usize, y: usize) -> [f32; 3] {
        let (fold, [.., b2, _, b3]) = (&self.fold, self.shape.split_mlp(&self.mlp));
        let ((x0, x1, s), (y0, y1, t)) = (fold.along[x], fold.across[y]);
        let at = |x: usize, y: usize| &fold.slice[y * fold.slice_width + x];
        let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
        let mut v = [0.0f32; 10];
        for i in 0..4 {
            let (above, below) = (a[i] + s * (b[i] - a[i]), c[i] + s * (d[i] - c[i]));
            v[i] = above + t * (below - above);
        }
        if !self.uv.is_empty() {
            let plane = self.shape.height * self.padded;
            for i in 0..4 {
                v[4 + i] = f32::from(self.uv[i * plane + y * self.padded + x]);
            }
        }
        (v[8], v[9]) = (fold.ut[0][x], fold.ut[1][x]);
        let mut h1: [f32; HIDDEN] = fold.rows.as_chunks().0[y];
        for (v, weights) in v.iter().zip(self.first.as_chunks::<HIDDEN>().0) {
            h1.iter_mut().zip(weights).for_each(|(h, w)| *h += w * v);
        }
        let mut h2 = [0.0; HIDDEN];
        h2.copy_from_slice(b2);
        for (h, weights) in h1.iter().zip(self.second.as_chunks::<HIDDEN>().0) {
            let v = gelu(*h);
            h2.iter_mut().zip(weights).for_each(|(h, w)| *h += w * v);
        }
        let mut y4 = [b3[0], b3[1], b3[2], 0.0];
        for (h, weights) in h2.iter().zip(&self.third) {
            let v = gelu(*h);
            y4.iter_mut().zip(weights).for_each(|(y, w)| *y += w * v);
        }
        std::array::from_fn(|c| irradiance(y4[c], fold.means[c], self.coding))
    }
}
