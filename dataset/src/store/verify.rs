//! Verifies every byte: `dataset check`.

use super::{Dataset, check};
use crate::format::{Curve, FileRef};
use crate::image::{self, Mask};
use crate::observe::count;
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};

pub(crate) mod geometry;
mod sums;

pub(crate) use sums::about_equal;

/// Rows that are held in memory at once.
pub(super) const ROWS: usize = 256;
/// Longest time, in hours, between a switch and the frame that shows a side of it.
const SWITCH_REACH: f64 = 0.1;

/// What [`Dataset::verify`] found.
#[derive(Debug, Default)]
pub struct Verification {
    /// Everything that is invalid of the format, in the manifest's order.
    pub faults: Vec<Error>,
    /// Findings that are valid but cost quality.
    pub warnings: Vec<String>,
    /// Valid texels of each page that are black in every frame: no fault in itself (no light may reach them),
    /// but many of them speak of texels inside geometry. `None` if a lightmap could not be read.
    pub dead_texels: Vec<Option<usize>>,
}

/// An image file on one of its pages.
struct Use<'a> {
    file: &'a FileRef,
    page: usize,
    /// Whether it is a lightmap there, or a layer.
    is_map: bool,
}

impl Dataset {
    /// Number of times that [`Dataset::verify`] calls `step`.
    pub fn verify_steps(&self) -> usize {
        let sums = if self.config.layers.is_empty() { 0 } else { self.maps().count() };
        self.distinct_files().len() + self.images().len() + sums
    }

    /// Checks what [`Dataset::open`] does not: every checksum, every mask, the noise file, the geometry, the
    /// curves of layers, the sun's path and visibility, that images are finite and not negative, that frames
    /// show the light groups as the schedules have them, and where layers are stored that each lightmap is
    /// (sun + sky) + local: bit for bit, about so in imported datasets.
    pub fn verify(&self, step: impl Fn() + Sync) -> Verification {
        let (faults, broken) = self.verify_files(&step);
        let mut broken: BTreeSet<String> = broken;
        let mut warnings = self.unseen_switches();
        warnings.extend(self.leftovers());
        let mut found = Verification { faults, warnings, dead_texels: Vec::new() };
        found.faults.extend(self.wrong_states());

        // Content, of files that are what the manifest says; the others are reported already.
        if let Some(noise) = &self.config.noise
            && !broken.contains(&noise.path)
        {
            found.faults.extend(self.noise().err());
        }
        if let Some(file) = &self.config.geometry
            && !broken.contains(&file.path)
        {
            let path = self.path(file);
            match super::read(&path) {
                Ok(bytes) => found.faults.extend(geometry::faults(&path, &bytes, &self.config)),
                Err(fault) => found.faults.push(fault),
            }
        }
        let curves = self.config.layers.iter().filter_map(|layer| layer.curve.as_ref());
        let curves: BTreeSet<&str> =
            curves.map(|file| &*file.path).filter(|path| !broken.contains(*path)).collect();
        found.faults.extend(curves.iter().filter_map(|path| Curve::read(&self.root.join(path)).err()));
        found.faults.extend(self.verify_sunlight(|file| broken.contains(&file.path)));
        let images = self.images();
        for page in 0..self.config.pages.len() {
            let mask = match self.mask(page) {
                Ok(mask) => Some(mask),
                Err(fault) => {
                    if !broken.contains(&self.config.pages[page].mask.path) {
                        found.faults.push(fault);
                    }
                    None
                }
            };
            // One bit per texel, whatever the number of frames.
            let lit = mask.as_ref().map(|mask| Bits::new(mask.valid.len()));
            let uses: Vec<&Use> = images.iter().filter(|used| used.page == page).collect();
            let seen = uses.par_iter().map(|used| {
                let readable = !broken.contains(&used.file.path);
                let result = if readable { self.verify_texels(used, lit.as_ref()) } else { Ok(()) };
                step();
                (readable && result.is_ok(), result.err())
            });
            let seen: Vec<(bool, Option<Error>)> = seen.collect();
            let mut all_read = true;
            for (used, (whole, fault)) in uses.iter().zip(seen) {
                all_read &= whole || !used.is_map;
                if !whole {
                    broken.insert(used.file.path.clone());
                }
                found.faults.extend(fault);
            }
            let read = mask.as_ref().zip(lit).filter(|_| all_read);
            let dead = |(mask, lit): (&Mask, Bits)| {
                (0..mask.valid.len()).filter(|&i| mask.valid[i] && !lit.get(i)).count()
            };
            found.dead_texels.push(read.map(dead));
            found.faults.extend(self.verify_sums(page, mask.as_ref(), &broken, &step));
        }
        found
    }

