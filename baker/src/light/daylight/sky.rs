//! The sky's radiance by direction, tabulated for all hours of a bake at once.

use super::harmonics::{Harmonic, harmonics};
use super::sky_image::ImageMap;
use super::sky_model::SkyAt;
use crate::Rgb;
use crate::scene::{Location, Sky};
use glam::{Vec3, Vec3Swizzles, Vec4};
use std::f32::consts::FRAC_PI_4;

pub use super::sky_model::{Illuminance, radiances};

/// Sky radiance of several hours over the sphere of directions, stored so that one lookup reads all hours
/// from neighbouring memory. A constant sky, a picture and harmonics are what they are; others are bilinear
/// in a map of the upper hemisphere that is equal-area in azimuth and finer towards the horizon, where clear
/// skies change fastest.
#[derive(Clone, Debug)]
pub struct SkyTable {
    /// Indices into the hours given to [`SkyTable::new`] whose sky is not black, in order.
    pub lit: Vec<usize>,
    store: Store,
}

#[derive(Clone, Debug)]
enum Store {
    /// One radiance for all directions, the same at every lit hour.
    Constant(Rgb),
    /// One picture, the same at every lit hour.
    Image(ImageMap),
    /// Per lit hour, a part of a harmonic: all functions are evaluated where they are asked for.
    Harmonics(Vec<Harmonic>),
    /// `[row][column][lit hour][channel]`: nodes of a grid over the square of [`square_from_direction`], on
    /// its border too, so that the horizon is a node and nothing below it is ever mixed in.
    Dome(Vec<f32>),
}

/// Cells along a side of the map; nodes are one more. 129² nodes of 24 hours are 4.8 MB.
const CELLS: usize = 128;
const NODES: usize = CELLS + 1;

/// Hours handled together: 4 of 3 channels are 3 vectors of 4 floats.
const GROUP: usize = 4;

impl SkyTable {
    /// Tabulates the sky at `hours`.
    pub fn new(sky: Option<&Sky>, location: Option<&Location>, hours: &[f64]) -> Self {
        let Some(sky) = sky else { return Self { lit: Vec::new(), store: Store::Constant(Rgb::ZERO) } };
        let (mut lit, mut skies) = (Vec::new(), Vec::new());
        for (k, &hour) in hours.iter().enumerate() {
            let at = SkyAt::new(sky, location, hour);
            if !at.is_black() {
                lit.push(k);
                skies.push(at);
            }
        }
        let store = match skies.first() {
            None => Store::Constant(Rgb::ZERO),
            Some(SkyAt::Constant(radiance)) => Store::Constant(*radiance),
            Some(SkyAt::Image(image)) => Store::Image(image.clone()),
            Some(SkyAt::Dome(_)) => Store::Dome(tabulate(&skies)),
            Some(SkyAt::Harmonic(_)) => Store::Harmonics(skies.iter().filter_map(SkyAt::harmonic).collect()),
        };
        Self { lit, store }
    }

    /// The picture, if it is one.
    pub fn image(&self) -> Option<&ImageMap> {
        match &self.store {
            Store::Image(image) => Some(image),
            _ => None,
        }
    }

    /// Calls for every lit hour: `out[k] += beta · L(hours[lit[k]], direction)`. `out.len() == lit.len()`.
    pub fn add(&self, direction: Vec3, beta: Rgb, out: &mut [Rgb]) {
        debug_assert_eq!(out.len(), self.lit.len());
        match &self.store {
            Store::Constant(radiance) => {
                let light = beta * *radiance;
                out.iter_mut().for_each(|o| *o += light);
            }
            Store::Image(image) => {
                let light = beta * image.radiance(direction);
                out.iter_mut().for_each(|o| *o += light);
            }
            Store::Harmonics(parts) => {
                let values = harmonics(direction);
                for (o, part) in out.iter_mut().zip(parts) {
                    *o += beta * part.radiance(&values, direction);
                }
            }
            Store::Dome(nodes) => {
                if direction.y < 0.0 || self.lit.is_empty() {
                    return;
                }
                // Cell and weights of its four nodes.
                let [a, b] = square_from_direction(direction);
                let at = |s: f32| {
                    let s = ((0.5 + 0.5 * s) * CELLS as f32).clamp(0.0, CELLS as f32);
                    let cell = (s as usize).min(CELLS - 1);
                    (cell, s - cell as f32)
                };
                let ((column, fa), (row, fb)) = (at(a), at(b));
                let weights = [(1.0 - fa) * (1.0 - fb), fa * (1.0 - fb), (1.0 - fa) * fb, fa * fb];
                // Two neighbours in a row lie side by side.
                let stride = 3 * self.lit.len();
                let low = &nodes[(row * NODES + column) * stride..][..2 * stride];
                let high = &nodes[((row + 1) * NODES + column) * stride..][..2 * stride];
                let runs = [&low[..stride], &low[stride..], &high[..stride], &high[stride..]];
                add_runs(runs, weights, beta, bytemuck::cast_slice_mut(out));
            }
        }
    }
}

