//! Images in memory and their files: RGB float32 EXR and 8-bit masks.

use crate::{Error, Result};
use glam::{Vec2, Vec3};
use image::ImageDecoder;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

mod openexr;

pub(crate) use openexr::{Channels, find_channels, read_rows_of, write_exr};
pub use openexr::{exr_of, read_exr_rows, read_exr_size};

/// Largest width and height that is read.
pub const MAX_SIDE: usize = 65536;

/// No compression of EXR or PNG shrinks data by more than this factor (deflate: 1032); a file that claims
/// more texels than its length can hold is refused before anything is allocated.
const MAX_COMPRESSION_RATIO: u64 = 1100;

/// A row-major RGB float32 image, linear Rec. 709.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// `width · height` texels, row by row from the top.
    pub texels: Vec<[f32; 3]>,
}

/// A row-major validity mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// True where the texel lies on a surface that light reaches.
    pub valid: Vec<bool>,
}

impl Image {
    /// A black image.
    pub fn black(width: usize, height: usize) -> Self {
        Image { width, height, texels: vec![[0.0; 3]; width * height] }
    }

    /// The light at a place in texels, whose centres stand at (i + ½), as a game's bilinear filter reads it;
    /// the edge goes on outside.
    ///
    /// # Panics
    /// If the image has no texels.
    pub fn at(&self, place: Vec2) -> Vec3 {
        let place = place - 0.5;
        let (low, f) = (place.floor(), place - place.floor());
        // (Negative numbers become 0.)
        let texel = |x: f32, y: f32| {
            let (x, y) = ((x as usize).min(self.width - 1), (y as usize).min(self.height - 1));
            Vec3::from(self.texels[y * self.width + x])
        };
        let upper = texel(low.x, low.y).lerp(texel(low.x + 1.0, low.y), f.x);
        let lower = texel(low.x, low.y + 1.0).lerp(texel(low.x + 1.0, low.y + 1.0), f.x);
        upper.lerp(lower, f.y)
    }

    /// The image as the bytes of an EXR file (channels R, G, B; float32; RLE), the same for the same texels.
    ///
    /// # Panics
    /// If the image has no texels, or their number is not `width · height`.
    pub fn to_exr(&self) -> Vec<u8> {
        assert_eq!(
            self.texels.len(),
            self.width * self.height,
            "texels of a {}×{} image",
            self.width,
            self.height
        );
        exr_of(self.width, self.height, |y, row| {
            row.copy_from_slice(&self.texels[y * self.width..(y + 1) * self.width])
        })
    }

    /// Reads an EXR file with channels R, G, B. Every texel must be finite; layers' negative values are the
    /// caller's rule.
    pub fn read_exr(path: &Path) -> Result<Self> {
        let (width, height) = read_exr_size(path)?;
        let texels = read_exr_rows(path, 0, height)?;
        refuse_texels(path, width, 0, &texels, |value| !value.is_finite(), "a finite value")?;
        Ok(Image { width, height, texels })
    }
}

/// Refuses sizes of zero, beyond [`MAX_SIDE`], or beyond what `file_bytes` can hold.
fn refuse_size(path: &Path, width: usize, height: usize, texel_bytes: u64, file_bytes: u64) -> Result<()> {
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        let what = format!("size {width}×{height}; expected 1 to {MAX_SIDE} texels on a side");
        return Err(Error::unsupported(path.display(), what));
    }
    if width as u64 * height as u64 * texel_bytes > file_bytes * MAX_COMPRESSION_RATIO {
        let what =
            format!("{file_bytes} bytes cannot hold the {width}×{height} texels that the header names");
        return Err(Error::invalid(path.display(), what));
    }
    Ok(())
}

/// The first texel with a value that is `bad`, as an error that names file, (x, y), channel and value.
/// `texels` are whole rows of `width` texels from row `y0` on.
pub(crate) fn refuse_texels(
    path: &Path,
    width: usize,
    y0: usize,
    texels: &[[f32; 3]],
    bad: impl Fn(f32) -> bool,
    expected: &str,
) -> Result<()> {
    let Some(index) = texels.iter().position(|texel| texel.iter().any(|&value| bad(value))) else {
        return Ok(());
    };
    let channel = texels[index].iter().position(|&value| bad(value)).unwrap_or(0);
    let (x, y) = (index % width, y0 + index / width);
    let place = format!("{}, texel ({x}, {y})", path.display());
    let what =
        format!("channel {} is {}; expected {expected}", ["R", "G", "B"][channel], texels[index][channel]);
    Err(Error::invalid(place, what))
}

