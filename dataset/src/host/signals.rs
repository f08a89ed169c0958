//! Requests to stop: Ctrl-C, a termination request, a terminal that closes.
//!
//! Long loops look at [`interrupted`] and return [`Error::Interrupted`]. Code that cannot check (a library in
//! C++, one long sort) is ended from the thread that waits for signals: every file is complete or absent, so
//! the process may end anywhere, and the next run continues.

use super::system::{INTERRUPT, leave, on_signals};
use crate::{Error, Result};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Mutex, PoisonError, mpsc};
use std::thread;
use std::time::Duration;

/// How long the process may take to end by itself.
const GRACE: Duration = Duration::from_millis(100);
/// How long a last line may take to be written.
const LAST_LINE: Duration = Duration::from_millis(40);

/// True once the process was asked to stop: long loops look at it and return [`Error::Interrupted`].
pub static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// The signal that asked.
static SIGNAL: AtomicI32 = AtomicI32::new(INTERRUPT);

/// Whether it was said that the process stops.
static SAID: AtomicBool = AtomicBool::new(false);

/// What is removed when the process ends by a signal.
static LEFTOVERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Whether the process was asked to stop.
pub fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// [`Error::Interrupted`] once the process was asked to stop: `stop_if_interrupted()?` in long loops.
pub fn stop_if_interrupted() -> Result<()> {
    if interrupted() { Err(Error::Interrupted) } else { Ok(()) }
}

/// The exit code of a process that was asked to stop: 128 and the signal's number (130, 143 or 129).
pub fn exit_code() -> u8 {
    128 + SIGNAL.load(Ordering::SeqCst) as u8
}

/// True if no message has said yet that the process stops; the caller is about to print one.
pub fn is_first_to_say() -> bool {
    !SAID.swap(true, Ordering::SeqCst)
}

/// Makes the three signals set [`INTERRUPTED`], and end the process after 0.1 s wherever it is; a second
/// signal ends it at once. Signals that are ignored (by `nohup`, or for a background job) stay so. `say`
/// writes an error's line.
pub fn catch(say: fn(&Error)) {
    on_signals(move |signal| {
        SIGNAL.store(signal, Ordering::SeqCst);
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            end(say);
        }
        let later = move || {
            thread::sleep(GRACE);
            end(say)
        };
        // (Where the system has no thread left, this one waits.)
        if thread::Builder::new().spawn(later).is_err() {
            later();
        }
    });
}

/// Ends the process where it is.
fn end(say: fn(&Error)) {
    if is_first_to_say() {
        // A terminal that takes no more lines must not keep the process.
        let (said, wait) = mpsc::channel();
        let line = move || {
            say(&Error::Interrupted);
            let _ = said.send(());
        };
        if thread::Builder::new().spawn(line).is_ok() {
            let _ = wait.recv_timeout(LAST_LINE);
        }
    }
    for path in LEFTOVERS.lock().unwrap_or_else(PoisonError::into_inner).iter() {
        let _ = fs::remove_file(path).or_else(|_| fs::remove_dir_all(path));
    }
    leave(exit_code().into());
}

/// A file or folder that is removed if the process ends by a signal, until this is dropped.
#[derive(Debug)]
pub struct RemovedAtSignal(PathBuf);

impl RemovedAtSignal {
    /// Of this path, from now on.
    pub fn new(path: &Path) -> Self {
        LEFTOVERS.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_owned());
        RemovedAtSignal(path.to_owned())
    }
}

impl Drop for RemovedAtSignal {
    fn drop(&mut self) {
        LEFTOVERS.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| *path != self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leftovers_are_known_until_they_are_dropped() {
        let known = |name: &str| {
            LEFTOVERS.lock().unwrap_or_else(PoisonError::into_inner).contains(&PathBuf::from(name))
        };
        let (a, b) = (RemovedAtSignal::new(Path::new("no/a")), RemovedAtSignal::new(Path::new("no/b")));
        drop(a);
        assert!(!known("no/a") && known("no/b"));
        drop(b);
        assert!(!known("no/b"));
    }
}
