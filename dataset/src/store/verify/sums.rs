//! Each lightmap is the sum of its layers.

use super::{ROWS, and_others};
use crate::format::{FileRef, Light};
use crate::image::{Mask, add};
use crate::store::Dataset;
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// How far a lightmap of an imported dataset may be from the sum of its layers: this share of the sum, as if
/// all had been half floats once …
const IMPORTED_SHARE: f32 = 1.0 / 1024.0;
/// … whose smallest steps these are.
const IMPORTED_STEP: f32 = 1.0 / (1 << 22) as f32;

/// Whether a texel of an imported dataset is the sum of its layers, near enough.
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
        if self.config.layers.is_empty() {
            return Vec::new();
        }
        let frames = (0..self.config.frames.len()).into_par_iter().map(|frame| {
            let map = &self.config.frames[frame].maps[page];
            let shares = self.shares_of(frame, page);
            let mut files = shares.files().chain([map]);
            let readable = !files.any(|file| broken.contains(&file.path));
            let result = if readable { self.verify_sum(page, mask, map, &shares) } else { Ok(()) };
            step();
            result
        });
        let results: Vec<Result<()>> = frames.collect();
        results.into_iter().filter_map(Result::err).collect()
    }

    /// The paths of the files of which the lightmap of a frame on a page is the sum, light by light: where
    /// they are equal, so are the sums.
    pub(crate) fn summands(&self, frame: usize, page: usize) -> Vec<Vec<&str>> {
        let Shares { sun, sky, local } = self.shares_of(frame, page);
        let lights = [sun, sky].into_iter().chain(local);
        lights.map(|files| files.into_iter().map(|file| &*file.path).collect()).collect()
    }

    /// What the lightmap of a frame on a page is to be the sum of.
    pub(crate) fn shares_of(&self, frame: usize, page: usize) -> Shares<'_> {
        let of = |light| self.config.files_of(light, None, frame, page);
        Shares { sun: of(Light::Sun), sky: of(Light::Sky), local: self.config.files_of_local(frame, page) }
    }

    /// Checks one map, row block by row block.
    fn verify_sum(&self, page: usize, mask: Option<&Mask>, map: &FileRef, shares: &Shares) -> Result<()> {
        let [width, height] = self.config.pages[page].size();
        let imported = self.config.source.is_some();
        let mut wrong: Option<(Error, usize)> = None;
        for y0 in (0..height).step_by(ROWS) {
            crate::host::signals::stop_if_interrupted()?;
            let y1 = (y0 + ROWS).min(height);
            let texels = self.image_rows(map, page, y0, y1)?;
            let sum = shares.sum_rows(self, page, y0, y1)?;
            let same = |i: usize| match imported {
                // Dilated texels are ignored; without a readable mask they are unknown.
                true => mask.is_none_or(|m| !m.valid[y0 * width + i]) || about_equal(&texels[i], &sum[i]),
                false => texels[i].map(f32::to_bits) == sum[i].map(f32::to_bits),
            };
            for i in (0..texels.len()).filter(|&i| !same(i)) {
                match &mut wrong {
                    Some((_, others)) => *others += 1,
                    None => {
                        let (path, x, y) = (self.path(map), i % width, y0 + i / width);
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

/// The files of a map's shares; those of one light in the order in which they are summed.
pub(crate) struct Shares<'a> {
    sun: Vec<&'a FileRef>,
    sky: Vec<&'a FileRef>,
    /// Per light, in their order.
    local: Vec<Vec<&'a FileRef>>,
}

impl<'a> Shares<'a> {
    fn files(&self) -> impl Iterator<Item = &'a FileRef> {
        [&self.sun, &self.sky].into_iter().chain(&self.local).flatten().copied()
    }

    /// Rows `y0 .. y1` of the sum: ((sun direct + sun indirect) + sky) + local; an absent share is black.
    pub(crate) fn sum_rows(
        &self,
        dataset: &Dataset,
        page: usize,
        y0: usize,
        y1: usize,
    ) -> Result<Vec<[f32; 3]>> {
        let share = |files: &[&FileRef]| dataset.sum_rows(files, page, y0, y1);
        let mut sum = share(&self.sun)?;
        add(&mut sum, &share(&self.sky)?);
        let mut local = vec![[0.0f32; 3]; sum.len()];
        for files in &self.local {
            add(&mut local, &share(files)?);
        }
        add(&mut sum, &local);
        Ok(sum)
    }
}
