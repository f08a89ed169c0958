//! Radiance pictures (`.hdr`, `.pic`): RGBE, as old or new runs or plain.

use dataset::image::{Image, MAX_SIDE};
use dataset::{Error, Result};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::io::Cursor;
use std::panic::catch_unwind;

/// Most texels per byte: twice as many as old runs of one marker each hold, and more than new ones do.
const MOST_TEXELS_PER_BYTE: u64 = 128;

/// Whether a file begins as a Radiance picture does, whatever its name.
pub(super) fn is_radiance(bytes: &[u8]) -> bool {
    bytes.starts_with(b"#?")
}

/// Reads a Radiance picture; `file` is for messages. Its values are divided by `EXPOSURE` and `COLORCORR`, as
/// the format defines the radiance.
///
/// # Errors
/// [`Error::Invalid`], and [`Error::Unsupported`] for XYZE and for rows that do not run from top to bottom
/// and left to right, with the command that converts the file.
pub fn read_radiance(bytes: &[u8], file: &str) -> Result<Image> {
    let failed = |error: image::ImageError| match error {
        image::ImageError::Unsupported(what) => {
            // (OpenImageIO does not read XYZE.)
            let command = match bytes.windows(4).take(4096).any(|word| word == b"xyze") {
                true => format!("ra_xyze -r {file} converted.hdr"),
                false => format!("oiiotool {file} -o converted.exr"),
            };
            let what = format!("{what}: `{command}` converts it");
            Error::unsupported(file, what)
        }
        error => Error::invalid(file, format!("damaged Radiance picture: {error}")),
    };
    // (Strict reading takes `#?RADIANCE` alone; `#?RGBE` is as common.)
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(failed)?;
    let metadata = decoder.metadata();
    let (width, height) = (metadata.width as usize, metadata.height as usize);
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        let what = format!("size {width}×{height}; expected 1 to {MAX_SIDE} texels on a side");
        return Err(Error::unsupported(file, what));
    }
    if width as u64 * height as u64 > bytes.len() as u64 * MOST_TEXELS_PER_BYTE {
        let what =
            format!("{} bytes cannot hold the {width}×{height} texels that the header names", bytes.len());
        return Err(Error::invalid(file, what));
    }
    let divisors = divisors(bytes);
    if !divisors.iter().all(|divisor| divisor.is_finite() && *divisor > 0.0) {
        let what = format!("EXPOSURE times COLORCORR is {divisors:?}: expected finite numbers above 0");
        return Err(Error::invalid(file, what));
    }
    // (Its counts of runs may overflow on bytes that are none.)
    let read = catch_unwind(move || {
        let mut texels = vec![[0f32; 3]; width * height];
        decoder.read_image(bytemuck::cast_slice_mut(&mut texels)).map(|()| texels)
    });
    let mut texels = read.map_err(|_| Error::invalid(file, "damaged Radiance picture"))?.map_err(failed)?;
    for texel in &mut texels {
        texel.iter_mut().zip(divisors).for_each(|(value, divisor)| *value /= divisor);
    }
    Ok(Image { width, height, texels })
}

/// What the values are to be divided by: all that the header tells of the picture itself. (The decoder counts
/// the indented lines, too, which tell of the pictures that it was made from.)
fn divisors(bytes: &[u8]) -> [f32; 3] {
    let mut divisors = [1.0; 3];
    let header = bytes.split(|byte| *byte == b'\n').take_while(|line| !line.is_empty());
    for line in header.filter_map(|line| std::str::from_utf8(line).ok()) {
        let numbers = |text: &str| -> Vec<f32> {
            text.split_whitespace().map_while(|word| word.parse().ok()).collect()
        };
        let exposure = line.strip_prefix("EXPOSURE=").map(numbers);
        let factors = match (exposure.as_deref(), line.strip_prefix("COLORCORR=").map(numbers).as_deref()) {
            (Some([exposure, ..]), _) => [*exposure; 3],
            (_, Some([r, g, b, ..])) => [*r, *g, *b],
            _ => continue,
        };
        divisors.iter_mut().zip(factors).for_each(|(divisor, factor)| *divisor *= factor);
    }
    divisors
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of 8 × 2 texels with this header and this first row; the second row is plain and grey.
    fn picture(header: &str, row: &[u8]) -> Vec<u8> {
        [header.as_bytes(), b"\n-Y 2 +X 8\n", row, &[128, 128, 128, 129].repeat(8)].concat()
    }

    #[test]
    fn plain_rows_and_old_and_new_runs_are_read() {
        let plain = [128, 64, 32, 129].repeat(8);
        let old = [128, 64, 32, 129, 1, 1, 1, 7];
        let new = [[2, 2, 0, 8], [136, 128, 136, 64]].concat();
        let new = [&new[..], &[8, 32, 32, 32, 32, 32, 32, 32, 32, 136, 129]].concat();
        for row in [&plain[..], &old, &new] {
            let image =
                read_radiance(&picture("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", row), "a.hdr").unwrap();
            assert_eq!((image.width, image.height), (8, 2));
            assert_eq!(image.texels[..8], [[1.0, 0.5, 0.25]; 8]);
            assert_eq!(image.texels[8..], [[1.0; 3]; 8]);
        }
    }

    #[test]
    fn exposure_and_colour_correction_are_undone() {
        let header = "#?RGBE\n# by nobody\nEXPOSURE=2\n\tEXPOSURE=7\nFORMAT=32-bit_rle_rgbe\nEXPOSURE= 4.0\nCOLORCORR=1 2 0.5\n";
        let image = read_radiance(&picture(header, &[128, 128, 128, 132].repeat(8)), "a.hdr").unwrap();
        assert_eq!(image.texels[0], [1.0, 0.5, 2.0]);
    }

    #[test]
    fn what_is_wrong_is_told() {
        let row = [128, 64, 32, 129].repeat(8);
        let good = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n";
        let sized = |size: &str| {
            let bytes = picture(good, &row);
            let at = bytes.windows(9).position(|bytes| bytes == b"-Y 2 +X 8").unwrap();
            [&bytes[..at], size.as_bytes(), &bytes[at + 9..]].concat()
        };
        for (bytes, told) in [
            (
                picture("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n", &row),
                "`ra_xyze -r a.hdr converted.hdr` converts it",
            ),
            (sized("+Y 2 +X 8"), "`oiiotool a.hdr -o converted.exr` converts it"),
            (sized("-Y 20000 +X 40000"), "bytes cannot hold the 40000×20000 texels"),
            (sized("-Y 0 +X 8"), "expected 1 to 65536 texels"),
            (sized("-Y 3 +X 8"), "damaged Radiance picture"),
            (picture("#?RADIANCE\nEXPOSURE=0\n", &row), "EXPOSURE times COLORCORR"),
            (b"#?RADIANCE\n".to_vec(), "damaged Radiance picture"),
            // A run longer than the row, and markers without end.
            (picture(good, &[9, 9, 9, 9, 1, 1, 1, 255]), "damaged Radiance picture"),
            (picture(good, &[[9, 9, 9, 9].to_vec(), [1, 1, 1, 0].repeat(99)].concat()), "a.hdr"),
        ] {
            match read_radiance(&bytes, "a.hdr") {
                Ok(image) => assert!(told == "a.hdr" && image.width == 8),
                Err(error) => assert!(error.to_string().contains(told), "{error}"),
            }
        }
    }
}
