//! Sampling of lamps from a receiving point: each a trio `sample`, `pdf`, `invert`.
//!
//! Sphere: uniform in the cone it fills. Rectangle: uniform in its solid angle (Ureña, Fajardo & King 2013, "An Area-
//! Preserving Parametrization for Spherical Rectangles"). Spot: a point. All inner arithmetic is f64: lamps of 10⁻⁴ m and
//! distances of 10⁵ m keep their digits without special cases.

use super::rectangle::Rectangle;
use super::{cos_bound, luminance};
use crate::Rgb;
use crate::scene::Lamp;
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// A lamp made ready for sampling, in the geometry's local space.
#[derive(Clone, Debug)]
pub struct LampSampler {
    shape: Shape,
    /// Radiance in kcd/m²; a spot's on-axis intensity in kcd.
    light: Rgb,
    luminance: f64,
}

#[derive(Clone, Debug)]
enum Shape {
    Sphere { centre: DVec3, radius: f64 },
    Rectangle(Rectangle),
    Spot { position: DVec3, axis: DVec3, cos_inner: f64, cos_outer: f64 },
}

/// One sample of a lamp's light at a receiver.
#[derive(Clone, Copy, Debug)]
pub struct LampSample {
    /// Unit vector from the receiver.
    pub direction: Vec3,
    /// Distance to the emitting point.
    pub distance: f32,
    /// Unoccluded irradiance estimate L·cosθ ÷ pdf at the receiver, for the receiver's normal; zero: no ray is needed.
    pub irradiance: Rgb,
}

impl LampSampler {
    /// Prepares a lamp; `origin` is the world position of the local origin.
    pub fn new(lamp: &Lamp, origin: DVec3) -> Self {
        let (shape, light) = match *lamp {
            Lamp::Sphere { centre, radius, radiance } => {
                (Shape::Sphere { centre: centre - origin, radius }, radiance)
            }
            Lamp::Rectangle { corner, edge_u, edge_v, radiance } => {
                (Shape::Rectangle(Rectangle::new(corner - origin, edge_u, edge_v)), radiance)
            }
            Lamp::Spot { position, direction, inner, outer, intensity } => {
                let (cos_inner, cos_outer) = (inner.cos(), outer.cos());
                (
                    Shape::Spot { position: position - origin, axis: direction, cos_inner, cos_outer },
                    intensity,
                )
            }
        };
        let light = light.as_vec3();
        Self { shape, light, luminance: f64::from(luminance(light)) }
    }

    /// Samples the lamp by solid angle as seen from `point` with unit `normal`. `None` when it cannot reach that side.
    /// `u` in [0, 1)².
    pub fn sample(&self, point: Vec3, normal: Vec3, u: Vec2) -> Option<LampSample> {
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
            Shape::Spot { .. } => self.spot(p)?,
        };
        let irradiance = self.light * (weight * direction.dot(n).max(0.0)) as f32;
        let sample = LampSample { direction: direction.as_vec3(), distance: distance as f32, irradiance };
        (sample.direction.is_finite() && sample.distance > 0.0 && irradiance.is_finite()).then_some(sample)
    }

    /// Density of [`LampSampler::sample`] over solid angle in a unit `direction` from `point`; 0 off the lamp. A spot is a
    /// point without a density: 0.
    pub fn pdf(&self, point: Vec3, normal: Vec3, direction: Vec3) -> f32 {
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
            Shape::Spot { .. } => 0.0,
        };
        pdf as f32
    }

    /// The `u` for which [`LampSampler::sample`] gives a unit `direction` from `point`; `None` off the lamp, and for a spot.
    pub fn invert(&self, point: Vec3, normal: Vec3, direction: Vec3) -> Option<Vec2> {
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
            Shape::Spot { .. } => return None,
        };
        Some(u.clamp(DVec2::ZERO, DVec2::ONE).as_vec2())
    }

    /// A cheap guess of the unoccluded irradiance luminance at `point`, for choosing among lamps of a
    /// group: zero only where `sample` always gives nothing, never an estimate of the light itself.
    pub fn importance(&self, point: Vec3, normal: Vec3) -> f32 {
        let (p, n) = (point.as_dvec3(), normal.as_dvec3());
        let received = match &self.shape {
            Shape::Sphere { centre, radius } => match Cone::new(*centre - p, *radius) {
                // π sin²θ cosθ, the cosine that of the cone's point nearest the normal.
                Some(cone) => PI * cone.sin2 * cone.cos_bound(n).max(0.0),
                None => PI,
            },
            Shape::Rectangle(rectangle) => rectangle.importance(p, n),
            Shape::Spot { .. } => {
                self.spot(p).map_or(0.0, |(direction, _, weight)| weight * direction.dot(n).max(0.0))
            }
        };
        // The smallest positive number keeps a faint lamp choosable; the largest finite one keeps sums finite.
        let guess = (received * self.luminance) as f32;
        if received > 0.0 && self.luminance > 0.0 { guess.clamp(f32::MIN_POSITIVE, 1e30) } else { 0.0 }
    }

    /// Direction and distance to a spot, and falloff/distance².
    fn spot(&self, p: DVec3) -> Option<(DVec3, f64, f64)> {
        let Shape::Spot { position, axis, cos_inner, cos_outer } = self.shape else { return None };
        let offset = position - p;
        let distance = offset.length();
        if distance <= 0.0 {
            return None;
        }
        let direction = offset / distance;
        let cosine = -direction.dot(axis);
        // Smoothstep in the cosine; a hard edge where inner = outer.
        let falloff = if cosine >= cos_inner {
            1.0
        } else if cosine <= cos_outer {
            return None;
        } else {
            let t = (cosine - cos_outer) / (cos_inner - cos_outer);
            t * t * (3.0 - 2.0 * t)
        };
        Some((direction, distance, falloff / (distance * distance)))
    }
}

