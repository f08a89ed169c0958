//! One tile's bytes: BC7 blocks, means, 8-bit planes, decoder weights.

use super::ALIGN;
use crate::bc7;
use crate::model::{Shape, TileParams};
use half::f16;

/// Length of a tile's payload in bytes, a multiple of 16.
pub fn payload_len(shape: &Shape) -> usize {
    let [uv, uvt, ut, vt] = shape.counts();
    (16 * (uv + uvt) + 12 * shape.sets + 2 * (ut + vt) + 2 * shape.mlp_len()).next_multiple_of(ALIGN)
}

/// A tile as bytes.
///
/// # Errors
/// What is wrong with the parameters: lengths that differ from the shape's, or values that [`decode_payload`] would refuse.
pub fn encode_payload(tile: &TileParams) -> Result<Vec<u8>, String> {
    let shape = &tile.shape;
    tile.check_lengths()?;
    check(tile)?;
    let mut bytes = Vec::with_capacity(payload_len(shape));
    bytes.extend(tile.f_uv.iter().chain(&tile.f_uvt).flatten());
    bytes.extend(tile.means.iter().flatten().flat_map(|mean| mean.to_le_bytes()));
    bytes.extend(tile.f_ut.iter().chain(&tile.f_vt).flatten());
    bytes.extend(tile.mlp.iter().flat_map(|weight| weight.to_le_bytes()));
    bytes.resize(payload_len(shape), 0);
    Ok(bytes)
}

/// A tile from its bytes.
///
/// # Errors
/// What the format forbids: another length, a block that is not BC7 mode 6, a weight or mean that is not finite, a negative mean,
/// padding that is not zero.
pub fn decode_payload(bytes: &[u8], shape: Shape) -> Result<TileParams, String> {
    if bytes.len() != payload_len(&shape) {
        return Err(format!("payload of {} bytes; expected {}", bytes.len(), payload_len(&shape)));
    }
    let [uv, uvt, ut, vt] = shape.counts();
    // The length is right, so every part is there.
    let mut rest = bytes;
    let mut take = |n: usize| {
        let (part, tail) = rest.split_at(n);
        rest = tail;
        part
    };
    let blocks = |part: &[u8]| part.as_chunks::<16>().0.to_vec();
    let (f_uv, f_uvt) = (blocks(take(16 * uv)), blocks(take(16 * uvt)));
    let means =
        take(12 * shape.sets).as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect::<Vec<_>>();
    let means = means.as_chunks::<3>().0.to_vec();
    let texels = |part: &[u8]| part.as_chunks::<2>().0.to_vec();
    let (f_ut, f_vt) = (texels(take(2 * ut)), texels(take(2 * vt)));
    let mlp = take(2 * shape.mlp_len()).as_chunks::<2>().0.iter().map(|&b| f16::from_le_bytes(b)).collect();
    if rest.iter().any(|&byte| byte != 0) {
        return Err("padding that is not zero".to_owned());
    }
    let tile = TileParams { shape, f_uv, f_uvt, f_ut, f_vt, mlp, means };
    check(&tile)?;
    Ok(tile)
}

/// The rules on values, the same for writing and reading.
fn check(tile: &TileParams) -> Result<(), String> {
    for (map, blocks) in [("F_uv", &tile.f_uv), ("F_uvt", &tile.f_uvt)] {
        if let Some(i) = blocks.iter().position(|block| bc7::decode(block).is_err()) {
            return Err(format!("block {i} of {map} is not BC7 mode 6"));
        }
    }
    if let Some((i, w)) = tile.mlp.iter().enumerate().find(|(_, w)| !w.is_finite()) {
        return Err(format!("decoder weight {i} is {w}; expected a finite number"));
    }
    for (set, mean) in tile.means.iter().enumerate() {
        if let Some(m) = mean.iter().find(|m| !(m.is_finite() && **m >= 0.0)) {
            return Err(format!("mean of set {set} is {m}; expected a finite number ≥ 0"));
        }
    }
    Ok(())
}
