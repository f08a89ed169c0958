//! A bake from end to end.

use super::assemble::{Assembler, BakedParts, Stored};
use super::block::Worker;
use super::charts::Charts;
use super::check::{Check, Chosen, check, choose};
use super::denoise::Denoiser;
use super::disk_space::DiskSpace;
use super::endless;
use super::errors::median;
use super::existing::{self, ERRORS, RUN};
use super::facts;
use super::folder;
use super::forecast::{extent, scale};
use super::json;
use super::kept;
use super::layers::{Layers, Texel};
use super::layout_estimate::LayoutEstimate;
use super::local::Places;
use super::rounds::{Traced, certain};
use super::state::Kinds;
use super::target;
use super::tracer::{Judge, Tracer, Way};
use super::valid::ValidTexels;
use super::views;
use super::visibility::Finder;
use super::work::WorkFolder;
use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use crate::light::curves;
use crate::scene::{Baked, Scene};
use crate::surface::FaceBins;
use crate::trace::counts::RayCounts;
use crate::trace::path::Transport;
use crate::{Error, Result};
use dataset::config::{
    Config, Daylight, FORMAT, FileRef, Group, Instance, Layer, Light, SunVisibility, VERSION,
};
use dataset::console::count;
use dataset::curve::Curve;
use dataset::files::{remove_stale_temporaries, sync_folder_of, write_atomically};
use dataset::observe::Observer;
use dataset::store::Writer;
use dataset::tiles::TILE;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub use super::options::{Denoise, Denoised, Integrator, LayerCount, LocalErrors, Options, Outcome, Preset};
pub use super::prepare::{Prepared, prepare};

