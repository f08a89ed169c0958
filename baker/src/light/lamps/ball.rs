//! A ball as a light: the cone of directions it fills, and directions uniform in it.

use crate::light::cos_bound;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// The cone of directions that a ball fills, from outside.
pub(super) struct Cone {
    axis: DVec3,
    distance: f64,
    radius: f64,
    /// sin² of the half angle.
    pub sin2: f64,
    /// 1 − cos of the half angle.
    versine: f64,
}

impl Cone {
    /// `None` inside the ball or on it.
    pub(super) fn new(to_centre: DVec3, radius: f64) -> Option<Self> {
        let distance = to_centre.length();
        if distance <= radius {
            return None;
        }
        let sin2 = (radius / distance).powi(2);
        // 1 − cos = sin²/(1 + cos) does not cancel for small cones.
        let versine = sin2 / (1.0 + (1.0 - sin2).sqrt());
        // (From very far away sin² is rounded to nothing; the ball is still seen from outside.)
        let versine = versine.max(f64::MIN_POSITIVE);
        Some(Self { axis: to_centre / distance, distance, radius, sin2, versine })
    }

    pub(super) fn solid_angle(&self) -> f64 {
        TAU * self.versine
    }

    /// The greatest n·ω over the cone.
    pub(super) fn cos_bound(&self, n: DVec3) -> f64 {
        cos_bound(self.axis.dot(n), self.sin2)
    }

    pub(super) fn sample(&self, u: DVec2) -> (DVec3, f64) {
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

    #[cfg(test)]
    pub(super) fn contains(&self, direction: DVec3) -> bool {
        // The slack is what rounding a direction to f32 moves it by.
        direction.dot(self.axis) > 0.0 && direction.cross(self.axis).length() <= self.sin2.sqrt() + 1e-7
    }

    #[cfg(test)]
    pub(super) fn invert(&self, direction: DVec3) -> DVec2 {
        let (x, y) = self.axis.any_orthonormal_pair();
        let (a, b) = (direction.dot(x), direction.dot(y));
        let versine = (a * a + b * b) / (1.0 + direction.dot(self.axis));
        DVec2::new(versine / self.versine, (b.atan2(a) / TAU).rem_euclid(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_however_far_away_is_seen_from_outside() {
        for distance in [1e3, 1e100, 1e150, 1e160, 1e200, 1e300] {
            let cone = Cone::new(DVec3::Y * distance, 1e-3).expect("outside");
            let (direction, _) = cone.sample(DVec2::splat(0.3));
            let light = cone.solid_angle() * direction.dot(DVec3::Y);
            assert!((0.0..1e-10).contains(&light), "{distance}: {light}");
        }
        assert!(Cone::new(DVec3::Y, 1.0).is_none() && Cone::new(DVec3::ZERO, 1.0).is_none());
    }
}
