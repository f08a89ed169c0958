//! When: switches, few and many frames, uneven hours.

use crate::case::Case;
use compressor::bundle::MapCoding;

/// A lamp's light at (x, y) of 48 × 48.
fn lamp(x: usize, y: usize) -> f32 {
    let (u, v) = (x as f32 / 48.0 - 0.4, y as f32 / 48.0 - 0.6);
    1.0 / (1.0 + 20.0 * (u * u + v * v))
}

#[test]
fn a_lamp_that_jumps_a_thousandfold_is_met_on_both_sides() {
    let on = |k: usize| !(2..=4).contains(&k);
    let light = |k: usize, x: usize, y: usize| {
        let base = 0.001 * (1.0 + 0.5 * (x as f32 * 0.2).sin());
        [base, base, 2.0 * base].map(|b| b + if on(k) { lamp(x, y) } else { 0.0 })
    };
    let result = Case::new(48, 48, 6, light).hours(&[0.0, 5.9, 6.0, 12.0, 18.0, 18.1], &[[18.0, 6.0]]).run();
    let error = result.worst_relative_error();
    assert!(error < 0.02, "{error}");
    let page = |hour| result.decoder.decode_page(0, hour).unwrap();
    assert!(page(18.05) == result.decoded[5] && page(5.95) == result.decoded[1]);
    assert!(page(18.0) == result.decoded[4] && page(6.0) == result.decoded[2]);
}

#[test]
fn a_lamp_that_blinks_within_six_minutes_is_on_and_off_to_the_instant() {
    blinks(MapCoding::Neural);
}

/// Imported frames have no layers, so the lamp is in the frames by any coding.
pub fn blinks(coding: MapCoding) {
    // On for a minute in every two.
    let spans: Vec<[f64; 2]> =
        (0..3).map(|i| [12.0 + f64::from(i) / 30.0, 12.0 + (f64::from(i) + 0.5) / 30.0]).collect();
    let hours: Vec<f64> = [0.0, 6.0]
        .into_iter()
        .chain((0..6).map(|i| 12.0 + (f64::from(i) + 0.5) / 60.0))
        .chain([18.0])
        .collect();
    let on = |k: usize| (2..8).contains(&k) && k.is_multiple_of(2);
    let light = |k: usize, x: usize, y: usize| [0.1 + if on(k) { lamp(x, y) } else { 0.0 }; 3];
    let result = Case { coding, ..Case::new(48, 48, 9, light).hours(&hours, &spans) }.run();
    let error = result.worst_relative_error();
    assert!(error < 0.025, "{error}");
    assert_eq!(result.decoder.bundle().header.apart, [false]);
    let page = |hour| result.decoder.decode_page(0, hour).unwrap();
    // Any instant of a blink is that blink's frame.
    for i in 0..6 {
        for share in [0.1, 0.4, 0.9] {
            let found = page(12.0 + (f64::from(i) + share) / 60.0);
            let light = found.texels[28 * 48 + 19][0];
            let expected = if i % 2 == 0 { 0.1 + lamp(19, 28) } else { 0.1 };
            assert!((light - expected).abs() < 0.05 * expected, "{i} {share}: {light}");
        }
    }
}

#[test]
fn one_two_and_240_frames_are_reproduced() {
    for (frames, bound) in [(1, 50.0), (2, 43.0), (240, 42.0)] {
        let light = |k: usize, x: usize, y: usize| {
            let phase = std::f32::consts::TAU * k as f32 / frames as f32;
            let sun = 1.0 / (1.0 + (-(x as f32 - 24.0 - 12.0 * phase.cos()) * 0.5).exp());
            [0.2 + sun, 0.2 + 0.9 * sun * lamp(x, y), 0.3]
        };
        let result = Case::new(48, 48, frames, light).run();
        let psnr = result.least_psnr_db();
        assert!(psnr > bound && psnr < bound + 25.0, "{frames} frames: {psnr} dB");
    }
}

#[test]
fn hours_seconds_and_half_days_apart_are_met() {
    let hours = [0.0, 0.001, 0.002, 11.0, 11.5, 23.998, 23.999];
    let light = |k: usize, x: usize, _: usize| {
        let sun = 1.0 / (1.0 + (-(x as f32 - 6.0 * k as f32) * 0.5).exp());
        [0.2 + sun, 0.2 + 0.9 * sun, 0.3]
    };
    let result = Case::new(48, 48, 7, light).hours(&hours, &[]).run();
    let psnr = result.least_psnr_db();
    assert!((43.0..70.0).contains(&psnr), "{psnr} dB");
    // Halfway through the longest gap light is about halfway.
    let [a, b] = [2, 3].map(|k| result.decoded[k].texels[24 * 48 + 11][0]);
    let between = result.decoder.decode_page(0, 5.501).unwrap().texels[24 * 48 + 11][0];
    assert!(a > b + 0.3 && (b - 0.1..a + 0.1).contains(&between), "{a} {between} {b}");
}