    /// Checks length and checksum of all files, each once; gives the faults, and the paths of the files that
    /// have any. Calls `step` for each file.
    pub fn verify_files(&self, step: impl Fn() + Sync) -> (Vec<Error>, BTreeSet<String>) {
        let distinct = self.distinct_files();
        let checked = distinct.par_iter().map(|file| {
            // A path that leads elsewhere is the manifest's fault and reported when that is read.
            let result = if check::is_inside(file) { self.verified(file).map(drop) } else { Ok(()) };
            step();
            result
        });
        let checked: Vec<Result<()>> = checked.collect();
        let broken = distinct.iter().zip(&checked).filter(|(_, result)| result.is_err());
        let broken = broken.map(|(file, _)| file.path.clone()).collect();
        (checked.into_iter().filter_map(Result::err).collect(), broken)
    }

    /// Checks the texels of an image, and marks those that a lightmap lights. The error names the first that
    /// is wrong and how many there are.
    fn verify_texels(&self, used: &Use, lit: Option<&Bits>) -> Result<()> {
        let page = &self.config.pages[used.page];
        let (width, height) = (page.width as usize, page.height as usize);
        let path = self.path(used.file);
        let size = image::read_exr_size(&path)?;
        check::size(&path, size, page)?;
        let mut wrong: Option<(Error, usize)> = None;
        for y0 in (0..height).step_by(ROWS) {
            crate::host::signals::stop_if_interrupted()?;
            let texels = image::read_exr_rows(&path, y0, (y0 + ROWS).min(height))?;
            let first = super::refuse_light(&path, width, y0, &texels).err();
            let number = texels.iter().filter(|texel| texel.iter().any(|&v| super::is_bad(v))).count();
            if let Some((_, all)) = &mut wrong {
                *all += number;
            } else {
                wrong = first.map(|error| (error, number));
            }
            if let Some(lit) = lit.filter(|_| used.is_map) {
                let not_black = texels.iter().enumerate().filter(|(_, texel)| **texel != [0.0; 3]);
                not_black.for_each(|(i, _)| lit.set(y0 * width + i));
            }
        }
        wrong.map_or(Ok(()), |(error, number)| Err(and_others(error, number - 1)))
    }

    /// Frames that show a group on while its schedule has it off, or the other way round.
    fn wrong_states(&self) -> Vec<Error> {
        let manifest = self.root.join(super::MANIFEST);
        let mut faults = Vec::new();
        for (index, frame) in self.config.frames.iter().enumerate() {
            for (group, &on) in self.config.groups.iter().zip(&frame.groups_on) {
                if group.is_on(frame.hour).is_some_and(|expected| expected != on) {
                    let (name, hour) = (&group.name, frame.hour);
                    let what = format!(
                        "frame {index}, hour {hour}: groups_on is {on} for {name:?}; its schedule says {}",
                        !on
                    );
                    faults.push(Error::invalid(manifest.display(), what));
                }
            }
        }
        faults
    }

    /// Files that killed writers left in the dataset's folder, or that running writers are about to replace.
    fn leftovers(&self) -> Vec<String> {
        let mut left = Vec::new();
        for folder in [self.root.clone(), self.root.join(super::DATA)] {
            // (A folder that cannot be listed is reported when its files are opened.)
            for path in crate::host::files::temporaries(&folder).unwrap_or_default() {
                left.push(format!(
                    "{}: a temporary file; if no process is writing here, a killed process left it and it can be removed",
                    path.display()
                ));
            }
        }
        if self.root.join(super::WORK).is_dir() {
            let path = self.root.join(super::WORK);
            left.push(format!("{}: {}, or the folder can be removed", path.display(), super::UNFINISHED));
        }
        left
    }

