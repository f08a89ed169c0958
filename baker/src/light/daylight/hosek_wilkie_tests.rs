//! The model against another implementation of it.

use super::*;

/// What the crates.io package `hw-skymodel` 0.1.1 gives: elevation, turbidity, albedo, θ, γ and radiance. On
/// one machine 74,529,000 values had the same bits; here the system's exp and pow may round differently.
#[test]
fn radiances_are_those_of_hw_skymodel() {
    let published = [
        (0.0, 1.0, 0.0, 0.0, 0.7, [0.5219978, 0.6013168, 0.58440495]),
        (0.0, 1.0, 0.0, 1.1, 2.0, [1.466213, 1.3757359, 1.0574113]),
        (0.0, 1.0, 0.0, 1.5, 0.05, [7.296238, 5.181038, 1.695312]),
        (0.3, 2.5, 0.2, 0.0, 0.7, [1.552791, 2.9145586, 5.15722]),
        (0.3, 2.5, 0.2, 1.1, 2.0, [3.3925252, 5.87729, 9.0955105]),
        (0.3, 2.5, 0.2, 1.5, 0.05, [67.7107, 61.02015, 37.105988]),
        (1.0, 6.75, 0.9, 0.0, 0.7, [7.359949, 10.24994, 16.495546]),
        (1.0, 6.75, 0.9, 1.1, 2.0, [9.522818, 14.6591, 23.315819]),
        (1.0, 6.75, 0.9, 1.5, 0.05, [385.6813, 422.13123, 251.23466]),
        (FRAC_PI_2, 10.0, 1.0, 0.0, 0.7, [14.886769, 17.180202, 22.426908]),
        (FRAC_PI_2, 10.0, 1.0, 1.1, 2.0, [13.617158, 14.216815, 19.556673]),
        (FRAC_PI_2, 10.0, 1.0, 1.5, 0.05, [300.85065, 524.25165, 414.58096]),
    ];
    for (elevation, turbidity, albedo, theta, gamma, expected) in published {
        let found = HosekWilkie::new(elevation, turbidity, albedo).radiance(theta, gamma);
        let ratio = found / Rgb::from_array(expected);
        assert!((ratio - 1.0).abs().max_element() < 1e-5, "{elevation} {theta}: {found}, not {expected:?}");
    }
}

/// Between two turbidities or albedos lies the mean of the coefficients, and at the ends nothing is read
/// beyond the tables.
#[test]
fn turbidity_and_albedo_are_interpolated_linearly() {
    let coefficients = |turbidity, albedo| HosekWilkie::new(0.6, turbidity, albedo).channels[1].coefficients;
    for (low, high, middle) in [
        (coefficients(3.0, 0.4), coefficients(4.0, 0.4), coefficients(3.5, 0.4)),
        (coefficients(10.0, 0.0), coefficients(10.0, 1.0), coefficients(10.0, 0.5)),
    ] {
        for i in 0..9 {
            let mean = (low[i] + high[i]) / 2.0;
            assert!((middle[i] - mean).abs() < 1e-4 * (1.0 + mean.abs()), "{i}: {} {mean}", middle[i]);
        }
    }
}
