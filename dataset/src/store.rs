//! A dataset's folder: writer and reader.

use crate::digest::Digest;
use crate::format::tiles::{TILE, grid};
use crate::format::{Config, FileRef, Light, Noise, VERSION};
use crate::host::files;
use crate::host::files::{is_component, read_json};
use crate::image::{self, Image, Mask};
use crate::observe::count;
use crate::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

mod check;
mod light_at;
mod stage;
mod sunlight;
mod verified;
mod verify;

pub(crate) use check::references;
pub(crate) use stage::Staged;
pub use sunlight::Sunlight;
use verify::ROWS;
pub use verify::Verification;
pub(crate) use verify::{about_equal, geometry};

/// The manifest's name in the folder.
pub const MANIFEST: &str = "config.json";
/// The sub-folder of the files that carry their content's hash in their name.
pub const DATA: &str = "data";
/// The folder of `bake`'s work until the dataset is complete.
pub const WORK: &str = ".bake";
/// Message for a folder with such work and no manifest yet.
pub const UNFINISHED: &str = "the bake in it is not finished; the same `bake` command continues it";
/// Hexadecimal digits of the hash in a file's name.
const HASH_DIGITS: usize = 12;

/// Fills a dataset folder. Files carry their content's hash in their name, so a running reader of the
/// previous generation is never disturbed; [`Writer::commit`] renames `config.json` into place last.
#[derive(Debug)]
pub struct Writer {
    root: PathBuf,
    /// What this writer added, by content hash.
    added: BTreeMap<Digest, FileRef>,
    /// Plain names in the folder for added files.
    aliases: Vec<(String, String)>,
}

impl Writer {
    /// Opens or creates the folder. Temporaries of dead runs are removed; a folder whose `config.json` is not
    /// a dataset's is refused, so that nothing foreign is overwritten.
    pub fn create(root: &Path) -> Result<Self> {
        let data = root.join(DATA);
        let manifest = root.join(MANIFEST);
        if manifest.exists() {
            parse_manifest(&manifest, &read(&manifest)?)?;
        }
        files::create_folders(&data).map_err(Error::io(&data))?;
        files::remove_stale_temporaries(root)?;
        files::remove_stale_temporaries(&data)?;
        Ok(Writer { root: root.to_owned(), added: BTreeMap::new(), aliases: Vec::new() })
    }

    /// Writes `bytes` as `data/<stem>-<hash12>.<extension>`, or finds that content among what this writer
    /// added, whatever its stem. A file of that name with that content, left by an earlier run, is reused.
    /// What is found does not depend on what else the folder holds, so the manifest does not either.
    /// Characters of `stem` other than letters, digits, `.` and `_` become `-`.
    pub fn add(&mut self, stem: &str, extension: &str, bytes: &[u8]) -> Result<FileRef> {
        let blake3 = Digest::of(bytes);
        if let Some(known) = self.added.get(&blake3) {
            return Ok(known.clone());
        }
        let path = format!("{DATA}/{}-{}.{extension}", plain_stem(stem), blake3.first(HASH_DIGITS));
        let on_disk = self.root.join(&path);
        if bytes.is_empty() || content_hash(&path).is_none() {
            return Err(stage::no_content(&on_disk));
        }
        // A file of that name and content may exist from an earlier run; a damaged one is replaced.
        if !has_content(&on_disk, bytes) {
            files::write_atomically(&on_disk, bytes)?;
        }
        let file = FileRef { path, bytes: bytes.len() as u64, blake3 };
        self.added.insert(blake3, file.clone());
        Ok(file)
    }

    /// Gives an added file a plain `name` in the dataset's folder as well (a hard link where possible) once
    /// the manifest is in place, for people and tools that do not read `config.json`.
    ///
    /// # Panics
    /// If `name` is not one plain component, or that of the manifest or the data folder.
    pub fn alias(&mut self, file: &FileRef, name: &str) {
        assert!(is_component(name) && name != MANIFEST && name != DATA, "alias {name:?}");
        self.aliases.push((file.path.clone(), name.to_owned()));
    }

