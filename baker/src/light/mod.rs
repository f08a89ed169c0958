//! Light as a function of time: lamps, sky, sun, schedules. No rays here: only what a direction or a point
//! receives unoccluded.
//!
//! In: the lights of a scene. Out: radiance by direction and hour, samples of lights with their densities,
//! and the times of a bake. Callers: tracing, bakes, previews, `bake new`. Each folder uses only those above
//! it.

pub mod lamps;
pub mod daylight;
pub mod times;

use crate::Rgb;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Luminance of linear Rec. 709 (the Y row of its primaries under D65), in the unit of `rgb`.
pub fn luminance(rgb: Rgb) -> f32 {
    rgb.dot(Rgb::new(0.2126, 0.7152, 0.0722))
}

/// The greatest cosine to a normal over a cone about an axis at cosine `cosine` to it, with half angle asin
/// √`sin2`.
pub(crate) fn cos_bound(cosine: f64, sin2: f64) -> f64 {
    let cos_cone = (1.0 - sin2).max(0.0).sqrt();
    if cosine >= cos_cone {
        return 1.0;
    }
    // cos(θ − θ_cone).
    cosine * cos_cone + ((1.0 - cosine * cosine).max(0.0) * sin2).sqrt()
}

/// Malley's map: cosine-weighted about `n`, of density cosθ ÷ π.
fn cosine_hemisphere(n: DVec3, u: DVec2) -> DVec3 {
    let (x, y) = n.any_orthonormal_pair();
    let (sin_phi, cos_phi) = (TAU * u.y).sin_cos();
    (x * cos_phi + y * sin_phi) * u.x.sqrt() + n * (1.0 - u.x).sqrt()
}

/// The `u` that [`cosine_hemisphere`] turns into `direction`.
#[cfg(test)]
fn cosine_hemisphere_inverse(n: DVec3, direction: DVec3) -> DVec2 {
    let (x, y) = n.any_orthonormal_pair();
    let (a, b) = (direction.dot(x), direction.dot(y));
    DVec2::new(a * a + b * b, (b.atan2(a) / TAU).rem_euclid(1.0))
}
