//! Reading and unpacking tiles beside the frame's thread.

use crate::{Pyramid, Read};
use ndgi::source::ReadAt;
use ndgi_gpu::{Features, Interval, Options, Sunlight};
use std::fmt::Debug;
use std::io;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// What a read brought.
#[derive(Debug, Default)]
pub struct Arrived {
    /// The tile's features, where they were asked for.
    pub features: Option<Features>,
    /// What it sees of the sun, where that was asked for.
    pub interval: Option<Interval>,
}

/// Why a read failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadError {
    /// Whether another try would fail too.
    pub is_lasting: bool,
    /// In words.
    pub what: String,
}

/// A read that is done.
#[derive(Debug)]
pub struct Done {
    /// [`Read::ticket`].
    pub ticket: u64,
    /// What it brought.
    pub what: Result<Arrived, ReadError>,
}

/// Who reads: [`Threads`], or what a game has for its own files. Its methods are called by the frame's thread, and must not wait.
pub trait Reader: Debug + Send {
    /// Starts a read. `known`: of a tile on the device, what its intervals are unpacked from.
    fn start(&mut self, pyramid: &Arc<Pyramid>, options: &Options, read: Read, known: Option<Sunlight>);

    /// What is done since the last call.
    fn done(&mut self) -> Vec<Done>;
}

/// What was read of a tile and is not on the device yet.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    pub features: Option<Features>,
    pub interval: Option<Interval>,
}

/// Reads a tile and unpacks it, as a [`Reader`] does on a thread of its own.
///
/// # Errors
/// A lasting one for a damaged tile; one that may pass where the source cannot be read.
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

/// Reads on threads of its own, which end when it is dropped.
#[derive(Debug)]
pub struct Threads {
    jobs: Sender<Job>,
    done: Receiver<Done>,
}

impl Threads {
    /// So many threads. Two suffice for a disk; over a network one for each read of [`crate::Budgets::reads`].
    ///
    /// # Errors
    /// What the system says.
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

/// A source behind a slow line, for tests: each read takes a latency, and its bytes take their time.
#[derive(Debug)]
pub struct Slow<S> {
    /// The source.
    pub source: S,
    /// Of each read.
    pub latency: Duration,
    /// Bytes a second, shared by all reads.
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
