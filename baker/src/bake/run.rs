//! A bake from end to end.

use crate::Result;
use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use crate::bake::cache::endless_light;
use crate::bake::errors::{CellMap, Pieces, median};
use crate::bake::finish::{Assembled, Assembler, BakedParts, Check, VisibilityBaker, check, choose};
use crate::bake::forecast::{DiskSpace, LayoutEstimate, extent, mistakes, scale, views};
use crate::bake::layers::{Denoiser, FilteredLayer, Layers, Texel, ValidTexels, kept, target};
use crate::bake::output::{ERRORS_FILE, OutputFolder, RUN_FILE, existing, facts};
use crate::bake::rounds::{BlockHistory, JudgeTarget, Traced, Tracer, guaranteed_samples};
use crate::bake::samples::Worker;
use crate::bake::store::{Charts, SumKinds, WorkFolder, json};
use crate::light::times::curves;
use crate::receivers::SurfaceTexels;
use crate::scene::{Baked, Scene};
use crate::trace::counts::RayCounts;
use crate::trace::paths::Transport;
use dataset::format::{
    Config, Curve, Daylight, FORMAT, FileRef, Group, Instance, Layer, Light, SunVisibility, TILE, VERSION,
};
use dataset::host::files::write_atomically;
use dataset::observe::{Observer, count};
use dataset::store::Writer;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub use crate::bake::layers::Denoised;
pub use crate::bake::output::{LayerCount, LocalErrors, Outcome};
pub use crate::bake::prepare::{Denoise, Integrator, Options, Preset};
pub use crate::bake::prepare::{Prepared, prepare};

