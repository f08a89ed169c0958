//! The normals of a page, by which the sun's visibility becomes light.
//!
//! A PNG file, 16-bit RGB, of the page's size. Its samples s from 1 to 65535 are the components x, y (up), z
//! as in the geometry: (s − 32768) ÷ 32767. Per texel, the mean of the shading normals there: shorter than 1
//! where they differ; 0 where there is no surface.

use crate::image::{encode_png_by, read_png_of};
use crate::{Error, Result};
use std::path::Path;

/// The sample value of 0.
const ZERO: i32 = 1 << 15;
/// How far a component of length 1 is from it.
const ONE: i32 = ZERO - 1;
/// What rounding may make a normal longer than 1.
const ROUNDING: f32 = 1e-4;

/// The normals of a page.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// `width · height` normals, row by row from the top; none longer than 1, but for rounding.
    pub normals: Vec<[f32; 3]>,
}

impl Normals {
    /// The bytes of a file.
    ///
    /// # Panics
    /// If there are no texels, or their number is not `width · height`.
    pub fn to_png(&self) -> Vec<u8> {
        let samples: Vec<[u16; 3]> = self.normals.iter().map(|normal| samples_of(*normal)).collect();
        png_of(&samples, self.width, self.height)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Unsupported`] of other kinds of PNG; [`Error::Invalid`] of damaged files, and
    /// with the texel whose normal is longer than 1.
    pub fn read_png(path: &Path) -> Result<Self> {
        let (width, height, bytes) = read_png_of(path, image::ColorType::Rgb16, "16-bit RGB")?;
        let component = |sample: &[u8]| {
            (i32::from(u16::from_ne_bytes([sample[0], sample[1]])) - ZERO) as f32 / ONE as f32
        };
        let normal = |texel: &[u8]| [0, 2, 4].map(|i| component(&texel[i..i + 2]));
        let normals: Vec<[f32; 3]> = bytes.chunks_exact(6).map(normal).collect();
        let length = |normal: &[f32; 3]| normal.iter().map(|x| x * x).sum::<f32>().sqrt();
        if let Some(index) = normals.iter().position(|normal| length(normal) > 1.0 + ROUNDING) {
            let place = format!("{}, texel ({}, {})", path.display(), index % width, index / width);
            let what = format!("a normal of length {}; expected at most 1", length(&normals[index]));
            return Err(Error::invalid(place, what));
        }
        Ok(Normals { width, height, normals })
    }
}

/// A normal as a file has it.
pub fn samples_of(normal: [f32; 3]) -> [u16; 3] {
    normal.map(|x| ((x * ONE as f32).round() as i32 + ZERO).clamp(1, 2 * ZERO - 1) as u16)
}

/// The bytes of a file of such samples, row by row from the top.
///
/// # Panics
/// If there are none, or their number is not `width · height`.
pub fn png_of(samples: &[[u16; 3]], width: usize, height: usize) -> Vec<u8> {
    // Where charts are flat texels are those above, bit by bit; it is also the filter that readers undo with
    // least work.
    let filter = image::codecs::png::FilterType::Up;
    encode_png_by(bytemuck::cast_slice(samples), width, height, image::ExtendedColorType::Rgb16, filter)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(normals: Vec<[f32; 3]>, width: usize) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("normals.png");
        let height = normals.len() / width;
        std::fs::write(&path, Normals { width, height, normals }.to_png()).unwrap();
        (folder, path)
    }

    #[test]
    fn components_are_kept_to_half_a_step() {
        let of = |i: usize| {
            let angle = i as f32 * 0.37;
            let length = if i.is_multiple_of(5) { 0.3 } else { 1.0 };
            [angle.cos() * 0.6, angle.sin() * 0.6, if i.is_multiple_of(2) { 0.8 } else { -0.8 }]
                .map(|x| x * length)
        };
        let mut normals: Vec<[f32; 3]> = (0..21).map(of).collect();
        normals[3] = [0.0; 3];
        normals[4] = [0.0, -1.0, 0.0];
        let (_folder, path) = written(normals.clone(), 7);
        let read = Normals::read_png(&path).unwrap();
        assert_eq!(
            (read.width, read.height, read.normals[3], read.normals[4]),
            (7, 3, [0.0; 3], [0.0, -1.0, 0.0])
        );
        for (a, b) in normals.iter().flatten().zip(read.normals.iter().flatten()) {
            assert!((a - b).abs() <= 0.5 / 32767.0 + 1e-7, "{a} {b}");
        }
    }

    #[test]
    fn what_is_no_normal_is_named() {
        let (_folder, path) = written(vec![[0.0; 3], [0.0; 3], [1.0, 1.0, 0.0], [0.0; 3]], 2);
        let error = Normals::read_png(&path).unwrap_err().to_string();
        assert!(error.contains("texel (0, 1): a normal of length 1.41"), "{error}");
        let png = crate::image::Mask { width: 2, height: 1, valid: vec![true; 2] }.to_png();
        std::fs::write(&path, png).unwrap();
        assert!(Normals::read_png(&path).unwrap_err().to_string().contains("expected 16-bit RGB"));
        std::fs::write(&path, b"no picture").unwrap();
        assert!(matches!(Normals::read_png(&path), Err(Error::Invalid { .. })));
    }
}
