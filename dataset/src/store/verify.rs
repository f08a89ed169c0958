//! A look at every byte: what `dataset check` does.

use super::{Dataset, check};
use crate::config::Map;
use crate::image::Mask;
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Rows that are held in memory at once.
const ROWS: usize = 256;

/// What [`Dataset::verify`] found.
#[derive(Debug, Default)]
pub struct Verification {
    /// Everything that breaks a rule of the format, in the manifest's order.
    pub faults: Vec<Error>,
    /// Valid texels of each page that are black in every set: no fault in itself (no light may reach them), but many
    /// of them speak of texels inside geometry. `None` where a lightmap could not be read.
    pub dead_texels: Vec<Option<usize>>,
}

impl Dataset {
    /// Number of times that [`Dataset::verify`] calls `step`.
    pub fn verify_steps(&self) -> usize {
        self.distinct_files().len() + self.config.sets.len() * self.config.pages.len()
    }

    /// Checks what [`Dataset::open`] does not: every checksum, every mask, the noise file, that lightmaps are finite and
    /// not negative, and where layers are kept that each is (sun + sky) + local bit for bit.
    pub fn verify(&self, step: impl Fn() + Sync) -> Verification {
        let mut found = Verification::default();

        // Lengths and checksums of all files, each once.
        let distinct = self.distinct_files();
        let checksums = distinct.par_iter().map(|file| {
            let result = self.check_content(file);
            step();
            result
        });
        let checksums: Vec<Result<()>> = checksums.collect();
        let mut broken: Vec<&str> = Vec::new();
        for (file, result) in distinct.iter().zip(checksums) {
            if let Err(fault) = result {
                broken.push(&file.path);
                found.faults.push(fault);
            }
        }

        // Content, of files that are what the manifest says; the others are reported already.
        if let Some(noise) = &self.config.noise
            && !broken.contains(&&*noise.path)
        {
            found.faults.extend(self.noise().err());
        }
        for page in 0..self.config.pages.len() {
            let mask = match self.mask(page) {
                Ok(mask) => Some(mask),
                Err(fault) => {
                    if !broken.contains(&&*self.config.pages[page].mask.path) {
                        found.faults.push(fault);
                    }
                    None
                }
            };
            let sets = (0..self.config.sets.len()).into_par_iter().map(|set| {
                let map = &self.config.sets[set].maps[page];
                let readable = !self.files_of(set, page, map).iter().any(|path| broken.contains(path));
                let result = if readable { self.verify_map(set, page).map(Some) } else { Ok(None) };
                step();
                result
            });
            let lit: Vec<Result<Option<Vec<bool>>>> = sets.collect();
            found.dead_texels.push(dead_texels(mask.as_ref(), lit, &mut found.faults));
        }
        found
    }

    /// Paths of the files that the map of a set on a page is made of.
    fn files_of<'a>(&'a self, set: usize, page: usize, map: &'a Map) -> Vec<&'a str> {
        let on = &self.config.sets[set].groups_on;
        let groups = self.config.groups.iter().zip(on).filter(|(_, on)| **on);
        let layers = groups.filter_map(|(group, _)| group.layers.get(page));
        std::iter::once(&map.file)
            .chain(&map.sun)
            .chain(&map.sky)
            .chain(layers)
            .map(|file| &*file.path)
            .collect()
    }

    /// Checks one map, row block by row block; returns which texels are not black.
    fn verify_map(&self, set: usize, page: usize) -> Result<Vec<bool>> {
        let map = &self.config.sets[set].maps[page];
        let (width, height) =
            (self.config.pages[page].width as usize, self.config.pages[page].height as usize);
        let layered = check::layers_kept(&self.config);
        let mut lit = Vec::with_capacity(width * height);
        for y0 in (0..height).step_by(ROWS) {
            crate::console::stop_if_interrupted()?;
            let y1 = (y0 + ROWS).min(height);
            let texels = self.image_rows(&map.file, page, y0, y1)?;
            if layered {
                // (sun + sky) + local; an absent layer is black.
                let layer = |file| self.image_rows(file, page, y0, y1);
                let black = || vec![[0.0f32; 3]; texels.len()];
                let mut sum = map.sun.as_ref().map_or_else(|| Ok(black()), layer)?;
                add(&mut sum, &map.sky.as_ref().map_or_else(|| Ok(black()), layer)?);
                let mut local = black();
                for (group, on) in self.config.groups.iter().zip(&self.config.sets[set].groups_on) {
                    if *on {
                        add(&mut local, &layer(&group.layers[page])?);
                    }
                }
                add(&mut sum, &local);
                let same = |a: &[f32; 3], b: &[f32; 3]| a.map(f32::to_bits) == b.map(f32::to_bits);
                if let Some(index) = texels.iter().zip(&sum).position(|(texel, sum)| !same(texel, sum)) {
                    let place = self.path(&map.file);
                    let place =
                        format!("{}, texel ({}, {})", place.display(), index % width, y0 + index / width);
                    let what = format!("{:?}; its layers sum to {:?}", texels[index], sum[index]);
                    return Err(Error::invalid(place, what));
                }
            }
            lit.extend(texels.iter().map(|texel| *texel != [0.0; 3]));
        }
        Ok(lit)
    }

    /// The files the manifest names, each once, in its order.
    fn distinct_files(&self) -> Vec<&crate::config::FileRef> {
        let mut order = Vec::new();
        let mut seen: BTreeMap<&str, Vec<&crate::config::FileRef>> = BTreeMap::new();
        for file in check::references(&self.config) {
            let same_path = seen.entry(&file.path).or_default();
            // Entries that state different content for one path are looked at each.
            if !same_path.contains(&file) {
                same_path.push(file);
                order.push(file);
            }
        }
        order
    }
}

fn add(sum: &mut [[f32; 3]], addend: &[[f32; 3]]) {
    for (sum, addend) in sum.iter_mut().zip(addend) {
        *sum = std::array::from_fn(|channel| sum[channel] + addend[channel]);
    }
}

/// Valid texels that no set lights; faults of the sets go to `faults`.
fn dead_texels(
    mask: Option<&Mask>,
    lit: Vec<Result<Option<Vec<bool>>>>,
    faults: &mut Vec<Error>,
) -> Option<usize> {
    let mut dead = mask.map(|mask| mask.valid.clone());
    for set in lit {
        match set {
            Ok(Some(lit)) => {
                if let Some(dead) = &mut dead {
                    dead.iter_mut().zip(lit).for_each(|(dead, lit)| *dead &= !lit);
                }
            }
            Ok(None) => dead = None,
            Err(fault) => {
                dead = None;
                faults.push(fault);
            }
        }
    }
    dead.map(|dead| dead.iter().filter(|&&dead| dead).count())
}