/// The cone of directions that a ball fills, from outside.
struct Cone {
    axis: DVec3,
    distance: f64,
    radius: f64,
    /// sin² of the half angle.
    sin2: f64,
    /// 1 − cos of the half angle.
    versine: f64,
}

impl Cone {
    /// `None` inside the ball or on it.
    fn new(to_centre: DVec3, radius: f64) -> Option<Self> {
        let distance = to_centre.length();
        if distance <= radius {
            return None;
        }
        let sin2 = (radius / distance).powi(2);
        // 1 − cos = sin²/(1 + cos) does not cancel for small cones.
        let versine = sin2 / (1.0 + (1.0 - sin2).sqrt());
        (versine > 0.0).then_some(Self { axis: to_centre / distance, distance, radius, sin2, versine })
    }

    fn solid_angle(&self) -> f64 {
        TAU * self.versine
    }

    /// The greatest n·ω over the cone.
    fn cos_bound(&self, n: DVec3) -> f64 {
        cos_bound(self.axis.dot(n), self.sin2)
    }

    fn sample(&self, u: DVec2) -> (DVec3, f64) {
        // 1 − cosθ uniform in [0, 1 − cosθ_max], azimuth uniform.
        let versine = u.x * self.versine;
        let sin2 = versine * (2.0 - versine);
        let (sin_phi, cos_phi) = (TAU * u.y).sin_cos();
        let (x, y) = self.axis.any_orthonormal_pair();
        let direction = self.axis * (1.0 - versine) + (x * cos_phi + y * sin_phi) * sin2.sqrt();
        // Near intersection: d cosθ − √(r² − d² sin²θ).
        let half_chord = (self.radius.powi(2) - self.distance.powi(2) * sin2).max(0.0).sqrt();
        (direction, self.distance * (1.0 - versine) - half_chord)
    }

    fn contains(&self, direction: DVec3) -> bool {
        // The slack is what rounding a direction to f32 moves it by.
        direction.dot(self.axis) > 0.0 && direction.cross(self.axis).length() <= self.sin2.sqrt() + 1e-7
    }

    fn invert(&self, direction: DVec3) -> DVec2 {
        let (x, y) = self.axis.any_orthonormal_pair();
        let (a, b) = (direction.dot(x), direction.dot(y));
        let versine = (a * a + b * b) / (1.0 + direction.dot(self.axis));
        DVec2::new(versine / self.versine, (b.atan2(a) / TAU).rem_euclid(1.0))
    }
}

/// Malley's map: cosine-weighted about `n`.
fn cosine_hemisphere(n: DVec3, u: DVec2) -> DVec3 {
    let (x, y) = n.any_orthonormal_pair();
    let (sin_phi, cos_phi) = (TAU * u.y).sin_cos();
    (x * cos_phi + y * sin_phi) * u.x.sqrt() + n * (1.0 - u.x).sqrt()
}

fn cosine_hemisphere_inverse(n: DVec3, direction: DVec3) -> DVec2 {
    let (x, y) = n.any_orthonormal_pair();
    let (a, b) = (direction.dot(x), direction.dot(y));
    DVec2::new(a * a + b * b, (b.atan2(a) / TAU).rem_euclid(1.0))
}

/// Distance from a point inside a ball (`from` its centre) to its shell.
fn to_shell(from: DVec3, direction: DVec3, radius: f64) -> f64 {
    let along = from.dot(direction);
    (along * along + radius * radius - from.length_squared()).max(0.0).sqrt() - along
}

#[cfg(test)]
#[path = "lamp_tests.rs"]
mod tests;