/// Bakes a scene into a dataset.
///
/// # Errors
/// Bad input, a full disk, or [`crate::Error::Interrupted`]; finished blocks are kept and the next call
/// continues with them.
pub fn bake(scene_file: &Path, options: &Options, console: &dyn Observer) -> Result<Outcome> {
    let start = Instant::now();
    let prepared = prepare(scene_file, options, console)?;
    let (settings, inputs) = prepared.manifest(options)?;
    let out = prepared.out(options);
    if let Some(outcome) = existing::up_to_date(&out, &inputs, options, start) {
        existing::refresh(&out, &settings)?;
        return Ok(outcome);
    }
    existing::refuse_foreign_folder(&out, prepared.scene.objects.iter().map(|object| object.file.as_path()))?;
    let output = OutputFolder::take(&out)?;
    existing::refuse_downgrade(&out, &prepared, options, console)?;
    let (layout, charts) = unwrap(&prepared, &output, options, console)?;
    let mut writer =
        output.begin(&DiskSpace::still_needed(&prepared, &layout, &out, options), options, charts)?;
    let (atlas, mut rays) = (layout.atlas, layout.rays);
    let (cell_map, cell_rays) =
        with_worker(&prepared, &atlas, &[], |worker| CellMap::find(&worker, console))?;
    rays += cell_rays;

    let run = Run { prepared: &prepared, atlas: &atlas, cell_map: &cell_map, output: &output, console };
    let mut denoiser = prepared.denoise.map(Denoiser::new);
    let (traced, origin, dropped) = run.trace_missing_layers(&mut denoiser)?;
    let (assembler, filtered) = run.assembler(&mut denoiser)?;
    let check = options.check.map(|samples| run.check(&assembler, samples)).transpose()?;

    let mut stored = store(&prepared, &assembler, &mut writer, console)?;
    drop(assembler);
    let sun = run.sunlight(&mut writer)?;
    let geometry = crate::bake::finish::to_glb(&prepared.geometry, &atlas)?;
    let glb = writer.add("scene", "glb", &geometry.glb)?;
    writer.alias(&glb, crate::bake::finish::GLB_FILE);
    let local = local_errors(&prepared, &stored, &traced);
    let picture = cell_map.grid().picture(stored.worst.as_ref().map(|worst| &worst.errors[..]));
    write_atomically(&out.join(ERRORS_FILE), &picture)?;
    let mut relative = stored.errors.relative(prepared.plan.layers() > 0);
    relative.sort_by(f64::total_cmp);
    let mut facts = facts::of_bake(&prepared.geometry, &atlas, &prepared.plan, &stored, &traced, origin);
    facts.extend(sun.fact());
    let mut warnings = [prepared.warnings.clone(), atlas.warnings.clone(), dropped].concat();
    let of_stored = facts::mostly_invalid(&prepared.plan, &stored);
    for warning in of_stored.into_iter().chain(facts::lightless(&prepared.scene, &prepared.plan, &stored)) {
        console.warn(&warning);
        warnings.push(warning);
    }

    let texels = stored.valid_texels;
    let mut config = manifest(&prepared, geometry.instances, &traced, &mut stored, glb, &inputs, settings);
    (config.sun_path, config.visibility) = (sun.path, sun.visibility);
    writer.commit(&config)?;
    let discarded =
        output.layers.keep_only(&prepared.base(), &prepared.digests, &filtered, sun.kept.as_deref());
    if discarded > 0 {
        console.say(format!("discarding layers that this bake does not use: {}", count(discarded, "layer")));
    }
    output.end();

    let samples = traced.samples().unwrap_or(prepared.limits.samples);
    // (Of a bake whose layers were all kept, the rays that were traced then.)
    rays = if origin.traced > 0 { traced.rays + rays } else { traced.rays };
    let outcome = Outcome {
        scene: prepared.scene.name.clone(),
        scene_file: existing::scene_file_from(&out, &prepared),
        dataset: out,
        inputs,
        up_to_date: false,
        integrator: if traced.is_unsettled { Integrator::Path } else { prepared.integrator },
        size: [atlas.width, atlas.page_height],
        pages: atlas.pages,
        frames: prepared.plan.times.len(),
        hours: prepared.plan.times.iter().map(|time| time.hour).collect(),
        texels,
        samples,
        mean_samples: traced.rounds.last().map_or(f64::from(samples), |round| round.mean_samples),
        layers: origin,
        relative_error: median(&relative),
        local,
        denoised: denoiser.as_ref().and_then(|denoiser| denoiser.outcome(&filtered)),
        out_of_time: traced.out_of_time,
        seconds: start.elapsed().as_secs_f64(),
        rays: sun.rays + denoiser.map_or(RayCounts::default(), |denoiser| denoiser.rays) + rays,
        facts,
        rounds: traced.rounds,
        check,
        skipped: prepared.plan.skipped,
        warnings,
    };
    write_atomically(&outcome.dataset.join(RUN_FILE), &json::bytes(&outcome, RUN_FILE)?)?;
    Ok(outcome)
}

/// Unwraps the geometry, or takes the charts that an earlier bake kept; says what came of it.
fn unwrap(
    prepared: &Prepared,
    output: &OutputFolder,
    options: &Options,
    console: &dyn Observer,
) -> Result<(LayoutEstimate, Charts)> {
    let Prepared { scene, geometry, plan, .. } = prepared;
    console.say(format!(
        "{}: {}, {}, {}",
        scene.name,
        count(geometry.triangles.len(), "triangle"),
        count(plan.times.len(), "frame"),
        count(plan.layers(), "layer")
    ));
    let charts = if options.force { Charts::none() } else { Charts::beside(output.root()) };
    let (mut atlas, rays) = {
        let progress = console.progress("unwrapping", 1);
        let unwrapped = prepared.atlas_from(&charts)?;
        progress.advance(1);
        unwrapped
    };
    console.say(format!("  {}", scale(extent(&geometry.positions), atlas.texels_per_metre)));
    let notes = facts::unwrapped(charts.counts()).into_iter().chain(facts::skipped(&atlas));
    notes.for_each(|note| console.say(format!("  {note}")));
    if !scene.cameras.is_empty() {
        let views = views::views(&scene.cameras, geometry, &atlas, TILE, &prepared.ray_tracer()?);
        let notes = views::in_words(&views, views::lit_tiles(&atlas, TILE));
        notes.into_iter().for_each(|note| console.say(format!("  {note}")));
    }
    atlas.warnings.extend(mistakes::warnings(prepared, atlas.texels_per_metre)?);
    atlas.warnings.iter().for_each(|warning| console.warn(warning));
    Ok((LayoutEstimate::exact(atlas, rays), charts))
}

