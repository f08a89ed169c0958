//! A bake from end to end.

use super::assemble::{Assembler, Stored};
use super::block::Worker;
use super::check::{Check, check};
use super::json;
use super::layers::{Layers, Texel};
use super::plan::Plan;
use super::rounds::{Traced, Tracer};
use super::state::StateFolder;
use crate::atlas::{self, Atlas, Placement};
use crate::geometry::{Geometry, Solids};
use crate::surface::FaceBins;
use crate::trace::counts::RayCounts;
use crate::trace::rays::Rays;
use crate::trace::space::Space;
use crate::trace::walk::Transport;
use crate::{Error, Result};
use dataset::config::{Config, FORMAT, FileRef, Group, Instance, VERSION};
use dataset::console::{Console, count};
use dataset::files::write_atomically;
use dataset::store::{Dataset, Writer};
use std::path::Path;
use std::time::Instant;

pub use super::options::{Integrator, LayerCount, Options, Outcome};
pub use super::prepare::{Prepared, prepare};

/// Bakes a scene into a dataset.
///
/// # Errors
/// Bad input, a full disk, or [`Error::Interrupted`]; finished blocks are kept and the next call continues with them.
pub fn bake(scene_file: &Path, options: &Options, console: &Console) -> Result<Outcome> {
    let start = Instant::now();
    let prepared = prepare(scene_file, options, console)?;
    let Prepared { scene, geometry, plan, limits, digests, .. } = &prepared;
    let out = options.out.clone().unwrap_or_else(|| Path::new("dataset").join(&scene.name));
    let (settings, inputs) = prepared.manifest(options)?;
    let layers = Layers::new(&out);
    if let Some(outcome) = up_to_date(&out, &inputs, options, start) {
        return Ok(outcome);
    }
    expect_folder(&out)?;
    let _lock = lock(&out)?;
    console.say(format!(
        "{}: {}, {}, {}",
        scene.name,
        count(geometry.triangles.len(), "triangle"),
        count(plan.moments.len(), "set"),
        count(plan.layers(), "layer")
    ));

    let atlas = {
        let progress = console.progress("unwrapping", 1);
        let atlas = atlas::build(geometry, &scene.lightmap)?;
        progress.advance(1);
        atlas
    };
    if options.force {
        StateFolder::clear(&out)?;
        layers.clear()?;
    }
    let mut writer = Writer::create(&out)?;
    let (traced, origin) = trace_missing(&prepared, &atlas, &out, &layers, console)?;
    let base = prepared.base();
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
    let facts = facts(geometry, &atlas, plan, &stored, &traced, origin);
    let mut warnings = prepared.warnings.clone();
    if let Some(warning) = mostly_invalid(plan, &stored) {
        console.warn(&warning);
        warnings.push(warning);
    }
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
    let forgotten = layers.keep_only(&base, digests);
    if forgotten > 0 {
        console.say(format!("no longer kept, as this bake does not use them: {}", count(forgotten, "layer")));
    }

    let outcome = Outcome {
        scene: scene.name.clone(),
        dataset: out.clone(),
        inputs,
        up_to_date: false,
        integrator: if traced.is_unsettled { Integrator::Path } else { prepared.integrator },
        size: [atlas.width, atlas.page_height],
        pages: atlas.pages,
        sets: plan.moments.len(),
        hours: plan.moments.iter().map(|m| m.hour).collect(),
        texels,
        samples: last.map_or(limits.samples, |r| r.samples),
        mean_samples: last.map_or(f64::from(limits.samples), |r| r.mean_samples),
        layers: origin,
        relative_error: relative.get(relative.len() / 2).copied().unwrap_or(0.0),
        out_of_time: traced.out_of_time,
        seconds: start.elapsed().as_secs_f64(),
        rays: traced.rays,
        facts,
        rounds: traced.rounds,
        check,
        left_out: prepared.plan.left_out,
        warnings,
    };
    write_atomically(&out.join(RUN), &json::bytes(&outcome, RUN)?)?;
    StateFolder::clear(&out)?;
    Ok(outcome)
}

