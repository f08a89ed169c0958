//! Closed forms of irradiance.

use glam::DVec3;
use std::f64::consts::PI;

/// A ball of radiance 1 wholly above the receiver's plane: π (R/d)² cos θ.
pub fn ball(centre: DVec3, radius: f64, point: DVec3, normal: DVec3) -> f64 {
    let to = centre - point;
    let distance = to.length();
    PI * (radius / distance).powi(2) * normal.dot(to) / distance
}

/// What part of the light of an evenly bright, level rectangle [x0, x1] × [z0, z1] above a level receiver at
/// the origin reaches it, of that of a whole bright sky: the sum of four corners' configuration factors.
pub fn level_rectangle(x0: f64, x1: f64, z0: f64, z1: f64, height: f64) -> f64 {
    let corner = |x: f64, z: f64| {
        let (x, z) = (x / height, z / height);
        let (rx, rz) = ((1.0 + x * x).sqrt(), (1.0 + z * z).sqrt());
        (x / rx * (z / rx).atan() + z / rz * (x / rz).atan()) / (2.0 * PI)
    };
    corner(x1, z1) - corner(x0, z1) - corner(x1, z0) + corner(x0, z0)
}

/// The mean cosine over a disc of half angle `delta` whose centre stands at `elevation` over a level
/// receiver, where what is below the receiver's plane gives nothing; the disc's irradiance times this is the
/// receiver's. Midpoints in rings.
pub fn disc_over_plane(elevation: f64, delta: f64) -> f64 {
    const N: usize = 600;
    let mut sum = 0.0;
    for i in 0..N {
        let versine = (i as f64 + 0.5) / N as f64 * (1.0 - delta.cos());
        let sine = (versine * (2.0 - versine)).sqrt();
        for j in 0..N {
            let azimuth = (j as f64 + 0.5) / N as f64 * 2.0 * PI;
            let height = elevation.sin() * (1.0 - versine) + elevation.cos() * sine * azimuth.cos();
            sum += height.max(0.0);
        }
    }
    sum / (N * N) as f64
}
