//! Numbers of 16 bits, IEEE 754 binary16: what weights and means are stored in.

/// A binary16. Decoded 16-bit floats ([`Tile::decode_rgba16f`](crate::at::Tile::decode_rgba16f)) are the bits
/// of such numbers, as `u16`: [`F16::from_bits`] makes a number of them.
///
/// ```
/// use ndgi::half::F16;
///
/// assert_eq!(F16::from_bits(0x3c00).to_f32(), 1.0);
/// assert_eq!(F16::from_f32(0.1).to_f32(), 0.099975586);
/// assert_eq!(F16::from_f32(1e9), F16::INFINITY);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct F16(pub u16);

impl F16 {
    /// The largest finite one, 65504.
    pub const MAX: F16 = F16(0x7bff);
    /// The least finite one.
    pub const MIN: F16 = F16(0xfbff);
    /// The smallest above 0, 2⁻²⁴.
    pub const SMALLEST: F16 = F16(1);
    /// Infinity.
    pub const INFINITY: F16 = F16(0x7c00);

    /// The number of these bits.
    pub const fn from_bits(bits: u16) -> Self {
        F16(bits)
    }

    /// Its bits.
    pub const fn to_bits(self) -> u16 {
        self.0
    }

    /// The nearest one, of two as near the even one; beyond the largest, infinity.
    pub fn from_f32(value: f32) -> Self {
        let bits = value.to_bits();
        let (sign, magnitude) = ((bits >> 16 & 0x8000) as u16, bits & 0x7fff_ffff);
        let half = match magnitude {
            0x7f80_0001.. => 0x7e00,
            // From half-way between the largest and the next power of two on.
            0x477f_f000.. => 0x7c00,
            // A float's exponent is 112 more; what is cut off rounds.
            0x3880_0000.. => {
                let even = magnitude >> 13 & 1;
                (((magnitude - (112 << 23)) + 0xfff + even) >> 13) as u16
            }
            // Below the smallest normal one in steps of 2^-24, which adding a half makes the last bits of a
            // float.
            _ => ((f32::from_bits(magnitude) + 0.5).to_bits() - 0.5f32.to_bits()) as u16,
        };
        F16(sign | half)
    }

    /// The same number.
    pub fn to_f32(self) -> f32 {
        let (sign, magnitude) = (u32::from(self.0 & 0x8000) << 16, u32::from(self.0 & 0x7fff));
        let value = match magnitude {
            0x7c00.. => magnitude << 13 | 0x7f80_0000,
            0x400.. => (magnitude << 13) + (112 << 23),
            _ => (magnitude as f32 * f32::from_bits((127 - 24) << 23)).to_bits(),
        };
        f32::from_bits(sign | value)
    }

    /// Two bytes, the lower one first.
    pub fn to_le_bytes(self) -> [u8; 2] {
        self.0.to_le_bytes()
    }

    /// From two bytes, the lower one first.
    pub fn from_le_bytes(bytes: [u8; 2]) -> Self {
        F16(u16::from_le_bytes(bytes))
    }

    /// Whether its sign is minus, that of −0 too.
    pub fn is_sign_negative(self) -> bool {
        self.0 & 0x8000 != 0
    }

    /// Whether it is neither infinite nor not a number.
    pub fn is_finite(self) -> bool {
        self.0 & 0x7c00 != 0x7c00
    }
}

impl std::fmt::Display for F16 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.to_f32().fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::F16;
    use half::f16;

    #[test]
    fn all_numbers_are_those_of_the_crate_half() {
        for bits in 0..=u16::MAX {
            let (ours, theirs) = (F16(bits).to_f32(), f16::from_bits(bits).to_f32());
            assert!(ours.to_bits() == theirs.to_bits() || ours.is_nan() && theirs.is_nan(), "{bits:#x}");
            assert_eq!(F16(bits).is_finite(), f16::from_bits(bits).is_finite(), "{bits:#x}");
        }
    }

    #[test]
    fn all_floats_round_as_in_the_crate_half() {
        let same = |bits: u32| {
            let value = f32::from_bits(bits);
            let (ours, theirs) = (F16::from_f32(value), f16::from_f32(value));
            assert!(ours.0 == theirs.to_bits() || value.is_nan() && !ours.is_finite(), "{value:e}");
        };
        // Around each value of 16 bits and half-way to the next; and some in between.
        for half in 0..=u16::MAX {
            let (at, next) = (f16::from_bits(half).to_f32(), f16::from_bits(half.wrapping_add(1)).to_f32());
            for centre in [at.to_bits(), ((at + next) / 2.0).to_bits()] {
                (-2..=2).for_each(|step| same(centre.wrapping_add_signed(step)));
            }
        }
        (0..=u32::MAX).step_by(10_007).for_each(same);
    }
}