/// `out += beta · Σ weight · run`, over hours × 3 floats each.
fn add_runs(runs: [&[f32]; 4], weights: [f32; 4], beta: Rgb, out: &mut [f32]) {
    // Groups of 4 hours: 3 vectors, over which beta's channels repeat as rgbr gbrg brgb.
    let betas = [beta.xyzx(), beta.yzxy(), beta.zxyz()];
    let groups = runs.map(|run| run.as_chunks::<4>().0.as_chunks::<3>().0);
    let (out_groups, out_rest) = out.as_chunks_mut::<{ 3 * GROUP }>();
    let inner = out_groups.iter_mut().zip(groups[0]).zip(groups[1]).zip(groups[2]).zip(groups[3]);
    for ((((out, a), b), c), d) in inner {
        for (j, out) in out.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let low = Vec4::from_array(a[j]) * weights[0] + Vec4::from_array(b[j]) * weights[1];
            let high = Vec4::from_array(c[j]) * weights[2] + Vec4::from_array(d[j]) * weights[3];
            *out = (Vec4::from_array(*out) + betas[j] * (low + high)).to_array();
        }
    }
    // The last hours one by one, in the same order of operations.
    let start = runs[0].len() - out_rest.len();
    let [a, b, c, d] = runs.map(|run| &run[start..]);
    for (i, out) in out_rest.iter_mut().enumerate() {
        let sum = (a[i] * weights[0] + b[i] * weights[1]) + (c[i] * weights[2] + d[i] * weights[3]);
        *out += beta[i % 3] * sum;
    }
}

/// All nodes of all skies.
fn tabulate(skies: &[SkyAt]) -> Vec<f32> {
    use rayon::prelude::*;
    let stride = 3 * skies.len();
    let mut nodes = vec![0.0; NODES * NODES * stride];
    nodes.par_chunks_exact_mut(stride).enumerate().for_each(|(node, values)| {
        let side = |k: usize| 2.0 * k as f32 / CELLS as f32 - 1.0;
        let direction = direction_from_square([side(node % NODES), side(node / NODES)]);
        for (sky, value) in skies.iter().zip(values.as_chunks_mut::<3>().0) {
            *value = sky.radiance(direction).to_array();
        }
    });
    nodes
}

/// The map of the upper hemisphere to [−1, 1]²: to the disc with y = (1 − r²)², then the concentric map of
/// Shirley & Chiu 1997 to the square. The zenith is the middle, the horizon the border. (Lambert's equal-area
/// y = 1 − r² leaves 3 % of error in the irradiance of walls: a cell at its border is 1.8° high, at this
/// one's 0.06°.)
fn square_from_direction(direction: Vec3) -> [f32; 2] {
    // r/sinθ, r² = 1 − √y = (1 − y)/(1 + √y), sin²θ = (1 − y)(1 + y).
    let scale = ((1.0 + direction.y.sqrt()) * (1.0 + direction.y)).sqrt().recip();
    let (x, z) = (direction.x * scale, direction.z * scale);
    let radius = x.hypot(z);
    if x.abs() > z.abs() {
        let a = radius.copysign(x);
        [a, a * (z / x).atan() / FRAC_PI_4]
    } else if z != 0.0 {
        let b = radius.copysign(z);
        [b * (x / z).atan() / FRAC_PI_4, b]
    } else {
        [0.0, 0.0]
    }
}

/// The inverse of [`square_from_direction`].
fn direction_from_square([a, b]: [f32; 2]) -> Vec3 {
    let (radius, phi) = if a.abs() > b.abs() {
        (a, FRAC_PI_4 * (b / a))
    } else if b != 0.0 {
        (b, 2.0 * FRAC_PI_4 - FRAC_PI_4 * (a / b))
    } else {
        return Vec3::Y;
    };
    let (sin, cos) = phi.sin_cos();
    // sin²θ = (1 − √y)(1 + √y)(1 + y).
    let root = (1.0 - radius * radius).max(0.0);
    let (y, r) = (root * root, radius * ((1.0 + root) * (1.0 + root * root)).sqrt());
    Vec3::new(r * cos, y, r * sin)
}

#[cfg(test)]
#[path = "sky_tests.rs"]
mod tests;