/// Bakes a scene into a dataset.
///
/// # Errors
/// Bad input, a full disk, or [`Error::Interrupted`]; finished blocks are kept and the next call continues
/// with them.
pub fn bake(scene_file: &Path, options: &Options, console: &dyn Observer) -> Result<Outcome> {
    let start = Instant::now();
    let prepared = prepare(scene_file, options, console)?;
    let Prepared { scene, geometry, plan, limits, digests, .. } = &prepared;
    let out = prepared.out(options);
    let (settings, inputs) = prepared.manifest(options)?;
    let layers = Layers::new(&out);
    if let Some(outcome) = existing::up_to_date(&out, &inputs, options, start) {
        // (Of a run that was killed while it wrote its report.)
        remove_stale_temporaries(&out)?;
        sync_folder_of(&out.join(RUN));
        existing::keep_cameras(&out, &settings)?;
        return Ok(outcome);
    }
    existing::refuse_foreign(&out, scene.objects.iter().map(|object| object.file.as_path()))?;
    folder::create(&out)?;
    let _lock = folder::lock(&out)?;
    existing::refuse_less(&out, &prepared, options, console)?;
    console.say(format!(
        "{}: {}, {}, {}",
        scene.name,
        count(geometry.triangles.len(), "triangle"),
        count(plan.times.len(), "frame"),
        count(plan.layers(), "layer")
    ));

    let charts = if options.force { Charts::none() } else { Charts::beside(&out) };
    let (atlas, looking) = {
        let progress = console.progress("unwrapping", 1);
        let atlas = prepared.atlas_from(&charts).inspect_err(|_| folder::leave(&out))?;
        progress.advance(1);
        atlas
    };
    console.say(format!("  {}", scale(extent(&geometry.positions), atlas.texels_per_metre)));
    facts::unwrapped(charts.counts()).into_iter().for_each(|what| console.say(format!("  {what}")));
    facts::skipped(&atlas).into_iter().for_each(|what| console.say(format!("  {what}")));
    if !scene.cameras.is_empty() {
        let rays = prepared.rays()?;
        let views = views::views(&scene.cameras, geometry, &atlas, TILE, &rays);
        let what = views::in_words(&views, views::lit_tiles(&atlas, TILE));
        what.into_iter().for_each(|what| console.say(format!("  {what}")));
    }
    atlas.warnings.iter().for_each(|w| console.warn(w));
    let layout = LayoutEstimate::exact(atlas, looking);
    let disk = DiskSpace::left(&prepared, &layout, &out, options);
    let atlas = layout.atlas;
    disk.expect_space(&out, (options.free_bytes)(&out)).inspect_err(|_| folder::leave(&out))?;
    folder::begin(&out)?;
    let mut writer = Writer::create(&out)?;
    if options.force {
        WorkFolder::clear(&out)?;
        layers.clear()?;
    }
    layers.settle()?;
    // (Nothing but time is lost where charts cannot be kept.)
    if layers.create().is_ok() {
        charts.keep(&out);
    }
    let (places, looks) = with_worker(&prepared, &atlas, &[], |worker| Places::find(&worker, console))?;
    let run =
        Run { prepared: &prepared, atlas: &atlas, places: &places, out: &out, layers: &layers, console };
    let mut denoiser = prepared.denoise.map(Denoiser::new);
    let (traced, origin, dropped) = run.provide_layers(&mut denoiser)?;
    let base = prepared.base();
    let Some(texels) = layers.texels(&base) else {
        return Err(Error::invalid(
            out.display(),
            "the layers just traced cannot be read: was the folder changed?",
        ));
    };

    let padding = scene.lightmap.padding;
    let assembler = Assembler::new(plan, geometry, &atlas, (&layers, digests), texels, &places, padding)?;
    let filtered = match &mut denoiser {
        Some(denoiser) => with_worker(&prepared, &atlas, &[], |worker| {
            let texels = assembler.texels();
            let valid: Vec<bool> = (0..texels.len()).map(|place| assembler.is_valid(place)).collect();
            denoiser.denoise(&worker, &layers, digests, (texels, &valid), console)
        })?,
        None => vec![None; digests.len()],
    };
    let assembler = assembler.with_filtered(filtered.clone());
    let check = options.check.map(|samples| {
        let chosen = choose(assembler.valid_texels(), scene.bake.seed);
        check_layers(&prepared, &atlas, &assembler, &chosen, samples, console)
    });
    let check = check.transpose()?;
    let progress = console.progress("writing", (plan.groups.len() + plan.times.len()) as u64);
    let baked = BakedParts {
        sun: if scene.sun.is_some() { scene.sun_baked } else { Baked::None },
        sky: if scene.sky.is_some() { scene.sky_baked } else { Baked::None },
        groups: scene.groups.iter().map(|group| group.baked).collect(),
    };
    let mut stored = assembler.store(&mut writer, &baked, || progress.advance(1))?;
    drop(progress);
    if stored.frames.len() > 1 {
        add_curves(scene, &mut stored.daylight, &mut writer)?;
    }
    let sun = sunlight(&prepared, &atlas, &layers, &base, &mut writer, console)?;
    let written = super::scene_glb::to_glb(geometry, &atlas)?;
    let glb = writer.add("scene", "glb", &written.glb)?;
    writer.alias(&glb, super::scene_glb::NAME);
    let mut facts = facts::of_bake(geometry, &atlas, plan, &stored, &traced, origin);
    facts.extend(sun.fact());
    let mut warnings = [prepared.warnings.clone(), atlas.warnings.clone(), dropped].concat();
    for warning in
        facts::mostly_invalid(plan, &stored).into_iter().chain(facts::lightless(scene, plan, &stored))
    {
        console.warn(&warning);
        warnings.push(warning);
    }
    let valid_texels = stored.valid_texels;
    let local = LocalErrors {
        all: stored.local.0,
        frames: stored.local.1.clone(),
        worst_frame: stored.worst.as_ref().map(|worst| worst.frame),
        advice: facts::advice(
            scene,
            plan,
            &stored,
            traced.samples().unwrap_or(limits.samples),
            prepared.denoise.is_some() || prepared.transfer.is_some(),
        ),
    };
    write_atomically(
        &out.join(ERRORS),
        &places.grid().picture(stored.worst.as_ref().map(|w| &w.errors[..])),
    )?;
    let mut relative = stored.errors.relative(plan.layers() > 0);
    relative.sort_by(f64::total_cmp);
    let last = traced.rounds.last();
    let mut config = manifest(&prepared, written.places, &traced, stored, glb, &inputs, settings);
    (config.sun_path, config.visibility) = (sun.path, sun.visibility);
    writer.commit(&config)?;
    let discarded = layers.keep_only(&base, digests, &filtered, sun.kept.as_deref());
    if discarded > 0 {
        console.say(format!("discarding layers that this bake does not use: {}", count(discarded, "layer")));
    }

    folder::end(&out);

    let outcome = Outcome {
        scene: scene.name.clone(),
        dataset: out.clone(),
        scene_file: existing::scene_file_from(&out, &prepared),
        inputs,
        up_to_date: false,
        integrator: if traced.is_unsettled { Integrator::Path } else { prepared.integrator },
        size: [atlas.width, atlas.page_height],
        pages: atlas.pages,
        frames: plan.times.len(),
        hours: plan.times.iter().map(|m| m.hour).collect(),
        texels: valid_texels,
        samples: traced.samples().unwrap_or(limits.samples),
        mean_samples: last.map_or(f64::from(limits.samples), |r| r.mean_samples),
        layers: origin,
        relative_error: median(&relative),
        local,
        denoised: denoiser.as_ref().and_then(|denoiser| denoiser.outcome(&filtered)),
        out_of_time: traced.out_of_time,
        seconds: start.elapsed().as_secs_f64(),
        rays: sun.rays
            + denoiser.as_ref().map_or(RayCounts::default(), |denoiser| denoiser.rays)
            + if origin.traced > 0 { traced.rays + looking + looks } else { traced.rays },
        facts,
        rounds: traced.rounds,
        check,
        skipped: prepared.plan.skipped,
        warnings,
    };
    write_atomically(&out.join(RUN), &json::bytes(&outcome, RUN)?)?;
    Ok(outcome)
}

