//! The clear sky of Hosek & Wilkie 2012, "An Analytic Model for Full Spectral Sky-Dome Radiance", in RGB.
//!
//! The authors' tables are in `third_party/hosek-wilkie`. All arithmetic is in 32 bits, in a fixed order:
//! datasets hold what it gives.

use crate::Rgb;
use std::f32::consts::FRAC_PI_2;

/// The coefficients by channel, albedo, turbidity and control point.
static COEFFICIENTS: [[[[[f32; 9]; 6]; 10]; 2]; 3] =
    include!("../../../third_party/hosek-wilkie/coefficients.rs");
/// The mean radiance, likewise.
static RADIANCES: [[[[f32; 6]; 10]; 2]; 3] = include!("../../../third_party/hosek-wilkie/radiances.rs");

/// The sky at one elevation of the sun.
#[derive(Clone, Copy, Debug)]
pub(super) struct HosekWilkie {
    channels: [Channel; 3],
}

#[derive(Clone, Copy, Debug)]
struct Channel {
    /// Those of the radiance formula: A B C D E F G I H.
    coefficients: [f32; 9],
    /// By which the formula is multiplied.
    radiance: f32,
}

impl HosekWilkie {
    /// `elevation` of the sun in radians, 0 to π/2; turbidity 1 to 10; albedo of the ground, 0 to 1.
    pub(super) fn new(elevation: f32, turbidity: f32, albedo: f32) -> Self {
        // The curves are dense where the sky changes fast: at the horizon.
        let basis = Quintic::at((elevation / FRAC_PI_2).powf(1.0 / 3.0));
        let corners = corners(turbidity, albedo);
        let channel = |channel: usize| {
            let mut found = Channel { coefficients: [0.0; 9], radiance: 0.0 };
            for (albedo, turbidity, weight) in corners {
                let points = &COEFFICIENTS[channel][albedo][turbidity];
                for (i, coefficient) in found.coefficients.iter_mut().enumerate() {
                    *coefficient += weight * basis.sum(points.map(|point| point[i]));
                }
                found.radiance += weight * basis.sum(RADIANCES[channel][albedo][turbidity]);
            }
            found
        };
        Self { channels: [channel(0), channel(1), channel(2)] }
    }

    /// Radiance in the model's unit at `theta` from the zenith (up to π/2) and `gamma` from the sun.
    pub(super) fn radiance(&self, theta: f32, gamma: f32) -> Rgb {
        Rgb::from_array(self.channels.map(|channel| channel.radiance(theta, gamma)))
    }
}

impl Channel {
    /// Equations 8 and 9 of the paper.
    fn radiance(&self, theta: f32, gamma: f32) -> f32 {
        let [a, b, c, d, e, f, g, i, h] = self.coefficients;
        let cos_theta = theta.cos().abs();
        let cos_gamma = gamma.cos();
        let cos2_gamma = cos_gamma * cos_gamma;
        // Anisotropic scattering by aerosols.
        let chi = (1.0 + cos2_gamma) / (1.0 + h * h - 2.0 * h * cos_gamma).powf(1.5);
        let horizon = 1.0 + a * (b / (cos_theta + 0.01)).exp();
        let rest = c + d * (e * gamma).exp() + f * cos2_gamma + g * chi + i * cos_theta.sqrt();
        self.radiance * (horizon * rest)
    }
}

/// What the four tables around a turbidity and an albedo contribute: indices of albedo and turbidity, and the
/// weight. Both are interpolated linearly.
fn corners(turbidity: f32, albedo: f32) -> [(usize, usize, f32); 4] {
    let low = (turbidity as usize).clamp(1, 10) - 1;
    let high = (low + 1).min(9);
    let t = turbidity.fract();
    [
        (0, low, (1.0 - albedo) * (1.0 - t)),
        (0, high, (1.0 - albedo) * t),
        (1, low, albedo * (1.0 - t)),
        (1, high, albedo * t),
    ]
}

/// Powers of x and of 1 − x, for Bernstein polynomials of degree 5.
struct Quintic {
    x: [f32; 6],
    rest: [f32; 6],
}

impl Quintic {
    fn at(x: f32) -> Self {
        let powers = |x: f32| {
            let (x2, x4) = (x * x, (x * x) * (x * x));
            [1.0, x, x2, x2 * x, x4, x4 * x]
        };
        Self { x: powers(x), rest: powers(1.0 - x) }
    }

    /// The Bézier curve of these control points.
    fn sum(&self, points: [f32; 6]) -> f32 {
        const BINOMIAL: [f32; 6] = [1.0, 5.0, 10.0, 10.0, 5.0, 1.0];
        let term = |k: usize| points[k] * BINOMIAL[k] * self.rest[5 - k] * self.x[k];
        (1..6).fold(term(0), |sum, k| sum + term(k))
    }
}

#[cfg(test)]
#[path = "hosek_wilkie_tests.rs"]
mod tests;
