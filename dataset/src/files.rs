//! Files that are whole or absent: written under a temporary name, synced, renamed.

use crate::{Error, Result};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// What stands between a file's name and its writer's process id in the name of a temporary.
const MARK: &str = ".tmp-";

/// Writes `bytes` to `path` so that a reader sees the old content or the new, never a part.
/// On an error the old content stays and the temporary is removed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically_with(path, |file| file.write_all(bytes))
}

/// [`write_atomically`] for content that is produced piece by piece.
pub fn write_atomically_with(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    let temporary = temporary_beside(path)?;
    let written = (|| {
        let mut file = File::create(&temporary)?;
        write(&mut file)?;
        file.sync_all()?;
        drop(file);
        fs::rename(&temporary, path)
    })();
    if let Err(source) = written {
        let _ = fs::remove_file(&temporary);
        expect_folder(path)?;
        return Err(Error::Io { path: path.to_owned(), source });
    }
    // The rename itself reaches the disk with the folder; not every system lets a folder be synced.
    if let Some(folder) = folder_of(path)
        && let Ok(folder) = File::open(folder)
    {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// An error unless the folder in which a file is to be written exists: to be asked before the work, not after it.
///
/// # Errors
/// `Invalid`, with the folder.
pub fn expect_folder(path: &Path) -> Result<()> {
    match folder_of(path).filter(|folder| !folder.is_dir()) {
        None => Ok(()),
        Some(folder) => {
            let there = if folder.exists() { "is no folder" } else { "does not exist" };
            let what = format!("{} {there}: expected a file name in an existing folder", folder.display());
            Err(Error::invalid(path.display(), what))
        }
    }
}

/// An error unless the path ends as it should (no output may replace a bundle or a manifest by mistake), in a folder that is there.
///
/// # Errors
/// `Invalid`, with the option it was given by, or the folder.
pub fn expect_output(path: &Path, extension: &str, option: &str) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)) {
        return expect_folder(path);
    }
    Err(Error::invalid(option, format!("{}: expected a name that ends in .{extension}", path.display())))
}

/// Puts a second name on the content of `from`: a hard link where the file system has them, else a copy. Atomic, and
/// replaces what stood at `to`.
pub fn link_or_copy(from: &Path, to: &Path) -> Result<()> {
    let temporary = temporary_beside(to)?;
    let linked = fs::hard_link(from, &temporary)
        .or_else(|_| fs::copy(from, &temporary).map(drop))
        .and_then(|()| fs::rename(&temporary, to));
    // Renaming one link of a file onto another does nothing and leaves both names.
    let _ = fs::remove_file(&temporary);
    linked.map_err(Error::io(to))
}

/// Removes a folder with all that is in it; none is fine.
///
/// # Errors
/// `Io` if it is still there.
pub fn remove_folder(path: &Path) -> Result<()> {
    match std::fs::remove_dir_all(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(Error::io(path)(e)),
        _ => Ok(()),
    }
}

/// Removes the temporaries that processes which no longer run left in `folder`.
pub fn remove_stale_temporaries(folder: &Path) -> Result<()> {
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        let name = entry.file_name();
        let Some(pid) = name.to_str().and_then(writer_of) else { continue };
        if pid != std::process::id() && !runs(pid) {
            let _ = fs::remove_file(entry.path());
        }
    }
    Ok(())
}

/// A name for a temporary in the folder of `path` that no other writer uses.
fn temporary_beside(path: &Path) -> Result<PathBuf> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
        return Err(Error::invalid(path.display(), "not the name of a file"));
    };
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    Ok(path.with_file_name(format!(".{name}{MARK}{}-{count}", std::process::id())))
}

/// The process id in the name of a temporary; `None` for every other name.
fn writer_of(name: &str) -> Option<u32> {
    let (_, writer) = name.strip_prefix('.')?.rsplit_once(MARK)?;
    let (pid, count) = writer.split_once('-')?;
    count.parse::<u64>().ok()?;
    pid.parse().ok()
}

/// Whether a process runs, where the system tells; elsewhere temporaries are left alone.
fn runs(pid: u32) -> bool {
    let processes = Path::new("/proc");
    !processes.join("self").exists() || processes.join(pid.to_string()).exists()
}

fn folder_of(path: &Path) -> Option<&Path> {
    match path.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Some(Path::new(".")),
        folder => folder,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_new_content_replaces_the_old_and_nothing_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, b"old").unwrap();
        write_atomically(&path, b"new content").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new content");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_full_disk_leaves_the_old_content_and_no_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, b"old").unwrap();
        // The disk is full after the first half of the content.
        let error = write_atomically_with(&path, |file| {
            file.write_all(b"new con")?;
            Err(io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert!(error.to_string().contains("a.bin"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_cannot_be_replaced_is_an_error_and_leaves_no_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::create_dir_all(path.join("inside")).unwrap();
        write_atomically(&path, b"x").unwrap_err();
        let error = write_atomically(&folder.path().join("missing/a"), b"x").unwrap_err().to_string();
        assert!(error.contains("missing/a") && error.contains("does not exist: expected"), "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        fs::write(folder.path().join("file"), b"x").unwrap();
        let error = write_atomically(&folder.path().join("file/a"), b"x").unwrap_err().to_string();
        assert!(error.contains("file/a") && error.contains("file is no folder"), "{error}");
    }

    #[test]
    fn temporaries_of_dead_processes_go_and_other_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        // No process has the largest id.
        let stale = folder.path().join(format!(".a.exr{MARK}{}-0", u32::MAX));
        let own = folder.path().join(format!(".a.exr{MARK}{}-0", std::process::id()));
        let foreign = folder.path().join(".a.tmp-notes");
        for path in [&stale, &own, &foreign] {
            fs::write(path, b"x").unwrap();
        }
        remove_stale_temporaries(folder.path()).unwrap();
        assert_eq!(stale.exists(), !Path::new("/proc/self").exists());
        assert!(own.exists() && foreign.exists());
    }

    #[test]
    fn a_link_replaces_and_leaves_no_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("from"), folder.path().join("to"));
        fs::write(&from, b"one").unwrap();
        fs::write(&to, b"before").unwrap();
        for _ in 0..2 {
            link_or_copy(&from, &to).unwrap();
            assert_eq!(fs::read(&to).unwrap(), b"one");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
