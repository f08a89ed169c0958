//! The dataset that stands where a bake will write: whether it is this very bake, else what of it would be lost, told before any ray
//! is traced.

use super::options::{Options, Outcome};
use super::prepare::Prepared;
use crate::scene::LightmapSize;
use crate::trace::counts::RayCounts;
use crate::{Error, Result};
use dataset::config::Config;
use dataset::console::{Console, count};
use dataset::store::Dataset;
use std::path::Path;
use std::time::Instant;

/// The outcome of a run, beside the manifest.
pub const RUN: &str = "run.json";

/// The outcome of the earlier run, if `out` holds exactly this bake, whole.
pub fn up_to_date(out: &Path, inputs: &str, options: &Options, start: Instant) -> Option<Outcome> {
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

/// Refuses a bake that would put less in the place of the dataset in `out`; says of any other which one it replaces.
///
/// # Errors
/// [`Error::Invalid`] where less would take its place: another scene, fewer of its hours, fewer samples or fewer texels. A quick
/// look at one hour must not cost a day's bake; `--force` says that it may.
pub fn refuse_less(out: &Path, prepared: &Prepared, options: &Options, console: &Console) -> Result<()> {
    // Nothing there, or nothing that could be read: nothing is lost. (The writer refuses a manifest that is no dataset's.)
    let Ok(Dataset { config: standing, .. }) = Dataset::open_manifest(out) else { return Ok(()) };
    let held = format!("{}, baked with {}", count(standing.sets.len(), "set"), samples(standing.samples));
    let lost = lost(&standing, prepared, options);
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

/// What of the standing dataset the new one would not have, in words.
fn lost(standing: &Config, prepared: &Prepared, options: &Options) -> Vec<String> {
    let mut lost = Vec::new();
    if standing.scene != prepared.scene.name {
        lost.push(format!("it is of the scene {:?}, not {:?}", standing.scene, prepared.scene.name));
    }
    // The hours that were asked for: the sets beside a switch move with the schedule, and are not missed where it changed.
    let settings = &standing.settings;
    let hours: Vec<f64> = serde_json::from_value(settings["hours"].clone())
        .unwrap_or_else(|_| standing.sets.iter().map(|set| set.hour).collect());
    let is_baked =
        |hour: &&f64| prepared.plan.moments.iter().any(|moment| (moment.hour - **hour).abs() < 1e-6);
    let missing = hours.len() - hours.iter().filter(is_baked).count();
    if missing > 0 {
        lost.push(format!("{missing} of its {} would go", count(hours.len(), "hour")));
    }
    // Towards a target or a time limit the samples are what came of it, and say nothing of what is better.
    let with = &settings["baked_with"];
    let was_fixed = with["target_error"].is_null() && with["time_limit_secs"].is_null();
    let is_fixed = options.target_error.is_none() && options.time_limit.is_none();
    if was_fixed && is_fixed && prepared.limits.samples < standing.samples {
        lost.push(format!("{} instead of {}", samples(prepared.limits.samples), standing.samples));
    }
    let size = serde_json::from_value(settings["lightmap"]["size"].clone()).ok();
    lost.extend(size.and_then(|size| coarser(size, prepared.scene.lightmap.size)));
    lost
}

/// In words, where a page has fewer texels than before. (A size and a density cannot be compared before the atlas is made.)
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
