//! HDR-ꟻLIP against its authors' implementation, and where that has nothing to say.

mod common;

use common::full_mask;
use dataset::format::Rect;
use dataset::image::{Image, Mask};
use dataset::pictures::metrics::{compare, flip};

/// An image of light by place.
fn image(width: usize, height: usize, light: impl Fn(f64, f64) -> [f64; 3]) -> Image {
    let at = |i: usize| light((i % width) as f64, (i / width) as f64).map(|value| value as f32);
    Image { width, height, texels: (0..width * height).map(at).collect() }
}

fn error(decoded: &Image, reference: &Image, mask: &Mask) -> Option<f64> {
    let tile = Rect { x0: 0, y0: 0, x1: reference.width, y1: reference.height };
    flip(decoded, reference, mask, tile, &compare(decoded, reference, mask, tile))
}

fn waves(x: f64, y: f64) -> [f64; 3] {
    let step = if y > 20.0 { 0.2 } else { 0.0 };
    [1.0 + (x / 5.0).sin() + step, 0.5 + 0.5 * (y / 7.0).cos(), 0.1 + 0.02 * x]
}

/// The expected values are those of the package `flip-evaluator` 1.7 of its authors,
/// `evaluate(reference, decoded, "HDR")`.
#[test]
fn values_are_those_of_its_authors() {
    let falling = |x: f64, y: f64| waves(x, y).map(|value| value * (-12.0 * x / 64.0).exp2());
    let spot = |x: f64, y: f64| {
        let is_lit = (x - 10.0).powi(2) + (y - 9.0).powi(2) < 9.0;
        waves(x, y).map(|value| value * if is_lit { 10001.0 } else { 1.0 })
    };
    type Light<'a> = &'a dyn Fn(f64, f64) -> [f64; 3];
    let cases: [(usize, usize, Light, bool, f64); 4] = [
        (40, 40, &waves, false, 0.042_950_3),
        (64, 48, &falling, false, 0.050_275_5),
        (33, 40, &spot, false, 0.093_645_5),
        (40, 21, &waves, true, 0.452_204_2),
    ];
    for (width, height, light, is_tinted, expected) in cases {
        let change = |x: f64, y: f64| match is_tinted {
            true => [1.0, 0.7, 1.4],
            false => [1.0 + 0.2 * (12.9898 * (y * width as f64 + x)).sin(); 3],
        };
        let reference = image(width, height, light);
        let decoded = image(width, height, |x, y| {
            let (light, change) = (light(x, y), change(x, y));
            std::array::from_fn(|c| light[c] * change[c])
        });
        let found = error(&decoded, &reference, &full_mask(width, height)).unwrap();
        assert!((found - expected).abs() < 1e-4, "{width}×{height}: {found} instead of {expected}");
    }
}

#[test]
fn equal_images_have_no_error_and_unequal_scales_do_not_matter() {
    let of_scale = |scale: f64| {
        let reference = image(30, 20, |x, y| waves(x, y).map(|value| value * scale));
        let mask = full_mask(30, 20);
        assert_eq!(error(&reference, &reference, &mask), Some(0.0));
        let brighter = image(30, 20, |x, y| waves(x, y).map(|value| 1.1 * value * scale));
        error(&brighter, &reference, &mask).unwrap()
    };
    let expected = of_scale(1.0);
    for scale in [1e-37, 1e-12, 1e12, 1e37] {
        let found = of_scale(scale);
        assert!((found - expected).abs() < 1e-4, "{scale}: {found} instead of {expected}");
    }
}

#[test]
fn invalid_and_black_texels_are_distinguished_from_others() {
    // A mask hides what differs.
    let reference = image(40, 20, waves);
    let half = Mask { width: 40, height: 20, valid: (0..800).map(|i| i % 40 < 20).collect() };
    let differs = image(40, 20, |x, y| if x < 20.0 { waves(x, y) } else { [f64::NAN; 3] });
    assert_eq!(error(&differs, &reference, &half), Some(0.0));
    // Most texels are black: the median of all would be none. Ratios of 1 : 10¹⁰ are no longer than others to
    // look at.
    let lamp = |x: f64, y: f64| if x < 8.0 { waves(x, y) } else { [0.0; 3] };
    let dim = |x: f64, y: f64| if x < 1.0 { [1e10; 3] } else { waves(x, y) };
    for light in [&lamp as &dyn Fn(f64, f64) -> [f64; 3], &dim] {
        let reference = image(40, 20, light);
        let brighter = image(40, 20, |x, y| light(x, y).map(|value| 1.3 * value));
        let found = error(&brighter, &reference, &full_mask(40, 20)).unwrap();
        assert!(found > 0.01 && found < 0.5, "{found}");
    }
    // Nothing to tell of black, of one colour, of no texel.
    for (light, valid) in [([0.0; 3], true), ([1.0, 2.0, 3.0], true), ([1.0; 3], false)] {
        let flat = image(9, 9, |_, _| light);
        let mask = Mask { width: 9, height: 9, valid: vec![valid; 81] };
        assert_eq!(error(&flat, &flat, &mask), None);
    }
    // Of two texels there is something.
    let two = image(2, 1, |x, _| [1.0 + x; 3]);
    assert!(error(&image(2, 1, |x, _| [1.2 + x; 3]), &two, &full_mask(2, 1)).unwrap() > 0.01);
}
