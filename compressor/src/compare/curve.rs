//! Transfer curves: what of linear light a codec with few bits gets to see.

use super::tiles::Texels;

/// A curve from light relative to its peak, in [0, 1], to code values in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Curve {
    /// The value to the power of 1 ÷ this.
    Power(f64),
    /// The logarithm of this many stops below the peak: log₂(1 + (2ᵇ − 1) x) ÷ b.
    Log(f64),
}

/// What 8-bit codecs are tried with.
#[cfg(any(test, feature = "baselines"))]
pub(super) const CURVES: [Curve; 4] =
    [Curve::Power(1.0), Curve::Power(1.5), Curve::Power(2.2), Curve::Log(8.0)];

impl Curve {
    /// The code value of light relative to its peak.
    pub(super) fn encode(self, x: f64) -> f64 {
        let x = x.clamp(0.0, 1.0);
        match self {
            Curve::Power(power) => x.powf(1.0 / power),
            Curve::Log(stops) => ((stops.exp2() - 1.0) * x).ln_1p() / (stops * std::f64::consts::LN_2),
        }
    }

    /// The inverse of [`Curve::encode`].
    pub(super) fn decode(self, y: f64) -> f64 {
        let y = y.clamp(0.0, 1.0);
        match self {
            Curve::Power(power) => y.powf(power),
            Curve::Log(stops) => ((stops * y).exp2() - 1.0) / (stops.exp2() - 1.0),
        }
    }

    /// What people call it.
    pub(super) fn name(self) -> String {
        match self {
            Curve::Power(1.0) => "linear".to_owned(),
            Curve::Power(power) => format!("power 1/{power}"),
            Curve::Log(stops) => format!("log of {stops} stops"),
        }
    }
}

/// The largest value of an image; 1 of a black one, so that one can divide by it.
pub(super) fn scale(texels: &Texels) -> f32 {
    let peak = texels.iter().flatten().fold(0.0f32, |a, &b| a.max(b));
    if peak > 0.0 { peak } else { 1.0 }
}

/// How often each curve was chosen, as in `linear 31, log of 8 stops 3`.
pub(super) fn tally(chosen: impl Iterator<Item = Curve>) -> String {
    let mut counts: Vec<(Curve, usize)> = Vec::new();
    for curve in chosen {
        match counts.iter_mut().find(|(of, _)| *of == curve) {
            Some((_, n)) => *n += 1,
            None => counts.push((curve, 1)),
        }
    }
    counts.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    counts.iter().map(|(curve, n)| format!("{} {n}", curve.name())).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_go_from_0_to_1_and_back() {
        for curve in CURVES {
            assert!(curve.encode(0.0) == 0.0 && (curve.encode(1.0) - 1.0).abs() < 1e-12);
            for i in 0..=100 {
                let x = f64::from(i) / 100.0;
                assert!((curve.decode(curve.encode(x)) - x).abs() < 1e-9, "{curve:?} {x}");
            }
            // Those that are curved give the dark more codes.
            assert!(curve == Curve::Power(1.0) || curve.encode(0.1) > 0.15);
        }
        let chosen = [CURVES[3], CURVES[0], CURVES[0]];
        assert_eq!(tally(chosen.into_iter()), "linear 2, log of 8 stops 1");
    }
}
