//! The inner loop: a vector of texels of one row at a time through the folded decoder, compiled once per
//! instruction set.
//!
//! Vectors never pass through closures here: those would be compiled without the instruction set of the
//! function around them.

#![allow(unsafe_code, reason = "instructions of processors")]
#![allow(clippy::needless_range_loop, reason = "units of a layer, as the formulas index them")]

use super::irradiance;
use crate::Result;
use crate::bc7;
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, Avx512};
use crate::lanes::{Instructions, Lanes, Quad, Tier};
use crate::model::{GELU_BOUND, GELU_COEFFICIENTS, Shape, Y_MAX};
use crate::time::Coding;

/// Rows of texels are padded to a multiple of this, which every vector length divides.
pub(super) const LANES: usize = 16;

/// What of a tile depends on the time, folded. Feature values are in 255ths; the weights of the first layer
/// are scaled accordingly.
#[derive(Clone, Debug)]
pub(super) struct Fold {
    /// F_uvt at the time, in rows of `slice_width` texels.
    pub slice: Vec<[f32; 4]>,
    pub slice_width: usize,
    /// Per column of texels: the two columns of F_uvt around it, and the second's share.
    pub along: Vec<(usize, usize, f32)>,
    /// Per row of texels: the two rows of F_uvt around it, and the second's share.
    pub across: Vec<(usize, usize, f32)>,
    /// V_ut by feature, column.
    pub ut: [Vec<f32>; 2],
    /// First layer's share of F_vt, γ, the gates and the bias: by row of texels, unit.
    pub rows: Vec<f32>,
    /// First layer's weights of F_uvt, F_uv and F_ut (the last two of which are 0), by unit.
    pub w_uvt: Vec<[f32; 4]>,
    pub w_uv: Vec<[f32; 4]>,
    pub w_ut: Vec<[f32; 4]>,
    pub means: [f32; 3],
}

/// A tile at one time, ready to be decoded.
pub(super) struct Folded<'a> {
    /// Stored size in texels.
    width: usize,
    height: usize,
    /// Width rounded up to whole vectors.
    padded: usize,
    /// Width of the hidden layers.
    hidden: usize,
    /// F_uv by channel, row, column; empty without it.
    uv: &'a [u8],
    fold: &'a Fold,
    /// The other layers as they are stored.
    w2: &'a [f32],
    b2: &'a [f32],
    w3: &'a [f32],
    b3: &'a [f32],
    coding: Coding,
}

impl<'a> Folded<'a> {
    /// A tile of a shape, its F_uv in rows of `padded` texels, and its weights.
    pub(super) fn new(
        shape: &Shape,
        fold: &'a Fold,
        coding: Coding,
        padded: usize,
        uv: &'a [u8],
        mlp: &'a [f32],
    ) -> Self {
        let [.., w2, b2, w3, b3] = shape.split_mlp(mlp);
        let Shape { width, height, hidden, .. } = *shape;
        Folded { width, height, padded, hidden, uv, fold, w2, b2, w3, b3, coding }
    }
}

