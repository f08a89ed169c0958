//! How wrong a bake really is: seeded texels, traced again by long paths to their end.
//!
//! Paths to the end have no bias; their own noise is known from two independent halves and taken out of the
//! difference. What is left of the difference beyond the noise that the bake itself reports is its bias.
//!
//! Measured by the mean light of all checked texels, a dim room beside a bright yard may lose most of its
//! light unseen. The difference is therefore also measured by each texel's own light, and summed over eighths
//! of the texels from the darkest to the brightest.

use crate::Rgb;
use crate::bake::cache::endless_light;
use crate::bake::errors::median;
use crate::bake::samples::{Stream, Worker};
use crate::bake::store::{Parts, Value};
use crate::trace::counts::RayCounts;
use dataset::host::signals::stop_if_interrupted;
use dataset::observe::Observer;
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;

/// Texels that are checked.
pub(super) const TEXELS: usize = 512;

/// What a check found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Check {
    /// Texels compared.
    pub texels: usize,
    /// Paths per texel of the reference.
    pub samples: u32,
    /// One entry per frame with light.
    pub frames: Vec<FrameCheck>,
}

/// A frame, over the checked texels; numbers are relative to their mean light where nothing else is said.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FrameCheck {
    /// Which frame.
    pub frame: usize,
    /// Root mean square difference from the reference, its noise taken out: the true error. `None` where the
    /// difference is no larger than that noise, so that nothing is known but that.
    pub measured_error: Option<f64>,
    /// Root mean square of the errors that the bake estimates for these texels.
    pub estimated_error: f64,
    /// What of the true error the estimate does not explain: √(true² − estimated²), 0 where that is negative.
    pub bias: f64,
    /// Mean difference, with its sign: light lost or gained.
    pub mean_difference: f64,
    /// Root mean square of the reference's own standard error.
    pub reference_noise: f64,
    /// Median over the texels of |difference| ÷ the texel's own reference light; the noise of the reference
    /// is in it.
    pub own_error: f64,
    /// Median over the texels of the reference's own standard error ÷ the texel's own reference light.
    pub own_reference_noise: f64,
    /// The texels by eighths, the darkest first; those in which the reference finds no light are left out.
    pub eighths: Vec<BrightnessEighth>,
    /// The errors by eighths, the darkest first.
    pub estimates: Vec<Estimate>,
}

/// The errors of an eighth of the checked texels, relative to its mean light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// 0 the darkest, 7 the brightest.
    pub rank: usize,
    /// Mean reference light.
    pub light: f64,
    /// Root mean square of the errors that the bake estimates.
    pub estimated: f64,
    /// Root mean square of the true ones, the reference's noise taken out; `None` where they are below that.
    pub measured: Option<f64>,
    /// Standard error of the ratio estimated ÷ measured, as a part of it; `None` like that.
    pub standard_error: Option<f64>,
}

impl Estimate {
    /// Estimated ÷ measured.
    pub fn ratio(&self) -> Option<f64> {
        self.measured.map(|measured| self.estimated / measured)
    }
}

/// An eighth of the checked texels: those of like brightness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BrightnessEighth {
    /// 0 the darkest, 7 the brightest.
    pub rank: usize,
    /// Mean reference light.
    pub light: f64,
    /// Mean difference ÷ mean reference light: light lost or gained.
    pub difference: f64,
    /// Its standard error.
    pub standard_error: f64,
}

/// Standard errors from which on a difference is taken for real: of 24 frames, eighth by eighth, chance alone
/// passes them once in thirty bakes or so (Student's t for 64 texels).
const SIGNIFICANT: f64 = 4.0;
/// Parts that the texels are sorted into by brightness.
const EIGHTHS: usize = 8;

