//! Trial fits: a short training ranks a tile's possible contents as a long one does.

use super::phases::Attempt;
use super::targets::light::Light;
use super::targets::problem::Problem;
use super::{Aim, Recipe, check};
use crate::Result;
use crate::bundle::blocks_len;
use crate::lanes::Tier;
use crate::model::{Contents, Shape};
use crate::tile::TileSource;
use serde::{Deserialize, Serialize};

/// Steps of a trial fit.
const ITERATIONS: usize = 400;

/// First guess of the factor by which a training of `iterations` steps with quantisation reduces the pooled
/// error, compared with a trial fit: 1.6, 1.9 and 2.4 after 1000, 2500 and 12,000 steps on the scene `yard`;
/// twice that in rooms, whose light is smooth.
pub fn gain(iterations: usize) -> f64 {
    (1.6 + 0.34 * (iterations as f64 / 1000.0).ln()).max(1.0)
}

/// A trial fit: contents with their size and error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialFit {
    /// The contents' word.
    pub word: u32,
    /// Length of the payload in bytes.
    pub bytes: u64,
    /// Squared error of the trial fit relative to the frame's peak, mean over channels, summed over valid
    /// texels and lit frames.
    pub error: f64,
    /// Terms of that sum.
    pub terms: u64,
}

/// Makes a trial fit of each candidate; none for a tile without light.
///
/// # Errors
/// As [`super::train`].
pub fn trials(source: &TileSource, seed: u64) -> Result<Vec<TrialFit>> {
    check(source)?;
    let recipe = Recipe { iterations: ITERATIONS, passes: 0, paper: false, seed, aim: Aim::PooledError };
    let light = Light::new(source, recipe.coding());
    if light.lit() == 0 {
        return Ok(Vec::new());
    }
    let mut trials = Vec::new();
    for contents in candidates(&light) {
        let shape = Shape::new(&contents, source.width, source.height, source.frames.len(), recipe.coding());
        let problem = Problem::new(source, &light, shape, recipe.coding());
        let read = problem.blocks_read().map(|blocks| blocks.iter().filter(|read| **read).count());
        let terms = (problem.valid * problem.frames) as u64;
        let tier = Tier::detect();
        let error = match contents.hidden {
            32 => Attempt::<32>::new(&problem, &recipe, 1.0, tier).trial(&recipe)?,
            64 => Attempt::<64>::new(&problem, &recipe, 1.0, tier).trial(&recipe)?,
            _ => Attempt::<16>::new(&problem, &recipe, 1.0, tier).trial(&recipe)?,
        };
        // A fit that diverges is dropped.
        if let (Some(error), Some(word)) = (error, contents.word()) {
            trials.push(TrialFit { word, bytes: blocks_len(&shape, read) as u64, error, terms });
        }
    }
    Ok(trials)
}

/// The contents to try.
fn candidates(light: &Light) -> Vec<Contents> {
    let (distinct, gates) = (light.distinct, light.gates.len());
    let none = Contents::NONE;
    let map = |uvt: usize, slices: usize| Contents { uvt, slices, ..none };
    if distinct == 1 {
        let with = |contents: Contents| Contents { uv: true, ..contents };
        return vec![none, map(16, 1), map(64, 1), with(none), with(map(16, 1))];
    }
    // Half as many slices as frames that differ, as a profile has; as many.
    let (half, all) = (distinct.div_ceil(2).min(12), distinct.min(24));
    let timed = Contents { gamma: true, gates, ..none };
    let map = |uvt: usize, slices: usize| Contents { uvt, slices, ..timed };
    let with_uv = |contents: Contents| Contents { uv: true, ..contents };
    let wide = |hidden: usize, contents: Contents| Contents { hidden, ..contents };
    let full = |contents: Contents| Contents { uv: true, ut: true, vt: true, rows: all, ..contents };
    vec![
        timed,
        map(8, half),
        map(16, half),
        map(32, half),
        with_uv(map(16, half)),
        full(map(16, half)),
        full(map(16, all)),
        wide(32, with_uv(map(16, half))),
        wide(32, full(map(16, half))),
        full(map(32, half)),
        wide(32, full(map(32, half))),
        wide(64, full(map(32, half))),
        full(map(32, all)),
        full(map(64, all)),
    ]
}
