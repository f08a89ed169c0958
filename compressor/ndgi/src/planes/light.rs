//! Planes unpacked, and the light of a tile from them at one time.

use super::coefficients::BLOCK;
use super::set::PlaneSet;
use super::transform::{UNITS, inverse};
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, Avx512};
use crate::lanes::{Instructions, Lanes, Quad, Tier};
use crate::model::Y_MAX;
use std::sync::Arc;

/// The longest vector; rows of planes are padded to a multiple of two of them.
const LANES: usize = 16;

/// Red, green and blue of luminance and two colour differences: an orthonormal transform.
const COLOURS: [[f64; 3]; 3] = {
    // 1/√3, 1/√2, 1/√6.
    let (third, half, sixth) = (0.577_350_269_189_625_8, 0.707_106_781_186_547_5, 0.408_248_290_463_863);
    [[third, half, -sixth], [third, 0.0, 2.0 * sixth], [third, -half, -sixth]]
};

/// Luminance and colour differences of red, green and blue: the inverse, which is the transpose, of what
/// decoders do.
pub fn components(rgb: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|j| (0..3).map(|c| COLOURS[c][j] * rgb[c]).sum())
}

/// One light source of a tile, unpacked.
#[derive(Clone, Debug)]
pub struct Unpacked {
    /// See [`PlaneSet::source`].
    pub source: u16,
    /// See [`PlaneSet::is_linear`].
    pub is_linear: bool,
    /// Number of planes.
    pub planes: usize,
    /// Number of frames that the source lights.
    pub frames: usize,
    /// By plane, row, column; rows of [`Unpacked::padded`].
    values: Vec<i16>,
    padded: usize,
    height: usize,
    /// By frame that the source lights, channel, plane.
    factors: Vec<f32>,
}

impl Unpacked {
    /// The planes of a set on a tile of stored width and height.
    ///
    /// # Panics
    /// For a set whose lists are not those of its numbers of planes, frames and blocks: one that was not read
    /// from a bundle, nor made by the encoder.
    pub fn new(set: &PlaneSet, [width, height]: [usize; 2]) -> Self {
        let planes = set.planes();
        let padded = width.next_multiple_of(TOGETHER * LANES);
        let (columns, rows) = (width.div_ceil(8), height.div_ceil(8));
        let mut values = vec![0; planes * height * padded];
        for (k, blocks) in set.coefficients.chunks_exact((columns * rows).max(1)).enumerate() {
            let plane = &mut values[k * height * padded..][..height * padded];
            for (i, block) in blocks.iter().enumerate().filter(|(_, block)| **block != [0; BLOCK]) {
                let (x, y) = (8 * (i % columns), 8 * (i / columns));
                let across = 8.min(padded - x);
                for (line, row) in plane.chunks_exact_mut(padded).skip(y).zip(&inverse(block)) {
                    line[x..x + across].copy_from_slice(&row[..across]);
                }
            }
        }
        let frames = set.weights.len();
        let step = (-f64::from(set.step) / 8.0).exp2();
        let mut factors = Vec::with_capacity(frames * 3 * planes);
        for (f, weight) in set.weights.iter().enumerate() {
            let scale = (-f64::from(*weight) / 8.0).exp2();
            let difference = scale * 16.0 / f64::from(set.chroma);
            let rgb = |row: [f64; 3]| {
                let row = [row[0] * scale, row[1] * difference, row[2] * difference];
                COLOURS.map(|of| (0..3).map(|j| of[j] * row[j]).sum::<f64>())
            };
            let unit = step / f64::from(UNITS);
            let of_planes: Vec<[f64; 3]> = (0..planes)
                .map(|k| {
                    let size = (-f64::from(set.scales[k]) / 8.0).exp2() * unit;
                    rgb(std::array::from_fn(|j| f64::from(set.factors[3 * frames * k + 3 * f + j]) * size))
                })
                .collect();
            for c in 0..3 {
                factors.extend(of_planes.iter().map(|of| of[c] as f32));
            }
        }
        let (source, is_linear) = (set.source, set.is_linear);
        Unpacked { source, is_linear, planes, frames, values, padded, height, factors }
    }

    /// A plane's values, in rows of whole vectors: of each row the first [`PlaneSet`]'s width count.
    pub fn plane(&self, k: usize) -> (&[i16], usize) {
        let size = self.height * self.padded;
        (&self.values[k * size..][..size], self.padded)
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        2 * self.values.len() + 4 * self.factors.len()
    }

    /// The factors between two frames that it lights, `share` of the way from `a` to `b`: by channel, each
    /// plane's.
    pub fn factors(&self, a: usize, b: usize, share: f32) -> Vec<f32> {
        let size = 3 * self.planes;
        let of = |frame: usize| &self.factors[frame * size..][..size];
        of(a).iter().zip(of(b)).map(|(a, b)| a + share * (b - a)).collect()
    }
}

