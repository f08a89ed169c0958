//! The folder a bake writes to: usable, and its own while it works.

use crate::{Error, Result};
use dataset::{files, lock, store};
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

const EXPECTED: &str = "expected a folder for the dataset, or a free name for one (--out)";

/// Tells of a file that is in the way of the dataset's folder.
pub fn expect_free(out: &Path) -> Result<()> {
    if let Some(file) = out.ancestors().find(|path| path.exists()).filter(|path| !path.is_dir()) {
        let file = if file == out { "it".to_owned() } else { file.display().to_string() };
        return Err(Error::invalid(out.display(), format!("{file} is a file; {EXPECTED}")));
    }
    Ok(())
}

/// Creates the dataset's folder, or tells what is in the way, before hours of tracing rather than after.
pub fn create(out: &Path) -> Result<()> {
    expect_free(out)?;
    let refused = |what: &str, error: std::io::Error| {
        Error::invalid(out.display(), format!("{what} ({error}); {EXPECTED} that this user may write to"))
    };
    files::create_folders(out).map_err(|e| refused("cannot be created", e))?;
    files::remove_stale_temporaries(out)?;
    let probe = files::temporary_beside(&out.join("probe"))?;
    let probed = std::fs::File::create(&probe).and_then(|_| std::fs::remove_file(&probe));
    probed.map_err(|e| refused("cannot be written to", e))
}

/// Begins the work in the dataset's folder. The folder of the work comes first: by it a later run knows the
/// folder for a bake's own.
pub fn begin(out: &Path) -> Result<()> {
    let work = out.join(store::WORK);
    files::create_folders(&work).map_err(Error::io(&work))
}

/// Ends it: the dataset stands. (What remains is no reason to fail.)
pub fn end(out: &Path) {
    let _ = std::fs::remove_dir(out.join(store::WORK));
}

/// Removes the folder if nothing but the lock is in it. (What remains is no reason to fail.)
pub fn leave(out: &Path) {
    let is_lock = |name: &OsStr| name == lock::LOCK || name == lock::CLAIM;
    let entries = std::fs::read_dir(out).map(|entries| entries.flatten().collect::<Vec<_>>());
    if entries.is_ok_and(|entries| entries.iter().all(|entry| is_lock(&entry.file_name()))) {
        [lock::CLAIM, lock::LOCK].iter().for_each(|name| _ = std::fs::remove_file(out.join(name)));
        let _ = std::fs::remove_dir(out);
    }
}

/// The path of a file from a folder: up as far as both have in common, then down. Both are absolute.
pub fn relative_to(folder: &Path, file: &Path) -> PathBuf {
    let common = file.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().count() - common;
    std::iter::repeat_n(Component::ParentDir, up).chain(file.components().skip(common)).collect()
}

/// Keeps other bakes out of the dataset's folder until it is dropped (or the process ends).
pub fn lock(out: &Path) -> Result<lock::Lock> {
    lock::lock(out, "another bake is writing here", "wait for it, or choose another --out")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_go_up_and_down() {
        let of = |folder: &str, file: &str| relative_to(Path::new(folder), Path::new(file));
        assert_eq!(of("/a/b", "/a/b/c.toml"), Path::new("c.toml"));
        assert_eq!(of("/a/b", "/a/d/c.toml"), Path::new("../d/c.toml"));
        assert_eq!(of("/a/b", "/c.toml"), Path::new("../../c.toml"));
    }
}
