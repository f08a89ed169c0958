//! Each lightmap is the sum of its layers.

use super::{ROWS, and_others};
use crate::config::{FileRef, Map};
use crate::image::Mask;
use crate::store::{Dataset, check};
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// How far a lightmap of an imported set may be from the sum of its layers: this share of the sum, as if all had been half
/// floats once …
const IMPORTED_SHARE: f32 = 1.0 / 1024.0;
/// … whose smallest steps these are.
const IMPORTED_STEP: f32 = 1.0 / (1 << 22) as f32;

/// Whether a texel of an imported set is the sum of its layers, near enough.
pub(crate) fn about_equal(texel: &[f32; 3], sum: &[f32; 3]) -> bool {
    (0..3).all(|c| (texel[c] - sum[c]).abs() <= IMPORTED_SHARE * sum[c] + IMPORTED_STEP)
}

impl Dataset {
    /// Checks the maps of a page whose files are not `broken`; calls `step` for each, if there are layers.
    pub(super) fn verify_sums(
        &self,
        page: usize,
        mask: Option<&Mask>,
        broken: &BTreeSet<String>,
        step: impl Fn() + Sync,
    ) -> Vec<Error> {
        if !check::layers_kept(&self.config) {
            return Vec::new();
        }
        let sets = (0..self.config.sets.len()).into_par_iter().map(|set| {
            let map = &self.config.sets[set].maps[page];
            let layers = self.layers_of(set, page, map);
            let files = [Some(&map.file), layers.sun, layers.sky];
            let mut files = files.into_iter().flatten().chain(layers.local.iter().copied());
            let readable = !files.any(|file| broken.contains(&file.path));
            let result = if readable { self.verify_sum(page, mask, map, &layers) } else { Ok(()) };
            step();
            result
        });
        let results: Vec<Result<()>> = sets.collect();
        results.into_iter().filter_map(Result::err).collect()
    }

    /// What a map is to be the sum of.
    fn layers_of<'a>(&'a self, set: usize, page: usize, map: &'a Map) -> Layers<'a> {
        let on = &self.config.sets[set].groups_on;
        let groups = self.config.groups.iter().zip(on).filter(|(_, on)| **on);
        let local = groups.filter_map(|(group, _)| group.layers.get(page)).chain(&map.local).collect();
        Layers { sun: map.sun.as_ref(), sky: map.sky.as_ref(), local }
    }

    /// Checks one map, row block by row block.
    fn verify_sum(&self, page: usize, mask: Option<&Mask>, map: &Map, layers: &Layers) -> Result<()> {
        let (width, height) =
            (self.config.pages[page].width as usize, self.config.pages[page].height as usize);
        let imported = self.config.source.is_some();
        let mut wrong: Option<(Error, usize)> = None;
        for y0 in (0..height).step_by(ROWS) {
            crate::console::stop_if_interrupted()?;
            let y1 = (y0 + ROWS).min(height);
            let texels = self.image_rows(&map.file, page, y0, y1)?;
            // (sun + sky) + local; an absent layer is black.
            let layer = |file| self.image_rows(file, page, y0, y1);
            let black = || vec![[0.0f32; 3]; texels.len()];
            let mut sum = layers.sun.map_or_else(|| Ok(black()), layer)?;
            add(&mut sum, &layers.sky.map_or_else(|| Ok(black()), layer)?);
            let mut local = black();
            for file in &layers.local {
                add(&mut local, &layer(file)?);
            }
            add(&mut sum, &local);
            let same = |i: usize| match imported {
                // Dilated texels are nobody's light; without a mask that can be read, nobody knows which they are.
                true => mask.is_none_or(|m| !m.valid[y0 * width + i]) || about_equal(&texels[i], &sum[i]),
                false => texels[i].map(f32::to_bits) == sum[i].map(f32::to_bits),
            };
            for i in (0..texels.len()).filter(|&i| !same(i)) {
                match &mut wrong {
                    Some((_, others)) => *others += 1,
                    None => {
                        let (path, x, y) = (self.path(&map.file), i % width, y0 + i / width);
                        let place = format!("{}, texel ({x}, {y})", path.display());
                        let what = format!("{:?}; its layers sum to {:?}", texels[i], sum[i]);
                        wrong = Some((Error::invalid(place, what), 0));
                    }
                }
            }
        }
        wrong.map_or(Ok(()), |(error, others)| Err(and_others(error, others)))
    }
}

/// The layers of a map.
struct Layers<'a> {
    sun: Option<&'a FileRef>,
    sky: Option<&'a FileRef>,
    /// Of the groups that are on, in their order.
    local: Vec<&'a FileRef>,
}

fn add(sum: &mut [[f32; 3]], addend: &[[f32; 3]]) {
    for (sum, addend) in sum.iter_mut().zip(addend) {
        *sum = std::array::from_fn(|channel| sum[channel] + addend[channel]);
    }
}
