//! A bake from end to end.

use super::assemble::{Assembler, Stored};
use super::block::Worker;
use super::check::{Check, check};
use super::errors::Parts;
use super::json;
use super::layers::{Layers, Texel};
use super::plan::Plan;
use super::rounds::{Limits, Round, Traced, Tracer};
use super::state::StateFolder;
use crate::atlas::{self, Atlas, Placement};
use crate::geometry::{self, Geometry};
use crate::light::schedule::Hours;
use crate::scene::{LightmapSize, MAX_SAMPLES, Scene};
use crate::surface::FaceBins;
use crate::trace::backend::Backend;
use crate::trace::rays::Rays;
use crate::trace::walk::{RayCounts, Transport};
use crate::{Error, Result};
use dataset::config::{Config, FORMAT, FileRef, Group, Instance, VERSION};
use dataset::console::Console;
use dataset::files::write_atomically;
use dataset::store::{Dataset, Writer};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Changes whenever the same scene would give other texels.
const METHOD: &str = "walks-7";

/// What to bake, apart from the scene.
#[derive(Clone, Debug)]
pub struct Options {
    /// The moments.
    pub hours: Hours,
    /// Samples of indirect light per texel; `None`: the scene's, or as many as a target error needs.
    pub samples: Option<u32>,
    /// Relative error at which 16×16 texels get no more samples.
    pub target_error: Option<f64>,
    /// Tracing stops after this time, whatever was reached.
    pub time_limit: Option<Duration>,
    /// How light is followed past the first surface.
    pub integrator: Integrator,
    /// What finds the hits of rays.
    pub backend: Backend,
    /// Check some texels against so many walks each that are followed to their end.
    pub check: Option<u32>,
    /// Half the lightmap's side, a quarter of the samples.
    pub draft: bool,
    /// The dataset's folder; `None`: `dataset/<scene>` in the working folder.
    pub out: Option<PathBuf>,
    /// Forget earlier work on this dataset.
    pub force: bool,
}

impl Options {
    /// The defaults, for these moments.
    pub fn new(hours: Hours) -> Self {
        Options {
            hours,
            samples: None,
            target_error: None,
            time_limit: None,
            integrator: Integrator::Cached,
            backend: Backend::default(),
            check: None,
            draft: false,
            out: None,
            force: false,
        }
    }
}

/// How light is followed past the first surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Integrator {
    /// Walks end at the first lightmapped surface, where the light of the whole day has been solved for beforehand.
    Cached,
    /// Walks go on to their end: unbiased.
    Path,
}

/// What a bake gave.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outcome {
    /// The scene's name.
    pub scene: String,
    /// The dataset's folder.
    pub dataset: PathBuf,
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
    /// Sets written.
    pub sets: usize,
    /// Their hours.
    pub hours: Vec<f64>,
    /// Valid texels.
    pub texels: usize,
    /// Samples of indirect light per texel, at most.
    pub samples: u32,
    /// The same, on average.
    pub mean_samples: f64,
    /// Layers of light traced by this run, and those taken from an earlier one.
    pub layers: LayerCount,
    /// Median estimated relative error over (tile, set).
    pub relative_error: f64,
    /// Whether a time limit ended the tracing.
    pub out_of_time: bool,
    /// Wall-clock seconds of this run, from scene file to dataset.
    pub seconds: f64,
    /// Rays traced by this run, by purpose.
    pub rays: RayCounts,
    /// Error against time, round by round.
    pub rounds: Vec<Round>,
    /// The true error of some texels, if it was asked for.
    pub check: Option<Check>,
    /// Facts about geometry and page, in words.
    pub facts: Vec<String>,
    /// What was left out and why.
    pub left_out: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Where the layers of a bake came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LayerCount {
    /// Traced by this run.
    pub traced: usize,
    /// Kept from an earlier one.
    pub reused: usize,
}