    /// Puts `config.json` in place and removes files that neither it nor the manifest it replaces refers to.
    /// The manifest is checked like [`Dataset::open`] does, before anything changes.
    pub fn commit(self, config: &Config) -> Result<()> {
        let manifest = self.root.join(MANIFEST);
        check::faults(&manifest, config).into_iter().next().map_or(Ok(()), Err)?;
        check::files(&self.root, config)?;
        let mut kept: BTreeSet<String> = check::references(config).map(|file| file.path.clone()).collect();
        if manifest.exists() {
            collect_paths(&parse_manifest(&manifest, &read(&manifest)?)?, &mut kept);
        }
        let json = files::json(&manifest, config)?;
        // (What a killed run left there and this one found has a name that may not have reached the disk.)
        files::sync_folder_of(&self.root.join(DATA).join(MANIFEST));
        files::write_atomically(&manifest, &json)?;
        for (path, name) in &self.aliases {
            files::link_or_copy(&self.root.join(path), &self.root.join(name))?;
        }
        // The new generation is in place; files that nothing refers to any more can be removed, now or in the
        // next run.
        let data = self.root.join(DATA);
        for entry in fs::read_dir(&data).map_err(Error::io(&data))?.flatten() {
            let Some(path) = entry.file_name().to_str().map(|name| format!("{DATA}/{name}")) else {
                continue;
            };
            if content_hash(&path).is_some() && !kept.contains(&path) {
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(())
    }
}

/// True if a value is not light: negative or not finite.
pub(crate) fn is_bad(value: f32) -> bool {
    !value.is_finite() || value < 0.0
}

/// An error with the first texel of whole rows from row `y0` on that is negative or not finite.
pub(crate) fn refuse_light(path: &Path, width: usize, y0: usize, texels: &[[f32; 3]]) -> Result<()> {
    image::refuse_texels(path, width, y0, texels, is_bad, "a finite value, zero or positive")
}

/// A stem with characters that file names cannot have replaced.
fn plain_stem(stem: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' || c == '_' { c } else { '-' };
    stem.chars().map(plain).collect()
}

/// The hash digits in a path that [`Writer::add`] made; `None` for every other path.
fn content_hash(path: &str) -> Option<&str> {
    let (stem, rest) = path.strip_prefix(DATA)?.strip_prefix('/')?.rsplit_once('-')?;
    let (hash, extension) = rest.split_once('.')?;
    let made = !stem.is_empty()
        && hash.len() == HASH_DIGITS
        && hash.bytes().all(|digit| matches!(digit, b'0'..=b'9' | b'a'..=b'f'))
        && !extension.is_empty()
        && extension.bytes().all(|c| c.is_ascii_alphanumeric());
    made.then_some(hash)
}

/// The stem by which the file at a path was added; that of its name, for a path that [`Writer::add`] did not
/// make.
pub(crate) fn stem_of(path: &str) -> &str {
    let name = path.rsplit_once('/').map_or(path, |(_, name)| name);
    let stem = match content_hash(path) {
        Some(_) => name.rsplit_once('-').map_or(name, |(stem, _)| stem),
        None => name.split_once('.').map_or(name, |(stem, _)| stem),
    };
    if stem.is_empty() { "file" } else { stem }
}

fn has_content(path: &Path, bytes: &[u8]) -> bool {
    fs::metadata(path).is_ok_and(|metadata| metadata.len() == bytes.len() as u64)
        && fs::read(path).is_ok_and(|found| found == bytes)
}

fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(Error::io(path))
}

/// A manifest as untyped JSON, its `format` checked.
fn parse_manifest(path: &Path, bytes: &[u8]) -> Result<serde_json::Value> {
    let value: serde_json::Value = serde_json::from_slice(bytes).map_err(Error::json(path))?;
    match value.get("format").and_then(|format| format.as_str()) {
        Some(crate::format::FORMAT) => Ok(value),
        found => {
            let found = found.map_or("missing".to_owned(), |format| format!("{format:?}"));
            let what = format!("format is {found}; expected {:?}", crate::format::FORMAT);
            Err(Error::invalid(path.display(), what))
        }
    }
}

/// Reads a manifest, and gives everything in it that is invalid; `place` names it in errors.
///
/// # Errors
/// `Unsupported` for another version, `Invalid` for a file that is not a manifest.
pub fn parse_config(place: &Path, bytes: &[u8]) -> Result<(Config, Vec<Error>)> {
    let config = parse(place, bytes)?;
    let faults = check::faults(place, &config);
    Ok((config, faults))
}

fn parse(place: &Path, bytes: &[u8]) -> Result<Config> {
    // The version decides how the rest is read, so it is checked first.
    let value = parse_manifest(place, bytes)?;
    let unsupported = |what: String| Err(Error::unsupported(place.display(), what));
    let version = &value["version"];
    if version.as_u64() != Some(VERSION.into()) {
        let advice = match version.as_u64() {
            Some(version) if version > VERSION.into() => "use a newer one",
            Some(_) => "bake or import the dataset again",
            None => "expected that number",
        };
        return unsupported(format!(
            "format version {version}; this program reads version {VERSION}; {advice}"
        ));
    }
    let mut pages = (0..).zip(value["pages"].as_array().into_iter().flatten());
    if let Some((page, _)) = pages.find(|(_, page)| page["kind"] == "probes") {
        return unsupported(format!(
            "page {page}: kind is \"probes\"; this program reads only pages of the kind \"atlas\"; use a newer one"
        ));
    }
    serde_json::from_slice(bytes).map_err(Error::json(place))
}

/// Every string under a key `path`, as manifests of any version refer to files.
fn collect_paths(value: &serde_json::Value, paths: &mut BTreeSet<String>) {
    match value {
        serde_json::Value::Object(object) => {
            for (key, value) in object {
                match value {
                    serde_json::Value::String(path) if key == "path" => drop(paths.insert(path.clone())),
                    value => collect_paths(value, paths),
                }
            }
        }
        serde_json::Value::Array(values) => values.iter().for_each(|value| collect_paths(value, paths)),
        _ => {}
    }
}

/// An opened dataset.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The folder.
    pub root: PathBuf,
    /// Its manifest, checked for consistency (versions, counts, hours sorted, paths inside the folder).
    pub config: Config,
    /// Files that were verified.
    known: verified::Known,
    /// True if rows of images are read from files that were not verified.
    trusts_rows: bool,
}

