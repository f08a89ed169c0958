//! A scene read and planned, and the digests by which its layers and its dataset are known again.

use super::hidden::{self, Hidden};
use super::limits::Limits;
use super::openings::{found_portals, openings, rooms};
use super::options::{Integrator, Options, Preset};
use super::plan::Plan;
use super::transfer;
use crate::atlas::{self, Atlas};
use crate::bake::store::{Charts, Parts, json};
use crate::geometry::{self, Geometry, Solids};
use crate::light::times::{Hours, VisibilityTimes, visibility_times};
use crate::scene::{Baked, Lightmap, LightmapSize, MAX_SAMPLES, Scene, Sky, SunVisibility};
use crate::trace::counts::RayCounts;
use crate::trace::rays::{Backend, Bvh8, RayTracer};
use crate::trace::solids::Space;
use crate::{Error, Result};
use dataset::format::{MOST_TIMES, SunPath, Transfer};
use dataset::observe::{Observer, Silent};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// Changes whenever the same scene would give other texels.
const METHOD: &str = "paths-28";
/// Changes whenever the same scene would give another `scene.glb`.
const SCENE_GLB: &str = "scene-glb-3";

/// A scene read and planned: what a bake would do.
#[derive(Debug)]
pub struct Prepared {
    /// The file that the scene was read of.
    pub scene_file: PathBuf,
    /// The scene, with what the command line overrides.
    pub scene: Scene,
    /// The hours that are baked.
    hours: Hours,
    /// What the scene is the transfer of, where that is asked for.
    pub transfer: Option<Transfer>,
    /// Its triangles.
    pub geometry: Geometry,
    /// The layers.
    pub plan: Plan,
    /// The times at which the sun's visibility is to be found; `None` where it is not.
    pub visibility_times: Option<VisibilityTimes>,
    /// How light will be followed.
    pub integrator: Integrator,
    /// What will find the hits of rays.
    pub backend: Backend,
    /// How noise will be taken out of indirect light, where it will be.
    pub denoise: Option<&'static str>,
    /// When to stop.
    pub limits: Limits,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Digest of all that decides a texel but light.
    base: blake3::Hash,
    /// Per layer, its digest.
    pub digests: Vec<String>,
    /// Our own hierarchy over the triangles, once it is needed.
    hierarchy: OnceLock<Arc<Bvh8>>,
    /// The triangles that bound solids, once they are needed.
    solids: OnceLock<Solids>,
}

impl Prepared {
    /// The digest of all that decides a texel but light, in hexadecimal.
    pub fn base(&self) -> String {
        self.base.to_hex().to_string()
    }

    /// The digest of the work of tracing some layers. A target is judged by frames of denoised light: what
    /// decides those decides the work too.
    pub fn work(&self, layers: &[usize]) -> String {
        let digests = layers.iter().map(|&l| self.digests[l].as_str()).collect::<String>();
        let judged = self.limits.target_error.map(|_| format!("{:?}{:?}", self.denoise, self.frames(layers)));
        let work = format!("{}{digests}{}", self.base(), judged.unwrap_or_default());
        blake3::hash(work.as_bytes()).to_hex().to_string()
    }

    /// The folder that the dataset goes to.
    pub fn out(&self, options: &Options) -> PathBuf {
        options.out.clone().unwrap_or_else(|| Path::new("dataset").join(&self.scene.name))
    }

    /// The sun by the minute over the time that is baked; none where the scene has no sun, nor in transfers.
    pub fn sun_path(&self) -> Option<SunPath> {
        let sun = self.scene.sun.as_ref().filter(|_| self.transfer.is_none())?;
        Some(visibility_times::sun_path(sun, self.scene.location.as_ref(), self.hours.span()))
    }

