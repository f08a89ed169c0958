//! What the training of one tile is given: its samples' targets and weights, and where each sample reads the
//! maps.

use super::features::in_blocks;
use super::light::{LEAST_MEAN_OF_PEAK, Light};
use crate::lanes::Quad;
use crate::model::{BORDER, Knot, STORED, Shape};
use crate::tile::{Coverage, TileSource};
use crate::time::{self, Axis, Coding};
use crate::train::Coded;

/// An epoch of training visits one of this many gutter texels.
pub(crate) const GUTTER_SHARE: usize = 5;
/// Weight of a gutter texel in the loss; most valid ones have 1.
pub(crate) const GUTTER_WEIGHT: f32 = 0.1;
/// Weight of a texel beside another tile's. Errors are smooth inside a tile and another's beyond its border,
/// which shows them.
pub(crate) const EDGE_WEIGHT: f32 = 6.0;
/// By how much more such a texel counts where blocks are chosen.
pub(crate) const EDGE_IN_BLOCKS: f32 = 2.0;

/// Two neighbouring texels of a map along one axis: offsets, and the weight of the second.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pair {
    /// Texel (or offset) of weight 1 − f, and of weight f.
    pub at: [usize; 2],
    /// f
    pub f: f32,
}

impl Pair {
    /// Both with their weights.
    #[inline(always)]
    pub(crate) fn ends(&self) -> [(usize, f32); 2] {
        [(self.at[0], 1.0 - self.f), (self.at[1], self.f)]
    }
}

/// Bilinear neighbours of a coordinate in [0, 1] with centres at (i + ½)/size, clamped at the ends; of size 0
/// as of 1. The second is the one after the first, unless there is but one.
pub(crate) fn clamped(coordinate: f64, size: usize) -> Pair {
    let size = size.max(1);
    let p = (coordinate * size as f64 - 0.5).clamp(0.0, (size - 1) as f64);
    let i = (p.floor() as usize).min(size.saturating_sub(2));
    Pair { at: [i, (i + 1).min(size - 1)], f: (p - i as f64) as f32 }
}

/// The same for an axis of period 1.
pub(crate) fn periodic(coordinate: f64, size: usize) -> Pair {
    let size = size.max(1);
    let p = coordinate * size as f64 - 0.5;
    let i = p.floor();
    let wrap = |i: f64| (i as i64).rem_euclid(size as i64) as usize;
    Pair { at: [wrap(i), wrap(i + 1.0)], f: (p - i) as f32 }
}

/// Where a column (or row) of stored texels reads the maps. Offsets of a column and a row add up: texels of
/// F_uv lie block by block, those of F_uvt row by row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Site {
    /// Part of the offset into F_uv.
    pub uv: usize,
    /// Parts of the offsets into a slice of F_uvt.
    pub uvt: Pair,
    /// Texels of a row of F_ut (or F_vt).
    pub plane: Pair,
}

/// The texels of a pair that have weight.
fn touched(pair: &Pair) -> impl Iterator<Item = usize> {
    pair.ends().into_iter().filter(|(_, f)| *f > 0.0).map(|(at, _)| at)
}

/// A time point that is trained on: a frame, or between two.
#[derive(Clone, Debug)]
pub(crate) struct TimePoint {
    /// Index of the frame, or of the one before.
    #[cfg(test)]
    pub index: usize,
    /// First texels of the two slices of F_uvt.
    pub slices: Pair,
    /// Rows of F_ut and F_vt.
    pub rows: Pair,
    /// What the first layer adds to its bias: γ(τ) and the gates, of those that the tile has.
    pub time: Vec<f32>,
    /// Scale of each channel: E = mean · y^p; 0 for a black channel.
    pub means: [f32; 3],
    /// Largest valid value of the frame.
    pub peak: f32,
    /// Loss weight of a channel: `base + slope · target`, at most [`crate::train::step::WEIGHT_CAP`].
    pub base: Quad,
    /// See `base`.
    pub slope: Quad,
}

