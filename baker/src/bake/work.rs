//! The work folder: what a bake has done so far, inside the dataset's folder, until the dataset stands.
//!
//! While tracing, memory holds the blocks being worked on, never the page; a killed bake continues with what was written. It holds
//!
//! | file | what | written |
//! |---|---|---|
//! | `layers.json` | the digests of the layers that are traced | at the beginning |
//! | `block-N.bin` | the sums of a block ([`BlockState`]) | after each step of the block |
//! | [`DIRECT`] | the mean of each light over the trial samples | before the rounds |
//! | [`CACHE`] | the solved cache, both halves | before the rounds |
//! | [`UNSETTLED`] | the passes after which the cache had not settled | in its place |
//! | [`PIVOT`] | the class of deviation that gets the mean number of samples | after the first round |
//! | `open-R.bin` | the cells that go on towards a target after round R | after each round |
//! | [`ROUNDS`] | what each round reached | after each round |
//!
//! Whatever later work is decided by is kept, and read by a run that continues: it finds more samples than were there when that was
//! decided, and would decide otherwise.

use super::json;
use super::state::BlockState;
use crate::{Error, Result};
use dataset::files::write_atomically;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Name of the folder of work in progress inside a dataset.
const FOLDER: &str = dataset::store::WORK;

/// The layers.
const LAYERS: &str = "layers.json";
/// The mean of each light.
pub const DIRECT: &str = "direct.json";
/// The cache.
pub const CACHE: &str = "cache.bin";
/// That there is none.
pub const UNSETTLED: &str = "unsettled.json";
/// Who gets the mean number of samples.
pub const PIVOT: &str = "pivot.json";
/// The log of the rounds: there once one is finished.
pub const ROUNDS: &str = "rounds.json";

/// The folder of one piece of work.
#[derive(Debug)]
pub struct WorkFolder {
    root: PathBuf,
    layers: usize,
    sampled: usize,
}

impl WorkFolder {
    /// Opens or creates the folder of the work with this digest below `dataset`, which traces the layers of these digests from so many
    /// sampled lights, and removes those of other work.
    pub fn open(dataset: &Path, digest: &str, layers: &[String], sampled: usize) -> Result<Self> {
        for other in Self::others(dataset, digest) {
            let _ = std::fs::remove_dir_all(other);
        }
        let root = dataset.join(FOLDER).join(&digest[..16]);
        std::fs::create_dir_all(&root).map_err(Error::io(&root))?;
        let folder = WorkFolder { root, layers: layers.len(), sampled };
        folder.write(LAYERS, &layers)?;
        Ok(folder)
    }

    /// The work of other bakes, which [`WorkFolder::open`] forgets.
    fn others(dataset: &Path, digest: &str) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(dataset.join(FOLDER)).into_iter().flatten().flatten();
        entries.map(|e| e.path()).filter(|path| !path.ends_with(&digest[..16])).collect()
    }

    /// The unfinished work of other bakes, each with whether it has a finished round. What was left behind when all of its layers were
    /// kept (which `is_kept` tells by their digests) is none.
    pub fn unfinished(dataset: &Path, digest: &str, is_kept: impl Fn(&str) -> bool) -> Vec<bool> {
        let unfinished =
            Self::others(dataset, digest).into_iter().filter(|path| !is_finished(path, &is_kept));
        unfinished.map(|path| path.join(ROUNDS).exists()).collect()
    }

    /// Removes the work of other bakes that was left behind so.
    pub fn remove_finished(dataset: &Path, digest: &str, is_kept: impl Fn(&str) -> bool) {
        for path in Self::others(dataset, digest).into_iter().filter(|path| is_finished(path, &is_kept)) {
            let _ = std::fs::remove_dir_all(path);
        }
    }

    /// Removes it, for all that was traced is kept; what cannot be removed is found to be finished by a later bake.
    pub fn remove(self) {
        let _ = std::fs::remove_dir_all(&self.root);
        // (The last one takes the folder of all work with it.)
        let _ = self.root.parent().map(std::fs::remove_dir);
    }

    /// Forgets all work below `dataset`.
    pub fn clear(dataset: &Path) -> Result<()> {
        dataset::files::remove_folder(&dataset.join(FOLDER))
    }

    /// The path of a file of the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Reads a block, or gives an empty one if nothing fitting was written yet.
    pub fn read_block(&self, block: usize, texels: usize) -> Result<BlockState> {
        let path = self.block_path(block);
        let empty = || BlockState::empty(texels, self.layers, self.sampled);
        match std::fs::read(&path) {
            Ok(bytes) => {
                Ok(BlockState::from_bytes(&bytes, texels, self.layers, self.sampled).unwrap_or_else(empty))
            }
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(empty()),
            Err(e) => Err(Error::io(&path)(e)),
        }
    }

    /// Writes a block, replacing what was there.
    pub fn write_block(&self, block: usize, state: &BlockState) -> Result<()> {
        // Whole or absent for a run that is killed; not synced, since after a power failure the work may start again.
        let path = self.block_path(block);
        let temporary = path.with_extension("partial");
        std::fs::write(&temporary, state.to_bytes(self.layers, self.sampled)).map_err(Error::io(&path))?;
        std::fs::rename(&temporary, &path).map_err(Error::io(&path))
    }

    fn block_path(&self, block: usize) -> PathBuf {
        self.root.join(format!("block-{block:07}.bin"))
    }

    /// The value that was kept under a name; `None` where none was, or no such.
    pub fn read<T: DeserializeOwned>(&self, name: &str) -> Option<T> {
        std::fs::read(self.path(name)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok())
    }

    /// Keeps a value under a name.
    pub fn write<T: Serialize>(&self, name: &str, value: &T) -> Result<()> {
        write_atomically(&self.path(name), &json::bytes(value, name)?)
    }

    /// The value that was kept under a name, or else the one that is found now, which is kept.
    pub fn kept<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        find: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        if let Some(kept) = self.read(name) {
            return Ok(kept);
        }
        let found = find()?;
        self.write(name, &found)?;
        Ok(found)
    }
}