    /// The ray tracer over the triangles. Our own hierarchy is built once, however often this is asked for.
    ///
    /// # Errors
    /// As [`RayTracer::with_backend`].
    pub fn ray_tracer(&self) -> Result<RayTracer<'_>> {
        match self.backend {
            Backend::Obvhs => Ok(self.own_ray_tracer()),
            Backend::Embree => RayTracer::with_backend(&self.geometry, self.backend),
        }
    }

    /// Rays through our own hierarchy, whatever the backend.
    fn own_ray_tracer(&self) -> RayTracer<'_> {
        let hierarchy = self.hierarchy.get_or_init(|| Arc::new(Bvh8::new(&self.geometry)));
        RayTracer::with_hierarchy(&self.geometry, Arc::clone(hierarchy))
    }

    /// The space among the triangles, with its solids.
    pub fn space<'a>(&'a self, ray_tracer: &'a RayTracer<'a>) -> Space<'a> {
        let solids = self.solids.get_or_init(|| Solids::new(&self.geometry));
        Space::new(&self.geometry, ray_tracer).with_solids(solids.clone())
    }

    /// Lays out the texels, unwrapping every mesh: [`Prepared::atlas_from`] nothing.
    ///
    /// # Errors
    /// As [`Prepared::atlas_from`].
    pub fn atlas(&self) -> Result<(Atlas, RayCounts)> {
        self.atlas_from(&Charts::none())
    }

    /// Lays out the texels, none of them on faces that nobody can see; gives also the rays that it took to
    /// find those. Meshes that an earlier bake unwrapped are not unwrapped again.
    ///
    /// # Errors
    /// As [`atlas::build_from`]; what does not fit names the line that asks for it.
    pub fn atlas_from(&self, charts: &Charts) -> Result<(Atlas, RayCounts)> {
        self.atlas_of(&self.scene.lightmap, charts)
    }

    /// The same by another lightmap than the scene's.
    pub fn atlas_of(&self, lightmap: &Lightmap, charts: &Charts) -> Result<(Atlas, RayCounts)> {
        let hidden = match hidden::is_sought(lightmap) {
            true => hidden::find_in(&self.space(&self.own_ray_tracer()), lightmap),
            false => Hidden::default(),
        };
        let atlas = atlas::build_from(&self.geometry, lightmap, &hidden.triangles, charts);
        let atlas = atlas.map_err(|error| match error {
            Error::Unsupported { what, .. } => Error::unsupported(&self.scene.size_as_written, what),
            other => other,
        })?;
        Ok((atlas, hidden.rays))
    }

    /// Per time, which of these layers (ascending) it is made of, by their place among them, and what each
    /// is multiplied by.
    pub fn frames(&self, layers: &[usize]) -> Vec<Parts> {
        let of_time = |time| {
            let parts = self.plan.layers_of(time).into_iter();
            parts.filter_map(|l| Some((layers.binary_search(&l).ok()?, self.plan.scale_of(l)))).collect()
        };
        (0..self.plan.times.len()).map(of_time).collect()
    }

    /// The settings as they go into the manifest, and the digest of all that decides the dataset.
    pub fn manifest(&self, options: &Options) -> Result<(serde_json::Value, String)> {
        let mut settings = settings(&self.scene, &self.hours, self.integrator, options)?;
        let mut hash = blake3::Hasher::new();
        hash.update(self.base.as_bytes());
        self.digests.iter().for_each(|d| {
            hash.update(d.as_bytes());
        });
        let times: Vec<(f64, &[bool])> = self.plan.times.iter().map(|m| (m.hour, &m.groups_on[..])).collect();
        hash.update(&json::bytes(&(times, &settings), "settings")?);
        if let Some(transfer) = &self.transfer {
            hash.update(&json::bytes(transfer, "transfer")?);
        }
        // What the geometry file carries over.
        hash.update(SCENE_GLB.as_bytes());
        self.geometry.originals.update_digest(&mut hash);
        self.geometry.instances.iter().for_each(|i| {
            hash.update(i.name.as_bytes()).update(&[0]);
        });
        // Only now: another camera makes no other bake.
        settings["cameras"] = serde_json::json!(self.scene.cameras);
        Ok((settings, hash.finalize().to_hex().to_string()))
    }
}

