//! The same stiff cases as planes.

use crate::case::Case;
use compressor::bundle::MapCoding;

fn basis<'a>(case: Case<'a>) -> crate::case::Result {
    Case { coding: MapCoding::Basis, ..case }.run()
}

#[test]
fn one_texel_of_a_million_leaves_the_others_as_they_are() {
    let bright = |x: usize, y: usize| (x, y) == (17, 30);
    let light = |k: usize, x: usize, y: usize| {
        [if bright(x, y) { 1e6 } else { 1.0 + 0.5 * ((x + k) as f32 * 0.2).sin() }; 3]
    };
    let result = basis(Case::new(48, 48, 6, light));
    for k in 0..6 {
        // Around the texel its block rings; beyond that others keep their light.
        let near = |x: usize, y: usize| x.abs_diff(17) < 9 && y.abs_diff(30) < 9;
        let found = result.relative_error(k, |x, y| !near(x, y));
        assert!(found < 3.0, "frame {k}: {found}");
        assert!(result.relative_error(k, bright) < 0.02);
    }
    assert!(result.least_psnr_db() > 50.0);
}

#[test]
fn nine_decades_from_noon_to_night_keep_their_error() {
    let level = |k: usize| 10f32.powi(-(k as i32));
    let light = |k: usize, x: usize, y: usize| {
        let slope = 0.2 + x as f32 / 48.0;
        [level(k) * slope, level(k) * 0.5 * slope, level(k) * (1.0 + y as f32 / 96.0)]
    };
    let result = basis(Case::new(48, 48, 10, light));
    let error = result.worst_relative_error();
    assert!(error < 0.02, "{error}");
}

#[test]
fn any_number_of_frames_any_rank_and_noise_are_bounded() {
    for (frames, bound) in [(1, 39.0), (2, 39.0), (240, 38.0)] {
        let light = |k: usize, x: usize, _: usize| {
            let phase = std::f32::consts::TAU * k as f32 / frames as f32;
            let sun = 1.0 / (1.0 + (-(x as f32 - 24.0 - 12.0 * phase.cos()) * 0.5).exp());
            [0.2 + sun, 0.2 + 0.9 * sun, 0.3]
        };
        let psnr = basis(Case::new(48, 48, frames, light)).least_psnr_db();
        assert!(psnr > bound && psnr < bound + 30.0, "{frames} frames: {psnr} dB");
    }
    // Noise in 40 frames that have nothing in common: nothing to gain, nothing to lose but bytes.
    let noise = |k: usize, x: usize, y: usize| {
        let hash = (k * 7919 + x * 104_729 + y * 1_299_709).wrapping_mul(0x9e37_79b9) >> 7;
        [0.1 + (hash % 1000) as f32 / 1000.0, 0.1 + (hash / 1000 % 1000) as f32 / 1000.0, 0.5]
    };
    let psnr = basis(Case::new(40, 40, 40, noise)).least_psnr_db();
    assert!((22.0..60.0).contains(&psnr), "{psnr} dB");
}

#[test]
fn what_is_black_takes_no_bytes_and_a_page_may_be_one_texel() {
    let result = basis(Case::new(300, 20, 4, |_, x, _| [if x < 120 { 1.0 } else { 0.0 }; 3]));
    let index = &result.decoder.bundle().index;
    assert!(index[0].maps.length > 0);
    assert_eq!((index[1].bytes(), index[2].bytes()), (0, 0));
    assert!(result.decoded[2].texels[299] == [0.0; 3]);
    let all = basis(Case::new(48, 48, 3, |_, _, _| [0.0; 3]));
    assert_eq!(all.outcome.empty, 1);
    let one = basis(Case::new(1, 1, 5, |k, _, _| [k as f32, 0.5, 0.0]));
    for (k, image) in one.decoded.iter().enumerate() {
        let [r, g, b] = image.texels[0];
        assert!(
            (r - k as f32).abs() < 0.05 * k as f32 + 0.01 && (g - 0.5).abs() < 0.03 && b < 1e-3,
            "{:?}",
            image.texels
        );
    }
}

#[test]
fn lamps_that_are_not_apart_switch_to_the_instant() {
    crate::times::blinks(MapCoding::Basis);
}

#[test]
fn the_largest_and_the_smallest_light_keep_their_error() {
    for level in [3e38f32, 1e30, 1e5, 1e-30, 1e-40] {
        let light = |k: usize, x: usize, y: usize| {
            [0.3, 0.8, 0.5].map(|c| level * c * (0.5 + ((x + k) as f32 * 0.3).sin().abs() * y as f32 / 96.0))
        };
        let error = basis(Case::new(48, 48, 4, light)).worst_relative_error();
        assert!(error < 0.05, "{level}: {error}");
    }
}

#[test]
fn noise_over_nine_decades_stays_light() {
    let noise = |k: usize, x: usize, y: usize| {
        let hash = (k * 7919 + x * 104_729 + y * 1_299_709).wrapping_mul(0x9e37_79b9) >> 7;
        [10f32.powf((hash % 9000) as f32 / 1000.0), 10f32.powf((hash / 9 % 9000) as f32 / 1000.0), 1.0]
    };
    // Whatever is lost, it is below the brightest by far: every texel is compared with its frame's peak.
    let psnr = basis(Case::new(40, 40, 8, noise)).least_psnr_db();
    assert!((20.0..60.0).contains(&psnr), "{psnr} dB");
}

#[test]
fn after_a_black_night_light_only_fades_in() {
    let dawn = |x: usize| 0.1 + x as f32 / 47.0;
    let light = |k: usize, x: usize, _: usize| match k {
        2..=5 => [0.0; 3],
        _ => [dawn(x), 0.8 * dawn(x), 0.5 * dawn(47 - x)],
    };
    let result = basis(Case::new(48, 48, 24, light));
    for (hour, share) in [(5.5, 0.5), (5.1, 0.1), (5.99, 0.99)] {
        let page = result.decoder.decode_page(0, hour).unwrap();
        for (found, sunrise) in page.texels.iter().zip(&result.decoded[6].texels) {
            for c in 0..3 {
                let expected = share * sunrise[c];
                assert!((found[c] - expected).abs() < 1e-4, "{hour} h: {} for {expected}", found[c]);
            }
        }
    }
    assert!(result.worst_relative_error() < 0.03);
}