/// A source's light at one time, ready to be added.
#[derive(Clone, Debug)]
pub struct Source {
    /// Its planes.
    pub unpacked: Arc<Unpacked>,
    /// [`Unpacked::factors`].
    pub factors: Vec<f32>,
    /// Its means at the time, by channel.
    pub means: [f32; 3],
}

/// Light of a value y of planes.
#[inline(always)]
fn light(y: f32, mean: f32, is_linear: bool) -> f32 {
    // What is not a number counts as zero.
    let y = if y > 0.0 { y.min(Y_MAX) } else { 0.0 };
    mean * if is_linear { y } else { y * y }
}

impl Source {
    /// The light of a stored texel, by the formulae: the oracle of the vectors.
    pub fn texel(&self, x: usize, y: usize) -> [f32; 3] {
        let Unpacked { planes, values, padded, height, is_linear, .. } = &*self.unpacked;
        let of_channel = |c: usize| {
            let factors = &self.factors[c * planes..][..*planes];
            let mut sum = 0.0;
            for (k, factor) in factors.iter().enumerate() {
                sum += factor * f32::from(values[(k * height + y) * padded + x]);
            }
            light(sum, self.means[c], *is_linear).min(f32::MAX)
        };
        std::array::from_fn(of_channel)
    }
}

/// The light of all stored texels, row by row of `width`: the sum of the sources, with the instructions of
/// `tier`.
pub(super) fn decode(tier: Tier, sources: &[Source], width: usize, out: &mut [[f32; 3]]) {
    let sources: Vec<Folded> = sources.iter().map(Folded::new).collect();
    match tier.instructions() {
        Instructions::Portable => run::<Quad>(&sources, width, out),
        // SAFETY: only `Tier::available` makes this tier, after asking the processor.
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "instructions of processors")]
        Instructions::Avx2 => unsafe { avx2(&sources, width, out) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "instructions of processors")]
        Instructions::Avx512 => unsafe { avx512(&sources, width, out) },
    }
}

/// A source as the inner loop reads it.
struct Folded<'a> {
    values: &'a [i16],
    padded: usize,
    plane: usize,
    is_linear: bool,
    /// By plane, channel.
    factors: Vec<[f32; 3]>,
    means: [f32; 3],
}

impl<'a> Folded<'a> {
    fn new(source: &'a Source) -> Self {
        let Unpacked { planes, values, padded, height, is_linear, .. } = &*source.unpacked;
        let factors = |k: usize| [0, 1, 2].map(|c| source.factors[c * planes + k]);
        Folded {
            values,
            padded: *padded,
            plane: height * padded,
            is_linear: *is_linear,
            factors: (0..*planes).map(factors).collect(),
            means: source.means,
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
fn avx512(sources: &[Folded], width: usize, out: &mut [[f32; 3]]) {
    run::<Avx512>(sources, width, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2(sources: &[Folded], width: usize, out: &mut [[f32; 3]]) {
    run::<Avx2>(sources, width, out);
}

/// As many whole numbers as lanes.
#[inline(always)]
fn load<L: Lanes>(from: &[i16]) -> L {
    let mut values = [0.0; LANES];
    for (value, from) in values[..L::N].iter_mut().zip(&from[..L::N]) {
        *value = f32::from(*from);
    }
    L::load(&values)
}

/// Vectors computed together: independent sums hide the latency of an addition.
const TOGETHER: usize = 2;

#[inline(always)]
fn run<L: Lanes>(sources: &[Folded], width: usize, out: &mut [[f32; 3]]) {
    for (y, line) in out.chunks_exact_mut(width).enumerate() {
        for (i, texels) in line.chunks_mut(TOGETHER * L::N).enumerate() {
            let x = i * TOGETHER * L::N;
            let mut lit = [[L::splat(0.0); TOGETHER]; 3];
            for source in sources {
                let at = y * source.padded + x;
                let mut sums = [[L::splat(0.0); TOGETHER]; 3];
                for (k, factors) in source.factors.iter().enumerate() {
                    let of = &source.values[k * source.plane + at..][..TOGETHER * L::N];
                    for n in 0..TOGETHER {
                        let value = load::<L>(&of[n * L::N..]);
                        for c in 0..3 {
                            sums[c][n] = L::splat(factors[c]).mul_add(value, sums[c][n]);
                        }
                    }
                }
                for c in 0..3 {
                    let mean = L::splat(source.means[c]);
                    for n in 0..TOGETHER {
                        let y = sums[c][n].max(L::splat(0.0)).min(L::splat(Y_MAX));
                        let y = if source.is_linear { y } else { y.mul(y) };
                        lit[c][n] = y.mul_add(mean, lit[c][n]);
                    }
                }
            }
            let mut values = [[0.0; TOGETHER * LANES]; 3];
            for c in 0..3 {
                for n in 0..TOGETHER {
                    lit[c][n].min(L::splat(f32::MAX)).store(&mut values[c][n * L::N..]);
                }
            }
            for (l, texel) in texels.iter_mut().enumerate() {
                *texel = [values[0][l], values[1][l], values[2][l]];
            }
        }
    }
}
