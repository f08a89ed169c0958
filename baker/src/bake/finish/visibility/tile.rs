//! The sun's visibility over one tile of texels: asked for where it changes, from coarse times to fine ones.
//!
//! Times of level 0 are asked for everywhere. One of a finer level lies between two that are known; a texel
//! is asked there only where light moves: where between those two its visibility, or that of a texel close
//! by, changes. Elsewhere it lies on the line between them.

use crate::Rgb;
use crate::light::daylight::SunDisc;
use crate::light::times::visibility_times::{VisibilityTimes, mean_direction};
use crate::trace::counts::RayCounts;
use crate::trace::solids::Space;
use crate::trace::sources::{SunAtTime, SunLight, SunSample, VisibilitySampler};
use dataset::format::Planes;
use rayon::prelude::*;

/// By level, how far around a texel that changes others are asked, in texels: what is thin moves on over some
/// in the time between, and shows at none of them at both of its ends.
const REACH_OF_LEVEL: [usize; 5] = [0, 8, 4, 2, 1];
/// The change between two times from which on the times between them are asked for.
const LEAST_CHANGE: u8 = 26;
/// What is known of a texel at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum KnownVisibility {
    /// The texel looks away from the sun.
    Nothing,
    /// This, as it was found.
    Found([u8; 3]),
    /// This, on the line between two times.
    Between([u8; 3]),
}

impl KnownVisibility {
    fn value(self) -> Option<[u8; 3]> {
        match self {
            KnownVisibility::Nothing => None,
            KnownVisibility::Found(value) | KnownVisibility::Between(value) => Some(value),
        }
    }
}

/// The suns of all times, with directions to the points of the disc that texels sample.
pub(super) fn suns_at(times: &VisibilityTimes, places: &[SunSample]) -> Vec<SunAtTime> {
    let of_disc =
        |disc: &SunDisc| SunAtTime::new(SunLight::new(*disc), mean_direction(disc).as_vec3(), places);
    times.suns.iter().map(of_disc).collect()
}

/// A tile of texels.
pub(super) struct Tile<'a> {
    /// Columns.
    pub width: usize,
    /// Per texel, row by row, its points; `None` where it is no surface.
    pub visibility_samplers: Vec<Option<VisibilitySampler>>,
    /// Per time, where the light that came straight from its sun was traced already: per texel, that light ÷
    /// the sun's irradiance.
    pub traced: Vec<Option<Vec<Rgb>>>,
    /// The times.
    pub times: &'a VisibilityTimes,
    /// The sun at each.
    pub suns: &'a [SunAtTime],
    /// What may block it.
    pub space: &'a Space<'a>,
}

