//! Real spherical harmonics of bands 0 to 3, and their parts: the skies that a scene's transfer is baked
//! under.
//!
//! Light is linear and never negative, so each function is baked as max(Y, 0) and, where it has one, max(−Y,
//! 0).

use dataset::format::TransferPart;
use glam::Vec3;

/// Bands 0 to 3.
pub const FUNCTIONS: usize = 16;

/// The function l = 1, m = 0, which goes with the height of a direction.
const HEIGHT: usize = 2;
/// Hours from one part to the next: they are told apart by their hours, as other skies are.
const STEP: f64 = 0.5;

/// One part of one function.
#[derive(Clone, Copy, Debug)]
pub struct Harmonic {
    /// Which part.
    pub part: TransferPart,
    /// Black below the horizon.
    pub upper: bool,
}

impl Harmonic {
    /// Radiance from a direction, of which all functions are known.
    #[inline]
    pub fn radiance(&self, values: &[f32; FUNCTIONS], direction: Vec3) -> f32 {
        if self.upper && direction.y < 0.0 {
            return 0.0;
        }
        let value = values[self.part.function as usize];
        let signed = if self.part.negative { -value } else { value };
        signed.max(0.0)
    }
}

/// The parts that are not black, by function; `upper`: of the functions above the horizon alone.
pub fn parts(upper: bool) -> Vec<TransferPart> {
    let has = |function: usize, negative: bool| !negative || !(function == 0 || upper && function == HEIGHT);
    let part = |i: usize| TransferPart { function: i as u32 / 2, negative: i % 2 == 1 };
    (0..2 * FUNCTIONS).filter(|i| has(i / 2, i % 2 == 1)).map(part).collect()
}

/// The hours that the parts stand at, in their order.
pub fn hours(upper: bool) -> Vec<f64> {
    (0..parts(upper).len()).map(|i| STEP * i as f64).collect()
}

/// The part that stands at an hour.
pub fn part_at(upper: bool, hour: f64) -> Option<TransferPart> {
    parts(upper).get((hour / STEP).round() as usize).copied()
}

/// What a part is called: `harmonic 2, -1, negative`, its band and its order.
pub fn name(part: TransferPart) -> String {
    let band = part.function.isqrt();
    let order = i64::from(part.function) - i64::from(band * (band + 1));
    format!("harmonic {band}, {order}, {}", if part.negative { "negative" } else { "positive" })
}

/// All functions in a unit direction; function l² + l + m has band l and order m. The polar axis is +Y.
#[rustfmt::skip]
pub fn harmonics(direction: Vec3) -> [f32; FUNCTIONS] {
    let Vec3 { x, y, z } = direction;
    // The associated Legendre polynomials of y without their powers of the sine, which go with cos mφ and sin
    // mφ as polynomials of x and z; the factors are √((2l+1)/4π · (l−m)!/(l+m)!), √2 times that where m is
    // not 0.
    let (cos2, sin2) = (x * x - z * z, 2.0 * x * z);
    let (cos3, sin3) = (x * cos2 - z * sin2, z * cos2 + x * sin2);
    let (p21, p31, p32) = (3.0 * y, 1.5 * (5.0 * y * y - 1.0), 15.0 * y);
    [
        0.282_094_79,
        0.488_602_51 * z, 0.488_602_51 * y, 0.488_602_51 * x,
        0.546_274_2 * sin2, 0.364_182_8 * p21 * z, 0.630_783_1 * 0.5 * (3.0 * y * y - 1.0),
        0.364_182_8 * p21 * x, 0.546_274_2 * cos2,
        0.590_043_6 * sin3, 0.096_353_73 * p32 * sin2, 0.304_697_2 * p31 * z,
        0.746_352_7 * 0.5 * y * (5.0 * y * y - 3.0),
        0.304_697_2 * p31 * x, 0.096_353_73 * p32 * cos2, 0.590_043_6 * cos3,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_called_by_band_and_order() {
        let called = |function: u32, negative: bool| name(TransferPart { function, negative });
        assert_eq!(called(0, false), "harmonic 0, 0, positive");
        assert_eq!(called(5, true), "harmonic 2, -1, negative");
        assert_eq!(called(15, false), "harmonic 3, 3, positive");
    }
    use std::f64::consts::{PI, TAU};

    /// ∫ f over the sphere: 128 rings of equal height, as many directions each.
    fn integral(f: impl Fn(Vec3) -> f64) -> f64 {
        let (rings, around) = (128, 128);
        let direction = |i: usize| {
            let y = 2.0 * ((i / around) as f64 + 0.5) / rings as f64 - 1.0;
            let (sin, cos) = ((i % around) as f64 * TAU / around as f64).sin_cos();
            let r = (1.0 - y * y).sqrt();
            Vec3::new((r * cos) as f32, y as f32, (r * sin) as f32)
        };
        (0..rings * around).map(|i| f(direction(i))).sum::<f64>() * 4.0 * PI / (rings * around) as f64
    }

    #[test]
    fn the_functions_are_orthonormal() {
        for i in 0..FUNCTIONS {
            for j in 0..=i {
                let product = |d: Vec3| f64::from(harmonics(d)[i]) * f64::from(harmonics(d)[j]);
                let expected = f64::from(u8::from(i == j));
                assert!((integral(product) - expected).abs() < 3e-3, "{i} {j}: {}", integral(product));
            }
        }
    }

    #[test]
    fn a_function_is_the_difference_of_its_parts_and_each_part_shines() {
        for upper in [false, true] {
            let parts = parts(upper);
            assert_eq!(parts.len(), if upper { 30 } else { 31 });
            assert_eq!(hours(upper).len(), parts.len());
            assert!(hours(upper).iter().zip(&parts).all(|(hour, part)| part_at(upper, *hour) == Some(*part)));
            assert_eq!(part_at(upper, 16.0), None);
            let light =
                |part: &TransferPart, d: Vec3| Harmonic { part: *part, upper }.radiance(&harmonics(d), d);
            for part in &parts {
                assert!(integral(|d| f64::from(light(part, d))) > 0.05, "{part:?}");
            }
            for d in [Vec3::new(0.48, 0.6, -0.64), Vec3::new(-0.36, -0.48, 0.8), Vec3::Y, Vec3::NEG_X] {
                let mut sums = [0.0; FUNCTIONS];
                for part in &parts {
                    let sign = if part.negative { -1.0 } else { 1.0 };
                    sums[part.function as usize] += sign * light(part, d);
                }
                let is_dark = upper && d.y < 0.0;
                assert_eq!(sums, if is_dark { [0.0; FUNCTIONS] } else { harmonics(d) });
            }
        }
    }
}
