//! Sampling of lamps from a receiving point: each a trio `sample`, `pdf`, `invert`.
//!
//! Sphere: uniform in the cone it fills. Rectangle: uniform in its solid angle (Ureña, Fajardo & King 2013,
//! "An Area- Preserving Parametrization for Spherical Rectangles"). Disc: by area from afar, near by the
//! solid angle of its square. Spot and point: points. All inner arithmetic is f64: lamps of 10⁻⁴ m and
//! distances of 10⁵ m keep their digits without special cases.

use super::ball::Cone;
use super::disc::Disc;
use super::rectangle::Rectangle;
use crate::Rgb;
#[cfg(test)]
use crate::light::cosine_hemisphere_inverse;
use crate::light::{cosine_hemisphere, luminance};
use crate::scene::{Lamp, Profile};
#[cfg(test)]
use glam::DVec2;
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// A ball of no more than this, as a part of the largest coordinate, is a point but for rounding.
const TINY: f64 = 1e-6;

/// A lamp made ready for sampling, in the geometry's local space.
#[derive(Clone, Debug)]
pub(super) struct LampSampler {
    shape: Shape,
    /// Radiance in kcd/m², a spot's on-axis intensity in kcd; in a bake both in units of the group's
    /// brightest number.
    light: Rgb,
    luminance: f64,
}

#[derive(Clone, Debug)]
enum Shape {
    Sphere { centre: DVec3, radius: f64 },
    Rectangle(Rectangle),
    Disc(Disc),
    Point { position: DVec3 },
    Spot { position: DVec3, axis: DVec3, cos_inner: f64, cos_outer: f64 },
    Ies(Box<Ies>),
}

/// A spot whose intensity a photometric file gives.
#[derive(Clone, Debug)]
struct Ies {
    position: DVec3,
    axis: DVec3,
    cos_inner: f64,
    cos_outer: f64,
    /// Towards horizontal angles 0 and 90°; those run counter-clockwise as seen against the axis, from above
    /// a ceiling lamp.
    x: DVec3,
    y: DVec3,
    profile: Arc<Profile>,
}

/// One sample of a lamp's light at a receiver.
#[derive(Clone, Copy, Debug)]
pub struct LampSample {
    /// Unit vector from the receiver.
    pub direction: Vec3,
    /// Distance to the emitting point.
    pub distance: f32,
    /// Unoccluded irradiance estimate L·cosθ ÷ pdf at the receiver, for the receiver's normal; zero: no ray
    /// is needed.
    pub irradiance: Rgb,
    /// For a surface of the scene that emits, which a path may meet too: its triangle, and the density over
    /// solid angle of this direction, the choice among emitters included. `None` for a lamp, which no path
    /// meets.
    pub emitter: Option<(u32, f32)>,
    /// Whether a surface in whose plane the point lies leaves it unshaded: not of a ball, half of which lies
    /// behind a surface through it.
    pub is_flat: bool,
}

/// A bound of a light, for choosing among many.
#[derive(Clone, Copy, Debug)]
pub struct Outline {
    /// Corners of a box around it.
    pub low: DVec3,
    pub high: DVec3,
    /// The axis it shines along, within `spread` of which its normals lie (radians; π: all directions); unit.
    pub axis: DVec3,
    pub spread: f64,
    /// Greatest angle between a normal and the light's direction, radians.
    pub reach: f64,
    /// Luminous intensity along a normal, luminance in kcd.
    pub intensity: f64,
}

impl LampSampler {
    /// Prepares a lamp; `origin` is the world position of the local origin.
    pub(super) fn new(lamp: &Lamp, origin: DVec3) -> Self {
        let (shape, light) = match *lamp {
            Lamp::Sphere { centre, radius, radiance } => {
                (Shape::Sphere { centre: centre - origin, radius }, radiance)
            }
            Lamp::Rectangle { corner, edge_u, edge_v, radiance } => {
                (Shape::Rectangle(Rectangle::new(corner - origin, edge_u, edge_v)), radiance)
            }
            Lamp::Disc { centre, direction, radius, radiance } => {
                (Shape::Disc(Disc::new(centre - origin, direction, radius)), radiance)
            }
            Lamp::Point { position, intensity } => (Shape::Point { position: position - origin }, intensity),
            Lamp::Spot { position, direction, inner, outer, intensity } => {
                let (cos_inner, cos_outer) = (inner.cos(), outer.cos());
                (
                    Shape::Spot { position: position - origin, axis: direction, cos_inner, cos_outer },
                    intensity,
                )
            }
            Lamp::Ies { position, direction, up, inner, outer, intensity, ref profile } => {
                let (cos_inner, cos_outer) = (inner.cos(), outer.cos());
                let (position, x, y) = (position - origin, up, up.cross(direction));
                let profile = profile.clone();
                let ies = Ies { position, axis: direction, cos_inner, cos_outer, x, y, profile };
                (Shape::Ies(Box::new(ies)), intensity)
            }
        };
        let light = light.as_vec3();
        Self { shape, light, luminance: f64::from(luminance(light)) }
    }

