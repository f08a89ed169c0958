//! How bright: black, constant, huge, tiny, peaks, noise.

use crate::case::Case;

/// A smooth texture, 0.5 … 1.5.
fn texture(x: usize, y: usize) -> f32 {
    1.0 + 0.25 * ((x as f32 * 0.31).sin() + (y as f32 * 0.23).cos())
}

/// A number in [0, 1) of frame, place and channel: SplitMix64 of them in turn.
fn noise(k: usize, x: usize, y: usize, c: usize) -> f32 {
    let bits = [k, x, y, c].into_iter().fold(1u64, |state, n| {
        let z = (state ^ n as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    });
    (bits >> 40) as f32 / (1 << 24) as f32
}

/// Said of a tile whose frames differ in their means alone.
const STATIC: &str = "the same at every hour except for its mean: F_uv alone";

#[test]
fn a_black_tile_next_to_a_lit_one_stays_black_and_takes_no_payload() {
    let lit = |x: usize| x >= 130;
    let result = Case::new(200, 40, 4, |_, x, y| if lit(x) { [texture(x, y); 3] } else { [0.0; 3] }).run();
    assert_eq!((result.outcome.tiles, result.outcome.empty), (2, 1));
    assert_eq!(result.omitted(), ["black in every frame", STATIC]);
    for image in &result.decoded {
        assert!((0..40).all(|y| (0..126).all(|x| image.texels[y * 200 + x] == [0.0; 3])));
    }
    let error = (0..4).map(|k| result.relative_error(k, |x, _| lit(x))).fold(0.0, f64::max);
    assert!(error < 0.015, "{error}");
}

#[test]
fn black_hours_are_exactly_black() {
    let day = |k: usize| (3..9).contains(&k);
    let result =
        Case::new(48, 48, 12, |k, x, y| if day(k) { [texture(x, y), 0.5, 0.2] } else { [0.0; 3] }).run();
    assert_eq!(result.omitted(), ["black in 6 of 12 frames", STATIC]);
    for k in (0..12).filter(|&k| !day(k)) {
        assert!(result.decoded[k].texels.iter().all(|t| *t == [0.0; 3]), "{k}");
    }
    let worst = (3..9).map(|k| result.relative_error(k, |_, _| true)).fold(0.0, f64::max);
    assert!(worst < 0.015, "{worst}");
}

#[test]
fn light_that_is_constant_in_space_or_in_time_is_met() {
    let space = Case::new(48, 48, 12, |k, _, _| [0.1 + k as f32, 2.0, 0.5]).run().worst_relative_error();
    let time =
        Case::new(48, 48, 12, |_, x, y| [texture(x, y), texture(y, x), 0.3]).run().worst_relative_error();
    let both = Case::new(48, 48, 12, |_, _, _| [0.7; 3]).run().worst_relative_error();
    assert!(space < 0.003 && time < 0.03 && both < 0.001, "{space} {time} {both}");
}

#[test]
fn a_channel_that_is_always_zero_stays_zero() {
    let result = Case::new(48, 48, 6, |k, x, y| [0.0, texture(x, y) * (1 + k) as f32, 0.0]).run();
    assert!(result.decoded.iter().flat_map(|i| &i.texels).all(|t| t[0] == 0.0 && t[2] == 0.0 && t[1] > 0.0));
    assert!(result.worst_relative_error() < 0.015, "{}", result.worst_relative_error());
}

#[test]
fn a_peak_of_a_million_in_one_frame_leaves_the_rest_of_its_tile_visible() {
    let spike = |k: usize, x: usize, y: usize| (k, x, y) == (2, 20, 21);
    let light = |k: usize, x: usize, y: usize| if spike(k, x, y) { [1e6; 3] } else { [texture(x, y); 3] };
    let result = Case::new(48, 48, 6, light).run();
    let peak = result.decoded[2].texels[21 * 48 + 20][1];
    let rest: Vec<f64> = (0..6).map(|k| result.relative_error(k, |x, y| !spike(2, x, y))).collect();
    let judged = &result.evaluation.by_hour[2].1;
    let (dim, others) = (rest[2], rest.iter().enumerate().filter(|(k, _)| *k != 2).map(|(_, e)| *e));
    assert!((peak / 1e6 - 1.0).abs() < 0.01, "{peak}");
    assert!(dim < 0.5 && others.fold(0.0, f64::max) < 0.03, "{rest:?}");
    // The PSNR would be as good were the rest ten thousand times too bright.
    assert!(judged.psnr_db.unwrap() > 80.0 && judged.psnr_log_db.unwrap() > 36.0, "{judged:?}");
    assert_eq!(result.omitted(), [""; 0]);
}

#[test]
fn a_peak_of_a_million_in_every_frame_leaves_the_rest_of_its_tile_visible() {
    let spike = |x: usize, y: usize| (x, y) == (20, 21);
    let light = |_, x: usize, y: usize| if spike(x, y) { [1e6; 3] } else { [texture(x, y); 3] };
    let result = Case::new(48, 48, 6, light).run();
    let peaks: Vec<f32> = result.decoded.iter().map(|image| image.texels[21 * 48 + 20][1]).collect();
    let rest: Vec<f64> = (0..6).map(|k| result.relative_error(k, |x, y| !spike(x, y))).collect();
    let judged = &result.evaluation.all;
    assert!(peaks.iter().all(|peak| (peak / 1e6 - 1.0).abs() < 0.01), "{peaks:?}");
    assert!(rest.iter().all(|error| *error < 0.5), "{rest:?}");
    assert!(judged.psnr_db.unwrap() > 80.0 && judged.psnr_log_db.unwrap() > 36.0, "{judged:?}");
    assert_eq!(result.omitted(), [STATIC]);
}

#[test]
fn light_beyond_half_floats_and_near_the_largest_number_is_met() {
    for scale in [1e5f32, 1e30, 2e38] {
        let light = |k: usize, x: usize, y: usize| [scale * (texture(x, y) * (1 + k) as f32 / 6.0); 3];
        let error = Case::new(48, 48, 6, light).run().worst_relative_error();
        assert!(error < 0.015, "{scale:e}: {error}");
    }
}

#[test]
fn denormal_light_is_met() {
    // The least of them has four levels.
    for (scale, bound) in [(1e-30f32, 0.015), (1e-40, 0.015), (4e-45, 0.1)] {
        let light = |k: usize, x: usize, y: usize| [scale * (texture(x, y) * (1 + k) as f32 / 6.0); 3];
        let error = Case::new(48, 48, 6, light).run().worst_relative_error();
        assert!(error < bound, "{scale:e}: {error}");
    }
}

#[test]
fn pure_noise_is_no_worse_than_its_mean() {
    let result = Case::new(64, 64, 12, |k, x, y| [0, 1, 2].map(|c| noise(k, x, y, c))).run();
    let error = result.worst_relative_error();
    let of_the_mean = 1.0 / 3.0f64.sqrt();
    assert!((0.4..of_the_mean).contains(&error), "{error}");
}

#[test]
fn noise_over_nine_decades_stays_finite() {
    let light = |k: usize, x: usize, y: usize| [0, 1, 2].map(|c| (20.0 * noise(k, x, y, c)).exp());
    let result = Case::new(64, 64, 12, light).run();
    // The mean itself would have 3.
    let error = result.worst_relative_error();
    assert!(error < 6.0, "{error}");
}
