//! Tone-mapped pictures of lightmaps and masks.

use super::tone::{bent_code, luminance};
use crate::Result;
use crate::image::{Image, Mask, encode_png};
use crate::store::Dataset;
use rayon::prelude::*;

/// Colour of texels on no surface.
const INVALID: [u8; 3] = [44, 46, 52];

/// An exposure under which the image's bright parts (99th percentile of valid luminance) come out near white;
/// 1 for a black image.
pub fn exposure(image: &Image, mask: &Mask) -> f32 {
    let valid = image.texels.iter().zip(&mask.valid).filter(|(_, valid)| **valid);
    let mut luminances: Vec<f32> =
        valid.map(|(texel, _)| luminance(*texel)).filter(|value| *value > 0.0).collect();
    if luminances.is_empty() {
        return 1.0;
    }
    let bright = (luminances.len() - 1) * 99 / 100;
    let (_, bright, _) = luminances.select_nth_unstable_by(bright, f32::total_cmp);
    (1.0 / *bright).clamp(f32::MIN_POSITIVE, f32::MAX)
}

/// The image as an sRGB PNG at most `max_side` texels on a side (box-filtered), invalid texels a neutral dark
/// tone.
pub fn tone_mapped_png(image: &Image, mask: &Mask, exposure: f32, max_side: usize) -> Vec<u8> {
    let mut reduction = Reduction::new(image.width, image.height, max_side);
    reduction.add_rows(&image.texels, &mask.valid);
    let (image, mask) = reduction.finish();
    encode(&image, &mask, exposure)
}

/// The mask as a grey PNG at most `max_side` texels on a side; grey where texels on and off surfaces meet.
pub fn mask_png(mask: &Mask, max_side: usize) -> Vec<u8> {
    let mut reduction = Reduction::new(mask.width, mask.height, max_side);
    for row in mask.valid.chunks_exact(mask.width.max(1)) {
        // White where valid; every texel counts.
        let white: Vec<[f32; 3]> = row.iter().map(|&valid| [f32::from(u8::from(valid)); 3]).collect();
        reduction.add_rows(&white, &vec![true; white.len()]);
    }
    let (image, _) = reduction.finish();
    let grey: Vec<u8> = image.texels.iter().map(|texel| (texel[0] * 255.0).round() as u8).collect();
    encode_png(&grey, image.width, image.height, image::ExtendedColorType::L8)
}

/// A frame's pages as sRGB PNGs at most `max_side` texels on a side, under one exposure.
pub fn pictures(dataset: &Dataset, frame: usize, max_side: usize) -> Result<Vec<Vec<u8>>> {
    let pages = 0..dataset.config.pages.len();
    let reduced =
        pages.into_par_iter().map(|page| reduce(dataset, &dataset.mask(page)?, frame, page, max_side));
    let reduced: Vec<(Image, Mask)> = reduced.collect::<Result<_>>()?;
    let lit = reduced.iter().filter(|(image, _)| is_lit(image));
    let exposure = lit.map(|(image, mask)| exposure(image, mask)).min_by(f32::total_cmp).unwrap_or(1.0);
    Ok(reduced.iter().map(|(image, mask)| encode(image, mask, exposure)).collect())
}

/// Whether any texel has light.
pub fn is_lit(image: &Image) -> bool {
    image.texels.iter().any(|texel| luminance(*texel) > 0.0)
}

/// A frame's map of one page, at most `side` texels on a side, read a few rows at a time.
pub fn reduce(
    dataset: &Dataset,
    mask: &Mask,
    frame: usize,
    page: usize,
    side: usize,
) -> Result<(Image, Mask)> {
    /// Rows that are held in memory at once.
    const ROWS: usize = 256;
    let mut reduction = Reduction::new(mask.width, mask.height, side);
    for y0 in (0..mask.height).step_by(ROWS) {
        let y1 = (y0 + ROWS).min(mask.height);
        let valid = &mask.valid[y0 * mask.width..y1 * mask.width];
        match valid.contains(&true) {
            true => reduction.add_rows(&dataset.map_rows(frame, page, y0, y1)?, valid),
            false => reduction.skip_rows(y1 - y0),
        }
    }
    Ok(reduction.finish())
}

/// Box filter by a whole factor: means over the valid texels of each box, of an image that comes a few rows
/// at a time.
#[derive(Debug)]
pub struct Reduction {
    width: usize,
    factor: usize,
    reduced_width: usize,
    rows_added: usize,
    sums: Vec<([f64; 3], u32)>,
}

