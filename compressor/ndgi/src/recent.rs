//! What was read lately, kept in memory.

use crate::Result;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Things by their place in a bundle's index, the one used last first; `None` where there is nothing.
#[derive(Debug)]
pub(crate) struct Recent<T> {
    kept: Mutex<VecDeque<(usize, Option<Arc<T>>)>>,
    /// At most this many are kept,
    most: usize,
    /// of at most this many bytes together, but always the newest.
    most_bytes: usize,
    bytes: fn(&T) -> usize,
}

impl<T> Recent<T> {
    pub(crate) fn new(most: usize, most_bytes: usize, bytes: fn(&T) -> usize) -> Self {
        Recent { kept: Mutex::default(), most, most_bytes, bytes }
    }

    /// What is at a place: from memory if it was read lately.
    pub(crate) fn get(
        &self,
        position: usize,
        read: impl FnOnce() -> Result<Option<T>>,
    ) -> Result<Option<Arc<T>>> {
        let lock = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut kept = lock();
            if let Some(i) = kept.iter().position(|(at, _)| *at == position)
                && let Some(hit) = kept.remove(i)
            {
                kept.push_front(hit.clone());
                return Ok(hit.1);
            }
        }
        let found = read()?.map(Arc::new);
        let mut kept = lock();
        kept.push_front((position, found.clone()));
        kept.truncate(self.most);
        let mut held = 0;
        let fits = |(i, (_, found)): (usize, &(usize, Option<Arc<T>>))| {
            held += found.as_ref().map_or(0, |found| (self.bytes)(found));
            i == 0 || held <= self.most_bytes
        };
        let fit = kept.iter().enumerate().map(fits).take_while(|fits| *fits).count();
        kept.truncate(fit);
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_last_stays_within_the_limits() {
        let recent = Recent::new(3, 100, |bytes: &usize| *bytes);
        let reads = std::cell::Cell::new(0);
        let get = |at: usize, bytes: Option<usize>| {
            let read = || {
                reads.set(reads.get() + 1);
                Ok(bytes)
            };
            recent.get(at, read).unwrap().map(|found| *found)
        };
        assert_eq!(
            [get(1, Some(40)), get(2, None), get(1, None), get(3, Some(50))],
            [Some(40), None, Some(40), Some(50)]
        );
        assert_eq!((reads.get(), get(2, Some(7))), (3, None));
        // A fourth: the one used longest ago goes, and with it what exceeds the bytes.
        get(4, Some(60));
        assert_eq!((get(4, None), get(2, None), reads.get()), (Some(60), None, 4));
        assert_eq!((get(3, Some(1)), reads.get()), (Some(1), 5));
        // One that is larger than all is kept alone.
        get(5, Some(1000));
        assert_eq!((get(5, None), get(2, Some(9)), reads.get()), (Some(1000), Some(9), 7));
        assert!(recent.get(9, || Err(crate::Error::invalid("a", "b"))).is_err());
    }
}