/// Reads a scene and plans its bake.
///
/// # Errors
/// Bad input.
pub fn prepare(scene_file: &Path, options: &Options, console: &dyn Observer) -> Result<Prepared> {
    options.backend.expect_built()?;
    let start = Instant::now();
    let (mut scene, mut warnings) = crate::scene::load(scene_file)?;
    apply(&mut scene, options)?;
    if let Some(location) = &scene.location {
        let checked = crate::light::daylight::sun::check(location);
        checked.map_err(|e| Error::invalid(scene_file.display(), format!("[place]: {e}")))?;
    }
    let (mut scene, hours, transfer) = if options.transfer {
        let inputs = inputs_of_the_day(scene_file, options)?;
        warnings.extend(transfer::omitted(&scene));
        let (scene, hours, transfer) = transfer::of_scene(scene, scene_file, inputs, options.extra_times)?;
        (scene, hours, Some(transfer))
    } else {
        (scene, options.hours.clone(), None)
    };
    warnings.iter().for_each(|w| console.warn(w));
    // Warnings are told whether or not there are errors, too.
    let before = warnings.len();
    let loaded = geometry::load_with(&scene, &mut warnings);
    warnings[before..].iter().for_each(|w| console.warn(w));
    let geometry = loaded?;
    geometry.lights.add_to(&mut scene);
    let hierarchy = OnceLock::new();
    if scene.sky.is_some() && (scene.find_portals || !scene.portals.is_empty()) {
        let own = hierarchy.get_or_init(|| Arc::new(Bvh8::new(&geometry)));
        let ray_tracer = RayTracer::with_hierarchy(&geometry, Arc::clone(own));
        if scene.portals.is_empty() {
            scene.portals = openings(&geometry, &ray_tracer);
            found_portals(&scene.portals).into_iter().for_each(|what| console.say(format!("  {what}")));
        }
        scene.rooms = rooms(&scene.portals, &geometry, &ray_tracer);
    }
    let mut plan = Plan::new(&scene, &geometry, &hours, options.extra_times);
    plan.skipped.extend(geometry.originals.left_out());
    let visibility_times = visibility_times(&scene, &hours, &mut plan.skipped)?;
    let integrator = match (options.integrator, scene.bake.bounces) {
        (Integrator::Cached, Some(most)) => {
            let why = "the cache holds all bounces";
            plan.skipped.push(format!("no cache: at most {most} bounces are asked for, {why}"));
            Integrator::Path
        }
        (Integrator::Path, _) => {
            plan.skipped.push("no cache: --integrator path".to_owned());
            Integrator::Path
        }
        (integrator, None) => integrator,
    };
    let limits = Limits {
        samples: scene.bake.samples,
        target_error: options.target_error,
        deadline: options.time_limit.map(|limit| start + limit),
    };
    let base = base_digest(&scene, &geometry, integrator, options)?;
    let digests = plan.digests(&scene, &base)?;
    let backend = options.backend;
    Ok(Prepared {
        scene_file: scene_file.to_owned(),
        scene,
        hours,
        transfer,
        geometry,
        plan,
        visibility_times,
        integrator,
        backend,
        denoise: options.denoise.method(options.transfer),
        limits,
        warnings,
        base,
        digests,
        hierarchy,
        solids: OnceLock::new(),
    })
}

/// The digest of the day's bake of a scene, which its transfer goes with. (That bake is prepared for no more
/// than this.)
fn inputs_of_the_day(scene_file: &Path, options: &Options) -> Result<String> {
    let day = Options { hours: Hours::day(), transfer: false, ..options.clone() };
    let (_, inputs) = prepare(scene_file, &day, &Silent)?.manifest(&day)?;
    Ok(inputs)
}

/// Overrides what the command line overrides.
fn apply(scene: &mut Scene, options: &Options) -> Result<()> {
    if options.indirect && scene.sun_baked == Baked::All {
        scene.sun_baked = Baked::Indirect;
    }
    scene.sun_visibility = scene.sun.as_ref().map(|_| match (scene.sun_visibility, scene.sun_baked) {
        (Some(visibility), _) => visibility,
        (None, Baked::All) if options.preset == Preset::Final => SunVisibility::Fine,
        (None, Baked::All) => SunVisibility::Quarters,
        (None, Baked::Indirect | Baked::None) => SunVisibility::Off,
    });
    let (scale, note) = match options.preset {
        Preset::Draft => (0.5, ", halved by --draft"),
        Preset::Default => (1.0, ""),
        Preset::Final => (2.0, ", doubled by --final"),
    };
    scene.lightmap.size = match scene.lightmap.size {
        LightmapSize::Fixed { width, height } => {
            let scaled = |texels: u32| ((f64::from(texels) * scale) as u32).max(1);
            LightmapSize::Fixed { width: scaled(width), height: scaled(height) }
        }
        LightmapSize::TexelsPerMetre(d) => LightmapSize::TexelsPerMetre(d * scale),
    };
    scene.size_as_written += note;
    // A padding that is wider than the default was meant as a part of the page.
    let least = Lightmap::default().padding;
    if scene.lightmap.padding > least {
        scene.lightmap.padding = ((f64::from(scene.lightmap.padding) * scale) as u32).max(least);
    }
    scene.bake.samples = match options.preset {
        Preset::Draft => (scene.bake.samples / 4).max(2),
        Preset::Default => scene.bake.samples,
        Preset::Final => (scene.bake.samples * 2).min(MAX_SAMPLES),
    };
    /// What a target error or a time limit may use when no number of samples is given.
    const PLENTY: u32 = 1 << 16;
    if (options.target_error.is_some() || options.time_limit.is_some()) && options.samples.is_none() {
        scene.bake.samples = PLENTY;
    }
    if let Some(samples) = options.samples {
        if !(2..=MAX_SAMPLES).contains(&samples) || !samples.is_power_of_two() {
            let above = samples.clamp(2, MAX_SAMPLES).next_power_of_two();
            let expected = format!("expected a power of two from 2 to {MAX_SAMPLES}, such as {above}");
            return Err(Error::invalid("--samples", format!("{samples}: {expected}")));
        }
        scene.bake.samples = samples;
    }
    if let Some(target) = options.target_error.filter(|t| !(1e-4..1.0).contains(t)) {
        return Err(Error::invalid(
            "--target-error",
            format!("{target}: expected 0.01 % to less than 100 %"),
        ));
    }
    Ok(())
}