#[test]
fn a_moving_slit_of_one_texel_is_in_its_place_in_every_frame() {
    let slit = |k: usize| 5 + 7 * k;
    let result = Case::new(126, 126, 12, |k, x, _| [if x == slit(k) { 1.0 } else { 0.1 }; 3]).run();
    for (k, image) in result.decoded.iter().enumerate() {
        let line = &image.texels[60 * 126..61 * 126];
        let brightest = (0..126).max_by(|&a, &b| line[a][1].total_cmp(&line[b][1]));
        assert_eq!(brightest, Some(slit(k)), "set {k}");
    }
    let psnr = result.least_psnr_db();
    assert!(psnr > 25.0, "{psnr} dB");
}

#[test]
fn a_small_spot_in_one_frame_is_only_there_and_then() {
    // 9 of 15876 texels: 0.7 % of the light's root mean square.
    let spot = |x: usize, y: usize| (60..63).contains(&x) && (70..73).contains(&y);
    let light = |k: usize, x: usize, y: usize| [if k == 6 && spot(x, y) { 0.8 } else { 0.5 }; 3];
    let result = Case::new(126, 126, 12, light).run();
    for (k, image) in result.decoded.iter().enumerate() {
        let found = image.texels[71 * 126 + 61][1];
        let expected = light(k, 61, 71)[0];
        assert!((found / expected - 1.0).abs() < 0.1, "set {k}: {found} for {expected}");
    }
}

#[test]
fn at_dawn_after_a_black_night_only_the_dawn_shines() {
    // Whole hours; the lamp until half past one, black from two to five.
    let dawn = |x: usize| 0.1 + x as f32 / 47.0;
    let light = |k: usize, x: usize, y: usize| match k {
        0 | 1 | 19.. => [lamp(x, y); 3],
        2..=5 => [0.0; 3],
        _ => [dawn(x), 0.8 * dawn(x), 0.5 * dawn(47 - x)],
    };
    let hours: Vec<f64> = (0..24).map(f64::from).collect();
    let result = Case::new(48, 48, 24, light).hours(&hours, &[[18.5, 1.5]]).run();
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

#[test]
fn between_frames_far_apart_light_stays_between_theirs() {
    // At one hour in the day everything is another; the rest hardly changes.
    let light = |k: usize, x: usize, y: usize| {
        let there = if k == 12 { lamp(47 - x, 47 - y) } else { lamp(x, y) };
        [there + 0.02 * (k as f32 * 0.7).sin() * (x as f32 * 0.3).cos(), there, 0.3]
    };
    let result = Case::new(48, 48, 24, light).run();
    for (before, hour, after) in
        [(11, 11.25, 12), (11, 11.5, 12), (11, 11.75, 12), (12, 12.5, 13), (3, 3.5, 4)]
    {
        let page = result.decoder.decode_page(0, hour).unwrap();
        let worst =
            page.texels.iter().zip(&result.references[before].texels).zip(&result.references[after].texels);
        let outside = |((found, a), b): ((&[f32; 3], &[f32; 3]), &[f32; 3])| {
            (0..3).map(|c| (found[c] - a[c].max(b[c])).max(a[c].min(b[c]) - found[c])).fold(0.0, f32::max)
        };
        let worst = worst.map(outside).fold(0.0, f32::max);
        assert!(worst < 0.06, "{hour} h: {worst} outside");
    }
}

#[test]
fn between_moonlight_and_the_sun_neither_outshines_both() {
    // Moon on the left, ten thousand times dimmer than the sun on the right.
    let side = |x: usize| 1.0 / (1.0 + (-(x as f32 - 23.5) * 0.4).exp());
    let light = |k: usize, x: usize, _: usize| match k {
        6..=18 => [10.0 * side(x) * (1.0 + 0.1 * k as f32) + 1e-4; 3],
        _ => [1e-3 * (1.0 - side(x)) + 1e-5; 3],
    };
    let result = Case::new(48, 48, 24, light).run();
    for (hour, share) in [(5.005, 0.005), (5.1, 0.1), (5.3, 0.3), (5.5, 0.5), (5.8, 0.8), (5.98, 0.98)] {
        let page = result.decoder.decode_page(0, hour).unwrap();
        let (mut sum, mut mean) = (0.0, 0.0);
        for (i, found) in page.texels.iter().enumerate() {
            let linear =
                (1.0 - share) * result.references[5].texels[i][1] + share * result.references[6].texels[i][1];
            sum += f64::from((found[1] - linear).powi(2));
            mean += f64::from(linear);
        }
        let texels = page.texels.len() as f64;
        let error = (sum / texels).sqrt() / (mean / texels);
        assert!(error < 0.08, "{hour} h: {error}");
    }
}

#[test]
fn a_lamp_is_not_lost_beside_a_hot_texel() {
    // A lamp of half the light of all but one texel, which is a million times as bright.
    let light = |k: usize, x: usize, y: usize| match (x, y) {
        (20, 21) => [1e6; 3],
        _ => [1.0 + if (1..=2).contains(&k) { 0.5 * lamp(x, y) } else { 0.0 }; 3],
    };
    let result = Case::new(48, 48, 4, light).hours(&[12.0, 18.1, 20.0, 23.0], &[[18.0, 22.0]]).run();
    let centre = |k: usize| f64::from(result.decoded[k].texels[28 * 48 + 19][1]);
    let (on, off) = (centre(1) + centre(2), centre(0) + centre(3));
    assert!((1.15..1.75).contains(&(on / off)), "{on} {off}");
}
