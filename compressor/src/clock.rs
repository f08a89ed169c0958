//! CPU time of a thread.

/// The machine's clock, in seconds.
pub(crate) fn seconds_since_1970() -> u64 {
    std::time::UNIX_EPOCH.elapsed().map_or(0, |elapsed| elapsed.as_secs())
}

/// CPU seconds of the thread that started it; wall-clock seconds where the system does not report them.
#[derive(Debug)]
pub(crate) struct Clock {
    wall: std::time::Instant,
    cpu: Option<f64>,
}

impl Clock {
    /// Starts now.
    pub(crate) fn start() -> Self {
        Clock { wall: std::time::Instant::now(), cpu: Self::thread_seconds() }
    }

    /// Linux: the first field of schedstat is the thread's time on a processor in nanoseconds.
    fn thread_seconds() -> Option<f64> {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
    }

    /// Seconds since the start; call it on the thread that started it.
    pub(crate) fn seconds(&self) -> f64 {
        match (self.cpu, Self::thread_seconds()) {
            (Some(start), Some(now)) => now - start,
            _ => self.wall.elapsed().as_secs_f64(),
        }
    }
}
