//! Light that nothing absorbs: found before the rounds by following some paths, and told with the surfaces
//! that reflect it.

use crate::atlas::Atlas;
use crate::geometry::Geometry;
use crate::trace::paths::{EndlessPath, Sequence, SequenceKind, Transport};
use crate::{Error, Result};
use rayon::prelude::*;

/// Surfaces that reflect less than this end any path within a few thousand bounces.
const REFLECTS_NEARLY_ALL: f32 = 0.999;
/// Paths that are followed from all over the atlas.
const PATHS: u32 = 1 << 14;
/// So many of them without end are no chance.
const ENOUGH_PATHS: usize = 4;
/// Most triangles of bright surfaces that a path is followed from.
const MOST_TRIANGLES: usize = 1 << 15;
/// Paths that are followed from one of them where the first had no end. Half of them tell a closed space from
/// a long way out.
const PATHS_AGAIN: u32 = 16;
/// Most names that the error lists.
const MOST_NAMED: usize = 5;

/// The error of light that nothing absorbs, with all surfaces that may reflect it.
pub(crate) fn error(geometry: &Geometry) -> Error {
    error_of(&geometry.reflecting(REFLECTS_NEARLY_ALL))
}

/// The error of light that nothing absorbs, with the names of the surfaces that reflect it.
fn error_of(names: &[&str]) -> Error {
    Error::invalid(
        "scene",
        format!(
            "light grows without end: surfaces of a closed space reflect all of it (albedo 1), or nearly: {}; expected less than \
             {REFLECTS_NEARLY_ALL}; set `albedo` of the object or part, or a lower `albedo_max` in [bake]",
            listed(names)
        ),
    )
}

/// The first few names, and how many more there are.
fn listed(names: &[&str]) -> String {
    let shown = names.iter().take(MOST_NAMED).copied().collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(MOST_NAMED) {
        0 => shown,
        more => format!("{shown}, and {more} more"),
    }
}

/// Refuses a scene in which many paths go on without end in lit places, or most paths from one of them. Gives
/// a warning where many do so in the dark: that is no error, but takes time. Costs nothing where all surfaces
/// absorb some light.
///
/// # Errors
/// Those paths' surfaces, by name.
pub(crate) fn refuse(transport: &Transport, atlas: &Atlas, seed: u64) -> Result<Option<String>> {
    let geometry = transport.space.geometry;
    let names = geometry.reflecting(REFLECTS_NEARLY_ALL);
    if names.is_empty() {
        return Ok(None);
    }
    let bright = |triangles: &[u32]| {
        let of_path = geometry.names_of(triangles);
        let bright: Vec<&str> = of_path.into_iter().filter(|name| names.contains(name)).collect();
        if bright.is_empty() { names.clone() } else { bright }
    };
    let found = anywhere(transport, atlas, seed);
    let triangles = |is_lit: bool| -> Option<Vec<u32>> {
        let paths: Vec<&[u32]> =
            found.iter().filter(|path| path.is_lit == is_lit).map(|path| &path.triangles[..]).collect();
        (paths.len() >= ENOUGH_PATHS).then(|| paths.concat())
    };
    if let Some(triangles) = triangles(true).or_else(|| in_closed_cavity(transport, seed)) {
        return Err(error_of(&bright(&triangles)));
    }
    Ok(triangles(false).map(|triangles| {
        format!(
            "paths go on for thousands of bounces in dark closed spaces whose surfaces reflect all light (albedo 1), or nearly, which takes \
             time: {}; set `albedo` of the object or part below {REFLECTS_NEARLY_ALL}, or a lower `albedo_max` in [bake]",
            listed(&bright(&triangles))
        )
    }))
}

/// The paths without end among those that start all over the atlas, by area.
fn anywhere(transport: &Transport, atlas: &Atlas, seed: u64) -> Vec<EndlessPath> {
    let geometry = transport.space.geometry;
    let mut sum = 0.0;
    let areas: Vec<f64> = atlas
        .faces
        .iter()
        .map(|face| {
            sum += f64::from(geometry.area(face.triangle as usize));
            sum
        })
        .collect();
    let endless = |path: u32| {
        let sequence = Sequence::new(seed, SequenceKind::PlanRay, path, 1);
        let target = (f64::from(path) + 0.5) / f64::from(PATHS) * sum;
        let face = atlas.faces.get(areas.partition_point(|&area| area <= target).min(areas.len() - 1))?;
        transport.endless_path(face.triangle, false, sequence, true)
    };
    if areas.is_empty() { Vec::new() } else { (0..PATHS).into_par_iter().filter_map(endless).collect() }
}

/// Triangles that paths without end met, where at least half of those from one bright triangle have none. A
/// small closed space, in which hardly any path that starts by area begins, is found so.
fn in_closed_cavity(transport: &Transport, seed: u64) -> Option<Vec<u32>> {
    let geometry = transport.space.geometry;
    let is_bright: Vec<bool> =
        (0..geometry.materials.len()).map(|m| geometry.reflects_at_most(m) >= REFLECTS_NEARLY_ALL).collect();
    let bright: Vec<u32> = (0..geometry.triangles.len() as u32)
        .filter(|&triangle| is_bright[geometry.material_of[triangle as usize] as usize])
        .collect();
    let step = bright.len().div_ceil(MOST_TRIANGLES).max(1);
    let some: Vec<u32> = bright.into_iter().step_by(step).collect();
    some.into_par_iter().find_map_first(|triangle| {
        let sides = if transport.space.material(triangle).two_sided { &[false, true][..] } else { &[false] };
        sides.iter().find_map(|&is_back| {
            let path = |number: u32| {
                let sequence =
                    Sequence::new(seed, SequenceKind::PlanRay, triangle, 2 + 2 * number + u32::from(is_back));
                let endless = transport.endless_path(triangle, is_back, sequence, false)?;
                endless.is_lit.then_some(endless.triangles)
            };
            path(0)?;
            let again: Vec<Vec<u32>> = (1..=PATHS_AGAIN).filter_map(path).collect();
            (2 * again.len() as u32 >= PATHS_AGAIN).then(|| again.concat())
        })
    })
}