/// A stored texel that is trained on: four bytes, for training goes through millions in random order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Texel {
    /// Its place among the problem's.
    index: u16,
    x: u8,
    y: u8,
}

impl Texel {
    /// Its place among the problem's texels.
    #[inline(always)]
    pub(crate) fn index(self) -> usize {
        usize::from(self.index)
    }

    /// Stored column.
    #[inline(always)]
    pub(crate) fn x(self) -> usize {
        usize::from(self.x)
    }

    /// Stored row.
    #[inline(always)]
    pub(crate) fn y(self) -> usize {
        usize::from(self.y)
    }
}

/// All samples of a tile.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    pub shape: Shape,
    /// What τ, γ and a target are.
    pub coding: Coding,
    /// Per stored column.
    pub columns: Vec<Site>,
    /// Per stored row.
    pub rows: Vec<Site>,
    /// The frames that are not black; then time points between neighbours among them, where decoders
    /// interpolate.
    pub points: Vec<TimePoint>,
    /// How many of the time points are frames.
    pub frames: usize,
    /// Valid texels, then gutter texels.
    pub texels: Vec<Texel>,
    /// How many of them are valid.
    pub valid: usize,
    /// Of each: whether it is valid, and beside a valid one of another tile, or its copy; none in the paper's
    /// recipe.
    pub edges: Vec<bool>,
    /// Per time point and texel: (E/mean)^(1/p) of three channels, and its loss weight when an epoch visits
    /// it.
    pub targets: Vec<Quad>,
    /// Means of all frames, zero where black.
    pub knots: Vec<Knot>,
    pub axis: Axis,
    /// Light groups that are gates.
    pub gates: Vec<u16>,
    /// How F_uv and F_uvt come to their blocks.
    pub coded: Coded,
}

impl Problem {
    /// Prepares a tile. The problem has no time points or no valid texels where there is nothing to train.
    pub(crate) fn new(source: &TileSource, light: &Light, shape: Shape, coding: Coding) -> Self {
        let valid = light.valid.len();
        let all: Vec<usize> = light.valid.iter().chain(&light.gutter).copied().collect();
        let texel = |(index, &i): (usize, &usize)| Texel {
            index: index as u16,
            x: (i % source.width) as u8,
            y: (i / source.width) as u8,
        };
        let texels: Vec<Texel> = all.iter().enumerate().map(texel).collect();
        let edges: Vec<bool> =
            all.iter().map(|&i| coding == Coding::Standard && at_border(source, i)).collect();
        let taus = coding.taus(&source.hours, &light.axis);
        let spans: Vec<Span> = (0..source.frames.len())
            .filter(|&frame| light.peaks[frame] > 0.0)
            .map(|frame| Span { from: frame, to: frame, fraction: 0.0, share: 0.0 })
            .collect();
        let frames = spans.len();
        let spans: Vec<Span> = spans.into_iter().chain(between(source, light, &taus, &shape)).collect();
        let points: Vec<TimePoint> =
            spans.iter().map(|span| point(span, &taus, light, coding, &shape)).collect();
        let mut targets = Vec::with_capacity(points.len() * all.len());
        for (span, point) in spans.iter().zip(&points) {
            let (from, to) = (&source.frames[span.from], &source.frames[span.to]);
            targets.extend(all.iter().enumerate().map(|(j, &i)| {
                let weight = match j < valid {
                    true if edges[j] => EDGE_WEIGHT,
                    true => 1.0,
                    false => GUTTER_WEIGHT * GUTTER_SHARE as f32,
                };
                // A gutter texel may outshine all valid ones; it is only there to filter with.
                let target = |c: usize| match point.means[c] {
                    0.0 => 0.0,
                    mean => {
                        let ratio = span.mix(from[i][c], to[i][c]) / f64::from(mean);
                        coding.output(ratio.min(1.0 / LEAST_MEAN_OF_PEAK)) as f32
                    }
                };
                [target(0), target(1), target(2), weight]
            }));
        }
        Problem {
            coded: Coded::OnTheLoss,
            columns: (0..shape.width)
                .map(|x| site(x, shape.width, shape.uvt[0], shape.ut, x / 4 * 16 + x % 4, 1))
                .collect(),
            rows: (0..shape.height)
                .map(|y| {
                    let uv = y / 4 * shape.width * 4 + y % 4 * 4;
                    site(y, shape.height, shape.uvt[1], shape.vt, uv, shape.uvt[0])
                })
                .collect(),
            points,
            frames,
            texels,
            valid,
            edges,
            targets,
            knots: light
                .means
                .iter()
                .zip(&light.peaks)
                .map(|(&mean, &peak)| Knot { mean, peak, share: 0.0 })
                .collect(),
            axis: light.axis.clone(),
            gates: if shape.contents.gates > 0 { light.gates.clone() } else { Vec::new() },
            shape,
            coding,
        }
    }
}

