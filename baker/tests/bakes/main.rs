//! Small scenes baked whole, many times over: what chance may do to a bake, and what a change of the scene
//! may not.

mod adaptive;
mod charts;
mod denoise;
mod golden;
mod groups;
mod keep;
mod local;
mod pages;
mod parts;
mod preview;
mod relight;
mod disk_space;
mod scenes;
mod statistics;
mod transfer;
mod visibility;

use baker::bake::run::{Options, Outcome, bake};
use baker::light::times::schedule::parse_hours;
use dataset::observe::Silent;
use dataset::store::Dataset;
use std::path::PathBuf;
use tempfile::TempDir;

/// A folder of scene files and of the datasets baked from them.
pub struct Stage {
    folder: TempDir,
}

impl Stage {
    /// A folder with these files.
    pub fn new(files: &[(&str, Vec<u8>)]) -> Self {
        let stage = Stage { folder: tempfile::tempdir().expect("a temporary folder") };
        files.iter().for_each(|(name, bytes)| stage.write(name, bytes));
        stage
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file.
    pub fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).expect("written");
    }

    /// Bakes the scene file of this text into the dataset `set`, with the default options but for what
    /// `change` changes.
    #[track_caller]
    pub fn bake(
        &self,
        scene: &str,
        set: &str,
        hours: &str,
        change: impl FnOnce(&mut Options),
    ) -> (Outcome, Dataset) {
        self.write("case.toml", scene.as_bytes());
        let out = self.path(set);
        let mut options =
            Options { out: Some(out.clone()), ..Options::new(parse_hours(hours).expect("hours")) };
        change(&mut options);
        let outcome =
            bake(&self.path("case.toml"), &options, &Silent).unwrap_or_else(|error| panic!("{error}"));
        let dataset = Dataset::open(&out).unwrap_or_else(|error| panic!("{error}"));
        (outcome, dataset)
    }
}

/// The content of every file the manifest stands for, and the manifest, by name. (Files of the manifest
/// before it may still lie beside them, for whoever reads those.)
pub fn data(dataset: &Dataset) -> Vec<(String, Vec<u8>)> {
    let named = dataset.files().map(|file| (file.path.clone(), dataset.path(file)));
    let manifest = ("config.json".to_owned(), dataset.root.join("config.json"));
    let files = named.chain([manifest]);
    let mut files: Vec<(String, Vec<u8>)> =
        files.map(|(name, path)| (name, std::fs::read(path).expect("readable"))).collect();
    files.sort();
    files.dedup();
    files
}

/// Two datasets must be the same, byte for byte.
#[track_caller]
pub fn assert_same(a: &Dataset, b: &Dataset) {
    let (a, b) = (data(a), data(b));
    let names = |files: &[(String, Vec<u8>)]| files.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b));
    for ((name, a), (_, b)) in a.iter().zip(&b) {
        assert!(a == b, "{name} differs");
    }
}
