//! Kernel file (holds `unsafe`): large pages for what is read at random. A cache or a hierarchy of a hundred
//! megabytes, read here and there, otherwise spends much of its time on finding pages of 4 KiB.

/// Asks the system to hold memory that was not touched yet in pages of 2 MiB, which it may ignore.
pub(super) fn prefer_large<T>(fresh: &[T]) {
    #[cfg(target_os = "linux")]
    {
        const LARGE: usize = 1 << 21;
        let from = (fresh.as_ptr() as usize).next_multiple_of(LARGE);
        let to = fresh.as_ptr_range().end as usize / LARGE * LARGE;
        if from < to {
            // SAFETY: advice on whole pages inside the allocation, which leaves their contents as they are.
            unsafe { libc::madvise(from as *mut libc::c_void, to - from, libc::MADV_HUGEPAGE) };
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = fresh;
}

/// The same values, in such memory.
pub(super) fn in_large<T: Copy>(values: &[T]) -> Vec<T> {
    let mut held = Vec::with_capacity(values.len());
    prefer_large(held.spare_capacity_mut());
    held.extend_from_slice(values);
    held
}
