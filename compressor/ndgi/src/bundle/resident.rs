//! The resident block: what is known of every tile without reading it, how bright it is at each knot.
//!
//! A tile's line is its scale, a power of two as an f32, four zero bytes, and eight bytes a knot: the mean of
//! red, green and blue as f16 in units of the scale, the peak in steps of a fifth of an octave, the share of
//! the second frame in 255ths. Eight bytes for each light group that is apart follow: the same, its share 0.

use crate::half::F16;
use crate::model::{Brightness, Knot};

/// Bytes before the knots, and of a knot.
const WORD: usize = 8;
/// Steps of a peak in an octave; the step that stands for the scale.
const PEAK_STEPS: f32 = 5.0;
const PEAK_OF_SCALE: f32 = 130.0;

/// Length of a tile's line, with this many knots and light groups that are apart together.
pub(super) fn len(words: usize) -> usize {
    WORD * (1 + words)
}

/// The line of a tile.
///
/// # Errors
/// The value that is none of light.
pub fn encode_brightness(of: &Brightness) -> Result<Vec<u8>, String> {
    encode(&[&of.knots[..], &of.lamps].concat())
}

/// From a line, of this many knots.
pub(super) fn decode_brightness(line: &[u8], knots: usize) -> Result<Brightness, String> {
    let mut words = decode(line)?;
    let lamps = words.split_off(knots.min(words.len()));
    Ok(Brightness { knots: words, lamps })
}

/// Brightness as a line gives it back.
///
/// # Errors
/// As [`encode_brightness`].
pub fn rounded_brightness(of: &Brightness) -> Result<Brightness, String> {
    decode_brightness(&encode_brightness(of)?, of.knots.len())
}

/// Words of light as a line.
///
/// # Errors
/// The value that is none of light.
pub(super) fn encode(knots: &[Knot]) -> Result<Vec<u8>, String> {
    let values = knots.iter().flat_map(|knot| knot.mean.into_iter().chain([knot.peak]));
    if let Some(value) = values.clone().find(|value| !(value.is_finite() && *value >= 0.0)) {
        return Err(format!("a mean or peak of {value}; expected a finite number ≥ 0"));
    }
    let largest = knots.iter().flat_map(|knot| knot.mean).fold(f32::MIN_POSITIVE, f32::max);
    // The largest mean is from 2^14 to 2^15 in units of the scale: night may be 2^-29 of it in whole
    // precision.
    let exponent = (f64::from(largest).log2().floor() as i32 - 14).max(-126);
    let scale = 2f64.powi(exponent);
    let mut bytes = (scale as f32).to_le_bytes().to_vec();
    bytes.extend([0; 4]);
    for knot in knots {
        bytes.extend(knot.mean.iter().flat_map(|mean| units(*mean, scale).to_le_bytes()));
        let steps = f64::from(PEAK_STEPS) * (f64::from(knot.peak) / scale).log2() + f64::from(PEAK_OF_SCALE);
        bytes.push(if knot.peak > 0.0 { steps.ceil().clamp(1.0, 255.0) as u8 } else { 0 });
        bytes.push((255.0 * knot.share.clamp(0.0, 1.0)).round() as u8);
    }
    Ok(bytes)
}

/// A mean in units of a scale: never 0 where there is light.
fn units(mean: f32, scale: f64) -> F16 {
    let units = F16::from_f32((f64::from(mean) / scale) as f32);
    if mean > 0.0 && units == F16(0) { F16::SMALLEST } else { units }
}

/// Means as a line gives them back: what a tile is trained to.
///
/// # Errors
/// As [`encode_payload`](super::encode_payload) of such means.
pub fn rounded_means(means: &[[f32; 3]]) -> Result<Vec<[f32; 3]>, String> {
    let knots: Vec<Knot> = means.iter().map(|&mean| Knot { mean, ..Knot::default() }).collect();
    Ok(decode(&encode(&knots)?)?.iter().map(|knot| knot.mean).collect())
}

/// The knots of a line.
///
/// # Errors
/// What the format forbids.
pub(super) fn decode(line: &[u8]) -> Result<Vec<Knot>, String> {
    let (words, _) = line.as_chunks::<WORD>();
    let Some(([a, b, c, d, zeros @ ..], words)) = words.split_first() else {
        return Err("no scale".to_owned());
    };
    let scale = f32::from_le_bytes([*a, *b, *c, *d]);
    let is_power = scale.is_normal() && scale > 0.0 && scale.to_bits() & 0x007f_ffff == 0;
    if !is_power || *zeros != [0; 4] {
        return Err(format!("scale {scale}, then {zeros:?}; expected a power of two and zeros"));
    }
    let knot = |word: &[u8; WORD]| {
        let mean = |c: usize| {
            let units = F16::from_le_bytes([word[2 * c], word[2 * c + 1]]);
            match units.is_finite() && !units.is_sign_negative() {
                true => Ok((units.to_f32() * scale).min(f32::MAX)),
                false => Err(format!("a mean of {units}; expected a finite number ≥ 0")),
            }
        };
        let peak = match word[6] {
            0 => 0.0,
            step => (scale * ((f32::from(step) - PEAK_OF_SCALE) / PEAK_STEPS).exp2()).min(f32::MAX),
        };
        Ok(Knot { mean: [mean(0)?, mean(1)?, mean(2)?], peak, share: f32::from(word[7]) / 255.0 })
    };
    words.iter().map(knot).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nights_and_days_keep_their_digits() {
        for top in [f32::MAX, 1e9, 80.0, 1.0, 1e-20, 1e-37] {
            let knots: Vec<Knot> = (0..=8)
                .map(|i| {
                    let mean = 10f32.powi(-i) * top;
                    Knot { mean: [mean, 0.3 * mean, 0.0], peak: mean, share: i as f32 / 8.0 }
                })
                .collect();
            let found = decode(&encode(&knots).unwrap()).unwrap();
            for (a, b) in knots.iter().zip(&found) {
                let tiny = 2.0 * f32::MIN_POSITIVE;
                for c in 0..3 {
                    assert!((a.mean[c] - b.mean[c]).abs() <= 1e-3 * a.mean[c] + tiny, "{a:?} {b:?}");
                }
                assert!(b.peak >= 0.999 * a.peak && b.peak <= 1.16 * a.peak + tiny, "{a:?} {b:?}");
                assert!((a.share - b.share).abs() < 0.003);
            }
            // What was read is written as it was.
            assert_eq!(encode(&found).unwrap()[..8], encode(&knots).unwrap()[..8]);
        }
        assert_eq!(decode(&encode(&[Knot::default()]).unwrap()).unwrap(), [Knot::default()]);
        assert!(encode(&[Knot { peak: f32::NAN, ..Knot::default() }]).is_err());
    }

    #[test]
    fn hostile_lines_are_refused() {
        let good = encode(&[Knot { mean: [1.0, 2.0, 3.0], peak: 4.0, share: 0.5 }]).unwrap();
        assert!(decode(&good).is_ok() && decode(&good[..4]).is_err());
        for (at, patch) in [
            (0, f32::NAN.to_le_bytes()),
            (0, 3f32.to_le_bytes()),
            (0, (-2f32).to_le_bytes()),
            (4, [1, 0, 0, 0]),
            (8, [0, 0x7c, 0, 0]),
            (8, [0, 0x80, 0, 0]),
        ] {
            let mut bad = good.clone();
            bad[at..at + 4].copy_from_slice(&patch);
            assert!(decode(&bad).is_err(), "{at} {patch:?}");
        }
    }
}
