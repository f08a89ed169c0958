//! Thin glass: surfaces that let a part of the light straight through.

use super::{Geometry, Material};
use crate::Rgb;
use glam::{Vec3, Vec4};

/// Less than this passes nowhere that counts: light is taken to be blocked.
pub const BLOCKED_BELOW: f32 = 1e-6;
/// A point that lets less through than this is a wall to tests of what lies inside or behind what.
const OPENS_FROM: f32 = 1.0 / 64.0;

/// What a material lets straight through. It is thin: light is neither bent nor spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glass {
    /// Share of the light that passes, per channel, in [0, 1]; the rest may be reflected.
    pub transmission: Vec3,
    /// Multiplies what passes, together with the colour of the material's texture; `None`: neither does.
    pub tint: Option<Vec3>,
    /// Index into textures: its red channel, linear, multiplies `transmission`.
    pub texture: Option<u32>,
    /// Whether alpha is coverage: 1 − alpha of the light passes beside the surface, untinted.
    pub is_blended: bool,
}

impl Glass {
    /// Glass that lets this share pass, and nothing else.
    pub fn clear(transmission: Vec3) -> Self {
        Glass { transmission, tint: None, texture: None, is_blended: false }
    }

    /// Every bit of it.
    pub(super) fn key(&self) -> [u32; 10] {
        let [r, g, b] = self.transmission.to_array().map(f32::to_bits);
        let [x, y, z] = self.tint.unwrap_or(Vec3::ZERO).to_array().map(f32::to_bits);
        let texture = self.texture.map_or([0, 0], |texture| [1, texture]);
        let flags = u32::from(self.is_blended) | u32::from(self.tint.is_some()) << 1;
        [r, g, b, x, y, z, texture[0], texture[1], flags, 1]
    }
}

impl Geometry {
    /// Whether any material is glass.
    pub fn has_glass(&self) -> bool {
        !self.glass.is_empty()
    }

    /// What a material lets through; `None` of an opaque one.
    pub fn glass_of(&self, material: u32) -> Option<&Glass> {
        self.glass.get(material as usize)?.as_ref()
    }

    /// Whether a triangle is of glass.
    #[inline]
    pub fn is_glass(&self, triangle: usize) -> bool {
        self.has_glass() && self.glass_of(self.material_of[triangle]).is_some()
    }

    /// Per channel, the share of light that passes straight through a point, from either side; zero of an
    /// opaque material.
    pub fn transmittance_at(&self, triangle: usize, barycentrics: Vec3) -> Rgb {
        let index = self.material_of[triangle];
        let Some(glass) = self.glass_of(index) else { return Rgb::ZERO };
        let material = &self.materials[index as usize];
        let sampled = material.texture.filter(|_| glass.tint.is_some() || glass.is_blended);
        let vertex = self.vertex_colour_at(triangle, barycentrics).unwrap_or(Vec4::ONE);
        let (colour, alpha) = (vertex.truncate(), material.alpha * vertex.w);
        let (colour, alpha) = match sampled {
            None => (colour, alpha),
            Some(texture) => {
                let texture = &self.textures[texture as usize];
                let sampled = texture.sample(self.uv_at(triangle, barycentrics));
                (colour * sampled.0, alpha * sampled.1)
            }
        };
        let through = self.passing(glass, triangle, barycentrics);
        let through = glass.tint.map_or(through, |tint| through * tint * colour);
        // Alpha is how much of the point the surface covers.
        let coverage = if glass.is_blended { alpha } else { 1.0 };
        (through * coverage + (1.0 - coverage)).clamp(Rgb::ZERO, Rgb::ONE)
    }

    /// What of its albedo a point of a glass material keeps, per channel: what neither passes through it nor
    /// beside it.
    pub(super) fn kept_at(&self, triangle: usize, barycentrics: Vec3) -> Rgb {
        let Some(glass) = self.glass_of(self.material_of[triangle]) else { return Rgb::ONE };
        let coverage = if glass.is_blended { self.alpha_at(triangle, barycentrics) } else { 1.0 };
        (Rgb::ONE - self.passing(glass, triangle, barycentrics)) * coverage
    }

    /// The share that passes through the surface itself, before any tint.
    fn passing(&self, glass: &Glass, triangle: usize, barycentrics: Vec3) -> Rgb {
        let texture = glass.texture.map(|texture| &self.textures[texture as usize]);
        let factor = texture.map_or(1.0, |texture| texture.sample_red(self.uv_at(triangle, barycentrics)));
        glass.transmission * factor
    }

    /// Whether a point is a wall to tests of what lies inside or behind what: opaque, or as good as.
    pub fn is_wall_at(&self, triangle: usize, barycentrics: Vec3) -> bool {
        !self.is_glass(triangle) || self.transmittance_at(triangle, barycentrics).max_element() < OPENS_FROM
    }

    /// Whether a point lies on an edge of its triangle that counts for the triangle on the other side: a ray
    /// meets both there, and would pass one pane twice. Of the two, which run along the edge against each
    /// other, it counts for the one that does so upwards.
    pub fn is_of_neighbour(&self, triangle: usize, barycentrics: Vec3) -> bool {
        /// Weights below this are zero but for rounding.
        const ZERO: f32 = 1e-9;
        let weights = barycentrics.to_array();
        let corners = self.corners(triangle);
        // On one edge alone: at a corner it counts for all.
        match [0, 1, 2].map(|k: usize| weights[k].abs() < ZERO) {
            [true, false, false] => is_downwards(corners[1], corners[2]),
            [false, true, false] => is_downwards(corners[2], corners[0]),
            [false, false, true] => is_downwards(corners[0], corners[1]),
            _ => false,
        }
    }

    /// The most that a material of this number keeps of its albedo anywhere.
    pub(super) fn keeps_at_most(&self, index: usize, material: &Material) -> f32 {
        match self.glass_of(index as u32) {
            Some(glass) => most_kept(glass, material.alpha),
            None => 1.0,
        }
    }
}

/// Whether the way from `a` to `b` leads down in the order of their coordinates.
fn is_downwards(a: Vec3, b: Vec3) -> bool {
    a.to_array() > b.to_array()
}

/// The most that glass keeps of its albedo anywhere, in any channel; `alpha` is the material's factor.
pub(super) fn most_kept(glass: &Glass, alpha: f32) -> f32 {
    let passing = if glass.texture.is_some() { 0.0 } else { glass.transmission.min_element() };
    (1.0 - passing) * if glass.is_blended { alpha } else { 1.0 }
}
