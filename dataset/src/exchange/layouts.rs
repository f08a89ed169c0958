//! Reads the configuration of either layout, and that which an imported dataset keeps.

use super::plan::{Lightmap, Planned};
use super::{layout1, layout2};
use crate::config::{Layout, Source};
use crate::image::MAX_SIDE;
use crate::store::Dataset;
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

/// Largest configuration file that is read.
const MAX_CONFIG_BYTES: u64 = 64 << 20;

/// The lightmaps of a layout, one after another, from the bytes of its configuration; `place` names that in
/// errors. What a configuration claims may be far more than exists, so `each` must check the files before the
/// next lightmap is planned.
pub(super) fn parse(
    layout: Layout,
    place: &Path,
    bytes: &[u8],
    mut each: impl FnMut(Planned) -> Result<()>,
) -> Result<()> {
    let planned: Box<dyn Iterator<Item = Result<Planned>>> = match layout {
        Layout::Hprc1 => Box::new(layout1::parse(place, bytes)?),
        Layout::Hprc2 => Box::new(layout2::parse(place, bytes)?),
        Layout::Exr => return Err(Error::invalid(place.display(), "EXR files have no configuration")),
    };
    let wrong = |what: String| Err(Error::invalid(place.display(), what));
    let mut ids = BTreeSet::new();
    let mut first: Option<(i64, Vec<f64>)> = None;
    for planned in planned {
        let planned = planned?;
        let Lightmap { id, width, height, .. } = planned.lightmap;
        if !ids.insert(id) {
            return wrong(format!("lightmap {id} occurs twice; expected distinct ids"));
        }
        let side = 1..=MAX_SIDE as u32;
        if !side.contains(&width) || !side.contains(&height) {
            return wrong(format!("lightmap {id}: resolution {width}×{height}; expected 1 to {MAX_SIDE}"));
        }
        let (first_id, hours) = first.get_or_insert_with(|| (id, planned.hours()));
        let own = planned.hours();
        let lacks = |a: &[f64], b: &[f64]| b.iter().copied().find(|hour| !a.contains(hour));
        if let Some(hour) = lacks(&own, hours) {
            return wrong(format!("lightmap {id} lacks {hour} h, which lightmap {first_id} has"));
        }
        if let Some(hour) = lacks(hours, &own) {
            return wrong(format!("lightmap {first_id} lacks {hour} h, which lightmap {id} has"));
        }
        each(planned)?;
    }
    Ok(())
}

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
pub(super) fn kept(dataset: &Dataset, wanted: Option<Layout>) -> Result<Option<(Vec<u8>, Vec<Planned>)>> {
    let Some(Source { layout, config: Some(file), .. }) = &dataset.config.source else { return Ok(None) };
    if wanted.is_some_and(|wanted| wanted != *layout) {
        return Ok(None);
    }
    let path = dataset.path(file);
    let bytes = read_config(&path)?;
    dataset.check_content(file)?;
    let config = &dataset.config;
    let hours: Vec<f64> = config.frames.iter().map(|set| set.hour).collect();
    let differs = || {
        let what = "lightmaps or hours differ from the manifest's; expected the configuration of the import";
        Error::invalid(path.display(), what)
    };
    let mut all: Vec<Planned> = Vec::new();
    parse(*layout, &path, &bytes, |planned| {
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
