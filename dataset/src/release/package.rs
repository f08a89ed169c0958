//! Packages datasets into a release folder.

use super::archive::{Content, Member, pack};
use super::bundle::expect_whole;
use super::datasheet::{Files, datasheet};
use super::parts::{LAYERS, split, without_layers};
use super::{Archive, FORMAT, MANIFEST, Manifest, READERS, SUMS, Scene, VERSION, sums};
use crate::exchange::export;
use crate::format::config::hours_apart;
use crate::host::files::{NewFolder, json, remove_folder, write_atomically, write_atomically_with};
use crate::host::signals::stop_if_interrupted;
use crate::layout::Layout;
use crate::observe::{Meter, Observer};
use crate::pictures::preview::pictures;
use crate::store::{self, Dataset};
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Hours of the pictures; the frames nearest to them …
const PREVIEW_HOURS: [f64; 4] = [0.0, 6.0, 12.0, 18.1];
/// … and not farther than this.
const PREVIEW_REACH: f64 = 0.5;
/// Largest side of a picture.
const PREVIEW_SIDE: usize = 1024;

/// Result of packaging.
#[derive(Clone, Debug, PartialEq)]
pub struct Packaged {
    /// Names of the scenes.
    pub scenes: Vec<String>,
    /// What the layouts of exchange cannot store.
    pub omitted: Vec<String>,
    /// Files in the release folder.
    pub files: usize,
    /// Their length.
    pub bytes: u64,
}

/// Packages datasets and their bundles into the new folder `out`, which appears when it is complete. Each is
/// checked first. `cc0`: the datasheets say that the datasets are released under CC0.
///
/// # Errors
/// For a dataset with a fault, and any other failure; then nothing is left behind.
pub fn release(
    folders: &[PathBuf],
    layouts: &[&dyn Layout],
    cc0: bool,
    out: &Path,
    console: &dyn Observer,
) -> Result<Packaged> {
    let folder = NewFolder::create(out)?;
    let root = folder.temporary();
    let mut datasets = Vec::new();
    let mut names = BTreeSet::new();
    for path in folders {
        let dataset = Dataset::open(path)?;
        let scene = &dataset.config.scene;
        if scene.chars().any(char::is_control) || scene.starts_with(['.', '-']) {
            let what =
                format!("scene {scene:?}; expected a name without control characters, '.' or '-' in front");
            return Err(Error::unsupported(path.display(), what));
        }
        if !names.insert(scene.clone()) {
            return Err(Error::invalid(
                path.display(),
                format!("scene {scene:?} occurs twice; expected distinct scene names"),
            ));
        }
        datasets.push(dataset);
    }
    check(&datasets, console)?;

    let mut plans = Vec::new();
    for dataset in &datasets {
        plans.push(Plan::of(dataset, layouts, root, console)?);
    }
    let members = plans.iter().flat_map(|plan| &plan.archives).flat_map(|(_, members)| members);
    let total: u64 = members.map(Member::length).sum::<Result<u64>>()?;
    let progress = console.progress("packing", total);
    let mut scenes = Vec::new();
    for (dataset, plan) in datasets.iter().zip(plans) {
        scenes.push(plan.fill(dataset, cc0, root, &progress)?);
    }
    drop(progress);

    for (name, program) in READERS {
        write_atomically(&root.join(name), program)?;
    }
    let omitted = scenes.iter().flat_map(|(_, omitted)| omitted.clone()).collect();
    let manifest = Manifest {
        format: FORMAT.to_owned(),
        version: VERSION,
        generator: concat!("dataset release ", env!("CARGO_PKG_VERSION")).to_owned(),
        scenes: scenes.into_iter().map(|(scene, _)| scene).collect(),
    };
    write_atomically(&root.join(MANIFEST), &json(&root.join(MANIFEST), &manifest)?)?;
    let bytes = write_sums(root, console)?;
    stop_if_interrupted()?;
    folder.finish()?;
    let files = bytes.len();
    Ok(Packaged { scenes: names.into_iter().collect(), omitted, files, bytes: bytes.iter().sum() })
}

