//! Pages a strip of whole tiles at a time, the large ones of [`super::LARGE`] too, so that memory grows with
//! their width, not with their height.

use super::LARGE;
use crate::decode::{Decoder, Lights};
use crate::law::{Law, LayerRows};
use crate::{Result, of_bundle};
use dataset::image::{Image, Mask};
use dataset::store::Dataset;
use std::ops::Range;

/// Texels of a strip, about: 100 MB an image.
const TEXELS: usize = 1 << 23;

/// The rows of each strip of a page that has a valid texel.
pub(crate) fn strips(mask: &Mask) -> Vec<Range<usize>> {
    of_height(mask, (TEXELS / mask.width / LARGE).max(1) * LARGE)
}

fn of_height(mask: &Mask, height: usize) -> Vec<Range<usize>> {
    let rows = |y: usize| y..(y + height).min(mask.height);
    (0..mask.height).step_by(height).map(rows).filter(|rows| valid(mask, rows).contains(&true)).collect()
}

/// The mask of some rows, row by row.
pub(crate) fn valid<'a>(mask: &'a Mask, rows: &Range<usize>) -> &'a [bool] {
    &mask.valid[rows.start * mask.width..rows.end * mask.width]
}

/// The mask of some rows.
pub(crate) fn cut(mask: &Mask, rows: &Range<usize>) -> Mask {
    Mask { width: mask.width, height: rows.len(), valid: valid(mask, rows).to_vec() }
}

/// Rows of a page of a frame: what `law` has of its light.
pub(crate) fn read(
    dataset: &Dataset,
    law: &Law,
    frame: usize,
    page: usize,
    rows: &Range<usize>,
) -> Result<Image> {
    let width = dataset.config.pages[page].width as usize;
    let (texels, _) = law.rows(dataset, [frame, page], [rows.start, rows.end], &mut LayerRows::new())?;
    Ok(Image { width, height: rows.len(), texels })
}

/// Rows of a page as a bundle has them at an hour.
pub(crate) fn decode(
    decoder: &Decoder,
    lights: Lights,
    page: usize,
    hour: f64,
    rows: &Range<usize>,
) -> Result<Image> {
    let ndgi::decode::Image { width, height, texels } =
        decoder.decode_rows_of(lights, page, hour, rows.clone()).map_err(of_bundle)?;
    Ok(Image { width, height, texels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_are_whole_tiles_with_something_valid() {
        let (width, height) = (3, 700);
        let valid = |y: usize| (130..140).contains(&y) || y == 699;
        let mask = Mask { width, height, valid: (0..width * height).map(|i| valid(i / width)).collect() };
        assert_eq!(of_height(&mask, 128), [128..256, 640..700]);
        assert_eq!(of_height(&mask, 256), [0..256, 512..700]);
        assert_eq!(strips(&mask).as_slice(), std::slice::from_ref(&(0..700)));
        assert_eq!(cut(&mask, &(139..141)).valid, [true, true, true, false, false, false]);
    }
}
