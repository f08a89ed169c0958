//! Traversal of the hierarchy, by the kernel that fits the processor.
//!
//! Kernel file (holds `unsafe`): the choice of a kernel.

#[cfg(target_arch = "x86_64")]
use super::bvh8::Tier;
use super::bvh8::{Bvh8, Line, Reach};
use super::kernel;
#[cfg(target_arch = "x86_64")]
use super::lanes_x86;
use super::triangle::TriangleHit;

impl Bvh8 {
    /// The nearest hit, t > 0. `is_open` is asked about triangles marked [`super::bvh8::CUT_OUT`].
    #[inline]
    pub fn nearest(
        &self,
        line: &Line,
        from: u32,
        is_open: &dyn Fn(u32, &TriangleHit) -> bool,
    ) -> Option<(u32, TriangleHit)> {
        match self.tier {
            // SAFETY: a tier above `Portable` is only ever set where `Tier::detect` found it or a higher one.
            #[cfg(target_arch = "x86_64")]
            Tier::Avx512 => unsafe { lanes_x86::nearest_avx512(self, line, from, is_open) },
            #[cfg(target_arch = "x86_64")]
            Tier::Avx2 => unsafe { lanes_x86::nearest_avx2(self, line, from, is_open) },
            _ => kernel::nearest::<super::lanes::Portable>(self, line, from, is_open),
        }
    }

    /// Whether there is any hit with 0 < t < `reach.t_max`. `is_open` is asked about triangles marked
    /// [`super::bvh8::CUT_OUT`], and from `reach.ask_from` on about all.
    #[inline]
    pub fn occluded(
        &self,
        line: &Line,
        reach: Reach,
        from: u32,
        is_open: &dyn Fn(u32, &TriangleHit) -> bool,
    ) -> bool {
        match self.tier {
            // SAFETY: as in `nearest`.
            #[cfg(target_arch = "x86_64")]
            Tier::Avx512 => unsafe { lanes_x86::occluded_avx512(self, line, reach, from, is_open) },
            #[cfg(target_arch = "x86_64")]
            Tier::Avx2 => unsafe { lanes_x86::occluded_avx2(self, line, reach, from, is_open) },
            _ => kernel::occluded::<super::lanes::Portable>(self, line, reach, from, is_open),
        }
    }
}
