//! Small scenes written to a folder, baked through the real pipeline and looked at texel by texel.

pub mod closed;
pub mod mesh;
pub mod texels;

use baker::bake::run::{Denoise, Integrator, Options, Outcome, bake};
use baker::light::times::schedule::parse_hours;
use dataset::format::{FileRef, Layer, Light};
use dataset::image::{Image, Mask};
use dataset::observe::Silent;
use dataset::store::Dataset;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;
use texels::Texel;

/// Independent scrambles behind every σ.
pub const SEEDS: u64 = 16;
/// As many standard errors as have the probability of 3 σ (0.27 %) when σ itself is estimated from 16 values:
/// Student's t with 15 degrees of freedom.
pub const THREE_SIGMA: f64 = 3.59;

/// Both ways to follow light, for tests in which it bounces.
pub const INTEGRATORS: [Integrator; 2] = [Integrator::Cached, Integrator::Path];

/// A folder of scene files and of what was baked from them.
pub struct Stage {
    folder: Arc<TempDir>,
    integrator: Integrator,
    target_error: Option<f64>,
}

/// A bake, opened.
pub struct Baked {
    /// The dataset, every image of it checked to be sane.
    pub dataset: Dataset,
    /// What the run told.
    pub outcome: Outcome,
    /// Its valid texels.
    pub mask: Mask,
    /// Texels whose centres lie on surface, valid or not, with their places in the scene.
    pub texels: Vec<Texel>,
    /// Holds the files.
    _folder: Arc<TempDir>,
}

impl Stage {
    /// An empty folder with these text files.
    pub fn new(files: &[(&str, String)]) -> Self {
        let folder = Arc::new(tempfile::tempdir().expect("a temporary folder"));
        let stage = Stage { folder, integrator: Integrator::Cached, target_error: None };
        files.iter().for_each(|(name, text)| stage.write(name, text.as_bytes()));
        stage
    }

    /// The same files, baked by this integrator from now on.
    pub fn by(mut self, integrator: Integrator) -> Self {
        self.integrator = integrator;
        self
    }

    /// The same files, baked towards this error from now on.
    pub fn towards(mut self, target_error: f64) -> Self {
        self.target_error = Some(target_error);
        self
    }

    /// Writes a file of the scene.
    pub fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).expect("written");
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Bakes `scene`, a scene file without seed and samples; if it has a `[bake]`, that is its last table.
    pub fn try_bake(&self, hours: &str, samples: u32, seed: u64, scene: &str) -> dataset::Result<Baked> {
        self.try_bake_with(hours, samples, seed, scene, Denoise::Auto)
    }

    fn try_bake_with(
        &self,
        hours: &str,
        samples: u32,
        seed: u64,
        scene: &str,
        denoise: Denoise,
    ) -> dataset::Result<Baked> {
        let heading = if scene.contains("[bake]") { "" } else { "[bake]" };
        let text = format!("{scene}\n{heading}\nsamples = {samples}\nseed = {seed}\n");
        self.write("case.toml", text.as_bytes());
        let out = self.path(&format!("set-{seed}"));
        let hours = parse_hours(hours).expect("hours");
        let options = Options {
            // Not what these tests are about: `light::times::extra_times` has its own.
            extra_times: 0,
            integrator: self.integrator,
            denoise,
            target_error: self.target_error,
            samples: self.target_error.map(|_| samples),
            out: Some(out.clone()),
            force: true,
            ..Options::new(hours)
        };
        let outcome = bake(&self.path("case.toml"), &options, &Silent)?;
        Ok(self.open(&out, outcome))
    }

    /// Opens a dataset and checks every image in it.
    fn open(&self, out: &Path, outcome: Outcome) -> Baked {
        let dataset = Dataset::open(out).expect("a dataset");
        let mask = dataset.mask(0).expect("a mask");
        assert_sane(&dataset);
        let texels = texels::of(&dataset, &mask);
        Baked { dataset, outcome, mask, texels, _folder: self.folder.clone() }
    }

    /// [`Stage::try_bake`] with seed 1, which must succeed.
    #[track_caller]
    pub fn bake(&self, hours: &str, samples: u32, scene: &str) -> Baked {
        self.try_bake(hours, samples, 1, scene).unwrap_or_else(|error| panic!("{error}"))
    }

    /// The message of a bake that must fail.
    #[track_caller]
    pub fn refusal(&self, hours: &str, scene: &str) -> String {
        match self.try_bake(hours, 2, 1, scene) {
            Ok(_) => panic!("the bake was accepted"),
            Err(error) => error.to_string(),
        }
    }

    /// Mean and standard error, over [`SEEDS`] scrambles, of a number read from each bake, which is left as
    /// it was traced.
    #[track_caller]
    pub fn measure(&self, hours: &str, samples: u32, scene: &str, read: impl Fn(&Baked) -> f64) -> Measured {
        self.measure_with(hours, samples, scene, Denoise::Off, read)
    }

    /// The same of several numbers that are read from the same bakes.
    #[track_caller]
    pub fn measure_each<const N: usize>(
        &self,
        hours: &str,
        samples: u32,
        scene: &str,
        read: impl Fn(&Baked) -> [f64; N],
    ) -> [Measured; N] {
        let bake = |seed| {
            let baked = self.try_bake_with(hours, samples, seed, scene, Denoise::Off);
            baked.unwrap_or_else(|error| panic!("{error}"))
        };
        let read: Vec<[f64; N]> = (1..=SEEDS).map(|seed| read(&bake(seed))).collect();
        std::array::from_fn(|i| Measured::of(&read.iter().map(|numbers| numbers[i]).collect::<Vec<_>>()))
    }

    /// The same of bakes that are denoised, or not.
    #[track_caller]
    pub fn measure_with(
        &self,
        hours: &str,
        samples: u32,
        scene: &str,
        denoise: Denoise,
        read: impl Fn(&Baked) -> f64,
    ) -> Measured {
        let bake = |seed| {
            let baked = self.try_bake_with(hours, samples, seed, scene, denoise);
            baked.unwrap_or_else(|error| panic!("{error}"))
        };
        Measured::of(&(1..=SEEDS).map(|seed| read(&bake(seed))).collect::<Vec<_>>())
    }
}

