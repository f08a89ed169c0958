//! Metrics against a direct transcription of their definitions, closed forms, and edge cases.

mod common;

use common::{Random, full_mask, noise_image};
use dataset::format::tiles::{Rect, TILE, tiles};
use dataset::image::{Image, Mask};
use dataset::pictures::metrics::{
    Brightnesses, PSNR_CAP_DB, StepError, TileQuality, compare, psnr_db, psnr_log_db, relative_error,
    valid_sum,
};

/// The definitions, one texel and one window at a time.
fn oracle(decoded: &Image, reference: &Image, mask: &Mask, tile: Rect) -> (f64, f64, f64) {
    let valid = |x: usize, y: usize| mask.valid[y * mask.width + x];
    let inside: Vec<(usize, usize)> = (tile.y0..tile.y1)
        .flat_map(|y| (tile.x0..tile.x1).map(move |x| (x, y)))
        .filter(|&(x, y)| valid(x, y))
        .collect();
    let value =
        |image: &Image, (x, y): (usize, usize), c: usize| f64::from(image.texels[y * image.width + x][c]);
    let samples = || inside.iter().flat_map(|&at| (0..3).map(move |c| (at, c)));
    let count = (3 * inside.len()) as f64;
    let mse = samples().map(|(at, c)| (value(decoded, at, c) - value(reference, at, c)).powi(2)).sum::<f64>()
        / count;
    let peak = samples().map(|(at, c)| value(reference, at, c)).fold(f64::MIN, f64::max);
    let low = samples().map(|(at, c)| value(reference, at, c)).fold(f64::MAX, f64::min);
    let range = peak - low;
    let (c1, c2) = ((0.01 * range).powi(2), (0.03 * range).powi(2));
    let mut ssim = 0.0;
    for ((px, py), c) in samples() {
        let mut moments = [0.0f64; 6];
        for &(x, y) in &inside {
            let (dx, dy) = (x as f64 - px as f64, y as f64 - py as f64);
            if dx.abs() > 5.0 || dy.abs() > 5.0 {
                continue;
            }
            let w = (-(dx * dx + dy * dy) / (2.0 * 1.5 * 1.5)).exp();
            let (a, b) = (value(decoded, (x, y), c), value(reference, (x, y), c));
            for (moment, term) in moments.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                *moment += w * term;
            }
        }
        let [w, a, b, aa, bb, ab] = moments;
        let (ma, mb) = (a / w, b / w);
        let (va, vb, cov) = (aa / w - ma * ma, bb / w - mb * mb, ab / w - ma * mb);
        ssim += (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
    }
    (10.0 * (peak * peak / mse).log10(), 10.0 * (range * range / mse).log10(), ssim / count)
}

#[test]
fn compare_agrees_with_the_definitions() {
    let mut random = Random(1);
    for (width, height, share) in
        [(40, 33, 100), (40, 33, 60), (40, 33, 3), (11, 4, 80), (2, 1, 100), (1, 30, 90)]
    {
        let reference = noise_image(width, height, random.bits());
        let mut decoded = reference.clone();
        for texel in &mut decoded.texels {
            *texel = texel.map(|value| value + 0.1 * (random.unit() - 0.5));
        }
        let mut mask = full_mask(width, height);
        mask.valid.iter_mut().for_each(|valid| *valid = random.below(100) < share);
        // At least two valid texels, so that the tile is not constant.
        mask.valid[0] = true;
        mask.valid[width * height - 1] = true;
        for tile in [
            Rect { x0: 0, y0: 0, x1: width, y1: height },
            Rect { x0: width / 4, y0: 0, x1: width, y1: height },
        ] {
            let quality = compare(&decoded, &reference, &mask, tile);
            let (Some(psnr), Some(psnr_range), Some(ssim)) =
                (quality.psnr_db, quality.psnr_range_db, quality.ssim)
            else {
                assert!(quality.constant);
                continue;
            };
            let expected = oracle(&decoded, &reference, &mask, tile);
            assert!((psnr - expected.0).abs() < 1e-9, "{psnr} {expected:?}");
            assert!((psnr_range - expected.1).abs() < 1e-9, "{psnr_range} {expected:?}");
            assert!((ssim - expected.2).abs() < 1e-9, "{ssim} {expected:?}");
        }
    }
}

