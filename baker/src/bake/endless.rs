//! Light that nothing absorbs: found before the rounds by following some paths, and told with the surfaces that reflect it.

use crate::atlas::Atlas;
use crate::geometry::Geometry;
use crate::trace::sampler::{Kind, Sequence};
use crate::trace::walk::Transport;
use crate::{Error, Result};
use rayon::prelude::*;

/// Surfaces that reflect less than this end any path within a few thousand bounces.
const NEARLY_ALL: f32 = 0.999;
/// Paths that are followed.
const PATHS: u32 = 1 << 14;
/// So many of them without end are no chance.
const ENOUGH: usize = 4;
/// Most names that the error lists.
const MOST_NAMED: usize = 5;

/// The error of light that nothing absorbs, with the surfaces that reflect it.
pub fn error(geometry: &Geometry) -> Error {
    let names = geometry.reflecting(NEARLY_ALL);
    let shown = names.iter().take(MOST_NAMED).copied().collect::<Vec<_>>().join(", ");
    let more = names.len().saturating_sub(MOST_NAMED);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    Error::invalid(
        "scene",
        format!(
            "light grows without end: surfaces of a closed space reflect all of it (albedo 1), or nearly: {shown}{more}; \
             expected less than {NEARLY_ALL}; set `albedo` of the object or part, or a lower `albedo_max` in [bake]"
        ),
    )
}

/// Refuses a scene in which many paths go on without end in lit places. Costs nothing where all surfaces absorb some light.
///
/// # Errors
/// [`error`].
pub fn refuse(transport: &Transport, atlas: &Atlas, seed: u64) -> Result<()> {
    let geometry = transport.space.geometry;
    if atlas.faces.is_empty() || geometry.reflecting(NEARLY_ALL).is_empty() {
        return Ok(());
    }
    // Starts are spread over the atlas's area.
    let mut sum = 0.0;
    let areas: Vec<f64> = atlas
        .faces
        .iter()
        .map(|face| {
            sum += f64::from(geometry.area(face.triangle as usize));
            sum
        })
        .collect();
    let endless = |path: &u32| {
        let sequence = Sequence::new(seed, Kind::PlanRay, *path, 1);
        let target = (f64::from(*path) + 0.5) / f64::from(PATHS) * sum;
        let face = areas.partition_point(|&area| area <= target).min(areas.len() - 1);
        transport.is_endless(atlas.faces[face].triangle, sequence)
    };
    let found = (0..PATHS).into_par_iter().filter(endless).count();
    if found >= ENOUGH { Err(error(geometry)) } else { Ok(()) }
}
