//! What a bake is asked for, and what it tells when done.

use super::check::Check;
use super::denoise::{self, Denoised};
use super::local_errors::LocalErrorSummary;
use super::rounds::Round;
use crate::light::extra_times;
use crate::light::schedule::Hours;
use crate::trace::backend::Backend;
use crate::trace::counts::RayCounts;
use dataset::observe::count;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What to bake, apart from the scene.
#[derive(Clone, Debug)]
pub struct Options {
    /// The times; not looked at for a transfer, which has its own.
    pub hours: Hours,
    /// At most this many more where light changes fast; a transfer has its light at those, too.
    pub extra_times: u32,
    /// The scene's transfer instead of its light.
    pub transfer: bool,
    /// Of the sun only what surfaces reflect, as if the scene said `baked = "indirect"` of it.
    pub indirect: bool,
    /// Samples of indirect light per texel; `None`: the scene's, or up to 65536 with a target or a time
    /// limit.
    pub samples: Option<u32>,
    /// Relative error at which 16×16 texels get no more samples.
    pub target_error: Option<f64>,
    /// Tracing stops after this time, whatever was reached, but not before the first round is done.
    pub time_limit: Option<Duration>,
    /// How light is traced beyond the first surface.
    pub integrator: Integrator,
    /// The ray-tracing backend.
    pub backend: Backend,
    /// Whether indirect light is denoised.
    pub denoise: Denoise,
    /// Retrace some texels with this many unbiased paths each, to measure the error.
    pub check: Option<u32>,
    /// Size and samples.
    pub preset: Preset,
    /// The dataset's folder; `None`: `dataset/<scene>` in the working folder.
    pub out: Option<PathBuf>,
    /// Discard earlier work on this dataset, and replace it even by less.
    pub force: bool,
    /// Returns the free bytes on the file system of a folder, if known. (Tests replace it.)
    pub free_bytes: fn(&Path) -> Option<u64>,
}

impl Options {
    /// The defaults, for these times.
    pub fn new(hours: Hours) -> Self {
        Options {
            hours,
            extra_times: extra_times::MOST_EXTRA_TIMES,
            transfer: false,
            indirect: false,
            samples: None,
            target_error: None,
            time_limit: None,
            integrator: Integrator::Cached,
            backend: Backend::default(),
            denoise: Denoise::Auto,
            check: None,
            preset: Preset::Default,
            out: None,
            force: false,
            free_bytes,
        }
    }
}

/// How large and how good a bake is to be, beside what the scene file says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// Half the lightmap's side, a quarter of the samples.
    Draft,
    /// As the scene says.
    #[default]
    Default,
    /// Twice the lightmap's side and twice the samples: what a game ships.
    Final,
}

/// Whether indirect light is denoised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Denoise {
    /// Where it pays: in all bakes but transfers.
    #[default]
    Auto,
    /// Not at all.
    Off,
    /// By the baker's own filters. (Not what a transfer holds: that may be negative.)
    Own,
}

impl Denoise {
    /// The method, where there is one.
    pub fn method(self, is_transfer: bool) -> Option<&'static str> {
        (self != Denoise::Off && !is_transfer).then_some(denoise::METHOD)
    }
}

/// How light is traced beyond the first surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Integrator {
    /// Paths end in an irradiance cache that is computed first: fast, slightly biased.
    Cached,
    /// Plain path tracing: unbiased for a fixed number of samples.
    Path,
}

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

/// The local errors of a bake ([`super::local_errors`]).
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

/// The bytes that are free to this user on the file system of a folder that may not exist yet; `None` where
/// the system does not tell.
fn free_bytes(folder: &Path) -> Option<u64> {
    let folder = std::path::absolute(folder).ok()?;
    let nearest = folder.ancestors().find(|path| path.exists())?;
    dataset::system::free_bytes(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_free_is_that_of_the_nearest_folder_that_exists() {
        let dir = tempfile::tempdir().unwrap();
        let free = free_bytes(&dir.path().join("not/yet"));
        assert!(free.is_some_and(|free| free > 0), "{free:?}");
    }
}
