//! The 8-bit four-channel output of a decoder.

/// The 8-bit four-channel output that a decoder writes to a texture: three mantissas and a shared exponent
/// (Ward, "Real Pixels", Graphics Gems II): with e the least exponent for which
/// `round(256 · max / 2^e) ≤ 255`, the bytes are `round(256 · c / 2^e)` and `e + 128`. Smaller than 2⁻¹²⁸ is
/// black.
pub fn to_rgbe(texel: [f32; 3]) -> [u8; 4] {
    let texel = texel.map(f64::from);
    let max = texel.into_iter().fold(0.0, f64::max);
    if max < 2f64.powi(-128) {
        return [0; 4];
    }
    // floor(log₂ max) + 1, one more where the largest mantissa would round to 256.
    let mut exponent = max.log2().floor() as i32 + 1;
    if (256.0 * max / 2f64.powi(exponent)).round() > 255.0 {
        exponent += 1;
    }
    let exponent = exponent.clamp(-127, 127);
    let [r, g, b] = texel.map(|c| (256.0 * c / 2f64.powi(exponent)).round().clamp(0.0, 255.0) as u8);
    [r, g, b, (exponent + 128) as u8]
}

/// The value of four bytes of [`to_rgbe`]: `c / 256 · 2^(e − 128)`; black for e = 0.
pub fn from_rgbe([r, g, b, e]: [u8; 4]) -> [f32; 3] {
    if e == 0 {
        return [0.0; 3];
    }
    let scale = 2f64.powi(i32::from(e) - 128 - 8);
    [r, g, b].map(|c| (f64::from(c) * scale) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_exponents_keep_eight_bits_of_the_largest_channel() {
        let mut x = 1e-30f32;
        while x < 1e30 {
            let texel = [x, 0.3 * x, 0.0];
            let [r, g, b] = from_rgbe(to_rgbe(texel));
            assert!(
                (r - x).abs() <= x / 256.0 * 1.01 && (g - 0.3 * x).abs() <= x / 256.0 * 1.01 && b == 0.0,
                "{x}"
            );
            x *= 1.37;
        }
        for exact in [[0.0; 3], [1.0, 0.5, 0.25], [255.0, 1.0, 3.0], [0.99609375, 0.0, 0.00390625]] {
            assert_eq!(from_rgbe(to_rgbe(exact)), exact);
        }
        assert!(from_rgbe(to_rgbe([f32::MAX; 3])).iter().all(|v| v.is_finite()));
        // 255.9/256 would round to 256: the exponent gives way.
        assert_eq!(from_rgbe(to_rgbe([0.9999, 0.0, 0.0]))[0], 1.0);
    }
}
