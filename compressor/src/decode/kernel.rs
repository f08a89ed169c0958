//! The inner loop: a vector of texels of one row at a time through the folded decoder, compiled once per instruction set.
//!
//! Vectors never pass through closures here: those would be compiled without the instruction set of the function around them.

use super::{Y_MAX, irradiance};
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, Avx512};
use crate::lanes::{Instructions, Lanes, Quad, Tier};
use crate::model::{GELU_BOUND, GELU_COEFFICIENTS};
use crate::time::Coding;

/// Rows of texels are padded to a multiple of this, which every vector length divides.
pub(super) const LANES: usize = 16;
/// Features whose share of the first layer is expanded to columns: V_uvt 4, V_ut 2.
pub(super) const EXPANDED: usize = 6;

/// A tile at one moment, ready to be decoded. Feature values are in 255ths; the weights of the first layer are scaled accordingly.
pub(super) struct Folded<'a> {
    /// Stored size in texels.
    pub width: usize,
    pub height: usize,
    /// Width rounded up to whole vectors.
    pub padded: usize,
    /// Width of the hidden layers.
    pub hidden: usize,
    /// F_uv by channel, row, column; empty without it.
    pub uv: &'a [u8],
    /// V_uvt and V_ut at every column: by row of F_uvt, feature, column.
    pub lines: Vec<f32>,
    /// First layer's weights of those features, by unit.
    pub w_lines: Vec<[f32; EXPANDED]>,
    /// Per row of texels: the two rows of F_uvt around it, and the second's share.
    pub across: Vec<(usize, usize, f32)>,
    /// First layer's share of F_vt, γ, the gates and the bias: by row of texels, unit.
    pub rows: Vec<f32>,
    /// First layer's weights of F_uv, by unit.
    pub w_uv: Vec<[f32; 4]>,
    /// The other layers as they are stored.
    pub w2: &'a [f32],
    pub b2: &'a [f32],
    pub w3: &'a [f32],
    pub b3: &'a [f32],
    pub means: [f32; 3],
    pub coding: Coding,
}

/// Decodes a whole tile into `out`, row by row, with the instructions of `tier`.
pub(super) fn decode(tier: Tier, tile: &Folded, out: &mut [[f32; 3]]) {
    match tile.hidden {
        16 => dispatch::<16>(tier, tile, out),
        64 => dispatch::<64>(tier, tile, out),
        other => unreachable!("profiles have hidden layers of 16 or 64, not {other}"),
    }
}

