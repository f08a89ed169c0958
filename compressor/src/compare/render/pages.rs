//! Light of tiles as pages, all treated alike off surfaces.

use super::super::tiles::{Fill, Texels, TileSet};
use crate::Result;
use dataset::format::TILE;
use dataset::image::{Image, Mask};
use dataset::store::Dataset;

/// Rings of texels around valid ones that filtering and mips may read. Of what methods have there, and of
/// what the dataset has, nothing is shown: it is the mean of the valid neighbours for all.
const RINGS: usize = 4;

pub(super) struct Pages<'a> {
    dataset: &'a Dataset,
    set: &'a TileSet,
    masks: Vec<Mask>,
    fills: Vec<Fill>,
}

impl<'a> Pages<'a> {
    pub(super) fn new(dataset: &'a Dataset, set: &'a TileSet) -> Result<Self> {
        let masks = dataset.masks()?;
        let fills = masks.iter().map(|mask| Fill::near(mask, RINGS)).collect();
        Ok(Pages { dataset, set, masks, fills })
    }

    /// The dataset's own light: of a frame, or at any hour.
    pub(super) fn of_dataset(&self, hour: f64, frame: Option<usize>) -> Result<Vec<Image>> {
        let page = |page: usize| {
            let image = match frame {
                Some(frame) => self.dataset.map(frame, page)?,
                None => self.dataset.light_at(hour, page)?,
            };
            Ok(self.filled(page, image))
        };
        (0..self.masks.len()).map(page).collect()
    }

    /// Pages of tiles.
    pub(super) fn of_tiles(&self, tiles: &[Texels]) -> Vec<Image> {
        let mut images: Vec<Image> =
            self.masks.iter().map(|mask| Image::black(mask.width, mask.height)).collect();
        for (tile, texels) in self.set.tiles.iter().zip(tiles) {
            let image = &mut images[tile.place.page];
            let (left, top) = (tile.place.column * TILE, tile.place.row * TILE);
            // What is stored goes past the page's edge up to a whole block.
            let width = tile.source.width.min(image.width - left);
            let rows = texels.chunks_exact(tile.source.width).take(image.height - top);
            for (y, row) in rows.enumerate() {
                image.texels[(top + y) * image.width + left..][..width].copy_from_slice(&row[..width]);
            }
        }
        images.into_iter().enumerate().map(|(page, image)| self.filled(page, image)).collect()
    }

    /// A page with what is close to surfaces as all have it.
    pub(super) fn filled(&self, page: usize, image: Image) -> Image {
        Image { texels: self.fills[page].apply(&image.texels), ..image }
    }
}
