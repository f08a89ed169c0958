//! The work folder: what a bake has done so far, inside the dataset's folder, until the dataset stands.
//!
//! While tracing, memory holds the blocks being worked on, never the page; a killed bake continues with what
//! was written. Blocks, cells and cache carry a checksum ([`sealed`]). It holds
//!
//! | file | what | written |
//! |---|---|---|
//! | `layers.json` | the digests of the layers that are traced | at the beginning |
//! | `block-N.bin` | the sums of a block ([`BlockState`]) | after each step of the block |
//! | [`DIRECT_FILE`] | the mean of each light over the pilot samples | before the rounds |
//! | [`CACHE_FILE`] | the solved cache, both halves | before the rounds |
//! | [`UNSETTLED_FILE`] | the passes after which the cache had not settled | in its place |
//! | [`PIVOT_FILE`] | the class of deviation that gets the mean number of samples | after the first round |
//! | `unconverged-R.bin` | the cells that go on towards a target after round R | after each round |
//! | [`ROUNDS_FILE`] | what each round reached | after each round |
//!
//! Whatever later work is decided by is kept, and read by a run that continues: it finds more samples than
//! were there when that was decided, and would decide otherwise.

use super::json;
use super::sealed;
use super::state::{BlockState, SumKinds};
use crate::{Error, Result};
use dataset::host::files::write_atomically;
use rayon::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Name of the folder of work in progress inside a dataset.
const FOLDER: &str = dataset::store::WORK;

/// The layers.
const LAYERS: &str = "layers.json";
/// The mean of each light.
pub(crate) const DIRECT_FILE: &str = "direct.json";
/// The cache.
pub(crate) const CACHE_FILE: &str = "cache.bin";
/// That there is none.
pub(crate) const UNSETTLED_FILE: &str = "unsettled.json";
/// Who gets the mean number of samples.
pub(crate) const PIVOT_FILE: &str = "pivot.json";
/// The log of the rounds: there once one is finished.
pub(crate) const ROUNDS_FILE: &str = "rounds.json";

/// The folder of one piece of work.
#[derive(Debug)]
pub struct WorkFolder {
    root: PathBuf,
    /// Digest of the work.
    digest: String,
    kinds: SumKinds,
}

impl WorkFolder {
    /// Opens or creates the folder of the work with this digest below `dataset`, which traces the layers of
    /// these digests as sums of these kinds, and removes those of other work.
    pub fn open(dataset: &Path, digest: &str, layers: &[String], kinds: SumKinds) -> Result<Self> {
        for other in Self::others(dataset, digest) {
            let _ = std::fs::remove_dir_all(other);
        }
        let root = Self::root_of(dataset, digest);
        dataset::host::files::create_folders(&root).map_err(Error::io(&root))?;
        dataset::host::files::remove_stale_temporaries(&root)?;
        let folder = WorkFolder { root, digest: digest.to_owned(), kinds };
        folder.write(LAYERS, &layers)?;
        Ok(folder)
    }

