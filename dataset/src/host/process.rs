//! Which process on which machine: what temporary names and locks are told apart by.

use serde::{Deserialize, Serialize};
use std::fs;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::path::Path;
use std::sync::LazyLock;

/// A process, as others know it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Process {
    /// Name of its machine, for people.
    pub host: String,
    /// Digest of what tells machines (and containers, whose process ids are their own) apart.
    pub machine: String,
    /// Identifies the time from one start of the machine to the next.
    pub boot: String,
    /// Its process id.
    pub pid: u32,
    /// When it started, in the system's ticks since the machine did; 0 where the system does not tell.
    pub start: u64,
}

impl Process {
    /// This process.
    pub fn this() -> &'static Process {
        static THIS: LazyLock<Process> = LazyLock::new(|| {
            let line = |path: &str| fs::read_to_string(path).unwrap_or_default().trim().to_owned();
            let host = line("/proc/sys/kernel/hostname");
            let namespace = fs::read_link("/proc/self/ns/pid").unwrap_or_default();
            let machine = format!("{host}/{}/{}", line("/etc/machine-id"), namespace.display());
            let pid = std::process::id();
            Process {
                host: if host.is_empty() { "this machine".to_owned() } else { host },
                machine: blake3::hash(machine.as_bytes()).to_hex()[..8].to_owned(),
                boot: line("/proc/sys/kernel/random/boot_id"),
                pid,
                start: started(pid).unwrap_or(0),
            }
        });
        &THIS
    }

    /// Whether it surely runs no more. Of processes on other machines nobody here knows.
    pub fn is_gone(&self) -> bool {
        let this = Process::this();
        let is_known = self.machine == this.machine && is_told();
        is_known && (self.boot != this.boot || started(self.pid) != Some(self.start))
    }
}

/// A number that no other process is likely to have, for names only.
pub(super) fn random() -> u32 {
    static RANDOM: LazyLock<u32> = LazyLock::new(|| RandomState::new().build_hasher().finish() as u32);
    *RANDOM
}

/// Whether a process of this machine runs; where the system does not tell, it may.
pub(super) fn runs(pid: u32) -> bool {
    !is_told() || started(pid).is_some()
}

/// Whether the system tells of its processes.
fn is_told() -> bool {
    Path::new("/proc/self/stat").exists()
}

/// When a process started, in ticks; `None` where there is none.
fn started(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // (The second word is the program's name in brackets, which may hold anything; the third, the process's
    // state, follows.)
    let words: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    // A process that ended, and that nobody asked about yet.
    if matches!(words.first(), Some(&"Z" | &"X")) {
        return None;
    }
    words.get(19)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_gone_when_its_id_is_free_or_anothers() {
        let this = Process::this().clone();
        assert!(!this.is_gone() && runs(this.pid) && this.machine.len() == 8);
        if !is_told() {
            return;
        }
        assert!(!runs(u32::MAX));
        assert!(Process { pid: u32::MAX, ..this.clone() }.is_gone());
        assert!(Process { start: this.start + 1, ..this.clone() }.is_gone());
        assert!(Process { boot: "before".to_owned(), ..this.clone() }.is_gone());
        // What another machine's processes do is not seen from here.
        assert!(!Process { pid: u32::MAX, machine: "other".to_owned(), ..this }.is_gone());
        // One that ended and was not waited for is gone.
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let start = std::time::Instant::now();
        while runs(child.id()) && start.elapsed().as_secs() < 20 {
            std::thread::yield_now();
        }
        assert!(!runs(child.id()));
        child.wait().unwrap();
    }
}
