//! Light as a function of time: schedules, sun, sky, lamps. No rays here: only what a direction or a point
//! receives unoccluded.

pub mod schedule;
pub mod sun;
pub mod visibility_times;
pub mod curves;
mod sky_image;
pub mod harmonics;
mod hosek_wilkie;
mod sky_model;
pub mod sky;
pub mod ground;
pub mod extra_times;
pub mod project;
mod rectangle;
mod cone;
mod disc;
pub mod lamp;
pub mod emitter;
mod tree;
pub mod group;
pub mod sky_sampler;

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