impl Dataset {
    /// Reads and checks `config.json`, and that the files it names exist with the lengths it
    /// states.
    pub fn open(root: &Path) -> Result<Self> {
        let dataset = Self::open_manifest(root)?;
        check::files(root, &dataset.config)?;
        Ok(dataset)
    }

    /// [`Dataset::open`] without checking the files.
    pub fn open_manifest(root: &Path) -> Result<Self> {
        let (dataset, faults) = Self::read_manifest(root)?;
        faults.into_iter().next().map_or(Ok(dataset), Err)
    }

    /// Reads `config.json` and returns all its faults. A dataset with faults can only be used with
    /// [`Dataset::verify_files`].
    pub fn read_manifest(root: &Path) -> Result<(Self, Vec<Error>)> {
        let manifest = root.join(MANIFEST);
        // (A file server that is away is not a missing file.)
        let is_there = |path: &Path| match path.try_exists() {
            Err(error) if error.kind() == std::io::ErrorKind::NotADirectory => Ok(false),
            found => found.map_err(Error::io(path)),
        };
        if !is_there(&manifest)? || !manifest.is_file() {
            let found = match (root.is_dir(), root.exists()) {
                (true, _) if root.join(WORK).is_dir() => UNFINISHED.to_owned(),
                (true, _) => format!("it has no {MANIFEST}"),
                (false, true) => "it is not a folder".to_owned(),
                (false, false) => "it does not exist".to_owned(),
            };
            let expected =
                format!("expected a folder with {MANIFEST}, as `bake` and `dataset import` write it");
            let what = format!("not a dataset: {found}; {expected}");
            return Err(Error::invalid(root.display(), what));
        }
        let config = parse(&manifest, &read(&manifest)?)?;
        let faults = check::faults(&manifest, &config);
        Ok((Dataset::of(root, config), faults))
    }

    /// A dataset whose manifest is in memory.
    pub(crate) fn of(root: &Path, config: Config) -> Self {
        let known = verified::Known::default();
        Dataset { root: root.to_owned(), config, known, trusts_rows: false }
    }

    /// The same, but [`Dataset::map_rows`], [`Dataset::image_rows`] and [`Dataset::sum_rows`] verify no
    /// checksums: for one of many processes that each read some rows of large files, where another compares
    /// what they read with verified files.
    pub fn with_unverified_rows(self) -> Self {
        Dataset { trusts_rows: true, ..self }
    }

    /// Every reference to a file, in the manifest's order; one file may come several times.
    pub fn files(&self) -> impl Iterator<Item = &FileRef> {
        check::references(&self.config)
    }

    /// The absolute path of a file, for messages; [`Dataset::verified`] gives one to read.
    pub fn path(&self, file: &FileRef) -> PathBuf {
        self.root.join(&file.path)
    }

    /// The mask of a page: size and checksum checked.
    ///
    /// # Panics
    /// If `page` is not below the number of pages.
    pub fn mask(&self, page: usize) -> Result<Mask> {
        let page = &self.config.pages[page];
        let path = self.verified_mask(&page.mask)?;
        let mask = Mask::read_png(&path)?;
        check::size(&path, (mask.width, mask.height), page)?;
        Ok(mask)
    }

    /// The masks of all pages: see [`Dataset::mask`].
    ///
    /// # Errors
    /// Those of [`Dataset::mask`].
    pub fn masks(&self) -> Result<Vec<Mask>> {
        (0..self.config.pages.len()).map(|page| self.mask(page)).collect()
    }

    /// The lightmap of a frame on a page: size and checksum checked; non-finite or negative texels are an
    /// error with file, (x, y), channel, value.
    ///
    /// # Panics
    /// If `frame` or `page` is not below the number of frames or pages.
    pub fn map(&self, frame: usize, page: usize) -> Result<Image> {
        self.image(&self.config.frames[frame].maps[page], page)
    }

