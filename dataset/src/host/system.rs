//! What differs between operating systems, in one place. The rest of the workspace is portable Rust, apart
//! from advice on memory pages in `baker/src/trace/memory_pages.rs`.
//!
//! Linux is what is tested. Elsewhere this compiles and does less: see each function.

use std::fs::File;
use std::io;
use std::path::Path;

pub use lock::{Guard, guard, is_local};
pub use stop::{INTERRUPT, leave, on_signals};

/// Reads from a place in a file that threads share.
pub trait ReadExactAt {
    /// Fills `bytes` from `offset` on, wherever other reads are.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] where the file ends before; others of the system.
    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()>;
}

#[cfg(unix)]
impl ReadExactAt for File {
    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(self, bytes, offset)
    }
}

#[cfg(windows)]
impl ReadExactAt for File {
    fn read_exact_at(&self, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
        while !bytes.is_empty() {
            match std::os::windows::fs::FileExt::seek_read(self, bytes, offset) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(read) => (offset, bytes) = (offset + read as u64, &mut bytes[read..]),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// The bytes that are free to this user on the file system of a folder; `None` where the system does not
/// tell.
pub fn free_bytes(folder: &Path) -> Option<u64> {
    #[cfg(unix)]
    {
        let found = rustix::fs::statvfs(folder).ok()?;
        found.f_bavail.checked_mul(found.f_frsize)
    }
    #[cfg(not(unix))]
    {
        let _ = folder;
        None
    }
}

/// Raises this process's limit of open files to what the system allows, at most 65,536: many systems begin
/// with 1024, some with 256. Does nothing where that fails.
pub fn allow_more_open_files() {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let limits = getrlimit(Resource::Nofile);
        let most = limits.maximum.unwrap_or(u64::MAX).min(1 << 16);
        // (macOS refuses more than 10240, whatever it says.)
        for files in [most, most.min(10240)] {
            let more = Rlimit { current: Some(files), ..limits };
            if limits.current.is_none_or(|now| now >= files) || setrlimit(Resource::Nofile, more).is_ok() {
                return;
            }
        }
    }
}

#[cfg(target_os = "linux")]
mod lock {
    use std::fs;
    use std::io;
    use std::os::linux::net::SocketAddrExt;
    use std::os::unix::fs::MetadataExt;
    use std::os::unix::net::{SocketAddr, UnixListener};
    use std::path::Path;

    /// Holds a name until it is dropped.
    pub type Guard = UnixListener;

    /// A name that one process of this machine at a time can have; the system frees it when the process ends.
    pub fn guard(folder: &Path) -> io::Result<Guard> {
        let metadata = fs::metadata(folder)?;
        let name = format!("temporal-lightmaps/{}/{}", metadata.dev(), metadata.ino());
        UnixListener::bind_addr(&SocketAddr::from_abstract_name(name)?)
    }

    /// Whether a folder lies on one of the file systems that are known to be this machine's alone.
    pub fn is_local(folder: &Path) -> bool {
        /// ext2 to ext4, xfs, btrfs, tmpfs, ramfs, overlayfs, zfs, f2fs, bcachefs, as `statfs` has them.
        const LOCAL: [u64; 9] = [
            0xef53,
            0x5846_5342,
            0x9123_683e,
            0x0102_1994,
            0x8584_58f6,
            0x794c_7630,
            0x2fc1_2fc1,
            0xf2f5_2010,
            0xca45_1a4e,
        ];
        rustix::fs::statfs(folder).is_ok_and(|found| LOCAL.contains(&((found.f_type as u64) & 0xffff_ffff)))
    }
}

#[cfg(not(target_os = "linux"))]
mod lock {
    use std::io;
    use std::path::Path;

    /// There is none.
    #[derive(Debug)]
    pub enum Guard {}

    /// No names that end with their process: two processes that take over a dead one's claim at the same
    /// instant may both succeed.
    pub fn guard(_folder: &Path) -> io::Result<Guard> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// Windows locks files on its network drives too, for all machines; of other systems that is not known,
    /// and a claim is made besides.
    pub fn is_local(_folder: &Path) -> bool {
        cfg!(windows)
    }
}

#[cfg(unix)]
mod stop {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;
    use std::fs;

    /// The number of the signal that Ctrl-C sends.
    pub const INTERRUPT: i32 = SIGINT;

    /// Calls `told` on a thread of its own for each request to stop, by its signal. Signals that are ignored
    /// (by `nohup`, or for a background job) stay so.
    pub fn on_signals(told: impl Fn(i32) + Send + 'static) {
        let ignored = ignored();
        let signals = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
        // Where the system has no signals or threads to give, the process ends as it would without.
        let Ok(mut signals) = Signals::new(signals) else { return };
        let _ = std::thread::Builder::new().spawn(move || signals.forever().for_each(told));
    }

    /// Ends the process where it is, without running what is registered for its end.
    pub fn leave(code: i32) -> ! {
        signal_hook::low_level::exit(code)
    }

    /// The signals that this process ignores, one bit each, where the system tells.
    fn ignored() -> u64 {
        let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
    }
}

#[cfg(not(unix))]
mod stop {
    /// The number of the signal that Ctrl-C sends.
    pub const INTERRUPT: i32 = 2;

    /// Nobody is told: the system ends the process, which it may do anywhere.
    pub fn on_signals(_told: impl Fn(i32) + Send + 'static) {}

    /// Ends the process where it is.
    #[allow(clippy::disallowed_methods, reason = "called when a signal has asked for it, as binaries do")]
    pub fn leave(code: i32) -> ! {
        std::process::exit(code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_read_from_their_place_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, b"0123456789").unwrap();
        let file = File::open(path).unwrap();
        let mut bytes = [0; 4];
        for (offset, expected) in [(6, b"6789"), (0, b"0123"), (3, b"3456")] {
            ReadExactAt::read_exact_at(&file, &mut bytes, offset).unwrap();
            assert_eq!(&bytes, expected);
        }
        let error = ReadExactAt::read_exact_at(&file, &mut bytes, 7).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }
}
