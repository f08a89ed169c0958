//! A whole tile: its light surveyed, its sources transformed, and encoded at a step.

use super::{Fitted, Quantiser, SourceLight};
use crate::bundle::{Header, encode_brightness, rounded_brightness};
use crate::law::Law;
use crate::model::{Brightness, Knot, Section};
use crate::planes::{PlaneSet, TilePlanes, encode_section};
use crate::tile::{Band, Coverage, Gate, TileSource};
use crate::time::Timeline;
use crate::train::TrialFit;

/// A frame whose light is this part of its peak counts this power of it: errors in the dark are seen.
const DARK: f64 = 0.25;
/// Colour differences count this over 16 as much as luminance.
const CHROMA: u8 = 24;
/// Components of less variance than this part of a step's own error are left out.
const CUT: f64 = 0.3;
/// Error, in squared steps, that a bit is worth.
const LAMBDA: f32 = 0.12;

/// A tile's light, surveyed and transformed.
#[derive(Debug)]
pub struct FittedTile {
    source: TileSource,
    /// Light groups that are apart: the place of each among all of those, when it is on, its light.
    lamps: Vec<(usize, Gate, Vec<[f32; 3]>)>,
    /// Per frame, the largest value of all its light on a valid texel.
    peaks: Vec<f32>,
    /// As it is stored.
    pub brightness: Brightness,
    fitted: Vec<Fitted>,
    timeline: Timeline,
}

/// A tile, encoded.
#[derive(Clone, Debug)]
pub struct BasisTile {
    /// Its section; empty for a black tile.
    pub section: Section,
    /// Mean PSNR of the lit frames in dB over the valid texels, peaks with the sun's direct light.
    pub psnr_db: Option<f64>,
    /// See [`TrialFit::error`] and [`TrialFit::terms`].
    pub error: (f64, u64),
}

/// Mean and largest value of some light over the valid texels.
fn knot(light: &[[f32; 3]], coverage: &[Coverage]) -> Knot {
    let (mut sum, mut peak, mut count) = ([0.0f64; 3], 0.0f32, 0.0);
    for (texel, _) in light.iter().zip(coverage).filter(|(_, coverage)| **coverage == Coverage::Valid) {
        (0..3).for_each(|c| sum[c] += f64::from(texel[c]));
        peak = texel.iter().fold(peak, |peak, value| peak.max(*value));
        count += 1.0;
    }
    let mean = sum.map(|sum| if count > 0.0 { (sum / count) as f32 } else { 0.0 });
    Knot { mean, peak, share: 0.0 }
}

impl FittedTile {
    /// Of the tile in a column of a band, for a bundle with this header.
    ///
    /// # Errors
    /// A message for light that no bundle holds.
    pub fn new(band: &Band, column: usize, law: &Law, header: &Header) -> Result<Self, String> {
        let (source, all_lamps) = (band.tile(column), band.lamps(column));
        let coverage = &source.coverage;
        let mut peaks = band.peaks(column);
        let of_frames: Vec<Knot> = source.frames.iter().map(|frame| knot(frame, coverage)).collect();
        if peaks.is_empty() {
            peaks = of_frames.iter().map(|knot| knot.peak).collect();
        }
        let timeline = header.maps_timeline();
        let knots = law.knots(&timeline, &of_frames, band.shares(column));
        let mut lamps = vec![Knot::default(); header.lamps()];
        let mut of_groups = Vec::new();
        for (gate, light) in all_lamps {
            if let Some(at) = header.lamp(usize::from(gate.group)) {
                lamps[at] = knot(&light, coverage);
                of_groups.push((at, gate, light));
            }
        }
        let brightness = rounded_brightness(&Brightness { knots, lamps })?;
        let mut tile =
            FittedTile { source, lamps: of_groups, peaks, brightness, fitted: Vec::new(), timeline };
        tile.fit();
        Ok(tile)
    }

