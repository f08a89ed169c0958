//! Compares two pictures of 8 bits a channel: how similar two renderings look on a screen.

use super::{flip, psnr_db, ssim};
use crate::format::Rect;
use crate::image::{Image, Mask};
use crate::pictures::tone;

/// The largest code, which is the peak of the PSNR and the range of the SSIM.
const WHITE: f64 = 255.0;

/// How alike two pictures are, over the pixels that are evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureQuality {
    /// Of the sRGB codes, peak 255, joint over the channels, capped at [`super::PSNR_CAP_DB`].
    pub psnr_db: f64,
    /// Of the sRGB codes: 11×11 Gaussian, σ 1.5, range 255, mean over channels.
    pub ssim: f64,
    /// ꟻLIP, 0 to 1, at 67 pixels per degree: mean over pixels.
    pub flip: f64,
    /// ꟻLIP that 95 % of the pixels do not exceed.
    pub flip_p95: f64,
    /// ꟻLIP that 99 % of the pixels do not exceed.
    pub flip_p99: f64,
}

/// Compares two pictures of sRGB codes, red, green and blue of each pixel row by row. Pixels off `evaluated`
/// count for nothing, and are black in both. `None` if no pixel is evaluated.
///
/// # Panics
/// If the lists are not of the mask's size.
pub fn compare_pictures(found: &[u8], reference: &[u8], judged: &Mask) -> Option<PictureQuality> {
    let [found, reference] = [found, reference].map(|codes| image(codes, judged));
    let pixels = judged.count();
    if pixels == 0 {
        return None;
    }
    let errors = found.texels.as_flattened().iter().zip(reference.texels.as_flattened());
    let squared: f64 = errors.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    let all = Rect { x0: 0, y0: 0, x1: judged.width, y1: judged.height };
    let shown = [&found, &reference].map(|image| {
        let linear = |texel: &[f32; 3]| texel.map(|code| tone::linear(code as u8));
        image.texels.iter().map(linear).collect::<Vec<_>>()
    });
    let errors = flip::of_pictures(&shown[0], &shown[1], [judged.width, judged.height]);
    let errors = errors.into_iter().zip(&judged.valid).filter(|(_, valid)| **valid);
    let mut errors: Vec<f64> = errors.map(|(error, _)| f64::from(error)).collect();
    let flip = errors.iter().sum::<f64>() / pixels as f64;
    errors.sort_unstable_by(f64::total_cmp);
    let at = |percent: usize| errors[(percent * pixels).div_ceil(100) - 1];
    Some(PictureQuality {
        psnr_db: psnr_db(WHITE, squared / (3 * pixels) as f64),
        ssim: ssim::masked(ssim::gaussian(), &found, &reference, judged, all, WHITE),
        flip,
        flip_p95: at(95),
        flip_p99: at(99),
    })
}

fn image(codes: &[u8], judged: &Mask) -> Image {
    assert_eq!(codes.len(), 3 * judged.valid.len(), "a code for each channel of each pixel");
    let pixels = codes.chunks_exact(3).zip(&judged.valid);
    let texels = pixels.map(|(rgb, valid)| match valid {
        true => [0, 1, 2].map(|c| f32::from(rgb[c])),
        false => [0.0; 3],
    });
    Image { width: judged.width, height: judged.height, texels: texels.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_count_where_pixels_are_evaluated() {
        let (width, height) = (24, 16);
        let reference: Vec<u8> = (0..3 * width * height).map(|i| (i * 37 % 200) as u8).collect();
        let judged = Mask { width, height, valid: (0..width * height).map(|i| i % width < 12).collect() };
        let exact = compare_pictures(&reference, &reference, &judged).unwrap();
        assert_eq!(
            exact,
            PictureQuality { psnr_db: 100.0, ssim: 1.0, flip: 0.0, flip_p95: 0.0, flip_p99: 0.0 }
        );
        // Ten codes more everywhere: 20 log₁₀(255/10).
        let brighter: Vec<u8> = reference.iter().map(|code| code + 10).collect();
        let found = compare_pictures(&brighter, &reference, &judged).unwrap();
        assert!((found.psnr_db - 28.131).abs() < 1e-3, "{found:?}");
        assert!((0.9..1.0).contains(&found.ssim) && (0.01..0.3).contains(&found.flip), "{found:?}");
        // One column in twelve is changed most: it is above 95 % of the pixels.
        let mut column = brighter.clone();
        (0..height).for_each(|y| column[3 * y * width] ^= 255);
        let odd = compare_pictures(&column, &reference, &judged).unwrap();
        assert!(found.flip_p95 <= found.flip_p99 && odd.flip < odd.flip_p95 && odd.flip_p95 <= odd.flip_p99);
        // Off the evaluated pixels nothing counts.
        let mut elsewhere = reference.clone();
        (0..height).for_each(|y| elsewhere[3 * (y * width + 20)] ^= 255);
        assert_eq!(compare_pictures(&elsewhere, &reference, &judged).unwrap(), exact);
        let nothing = Mask { valid: vec![false; width * height], ..judged };
        assert!(compare_pictures(&reference, &reference, &nothing).is_none());
    }
}
