//! Light at any time of the day, between the frames too.

use super::Dataset;
use crate::format::curve::{Curve, way};
use crate::format::{FileRef, Group, Layer, Light};
use crate::image::{self, Image};
use crate::{Error, Result};

/// The frames before and after an hour, and by what the light of each is multiplied.
struct Mix {
    frames: [usize; 2],
    weights: [[f64; 2]; 3],
}

impl Dataset {
    /// The light of a page at any hour that was baked.
    ///
    /// On the mask the sun's direct light is that of its visibility, where the dataset has it. Each other
    /// layer of sun and sky is interpolated between the frames around the hour, by its curve or linearly.
    /// Light groups are on by their schedules. The lamps of imported datasets, and lightmaps without stored
    /// layers, are interpolated linearly between two frames with the same light groups on; between others
    /// they are those of the frame whose lamps are the hour's, or else of the nearer one.
    ///
    /// At the hours of frames it is [`Dataset::map`], but for what the visibility rounds, and misses with its
    /// few points per texel.
    ///
    /// # Errors
    /// [`Error::Invalid`] of an hour outside of the day, or of the hours of the sun's path. Those of the
    /// files' readers.
    ///
    /// # Panics
    /// If `page` is not below the number of pages.
    pub fn light_at(&self, hour: f64, page: usize) -> Result<Image> {
        self.expect_day()?;
        if !(0.0..=24.0).contains(&hour) {
            let what = format!("hour {hour}; expected 0 to 24");
            return Err(Error::invalid(self.root.display(), what));
        }
        if let Some(path) = self.sun_path()?
            && path.at(hour).is_none()
        {
            return Err(path.outside(self.root.display(), hour));
        }
        if self.config.layers.is_empty() {
            let mix = self.mix_of_groups(hour);
            return self.mixed(|frame| vec![&self.config.frames[frame].maps[page]], page, &mix);
        }
        // ((sun direct + sun indirect) + sky) + local, as in frames.
        let is_apart = self.config.layers.iter().any(Layer::is_direct_sun);
        let sunlight = if is_apart { self.sunlight(page)? } else { None };
        let [width, height] = self.config.pages[page].size();
        let mut total = Image::black(width, height);
        let daylight =
            self.config.layers.iter().filter(|layer| matches!(layer.light, Light::Sun | Light::Sky));
        for layer in daylight {
            let mix = self.mix_of_layer(layer, hour)?;
            let mut share = self.mixed(|frame| layer.file(frame, page).into_iter().collect(), page, &mix)?;
            if let Some(sunlight) = sunlight.as_ref().filter(|_| layer.is_direct_sun()) {
                // Off the mask, where nothing is known of the sun, the layer has what is filled in.
                let valid = self.mask(page)?.valid;
                let found = sunlight.at(hour)?.texels.into_iter().zip(valid);
                for (share, (found, _)) in share.texels.iter_mut().zip(found).filter(|(_, (_, valid))| *valid)
                {
                    *share = found;
                }
            }
            add(&mut total, &share);
        }
        let mut local = Image::black(total.width, total.height);
        for (index, _) in self.groups_on(hour).into_iter().enumerate().filter(|(_, on)| *on) {
            add(&mut local, &self.light(Light::Group, Some(index as u32), 0, page)?);
        }
        if self.config.layers_of(Light::Lamps, None).next().is_some() {
            let mix = self.mix_of_groups(hour);
            add(
                &mut local,
                &self.mixed(|frame| self.config.files_of(Light::Lamps, None, frame, page), page, &mix)?,
            );
        }
        add(&mut total, &local);
        Ok(total)
    }

    /// Which groups are on. At the very instant of a switch they are off.
    fn groups_on(&self, hour: f64) -> Vec<bool> {
        let is_on = |group: &Group| group.is_on(hour).unwrap_or(false);
        self.config.groups.iter().map(is_on).collect()
    }

    /// The frames before and after an hour, on the circle of the day.
    fn frames_around(&self, hour: f64) -> [usize; 2] {
        let frames = &self.config.frames;
        let next = frames.partition_point(|frame| frame.hour <= hour);
        [(next + frames.len() - 1) % frames.len(), next % frames.len()]
    }

    fn mix_of_layer(&self, layer: &Layer, hour: f64) -> Result<Mix> {
        let frames = self.frames_around(hour);
        let hours = frames.map(|frame| self.config.frames[frame].hour);
        let weights = match &layer.curve {
            Some(file) => Curve::read(&self.verified(file)?)?.weights(hours, hour),
            None => linear(way(hours, hour)),
        };
        Ok(Mix { frames, weights })
    }

    fn mix_of_groups(&self, hour: f64) -> Mix {
        let frames = self.frames_around(hour);
        let [before, after] = frames.map(|frame| &self.config.frames[frame]);
        let part = way([before.hour, after.hour], hour);
        let on = self.groups_on(hour);
        let part = match [before.groups_on == on, after.groups_on == on] {
            _ if before.groups_on == after.groups_on => part,
            [true, false] => 0.0,
            [false, true] => 1.0,
            _ => part.round(),
        };
        Mix { frames, weights: linear(part) }
    }

    /// The light of two frames, each a sum of files, weighted.
    fn mixed<'a>(&self, files: impl Fn(usize) -> Vec<&'a FileRef>, page: usize, mix: &Mix) -> Result<Image> {
        let [width, height] = self.config.pages[page].size();
        let mut mixed = Image::black(width, height);
        for (end, frame) in mix.frames.into_iter().enumerate() {
            let files = files(frame);
            let weights = mix.weights.map(|ends| ends[end]);
            if files.is_empty() || weights == [0.0; 3] {
                continue;
            }
            let light = self.sum_rows(&files, page, 0, height)?;
            for (sum, light) in mixed.texels.iter_mut().zip(light) {
                for c in 0..3 {
                    let value = f64::from(sum[c]) + weights[c] * f64::from(light[c]);
                    sum[c] = value.min(f64::from(f32::MAX)) as f32;
                }
            }
        }
        Ok(mixed)
    }
}

fn linear(part: f64) -> [[f64; 2]; 3] {
    [[1.0 - part, part]; 3]
}

fn add(sum: &mut Image, other: &Image) {
    image::add(&mut sum.texels, &other.texels);
}
