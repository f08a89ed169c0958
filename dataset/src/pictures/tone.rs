//! From light to what a screen shows: how the pictures of a scene are exposed.

/// What the log-average luminance of the surfaces becomes by default: middle grey.
const MIDDLE_GREY: f64 = 0.18;
/// Where the tone curve leaves the straight line.
const KNEE: f32 = 0.7;

/// Rec. 709 luminance.
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// The exposure that suits pixels of these luminances, as a power of two: their log-average becomes middle
/// grey, or less where the 95th percentile would come out above 1; 0 where all are black.
pub fn automatic_exposure(luminances: impl Iterator<Item = f32>) -> f64 {
    /// What is darker than this share of the mean counts as it: black corners do not burn out the rest.
    const DARKEST: f64 = 0.01;
    let mut luminances: Vec<f64> = luminances.map(f64::from).collect();
    let n = luminances.len().max(1) as f64;
    let mean = luminances.iter().sum::<f64>() / n;
    if mean <= 0.0 || !mean.is_finite() {
        return 0.0;
    }
    let log_average = luminances.iter().map(|l| l.max(DARKEST * mean).log2()).sum::<f64>() / n;
    let bright = (luminances.len() - 1) * 95 / 100;
    let (_, bright, _) = luminances.select_nth_unstable_by(bright, f64::total_cmp);
    (MIDDLE_GREY.log2() - log_average).min(-bright.max(DARKEST * mean).log2())
}

/// The 8-bit sRGB code of exposed light: linear up to the knee, then towards 1 without reaching it.
pub fn code(exposed: f32) -> u8 {
    bent_code(exposed, KNEE)
}

/// The same with another knee.
pub fn bent_code(exposed: f32, knee: f32) -> u8 {
    let shown = match exposed <= knee {
        true => exposed.max(0.0),
        false => 1.0 - (1.0 - knee) * (-(exposed - knee) / (1.0 - knee)).exp(),
    };
    // IEC 61966-2-1.
    let code = if shown <= 0.003_130_8 { 12.92 * shown } else { 1.055 * shown.powf(1.0 / 2.4) - 0.055 };
    (code * 255.0).round() as u8
}

/// What a screen shows for an 8-bit sRGB code, linear in light, 1 being white.
pub fn linear(code: u8) -> f32 {
    // IEC 61966-2-1.
    let code = f64::from(code) / 255.0;
    (if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_linear_below_its_knee_and_never_above_white() {
        // sRGB of 0.18 is 0.4614, of 0.5 is 0.7354, of 0.7 is 0.8545; 1 becomes 1 − 0.3 e⁻¹ = 0.8896, whose
        // sRGB is 0.9498.
        let expected =
            [(-1.0, 0), (0.0, 0), (0.001, 3), (0.18, 118), (0.5, 188), (0.7, 218), (1.0, 242), (1e9, 255)];
        for (exposed, shown) in expected {
            assert_eq!(code(exposed), shown, "{exposed}");
        }
    }

    #[test]
    fn the_log_average_becomes_middle_grey_and_the_brightest_stay_below_white() {
        let check = |values: &'static [f32], expected: f64| {
            let found = automatic_exposure(values.iter().copied());
            assert!((found - expected).abs() < 1e-6, "{values:?}: {found}");
        };
        // The log-average of 1 and 4 is 2: 2 · 2^EV = 0.18.
        check(&[1.0, 4.0], 0.09f64.log2());
        // Black counts as a hundredth of the mean, here of 1: a log-average of √(2 · 0.01).
        check(&[0.0, 2.0], (0.18 / 0.02f64.sqrt()).log2());
        // Three of ten a hundred times as bright: a log-average of 100^0.3 would make them 4.5.
        check(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 100.0, 100.0, 100.0], 0.01f64.log2());
        check(&[0.0], 0.0);
        check(&[], 0.0);
    }
}
