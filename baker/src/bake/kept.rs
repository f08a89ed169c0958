//! Which of the layers that earlier bakes left serve this one.

use super::errors::Sums;
use super::layers::{Layers, Texel};
use super::local::{Pieces, Places};
use super::open::OpenCells;
use super::plan::Plan;
use super::rounds::Traced;
use super::value::Value;
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
    (places, width, texels): (&Places, usize, &[Texel]),
    target: f64,
    traced: &Traced,
) -> Result<Vec<usize>> {
    if traced.out_of_time || traced.rounds.last().is_none_or(|round| round.is_missed) {
        return Ok(Vec::new());
    }
    let mut is_lit = vec![false; texels.len()];
    for (layer, digest) in digests.iter().enumerate() {
        for &part in plan.held_parts_of(layer) {
            layers.each(digest, part, |i, value| is_lit[i] |= value.mean != Rgb::ZERO)?;
        }
    }
    let pieces = Pieces::of_texels(places, width, texels.iter().map(|texel| texel.index as usize));
    let mut exposed = vec![0; places.grid().cells()];
    for texel in texels.iter().filter(|texel| texel.exposed == 1) {
        exposed[places.grid().at(texel.index as usize % width, texel.index as usize / width)] += 1;
    }
    let mut found = BTreeSet::new();
    for moment in 0..plan.moments.len() {
        let of_moment = plan.layers_of(moment);
        if of_moment.iter().all(|layer| found.contains(layer)) {
            continue;
        }
        let mut sum = vec![Value::default(); texels.len()];
        for &layer in &of_moment {
            let scale = plan.scale_of(layer);
            for &part in plan.held_parts_of(layer) {
                layers.each(&digests[layer], part, |i, value| sum[i] = sum[i].plus(value.times(scale)))?;
            }
        }
        let counted = |i: usize| (is_lit[i] && texels[i].exposed == 1).then_some(sum[i]);
        let mut cells = vec![Sums::default(); places.grid().cells()];
        pieces.add_some(counted, &mut cells);
        let mut open = OpenCells::none(places.grid());
        open.judge(places, target, &cells, &exposed);
        if !open.is_met() {
            found.extend(of_moment);
        }
    }
    Ok(found.into_iter().collect())
}
