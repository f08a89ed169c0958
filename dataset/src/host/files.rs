//! Files that are whole or absent: written under a temporary name, synced, renamed.

use super::process::{self, Process};
use super::signals::RemovedAtSignal;
use crate::{Error, Result};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// What stands between a file's name and its writer in the name of a temporary.
const MARK: &str = ".tmp-";
/// Most bytes of a file's name in that of its temporary, which then fits into the 255 bytes of most file
/// systems.
const MOST_OF_NAME: usize = 190;

/// Writes `bytes` to `path` so that a reader sees the old content or the new, never a part.
/// On an error the old content stays and the temporary is removed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically_with(path, |file| file.write_all(bytes))
}

/// [`write_atomically`] for content that is produced piece by piece.
pub fn write_atomically_with(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    write_unsynced_with(path, |file| {
        write(file)?;
        file.sync_all()
    })?;
    sync_folder_of(path);
    Ok(())
}

/// [`write_atomically_with`], but only a killed process leaves the old content or the new: after a power
/// failure any may be there, or none, unless the file and its folder are synced afterwards.
pub fn write_unsynced_with(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    let temporary = temporary_beside(path)?;
    let written = (|| {
        let mut file = File::create(&temporary)?;
        write(&mut file)?;
        drop(file);
        fs::rename(&temporary, path)
    })();
    written.map_err(|source| {
        let _ = fs::remove_file(&temporary);
        expect_folder(path).err().unwrap_or(Error::Io { path: path.to_owned(), source })
    })
}

/// A rename itself reaches the disk with the folder; not every system lets a folder be synced.
pub fn sync_folder_of(path: &Path) {
    if let Some(folder) = folder_of(path)
        && let Ok(folder) = File::open(folder)
    {
        let _ = folder.sync_all();
    }
}

/// Creates a folder and those around it, where they are missing. Each is an entry of the folder around it,
/// which is synced: what is written into a folder whose own name is lost is lost with it.
///
/// # Errors
/// Those of [`fs::create_dir_all`].
pub fn create_folders(path: &Path) -> io::Result<()> {
    let is_missing = |path: &&Path| !path.as_os_str().is_empty() && !path.exists();
    let missing: Vec<&Path> = path.ancestors().take_while(is_missing).collect();
    fs::create_dir_all(path)?;
    // (Also where it is there: who made it may have been killed before this.)
    sync_folder_of(path);
    missing.iter().skip(1).for_each(|folder| sync_folder_of(folder));
    Ok(())
}

/// Makes the entries of a folder durable, and those of the folders in it.
fn sync_folders(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            sync_folders(&entry.path());
        }
    }
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// An error unless the folder in which a file is to be written exists.
fn expect_folder(path: &Path) -> Result<()> {
    match folder_of(path).filter(|folder| !folder.is_dir()) {
        None => Ok(()),
        Some(folder) => {
            let there = if folder.exists() { "is no folder" } else { "does not exist" };
            let what = format!("{} {there}: expected a file name in an existing folder", folder.display());
            Err(Error::invalid(path.display(), what))
        }
    }
}

/// An error unless a file can be written there, for which one is made and removed: to be asked before the
/// work, not after it. What killed writers left in that folder is removed.
///
/// # Errors
/// `Invalid`, with the folder; `Io`.
pub fn expect_writable(path: &Path) -> Result<()> {
    expect_folder(path)?;
    expect_nameable(path)?;
    if path.is_dir() {
        return Err(Error::invalid(path.display(), "is a folder; expected the name of a file to write"));
    }
    let temporary = temporary_beside(path)?;
    File::create(&temporary).and_then(|_| fs::remove_file(&temporary)).map_err(Error::io(path))?;
    remove_stale_temporaries(folder_of(path).unwrap_or(Path::new(".")))
}

/// An error unless a file can have this path: in UTF-8, and no longer than the file system allows.
///
/// # Errors
/// `Invalid`.
pub fn expect_nameable(path: &Path) -> Result<()> {
    if path.to_str().is_none() {
        return Err(Error::invalid(path.display(), "is not UTF-8; expected a name in UTF-8"));
    }
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::InvalidFilename => {
            let bytes = path.file_name().map_or(0, |name| name.len());
            let what = format!("a name of {bytes} bytes is too long here; expected a shorter one");
            Err(Error::invalid(path.display(), what))
        }
        _ => Ok(()),
    }
}