    /// The work of other bakes, which [`WorkFolder::open`] forgets.
    fn others(dataset: &Path, digest: &str) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(dataset.join(FOLDER)).into_iter().flatten().flatten();
        entries.map(|e| e.path()).filter(|path| digest.is_empty() || !path.ends_with(&digest[..16])).collect()
    }

    /// The folder of the work with this digest below `dataset`.
    pub fn root_of(dataset: &Path, digest: &str) -> PathBuf {
        dataset.join(FOLDER).join(&digest[..16])
    }

    /// The unfinished work of other bakes, each with whether it has a finished round. What was left behind
    /// when all of its layers were kept (which `is_kept` tells by their digests) is none.
    pub fn unfinished(dataset: &Path, digest: &str, is_kept: impl Fn(&str) -> bool) -> Vec<bool> {
        let unfinished =
            Self::others(dataset, digest).into_iter().filter(|path| !is_finished(path, &is_kept));
        unfinished.map(|path| path.join(ROUNDS_FILE).exists()).collect()
    }

    /// Removes the work of other bakes that was left behind so.
    pub fn remove_finished(dataset: &Path, digest: &str, is_kept: impl Fn(&str) -> bool) {
        for path in Self::others(dataset, digest).into_iter().filter(|path| is_finished(path, &is_kept)) {
            let _ = std::fs::remove_dir_all(path);
        }
    }

    /// Removes it, for all that was traced is kept; what cannot be removed is found to be finished by a later
    /// bake.
    pub fn remove(self) {
        let _ = std::fs::remove_dir_all(&self.root);
    }

    /// Forgets all work below `dataset`. The folder of it stays, by which a later run knows the dataset's
    /// folder for a bake's own.
    pub fn clear(dataset: &Path) -> Result<()> {
        Self::others(dataset, "").iter().try_for_each(|path| dataset::host::files::remove_folder(path))
    }

    /// The path of a file of the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Forgets all that was done, so that the work begins anew.
    pub fn restart(&self) -> Result<()> {
        let entries = std::fs::read_dir(&self.root).map_err(Error::io(&self.root))?;
        let paths = entries.flatten().map(|entry| entry.path());
        // What is believed without a look at the blocks goes first: a run that is killed here finds blocks
        // that went too far, and begins anew too.
        let (mut files, blocks): (Vec<PathBuf>, Vec<PathBuf>) =
            paths.filter(|path| !path.ends_with(LAYERS)).partition(|path| path.ends_with(ROUNDS_FILE));
        files.extend(blocks);
        files.iter().try_for_each(|path| std::fs::remove_file(path).map_err(Error::io(path)))
    }

    /// The error of a folder that somebody changes while it is worked in.
    pub fn changed(&self) -> Error {
        Error::invalid(
            self.root.display(),
            "files of the unfinished work disappear or change while it is traced; expected no other program to write there (the same \
             command continues)",
        )
    }

    /// A block of so many texels without samples.
    pub fn empty_block(&self, texels: usize) -> BlockState {
        BlockState::empty(texels, self.kinds)
    }

    /// Reads a block; `None` where it was not written yet, or what is there is not whole or not of this work.
    pub fn read_block(&self, block: usize, texels: usize) -> Result<Option<BlockState>> {
        let bytes = self.read_sealed(&block_name(block))?;
        Ok(bytes.and_then(|bytes| BlockState::from_bytes(&bytes, texels, self.kinds)))
    }

    /// A block that this run has read or written before.
    pub fn expect_block(&self, block: usize, texels: usize) -> Result<BlockState> {
        match self.read_block(block, texels)? {
            Some(state) => Ok(state),
            // (Surface that covers no texel leaves nothing to write.)
            None if texels == 0 => Ok(self.empty_block(0)),
            None => Err(self.changed()),
        }
    }

    /// Writes a block, replacing what was there: whole or absent for a run that is killed, and durable after
    /// [`Self::sync_blocks`].
    pub fn write_block(&self, block: usize, state: &BlockState) -> Result<()> {
        let (name, bytes) = (block_name(block), state.to_bytes(self.kinds));
        sealed::write_unsynced(&self.path(&name), &self.label(&name), &[&bytes])
    }

    /// Makes blocks durable. Once for all of a round: most of them have reached the disk by then.
    pub fn sync_blocks(&self, blocks: &[usize]) -> Result<()> {
        let sync = |&block: &usize| {
            let path = self.path(&block_name(block));
            let synced = std::fs::File::open(&path).and_then(|file| file.sync_all());
            // (A block that disappeared is found to be missing by who reads it.)
            synced
                .or_else(|e| if e.kind() == ErrorKind::NotFound { Ok(()) } else { Err(Error::io(&path)(e)) })
        };
        blocks.par_iter().try_for_each(sync)?;
        dataset::host::files::sync_folder_of(&self.path(ROUNDS_FILE));
        Ok(())
    }

    /// The content of a file that [`Self::write_sealed`] wrote; `None` where there is none, or it is not
    /// whole.
    pub fn read_sealed(&self, name: &str) -> Result<Option<Vec<u8>>> {
        let path = self.path(name);
        match std::fs::read(&path) {
            Ok(bytes) => Ok(sealed::payload(&self.label(name), &bytes).map(<[u8]>::to_vec)),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(Error::io(&path)(e)),
        }
    }

    /// Writes the parts of a file's content one after the other, with a checksum.
    pub fn write_sealed(&self, name: &str, parts: &[&[u8]]) -> Result<()> {
        sealed::write(&self.path(name), &self.label(name), parts)
    }

    /// What a checksum is of, beside the content: a file of other work, or of another block, does not pass
    /// for this one.
    fn label(&self, name: &str) -> String {
        format!("{}/{name}", self.digest)
    }

    /// The value that was kept under a name; `None` where none was kept, or the file holds no such value.
    ///
    /// # Errors
    /// A file that is there and cannot be read: it is not known to be lost.
    pub fn read<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>> {
        let path = self.path(name);
        match std::fs::read(&path) {
            Ok(bytes) => Ok(serde_json::from_slice(&bytes).ok()),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(Error::io(&path)(e)),
        }
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
        if let Some(kept) = self.read(name)? {
            return Ok(kept);
        }
        let found = find()?;
        self.write(name, &found)?;
        Ok(found)
    }
}

fn block_name(block: usize) -> String {
    format!("block-{block:07}.bin")
}

