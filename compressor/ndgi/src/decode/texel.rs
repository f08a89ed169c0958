//! One texel by the formulae of [`crate::model`], literally: random access, and the oracle of the fast path.

use super::{clamped, irradiance, lerp, means_at, periodic, tau_at};
use crate::bc7;
use crate::model::{TileParams, gelu};
use crate::time::{TimePoint, Timeline};

/// Irradiance of the stored texel (x, y), which must lie inside the tile, at a time of the bundle's timeline.
/// Blocks of modes of BC7 that no bundle holds count as zero.
pub fn texel(tile: &TileParams, timeline: &Timeline, point: &TimePoint, x: usize, y: usize) -> [f32; 3] {
    let (shape, has) = (&tile.shape, &tile.shape.contents);
    let (u, v) = ((x as f32 + 0.5) / shape.width as f32, (y as f32 + 0.5) / shape.height as f32);
    let tau = tau_at(tile, timeline, point);
    let c = |f: f32| 3.0 * (f - 0.5);
    // x = [c(V_uvt), c(V_uv), c(V_ut), c(V_vt), γ(τ), gates], of those that the tile has.
    let mut input: Vec<f32> = Vec::with_capacity(shape.inputs());

    // V_uvt: trilinear, clamped in u and v, periodic in τ.
    if has.uvt > 0 {
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
        input.extend(mix(bilinear(k0), bilinear(k1), st).map(c));
    }
    // V_uv: the texel itself.
    if has.uv {
        input.extend(block_texel(&tile.f_uv, shape.width, x, y).map(c));
    }
    // V_ut and V_vt: bilinear, clamped along the side, periodic in τ.
    for (there, map, u, n) in [(has.ut, &tile.f_ut, u, shape.ut), (has.vt, &tile.f_vt, v, shape.vt)] {
        if there {
            let ((r0, r1, sr), (i0, i1, s)) = (periodic(tau, shape.rows), clamped(u, n));
            let at = |r: usize, i: usize| map[r * n + i].map(|q| f32::from(q) / 255.0);
            let value = mix(mix(at(r0, i0), at(r0, i1), s), mix(at(r1, i0), at(r1, i1), s), sr);
            input.extend(value.map(c));
        }
    }
    if has.gamma {
        input.extend(timeline.coding.gamma(tau));
    }
    input.extend(tile.gate_inputs(&timeline.states[point.a]));
    debug_assert_eq!(input.len(), shape.inputs());
    // Three layers.
    let mut weights = tile.mlp.iter().map(|w| w.to_f32());
    let mut layer = |input: &[f32], outputs: usize| {
        let matrix: Vec<f32> = weights.by_ref().take(outputs * input.len()).collect();
        let biases: Vec<f32> = weights.by_ref().take(outputs).collect();
        let dot = |row: &[f32]| row.iter().zip(input).map(|(w, x)| w * x).sum::<f32>();
        let row = |j: usize| &matrix[j * input.len()..(j + 1) * input.len()];
        (0..outputs).map(|j| biases[j] + dot(row(j))).collect::<Vec<f32>>()
    };
    let h1: Vec<f32> = layer(&input, shape.hidden).into_iter().map(gelu).collect();
    let h2: Vec<f32> = layer(&h1, shape.hidden).into_iter().map(gelu).collect();
    let y = layer(&h2, 3);
    let means = means_at(tile, point);
    std::array::from_fn(|c| irradiance(y[c], means[c], timeline.coding))
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