/// The times at which the sun's visibility is to be found; where it is not, `skipped` gets the reason, if
/// there is a sun.
///
/// # Errors
/// [`Error::Unsupported`] for more times than a dataset holds.
fn visibility_times(
    scene: &Scene,
    hours: &Hours,
    skipped: &mut Vec<String>,
) -> Result<Option<VisibilityTimes>> {
    let (Some(sun), Some(visibility)) = (&scene.sun, scene.sun_visibility) else { return Ok(None) };
    if matches!(scene.sky, Some(Sky::Harmonics { .. })) || scene.sun_baked == Baked::None {
        // (Told with its rays.)
        return Ok(None);
    }
    let Some(minutes) = visibility.minutes() else {
        skipped.push(match scene.sun_baked {
            Baked::All => "no visibility of the sun: [sun] visibility = \"off\"".to_owned(),
            _ => "no visibility of the sun: its direct light is not baked ([sun] visibility asks for it all the same)".to_owned(),
        });
        return Ok(None);
    };
    let [from, to] = hours.span();
    if from == to {
        skipped.push("no visibility of the sun over time: one time is baked".to_owned());
        return Ok(None);
    }
    let visibility_times = VisibilityTimes::new(sun, scene.location.as_ref(), [from, to], minutes);
    if visibility_times.is_dark() {
        skipped.push(
            "no visibility of the sun: it gives no light between the first and the last hour".to_owned(),
        );
        return Ok(None);
    }
    if visibility_times.hours.len() > MOST_TIMES {
        let what = format!(
            "the sun's visibility has {} times; expected {MOST_TIMES} at most: fewer keys, or visibility = \"off\"",
            visibility_times.hours.len()
        );
        return Err(Error::unsupported("[sun] track", what));
    }
    Ok(Some(visibility_times))
}

/// Digest of all that decides a texel but light.
fn base_digest(
    scene: &Scene,
    geometry: &Geometry,
    integrator: Integrator,
    options: &Options,
) -> Result<blake3::Hash> {
    let mut hash = blake3::Hasher::new();
    hash.update(METHOD.as_bytes());
    let decisive = (
        &scene.lightmap,
        &scene.bake,
        integrator,
        options.backend.to_string(),
        options.target_error,
        options.time_limit.map(|limit| limit.as_nanos()),
    );
    hash.update(&json::bytes(&decisive, "scene")?);
    geometry.update_digest(&mut hash);
    Ok(hash.finalize())
}

/// The settings as they go into the manifest: no path of the machine that baked.
fn settings(
    scene: &Scene,
    hours: &Hours,
    integrator: Integrator,
    options: &Options,
) -> Result<serde_json::Value> {
    let mut settings = serde_json::to_value(scene).map_err(|e| Error::invalid("scene", e))?;
    if let Some(objects) = settings["objects"].as_array_mut() {
        for object in objects.iter_mut().filter_map(|o| o.as_object_mut()) {
            let name = object["file"]
                .as_str()
                .and_then(|f| Path::new(f).file_name()?.to_str())
                .unwrap_or("")
                .to_owned();
            object.insert("file".to_owned(), name.into());
        }
    }
    settings["hours"] = serde_json::json!(hours.list);
    settings["baked_with"] = serde_json::json!({
        "method": METHOD,
        "integrator": integrator,
        "backend": options.backend.to_string(),
        "denoise": options.denoise.method(options.transfer),
        "target_error": options.target_error,
        "time_limit_secs": options.time_limit.map(|limit| limit.as_secs_f64()),
    });
    Ok(settings)
}
