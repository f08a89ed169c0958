//! A path at glass: it goes straight on or is reflected, by chance, so that neither the light behind nor that
//! before it is lost.

use super::triangle::Hit;
use crate::Rgb;
use crate::geometry::{BLOCKED_BELOW, Geometry};

/// What becomes of a path at glass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GlassEvent {
    /// It goes on in its direction.
    Passes,
    /// It is reflected: its weight is yet to be multiplied by the albedo.
    Reflects,
    /// Nothing is left of it.
    Ends,
}

/// Decides on a path that meets glass, and changes its weight accordingly: divided by the probability of what
/// was chosen. `absorbs`: the glass reflects nothing on this side. `choice` is asked for where both are
/// possible.
///
/// The density of the direction stays what it was, for the choice says nothing about it: a light that is
/// found behind glass counts with the same share of the balance heuristic as in the open.
pub(crate) fn pass_or_reflect(
    geometry: &Geometry,
    hit: &Hit,
    absorbs: bool,
    choice: impl FnOnce() -> f32,
    weight: &mut Rgb,
) -> GlassEvent {
    let triangle = hit.triangle as usize;
    let passing = *weight * geometry.transmittance_at(triangle, hit.barycentric);
    let albedo = if absorbs { Rgb::ZERO } else { geometry.albedo_at(triangle, hit.barycentric) };
    // In proportion to the brightest channel of what the path would bring: weights then never grow by more
    // than a factor of three, however much glass there is.
    let (through, back) = (passing.max_element(), (*weight * albedo).max_element());
    if through < BLOCKED_BELOW && back <= 0.0 {
        return GlassEvent::Ends;
    }
    let probability = if through < BLOCKED_BELOW { 0.0 } else { through / (through + back) };
    if probability == 1.0 || probability > 0.0 && choice() < probability {
        *weight = passing / probability;
        GlassEvent::Passes
    } else {
        *weight /= 1.0 - probability;
        GlassEvent::Reflects
    }
}