/// What may be wrong with a scene most of whose texels are of no use.
fn mostly_invalid(plan: &Plan, stored: &Stored) -> Option<String> {
    let of = |texels: usize| {
        100.0 * texels as f64 / (stored.valid_texels + stored.unlit_texels + stored.buried_texels) as f64
    };
    if plan.layers() == 0 {
        Some(
            "no light: neither sun nor sky nor a lamp shines at any of these moments; all sets are black"
                .to_owned(),
        )
    } else if of(stored.unlit_texels) > 50.0 {
        Some(format!(
            "no light arrives at {:.0} % of the texels: do their front sides (counter-clockwise) face away from it? `two_sided` or \
             turned faces may help",
            of(stored.unlit_texels)
        ))
    } else if of(stored.buried_texels) > 50.0 {
        Some(format!(
            "{:.0} % of the texels lie inside solids: all around them are the backs of one-sided faces. Are faces turned inside out?",
            of(stored.buried_texels)
        ))
    } else {
        None
    }
}

/// Creates the dataset's folder, or tells what is in the way, before hours of tracing rather than after.
fn expect_folder(out: &Path) -> Result<()> {
    const EXPECTED: &str = "expected a folder for the dataset, or a free name for one (--out)";
    if let Some(file) = out.ancestors().find(|path| path.exists()).filter(|path| !path.is_dir()) {
        return Err(Error::invalid(out.display(), format!("{} is no folder; {EXPECTED}", file.display())));
    }
    let refused = |what: &str, error: std::io::Error| {
        Error::invalid(out.display(), format!("{what} ({error}); {EXPECTED} that this user may write to"))
    };
    std::fs::create_dir_all(out).map_err(|e| refused("cannot be created", e))?;
    let probe = out.join(format!(".probe-{}", std::process::id()));
    let probed = std::fs::File::create(&probe).and_then(|_| std::fs::remove_file(&probe));
    probed.map_err(|e| refused("cannot be written to", e))
}