/// Whether all layers that a folder's work is of are kept, or their list is gone: it is written before all
/// else, so that a run without it was killed while it removed the folder, or before it had done anything.
fn is_finished(folder: &Path, is_kept: impl Fn(&str) -> bool) -> bool {
    let layers: Option<Vec<String>> = match std::fs::read(folder.join(LAYERS)) {
        Err(e) if e.kind() == ErrorKind::NotFound => return true,
        read => read.ok().and_then(|json| serde_json::from_slice(&json).ok()),
    };
    layers.is_some_and(|layers| layers.iter().all(|digest| is_kept(digest)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: SumKinds = SumKinds { layers: 3, sampled: 2, hit_lights: 1 };

    #[test]
    fn blocks_are_kept_and_torn_ones_are_not_believed() {
        let dir = tempfile::tempdir().unwrap();
        let digest = "0123456789abcdef0123";
        let names = |names: [&str; 3]| names.map(str::to_owned);
        let folder = WorkFolder::open(dir.path(), digest, &names(["a", "b", "c"]), KINDS).unwrap();
        assert_eq!(folder.read_block(5, 4).unwrap(), None);
        let state = BlockState { round: 2, direct_budgets: vec![1; 8], ..BlockState::empty(4, KINDS) };
        folder.write_block(5, &state).unwrap();
        folder.sync_blocks(&[5, 6]).unwrap();
        assert_eq!(folder.expect_block(5, 4).unwrap(), state);
        assert_eq!(folder.read_block(5, 3).unwrap(), None);
        let path = folder.path(&block_name(5));
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert_eq!(folder.read_block(5, 4).unwrap(), None);
        // Of another block, or of other work.
        std::fs::write(folder.path(&block_name(6)), &bytes).unwrap();
        assert_eq!(folder.read_block(6, 4).unwrap(), None);
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(folder.read_block(5, 4).unwrap(), Some(state));
        folder.restart().unwrap();
        assert!(folder.read_block(5, 4).unwrap().is_none() && folder.path(LAYERS).exists());
        // Its work is unfinished, whatever is kept of its layers, until all of them are.
        let other = "fedcba9876543210fedc";
        let unfinished = |of: &str, missing: &[&str]| {
            WorkFolder::unfinished(dir.path(), of, |layer| !missing.contains(&layer))
        };
        assert!(unfinished(digest, &["a", "b", "c"]).is_empty());
        assert_eq!(unfinished(other, &["b"]), [false]);
        folder.write(ROUNDS_FILE, &[1]).unwrap();
        assert_eq!(unfinished(other, &["b"]), [true]);
        // What is left of finished work is none, and goes.
        WorkFolder::remove_finished(dir.path(), other, |layer| layer != "b");
        assert!(folder.root.exists() && unfinished(other, &[]).is_empty());
        // Also where a run was killed that was removing it, and had removed the list of its layers first.
        std::fs::remove_file(folder.path(LAYERS)).unwrap();
        assert!(folder.path(ROUNDS_FILE).exists() && unfinished(other, &["b"]).is_empty());
        folder.write(LAYERS, &["a", "b", "c"]).unwrap();
        WorkFolder::remove_finished(dir.path(), other, |_| true);
        assert!(!folder.root.exists());
        // Another bake's work is removed.
        let folder = WorkFolder::open(dir.path(), digest, &names(["a", "b", "c"]), KINDS).unwrap();
        let new = WorkFolder::open(dir.path(), other, &[], KINDS).unwrap();
        assert!(!folder.root.exists() && new.root.exists());
        new.remove();
        assert_eq!(std::fs::read_dir(dir.path().join(FOLDER)).unwrap().count(), 0);
        WorkFolder::open(dir.path(), other, &[], KINDS).unwrap();
        WorkFolder::clear(dir.path()).unwrap();
        assert_eq!(std::fs::read_dir(dir.path().join(FOLDER)).unwrap().count(), 0);
    }

    #[test]
    fn what_was_decided_once_stays_decided() {
        let dir = tempfile::tempdir().unwrap();
        let folder = WorkFolder::open(
            dir.path(),
            "0123456789abcdef",
            &[],
            SumKinds { layers: 0, sampled: 0, hit_lights: 0 },
        )
        .unwrap();
        assert_eq!(folder.kept(DIRECT_FILE, || Ok(vec![1.5f32])).unwrap(), [1.5]);
        assert_eq!(folder.kept(DIRECT_FILE, || Ok(vec![2.5f32])).unwrap(), [1.5]);
        assert_eq!(folder.kept(PIVOT_FILE, || Ok(None::<i16>)).unwrap(), None);
        assert_eq!(folder.kept(PIVOT_FILE, || Ok(Some(3))).unwrap(), None);
        std::fs::write(folder.path(DIRECT_FILE), b"torn [").unwrap();
        assert_eq!(folder.kept(DIRECT_FILE, || Ok(vec![2.5f32])).unwrap(), [2.5]);
        assert_eq!(folder.read::<Vec<f32>>(ROUNDS_FILE).unwrap(), None);
        // What is there and cannot be read is an error, not a loss.
        std::fs::create_dir(folder.path(ROUNDS_FILE)).unwrap();
        assert!(folder.read::<Vec<f32>>(ROUNDS_FILE).unwrap_err().to_string().contains(ROUNDS_FILE));
    }
}
