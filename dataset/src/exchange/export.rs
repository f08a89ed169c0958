//! Exports a dataset to a layout.

use super::kept::{kept, lightmaps_of};
use super::raw::{self, light_bytes, mask_bytes};
use crate::format::{FileRef, Layer, Light};
use crate::host::files::{NewFolder, write_atomically};
use crate::image::add;
use crate::layout::{self, Id, Layout, Lightmap, Parts, Planned};
use crate::observe::{Meter, Observer, count};
use crate::store::{Dataset, MANIFEST};
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::Path;

/// Result of an export.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// Hours of the frames that were written.
    pub hours: Vec<f64>,
    /// Parts of the dataset that the layout cannot store, and why.
    pub omitted: Vec<String>,
    /// Files written.
    pub files: usize,
    /// Total bytes.
    pub bytes: u64,
}

/// Writes a dataset in a layout to the new folder `out`, which appears when it is complete. A dataset that
/// was imported from the same layout gets its old names and configuration back.
///
/// # Errors
/// `Unsupported` if the layout cannot store any of the dataset; `Invalid` for an invalid dataset. Then
/// nothing is left behind.
pub fn export(
    dataset: &Dataset,
    layout: &dyn Layout,
    out: &Path,
    console: &dyn Observer,
) -> Result<Exported> {
    dataset.expect_day()?;
    let folder = NewFolder::create(out)?;
    let root = folder.temporary();
    let (hours, mut omitted, (config, planned)) = match kept(dataset, Some(layout))? {
        Some(own) => (dataset.config.frames.iter().map(|frame| frame.hour).collect(), Vec::new(), own),
        None => {
            let (hours, mut omitted) = hours(dataset, layout)?;
            let plan = plan(dataset, layout, &hours)?;
            if !dataset.config.groups.is_empty() {
                omitted.push("names and hours of light groups: the layout cannot store them".to_owned());
            }
            (hours, omitted, plan)
        }
    };
    let layered = !dataset.config.layers.is_empty();
    let shares = layout.shares();
    if !shares.is_empty() && !layered {
        omitted.push(format!("{}: the dataset has no layers", shares.join(", ")));
    }
    if shares.is_empty() && layered {
        omitted.push("layers of sun, sky and light groups: the layout cannot store them".to_owned());
    }
    let manifest = &dataset.config;
    for (what, is_there) in [
        ("geometry", manifest.geometry.is_some()),
        ("chart placements of instances", !manifest.instances.is_empty()),
        ("noise", manifest.noise.is_some()),
        ("the sun's path", manifest.sun_path.is_some()),
        ("the sun's visibility", manifest.visibility.is_some()),
    ] {
        if is_there {
            omitted.push(format!("{what}: the layout cannot store it"));
        }
    }

    let images = planned.iter().flat_map(|p| p.frames.iter().map(|_| u64::from(p.lightmap.height)));
    let kinds = if layered { 1 + shares.len() as u64 } else { 1 };
    let progress = console.progress("exporting", kinds * images.sum::<u64>());
    check_contents(dataset, &hours, layout)?;
    let mut written = Vec::new();
    // A configuration may name one file several times; it has one content.
    let mut named = BTreeSet::new();
    for (page, mut planned) in planned.into_iter().enumerate() {
        planned.masks.retain(|parts| named.insert(parts.clone()));
        planned.frames.retain(|planned_frame| named.insert(planned_frame.whole.clone()));
        written.extend(write_page(dataset, page, &planned, root, layered, &progress)?);
    }
    write_atomically(&root.join(MANIFEST), &config)?;
    written.push(config.len() as u64);
    drop(progress);
    folder.finish()?;
    Ok(Exported { hours, omitted, files: written.len(), bytes: written.iter().sum() })
}

/// The hours that the layout takes, and why not the others.
fn hours(dataset: &Dataset, layout: &dyn Layout) -> Result<(Vec<f64>, Vec<String>)> {
    let all: Vec<f64> = dataset.config.frames.iter().map(|frame| frame.hour).collect();
    let unsupported = |what| Error::unsupported(dataset.root.display(), what);
    if let Some(what) = layout.refuses(&all) {
        return Err(unsupported(what));
    }
    let (taken, others): (Vec<f64>, Vec<f64>) = all.iter().partition(|&&hour| layout.takes(hour));
    if taken.is_empty() {
        return Err(unsupported(format!(
            "no frame at a whole hour; frames at {} h have no time key: bake whole hours",
            layout::list(&others)
        )));
    }
    let reported = (!others.is_empty()).then(|| {
        let (frames, hours) = (count(others.len(), "frame"), layout::list(&others));
        format!("{frames} at {hours} h: the layout stores {}", layout.hours())
    });
    Ok((taken, reported.into_iter().collect()))
}