impl Baked {
    /// The lightmap at an hour that was baked.
    #[track_caller]
    pub fn at(&self, hour: f64) -> Image {
        let set = self.dataset.config.frames.iter().position(|s| (s.hour - hour).abs() < 1e-6);
        self.dataset.map(set.unwrap_or_else(|| panic!("no set at {hour}")), 0).expect("a map")
    }

    /// The lightmap of the first set.
    pub fn first(&self) -> Image {
        self.dataset.map(0, 0).expect("a map")
    }

    /// A group's light.
    pub fn group(&self, name: &str) -> Image {
        let group = self.dataset.config.groups.iter().position(|g| g.name == name).expect("the group");
        self.dataset.light(Light::Group, Some(group as u32), 0, 0).expect("its light")
    }

    /// Valid texels that lie wholly on the surfaces whose name contains `name`, and at least one.
    #[track_caller]
    pub fn on(&self, name: &str) -> Vec<&Texel> {
        let fits = |t: &&Texel| t.whole && t.valid && t.name.contains(name);
        let found: Vec<&Texel> = self.texels.iter().filter(fits).collect();
        assert!(!found.is_empty(), "no valid texel wholly on {name}: {:?}", self.outcome.facts);
        found
    }

    /// Texels whose centres lie on the surfaces whose name contains `name`, valid or not.
    pub fn covered(&self, name: &str) -> Vec<&Texel> {
        self.texels.iter().filter(|t| t.name.contains(name)).collect()
    }

    /// Light over the texels of `image` ÷ the light that `expected` gives at their points.
    pub fn ratio(&self, image: &Image, texels: &[&Texel], expected: impl Fn(&Texel) -> f64) -> f64 {
        let light: f64 = texels.iter().map(|t| green(image, t)).sum();
        light / texels.iter().map(|t| expected(t)).sum::<f64>()
    }
}

/// The green channel of a texel; none of an invalid one, which holds only what dilation put there.
pub fn green(image: &Image, texel: &Texel) -> f64 {
    if texel.valid { f64::from(image.texels[texel.index][1]) } else { 0.0 }
}

/// The mean of a texel's channels over some texels.
pub fn mean(image: &Image, texels: &[&Texel]) -> f64 {
    texels.iter().map(|t| green(image, t)).sum::<f64>() / texels.len() as f64
}

/// A mean over scrambles and its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    pub mean: f64,
    pub sigma: f64,
}

impl Measured {
    /// Of independent values.
    pub fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Measured { mean, sigma: (variance / n).sqrt() }
    }

    /// The value must lie within three standard errors of the closed form, and these must be within
    /// `precision` of it: else the test would show nothing. Rounding to `f32` is allowed for.
    #[track_caller]
    pub fn expect(self, closed_form: f64, precision: f64) {
        let Measured { mean, sigma } = self;
        assert!(sigma <= precision * closed_form, "{mean} ± {sigma} is no test of {closed_form}");
        let off = (mean - closed_form).abs();
        assert!(off <= THREE_SIGMA * sigma + 2e-5 * closed_form, "{mean} ± {sigma}, expected {closed_form}");
    }

    /// Two independent measurements must agree.
    #[track_caller]
    pub fn agree(self, other: Self, precision: f64) {
        let sigma = (self.sigma.powi(2) + other.sigma.powi(2)).sqrt();
        assert!(sigma <= precision * other.mean, "{self:?} {other:?}");
        assert!((self.mean - other.mean).abs() <= 3.2 * sigma + 2e-5 * other.mean, "{self:?} {other:?}");
    }
}

/// Reads every image of a dataset: no texel is NaN, infinite or negative, no error estimate either.
pub fn assert_sane(dataset: &Dataset) {
    let config = &dataset.config;
    let check = |file: &FileRef| {
        // The reader refuses such texels; looked at again here, for a test must not rest on what it tests.
        let image = dataset.image(file, 0).unwrap_or_else(|error| panic!("{error}"));
        for (i, texel) in image.texels.iter().enumerate() {
            assert!(texel.iter().all(|v| v.is_finite() && *v >= 0.0), "{}: texel {i}: {texel:?}", file.path);
        }
    };
    let mut seen = std::collections::BTreeSet::new();
    let maps = config.frames.iter().flat_map(|frame| &frame.maps);
    for file in maps.chain(config.layers.iter().flat_map(Layer::files)) {
        if seen.insert(&file.path) {
            check(file);
        }
    }
    for set in &config.frames {
        assert!(set.relative_error.is_none_or(|e| e.is_finite() && e >= 0.0), "{:?}", set.relative_error);
    }
    // Checks each of its numbers.
    dataset.noise().expect("a noise table");
}
