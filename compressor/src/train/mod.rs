//! Training of one tile: from its light to its stored parameters.
//!
//! In: a tile's light ([`TileSource`]), a [`Recipe`], a [`Profile`] and [`Contents`]. Out: its parameters as
//! they are stored ([`TileParams`]). Callers: `compress`, `sweep`, comparisons. `phases` orders all of it;
//! `trial_fit` trains briefly to rank what a tile could store. Each folder uses only those above it.

pub(crate) mod targets;
pub(crate) mod step;
mod stored;
mod phases;
mod trial_fit;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod tests;

pub use trial_fit::{TrialFit, gain, trials};

use crate::lanes::Tier;
use crate::model::{Contents, Profile, Shape, TileParams};
use crate::tile::TileSource;
use crate::time::Coding;
use crate::{Error, Result};
use phases::Attempt;
use serde::{Deserialize, Serialize};
use targets::light::Light;
use targets::problem::Problem;

/// Recipe of a training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Steps of the main phase.
    pub iterations: usize,
    /// Passes in which all that is not yet quantised is trained around the blocks; before each pass but the
    /// first, blocks are chosen anew.
    pub passes: usize,
    /// The paper's literal recipe: its coding ([`Coding::Paper`]), constant rate 1e-3, plain Adam with β₂
    /// 0.999, unweighted L2, no time points between frames; then 8 bits, a plain BC7 encoder, and fine-tuning
    /// of the decoder network alone. Initial values, the floors of the means, the gutter's weight (½ for one
    /// texel in five) and what happens on divergence, on which the paper is silent, are those of the main
    /// recipe; the activation is the format's ([`crate::model::gelu`]).
    pub paper: bool,
    /// Seed of this tile's randomness.
    pub seed: u64,
    /// Aim of the loss weights.
    pub aim: Aim,
}

/// Aim of a training's loss weights, in linear light; the paper's recipe has none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aim {
    /// The mean PSNR of the frames: frames that are good already count as much as others.
    MeanPsnr,
    /// Nearer to the squared error relative to the peak, pooled over the frames: frames count more as they
    /// are bad.
    PooledError,
}

impl Recipe {
    /// The coding that the recipe trains.
    pub fn coding(&self) -> Coding {
        if self.paper { Coding::Paper } else { Coding::Standard }
    }
}

/// A point of the curve of quality against training time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Steps done.
    pub iteration: usize,
    /// CPU seconds since this attempt began.
    pub seconds: f64,
    /// PSNR of the model as it is then (towards the end quantised), mean over the tile's frames, over some
    /// 2000 of its valid texels; peak = the frame's largest valid value.
    pub psnr_db: f64,
}

/// Result of a training.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainedTile {
    /// Steps of the main phase; 0 for a tile without light.
    pub steps: usize,
    /// CPU seconds of these steps.
    pub stepping_seconds: f64,
    /// The stored tile; `None` for a tile that has no valid texel or is all black.
    #[serde(skip)]
    pub params: Option<TileParams>,
    /// PSNR before quantisation over all valid texels; `None` if no frame has one.
    pub psnr_unquantised_db: Option<f64>,
    /// The same with all features rounded to 8 bits, nothing trained after it.
    pub psnr_8bit_features_db: Option<f64>,
    /// PSNR of what is stored, blocks, planes and network rounded, as the trainer computes it.
    pub psnr_db: Option<f64>,
    /// Its squared error, as [`TrialFit::error`] counts it.
    pub error: Option<f64>,
    /// Quality against time.
    pub curve: Vec<Point>,
    /// Remarks: what was omitted and why, and others, such as "black in 9 of 26 frames".
    pub omitted: Vec<String>,
}

/// The remark on a tile without a valid texel.
pub(crate) const NO_TEXEL: &str = "no valid texel";

/// Number of restarts at half the learning rate after a training diverges.
const RETRIES: i32 = 6;

/// What a tile is trained to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Maps<'a> {
    /// The maps of a profile, without those that the tile does not need.
    Profile(&'a Profile),
    /// One of the configurations that [`trials`] returned.
    Chosen(&'a Contents),
}

impl<'a> From<&'a Profile> for Maps<'a> {
    fn from(profile: &'a Profile) -> Self {
        Maps::Profile(profile)
    }
}

impl<'a> From<&'a Contents> for Maps<'a> {
    fn from(contents: &'a Contents) -> Self {
        Maps::Chosen(contents)
    }
}

/// Trains a tile. Deterministic in (source, maps, recipe) on one instruction set.
///
/// # Errors
/// [`Error::Invalid`] where the source's lists have wrong lengths or light that is negative or not finite,
/// [`Error::Unsupported`] for a hidden width other than 16, 32 or 64, [`Error::Interrupted`].
pub fn train<'a>(source: &TileSource, maps: impl Into<Maps<'a>>, recipe: &Recipe) -> Result<TrainedTile> {
    let maps = maps.into();
    train_coded(source, recipe, Coded::OnTheLoss, |light, omitted| match maps {
        Maps::Profile(profile) => needed(light, profile, recipe, omitted),
        Maps::Chosen(contents) => {
            omitted.push(format!("chosen by trial fits: {contents}"));
            *contents
        }
    })
}

/// How F_uv and F_uvt come to their blocks, for comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Coded {
    /// Learned as endpoints and weights; blocks and all else fitted on the loss: the standard recipe.
    OnTheLoss,
    /// Learned as endpoints and weights; encoded plainly.
    Plainly,
    /// Learned texel by texel, which no block holds; encoded plainly.
    TexelByTexel,
}

