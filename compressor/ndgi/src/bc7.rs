//! BC7 modes 6 and 4, to the bit: encode endpoints and indices, decode any block of these modes.
//!
//! Mode 6 is two 4-channel endpoints and 16 weights, which is what the trainer learns. Mode 4 gives one
//! channel indices of its own, at coarser endpoints. Layout of the 128 bits, least significant bit of byte 0
//! first (Direct3D 11 BC7 format reference):
//!
//! | mode 6 | field |
//! |---|---|
//! | 0–6 | mode: bit 6 set, bits 0–5 clear |
//! | 7–62 | R₀ R₁ G₀ G₁ B₀ B₁ A₀ A₁, the upper 7 bits of each endpoint channel |
//! | 63, 64 | p-bits P₀, P₁: the lowest bit of all four channels of an endpoint |
//! | 65–67 | index of texel 0 without its top bit, which is 0 (the anchor rule) |
//! | 68–127 | indices of texels 1 … 15, 4 bits each; texel = x + 4 y |
//!
//! | mode 4 | field |
//! |---|---|
//! | 0–4 | mode: bit 4 set, bits 0–3 clear |
//! | 5, 6 | rotation: 0, or 1 … 3 if channel 0 … 2 is exchanged with channel 3 after decoding |
//! | 7 | which indices channel 3 has: 0 those of three bits, 1 those of two; the others have the other ones |
//! | 8–37 | R₀ R₁ G₀ G₁ B₀ B₁, 5 bits each |
//! | 38–49 | A₀ A₁, 6 bits each |
//! | 50–80 | indices of two bits, that of texel 0 without its top bit |
//! | 81–127 | indices of three bits, likewise |

use crate::{Error, Result};

/// Interpolation weights of the indices of two, three and four bits, in 64ths.
const WEIGHTS: [&[u8]; 3] = [
    &[0, 21, 43, 64],
    &[0, 9, 18, 27, 37, 46, 55, 64],
    &[0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64],
];
/// Most values that a block's texels can choose from.
pub const MOST_VALUES: usize = 32;

/// How a block is coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// All channels share indices of four bits.
    Six,
    /// One channel has indices of its own.
    Four {
        /// That channel.
        alone: u8,
        /// It has those of two bits, the other channels those of three; otherwise the other way round.
        coarse: bool,
    },
}

impl Mode {
    /// Every form of mode 4.
    pub const FOURS: [Mode; 8] = {
        let mut all = [Mode::Six; 8];
        let mut i = 0;
        while i < 8 {
            all[i as usize] = Mode::Four { alone: i / 2, coarse: i % 2 == 1 };
            i += 1;
        }
        all
    };

    /// How many values a texel can choose from.
    pub fn values(self) -> usize {
        match self {
            Mode::Six => 16,
            Mode::Four { .. } => MOST_VALUES,
        }
    }

    /// The weights of the four channels at an index, in 64ths. In mode 4 the lower bits of the index are
    /// those of the channel alone.
    #[inline(always)]
    pub fn weights(self, index: u8) -> [u8; 4] {
        let i = usize::from(index);
        match self {
            Mode::Six => [WEIGHTS[2][i & 15]; 4],
            Mode::Four { alone, coarse } => {
                let (others, own) = if coarse {
                    (WEIGHTS[1][i >> 2 & 7], WEIGHTS[0][i & 3])
                } else {
                    (WEIGHTS[0][i >> 3 & 3], WEIGHTS[1][i & 7])
                };
                std::array::from_fn(|c| if c == usize::from(alone) { own } else { others })
            }
        }
    }

    /// Bits of an endpoint's channel, a p-bit counted in.
    pub fn bits(self, channel: usize) -> u32 {
        match self {
            Mode::Six => 8,
            Mode::Four { alone, .. } => {
                if usize::from(alone) == channel {
                    6
                } else {
                    5
                }
            }
        }
    }
}

/// A level of this many bits (5 to 8) as a byte: its upper bits are repeated below.
pub fn expand(level: u8, bits: u32) -> u8 {
    let high = u32::from(level) << (8 - bits);
    (high | high >> bits) as u8
}

/// One block: 4×4 texels of four channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// How it is coded.
    pub mode: Mode,
    /// Two endpoints of four 8-bit channels. In mode 6 the channels of one endpoint share their lowest bit,
    /// its p-bit; in mode 4 they are expanded levels of [`Mode::bits`].
    pub endpoints: [[u8; 4]; 2],
    /// Index of texel x + 4 y, below [`Mode::values`].
    pub indices: [u8; 16],
}

/// The block whose texels are all 128: the middle, so that what nothing reads decodes to no extreme.
pub const GREY: Block = Block { mode: Mode::Six, endpoints: [[128; 4]; 2], indices: [0; 16] };