/// Keeps other bakes out of the dataset's folder until it is dropped (or the process ends).
fn lock(out: &Path) -> Result<std::fs::File> {
    let path = out.join(".lock");
    let file = std::fs::File::create(&path).map_err(Error::io(&path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => Err(Error::invalid(
            out.display(),
            "another bake is writing here; wait for it, or choose another --out",
        )),
        Err(std::fs::TryLockError::Error(e)) => Err(Error::io(&path)(e)),
    }
}

/// Traces the layers that no earlier bake left, and keeps them.
fn trace_missing(
    prepared: &Prepared,
    atlas: &Atlas,
    out: &Path,
    layers: &Layers,
    console: &Console,
) -> Result<(Traced, LayerCount)> {
    let Prepared { plan, digests, .. } = prepared;
    let base = prepared.base();
    let texels = layers.texels(&base);
    let is_missing = |digest: &String| texels.as_ref().is_none_or(|t| !layers.has(digest, t.len()));
    let missing: Vec<usize> = (0..digests.len()).filter(|&l| is_missing(&digests[l])).collect();
    let origin = LayerCount { traced: missing.len(), reused: digests.len() - missing.len() };
    if missing.is_empty() && texels.is_some() {
        console.say(format!("no rays: kept from an earlier bake: {}", count(digests.len(), "layer")));
        return Ok((layers.traced(&base).unwrap_or_default(), origin));
    }
    if origin.reused > 0 {
        let names: Vec<String> = missing.iter().map(|&l| plan.name_of(l)).collect();
        console.say(format!(
            "kept from an earlier bake: {}; tracing {}",
            count(origin.reused, "layer"),
            names.join(", ")
        ));
    }
    let wanted: Vec<String> = missing.iter().map(|&l| digests[l].clone()).collect();
    let work = blake3::hash(format!("{base}{}", wanted.concat()).as_bytes()).to_hex().to_string();
    let traced = with_worker(prepared, atlas, &missing, |worker| {
        let lights = worker.transport.lights;
        let folder = StateFolder::open(out, &work, lights.layers(), lights.sampled())?;
        let cached = prepared.integrator == Integrator::Cached;
        let sets = prepared.sets(&missing);
        let tracer = Tracer { worker, sets, folder: &folder, cached, layers: plan.layers() };
        let traced = tracer.run(&prepared.limits, console)?;
        layers.write(&tracer.worker, &folder, &base, &wanted, &traced, console)?;
        Ok(traced)
    })?;
    Ok((traced, origin))
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
    let all: Vec<usize> = (0..prepared.plan.layers()).collect();
    let values = prepared.digests.iter().map(|d| layers.read(d)).collect::<Result<Vec<_>>>()?;
    with_worker(prepared, atlas, &all, |worker| {
        check(&worker, texels, &values, &prepared.sets(&all), samples, console)
    })
}

/// Works with the light of some layers (ascending).
fn with_worker<T>(
    prepared: &Prepared,
    atlas: &Atlas,
    layers: &[usize],
    work: impl FnOnce(Worker) -> Result<T>,
) -> Result<T> {
    let Prepared { scene, geometry, plan, .. } = prepared;
    let lights = plan.lights(scene, geometry, layers);
    let bins = FaceBins::new(atlas);
    let rays = Rays::with_backend(geometry, prepared.backend)?;
    let space = Space::new(geometry, &rays).with_solids(Solids::new(geometry));
    let transport = Transport::new(space, &lights, scene.bake.bounces);
    work(Worker { transport, atlas, bins: &bins, seed: scene.bake.seed })
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

/// The outcome of the earlier run, if `out` holds exactly this bake, whole.
fn up_to_date(out: &Path, inputs: &str, options: &Options, start: Instant) -> Option<Outcome> {
    let dataset = Dataset::open(out).ok().filter(|_| !options.force)?;
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
            "{} in {} ({lit} lightmapped); {}, {}",
            count(geometry.triangles.len(), "triangle"),
            if geometry.instances.len() == 1 {
                "1 mesh".to_owned()
            } else {
                format!("{} meshes", geometry.instances.len())
            },
            count(geometry.materials.len(), "material"),
            count(geometry.textures.len(), "texture")
        ),
        format!(
            "{} {} × {} texels, {}, {:.1} texels per metre; charts touch {:.1} % of the texels, {:.1} % are valid",
            if atlas.pages == 1 { "page".to_owned() } else { format!("{} pages of", atlas.pages) },
            atlas.width,
            atlas.page_height,
            count(atlas.charts as usize, "chart"),
            atlas.texels_per_metre,
            atlas.utilisation * 100.0,
            stored.valid_texels as f64 / page * 100.0
        ),
        format!("{} marked invalid for lying inside solids", count(stored.buried_texels, "texel")),
        format!(
            "{} marked invalid because no sample found light at any moment",
            count(stored.unlit_texels, "texel")
        ),
        format!(
            "{} besides the hours asked for, to show both sides of every light switch",
            count(extras, "set")
        ),
    ];
    if !atlas.layouts.is_empty() {
        let sharing = atlas.placements.iter().flatten().filter(|p| p.layout.is_some()).count();
        facts.push(format!("{sharing} instances share {}", count(atlas.layouts.len(), "chart layout")));
    }
    facts.extend(atlas.notes.iter().cloned());
    if atlas.degenerate > 0 {
        facts.push(format!("{} without area got no texels", count(atlas.degenerate, "triangle")));
    }
    if let Some((edges, before, after)) = &stored.seams {
        facts.push(format!(
            "{} where charts of one surface meet: mean jump {:.2} % of the light there, {:.2} % after stitching (in the \
             brightest set)",
            count(*edges, "edge"),
            before.mean * 100.0,
            after.mean * 100.0
        ));
    }
    facts.push(format!(
        "{} of light traced, {} kept from an earlier bake",
        count(layers.traced, "layer"),
        layers.reused
    ));
    facts.extend(traced.notes.iter().cloned());
    if traced.out_of_time {
        facts.push(
            "the time limit ended the tracing: other machines, or other days, give other samples".to_owned(),
        );
    }
    if traced.resumed > 0 {
        facts.push(format!("continued an earlier run that had finished {}", count(traced.resumed, "round")));
    }
    facts
}
