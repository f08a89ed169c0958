//! What stands where a bake will write: whether it is this very bake, else what of it would be lost, told
//! before any ray is traced.

use super::folder;
use super::outcome::Outcome;
use crate::bake::finish::GLB_FILE;
use crate::bake::layers::{Layers, kept};
use crate::bake::prepare::{Options, Prepared};
use crate::bake::store::{LAYERS_FOLDER, WorkFolder};
use crate::scene::LightmapSize;
use crate::trace::counts::RayCounts;
use crate::{Error, Result};
use dataset::format::{Config, FileRef};
use dataset::host::files::{remove_stale_temporaries, sync_folder_of};
use dataset::observe::{Observer, Silent, count};
use dataset::store::{self, Dataset, Writer};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The outcome of a run, beside the manifest.
pub(crate) const RUN_FILE: &str = "run.json";
/// A picture of local errors, beside it: a pixel per cell of 16×16 texels, at the frame whose 95th percentile
/// is greatest; grey 1 is 0.2 %.
pub const ERRORS_FILE: &str = "local-error.png";
/// The report, beside it.
pub const REPORT_FILE: &str = "report.html";

/// The outcome of the earlier run, if `out` holds exactly this bake, whole.
pub(crate) fn up_to_date(out: &Path, inputs: &str, options: &Options, start: Instant) -> Option<Outcome> {
    let dataset = Dataset::open(out).ok().filter(|_| !options.force)?;
    // (One of which a file is damaged is written again, from the layers kept beside it.)
    if dataset.config.inputs != inputs || !is_whole(&dataset) {
        return None;
    }
    let run: Outcome = serde_json::from_slice(&std::fs::read(out.join(RUN_FILE)).ok()?).ok()?;
    if run.inputs != inputs {
        return None;
    }
    if options.check.is_some() && options.check != run.check.as_ref().map(|c| c.samples) {
        return None;
    }
    let seconds = start.elapsed().as_secs_f64();
    Some(Outcome { dataset: out.to_owned(), up_to_date: true, seconds, rays: RayCounts::default(), ..run })
}

/// Brings a finished bake's folder up to date: removes what a run left that was killed while it wrote its
/// report, and writes cameras into a manifest that has others. (They are no part of a bake, and reports show
/// the scene by them.)
///
/// # Errors
/// A dataset that cannot be written.
pub(crate) fn refresh(out: &Path, settings: &serde_json::Value) -> Result<()> {
    remove_stale_temporaries(out)?;
    sync_folder_of(&out.join(RUN_FILE));
    let mut config = Dataset::open(out)?.config;
    let of = |settings: &serde_json::Value| settings["cameras"].as_array().cloned().unwrap_or_default();
    // Through text, as the manifest went: reading a number back may round it.
    let text = settings.to_string();
    let new = of(&serde_json::from_str(&text).map_err(|e| Error::invalid("scene", e))?);
    if of(&config.settings) == new || !config.settings.is_object() {
        return Ok(());
    }
    let _lock = folder::lock(out)?;
    config.settings["cameras"] = new.into();
    Writer::create(out)?.commit(&config)
}

/// Whether all files of a dataset are as they were written, the geometry under both of its names.
fn is_whole(dataset: &Dataset) -> bool {
    // (The plain name is a second link to the same file, or a copy of it.)
    let named =
        dataset.config.geometry.iter().map(|file| FileRef { path: GLB_FILE.to_owned(), ..file.clone() });
    dataset.files().all(|file| dataset.verified(file).is_ok())
        && named.into_iter().all(|file| dataset.verified(&file).is_ok())
}

/// Refuses a folder that is no dataset's, nor holds the work of a bake, and in which files of those names
/// stand: they would be written over. `reads` are the files of the scene.
///
/// # Errors
/// [`Error::Invalid`], also where a file of the scene is one that the dataset has.
pub(crate) fn refuse_foreign_folder<'a>(out: &Path, reads: impl IntoIterator<Item = &'a Path>) -> Result<()> {
    let is_own = [store::MANIFEST, store::WORK, LAYERS_FOLDER].iter().any(|name| out.join(name).exists());
    let written = [GLB_FILE, RUN_FILE, REPORT_FILE, store::DATA];
    // (An empty folder is nobody's loss.)
    let is_empty = |path: &Path| std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none());
    let is_foreign = |path: PathBuf| !is_own && path.exists() && !is_empty(&path);
    let foreign: Vec<&str> = written.into_iter().filter(|name| is_foreign(out.join(name))).collect();
    if !foreign.is_empty() {
        return Err(Error::invalid(
            out.display(),
            format!(
                "is no dataset, and holds {}, which a bake would write over; expected a folder of its own for the dataset (--out)",
                foreign.join(", ")
            ),
        ));
    }
    let place = |path: &Path| path.canonicalize().ok();
    let (glb, data) = (place(&out.join(GLB_FILE)), place(&out.join(store::DATA)));
    for file in reads {
        let Some(read) = place(file) else { continue };
        if glb.as_ref() == Some(&read) || data.as_ref().is_some_and(|data| read.starts_with(data)) {
            return Err(Error::invalid(
                file.display(),
                format!(
                    "the scene reads it, and a bake to {} would write over it; expected a copy elsewhere, or another --out",
                    out.display()
                ),
            ));
        }
    }
    Ok(())
}