/// Writes how light of sun and sky goes between frames, and names it in their layers. (The sun's direct light
/// goes by its visibility.)
fn add_curves(scene: &Scene, daylight: &mut [Layer], writer: &mut Writer) -> Result<()> {
    let place = scene.place.as_ref();
    for layer in daylight.iter_mut().filter(|layer| !layer.is_direct_sun()) {
        let curve = match layer.light {
            Light::Sun => scene.sun.as_ref().and_then(|sun| curves::of_reflected_sun(sun, place)),
            _ => scene.sky.as_ref().and_then(|sky| curves::of_sky(sky, place)),
        };
        let add =
            |curve: Curve| writer.add(&format!("curve-{}", layer.light.name()), "json", &curve.to_json());
        layer.curve = curve.map(add).transpose()?;
    }
    Ok(())
}

/// The manifest of what was stored.
fn manifest(
    prepared: &Prepared,
    places: Vec<Instance>,
    traced: &Traced,
    stored: Stored,
    geometry_file: FileRef,
    inputs: &str,
    settings: serde_json::Value,
) -> Config {
    let Prepared { scene, .. } = prepared;
    // A group that is left to the game switches nothing here.
    let is_baked = |group: usize| scene.groups[group].baked != Baked::None;
    let mut frames = stored.frames;
    for frame in &mut frames {
        let groups_on = frame.groups_on.iter().enumerate().filter(|(group, _)| is_baked(*group));
        frame.groups_on = groups_on.map(|(_, on)| *on).collect();
    }
    let mut layers = stored.daylight;
    let mut groups = Vec::new();
    for (group, shares) in scene.groups.iter().zip(stored.groups).filter(|(of, _)| of.baked != Baked::None) {
        let index = Some(groups.len() as u32);
        let layer =
            |(part, row)| Layer { light: Light::Group, group: index, part, files: vec![row], curve: None };
        layers.extend(shares.into_iter().map(layer));
        groups.push(Group { name: group.name.clone(), on: group.on.clone(), baked: group.baked.into() });
    }
    let daylight = |is_there: bool, baked: Baked| is_there.then(|| Daylight { baked: baked.into() });
    Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        scene: scene.name.clone(),
        generator: concat!("bake ", env!("CARGO_PKG_VERSION")).to_owned(),
        unit: "irradiance in kilolux, linear Rec. 709".to_owned(),
        seed: scene.bake.seed,
        inputs: inputs.to_owned(),
        samples: traced.samples().unwrap_or(prepared.limits.samples),
        pages: stored.pages,
        sun: daylight(scene.sun.is_some(), scene.sun_baked),
        sky: daylight(scene.sky.is_some(), scene.sky_baked),
        groups,
        layers,
        frames,
        noise: Some(stored.noise),
        geometry: Some(geometry_file),
        instances: places,
        settings,
        sun_path: None,
        visibility: None,
        source: None,
        transfer: prepared.transfer.clone(),
    }
}