    /// Samples the lamp by solid angle as seen from `point` with unit `normal`. `None` when it cannot reach
    /// that side. `u` in [0, 1)².
    pub(super) fn sample(&self, point: Vec3, normal: Vec3, u: Vec2) -> Option<LampSample> {
        let (p, n, u) = (point.as_dvec3(), normal.as_dvec3(), u.as_dvec2());
        // Direction, distance and 1/pdf; for a spot 1/pdf stands for falloff/distance².
        let (direction, distance, weight) = match &self.shape {
            Shape::Sphere { centre, radius } => {
                let cone = Cone::new(*centre - p, *radius);
                if let Some(cone) = cone {
                    if cone.cos_bound(n) <= 0.0 {
                        return None;
                    }
                    let (direction, distance) = cone.sample(u);
                    (direction, distance, cone.solid_angle())
                } else {
                    // Inside: every direction meets the shell; cosine-weighted about the normal.
                    let direction = cosine_hemisphere(n, u);
                    let cosine = direction.dot(n);
                    (
                        direction,
                        to_shell(p - *centre, direction, *radius),
                        if cosine > 0.0 { PI / cosine } else { 0.0 },
                    )
                }
            }
            Shape::Rectangle(rectangle) => {
                let seen = rectangle.seen_from(p)?;
                if rectangle.height_bound(p, n) <= 0.0 {
                    return None;
                }
                let offset = seen.sample(u);
                let distance = offset.length();
                (offset / distance, distance, 1.0 / seen.pdf(offset))
            }
            Shape::Disc(disc) => {
                let seen = disc.seen_from(p)?;
                if disc.height_bound(p, n) <= 0.0 {
                    return None;
                }
                let offset = seen.sample(u)?;
                let distance = offset.length();
                (offset / distance, distance, 1.0 / seen.pdf(offset))
            }
            Shape::Point { .. } | Shape::Spot { .. } | Shape::Ies(_) => self.point(p)?,
        };
        let irradiance = self.light * (weight * direction.dot(n).max(0.0)) as f32;
        let (direction, distance) = (direction.as_vec3(), distance as f32);
        let is_flat = match &self.shape {
            Shape::Sphere { centre, radius } => *radius <= TINY * centre.abs().max(p.abs()).max_element(),
            _ => true,
        };
        let sample = LampSample { direction, distance, irradiance, emitter: None, is_flat };
        (sample.direction.is_finite() && sample.distance > 0.0 && irradiance.is_finite()).then_some(sample)
    }

    /// Density of [`LampSampler::sample`] over solid angle in a unit `direction` from `point`; 0 off the
    /// lamp. Spots and points have no density: 0.
    #[cfg(test)]
    pub(super) fn pdf(&self, point: Vec3, normal: Vec3, direction: Vec3) -> f32 {
        let (p, n, direction) = (point.as_dvec3(), normal.as_dvec3(), direction.as_dvec3());
        let pdf = match &self.shape {
            Shape::Sphere { centre, radius } => match Cone::new(*centre - p, *radius) {
                Some(cone) if cone.cos_bound(n) > 0.0 && cone.contains(direction) => 1.0 / cone.solid_angle(),
                Some(_) => 0.0,
                None => direction.dot(n).max(0.0) / PI,
            },
            Shape::Rectangle(rectangle) => match rectangle.seen_from(p) {
                Some(seen) if rectangle.height_bound(p, n) > 0.0 => {
                    seen.hit(direction).map_or(0.0, |o| seen.pdf(o))
                }
                _ => 0.0,
            },
            Shape::Disc(disc) => match disc.seen_from(p) {
                Some(seen) if disc.height_bound(p, n) > 0.0 => {
                    seen.hit(direction).map_or(0.0, |o| seen.pdf(o))
                }
                _ => 0.0,
            },
            Shape::Point { .. } | Shape::Spot { .. } | Shape::Ies(_) => 0.0,
        };
        pdf as f32
    }

    /// The `u` for which [`LampSampler::sample`] gives a unit `direction` from `point`; `None` off the lamp,
    /// and for spots and points.
    #[cfg(test)]
    pub(super) fn invert(&self, point: Vec3, normal: Vec3, direction: Vec3) -> Option<Vec2> {
        let (p, n, direction) = (point.as_dvec3(), normal.as_dvec3(), direction.as_dvec3());
        let u = match &self.shape {
            Shape::Sphere { centre, radius } => match Cone::new(*centre - p, *radius) {
                Some(cone) => {
                    (cone.cos_bound(n) > 0.0 && cone.contains(direction)).then(|| cone.invert(direction))?
                }
                None => (direction.dot(n) > 0.0).then(|| cosine_hemisphere_inverse(n, direction))?,
            },
            Shape::Rectangle(rectangle) => {
                let seen = rectangle.seen_from(p).filter(|_| rectangle.height_bound(p, n) > 0.0)?;
                seen.invert(seen.hit(direction)?)
            }
            Shape::Disc(disc) => {
                let seen = disc.seen_from(p).filter(|_| disc.height_bound(p, n) > 0.0)?;
                seen.invert(seen.hit(direction)?)
            }
            Shape::Point { .. } | Shape::Spot { .. } | Shape::Ies(_) => return None,
        };
        Some(u.clamp(DVec2::ZERO, DVec2::ONE).as_vec2())
    }

