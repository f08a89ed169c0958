//! A disk on the simulated clock: reads are carried out at once, and arrive when such a disk would have
//! brought them.

use crate::args::Disk;
use ndgi_gpu::{Options, Sunlight};
use ndgi_stream::gpu::{Done, Reader, read};
use ndgi_stream::{Pyramid, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// A disk whose clock is in microseconds.
#[derive(Debug)]
pub struct Simulated {
    disk: Disk,
    clock: Arc<AtomicU64>,
    /// When the line is free again.
    free: f64,
    /// Nanoseconds of unpacking, which threads of their own would do.
    spent: Arc<AtomicU64>,
    under_way: Vec<(f64, Done)>,
}

impl Simulated {
    pub fn new(disk: Disk, clock: &Arc<AtomicU64>, spent: &Arc<AtomicU64>) -> Self {
        let (clock, spent) = (Arc::clone(clock), Arc::clone(spent));
        Simulated { disk, clock, free: 0.0, spent, under_way: Vec::new() }
    }

    fn now(&self) -> f64 {
        self.clock.load(Ordering::Relaxed) as f64 * 1e-6
    }
}

impl Reader for Simulated {
    fn start(&mut self, pyramid: &Arc<Pyramid>, options: &Options, of: Read, known: Option<Sunlight>) {
        let began = Instant::now();
        let what = read(pyramid, options, &of, known.as_ref());
        self.spent.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
        let mut bytes = 0;
        if of.features
            && let Some(spot) = pyramid.spot(of.tile)
        {
            let bundle = pyramid.bundle(spot.level);
            bytes = bundle.header.position(spot.place).map_or(0, |position| bundle.index[position].bytes());
        }
        let at = if of.features {
            self.free = self.free.max(self.now()) + bytes as f64 / self.disk.bytes_per_second;
            self.free + self.disk.latency_secs
        } else {
            // From what is in memory.
            self.now()
        };
        self.under_way.push((at, Done { ticket: of.ticket, what }));
    }

    fn done(&mut self) -> Vec<Done> {
        let now = self.now();
        let (done, left): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.under_way).into_iter().partition(|(at, _)| *at <= now);
        self.under_way = left;
        done.into_iter().map(|(_, done)| done).collect()
    }
}
