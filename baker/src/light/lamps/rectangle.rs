//! A rectangle as a light: its solid angle, and points uniform in it (Ureña, Fajardo & King 2013, "An
//! Area-Preserving Parametrization for Spherical Rectangles").

use crate::light::cos_bound;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// A rectangle in a frame of its own: x along `edge_u`, y along `edge_v`, z to the side it shines to.
#[derive(Clone, Debug)]
pub(crate) struct Rectangle {
    corner: DVec3,
    x: DVec3,
    y: DVec3,
    z: DVec3,
    size: DVec2,
}

impl Rectangle {
    pub(crate) fn new(corner: DVec3, edge_u: DVec3, edge_v: DVec3) -> Self {
        let (x, y) = (edge_u.normalize_or_zero(), edge_v.normalize_or_zero());
        Self { corner, x, y, z: x.cross(y), size: DVec2::new(edge_u.length(), edge_v.length()) }
    }

    /// Unit normal of the side it shines to.
    pub(crate) fn normal(&self) -> DVec3 {
        self.z
    }

    pub(crate) fn area(&self) -> f64 {
        self.size.x * self.size.y
    }

    /// Lower and upper corner of the box around it.
    pub(crate) fn bounds(&self) -> (DVec3, DVec3) {
        let (u, v) = (self.x * self.size.x, self.y * self.size.y);
        let (zero, corner) = (DVec3::ZERO, self.corner);
        (corner + u.min(zero) + v.min(zero), corner + u.max(zero) + v.max(zero))
    }

    /// What `p` sees of it; `None` from behind, from its plane, and where it has no area.
    pub(crate) fn seen_from(&self, p: DVec3) -> Option<Seen<'_>> {
        let corner = self.corner - p;
        let low = DVec2::new(corner.dot(self.x), corner.dot(self.y));
        let seen =
            Seen { frame: self, low, high: low + self.size, height: -corner.dot(self.z), solid_angle: 0.0 };
        if !(seen.height > 0.0 && self.size.min_element() > 0.0) {
            return None;
        }
        Some(Seen { solid_angle: seen.solid_angle_of(seen.high.x), ..seen })
    }

    /// The greatest height of a corner over the plane through `p` with normal `n`.
    pub(crate) fn height_bound(&self, p: DVec3, n: DVec3) -> f64 {
        let u = (self.x.dot(n) * self.size.x).max(0.0);
        let v = (self.y.dot(n) * self.size.y).max(0.0);
        (self.corner - p).dot(n) + u + v
    }

    pub(crate) fn importance(&self, p: DVec3, n: DVec3) -> f64 {
        let to_centre = self.corner + 0.5 * (self.x * self.size.x + self.y * self.size.y) - p;
        let height = -to_centre.dot(self.z);
        if height <= 0.0 || self.size.min_element() <= 0.0 || self.height_bound(p, n) <= 0.0 {
            return 0.0;
        }
        let distance2 = to_centre.length_squared();
        let radius2 = 0.25 * self.size.length_squared();
        if distance2 > 4.0 * radius2 {
            // Far: the centre's solid angle, the cosine over the ball around it.
            let distance = distance2.sqrt();
            let cosine = cos_bound(to_centre.dot(n) / distance, radius2 / distance2);
            return self.size.x * self.size.y * height / (distance2 * distance)
                * cosine.max(f64::MIN_POSITIVE);
        }
        self.seen_from(p).map_or(0.0, |seen| seen.solid_angle.clamp(f64::MIN_POSITIVE, PI))
    }
}

/// Below this solid angle the differences of angles that the spherical rectangle is made of have lost half
/// their digits; points are then chosen by area, which is nearly the same there.
const SMALL_SOLID_ANGLE: f64 = 1e-7;

/// A rectangle as seen from a point in front of it, offsets relative to that point.
pub(crate) struct Seen<'a> {
    frame: &'a Rectangle,
    /// The corners' x and y.
    low: DVec2,
    high: DVec2,
    /// Distance of the point from the rectangle's plane, > 0.
    height: f64,
    solid_angle: f64,
}