/// What was written of the sun apart from its lightmaps.
#[derive(Default)]
struct Sunlight {
    path: Option<FileRef>,
    visibility: Option<SunVisibility>,
    /// Times that its visibility has.
    times: usize,
    /// The folder of what was found of its visibility, for the next bake.
    kept: Option<PathBuf>,
    /// Those of the visibility.
    rays: RayCounts,
}

impl Sunlight {
    /// In words, what the visibility took.
    fn fact(&self) -> Option<String> {
        let visibility = self.visibility.as_ref()?;
        let bytes: u64 = visibility.references().map(|file| file.bytes).sum();
        let rays = match self.rays.visibility {
            0 => "no rays: kept from an earlier bake".to_owned(),
            rays => format!("{:.1} million rays", rays as f64 / 1e6),
        };
        Some(format!(
            "the sun's visibility: {}, to {} min where it changes, {:.2} MB with normals, {rays}",
            count(self.times, "time"),
            visibility.minutes,
            bytes as f64 / 1e6
        ))
    }
}

/// Writes the sun's path and finds its visibility, as far as they are asked for. `base`: the digest of the
/// texels.
fn sunlight(
    prepared: &Prepared,
    atlas: &Atlas,
    layers: &Layers,
    base: &str,
    writer: &mut Writer,
    console: &dyn Observer,
) -> Result<Sunlight> {
    let mut sunlight = Sunlight::default();
    if let Some(path) = prepared.sun_path() {
        sunlight.path = Some(writer.add("sun", "json", &path.to_json())?);
    }
    let Some(course) = &prepared.course else { return Ok(sunlight) };
    let texels = layers.texels(base).ok_or_else(|| {
        Error::invalid(layers.root().display(), "the texels cannot be read: was the folder changed?")
    })?;
    with_worker(prepared, atlas, &[], |worker| {
        let finder = Finder::new(prepared, &worker, layers, &texels, course)?;
        let (mut files, mut normals) = (Vec::new(), Vec::new());
        sunlight.rays = finder.pages(console, |number, page| {
            files.push(writer.add(&format!("visibility-{number}"), "vis", &page.visibility)?);
            normals.push(writer.add(&format!("normals-{number}"), "png", &page.normals.to_png())?);
            Ok(())
        })?;
        sunlight.visibility = Some(SunVisibility { minutes: course.minutes, files, normals });
        sunlight.times = course.hours.len();
        sunlight.kept = Some(finder.folder().to_owned());
        Ok(sunlight)
    })
}

/// A run, and where it works.
struct Run<'a> {
    prepared: &'a Prepared,
    atlas: &'a Atlas,
    places: &'a Places,
    out: &'a Path,
    layers: &'a Layers,
    console: &'a dyn Observer,
}

