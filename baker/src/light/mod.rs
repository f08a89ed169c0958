//! Light as a function of time: schedules, sun, sky, lamps. No rays here: only what a direction or a point receives unoccluded.

pub mod lamp;
mod rectangle;
pub mod schedule;
pub mod sky;
mod sky_model;
pub mod sun;

use crate::Rgb;

/// Luminance of linear Rec. 709 (the Y row of its primaries under D65), in the unit of `rgb`.
pub fn luminance(rgb: Rgb) -> f32 {
    rgb.dot(Rgb::new(0.2126, 0.7152, 0.0722))
}

/// The greatest cosine to a normal over a cone about an axis at cosine `cosine` to it, with half angle asin √`sin2`.
pub(crate) fn cos_bound(cosine: f64, sin2: f64) -> f64 {
    let cos_cone = (1.0 - sin2).max(0.0).sqrt();
    if cosine >= cos_cone {
        return 1.0;
    }
    // cos(θ − θ_cone).
    cosine * cos_cone + ((1.0 - cosine * cosine).max(0.0) * sin2).sqrt()
}