    /// An EXR file of a page, such as a layer, with the checks of [`Dataset::map`].
    ///
    /// # Panics
    /// If `page` is not below the number of pages.
    pub fn image(&self, file: &FileRef, page: usize) -> Result<Image> {
        let [width, height] = self.config.pages[page].size();
        self.verified_image(file, page)?;
        Ok(Image { width, height, texels: self.image_rows(file, page, 0, height)? })
    }

    /// Rows `y0 .. y1` of [`Dataset::map`], with the same checks; memory does not grow with the page's
    /// height.
    ///
    /// # Panics
    /// If `frame` or `page` is not below the number of frames or pages.
    pub fn map_rows(&self, frame: usize, page: usize, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
        self.image_rows(&self.config.frames[frame].maps[page], page, y0, y1)
    }

    /// Rows `y0 .. y1` of [`Dataset::image`], with the same checks; an error if they do not lie inside the
    /// image.
    ///
    /// # Panics
    /// If `page` is not below the number of pages.
    pub fn image_rows(&self, file: &FileRef, page: usize, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
        let path = if self.trusts_rows { self.path(file) } else { self.verified_image(file, page)? };
        let page = &self.config.pages[page];
        check::size(&path, image::read_exr_size(&path)?, page)?;
        let texels = image::read_exr_rows(&path, y0, y1)?;
        refuse_light(&path, page.width as usize, y0, &texels)?;
        Ok(texels)
    }

    /// The light that the lightmap of a frame on a page holds of one light: the sum of its layers, with the
    /// checks of [`Dataset::map`]. Black also if layers are not stored.
    ///
    /// # Panics
    /// If `page` is not below the number of pages.
    pub fn light(&self, light: Light, group: Option<u32>, frame: usize, page: usize) -> Result<Image> {
        let files = self.config.files_of(light, group, frame, page);
        let [width, height] = self.config.pages[page].size();
        files.iter().try_for_each(|file| self.verified_image(file, page).map(drop))?;
        let texels = self.sum_rows(&files, page, 0, height)?;
        Ok(Image { width, height, texels })
    }

    /// Rows `y0 .. y1` of the sum of images in their order, with the checks of [`Dataset::map`]; one
    /// alone keeps every bit, none is black.
    ///
    /// # Panics
    /// If `page` is not below the number of pages.
    pub fn sum_rows(&self, files: &[&FileRef], page: usize, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
        let Some((first, others)) = files.split_first() else {
            return Ok(vec![[0.0; 3]; self.config.pages[page].width as usize * (y1 - y0)]);
        };
        let mut sum = self.image_rows(first, page, y0, y1)?;
        for file in others {
            image::add(&mut sum, &self.image_rows(file, page, y0, y1)?);
        }
        Ok(sum)
    }

    /// The sampling error per tile, where known.
    pub fn noise(&self) -> Result<Option<Noise>> {
        let Some(file) = &self.config.noise else { return Ok(None) };
        let path = self.verified(file)?;
        let noise: Noise = read_json(&path)?;
        if noise.tile as usize != TILE {
            return Err(Error::unsupported(
                path.display(),
                format!("tiles of {}; expected {TILE}", count(noise.tile as usize, "texel")),
            ));
        }
        let wrong = |what: String| Err(Error::invalid(path.display(), what));
        if noise.mse.len() != self.config.frames.len() {
            return wrong(format!(
                "{}; expected {}",
                count(noise.mse.len(), "frame"),
                self.config.frames.len()
            ));
        }
        for (frame, pages) in noise.mse.iter().enumerate() {
            if pages.len() != self.config.pages.len() {
                return wrong(format!(
                    "frame {frame}: {}; expected {}",
                    count(pages.len(), "page"),
                    self.config.pages.len()
                ));
            }
            for (index, (tiles, page)) in pages.iter().zip(&self.config.pages).enumerate() {
                let (across, down) = grid(page.width as usize, page.height as usize, TILE);
                if tiles.len() != across * down {
                    return wrong(format!(
                        "frame {frame}, page {index}: {}; expected {}",
                        count(tiles.len(), "tile"),
                        across * down
                    ));
                }
                if let Some(tile) = tiles.iter().position(|mse| !mse.is_finite() || *mse < 0.0) {
                    return wrong(format!(
                        "frame {frame}, page {index}, tile {tile}: {}; expected ≥ 0",
                        tiles[tile]
                    ));
                }
            }
        }
        Ok(Some(noise))
    }

    /// An error where the frames are no times of a day: those of a transfer.
    pub fn expect_day(&self) -> Result<()> {
        let Some(transfer) = &self.config.transfer else { return Ok(()) };
        let what = format!("is the transfer of {}; expected a dataset of a day", transfer.scene);
        Err(Error::unsupported(self.root.display(), what))
    }
}