/// The expected values were computed with numpy 2.4.6, scipy 1.17.1 and scikit-image 0.26.0: PSNR by
/// `skimage.metrics.peak_signal_noise_ratio` of the valid texels with data_range = peak, and max − min; each
/// time of SSIM by `scipy.ndimage.correlate(a · mask, window, mode="constant")` ÷ that of the mask. Where no
/// window is cut these maps equal those of
/// `skimage.metrics.structural_similarity(gaussian_weights=True, sigma=1.5 | win_size=7, use_sample_covariance=False)`
/// to 1e-14.
#[test]
fn values_are_those_of_numpy_scipy_and_scikit_image() {
    let (width, height) = (24, 20);
    let image = |value: &dyn Fn(usize, usize, usize) -> f32| Image {
        width,
        height,
        texels: (0..width * height)
            .map(|i| std::array::from_fn(|c| value(i % width, i / width, c)))
            .collect(),
    };
    let light = |x: usize, y: usize, c: usize| ((7 * x + 13 * y + 5 * c + x * y) % 32) as f32 / 32.0 + 0.125;
    let reference = image(&light);
    let decoded = image(&|x, y, c| light(x, y, c) + (((x * x + 3 * y + c) % 5) as f32 - 2.0) / 16.0);
    // The next frame: upside down and half as bright.
    let next = image(&|x, y, c| light(x, height - 1 - y, c) / 2.0);
    let decoded_next =
        image(&|x, y, c| light(x, height - 1 - y, c) / 2.0 + (((x + y + c) % 3) as f32 - 1.0) / 128.0);
    let holes = Mask {
        width,
        height,
        valid: (0..width * height).map(|i| (5 * (i % width) + 3 * (i / width)) % 7 != 0).collect(),
    };
    let whole = Rect { x0: 0, y0: 0, x1: width, y1: height };
    // PSNR, of the range, of the logarithm; SSIM, with the uniform window; error of the step.
    for (mask, expected) in [
        (full_mask(width, height), [21.850461, 20.796334, 22.834849, 0.954866, 0.955015, 0.198353]),
        (holes, [21.839933, 20.785805, 24.243361, 0.953375, 0.953576, 0.200557]),
    ] {
        let quality = compare(&decoded, &reference, &mask, whole);
        let mut step = StepError::default();
        // In two parts.
        for part in [0..100, 100..width * height] {
            let cut = |image: &Image| image.texels[part.clone()].to_vec();
            let [d0, d1, r0, r1] = [&decoded, &decoded_next, &reference, &next].map(cut);
            step.add([&d0, &d1], [&r0, &r1], &mask.valid[part]);
        }
        let found = [
            quality.psnr_db,
            quality.psnr_range_db,
            psnr_log_db(&decoded, &reference, &mask, whole, quality.mean),
            quality.ssim,
            quality.ssim_uniform,
            step.relative(),
        ];
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found.unwrap() - expected).abs() < 1e-5, "{found:?} {expected}");
        }
    }
}

#[test]
fn a_step_that_is_none_has_no_error() {
    let step = |change: f32, error: f32| {
        let mut step = StepError::default();
        let at = |light: f32| [[light; 3]; 4];
        step.add(
            [&at(1.0), &at(1.0 + change + error)],
            [&at(1.0), &at(1.0 + change)],
            &[true, true, false, true],
        );
        step.relative()
    };
    assert_eq!(step(0.0, 0.5), None);
    assert_eq!(step(0.5, 0.0), Some(0.0));
    assert!((step(0.5, 0.25).unwrap() - 0.5).abs() < 1e-6);
    assert_eq!(StepError::default().relative(), None);
}

#[test]
fn values_outside_mask_and_tile_do_not_count() {
    let reference = noise_image(129, 130, 2);
    let mut mask = full_mask(129, 130);
    mask.valid[5 * 129 + 7] = false;
    let tiles = tiles(129, 130, TILE);
    let mut decoded = reference.clone();
    let clean: Vec<TileQuality> =
        tiles.iter().map(|&tile| compare(&decoded, &reference, &mask, tile)).collect();
    decoded.texels[5 * 129 + 7] = [1e30, f32::NAN, -5.0];
    decoded.texels[128] = [9.0; 3];
    for (index, (&tile, clean)) in tiles.iter().zip(&clean).enumerate() {
        let quality = compare(&decoded, &reference, &mask, tile);
        // Texel 128 of the first row is in the second tile, one texel wide.
        assert_eq!(quality == *clean, index != 1, "tile {index}");
    }
    assert_eq!((clean.len(), clean[1].texels, clean[3].texels), (4, 128, 2));
}

