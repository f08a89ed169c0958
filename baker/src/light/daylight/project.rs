//! Sky and sun of a scene in terms of spherical harmonics: the least-squares fit over the directions that
//! shine.

use super::harmonics::{FUNCTIONS, harmonics};
use super::sky;
use super::sun::{self, SunDisc};
use crate::scene::{Scene, Sky, SunTrack};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Rings from pole to pole that radiance is integrated over; a picture of more rows has one for each.
const RINGS: usize = 360;
/// Points along a side of the square that a sun's disc is averaged over.
const SIDE: usize = 8;

/// Whether light comes from above the horizon alone: the model's sky ends there, and so does a sun that
/// follows the date.
pub(crate) fn is_upper(scene: &Scene) -> bool {
    let sky = !matches!(scene.sky, Some(Sky::Constant { .. } | Sky::Image(_)));
    let sun = scene.sun.as_ref().is_none_or(|sun| match &sun.track {
        // The whole of the disc.
        SunTrack::Authored(keys) => {
            keys.iter().all(|key| key.direction.normalize().y >= (sun.disc_angle / 2.0).to_radians().sin())
        }
        SunTrack::Computed { .. } => true,
    });
    sky && sun
}

/// Per hour and function, the coefficients of sky + sun: those c for which Σ c Y has the least squared
/// distance from the light over the support, which is c = G⁻¹ b with G the functions' products and b the
/// light's product with each. A sun is an impulse of its irradiance.
pub(crate) fn coefficients(scene: &Scene, hours: &[f64]) -> Vec<Vec<[f64; 3]>> {
    let rings = match &scene.sky {
        Some(Sky::Image(image)) => RINGS.max(image.radiance.height),
        _ => RINGS,
    };
    let grid = Grid { rings, upper: is_upper(scene) };
    let factor = cholesky(Grid { rings: RINGS, ..grid }.gram());
    let of_sky = |hour: f64| match &scene.sky {
        Some(sky) => grid.products(|d| sky::radiances(sky, scene.location.as_ref(), hour, d)),
        None => [DVec3::ZERO; FUNCTIONS],
    };
    // Only the model's sky changes with the hour.
    let changes = matches!(scene.sky, Some(Sky::HosekWilkie { .. }));
    let still = hours.first().filter(|_| !changes).map(|&hour| of_sky(hour));
    let at = |&hour: &f64| {
        let mut b = still.unwrap_or_else(|| of_sky(hour));
        let disc = scene.sun.as_ref().and_then(|sun| sun::at(sun, scene.location.as_ref(), hour));
        if let Some(disc) = disc {
            let irradiance = disc.irradiance.as_dvec3();
            b.iter_mut().zip(mean_over(&disc)).for_each(|(b, mean)| *b += irradiance * mean);
        }
        solve(&factor, b).map(|c| c.to_array()).to_vec()
    };
    hours.iter().map(at).collect()
}

/// The mean of each function over a sun's disc.
fn mean_over(disc: &SunDisc) -> [f64; FUNCTIONS] {
    let mut sums = [0.0; FUNCTIONS];
    for i in 0..SIDE * SIDE {
        let u = Vec2::new((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5) / SIDE as f32;
        let values = harmonics(disc.sample(u));
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += f64::from(value));
    }
    sums.map(|sum| sum / (SIDE * SIDE) as f64)
}

/// Directions spread over the support: rings of equal angle, twice as many directions around as there are
/// rings on a sphere.
struct Grid {
    rings: usize,
    upper: bool,
}

impl Grid {
    /// The directions of a ring, and the solid angle of each.
    fn ring(&self, ring: usize) -> (Vec<Vec3>, f64) {
        let edge = |i: usize| PI * i as f64 / self.rings as f64;
        let (sin, cos) = (0.5 * (edge(ring) + edge(ring + 1))).sin_cos();
        let around = 2 * self.rings;
        let direction = |i: usize| {
            let (s, c) = (TAU * (i as f64 + 0.5) / around as f64).sin_cos();
            DVec3::new(sin * c, cos, sin * s).as_vec3()
        };
        let solid_angle = (edge(ring).cos() - edge(ring + 1).cos()) * TAU / around as f64;
        ((0..around).map(direction).collect(), solid_angle)
    }

    /// The sum of a function of each ring, in the order of the rings whatever the threads.
    fn sum<const N: usize>(&self, of_ring: impl Fn(Vec<Vec3>, f64) -> [DVec3; N] + Sync) -> [DVec3; N] {
        let rings = if self.upper { self.rings / 2 } else { self.rings };
        let parts: Vec<[DVec3; N]> = (0..rings)
            .into_par_iter()
            .map(|ring| {
                let (directions, solid_angle) = self.ring(ring);
                of_ring(directions, solid_angle)
            })
            .collect();
        parts.iter().fold([DVec3::ZERO; N], |mut sum, part| {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += *part);
            sum
        })
    }

    /// ∫ L Y dω for each function.
    fn products(&self, radiances: impl Fn(&[Vec3]) -> Vec<Vec3> + Sync) -> [DVec3; FUNCTIONS] {
        self.sum(|directions, solid_angle| {
            let mut sums = [DVec3::ZERO; FUNCTIONS];
            for (radiance, direction) in radiances(&directions).into_iter().zip(&directions) {
                let light = radiance.as_dvec3() * solid_angle;
                let values = harmonics(*direction);
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += light * f64::from(value));
            }
            sums
        })
    }

    /// ∫ Y Y dω over the support, row by row.
    fn gram(&self) -> [[f64; FUNCTIONS]; FUNCTIONS] {
        std::array::from_fn(|i| {
            let with = |d: &[Vec3]| d.iter().map(|d| Vec3::splat(harmonics(*d)[i])).collect();
            self.products(with).map(|product| product.x)
        })
    }
}

/// The lower triangle L of a symmetric positive matrix, which is L Lᵀ.
fn cholesky(a: [[f64; FUNCTIONS]; FUNCTIONS]) -> [[f64; FUNCTIONS]; FUNCTIONS] {
    let mut l = [[0.0; FUNCTIONS]; FUNCTIONS];
    for i in 0..FUNCTIONS {
        for j in 0..=i {
            let rest = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = if i == j { rest.sqrt() } else { rest / l[j][j] };
        }
    }
    l
}

/// x of L Lᵀ x = b.
fn solve(l: &[[f64; FUNCTIONS]; FUNCTIONS], mut x: [DVec3; FUNCTIONS]) -> [DVec3; FUNCTIONS] {
    for i in 0..FUNCTIONS {
        let known: DVec3 = (0..i).map(|k| x[k] * l[i][k]).sum();
        x[i] = (x[i] - known) / l[i][i];
    }
    for i in (0..FUNCTIONS).rev() {
        let known: DVec3 = (i + 1..FUNCTIONS).map(|k| x[k] * l[k][i]).sum();
        x[i] = (x[i] - known) / l[i][i];
    }
    x
}

#[cfg(test)]
#[path = "project_tests.rs"]
mod tests;
