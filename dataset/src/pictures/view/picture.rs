//! Samples of a picture, and their light.

use super::lens::Camera;
use super::lookout;
use super::model::{self, Model};
use super::raster::{Fragment, draw};
use crate::Result;
use crate::format::Config;
use crate::image::{Image, encode_png};
use crate::pictures::tone;
use crate::store::Dataset;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;
use std::ops::Range;

/// Samples along each side of a pixel.
const FINE: usize = 2;
/// Rows of maps that are held in memory at once: whole tiles of a bundle.
const ROWS: usize = 8 * 126;
/// What is shown where nothing is: radiance as exposed.
const SKY: Vec3 = Vec3::new(0.06, 0.07, 0.085);

/// What a sample shows.
#[derive(Clone, Copy, Debug)]
enum Shown {
    Sky,
    /// A surface without texels, which gets this share of the median light.
    Plain(f32),
    /// A place on a page, in texels.
    Texel {
        page: usize,
        at: Vec2,
    },
}

/// A scene seen by a camera.
#[derive(Debug)]
pub struct View {
    /// From where.
    pub camera: Camera,
    size: [usize; 2],
    /// Row by row, [`FINE`]² to a pixel: base colour, and whose light is on it.
    samples: Vec<(Vec3, Shown)>,
    /// Those with texels, by page and row, so that maps are read once.
    lit: Vec<u32>,
}

/// Irradiance on the samples of a view.
#[derive(Debug)]
pub struct Light {
    irradiance: Vec<Vec3>,
}

impl View {
    /// A picture of `size` pixels of a dataset's scene: by its first camera that sees texels, or from where
    /// most is in view. `None` without a geometry file, or where nothing in it has texels.
    ///
    /// # Errors
    /// A geometry file or mask that cannot be read, or is invalid.
    pub fn of(dataset: &Dataset, size: [usize; 2]) -> Result<Option<View>> {
        let Some(model) = read(dataset)? else { return Ok(None) };
        let seen_by = |camera| View::seen_by(camera, &model, &dataset.config, size);
        match cameras(&dataset.config, &model).find_map(seen_by) {
            Some(view) => Ok(Some(view)),
            None => Ok(seen_by(lookout(dataset, &model)?)),
        }
    }

    /// Pictures by every camera of the scene that sees texels, `most` at most: those of the scene file, then
    /// of the geometry file, each name once; by the automatic one where there is none. Nothing without a
    /// geometry file, or where nothing in it has texels.
    ///
    /// # Errors
    /// As [`View::of`].
    pub fn each(dataset: &Dataset, size: [usize; 2], most: usize) -> Result<Vec<View>> {
        let Some(model) = read(dataset)? else { return Ok(Vec::new()) };
        let mut views: Vec<View> = Vec::new();
        for camera in cameras(&dataset.config, &model) {
            if views.len() < most && views.iter().all(|view| view.camera.name != camera.name) {
                views.extend(View::seen_by(camera, &model, &dataset.config, size));
            }
        }
        if views.is_empty() {
            views.extend(View::seen_by(lookout(dataset, &model)?, &model, &dataset.config, size));
        }
        Ok(views)
    }

    fn seen_by(camera: Camera, model: &Model, config: &Config, size: [usize; 2]) -> Option<View> {
        let fragments = draw(model, &camera, size.map(|side| side * FINE), false);
        let samples: Vec<_> = fragments.iter().map(|fragment| shown(model, config, fragment)).collect();
        let mut lit: Vec<u32> = Vec::new();
        lit.extend((0..samples.len()).filter(|&i| row(&samples[i].1).is_some()).map(|i| i as u32));
        lit.sort_by_key(|&i| row(&samples[i as usize].1));
        (!lit.is_empty()).then_some(View { camera, size, samples, lit })
    }

    /// The share of each pixel, row by row, that shows texels.
    pub fn with_texels(&self) -> Vec<f32> {
        self.means(|i| f32::from(u8::from(row(&self.samples[i].1).is_some())))
    }