/// Whether all layers that a folder's work is of are kept.
fn is_finished(folder: &Path, is_kept: impl Fn(&str) -> bool) -> bool {
    let layers =
        || -> Option<Vec<String>> { serde_json::from_slice(&std::fs::read(folder.join(LAYERS)).ok()?).ok() };
    layers().is_some_and(|layers| layers.iter().all(|digest| is_kept(digest)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_kept_and_torn_ones_are_not_believed() {
        let dir = tempfile::tempdir().unwrap();
        let digest = "0123456789abcdef0123";
        let names = |names: [&str; 3]| names.map(str::to_owned);
        let folder = WorkFolder::open(dir.path(), digest, &names(["a", "b", "c"]), 2).unwrap();
        assert_eq!(folder.read_block(5, 4).unwrap(), BlockState::empty(4, 3, 2));
        let state = BlockState { round: 2, wants: vec![1; 8], ..BlockState::empty(4, 3, 2) };
        folder.write_block(5, &state).unwrap();
        assert_eq!(folder.read_block(5, 4).unwrap(), state);
        assert_eq!(folder.read_block(5, 3).unwrap(), BlockState::empty(3, 3, 2));
        let path = folder.block_path(5);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert_eq!(folder.read_block(5, 4).unwrap(), BlockState::empty(4, 3, 2));
        // Its work is unfinished, whatever is kept of its layers, until all of them are.
        let other = "fedcba9876543210fedc";
        let unfinished = |of: &str, missing: &[&str]| {
            WorkFolder::unfinished(dir.path(), of, |layer| !missing.contains(&layer))
        };
        assert!(unfinished(digest, &["a", "b", "c"]).is_empty());
        assert_eq!(unfinished(other, &["b"]), [false]);
        folder.write(ROUNDS, &[1]).unwrap();
        assert_eq!(unfinished(other, &["b"]), [true]);
        // What is left of finished work is none, and goes.
        WorkFolder::remove_finished(dir.path(), other, |layer| layer != "b");
        assert!(folder.root.exists() && unfinished(other, &[]).is_empty());
        WorkFolder::remove_finished(dir.path(), other, |_| true);
        assert!(!folder.root.exists());
        // Another bake's work is removed.
        let folder = WorkFolder::open(dir.path(), digest, &names(["a", "b", "c"]), 2).unwrap();
        let new = WorkFolder::open(dir.path(), other, &[], 2).unwrap();
        assert!(!folder.root.exists() && new.root.exists());
        new.remove();
        assert!(!dir.path().join(FOLDER).exists());
    }

    #[test]
    fn what_was_decided_once_stays_decided() {
        let dir = tempfile::tempdir().unwrap();
        let folder = WorkFolder::open(dir.path(), "0123456789abcdef", &[], 0).unwrap();
        assert_eq!(folder.kept(DIRECT, || Ok(vec![1.5f32])).unwrap(), [1.5]);
        assert_eq!(folder.kept(DIRECT, || Ok(vec![2.5f32])).unwrap(), [1.5]);
        assert_eq!(folder.kept(PIVOT, || Ok(None::<i16>)).unwrap(), None);
        assert_eq!(folder.kept(PIVOT, || Ok(Some(3))).unwrap(), None);
        std::fs::write(folder.path(DIRECT), b"torn [").unwrap();
        assert_eq!(folder.kept(DIRECT, || Ok(vec![2.5f32])).unwrap(), [2.5]);
        assert_eq!(folder.read::<Vec<f32>>(ROUNDS), None);
    }
}
