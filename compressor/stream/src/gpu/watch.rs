//! Bundles as files, and whether they were replaced.

use crate::{Pyramid, Result};
use ndgi::Bundle;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// The bundles of a scene's levels as files.
#[derive(Clone, Debug)]
pub struct Files {
    paths: Vec<PathBuf>,
    stamps: Vec<Option<(u64, SystemTime)>>,
}

impl Files {
    /// `NAME.ndgi`, and the levels `NAME.1.ndgi`, `NAME.2.ndgi` … beside it, up to the first that is missing.
    pub fn beside(finest: &Path) -> Self {
        let mut paths = vec![finest.to_owned()];
        let level = |level: usize| finest.with_extension(format!("{level}.ndgi"));
        paths.extend((1..).map(level).take_while(|path| path.exists()));
        Files { stamps: vec![None; paths.len()], paths }
    }

    /// The files, finest level first.
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Opens them all.
    ///
    /// # Errors
    /// Those of `Bundle::open` and [`Pyramid::new`].
    pub fn open(&mut self) -> Result<Arc<Pyramid>> {
        self.stamps = self.paths.iter().map(|path| stamp(path)).collect();
        let bundles: Vec<Arc<Bundle>> =
            self.paths.iter().map(|path| Ok(Arc::new(Bundle::open(path)?))).collect::<Result<_>>()?;
        Ok(Arc::new(Pyramid::new(bundles)?))
    }

    /// Whether a file's length or time of change differs from when it was opened. Ask about once a second, on any thread, and if so
    /// [`Files::open`] again. If that fails because only some levels are written yet, ask again later. Additional levels are not noticed.
    pub fn changed(&self) -> bool {
        self.paths.iter().zip(&self.stamps).any(|(path, opened)| stamp(path) != *opened)
    }
}

fn stamp(path: &Path) -> Option<(u64, SystemTime)> {
    let data = path.metadata().ok()?;
    Some((data.len(), data.modified().ok()?))
}