    fn fit(&mut self) {
        let size = [self.source.width, self.source.height];
        let coverage = &self.source.coverage;
        let weight = |mean: [f32; 3], frame: usize| {
            let grey = f64::from(mean[0]) + f64::from(mean[1]) + f64::from(mean[2]);
            match f64::from(self.peaks[frame]) {
                peak if peak > 0.0 => (grey / 3.0 / peak).min(1.0).powf(DARK),
                _ => 1.0,
            }
        };
        let mean_of = |frame: usize| self.brightness.knots[self.timeline.knot_of(frame)].mean;
        let lit: Vec<usize> =
            (0..self.source.frames.len()).filter(|frame| mean_of(*frame) != [0.0; 3]).collect();
        let mut fitted = Vec::new();
        let mut add = |source, frames: &[&[[f32; 3]]], means: &[[f32; 3]], weights: &[f64]| {
            let light = SourceLight { source, frames, means, weights };
            fitted.push(Fitted::new(&light, coverage, size, CHROMA));
        };
        if !lit.is_empty() {
            let frames: Vec<&[[f32; 3]]> = lit.iter().map(|&k| &self.source.frames[k][..]).collect();
            let means: Vec<[f32; 3]> = lit.iter().map(|&k| mean_of(k)).collect();
            let weights: Vec<f64> = lit.iter().map(|&k| weight(mean_of(k), k)).collect();
            add(0, &frames, &means, &weights);
        }
        for (at, gate, light) in &self.lamps {
            let mean = self.brightness.lamps[*at].mean;
            if mean != [0.0; 3] {
                let square: f64 =
                    (0..gate.on.len()).filter(|&k| gate.on[k]).map(|k| weight(mean, k).powi(2)).sum();
                add(gate.group + 1, &[light], &[mean], &[square.sqrt()]);
            }
        }
        self.fitted = fitted;
    }

    /// Encodes it at a step of 2^(−step/8).
    ///
    /// # Errors
    /// A message for what no section holds.
    pub fn encoded(&self, step: u8) -> Result<BasisTile, String> {
        let quantiser = Quantiser { step, cut: CUT, lambda: LAMBDA };
        let sets: Vec<(PlaneSet, Vec<u8>)> =
            self.fitted.iter().map(|fitted| fitted.quantised(&quantiser)).collect();
        if sets.is_empty() {
            return Ok(BasisTile { section: Section::default(), psnr_db: None, error: (0.0, 0) });
        }
        let section = encode_section(&sets)?;
        let sets: Vec<PlaneSet> = sets.into_iter().map(|(set, _)| set).collect();
        let (psnr_db, error) = self.errors(&sets);
        Ok(BasisTile { section, psnr_db, error })
    }

    /// Errors of what sets decode to, at all frames.
    fn errors(&self, sets: &[PlaneSet]) -> (Option<f64>, (f64, u64)) {
        let TileSource { width, height, frames, coverage, .. } = &self.source;
        let planes = TilePlanes::new(sets, [*width, *height], &self.timeline, &self.brightness);
        let valid: Vec<usize> = (0..coverage.len()).filter(|&i| coverage[i] == Coverage::Valid).collect();
        let (mut decibels, mut lit, mut error, mut terms) = (0.0, 0, 0.0, 0);
        let mut out = vec![[0.0; 3]; width * height];
        for (k, frame) in frames.iter().enumerate() {
            let peak = f64::from(self.peaks[k]);
            if peak <= 0.0 {
                continue;
            }
            let of_group = |group: u16| self.lamps.iter().find(|(_, gate, _)| gate.group == group);
            let place = |group: u16| of_group(group).map(|(at, ..)| *at);
            let is_on = |place: usize| self.lamps.iter().any(|(at, gate, _)| *at == place && gate.on[k]);
            let weight = |place: usize| f32::from(u8::from(is_on(place)));
            planes.at(&self.timeline.hold(k), place, weight).decode_into(&mut out);
            let mut sum = 0.0;
            for &i in &valid {
                for c in 0..3 {
                    let on = self.lamps.iter().filter(|(_, gate, _)| gate.on[k]);
                    let of_lamps: f64 = on.map(|(.., light)| f64::from(light[i][c])).sum();
                    let wanted = f64::from(frame[i][c]) + of_lamps;
                    sum += (f64::from(out[i][c]) - wanted).powi(2);
                }
            }
            let relative = sum / 3.0 / (peak * peak);
            error += relative;
            terms += valid.len() as u64;
            decibels += -10.0 * (relative / valid.len() as f64).max(1e-10).log10();
            lit += 1;
        }
        ((lit > 0).then(|| decibels / f64::from(lit)), (error, terms))
    }

    /// What it takes at some steps; nothing for a black tile.
    ///
    /// # Errors
    /// As [`FittedTile::encoded`].
    pub fn trials(&self, steps: &[u8]) -> Result<Vec<TrialFit>, String> {
        if self.fitted.is_empty() {
            return Ok(Vec::new());
        }
        let resident = encode_brightness(&self.brightness)?.len();
        let trial = |step: &u8| {
            let tile = self.encoded(*step)?;
            let (error, terms) = tile.error;
            let bytes = (tile.section.bytes.len() + resident) as u64;
            Ok(TrialFit { word: u32::from(*step), bytes, error, terms })
        };
        steps.iter().map(trial).collect()
    }
}