/// An error unless the path ends as it should (no output may replace a bundle or a manifest by mistake), in a
/// folder that is there and lets files be written.
///
/// # Errors
/// `Invalid`, with the option it was given by, or the folder; `Io`.
pub fn expect_output(path: &Path, extension: &str, option: &str) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)) {
        return expect_writable(path);
    }
    Err(Error::invalid(option, format!("{}: expected a name that ends in .{extension}", path.display())))
}

/// Puts a second name on the content of `from`: a hard link where the file system has them, else a copy.
/// Atomic, and replaces what stood at `to`.
pub fn link_or_copy(from: &Path, to: &Path) -> Result<()> {
    let temporary = temporary_beside(to)?;
    let linked = fs::hard_link(from, &temporary)
        .or_else(|_| fs::copy(from, &temporary).map(drop))
        .and_then(|()| fs::rename(&temporary, to));
    // Renaming one link of a file onto another does nothing and leaves both names.
    let _ = fs::remove_file(&temporary);
    linked.map_err(Error::io(to))
}

/// A folder that is filled under a temporary name beside its own, and appears whole or not at all: dropped
/// before [`NewFolder::finish`], it is removed.
#[derive(Debug)]
pub struct NewFolder {
    temporary: PathBuf,
    path: PathBuf,
    _at_signal: RemovedAtSignal,
}

impl NewFolder {
    /// Begins a folder at `path`, where there may be an empty one; what killed writers of this folder left is
    /// removed.
    ///
    /// # Errors
    /// `Invalid` if something stands there, or the folder around it is missing.
    pub fn create(path: &Path) -> Result<Self> {
        let taken = match fs::read_dir(path) {
            Ok(mut entries) => entries.next().is_some(),
            Err(_) => fs::symlink_metadata(path).is_ok(),
        };
        if taken {
            return Err(Error::invalid(
                path.display(),
                "stands there already; expected the name of a new folder",
            ));
        }
        expect_folder(path)?;
        expect_nameable(path)?;
        let temporary = temporary_beside(path)?;
        let name = start_of_name(path)?;
        let beside = folder_of(path).unwrap_or(Path::new("."));
        for entry in fs::read_dir(beside).map_err(Error::io(beside))?.flatten() {
            let found = entry.file_name();
            let found = found.to_str().filter(|found| found.starts_with(&format!(".{name}{MARK}")));
            if found.is_some_and(is_stale) {
                remove_folder(&entry.path())?;
            }
        }
        fs::create_dir(&temporary).map_err(Error::io(path))?;
        let at_signal = RemovedAtSignal::new(&temporary);
        Ok(NewFolder { temporary, path: path.to_owned(), _at_signal: at_signal })
    }

    /// The folder's place until it is finished.
    pub fn temporary(&self) -> &Path {
        &self.temporary
    }

    /// Gives the folder its name.
    pub fn finish(self) -> Result<()> {
        // What is in it is durable before its name is.
        sync_folders(&self.temporary);
        fs::rename(&self.temporary, &self.path).map_err(Error::io(&self.path))?;
        sync_folder_of(&self.path);
        Ok(())
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        // Gone if it was renamed.
        let _ = fs::remove_dir_all(&self.temporary);
    }
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

/// Removes the temporaries that processes of this machine which no longer run left in `folder`. Those of
/// other machines stay, for nobody here can tell whether their writers run.
pub fn remove_stale_temporaries(folder: &Path) -> Result<()> {
    for path in temporaries(folder)? {
        let is_stale = path.file_name().and_then(|name| name.to_str()).is_some_and(is_stale);
        if is_stale {
            let _ = fs::remove_file(path);
        }
    }
    Ok(())
}

/// The temporaries in `folder`, whoever left them or writes them now; none where there is no folder.
pub fn temporaries(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(Error::io(folder)(e)),
    };
    let paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<io::Result<Vec<_>>>();
    let mut paths = paths.map_err(Error::io(folder))?;
    paths.retain(|path| {
        path.file_name().and_then(|name| name.to_str()).is_some_and(|n| writer_of(n).is_some())
    });
    paths.sort();
    Ok(paths)
}

/// A name for a temporary in the folder of `path` that no other writer uses, on this machine or another:
/// `.<name>.tmp-<machine>-<process>-<random>-<number>`, with the start of a long name.
pub fn temporary_beside(path: &Path) -> Result<PathBuf> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let name = start_of_name(path)?;
    let (this, count) = (Process::this(), COUNT.fetch_add(1, Ordering::Relaxed));
    let writer = format!("{}-{}-{:08x}-{count}", this.machine, this.pid, process::random());
    Ok(path.with_file_name(format!(".{name}{MARK}{writer}")))
}

