//! A disc as a light. From afar points are uniform in its area (the concentric map of Shirley & Chiu 1997);
//! near, where solid angle and area part, directions are uniform in the solid angle of the square around it
//! (Ureña, Fajardo & King 2013), and those that miss the disc give nothing: the density never falls below
//! 1/2π, so that the variance stays finite down to touch.

use super::rectangle::{Rectangle, Seen as SeenSquare};
use crate::light::cos_bound;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_4, PI};

/// Nearer to the disc's nearest point than this, in radii, sampling by its square has less variance than by
/// its area (on the axis the two are equal at 0.85).
const NEAR: f64 = 0.85;

/// A one-sided disc.
#[derive(Clone, Debug)]
pub(super) struct Disc {
    pub centre: DVec3,
    x: DVec3,
    y: DVec3,
    /// Unit normal of the side it shines to.
    pub z: DVec3,
    pub radius: f64,
    square: Rectangle,
}

impl Disc {
    pub(super) fn new(centre: DVec3, direction: DVec3, radius: f64) -> Self {
        let z = direction.normalize_or_zero();
        let (x, y) = z.any_orthonormal_pair();
        // (x, y, z) right-handed, so that the square shines along z.
        let (x, y) = if x.cross(y).dot(z) < 0.0 { (y, x) } else { (x, y) };
        let square = Rectangle::new(centre - (x + y) * radius, x * (2.0 * radius), y * (2.0 * radius));
        Self { centre, x, y, z, radius, square }
    }

    /// What `p` sees of it; `None` from behind and from its plane.
    pub(super) fn seen_from(&self, p: DVec3) -> Option<Seen<'_>> {
        let to_centre = self.centre - p;
        let height = -to_centre.dot(self.z);
        if !(height > 0.0 && self.radius > 0.0) {
            return None;
        }
        let aside = (to_centre + self.z * height).length();
        let nearest = height.hypot((aside - self.radius).max(0.0));
        let square = if nearest < NEAR * self.radius { Some(self.square.seen_from(p)?) } else { None };
        Some(Seen { disc: self, to_centre, height, square })
    }

    /// The greatest height of a point of it over the plane through `p` with normal `n`.
    pub(super) fn height_bound(&self, p: DVec3, n: DVec3) -> f64 {
        (self.centre - p).dot(n) + self.radius * self.x.dot(n).hypot(self.y.dot(n))
    }

    pub(super) fn importance(&self, p: DVec3, n: DVec3) -> f64 {
        let Some(seen) = self.seen_from(p).filter(|_| self.height_bound(p, n) > 0.0) else { return 0.0 };
        if let Some(square) = &seen.square {
            return square.solid_angle().clamp(f64::MIN_POSITIVE, PI);
        }
        // The centre's solid angle, the cosine over the ball around it.
        let (distance2, radius2) = (seen.to_centre.length_squared(), self.radius * self.radius);
        let distance = distance2.sqrt();
        let cosine = cos_bound(seen.to_centre.dot(n) / distance, (radius2 / distance2).min(1.0));
        (PI * radius2 * seen.height / (distance2 * distance)).min(PI) * cosine.max(f64::MIN_POSITIVE)
    }
}

/// A disc as seen from a point in front of it, offsets relative to that point.
pub(super) struct Seen<'a> {
    disc: &'a Disc,
    to_centre: DVec3,
    /// Distance of the point from the disc's plane, > 0.
    height: f64,
    /// The square around it, where the point is near.
    square: Option<SeenSquare<'a>>,
}

impl Seen<'_> {
    /// Offset from the point to the sampled point of the disc; `None` where the square's sample misses it.
    pub(super) fn sample(&self, u: DVec2) -> Option<DVec3> {
        match &self.square {
            Some(square) => Some(square.sample(u)).filter(|offset| self.inside(*offset, 0.0)),
            None => {
                let at = concentric(u) * self.disc.radius;
                Some(self.to_centre + self.disc.x * at.x + self.disc.y * at.y)
            }
        }
    }

    fn inside(&self, offset: DVec3, slack: f64) -> bool {
        let at = offset - self.to_centre;
        at.dot(self.disc.x).hypot(at.dot(self.disc.y)) <= self.disc.radius + slack
    }

    /// Density over solid angle at an offset on the disc.
    pub(super) fn pdf(&self, offset: DVec3) -> f64 {
        match &self.square {
            Some(square) => square.pdf(offset),
            None => offset.length().powi(3) / (self.height * PI * self.disc.radius * self.disc.radius),
        }
    }

    /// The offset at which a direction meets the disc.
    #[cfg(test)]
    pub(super) fn hit(&self, direction: DVec3) -> Option<DVec3> {
        let towards = -direction.dot(self.disc.z);
        if towards <= 0.0 {
            return None;
        }
        let distance = self.height / towards;
        let offset = direction * distance;
        // The slack is what rounding a direction to f32 moves the point by.
        self.inside(offset, 2e-7 * distance * distance / self.height).then_some(offset)
    }

    #[cfg(test)]
    pub(super) fn invert(&self, offset: DVec3) -> DVec2 {
        match &self.square {
            Some(square) => square.invert(offset),
            None => {
                let at = offset - self.to_centre;
                let at = DVec2::new(at.dot(self.disc.x), at.dot(self.disc.y)) / self.disc.radius;
                concentric_inverse(at)
            }
        }
    }
}

/// The square [0, 1]² onto the unit disc, area-preserving, neighbours staying neighbours.
fn concentric(u: DVec2) -> DVec2 {
    let p = u * 2.0 - DVec2::ONE;
    let (r, phi) = if p == DVec2::ZERO {
        (0.0, 0.0)
    } else if p.x.abs() > p.y.abs() {
        (p.x, FRAC_PI_4 * (p.y / p.x))
    } else {
        (p.y, 2.0 * FRAC_PI_4 - FRAC_PI_4 * (p.x / p.y))
    };
    DVec2::from_angle(phi) * r
}

#[cfg(test)]
fn concentric_inverse(at: DVec2) -> DVec2 {
    let r = at.length();
    let p = if r == 0.0 {
        DVec2::ZERO
    } else if at.x.abs() > at.y.abs() {
        let a = r.copysign(at.x);
        DVec2::new(a, a * (at.y / at.x).atan() / FRAC_PI_4)
    } else {
        let b = r.copysign(at.y);
        DVec2::new(b * (at.x / at.y).atan() / FRAC_PI_4, b)
    };
    0.5 * (p + DVec2::ONE)
}