/// A scene read and planned: what a bake would do.
#[derive(Debug)]
pub struct Prepared {
    /// The scene, with what the command line overrides.
    pub scene: Scene,
    /// Its triangles.
    pub geometry: Geometry,
    /// The layers.
    pub plan: Plan,
    /// How light will be followed.
    pub integrator: Integrator,
    /// What will find the hits of rays.
    pub backend: Backend,
    /// When to stop.
    pub limits: Limits,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Digest of all that decides a texel but light.
    base: blake3::Hash,
    /// Per layer, its digest.
    digests: Vec<String>,
}

/// Reads a scene and plans its bake.
///
/// # Errors
/// Bad input.
pub fn prepare(scene_file: &Path, options: &Options, console: &Console) -> Result<Prepared> {
    let start = Instant::now();
    let (mut scene, mut warnings) = crate::scene::load(scene_file)?;
    apply(&mut scene, options)?;
    if let Some(place) = &scene.place {
        let place = crate::light::sun::check(place);
        place.map_err(|e| Error::invalid(scene_file.display(), format!("[place]: {e}")))?;
    }
    warnings.iter().for_each(|w| console.warn(w));
    let (geometry, geometry_warnings) = geometry::load(&scene)?;
    geometry_warnings.iter().for_each(|w| console.warn(w));
    warnings.extend(geometry_warnings);
    let mut plan = Plan::new(&scene, &geometry, &options.hours);
    let integrator = match (options.integrator, scene.bake.bounces) {
        (Integrator::Cached, Some(most)) => {
            let why = "the cache holds all bounces";
            plan.left_out.push(format!("no cache: at most {most} bounces are asked for, {why}"));
            Integrator::Path
        }
        (Integrator::Path, _) => {
            plan.left_out.push("no cache: --integrator path".to_owned());
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
    Ok(Prepared { scene, geometry, plan, integrator, backend, limits, warnings, base, digests })
}

/// Bakes a scene into a dataset.
///
/// # Errors
/// Bad input, a full disk, or [`Error::Interrupted`]; finished blocks are kept and the next call continues with them.
pub fn bake(scene_file: &Path, options: &Options, console: &Console) -> Result<Outcome> {
    let start = Instant::now();
    let prepared = prepare(scene_file, options, console)?;
    let Prepared { scene, geometry, plan, limits, digests, .. } = &prepared;
    let out = options.out.clone().unwrap_or_else(|| Path::new("dataset").join(&scene.name));
    let settings = settings(scene, &options.hours)?;
    let inputs = inputs_digest(&prepared, &settings)?;
    let layers = Layers::new(&out);
    if options.force {
        StateFolder::clear(&out)?;
        layers.clear()?;
    } else if let Some(outcome) = up_to_date(&out, &inputs, options, start) {
        console.say(format!("{} already holds this bake (--force bakes it again)", out.display()));
        return Ok(outcome);
    }
    console.say(format!(
        "{}: {} triangles, {} sets, {} layers",
        scene.name,
        geometry.triangles.len(),
        plan.moments.len(),
        plan.layers()
    ));

    let atlas = {
        let progress = console.progress("unwrapping", 1);
        let atlas = atlas::build(geometry, &scene.lightmap)?;
        progress.advance(1);
        atlas
    };
    let mut writer = Writer::create(&out)?;
    let (traced, count) = trace_missing(&prepared, &atlas, &out, &layers, console)?;
    let base = prepared.base.to_hex().to_string();
    let Some(texels) = layers.texels(&base) else {
        return Err(Error::invalid(
            out.display(),
            "the layers just traced cannot be read: was the folder changed?",
        ));
    };

    let check = match options.check {
        Some(samples) => Some(check_layers(&prepared, &atlas, &layers, &texels, samples, console)?),
        None => None,
    };
    let progress = console.progress("writing", (plan.groups.len() + plan.moments.len()) as u64);
    let assembler = Assembler::new(plan, geometry, &atlas, &layers, digests, texels, scene.lightmap.padding)?;
    let stored = assembler.store(&mut writer, || progress.advance(1))?;
    drop(progress);
    let glb = writer.add("scene", "glb", &super::scene_glb::to_glb(geometry, &atlas)?)?;
    writer.alias(&glb, "scene.glb");
    let facts = facts(geometry, &atlas, plan, &stored, &traced, count);
    let texels = stored.valid_texels;
    let mut relative = stored.errors.relative();
    relative.sort_by(f64::total_cmp);
    let last = traced.rounds.last();
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        scene: scene.name.clone(),
        generator: concat!("bake ", env!("CARGO_PKG_VERSION")).to_owned(),
        unit: "irradiance in kilolux, linear Rec. 709".to_owned(),
        seed: scene.bake.seed,
        inputs: inputs.clone(),
        samples: last.map_or(limits.samples, |r| r.samples),
        pages: stored.pages,
        groups: scene.groups.iter().zip(stored.groups).map(group).collect(),
        sets: stored.sets,
        noise: Some(stored.noise),
        geometry: Some(glb),
        instances: instances(geometry, &atlas),
        settings,
    };
    writer.commit(&config)?;
    layers.keep_only(&base, digests);

    let outcome = Outcome {
        scene: scene.name.clone(),
        dataset: out.clone(),
        inputs,
        up_to_date: false,
        integrator: prepared.integrator,
        size: [atlas.width, atlas.page_height],
        pages: atlas.pages,
        sets: plan.moments.len(),
        hours: plan.moments.iter().map(|m| m.hour).collect(),
        texels,
        samples: last.map_or(limits.samples, |r| r.samples),
        mean_samples: last.map_or(f64::from(limits.samples), |r| r.mean_samples),
        layers: count,
        relative_error: relative.get(relative.len() / 2).copied().unwrap_or(0.0),
        out_of_time: traced.out_of_time,
        seconds: start.elapsed().as_secs_f64(),
        rays: traced.rays,
        facts,
        rounds: traced.rounds,
        check,
        left_out: prepared.plan.left_out,
        warnings: prepared.warnings,
    };
    write_atomically(&out.join(RUN), &json::bytes(&outcome, RUN)?)?;
    StateFolder::clear(&out)?;
    Ok(outcome)
}

/// Traces the layers that no earlier bake left, and keeps them.
fn trace_missing(
    prepared: &Prepared,
    atlas: &Atlas,
    out: &Path,
    layers: &Layers,
    console: &Console,
) -> Result<(Traced, LayerCount)> {
    let Prepared { scene, geometry, plan, digests, .. } = prepared;
    let base = prepared.base.to_hex().to_string();
    let texels = layers.texels(&base);
    let is_missing = |digest: &String| texels.as_ref().is_none_or(|t| !layers.has(digest, t.len()));
    let missing: Vec<usize> = (0..digests.len()).filter(|&l| is_missing(&digests[l])).collect();
    let count = LayerCount { traced: missing.len(), reused: digests.len() - missing.len() };
    if missing.is_empty() && texels.is_some() {
        console.say(format!("no rays: all {} layers are kept from an earlier bake", digests.len()));
        let rounds = layers.rounds(&base).unwrap_or_default();
        return Ok((Traced { rounds, ..Traced::default() }, count));
    }
    if count.reused > 0 {
        let names: Vec<String> = missing.iter().map(|&l| plan.name_of(l)).collect();
        console.say(format!(
            "{} layers are kept from an earlier bake; tracing {}",
            count.reused,
            names.join(", ")
        ));
    }
    let lights = plan.lights(scene, geometry, &missing);
    let bins = FaceBins::new(atlas);
    let rays = Rays::with_backend(geometry, prepared.backend)?;
    let transport = Transport { geometry, rays: &rays, lights: &lights, bounces: scene.bake.bounces };
    let worker = Worker { transport, atlas, bins: &bins, seed: scene.bake.seed };
    let wanted: Vec<String> = missing.iter().map(|&l| digests[l].clone()).collect();
    let work = blake3::hash(format!("{base}{}", wanted.concat()).as_bytes()).to_hex().to_string();
    let folder = StateFolder::open(out, &work, lights.layers(), lights.sampled())?;
    let sets: Vec<Parts> = (0..plan.moments.len())
        .map(|moment| {
            let parts = plan.layers_of(moment).into_iter();
            parts.filter_map(|l| Some((missing.binary_search(&l).ok()?, plan.scale_of(l)))).collect()
        })
        .collect();
    let cached = prepared.integrator == Integrator::Cached;
    let layers_of_plan = plan.layers();
    let tracer = Tracer { worker, sets, folder: &folder, cached, layers: layers_of_plan };
    let traced = tracer.run(&prepared.limits, console)?;
    layers.write(&tracer.worker, &folder, &base, &wanted, &traced.rounds, console)?;
    Ok((traced, count))
}

/// Checks all layers, however they came to be.
fn check_layers(
    prepared: &Prepared,
    atlas: &Atlas,
    layers: &Layers,
    texels: &[Texel],
    samples: u32,
    console: &Console,
) -> Result<Check> {
    let Prepared { scene, geometry, plan, digests, .. } = prepared;
    let all: Vec<usize> = (0..plan.layers()).collect();
    let lights = plan.lights(scene, geometry, &all);
    let bins = FaceBins::new(atlas);
    let rays = Rays::with_backend(geometry, prepared.backend)?;
    let transport = Transport { geometry, rays: &rays, lights: &lights, bounces: scene.bake.bounces };
    let worker = Worker { transport, atlas, bins: &bins, seed: scene.bake.seed };
    let values = digests.iter().map(|d| layers.read(d)).collect::<Result<Vec<_>>>()?;
    let part = |l: usize| (l, plan.scale_of(l));
    let sets: Vec<Parts> =
        (0..plan.moments.len()).map(|m| plan.layers_of(m).into_iter().map(part).collect()).collect();
    check(&worker, texels, &values, &sets, samples, console)
}

/// The outcome of a run, beside the manifest.
const RUN: &str = "run.json";

fn group((group, layers): (&crate::scene::Group, Vec<FileRef>)) -> Group {
    Group { name: group.name.clone(), on: group.on.clone(), layers }
}

/// The places of all instances that have texels.
fn instances(geometry: &Geometry, atlas: &Atlas) -> Vec<Instance> {
    let instances = geometry.instances.iter().zip(&atlas.placements);
    let placed = instances.flat_map(|(instance, placements)| {
        let place = |p: &Placement| Instance {
            name: instance.name.clone(),
            page: p.page,
            scale: p.scale,
            offset: p.offset,
        };
        placements.iter().map(place)
    });
    placed.collect()
}

/// Overrides what the command line overrides.
fn apply(scene: &mut Scene, options: &Options) -> Result<()> {
    if options.draft {
        scene.lightmap.size = match scene.lightmap.size {
            LightmapSize::Fixed { width, height } => {
                LightmapSize::Fixed { width: (width / 2).max(1), height: (height / 2).max(1) }
            }
            LightmapSize::TexelsPerMetre(d) => LightmapSize::TexelsPerMetre(d / 2.0),
        };
        scene.bake.samples = (scene.bake.samples / 4).max(2);
    }
    /// What a target error or a time limit may use when no number of samples is given.
    const PLENTY: u32 = 1 << 16;
    if (options.target_error.is_some() || options.time_limit.is_some()) && options.samples.is_none() {
        scene.bake.samples = PLENTY;
    }
    if let Some(samples) = options.samples {
        if !(2..=MAX_SAMPLES).contains(&samples) || !samples.is_power_of_two() {
            let expected = format!("expected a power of two from 2 to {MAX_SAMPLES}");
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

/// Digest of all that decides the dataset.
fn inputs_digest(prepared: &Prepared, settings: &serde_json::Value) -> Result<String> {
    let mut hash = blake3::Hasher::new();
    hash.update(prepared.base.as_bytes());
    prepared.digests.iter().for_each(|d| {
        hash.update(d.as_bytes());
    });
    let plan = &prepared.plan;
    let moments: Vec<(f64, &[bool])> = plan.moments.iter().map(|m| (m.hour, &m.groups_on[..])).collect();
    hash.update(&json::bytes(&(moments, settings), "settings")?);
    prepared.geometry.instances.iter().for_each(|i| {
        hash.update(i.name.as_bytes()).update(&[0]);
    });
    Ok(hash.finalize().to_hex().to_string())
}

/// The settings as they go into the manifest: no path of the machine that baked.
fn settings(scene: &Scene, hours: &Hours) -> Result<serde_json::Value> {
    let mut settings = serde_json::to_value(scene).map_err(|e| Error::invalid("scene", e))?;
    if let Some(objects) = settings["objects"].as_array_mut() {
        for object in objects.iter_mut().filter_map(|o| o.as_object_mut()) {
            object.remove("place");
            let name = object["file"]
                .as_str()
                .and_then(|f| Path::new(f).file_name()?.to_str())
                .unwrap_or("")
                .to_owned();
            object.insert("file".to_owned(), name.into());
        }
    }
    settings["hours"] = serde_json::json!(hours.list);
    Ok(settings)
}

/// The outcome of the earlier run, if `out` holds exactly this bake, whole.
fn up_to_date(out: &Path, inputs: &str, options: &Options, start: Instant) -> Option<Outcome> {
    let dataset = Dataset::open(out).ok()?;
    if dataset.config.inputs != inputs {
        return None;
    }
    let run: Outcome = serde_json::from_slice(&std::fs::read(out.join(RUN)).ok()?).ok()?;
    if run.inputs != inputs {
        return None;
    }
    if options.check.is_some() && options.check != run.check.as_ref().map(|c| c.samples) {
        return None;
    }
    let seconds = start.elapsed().as_secs_f64();
    Some(Outcome { dataset: out.to_owned(), up_to_date: true, seconds, rays: RayCounts::default(), ..run })
}

fn facts(
    geometry: &Geometry,
    atlas: &Atlas,
    plan: &Plan,
    stored: &Stored,
    traced: &Traced,
    layers: LayerCount,
) -> Vec<String> {
    let page = f64::from(atlas.width) * f64::from(atlas.page_height) * f64::from(atlas.pages);
    let extras = plan.moments.iter().filter(|m| m.extra).count();
    let lit = geometry.instances.iter().filter(|i| i.lightmap).count();
    let mut facts = vec![
        format!(
            "{} triangles in {} meshes, {lit} of them lightmapped; {} materials, {} textures",
            geometry.triangles.len(),
            geometry.instances.len(),
            geometry.materials.len(),
            geometry.textures.len()
        ),
        format!(
            "{} {} × {} texels, {} charts, {:.1} texels per metre; charts touch {:.1} % of the texels, {:.1} % are valid",
            if atlas.pages == 1 { "page".to_owned() } else { format!("{} pages of", atlas.pages) },
            atlas.width,
            atlas.page_height,
            atlas.charts,
            atlas.texels_per_metre,
            atlas.utilisation * 100.0,
            stored.valid_texels as f64 / page * 100.0
        ),
        format!("{} texels marked invalid: they lie inside solids", stored.buried_texels),
        format!("{} texels marked invalid: no light reaches them at any moment", stored.unlit_texels),
        format!("{extras} sets besides the hours asked for, to show both sides of every light switch"),
    ];
    if !atlas.layouts.is_empty() {
        let sharing = atlas.placements.iter().flatten().filter(|p| p.layout.is_some()).count();
        facts.push(format!("{sharing} instances share {} chart layouts", atlas.layouts.len()));
    }
    facts.extend(atlas.notes.iter().cloned());
    if atlas.degenerate > 0 {
        facts.push(format!("{} triangles without area got no texels", atlas.degenerate));
    }
    if let Some((edges, before, after)) = &stored.seams {
        facts.push(format!(
            "{edges} edges where charts of one surface meet: mean jump {:.2} % of the light there, {:.2} % after stitching (in the \
             brightest set)",
            before.mean * 100.0,
            after.mean * 100.0
        ));
    }
    facts.push(format!(
        "{} layers of light traced, {} kept from an earlier bake",
        layers.traced, layers.reused
    ));
    facts.extend(traced.notes.iter().cloned());
    if traced.out_of_time {
        facts.push(
            "the time limit ended the tracing: other machines, or other days, give other samples".to_owned(),
        );
    }
    if traced.resumed > 0 {
        facts.push(format!("continued an earlier run that had finished {} rounds", traced.resumed));
    }
    facts
}
