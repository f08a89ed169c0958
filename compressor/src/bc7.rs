//! BC7 mode 6, to the bit: encode endpoints and indices, decode any mode-6 block.
//!
//! Mode 6 is the one mode of BC7 whose block is exactly two 4-channel endpoints and 16 weights, which is what the
//! trainer learns. Layout of the 128 bits, least significant bit of byte 0 first (Direct3D 11 BC7 format reference):
//!
//! | bits | field |
//! |---|---|
//! | 0–6 | mode: bit 6 set, bits 0–5 clear |
//! | 7–62 | R₀ R₁ G₀ G₁ B₀ B₁ A₀ A₁, the upper 7 bits of each endpoint channel |
//! | 63, 64 | p-bits P₀, P₁: the lowest bit of all four channels of an endpoint |
//! | 65–67 | index of texel 0 without its top bit, which is 0 (the anchor rule) |
//! | 68–127 | indices of texels 1 … 15, 4 bits each; texel = x + 4 y |

use crate::{Error, Result};

/// Interpolation weights of the 16 indices, in 64ths.
pub const WEIGHTS: [u8; 16] = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];

/// One mode-6 block: 4×4 texels of four channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mode6 {
    /// Two endpoints of four 8-bit channels; the channels of one endpoint share their lowest bit, its p-bit.
    pub endpoints: [[u8; 4]; 2],
    /// Index into [`WEIGHTS`] (0 ..= 15) of texel x + 4 y.
    pub indices: [u8; 16],
}

/// The block whose texels are all 128: the middle, so that what nothing reads decodes to no extreme.
pub const GREY: Mode6 = Mode6 { endpoints: [[128; 4]; 2], indices: [0; 16] };

/// The value between two endpoint channels at a weight in 64ths: `((64 − w) e₀ + w e₁ + 32) / 64`, rounded down.
#[inline]
pub fn interpolate(e0: u8, e1: u8, weight: u8) -> u8 {
    (((64 - u32::from(weight)) * u32::from(e0) + u32::from(weight) * u32::from(e1) + 32) >> 6) as u8
}

/// The 16 texel values that a pair of endpoints can give, by index.
pub fn palette(endpoints: &[[u8; 4]; 2]) -> [[u8; 4]; 16] {
    WEIGHTS.map(|w| std::array::from_fn(|c| interpolate(endpoints[0][c], endpoints[1][c], w)))
}

impl Mode6 {
    /// The 16 texels, x + 4 y.
    pub fn texels(&self) -> [[u8; 4]; 16] {
        let palette = palette(&self.endpoints);
        self.indices.map(|i| palette[usize::from(i & 15)])
    }
}

/// Writes a block. The p-bits are taken from the first channels.
pub fn encode(block: &Mode6) -> [u8; 16] {
    debug_assert!(
        block.endpoints.iter().all(|e| e.iter().all(|c| (c ^ e[0]) & 1 == 0)),
        "channels share a p-bit"
    );
    debug_assert!(block.indices.iter().all(|&i| i < 16));
    let (mut endpoints, mut indices) = (block.endpoints, block.indices);
    // Anchor rule: texel 0 has an index below 8; the mirrored block has the same texels, since w[15 − i] = 64 − w[i].
    if indices[0] >= 8 {
        endpoints.swap(0, 1);
        indices = indices.map(|i| 15 - i);
    }
    let mut bits: u128 = 1 << 6;
    for (e, endpoint) in endpoints.iter().enumerate() {
        for (c, value) in endpoint.iter().enumerate() {
            bits |= u128::from(value >> 1) << (7 + 14 * c + 7 * e);
        }
    }
    bits |= u128::from(endpoints[0][0] & 1) << 63;
    bits |= u128::from(endpoints[1][0] & 1) << 64;
    bits |= u128::from(indices[0]) << 65;
    for (i, &index) in indices.iter().enumerate().skip(1) {
        bits |= u128::from(index) << (64 + 4 * i);
    }
    bits.to_le_bytes()
}

