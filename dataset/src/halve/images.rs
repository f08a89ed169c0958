//! Lightmaps and layers of a page, band by band, each distinct image once.

use super::half::Half;
use crate::format::{Config, FileRef};
use crate::host::signals::stop_if_interrupted;
use crate::image::write_exr;
use crate::observe::Meter;
use crate::store::{Dataset, Staged, Writer, refuse_light, stem_of};
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Bytes of light of full resolution that are held in memory at once for an image, about.
const BAND_BYTES: usize = 4 << 20;

/// A page at work.
pub(super) struct Job<'a> {
    pub dataset: &'a Dataset,
    pub page: usize,
    pub half: &'a Half,
    pub progress: &'a dyn Meter,
}

/// Whether frames are the sums of halved layers. Those of an imported dataset are so only about, and are
/// halved themselves.
fn are_sums(config: &Config) -> bool {
    !config.layers.is_empty() && config.source.is_none()
}

/// The images of a page that are halved themselves, in the manifest's order, each once.
fn sources(config: &Config, page: usize) -> Vec<&FileRef> {
    let rows = config.layers.iter().flat_map(|layer| &layer.files);
    let layers = rows.filter_map(move |row| row[page].as_ref());
    let maps = config.frames.iter().filter(|_| !are_sums(config)).map(move |frame| &frame.maps[page]);
    let mut seen = BTreeMap::new();
    layers.chain(maps).filter(|file| seen.insert(&file.path, ()).is_none()).collect()
}

/// The number of images that [`write`] writes of a page, at most.
pub(super) fn count(config: &Config, page: usize) -> u64 {
    let sums = if are_sums(config) { config.frames.len() } else { 0 };
    (sources(config, page).len() + sums) as u64
}

/// Writes all images of a page, and names them in `config`, whose page has its size already. `root`: the
/// folder of `writer`.
pub(super) fn write(job: &Job, writer: &mut Writer, root: &Path, config: &mut Config) -> Result<()> {
    let page = job.page;
    let sources = sources(&job.dataset.config, page);
    let staged: Vec<Result<Staged>> = sources.par_iter().map(|file| job.halved(writer, file)).collect();
    let mut halves: BTreeMap<&str, FileRef> = BTreeMap::new();
    for (file, staged) in sources.iter().zip(staged) {
        halves.insert(&file.path, writer.adopt(staged?, stem_of(&file.path), "exr")?);
    }
    for row in config.layers.iter_mut().flat_map(|layer| &mut layer.files) {
        if let Some(file) = &mut row[page] {
            *file = halves[&*file.path].clone();
        }
    }
    if !are_sums(config) {
        config.frames.iter_mut().for_each(|frame| frame.maps[page] = halves[&*frame.maps[page].path].clone());
        return Ok(());
    }

    // Frames with the same layers are one image.
    let halved = Dataset::of(root, config.clone());
    let mut first: BTreeMap<Vec<Vec<&str>>, usize> = BTreeMap::new();
    let mut distinct = Vec::new();
    let of_frame: Vec<usize> = (0..config.frames.len())
        .map(|frame| {
            *first.entry(halved.summands(frame, page)).or_insert_with(|| {
                distinct.push(frame);
                distinct.len() - 1
            })
        })
        .collect();
    let staged: Vec<Result<Staged>> =
        distinct.par_iter().map(|&frame| job.sum(writer, &halved, frame)).collect();
    let mut sums = Vec::new();
    for (&frame, staged) in distinct.iter().zip(staged) {
        let stem = stem_of(&job.dataset.config.frames[frame].maps[page].path);
        sums.push(writer.adopt(staged?, stem, "exr")?);
    }
    for (frame, sum) in config.frames.iter_mut().zip(of_frame) {
        frame.maps[page] = sums[sum].clone();
    }
    Ok(())
}

impl Job<'_> {
    /// The half of an image, its texels and its checksum checked.
    fn halved(&self, writer: &Writer, file: &FileRef) -> Result<Staged> {
        let width = self.half.source.width;
        self.image(writer, |y0, y1| {
            let (from, to) = (2 * y0, (2 * y1).min(self.half.source.height));
            let texels = self.dataset.image_rows(file, self.page, from, to)?;
            let texel = |(x, y): (usize, usize)| texels[(y - from) * width + x];
            let places = (y0..y1).flat_map(|y| (0..self.half.width).map(move |x| (x, y)));
            Ok(places.map(|(x, y)| self.half.counted(x, y).mean(texel)).collect())
        })
    }

    /// The sum of the halved layers of a frame.
    fn sum(&self, writer: &Writer, halved: &Dataset, frame: usize) -> Result<Staged> {
        let place = self.dataset.path(&self.dataset.config.frames[frame].maps[self.page]);
        self.image(writer, |y0, y1| {
            let texels = halved.shares_of(frame, self.page).sum_rows(halved, self.page, y0, y1)?;
            refuse_light(&place, self.half.width, y0, &texels).map_err(|error| match error {
                Error::Invalid { place, what } => {
                    Error::invalid(place, format!("{what} (the sum of its halved layers)"))
                }
                other => other,
            })?;
            Ok(texels)
        })
    }

    /// An image of the half, whose rows `y0 .. y1` are what `rows(y0, y1)` gives.
    fn image(&self, writer: &Writer, rows: impl Fn(usize, usize) -> Result<Vec<[f32; 3]>>) -> Result<Staged> {
        let Half { width, height, .. } = *self.half;
        // Two rows of full resolution for each, in whole blocks of compressed files.
        let band =
            (BAND_BYTES / (2 * size_of::<[f32; 3]>() * self.half.source.width)).next_multiple_of(16).max(16);
        let mut texels = Vec::new();
        writer.stage(|path, out| {
            write_exr(path, out, (width, height), |y, row| {
                if y.is_multiple_of(band) {
                    stop_if_interrupted()?;
                    let end = (y + band).min(height);
                    texels = rows(y, end)?;
                    self.progress.advance((end - y) as u64);
                }
                row.copy_from_slice(&texels[y % band * width..][..width]);
                Ok(())
            })
        })
    }
}