#[test]
fn an_offset_has_its_closed_form() {
    // peak 2, error 0.02 everywhere: 20 log₁₀(2 ÷ 0.02) = 40 dB.
    let mut reference = noise_image(64, 64, 3);
    reference.texels[0][0] = 2.0;
    let mut decoded = reference.clone();
    decoded.texels.iter_mut().for_each(|texel| *texel = texel.map(|value| value + 0.02));
    let whole = Rect { x0: 0, y0: 0, x1: 64, y1: 64 };
    let quality = compare(&decoded, &reference, &full_mask(64, 64), whole);
    assert!((quality.psnr_db.unwrap() - 40.0).abs() < 1e-4, "{quality:?}");
    assert!((quality.mse() - 4e-4).abs() < 1e-9);
    let exact = compare(&reference, &reference, &full_mask(64, 64), whole);
    assert_eq!((exact.psnr_db, exact.psnr_range_db), (Some(PSNR_CAP_DB), Some(PSNR_CAP_DB)));
    assert_eq!(exact.ssim, Some(1.0));
}

#[test]
fn metrics_do_not_depend_on_the_unit() {
    let reference = noise_image(30, 30, 4);
    let decoded = noise_image(30, 30, 5);
    let scaled = |image: &Image, s: f32| Image {
        texels: image.texels.iter().map(|t| t.map(|v| v * s)).collect(),
        ..*image
    };
    let whole = Rect { x0: 0, y0: 0, x1: 30, y1: 30 };
    let one = compare(&decoded, &reference, &full_mask(30, 30), whole);
    for scale in [1e-12, 1e12] {
        let other = compare(&scaled(&decoded, scale), &scaled(&reference, scale), &full_mask(30, 30), whole);
        assert!((one.psnr_db.unwrap() - other.psnr_db.unwrap()).abs() < 1e-4);
        assert!((one.ssim.unwrap() - other.ssim.unwrap()).abs() < 1e-5);
    }
}

#[test]
fn tiles_without_contrast_are_distinguished() {
    let whole = Rect { x0: 0, y0: 0, x1: 8, y1: 8 };
    let constant = |texel: [f32; 3]| Image { width: 8, height: 8, texels: vec![texel; 64] };
    let full = full_mask(8, 8);

    // No valid texel.
    let mut none = full.clone();
    none.valid.fill(false);
    let quality = compare(&constant([1.0; 3]), &constant([2.0; 3]), &none, whole);
    assert_eq!((quality.texels, quality.psnr_db, quality.ssim), (0, None, None));

    // All black, decoded as 0.5.
    let quality = compare(&constant([0.5; 3]), &constant([0.0; 3]), &full, whole);
    assert_eq!(
        (quality.psnr_db, quality.psnr_range_db, quality.ssim, quality.constant),
        (None, None, None, true)
    );

    // Constant in space, though not over channels: a peak, no range; off by 1 % of the mean 2.
    let quality = compare(&constant([1.02, 2.02, 3.02]), &constant([1.0, 2.0, 3.0]), &full, whole);
    assert!(
        quality.constant
            && quality.psnr_db.is_some()
            && quality.psnr_range_db.is_none()
            && quality.ssim.is_none()
    );

    // One valid texel of an image that varies.
    let mut one = none.clone();
    one.valid[13] = true;
    let image = noise_image(8, 8, 6);
    let quality = compare(&image, &image, &one, whole);
    assert!(quality.texels == 1 && quality.constant && quality.ssim.is_none());
    assert_eq!(quality.psnr_db, Some(PSNR_CAP_DB));
}

#[test]
fn relative_errors_are_floored() {
    assert_eq!(relative_error(0.04, 2.0, 1.0), 0.1);
    assert_eq!(relative_error(1e-6, 0.0, 1.0), 1.0);
    assert_eq!(relative_error(0.0, 0.0, 0.0), 0.0);
    assert_eq!(relative_error(1.0, 0.0, 0.0), f64::INFINITY);
    assert!(psnr_db(1.0, f64::NAN).is_nan());
}

#[test]
fn valid_sums_leave_out_the_rest() {
    let mut mask = full_mask(2, 1);
    mask.valid[1] = false;
    let image = Image { width: 2, height: 1, texels: vec![[1.0, 2.0, 3.0], [f32::NAN; 3]] };
    assert_eq!(valid_sum(&image.texels, &mask.valid), (6.0, 1));
}

