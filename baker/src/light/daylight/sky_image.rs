//! A lat-long picture of the sky by direction.

use crate::Rgb;
use crate::scene::SkyImage;
use dataset::image::Image;
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// The picture with the turn it is hung up with: bilinear between texel centres, around the seam too.
#[derive(Clone, Debug)]
pub struct ImageMap {
    image: Arc<Image>,
    frame: LatLong,
}

impl ImageMap {
    pub fn new(sky: &SkyImage) -> Self {
        Self { image: sky.radiance.clone(), frame: LatLong { turn: sky.rotation.to_radians() } }
    }

    pub fn image(&self) -> &Image {
        &self.image
    }

    pub fn frame(&self) -> LatLong {
        self.frame
    }

    pub fn is_black(&self) -> bool {
        self.image.texels.iter().all(|texel| *texel == [0.0; 3])
    }

    /// Radiance from a unit direction, kcd/m².
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let Image { width, height, ref texels } = *self.image;
        let at = self.frame.square_of(direction.as_dvec3());
        // Texel centres stand at half numbers; columns wrap, rows end.
        let x = at.x * width as f64 - 0.5;
        let y = (at.y * height as f64 - 0.5).clamp(0.0, (height - 1) as f64);
        let (fx, fy) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
        let left = (x.floor() as i64).rem_euclid(width as i64) as usize;
        let right = if left + 1 == width { 0 } else { left + 1 };
        let top = y as usize;
        let bottom = (top + 1).min(height - 1);
        let texel = |x: usize, y: usize| Vec3::from_array(texels[y * width + x]);
        let high = texel(left, top) * (1.0 - fx) + texel(right, top) * fx;
        let low = texel(left, bottom) * (1.0 - fx) + texel(right, bottom) * fx;
        high * (1.0 - fy) + low * fy
    }
}

/// The map of the sphere to [0, 1)²: x is the azimuth, clockwise seen from above, −Z in the middle if not
/// turned; y the angle from +Y.
#[derive(Clone, Copy, Debug)]
pub struct LatLong {
    /// Radians clockwise from −Z to the middle column.
    turn: f64,
}

impl LatLong {
    pub fn square_of(self, d: DVec3) -> DVec2 {
        let azimuth = d.x.atan2(-d.z) - self.turn;
        DVec2::new((0.5 + azimuth / TAU).rem_euclid(1.0), d.x.hypot(d.z).atan2(d.y) / PI)
    }

    pub fn direction_of(self, at: DVec2) -> DVec3 {
        let (sin_azimuth, cos_azimuth) = ((at.x - 0.5) * TAU + self.turn).sin_cos();
        let (sin, cos) = (at.y * PI).sin_cos();
        DVec3::new(sin * sin_azimuth, cos, -sin * cos_azimuth)
    }
}

#[cfg(test)]
#[path = "sky_image_tests.rs"]
mod tests;