/// Adds texels to others, channel by channel in float32.
pub(crate) fn add(sum: &mut [[f32; 3]], addend: &[[f32; 3]]) {
    for (sum, addend) in sum.iter_mut().zip(addend) {
        *sum = std::array::from_fn(|channel| sum[channel] + addend[channel]);
    }
}

impl Mask {
    /// The mask as the bytes of an 8-bit grey PNG: 255 valid, 0 not.
    ///
    /// # Panics
    /// If the mask has no texels, or their number is not `width · height`.
    pub fn to_png(&self) -> Vec<u8> {
        let grey: Vec<u8> = self.valid.iter().map(|&valid| if valid { 255 } else { 0 }).collect();
        encode_png(&grey, self.width, self.height, image::ExtendedColorType::L8)
    }

    /// Reads a grey PNG whose texels are 0 or 255.
    pub fn read_png(path: &Path) -> Result<Self> {
        let (width, height, grey) = read_png_of(path, image::ColorType::L8, "8-bit grey")?;
        if let Some(index) = grey.iter().position(|&value| value != 0 && value != 255) {
            let place = format!("{}, texel ({}, {})", path.display(), index % width, index / width);
            return Err(Error::invalid(place, format!("mask value {}; expected 0 or 255", grey[index])));
        }
        Ok(Mask { width, height, valid: grey.iter().map(|&value| value == 255).collect() })
    }

    /// Number of valid texels.
    pub fn count(&self) -> usize {
        self.valid.iter().filter(|&&valid| valid).count()
    }
}

/// Reads a PNG file of one colour type, `expected` as text: width, height, and its samples in the machine's
/// byte order.
pub(crate) fn read_png_of(
    path: &Path,
    colour: image::ColorType,
    expected: &str,
) -> Result<(usize, usize, Vec<u8>)> {
    let file = File::open(path).map_err(Error::io(path))?;
    let file_bytes = file.metadata().map_err(Error::io(path))?.len();
    let damaged = |error: image::ImageError| match error {
        image::ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            Error::Io { path: path.to_owned(), source }
        }
        error => Error::invalid(path.display(), format!("damaged PNG file: {error}")),
    };
    let decoder = image::codecs::png::PngDecoder::new(BufReader::new(file)).map_err(damaged)?;
    if decoder.color_type() != colour {
        let what = format!("colour type {:?}; expected {expected}", decoder.color_type());
        return Err(Error::unsupported(path.display(), what));
    }
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    let texel = usize::from(colour.bytes_per_pixel());
    refuse_size(path, width, height, texel as u64, file_bytes)?;
    let mut samples = vec![0; width * height * texel];
    decoder.read_image(&mut samples).map_err(damaged)?;
    Ok((width, height, samples))
}

/// `width · height` samples of the colour type as a PNG file.
///
/// # Panics
/// If there are more or fewer samples.
pub fn encode_png(samples: &[u8], width: usize, height: usize, colour: image::ExtendedColorType) -> Vec<u8> {
    encode_png_by(samples, width, height, colour, image::codecs::png::FilterType::Adaptive)
}

/// [`encode_png`] with a filter of its rows.
pub(crate) fn encode_png_by(
    samples: &[u8],
    width: usize,
    height: usize,
    colour: image::ExtendedColorType,
    filter: image::codecs::png::FilterType,
) -> Vec<u8> {
    use image::ImageEncoder;
    use image::codecs::png::{CompressionType, PngEncoder};
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::default(), filter)
        .write_image(samples, width as u32, height as u32, colour)
        .expect("writing a valid picture into memory cannot fail");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_read_at_their_centres_and_between() {
        let texels = [[0.0, 0.0, 4.0], [1.0, 0.0, 4.0], [2.0, 8.0, 4.0], [3.0, 8.0, 4.0]].to_vec();
        let image = Image { width: 2, height: 2, texels };
        for (place, expected) in [
            ([0.5, 0.5], [0.0, 0.0, 4.0]),
            ([1.5, 1.5], [3.0, 8.0, 4.0]),
            ([1.0, 0.5], [0.5, 0.0, 4.0]),
            ([1.0, 1.25], [2.0, 6.0, 4.0]),
            ([0.0, 0.0], [0.0, 0.0, 4.0]),
            ([9.0, 1.5], [3.0, 8.0, 4.0]),
        ] {
            assert_eq!(image.at(Vec2::from_array(place)).to_array(), expected, "{place:?}");
        }
    }
}