/// Writes all images, and the curves of light between frames.
fn store(
    prepared: &Prepared,
    assembler: &Assembler,
    writer: &mut Writer,
    console: &dyn Observer,
) -> Result<Assembled> {
    let Prepared { scene, plan, .. } = prepared;
    let baked = BakedParts {
        sun: if scene.sun.is_some() { scene.sun_baked } else { Baked::None },
        sky: if scene.sky.is_some() { scene.sky_baked } else { Baked::None },
        groups: scene.groups.iter().map(|group| group.baked).collect(),
    };
    let progress = console.progress("writing", (plan.groups.len() + plan.times.len()) as u64);
    let mut stored = assembler.store(writer, &baked, || progress.advance(1))?;
    if stored.frames.len() > 1 {
        add_curves(scene, &mut stored.daylight, writer)?;
    }
    Ok(stored)
}

/// The local errors of what was stored, with advice.
fn local_errors(prepared: &Prepared, stored: &Assembled, traced: &Traced) -> LocalErrors {
    let samples = traced.samples().unwrap_or(prepared.limits.samples);
    let is_settled = prepared.denoise.is_some() || prepared.transfer.is_some();
    LocalErrors {
        all: stored.local.0,
        frames: stored.local.1.clone(),
        worst_frame: stored.worst.as_ref().map(|worst| worst.frame),
        advice: facts::advice(
            &prepared.scene,
            &prepared.plan,
            stored,
            (samples, prepared.limits.target_error),
            is_settled,
        ),
    }
}