impl Problem {
    /// Per block of F_uv and of F_uvt: whether any sample reads it.
    pub(crate) fn blocks_read(&self) -> [Vec<bool>; 2] {
        let [uv, uvt, ..] = self.shape.counts();
        let mut read_uv = vec![false; uv];
        // Texels of a slice.
        let mut read_uvt = vec![false; self.shape.uvt[0] * self.shape.uvt[1]];
        let slices: Vec<usize> = self.points.iter().flat_map(|point| touched(&point.slices)).collect();
        for texel in &self.texels {
            let (column, row) = self.sites(*texel);
            if uv > 0 {
                read_uv[(column.uv + row.uv) / 16] = true;
            }
            if uvt > 0 {
                for y in touched(&row.uvt) {
                    for x in touched(&column.uvt) {
                        read_uvt[x + y] = true;
                    }
                }
            }
        }
        let blocks = in_blocks(&read_uvt, self.shape.uvt[0]).into_iter().map(|texels| texels.contains(&true));
        let of_slice: Vec<bool> = blocks.collect();
        let slice = |i: usize| match slices.contains(&(i * read_uvt.len())) {
            true => of_slice.clone(),
            false => vec![false; of_slice.len()],
        };
        [read_uv, (0..if uvt > 0 { self.shape.uvt[2] } else { 0 }).flat_map(slice).collect()]
    }

    /// Its column and its row.
    #[inline(always)]
    pub(crate) fn sites(&self, texel: Texel) -> (&Site, &Site) {
        (&self.columns[texel.x()], &self.rows[texel.y()])
    }

    /// The targets of a time point, by the texels' places.
    #[inline(always)]
    pub(crate) fn targets_at(&self, point: usize) -> &[Quad] {
        &self.targets[point * self.texels.len()..][..self.texels.len()]
    }

    /// Every this many valid texels are some 2000: enough to judge a training by.
    pub(crate) fn coarse_stride(&self) -> usize {
        self.valid.div_ceil(2048)
    }

    /// Factor of a texel's weight where blocks are chosen, which looks at every texel: an epoch visits the
    /// gutter's less often.
    #[inline(always)]
    pub(crate) fn weight_in_blocks(&self, texel: Texel) -> f32 {
        match texel.index() < self.valid {
            true if self.edges[texel.index()] => EDGE_IN_BLOCKS,
            true => 1.0,
            false => 1.0 / GUTTER_SHARE as f32,
        }
    }
}

/// Whether a texel is valid and beside a valid one on the other side of a border with another tile. Of the
/// border's copies only those to the right and below count: filtering goes on to them, and then from the next
/// tile's own first texels.
fn at_border(source: &TileSource, texel: usize) -> bool {
    let (x, y) = (texel % source.width, texel / source.width);
    let valid = |x: usize, y: usize| source.coverage[y * source.width + x] == Coverage::Valid;
    let [left, right, above, below] = source.neighbours;
    let copy = STORED - BORDER;
    let pair = |a: (usize, usize), b: (usize, usize)| {
        ((x, y) == a || (x, y) == b) && valid(a.0, a.1) && valid(b.0, b.1)
    };
    x >= BORDER
        && y >= BORDER
        && valid(x, y)
        && (left && x == BORDER && valid(0, y)
            || above && y == BORDER && valid(x, 0)
            || right && pair((copy - 1, y), (copy, y))
            || below && pair((x, copy - 1), (x, copy)))
}

