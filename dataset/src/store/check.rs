//! What every consumer of a manifest relies on.

use crate::format::{Config, FORMAT, FileRef, Layer, Page, SunVisibility, VERSION};
use crate::host::files::is_component;
use crate::image::MAX_SIDE;
use crate::observe::count;
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

mod layers;

/// Everything in a manifest that is invalid, in itself; `manifest` names it in errors.
pub(super) fn faults(manifest: &Path, config: &Config) -> Vec<Error> {
    let mut found = Vec::new();
    let mut wrong = |what: String| found.push(Error::invalid(manifest.display(), what));
    if config.format != FORMAT {
        wrong(format!("format is {:?}; expected {FORMAT:?}", config.format));
    }
    if config.version != VERSION {
        wrong(format!("version is {}; expected {VERSION}", config.version));
    }
    if !is_component(&config.scene) {
        wrong(format!("scene is {:?}; expected a name that can be a folder's", config.scene));
    }
    pages(config, &mut wrong);
    groups(config, &mut wrong);
    frames(config, &mut wrong);
    layers::layers(config, &mut wrong);
    visibility(config, &mut wrong);
    transfer(config, &mut wrong);
    for (index, instance) in config.instances.iter().enumerate() {
        let (page, pages) = (instance.page as usize, config.pages.len());
        if page >= pages {
            let name = &instance.name;
            wrong(format!("instance {index}, {name:?}: page {page}; expected one of {pages}, from 0"));
        }
    }
    let mut seen = BTreeSet::new();
    for file in references(config).filter(|file| seen.insert((&file.path, file.bytes, &file.blake3))) {
        if !is_inside(file) {
            wrong(format!("path {:?}; expected one inside the dataset's folder, with /", file.path));
        }
        if file.bytes == 0 {
            wrong(format!("{}: bytes is 0; expected the file's length", file.path));
        }
    }
    found
}

fn pages(config: &Config, wrong: &mut impl FnMut(String)) {
    if config.pages.is_empty() {
        wrong("no pages".into());
    }
    for (index, page) in config.pages.iter().enumerate() {
        let side = 1..=MAX_SIDE as u32;
        if !side.contains(&page.width) || !side.contains(&page.height) {
            wrong(format!("page {index}: size {}×{}; expected 1 to {MAX_SIDE}", page.width, page.height));
        }
    }
}

/// Unique names, hours of the day.
fn groups(config: &Config, wrong: &mut impl FnMut(String)) {
    let mut names = BTreeSet::new();
    for group in &config.groups {
        let name = &group.name;
        if name.is_empty() || !names.insert(name) {
            wrong(format!("group {name:?}: the name is empty or occurs twice"));
        }
        group.faults_of_schedule().for_each(&mut *wrong);
    }
}

/// Ascending hours of one day, every list of the right length.
fn frames(config: &Config, wrong: &mut impl FnMut(String)) {
    if config.frames.is_empty() {
        wrong("no frames".into());
    }
    let mut previous = f64::NEG_INFINITY;
    for (index, frame) in config.frames.iter().enumerate() {
        let hour = frame.hour;
        if !(0.0..24.0).contains(&hour) || hour <= previous {
            wrong(format!("frame {index}: hour {hour}; expected ascending hours in [0, 24)"));
        }
        previous = hour;
        if frame.groups_on.len() != config.groups.len() {
            let (found, expected) = (frame.groups_on.len(), config.groups.len());
            wrong(format!("frame {index}, hour {hour}: groups_on has {found} entries; expected {expected}"));
        }
        if frame.maps.len() != config.pages.len() {
            let (found, expected) = (count(frame.maps.len(), "page"), config.pages.len());
            wrong(format!("frame {index}, hour {hour}: maps for {found}; expected {expected}"));
        }
        if let Some(error) = frame.relative_error
            && !(error.is_finite() && error >= 0.0)
        {
            wrong(format!("frame {index}, hour {hour}: relative_error {error}; expected ≥ 0"));
        }
    }
}

/// Of a sun whose path is known, with a file and normals for each page.
fn visibility(config: &Config, wrong: &mut impl FnMut(String)) {
    if config.sun_path.is_some() && config.sun.is_none() {
        wrong("sun_path: expected none where sun is null".into());
    }
    let Some(visibility) = &config.visibility else { return };
    if config.sun_path.is_none() {
        wrong("visibility without sun_path; expected both or neither".into());
    }
    if !(visibility.minutes.is_finite() && visibility.minutes > 0.0) {
        wrong(format!("visibility: minutes is {}; expected a number above 0", visibility.minutes));
    }
    let expected = config.pages.len();
    for (key, files) in [("files", &visibility.files), ("normals", &visibility.normals)] {
        if files.len() != expected {
            wrong(format!("visibility: {key} for {}; expected {expected}", count(files.len(), "page")));
        }
    }
}

