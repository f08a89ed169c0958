//! A bake from end to end.

use super::assemble::{Assembler, Stored};
use super::json;
use super::plan::Plan;
use super::rounds::{Round, Tracer};
use super::state::StateFolder;
use crate::atlas::{self, Atlas};
use crate::geometry::{self, Geometry};
use crate::light::schedule::Hours;
use crate::scene::{LightmapSize, MAX_SAMPLES, Scene};
use crate::surface::FaceBins;
use crate::trace::rays::Rays;
use crate::trace::walk::{RayCounts, Transport};
use crate::{Error, Result};
use dataset::config::{Config, FORMAT, FileRef, Group, Instance, Page, VERSION};
use dataset::console::Console;
use dataset::files::write_atomically;
use dataset::store::{Dataset, Writer};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Changes whenever the same scene would give other texels.
const METHOD: &str = "walks-3";

/// What to bake, apart from the scene.
#[derive(Clone, Debug)]
pub struct Options {
    /// The moments.
    pub hours: Hours,
    /// Samples per texel; `None`: the scene's.
    pub samples: Option<u32>,
    /// Half the lightmap's side, a quarter of the samples.
    pub draft: bool,
    /// The dataset's folder; `None`: `dataset/<scene>` in the working folder.
    pub out: Option<PathBuf>,
    /// Forget earlier work on this dataset.
    pub force: bool,
}

/// What a bake gave.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outcome {
    /// The scene's name.
    pub scene: String,
    /// The dataset's folder.
    pub dataset: PathBuf,
    /// True when the folder held this very bake already and nothing was traced.
    pub up_to_date: bool,
    /// Width and height of the page in texels.
    pub size: [u32; 2],
    /// Sets written.
    pub sets: usize,
    /// Valid texels.
    pub texels: usize,
    /// Samples per texel.
    pub samples: u32,
    /// Median estimated relative error over (tile, set).
    pub relative_error: f64,
    /// Wall-clock seconds of this run, from scene file to dataset.
    pub seconds: f64,
    /// Rays traced by this run, by purpose.
    pub rays: RayCounts,
    /// Error against time, round by round.
    pub rounds: Vec<Round>,
    /// Facts about geometry and page, in words.
    pub facts: Vec<String>,
    /// What was left out and why.
    pub left_out: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Bakes a scene into a dataset.
///
/// # Errors
/// Bad input, a full disk, or [`Error::Interrupted`]; finished blocks are kept and the next call continues with them.
pub fn bake(scene_file: &Path, options: &Options, console: &Console) -> Result<Outcome> {
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
    let out = options.out.clone().unwrap_or_else(|| Path::new("dataset").join(&scene.name));
    let plan = Plan::new(&scene, &geometry, &options.hours);
    let settings = settings(&scene, &options.hours)?;
    let (work, inputs) = digests(&scene, &geometry, &plan, &settings)?;

    if options.force {
        StateFolder::clear(&out);
    } else if let Some(outcome) = up_to_date(&out, &inputs, start) {
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
        let atlas = atlas::build(&geometry, &scene.lightmap)?;
        progress.advance(1);
        atlas
    };
    let mut writer = Writer::create(&out)?;
    let folder = StateFolder::open(&out, &work, plan.layers())?;
    let bins = FaceBins::new(&atlas);
    let rays = Rays::new(&geometry);
    let transport = Transport {
        geometry: &geometry,
        rays: &rays,
        suns: &plan.suns,
        sky: &plan.sky,
        groups: &plan.lamps,
        layer_of_group: &plan.layer_of_group,
        bounces: scene.bake.bounces,
    };
    let seed = scene.bake.seed;
    let tracer = Tracer { transport, plan: &plan, atlas: &atlas, bins: &bins, folder: &folder, seed };
    let traced = tracer.run(scene.bake.samples, console)?;

    let assembler = Assembler::new(&plan, &atlas, &bins, &folder, scene.lightmap.padding)?;
    let progress = console.progress("writing", (plan.lamps.len() + plan.moments.len()) as u64);
    let stored = assembler.store(&mut writer, &traced.errors, || progress.advance(1))?;
    drop(progress);
    let glb = writer.add("scene", "glb", &super::scene_glb::to_glb(&geometry, &atlas)?)?;
    writer.alias(&glb, "scene.glb");
    let facts = facts(&geometry, &atlas, &plan, &stored, traced.resumed_samples);
    let texels = stored.valid_texels;
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        scene: scene.name.clone(),
        generator: concat!("bake ", env!("CARGO_PKG_VERSION")).to_owned(),
        unit: "irradiance in kilolux, linear Rec. 709".to_owned(),
        seed,
        inputs,
        samples: scene.bake.samples,
        pages: vec![Page { width: atlas.width, height: atlas.height, mask: stored.mask }],
        groups: scene.groups.iter().zip(stored.groups).map(group).collect(),
        sets: stored.sets,
        noise: Some(stored.noise),
        geometry: Some(glb),
        instances: instances(&geometry, &atlas),
        settings,
    };
    writer.commit(&config)?;

    let outcome = Outcome {
        scene: scene.name.clone(),
        dataset: out.clone(),
        up_to_date: false,
        size: [atlas.width, atlas.height],
        sets: plan.moments.len(),
        texels,
        samples: scene.bake.samples,
        relative_error: traced.rounds.last().map_or(0.0, |r| r.median_error),
        seconds: start.elapsed().as_secs_f64(),
        rays: traced.rays,
        facts,
        rounds: traced.rounds,
        left_out: plan.left_out,
        warnings,
    };
    write_atomically(&out.join(RUN), &json::bytes(&outcome, RUN)?)?;
    StateFolder::clear(&out);
    Ok(outcome)
}

