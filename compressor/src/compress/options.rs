//! Options of a compression.

use crate::bundle::MapCoding;
use crate::model::Profile;
use crate::train::{Aim, Recipe};
use std::path::PathBuf;
use std::time::Duration;

/// How long and how carefully tiles are trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Steps of the main phase.
    pub iterations: usize,
    /// See [`Recipe::passes`].
    pub passes: usize,
}

/// Quick results.
pub const DRAFT: Preset = Preset { name: "draft", iterations: 1000, passes: 2 };
/// The default.
pub const MEDIUM: Preset = Preset { name: "medium", iterations: 10_000, passes: 2 };
/// The best quality.
pub const FINAL: Preset = Preset { name: "final", iterations: 32_000, passes: 4 };
/// All presets, the shortest first.
pub const PRESETS: [Preset; 3] = [DRAFT, MEDIUM, FINAL];

/// How tiles' configurations are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Profile M; S where the dataset stores the sun's direct light separately, because the rest is smooth in
    /// time.
    Usual,
    /// The same profile for all tiles, omitting what a tile does not need.
    Profile(Profile),
    /// By trial fits, so that all tiles together reach about this pooled PSNR in dB.
    Psnr(f64),
    /// By trial fits, within this many bits per texel and frame for the whole bundle.
    Bpp(f64),
}

/// Options of a compression.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// How maps are coded.
    pub coding: MapCoding,
    /// How tiles' configurations, or with [`MapCoding::Basis`] the step of all tiles, are chosen.
    pub rate: Rate,
    /// Steps of the main phase; with a time limit, at most this many.
    pub iterations: usize,
    /// See [`Recipe::passes`].
    pub passes: usize,
    /// Time from the run's start at which training is planned to end: all tiles get about the same number of
    /// steps. The bytes then depend on the machine and its load. Only with [`Rate::Profile`], because the
    /// time of trial fits cannot be planned.
    pub time_limit: Option<Duration>,
    /// Omit the sun's direct light, which the dataset stores separately: the bundle's reader draws the sun
    /// itself.
    pub without_sun: bool,
    /// Cross-fade the sun's shadows from frame to frame instead of moving them.
    pub still_shadows: bool,
    /// Seed of all randomness.
    pub seed: u64,
    /// The bundle's path; `None` for [`super::default_bundle`].
    pub out: Option<PathBuf>,
    /// Retrain every tile, even those a stopped run finished, and replace an existing bundle. Shards and
    /// merges only do the latter.
    pub force: bool,
    /// Write the bundle from the tiles that shards have trained or, with a target, first choose
    /// configurations from their trial fits. [`Rate::Psnr`] trains a few tiles to choose.
    pub merge: bool,
}

impl Options {
    /// The recipe of all tiles; each has its own seed.
    pub(super) fn recipe(&self) -> Recipe {
        let aim = match self.rate {
            Rate::Usual | Rate::Profile(_) => Aim::MeanPsnr,
            _ => Aim::PooledError,
        };
        Recipe { iterations: self.iterations, passes: self.passes, paper: false, seed: self.seed, aim }
    }

    /// The defaults with a preset's training.
    pub fn of(preset: Preset) -> Self {
        Options {
            coding: MapCoding::Neural,
            rate: Rate::Usual,
            iterations: preset.iterations,
            passes: preset.passes,
            time_limit: None,
            without_sun: false,
            still_shadows: false,
            seed: 1,
            out: None,
            force: false,
            merge: false,
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Options::of(MEDIUM)
    }
}