/// A time point by the frames around it; at a frame both are that one.
#[derive(Clone, Copy, Debug)]
struct Span {
    from: usize,
    to: usize,
    /// How far it is from the one to the other in time.
    fraction: f64,
    /// The same on the time axis: the share of the light that is the second frame's
    /// ([`time::fraction_of_share`]).
    share: f64,
}

impl Span {
    /// Linearly from one frame's value to the other's.
    fn mix(&self, from: f32, to: f32) -> f64 {
        (1.0 - self.fraction) * f64::from(from) + self.fraction * f64::from(to)
    }
}

/// Time points between neighbouring frames that do not look alike and show the same gates, where decoders may
/// interpolate: at a third and two thirds of the way on the time axis, and more where rows or slices would be
/// left that no time point reads.
fn between(source: &TileSource, light: &Light, taus: &[f64], shape: &Shape) -> Vec<Span> {
    let n = source.frames.len();
    // The paper's recipe knows frames alone.
    if n < 2 || !shape.axis {
        return Vec::new();
    }
    let finest = shape.rows.max(shape.uvt[2]) as f64;
    let span = |from: usize| {
        let to = (from + 1) % n;
        let apart = (taus[to] - taus[from]).rem_euclid(1.0);
        let joined = source.gates.iter().all(|gate| gate.on[from] == gate.on[to]);
        let lit = light.peaks[from] > 0.0 && light.peaks[to] > 0.0;
        let count = match joined && lit && apart > 0.0 {
            true => ((apart * finest).ceil() as usize).saturating_sub(1).max(2),
            false => 0,
        };
        let [a, b] = [from, to].map(|frame| time::brightness(&light.means[frame]));
        (1..=count).map(move |i| {
            let share = i as f64 / (count + 1) as f64;
            Span { from, to, fraction: time::fraction_of_share(share, a, b), share }
        })
    };
    (0..n).flat_map(span).collect()
}

fn point(span: &Span, taus: &[f64], light: &Light, coding: Coding, shape: &Shape) -> TimePoint {
    let Span { from, to, share, .. } = *span;
    let tau = taus[from] + share * (taus[to] - taus[from]).rem_euclid(1.0);
    let slice = shape.uvt[0] * shape.uvt[1];
    let slices = periodic(tau, shape.uvt[2]);
    let means: [f32; 3] = std::array::from_fn(|c| span.mix(light.means[from][c], light.means[to][c]) as f32);
    let mut time = Vec::new();
    if shape.contents.gamma {
        time.extend(coding.gamma(tau));
    }
    if shape.contents.gates > 0 {
        time.extend(&light.gate_inputs[from]);
    }
    TimePoint {
        #[cfg(test)]
        index: from,
        slices: Pair { at: slices.at.map(|i| i * slice), f: slices.f },
        rows: periodic(tau, shape.rows),
        time,
        means,
        peak: span.mix(light.peaks[from], light.peaks[to]) as f32,
        base: [0, 1, 2, 3].map(|c| if c < 3 && means[c] > 0.0 { 1.0 } else { 0.0 }),
        slope: [0.0; 4],
    }
}

fn site(at: usize, stored: usize, uvt: usize, plane: usize, uv: usize, uvt_stride: usize) -> Site {
    let coordinate = (at as f64 + 0.5) / stored as f64;
    let pair = clamped(coordinate, uvt);
    Site {
        uv,
        uvt: Pair { at: pair.at.map(|at| at * uvt_stride), f: pair.f },
        plane: clamped(coordinate, plane),
    }
}
