//! Which of the layers that earlier bakes left serve this one.

use super::folder::{Layers, Texel};
use super::target::StoredLight;
use crate::Result;
use crate::bake::prepare::Plan;
use crate::bake::rounds::Traced;
use std::collections::BTreeSet;

/// The layers, ascending, that are not kept.
pub(crate) fn not_kept(plan: &Plan, layers: &Layers, base: &str, digests: &[String]) -> Vec<usize> {
    let texels = layers.texels(base);
    let is_missing = |&layer: &usize| {
        let has = |texels: &Vec<Texel>| layers.has(&digests[layer], texels.len(), plan.parts_of(layer));
        !texels.as_ref().is_some_and(has)
    };
    (0..digests.len()).filter(is_missing).collect()
}

/// The layers, ascending, of the frames that miss a target error, where those layers were traced until they
/// met it: by other colours, intensities or schedules, or together with others. `light`: all layers.
pub(crate) fn off_target(plan: &Plan, light: &StoredLight, target: f64) -> Result<Vec<usize>> {
    let mut found = BTreeSet::new();
    for time in 0..plan.times.len() {
        let of_time = plan.layers_of(time);
        if !of_time.iter().all(|layer| found.contains(layer)) && light.misses_target(time, target)? {
            found.extend(of_time);
        }
    }
    Ok(found.into_iter().collect())
}

/// Whether what was traced last met its target. (What could not be brought to it then would not be now.)
pub(crate) fn met_target(traced: &Traced) -> bool {
    !traced.out_of_time && traced.rounds.last().is_some_and(|round| !round.is_missed)
}