fn dispatch<const HIDDEN: usize>(tier: Tier, tile: &Folded, out: &mut [[f32; 3]]) {
    match tier.instructions() {
        Instructions::Portable => run::<Quad, HIDDEN>(tile, out),
        // SAFETY: only `Tier::available` makes this tier, after asking the processor.
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2 => unsafe { avx2::<HIDDEN>(tile, out) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx512 => unsafe { avx512::<HIDDEN>(tile, out) },
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
fn avx512<const HIDDEN: usize>(tile: &Folded, out: &mut [[f32; 3]]) {
    run::<Avx512, HIDDEN>(tile, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<const HIDDEN: usize>(tile: &Folded, out: &mut [[f32; 3]]) {
    run::<Avx2, HIDDEN>(tile, out);
}

/// [`crate::model::gelu`] in every lane.
#[inline(always)]
fn gelu<L: Lanes>(x: L) -> L {
    let y = x.max(L::splat(-GELU_BOUND)).min(L::splat(GELU_BOUND));
    let s = y.mul(y);
    let mut p = L::splat(GELU_COEFFICIENTS[5]);
    for k in [4, 3, 2, 1, 0] {
        p = p.mul_add(s, L::splat(GELU_COEFFICIENTS[k]));
    }
    x.mul(y.mul_add(p, L::splat(0.5)))
}

/// As many bytes as lanes, as numbers.
#[inline(always)]
fn load_bytes<L: Lanes>(from: &[u8]) -> L {
    let mut values = [0.0; LANES];
    for (value, byte) in values[..L::N].iter_mut().zip(&from[..L::N]) {
        *value = f32::from(*byte);
    }
    L::load(&values)
}

/// Outputs of a layer computed together: as many independent sums as hide the latency of an addition.
const BLOCK: usize = 8;

#[inline(always)]
fn run<L: Lanes, const HIDDEN: usize>(tile: &Folded, out: &mut [[f32; 3]]) {
    let columns = expand::<L, HIDDEN>(tile);
    let plane = tile.height * tile.padded;
    let has_uv = !tile.uv.is_empty();
    let (w2, _) = tile.w2.as_chunks::<HIDDEN>();
    let (w3, _) = tile.w3.as_chunks::<HIDDEN>();
    for (y, line) in out.chunks_exact_mut(tile.width).enumerate() {
        let (above, below, share) = tile.across[y];
        let share = L::splat(share);
        let rows = &tile.rows[y * HIDDEN..(y + 1) * HIDDEN];
        for (i, texels) in line.chunks_mut(L::N).enumerate() {
            let x = i * L::N;
            // h₁ = gelu(W₁ x + b₁), all but V_uv folded.
            let mut v_uv = [L::splat(0.0); 4];
            if has_uv {
                for (c, v) in v_uv.iter_mut().enumerate() {
                    *v = load_bytes(&tile.uv[c * plane + y * tile.padded + x..]);
                }
            }
            let mut h1 = [L::splat(0.0); HIDDEN];
            for (j, h) in h1.iter_mut().enumerate() {
                let a = L::load(&columns[(above * HIDDEN + j) * tile.padded + x..]);
                let b = L::load(&columns[(below * HIDDEN + j) * tile.padded + x..]);
                let difference = a.mul_add(L::splat(-1.0), b);
                let mut sum = share.mul_add(difference, a).add(L::splat(rows[j]));
                if has_uv {
                    for (w, v) in tile.w_uv[j].iter().zip(&v_uv) {
                        sum = L::splat(*w).mul_add(*v, sum);
                    }
                }
                *h = gelu(sum);
            }
            // h₂ = gelu(W₂ h₁ + b₂)
            let mut h2 = [L::splat(0.0); HIDDEN];
            for (j, h2) in h2.as_chunks_mut::<BLOCK>().0.iter_mut().enumerate() {
                let mut sums = [L::splat(0.0); BLOCK];
                for (b, sum) in sums.iter_mut().enumerate() {
                    *sum = L::splat(tile.b2[j * BLOCK + b]);
                }
                for (k, h) in h1.iter().enumerate() {
                    for (b, sum) in sums.iter_mut().enumerate() {
                        *sum = L::splat(w2[j * BLOCK + b][k]).mul_add(*h, *sum);
                    }
                }
                for (h, sum) in h2.iter_mut().zip(&sums) {
                    *h = gelu(*sum);
                }
            }
            // y = W₃ h₂ + b₃
            let mut y3 = [L::splat(tile.b3[0]), L::splat(tile.b3[1]), L::splat(tile.b3[2])];
            for (k, h) in h2.iter().enumerate() {
                for (c, y) in y3.iter_mut().enumerate() {
                    *y = L::splat(w3[c][k]).mul_add(*h, *y);
                }
            }
            store(y3, tile, texels);
        }
    }
}

/// The first layer's share of V_uvt and V_ut: by row of F_uvt, unit, column.
#[inline(always)]
fn expand<L: Lanes, const HIDDEN: usize>(tile: &Folded) -> Vec<f32> {
    let padded = tile.padded;
    let mut columns = vec![0.0; tile.lines.len() / EXPANDED * HIDDEN];
    for (line, out) in
        tile.lines.chunks_exact(EXPANDED * padded).zip(columns.chunks_exact_mut(HIDDEN * padded))
    {
        for x in (0..padded).step_by(L::N) {
            let mut features = [L::splat(0.0); EXPANDED];
            for (c, feature) in features.iter_mut().enumerate() {
                *feature = L::load(&line[c * padded + x..]);
            }
            for (j, weights) in tile.w_lines.iter().enumerate() {
                let mut sum = L::splat(0.0);
                for (w, f) in weights.iter().zip(&features) {
                    sum = L::splat(*w).mul_add(*f, sum);
                }
                sum.store(&mut out[j * padded + x..]);
            }
        }
    }
    columns
}

/// Output to irradiance, as [`irradiance`], and lanes to texels; the last vector of a row may have fewer texels than lanes.
#[inline(always)]
fn store<L: Lanes>(y: [L; 3], tile: &Folded, texels: &mut [[f32; 3]]) {
    let mut values = [[0.0; LANES]; 3];
    for c in 0..3 {
        let y = y[c].max(L::splat(0.0)).min(L::splat(Y_MAX));
        let light = y.mul(y).mul(L::splat(tile.means[c])).min(L::splat(f32::MAX));
        if tile.coding == Coding::Standard { light } else { y }.store(&mut values[c]);
    }
    for (l, texel) in texels.iter_mut().enumerate() {
        *texel = [values[0][l], values[1][l], values[2][l]];
        if tile.coding != Coding::Standard {
            *texel = std::array::from_fn(|c| irradiance(texel[c], tile.means[c], tile.coding));
        }
    }
}
