//! Survey of a tile's light before its maps are chosen: its scales, which frames look alike, which gates
//! switch it.

use crate::bundle::rounded_means;
use crate::model::{MOST_GATES, gate};
use crate::tile::{Coverage, TileSource};
use crate::time::{Axis, Coding};

/// A frame's channel is divided by at least this share of its largest texel, so that no ratio to the mean
/// exceeds 1 / share.
pub(crate) const LEAST_MEAN_OF_PEAK: f64 = 0.01;
/// A channel is divided by at least this share of the frame's strongest channel.
const LEAST_MEAN_OF_CHANNELS: f64 = 0.003;
/// Frames share a place on the time axis where their outputs (about 1 in the mean) differ by at most this
/// (RMS): 0.2 % in light.
const ALIKE: f64 = 1e-3;
/// And in no texel by more than this share of its own output: 2 % of its light, however dim beside the tile's
/// brightest.
const ALIKE_ANYWHERE: f64 = 0.01;

/// The light of a tile, surveyed.
#[derive(Clone, Debug)]
pub(crate) struct Light {
    pub valid: Vec<usize>,
    pub gutter: Vec<usize>,
    /// Per frame: what each channel is divided by, zero where black.
    pub means: Vec<[f32; 3]>,
    /// Per frame: the largest valid value.
    pub peaks: Vec<f32>,
    /// The time axis; empty under the paper's coding.
    pub axis: Axis,
    /// Number of frames that look different; the number of frames under the paper's coding.
    pub distinct: usize,
    /// The light groups that are gates, ascending.
    pub gates: Vec<u16>,
    /// Per frame: the gates' inputs.
    pub gate_inputs: Vec<Vec<f32>>,
    /// Gates beyond the format's limit.
    pub gates_omitted: usize,
}

impl Light {
    /// Surveys a tile.
    pub(crate) fn new(source: &TileSource, coding: Coding) -> Self {
        let of = |coverage| (0..source.coverage.len()).filter(move |&i| source.coverage[i] == coverage);
        let valid: Vec<usize> = of(Coverage::Valid).collect();
        let (means, peaks): (Vec<[f32; 3]>, Vec<_>) =
            source.frames.iter().map(|light| scales(light, &valid)).unzip();
        // As they are stored, so that what rounding does is trained away.
        let means = rounded_means(&means).unwrap_or(means);
        let (axis, distinct) = match coding {
            Coding::Standard => axis(source, &valid, &means),
            Coding::Paper => (Axis::default(), source.frames.len()),
        };
        let lit: Vec<usize> = (0..peaks.len()).filter(|&k| peaks[k] > 0.0).collect();
        let mut gates: Vec<usize> = Vec::new();
        // On one place all frames look alike, whatever is on.
        if coding == Coding::Standard && distinct > 1 {
            for (i, candidate) in source.gates.iter().enumerate() {
                let is_new = |&g: &usize| {
                    let same = |k: &&usize| source.gates[g].on[**k] == candidate.on[**k];
                    !matches!(lit.iter().filter(same).count(), n if n == 0 || n == lit.len())
                };
                let switches = lit.iter().any(|&k| candidate.on[k] != candidate.on[lit[0]]);
                if switches && gates.iter().all(is_new) {
                    gates.push(i);
                }
            }
        }
        let gates_omitted = gates.len().saturating_sub(MOST_GATES);
        gates.truncate(MOST_GATES);
        let inputs = |k: usize| gates.iter().map(|&g| gate(source.gates[g].on[k])).collect();
        Light {
            gutter: of(Coverage::Gutter).collect(),
            gate_inputs: (0..peaks.len()).map(inputs).collect(),
            gates: gates.iter().map(|&g| source.gates[g].group).collect(),
            valid,
            means,
            peaks,
            axis,
            distinct,
            gates_omitted,
        }
    }

    /// Frames that are not black.
    pub(crate) fn lit(&self) -> usize {
        self.peaks.iter().filter(|peak| **peak > 0.0).count()
    }
}