/// The start of a file's name, as it stands in those of its temporaries.
fn start_of_name(path: &Path) -> Result<&str> {
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
        return Err(Error::invalid(path.display(), "not the name of a file in UTF-8"));
    };
    let end = (0..=name.len().min(MOST_OF_NAME)).rev().find(|&end| name.is_char_boundary(end));
    Ok(&name[..end.unwrap_or_default()])
}

/// Who made a temporary.
struct Writer<'a> {
    machine: &'a str,
    pid: u32,
    random: u32,
}

/// The writer in the name of a temporary; `None` for every other name.
fn writer_of(name: &str) -> Option<Writer<'_>> {
    let (_, writer) = name.strip_prefix('.')?.rsplit_once(MARK)?;
    let mut words = writer.split('-');
    let (machine, pid, random, count) = (words.next()?, words.next()?, words.next()?, words.next()?);
    count.parse::<u64>().ok()?;
    let writer = Writer { machine, pid: pid.parse().ok()?, random: u32::from_str_radix(random, 16).ok()? };
    (words.next().is_none() && machine.len() == 8).then_some(writer)
}

/// Whether the writer of a temporary surely runs no more.
fn is_stale(name: &str) -> bool {
    let this = Process::this();
    writer_of(name).is_some_and(|writer| {
        let is_own = writer.pid == this.pid && writer.random == process::random();
        let is_free = writer.pid == this.pid || !process::runs(writer.pid);
        writer.machine == this.machine && !is_own && is_free
    })
}

fn folder_of(path: &Path) -> Option<&Path> {
    match path.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Some(Path::new(".")),
        folder => folder,
    }
}

/// The bytes of a JSON file for people; `place` is where it goes.
///
/// # Errors
/// [`Error::Invalid`] for a value that JSON cannot hold.
pub fn json(place: &Path, value: &impl serde::Serialize) -> Result<Vec<u8>> {
    let mut json =
        serde_json::to_vec_pretty(value).map_err(|error| Error::invalid(place.display(), error))?;
    json.push(b'\n');
    Ok(json)
}

/// Reads a JSON file.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    serde_json::from_slice(&fs::read(path).map_err(Error::io(path))?).map_err(Error::json(path))
}

/// Reads a JSON file whose values must have no fault.
pub fn read_checked<T: serde::de::DeserializeOwned>(
    path: &Path,
    fault: impl Fn(&T) -> Option<String>,
) -> Result<T> {
    let found: T = read_json(path)?;
    match fault(&found) {
        Some(what) => Err(Error::invalid(path.display(), what)),
        None => Ok(found),
    }
}