#[test]
fn the_logarithm_sees_what_a_spike_hides_from_the_psnr() {
    let (width, height) = (64, 64);
    let image = |rest: f32| {
        let mut texels = vec![[rest; 3]; width * height];
        texels[70] = [1e6; 3];
        Image { width, height, texels }
    };
    let (reference, mut mask) = (image(1.0), full_mask(width, height));
    let tile = Rect { x0: 0, y0: 0, x1: width, y1: height };
    let mean = (1e6 + 4095.0) / 4096.0;
    let judge = |decoded: &Image, mask: &Mask| {
        let log = psnr_log_db(decoded, &reference, mask, tile, mean);
        (compare(decoded, &reference, mask, tile).psnr_db.unwrap(), log.unwrap())
    };
    // All but one texel a hundred times too bright: an excellent PSNR.
    let (psnr, log) = judge(&image(100.0), &mask);
    let floor: f64 = 1e-3 * mean;
    let [one, hundred, peak] = [1.0, 100.0, 1e6].map(|v: f64| (1.0 + v / floor).ln());
    let expected = 20.0 * (peak / ((hundred - one) * (4095.0f64 / 4096.0).sqrt())).log10();
    assert!(psnr > 79.0 && (log - expected).abs() < 1e-9 && log < 11.0, "{psnr} {log}");
    assert!(judge(&image(1.01), &mask).1 > 60.0);
    assert_eq!(judge(&reference, &mask).1, PSNR_CAP_DB);
    // An error outside the mask is none.
    let mut wrong = reference.clone();
    wrong.texels[9] = [7.0; 3];
    mask.valid[9] = false;
    assert_eq!(judge(&wrong, &mask).1, PSNR_CAP_DB);
    // Nothing valid, nothing lit.
    let none = Mask { valid: vec![false; width * height], ..mask };
    let black = Image::black(width, height);
    assert_eq!(psnr_log_db(&reference, &reference, &none, tile, mean), None);
    assert_eq!(psnr_log_db(&reference, &black, &full_mask(width, height), tile, 0.0), None);
}

#[test]
fn the_darkest_quarter_is_that_of_the_whole_set() {
    // Brightness 1 … 8 and 11 … 18 on two pages, and an invalid black texel on each.
    let page = |first: f32| {
        let texels =
            (0..9).map(|i| if i == 8 { [0.0; 3] } else { [0.0, 2.0, 1.0].map(|c| c * (first + i as f32)) });
        Image { width: 9, height: 1, texels: texels.collect() }
    };
    let mut mask = full_mask(9, 1);
    mask.valid[8] = false;
    let judged = |errors: &[(usize, usize, f32)]| {
        let mut set = Brightnesses::default();
        for (number, first) in [11.0, 1.0].into_iter().enumerate() {
            let (reference, mut decoded) = (page(first), page(first));
            for &(_, texel, error) in errors.iter().filter(|(of, ..)| *of == number) {
                decoded.texels[texel][1] += error;
            }
            set.add(&decoded, &reference, &mask);
        }
        set.dark_relative_error(9.5).unwrap()
    };
    assert_eq!(judged(&[]), 0.0);
    // The quarter is 1, 2, 3, 4; errors elsewhere are none of its business.
    assert_eq!(judged(&[(0, 3, 5.0), (1, 4, 5.0), (1, 8, 5.0), (0, 8, 5.0)]), 0.0);
    let rmse = (0.6f64 * 0.6 / 3.0 / 4.0).sqrt();
    assert!((judged(&[(1, 3, 0.6)]) - rmse / 2.5).abs() < 1e-7);
    assert!((judged(&[(1, 0, 0.6)]) - rmse / 2.5).abs() < 1e-7);
    // Equal brightness counts as a whole; a black quarter is measured against the dataset.
    let (mut set, grey) = (Brightnesses::default(), Image { width: 9, height: 1, texels: vec![[2.0; 3]; 9] });
    set.add(&Image { texels: vec![[2.5; 3]; 9], ..grey }, &grey, &mask);
    assert_eq!(set.dark_relative_error(2.0), Some(0.25));
    let (mut set, black) = (Brightnesses::default(), Image::black(9, 1));
    set.add(&Image { texels: vec![[0.5; 3]; 9], ..black }, &black, &mask);
    assert_eq!(set.dark_relative_error(100.0), Some(5.0));
    assert_eq!(Brightnesses::default().dark_relative_error(1.0), None);
}