impl Reduction {
    /// Of an image of this size, to at most `max_side` texels on a side.
    pub fn new(width: usize, height: usize, max_side: usize) -> Self {
        let factor = width.max(height).div_ceil(max_side.max(1)).max(1);
        let reduced_width = width.div_ceil(factor);
        let sums = vec![([0.0; 3], 0); reduced_width * height.div_ceil(factor)];
        Reduction { width, factor, reduced_width, rows_added: 0, sums }
    }

    /// Adds the next whole rows.
    pub fn add_rows(&mut self, texels: &[[f32; 3]], valid: &[bool]) {
        for (texels, valid) in texels.chunks_exact(self.width).zip(valid.chunks_exact(self.width)) {
            let start = self.rows_added / self.factor * self.reduced_width;
            for (x, (texel, _)) in texels.iter().zip(valid).enumerate().filter(|(_, (_, valid))| **valid) {
                let (sum, count) = &mut self.sums[start + x / self.factor];
                *sum = std::array::from_fn(|channel| sum[channel] + f64::from(texel[channel]));
                *count += 1;
            }
            self.rows_added += 1;
        }
    }

    /// Passes over rows that have no valid texel.
    pub fn skip_rows(&mut self, rows: usize) {
        self.rows_added += rows;
    }

    /// The reduced image, and where it has valid texels.
    pub fn finish(self) -> (Image, Mask) {
        let (width, height) = (self.reduced_width, self.sums.len() / self.reduced_width);
        let mean = |(sum, count): &([f64; 3], u32)| sum.map(|sum| (sum / f64::from((*count).max(1))) as f32);
        let image = Image { width, height, texels: self.sums.iter().map(mean).collect() };
        let mask = Mask { width, height, valid: self.sums.iter().map(|(_, count)| *count > 0).collect() };
        (image, mask)
    }
}

/// Where the tone curve leaves the straight line: 1 becomes 0.93.
const KNEE: f32 = 0.8;

/// The image as an sRGB PNG, invalid texels a neutral dark tone.
pub fn encode(image: &Image, mask: &Mask, exposure: f32) -> Vec<u8> {
    let texels = image.texels.iter().zip(&mask.valid);
    let pixels = texels.flat_map(
        |(texel, valid)| if *valid { texel.map(|v| bent_code(v * exposure, KNEE)) } else { INVALID },
    );
    encode_png(&pixels.collect::<Vec<u8>>(), image.width, image.height, image::ExtendedColorType::Rgb8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(png: &[u8]) -> image::RgbImage {
        image::load_from_memory(png).unwrap().to_rgb8()
    }

    #[test]
    fn bright_parts_are_near_white_at_any_scale() {
        for scale in [1e-30f32, 1e-3, 1.0, 1e6, 1e30] {
            let mut image = Image::black(40, 10);
            image
                .texels
                .iter_mut()
                .enumerate()
                .for_each(|(i, texel)| *texel = [scale * (1 + i % 40) as f32 / 40.0; 3]);
            let mask = Mask { width: 40, height: 10, valid: vec![true; 400] };
            let picture = decode(&tone_mapped_png(&image, &mask, exposure(&image, &mask), 64));
            let [first, last] = [picture.get_pixel(0, 0)[0], picture.get_pixel(39, 0)[0]];
            assert!(last > 240 && first < 60, "{first}, {last} at {scale}");
        }
    }

    #[test]
    fn black_and_empty_images_have_exposure_one() {
        let image = Image::black(3, 3);
        for valid in [true, false] {
            let mask = Mask { width: 3, height: 3, valid: vec![valid; 9] };
            assert_eq!(exposure(&image, &mask), 1.0);
            assert_eq!(decode(&tone_mapped_png(&image, &mask, 1.0, 2)).dimensions(), (2, 2));
        }
    }

    #[test]
    fn invalid_texels_do_not_bleed_into_the_means() {
        // Boxes of 2×2: one valid texel each in the first, none in the second.
        let texels = [[0.5; 3], [9.0; 3], [9.0; 3], [9.0; 3]].repeat(2);
        let valid = [true, false, false, false].repeat(2);
        let image = Image { width: 4, height: 2, texels };
        let mask = Mask { width: 4, height: 2, valid };
        let picture = decode(&tone_mapped_png(&image, &mask, 1.0, 2));
        assert_eq!(picture.dimensions(), (2, 1));
        // sRGB of 0.5 is 188.
        assert_eq!(picture.get_pixel(0, 0).0, [188; 3]);
        assert_eq!(picture.get_pixel(1, 0).0, INVALID);
    }

    #[test]
    fn a_mask_picture_shows_shares() {
        let mask = Mask { width: 4, height: 1, valid: vec![true, true, false, true] };
        let picture = decode(&mask_png(&mask, 2));
        assert_eq!([picture.get_pixel(0, 0)[0], picture.get_pixel(1, 0)[0]], [255, 128]);
    }
}