/// A part per frame, none twice; light of one day in terms of the functions that the parts make up.
fn transfer(config: &Config, wrong: &mut impl FnMut(String)) {
    let Some(transfer) = &config.transfer else { return };
    if !is_component(&transfer.scene) {
        wrong(format!("transfer: scene is {:?}; expected a name that can be a folder's", transfer.scene));
    }
    let (parts, frames) = (transfer.parts.len(), config.frames.len());
    if parts != frames {
        wrong(format!("transfer: {}; expected {frames}, one per frame", count(parts, "part")));
    }
    let mut seen = BTreeSet::new();
    for part in &transfer.parts {
        let (function, sign) = (part.function, if part.negative { "negative" } else { "positive" });
        if !seen.insert((function, part.negative)) {
            wrong(format!("transfer: the {sign} part of function {function} occurs twice"));
        }
    }
    let functions: BTreeSet<u32> = seen.iter().map(|(function, _)| *function).collect();
    if let Some(missing) = (0..functions.len() as u32).find(|function| !functions.contains(function)) {
        wrong(format!("transfer: no part of function {missing}; expected functions from 0 on"));
    }
    if transfer.light.is_empty() {
        wrong("transfer: light has no entries; expected at least one".into());
    }
    let mut previous = f64::NEG_INFINITY;
    for light in &transfer.light {
        let hour = light.hour;
        if !(0.0..24.0).contains(&hour) || hour <= previous {
            wrong(format!("transfer: light at hour {hour}; expected ascending hours in [0, 24)"));
        }
        previous = hour;
        let (found, expected) = (light.coefficients.len(), functions.len());
        if found != expected {
            wrong(format!(
                "transfer: light at hour {hour} has {}; expected {expected}",
                count(found, "coefficient")
            ));
        }
        if let Some(value) = light.coefficients.iter().flatten().find(|value| !value.is_finite()) {
            wrong(format!(
                "transfer: light at hour {hour} has a coefficient {value}; expected a finite number"
            ));
        }
    }
}

/// Whether a file's path stays inside the dataset's folder, by its words.
pub(super) fn is_inside(file: &FileRef) -> bool {
    file.path.split('/').all(is_component)
}

/// Checks that every file exists with its length.
pub(super) fn files(root: &Path, config: &Config) -> Result<()> {
    let distinct: BTreeSet<(&str, u64)> = references(config).map(|file| (&*file.path, file.bytes)).collect();
    distinct.into_iter().try_for_each(|(path, bytes)| length_of(root, path, bytes))
}

/// Checks that a file exists with its length.
pub(super) fn length(root: &Path, file: &FileRef) -> Result<()> {
    length_of(root, &file.path, file.bytes)
}

fn length_of(root: &Path, path: &str, bytes: u64) -> Result<()> {
    let path = root.join(path);
    let metadata = fs::metadata(&path).map_err(Error::io(&path))?;
    if metadata.len() != bytes {
        let found = count(metadata.len() as usize, "byte");
        return Err(Error::invalid(path.display(), format!("{found}; {} says {bytes}", super::MANIFEST)));
    }
    Ok(())
}

/// Checks an image's size against its page's.
pub(super) fn size(path: &Path, (width, height): (usize, usize), page: &Page) -> Result<()> {
    if (width, height) != (page.width as usize, page.height as usize) {
        let what = format!("size {width}×{height}; the page has {}×{}", page.width, page.height);
        return Err(Error::invalid(path.display(), what));
    }
    Ok(())
}

/// Every reference to a file, in the manifest's order.
pub(crate) fn references(config: &Config) -> impl Iterator<Item = &FileRef> {
    let masks = config.pages.iter().map(|page| &page.mask);
    let layers = config.layers.iter().flat_map(Layer::files);
    let maps = config.frames.iter().flat_map(|frame| &frame.maps);
    let source = config.source.iter().flat_map(|source| &source.config);
    let curves = config.layers.iter().filter_map(|layer| layer.curve.as_ref());
    let all = masks.chain(layers).chain(curves).chain(maps).chain(&config.noise).chain(&config.geometry);
    all.chain(&config.sun_path)
        .chain(config.visibility.iter().flat_map(SunVisibility::references))
        .chain(source)
}