impl Run<'_> {
    /// Traces the layers that no earlier bake left, and keeps them; towards a target also those that were
    /// left, where they miss it by this light. Warnings, too.
    fn provide_layers(&self, denoiser: &mut Option<Denoiser>) -> Result<(Traced, LayerCount, Vec<String>)> {
        let Run { prepared, layers, console, .. } = *self;
        let Prepared { plan, digests, .. } = prepared;
        let base = prepared.base();
        let missing = kept::missing(plan, layers, &base, digests);
        if missing.len() < digests.len() {
            let names: Vec<String> = missing.iter().map(|&l| plan.name_of(l)).collect();
            let kept = count(digests.len() - missing.len(), "layer");
            console.say(match &names[..] {
                [] => format!("no rays: kept from an earlier bake: {kept}"),
                names => format!("kept from an earlier bake: {kept}; tracing {}", names.join(", ")),
            });
        }
        let damaged = missing.iter().filter(|&&l| layers.holds(&digests[l])).count();
        let (mut traced, mut warnings) = self.trace(&missing, denoiser)?;
        if damaged > 0 {
            let what = format!(
                "{} kept here from an earlier bake were damaged: traced again",
                count(damaged, "layer")
            );
            console.warn(&what);
            warnings.push(what);
        }
        let mut origin = LayerCount { traced: missing.len(), reused: digests.len() - missing.len() };
        if let (Some(target), Some(texels), 1.., true) =
            (prepared.limits.target_error, layers.texels(&base), origin.reused, kept::is_met(&traced))
        {
            let all: Vec<usize> = (0..digests.len()).collect();
            let again = with_worker(prepared, self.atlas, &[], |worker| {
                kept::missing_target(plan, &self.light(&worker, layers, &all, &texels, denoiser)?, target)
            })?;
            if !again.is_empty() {
                let names: Vec<String> = again.iter().map(|&l| plan.name_of(l)).collect();
                console.say(format!(
                    "these kept layers miss the target with the new light and are traced again: {}",
                    names.join(", ")
                ));
                layers.forget(again.iter().map(|&l| &digests[l]))?;
                let (new, more) = self.trace(&again, denoiser)?;
                let rays = traced.rays + new.rays;
                traced = Traced { rays, ..new };
                warnings.extend(more);
                origin.traced = missing.iter().chain(&again).collect::<BTreeSet<_>>().len();
                origin.reused = digests.len() - origin.traced;
            }
        }
        Ok((traced, origin, warnings))
    }

    /// The light of some layers (ascending) that `folder` holds, denoised where that is asked for.
    fn light<'l>(
        &'l self,
        worker: &Worker,
        folder: &'l Layers,
        chosen: &[usize],
        texels: &'l [Texel],
        denoiser: &mut Option<Denoiser>,
    ) -> Result<target::Light<'l>> {
        let Prepared { plan, digests, .. } = self.prepared;
        let owners = Owners::new(self.atlas);
        let parts = chosen.iter().map(|&layer| (&digests[layer], plan.parts_of(layer)));
        let valid = ValidTexels::find(self.atlas, &owners, texels, folder, parts)?.by_place(texels);
        let of_chosen: Vec<String> = chosen.iter().map(|&layer| digests[layer].clone()).collect();
        let filtered = match denoiser {
            Some(denoiser) => denoiser.denoise(worker, folder, &of_chosen, (texels, &valid), self.console)?,
            None => vec![None; chosen.len()],
        };
        let held = chosen.iter().zip(filtered);
        let layers =
            held.map(|(&layer, filtered)| (&digests[layer], plan.held_parts_of(layer), filtered)).collect();
        let (frames, width) = (self.prepared.frames(chosen), self.atlas.width as usize);
        Ok(target::Light { folder, layers, frames, texels, valid, places: self.places, width })
    }

    /// Traces some layers (ascending) and keeps them; if there are none to trace, gives the account of those
    /// that are kept. Warnings, too.
    fn trace(&self, chosen: &[usize], denoiser: &mut Option<Denoiser>) -> Result<(Traced, Vec<String>)> {
        let Run { prepared, atlas, places, out, layers, console } = *self;
        let Prepared { plan, digests, .. } = prepared;
        let base = prepared.base();
        let work = prepared.work(chosen);
        WorkFolder::remove_finished(out, &work, |digest| layers.holds(digest));
        if chosen.is_empty() && layers.texels(&base).is_some() {
            return Ok((layers.traced(&base).unwrap_or_default(), Vec::new()));
        }
        let wanted: Vec<String> = chosen.iter().map(|&l| digests[l].clone()).collect();
        let mut warnings = Vec::new();
        if existing::refuse_unfinished(out, &work, layers)? {
            let dropped = "discarding the unfinished work of a bake with other settings (its command would have continued it)";
            console.warn(dropped);
            warnings.push(dropped.to_owned());
        }
        let traced = with_worker(prepared, atlas, chosen, |worker| {
            if let Some(slow) = endless::refuse(&worker.transport, atlas, worker.seed)? {
                console.warn(&slow);
                warnings.push(slow);
            }
            let folder = WorkFolder::open(out, &work, &wanted, Kinds::of(worker.transport.lights))?;
            let cached = prepared.integrator == Integrator::Cached;
            let frames = prepared.frames(chosen);
            let tracer = Tracer { worker, frames, places, folder: &folder, cached, layers: plan.layers() };
            let (provisional, mut more) = (layers.provisional(), RayCounts::default());
            let mut judge = |tracer: &Tracer, way: &Way, target: f64| {
                provisional.clear()?;
                more += provisional.write(tracer, way, &base, &wanted, &Traced::default(), console)?;
                let texels = provisional.texels(&base).ok_or_else(|| folder.changed())?;
                self.light(&tracer.worker, &provisional, chosen, &texels, denoiser)?.judge(target)
            };
            let judge: Option<Judge> = prepared.denoise.is_some().then_some(&mut judge);
            let (mut traced, way) = tracer.run(&prepared.limits, judge, console)?;
            if let Some(kept) = layers.traced(&base).filter(|_| chosen.len() < digests.len()) {
                traced.keep(&kept);
            }
            traced.rays += more + layers.write(&tracer, &way, &base, &wanted, &traced, console)?;
            layers.adopt(&provisional);
            folder.remove();
            Ok(traced)
        })?;
        Ok((traced, warnings))
    }
}