/// The value between two endpoint channels at a weight in 64ths: `((64 − w) e₀ + w e₁ + 32) / 64`, rounded
/// down.
#[inline]
pub fn interpolate(e0: u8, e1: u8, weight: u8) -> u8 {
    (((64 - u32::from(weight)) * u32::from(e0) + u32::from(weight) * u32::from(e1) + 32) >> 6) as u8
}

/// The texel values that a pair of endpoints can give, by index; the first [`Mode::values`] count.
#[inline(always)]
pub fn palette(mode: Mode, endpoints: &[[u8; 4]; 2]) -> [[u8; 4]; MOST_VALUES] {
    let mut palette = [[0; 4]; MOST_VALUES];
    for (i, value) in (0..).zip(&mut palette[..mode.values()]) {
        let w = mode.weights(i);
        *value = std::array::from_fn(|c| interpolate(endpoints[0][c], endpoints[1][c], w[c]));
    }
    palette
}

impl Block {
    /// The 16 values of each channel, x + 4 y: what [`interpolate`] gives at [`Mode::weights`], sixteen at a
    /// time.
    #[inline(always)]
    pub fn planes(&self) -> [[u8; 16]; 4] {
        let (alone, own, others) = match self.mode {
            Mode::Six => {
                let all = sixty_fourths::<4>(&self.indices, 0);
                (3, all, all)
            }
            Mode::Four { alone, coarse: true } => {
                (alone, sixty_fourths::<2>(&self.indices, 0), sixty_fourths::<3>(&self.indices, 2))
            }
            Mode::Four { alone, coarse: false } => {
                (alone, sixty_fourths::<3>(&self.indices, 0), sixty_fourths::<2>(&self.indices, 3))
            }
        };
        let mut planes = [[0; 16]; 4];
        for (c, plane) in planes.iter_mut().enumerate() {
            let [e0, e1] = [i16::from(self.endpoints[0][c]), i16::from(self.endpoints[1][c])];
            let weights = if c == usize::from(alone) { &own } else { &others };
            for (value, w) in plane.iter_mut().zip(weights) {
                *value = ((64 * e0 + w * (e1 - e0) + 32) >> 6) as u8;
            }
        }
        planes
    }

    /// The 16 texels, x + 4 y.
    #[inline]
    pub fn texels(&self) -> [[u8; 4]; 16] {
        let planes = self.planes();
        let mut texels = [[0; 4]; 16];
        for (i, texel) in texels.iter_mut().enumerate() {
            for c in 0..4 {
                texel[c] = planes[c][i];
            }
        }
        texels
    }
}

/// The [`WEIGHTS`] of this many bits of indices from a bit on: their share of the highest index in 64ths,
/// rounded.
#[inline(always)]
fn sixty_fourths<const BITS: u32>(indices: &[u8; 16], from: u32) -> [i16; 16] {
    let top = (1u16 << BITS) - 1;
    // A division by `top` of what is below 1024, as a multiplication.
    let inverse = u32::from(u16::MAX / top) + 1;
    let mut weights = [0; 16];
    for (weight, index) in weights.iter_mut().zip(indices) {
        let rounded = 64 * (u16::from(index >> from) & top) + top / 2;
        *weight = ((u32::from(rounded) * inverse) >> 16) as i16;
    }
    weights
}

/// Appends fields to 128 bits, the lowest first.
struct Bits {
    bits: u128,
    at: u32,
}

impl Bits {
    fn push(&mut self, value: u8, width: u32) {
        self.bits |= u128::from(value) << self.at;
        self.at += width;
    }

    /// Indices of this many bits; texel 0 lacks its top bit.
    fn push_indices(&mut self, indices: &[u8; 16], width: u32) {
        self.push(indices[0], width - 1);
        indices[1..].iter().for_each(|&index| self.push(index, width));
    }
}

/// Anchor rule: the index of texel 0 has no top bit. The mirrored block has the same texels, since w[n − 1 −
/// i] = 64 − w[i].
fn anchor(indices: &mut [u8; 16], width: u32, swap: impl FnOnce()) {
    if indices[0] >> (width - 1) == 1 {
        *indices = indices.map(|i| (1 << width) - 1 - i);
        swap();
    }
}

