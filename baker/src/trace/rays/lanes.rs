//! Eight floats at once: what the traversal kernels compute with, and the portable form of it.
//!
//! Every operation is the IEEE one of single precision, lane by lane, without contraction, so that all forms
//! give the same bits. `min` and `max` return the second operand where either is not a number, as x86 does.

/// Eight single-precision lanes.
pub(super) trait Lanes: Copy {
    /// The same number in all lanes.
    fn splat(value: f32) -> Self;
    /// Lane by lane from memory.
    fn load(values: &[f32; 8]) -> Self;
    /// Lane by lane to memory.
    fn store(self) -> [f32; 8];
    /// Sum.
    fn add(self, other: Self) -> Self;
    /// Difference.
    fn sub(self, other: Self) -> Self;
    /// Product.
    fn mul(self, other: Self) -> Self;
    /// `self` where it is smaller than `other`, else `other`.
    fn min(self, other: Self) -> Self;
    /// `self` where it is larger than `other`, else `other`.
    fn max(self, other: Self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// A bit per lane: `self <= other`.
    fn less_or_equal(self, other: Self) -> u32;
}

/// Lanes for any machine: the oracle of the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Portable([f32; 8]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Portable(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn mask(self, other: Self, f: impl Fn(f32, f32) -> bool) -> u32 {
        (0..8).map(|i| u32::from(f(self.0[i], other.0[i])) << i).sum()
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Portable([value; 8])
    }

    #[inline(always)]
    fn load(values: &[f32; 8]) -> Self {
        Portable(*values)
    }

    #[inline(always)]
    fn store(self) -> [f32; 8] {
        self.0
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Portable(self.0.map(f32::abs))
    }

    #[inline(always)]
    fn less_or_equal(self, other: Self) -> u32 {
        self.mask(other, |a, b| a <= b)
    }
}
