//! Colour of thermal emitters.

use glam::{DMat3, DVec3};

/// The colour temperatures [`black_body`] is meant for.
pub const KELVIN: std::ops::RangeInclusive<f64> = 1000.0..=40000.0;

/// Rec. 709 primaries and D65 (ITU-R BT.709-6), from CIE 1931 XYZ; rows are R, G, B.
const RGB_FROM_XYZ: DMat3 = DMat3::from_cols(
    DVec3::new(3.240_969_941_904_521, -0.969_243_636_280_88, 0.055_630_079_696_993_61),
    DVec3::new(-1.537_383_177_570_093, 1.875_967_501_507_72, -0.203_976_958_888_976_57),
    DVec3::new(-0.498_610_760_293, 0.041_555_057_407_175_61, 1.056_971_514_242_878_6),
);

/// Luminance of linear Rec. 709.
const LUMINANCE: DVec3 =
    DVec3::new(0.212_639_005_871_510_36, 0.715_168_678_767_756, 0.072_192_315_360_733_71);

/// Linear Rec. 709 of a black body, scaled to luminance 1. Outside the gamut (below about 1900 K) it is mixed
/// with white of the same luminance until no channel is negative. Out of [`KELVIN`], the nearest bound is
/// used.
pub fn black_body(kelvin: f64) -> DVec3 {
    let kelvin = kelvin.clamp(*KELVIN.start(), *KELVIN.end());
    // XYZ = ∫ B(λ, T) (x̄, ȳ, z̄) dλ over the visible range.
    let xyz: DVec3 =
        (360..=830).map(|nm| colour_matching(f64::from(nm)) * planck(f64::from(nm), kelvin)).sum();
    let rgb = RGB_FROM_XYZ * (xyz / xyz.y);
    // Towards white, which has luminance 1 too: the luminance stays.
    let lowest = rgb.min_element();
    let rgb = if lowest < 0.0 { DVec3::ONE + (rgb - DVec3::ONE) / (1.0 - lowest) } else { rgb };
    let rgb = rgb.max(DVec3::ZERO);
    rgb / rgb.dot(LUMINANCE)
}

/// Planck's law by wavelength in nm, up to a factor.
fn planck(nm: f64, kelvin: f64) -> f64 {
    /// h c / k in nm K.
    const C2: f64 = 1.438_776_877e7;
    (560.0 / nm).powi(5) / (C2 / (nm * kelvin)).exp_m1()
}

/// CIE 1931 2° colour matching functions by the multi-lobe fit of Wyman, Sloan & Shirley (JCGT 2(2), 2013).
fn colour_matching(nm: f64) -> DVec3 {
    let g = |mean: f64, below: f64, above: f64| {
        let t = (nm - mean) / if nm < mean { below } else { above };
        (-0.5 * t * t).exp()
    };
    DVec3::new(
        1.056 * g(599.8, 37.9, 31.0) + 0.362 * g(442.0, 16.0, 26.7) - 0.065 * g(501.1, 20.4, 26.2),
        0.821 * g(568.8, 46.9, 40.5) + 0.286 * g(530.9, 16.3, 31.1),
        1.217 * g(437.0, 11.8, 36.0) + 0.681 * g(459.0, 26.0, 13.8),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CIE x, y of the Planckian locus, computed from the CIE 1931 tables (2856 K is illuminant A).
    #[test]
    fn chromaticity_follows_the_planckian_locus() {
        let xyz_from_rgb = RGB_FROM_XYZ.inverse();
        for (kelvin, x, y) in [(2856.0, 0.4476, 0.4075), (4000.0, 0.3805, 0.3768), (6500.0, 0.3135, 0.3237)] {
            let xyz = xyz_from_rgb * black_body(kelvin);
            let sum = xyz.element_sum();
            assert!((xyz.x / sum - x).abs() < 0.003, "{kelvin} K: x = {}", xyz.x / sum);
            assert!((xyz.y / sum - y).abs() < 0.003, "{kelvin} K: y = {}", xyz.y / sum);
        }
    }

    #[test]
    fn luminance_is_one_and_no_channel_negative() {
        for kelvin in (1000..=40000).step_by(500) {
            let rgb = black_body(f64::from(kelvin));
            assert!((rgb.dot(LUMINANCE) - 1.0).abs() < 1e-9 && rgb.min_element() >= 0.0, "{kelvin} K: {rgb}");
        }
        assert!(black_body(1500.0).x > black_body(1500.0).z && black_body(20000.0).x < black_body(20000.0).z);
    }
}
