//! Owen-scrambled Sobol points by hashing (Burley 2020, "Practical Hash-based Owen Scrambling"): a point is a
//! function of (texel, half, sample, dimension, seed) alone, so neither threads nor rounds change it.

use glam::{Vec2, vec2};

/// The point sequence of one texel and half. Two halves are scrambled independently: their difference
/// measures the error.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    key: u32,
}

/// What a sequence is of. (The numbers decide the bytes of every bake.)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SequenceKind {
    /// A texel of the virtual page.
    Texel = 0,
    /// A patch of the cache.
    Patch = 1,
    /// A ray of `--plan`.
    PlanRay = 2,
    /// A pixel of a preview.
    Pixel = 3,
}

impl Sequence {
    /// The sequence for one purpose (`stream`) of what has this `index` among things of its kind.
    pub fn new(seed: u64, kind: SequenceKind, index: u32, stream: u32) -> Self {
        let key = hash(seed as u32 ^ hash((seed >> 32) as u32 ^ hash(kind as u32 ^ 0x9e37_79b9)));
        Sequence { key: hash(key ^ hash(index ^ hash(stream ^ 0x85eb_ca6b))) }
    }

    /// Sample number `index` of the sequence.
    pub fn sample(self, index: u32) -> Sample {
        Sample { key: self.key, index }
    }
}

/// One sample: a point with as many dimensions as are asked for.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    key: u32,
    index: u32,
}

impl Sample {
    /// The sample's pair of dimensions number `pair`, in [0, 1)². Over the samples, every pair is a (0,
    /// 2)-sequence of its own, shuffled against the others ("padding").
    #[inline]
    pub fn pair(self, pair: u32) -> Vec2 {
        let key = hash(self.key ^ pair.wrapping_mul(0x9e37_79b9));
        let index = owen_scramble(self.index, key);
        let x = owen_scramble(sobol0(index), hash(key ^ 0x68bc_21eb));
        let y = owen_scramble(sobol1(index), hash(key ^ 0x02e5_be93));
        vec2(unit(x), unit(y))
    }

    /// A uniform number in [0, 1), shuffled against the pairs and other numbers: for single decisions. Over
    /// the samples it is a (0, 1)-sequence of its own.
    #[inline]
    pub fn number(self, purpose: u32) -> f32 {
        let key = hash(self.key ^ hash(purpose ^ 0xc2b2_ae35));
        unit(owen_scramble(sobol0(owen_scramble(self.index, key)), hash(key ^ 0x68bc_21eb)))
    }
}

/// 24 high bits as a float in [0, 1).
#[inline]
fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A 32-bit finaliser with good avalanche (the "lowbias32" constants found by Wellons' search).
#[inline]
fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// First Sobol dimension: the radical inverse, as bits of a fraction.
#[inline]
fn sobol0(index: u32) -> u32 {
    index.reverse_bits()
}

/// Second Sobol dimension: its matrix is Pascal's triangle modulo 2, applied here in log₂ 32 steps.
#[inline]
fn sobol1(index: u32) -> u32 {
    let mut x = index.reverse_bits();
    x ^= x << 16;
    x ^= (x & 0x00ff_00ff) << 8;
    x ^= (x & 0x0f0f_0f0f) << 4;
    x ^= (x & 0x3333_3333) << 2;
    x ^ (x & 0x5555_5555) << 1
}

/// Nested uniform scramble: each bit is flipped by a hash of the bits above it, so aligned runs stay aligned
/// runs (Laine & Karras's mixing, Burley's constants as improved by Vegdahl).
#[inline]
fn owen_scramble(fraction: u32, seed: u32) -> u32 {
    let mut x = fraction.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_is_a_net() {
        // A (0, 2)-sequence in base 2: the first 2^m points put exactly one into each elementary box of area
        // 2^-m.
        for pair in 0..5 {
            let sequence = Sequence::new(7, SequenceKind::Texel, 42, 1);
            for m in 0..9u32 {
                for split in 0..=m {
                    let (nx, ny) = (1u32 << split, 1u32 << (m - split));
                    let mut count = vec![0; (nx * ny) as usize];
                    for i in 0..1 << m {
                        let p = sequence.sample(i).pair(pair);
                        count[((p.y * ny as f32) as u32 * nx + (p.x * nx as f32) as u32) as usize] += 1;
                    }
                    assert!(count.iter().all(|&c| c == 1), "pair {pair}, m {m}, split {split}");
                }
            }
        }
    }

    #[test]
    fn means_over_scrambles_are_unbiased() {
        // Each single point is uniform over scrambles: mean ½ and E[xy] ¼ within 4σ at 20,000 scrambles.
        let n = 20_000;
        for sample in [0, 1, 5] {
            let (mut sx, mut sxy) = (0.0, 0.0);
            for texel in 0..n {
                let p = Sequence::new(1, SequenceKind::Texel, texel, 0).sample(sample).pair(3);
                sx += f64::from(p.x);
                sxy += f64::from(p.x) * f64::from(p.y);
            }
            let (mx, mxy) = (sx / f64::from(n), sxy / f64::from(n));
            assert!((mx - 0.5).abs() < 4.0 * 0.2887 / f64::from(n).sqrt(), "{mx}");
            assert!((mxy - 0.25).abs() < 4.0 * 0.2205 / f64::from(n).sqrt(), "{mxy}");
        }
    }

    #[test]
    fn pairs_are_independent() {
        let n = 1 << 12;
        let sequence = Sequence::new(3, SequenceKind::Texel, 9, 0);
        let sum: f64 = (0..n)
            .map(|i| {
                f64::from(sequence.sample(i).pair(0).x - 0.5) * f64::from(sequence.sample(i).pair(1).x - 0.5)
            })
            .sum();
        // Correlation of independent uniforms: σ = √n ÷ 12.
        assert!(sum.abs() < 4.0 * f64::from(n).sqrt() / 12.0, "{sum}");
    }
}
