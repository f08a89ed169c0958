//! The inverse cosine transform of 8×8 blocks in whole numbers, so that all readers give the same planes.

use super::coefficients::BLOCK;

/// Units of a plane in a step of its coefficients.
pub const UNITS: f32 = 16.0;

/// √(1/8) for k = 0, else ½, times cos((2n + 1) k π/16), in 1/4096, by k, n.
pub(super) const COSINES: [[i32; 8]; 8] = [
    [1448, 1448, 1448, 1448, 1448, 1448, 1448, 1448],
    [2009, 1703, 1138, 400, -400, -1138, -1703, -2009],
    [1892, 784, -784, -1892, -1892, -784, 784, 1892],
    [1703, -400, -2009, -1138, 1138, 2009, 400, -1703],
    [1448, -1448, -1448, 1448, 1448, -1448, -1448, 1448],
    [1138, -2009, 400, 1703, -1703, -400, 2009, -1138],
    [784, -1892, 1892, -784, -784, 1892, -1892, 784],
    [400, -1138, 1703, -2009, 2009, -1703, 1138, -400],
];

/// Largest value between the two passes, so that the second fits 32 bits.
const BETWEEN: i32 = (1 << 17) - 1;

/// A block's values, 16 units to a step of its coefficients, row by row.
#[inline(always)]
pub(super) fn inverse(coefficients: &[i16; BLOCK]) -> [[i16; 8]; 8] {
    let (rows, _) = coefficients.as_chunks::<8>();
    // Down the columns: by row of texels, horizontal frequency.
    let mut between = [[0i32; 8]; 8];
    let mut highest = 0;
    for (v, row) in rows.iter().enumerate() {
        if *row == [0; 8] {
            continue;
        }
        for (u, value) in row.iter().enumerate() {
            if *value != 0 {
                highest = highest.max(u);
            }
        }
        for (out, cosine) in between.iter_mut().zip(COSINES[v]) {
            for (out, value) in out.iter_mut().zip(row) {
                *out += cosine * i32::from(*value);
            }
        }
    }
    for value in between.as_flattened_mut() {
        *value = ((*value + 128) >> 8).clamp(-BETWEEN, BETWEEN);
    }
    between.map(|row| {
        let mut out = [1 << 11; 8];
        for (value, cosines) in row.iter().zip(&COSINES).take(highest + 1) {
            for (out, cosine) in out.iter_mut().zip(cosines) {
                *out += cosine * value;
            }
        }
        out.map(|value| (value >> 12).clamp(-32767, 32767) as i16)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    #[test]
    fn cosines_are_those_of_the_formula() {
        for (k, row) in COSINES.iter().enumerate() {
            for (n, found) in row.iter().enumerate() {
                let scale = if k == 0 { 0.125f64.sqrt() } else { 0.5 };
                let exact = (std::f64::consts::PI * ((2 * n + 1) * k) as f64 / 16.0).cos() * scale * 4096.0;
                assert!((exact - f64::from(*found)).abs() < 0.51, "{k} {n}: {exact}");
            }
        }
    }

    #[test]
    fn blocks_are_those_of_the_real_transform_and_never_overflow() {
        let mut random = Random(3);
        for size in [1, 3, 40, 300] {
            for _ in 0..200 {
                let block: [i16; 64] = std::array::from_fn(|_| match random.below(3) {
                    0 => random.below(2 * size + 1) as i16 - size as i16,
                    _ => 0,
                });
                let found = inverse(&block);
                let cosine = |k: usize, n: usize| f64::from(COSINES[k][n]) / 4096.0;
                for (y, row) in found.iter().enumerate() {
                    for (x, found) in row.iter().enumerate() {
                        let term = |i: usize| f64::from(block[i]) * cosine(i / 8, y) * cosine(i % 8, x);
                        let exact: f64 = 16.0 * (0..64).map(term).sum::<f64>();
                        assert!((f64::from(*found) - exact).abs() < 1.6, "{exact} {found}");
                    }
                }
            }
        }
        for sign in [1, -1] {
            assert_eq!(inverse(&[sign * i16::MAX; 64])[0][0], sign * 32767);
            let signs: [i16; 64] = std::array::from_fn(|i| {
                sign * (COSINES[i / 8][7].signum() * COSINES[i % 8][7].signum()) as i16 * i16::MAX
            });
            assert_eq!(inverse(&signs)[7][7], sign * 32767);
        }
    }
}