/// Refuses a bake that would put less in the place of the dataset in `out`; says of any other which one it
/// replaces.
///
/// # Errors
/// [`Error::Invalid`] where less would take its place: another scene, fewer of its hours, fewer samples or
/// fewer texels. A quick look at one hour must not cost a day's bake; `--force` says that it may. Also,
/// forced or not, where a manifest stands there that cannot be read.
pub(crate) fn refuse_downgrade(
    out: &Path,
    prepared: &Prepared,
    options: &Options,
    console: &dyn Observer,
) -> Result<()> {
    let existing = match Dataset::open_manifest(out) {
        Ok(dataset) => dataset.config,
        Err(_) if !out.join(store::MANIFEST).exists() => return Ok(()),
        // It may be of something else, so not even `--force` writes over it.
        Err(error) => {
            return Err(Error::invalid(
                out.display(),
                format!(
                    "what stands there is not known ({error}): to bake here, remove {} (what was traced is kept beside it), or give another \
                     folder with --out DIR",
                    out.join(store::MANIFEST).display()
                ),
            ));
        }
    };
    let held = format!("{}, baked with {}", count(existing.frames.len(), "frame"), samples(existing.samples));
    let mut lost = lost(&existing, prepared, options);
    lost.extend(other_file(out, &existing, prepared));
    if !lost.is_empty() && !options.force {
        return Err(Error::invalid(
            out.display(),
            format!(
                "holds a dataset of {held}, and this bake would put less in its place: {}; expected --out DIR for a folder of its \
                 own, or --force to replace it",
                lost.join("; ")
            ),
        ));
    }
    console.say(format!("{}: the dataset there ({held}) is replaced when this bake is done", out.display()));
    Ok(())
}

/// Refuses to drop what an unfinished bake of other settings has traced, in favour of the work of this
/// digest; whether it would drop work without a finished round.
///
/// # Errors
/// [`Error::Invalid`] where such work has a finished round.
pub(crate) fn refuse_unfinished(out: &Path, work: &str, layers: &Layers) -> Result<bool> {
    let unfinished = WorkFolder::unfinished(out, work, |digest| layers.holds(digest));
    if unfinished.contains(&true) {
        return Err(Error::invalid(
            out.display(),
            "holds the unfinished work of a bake of other settings; expected the command that began it, which goes on with it, or --out \
             DIR for a folder of its own, or --force to drop it",
        ));
    }
    Ok(!unfinished.is_empty())
}

/// What would become of what stands where a bake is to write, in words; `None` where nothing does.
pub fn replacement_note(prepared: &Prepared, options: &Options) -> Result<Option<String>> {
    let out = prepared.out(options);
    let refused = |error: Error| format!("this bake would be refused: {error}");
    let reads = prepared.scene.objects.iter().map(|object| object.file.as_path());
    if let Err(error) =
        folder::check_no_file_in_the_way(&out).and_then(|()| refuse_foreign_folder(&out, reads))
    {
        return Ok(Some(refused(error)));
    }
    let (_, inputs) = prepared.manifest(options)?;
    if up_to_date(&out, &inputs, options, Instant::now()).is_some() {
        return Ok(Some(format!("{} already holds this bake: nothing would be traced", out.display())));
    }
    if let Err(error) = refuse_downgrade(&out, prepared, options, &Silent) {
        return Ok(Some(refused(error)));
    }
    if options.force {
        return Ok(None);
    }
    let (layers, all) = (Layers::new(&out), prepared.digests.len());
    let missing = kept::not_kept(&prepared.plan, &layers, &prepared.base(), &prepared.digests);
    if !missing.is_empty()
        && let Err(error) = refuse_unfinished(&out, &prepared.work(&missing), &layers)
    {
        return Ok(Some(refused(error)));
    }
    let kept = all - missing.len();
    Ok((kept > 0).then(|| {
        format!("kept in {} from an earlier bake, not traced again: {}", out.display(), count(kept, "layer"))
    }))
}

