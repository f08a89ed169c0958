//! A tile's planes, unpacked, and its light at one time.

use super::light::{Source, Unpacked, decode};
use super::set::PlaneSet;
use crate::lanes::Tier;
use crate::model::{Brightness, Knot};
use crate::time::{TimePoint, Timeline, brightness};
use std::sync::Arc;

/// A tile's planes, unpacked once for all times.
#[derive(Clone, Debug)]
pub struct TilePlanes {
    /// Stored texels across and down.
    pub size: [usize; 2],
    /// Its light sources, ascending.
    pub sources: Vec<Arc<Unpacked>>,
    /// Per frame, its place among those that daylight lights.
    lit: Vec<Option<usize>>,
    knots: Vec<Knot>,
    /// Means of the light groups that are apart, in their order.
    lamps: Vec<[f32; 3]>,
}

/// Which frames light a tile: their number, and each one's place among them.
pub(crate) fn lit_frames(timeline: &Timeline, of: &Brightness) -> (usize, Vec<Option<usize>>) {
    let mut count = 0;
    let place = |frame| {
        let knot = of.knots.get(timeline.knot_of(frame)).copied().unwrap_or_default();
        (knot.mean != [0.0; 3]).then(|| {
            count += 1;
            count - 1
        })
    };
    let places = (0..timeline.hours.len()).map(place).collect();
    (count, places)
}

impl TilePlanes {
    /// Unpacks the sets of a tile of stored width and height, whose brightness is known.
    ///
    /// # Panics
    /// As [`Unpacked::new`].
    pub fn new(sets: &[PlaneSet], size: [usize; 2], timeline: &Timeline, brightness: &Brightness) -> Self {
        let (_, lit) = lit_frames(timeline, brightness);
        TilePlanes {
            size,
            sources: sets.iter().map(|set| Arc::new(Unpacked::new(set, size))).collect(),
            lit,
            knots: brightness.knots.clone(),
            lamps: brightness.lamps.iter().map(|lamp| lamp.mean).collect(),
        }
    }

    /// Bytes in memory, about.
    pub fn bytes(&self) -> usize {
        self.sources.iter().map(|source| source.bytes()).sum::<usize>() + size_of::<Knot>() * self.knots.len()
    }

    /// Its light at a time. `point`: of the times of what is not apart; `place_of`: the place of a light
    /// group among those that are apart; `weight`: how bright the group of each place is.
    pub fn at(
        &self,
        point: &TimePoint,
        place_of: impl Fn(u16) -> Option<usize>,
        weight: impl Fn(usize) -> f32,
    ) -> PlanesAt {
        let mut sources = Vec::new();
        for unpacked in &self.sources {
            let source = match unpacked.source.checked_sub(1) {
                None => self.daylight(unpacked, point),
                Some(group) => place_of(group).and_then(|place| {
                    let (weight, mean) = (weight(place), *self.lamps.get(place)?);
                    (weight > 0.0).then(|| Source {
                        unpacked: Arc::clone(unpacked),
                        factors: unpacked.factors(0, 0, 0.0),
                        means: mean.map(|mean| (mean * weight).min(f32::MAX)),
                    })
                }),
            };
            sources.extend(source);
        }
        PlanesAt { tier: Tier::detect(), width: self.size[0], sources }
    }

    /// Daylight between two frames; `None` where it is black.
    fn daylight(&self, unpacked: &Arc<Unpacked>, point: &TimePoint) -> Option<Source> {
        let [from, to] = point.knots.map(|knot| self.knots[knot].mean);
        let means = std::array::from_fn(|c| {
            ((1.0 - point.fraction) * f64::from(from[c]) + point.fraction * f64::from(to[c])) as f32
        });
        let (a, b) = match (self.lit[point.a], self.lit[point.b]) {
            (Some(a), Some(b)) => (a, b),
            // Next to a black frame light only fades.
            (Some(one), None) | (None, Some(one)) => (one, one),
            (None, None) => return None,
        };
        if means == [0.0; 3] {
            return None;
        }
        let of = |knot: usize| brightness(&self.knots[knot].mean);
        let share = point.share(of, |knot| f64::from(self.knots[knot].share));
        Some(Source { unpacked: Arc::clone(unpacked), factors: unpacked.factors(a, b, share as f32), means })
    }
}

/// The light of a tile's planes at one time.
#[derive(Clone, Debug)]
pub struct PlanesAt {
    tier: Tier,
    width: usize,
    /// The sources that are lit.
    pub sources: Vec<Source>,
}

impl PlanesAt {
    #[cfg(test)]
    pub(super) fn of(tier: Tier, width: usize, sources: Vec<Source>) -> Self {
        PlanesAt { tier, width, sources }
    }

    /// True if no source is lit.
    pub fn is_black(&self) -> bool {
        self.sources.is_empty()
    }

    /// All stored texels, row by row.
    pub fn decode_into(&self, out: &mut [[f32; 3]]) {
        decode(self.tier, &self.sources, self.width, out);
    }

    /// One stored texel, by the formulae.
    pub fn texel(&self, x: usize, y: usize) -> [f32; 3] {
        let mut sum = [0.0f32; 3];
        for source in &self.sources {
            let light = source.texel(x, y);
            (0..3).for_each(|c| sum[c] = (sum[c] + light[c]).min(f32::MAX));
        }
        sum
    }
}