/// The outcome of a run, beside the manifest.
const RUN: &str = "run.json";

fn group((group, layer): (&crate::scene::Group, FileRef)) -> Group {
    Group { name: group.name.clone(), on: group.on.clone(), layers: vec![layer] }
}

/// The places of all instances that have texels.
fn instances(geometry: &Geometry, atlas: &Atlas) -> Vec<Instance> {
    let instances = geometry.instances.iter().zip(&atlas.placements);
    let placed = instances.filter_map(|(instance, placement)| {
        placement.map(|p| Instance { name: instance.name.clone(), page: 0, scale: p.scale, offset: p.offset })
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
    if let Some(samples) = options.samples {
        if !(2..=MAX_SAMPLES).contains(&samples) || !samples.is_power_of_two() {
            let expected = format!("expected a power of two from 2 to {MAX_SAMPLES}");
            return Err(Error::invalid("--samples", format!("{samples}: {expected}")));
        }
        scene.bake.samples = samples;
    }
    Ok(())
}

/// Digest of what decides every sample, and of what decides the dataset: the number of samples and all that the manifest
/// tells besides.
fn digests(
    scene: &Scene,
    geometry: &Geometry,
    plan: &Plan,
    settings: &serde_json::Value,
) -> Result<(String, String)> {
    let mut hash = blake3::Hasher::new();
    hash.update(METHOD.as_bytes());
    let hours: Vec<f64> = plan.moments.iter().map(|m| m.hour).collect();
    let light = (
        &scene.name,
        &scene.place,
        &scene.sun,
        &scene.sky,
        &scene.groups,
        &scene.lightmap,
        scene.bake.bounces,
        scene.bake.seed,
        hours,
    );
    hash.update(&json::bytes(&light, "scene")?);
    geometry.update_digest(&mut hash);
    let work = hash.finalize().to_hex().to_string();
    hash.update(&scene.bake.samples.to_le_bytes());
    hash.update(&json::bytes(settings, "settings")?);
    geometry.instances.iter().for_each(|i| {
        hash.update(i.name.as_bytes()).update(&[0]);
    });
    Ok((work, hash.finalize().to_hex().to_string()))
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
fn up_to_date(out: &Path, inputs: &str, start: Instant) -> Option<Outcome> {
    let dataset = Dataset::open(out).ok()?;
    if dataset.config.inputs != inputs {
        return None;
    }
    let run: Outcome = serde_json::from_slice(&std::fs::read(out.join(RUN)).ok()?).ok()?;
    let seconds = start.elapsed().as_secs_f64();
    Some(Outcome { dataset: out.to_owned(), up_to_date: true, seconds, rays: RayCounts::default(), ..run })
}

fn facts(geometry: &Geometry, atlas: &Atlas, plan: &Plan, stored: &Stored, resumed: u32) -> Vec<String> {
    let page = f64::from(atlas.width) * f64::from(atlas.height);
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
            "page {} × {} texels, {} charts, {:.1} texels per metre; charts touch {:.1} % of the texels, {:.1} % are valid",
            atlas.width,
            atlas.height,
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
    if resumed > 0 {
        facts.push(format!("continued an earlier run that had reached {resumed} samples per texel"));
    }
    facts
}