/// The first fault of any, as an error.
fn check(datasets: &[Dataset], console: &dyn Observer) -> Result<()> {
    let steps: usize = datasets.iter().map(Dataset::verify_steps).sum();
    let progress = console.progress("checking", steps as u64);
    for dataset in datasets {
        let found = dataset.verify(|| progress.advance(1));
        stop_if_interrupted()?;
        found.faults.into_iter().next().map_or(Ok(()), Err)?;
        let scene = &dataset.config.scene;
        found.warnings.iter().for_each(|warning| console.warn(format!("{scene}: {warning}")));
    }
    Ok(())
}

/// What is to be written of a scene.
struct Plan {
    /// What each archive holds.
    archives: Vec<(String, Vec<Member>)>,
    /// Folders of exported layouts, to be removed once they are packed.
    exported: Vec<PathBuf>,
    omitted: Vec<String>,
}

impl Plan {
    fn of(dataset: &Dataset, layouts: &[&dyn Layout], root: &Path, console: &dyn Observer) -> Result<Self> {
        let (config, scene) = (&dataset.config, &dataset.config.scene);
        let place = dataset.root.join(store::MANIFEST);
        let own = fs::read(&place).map_err(Error::io(&place))?;
        let memory =
            |name: &str, bytes| Member { path: format!("{scene}/{name}"), content: Content::Memory(bytes) };
        let mut archives = Vec::new();
        for (holds, files) in split(config) {
            let mut members = Vec::new();
            if holds == "sets" {
                match without_layers(config) {
                    Some(frames) => {
                        members.push(memory(store::MANIFEST, json(&place, &frames)?));
                        members.push(memory(LAYERS, own.clone()));
                    }
                    None => members.push(memory(store::MANIFEST, own.clone())),
                }
            }
            members.extend(files.into_iter().map(|file| Member {
                path: format!("{scene}/{}", file.path),
                content: Content::Disk(dataset.path(file), Some(file.clone())),
            }));
            archives.push((holds.to_owned(), members));
        }
        let (mut exported, mut omitted) = (Vec::new(), Vec::new());
        for &layout in layouts {
            let name = format!("{scene}-{}", layout.name());
            let folder = root.join(format!("{name}.export"));
            let reported = export(dataset, layout, &folder, console)?.omitted;
            omitted.extend(reported.into_iter().map(|what| format!("{name}: {what}")));
            let mut files = Vec::new();
            list(&folder, &name, &mut files)?;
            files.sort_by(|a, b| a.path.cmp(&b.path));
            archives.push((layout.name().to_owned(), files));
            exported.push(folder);
        }
        Ok(Plan { archives, exported, omitted })
    }

    /// Writes the scene's files; gives its entry of the manifest, and what was omitted.
    fn fill(
        self,
        dataset: &Dataset,
        cc0: bool,
        root: &Path,
        progress: &dyn Meter,
    ) -> Result<(Scene, Vec<String>)> {
        let config = &dataset.config;
        let scene = &config.scene;
        let packed = self.archives.par_iter().map(|(holds, members)| {
            let name = format!("{scene}-{holds}.tar.zst");
            let files = pack(&root.join(&name), members, progress)?;
            let bytes = length(&root.join(&name))?;
            Ok((Archive { name, holds: holds.clone(), files }, bytes))
        });
        let archives =
            packed.collect::<Vec<Result<(Archive, u64)>>>().into_iter().collect::<Result<Vec<_>>>()?;
        self.exported.iter().try_for_each(|folder| remove_folder(folder))?;
        let bundles = copy_bundles(dataset, root)?;
        let mut previews = Vec::new();
        for frame in preview_frames(dataset) {
            for (page, png) in pictures(dataset, frame, PREVIEW_SIDE)?.iter().enumerate() {
                let page = if config.pages.len() > 1 { format!("-page{page}") } else { String::new() };
                let name = format!("{scene}-{}h{page}.png", config.frames[frame].hour);
                expect_free(root, &name)?;
                write_atomically(&root.join(&name), png)?;
                previews.push(name);
            }
        }
        let (archives_of, omitted) = (&archives, &self.omitted);
        let files = Files { archives: archives_of, bundles: &bundles, previews: &previews, omitted, cc0 };
        let name = format!("{scene}.md");
        expect_free(root, &name)?;
        write_atomically(&root.join(&name), datasheet(config, &files).as_bytes())?;
        let entry = Scene {
            scene: scene.clone(),
            datasheet: name,
            archives: archives.into_iter().map(|(archive, _)| archive).collect(),
            bundles: bundles.into_iter().map(|(name, _)| name).collect(),
            previews,
        };
        Ok((entry, self.omitted))
    }
}

