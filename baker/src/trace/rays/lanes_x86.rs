//! Kernel file (holds `unsafe`): eight lanes in one AVX register, and the traversals compiled for AVX2 and
//! AVX-512VL.
//!
//! Soundness: [`Avx`] is private to this file, and the only code that makes one is what the entry points at
//! the end inline. They are `unsafe` to call, and [`super::bvh8_traversal`] calls each only with the tier
//! that `Tier::detect` found.

use super::bvh8::{Bvh8, Line, Reach};
use super::kernel;
use super::lanes::Lanes;
use super::triangle::TriangleHit;
use std::arch::x86_64::*;

#[derive(Clone, Copy)]
struct Avx(__m256);

// SAFETY of every intrinsic below: they need AVX, which the callers of the entry points have made sure of;
// the two that touch memory read or write exactly the eight floats of an array, unaligned.
impl Lanes for Avx {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        unsafe { Avx(_mm256_set1_ps(value)) }
    }

    #[inline(always)]
    fn load(values: &[f32; 8]) -> Self {
        unsafe { Avx(_mm256_loadu_ps(values.as_ptr())) }
    }

    #[inline(always)]
    fn store(self) -> [f32; 8] {
        let mut values = [0.0; 8];
        unsafe { _mm256_storeu_ps(values.as_mut_ptr(), self.0) };
        values
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        unsafe { Avx(_mm256_add_ps(self.0, other.0)) }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        unsafe { Avx(_mm256_sub_ps(self.0, other.0)) }
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        unsafe { Avx(_mm256_mul_ps(self.0, other.0)) }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        unsafe { Avx(_mm256_min_ps(self.0, other.0)) }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { Avx(_mm256_max_ps(self.0, other.0)) }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { Avx(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0)) }
    }

    #[inline(always)]
    fn less_or_equal(self, other: Self) -> u32 {
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)) as u32 }
    }
}

/// [`kernel::nearest`] for AVX2.
///
/// # Safety
/// The processor must have AVX2, BMI1, BMI2 and LZCNT.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
pub(super) unsafe fn nearest_avx2(
    bvh: &Bvh8,
    line: &Line,
    from: u32,
    is_open: &dyn Fn(u32, &TriangleHit) -> bool,
) -> Option<(u32, TriangleHit)> {
    kernel::nearest::<Avx>(bvh, line, from, is_open)
}

/// [`kernel::occluded`] for AVX2.
///
/// # Safety
/// The processor must have AVX2, BMI1, BMI2 and LZCNT.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
pub(super) unsafe fn occluded_avx2(
    bvh: &Bvh8,
    line: &Line,
    reach: Reach,
    from: u32,
    is_open: &dyn Fn(u32, &TriangleHit) -> bool,
) -> bool {
    kernel::occluded::<Avx>(bvh, line, reach, from, is_open)
}

/// [`kernel::nearest`] for AVX-512VL: the same operations, with twice the registers and mask registers.
///
/// # Safety
/// The processor must have AVX-512 F, VL and DQ and what AVX2's form needs.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,lzcnt")]
pub(super) unsafe fn nearest_avx512(
    bvh: &Bvh8,
    line: &Line,
    from: u32,
    is_open: &dyn Fn(u32, &TriangleHit) -> bool,
) -> Option<(u32, TriangleHit)> {
    kernel::nearest::<Avx>(bvh, line, from, is_open)
}

/// [`kernel::occluded`] for AVX-512VL.
///
/// # Safety
/// The processor must have AVX-512 F, VL and DQ and what AVX2's form needs.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,lzcnt")]
pub(super) unsafe fn occluded_avx512(
    bvh: &Bvh8,
    line: &Line,
    reach: Reach,
    from: u32,
    is_open: &dyn Fn(u32, &TriangleHit) -> bool,
) -> bool {
    kernel::occluded::<Avx>(bvh, line, reach, from, is_open)
}