impl Tile<'_> {
    /// The visibility over all texels, in levels up to `top`.
    pub(super) fn planes(&self, top: u8) -> (Planes, RayCounts) {
        let mut known: Vec<Vec<KnownVisibility>> = vec![Vec::new(); self.times.hours.len()];
        let mut counts = RayCounts::default();
        for level in 0..=self.times.finest() {
            for (time, before, after) in self.times.of_level(level) {
                let around =
                    |time: Option<usize>| time.map(|time| (self.times.hours[time], &known[time][..]));
                let (found, rays) = self.at(time, around(before), around(after));
                counts += rays;
                known[time] = found;
            }
        }
        let (texels, times) = (self.visibility_samplers.len(), known.len());
        let mut levels = vec![0; 3 * times * texels];
        for texel in 0..texels {
            let values: Vec<Option<[u8; 3]>> = known.iter().map(|known| known[texel].value()).collect();
            for (time, value) in filled(&values, &self.times.hours).into_iter().enumerate() {
                for (channel, value) in value.into_iter().enumerate() {
                    let level = (u32::from(value) * u32::from(top) + 127) / 255;
                    levels[(channel * times + time) * texels + texel] = level as u8;
                }
            }
        }
        (Planes { texels, channels: 3, levels }, counts)
    }

    /// What is known at a time, by what is known at the times around it.
    fn at(
        &self,
        time: usize,
        before: Option<(f64, &[KnownVisibility])>,
        after: Option<(f64, &[KnownVisibility])>,
    ) -> (Vec<KnownVisibility>, RayCounts) {
        let texels = self.visibility_samplers.len();
        let sun = &self.suns[time];
        let around = before.zip(after).map(|((from, before), (to, after))| {
            let part = ((self.times.hours[time] - from) / (to - from)) as f32;
            (
                before,
                after,
                part,
                self.close_to(&changes(before, after), REACH_OF_LEVEL[self.times.levels[time] as usize]),
            )
        });
        let of_texel = |texel: usize| {
            let mut counts = RayCounts::default();
            let Some(visibility_sampler) = &self.visibility_samplers[texel] else {
                return (KnownVisibility::Nothing, counts);
            };
            if let Some((before, after, part, moves)) = &around
                && !moves[texel]
                && let (Some(a), Some(b)) = (before[texel].value(), after[texel].value())
            {
                return (KnownVisibility::Between(lerp(a, b, *part)), counts);
            }
            let found = match &self.traced[time] {
                Some(traced)
                    if visibility_sampler.is_fully_facing(sun)
                        && is_plain(traced[texel] / visibility_sampler.normal.dot(sun.mean)) =>
                {
                    Some((traced[texel] / visibility_sampler.normal.dot(sun.mean)).round())
                }
                _ => visibility_sampler.visibility(self.space, sun, &mut counts),
            };
            let to_byte = |value: f32| (value * 255.0).round() as u8;
            (
                found.map_or(KnownVisibility::Nothing, |value| {
                    KnownVisibility::Found(value.to_array().map(to_byte))
                }),
                counts,
            )
        };
        let all: Vec<(KnownVisibility, RayCounts)> =
            (0..texels).into_par_iter().with_min_len(64).map(of_texel).collect();
        let mut counts = RayCounts::default();
        all.iter().for_each(|(_, rays)| counts += *rays);
        (all.into_iter().map(|(known, _)| known).collect(), counts)
    }

    /// The texels that are marked, and those within reach of them.
    fn close_to(&self, marked: &[bool], reach: usize) -> Vec<bool> {
        let (width, height) = (self.width, marked.len() / self.width);
        let mut close = vec![false; marked.len()];
        for texel in (0..marked.len()).filter(|&texel| marked[texel]) {
            let (x, y) = (texel % width, texel / width);
            for y in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                let row = y * width;
                close[row + x.saturating_sub(reach)..row + (x + reach + 1).min(width)].fill(true);
            }
        }
        close
    }
}

/// Per texel, whether it changes between two times.
fn changes(before: &[KnownVisibility], after: &[KnownVisibility]) -> Vec<bool> {
    let change = |(a, b): (&KnownVisibility, &KnownVisibility)| match (a.value(), b.value()) {
        (Some(a), Some(b)) => (0..3).any(|c| a[c].abs_diff(b[c]) >= LEAST_CHANGE),
        _ => false,
    };
    before.iter().zip(after).map(change).collect()
}

fn lerp(a: [u8; 3], b: [u8; 3], part: f32) -> [u8; 3] {
    std::array::from_fn(|c| {
        let (a, b) = (f32::from(a[c]), f32::from(b[c]));
        (a + (b - a) * part).round() as u8
    })
}

/// The values of a texel at all times: where nothing is known, as at the nearest time at which something is;
/// 0 where there is none.
fn filled(values: &[Option<[u8; 3]>], hours: &[f64]) -> Vec<[u8; 3]> {
    let known: Vec<(f64, [u8; 3])> =
        hours.iter().zip(values).filter_map(|(hour, value)| Some((*hour, (*value)?))).collect();
    let mut next = 0;
    let at = |(hour, value): (&f64, &Option<[u8; 3]>)| {
        next += usize::from(value.is_some());
        match (value, next.checked_sub(1).map(|i| known[i]), known.get(next)) {
            (Some(value), _, _) => *value,
            (None, Some((from, a)), Some((to, b))) => {
                if hour - from <= to - hour {
                    a
                } else {
                    *b
                }
            }
            (None, Some((_, value)), None) => value,
            (None, None, Some((_, value))) => *value,
            (None, None, None) => [0; 3],
        }
    };
    hours.iter().zip(values).map(at).collect()
}

/// Whether light is that of a texel that sees all of the sun, or nothing of it.
fn is_plain(part: Rgb) -> bool {
    const CLOSE: f32 = 2e-3;
    part == Rgb::ZERO || (part - Rgb::ONE).abs().max_element() < CLOSE
}

#[cfg(test)]
#[path = "tile_tests.rs"]
mod tests;
