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
    // Imported frames have no layers: the lamp is in the frames, on for a minute in every two.
    let spans: Vec<[f64; 2]> =
        (0..3).map(|i| [12.0 + f64::from(i) / 30.0, 12.0 + (f64::from(i) + 0.5) / 30.0]).collect();
    let hours: Vec<f64> = [0.0, 6.0]
        .into_iter()
        .chain((0..6).map(|i| 12.0 + (f64::from(i) + 0.5) / 60.0))
        .chain([18.0])
        .collect();
    let lamp = |x: usize, y: usize| {
        1.0 / (1.0 + 20.0 * ((x as f32 / 48.0 - 0.4).powi(2) + (y as f32 / 48.0 - 0.6).powi(2)))
    };
    let on = |k: usize| (2..8).contains(&k) && k.is_multiple_of(2);
    let light = |k: usize, x: usize, y: usize| [0.1 + if on(k) { lamp(x, y) } else { 0.0 }; 3];
    let result = basis(Case::new(48, 48, 9, light).hours(&hours, &spans));
    let error = result.worst_relative_error();
    assert!(error < 0.03, "{error}");
    assert_eq!(result.decoder.bundle().header.apart, [false]);
    for i in 0..6 {
        for share in [0.1, 0.4, 0.9] {
            let page = result.decoder.decode_page(0, 12.0 + (f64::from(i) + share) / 60.0).unwrap();
            let found = page.texels[28 * 48 + 19][0];
            let expected = if i % 2 == 0 { 0.1 + lamp(19, 28) } else { 0.1 };
            assert!((found - expected).abs() < 0.06 * expected, "{i} {share}: {found}");
        }
    }
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