impl BrightnessEighth {
    /// Such as `darkest eighth: −3.1 ± 0.4 %`.
    pub fn words(&self) -> String {
        let name = match self.rank {
            0 => "darkest eighth".to_owned(),
            7 => "brightest eighth".to_owned(),
            rank => format!("eighth {} of 8 from the darkest", rank + 1),
        };
        let sign = if self.difference < 0.0 { "−" } else { "+" };
        let percent = |v: f64| v.abs() * 100.0;
        format!("{name}: {sign}{:.1} ± {:.1} %", percent(self.difference), percent(self.standard_error))
    }
}

impl Check {
    /// The frame and eighth that lost or gained most, of those where chance does not explain it.
    pub fn worst_eighth(&self) -> Option<(usize, &BrightnessEighth)> {
        let beyond_chance = |s: &FrameCheck, e: &BrightnessEighth| (s.frame, beyond_chance(e, &s.eighths));
        let all = self.frames.iter().flat_map(|s| s.eighths.iter().map(move |e| (beyond_chance(s, e), e)));
        let worst = all.filter(|((_, beyond), _)| *beyond > 0.0).max_by(|(a, _), (b, _)| a.1.total_cmp(&b.1));
        worst.map(|((frame, _), eighth)| (frame, eighth))
    }
}

/// What of an eighth's difference is beyond chance. Texels of like brightness are alike noisy: an eighth that
/// happens to miss the few texels that hold most of the light scatters too little, so the scatter of those
/// beside it counts too.
fn beyond_chance(eighth: &BrightnessEighth, all: &[BrightnessEighth]) -> f64 {
    let beside = all.iter().filter(|other| other.rank.abs_diff(eighth.rank) <= 1);
    let noise = beside.map(|other| other.standard_error).fold(0.0, f64::max);
    eighth.difference.abs() - SIGNIFICANT * noise
}

/// One checked texel at one frame.
#[derive(Clone, Copy)]
struct Checked {
    /// Its light as baked.
    baked: DVec3,
    /// The squared error that the bake estimates for it, summed over the channels.
    estimated: f64,
    /// Both halves of the reference, independent of each other.
    halves: [DVec3; 2],
}

/// A texel to be checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// Its position among the covered texels, by which layers are read.
    pub position: usize,
    /// Its index on the page.
    pub index: u32,
}

/// Chooses [`TEXELS`] of the valid texels, each given with its light, by the seed: as many of every octave of
/// light, so that a dark room counts as much as the field around it.
///
/// All that are valid may be chosen, those too at which the bake found no light: that may be its error. Where
/// the reference finds none either they say nothing and do no harm, for errors are relative to the mean over
/// all of them, or to the light of an eighth. Texels that are not valid have no light to compare: they show
/// their neighbours'.
pub(crate) fn choose(valid: impl Iterator<Item = (Chosen, f32)>, seed: u64) -> Vec<Chosen> {
    /// Octaves that hold a smaller part of the texels count as one with the next brighter: creases, which
    /// nobody sees.
    const FEWEST: f64 = 0.005;
    #[derive(Default)]
    struct Octave {
        texels: usize,
        smallest: Vec<([u8; 32], Chosen)>,
    }
    impl Octave {
        fn keep(&mut self) {
            self.smallest.sort_unstable_by_key(|(hash, _)| *hash);
            self.smallest.truncate(TEXELS);
        }
    }
    // Of each octave those whose hashes are smallest; never many more are held than are wanted.
    let mut octaves: BTreeMap<i32, Octave> = BTreeMap::new();
    for (chosen, light) in valid {
        let hash = blake3::hash(&[seed.to_le_bytes(), u64::from(chosen.index).to_le_bytes()].concat());
        let octave =
            octaves.entry(if light > 0.0 { light.log2().floor() as i32 } else { i32::MIN }).or_default();
        octave.texels += 1;
        octave.smallest.push((*hash.as_bytes(), chosen));
        if octave.smallest.len() == 4 * TEXELS {
            octave.keep();
        }
    }
    let all: usize = octaves.values().map(|octave| octave.texels).sum();
    let (mut classes, mut left) = (Vec::new(), Octave::default());
    let last = octaves.len();
    for (k, octave) in octaves.into_values().enumerate() {
        left.texels += octave.texels;
        left.smallest.extend(octave.smallest);
        if left.texels as f64 >= FEWEST * all as f64 || k + 1 == last {
            left.keep();
            classes.push(std::mem::take(&mut left).smallest);
        }
    }
    let mut octaves = classes;
    // Those with few give what they have; the others share what is left.
    octaves.sort_by_key(Vec::len);
    let (mut chosen, count) = (Vec::with_capacity(TEXELS), octaves.len());
    for (k, octave) in octaves.into_iter().enumerate() {
        let share = (TEXELS - chosen.len()) / (count - k);
        chosen.extend(octave.into_iter().take(share).map(|(_, chosen)| chosen));
    }
    chosen
}

