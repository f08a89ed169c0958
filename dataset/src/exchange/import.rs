//! Imports a layout as a dataset.

use super::convert::{convert, work};
use super::images;
use super::incoming::{Incoming, IncomingFrame, IncomingPage, Light, MaskFile};
use super::kept::read_config;
use super::raw::Raw;
use crate::format::{Baked, Config, Group};
use crate::host::files::{NewFolder, is_component};
use crate::host::inputs::{expect_file, expect_folder};
use crate::layout::{self, LIGHT_BYTES, Layout, Parts, Planned};
use crate::observe::{Observer, count};
use crate::store::MANIFEST;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// The source of an import.
#[derive(Clone, Debug)]
pub enum Origin {
    /// A folder in a layout.
    Folder(&'static dyn Layout, PathBuf),
    /// EXR files of one page.
    Pattern {
        /// The folder that holds them.
        folder: PathBuf,
        /// Their names, with `{hour}` for the hour.
        pattern: String,
        /// A picture, light where texels are valid; without one all are.
        mask: Option<PathBuf>,
        /// The layer of the files to take.
        layer: Option<String>,
    },
    /// A TOML file that names EXR files.
    Table(PathBuf),
}

/// Makes a dataset in the new folder `out`, which appears when it is complete; the scene has the folder's
/// name. Returns its manifest.
///
/// # Errors
/// For any fault of the source; then nothing is left behind.
pub fn import(origin: &Origin, out: &Path, console: &dyn Observer) -> Result<Config> {
    let scene = out.file_name().and_then(|name| name.to_str()).filter(|name| is_component(name));
    let scene = scene.ok_or_else(|| Error::invalid(out.display(), "expected the name of a new folder"))?;
    let folder = NewFolder::create(out)?;
    let incoming = match origin {
        Origin::Folder(layout, root) => read_folder(*layout, root)?,
        Origin::Pattern { folder, pattern, mask, layer } => {
            let (incoming, others) = images::by_pattern(folder, pattern, mask.as_deref(), layer.as_deref())?;
            if !others.is_empty() {
                console.say(format!("not matched by the pattern: {}", others.join(", ")));
            }
            incoming
        }
        Origin::Table(path) => images::by_table(path)?,
    };
    let progress = console.progress("importing", work(&incoming));
    let config = convert(&incoming, folder.temporary(), scene, console, &progress)?;
    drop(progress);
    folder.finish()?;
    Ok(config)
}

/// Finds the files of a layout.
fn read_folder(layout: &dyn Layout, root: &Path) -> Result<Incoming> {
    let place = root.join(MANIFEST);
    expect_folder(root, &format!("a folder in the layout {}", layout.name()))?;
    expect_file(
        &place,
        &format!("the configuration of the layout {}, which says what files it has", layout.name()),
    )?;
    let root = root.canonicalize().map_err(Error::io(root))?;
    let bytes = read_config(&inside(&root, Path::new(MANIFEST))?)?;
    // All folders of shares, or none.
    let shares = layout.shares();
    let there: Vec<&str> = shares.iter().copied().filter(|share| root.join(share).exists()).collect();
    if !there.is_empty() && there != shares {
        let (there, shares) = (there.join(", "), shares.join(", "));
        let what = format!("only {there} exists; expected {shares}, or none of them");
        return Err(Error::invalid(root.display(), what));
    }
    let mut pages = Vec::new();
    let mut hours = Vec::new();
    layout::plan(layout, &place, &bytes, |planned| {
        hours = planned.frames.iter().map(|planned_frame| planned_frame.hour).collect();
        pages.push(find(&root, planned, !there.is_empty())?);
        Ok(())
    })?;
    let lamps = |on| Group { name: "local".to_owned(), on: vec![on], baked: Baked::All };
    Ok(Incoming {
        layout: layout.name(),
        config: Some(bytes),
        unit: images::UNKNOWN_UNIT.to_owned(),
        groups: layout.lamps_on(&hours).map(lamps).into_iter().collect(),
        hours,
        pages,
    })
}

/// Finds the files of a lightmap. All that are missing are named.
fn find(root: &Path, planned: Planned, with_shares: bool) -> Result<IncomingPage> {
    let (width, height) = (planned.lightmap.width as usize, planned.lightmap.height as usize);
    let mut missing = Vec::new();
    let mut raw = |parts: Parts, texel_bytes: usize| -> Result<Option<Raw>> {
        let mut paths = Vec::with_capacity(parts.len());
        for part in parts {
            match inside(root, &part) {
                Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                    missing.push(part);
                }
                found => paths.push(found?),
            }
        }
        match missing.is_empty() {
            true => Raw::open(paths, (width, height), texel_bytes).map(Some),
            false => Ok(None),
        }
    };
    let mut masks = Vec::new();
    for parts in planned.masks {
        masks.extend(raw(parts, 1)?.map(MaskFile::Raw));
    }
    let mut sets = Vec::new();
    for planned_frame in planned.frames {
        let whole = raw(planned_frame.whole, LIGHT_BYTES)?;
        let mut shares = Vec::new();
        for parts in planned_frame.shares.into_iter().flatten().filter(|_| with_shares) {
            shares.extend(raw(parts, LIGHT_BYTES)?.map(Light::Raw));
        }
        sets.extend(
            whole.map(|whole| IncomingFrame { whole: Light::Raw(whole), shares: shares.try_into().ok() }),
        );
    }
    if missing.is_empty() {
        return Ok(IncomingPage { width, height, masks, frames: sets });
    }
    let names: Vec<String> = missing.iter().take(30).map(|path| path.display().to_string()).collect();
    let more = missing.len() - names.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let what =
        format!("{}: {} missing: {}{more}", planned.lightmap, count(missing.len(), "file"), names.join(", "));
    Err(Error::invalid(root.display(), what))
}

/// The file at a path in the folder, whose own path is canonical. A link must not lead out of the folder.
fn inside(root: &Path, relative: &Path) -> Result<PathBuf> {
    let path = root.join(relative);
    let real = path.canonicalize().map_err(Error::io(&path))?;
    match real.starts_with(root) {
        true => Ok(path),
        false => {
            let what = format!("leads to {}; expected a file inside {}", real.display(), root.display());
            Err(Error::invalid(path.display(), what))
        }
    }
}
