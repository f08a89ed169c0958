//! Vectors of f32 for the kernels of training and decoding: one trait, a type for each instruction set and
//! length.
//!
//! The kernels are generic over [`Lanes`] and `#[inline(always)]`; `train/step/kernel.rs` and
//! `decode/kernel.rs` instantiate each of theirs inside a function that enables the instruction set, after
//! asking the processor for its [`Tier`]. No vector goes through a closure of theirs: closures are compiled
//! without their caller's instruction set.

#![allow(unsafe_code, reason = "instructions of processors")]

use std::sync::atomic::{AtomicU8, Ordering};

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

/// The longest vectors of an instruction set, and its shorter ones: features come four at a time.
pub trait Longest: Lanes {
    /// A quad.
    type Four: Lanes;
    /// Two quads.
    type Eight: TwoQuads<Four = Self::Four>;
}

/// Eight lanes as two quads.
pub trait TwoQuads: Lanes {
    /// One of them.
    type Four: Lanes;
    /// The same quad twice.
    fn twice(quad: Self::Four) -> Self;
    /// All lanes of a quad the same.
    fn spread(pair: [f32; 2]) -> Self;
    /// The sum of the two.
    fn folded(self) -> Self::Four;
    /// The sum over each of eight quads, in order.
    fn sums(quads: [Self; 4]) -> Self;
    /// 1 − f and f: what the ends of a line have at f.
    #[inline(always)]
    fn ends(f: f32) -> Self {
        Self::splat(f).mul_add(Self::spread([-1.0, 1.0]), Self::spread([1.0, 0.0]))
    }
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

/// The best [`Instructions`] that may be used.
static LIMIT: AtomicU8 = AtomicU8::new(u8::MAX);

/// Instructions that this processor has: made here alone, after asking it, so that code compiled for them may
/// be entered.
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

    /// The best this processor has, up to [`Tier::limit`].
    pub fn detect() -> Self {
        let limit = LIMIT.load(Ordering::Relaxed);
        let mut allowed = Self::available();
        allowed.retain(|tier| tier.0 as u8 <= limit);
        *allowed.last().expect("the portable tier is always available")
    }

    /// Makes this the best that any thread of the process uses from now on: for the same bytes on machines of
    /// other processors.
    pub fn limit(self) {
        LIMIT.store(self.0 as u8, Ordering::Relaxed);
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

impl Longest for Quad {
    type Four = Quad;
    type Eight = Plain;
}

/// Eight lanes in plain Rust.
#[derive(Clone, Copy)]
pub struct Plain([Quad; 2]);

impl Plain {
    #[inline(always)]
    fn each(self, b: Self, op: impl Fn(Quad, Quad) -> Quad) -> Self {
        Plain([op(self.0[0], b.0[0]), op(self.0[1], b.0[1])])
    }
}

impl Lanes for Plain {
    const N: usize = 8;
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Plain([[value; 4]; 2])
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Plain([Quad::load(from), Quad::load(&from[4..])])
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..8].copy_from_slice(self.0.as_flattened());
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.each(b, Quad::add)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.each(b, Quad::mul)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self.mul(b).add(c)
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.each(b, Quad::max)
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.each(b, Quad::min)
    }
}

impl TwoQuads for Plain {
    type Four = Quad;
    #[inline(always)]
    fn twice(quad: Quad) -> Self {
        Plain([quad; 2])
    }
    #[inline(always)]
    fn spread(pair: [f32; 2]) -> Self {
        Plain(pair.map(Quad::splat))
    }
    #[inline(always)]
    fn folded(self) -> Quad {
        self.0[0].add(self.0[1])
    }
    #[inline(always)]
    fn sums(quads: [Self; 4]) -> Self {
        let sum = |q: Quad| (q[0] + q[1]) + (q[2] + q[3]);
        let [a, b, c, d] = quads.map(|q| q.0.map(sum));
        Plain([[a[0], a[1], b[0], b[1]], [c[0], c[1], d[0], d[1]]])
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Lanes, Longest, TwoQuads};
    use std::arch::x86_64::*;

    /// Implements [`Lanes`] by intrinsics.
    ///
    /// Soundness of every `unsafe` here: the values of these types are made and used only inside the
    /// `#[target_feature]` functions of the two `kernel.rs`, which are entered after
    /// [`super::Tier::available`] has found the instruction set; loads and stores are unaligned and preceded
    /// by a slice that is checked to hold N values.
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
        Avx2Quad,
        __m128,
        4,
        _mm_set1_ps,
        _mm_loadu_ps,
        _mm_storeu_ps,
        _mm_add_ps,
        _mm_mul_ps,
        _mm_fmadd_ps,
        _mm_max_ps,
        _mm_min_ps
    );
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

    impl Longest for Avx2 {
        type Four = Avx2Quad;
        type Eight = Avx2;
    }

    impl Longest for Avx512 {
        type Four = Avx2Quad;
        type Eight = Avx2;
    }

    impl TwoQuads for Avx2 {
        type Four = Avx2Quad;
        #[inline(always)]
        fn twice(quad: Avx2Quad) -> Self {
            // SAFETY: see the macro.
            Self(unsafe { _mm256_set_m128(quad.0, quad.0) })
        }
        #[inline(always)]
        fn spread([a, b]: [f32; 2]) -> Self {
            // SAFETY: see the macro.
            Self(unsafe { _mm256_set_m128(_mm_set1_ps(b), _mm_set1_ps(a)) })
        }
        #[inline(always)]
        fn folded(self) -> Avx2Quad {
            // SAFETY: see the macro.
            Avx2Quad(unsafe {
                _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0))
            })
        }
        #[inline(always)]
        fn sums([a, b, c, d]: [Self; 4]) -> Self {
            // SAFETY: see the macro.
            Self(unsafe {
                // a₀ b₀ c₀ d₀ a₁ b₁ c₁ d₁
                let sums = _mm256_hadd_ps(_mm256_hadd_ps(a.0, b.0), _mm256_hadd_ps(c.0, d.0));
                _mm256_permutevar8x32_ps(sums, _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7))
            })
        }
    }
}