/// Whether a name is one plain component of a path on every system.
pub fn is_component(name: &str) -> bool {
    !name.is_empty() && name != "." && name != ".." && !name.contains(['/', '\\', ':', '\0'])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A temporary's name that a process of this machine left which no longer runs: no process has the
    /// largest id.
    fn stale_name(name: &str) -> String {
        format!(".{name}{MARK}{}-{}-0123abcd-0", Process::this().machine, u32::MAX)
    }

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
        let stale = folder.path().join(stale_name("a.exr"));
        let own = temporary_beside(&folder.path().join("a.exr")).unwrap();
        // Of an earlier process with this one's id; of another machine; no temporary.
        let earlier =
            folder.path().join(format!(".a.exr{MARK}{}-{}-0-0", Process::this().machine, std::process::id()));
        let elsewhere = folder.path().join(format!(".a.exr{MARK}01234567-{}-0-0", u32::MAX));
        // Of a container, by an id that is a living process's here.
        let container = folder.path().join(format!(".a.exr{MARK}89abcdef-{}-0-0", std::process::id()));
        let foreign = folder.path().join(".a.tmp-notes");
        for path in [&stale, &own, &earlier, &elsewhere, &container, &foreign] {
            fs::write(path, b"x").unwrap();
        }
        assert_eq!(temporaries(folder.path()).unwrap().len(), 5);
        remove_stale_temporaries(folder.path()).unwrap();
        assert_eq!(stale.exists(), !Path::new("/proc/self").exists());
        assert!(own.exists() && !earlier.exists() && elsewhere.exists() && foreign.exists());
        // Neither does the clock: the writer of an old file may run.
        assert!(container.exists());
        assert!(temporaries(&folder.path().join("none")).unwrap().is_empty());
    }

    #[test]
    fn a_new_folder_appears_whole_or_not_at_all() {
        let around = tempfile::tempdir().unwrap();
        let path = around.path().join("set");
        let names = || {
            let entries = fs::read_dir(around.path()).unwrap().flatten();
            entries.map(|entry| entry.file_name().into_string().unwrap()).collect::<Vec<_>>()
        };
        // Left by a killed writer of this folder, and by one of another.
        let (stale, other) = (stale_name("set"), stale_name("other"));
        fs::create_dir_all(around.path().join(&stale).join("data")).unwrap();
        fs::create_dir(around.path().join(&other)).unwrap();
        let begun = NewFolder::create(&path).unwrap();
        assert_eq!(names().contains(&stale), !Path::new("/proc/self").exists());
        fs::write(begun.temporary().join("file"), b"x").unwrap();
        assert!(!path.exists());
        drop(begun);
        fs::remove_dir(around.path().join(&other)).unwrap();
        assert!(names().is_empty(), "{:?}", names());
        // An empty folder may stand there.
        fs::create_dir(&path).unwrap();
        let begun = NewFolder::create(&path).unwrap();
        fs::write(begun.temporary().join("file"), b"x").unwrap();
        begun.finish().unwrap();
        assert_eq!((names(), fs::read(path.join("file")).unwrap()), (vec!["set".to_owned()], b"x".to_vec()));
        // What is not empty stays as it is.
        assert!(NewFolder::create(&path).unwrap_err().to_string().contains("stands there already"));
        assert!(NewFolder::create(&path.join("file")).unwrap_err().to_string().contains("already"));
        assert!(
            NewFolder::create(&around.path().join("a/b")).unwrap_err().to_string().contains("does not exist")
        );
        assert_eq!(names(), ["set"]);
    }

    #[test]
    fn names_of_255_bytes_are_written_and_longer_ones_refused_at_once() {
        let around = tempfile::tempdir().unwrap();
        // (The cut would fall into a character.)
        for name in ["a".repeat(255), format!("a{}", "é".repeat(127)), "b".repeat(240)] {
            let path = around.path().join(&name);
            expect_writable(&path).unwrap();
            write_atomically(&path, b"x").unwrap();
            let link = around.path().join(name.replace(['a', 'b'], "c"));
            link_or_copy(&path, &link).unwrap();
            assert_eq!(fs::read(&link).unwrap(), b"x");
            let folder = around.path().join(name.replace(['a', 'b'], "d"));
            NewFolder::create(&folder).unwrap().finish().unwrap();
            assert!(folder.is_dir());
            assert!(
                temporary_beside(&path)
                    .is_ok_and(|path| { writer_of(path.file_name().unwrap().to_str().unwrap()).is_some() })
            );
        }
        let long = around.path().join("a".repeat(256));
        for error in [expect_writable(&long).unwrap_err(), NewFolder::create(&long).unwrap_err()] {
            assert!(error.to_string().contains("a name of 256 bytes is too long here"), "{error}");
        }
        #[cfg(unix)]
        {
            use std::os::unix::ffi::OsStrExt;
            let latin = std::ffi::OsStr::from_bytes(b"map\xe9");
            for path in [around.path().join(latin), around.path().join(latin).join("a.csv")] {
                let _ = fs::create_dir(around.path().join(latin));
                let error = expect_nameable(&path).unwrap_err().to_string();
                assert!(error.contains("is not UTF-8"), "{error}");
                expect_writable(&path).unwrap_err();
            }
            assert!(NewFolder::create(&around.path().join(latin).join("set")).is_err());
        }
    }

    #[test]
    fn folders_are_made_with_those_around_them() {
        let around = tempfile::tempdir().unwrap();
        let path = around.path().join("a/b/c");
        for _ in 0..2 {
            create_folders(&path).unwrap();
            assert!(path.is_dir());
        }
        fs::write(path.join("file"), b"x").unwrap();
        create_folders(&path.join("file")).unwrap_err();
        create_folders(&path.join("file/d")).unwrap_err();
        // What killed writers left goes where something is about to be written.
        let stale = path.join(stale_name("other.png"));
        fs::write(&stale, b"x").unwrap();
        expect_writable(&path.join("a.png")).unwrap();
        assert_eq!(stale.exists(), !Path::new("/proc/self").exists());
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