/// The value each channel of a frame is divided by, and the frame's largest value. Both over valid texels.
fn scales(light: &[[f32; 3]], valid: &[usize]) -> ([f32; 3], f32) {
    let (mut sum, mut peak) = ([0.0f64; 3], [0.0f64; 3]);
    for &i in valid {
        for c in 0..3 {
            sum[c] += f64::from(light[i][c]);
            peak[c] = peak[c].max(f64::from(light[i][c]));
        }
    }
    let mean = sum.map(|s| s / valid.len().max(1) as f64);
    let strongest = mean.iter().fold(0.0f64, |a, &b| a.max(b));
    let scale = |c: usize| match peak[c] {
        0.0 => 0.0,
        peak => mean[c].max(LEAST_MEAN_OF_PEAK * peak).max(LEAST_MEAN_OF_CHANNELS * strongest) as f32,
    };
    ([scale(0), scale(1), scale(2)], peak.iter().fold(0.0f64, |a, &b| a.max(b)) as f32)
}

/// Places from a frame to the next at the largest difference of a tile. They go by the difference's root:
/// less even than all the same, which spends slices on hours at which little happens, and more than in
/// proportion, which leaves small changes no room.
const FINEST: f64 = 8.0;
/// The share of a difference across a switch that counts: gates tell the rest.
const SWITCHED: f64 = 0.3;

/// The time axis, and how many frames have light and look different. A frame has the place of an earlier one
/// where all since look like that, means apart; the more it differs, the farther it stands. Around midnight
/// likewise. Black frames have the place before: it is never looked at, as a time point beside a black frame
/// has the time of the lit one.
fn axis(source: &TileSource, valid: &[usize], means: &[[f32; 3]]) -> (Axis, usize) {
    let output = |k: usize, i: usize, c: usize| match means[k][c] {
        0.0 => 0.0,
        mean => Coding::Standard.output(f64::from(source.frames[k][i][c]) / f64::from(mean)),
    };
    // RMS over texels and channels, and whether two frames look alike.
    let compare = |a: usize, b: usize| {
        let (mut sum, mut alike) = (0.0, true);
        for &i in valid {
            for c in 0..3 {
                let (a, b) = (output(a, i, c), output(b, i, c));
                sum += (a - b) * (a - b);
                alike &= (a - b).abs() <= ALIKE_ANYWHERE * a.max(b);
            }
        }
        let rms = (sum / (3 * valid.len()) as f64).sqrt();
        (rms, alike && rms <= ALIKE)
    };
    // Of a difference that a gate tells, a part counts.
    let share = |a: usize, b: usize| match source.gates.iter().any(|gate| gate.on[a] != gate.on[b]) {
        true => SWITCHED,
        false => 1.0,
    };
    // Runs of frames that look like their first, and how far it is from the run before; the last may continue
    // in the first.
    let lit: Vec<usize> = (0..means.len()).filter(|&k| means[k] != [0.0; 3]).collect();
    let mut firsts: Vec<(usize, f64)> = Vec::new();
    for &k in &lit {
        let (far, alike) = firsts.last().map_or((0.0, false), |&(first, _)| compare(first, k));
        if !alike {
            let before = lit[lit.partition_point(|&l| l < k).saturating_sub(1)];
            firsts.push((k, far * share(before, k)));
        }
    }
    let closes =
        firsts.len() > 1 && firsts.last().zip(firsts.first()).is_some_and(|(a, b)| compare(a.0, b.0).1);
    let largest = firsts.iter().map(|(_, far)| *far).fold(1e-9, f64::max);
    let step = |far: f64| (FINEST * (far / largest).min(1.0).sqrt()).round().max(1.0) as u16;
    let mut axis = Axis { length: 1, places: vec![0; means.len()] };
    for (run, &(first, far)) in firsts.iter().enumerate() {
        let place = if run > 0 { (axis.length - 1).saturating_add(step(far)).min(u16::MAX - 1) } else { 0 };
        axis.places[first..].fill(place);
        axis.length = place + 1;
    }
    // Around midnight: from the last run to the first, which may be one.
    if closes && let Some(&(first, _)) = firsts.last() {
        axis.places[first..].fill(0);
        axis.length -= 1;
    } else if let [first, .., last] = firsts[..] {
        let far = compare(last.0, first.0).0 * share(last.0, first.0);
        axis.length = axis.length.saturating_add(step(far) - 1);
    }
    let runs = firsts.len() - usize::from(closes);
    (axis, runs.max(1))
}
