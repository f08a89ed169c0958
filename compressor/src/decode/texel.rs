//! One texel by the formulae of [`crate::model`], literally: random access, and the oracle of the fast path.

use super::{clamped, irradiance, lerp, means_at, periodic};
use crate::bc7;
use crate::model::{INPUTS, TileParams, gelu};
use crate::time::{Coding, Moment};

/// Irradiance of the stored texel (x, y), which must lie inside the tile, at a moment of the bundle's timeline.
/// Blocks that are not BC7 mode 6, which no bundle holds, count as zero.
pub fn texel(tile: &TileParams, coding: Coding, moment: &Moment, x: usize, y: usize) -> [f32; 3] {
    let shape = &tile.shape;
    let (u, v) = ((x as f32 + 0.5) / shape.width as f32, (y as f32 + 0.5) / shape.height as f32);
    let tau = moment.tau;

    // V_uv: the texel itself.
    let v_uv = block_texel(&tile.f_uv, shape.width, x, y);
    // V_uvt: trilinear, clamped in u and v, periodic in τ.
    let [width, height, slices] = shape.uvt;
    let ((x0, x1, su), (y0, y1, sv), (k0, k1, st)) =
        (clamped(u, width), clamped(v, height), periodic(tau, slices));
    let blocks = (width / 4) * (height / 4);
    let bilinear = |k: usize| {
        let slice = &tile.f_uvt[k * blocks..(k + 1) * blocks];
        let at = |x, y| block_texel(slice, width, x, y);
        let row = |y| mix(at(x0, y), at(x1, y), su);
        mix(row(y0), row(y1), sv)
    };
    let v_uvt = mix(bilinear(k0), bilinear(k1), st);
    // V_ut and V_vt: bilinear, clamped along the side, periodic in τ.
    let (r0, r1, sr) = periodic(tau, shape.rows);
    let plane = |map: &[[u8; 2]], u: f32, n: usize| {
        let (i0, i1, s) = clamped(u, n);
        let at = |r: usize, i: usize| map[r * n + i].map(|q| f32::from(q) / 255.0);
        mix(mix(at(r0, i0), at(r0, i1), s), mix(at(r1, i0), at(r1, i1), s), sr)
    };
    let (v_ut, v_vt) = (plane(&tile.f_ut, u, shape.ut), plane(&tile.f_vt, v, shape.vt));

    // x = [c(V_uvt), c(V_uv), c(V_ut), c(V_vt), γ(τ)]
    let features = v_uvt.into_iter().chain(v_uv).chain(v_ut).chain(v_vt).map(|f| 3.0 * (f - 0.5));
    let input: Vec<f32> = features.chain(coding.gamma(f64::from(tau))).collect();
    debug_assert_eq!(input.len(), INPUTS);
    // Three layers.
    let mut weights = tile.mlp.iter().map(|w| w.to_f32());
    let mut layer = |input: &[f32], outputs: usize| {
        let matrix: Vec<f32> = weights.by_ref().take(outputs * input.len()).collect();
        let biases: Vec<f32> = weights.by_ref().take(outputs).collect();
        let dot = |row: &[f32]| row.iter().zip(input).map(|(w, x)| w * x).sum::<f32>();
        matrix.chunks(input.len()).zip(biases).map(|(row, b)| b + dot(row)).collect::<Vec<f32>>()
    };
    let h1: Vec<f32> = layer(&input, shape.hidden).into_iter().map(gelu).collect();
    let h2: Vec<f32> = layer(&h1, shape.hidden).into_iter().map(gelu).collect();
    let y = layer(&h2, 3);
    let means = means_at(tile, moment);
    std::array::from_fn(|c| irradiance(y[c], means[c], coding))
}

/// Texel (x, y) of a map of blocks, `width` texels across, in [0, 1].
fn block_texel(blocks: &[[u8; 16]], width: usize, x: usize, y: usize) -> [f32; 4] {
    let block = &blocks[(y / 4) * (width / 4) + x / 4];
    let texels = bc7::decode(block).unwrap_or([[0; 4]; 16]);
    texels[x % 4 + 4 * (y % 4)].map(|q| f32::from(q) / 255.0)
}

fn mix<const N: usize>(a: [f32; N], b: [f32; N], s: f32) -> [f32; N] {
    std::array::from_fn(|i| lerp(a[i], b[i], s))
}
