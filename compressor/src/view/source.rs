//! Finds what belongs to a bundle: the scene's geometry and cameras, and the dataset that it was made from.

use super::{WANTED, glb};
use crate::bundle::{Bundle, Header};
use crate::compress::{default_bundle, light_of};
use crate::evaluate::sizes;
use crate::{Error, Result, of_bundle};
use dataset::format::config::{Config, hours_apart};
use dataset::host::inputs::expect_file;
use dataset::pictures::Camera;
use dataset::store::Dataset;
use ndgi::pack::rgb9e5;
use ndgi::sun::Shadows;
use std::fs;
use std::path::{Path, PathBuf};

/// Options that override what is found.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The bundle, instead of the dataset's own.
    pub bundle: Option<PathBuf>,
    /// The geometry, instead of that of the dataset or the one beside the bundle.
    pub scene: Option<PathBuf>,
    /// Omit the dataset's lightmaps.
    pub no_reference: bool,
}

/// A bundle and what belongs to it.
#[derive(Debug)]
pub struct Source {
    /// The bundle.
    pub bundle: PathBuf,
    /// The geometry.
    pub scene: Option<PathBuf>,
    /// The scene's name, by the bundle.
    pub scene_name: String,
    /// The cameras of the scene that was baked.
    pub cameras: Vec<Camera>,
    /// Why the dataset is not used as a reference.
    pub omitted: Option<String>,
    /// Why the geometry that was named may be that of another scene.
    pub doubts: Vec<String>,
    header: Header,
    reference: Option<Dataset>,
    needs_words: bool,
}

impl Source {
    /// Finds what belongs to a dataset's folder or a bundle.
    ///
    /// # Errors
    /// A bundle that is not there or damaged, or is not of the dataset; files that are named and cannot be
    /// read, or are of another kind.
    pub fn open(input: &Path, options: &Options) -> Result<Self> {
        let is_folder = input.is_dir();
        let folder = if is_folder { input } else { input.parent().unwrap_or(Path::new("")) };
        let dataset = match Dataset::open_manifest(folder) {
            Ok(dataset) => Some(dataset),
            Err(error) if is_folder => return Err(error),
            Err(_) => None,
        };
        let bundle = match (&options.bundle, &dataset) {
            (Some(path), _) => path.clone(),
            (None, Some(dataset)) if is_folder => default_bundle(dataset),
            _ => input.to_owned(),
        };
        let (or, of) = match (is_folder, &options.bundle) {
            (true, None) => ("", folder.display().to_string()),
            (false, None) => ("a dataset's folder, or ", "<dataset>".to_owned()),
            (_, Some(_)) => ("", "<dataset>".to_owned()),
        };
        expect_file(&bundle, &format!("{or}a bundle, a .ndgi file, as `compress {of}` writes it"))?;
        let opened = Bundle::open(&bundle).map_err(of_bundle)?;
        // The page itself verifies no checksums.
        opened.verify().map_err(of_bundle)?;
        let needs_words = opened.index.iter().any(|entry| entry.shadows.length > 0);
        let header = opened.header;
        let other = dataset.as_ref().and_then(|dataset| difference(&header, &dataset.config));
        let how = match (is_folder, &options.scene) {
            (true, _) => Some(format!("`compress {}` makes one of this dataset", folder.display())),
            (false, None) => {
                Some("for a bundle of another dataset, name its geometry with --scene".to_owned())
            }
            (false, Some(_)) => None,
        };
        if let Some((what, how)) = other.as_ref().zip(how) {
            return Err(Error::invalid(bundle.display(), format!("{what}; {how}")));
        }
        let dataset = dataset.filter(|_| other.is_none());
        let scene = scene_of(options, dataset.as_ref(), folder)?;
        let (mut placed, mut doubts) = (Vec::new(), Vec::new());
        if let Some(path) = &scene {
            placed = glb::pages(path)?;
        }
        if let Some(path) = &options.scene {
            doubts = doubts_of(path, &header, &placed);
        }
        let cameras = dataset.iter().flat_map(|dataset| Camera::of_manifest(&dataset.config)).collect();
        let (reference, omitted) = match other {
            Some(_) if !options.no_reference => {
                (None, Some("the dataset in the bundle's folder is of another scene".to_owned()))
            }
            _ => reference_of(dataset, &header, options.no_reference),
        };
        let scene_name = header.scene.clone();
        Ok(Source { bundle, scene, scene_name, cameras, omitted, doubts, header, reference, needs_words })
    }

