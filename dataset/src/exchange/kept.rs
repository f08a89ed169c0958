//! Reads the configuration of a layout, and that which an imported dataset keeps.

use crate::format::Source;
use crate::layout::{self, Layout, Lightmap, Planned};
use crate::store::Dataset;
use crate::{Error, Result};
use std::io::Read;
use std::path::Path;

/// Largest configuration file that is read.
const MAX_CONFIG_BYTES: u64 = 64 << 20;

/// The bytes of a configuration.
pub(super) fn read_config(path: &Path) -> Result<Vec<u8>> {
    let refused = |what: String| Err(Error::invalid(path.display(), what));
    if !path.metadata().map_err(Error::io(path))?.is_file() {
        return refused("not a regular file; expected a configuration file".to_owned());
    }
    let mut bytes = Vec::new();
    let mut file = std::fs::File::open(path).map_err(Error::io(path))?.take(MAX_CONFIG_BYTES + 1);
    file.read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 > MAX_CONFIG_BYTES {
        return refused(format!("more than {MAX_CONFIG_BYTES} bytes; expected a smaller configuration file"));
    }
    Ok(bytes)
}

/// The files of the layout that a dataset was imported from, if it was of this layout.
pub(super) fn kept(
    dataset: &Dataset,
    wanted: Option<&dyn Layout>,
) -> Result<Option<(Vec<u8>, Vec<Planned>)>> {
    let Some(Source { layout, config: Some(file), .. }) = &dataset.config.source else { return Ok(None) };
    if wanted.is_some_and(|wanted| wanted.name() != layout) {
        return Ok(None);
    }
    let path = dataset.verified(file)?;
    let bytes = read_config(&path)?;
    let layout = layout::named(layout);
    let layout = layout.ok_or_else(|| Error::invalid(path.display(), "EXR files have no configuration"))?;
    let config = &dataset.config;
    let hours: Vec<f64> = config.frames.iter().map(|frame| frame.hour).collect();
    let differs = || {
        let what = "lightmaps or hours differ from the manifest's; expected the configuration of the import";
        Error::invalid(path.display(), what)
    };
    let mut all: Vec<Planned> = Vec::new();
    layout::plan(layout, &path, &bytes, |planned| {
        let size = (planned.lightmap.width, planned.lightmap.height);
        let page = config.pages.get(all.len()).filter(|page| (page.width, page.height) == size);
        if page.is_none() || planned.hours() != hours {
            return Err(differs());
        }
        all.push(planned);
        Ok(())
    })?;
    if all.len() != config.pages.len() {
        return Err(differs());
    }
    Ok(Some((bytes, all)))
}

/// What the layout that a dataset was imported from calls its pages; `None` for a dataset from elsewhere.
///
/// # Errors
/// As for a layout's configuration that is read.
pub fn lightmaps_of(dataset: &Dataset) -> Result<Option<Vec<Lightmap>>> {
    let kept = kept(dataset, None)?;
    Ok(kept.map(|(_, planned)| planned.into_iter().map(|planned| planned.lightmap).collect()))
}
