//! Verifies every byte of a release without unpacking it to disk and without trusting it.

use super::archive::{Examined, examine};
use super::bundle::expect_whole;
use super::parts::LAYERS;
use super::{FORMAT, MANIFEST, MAX_TEXT_BYTES, Manifest, SUMS, Scene, VERSION, sums};
use crate::format::FileRef;
use crate::host::files::is_component;
use crate::host::inputs::{expect_file, expect_folder};
use crate::observe::{Meter, Observer};
use crate::store::{self, parse_config};
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

/// Result of [`verify`].
#[derive(Debug, Default)]
pub struct Verified {
    /// Every difference from what the release says.
    pub faults: Vec<Error>,
    /// Names of the scenes.
    pub scenes: Vec<String>,
    /// Files that are listed.
    pub files: usize,
    /// Total bytes of those that exist.
    pub bytes: u64,
}

/// What is verified, for the message where it is not there.
const RELEASE: &str = "a release, a folder with SHA256SUMS, as `dataset release` writes it, or a dataset, a folder with config.json";

/// Verifies a release: that it has exactly the files of `SHA256SUMS`, with their checksums; that archives
/// contain what `release.json` says, and all that each scene's own manifest names.
///
/// # Errors
/// `Interrupted`, or where the folder cannot be read at all. Everything else is a fault.
pub fn verify(folder: &Path, console: &dyn Observer) -> Result<Verified> {
    let mut verified = Verified::default();
    let place = folder.join(SUMS);
    let read = || {
        expect_folder(folder, RELEASE)?;
        expect_file(&place, RELEASE)?;
        let bytes = text(&place)?;
        let text = str::from_utf8(&bytes).map_err(|error| Error::invalid(place.display(), error))?;
        sums::parse(&place, text)
    };
    let listed = match read() {
        Ok(listed) => listed,
        Err(fault) => return Ok(Verified { faults: vec![fault], ..verified }),
    };
    let faults = &mut verified.faults;
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        let known = entry.file_name().to_str().is_some_and(|name| name == SUMS || listed.contains_key(name));
        if !known {
            faults.push(Error::invalid(entry.path().display(), format!("not in {SUMS}")));
        }
    }
    let mut lengths = BTreeMap::new();
    for name in listed.keys() {
        match fs::symlink_metadata(folder.join(name)) {
            Ok(metadata) if metadata.is_file() => _ = lengths.insert(&**name, metadata.len()),
            Ok(_) => faults.push(Error::invalid(folder.join(name).display(), "not a regular file")),
            Err(error) => faults.push(Error::io(&folder.join(name))(error)),
        }
    }
    let manifest = read_manifest(&folder.join(MANIFEST)).map_err(|fault| faults.push(fault)).ok();
    let scenes = manifest.as_ref().map_or(&[][..], |manifest| &manifest.scenes);
    faults.extend(unlisted(folder, scenes, &listed));

    // Each file is read once; archives are looked into on the way.
    let progress = console.progress("verifying", lengths.values().sum());
    let archives: BTreeMap<&str, &[FileRef]> = scenes
        .iter()
        .flat_map(|scene| &scene.archives)
        .map(|archive| (&*archive.name, &*archive.files))
        .collect();
    let present: Vec<&str> = lengths.keys().copied().collect();
    let examined: Vec<Result<(&str, Examined)>> =
        present.par_iter().map(|&name| Ok((name, look(folder, name, &archives, &progress)?))).collect();
    let mut kept = BTreeMap::new();
    for examined in examined {
        match examined {
            Ok((name, examined)) => {
                if examined.sha256 != listed[name] {
                    let (found, expected) = (&examined.sha256[..16], &listed[name][..16]);
                    let what = format!("SHA-256 {found}…; {SUMS} says {expected}…: the content changed");
                    faults.push(Error::invalid(folder.join(name).display(), what));
                }
                faults.extend(examined.faults);
                kept.extend(examined.kept);
            }
            Err(Error::Interrupted) => return Err(Error::Interrupted),
            Err(fault) => faults.push(fault),
        }
    }
    faults.extend(scenes.iter().flat_map(|scene| incomplete(folder, scene, &kept)));
    verified.scenes = scenes.iter().map(|scene| scene.scene.clone()).collect();
    (verified.files, verified.bytes) = (listed.len(), lengths.values().sum());
    Ok(verified)
}