impl Seen<'_> {
    pub(crate) fn solid_angle(&self) -> f64 {
        self.solid_angle
    }

    pub(crate) fn by_area(&self) -> bool {
        self.solid_angle < SMALL_SOLID_ANGLE
    }

    /// z components of the unit normals of the planes through the point and the edges: y = low, x = `right`,
    /// y = high, x = low (n₀ … n₃ of the paper, z pointing towards the rectangle's back as there, z₀ =
    /// −height).
    fn edge_normals(&self, right: f64) -> [f64; 4] {
        let z2 = self.height * self.height;
        let over = |a: f64| a / (z2 + a * a).sqrt();
        [-over(self.low.y), over(right), over(self.high.y), -over(self.low.x)]
    }

    /// Solid angle of the part with x ≤ `right`.
    fn solid_angle_of(&self, right: f64) -> f64 {
        let n = self.edge_normals(right);
        let angle = |a: f64, b: f64| (-a * b).clamp(-1.0, 1.0).acos();
        (angle(n[0], n[1]) + angle(n[1], n[2]) + angle(n[2], n[3]) + angle(n[3], n[0]) - TAU).max(0.0)
    }

    /// Offset from the point to the sampled point of the rectangle.
    pub(crate) fn sample(&self, u: DVec2) -> DVec3 {
        if self.by_area() {
            return self.offset(self.low + u * (self.high - self.low));
        }
        let n = self.edge_normals(self.high.x);
        let angle = |a: f64, b: f64| (-a * b).clamp(-1.0, 1.0).acos();
        // The u-th part of the solid angle, as the angle φ_u.
        let k = TAU - angle(n[2], n[3]) - angle(n[3], n[0]);
        let (sin_phi, cos_phi) = (u.x * self.solid_angle + k).sin_cos();
        // x from φ_u.
        let (b0, b1) = (n[0], n[2]);
        let f = (cos_phi * b0 - b1) / sin_phi;
        let c = (1.0 / (f * f + b0 * b0).sqrt()).copysign(f).clamp(-1.0, 1.0);
        let x = (c * self.height / (1.0 - c * c).sqrt()).clamp(self.low.x, self.high.x);
        let x = if x.is_nan() { self.high.x } else { x };
        // y: uniform in the sine of its elevation over the line at x.
        let d = x.hypot(self.height);
        let [h0, h1] = self.sines(d);
        let h = h0 + u.y * (h1 - h0);
        let y = (h * d / (1.0 - h * h).max(0.0).sqrt()).clamp(self.low.y, self.high.y);
        self.offset(DVec2::new(x, if y.is_nan() { self.high.y } else { y }))
    }

    /// y/√(d² + y²) of both ends.
    fn sines(&self, d: f64) -> [f64; 2] {
        [self.low.y / d.hypot(self.low.y), self.high.y / d.hypot(self.high.y)]
    }

    fn offset(&self, at: DVec2) -> DVec3 {
        self.frame.x * at.x + self.frame.y * at.y - self.frame.z * self.height
    }

    /// Density over solid angle at an offset on the rectangle.
    pub(crate) fn pdf(&self, offset: DVec3) -> f64 {
        if self.by_area() {
            return offset.length().powi(3) / (self.height * self.frame.area());
        }
        1.0 / self.solid_angle
    }

    /// The offset at which a direction meets the rectangle.
    pub(crate) fn hit(&self, direction: DVec3) -> Option<DVec3> {
        let towards = -direction.dot(self.frame.z);
        if towards <= 0.0 {
            return None;
        }
        let distance = self.height / towards;
        let at = DVec2::new(direction.dot(self.frame.x), direction.dot(self.frame.y)) * distance;
        // The slack is what rounding a direction to f32 moves the point by.
        let slack = 2e-7 * distance * distance / self.height;
        let inside = at.cmpge(self.low - slack).all() && at.cmple(self.high + slack).all();
        inside.then(|| self.offset(at.clamp(self.low, self.high)))
    }

    #[cfg(test)]
    pub(crate) fn invert(&self, offset: DVec3) -> DVec2 {
        let at = DVec2::new(offset.dot(self.frame.x), offset.dot(self.frame.y));
        if self.by_area() {
            return (at - self.low) / (self.high - self.low);
        }
        // u: the part of the solid angle left of x, by definition of the map.
        let [h0, h1] = self.sines(at.x.hypot(self.height));
        let h = at.y / offset.length();
        DVec2::new(self.solid_angle_of(at.x) / self.solid_angle, (h - h0) / (h1 - h0))
    }
}