/// Writes a block. Of endpoints only the bits are taken that the mode has; p-bits from the first channels.
pub fn encode(block: &Block) -> [u8; 16] {
    debug_assert!(block.indices.iter().all(|&i| usize::from(i) < block.mode.values()));
    let mut ends = block.endpoints;
    let mut out = Bits { bits: 0, at: 0 };
    match block.mode {
        Mode::Six => {
            debug_assert!(
                ends.iter().all(|e| e.iter().all(|c| (c ^ e[0]) & 1 == 0)),
                "channels share a p-bit"
            );
            let mut indices = block.indices;
            anchor(&mut indices, 4, || ends.swap(0, 1));
            out.push(1 << 6, 7);
            (0..4).for_each(|c| ends.iter().for_each(|e| out.push(e[c] >> 1, 7)));
            ends.iter().for_each(|e| out.push(e[0] & 1, 1));
            out.push_indices(&indices, 4);
        }
        Mode::Four { alone, coarse } => {
            // Channel 3 is the one alone as long as the block is coded.
            ends.iter_mut().for_each(|e| e.swap(usize::from(alone), 3));
            let own_bits = if coarse { 2 } else { 3 };
            let mut own = block.indices.map(|i| i & ((1 << own_bits) - 1));
            let mut others = block.indices.map(|i| i >> own_bits);
            let [mut e0, mut e1] = ends;
            anchor(&mut others, 5 - own_bits, || (0..3).for_each(|c| std::mem::swap(&mut e0[c], &mut e1[c])));
            anchor(&mut own, own_bits, || std::mem::swap(&mut e0[3], &mut e1[3]));
            out.push(1 << 4, 5);
            out.push((alone + 1) % 4, 2);
            out.push(u8::from(coarse), 1);
            for c in 0..4 {
                let bits = if c == 3 { 6 } else { 5 };
                [e0, e1].iter().for_each(|e| out.push(e[c] >> (8 - bits), bits));
            }
            let [two, three] = if coarse { [own, others] } else { [others, own] };
            out.push_indices(&two, 2);
            out.push_indices(&three, 3);
        }
    }
    out.bits.to_le_bytes()
}

/// Whether a block is of the modes that there are.
///
/// # Errors
/// [`Error::Unsupported`] for another mode of BC7, [`Error::Invalid`] for the reserved mode (first byte 0).
#[inline]
pub fn check(block: &[u8; 16]) -> Result<()> {
    match block[0].trailing_zeros() {
        4 | 6 => Ok(()),
        8 => Err(Error::invalid("BC7 block", "first byte 0, which is reserved; expected mode 4 or 6")),
        mode => Err(Error::unsupported("BC7 block", format!("mode {mode}; expected mode 4 or 6"))),
    }
}

/// Reads a block.
///
/// # Errors
/// As [`check`].
#[inline(always)]
pub fn unpack(block: &[u8; 16]) -> Result<Block> {
    check(block)?;
    let bits = u128::from_le_bytes(*block);
    // (Shifts by constants: places that depend on the block make all of decoding a fifth slower.)
    let field = |at: u32, width: u32| (bits >> at) as u8 & ((1u16 << width) - 1) as u8;
    let mut endpoints = [[0; 4]; 2];
    if block[0].trailing_zeros() == 6 {
        for (i, at) in (0..8).zip((7..).step_by(7)) {
            endpoints[i % 2][i / 2] = field(at, 7) << 1 | field(63 + i as u32 % 2, 1);
        }
        return Ok(Block { mode: Mode::Six, endpoints, indices: indices((bits >> 65) as u64, 4) });
    }
    let alone = (field(5, 2) + 3) % 4;
    let coarse = field(7, 1) == 1;
    for (i, at) in (0..6).zip((8..).step_by(5)) {
        endpoints[i % 2][i / 2] = expand(field(at, 5), 5);
    }
    for (e, at) in endpoints.iter_mut().zip([38, 44]) {
        e[3] = expand(field(at, 6), 6);
        e.swap(usize::from(alone), 3);
    }
    let (two, three) = (indices((bits >> 50) as u64 & 0x7fff_ffff, 2), indices((bits >> 81) as u64, 3));
    let mut all = [0; 16];
    for (i, index) in all.iter_mut().enumerate() {
        *index = if coarse { three[i] << 2 | two[i] } else { two[i] << 3 | three[i] };
    }
    Ok(Block { mode: Mode::Four { alone, coarse }, endpoints, indices: all })
}

/// Indices of this many bits, of which texel 0 lacks its top bit, and nothing above them.
#[inline(always)]
fn indices(bits: u64, width: u32) -> [u8; 16] {
    let low = (1 << (width - 1)) - 1;
    let bits = (bits & !low) << 1 | bits & low;
    let mut indices = [0; 16];
    for (index, at) in indices.iter_mut().zip((0..).step_by(width as usize)) {
        *index = (bits >> at) as u8 & ((1 << width) - 1);
    }
    indices
}

/// The 16 texels (x + 4 y) of a block.
///
/// # Errors
/// As [`check`].
#[inline]
pub fn decode(block: &[u8; 16]) -> Result<[[u8; 4]; 16]> {
    Ok(unpack(block)?.texels())
}

#[cfg(test)]
#[path = "bc7_tests.rs"]
mod tests;
