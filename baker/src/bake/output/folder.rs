//! The folder a bake writes to: usable, and its own while it works.

use crate::bake::forecast::DiskSpace;
use crate::bake::layers::{Layers, Texel};
use crate::bake::prepare::Options;
use crate::bake::store::{Charts, WorkFolder};
use crate::{Error, Result};
use dataset::host::{files, lock};
use dataset::store;
use dataset::store::Writer;
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

const EXPECTED: &str = "expected a folder for the dataset, or a free name for one (--out)";

/// Tells of a file that is in the way of the dataset's folder.
pub fn check_no_file_in_the_way(out: &Path) -> Result<()> {
    if let Some(file) = out.ancestors().find(|path| path.exists()).filter(|path| !path.is_dir()) {
        let file = if file == out { "it".to_owned() } else { file.display().to_string() };
        return Err(Error::invalid(out.display(), format!("{file} is a file; {EXPECTED}")));
    }
    Ok(())
}

/// The output folder of a bake, which no other bake writes to until this is dropped.
pub struct OutputFolder {
    root: PathBuf,
    /// The layers kept in it.
    pub layers: Layers,
    _lock: lock::Lock,
}

impl OutputFolder {
    /// Creates and locks it.
    ///
    /// # Errors
    /// [`Error::Invalid`] where it cannot be created or written to; [`Error::Unready`] while another bake has
    /// it.
    pub fn take(out: &Path) -> Result<Self> {
        create(out)?;
        Ok(OutputFolder { root: out.to_owned(), layers: Layers::new(out), _lock: lock(out)? })
    }

    /// Its path.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Begins the work: with `--force` what was kept goes; `charts` are kept for the next bake.
    ///
    /// # Errors
    /// [`Error::Unready`] where the disk has not room for it.
    pub fn begin(&self, disk: &DiskSpace, options: &Options, charts: Charts) -> Result<Writer> {
        disk.check_free_space(&self.root, (options.free_bytes)(&self.root))?;
        // The folder of the work comes first: by it a later run knows the folder for a bake's own.
        let work = self.root.join(store::WORK);
        files::create_folders(&work).map_err(Error::io(&work))?;
        let writer = Writer::create(&self.root)?;
        if options.force {
            WorkFolder::clear(&self.root)?;
            self.layers.clear()?;
        }
        self.layers.finish_changes()?;
        // (Nothing but time is lost where charts cannot be kept.)
        if self.layers.create().is_ok() {
            charts.keep(&self.root);
        }
        Ok(writer)
    }

    /// The covered texels of the kept layers with this base.
    ///
    /// # Errors
    /// [`Error::Invalid`] where somebody changed the folder.
    pub fn texels(&self, base: &str) -> Result<Vec<Texel>> {
        let what = "the layers just traced cannot be read: was the folder changed?";
        self.layers.texels(base).ok_or_else(|| Error::invalid(self.root.display(), what))
    }

    /// Ends the work: the dataset stands. (What remains is no reason to fail.)
    pub fn end(&self) {
        let _ = std::fs::remove_dir(self.root.join(store::WORK));
    }
}

impl Drop for OutputFolder {
    /// Removes the folder if nothing but the lock is in it. (What remains is no reason to fail.)
    fn drop(&mut self) {
        let is_lock = |name: &OsStr| name == lock::LOCK || name == lock::CLAIM;
        let entries = std::fs::read_dir(&self.root).map(|entries| entries.flatten().collect::<Vec<_>>());
        if entries.is_ok_and(|entries| entries.iter().all(|entry| is_lock(&entry.file_name()))) {
            [lock::CLAIM, lock::LOCK].iter().for_each(|name| _ = std::fs::remove_file(self.root.join(name)));
            let _ = std::fs::remove_dir(&self.root);
        }
    }
}

/// Creates the dataset's folder, or tells what is in the way, before hours of tracing rather than after.
fn create(out: &Path) -> Result<()> {
    check_no_file_in_the_way(out)?;
    let refused = |what: &str, error: std::io::Error| {
        Error::invalid(out.display(), format!("{what} ({error}); {EXPECTED} that this user may write to"))
    };
    files::create_folders(out).map_err(|e| refused("cannot be created", e))?;
    files::remove_stale_temporaries(out)?;
    let probe = files::temporary_beside(&out.join("probe"))?;
    let probed = std::fs::File::create(&probe).and_then(|_| std::fs::remove_file(&probe));
    probed.map_err(|e| refused("cannot be written to", e))
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