/// Checks the chosen texels. `layers` holds each layer's values in their order; `frames` are made of the
/// worker's layers.
pub(crate) fn check(
    worker: &Worker,
    chosen: &[Chosen],
    layers: &[Vec<Value>],
    frames: &[Parts],
    samples: u32,
    console: &dyn Observer,
) -> crate::Result<Check> {
    let progress = console.progress("checking", chosen.len() as u64);
    let checked: Vec<Vec<Checked>> = chosen
        .par_iter()
        .enumerate()
        .map(|(i, texel)| {
            stop_if_interrupted()?;
            let [a, b] = reference(worker, texel.index, samples)?;
            progress.advance(1);
            let of_frame = |parts: &Parts| {
                let sum = |value: &dyn Fn(usize) -> Rgb| {
                    parts.iter().map(|&(l, s)| value(l) * s).sum::<Rgb>().as_dvec3()
                };
                let baked =
                    parts.iter().fold(Value::default(), |sum, &(l, s)| sum.plus(layers[l][i].times(s)));
                Checked {
                    baked: baked.mean.as_dvec3(),
                    estimated: baked.variance() + baked.squared_bias(),
                    halves: [sum(&|l| a[l]), sum(&|l| b[l])],
                }
            };
            Ok(frames.iter().map(of_frame).collect())
        })
        .collect::<crate::Result<_>>()?;
    let summary = (0..frames.len()).filter_map(|frame| {
        let texels: Vec<Checked> = checked.iter().map(|frames| frames[frame]).collect();
        summary(frame, &texels)
    });
    Ok(Check { texels: checked.len(), samples, frames: summary.collect() })
}

/// Sums up the checked texels of a frame; `None` without light.
fn summary(frame: usize, texels: &[Checked]) -> Option<FrameCheck> {
    let n = (3 * texels.len().max(1)) as f64;
    let total = |f: &dyn Fn(&Checked) -> f64| texels.iter().map(f).sum::<f64>() / n;
    let light = |t: &Checked| (t.halves[0] + t.halves[1]) * 0.5;
    let noise = |t: &Checked| (t.halves[0] - t.halves[1]) * 0.5;
    let difference = |t: &Checked| t.baked - light(t);
    let mean = total(&|t| light(t).element_sum());
    if mean <= 0.0 {
        return None;
    }
    let reference2 = total(&|t| noise(t).length_squared());
    let true2 = total(&|t| difference(t).length_squared()) - reference2;
    let estimated2 = total(&|t| t.estimated).max(0.0);
    // (Where the reference is black, anything else is wrong by the whole.)
    let own = |f: &dyn Fn(&Checked) -> DVec3| {
        let ratio = |t: &Checked| match (f(t).length(), light(t).length()) {
            (value, 0.0) => f64::from(u8::from(value > 0.0)),
            (value, light) => value / light,
        };
        let mut ratios: Vec<f64> = texels.iter().map(ratio).collect();
        ratios.sort_by(f64::total_cmp);
        median(&ratios)
    };
    Some(FrameCheck {
        frame,
        measured_error: (true2 > 0.0).then(|| true2.sqrt() / mean),
        estimated_error: estimated2.sqrt() / mean,
        bias: (true2 - estimated2).max(0.0).sqrt() / mean,
        mean_difference: total(&|t| difference(t).element_sum()) / mean,
        reference_noise: reference2.sqrt() / mean,
        own_error: own(&difference),
        own_reference_noise: own(&noise),
        eighths: eighths(texels),
        estimates: estimates(texels),
    })
}

