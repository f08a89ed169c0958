//! Vectors of f32 for the kernels of training and decoding: one trait, one type per instruction set.
//!
//! The kernels are generic over [`Lanes`] and `#[inline(always)]`; `train/kernel.rs` and `decode/kernel.rs` instantiate each
//! of theirs inside a function that enables the instruction set, after asking the processor for its [`Tier`].

/// A vector of [`Lanes::N`] f32.
pub trait Lanes: Copy {
    /// Number of lanes; divides 16.
    const N: usize;
    /// All lanes the same.
    fn splat(value: f32) -> Self;
    /// The first N values of a slice.
    fn load(from: &[f32]) -> Self;
    /// Writes to the first N values of a slice.
    fn store(self, to: &mut [f32]);
    /// self + b
    fn add(self, b: Self) -> Self;
    /// self · b
    fn mul(self, b: Self) -> Self;
    /// self · b + c, rounded once or twice.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// The larger of each lane; b where self is not a number.
    fn max(self, b: Self) -> Self;
    /// The smaller of each lane; b where self is not a number.
    fn min(self, b: Self) -> Self;
}

/// The instruction sets there is code for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instructions {
    /// Plain Rust arrays of four: what the compiler makes of them (SSE2 on x86-64). The oracle of the others.
    Portable,
    /// 256-bit vectors and fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// Instructions that this processor has: made here alone, after asking it, so that code compiled for them may be entered.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Tier(Instructions);

/// The name of the instructions.
impl std::fmt::Debug for Tier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl Tier {
    /// What every processor has.
    pub fn portable() -> Self {
        Tier(Instructions::Portable)
    }

    /// The instructions, to choose the code by.
    pub fn instructions(self) -> Instructions {
        self.0
    }

    /// The best this processor has.
    pub fn detect() -> Self {
        *Self::available().last().expect("the portable tier is always there")
    }

    /// All that this processor has, slowest first.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "more is pushed on x86-64")]
        let mut tiers = vec![Tier::portable()];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                tiers.push(Tier(Instructions::Avx2));
            }
            if is_x86_feature_detected!("avx512f") && tiers.contains(&Tier(Instructions::Avx2)) {
                tiers.push(Tier(Instructions::Avx512));
            }
        }
        tiers
    }
}

/// Asks for a value's cache line ahead of its use.
#[inline(always)]
pub fn prefetch<T>(value: &T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE is part of x86-64, and the address is that of a live value.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(value).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

/// Four lanes in plain Rust.
pub type Quad = [f32; 4];

impl Lanes for Quad {
    const N: usize = 4;
    #[inline(always)]
    fn splat(value: f32) -> Self {
        [value; 4]
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        [from[0], from[1], from[2], from[3]]
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..4].copy_from_slice(&self);
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        [self[0] + b[0], self[1] + b[1], self[2] + b[2], self[3] + b[3]]
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        [self[0] * b[0], self[1] * b[1], self[2] * b[2], self[3] * b[3]]
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self.mul(b).add(c)
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        std::array::from_fn(|i| if self[i] > b[i] { self[i] } else { b[i] })
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        std::array::from_fn(|i| if self[i] < b[i] { self[i] } else { b[i] })
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::Lanes;
    use std::arch::x86_64::*;

    /// Implements [`Lanes`] by intrinsics.
    ///
    /// Soundness of every `unsafe` here: the values of these types are made and used only inside the `#[target_feature]`
    /// functions of the two `kernel.rs`, which are entered after [`super::Tier::available`] has found the instruction set;
    /// loads and stores are unaligned and preceded by a slice that is checked to hold N values.
    macro_rules! lanes {
        ($name:ident, $vector:ty, $n:literal, $set1:ident, $load:ident, $store:ident, $add:ident, $mul:ident,
         $fmadd:ident, $max:ident, $min:ident) => {
            /// A vector of this instruction set.
            #[derive(Clone, Copy)]
            pub struct $name($vector);
            impl Lanes for $name {
                const N: usize = $n;
                #[inline(always)]
                fn splat(value: f32) -> Self {
                    // SAFETY: see the macro.
                    Self(unsafe { $set1(value) })
                }
                #[inline(always)]
                fn load(from: &[f32]) -> Self {
                    let from = &from[..$n];
                    // SAFETY: see the macro.
                    Self(unsafe { $load(from.as_ptr()) })
                }
                #[inline(always)]
                fn store(self, to: &mut [f32]) {
                    let to = &mut to[..$n];
                    // SAFETY: see the macro.
                    unsafe { $store(to.as_mut_ptr(), self.0) }
                }
                #[inline(always)]
                fn add(self, b: Self) -> Self {
                    // SAFETY: see the macro.
                    Self(unsafe { $add(self.0, b.0) })
                }
                #[inline(always)]
                fn mul(self, b: Self) -> Self {
                    // SAFETY: see the macro.
                    Self(unsafe { $mul(self.0, b.0) })
                }
                #[inline(always)]
                fn mul_add(self, b: Self, c: Self) -> Self {
                    // SAFETY: see the macro.
                    Self(unsafe { $fmadd(self.0, b.0, c.0) })
                }
                #[inline(always)]
                fn max(self, b: Self) -> Self {
                    // SAFETY: see the macro.
                    Self(unsafe { $max(self.0, b.0) })
                }
                #[inline(always)]
                fn min(self, b: Self) -> Self {
                    // SAFETY: see the macro.
                    Self(unsafe { $min(self.0, b.0) })
                }
            }
        };
    }

    lanes!(
        Avx2,
        __m256,
        8,
        _mm256_set1_ps,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_add_ps,
        _mm256_mul_ps,
        _mm256_fmadd_ps,
        _mm256_max_ps,
        _mm256_min_ps
    );
    lanes!(
        Avx512,
        __m512,
        16,
        _mm512_set1_ps,
        _mm512_loadu_ps,
        _mm512_storeu_ps,
        _mm512_add_ps,
        _mm512_mul_ps,
        _mm512_fmadd_ps,
        _mm512_max_ps,
        _mm512_min_ps
    );
}