    /// The light on its samples; `read` gives rows of a page.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn light(
        &self,
        config: &Config,
        mut read: impl FnMut(usize, Range<usize>) -> Result<Image>,
    ) -> Result<Light> {
        let mut irradiance = vec![Vec3::ZERO; self.samples.len()];
        let mut strip: Option<(usize, Range<usize>, Image)> = None;
        for &i in &self.lit {
            let Shown::Texel { page, at } = self.samples[i as usize].1 else { continue };
            let height = config.pages[page].height as usize;
            let first = first_row(at).min(height - 1);
            if strip.as_ref().is_none_or(|(of, rows, _)| *of != page || !rows.contains(&first)) {
                let start = first / ROWS * ROWS;
                let rows = start..(start + ROWS).min(height);
                // With the row below, for those between.
                let image = read(page, start..(rows.end + 1).min(height))?;
                strip = Some((page, rows, image));
            }
            if let Some((_, rows, image)) = &strip {
                irradiance[i as usize] = image.at(at - Vec2::new(0.0, rows.start as f32));
            }
        }
        // (At night the mean is that of a few places right below lamps.)
        let median = self.median(&irradiance);
        for (light, (_, shown)) in irradiance.iter_mut().zip(&self.samples) {
            if let Shown::Plain(share) = shown {
                *light = median * *share;
            }
        }
        Ok(Light { irradiance })
    }

    /// The median of each channel over what has texels.
    fn median(&self, irradiance: &[Vec3]) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|channel| {
            let mut values: Vec<f32> = self.lit.iter().map(|&i| irradiance[i as usize][channel]).collect();
            let middle = values.len() / 2;
            *values.select_nth_unstable_by(middle, f32::total_cmp).1
        }))
    }

    /// The exposure that suits a light where there are texels, as a power of two: see
    /// [`tone::automatic_exposure`].
    pub fn exposure(&self, light: &Light) -> f64 {
        let pixels = self.radiance(light, Vec3::ZERO).into_iter().zip(self.with_texels());
        let pixels = pixels.filter(|(_, share)| *share > 0.5);
        tone::automatic_exposure(pixels.map(|(radiance, _)| tone::luminance(radiance.to_array())))
    }

    /// The bytes of a PNG file.
    pub fn to_png(&self, light: &Light, exposure: f64) -> Vec<u8> {
        let codes = self.to_codes(light, exposure);
        encode_png(&codes, self.size[0], self.size[1], image::ExtendedColorType::Rgb8)
    }

    /// The sRGB codes of that picture: red, green and blue of each pixel, row by row.
    pub fn to_codes(&self, light: &Light, exposure: f64) -> Vec<u8> {
        let scale = exposure.exp2() as f32;
        let pixels = self.radiance(light, SKY / scale).into_iter();
        pixels.flat_map(|pixel| (pixel * scale).to_array().map(tone::code)).collect()
    }

    /// The radiance of each pixel, row by row, in the light's own unit; the sky is black.
    pub fn to_radiance(&self, light: &Light) -> Vec<[f32; 3]> {
        self.radiance(light, Vec3::ZERO).into_iter().map(|pixel| pixel.to_array()).collect()
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The bytes of a PNG file of values that are colours already, such as of errors, and no light: they are
    /// shown as they are.
    pub fn to_map(&self, values: &Light) -> Vec<u8> {
        const NOTHING: Vec3 = Vec3::splat(0.1);
        let of = |i: usize| match self.samples[i].1 {
            Shown::Texel { .. } => values.irradiance[i],
            Shown::Plain(_) => NOTHING,
            Shown::Sky => SKY,
        };
        let codes: Vec<u8> =
            self.means(of).into_iter().flat_map(|pixel| pixel.to_array().map(tone::code)).collect();
        encode_png(&codes, self.size[0], self.size[1], image::ExtendedColorType::Rgb8)
    }

    /// Of each pixel, the mean radiance, by that of the sky.
    fn radiance(&self, light: &Light, sky: Vec3) -> Vec<Vec3> {
        let of = |i: usize| match self.samples[i] {
            (_, Shown::Sky) => sky,
            (albedo, _) => albedo * light.irradiance[i] / PI,
        };
        self.means(of)
    }

    /// Of each pixel, the mean over its samples.
    fn means<T>(&self, of: impl Fn(usize) -> T) -> Vec<T>
    where
        T: std::iter::Sum + std::ops::Div<f32, Output = T>,
    {
        let [width, height] = self.size;
        let pixels = (0..width * height).map(|pixel| {
            let (x, y) = (pixel % width * FINE, pixel / width * FINE);
            let samples = (0..FINE * FINE).map(|k| of((y + k / FINE) * width * FINE + x + k % FINE));
            samples.sum::<T>() / (FINE * FINE) as f32
        });
        pixels.collect()
    }
}

/// The geometry of a dataset that has it.
fn read(dataset: &Dataset) -> Result<Option<Model>> {
    let Some(file) = &dataset.config.geometry else { return Ok(None) };
    model::read(&dataset.path(file), &dataset.read(file)?, &dataset.config).map(Some)
}

/// The cameras of a scene: of the scene file, which the manifest keeps, then of the geometry file.
fn cameras(config: &Config, model: &Model) -> impl Iterator<Item = Camera> {
    Camera::of_manifest(config).chain(model.cameras.iter().cloned())
}

/// A default camera.
fn lookout(dataset: &Dataset, model: &Model) -> Result<Camera> {
    let masks = dataset.masks()?;
    let is_lit = |page: usize, at: Vec2| {
        let mask = &masks[page];
        let texel = |at: f32, side: usize| ((at * side as f32) as usize).min(side - 1);
        mask.valid[texel(at.y, mask.height) * mask.width + texel(at.x, mask.width)]
    };
    Ok(lookout::choose(model, &is_lit))
}

/// What a fragment shows.
fn shown(model: &Model, config: &Config, fragment: &Fragment) -> (Vec3, Shown) {
    if !fragment.is_surface() {
        return (Vec3::ZERO, Shown::Sky);
    }
    let (part, triangle) = (&model.parts[fragment.part as usize], fragment.triangle as usize);
    let (albedo, _) = model.colour(&model.shapes[part.shape], triangle, fragment.at);
    let texel = model.texel(part, triangle, fragment.at).filter(|_| !fragment.is_back);
    let shown = match texel {
        Some((page, at)) => {
            let size = &config.pages[page];
            Shown::Texel { page, at: at * Vec2::new(size.width as f32, size.height as f32) }
        }
        // A little more from above, so that shapes are recognisable.
        None => Shown::Plain(0.8 + 0.2 * model.normal(part, triangle).y as f32),
    };
    (albedo, shown)
}

/// Page and first row of what a sample shows, if it has texels.
fn row(shown: &Shown) -> Option<(usize, usize)> {
    match shown {
        Shown::Texel { page, at } => Some((*page, first_row(*at))),
        _ => None,
    }
}

/// The upper of the two rows around a place. (Negative numbers become 0.)
fn first_row(at: Vec2) -> usize {
    (at.y - 0.5) as usize
}
