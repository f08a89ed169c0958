//! Lightmaps to import, from any source.

use super::raw::Raw;
use crate::format::Group;
use crate::image::{self, Channels, Mask};
use crate::{Error, Result};
use ::image::{ImageError, ImageReader};
use std::path::{Path, PathBuf};

/// A dataset of lightmaps elsewhere, its files found and their sizes checked.
pub(super) struct Incoming {
    /// What the manifest calls it.
    pub layout: &'static str,
    pub config: Option<Vec<u8>>,
    pub unit: String,
    /// Ascending, in [0, 24).
    pub hours: Vec<f64>,
    /// Without layers.
    pub groups: Vec<Group>,
    pub pages: Vec<IncomingPage>,
}

/// A lightmap at all hours.
pub(super) struct IncomingPage {
    pub width: usize,
    pub height: usize,
    /// All are to agree; without any, every texel is valid.
    pub masks: Vec<MaskFile>,
    /// One per hour.
    pub frames: Vec<IncomingFrame>,
}

/// A lightmap at one hour.
pub(super) struct IncomingFrame {
    pub whole: Light,
    /// The shares of sun, sky and lamps.
    pub shares: Option<[Light; 3]>,
}

/// Where light is read from.
pub(super) enum Light {
    Raw(Raw),
    Exr(PathBuf, Channels),
}

impl Light {
    /// Rows `y0 .. y1`; their values are not checked.
    pub(super) fn rows(&self, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
        match self {
            Light::Raw(raw) => raw.light(y0, y1),
            Light::Exr(path, channels) => image::read_rows_of(path, channels, y0, y1),
        }
    }

    /// The file that holds a row.
    pub(super) fn path(&self, y: usize) -> &Path {
        match self {
            Light::Raw(raw) => raw.path(y),
            Light::Exr(path, _) => path,
        }
    }
}

/// Where a mask is read from.
pub(super) enum MaskFile {
    Raw(Raw),
    /// A picture: light is valid.
    Picture(PathBuf),
}

impl IncomingPage {
    pub(super) fn mask(&self) -> Result<Mask> {
        let (width, height) = (self.width, self.height);
        let mut mask: Option<(Mask, &MaskFile)> = None;
        for file in &self.masks {
            let Some((first, first_file)) = &mut mask else {
                let mut valid = Vec::with_capacity(width * height);
                file.read((width, height), |_, rows| {
                    valid.extend_from_slice(rows);
                    Ok(())
                })?;
                mask = Some((Mask { width, height, valid }, file));
                continue;
            };
            file.read((width, height), |y0, rows| {
                let own = &first.valid[y0 * width..][..rows.len()];
                match rows.iter().zip(own).position(|(a, b)| a != b) {
                    None => Ok(()),
                    Some(i) => {
                        let (x, y) = (i % width, y0 + i / width);
                        let place = format!("{}, texel ({x}, {y})", file.path(y).display());
                        let reported = |valid: bool| if valid { "valid" } else { "not valid" };
                        let what = format!(
                            "{}, but {} in {}; expected the same mask at all hours",
                            reported(rows[i]),
                            reported(own[i]),
                            first_file.path(y).display()
                        );
                        Err(Error::invalid(place, what))
                    }
                }
            })?;
        }
        let all = || Mask { width, height, valid: vec![true; width * height] };
        Ok(mask.map_or_else(all, |(mask, _)| mask))
    }
}

impl MaskFile {
    /// Gives whole rows with the number of the first.
    fn read(
        &self,
        (width, height): (usize, usize),
        mut each: impl FnMut(usize, &[bool]) -> Result<()>,
    ) -> Result<()> {
        match self {
            MaskFile::Raw(raw) => {
                let rows = super::raw::block_rows(width);
                (0..height).step_by(rows).try_for_each(|y| each(y, &raw.valid(y, (y + rows).min(height))?))
            }
            MaskFile::Picture(path) => each(0, &read_picture(path, (width, height))?),
        }
    }

    fn path(&self, y: usize) -> &Path {
        match self {
            MaskFile::Raw(raw) => raw.path(y),
            MaskFile::Picture(path) => path,
        }
    }
}

/// A mask painted by others: valid where a picture is at least half white and half opaque, where an EXR is
/// above one half.
fn read_picture(path: &Path, size: (usize, usize)) -> Result<Vec<bool>> {
    let expect = |found: (usize, usize)| match found == size {
        true => Ok(()),
        false => {
            let what = format!("size {}×{}; expected {}×{}", found.0, found.1, size.0, size.1);
            Err(Error::invalid(path.display(), what))
        }
    };
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
        let (channels, found) = image::find_channels(path, None)?;
        expect(found)?;
        let texels = image::read_rows_of(path, &channels, 0, size.1)?;
        return Ok(texels.iter().map(|texel| texel.iter().any(|&v| v > 0.5)).collect());
    }
    let damaged = |error: ImageError| match error {
        ImageError::IoError(source) => Error::Io { path: path.to_owned(), source },
        error => Error::invalid(path.display(), error),
    };
    let open = || {
        let reader = ImageReader::open(path).map_err(Error::io(path))?;
        reader.with_guessed_format().map_err(Error::io(path))
    };
    // The header alone decides whether the picture is read at all.
    let (width, height) = open()?.into_dimensions().map_err(damaged)?;
    expect((width as usize, height as usize))?;
    let mut reader = open()?;
    reader.no_limits();
    let picture = reader.decode().map_err(damaged)?;
    let grey = picture.into_luma_alpha8();
    Ok(grey.pixels().map(|pixel| pixel.0.iter().all(|&value| value >= 128)).collect())
}