/// The configuration to write, and the files it speaks of.
fn plan(dataset: &Dataset, layout: &dyn Layout, hours: &[f64]) -> Result<(Vec<u8>, Vec<Planned>)> {
    // Another layout's numbers and levels are kept; else pages are counted.
    let lightmaps = lightmaps_of(dataset)?.unwrap_or_else(|| {
        let pages = dataset.config.pages.iter().zip(0..);
        pages
            .map(|(page, id)| Lightmap {
                id: Id::Number(id),
                level: None,
                width: page.width,
                height: page.height,
            })
            .collect()
    });
    if let Some(what) = layout.confuses(&lightmaps) {
        return Err(Error::unsupported(dataset.root.display(), what));
    }
    let config = layout.compose(&dataset.config.scene, &lightmaps, hours);
    let mut planned = Vec::new();
    layout::plan(layout, Path::new(MANIFEST), &config, |one| {
        planned.push(one);
        Ok(())
    })?;
    Ok((config, planned))
}

/// An error unless all files that are read are what the manifest says.
fn check_contents(dataset: &Dataset, hours: &[f64], layout: &dyn Layout) -> Result<()> {
    let config = &dataset.config;
    let frames = config.frames.iter().filter(|frame| hours.contains(&frame.hour));
    let mut files: Vec<&FileRef> = frames.flat_map(|frame| &frame.maps).collect();
    if !layout.shares().is_empty() {
        files.extend(config.layers.iter().flat_map(Layer::files));
    }
    let mut seen = BTreeSet::new();
    files.retain(|file| seen.insert(&file.path));
    files.par_iter().try_for_each(|file| {
        crate::host::signals::stop_if_interrupted()?;
        dataset.verified(file).map(drop)
    })
}

/// Writes the files of a page; gives their lengths, parts together.
fn write_page(
    dataset: &Dataset,
    page: usize,
    planned: &Planned,
    root: &Path,
    layered: bool,
    progress: &dyn Meter,
) -> Result<Vec<u64>> {
    let size = (planned.lightmap.width as usize, planned.lightmap.height as usize);
    let place = |parts: &Parts| -> Result<Parts> {
        let paths: Parts = parts.iter().map(|part| root.join(part)).collect();
        for folder in paths.iter().filter_map(|path| path.parent()) {
            std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        }
        Ok(paths)
    };
    let mask = dataset.mask(page)?;
    let mut written = Vec::new();
    for parts in &planned.masks {
        let rows = |y0: usize, y1: usize| Ok(mask_bytes(&mask.valid[y0 * size.0..y1 * size.0]));
        written.push(raw::write(&place(parts)?, size, rows)?);
    }
    drop(mask);
    let frames: Vec<Result<Vec<u64>>> = planned
        .frames
        .par_iter()
        .map(|planned_frame| {
            let frame = dataset.config.frames.iter().position(|frame| frame.hour == planned_frame.hour);
            let frame = frame.expect("hours were taken from the frames");
            let mut kinds =
                vec![(&planned_frame.whole, vec![vec![&dataset.config.frames[frame].maps[page]]])];
            if let Some([sun, sky, local]) = planned_frame.shares.as_ref().filter(|_| layered) {
                let of = |light| vec![dataset.config.files_of(light, None, frame, page)];
                let lamps = dataset.config.files_of_local(frame, page);
                kinds.extend([(sun, of(Light::Sun)), (sky, of(Light::Sky)), (local, lamps)]);
            }
            let mut lengths = Vec::with_capacity(kinds.len());
            for (parts, lights) in kinds {
                let rows = |y0: usize, y1: usize| {
                    progress.advance((y1 - y0) as u64);
                    Ok(light_bytes(&sum(dataset, page, &lights, (y0, y1))?))
                };
                lengths.push(raw::write(&place(parts)?, size, rows)?);
            }
            Ok(lengths)
        })
        .collect();
    for lengths in frames {
        written.extend(lengths?);
    }
    Ok(written)
}

/// The sum of lights in their order, from zero on, each the sum of its files; one alone keeps every bit.
fn sum(
    dataset: &Dataset,
    page: usize,
    lights: &[Vec<&FileRef>],
    (y0, y1): (usize, usize),
) -> Result<Vec<[f32; 3]>> {
    let Some((first, others)) = lights.split_first() else {
        return dataset.sum_rows(&[], page, y0, y1);
    };
    let mut sum = dataset.sum_rows(first, page, y0, y1)?;
    for files in others {
        add(&mut sum, &dataset.sum_rows(files, page, y0, y1)?);
    }
    Ok(sum)
}