/// Checks all layers at these texels, however they came to be.
fn check_layers(
    prepared: &Prepared,
    atlas: &Atlas,
    assembler: &Assembler,
    chosen: &[Chosen],
    samples: u32,
    console: &dyn Observer,
) -> Result<Check> {
    let all: Vec<usize> = (0..prepared.plan.layers()).collect();
    // Of every layer these texels alone: all of all layers may be more than memory holds.
    let places: Vec<usize> = chosen.iter().map(|texel| texel.place).collect();
    let held = |&layer: &usize| assembler.held_at(layer, &places);
    let values = all.iter().map(held).collect::<Result<Vec<_>>>()?;
    with_worker(prepared, atlas, &all, |worker| {
        check(&worker, chosen, &values, &prepared.frames(&all), samples, console)
    })
}

/// Works with the light of some layers (ascending).
pub fn with_worker<T>(
    prepared: &Prepared,
    atlas: &Atlas,
    layers: &[usize],
    work: impl FnOnce(Worker) -> Result<T>,
) -> Result<T> {
    let Prepared { scene, geometry, plan, .. } = prepared;
    let lights = plan.lights(scene, geometry, layers);
    let bins = FaceBins::new(atlas);
    let rays = prepared.rays()?;
    let transport = Transport::new(prepared.space(&rays), &lights, scene.bake.bounces);
    work(Worker { transport, atlas, bins: &bins, seed: scene.bake.seed, certain: certain(&prepared.limits) })
}