/// Trains a tile with a profile's maps as `edit` changes them, and its blocks as told. Otherwise as
/// [`train`].
pub(crate) fn train_ablated(
    source: &TileSource,
    profile: &Profile,
    edit: impl Fn(Contents) -> Contents,
    coded: Coded,
    recipe: &Recipe,
) -> Result<TrainedTile> {
    let choose = |light: &Light, omitted: &mut Vec<String>| edit(needed(light, profile, recipe, omitted));
    train_coded(source, recipe, coded, choose)
}

fn train_coded(
    source: &TileSource,
    recipe: &Recipe,
    coded: Coded,
    choose: impl Fn(&Light, &mut Vec<String>) -> Contents,
) -> Result<TrainedTile> {
    check(source)?;
    let light = Light::new(source, recipe.coding());
    let mut omitted = Vec::new();
    let black = source.frames.len() - light.lit();
    if light.valid.is_empty() {
        omitted.push(NO_TEXEL.to_owned());
    } else if black > 0 {
        omitted.push(match light.lit() {
            0 => "black in every frame".to_owned(),
            _ => format!("black in {black} of {} frames", source.frames.len()),
        });
    }
    if light.lit() == 0 {
        return Ok(TrainedTile { omitted, ..TrainedTile::default() });
    }
    let contents = choose(&light, &mut omitted);
    let recipe = &Recipe { iterations: needed_steps(recipe, &light), ..*recipe };
    let shape = Shape::new(&contents, source.width, source.height, source.frames.len(), recipe.coding());
    let mut problem = Problem::new(source, &light, shape, recipe.coding());
    problem.coded = coded;
    match contents.hidden {
        16 => train_width::<16>(&problem, recipe, 1.0, omitted),
        32 => train_width::<32>(&problem, recipe, 1.0, omitted),
        64 => train_width::<64>(&problem, recipe, 1.0, omitted),
        other => Err(Error::unsupported("profile", format!("hidden width {other}; expected 16, 32 or 64"))),
    }
}

/// The profile's maps without what a tile does not need; all of them by the paper's recipe.
fn needed(light: &Light, profile: &Profile, recipe: &Recipe, omitted: &mut Vec<String>) -> Contents {
    let all = profile.contents(light.distinct, light.gates.len());
    if recipe.paper {
        return all;
    }
    if light.gates_omitted > 0 {
        omitted.push(format!("{} of {} gates", light.gates_omitted, light.gates.len() + light.gates_omitted));
    }
    if light.distinct > 1 {
        return all;
    }
    omitted.push("the same at every hour except for its mean: F_uv alone".to_owned());
    Contents { uv: true, hidden: all.hidden, ..Contents::NONE }
}

/// Share of the steps in which a tile of one picture learns all it can.
const STILL_SHARE: f64 = 0.25;
/// But this many, if the recipe does.
const LEAST_STEPS: usize = 1000;

/// The recipe's steps, or fewer for a tile whose frames look alike.
fn needed_steps(recipe: &Recipe, light: &Light) -> usize {
    if recipe.paper || light.distinct > 1 {
        return recipe.iterations;
    }
    ((STILL_SHARE * recipe.iterations as f64) as usize).max(LEAST_STEPS).min(recipe.iterations)
}

fn check(source: &TileSource) -> Result<()> {
    let texels = source.width * source.height;
    let wrong = |what: String| Err(Error::invalid("tile", what));
    if texels == 0 || !source.width.is_multiple_of(4) || !source.height.is_multiple_of(4) {
        return wrong(format!("{}×{} texels; expected multiples of 4", source.width, source.height));
    }
    if source.width.max(source.height) > crate::model::STORED {
        return wrong(format!("{}×{} texels; expected at most 128×128", source.width, source.height));
    }
    if source.hours.len() != source.frames.len() {
        return wrong(format!(
            "{} hours; expected one for each of {} frames",
            source.hours.len(),
            source.frames.len()
        ));
    }
    if source.frames.is_empty() || source.coverage.len() != texels {
        return wrong(format!(
            "{} frames and {} coverages; expected at least one frame and {texels} coverages",
            source.frames.len(),
            source.coverage.len()
        ));
    }
    for (k, frame) in source.frames.iter().enumerate() {
        if frame.len() != texels {
            return wrong(format!("frame {k} has {} texels; expected {texels}", frame.len()));
        }
        if let Some(i) = frame.iter().position(|e| !e.iter().all(|c| c.is_finite() && *c >= 0.0)) {
            let (x, y) = (i % source.width, i / source.width);
            return wrong(format!("frame {k}, texel ({x}, {y}): {:?}; expected finite light ≥ 0", frame[i]));
        }
    }
    Ok(())
}

/// Trains at `rate` times the recipe's rates; where that diverges, at ever smaller ones.
fn train_width<const H: usize>(
    problem: &Problem,
    recipe: &Recipe,
    rate: f32,
    mut omitted: Vec<String>,
) -> Result<TrainedTile> {
    let attempt = |slower: f32, last: bool| {
        Attempt::<H>::new(problem, recipe, rate * slower, Tier::detect()).finish(recipe, last)
    };
    let trained = restarting(attempt, &mut omitted)?;
    Ok(TrainedTile { omitted, ..trained })
}

/// What the first attempt gives that does not diverge; each is told its share of the rate, and whether it is
/// the last. Every restart is added to the remarks.
fn restarting<T>(
    mut attempt: impl FnMut(f32, bool) -> Result<Option<T>>,
    remarks: &mut Vec<String>,
) -> Result<T> {
    for retry in 0..=RETRIES {
        if let Some(finished) = attempt(0.5f32.powi(retry), retry == RETRIES)? {
            return Ok(finished);
        }
        if retry < RETRIES {
            remarks.push(format!("training diverged; restarted at 1/{} of the learning rate", 2 << retry));
        }
    }
    Err(Error::invalid("tile", format!("training diverges even at 1/{} of the learning rate", 1 << RETRIES)))
}