/// Decodes a whole tile into `out`, row by row, with the instructions of `tier`.
pub(super) fn decode(tier: Tier, tile: &Folded, out: &mut [[f32; 3]]) {
    match tile.hidden {
        16 => dispatch::<16>(tier, tile, out),
        32 => dispatch::<32>(tier, tile, out),
        64 => dispatch::<64>(tier, tile, out),
        other => unreachable!("hidden layer of {other} units; expected 16, 32 or 64"),
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

/// A map's texels, block by block, as bytes by channel, row, column (`4 × height × padded`).
///
/// # Errors
/// For a block of another mode of BC7 than 6 and 4.
pub(super) fn unpack(
    tier: Tier,
    blocks: &[[u8; 16]],
    [width, height, padded]: [usize; 3],
) -> Result<Vec<u8>> {
    let mut texels = vec![0; 4 * height * padded];
    let planes = Planes { texels: &mut texels, width, height, padded };
    match tier.instructions() {
        Instructions::Portable => unpack_blocks(blocks, planes)?,
        // SAFETY: only `Tier::available` makes these tiers, after asking the processor for AVX2 at least.
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2 | Instructions::Avx512 => unsafe { unpack_avx2(blocks, planes)? },
    }
    Ok(texels)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn unpack_avx2(blocks: &[[u8; 16]], planes: Planes) -> Result<()> {
    unpack_blocks(blocks, planes)
}

/// Where a map's texels go: `4 × height × padded` bytes.
struct Planes<'a> {
    texels: &'a mut [u8],
    width: usize,
    height: usize,
    padded: usize,
}

#[inline(always)]
fn unpack_blocks(blocks: &[[u8; 16]], planes: Planes) -> Result<()> {
    let Planes { texels, width, height, padded } = planes;
    for (top, row) in blocks.chunks_exact(width / 4).enumerate() {
        for (left, block) in row.iter().enumerate() {
            let values = bc7::unpack(block)?.planes();
            for (c, values) in values.iter().enumerate() {
                let to = &mut texels[(c * height + 4 * top) * padded + 4 * left..][..3 * padded + 4];
                for (y, values) in values.as_chunks::<4>().0.iter().enumerate() {
                    to[y * padded..][..4].copy_from_slice(values);
                }
            }
        }
    }
    Ok(())
}

/// Units of a layer computed together: as many independent sums as hide the latency of an addition.
const BLOCK: usize = 8;

/// [`crate::model::gelu`] in every lane, four units side by side.
#[inline(always)]
fn gelu<L: Lanes>(units: &mut [L; BLOCK]) {
    for x in units.as_chunks_mut::<4>().0 {
        let (mut y, mut s) = (*x, *x);
        for i in 0..4 {
            y[i] = x[i].max(L::splat(-GELU_BOUND)).min(L::splat(GELU_BOUND));
            s[i] = y[i].mul(y[i]);
        }
        const LAST: usize = GELU_COEFFICIENTS.len() - 1;
        let mut p = [L::splat(GELU_COEFFICIENTS[LAST]); 4];
        for k in (0..LAST).rev() {
            for i in 0..4 {
                p[i] = p[i].mul_add(s[i], L::splat(GELU_COEFFICIENTS[k]));
            }
        }
        for i in 0..4 {
            x[i] = x[i].mul(y[i].mul_add(p[i], L::splat(0.5)));
        }
    }
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

/// A layer's units at [`LANES`] columns.
type Units<const HIDDEN: usize> = [[f32; LANES]; HIDDEN];

#[inline(always)]
fn run<L: Lanes, const HIDDEN: usize>(tile: &Folded, out: &mut [[f32; 3]]) {
    let plane = tile.height * tile.padded;
    let has_uv = !tile.uv.is_empty();
    let w_uv: &[[f32; 4]; HIDDEN] = tile.fold.w_uv[..].try_into().expect("weights of every unit");
    let w2: &[[f32; HIDDEN]; HIDDEN] = tile.w2.as_chunks().0.try_into().expect("weights of every unit");
    let w3: &[[f32; HIDDEN]; 3] = tile.w3.as_chunks().0.try_into().expect("weights of every channel");
    let b2: &[f32; HIDDEN] = tile.b2.try_into().expect("a bias of every unit");
    let of_ut = expand_ut::<L, HIDDEN>(tile);
    // Rows of F_uvt in turn: the even one and the odd one of the two around a row of texels.
    let mut expanded = [of_ut.clone(), of_ut.clone()];
    let mut held = [usize::MAX; 2];
    for (y, line) in out.chunks_exact_mut(tile.width).enumerate() {
        let (above, below, share) = tile.fold.across[y];
        for row in [above, below] {
            if held[row % 2] != row {
                held[row % 2] = row;
                expand::<L, HIDDEN>(tile, row, &of_ut, &mut expanded[row % 2]);
            }
        }
        let (from_above, from_below) = (&expanded[above % 2], &expanded[below % 2]);
        let share = L::splat(share);
        let row = &tile.fold.rows.as_chunks::<HIDDEN>().0[y];
        for (i, texels) in line.chunks_mut(L::N).enumerate() {
            let x = i * L::N;
            let (chunk, lane) = (x / LANES, x % LANES);
            // h₁ = gelu(W₁ x + b₁), all but V_uv folded.
            let mut v_uv = [L::splat(0.0); 4];
            if has_uv {
                for (c, v) in v_uv.iter_mut().enumerate() {
                    *v = load_bytes(&tile.uv[c * plane + y * tile.padded + x..]);
                }
            }
            let (above, below) = (&from_above[chunk], &from_below[chunk]);
            let mut h1 = [L::splat(0.0); HIDDEN];
            for (j, h1) in h1.as_chunks_mut::<BLOCK>().0.iter_mut().enumerate() {
                let mut sums = [L::splat(0.0); BLOCK];
                for b in 0..BLOCK {
                    let unit = j * BLOCK + b;
                    let from = L::load(&above[unit][lane..]);
                    let difference = from.mul_add(L::splat(-1.0), L::load(&below[unit][lane..]));
                    sums[b] = share.mul_add(difference, from.add(L::splat(row[unit])));
                }
                if has_uv {
                    for c in 0..4 {
                        for b in 0..BLOCK {
                            sums[b] = L::splat(w_uv[j * BLOCK + b][c]).mul_add(v_uv[c], sums[b]);
                        }
                    }
                }
                gelu(&mut sums);
                *h1 = sums;
            }
            // h₂ = gelu(W₂ h₁ + b₂)
            let mut h2 = [L::splat(0.0); HIDDEN];
            for (j, h2) in h2.as_chunks_mut::<BLOCK>().0.iter_mut().enumerate() {
                let mut sums = [L::splat(0.0); BLOCK];
                for b in 0..BLOCK {
                    sums[b] = L::splat(b2[j * BLOCK + b]);
                }
                for (k, h) in h1.iter().enumerate() {
                    for b in 0..BLOCK {
                        sums[b] = L::splat(w2[j * BLOCK + b][k]).mul_add(*h, sums[b]);
                    }
                }
                gelu(&mut sums);
                *h2 = sums;
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

/// First-layer contribution of V_ut, by column.
#[inline(always)]
fn expand_ut<L: Lanes, const HIDDEN: usize>(tile: &Folded) -> Vec<Units<HIDDEN>> {
    let mut out = vec![[[0.0; LANES]; HIDDEN]; tile.padded / LANES];
    for (chunk, units) in out.iter_mut().enumerate() {
        for (w, unit) in tile.fold.w_ut.iter().zip(units) {
            for lane in (0..LANES).step_by(L::N) {
                let x = chunk * LANES + lane;
                let second = L::splat(w[1]).mul(L::load(&tile.fold.ut[1][x..]));
                L::splat(w[0]).mul_add(L::load(&tile.fold.ut[0][x..]), second).store(&mut unit[lane..]);
            }
        }
    }
    out
}

/// First-layer contribution of V_ut and V_uvt, by column, at one row of F_uvt.
#[inline(always)]
fn expand<L: Lanes, const HIDDEN: usize>(
    tile: &Folded,
    row: usize,
    of_ut: &[Units<HIDDEN>],
    out: &mut [Units<HIDDEN>],
) {
    let texels = &tile.fold.slice[row * tile.fold.slice_width..(row + 1) * tile.fold.slice_width];
    for (chunk, (of_ut, units)) in of_ut.iter().zip(out).enumerate() {
        let mut features = [[0.0; LANES]; 4];
        let along = &tile.fold.along[chunk * LANES..];
        for (l, &(x0, x1, share)) in along.iter().take(LANES).enumerate() {
            let (a, b) = (texels[x0], texels[x1]);
            let value = [share; 4].mul_add(a.mul_add([-1.0; 4], b), a);
            for c in 0..4 {
                features[c][l] = value[c];
            }
        }
        for lane in (0..LANES).step_by(L::N) {
            let mut v = [L::splat(0.0); 4];
            for c in 0..4 {
                v[c] = L::load(&features[c][lane..]);
            }
            for ((weights, of_ut), unit) in tile.fold.w_uvt.iter().zip(of_ut).zip(units.iter_mut()) {
                let mut sum = L::load(&of_ut[lane..]);
                for c in 0..4 {
                    sum = L::splat(weights[c]).mul_add(v[c], sum);
                }
                sum.store(&mut unit[lane..]);
            }
        }
    }
}

/// Output to irradiance, as [`irradiance`], and lanes to texels; the last vector of a row may have fewer
/// texels than lanes.
#[inline(always)]
fn store<L: Lanes>(y: [L; 3], tile: &Folded, texels: &mut [[f32; 3]]) {
    let mut values = [[0.0; LANES]; 3];
    for c in 0..3 {
        let y = y[c].max(L::splat(0.0)).min(L::splat(Y_MAX));
        let light = y.mul(y).mul(L::splat(tile.fold.means[c])).min(L::splat(f32::MAX));
        if tile.coding == Coding::Standard { light } else { y }.store(&mut values[c]);
    }
    for (l, texel) in texels.iter_mut().enumerate() {
        *texel = [values[0][l], values[1][l], values[2][l]];
    }
    if tile.coding != Coding::Standard {
        for texel in texels {
            *texel = std::array::from_fn(|c| irradiance(texel[c], tile.fold.means[c], tile.coding));
        }
    }
}
