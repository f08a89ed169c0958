//! Reproducible randomness: a counter through SplitMix64's finaliser, and periodic value noise on top of it.

use glam::DVec3;

/// Hashes a 64-bit value (Steele, Lea & Flood 2014, SplitMix64).
pub fn hash(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A uniform number in [0, 1) for an integer cell and a seed.
pub fn cell(x: i64, y: i64, seed: u64) -> f64 {
    let h = hash(hash(hash(seed) ^ x as u64) ^ y as u64);
    (h >> 11) as f64 / (1u64 << 53) as f64
}

/// Value noise in [0, 1) with cubic blending, repeating after `period` cells in both axes.
pub fn noise(x: f64, y: f64, period: i64, seed: u64) -> f64 {
    let (cx, cy) = (x.floor(), y.floor());
    let blend = |t: f64| t * t * (3.0 - 2.0 * t);
    let (bx, by) = (blend(x - cx), blend(y - cy));
    let at =
        |i: i64, j: i64| cell((cx as i64 + i).rem_euclid(period), (cy as i64 + j).rem_euclid(period), seed);
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * bx;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * bx;
    low + (high - low) * by
}

/// A stream of random numbers.
pub struct Random {
    counter: u64,
}

impl Random {
    /// A stream; equal seeds give equal streams.
    pub fn new(seed: u64) -> Self {
        Self { counter: hash(seed) }
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        self.counter = self.counter.wrapping_add(1);
        low + (high - low) * (hash(self.counter) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        let z = self.range(-1.0, 1.0);
        let (sin, cos) = self.range(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, z, r * sin)
    }
}