/// Writes how light of sun and sky goes between frames, and names it in their layers. (The sun's direct light
/// goes by its visibility.)
fn add_curves(scene: &Scene, daylight: &mut [Layer], writer: &mut Writer) -> Result<()> {
    let location = scene.location.as_ref();
    for layer in daylight.iter_mut().filter(|layer| !layer.is_direct_sun()) {
        let curve = match layer.light {
            Light::Sun => scene.sun.as_ref().and_then(|sun| curves::of_reflected_sun(sun, location)),
            _ => scene.sky.as_ref().and_then(|sky| curves::of_sky(sky, location)),
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
    instances: Vec<Instance>,
    traced: &Traced,
    stored: &mut Assembled,
    geometry_file: FileRef,
    inputs: &str,
    settings: serde_json::Value,
) -> Config {
    let Prepared { scene, .. } = prepared;
    // A group that is left to the game switches nothing here.
    let is_baked = |group: usize| scene.groups[group].baked != Baked::None;
    let mut frames = std::mem::take(&mut stored.frames);
    for frame in &mut frames {
        let groups_on = frame.groups_on.iter().enumerate().filter(|(group, _)| is_baked(*group));
        frame.groups_on = groups_on.map(|(_, on)| *on).collect();
    }
    let mut layers = std::mem::take(&mut stored.daylight);
    let mut groups = Vec::new();
    for (group, shares) in
        scene.groups.iter().zip(std::mem::take(&mut stored.groups)).filter(|(of, _)| of.baked != Baked::None)
    {
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
        pages: std::mem::take(&mut stored.pages),
        sun: daylight(scene.sun.is_some(), scene.sun_baked),
        sky: daylight(scene.sky.is_some(), scene.sky_baked),
        groups,
        layers,
        frames,
        noise: Some(stored.noise.clone()),
        geometry: Some(geometry_file),
        instances,
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

/// A run, and where it works.
struct Run<'a> {
    prepared: &'a Prepared,
    atlas: &'a Atlas,
    cell_map: &'a CellMap,
    output: &'a OutputFolder,
    console: &'a dyn Observer,
}

impl Run<'_> {
    /// Traces the layers that no earlier bake left, and keeps them; towards a target also those that were
    /// left, where they miss it by this light. Warnings, too.
    fn trace_missing_layers(
        &self,
        denoiser: &mut Option<Denoiser>,
    ) -> Result<(Traced, LayerCount, Vec<String>)> {
        let Run { prepared, console, .. } = *self;
        let (Prepared { plan, digests, .. }, layers) = (prepared, &self.output.layers);
        let base = prepared.base();
        let missing = kept::not_kept(plan, layers, &base, digests);
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
            (prepared.limits.target_error, layers.texels(&base), origin.reused, kept::met_target(&traced))
        {
            let all: Vec<usize> = (0..digests.len()).collect();
            let again = with_worker(prepared, self.atlas, &[], |worker| {
                kept::off_target(plan, &self.light(&worker, layers, &all, &texels, denoiser)?, target)
            })?;
            if !again.is_empty() {
                let names: Vec<String> = again.iter().map(|&l| plan.name_of(l)).collect();
                console.say(format!(
                    "these kept layers miss the target with the new light and are traced again: {}",
                    names.join(", ")
                ));
                layers.remove(again.iter().map(|&l| &digests[l]))?;
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
    ) -> Result<target::StoredLight<'l>> {
        let Prepared { plan, digests, .. } = self.prepared;
        let owners = Owners::new(self.atlas);
        let parts = chosen.iter().map(|&layer| (&digests[layer], plan.parts_of(layer)));
        let valid =
            ValidTexels::find(worker.receivers.size(), &owners, texels, folder, parts)?.by_position(texels);
        let of_chosen: Vec<String> = chosen.iter().map(|&layer| digests[layer].clone()).collect();
        let filtered = match denoiser {
            Some(denoiser) => denoiser.denoise(worker, folder, &of_chosen, (texels, &valid), self.console)?,
            None => vec![None; chosen.len()],
        };
        let held = chosen.iter().zip(filtered);
        let layers =
            held.map(|(&layer, filtered)| (&digests[layer], plan.held_parts_of(layer), filtered)).collect();
        let (frames, width) = (self.prepared.frames(chosen), self.atlas.width as usize);
        let pieces = Pieces::of_texels(self.cell_map, width, texels.iter().map(|texel| texel.index as usize));
        Ok(target::StoredLight {
            folder,
            layers,
            frames,
            texels,
            valid,
            cell_map: self.cell_map,
            pieces,
            width,
        })
    }

    /// Traces some layers (ascending) and keeps them; if there are none to trace, gives the account of those
    /// that are kept. Warnings, too.
    fn trace(&self, chosen: &[usize], denoiser: &mut Option<Denoiser>) -> Result<(Traced, Vec<String>)> {
        let Run { prepared, atlas, cell_map, output, console } = *self;
        let (Prepared { plan, digests, .. }, layers, out) = (prepared, &output.layers, output.root());
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
            if let Some(slow) = endless_light::refuse(&worker.transport, atlas, worker.seed)? {
                console.warn(&slow);
                warnings.push(slow);
            }
            let folder = WorkFolder::open(out, &work, &wanted, SumKinds::of(worker.transport.lights))?;
            let cached = prepared.integrator == Integrator::Cached;
            let frames = prepared.frames(chosen);
            let tracer =
                Tracer { worker, atlas, frames, cell_map, folder: &folder, cached, layers: plan.layers() };
            let (provisional, mut more) = (layers.provisional(), RayCounts::default());
            let mut judge = |tracer: &Tracer, history: &BlockHistory, target: f64| {
                provisional.clear()?;
                more += provisional.write(tracer, history, &base, &wanted, &Traced::default(), console)?;
                let texels = provisional.texels(&base).ok_or_else(|| folder.changed())?;
                self.light(&tracer.worker, &provisional, chosen, &texels, denoiser)?.judge(target)
            };
            let judge: Option<JudgeTarget> = prepared.denoise.is_some().then_some(&mut judge);
            let (mut traced, history) = tracer.run(&prepared.limits, judge, console)?;
            if let Some(kept) = layers.traced(&base).filter(|_| chosen.len() < digests.len()) {
                traced.keep(&kept);
            }
            traced.rays += more + layers.write(&tracer, &history, &base, &wanted, &traced, console)?;
            layers.take_filtered_from(&provisional);
            folder.remove();
            Ok(traced)
        })?;
        Ok((traced, warnings))
    }

    /// The layers, denoised where that is asked for, ready to be put together; and what filters left of each.
    fn assembler(
        &self,
        denoiser: &mut Option<Denoiser>,
    ) -> Result<(Assembler<'_>, Vec<Option<FilteredLayer>>)> {
        let Run { prepared, atlas, cell_map, output, console } = *self;
        let Prepared { scene, geometry, plan, digests, .. } = prepared;
        let (layers, padding) = (&output.layers, scene.lightmap.padding);
        let texels = output.texels(&prepared.base())?;
        let assembler = Assembler::new(plan, geometry, atlas, (layers, digests), texels, cell_map, padding)?;
        let filtered = match denoiser {
            Some(denoiser) => with_worker(prepared, atlas, &[], |worker| {
                let texels = assembler.texels();
                let valid: Vec<bool> = (0..texels.len()).map(|place| assembler.is_valid(place)).collect();
                denoiser.denoise(&worker, layers, digests, (texels, &valid), console)
            })?,
            None => vec![None; digests.len()],
        };
        Ok((assembler.with_filtered(filtered.clone()), filtered))
    }

    /// Retraces some texels with this many unbiased paths each.
    fn check(&self, assembler: &Assembler, samples: u32) -> Result<Check> {
        let Run { prepared, atlas, console, .. } = *self;
        let chosen = choose(assembler.valid_texels(), prepared.scene.bake.seed);
        let all: Vec<usize> = (0..prepared.plan.layers()).collect();
        // Of every layer these texels alone: all of all layers may be more than memory holds.
        let positions: Vec<usize> = chosen.iter().map(|texel| texel.position).collect();
        let held = |&layer: &usize| assembler.held_at(layer, &positions);
        let values = all.iter().map(held).collect::<Result<Vec<_>>>()?;
        with_worker(prepared, atlas, &all, |worker| {
            check(&worker, &chosen, &values, &prepared.frames(&all), samples, console)
        })
    }

    /// Writes the sun's path and finds its visibility, as far as they are asked for.
    fn sunlight(&self, writer: &mut Writer) -> Result<Sunlight> {
        let Run { prepared, atlas, output, console, .. } = *self;
        let mut sunlight = Sunlight::default();
        if let Some(path) = prepared.sun_path() {
            sunlight.path = Some(writer.add("sun", "json", &path.to_json())?);
        }
        let Some(visibility_times) = &prepared.visibility_times else { return Ok(sunlight) };
        let texels = output.texels(&prepared.base())?;
        with_worker(prepared, atlas, &[], |worker| {
            let visibility_baker =
                VisibilityBaker::new(prepared, &worker, atlas, &output.layers, &texels, visibility_times)?;
            let (mut files, mut normals) = (Vec::new(), Vec::new());
            sunlight.rays = visibility_baker.pages(console, |number, page| {
                files.push(writer.add(&format!("visibility-{number}"), "vis", &page.visibility)?);
                normals.push(writer.add(&format!("normals-{number}"), "png", &page.normals)?);
                Ok(())
            })?;
            sunlight.visibility = Some(SunVisibility { minutes: visibility_times.minutes, files, normals });
            sunlight.times = visibility_times.hours.len();
            sunlight.kept = Some(visibility_baker.folder().to_owned());
            Ok(sunlight)
        })
    }
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
    let texels = SurfaceTexels::new(atlas);
    let ray_tracer = prepared.ray_tracer()?;
    let transport = Transport::new(prepared.space(&ray_tracer), &lights, scene.bake.bounces);
    work(Worker {
        transport,
        receivers: &texels,
        seed: scene.bake.seed,
        guaranteed_samples: guaranteed_samples(&prepared.limits),
    })
}