fn look(
    folder: &Path,
    name: &str,
    archives: &BTreeMap<&str, &[FileRef]>,
    progress: &dyn Meter,
) -> Result<Examined> {
    let path = folder.join(name);
    let Some(files) = archives.get(name) else {
        let sha256 = sums::sha256(&path, progress)?;
        return Ok(Examined { sha256, faults: Vec::new(), kept: BTreeMap::new() });
    };
    let is_manifest =
        |path: &str| path.split_once('/').is_some_and(|(_, name)| name == store::MANIFEST || name == LAYERS);
    examine(&path, files, is_manifest, progress)
}

/// A text file; larger ones than a release has are not read.
fn text(path: &Path) -> Result<Vec<u8>> {
    if !path.metadata().map_err(Error::io(path))?.is_file() {
        return Err(Error::invalid(path.display(), "not a regular file"));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(Error::io(path))?;
    file.take(MAX_TEXT_BYTES + 1).read_to_end(&mut bytes).map_err(Error::io(path))?;
    match bytes.len() as u64 > MAX_TEXT_BYTES {
        true => Err(Error::unsupported(path.display(), format!("more than {MAX_TEXT_BYTES} bytes"))),
        false => Ok(bytes),
    }
}

fn read_manifest(path: &Path) -> Result<Manifest> {
    let bytes = text(path)?;
    let manifest: Manifest = serde_json::from_slice(&bytes).map_err(Error::json(path))?;
    if manifest.format != FORMAT {
        let what = format!("format is {:?}; expected {FORMAT:?}", manifest.format);
        return Err(Error::invalid(path.display(), what));
    }
    if manifest.version == 0 || manifest.version > VERSION {
        let what = format!("version {}; this program reads up to {VERSION}", manifest.version);
        return Err(Error::unsupported(path.display(), what));
    }
    Ok(manifest)
}

/// Files that the manifest names and the list of checksums does not.
fn unlisted(folder: &Path, scenes: &[Scene], listed: &BTreeMap<String, String>) -> Vec<Error> {
    let named = scenes.iter().flat_map(|scene| {
        let archives = scene.archives.iter().map(|archive| &archive.name);
        archives.chain(&scene.bundles).chain(&scene.previews).chain([&scene.datasheet])
    });
    let named = named.map(String::as_str).chain([MANIFEST]);
    let unlisted = named.filter(|name| !listed.contains_key(*name));
    unlisted
        .map(|name| Error::invalid(folder.join(SUMS).display(), format!("it does not list {name:?}")))
        .collect()
}

/// What the scene's own manifests name and its archives do not hold.
fn incomplete(folder: &Path, scene: &Scene, kept: &BTreeMap<String, Vec<u8>>) -> Vec<Error> {
    let mut faults = Vec::new();
    if !is_component(&scene.scene) {
        let what = format!("scene {:?}; expected a name that can be a folder's", scene.scene);
        return vec![Error::invalid(folder.join(MANIFEST).display(), what)];
    }
    let held: BTreeSet<&FileRef> = scene.archives.iter().flat_map(|archive| &archive.files).collect();
    for name in [store::MANIFEST, LAYERS] {
        let path = format!("{}/{name}", scene.scene);
        let Some(bytes) = kept.get(&path) else {
            if name == store::MANIFEST {
                faults.push(Error::invalid(folder.display(), format!("no archive contains {path}")));
            }
            continue;
        };
        match parse_config(Path::new(&path), bytes) {
            Err(fault) => faults.push(fault),
            Ok((config, wrong)) => {
                faults.extend(wrong);
                if name == store::MANIFEST {
                    let digest = config.digest_of_light();
                    let bundles =
                        scene.bundles.iter().filter(|name| is_component(name)).map(|name| folder.join(name));
                    let there = bundles.filter(|bundle| bundle.is_file());
                    faults.extend(there.filter_map(|bundle| expect_whole(&bundle, &digest).err()));
                }
                for file in store::references(&config) {
                    let packed = FileRef { path: format!("{}/{}", scene.scene, file.path), ..file.clone() };
                    if !held.contains(&packed) {
                        faults.push(Error::invalid(
                            &path,
                            format!("{:?} is in no archive as it says", file.path),
                        ));
                    }
                }
            }
        }
    }
    faults
}
