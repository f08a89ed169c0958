//! Which of the layers that earlier bakes left serve this one.

use super::layers::{Layers, Texel, Value};
use super::open::OpenCells;
use super::plan::Plan;
use super::rounds::Traced;
use crate::{Result, Rgb};
use std::collections::BTreeSet;

/// The layers, ascending, that are not kept.
pub fn missing(plan: &Plan, layers: &Layers, base: &str, digests: &[String]) -> Vec<usize> {
    let texels = layers.texels(base);
    let is_missing = |&layer: &usize| {
        let has = |texels: &Vec<Texel>| layers.has(&digests[layer], texels.len(), plan.parts_of(layer));
        !texels.as_ref().is_some_and(has)
    };
    (0..digests.len()).filter(is_missing).collect()
}

/// The layers, ascending, of the sets that miss a target error, where those layers were traced until they met it: by other
/// colours, intensities or schedules, or together with others. `traced` tells how the last of them were; what could not be brought to
/// the target then would not be now.
pub fn missing_target(
    plan: &Plan,
    layers: &Layers,
    digests: &[String],
    (width, height, texels): (usize, usize, &[Texel]),
    target: f64,
    traced: &Traced,
) -> Result<Vec<usize>> {
    if traced.out_of_time || traced.rounds.last().is_none_or(|round| round.open_cells > 0) {
        return Ok(Vec::new());
    }
    let mut is_lit = vec![false; texels.len()];
    for (layer, digest) in digests.iter().enumerate() {
        let values = layers.read_sum(digest, plan.held_parts_of(layer))?;
        is_lit.iter_mut().zip(values).for_each(|(lit, value)| *lit |= value.mean != Rgb::ZERO);
    }
    let mut found = BTreeSet::new();
    for moment in 0..plan.moments.len() {
        let of_moment = plan.layers_of(moment);
        if of_moment.iter().all(|layer| found.contains(layer)) {
            continue;
        }
        let mut sum = vec![Value { mean: Rgb::ZERO, error: Rgb::ZERO }; texels.len()];
        for &layer in &of_moment {
            let scale = plan.scale_of(layer);
            for (sum, value) in
                sum.iter_mut().zip(layers.read_sum(&digests[layer], plan.held_parts_of(layer))?)
            {
                sum.mean += value.mean * scale;
                sum.error += value.error * scale;
            }
        }
        let place = |texel: &Texel| (texel.index as usize % width, texel.index as usize / width);
        let exposed = (0..texels.len()).filter(|&i| texels[i].exposed == 1);
        let judged = exposed.map(|i| (place(&texels[i]), is_lit[i].then_some((sum[i].mean, sum[i].error))));
        if OpenCells::count_of_set((width, height), target, judged) > 0 {
            found.extend(of_moment);
        }
    }
    Ok(found.into_iter().collect())
}
