//! The work folder `<bundle>.part/`: a file for each finished tile, for each tile's trial fits, for the
//! choice of configurations, and for the times between frames, each named by a digest of its inputs; the
//! notes of shards; the lock.

use super::{beside, folder_beside, note};
use crate::bundle::{self, Payload, Section};
use crate::{Error, Result};
use dataset::host::files::{remove_stale_temporaries, sync_folder_of, temporaries, write_atomically};
use dataset::host::lock::{LOCK, Lock, Shared, lock, share};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;

const EXTENSION: &str = "tile";
/// Name of the list of files whose bundle is written. A run that is killed while it removes them leaves the
/// list.
const DONE: &str = "done.json";

enum Held {
    /// Only this run.
    Alone(#[allow(dead_code, reason = "held, never read")] Lock),
    /// Shared by all shards.
    Together(#[allow(dead_code, reason = "held, never read")] Shared),
}

/// Message when another run holds the folder.
const BUSY: [&str; 2] = ["another run is writing this bundle", "wait until it ends, or choose another --out"];

/// A finished part.
#[derive(Debug, PartialEq)]
pub(super) struct Kept<S> {
    /// Of a tile.
    pub payload: Payload,
    /// Its statistics, or the result itself.
    pub result: S,
    /// Digest of the light it was made from; `None` if its writer had verified the dataset's checksums.
    pub made_from: Option<String>,
}

pub(super) struct Part {
    folder: PathBuf,
    /// Excludes other runs; `None` once the folder is left.
    held: Option<Held>,
    /// The files that this run read, wrote or claimed: removed once the bundle is written.
    own: Mutex<BTreeSet<PathBuf>>,
    /// The keys of those that it wrote.
    written: Mutex<BTreeSet<String>>,
}

impl Part {
    /// Opens or creates the work folder of a bundle, for this run alone; with `fresh`, empties it.
    pub(super) fn open(out: &Path, fresh: bool) -> Result<Self> {
        let (folder, held) = held(out, |folder| lock(folder, BUSY[0], BUSY[1]).map(Held::Alone))?;
        remove_stale_temporaries(&folder)?;
        let part = Part { folder, held, own: Mutex::default(), written: Mutex::default() };
        if fresh {
            part.files().chain(note::files(&part.folder)).for_each(remove);
            remove(part.folder.join(DONE));
        }
        Ok(part)
    }

    /// Opens or creates it, shared with other shards. Leftovers of killed processes stay until a run has the
    /// folder alone.
    pub(super) fn share(out: &Path) -> Result<Self> {
        let (folder, held) = held(out, |folder| share(folder, BUSY[0], BUSY[1]).map(Held::Together))?;
        Ok(Part { folder, held, own: Mutex::default(), written: Mutex::default() })
    }

    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(format!("{key}.{EXTENSION}"))
    }

    /// Counts a file as this run's, to be removed once the bundle is written. Gives its path.
    pub(super) fn claim(&self, key: &str) -> PathBuf {
        let path = self.path(key);
        self.own.lock().unwrap_or_else(|e| e.into_inner()).insert(path.clone());
        path
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// A finished tile; `None` if missing, damaged or under another's name.
    pub(super) fn read<S: DeserializeOwned>(&self, key: &str) -> Option<Kept<S>> {
        // Checksum of the key and the rest, length of digest and statistics, these, word, length and bytes of
        // the features, resident bytes.
        let bytes = fs::read(self.claim(key)).ok()?;
        let (sum, rest) = bytes.split_first_chunk::<8>()?;
        if bundle::checksum(&[key.as_bytes(), rest]) != u64::from_le_bytes(*sum) {
            return None;
        }
        let (length, rest) = rest.split_first_chunk::<8>()?;
        let (stats, rest) = rest.split_at_checked(u64::from_le_bytes(*length).try_into().ok()?)?;
        let (word, rest) = rest.split_first_chunk::<4>()?;
        let (length, rest) = rest.split_first_chunk::<8>()?;
        let (bytes, resident) = rest.split_at_checked(u64::from_le_bytes(*length).try_into().ok()?)?;
        let maps = Section { word: u32::from_le_bytes(*word), bytes: bytes.to_vec() };
        let payload = Payload { maps, resident: resident.to_vec(), ..Payload::default() };
        let (made_from, result) = serde_json::from_slice(stats).ok()?;
        Some(Kept { payload, result, made_from })
    }

    /// A finished part's [`Kept::made_from`].
    pub(super) fn made_from(&self, key: &str) -> Option<String> {
        self.read::<serde::de::IgnoredAny>(key)?.made_from
    }

    /// Stores a finished tile without its sun sections, which are quick to recompute. `made_from`:
    /// [`Kept::made_from`].
    pub(super) fn write(
        &self,
        key: &str,
        payload: &Payload,
        result: &impl Serialize,
        made_from: Option<&str>,
    ) -> Result<()> {
        let path = self.claim(key);
        let stats = serde_json::to_vec(&(made_from, result))
            .map_err(|error| Error::invalid(path.display(), error))?;
        let length = (stats.len() as u64).to_le_bytes();
        let Section { word, bytes } = &payload.maps;
        let of_bytes = (bytes.len() as u64).to_le_bytes();
        let rest = [&length[..], &stats, &word.to_le_bytes(), &of_bytes, bytes, &payload.resident].concat();
        let sum = bundle::checksum(&[key.as_bytes(), &rest]).to_le_bytes();
        self.written(write_atomically(&path, &[&sum[..], &rest].concat()))?;
        self.written.lock().unwrap_or_else(|e| e.into_inner()).insert(key.to_owned());
        Ok(())
    }

    /// The result of writing into the folder: where another process removed the folder meanwhile, an error
    /// that says so.
    pub(super) fn written(&self, result: Result<()>) -> Result<()> {
        match result {
            // (Or one of the folder's temporaries was.)
            Err(error) if !self.folder.is_dir() || is_not_found(&error) => {
                Err(Error::unready(self.folder.display(), REMOVED))
            }
            result => result,
        }
    }

    /// Removes a tile that is of no use.
    pub(super) fn discard(&self, key: &str) {
        remove(self.claim(key));
    }

    /// The names of the files that this run read, wrote or claimed.
    pub(super) fn own(&self) -> Vec<String> {
        let own = self.own.lock().unwrap_or_else(|e| e.into_inner());
        own.iter().filter_map(|path| Some(path.file_name()?.to_str()?.to_owned())).collect()
    }

    /// Counts files of other runs as this one's, to be removed with them.
    pub(super) fn adopt(&self, names: &[String]) {
        let is_tile = |path: &PathBuf| path.extension().is_some_and(|extension| extension == EXTENSION);
        let plain = names.iter().filter(|name| !name.contains('/')).map(|name| self.folder.join(name));
        self.own.lock().unwrap_or_else(|e| e.into_inner()).extend(plain.filter(is_tile));
    }

    /// True if the file of a key exists, complete or not.
    pub(super) fn has(&self, key: &str) -> bool {
        self.path(key).exists()
    }

    /// Whether a file is this run's own work.
    pub(super) fn wrote(&self, key: &str) -> bool {
        self.written.lock().unwrap_or_else(|e| e.into_inner()).contains(key)
    }

    /// Notes that the bundle of this run's tiles is written: from now on [`Part::remove`], of this run or
    /// another, removes them.
    pub(super) fn finish(&self) -> Result<()> {
        let list = self.folder.join(DONE);
        let json = serde_json::to_vec(&self.own()).map_err(|error| Error::invalid(list.display(), error))?;
        self.written(write_atomically(&list, &json))
    }

    /// Removes the files of this run and those of a written bundle; dropping it removes the folder if nothing
    /// is left in it. Only for a run that has it alone. Notes of shards with this recipe go too, and all of
    /// them if no tile is left. Returns the number of remaining files, which are of runs with other settings.
    pub(super) fn remove(self, recipe: &str) -> usize {
        let list = self.folder.join(DONE);
        let done: Option<Vec<String>> =
            fs::read(&list).ok().and_then(|json| serde_json::from_slice(&json).ok());
        self.adopt(&done.unwrap_or_default());
        self.own.lock().unwrap_or_else(|e| e.into_inner()).iter().cloned().for_each(remove);
        let left = self.files().count();
        let is_done = |path: &PathBuf| left == 0 || note::is_of(path, recipe);
        note::files(&self.folder).filter(is_done).for_each(remove);
        // (Of machines that cannot be asked whether their processes run: nobody writes a tile for a day.)
        temporaries(&self.folder).unwrap_or_default().into_iter().filter(is_old).for_each(remove);
        // (The list must not be gone before they are.)
        sync_folder_of(&list);
        remove(list);
        left
    }

    fn files(&self) -> impl Iterator<Item = PathBuf> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten().map(|entry| entry.path());
        entries.filter(|path| path.extension().is_some_and(|extension| extension == EXTENSION))
    }
}

impl Drop for Part {
    /// Removes the folder if nothing is left in it and nobody else can be there.
    fn drop(&mut self) {
        let is_used = || {
            let tiles = self.files().next().is_some();
            tiles || note::files(&self.folder).next().is_some() || self.folder.join(DONE).exists()
        };
        if !matches!(self.held, Some(Held::Alone(_))) || is_used() {
            return;
        }
        // What cannot be removed does no harm.
        remove(self.folder.join(LOCK));
        // (Its claim is in the folder, and on some networks an open file stays in its folder when it is
        // removed.)
        self.held = None;
        let _ = fs::remove_dir(&self.folder);
    }
}

/// The error of a process whose work folder is gone.
const REMOVED: &str = "was removed while this process worked in it, perhaps because the bundle is finished; run the same command again";

fn is_not_found(error: &Error) -> bool {
    matches!(error, Error::Io { source, .. } if source.kind() == ErrorKind::NotFound)
}

/// Whether a file was last written more than a day ago.
fn is_old(path: &PathBuf) -> bool {
    let modified = fs::metadata(path).and_then(|metadata| metadata.modified());
    modified.is_ok_and(|at| at.elapsed().is_ok_and(|age| age > Duration::from_secs(24 * 3600)))
}

/// The folder, created if it is missing, and the lock on it. (A run that finds nothing left in it may remove
/// it in between.)
fn held(out: &Path, lock: impl Fn(&Path) -> Result<Held>) -> Result<(PathBuf, Option<Held>)> {
    for _ in 0..10 {
        let folder = folder_beside(out, ".part")?;
        match lock(&folder) {
            Err(error) if is_not_found(&error) => {}
            held => return Ok((folder, Some(held?))),
        }
    }
    Err(Error::unready(beside(out, ".part").display(), REMOVED))
}

fn remove(path: PathBuf) {
    let _ = fs::remove_file(path);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compress::TileStats;
    use crate::train::{Point, TrainedTile};

    #[test]
    fn tiles_are_kept_and_damaged_ones_are_not_believed() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a.ndgi");
        let part = Part::open(&out, false).unwrap();
        let stats = TileStats {
            texels: 1,
            trained: TrainedTile {
                steps: 10,
                stepping_seconds: 0.05,
                psnr_unquantised_db: Some(44.25),
                error: Some(0.5),
                curve: vec![Point { iteration: 10, seconds: 0.1, psnr_db: 30.0 }],
                omitted: vec!["black in 1 of 2 frames".to_owned()],
                ..TrainedTile::default()
            },
            seconds: 1.5,
        };
        let maps = Section { word: 0x1234_5678, bytes: b"payload".to_vec() };
        let payload = Payload { maps, resident: b"resident".to_vec(), ..Payload::default() };
        assert!(!part.wrote("k"));
        part.write("k", &payload, &stats, Some("light")).unwrap();
        assert!(part.wrote("k"));
        let busy = Part::open(&out, false).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(busy.contains("another run is writing this bundle"), "{busy}");
        drop(part);
        let part = Part::open(&out, false).unwrap();
        assert!(!part.wrote("k"));
        let kept = Kept { payload, result: stats.clone(), made_from: Some("light".to_owned()) };
        assert_eq!(part.read("k"), Some(kept));
        // Under another's name it is not believed.
        fs::copy(part.path("k"), part.path("l")).unwrap();
        assert_eq!(part.read::<TileStats>("l"), None);
        part.discard("l");
        assert_eq!(part.read::<TileStats>("other"), None);
        let path = part.path("k");
        let bytes = fs::read(&path).unwrap();
        for i in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[i] ^= 1;
            fs::write(&path, damaged).unwrap();
            assert_eq!(part.read::<TileStats>("k"), None);
            fs::write(&path, &bytes[..i]).unwrap();
            assert_eq!(part.read::<TileStats>("k"), None);
        }
        part.write("k", &Payload::default(), &stats, None).unwrap();
        drop(part);
        assert!(Part::open(&out, false).unwrap().read::<TileStats>("k").is_some());
        assert!(Part::open(&out, true).unwrap().read::<TileStats>("k").is_none());
        assert!(!beside(&out, ".part").exists());
        fs::create_dir(beside(&out, ".part")).unwrap();
        fs::write(beside(&out, ".part").join("notes.txt"), b"mine").unwrap();
        Part::open(&out, false)
            .unwrap()
            .write("of other settings", &Payload::default(), &stats, None)
            .unwrap();
        // This run's tiles are removed; the one of other settings remains.
        let part = Part::open(&out, false).unwrap();
        part.write("k", &Payload::default(), &stats, None).unwrap();
        assert_eq!(part.remove(""), 1);
        let part = Part::open(&out, false).unwrap();
        assert!(
            part.read::<TileStats>("k").is_none() && part.read::<TileStats>("of other settings").is_some()
        );
        assert_eq!(part.remove(""), 0);
        let left = fs::read_dir(beside(&out, ".part")).unwrap().map(|entry| entry.unwrap().file_name());
        assert_eq!(left.collect::<Vec<_>>(), ["notes.txt"]);
        // Where the folder is gone meanwhile, the same command can succeed.
        let part = Part::share(&out).unwrap();
        fs::remove_dir_all(beside(&out, ".part")).unwrap();
        let gone = part.write("k", &Payload::default(), &stats, None).unwrap_err();
        assert_eq!(gone.exit_code(), dataset::error::TRY_AGAIN, "{gone}");
    }
}
