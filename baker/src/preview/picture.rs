//! All pixels of a view.

use super::shade::{Seen, Shader};
use crate::light::luminance;
use crate::trace::paths::path::point_pair;
use crate::trace::paths::{Sequence, SequenceKind};
use crate::trace::rays::Lens;
use crate::{Result, Rgb};
use dataset::host::signals::stop_if_interrupted;
use dataset::observe::Observer;
use dataset::pictures::tone::{self, automatic_exposure};
use glam::Vec2;
use image::ImageEncoder;
use rayon::prelude::*;

/// A view in linear light.
pub(super) struct Picture {
    size: [u32; 2],
    /// Row by row from the top.
    pixels: Vec<Pixel>,
}

/// A pixel's mean radiance, and the shares of its rays that met surfaces with light and without.
struct Pixel {
    radiance: Rgb,
    lit: f32,
    unlit: f32,
}

impl Picture {
    /// Traces a view; a pixel's random numbers are a function of its place, so that threads change nothing.
    pub(super) fn trace(
        shader: &Shader,
        lens: &Lens,
        size: [u32; 2],
        samples: u32,
        seed: u64,
        console: &dyn Observer,
    ) -> Result<Self> {
        let [width, height] = size;
        let progress = console.progress("drawing", height.into());
        let pixel = |x: u32, y: u32| {
            let of = |stream| Sequence::new(seed, SequenceKind::Pixel, y * width + x, stream);
            let (places, paths) = (of(0), of(1));
            let (mut sum, mut lit, mut unlit) = (Rgb::ZERO, 0, 0);
            for i in 0..samples {
                let place = Vec2::new(x as f32, y as f32) + point_pair(places.sample(i));
                let (radiance, seen) = shader.radiance(lens.origin, lens.direction(place), paths, i);
                sum += radiance;
                lit += u32::from(seen == Seen::Lit);
                unlit += u32::from(seen == Seen::Unlit);
            }
            let share = |count: u32| count as f32 / samples as f32;
            Pixel { radiance: sum / samples as f32, lit: share(lit), unlit: share(unlit) }
        };
        let rows: Vec<Vec<Pixel>> = (0..height)
            .into_par_iter()
            .map(|y| {
                stop_if_interrupted()?;
                let row = (0..width).map(|x| pixel(x, y)).collect();
                progress.advance(1);
                Ok(row)
            })
            .collect::<Result<_>>()?;
        Ok(Picture { size, pixels: rows.into_iter().flatten().collect() })
    }

    /// The shares of rays that met surfaces with light, and without.
    pub(super) fn met(&self) -> [f64; 2] {
        let mean = |of: fn(&Pixel) -> f32| {
            self.pixels.iter().map(|pixel| f64::from(of(pixel))).sum::<f64>() / self.pixels.len() as f64
        };
        [mean(|pixel| pixel.lit), mean(|pixel| pixel.unlit)]
    }

    /// The exposure that suits its surfaces with light, as a power of two: see [`automatic_exposure`].
    pub(super) fn exposure(&self) -> f64 {
        let surfaces = self.pixels.iter().filter(|pixel| pixel.lit > 0.5);
        automatic_exposure(surfaces.map(|pixel| luminance(pixel.radiance)))
    }

    /// The bytes of a PNG file.
    pub(super) fn to_png(&self, exposure: f64) -> Vec<u8> {
        let scale = exposure.exp2() as f32;
        let pixels = self.pixels.iter();
        let samples: Vec<u8> =
            pixels.flat_map(|pixel| (pixel.radiance * scale).to_array().map(tone::code)).collect();
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes)
            .write_image(&samples, self.size[0], self.size[1], image::ExtendedColorType::Rgb8)
            .expect("writing a picture into memory cannot fail");
        bytes
    }
}
