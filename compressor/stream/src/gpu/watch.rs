//! Bundles as files, and whether others stand in their place now.

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
    /// `NAME.ndgi`, and beside it as many of `NAME.1.ndgi`, `NAME.2.ndgi` … as there are.
    pub fn beside(finest: &Path) -> Self {
        let mut paths = vec![finest.to_owned()];
        let level = |level: usize| finest.with_extension(format!("{level}.ndgi"));
        paths.extend((1..).map(level).take_while(|path| path.exists()));
        Files { stamps: vec![None; paths.len()], paths }
    }

    /// The files.
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Opens them all.
    ///
    /// # Errors
    /// As `Bundle::open` and [`Pyramid::new`].
    pub fn open(&mut self) -> Result<Arc<Pyramid>> {
        self.stamps = self.paths.iter().map(|path| stamp(path)).collect();
        let bundles: Vec<Arc<Bundle>> =
            self.paths.iter().map(|path| Ok(Arc::new(Bundle::open(path)?))).collect::<Result<_>>()?;
        Ok(Arc::new(Pyramid::new(bundles)?))
    }

    /// Whether a file is another one than when they were opened: to be asked every second or so, on any thread. Where it is, [`Files::open`] them
    /// again; a set of which only some are written yet gives an error, and is asked for again later.
    pub fn changed(&self) -> bool {
        self.paths.iter().zip(&self.stamps).any(|(path, opened)| stamp(path) != *opened)
    }
}

fn stamp(path: &Path) -> Option<(u64, SystemTime)> {
    let data = path.metadata().ok()?;
    Some((data.len(), data.modified().ok()?))
}
