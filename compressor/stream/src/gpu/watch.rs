//! Bundles as files, and whether they were replaced.

use crate::{Pyramid, Result};
use ndgi::Bundle;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// A file's length and time of change; `None` if there is none.
type Stamp = Option<(u64, SystemTime)>;

/// The bundles of a scene's levels as files: `NAME.ndgi`, and the levels `NAME.1.ndgi`, `NAME.2.ndgi` …
/// beside it, up to the first that is missing.
#[derive(Clone, Debug)]
pub struct Files {
    finest: PathBuf,
    /// Those that were opened.
    opened: Vec<(PathBuf, Stamp)>,
}

impl Files {
    /// Those of a scene, by the file of its finest level.
    pub fn beside(finest: &Path) -> Self {
        Files { finest: finest.to_owned(), opened: Vec::new() }
    }

    /// The files that there are now, finest level first.
    pub fn paths(&self) -> Vec<PathBuf> {
        let level = |level: usize| self.finest.with_extension(format!("{level}.ndgi"));
        let coarser = (1..).map(level).take_while(|path| path.exists());
        [self.finest.clone()].into_iter().chain(coarser).collect()
    }

    /// Opens them all.
    ///
    /// # Errors
    /// Those of `Bundle::open` and [`Pyramid::new`].
    pub fn open(&mut self) -> Result<Arc<Pyramid>> {
        let found = self.found();
        let bundles: Vec<Arc<Bundle>> =
            found.iter().map(|(path, _)| Ok(Arc::new(Bundle::open(path)?))).collect::<Result<_>>()?;
        let pyramid = Pyramid::new(bundles)?;
        self.opened = found;
        Ok(Arc::new(pyramid))
    }

    /// Whether there are other files than those that were opened, or one has another length or time of
    /// change. Ask about once a second, on any thread, and if so [`Files::open`] again. If that fails because
    /// only some levels are written yet, ask again later.
    pub fn changed(&self) -> bool {
        self.found() != self.opened
    }

    fn found(&self) -> Vec<(PathBuf, Stamp)> {
        let of = |path: PathBuf| {
            let stamp = stamp(&path);
            (path, stamp)
        };
        self.paths().into_iter().map(of).collect()
    }
}

fn stamp(path: &Path) -> Stamp {
    let data = path.metadata().ok()?;
    Some((data.len(), data.modified().ok()?))
}