    /// Switches between the first and the last frame of which a side is shown by no frame close to it.
    fn unseen_switches(&self) -> Vec<String> {
        let frames = &self.config.frames;
        let mut unseen = Vec::new();
        for (g, group) in self.config.groups.iter().enumerate() {
            let shown = |at: f64, on: bool| {
                // At the very instant lamps are off.
                frames.iter().any(|s| (s.hour - at).abs() < SWITCH_REACH + 1e-6 && s.groups_on[g] == on)
            };
            let mut ends: Vec<f64> = group.on.iter().flatten().copied().collect();
            ends.sort_by(f64::total_cmp);
            ends.dedup();
            for at in ends {
                let [before, after] = [-1e-3, 1e-3].map(|d| group.is_on((at + d).rem_euclid(24.0)));
                if before == after || !(frames[0].hour < at && at < frames[frames.len() - 1].hour) {
                    continue;
                }
                for on in [before, after].into_iter().flatten().filter(|&on| !shown(at, on)) {
                    let (name, state) = (&group.name, if on { "on" } else { "off" });
                    unseen.push(format!(
                        "group {name:?} switches at {at} h, but no frame within {SWITCH_REACH} h has it {state}, so light \
                         near the switch is taken from a frame farther away"
                    ));
                }
            }
        }
        unseen
    }

    /// The maps of all frames, each with its page.
    fn maps(&self) -> impl Iterator<Item = (usize, &FileRef)> {
        self.config.frames.iter().flat_map(|frame| frame.maps.iter().enumerate())
    }

    /// The lightmaps and layers, each once per page.
    fn images(&self) -> Vec<Use<'_>> {
        let rows = self.config.layers.iter().flat_map(|layer| &layer.files);
        let layers = rows.flat_map(|row| row.iter().enumerate());
        let layers =
            layers.filter_map(|(page, file)| Some(Use { file: file.as_ref()?, page, is_map: false }));
        let maps = self.maps().map(|(page, file)| Use { file, page, is_map: true });
        let mut place: BTreeMap<(&str, usize), usize> = BTreeMap::new();
        let mut images: Vec<Use> = Vec::new();
        for used in layers.chain(maps) {
            let at = *place.entry((&used.file.path, used.page)).or_insert(images.len());
            match images.get_mut(at) {
                Some(known) => known.is_map |= used.is_map,
                None => images.push(used),
            }
        }
        images
    }

    /// The files the manifest names, each once, in its order.
    fn distinct_files(&self) -> Vec<&FileRef> {
        let mut order = Vec::new();
        let mut seen: BTreeMap<&str, Vec<&FileRef>> = BTreeMap::new();
        for file in check::references(&self.config) {
            let same_path = seen.entry(&file.path).or_default();
            // Entries that state different content for one path are checked separately.
            if !same_path.contains(&file) {
                same_path.push(file);
                order.push(file);
            }
        }
        order
    }
}

/// An error that names the first of several.
fn and_others(error: Error, others: usize) -> Error {
    match (error, others) {
        (Error::Invalid { place, what }, 1..) => {
            Error::invalid(place, format!("{what} ({} more like it)", count(others, "texel")))
        }
        (error, _) => error,
    }
}

/// A bit per texel, set from any thread.
struct Bits(Vec<AtomicU64>);

impl Bits {
    fn new(texels: usize) -> Self {
        Bits((0..texels.div_ceil(64)).map(|_| AtomicU64::new(0)).collect())
    }

    fn set(&self, i: usize) {
        self.0[i / 64].fetch_or(1 << (i % 64), Ordering::Relaxed);
    }

    fn get(&self, i: usize) -> bool {
        self.0[i / 64].load(Ordering::Relaxed) >> (i % 64) & 1 == 1
    }
}
