//! How the meshes of a bake come apart into charts, kept beside the dataset: a later bake or plan of the same
//! meshes need not unwrap them.
//!
//! One file, sealed, holds all meshes of the last bake or plan, by key. Of each:
//!
//! | bytes | what |
//! |---|---|
//! | 32 | its key, which names it by its triangles |
//! | 8 | number of triangles, little-endian |
//! | 28 each | the triangles, as [`Unwrap::to_bytes`] gives them |
//!
//! The triangles are those of the geometry, about the scene's centre: where that moves, every mesh is
//! another. What is damaged, or of another version, is not there. Nothing fails because the file cannot be
//! read or written.

use super::sealed;
use crate::atlas::unwraps::{Key, TRIANGLE, Unwrap, Unwraps};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Name of the folder inside a dataset that serves later bakes.
pub(crate) const LAYERS_FOLDER: &str = ".layers";

/// Name of the file in it that holds how meshes come apart.
pub(crate) const CHARTS_FILE: &str = "meshes.charts";

/// Label of the file's seal: changes with the file's format.
const LABEL: &str = "charts-1";

/// The unwraps that an earlier bake left, and those of this one.
#[derive(Debug, Default)]
pub struct Charts {
    /// By key, the bytes of every unwrap of the file.
    found: BTreeMap<Key, Vec<u8>>,
    /// By key, every unwrap that was asked for.
    used: Mutex<BTreeMap<Key, Origin>>,
}

/// Where an unwrap comes from.
#[derive(Debug)]
enum Origin {
    /// The file.
    Found,
    /// It was made, and these are its bytes.
    Made(Vec<u8>),
}

/// How many different meshes there were.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Meshes that were unwrapped.
    pub made: usize,
    /// Meshes whose unwraps were kept.
    pub kept: usize,
}

impl Charts {
    /// Nothing is kept yet.
    pub fn none() -> Self {
        Charts::default()
    }

    /// What lies beside a dataset.
    pub fn beside(dataset: &Path) -> Self {
        let payload = sealed::read(&path(dataset), LABEL);
        let found = payload.and_then(|payload| meshes(&payload)).unwrap_or_default();
        Charts { found, used: Mutex::default() }
    }

    /// How many meshes were asked for.
    pub fn counts(&self) -> Counts {
        let used = self.used();
        let kept = used.values().filter(|origin| matches!(origin, Origin::Found)).count();
        Counts { made: used.len() - kept, kept }
    }

    /// Keeps what was asked for beside the dataset, and nothing else, if its folder of layers exists.
    pub fn keep(self, dataset: &Path) {
        let used = self.used();
        let is_there =
            used.keys().eq(self.found.keys()) && used.values().all(|origin| matches!(origin, Origin::Found));
        if is_there || !dataset.join(LAYERS_FOLDER).is_dir() {
            return;
        }
        let mut payload = Vec::new();
        for (key, origin) in used.iter() {
            let bytes = match origin {
                Origin::Made(bytes) => bytes,
                Origin::Found => &self.found[key],
            };
            payload.extend(key);
            payload.extend(((bytes.len() / TRIANGLE) as u64).to_le_bytes());
            payload.extend(bytes);
        }
        // (The next bake unwraps again if this fails.)
        let _ = sealed::write(&path(dataset), LABEL, &[&payload]);
    }

    fn used(&self) -> MutexGuard<'_, BTreeMap<Key, Origin>> {
        self.used.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Unwraps for Charts {
    fn get(&self, key: &Key, triangles: usize) -> Option<Unwrap> {
        let unwrap = Unwrap::from_bytes(self.found.get(key)?, triangles)?;
        self.used().insert(*key, Origin::Found);
        Some(unwrap)
    }

    fn put(&self, key: &Key, unwrap: &Unwrap) {
        let bytes = unwrap.to_bytes();
        self.used().insert(*key, Origin::Made(bytes));
    }
}

fn path(dataset: &Path) -> PathBuf {
    dataset.join(LAYERS_FOLDER).join(CHARTS_FILE)
}

/// The meshes of a payload; `None` for one that no bake writes.
fn meshes(mut payload: &[u8]) -> Option<BTreeMap<Key, Vec<u8>>> {
    let mut meshes = BTreeMap::new();
    while !payload.is_empty() {
        let (key, rest) = payload.split_first_chunk()?;
        let (triangles, rest) = rest.split_first_chunk()?;
        let length = usize::try_from(u64::from_le_bytes(*triangles)).ok()?.checked_mul(TRIANGLE)?;
        let (bytes, rest) = rest.split_at_checked(length)?;
        meshes.insert(*key, bytes.to_vec());
        payload = rest;
    }
    Some(meshes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::unwraps::Unwrapped;

    #[test]
    fn counts_that_the_bytes_do_not_hold_are_not_believed() {
        let entry = |triangles: u64, bytes: usize| {
            let header = [7; 32].into_iter().chain(triangles.to_le_bytes());
            header.chain(std::iter::repeat_n(0, bytes)).collect::<Vec<u8>>()
        };
        let whole = entry(2, 2 * TRIANGLE);
        assert_eq!(meshes(&whole).unwrap()[&[7; 32]].len(), 2 * TRIANGLE);
        for triangles in [3, 1 << 40, u64::MAX / TRIANGLE as u64 + 1, u64::MAX] {
            assert_eq!(meshes(&entry(triangles, 2 * TRIANGLE)), None, "{triangles}");
        }
        for length in 1..whole.len() {
            assert_eq!(meshes(&whole[..length]), None, "cut at {length}");
        }
    }

    #[test]
    fn a_sealed_file_of_another_mesh_is_not_believed() {
        let dataset = tempfile::tempdir().unwrap();
        std::fs::create_dir(dataset.path().join(LAYERS_FOLDER)).unwrap();
        let key = [7; 32];
        let charts = Charts::none();
        charts.put(&key, &Unwrap { triangles: vec![Unwrapped::ALONE; 2] });
        charts.keep(dataset.path());
        let charts = Charts::beside(dataset.path());
        assert_eq!((charts.get(&key, 3), charts.get(&[8; 32], 2)), (None, None));
        assert!(charts.get(&key, 2).is_some());
        assert_eq!(charts.counts(), Counts { made: 0, kept: 1 });
    }
}
