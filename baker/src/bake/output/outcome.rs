//! What a bake gave: `run.json`, and what the report says.

use crate::bake::errors::LocalErrorSummary;
use crate::bake::finish::Check;
use crate::bake::layers::Denoised;
use crate::bake::prepare::Integrator;
use crate::bake::rounds::Round;
use crate::trace::counts::RayCounts;
use dataset::observe::count;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What a bake gave.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outcome {
    /// The scene's name.
    pub scene: String,
    /// The dataset's folder.
    pub dataset: PathBuf,
    /// The scene file, from the dataset's folder.
    pub scene_file: Option<PathBuf>,
    /// The digest of all that decides the dataset, as in its manifest.
    pub inputs: String,
    /// True when the folder held this very bake already and nothing was traced.
    pub up_to_date: bool,
    /// How light was followed.
    pub integrator: Integrator,
    /// Width and height of a page in texels.
    pub size: [u32; 2],
    /// Pages.
    pub pages: u32,
    /// Frames written.
    pub frames: usize,
    /// Their hours.
    pub hours: Vec<f64>,
    /// Valid texels.
    pub texels: usize,
    /// Samples of indirect light that a texel of mean deviation has, at most.
    pub samples: u32,
    /// Those that were drawn, on average.
    pub mean_samples: f64,
    /// Layers of light traced by this run, and those taken from an earlier one.
    pub layers: LayerCount,
    /// Median estimated relative error over (tile, frame).
    pub relative_error: f64,
    /// Local errors: of cells of 16×16 texels, relative to the light where they are.
    pub local: LocalErrors,
    /// What was denoised; `None` where nothing was.
    pub denoised: Option<Denoised>,
    /// Whether a time limit ended the tracing.
    pub out_of_time: bool,
    /// Wall-clock seconds of this run, from scene file to dataset.
    pub seconds: f64,
    /// Rays traced by this run, by purpose: for the layers it traced, to lay out their texels, to look around
    /// from their cells, and to denoise. Not those of its check.
    pub rays: RayCounts,
    /// Error against time, round by round.
    pub rounds: Vec<Round>,
    /// The true error of some texels, if it was asked for.
    pub check: Option<Check>,
    /// Facts about geometry and page, in words.
    pub facts: Vec<String>,
    /// What was skipped and why.
    pub skipped: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl Outcome {
    /// What denoising did, in words.
    pub fn denoised_in_words(&self) -> Option<String> {
        let denoised = self.denoised.as_ref()?;
        let before = self.rounds.last().and_then(|round| round.local).map_or(String::new(), |local| {
            let percent = |share: f64| format!("{:.1} %", share * 100.0);
            format!(
                ": as traced, the local error was {} in the median cell and {} at the 95th percentile",
                percent(local.median),
                percent(local.p95)
            )
        });
        let how = match denoised.new_layers {
            0 => ", kept from an earlier bake".to_owned(),
            _ => format!(" in {:.1} s", denoised.seconds),
        };
        Some(format!("denoised {}{how}{before}", count(denoised.layers, "layer")))
    }

    /// The hour with the greatest local errors, and those.
    pub fn worst_hour(&self) -> Option<(f64, LocalErrorSummary)> {
        let frame = self.local.worst_frame?;
        Some((*self.hours.get(frame)?, (*self.local.frames.get(frame)?)?))
    }
}

/// The local errors of a bake ([`crate::bake::errors::local_errors`]).
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LocalErrors {
    /// Of all frames together; `None` without light.
    pub all: Option<LocalErrorSummary>,
    /// Of each frame.
    pub frames: Vec<Option<LocalErrorSummary>>,
    /// The frame whose 95th percentile is greatest.
    pub worst_frame: Option<usize>,
    /// Where many cells have more than the target error, or than 5 % without one: why, and what to do.
    pub advice: Option<String>,
}

/// Where the layers of a bake came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LayerCount {
    /// Traced by this run.
    pub traced: usize,
    /// Kept from an earlier one.
    pub reused: usize,
}
