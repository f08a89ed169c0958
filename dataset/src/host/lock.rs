//! Keeps other processes out of a folder.
//!
//! On a local disk `flock` does it: the system frees the lock when a process ends, however it ends. On file
//! systems of a network it may be missing, or hold on one machine only. There the folder also holds a
//! *claim*, a file that only one process can create and that says which. A claim of a process that ended on
//! this machine is taken over. One of another machine is not, for nobody here can tell whether that process
//! runs: the error says which file to remove.

use super::process::Process;
use super::signals::RemovedAtSignal;
use super::system::{Guard, guard, is_local};
use crate::{Error, Result};
use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};

/// Name of the file that is locked, and says by whom.
pub const LOCK: &str = ".lock";
/// Name of the claim.
pub const CLAIM: &str = ".lock-claim";

/// A folder that is this process's own until this is dropped, or the process ends.
#[derive(Debug)]
pub struct Lock {
    _file: File,
    _claim: Option<Claim>,
}

/// A folder that is open to those who [`share`] it until this is dropped, or the process ends.
#[derive(Debug)]
pub struct Shared {
    _file: File,
}

/// The file that says whose a folder is, and what keeps this machine's other processes from taking it over at
/// the same time.
#[derive(Debug)]
struct Claim {
    path: PathBuf,
    _at_signal: RemovedAtSignal,
    _socket: Option<Guard>,
}

impl Drop for Claim {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// What the system gives to lock with; tests give less.
struct System<'a> {
    /// `flock`, without waiting.
    flock: &'a dyn Fn(&File) -> Result<(), TryLockError>,
    /// Whether a folder is known to be on a disk of this machine alone.
    is_local: &'a dyn Fn(&Path) -> bool,
    process: &'a Process,
}

/// Locks a folder. `who` says in an error what the other process does there, `advice` what else can be done.
///
/// # Errors
/// [`Error::Unready`] for the folder where another process has it, or may have it.
pub fn lock(folder: &Path, who: &str, advice: &str) -> Result<Lock> {
    let system = System { flock: &File::try_lock, is_local: &is_local, process: Process::this() };
    system.lock(folder, who, advice)
}

/// Keeps those out who [`lock`] the folder, as far as the file system can, and lets others in who share it:
/// for processes that write files of their own there.
///
/// # Errors
/// As [`lock`], which says what `who` and `advice` are.
pub fn share(folder: &Path, who: &str, advice: &str) -> Result<Shared> {
    let mut file = open(&folder.join(LOCK))?;
    let busy = |by: String| Error::unready(folder.display(), format!("{who}{by}; {advice}"));
    if matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)) {
        return Err(busy(here(holder(&mut file))));
    }
    // (Of another machine, which the file system did not tell.)
    let path = folder.join(CLAIM);
    match File::open(&path).ok().map(|mut claim| holder(&mut claim)) {
        Some(Some(by)) if by.is_gone() => Ok(Shared { _file: file }),
        Some(Some(by)) if by.machine == Process::this().machine => Err(busy(here(Some(by)))),
        Some(by) => Err(busy(elsewhere(by, &path))),
        None => Ok(Shared { _file: file }),
    }
}

impl System<'_> {
    fn lock(&self, folder: &Path, who: &str, advice: &str) -> Result<Lock> {
        let path = folder.join(LOCK);
        let mut file = open(&path)?;
        let is_locked = match (self.flock)(&file) {
            Ok(()) => true,
            Err(TryLockError::WouldBlock) => {
                let by = here(holder(&mut file));
                return Err(Error::unready(folder.display(), format!("{who}{by}; {advice}")));
            }
            // Not on this file system.
            Err(TryLockError::Error(_)) => false,
        };
        // A lock that a second opening of the file can have too is none.
        let second = open(&path)?;
        let is_exclusive = is_locked && matches!((self.flock)(&second), Err(TryLockError::WouldBlock));
        drop(second);
        let claim = match is_exclusive && (self.is_local)(folder) {
            true => None,
            false => Some(self.claim(folder, who, advice)?),
        };
        // Only for people, and for the error of who comes next.
        let written = file.set_len(0).and_then(|()| file.rewind()).and_then(|()| self.write(&mut file));
        written.map_err(Error::io(&path))?;
        Ok(Lock { _file: file, _claim: claim })
    }

    fn write(&self, file: &mut File) -> io::Result<()> {
        serde_json::to_writer(&mut *file, self.process)?;
        file.write_all(b"\n")?;
        file.sync_all()
    }

    fn claim(&self, folder: &Path, who: &str, advice: &str) -> Result<Claim> {
        let path = folder.join(CLAIM);
        let busy = |by: String| Error::unready(folder.display(), format!("{who}{by}; {advice}"));
        // Of this machine's processes one at a time gets beyond this line, whatever the file system does.
        let socket = match guard(folder) {
            Err(e) if e.kind() == ErrorKind::AddrInUse => return Err(busy(here(None))),
            socket => socket.ok(),
        };
        loop {
            match File::options().write(true).create_new(true).open(&path) {
                Ok(mut file) => {
                    let at_signal = RemovedAtSignal::new(&path);
                    let claim = Claim { path: path.clone(), _at_signal: at_signal, _socket: socket };
                    self.write(&mut file).map_err(Error::io(&path))?;
                    return Ok(claim);
                }
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
                Err(e) => return Err(Error::io(&path)(e)),
            }
            let by = match File::open(&path) {
                Ok(mut file) => holder(&mut file),
                // (A link to nothing is in the way of a new file, and opens none.)
                Err(e)
                    if e.kind() == ErrorKind::NotFound
                        && fs::symlink_metadata(&path).is_ok_and(|m| m.is_symlink()) =>
                {
                    return Err(Error::invalid(
                        path.display(),
                        "is a symbolic link to a file that is not there; expected a file that says who writes in this folder, or none: \
                         remove it",
                    ));
                }
                Err(e) if e.kind() == ErrorKind::NotFound => continue,
                Err(e) => return Err(Error::io(&path)(e)),
            };
            match by {
                Some(by) if by.is_gone() => fs::remove_file(&path).map_err(Error::io(&path))?,
                Some(by) if by.machine == self.process.machine => return Err(busy(here(Some(by)))),
                by => return Err(busy(elsewhere(by, &path))),
            }
        }
    }
}

fn open(path: &Path) -> Result<File> {
    File::options().read(true).write(true).create(true).truncate(false).open(path).map_err(Error::io(path))
}

/// Who wrote a lock file or a claim.
fn holder(file: &mut File) -> Option<Process> {
    let mut text = String::new();
    file.read_to_string(&mut text).ok()?;
    serde_json::from_str(&text).ok()
}

/// Who has a folder from this machine, where that is known.
fn here(by: Option<Process>) -> String {
    by.map_or(String::new(), |by| format!(" ({})", told(&by)))
}

/// Who has a folder from another machine, and what to do if that machine is dead.
fn elsewhere(by: Option<Process>, claim: &Path) -> String {
    let by = by.map_or("a process that cannot be told".to_owned(), |by| told(&by));
    let claim = claim.display();
    format!(" ({by}; whether it still runs is not seen from here: if it does not, remove {claim})")
}

fn told(process: &Process) -> String {
    format!("process {} on {}", process.pid, process.host)
}

#[cfg(test)]
#[path = "lock_tests.rs"]
mod tests;