/// Errors as estimated and as they are, by eighths. (Sorted by what was baked, the darkest would be those
/// that missed the light, and with it their own error.)
fn estimates(texels: &[Checked]) -> Vec<Estimate> {
    let sorted = sorted(texels);
    let eighth = |rank: usize| {
        let texels: Vec<(&Checked, usize)> = [0, 1]
            .into_iter()
            .flat_map(|half| sorted[half][bounds(rank, texels.len())].iter().map(move |t| (*t, 1 - half)))
            .collect();
        let n = texels.len() as f64;
        // (Both halves hold much the same texels: as many say as much as one half of them.)
        let moments = |f: &dyn Fn(&Checked, usize) -> f64| {
            let mean = texels.iter().map(|(t, half)| f(t, *half)).sum::<f64>() / n;
            let scatter = texels.iter().map(|(t, half)| (f(t, *half) - mean).powi(2)).sum::<f64>();
            (mean, (scatter / (n * (n / 2.0 - 1.0))).sqrt())
        };
        let light = texels.iter().map(|(t, half)| t.halves[*half].element_sum()).sum::<f64>() / n / 3.0;
        if texels.len() < 4 || light <= 0.0 {
            return None;
        }
        let (estimated, estimated_error) = moments(&|t, _| t.estimated / 3.0);
        let noise = |t: &Checked| (t.halves[0] - t.halves[1]).length_squared() / 2.0;
        let (measured, measured_error) =
            moments(&|t, half| ((t.baked - t.halves[half]).length_squared() - noise(t)) / 3.0);
        // (Of a square root half of the part.)
        let part = |value: f64, error: f64| if value > 0.0 { error / value / 2.0 } else { 0.0 };
        let is_known = measured > 2.0 * measured_error;
        Some(Estimate {
            rank,
            light,
            estimated: estimated.max(0.0).sqrt() / light,
            measured: is_known.then(|| measured.sqrt() / light),
            standard_error: is_known
                .then(|| part(estimated, estimated_error).hypot(part(measured, measured_error))),
        })
    };
    (0..EIGHTHS).filter_map(eighth).collect()
}

/// The texels by the brightness of each half of the reference, the darkest first.
fn sorted(texels: &[Checked]) -> [Vec<&Checked>; 2] {
    [0, 1].map(|half: usize| {
        let mut sorted: Vec<&Checked> = texels.iter().collect();
        let brightness = |t: &Checked| t.halves[half].element_sum();
        sorted.sort_by(|a, b| brightness(a).total_cmp(&brightness(b)));
        sorted
    })
}

/// The places of an eighth among sorted texels.
fn bounds(rank: usize, texels: usize) -> Range<usize> {
    rank * texels / EIGHTHS..(rank + 1) * texels / EIGHTHS
}

/// The texels sorted by brightness and cut into eighths. Sorted and compared by the same noisy light, the
/// darkest would be those whose reference came out too dark; so one half of the reference sorts and the other
/// compares, and the other way round.
fn eighths(texels: &[Checked]) -> Vec<BrightnessEighth> {
    let sorted = sorted(texels);
    let eighth = |rank: usize| {
        let [a, b] = [0, 1].map(|half: usize| {
            let pairs = sorted[half][bounds(rank, texels.len())].iter();
            ratio(pairs.map(|t| (t.baked.element_sum() / 3.0, t.halves[1 - half].element_sum() / 3.0)))
        });
        let ((light_a, a, error_a), (light_b, b, error_b)) = (a?, b?);
        Some(BrightnessEighth {
            rank,
            light: (light_a + light_b) / 2.0,
            difference: (a + b) / 2.0,
            // (Both hold much the same texels: taken as if they were the same.)
            standard_error: ((error_a * error_a + error_b * error_b) / 2.0).sqrt(),
        })
    };
    (0..EIGHTHS).filter_map(eighth).collect()
}

