//! The texels of a blend, read as a game reads them.

use super::blend::Blend;
use super::bundle::{Compressed, of_bundle};
use super::triangle_layout::TriangleLayout;
use crate::{Result, Rgb};
use dataset::image::Image;
use dataset::store::Dataset;
use glam::Vec3;

/// Baked irradiance.
pub(super) struct Baked {
    layout: TriangleLayout,
    pages: Vec<Image>,
}

impl Baked {
    /// Reads the frames of a blend and sums them.
    pub(super) fn read(dataset: &Dataset, blend: &Blend, layout: TriangleLayout) -> Result<Self> {
        let sum = |page: usize| -> Result<Image> {
            let mut sum: Option<Image> = None;
            for &(frame, weight) in &blend.parts {
                let map = dataset.map(frame, page)?;
                let sum = sum.get_or_insert_with(|| Image::black(map.width, map.height));
                let values = sum.texels.as_flattened_mut().iter_mut().zip(map.texels.as_flattened());
                values.for_each(|(sum, value)| *sum += weight * value);
            }
            Ok(sum.unwrap_or_else(|| Image::black(1, 1)))
        };
        let pages = (0..dataset.config.pages.len()).map(sum).collect::<Result<_>>()?;
        Ok(Baked { layout, pages })
    }

    /// Decodes a bundle at an hour.
    pub(super) fn decode(bundle: &Compressed, hour: f64, layout: TriangleLayout) -> Result<Self> {
        let page = |page| {
            let ndgi::decode::Image { width, height, texels } = bundle.decoder.decode_page(page, hour)?;
            Ok(Image { width, height, texels })
        };
        let pages = 0..bundle.decoder.bundle().header.pages.len();
        let pages = pages.map(page).collect::<Result<_, _>>().map_err(of_bundle)?;
        Ok(Baked { layout, pages })
    }

    /// Irradiance at a point of the front of a triangle; `None` where it has no texels.
    pub(super) fn irradiance(&self, triangle: u32, barycentric: Vec3) -> Option<Rgb> {
        let (page, [a, b, c]) = self.layout.of(triangle)?;
        let texel = a * barycentric.x + b * barycentric.y + c * barycentric.z;
        Some(self.pages[page].at(texel))
    }
}