/// Reads the endpoints and indices of a mode-6 block.
///
/// # Errors
/// [`Error::Unsupported`] for another mode of BC7, [`Error::Invalid`] for the reserved mode (first byte 0).
pub fn unpack(block: &[u8; 16]) -> Result<Mode6> {
    match block[0].trailing_zeros() {
        6 => {}
        8 => return Err(Error::invalid("BC7 block", "first byte 0, which is reserved; expected mode 6")),
        mode => return Err(Error::unsupported("BC7 block", format!("mode {mode}; expected mode 6"))),
    }
    let bits = u128::from_le_bytes(*block);
    let field = |at: usize, width: u32| (bits >> at) as u8 & ((1u16 << width) - 1) as u8;
    let endpoint = |e: usize| std::array::from_fn(|c| field(7 + 14 * c + 7 * e, 7) << 1 | field(63 + e, 1));
    let index = |i: usize| if i == 0 { field(65, 3) } else { field(64 + 4 * i, 4) };
    Ok(Mode6 { endpoints: [endpoint(0), endpoint(1)], indices: std::array::from_fn(index) })
}

/// The 16 texels (x + 4 y) of a mode-6 block.
///
/// # Errors
/// As [`unpack`].
pub fn decode(block: &[u8; 16]) -> Result<[[u8; 4]; 16]> {
    Ok(unpack(block)?.texels())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SplitMix64: a stream of well-mixed 64-bit values.
    fn random(state: &mut u64) -> u64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn random_block(state: &mut u64, p_bits: [u8; 2]) -> Mode6 {
        let (e0, e1, indices) = (random(state), random(state), random(state));
        let endpoint = |r: u64, p: u8| std::array::from_fn(|c| ((r >> (8 * c)) as u8 & !1) | p);
        Mode6 {
            endpoints: [endpoint(e0, p_bits[0]), endpoint(e1, p_bits[1])],
            indices: std::array::from_fn(|i| (indices >> (4 * i)) as u8 & 15),
        }
    }

    #[test]
    fn blocks_decode_as_in_an_independent_decoder() {
        let mut state = 1;
        for n in 0..120_000 {
            let block = random_block(&mut state, [(n & 1) as u8, (n >> 1 & 1) as u8]);
            let bytes = encode(&block);
            let mut theirs = [0u8; 64];
            bcdec_rs::bc7(&bytes, &mut theirs, 16);
            let ours = decode(&bytes).unwrap();
            assert_eq!(ours.as_flattened(), theirs, "{block:?}");
            // The anchor rule may mirror the block, never change its texels.
            assert_eq!(ours, block.texels());
        }
    }

    #[test]
    fn every_mode_6_block_is_read_as_the_independent_decoder_reads_it() {
        let mut state = 2;
        for _ in 0..50_000 {
            let mut bytes = [0; 16];
            bytes[..8].copy_from_slice(&random(&mut state).to_le_bytes());
            bytes[8..].copy_from_slice(&random(&mut state).to_le_bytes());
            bytes[0] = bytes[0] & 0x80 | 0x40;
            let mut theirs = [0u8; 64];
            bcdec_rs::bc7(&bytes, &mut theirs, 16);
            assert_eq!(decode(&bytes).unwrap().as_flattened(), theirs);
            // Reading and writing again gives the same bytes, as texel 0 already obeys the anchor rule.
            assert_eq!(encode(&unpack(&bytes).unwrap()), bytes);
        }
    }

    #[test]
    fn other_modes_are_errors() {
        for mode in [0, 1, 2, 3, 4, 5, 7] {
            let mut bytes = [0xa5; 16];
            bytes[0] = 1 << mode;
            assert!(matches!(decode(&bytes), Err(Error::Unsupported { .. })), "mode {mode}");
        }
        assert!(matches!(decode(&[0; 16]), Err(Error::Invalid { .. })));
    }

    #[test]
    fn palette_runs_from_endpoint_to_endpoint() {
        let endpoints = [[3, 255, 17, 91], [250, 0, 36, 90]];
        let palette = palette(&endpoints);
        assert_eq!([palette[0], palette[15]], endpoints);
        assert_eq!(palette[8][1], 120); // ((64 − 34) 255 + 32) / 64 = 120.03
    }
}