/// Of pairs (baked, reference): the mean reference light, Σ baked ÷ Σ reference − 1, and the standard error
/// of that, from the scatter about it (the ratio estimator of sampling theory); too small where few texels
/// hold most of the light. `None` without light or scatter to judge by.
fn ratio(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> Option<(f64, f64, f64)> {
    let (mut n, mut baked, mut light) = (0.0, 0.0, 0.0);
    for (b, l) in pairs.clone() {
        (n, baked, light) = (n + 1.0, baked + b, light + l);
    }
    if n < 2.0 || light <= 0.0 {
        return None;
    }
    let ratio = baked / light;
    let scatter: f64 = pairs.map(|(b, l)| (b - ratio * l).powi(2)).sum();
    Some((light / n, ratio - 1.0, (scatter * n / (n - 1.0)).sqrt() / light))
}

/// Both halves of a texel's light in every layer, by paths to their end.
fn reference(worker: &Worker, index: u32, samples: u32) -> crate::Result<[Vec<Rgb>; 2]> {
    let [width, _] = worker.receivers.size();
    let (x, y) = (index as usize % width, index as usize / width);
    let receivers = worker.block(worker.receivers.block_of(x, y));
    let texel = (y - receivers.y0) * receivers.width + x - receivers.x0;
    let lights = worker.transport.lights;
    let mut counts = RayCounts::default();
    let points = worker.surface_points(&receivers, texel, &mut counts);
    let halves = [0, 1].map(|half| {
        let sequence = worker.sequence(&receivers, texel, Stream::Check, half);
        let mut sums = vec![Rgb::ZERO; lights.layers()];
        let (mut direct, mut hit_light) = (sums.clone(), vec![Rgb::ZERO; lights.hit_lights()]);
        let mut taken = 0u32;
        for i in 0..samples / 2 {
            let sample = sequence.sample(i);
            let Some(at) = worker.receiver(&receivers, texel, sample, points, &mut counts) else { continue };
            taken += 1;
            worker.transport.add_direct(&at, Rgb::ONE, sample, 0, &mut direct, &mut counts);
            worker.trace_path(&at, sample, None, &mut sums, &mut hit_light, &mut counts);
        }
        lights.add_held(&direct, &hit_light, &mut sums);
        sums.iter_mut().for_each(|s| *s /= taken.max(1) as f32);
        sums
    });
    if counts.endless > 0 { Err(endless_light::error(worker.transport.space.geometry)) } else { Ok(halves) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::paths::{Sequence, SequenceKind};

    /// Numbers of mean 0 and variance 1, about normal: the sum of twelve even ones less 6.
    struct Noise {
        seed: u64,
        drawn: u32,
    }

    impl Noise {
        fn next(&mut self) -> f64 {
            self.drawn += 1;
            let sample = Sequence::new(self.seed, SequenceKind::Texel, self.drawn, 0).sample(0);
            (0..12).map(|d| f64::from(sample.number(d))).sum::<f64>() - 6.0
        }
    }

    /// A bake of 512 texels: three quarters a yard of light about 100, the rest a room of light about 1, of
    /// which the bake found the part `kept`. A tenth of noise in the bake, a fifth in each half of the
    /// reference.
    fn bake(seed: u64, kept: f64, room: f64) -> Vec<Checked> {
        bake_checked_to(0.2, seed, kept, room)
    }

    /// The same, by a reference of that noise in each half.
    fn bake_checked_to(reference: f64, seed: u64, kept: f64, room: f64) -> Vec<Checked> {
        let mut noise = Noise { seed, drawn: 0 };
        let texel = |i: usize| {
            let is_room = i.is_multiple_of(4);
            let light = if is_room { room } else { 100.0 } * (1.0 + (i % 7) as f64 * 0.05);
            let kept = if is_room { kept } else { 1.0 };
            let half = |n: f64| DVec3::splat(light * (1.0 + reference * n));
            Checked {
                baked: DVec3::splat(light * kept * (1.0 + 0.1 * noise.next())),
                estimated: 3.0 * (light * kept * 0.1).powi(2),
                halves: [half(noise.next()), half(noise.next())],
            }
        };
        (0..TEXELS).map(texel).collect()
    }

    #[test]
    fn texels_are_chosen_by_their_hashes_as_many_of_each_octave() {
        let hash = |seed: u64, index: u32| {
            *blake3::hash(&[seed.to_le_bytes(), u64::from(index).to_le_bytes()].concat()).as_bytes()
        };
        let texel = |position: usize| Chosen { position, index: 3 * position as u32 };
        // Every third texel of a page is covered, every second of these valid; all alike.
        let valid = || (0..40_000usize).step_by(2).map(|position| (texel(position), 1.5));
        for seed in [1, 2] {
            let mut expected: Vec<u32> = valid().map(|(chosen, _)| chosen.index).collect();
            expected.sort_by_key(|&index| hash(seed, index));
            let chosen = choose(valid(), seed);
            assert!(chosen.iter().all(|c| c.index == 3 * c.position as u32));
            let indices: Vec<u32> = chosen.iter().map(|c| c.index).collect();
            assert_eq!(indices, expected[..TEXELS]);
        }
        assert_eq!(choose(valid().take(7), 1).len(), 7);
        // A field, a room of one texel in forty, and five texels without light, which count as the room's.
        let light = |position: usize| if position.is_multiple_of(40) { 1e-3 } else { 1.0 };
        let house =
            (0..40_000).map(|position| (texel(position), if position < 5 { 0.0 } else { light(position) }));
        let chosen = choose(house, 1);
        let dark = chosen.iter().filter(|c| c.position < 5 || c.position.is_multiple_of(40)).count();
        assert_eq!((dark, chosen.len()), (TEXELS / 2, TEXELS));
    }

    #[test]
    fn errors_are_told_as_they_are_by_eighths() {
        // All eighths of twenty bakes: the ratio is 1 on average, and within its own bounds as often as it
        // should.
        let (mut ratios, mut beyond) = (Vec::new(), 0);
        for seed in 1..=20 {
            for estimate in estimates(&bake_checked_to(0.05, seed, 1.0, 1.0)) {
                let (Some(ratio), Some(error)) = (estimate.ratio(), estimate.standard_error) else {
                    continue;
                };
                ratios.push(ratio.ln());
                beyond += usize::from((ratio.ln() / error).abs() > 2.0);
            }
        }
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        assert!(ratios.len() > 150 && mean.abs() < 0.06, "{} {mean}", ratios.len());
        assert!(beyond < ratios.len() / 6, "{beyond} of {}", ratios.len());
        // Half of the room's light lost: there alone the truth is far above the estimate.
        let estimates = estimates(&bake_checked_to(0.05, 1, 0.5, 1.0));
        assert!(estimates[0].ratio().is_some_and(|ratio| ratio < 0.2), "{estimates:?}");
        assert!(estimates[7].ratio().is_some_and(|ratio| (0.5..2.0).contains(&ratio)), "{estimates:?}");
    }

    fn check_of(texels: &[Checked]) -> Check {
        Check { texels: texels.len(), samples: 2, frames: summary(0, texels).into_iter().collect() }
    }

    #[test]
    fn a_damaged_dim_room_is_seen_though_the_page_hardly_changes() {
        let (whole, damaged) = (check_of(&bake(1, 1.0, 1.0)), check_of(&bake(1, 0.5, 1.0)));
        // Relative to the page, half the room's light is nothing.
        let measured_error = |check: &Check| check.frames[0].measured_error.expect("more than noise");
        assert!((measured_error(&damaged) - measured_error(&whole)).abs() < 0.002);
        assert!(damaged.frames[0].mean_difference.abs() < 0.02);
        // The two darkest eighths are the room.
        for eighth in &damaged.frames[0].eighths[..2] {
            assert!((eighth.difference + 0.5).abs() < 4.0 * eighth.standard_error, "{eighth:?}");
            assert!(eighth.standard_error < 0.03 && (eighth.light / 1.15 - 1.0).abs() < 0.2, "{eighth:?}");
        }
        let (frame, worst) = damaged.worst_eighth().expect("a worst eighth");
        assert!(frame == 0 && worst.rank < 2, "{worst:?}");
    }

    #[test]
    fn a_sound_bake_has_no_worst_eighth() {
        // Also where all texels are alike, so that their noise alone sorts the reference's halves.
        for seed in 1..=20 {
            for room in [1.0, 100.0] {
                let check = check_of(&bake(seed, 1.0, room));
                assert_eq!(check.worst_eighth(), None, "{:?}", check.frames[0].eighths);
            }
        }
    }

    #[test]
    fn a_texels_own_error_is_a_part_of_its_own_light() {
        // Medians of |normal| are 0.674 of its deviation: difference √(0.1² + 0.2² ÷ 2), reference 0.2 ÷ √2.
        let frame = &check_of(&bake(1, 1.0, 1.0)).frames[0];
        assert!((frame.own_error / (0.674 * 0.03f64.sqrt()) - 1.0).abs() < 0.15, "{}", frame.own_error);
        let noise = frame.own_reference_noise / (0.674 * 0.02f64.sqrt());
        assert!((noise - 1.0).abs() < 0.15, "{noise}");
        // All light lost everywhere: wrong by the whole of it.
        let mut black = bake(1, 1.0, 1.0);
        black.iter_mut().for_each(|t| t.baked = DVec3::ZERO);
        let frame = &check_of(&black).frames[0];
        assert_eq!(frame.own_error, 1.0);
        assert!(frame.eighths.iter().all(|e| e.difference == -1.0));
    }

    #[test]
    fn without_light_or_texels_there_is_nothing_to_sum_up() {
        assert!(summary(0, &[]).is_none());
        let black = Checked { baked: DVec3::ONE, estimated: 0.0, halves: [DVec3::ZERO; 2] };
        assert!(summary(0, &[black; 16]).is_none());
        // Three texels of sixteen have light: eighths without are left out, and every number is finite.
        let mut texels = [black; 16];
        texels[..3].iter_mut().for_each(|t| t.halves = [DVec3::ONE; 2]);
        let frame = summary(0, &texels).expect("light");
        assert!(frame.own_error.is_finite() && frame.eighths.iter().all(|e| e.rank >= 6), "{frame:?}");
        serde_json::to_string(&frame).unwrap();
    }

    #[test]
    fn noise_that_a_few_texels_hold_is_no_loss() {
        // One texel of the room in 32 holds 32 times its light, the others none: right on average. By its own
        // scatter alone an eighth would be called dark in a tenth of such bakes.
        let false_alarms = (1..=100).filter(|&seed| {
            let mut texels = bake(seed, 1.0, 1.0);
            for (i, texel) in texels.iter_mut().enumerate().filter(|(i, _)| i.is_multiple_of(4)) {
                let sample = Sequence::new(seed, SequenceKind::Patch, i as u32, 0).sample(0);
                texel.baked *= if sample.number(0) < 1.0 / 32.0 { 32.0 } else { 0.0 };
            }
            check_of(&texels).worst_eighth().is_some()
        });
        assert!(false_alarms.count() <= 4);
    }

    #[test]
    fn words() {
        let eighth =
            |rank, difference| BrightnessEighth { rank, light: 1.0, difference, standard_error: 0.004 };
        assert_eq!(eighth(0, -0.031).words(), "darkest eighth: −3.1 ± 0.4 %");
        assert_eq!(eighth(7, 0.02).words(), "brightest eighth: +2.0 ± 0.4 %");
        assert_eq!(eighth(2, 0.02).words(), "eighth 3 of 8 from the darkest: +2.0 ± 0.4 %");
    }
}