    /// A cheap guess of the unoccluded irradiance luminance at `point`, for choosing among lamps of a
    /// group: zero only where `sample` always gives nothing, never an estimate of the light itself.
    pub(super) fn importance(&self, point: Vec3, normal: Vec3) -> f32 {
        let (p, n) = (point.as_dvec3(), normal.as_dvec3());
        let received = match &self.shape {
            Shape::Sphere { centre, radius } => match Cone::new(*centre - p, *radius) {
                // π sin²θ cosθ, the cosine that of the cone's point nearest the normal.
                Some(cone) => PI * cone.sin2 * cone.cos_bound(n).max(0.0),
                None => PI,
            },
            Shape::Rectangle(rectangle) => rectangle.importance(p, n),
            Shape::Disc(disc) => disc.importance(p, n),
            Shape::Point { .. } | Shape::Spot { .. } | Shape::Ies(_) => {
                self.point(p).map_or(0.0, |(direction, _, weight)| weight * direction.dot(n).max(0.0))
            }
        };
        // The smallest positive number keeps a faint lamp choosable; the largest finite one keeps sums
        // finite.
        let guess = (received * self.luminance) as f32;
        if received > 0.0 && self.luminance > 0.0 { guess.clamp(f32::MIN_POSITIVE, 1e30) } else { 0.0 }
    }

    /// Luminance of its radiance or on-axis intensity.
    pub(super) fn luminance(&self) -> f64 {
        self.luminance
    }

    /// What bounds it.
    pub(super) fn outline(&self) -> Outline {
        use std::f64::consts::FRAC_PI_2;
        let around = |centre: DVec3, radius: f64| (centre - radius, centre + radius);
        let ((low, high), axis, spread, reach, size) = match &self.shape {
            Shape::Sphere { centre, radius } => {
                (around(*centre, *radius), DVec3::Y, PI, FRAC_PI_2, PI * radius * radius)
            }
            Shape::Rectangle(r) => (r.bounds(), r.normal(), 0.0, FRAC_PI_2, r.area()),
            Shape::Disc(d) => (around(d.centre, d.radius), d.z, 0.0, FRAC_PI_2, PI * d.radius * d.radius),
            Shape::Point { position } => (around(*position, 0.0), DVec3::Y, PI, PI, 1.0),
            Shape::Spot { position, axis, cos_outer, .. } => {
                (around(*position, 0.0), *axis, 0.0, cos_outer.acos(), 1.0)
            }
            Shape::Ies(ies) => {
                let reach = ies.cos_outer.acos().min(ies.profile.reach());
                (around(ies.position, 0.0), ies.axis, 0.0, reach, 1.0)
            }
        };
        Outline { low, high, axis, spread, reach, intensity: size * self.luminance }
    }

    /// Direction and distance to a point or spot, and falloff/distance².
    fn point(&self, p: DVec3) -> Option<(DVec3, f64, f64)> {
        let position = match &self.shape {
            Shape::Point { position } | Shape::Spot { position, .. } => *position,
            Shape::Ies(ies) => ies.position,
            _ => return None,
        };
        let offset = position - p;
        let distance = offset.length();
        if distance <= 0.0 {
            return None;
        }
        let direction = offset / distance;
        let falloff = match &self.shape {
            Shape::Spot { axis, cos_inner, cos_outer, .. } => {
                cone_falloff(-direction.dot(*axis), *cos_inner, *cos_outer)?
            }
            Shape::Ies(ies) => {
                let out = -direction;
                let cone = cone_falloff(out.dot(ies.axis), ies.cos_inner, ies.cos_outer)?;
                let (x, y) = (out.dot(ies.x), out.dot(ies.y));
                let relative = ies.profile.at(x.hypot(y).atan2(out.dot(ies.axis)), y.atan2(x));
                if relative <= 0.0 {
                    return None;
                }
                cone * relative
            }
            _ => 1.0,
        };
        Some((direction, distance, falloff / (distance * distance)))
    }
}

/// What a spot's cone leaves at a cosine to its axis: smoothstep in the cosine, a hard edge where inner =
/// outer.
fn cone_falloff(cosine: f64, cos_inner: f64, cos_outer: f64) -> Option<f64> {
    if cosine >= cos_inner {
        Some(1.0)
    } else if cosine <= cos_outer {
        None
    } else {
        let t = (cosine - cos_outer) / (cos_inner - cos_outer);
        Some(t * t * (3.0 - 2.0 * t))
    }
}

/// Distance from a point inside a ball (`from` its centre) to its shell.
fn to_shell(from: DVec3, direction: DVec3, radius: f64) -> f64 {
    let along = from.dot(direction);
    (along * along + radius * radius - from.length_squared()).max(0.0).sqrt() - along
}

#[cfg(test)]
#[path = "lamp_tests.rs"]
mod tests;