/// What of the existing dataset the new one would not have, in words.
fn lost(existing: &Config, prepared: &Prepared, options: &Options) -> Vec<String> {
    let mut lost = Vec::new();
    if existing.scene != prepared.scene.name {
        lost.push(format!("it is of the scene {:?}, not {:?}", existing.scene, prepared.scene.name));
    }
    if let Some(halved) = existing.halved() {
        let level = halved.times;
        lost.push(format!(
            "it is level {level} of a dataset, which `dataset halve` made and no bake makes again"
        ));
    }
    let (before, now) =
        (files(&existing.settings), prepared.scene.objects.iter().filter_map(|o| o.file.file_name()));
    let now: BTreeSet<String> = now.map(|name| name.to_string_lossy().into_owned()).collect();
    if !before.is_empty() && before.is_disjoint(&now) {
        let names =
            |files: &BTreeSet<String>| files.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        lost.push(format!("it is of {}, not of {}", names(&before), names(&now)));
    }
    // The hours that were asked for: the frames beside a switch move with the schedule, and are not missed
    // where it changed.
    let settings = &existing.settings;
    let hours: Vec<f64> = serde_json::from_value(settings["hours"].clone())
        .unwrap_or_else(|_| existing.frames.iter().map(|frame| frame.hour).collect());
    let is_baked = |hour: &&f64| prepared.plan.times.iter().any(|time| (time.hour - **hour).abs() < 1e-6);
    let missing = hours.len() - hours.iter().filter(is_baked).count();
    if missing > 0 {
        lost.push(format!("{missing} of its {} would go", count(hours.len(), "hour")));
    }
    // Towards a target or a time limit the samples are what came of it, and say nothing of what is better.
    let with = &settings["baked_with"];
    let was_fixed = with["target_error"].is_null() && with["time_limit_secs"].is_null();
    let is_fixed = options.target_error.is_none() && options.time_limit.is_none();
    if was_fixed && is_fixed && prepared.limits.samples < existing.samples {
        lost.push(format!("{} instead of {}", samples(prepared.limits.samples), existing.samples));
    }
    let size = serde_json::from_value(settings["lightmap"]["size"].clone()).ok();
    lost.extend(size.and_then(|size| coarser(size, prepared.scene.lightmap.size)));
    lost
}

/// In words, where the dataset was baked from another scene file that is still there. (One that is gone was
/// moved or renamed.)
fn other_file(out: &Path, existing: &Config, prepared: &Prepared) -> Option<String> {
    let run: Outcome = serde_json::from_slice(&std::fs::read(out.join(RUN_FILE)).ok()?).ok()?;
    let before = out.join(run.scene_file.filter(|_| run.inputs == existing.inputs)?).canonicalize().ok()?;
    let now = prepared.scene_file.canonicalize().ok()?;
    (before.is_file() && before != now && existing.scene == prepared.scene.name)
        .then(|| format!("it is of {}, which has the same name as {}", before.display(), now.display()))
}

/// The scene file's path from the dataset's folder: it holds where both are moved or copied together.
pub(crate) fn scene_file_from(out: &Path, prepared: &Prepared) -> Option<PathBuf> {
    let (out, scene) = (out.canonicalize().ok()?, prepared.scene_file.canonicalize().ok()?);
    Some(folder::relative_to(&out, &scene))
}

/// The names of the geometry files that a dataset was baked from.
fn files(settings: &serde_json::Value) -> BTreeSet<String> {
    let objects = settings["objects"].as_array().into_iter().flatten();
    objects.filter_map(|object| Some(object["file"].as_str()?.to_owned())).collect()
}

/// In words, where a page has fewer texels than before. (A size and a density cannot be compared before the
/// atlas is made.)
fn coarser(before: LightmapSize, now: LightmapSize) -> Option<String> {
    match (before, now) {
        (LightmapSize::Fixed { width: w0, height: h0 }, LightmapSize::Fixed { width, height }) => {
            let is_less = u64::from(width) * u64::from(height) < u64::from(w0) * u64::from(h0);
            is_less.then(|| format!("pages of {width} × {height} texels instead of {w0} × {h0}"))
        }
        (LightmapSize::TexelsPerMetre(before), LightmapSize::TexelsPerMetre(now)) => {
            (now < before).then(|| format!("{now} texels per metre instead of {before}"))
        }
        _ => None,
    }
}

fn samples(n: u32) -> String {
    format!("{} per texel", count(n as usize, "sample"))
}
