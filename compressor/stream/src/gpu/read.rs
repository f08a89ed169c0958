//! Reads and unpacks tiles on other threads than the frame's.

use crate::{Pyramid, Read};
use ndgi::source::ReadAt;
use ndgi_gpu::{Features, Interval, Options, Sunlight};
use std::fmt::Debug;
use std::io;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// The result of a read.
#[derive(Debug, Default)]
pub struct Arrived {
    /// The tile's features, if the read requested them.
    pub features: Option<Features>,
    /// Its interval of visibility, if the read requested one.
    pub interval: Option<Interval>,
}

/// Why a read failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadError {
    /// Whether another try would fail too.
    pub is_lasting: bool,
    /// The reason, as text.
    pub what: String,
}

/// A completed read.
#[derive(Debug)]
pub struct Done {
    /// [`Read::ticket`].
    pub ticket: u64,
    /// The result, or why there is none.
    pub what: Result<Arrived, ReadError>,
}

/// Carries out reads: [`Threads`], or a game's own. The frame's thread calls its methods, so they must not
/// wait.
pub trait Reader: Debug + Send {
    /// Starts a read. `known` is the data from which the intervals of a tile on the device are unpacked.
    fn start(&mut self, pyramid: &Arc<Pyramid>, options: &Options, read: Read, known: Option<Sunlight>);

    /// The reads that completed since the last call.
    fn done(&mut self) -> Vec<Done>;
}

/// Data of a tile that was read and is not on the device yet.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    pub features: Option<Features>,
    pub interval: Option<Interval>,
}

/// Reads and unpacks a tile: what a [`Reader`] calls on a thread of its own. It blocks.
///
/// # Errors
/// A lasting one for a damaged tile; one that is not lasting where the source cannot be read.
pub fn read(
    pyramid: &Pyramid,
    options: &Options,
    read: &Read,
    known: Option<&Sunlight>,
) -> Result<Arrived, ReadError> {
    let lasting = |what: String| ReadError { is_lasting: true, what };
    let spot = pyramid.spot(read.tile).ok_or_else(|| lasting(format!("{:?}: no such tile", read.tile)))?;
    let bundle = pyramid.bundle(spot.level);
    let error = |error: ndgi_gpu::Error| ReadError {
        is_lasting: !matches!(&error, ndgi_gpu::Error::Bundle(ndgi::Error::Io { .. })),
        what: error.to_string(),
    };
    let features = match read.features {
        true => Some(Features::read(bundle, spot.place, options).map_err(error)?),
        false => None,
    };
    let sunlight = features.as_ref().map(Features::sunlight).or(known.cloned());
    let interval = match sunlight.zip(read.times) {
        Some((sunlight, times)) => Some(sunlight.interval(bundle, times).map_err(error)?),
        None => None,
    };
    Ok(Arrived { features, interval })
}

struct Job {
    pyramid: Arc<Pyramid>,
    options: Options,
    read: Read,
    known: Option<Sunlight>,
}

/// A [`Reader`] with threads of its own, which end when it is dropped.
#[derive(Debug)]
pub struct Threads {
    jobs: Sender<Job>,
    done: Receiver<Done>,
}

impl Threads {
    /// Starts `count` threads. Two suffice for a disk; over a network, use one for each of
    /// [`crate::Budgets::reads`].
    ///
    /// # Errors
    /// The system's error if a thread cannot be started.
    pub fn new(count: usize) -> io::Result<Self> {
        let (jobs, to_do) = channel::<Job>();
        let (tell, done) = channel();
        let to_do = Arc::new(Mutex::new(to_do));
        for _ in 0..count.max(1) {
            let (to_do, tell) = (Arc::clone(&to_do), tell.clone());
            thread::Builder::new().name("ndgi-stream".to_owned()).spawn(move || work(&to_do, &tell))?;
        }
        Ok(Threads { jobs, done })
    }
}

fn work(to_do: &Mutex<Receiver<Job>>, tell: &Sender<Done>) {
    loop {
        let job = to_do.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(Job { pyramid, options, read: of, known }) = job else { return };
        let what = read(&pyramid, &options, &of, known.as_ref());
        if tell.send(Done { ticket: of.ticket, what }).is_err() {
            return;
        }
    }
}

impl Reader for Threads {
    fn start(&mut self, pyramid: &Arc<Pyramid>, options: &Options, read: Read, known: Option<Sunlight>) {
        let job = Job { pyramid: Arc::clone(pyramid), options: options.clone(), read, known };
        // The threads live as long as the sender does.
        let _ = self.jobs.send(job);
    }

    fn done(&mut self) -> Vec<Done> {
        self.done.try_iter().collect()
    }
}

/// A source behind a slow line, for tests: a read takes the latency, plus the time of its bytes.
#[derive(Debug)]
pub struct Slow<S> {
    /// The source.
    pub source: S,
    /// The latency of each read.
    pub latency: Duration,
    /// Bytes a second, shared by all reads; at least 1.
    pub bytes_per_second: f64,
    line: Mutex<Instant>,
}

impl<S: ReadAt> Slow<S> {
    /// A source behind a line.
    pub fn new(source: S, latency: Duration, bytes_per_second: f64) -> Self {
        Slow { source, latency, bytes_per_second, line: Mutex::new(Instant::now()) }
    }
}

impl<S: ReadAt> ReadAt for Slow<S> {
    fn size(&self) -> io::Result<u64> {
        self.source.size()
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        let takes = Duration::from_secs_f64(bytes.len() as f64 / self.bytes_per_second.max(1.0));
        let free = {
            let mut line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
            *line = (*line).max(Instant::now()) + takes;
            *line
        };
        thread::sleep((free + self.latency).saturating_duration_since(Instant::now()));
        self.source.read_at(offset, bytes)
    }
}
