//! The texels of a blend, read as a game reads them.

use super::blend::Blend;
use super::bundle::{Compressed, of_bundle};
use super::triangle_layout::TriangleLayout;
use crate::{Result, Rgb};
use dataset::image::Image;
use dataset::store::Dataset;
use glam::{Vec2, Vec3};

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
        Some(bilinear(&self.pages[page], texel))
    }
}

/// The image at a place in texels, whose centres stand at (i + ½); its edge goes on outside.
fn bilinear(image: &Image, place: Vec2) -> Rgb {
    let (place, last) = (place - 0.5, [image.width - 1, image.height - 1]);
    let (low, f) = (place.floor(), place - place.floor());
    // (Negative numbers become 0.)
    let column = |x: f32| (x as usize).min(last[0]);
    let row = |y: f32| (y as usize).min(last[1]);
    let at = |x: f32, y: f32| Rgb::from_array(image.texels[row(y) * image.width + column(x)]);
    let upper = at(low.x, low.y).lerp(at(low.x + 1.0, low.y), f.x);
    let lower = at(low.x, low.y + 1.0).lerp(at(low.x + 1.0, low.y + 1.0), f.x);
    upper.lerp(lower, f.y)
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
            assert_eq!(bilinear(&image, Vec2::from_array(place)).to_array(), expected, "{place:?}");
        }
    }
}