/// All files below a folder, with their paths in the archive.
fn list(folder: &Path, prefix: &str, files: &mut Vec<Member>) -> Result<()> {
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        let name = format!("{prefix}/{}", path.file_name().unwrap_or_default().to_string_lossy());
        match path.is_dir() {
            true => list(&path, &name, files)?,
            false => files.push(Member { path: name, content: Content::Disk(path, None) }),
        }
    }
    Ok(())
}

/// The frames that pictures are made of, ascending; at least one.
fn preview_frames(dataset: &Dataset) -> BTreeSet<usize> {
    let config = &dataset.config;
    let nearest = PREVIEW_HOURS.iter().filter_map(|&hour| {
        let nearest = config.nearest_frame(hour)?;
        (hours_apart(config.frames[nearest].hour, hour) <= PREVIEW_REACH).then_some(nearest)
    });
    let nearest: BTreeSet<usize> = nearest.collect();
    if nearest.is_empty() { BTreeSet::from([0]) } else { nearest }
}

/// Copies the bundles in a dataset's folder; returns their names in the release, which begin with the
/// scene's, and lengths.
fn copy_bundles(dataset: &Dataset, root: &Path) -> Result<Vec<(String, u64)>> {
    let scene = &dataset.config.scene;
    let entries = fs::read_dir(&dataset.root).map_err(Error::io(&dataset.root))?;
    let mut found = BTreeMap::new();
    for entry in entries {
        let path = entry.map_err(Error::io(&dataset.root))?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        // Names with a dot in front are of unfinished work.
        let Some(name) = name.filter(|name| name.ends_with(".ndgi") && !name.starts_with('.')) else {
            continue;
        };
        if name.chars().any(char::is_control) || !path.is_file() {
            continue;
        }
        // (Coarser levels are `yard.1.ndgi`, and so on.)
        let own = ["-", "."].iter().any(|next| name.starts_with(&format!("{scene}{next}")));
        let name = if own { name.to_owned() } else { format!("{scene}-{name}") };
        if let Some(other) = found.insert(name.clone(), path.clone()) {
            let what = format!("would be {name} in the release, as would {}; rename one", other.display());
            return Err(Error::invalid(path.display(), what));
        }
    }
    let mut bundles = Vec::new();
    for (name, path) in found {
        expect_free(root, &name)?;
        expect_whole(&path, &dataset.config.digest_of_light())?;
        let mut source = File::open(&path).map_err(Error::io(&path))?;
        let copied = write_atomically_with(&root.join(&name), |out| io::copy(&mut source, out).map(drop));
        stop_if_interrupted()?;
        copied?;
        bundles.push((name.clone(), length(&root.join(&name))?));
    }
    Ok(bundles)
}

/// An error where another scene has taken a name.
fn expect_free(root: &Path, name: &str) -> Result<()> {
    match root.join(name).exists() {
        true => {
            Err(Error::invalid(name, "two scenes would have a file of this name; expected different names"))
        }
        false => Ok(()),
    }
}

/// Writes the list of checksums; gives the lengths of all files, its own among them.
fn write_sums(root: &Path, console: &dyn Observer) -> Result<Vec<u64>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(root).map_err(Error::io(root))? {
        let name = entry.map_err(Error::io(root))?.file_name();
        names.push(
            name.into_string().map_err(|name| Error::invalid(name.display(), "the name is not UTF-8"))?,
        );
    }
    names.sort();
    let lengths = names.iter().map(|name| length(&root.join(name))).collect::<Result<Vec<u64>>>()?;
    let progress = console.progress("summing", lengths.iter().sum());
    let sums = names.into_par_iter().map(|name| {
        let sum = sums::sha256(&root.join(&name), &progress)?;
        Ok((name, sum))
    });
    let list = sums::format(&sums.collect::<Result<BTreeMap<String, String>>>()?);
    write_atomically(&root.join(SUMS), list.as_bytes())?;
    Ok(lengths.into_iter().chain([list.len() as u64]).collect())
}

fn length(path: &Path) -> Result<u64> {
    Ok(path.metadata().map_err(Error::io(path))?.len())
}