    /// The bundle's file name.
    pub fn title(&self) -> String {
        self.bundle.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Where the page is written by default: the bundle's name with `.view.html`.
    pub fn page_path(&self) -> PathBuf {
        self.bundle.with_extension("view.html")
    }

    /// Number of frames of the reference, 0 where there is none.
    pub fn frames(&self) -> usize {
        self.reference.as_ref().map_or(0, |dataset| dataset.config.frames.len())
    }

    /// The hour of a frame of the reference.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn hour(&self, frame: usize) -> f64 {
        self.reference.as_ref().expect("a frame of a reference").config.frames[frame].hour
    }

    /// The frames that fit in a number of bytes, ascending: those nearest to the wanted hours come first.
    pub(super) fn sets_within(&self, bytes: u64) -> Vec<usize> {
        let each =
            self.header.pages.iter().map(|page| 4 * page.width as u64 * page.height as u64).sum::<u64>();
        let count = (bytes / each.max(1)).min(self.frames() as u64) as usize;
        let mut frames: Vec<usize> = Vec::new();
        for wanted in WANTED {
            let away = |frame: &usize| hours_apart(self.hour(*frame), wanted);
            let left = (0..self.frames()).filter(|frame| !frames.contains(frame));
            frames.extend(left.min_by(|a, b| away(a).total_cmp(&away(b))).filter(|_| frames.len() < count));
        }
        frames.sort_unstable();
        frames
    }

    /// The names of all data, with the references of these frames.
    pub(super) fn names(&self, frames: &[usize]) -> Vec<String> {
        let mut names = vec!["bundle".to_owned()];
        names.extend(self.scene.is_some().then(|| "scene".to_owned()));
        names.extend(self.needs_words.then(|| "words".to_owned()));
        for page in 0..self.header.pages.len() {
            names.extend((!frames.is_empty()).then(|| format!("mask-{page}")));
            names.extend(frames.iter().map(|frame| format!("reference-{frame}-{page}")));
        }
        names
    }

    /// The file that stands behind a name, if one does.
    pub(super) fn file(&self, name: &str) -> Option<&Path> {
        match name {
            "bundle" => Some(&self.bundle),
            "scene" => self.scene.as_deref(),
            _ => None,
        }
    }

    /// The number of bytes behind a name.
    pub(super) fn len(&self, name: &str) -> Result<u64> {
        if let Some(path) = self.file(name) {
            return fs::metadata(path).map(|data| data.len()).map_err(Error::io(path));
        }
        let texels =
            |page: usize| self.header.pages[page].width as u64 * self.header.pages[page].height as u64;
        Ok(match self.parse(name) {
            Some(Data::Words) => Shadows::codebook().len() as u64,
            Some(Data::Mask(page)) => texels(page).div_ceil(8),
            Some(Data::Reference(_, page)) => 4 + 4 * texels(page),
            None => 0,
        })
    }

    /// The bytes behind a name.
    ///
    /// # Errors
    /// No such name; what cannot be read.
    pub fn read(&self, name: &str) -> Result<Vec<u8>> {
        if let Some(path) = self.file(name) {
            return fs::read(path).map_err(Error::io(path));
        }
        match (self.parse(name), &self.reference) {
            (Some(Data::Words), _) => Ok(Shadows::codebook().to_vec()),
            (Some(Data::Mask(page)), Some(dataset)) => Ok(bits(&dataset.mask(page)?.valid)),
            (Some(Data::Reference(frame, page)), Some(dataset)) => {
                Ok(packed(&dataset.map(frame, page)?.texels))
            }
            _ => Err(Error::invalid(name, "no such data")),
        }
    }

    fn parse(&self, name: &str) -> Option<Data> {
        let pages = self.header.pages.len();
        let mut parts = name.split('-');
        let kind = parts.next()?;
        let numbers: Vec<usize> = parts.map(|part| part.parse().ok()).collect::<Option<_>>()?;
        match (kind, &numbers[..]) {
            ("words", []) => Some(Data::Words),
            ("mask", &[page]) if page < pages => Some(Data::Mask(page)),
            ("reference", &[frame, page]) if frame < self.frames() && page < pages => {
                Some(Data::Reference(frame, page))
            }
            _ => None,
        }
    }
}

enum Data {
    Words,
    Mask(usize),
    Reference(usize, usize),
}

fn scene_of(options: &Options, dataset: Option<&Dataset>, folder: &Path) -> Result<Option<PathBuf>> {
    if let Some(path) = &options.scene {
        expect_file(path, "the scene's geometry, a GLB file (--scene)")?;
        return Ok(Some(path.clone()));
    }
    let of_dataset = dataset.and_then(|dataset| Some((dataset, dataset.config.geometry.as_ref()?)));
    match of_dataset.filter(|(dataset, file)| dataset.path(file).is_file()) {
        Some((dataset, file)) => dataset.verified(file).map(Some),
        None => Ok(Some(folder.join("scene.glb")).filter(|path| path.is_file())),
    }
}

