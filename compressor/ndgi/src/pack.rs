//! Light as the formats of textures.

use crate::half::F16;

/// Light times an exposure, as four 16-bit floats; alpha is 1.
pub fn rgba16f(light: [f32; 3], exposure: f32) -> [u16; 4] {
    let [r, g, b] = light.map(|e| F16::from_f32((e * exposure).min(65504.0)).0);
    [r, g, b, 0x3c00]
}

/// Light times an exposure, as three mantissas of 9 bits, red the lowest, and an exponent of 5.
pub fn rgb9e5(light: [f32; 3], exposure: f32) -> u32 {
    const MOST: f32 = 65408.0;
    let light = light.map(|e| (e * exposure).clamp(0.0, MOST));
    let largest = light.into_iter().fold(0.0, f32::max);
    // The exponent at which the largest is below 512 steps, from -15 on; one more where it rounds up to 512.
    let power = |exponent: i32| f32::from_bits(((exponent + 127) as u32) << 23);
    let exponent = ((largest.to_bits() >> 23) as i32 - 127).max(-16) + 1;
    let step = |exponent: i32| power(exponent - 9);
    let exponent = if (largest / step(exponent)).round() >= 512.0 { exponent + 1 } else { exponent };
    let [r, g, b] = light.map(|e| (e / step(exponent)).round() as u32);
    r | g << 9 | b << 18 | ((exponent + 15) as u32) << 27
}

/// √(light / peak), cut at 1, in 255ths; alpha is 255.
pub fn rgba8(light: [f32; 3], peak: f32) -> [u8; 4] {
    let [r, g, b] = light.map(|e| {
        let share = if e > 0.0 { e / peak } else { 0.0 };
        (share.clamp(0.0, 1.0).sqrt() * 255.0).round() as u8
    });
    [r, g, b, 255]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    #[test]
    fn shared_exponents_are_half_a_step_off_at_most() {
        let unpack = |packed: u32| {
            let step = f64::from((packed >> 27) as i32 - 15 - 9).exp2();
            [0, 9, 18].map(|shift| f64::from(packed >> shift & 511) * step)
        };
        let mut random = Random(3);
        for _ in 0..100_000 {
            let light = [0; 3].map(|_| (40.0 * random.unit() - 22.0).exp2());
            let largest = light.into_iter().fold(0.0, f32::max).min(65408.0);
            let found = unpack(rgb9e5(light, 1.0));
            // Half a step is 2⁻¹⁰ of the power of two above the largest, and 2⁻²⁵ at least.
            let half = (f64::from(largest) / 512.0).max(f64::from(-25.0f32).exp2());
            for (found, light) in found.into_iter().zip(light) {
                assert!((found - f64::from(light.min(65408.0))).abs() <= half, "{light} {found}");
            }
        }
        assert_eq!(rgb9e5([0.0; 3], 1.0), 0);
        assert_eq!(unpack(rgb9e5([1.0, 0.5, 0.25], 1.0)), [1.0, 0.5, 0.25]);
        assert_eq!(unpack(rgb9e5([f32::MAX; 3], 1.0)), [65408.0; 3]);
        assert_eq!(unpack(rgb9e5([511.9, 0.0, 0.0], 1.0)), [512.0, 0.0, 0.0]);
    }

    #[test]
    fn halves_and_bytes_are_cut_and_never_wrap() {
        assert_eq!(rgba16f([1.0, 1e9, 0.0], 1.0), [0x3c00, 0x7bff, 0, 0x3c00]);
        assert_eq!(rgba16f([0.001, 0.0, 0.0], 1000.0), [0x3c00, 0, 0, 0x3c00]);
        // Daylight is not cut at 256, and starlight is a normal number.
        let [day, night, ..] = rgba16f([255.0, 1e-6, 0.0], 256.0);
        assert!(day < 0x7bff && night >= 0x0400, "{day:x} {night:x}");
        assert_eq!(rgba8([2.0, 0.5, 0.0], 2.0), [255, 128, 0, 255]);
        assert_eq!(rgba8([2.0, f32::MAX, 0.0], 0.0), [255, 255, 0, 255]);
    }
}
