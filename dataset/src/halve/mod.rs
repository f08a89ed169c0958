//! A dataset of half the resolution: a coarser level of detail for virtual texturing, and a dataset like any
//! other.
//!
//! Texel (x, y) covers the texels [2x, 2x + 2) × [2y, 2y + 2) of the source, those inside the page. Its light
//! is the mean over those of them that are valid, and it is valid if one is; where none is, the mean is over
//! all. Layers are halved, and frames are their sums anew.

mod half;
mod images;
mod places;
mod sunlight;

use crate::digest::Digest;
use crate::format::{Config, FileRef, Page, SunVisibility, VERSION};
use crate::host::NewFolder;
use crate::host::signals::stop_if_interrupted;
use crate::observe::{Meter, Observer};
use crate::store::{Dataset, MANIFEST, Writer, references, stem_of};
use crate::{Error, Result};
use half::Half;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;

/// What the generator of halved datasets begins with.
const GENERATOR: &str = concat!("dataset halve ", env!("CARGO_PKG_VERSION"));
/// The geometry's plain name.
const GLB: &str = "scene.glb";

/// Writes the dataset of half the resolution to the new folder `out`, which appears when it is complete.
/// Returns its manifest.
///
/// # Errors
/// [`Error::Unsupported`] for a scene's transfer; [`Error::Invalid`] for a source that is invalid, or if
/// `out` exists. Then nothing is left behind.
pub fn halve(dataset: &Dataset, out: &Path, console: &dyn Observer) -> Result<Config> {
    expect_day(dataset)?;
    let folder = NewFolder::create(out)?;
    let progress = console.progress("halving", work(&dataset.config));
    let mut writer = Writer::create(folder.temporary())?;
    let config = write(dataset, &mut writer, folder.temporary(), &progress)?;
    writer.commit(&config)?;
    drop(progress);
    folder.finish()?;
    Ok(config)
}

/// The [`Config::inputs`] of what [`halve`] makes of a dataset: a digest of all that decides its files.
pub fn halved_inputs(config: &Config) -> String {
    let files: Vec<Digest> = references(config).map(|file| file.blake3).collect();
    let all = json!([GENERATOR, config.inputs, config.digest_of_light(), files]).to_string();
    blake3::hash(all.as_bytes()).to_hex().to_string()
}

/// The functions of a transfer go with the bake of a scene's day by its `inputs`, which no halved dataset
/// has.
fn expect_day(dataset: &Dataset) -> Result<()> {
    let Some(transfer) = &dataset.config.transfer else { return Ok(()) };
    let what = format!(
        "is the transfer of {:?}, which exists only at full resolution; expected a dataset of a day",
        transfer.scene
    );
    Err(Error::unsupported(dataset.root.display(), what))
}

/// What the progress counts: rows that are written, and about as much for visibility.
fn work(config: &Config) -> u64 {
    let rows = |page: usize| u64::from(config.pages[page].height.div_ceil(2));
    let pages = 0..config.pages.len();
    pages.map(|page| rows(page) * images::count(config, page) + sunlight::work(config, page)).sum()
}

/// Writes all files; gives the manifest that names them.
fn write(dataset: &Dataset, writer: &mut Writer, root: &Path, progress: &dyn Meter) -> Result<Config> {
    let source = &dataset.config;
    let mut config = source.clone();
    (config.version, config.inputs) = (VERSION, halved_inputs(source));
    let by = source.generator.split(", of ").last().unwrap_or_default();
    config.generator = format!("{GENERATOR}, of {by}");
    config.set_halved(&source.halved_again());
    // Errors of neighbouring texels go together after denoising, so that the error of their mean is not
    // known.
    config.noise = None;
    config.frames.iter_mut().for_each(|frame| frame.relative_error = None);
    // The layout's own configuration names lightmaps of other sizes.
    config.source.iter_mut().for_each(|source| source.config = None);
    places::move_instances(&mut config);

    let mut copy = |file: &FileRef| copied(dataset, writer, file);
    for layer in &mut config.layers {
        layer.curve = layer.curve.as_ref().map(&mut copy).transpose()?;
    }
    config.sun_path = config.sun_path.as_ref().map(&mut copy).transpose()?;
    config.geometry = match &source.geometry {
        None => None,
        Some(file) => Some(geometry(dataset, writer, file)?),
    };
    let mut visibility = source.visibility.as_ref().map(|of| SunVisibility {
        minutes: of.minutes,
        files: Vec::new(),
        normals: Vec::new(),
    });
    for page in 0..source.pages.len() {
        let half = Half::new(dataset.mask(page)?);
        let mask = half.mask();
        let file = writer.add(stem_of(&source.pages[page].mask.path), "png", &mask.to_png())?;
        config.pages[page] = Page {
            width: mask.width as u32,
            height: mask.height as u32,
            mask: file,
            ..source.pages[page].clone()
        };
        images::write(&images::Job { dataset, page, half: &half, progress }, writer, root, &mut config)?;
        if let Some(visibility) = &mut visibility {
            let [levels, normals] = sunlight::write(dataset, page, &half, writer, progress)?;
            visibility.files.extend(levels);
            visibility.normals.extend(normals);
        }
    }
    config.visibility = visibility;
    Ok(config)
}

/// A file as it is, its checksum checked.
fn copied(dataset: &Dataset, writer: &mut Writer, file: &FileRef) -> Result<FileRef> {
    let bytes = read(dataset, file)?;
    let extension = file.path.rsplit_once('.').map_or("bin", |(_, extension)| extension);
    writer.add(stem_of(&file.path), extension, &bytes)
}

/// The geometry, with the places of the half pages in its nodes' extras.
fn geometry(dataset: &Dataset, writer: &mut Writer, file: &FileRef) -> Result<FileRef> {
    let bytes = read(dataset, file)?;
    let place = dataset.path(file);
    let moved = places::moved_geometry(&bytes, &dataset.config)
        .map_err(|what| Error::invalid(place.display(), what))?;
    let file = writer.add(stem_of(&file.path), "glb", &moved)?;
    writer.alias(&file, GLB);
    Ok(file)
}

/// The bytes of a file, its checksum checked.
fn read(dataset: &Dataset, file: &FileRef) -> Result<Vec<u8>> {
    stop_if_interrupted()?;
    dataset.read(file)
}

/// The number of files that a manifest names, and their bytes, each counted once.
pub fn extent(config: &Config) -> (usize, u64) {
    let distinct: BTreeMap<&str, u64> = references(config).map(|file| (&*file.path, file.bytes)).collect();
    (distinct.len(), distinct.values().sum())
}

/// The halved dataset in a folder, complete and made from this very source.
///
/// # Errors
/// As [`Dataset::open`]; [`Error::Invalid`] for one made from another source.
pub fn open(root: &Path, source: &Config) -> Result<Dataset> {
    let dataset = Dataset::open(root)?;
    if dataset.config.inputs != halved_inputs(source) {
        let what = "was not made from the present state of that dataset; run `dataset halve` again";
        return Err(Error::invalid(root.join(MANIFEST).display(), what));
    }
    Ok(dataset)
}