/// What tells that a bundle is not of a dataset: its scene, or the sizes of its pages.
fn difference(header: &Header, config: &Config) -> Option<String> {
    let (found, expected) = (&header.scene, &config.scene);
    if found != expected {
        return Some(format!("is a bundle of scene {found:?}; expected one of {expected:?}"));
    }
    let found = sizes(header.pages.iter().map(|page| [page.width, page.height]));
    let expected = sizes(config.pages.iter().map(|page| [page.width, page.height]));
    (found != expected)
        .then(|| format!("has pages of {found} texels; expected those of the dataset, {expected}"))
}

/// Why geometry that was named may be that of another scene. `placed`: the pages on which it has meshes.
fn doubts_of(path: &Path, header: &Header, placed: &[u64]) -> Vec<String> {
    let mut doubts = Vec::new();
    let mut doubt = |what: String| doubts.push(format!("--scene {}: {what}", path.display()));
    let folder = path.parent().unwrap_or(Path::new(""));
    let dataset = Dataset::open_manifest(folder).ok();
    if let Some(what) = dataset.and_then(|dataset| difference(header, &dataset.config)) {
        doubt(format!("it belongs to a dataset that the bundle was not made from: the bundle {what}"));
    }
    let pages = header.pages.len() as u64;
    match placed.iter().max() {
        None => doubt("no mesh has a chart placement on a page (extras lightmapPage)".to_owned()),
        Some(&page) if page >= pages => {
            doubt(format!("it has meshes on page {page}, but the bundle has {pages}, numbered from 0"));
        }
        Some(_) => {}
    }
    doubts
}

/// The dataset as a reference, or why it cannot be one.
fn reference_of(
    dataset: Option<Dataset>,
    header: &Header,
    is_unwanted: bool,
) -> (Option<Dataset>, Option<String>) {
    let Some(dataset) = dataset.filter(|_| !is_unwanted) else { return (None, None) };
    if light_of(header) != Some(dataset.config.digest_of_light()) {
        return (
            None,
            Some("the bundle was compressed from a different bake; run `compress` again".to_owned()),
        );
    }
    (Some(dataset), None)
}

/// Eight flags a byte, the first the lowest.
fn bits(flags: &[bool]) -> Vec<u8> {
    flags
        .chunks(8)
        .map(|eight| (0..).zip(eight).map(|(bit, flag)| u8::from(*flag) << bit).sum::<u8>())
        .collect()
}

/// Light as RGB9E5, behind the power of two that it is multiplied with. That brings the brightest channel to
/// 2¹⁴ … 2¹⁵, because below 2⁻¹⁶ the format loses digits.
fn packed(texels: &[[f32; 3]]) -> Vec<u8> {
    let top = texels.iter().flatten().fold(0.0, |top: f32, light| top.max(*light));
    let exponent = (top.to_bits() >> 23) as i32 - 127;
    let scale = if top > 0.0 { 2f32.powi((14 - exponent).min(126)) } else { 1.0 };
    let texels = texels.iter().flat_map(|light| rgb9e5(*light, scale).to_le_bytes());
    scale.to_le_bytes().into_iter().chain(texels).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_are_as_precise_by_night_as_by_day() {
        let number = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().unwrap());
        // Noon, a moonless night, and the ends of single precision.
        for top in [120.0, 5e-7, 1e-36, f32::MAX] {
            let fall = |i: i32| top * 2f32.powi(-i) * 0.999;
            let texels: Vec<[f32; 3]> = (0..20).map(|i| [fall(i), fall(i + 2), fall(i + 7)]).collect();
            let bytes = packed(&texels);
            let scale = f64::from(f32::from_bits(number(&bytes[..4])));
            for (light, packed) in texels.iter().zip(bytes[4..].chunks(4).map(number)) {
                let step = f64::from((packed >> 27) as i32 - 15 - 9).exp2() / scale;
                for (shift, e) in [0, 9, 18].into_iter().zip(light) {
                    let off = f64::from(packed >> shift & 511) * step - f64::from(*e);
                    assert!(off.abs() <= f64::from(light[0]) / 512.0, "{top}: {light:?} {off}");
                }
            }
        }
        assert_eq!(packed(&[[0.0; 3]]), [0, 0, 128, 63, 0, 0, 0, 0]);
    }

    #[test]
    fn flags_are_packed_lowest_first() {
        assert_eq!(bits(&[true, false, true, false, false, false, false, true, true]), [0b1000_0101, 1]);
    }
}
