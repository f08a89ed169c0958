//! How much of the sun a texel sees: points of its surface, each with a place on the sun's disc, that look at
//! it from one time to the next.

use super::lights::{SunLight, SunSample};
use crate::Rgb;
use crate::trace::counts::RayCounts;
use crate::trace::solids::{Receiver, Space};
use glam::Vec3;

/// Points that are asked first; where all see the same, no more are.
const FIRST_POINTS: usize = 8;

/// Difference between what points see up to which they see the same.
const MOST_DIFFERENCE: f32 = 1.0 / 32.0;

/// The angle between normals of a flat texel at most, in radians.
const FLAT_ANGLE: f32 = 2e-3;

/// The sun at a time.
pub(crate) struct SunAtTime {
    sun: SunLight,
    /// The mean direction towards the disc; not a unit vector.
    pub mean: Vec3,
    /// Directions to the points of the disc that texels sample, by index.
    directions: Vec<Vec3>,
}

impl SunAtTime {
    /// A sun and its places, which are the same at all times.
    pub(crate) fn new(sun: SunLight, mean: Vec3, places: &[SunSample]) -> Self {
        SunAtTime { sun, mean, directions: places.iter().map(|place| sun.sample(place)).collect() }
    }
}

/// A texel's points.
pub(crate) struct VisibilitySampler {
    /// Each with the index of its place on the disc.
    points: Vec<(Receiver, usize)>,
    /// The mean of the points' shading normals; not a unit vector where they differ.
    pub normal: Vec3,
    axis: Vec3,
    /// The greatest angle between a normal and `axis`, in radians.
    spread: f32,
}

impl VisibilitySampler {
    /// From points of a texel's surface, each with the index of its place on the disc; `None` without any.
    pub(crate) fn new(points: Vec<(Receiver, usize)>) -> Option<Self> {
        let normal = points.iter().map(|(at, _)| at.normal).sum::<Vec3>() / points.len() as f32;
        let axis = normal.try_normalize().unwrap_or(Vec3::Y);
        let angle = |(at, _): &(Receiver, usize)| axis.dot(at.normal).clamp(-1.0, 1.0).acos();
        let spread = points.iter().map(angle).reduce(f32::max)?;
        Some(VisibilitySampler { points, normal, axis, spread })
    }

    /// The sine of the elevation of a sun's centre above the plane across the axis from which on all of it
    /// stands before all of the points, and below the negative of which none of it stands before any.
    fn margin(&self, sun: &SunLight) -> f32 {
        /// For rounding, of normals and of angles.
        const ROUNDING: f32 = 1e-3;
        (self.spread + sun.disc().half_angle + ROUNDING).min(std::f32::consts::FRAC_PI_2).sin()
    }

    /// Whether the texel is flat and all of a sun stands before it: then light that came straight from the
    /// sun is the part that was not blocked, times a number that all of its points share.
    pub(crate) fn is_fully_facing(&self, SunAtTime { sun, .. }: &SunAtTime) -> bool {
        self.spread < FLAT_ANGLE && self.axis.dot(sun.disc().direction) > self.margin(sun)
    }

    /// The part of a sun's light that reaches the texel, from 0 to 1 per channel: times `normal` · `sun.mean`
    /// and the sun's irradiance, it gives the irradiance of the texel. `None` where `normal` · `sun.mean` is
    /// not positive: the texel looks away.
    ///
    /// It is the share of light that is not blocked, but where the texel looks away in part: there normal ·
    /// mean is less than what would arrive unblocked, and the part is so much greater, up to 1.
    pub(crate) fn visibility(
        &self,
        space: &Space,
        SunAtTime { sun, mean, directions }: &SunAtTime,
        counts: &mut RayCounts,
    ) -> Option<Rgb> {
        let elevation = self.axis.dot(sun.disc().direction);
        let product = self.normal.dot(*mean);
        if product <= 0.0 || elevation < -self.margin(sun) {
            return None;
        }
        let (mut sum, mut cosines) = (Rgb::ZERO, 0.0);
        let (mut least, mut most) = (Rgb::ONE, Rgb::ZERO);
        for (i, &(ref at, place)) in self.points.iter().enumerate() {
            if i >= FIRST_POINTS && cosines > 0.0 && (most - least).max_element() <= MOST_DIFFERENCE {
                break;
            }
            let direction = directions[place];
            let cosine = direction.dot(at.normal);
            if cosine <= 0.0 {
                continue;
            }
            let seen = if direction.dot(at.face_normal) <= 0.0 {
                Rgb::ZERO
            } else {
                counts.visibility += 1;
                space.ray_tracer.transmittance(at.origin, direction, f32::INFINITY, at.triangle)
            };
            sum += seen * cosine;
            cosines += cosine;
            (least, most) = (least.min(seen), most.max(seen));
        }
        if cosines == 0.0 {
            return None;
        }
        let share = sum / cosines;
        if elevation > self.margin(sun) || share == Rgb::ZERO {
            return Some(share);
        }
        let cosine = |&(ref at, place): &(Receiver, usize)| directions[place].dot(at.normal).max(0.0);
        let unblocked = self.points.iter().map(cosine).sum::<f32>() / self.points.len() as f32;
        Some((share * (unblocked / product).max(1.0)).min(Rgb::ONE))
    }
}
