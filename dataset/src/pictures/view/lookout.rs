//! Where to look from when no camera is known.

use super::lens::Camera;
use super::model::Model;
use super::raster::{Fragment, draw};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// Samples of the pictures that are tried.
const TRIED: [usize; 2] = [48, 27];
/// Places along each horizontal side of the box that is searched, and their height in it.
const ALONG: usize = 4;
const HEIGHT: f64 = 0.5;
/// Headings that are tried at a place.
const HEADINGS: usize = 6;
/// Angles of view from outside and inside, in degrees.
const OUTSIDE: f64 = 60.0;
const INSIDE: f64 = 80.0;

/// From the south-west above what has texels, where that shows half as much as the best of some places inside
/// does; else from there. `is_lit` tests a point of a page.
pub(super) fn choose(model: &Model, is_lit: &(dyn Fn(usize, glam::Vec2) -> bool + Sync)) -> Camera {
    let (low, high) = model.bounds(true);
    let (middle, length) = (0.5 * (low + high), (high - low).length());
    let name = "default".to_owned();
    let distance = 0.5 * length.max(f64::MIN_POSITIVE) / (0.5 * OUTSIDE.to_radians()).sin();
    let position = middle + DVec3::new(-0.6, 0.6, 1.0).normalize() * distance;
    let outside = Camera { name: name.clone(), position, look_at: middle, fov: OUTSIDE };
    let is_good = |fragment: &Fragment| {
        let part = &model.parts[fragment.part as usize];
        let texel = model.texel(part, fragment.triangle as usize, fragment.at);
        !fragment.is_back && texel.is_some_and(|(page, at)| is_lit(page, at))
    };
    let tried: Vec<Camera> = (0..ALONG * ALONG * HEADINGS)
        .map(|i| {
            let (place, heading) = (i / HEADINGS, i % HEADINGS);
            let of = |k: usize| (k as f64 + 0.5) / ALONG as f64;
            let position = low + (high - low) * DVec3::new(of(place % ALONG), HEIGHT, of(place / ALONG));
            let (sin, cos) = (TAU * heading as f64 / HEADINGS as f64).sin_cos();
            // A little downwards, as people look.
            let look_at = position + DVec3::new(sin, -0.15, -cos);
            Camera { name: name.clone(), position, look_at, fov: INSIDE }
        })
        .collect();
    let worth = |camera: &Camera| {
        let seen = draw(model, camera, TRIED, true);
        // Inside a body backs are seen.
        let backs = seen.iter().filter(|fragment| fragment.is_surface() && fragment.is_back).count();
        if 4 * backs > seen.len() {
            return 0.0;
        }
        let (mut sum, mut materials) = (0.0, BTreeSet::new());
        for fragment in seen.iter().filter(|fragment| fragment.is_surface() && is_good(fragment)) {
            // Far things show more than a wall close by, and many materials more than one.
            sum += (1.0 / f64::from(fragment.inverse_depth) / length).min(1.0).sqrt();
            materials.insert(model.shapes[model.parts[fragment.part as usize].shape].material);
        }
        sum * (materials.len() as f64).sqrt()
    };
    let worths: Vec<f64> = tried.par_iter().map(worth).collect();
    // The first of the best.
    let best = (0..tried.len()).rev().max_by(|a, b| worths[*a].total_cmp(&worths[*b]));
    best.filter(|best| 2.0 * worth(&outside) < worths[*best]).map_or(outside, |best| tried[best].clone())
}
