//! What a bake is asked for.

use crate::light::times::Hours;
use crate::light::times::extra_times;
use crate::trace::rays::Backend;
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
    /// Names the baker's own filters: other filters are other files.
    pub const METHOD: &str = "own-1";

    /// The method, where there is one.
    pub fn method(self, is_transfer: bool) -> Option<&'static str> {
        (self != Denoise::Off && !is_transfer).then_some(Self::METHOD)
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

/// The bytes that are free to this user on the file system of a folder that may not exist yet; `None` where
/// the system does not tell.
fn free_bytes(folder: &Path) -> Option<u64> {
    let folder = std::path::absolute(folder).ok()?;
    let nearest = folder.ancestors().find(|path| path.exists())?;
    dataset::host::system::free_bytes(nearest)
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
